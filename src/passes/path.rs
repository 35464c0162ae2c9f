//! The path tracer (`glsl/path.comp`), and what it flies through (`glsl/extinction.comp`, `glsl/majorant.comp`).

use super::classify::voxel_grid;
use super::emptiness::{Emptiness, cells};
use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::{PathPush, PathState};
use crate::scene::Background;
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Filter, Image, ImageFormat, Pipeline, Recorder};
use std::ops::Range;

/// When paths end.
#[derive(Clone, Copy, Debug)]
pub struct PathConfig {
    /// Most scatterings of a path.
    pub orders: u32,
    /// `orders` is a mere cap: paths also end by Russian roulette, and what the cap cuts is counted.
    pub is_unlimited: bool,
}

/// The pass, with the volume as it sees it and the sums so far.
pub struct PathTracer {
    config: PathConfig,
    extinction_pipeline: Pipeline,
    majorant_pipeline: Pipeline,
    pipeline: Pipeline,
    extinction: Image,
    majorants: Image,
    paths: Buffer<PathState>,
    /// `constants::TALLY_WORDS` words about the latest dispatch.
    pub tally: Buffer<u32>,
    /// Sums of the samples, then of their squares, each as high and low part (`path.comp`).
    pub sums: [Image; 4],
    event_cost: u32,
}

impl PathTracer {
    /// Makes pipelines and images. A dispatch renders at most `band_pixels`.
    pub fn new(
        ctx: &Context,
        scene: &SceneData,
        background: Background,
        config: PathConfig,
        band_pixels: u32,
    ) -> Result<Self> {
        let p = &scene.params;
        let specialization = [
            ("ANISOTROPIC", (p.g != 0.0).into()),
            ("ENVIRONMENT", scene.environment),
            ("BACKGROUND", super::camera::behind(background)),
            ("LIT", (scene.light_count > 0).into()),
            ("POINT_LIGHTS", scene.has_point_lights.into()),
            ("EMITS", scene.has_emission.into()),
            ("EVEN_ALBEDO", (!scene.has_emission && scene.has_even_albedo).into()),
            ("UNLIMITED", config.is_unlimited.into()),
        ];
        let [rows, columns] = [p.environment_size[1], p.environment_size[0]];
        let halvings = |n: u32| n.max(1).ilog2() + 2;
        let image = |name| ctx.image_2d(name, p.size, ImageFormat::Rgba32Float);
        Ok(Self {
            config,
            extinction_pipeline: Pipeline::new(ctx, &shaders::EXTINCTION, &[])?,
            majorant_pipeline: Pipeline::new(ctx, &shaders::MAJORANT, &[])?,
            pipeline: Pipeline::new(ctx, &shaders::PATH, &specialization)?,
            extinction: ctx.image_3d("path.extinction", p.dims, ImageFormat::R32Float)?,
            majorants: ctx.image_3d("path.majorants", cells(p.dims, constants::CELL_SIZE), ImageFormat::R32Float)?,
            paths: ctx.device_buffer("path.states", band_pixels as usize)?,
            tally: ctx.device_buffer("path.tally", constants::TALLY_WORDS as usize)?,
            sums: [image("path.sums")?, image("path.sums.low")?, image("path.squares")?, image("path.squares.low")?],
            // Its searches and its loop over the lights.
            event_cost: 1 + halvings(p.transfer_points) + scene.light_count + halvings(rows) + halvings(columns),
        })
    }

    /// Relative extinction of every voxel.
    pub fn extinction(&self) -> &Image {
        &self.extinction
    }

    /// Majorants of the macrocells.
    pub fn majorants(&self) -> &Image {
        &self.majorants
    }

    /// Loop iterations that a dispatch needs at least to get on.
    pub fn least_budget(&self) -> u32 {
        2 * self.event_cost
    }

    /// Extinction, empty space and majorants of the scene; sums of zero; `tally` gets the
    /// number of active voxels. For new images only: ordered after nothing.
    pub fn record_set_up(&self, rec: &mut Recorder, scene: &SceneData, emptiness: &Emptiness) {
        self.record_clear(rec);
        rec.fill(&self.tally, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("transfer_block", scene.transfer.bind()),
            ("scalar", scene.scalar.sampled(Filter::Nearest)),
            ("extinction", self.extinction.storage()),
            ("tally", self.tally.bind()),
        ];
        rec.dispatch(&self.extinction_pipeline, &binds, &(), voxel_grid(scene.params.dims));
        emptiness.record(rec, scene, &self.extinction);
        order_compute(rec);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("extinction", self.extinction.sampled(Filter::Nearest)),
            ("emptiness", emptiness.image.sampled(Filter::Nearest)),
            ("majorants", self.majorants.storage()),
        ];
        rec.dispatch(
            &self.majorant_pipeline,
            &binds,
            &(),
            cells(scene.params.dims, constants::CELL_SIZE).map(|c| c.div_ceil(4)),
        );
    }

    /// Sets the sums to zero ([`Access::TransferWrite`]).
    pub fn record_clear(&self, rec: &mut Recorder) {
        for image in &self.sums {
            rec.clear_image(image);
        }
    }

    /// Starts a round of samples in a band of rows: no path is under way, no sample done. Ordered after all compute
    /// accesses before; ends with the states written by a transfer.
    pub fn record_begin(&self, rec: &mut Recorder) {
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.paths, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
    }

    /// Goes on with the round `samples` of the pixels in `rows`, for at most `budget` loop iterations each. `tally` says
    /// afterwards how many pixels are not done yet. Ordered after all compute accesses before.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, rows: Range<u32>, samples: Range<u32>, budget: u32) {
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.tally, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        let push = PathPush {
            row_begin: rows.start,
            row_end: rows.end,
            sample_begin: samples.start,
            sample_count: samples.end - samples.start,
            orders: self.config.orders,
            light_count: scene.light_count,
            budget: budget.clamp(self.least_budget(), constants::MAX_ITERATIONS - self.event_cost),
            event_cost: self.event_cost,
        };
        let mut binds = vec![
            ("scene_block", scene.block.bind()),
            ("transfer_block", scene.transfer.bind()),
            ("majorants", self.majorants.storage()),
            ("extinction", self.extinction.storage()),
            ("scalar", scene.scalar.sampled(Filter::Nearest)),
            ("lights", scene.lights.bind()),
            ("environment_image", scene.environment_image.sampled(Filter::Nearest)),
            ("environment_table", scene.environment_table.bind()),
            ("paths", self.paths.bind()),
            ("tally", self.tally.bind()),
        ];
        let names = ["sums", "sums_low", "squares", "squares_low"];
        binds.extend(names.into_iter().zip(&self.sums).map(|(name, image)| (name, image.storage())));
        let groups = [scene.params.size[0].div_ceil(8), (rows.end - rows.start).div_ceil(8), 1];
        rec.dispatch(&self.pipeline, &binds, &push, groups);
    }
}
