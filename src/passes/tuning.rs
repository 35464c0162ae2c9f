//! Shapes of the primitives by kind of device: data, measured with `tyndall bench scan|sort` (docs/primitives.md).

use super::radix_sort::RadixSortConfig;
use super::scan::ScanConfig;
use crate::vk::Context;

/// PCI vendor of NVIDIA.
const NVIDIA: u32 = 0x10DE;

/// The shapes for a kind of device.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// Of the scan.
    pub scan: ScanConfig,
    /// Of the radix sort.
    pub sort: RadixSortConfig,
}

impl Tuning {
    /// What is right for any device, and was measured on lavapipe.
    pub fn portable() -> Self {
        Self { scan: ScanConfig::default(), sort: RadixSortConfig::default() }
    }

    /// Measured on an H200. Its workgroups that have started go on running, so that waiting for a while is cheaper than
    /// doing another's work; the limit is there all the same.
    fn nvidia() -> Self {
        let portable = Self::portable();
        let spin_limit = 4096;
        Self {
            scan: ScanConfig { workgroup: 256, vectors: 8, spin_limit, ..portable.scan },
            sort: RadixSortConfig {
                workgroup: Some(384),
                keys: 15,
                masks: true,
                ahead: 4,
                histogram_workgroup: 1024,
                histogram_parts: 8,
                spin_limit,
                ..portable.sort
            },
        }
    }

    /// The shapes for this device.
    pub fn of(ctx: &Context) -> Self {
        // Other subgroup sizes than that measured get what fits every size.
        if ctx.vendor_id() == NVIDIA && ctx.min_subgroup_size() == 32 && ctx.max_subgroup_size() == 32 {
            Self::nvidia()
        } else {
            Self::portable()
        }
    }
}
