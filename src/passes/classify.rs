//! Classify (`glsl/classify.comp`): from scalars to extinction and emitted source.

use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};

/// The source that classification writes beside the extinction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emitted {
    /// None.
    Nothing,
    /// σ_a times the emitted radiance.
    Emission,
    /// σ_t times the transfer function's colour: the absorption model.
    Color,
}

/// The pass.
pub struct Classify {
    pipeline: Pipeline,
}

/// Workgroups of an 8 × 8 × 1 kernel over `dims` voxels.
pub(super) fn voxel_grid(dims: [u32; 3]) -> [u32; 3] {
    [dims[0].div_ceil(8), dims[1].div_ceil(8), dims[2]]
}

impl Classify {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, scene: &SceneData, emitted: Emitted) -> Result<Self> {
        let emitted = match emitted {
            Emitted::Nothing => constants::EMITTED_NOTHING,
            Emitted::Emission => constants::EMITTED_EMISSION,
            Emitted::Color => constants::EMITTED_COLOR,
        };
        let kernel = scene.stored.version(shaders::CLASSIFY_VERSIONS);
        Ok(Self { pipeline: Pipeline::new(ctx, kernel, &[("EMITTED", emitted)])? })
    }

    /// Writes source and extinction of every voxel to `field`. Ordered after all compute accesses before; ends
    /// with `field` written by compute.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, field: &Image) {
        order_compute(rec);
        rec.dispatch(
            &self.pipeline,
            &[
                ("scene_block", scene.block.bind()),
                ("transfer_block", scene.transfer.bind()),
                ("scalar", scene.scalar.sampled(Filter::Nearest)),
                ("field", field.storage()),
            ],
            &(),
            voxel_grid(scene.params.dims),
        );
    }
}
