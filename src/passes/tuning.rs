//! Shapes of the primitives by kind of device: data, measured with `tyndall bench scan|sort` (docs/primitives.md). And on which
//! drivers they look back.

use super::lookback::Carry;
use super::radix_sort::RadixSortConfig;
use super::scan::ScanConfig;
use crate::vk::{Context, DriverId};

/// PCI vendor of NVIDIA.
const NVIDIA: u32 = 0x10DE;

/// Drivers that are known to go on running the workgroups that they have started: what look-back by ticket needs in order not
/// to wait for long. Vulkan promises no such thing, and no query tells.
///
/// Sorensen and others tested GPUs for it; the table of Smith, Levien and Owens ("Decoupled Fallback", 2025) has NVIDIA's, AMD's
/// and Intel's as those that do, Apple's M1 and M3 and Arm's Mali-G78 as those that do not. Other drivers of the same GPUs, such
/// as Mesa's for NVIDIA, were tested by nobody that we know of, and are left out.
const LOOK_BACK_DRIVERS: [DriverId; 7] = [
    // The table; and run on an H100 and an H200 (docs/primitives.md).
    DriverId::NVIDIA_PROPRIETARY,
    // The table. Not run here.
    DriverId::AMD_PROPRIETARY,
    DriverId::AMD_OPEN_SOURCE,
    DriverId::MESA_RADV,
    DriverId::INTEL_PROPRIETARY_WINDOWS,
    DriverId::INTEL_OPEN_SOURCE_MESA,
    // lavapipe: its workgroups run to their end on threads of the operating system, and all tests run on it.
    DriverId::MESA_LLVMPIPE,
];

/// How sums get from tile to tile on a driver: by look-back where it is known to do well, else between dispatches.
pub fn carry_of(driver: DriverId) -> Carry {
    if LOOK_BACK_DRIVERS.contains(&driver) { Carry::LookBack } else { Carry::Dispatches }
}

/// The same for a context, which may know better ([`ContextConfig::forward_progress`]).
///
/// [`ContextConfig::forward_progress`]: crate::vk::ContextConfig::forward_progress
pub fn carry_on(ctx: &Context) -> Carry {
    match ctx.forward_progress() {
        Some(true) => Carry::LookBack,
        Some(false) => Carry::Dispatches,
        None => carry_of(ctx.device_info().driver_id),
    }
}

/// Invocations of a workgroup of `column_scan.comp`, which takes 16 rows for each at a time: on processors, where invocations that have
/// nothing to do cost as much as others, few.
pub(super) fn column_workgroup(ctx: &Context) -> u32 {
    if ctx.is_cpu() { ctx.max_subgroup_size().max(32) } else { 256 }
}

/// The shapes for a kind of device.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// Of the scan.
    pub scan: ScanConfig,
    /// Of the radix sort.
    pub sort: RadixSortConfig,
}

impl Tuning {
    /// What is right for any device.
    pub fn portable() -> Self {
        Self { scan: ScanConfig::default(), sort: RadixSortConfig::default() }
    }

    /// Measured on lavapipe. There what no lane does costs as much as what all do, operations of a subgroup go lane by lane, and
    /// caches are large: so few of them per item, by runs of items.
    fn processor() -> Self {
        let portable = Self::portable();
        Self {
            scan: ScanConfig { workgroup: 64, vectors: 208, blocked: true, ..portable.scan },
            sort: RadixSortConfig { keys: 2040, blocked: true, ..portable.sort },
        }
    }

    /// Measured on an H200 and an H100. Their workgroups that have started go on running, so that waiting for a while, some 0.2 ms,
    /// is cheaper than doing another's work; the limit is there all the same.
    fn nvidia() -> Self {
        let portable = Self::portable();
        let spin_limit = 256;
        Self {
            scan: ScanConfig { workgroup: 256, vectors: 8, spin_limit, ..portable.scan },
            sort: RadixSortConfig {
                workgroup: Some(384),
                keys: 15,
                mask_rows: 11,
                ahead: 4,
                histogram_workgroup: 1024,
                spin_limit,
                ..portable.sort
            },
        }
    }

    /// The shapes for this device.
    pub fn of(ctx: &Context) -> Self {
        // Other subgroup sizes than that measured get what fits every size.
        let is_nvidia = ctx.vendor_id() == NVIDIA && ctx.min_subgroup_size() == 32 && ctx.max_subgroup_size() == 32;
        let Self { scan, sort } = if is_nvidia {
            Self::nvidia()
        } else if ctx.is_cpu() {
            Self::processor()
        } else {
            Self::portable()
        };
        let carry = carry_on(ctx);
        Self { scan: ScanConfig { carry, ..scan }, sort: RadixSortConfig { carry, ..sort } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shaders::constants;

    #[test]
    fn the_loop_budget_has_room_for_several_tiles_that_do_not_come_forth() {
        for Tuning { scan, sort } in [Tuning::portable(), Tuning::processor(), Tuning::nvidia()] {
            let run = if sort.blocked { constants::RADIX_RUN_VECTORS } else { 0 };
            for (spin_limit, steps_each, more) in [(scan.spin_limit, 1, 0), (sort.spin_limit, sort.ahead, run)] {
                let each = (spin_limit + 1) * steps_each + constants::FALLBACK_STEPS + more;
                assert!(10 * each < constants::LOOKBACK_BUDGET, "{each} of {}", constants::LOOKBACK_BUDGET);
            }
        }
        const { assert!(constants::LOOKBACK_BUDGET <= constants::MAX_ITERATIONS / 2) };
    }

    #[test]
    fn drivers_that_nobody_vouches_for_do_not_look_back() {
        assert_eq!(carry_of(DriverId::NVIDIA_PROPRIETARY), Carry::LookBack);
        assert_eq!(carry_of(DriverId::MESA_LLVMPIPE), Carry::LookBack);
        for driver in [DriverId::MOLTENVK, DriverId::ARM_PROPRIETARY, DriverId::QUALCOMM_PROPRIETARY] {
            assert_eq!(carry_of(driver), Carry::Dispatches);
        }
        // Of a device that does not say, and of a driver of tomorrow.
        for driver in [0, 9999] {
            assert_eq!(carry_of(DriverId::from_raw(driver)), Carry::Dispatches);
        }
    }
}
