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
