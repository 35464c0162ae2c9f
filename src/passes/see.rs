//! Which cells the eye sees, and which it reaches (`glsl/see.comp`).

use super::compact::Marks;
use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::{SceneParams, SeePush};
use crate::cpu::scene::world_from_index;
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

/// The rays of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rays {
    /// Along each axis of the picture.
    pub per_pixel: u32,
    /// Do they meet every cell that any ray of the eye may meet, or its neighbour?
    pub is_dense: bool,
}

/// So many rays that they are at most a cell apart on the far side of the volume, and no fewer than two per voxel of its longest
/// axis, since cells that are seen and missed are noisier. Not so many if it is far away and small in the picture, or more than
/// a grid of one dispatch takes: eight per voxel must do.
pub fn rays(params: &SceneParams) -> Rays {
    let vector = |v: [f32; 3]| Vec3::from(v);
    let axes = [params.world_of_x, params.world_of_y, params.world_of_z].map(vector);
    let corner = |i: u32| {
        let at = [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { 0.0 } else { params.dims[axis] as f32 });
        world_from_index(params, Vec3::from(at))
    };
    let eye = vector(params.eye);
    let farthest = (0..8).map(|i| (corner(i) - eye).dot(vector(params.forward))).fold(0.0, f32::max);
    // The picture is 2 |right| wide at distance 1.
    let apart = |side: [f32; 3], pixels: u32| 2.0 * vector(side).length() * farthest / pixels as f32;
    let cell = axes.map(Vec3::length).into_iter().fold(f32::INFINITY, f32::min) * params.light_edge as f32;
    let needed = (apart(params.right, params.size[0]).max(apart(params.up, params.size[1])) / cell).ceil() as u32;
    let longest = params.dims.into_iter().max().expect("three axes") as f32;
    let [width, height] = params.size.map(|n| n as f32);
    let of_grid = constants::MAX_GRID * WORKGROUP / params.size[0];
    let per_voxel = |n: f32| ((n * longest / (width * height).sqrt()).ceil() as u32).min(of_grid);
    let most = per_voxel(8.0);
    Rays { per_pixel: needed.clamp(per_voxel(2.0), most), is_dense: needed <= most }
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
        let rays = rays(&scene.params).per_pixel;
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

    /// A volume of 40 voxels along each axis, whose far side is 70 away, seen by an eye whose picture is `width` wide at distance
    /// 1.
    fn params(size: [u32; 2], width: f32, light_edge: u32) -> SceneParams {
        SceneParams {
            dims: [40; 3],
            light_edge,
            size,
            world_of_x: [1.0, 0.0, 0.0],
            world_of_y: [0.0, 1.0, 0.0],
            world_of_z: [0.0, 0.0, 1.0],
            world_of_origin: [-20.0; 3],
            eye: [0.0, 0.0, -50.0],
            forward: [0.0, 0.0, 1.0],
            right: [0.5 * width, 0.0, 0.0],
            up: [0.0, 0.5 * width, 0.0],
            ..bytemuck::Zeroable::zeroed()
        }
    }

    #[test]
    fn neighbours_are_a_cell_apart_on_the_far_side() {
        let of = |per_pixel, is_dense| Rays { per_pixel, is_dense };
        // 100 rays over 70 times the width.
        assert_eq!(rays(&params([100; 2], 1.42, 1)), of(1, true));
        assert_eq!(rays(&params([100; 2], 1.44, 1)), of(2, true));
        assert_eq!(rays(&params([100; 2], 2.84, 2)), of(1, true));
        assert_eq!(rays(&params([100; 2], 2.88, 2)), of(2, true));
        // Four per pixel are most.
        assert_eq!(rays(&params([100; 2], 5.71, 1)), of(4, true));
        assert_eq!(rays(&params([100; 2], 5.72, 1)), of(4, false));
    }

    #[test]
    fn rays_fit_into_a_grid_whatever_the_picture() {
        for dims in [[16384; 3], [1; 3]] {
            for size in [[16384, 1], [1, 16384], [1, 1], [16384; 2]] {
                for width in [0.0, 1e-6, 1.0, 1e30, f32::INFINITY] {
                    let rays = rays(&SceneParams { dims, ..params(size, width, 1) }).per_pixel;
                    assert!(
                        rays >= 1 && (size[0] * rays).div_ceil(WORKGROUP) <= constants::MAX_GRID,
                        "{dims:?} {size:?} {width}: {rays}"
                    );
                }
            }
        }
    }
}
