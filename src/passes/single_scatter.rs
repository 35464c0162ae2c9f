//! Single scattering (`glsl/single_scatter.comp`): order 1 from delta lights and the environment.

use super::compact::{Chunk, ChunkArgs};
use super::contribute::Orders;
use super::scene_data::SceneData;
use super::{contribute, order_compute, rays_per_invocation};
use crate::Result;
use crate::abi::SingleScatterPush;
use crate::shaders;
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};

/// The pass.
pub struct SingleScatter {
    pipeline: Pipeline,
    directions: u32,
    step: f32,
    has_next: bool,
}

impl SingleScatter {
    /// Makes the pipeline. `directions`: samples of the environment per voxel; `has_next`: another order follows.
    pub fn new(ctx: &Context, scene: &SceneData, directions: u32, step: f32, has_next: bool) -> Result<Self> {
        let common = contribute::specialization(scene, has_next);
        let specialization = [&common[..], &[("ENVIRONMENT", scene.environment)]].concat();
        Ok(Self {
            pipeline: Pipeline::new(ctx, &shaders::SINGLE_SCATTER, &specialization)?,
            directions,
            step,
            has_next,
        })
    }

    /// Delta lights whose light is cached: it is for the next order only.
    fn lights(&self, scene: &SceneData) -> u32 {
        if self.has_next { scene.light_count } else { 0 }
    }

    /// Rays per voxel.
    pub fn rays(&self, scene: &SceneData) -> u32 {
        self.lights(scene) + if scene.environment == 0 { 0 } else { self.directions }
    }

    /// Adds order 1 of a chunk, but for the delta lights that the camera adds, to `orders.total`, and writes all of it to
    /// `orders.next` if there is a next order. `field` has the extinction.
    ///
    /// Ordered after all compute accesses before; ends with these images written by compute.
    #[allow(clippy::too_many_arguments, reason = "what a kernel reads and writes is named one by one")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        cells: &Image,
        chunk: &Chunk<'_>,
        args: &ChunkArgs,
        field: &Image,
        orders: &Orders<'_>,
    ) {
        let rays = self.rays(scene);
        let per_dispatch = rays_per_invocation(scene.params.dims, self.step);
        let mut begin = 0u32;
        if rays == 0 && !self.has_next {
            return;
        }
        // One dispatch even where nothing shines: the next order's source must be written.
        loop {
            let end = rays.min(begin.saturating_add(per_dispatch));
            let lights = self.lights(scene);
            let push = SingleScatterPush {
                chunk_begin: chunk.begin,
                chunk_items: chunk.items,
                light_begin: begin.min(lights),
                light_end: end.min(lights),
                environment_begin: begin.max(lights) - lights,
                environment_end: end.max(lights) - lights,
                environment_directions: self.directions,
                first: (begin == 0).into(),
                step_voxels: self.step,
            };
            let mut binds = contribute::binds(scene, cells, orders);
            binds.extend([
                ("lights", scene.lights.bind()),
                ("field", field.sampled(Filter::Linear)),
                ("environment_image", scene.environment_image.sampled(Filter::Nearest)),
                ("environment_table", scene.environment_table.bind()),
            ]);
            order_compute(rec);
            chunk.dispatch(rec, &self.pipeline, &binds, &push, args);
            begin = end;
            if begin >= rays {
                break;
            }
        }
    }
}
