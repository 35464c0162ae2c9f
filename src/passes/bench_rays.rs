//! Rays through one of the structures that `tyndall bench proxy` compares (`glsl/bench_rays.comp`).

use super::scene_data::SceneData;
use super::{LIST_WORKGROUP, order_compute, ray_iterations};
use crate::Result;
use crate::abi::BenchRaysPush;
use crate::shaders::{self, constants};
use crate::vk::{Buffer, Context, Filter, Image, Pipeline, Recorder};

/// How rays go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayConfig {
    /// `constants::STRUCTURE_*`.
    pub structure: u32,
    /// Voxels along the edge of a macrocell of what is skipped.
    pub edge: u32,
    /// Step in voxels.
    pub step: f32,
    /// Of mips: steps in full resolution.
    pub reach: f32,
}

/// What rays read. What a structure does not use may be anything of the kind.
#[derive(Clone, Copy)]
pub struct RayInputs<'a> {
    /// Rgb = source function, a = extinction.
    pub source: &'a Image,
    /// Distances by octant, which estimates in fixed steps skip by, too.
    pub emptiness: &'a Image,
    /// What else exact rays skip by.
    pub skips: &'a Image,
    /// Buckets, cubes, or light and extinction of every voxel.
    pub values: &'a Image,
    /// Light and extinction of every bucket.
    pub bucket_light: &'a Buffer<u32>,
    /// Light and extinction in half and quarter resolution.
    pub coarse_values: [&'a Image; 2],
    /// The same, to be interpolated.
    pub coarse_source: [&'a Image; 2],
}

/// The pass for one structure.
pub struct BenchRays {
    config: RayConfig,
    timed: Pipeline,
    counted: Pipeline,
    /// In place of counts.
    none: Buffer<[u32; 3]>,
}

/// Cells of a dispatch, which should be short.
const CELLS: u32 = 4096;
/// Iterations that a structure may take for one step: those that enter and leave nodes and cells among them.
const ITERATIONS_PER_STEP: u32 = 4;

impl BenchRays {
    /// Makes the pipelines: one that is timed, and one that counts.
    pub fn new(ctx: &Context, config: RayConfig) -> Result<Self> {
        let pipeline = |is_counted: bool| {
            let specialization = [
                ("WORKGROUP", LIST_WORKGROUP),
                ("STRUCTURE", config.structure),
                ("EDGE", config.edge),
                ("COUNTED", is_counted.into()),
            ];
            Pipeline::new(ctx, &shaders::BENCH_RAYS, &specialization)
        };
        Ok(Self {
            config,
            timed: pipeline(false)?,
            counted: pipeline(true)?,
            none: ctx.device_buffer("bench.none", 1)?,
        })
    }

    /// Follows rays in `directions` directions from each of `cells`, linear indices. `results`, `[direction][cell]`: radiance
    /// (mean of the channels, times radiance_scale) and transmittance. With `counts`, in the same order: steps,
    /// trilinear samples and nearest reads of every ray.
    ///
    /// Ordered after all compute accesses before; ends with `results` and `counts` written by compute.
    #[allow(clippy::too_many_arguments, reason = "what is read and written is named one by one")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        inputs: RayInputs<'_>,
        cells: &Buffer<u32>,
        directions: u32,
        results: &Buffer<[f32; 2]>,
        counts: Option<&Buffer<[u32; 3]>>,
    ) {
        let iterations = ITERATIONS_PER_STEP * ray_iterations(scene.params.dims, self.config.step.min(1.0));
        let block = (constants::MAX_ITERATIONS / iterations).clamp(1, directions);
        let cell_count = cells.len() as u32;
        for cell_begin in (0..cell_count).step_by(CELLS as usize) {
            let cell_end = cell_count.min(cell_begin + CELLS);
            let push = BenchRaysPush {
                cell_begin,
                cell_end,
                cell_count,
                directions,
                block,
                step_voxels: self.config.step,
                reach: self.config.reach,
            };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("source", inputs.source.sampled(Filter::Linear)),
                ("emptiness", inputs.emptiness.sampled(Filter::Nearest)),
                ("skips", inputs.skips.sampled(Filter::Nearest)),
                ("values", inputs.values.sampled(Filter::Nearest)),
                ("bucket_light", inputs.bucket_light.bind()),
                ("half_values", inputs.coarse_values[0].sampled(Filter::Nearest)),
                ("quarter_values", inputs.coarse_values[1].sampled(Filter::Nearest)),
                ("half_source", inputs.coarse_source[0].sampled(Filter::Linear)),
                ("quarter_source", inputs.coarse_source[1].sampled(Filter::Linear)),
                ("cells", cells.bind()),
                ("results", results.bind()),
                ("counts", counts.unwrap_or(&self.none).bind()),
            ];
            let groups = [(cell_end - cell_begin).div_ceil(LIST_WORKGROUP), directions.div_ceil(block), 1];
            order_compute(rec);
            let pipeline = if counts.is_some() { &self.counted } else { &self.timed };
            rec.dispatch(pipeline, &binds, &push, groups);
        }
    }
}
