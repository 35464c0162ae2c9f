//! Which cells the eye sees, and which it reaches (`glsl/see.comp`).

use super::compact::Marks;
use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::{SceneParams, SeePush};
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};
use glam::Vec3;

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

/// Do these rays meet every cell that any ray of the eye may meet, or its neighbour? Where they are at most a cell apart on the
/// far side of the volume, which they are not if the volume is far away and small in the picture.
pub fn is_dense(params: &SceneParams) -> bool {
    let rays = rays(params.dims, params.size) as f32;
    let vector = |v: [f32; 3]| Vec3::from(v);
    let axes = [params.world_of_x, params.world_of_y, params.world_of_z].map(vector);
    let corner = |i: u32| {
        let along = |axis: usize| axes[axis] * if i >> axis & 1 == 0 { 0.0 } else { params.dims[axis] as f32 };
        vector(params.world_of_origin) + along(0) + along(1) + along(2)
    };
    let eye = vector(params.eye);
    let farthest = (0..8).map(|i| (corner(i) - eye).dot(vector(params.forward))).fold(0.0, f32::max);
    // The picture is 2 |right| wide at distance 1.
    let apart = |side: [f32; 3], pixels: u32| 2.0 * vector(side).length() * farthest / (pixels as f32 * rays);
    let least = axes.map(Vec3::length).into_iter().fold(f32::INFINITY, f32::min) * params.light_edge as f32;
    apart(params.right, params.size[0]).max(apart(params.up, params.size[1])) <= least
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

    /// An axis-aligned volume of 40 voxels whose far side is 70 away, seen by an eye whose picture is `width` wide at distance 1.
    #[test]
    fn rays_are_dense_where_neighbours_are_a_cell_apart_on_the_far_side() {
        let dense = |width: f32, light_edge: u32| {
            is_dense(&SceneParams {
                dims: [40; 3],
                light_edge,
                size: [100, 100],
                world_of_x: [1.0, 0.0, 0.0],
                world_of_y: [0.0, 1.0, 0.0],
                world_of_z: [0.0, 0.0, 1.0],
                world_of_origin: [-20.0; 3],
                eye: [0.0, 0.0, -50.0],
                forward: [0.0, 0.0, 1.0],
                right: [0.5 * width, 0.0, 0.0],
                up: [0.0, 0.5 * width, 0.0],
                ..bytemuck::Zeroable::zeroed()
            })
        };
        assert_eq!(rays([40; 3], [100, 100]), 1);
        // 100 rays over 70 times the width.
        assert!(dense(1.42, 1) && !dense(1.44, 1));
        assert!(dense(2.84, 2) && !dense(2.88, 2));
    }

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
