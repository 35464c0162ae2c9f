//! The camera (`glsl/camera.comp`): one ray per pixel and sample.

use super::scene_data::SceneData;
use super::{order_compute, ray_iterations};
use crate::abi::CameraPush;
use crate::scene::Background;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};
use crate::{Error, Result};

/// The pass.
pub struct Camera {
    pipeline: Pipeline,
    step: f32,
    samples: u32,
    lights_per_sample: u32,
}

/// What the camera sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// The source that classification or local shading wrote.
    Local,
    /// Projected light, emission, and delta lights by single scattering.
    Scattering,
}

/// Delta lights that one sample visits at most.
const MAX_LIGHTS_PER_SAMPLE: u32 = 8;

/// Stride through `samples` places in which neighbours come apart: near their golden section, and coprime to them.
pub fn depth_stride(samples: u32) -> u32 {
    let gcd = |mut a: u32, mut b: u32| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let golden = (0.382 * f64::from(samples)) as u32;
    (golden.max(1)..).find(|&s| gcd(s, samples) == 1).expect("samples + 1 is coprime to samples")
}

/// `constants::BACKGROUND_*`.
pub(super) fn behind(background: Background) -> u32 {
    match background {
        Background::Transparent => constants::BACKGROUND_TRANSPARENT,
        Background::Color(_) => constants::BACKGROUND_COLOR,
        Background::Environment => constants::BACKGROUND_ENVIRONMENT,
    }
}

impl Camera {
    /// Makes the pipeline. `content`: what there is to see.
    ///
    /// Errors: rays of `step` voxels through the volume take more iterations than an invocation may run.
    pub fn new(
        ctx: &Context,
        scene: &SceneData,
        background: Background,
        step: f32,
        samples: u32,
        content: Content,
    ) -> Result<Self> {
        let longest = ray_iterations(scene.params.dims, step);
        // The camera ray, and where it is lit the ray again and one ray per light.
        let is_scattering = content == Content::Scattering;
        let is_lit = is_scattering && scene.light_count > 0;
        let fixed = longest * if is_lit { 2 } else { 1 };
        let rays_left = (constants::MAX_ITERATIONS - constants::MAX_ITERATIONS / 10).saturating_sub(fixed) / longest;
        if rays_left == 0 {
            return Err(Error::input(
                "--camera-step",
                format!("{step} voxels make rays of {longest} steps, too many for {}", constants::MAX_ITERATIONS),
                "use longer steps",
            ));
        }
        let lights_per_sample = scene.light_count.min(MAX_LIGHTS_PER_SAMPLE).min(rays_left);
        let behind = behind(background);
        let specialization = [
            ("ENVIRONMENT", scene.environment),
            ("BACKGROUND", behind),
            ("LIT", is_lit.into()),
            ("PROJECTED", is_scattering.into()),
            ("EMITS", (is_scattering && scene.has_emission).into()),
        ];
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::CAMERA, &specialization)?, step, samples, lights_per_sample })
    }

    /// An image for a picture of `size` pixels: linear RGB premultiplied by alpha.
    pub fn picture(ctx: &Context, size: [u32; 2]) -> Result<Image> {
        ctx.image_2d("picture", size, ImageFormat::Rgba32Float)
    }

    /// Adds sample `sample` of the pixels in rows `rows` to `picture`. `emitted`: the emitted source, anything where nothing
    /// emits. Ordered after all compute accesses before.
    #[allow(clippy::too_many_arguments, reason = "resources and range of one dispatch")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        emptiness: &Image,
        total: &Image,
        emitted: &Image,
        picture: &Image,
        sample: u32,
        rows: std::ops::Range<u32>,
    ) {
        order_compute(rec);
        let push = CameraPush {
            row_begin: rows.start,
            row_end: rows.end,
            sample_index: sample,
            samples: self.samples,
            step_voxels: self.step,
            light_count: scene.light_count,
            lights_per_sample: self.lights_per_sample,
            light_step: self.step,
            depth_stride: depth_stride(self.samples),
        };
        let binds = [
            ("scene_block", scene.block.bind()),
            ("transfer_block", scene.transfer.bind()),
            ("scalar", scene.scalar.sampled(Filter::Nearest)),
            ("lights", scene.lights.bind()),
            ("total", total.sampled(Filter::Linear)),
            ("emitted", emitted.sampled(Filter::Linear)),
            ("emptiness", emptiness.sampled(Filter::Nearest)),
            ("environment_image", scene.environment_image.sampled(Filter::Nearest)),
            ("picture", picture.storage()),
        ];
        let groups = [scene.params.size[0].div_ceil(8), (rows.end - rows.start).div_ceil(8), 1];
        rec.dispatch(&self.pipeline, &binds, &push, groups);
    }
}
