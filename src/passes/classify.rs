//! Classify (`glsl/classify.comp`): from scalars to extinction and emitted source.

use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};

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
    /// A single texel where nothing is written to it.
    extinction: Image,
    is_alone: bool,
}

/// Workgroups of an 8 × 8 × 1 kernel over `dims` voxels.
pub(super) fn voxel_grid(dims: [u32; 3]) -> [u32; 3] {
    [dims[0].div_ceil(8), dims[1].div_ceil(8), dims[2]]
}

impl Classify {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, scene: &SceneData, emitted: Emitted) -> Result<Self> {
        Self::with(ctx, scene, emitted, false)
    }

    /// The same for a pass that writes the extinction to an image of its own, too: rays that read nothing else have a fourth of
    /// the bytes to fetch. Devices that cannot interpolate it do without.
    pub fn with_extinction(ctx: &Context, scene: &SceneData, emitted: Emitted) -> Result<Self> {
        Self::with(ctx, scene, emitted, ctx.stores_fields(ImageFormat::Alpha32Float))
    }

    fn with(ctx: &Context, scene: &SceneData, emitted: Emitted, is_alone: bool) -> Result<Self> {
        let emitted = match emitted {
            Emitted::Nothing => constants::EMITTED_NOTHING,
            Emitted::Emission => constants::EMITTED_EMISSION,
            Emitted::Color => constants::EMITTED_COLOR,
        };
        let kernel = scene.stored.version(shaders::CLASSIFY_VERSIONS);
        let specialization =
            [("EMITTED", emitted), ("ALONE", is_alone.into()), ("SCATTERS", scene.stores_scattering().into())];
        let dims = if is_alone { scene.params.dims } else { [1; 3] };
        Ok(Self {
            pipeline: Pipeline::new(ctx, kernel, &specialization)?,
            extinction: ctx.image_3d("extinction", dims, ImageFormat::Alpha32Float)?,
            is_alone,
        })
    }

    /// Where samplers find the extinction in their fourth component, once `field` was recorded.
    pub fn extinction<'i>(&'i self, field: &'i Image) -> &'i Image {
        if self.is_alone { &self.extinction } else { field }
    }

    /// Writes source and extinction of every voxel to `field`, and the scene's scattering coefficients. Ordered after all compute
    /// accesses before; ends with them and [`Self::extinction`] written by compute.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, field: &Image) {
        order_compute(rec);
        rec.dispatch(
            &self.pipeline,
            &[
                ("scene_block", scene.block.bind()),
                ("transfer_block", scene.transfer.bind()),
                ("scalar", scene.scalar.sampled(Filter::Nearest)),
                ("field", field.storage()),
                ("extinction_alone", self.extinction.storage()),
                ("scattering", scene.scattering.storage()),
            ],
            &(),
            voxel_grid(scene.params.dims),
        );
    }
}
