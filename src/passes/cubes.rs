//! The largest aligned cube of one value around every voxel (`glsl/cubes.comp`): what rays may cross in one step.

use super::order_compute;
use crate::Result;
use crate::abi::CubesPush;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};

/// The pass, and what it finds.
pub struct Cubes {
    /// By `constants::CUBES_*`.
    stages: [Pipeline; 3],
    merged: Image,
    levels: u32,
    /// Value and level << `constants::CUBES_VALUE_BITS` of every voxel.
    pub image: Image,
}

impl Cubes {
    /// Makes pipelines and images for a grid of `dims` voxels.
    pub fn new(ctx: &Context, dims: [u32; 3]) -> Result<Self> {
        let stage = |stage| Pipeline::new(ctx, &shaders::CUBES, &[("STAGE", stage)]);
        let image = |name| ctx.image_3d(name, dims, ImageFormat::R32Uint);
        Ok(Self {
            stages: [stage(constants::CUBES_COPY)?, stage(constants::CUBES_MERGE)?, stage(constants::CUBES_SPREAD)?],
            merged: image("cubes.merged")?,
            levels: levels(dims),
            image: image("cubes")?,
        })
    }

    /// Finds the cubes of `values`, which are below 1 << `constants::CUBES_VALUE_BITS`. Ordered after all compute
    /// accesses before; ends with [`Cubes::image`] written by compute.
    pub fn record(&self, rec: &mut Recorder, values: &Image) {
        let mut dispatch = |stage: u32, level: u32, edge: u32| {
            order_compute(rec);
            let binds = [
                ("values", values.sampled(Filter::Nearest)),
                ("merged", self.merged.storage()),
                ("cubes", self.image.storage()),
            ];
            let groups = self.image.extent().map(|d| d.div_ceil(4 * edge));
            rec.dispatch(&self.stages[stage as usize], &binds, &CubesPush { level }, groups);
        };
        dispatch(constants::CUBES_COPY, 0, 1);
        for level in 1..=self.levels {
            dispatch(constants::CUBES_MERGE, level, 1 << level);
        }
        dispatch(constants::CUBES_SPREAD, self.levels, 1);
    }
}

/// Levels of cubes in a grid of `dims` voxels: the last one spans it, if that is not too large a cube.
pub fn levels(dims: [u32; 3]) -> u32 {
    let longest = dims.into_iter().max().unwrap_or(1);
    longest.next_power_of_two().ilog2().min(constants::CUBES_LEVELS)
}
