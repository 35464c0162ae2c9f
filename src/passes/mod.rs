//! The passes: sizes, scratch memory, and `record()`, which appends a pass to a [`Recorder`].
//!
//! Every kernel starts by ordering itself after the compute accesses recorded before; see each `record`.

pub mod bench_copy;
pub mod bench_rays;
pub mod camera;
pub mod classify;
pub mod compact;
pub mod cubes;
pub mod emptiness;
pub mod gather;
pub mod lookback;
pub mod mips;
pub mod path;
pub mod phase_probe;
pub mod phong;
pub mod pilot;
pub mod project;
pub mod proxy;
pub mod quantiser;
pub mod radix_sort;
pub mod scan;
pub mod scene_data;
pub mod see;
pub mod select;
pub mod single_scatter;
pub mod spread;
pub mod tuning;

use crate::scene::Precision;
use crate::shaders::ShaderInfo;
use crate::shaders::constants::MAX_ITERATIONS;
use crate::vk::{Access, ImageFormat, Recorder};

/// Workgroup size of kernels over lists.
pub const LIST_WORKGROUP: u32 = 64;

/// The given share of `count` directions: at least one, but none of a share of 0.
pub(crate) fn share_of(count: u32, share: f32) -> u32 {
    if share == 0.0 { 0 } else { ((count as f32 * share).ceil() as u32).max(1) }
}

/// The format that fields of light and extinction have.
fn stored_format(precision: Precision) -> ImageFormat {
    match precision {
        Precision::Half => ImageFormat::Rgba16Float,
        Precision::Single => ImageFormat::Rgba32Float,
    }
}

/// The version of a kernel that writes them.
fn storing(precision: Precision, half: &'static ShaderInfo, single: &'static ShaderInfo) -> &'static ShaderInfo {
    match precision {
        Precision::Half => half,
        Precision::Single => single,
    }
}

/// Orders everything that compute shaders did before everything that they do next.
pub(crate) fn order_compute(rec: &mut Recorder) {
    rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
}

/// Loop iterations that a ray through a volume may take: the longest diagonal in steps, and what rounding adds.
pub fn ray_iterations(dims: [u32; 3], step_voxels: f32) -> u32 {
    let diagonal = dims.iter().map(|&d| f64::from(d).powi(2)).sum::<f64>().sqrt();
    // Every skipped cell may cost a step more than its length says; the first steps are short.
    (diagonal / f64::from(step_voxels)).ceil() as u32 + 12
}

/// Rays that one invocation may follow within the loop budget; at least 1.
pub fn rays_per_invocation(dims: [u32; 3], step_voxels: f32) -> u32 {
    // A tenth is left for the loops around the rays.
    ((MAX_ITERATIONS - MAX_ITERATIONS / 10) / ray_iterations(dims, step_voxels)).max(1)
}
