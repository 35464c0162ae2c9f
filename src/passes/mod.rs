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
pub mod points;
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
use crate::vk::{Access, Context, ImageFormat, Recorder};

/// Workgroup size of kernels over lists.
pub const LIST_WORKGROUP: u32 = 64;

/// The given share of `count` directions: at least one, but none of a share of 0.
pub(crate) fn share_of(count: u32, share: f32) -> u32 {
    if share == 0.0 { 0 } else { ((count as f32 * share).ceil() as u32).max(1) }
}

/// How light is stored: fields of light and extinction, and sums of light. Where a scene has no colour, one channel is enough for
/// it (`glsl/include/stored.glsl`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stored {
    /// Of the fields.
    pub precision: Precision,
    /// One channel instead of three.
    pub is_grey: bool,
}

impl Stored {
    /// One channel where one is enough and the device has images of two.
    pub fn of(ctx: &Context, precision: Precision, is_grey: bool) -> Self {
        let stored = Self { precision, is_grey };
        Self { is_grey: is_grey && ctx.stores_fields(stored.format()), ..stored }
    }

    /// The format of fields of light and extinction.
    pub fn format(self) -> ImageFormat {
        match (self.precision, self.is_grey) {
            (Precision::Half, false) => ImageFormat::Rgba16Float,
            (Precision::Half, true) => ImageFormat::GreyAlpha16Float,
            (Precision::Single, false) => ImageFormat::Rgba32Float,
            (Precision::Single, true) => ImageFormat::GreyAlpha32Float,
        }
    }

    /// The format of sums.
    fn sum_format(self) -> ImageFormat {
        if self.is_grey { ImageFormat::R32Float } else { ImageFormat::Rgba32Float }
    }

    /// Of a kernel's versions, in the order of `build.rs`, the one that writes them. A kernel that writes sums only has two.
    fn version<const N: usize>(self, versions: [&'static ShaderInfo; N]) -> &'static ShaderInfo {
        let of_all = 2 * usize::from(self.precision == Precision::Single) + usize::from(self.is_grey);
        versions[of_all % N]
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
