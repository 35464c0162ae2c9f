//! Single scattering (`glsl/single_scatter.comp`): order 1 from delta lights and the environment.

use super::compact::Chunk;
use super::project::Scattering;
use super::scene_data::SceneData;
use super::{LIST_WORKGROUP, order_compute};
use crate::Result;
use crate::abi::SingleScatterPush;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Pipeline, Recorder};
use std::ops::Range;

/// The pass.
pub struct SingleScatter {
    pipeline: Pipeline,
    step: f32,
}

impl SingleScatter {
    /// Makes the pipeline.
    pub fn new(ctx: &Context, scene: &SceneData, step: f32) -> Result<Self> {
        let even_albedo = ("EVEN_ALBEDO", scene.has_even_albedo.into());
        let specialization = [("WORKGROUP", LIST_WORKGROUP), ("ENVIRONMENT", scene.environment), even_albedo];
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::SINGLE_SCATTER, &specialization)?, step })
    }

    /// Rays per cell towards delta lights.
    pub fn light_rays(&self, scene: &SceneData) -> u32 {
        scene.light_count * constants::LIGHT_POINTS
    }

    /// Samples and deposits the environment's light in a chunk of cells from so many `directions`. `is_seen`: the eye shall
    /// see it through what is stored.
    ///
    /// Ordered after all compute accesses before; ends with the projection's sums written by compute.
    pub fn record_environment(
        &self,
        rec: &mut Recorder,
        scattering: &Scattering<'_>,
        chunk: &Chunk<'_>,
        directions: u32,
        is_seen: bool,
    ) {
        scattering.record_blocks(rec, chunk, directions, self.step, is_seen, |rec, block| {
            self.record_rays(rec, scattering, chunk, 0..0, block, directions);
        });
    }

    /// The same for some of the delta lights, whose light the eye does not see through what is stored: the camera adds it without the
    /// stored light's error (`camera.comp`).
    pub fn record_lights(
        &self,
        rec: &mut Recorder,
        scattering: &Scattering<'_>,
        chunk: &Chunk<'_>,
        lights: Range<u32>,
    ) {
        let first = lights.start * constants::LIGHT_POINTS;
        let rays = lights.len() as u32 * constants::LIGHT_POINTS;
        scattering.record_blocks(rec, chunk, rays, self.step, false, |rec, block| {
            self.record_rays(rec, scattering, chunk, first + block.start..first + block.end, 0..0, 0);
        });
    }

    fn record_rays(
        &self,
        rec: &mut Recorder,
        scattering: &Scattering<'_>,
        chunk: &Chunk<'_>,
        lights: Range<u32>,
        environment: Range<u32>,
        environment_directions: u32,
    ) {
        let scene = scattering.scene;
        let push = SingleScatterPush {
            chunk_begin: chunk.begin,
            chunk_items: chunk.items,
            light_begin: lights.start,
            light_end: lights.end,
            environment_begin: environment.start,
            environment_end: environment.end,
            environment_directions,
            step_voxels: self.step,
        };
        let binds = [
            ("scene_block", scene.block.bind()),
            ("emptiness", scattering.emptiness.sampled(Filter::Nearest)),
            ("scattering", scene.scattering(scattering.field).sampled(Filter::Linear)),
            ("lights", scene.lights.bind()),
            ("field", scattering.field.sampled(Filter::Linear)),
            ("environment_image", scene.environment_image.sampled(Filter::Nearest)),
            ("environment_table", scene.environment_table.bind()),
            ("samples", scattering.projection.samples().bind()),
        ];
        order_compute(rec);
        chunk.dispatch(rec, &self.pipeline, &binds, &push, scattering.args);
    }
}
