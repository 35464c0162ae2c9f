//! Which cells the eye sees (`glsl/see.comp`).

use super::compact::Marks;
use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::SeePush;
use crate::shaders;
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};

/// The pass.
pub struct See {
    pipeline: Pipeline,
}

/// Step of its rays in voxels.
pub const STEP: f32 = 1.0;

/// Rays per pixel along each axis of the picture: about two per voxel along the volume's longest axis.
pub fn rays(dims: [u32; 3], size: [u32; 2]) -> u32 {
    let longest = f64::from(dims.into_iter().max().expect("three axes"));
    let side = (f64::from(size[0]) * f64::from(size[1])).sqrt();
    (2.0 * longest / side).ceil() as u32
}

impl See {
    /// Makes the pipeline.
    pub fn new(ctx: &Context) -> Result<Self> {
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::SEE, &[])? })
    }

    /// Adds to `marks`, which are recorded, what rays in the rows `rows` of pixels see of the extinction in `field`.
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
        let push = SeePush { rays, row_begin: rows.start * rays, row_end: rows.end * rays, step_voxels: STEP };
        let binds = [
            ("scene_block", scene.block.bind()),
            ("field", field.sampled(Filter::Linear)),
            ("emptiness", emptiness.sampled(Filter::Nearest)),
            ("marks", marks.image.storage()),
        ];
        let groups = [(size[0] * rays).div_ceil(8), (rows.len() as u32 * rays).div_ceil(8), 1];
        rec.dispatch(&self.pipeline, &binds, &push, groups);
    }
}
