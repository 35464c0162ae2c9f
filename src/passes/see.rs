//! Which cells the eye sees (`glsl/see.comp`).

use super::compact::Marks;
use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::SeePush;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};

/// The pass.
pub struct See {
    pipeline: Pipeline,
}

/// Step of its rays in voxels.
pub const STEP: f32 = 1.0;

/// Invocations of a workgroup along each axis.
const WORKGROUP: u32 = 8;

/// Rays per pixel along each axis of the picture: about two per voxel along the volume's longest axis, and no more than a grid
/// of one dispatch takes.
pub fn rays(dims: [u32; 3], size: [u32; 2]) -> u32 {
    let longest = f64::from(dims.into_iter().max().expect("three axes"));
    let side = (f64::from(size[0]) * f64::from(size[1])).sqrt();
    let most = constants::MAX_GRID * WORKGROUP / size[0];
    ((2.0 * longest / side).ceil() as u32).min(most)
}

impl See {
    /// Makes the pipeline.
    pub fn new(ctx: &Context) -> Result<Self> {
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::SEE, &[])? })
    }

    /// Adds to `marks`, which are recorded, what the rays in the rows `rows` of rays see of the extinction in `field`.
    /// Ordered after all compute accesses before; ends with the marks written by compute.
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        field: &Image,
        emptiness: &Image,
        marks: &Marks,
        rows: std::ops::Range<u32>,
    ) {
        let size = scene.params.size;
        let rays = rays(scene.params.dims, size);
        order_compute(rec);
        let push = SeePush { rays, row_begin: rows.start, row_end: rows.end, step_voxels: STEP };
        let binds = [
            ("scene_block", scene.block.bind()),
            ("field", field.sampled(Filter::Linear)),
            ("emptiness", emptiness.sampled(Filter::Nearest)),
            ("marks", marks.image.storage()),
        ];
        let groups = [(size[0] * rays).div_ceil(WORKGROUP), (rows.len() as u32).div_ceil(WORKGROUP), 1];
        rec.dispatch(&self.pipeline, &binds, &push, groups);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_fit_into_a_grid_whatever_the_picture() {
        assert_eq!(rays([128, 64, 32], [128, 128]), 2);
        assert_eq!(rays([128; 3], [512, 512]), 1);
        for (dims, size) in
            [([16384; 3], [16384, 1]), ([16384; 3], [1, 16384]), ([16384; 3], [1, 1]), ([1; 3], [16384; 2])]
        {
            let rays = rays(dims, size);
            assert!(
                rays >= 1 && (size[0] * rays).div_ceil(WORKGROUP) <= constants::MAX_GRID,
                "{dims:?} {size:?}: {rays}"
            );
        }
    }
}
