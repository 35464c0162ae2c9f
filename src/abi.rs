//! Structs shared with GLSL. `build.rs` checks size, offsets and member types of each against the shaders.

use bytemuck::{Pod, Zeroable};

/// `canary.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CanaryPush {
    /// Words to copy.
    pub count: u32,
    /// Added to the index of what is written.
    pub shift: u32,
}

/// `dispatch_args.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct DispatchArgsPush {
    /// Element of `counts` that holds the count.
    pub offset: u32,
    /// Largest count that there is room for.
    pub capacity: u32,
    /// Items per workgroup of the two dispatches.
    pub tile_items: [u32; 2],
}

/// `scan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ScanPush {
    /// Items, or `COUNT_ON_DEVICE`.
    pub count: u32,
}

/// `radix_histogram.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixHistogramPush {
    /// Keys, or `COUNT_ON_DEVICE`.
    pub count: u32,
    /// First bit to sort by.
    pub bit_begin: u32,
    /// Bit after the last to sort by.
    pub bit_end: u32,
}

/// `radix_scan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixScanPush {
    /// Status rows per pass: tiles + 1.
    pub rows: u32,
}

/// `radix_onesweep.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixOnesweepPush {
    /// Pairs, or `COUNT_ON_DEVICE`.
    pub count: u32,
    /// Which digit, from 0.
    pub pass: u32,
    /// First bit to sort by.
    pub bit_begin: u32,
    /// Bit after the last to sort by.
    pub bit_end: u32,
    /// Status rows per pass: tiles + 1.
    pub rows: u32,
}
