//! Local gradient shading (`glsl/phong.comp`).

use super::compact::{Chunk, ChunkArgs};
use super::scene_data::SceneData;
use super::{LIST_WORKGROUP, order_compute};
use crate::Result;
use crate::abi::PhongPush;
use crate::shaders;
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};

/// The pass.
pub struct Phong {
    pipeline: Pipeline,
}

impl Phong {
    /// Makes the pipeline.
    pub fn new(ctx: &Context, scene: &SceneData) -> Result<Self> {
        let kernel = scene.stored.version(shaders::PHONG_VERSIONS);
        Ok(Self { pipeline: Pipeline::new(ctx, kernel, &[("WORKGROUP", LIST_WORKGROUP)])? })
    }

    /// Writes the shaded colour of a chunk's voxels to `total`. Ordered after all compute accesses before.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, chunk: &Chunk<'_>, args: &ChunkArgs, total: &Image) {
        order_compute(rec);
        let push = PhongPush {
            chunk_begin: chunk.begin,
            chunk_items: chunk.items,
            lights_count: scene.light_count,
            ambient: scene.ambient.to_array(),
        };
        let binds = [
            ("scene_block", scene.block.bind()),
            ("transfer_block", scene.transfer.bind()),
            ("lights", scene.lights.bind()),
            ("scalar", scene.scalar.sampled(Filter::Nearest)),
            ("total", total.storage()),
        ];
        chunk.dispatch(rec, &self.pipeline, &binds, &push, args);
    }
}
