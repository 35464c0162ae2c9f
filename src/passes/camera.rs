//! The camera (`glsl/camera.comp`): one ray per pixel and sample.

use super::project::Source;
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
    light_step: f32,
    samples: u32,
    lattice: [u32; 3],
    lights_per_sample: u32,
}

/// What the camera sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// The source that classification or local shading wrote.
    Local,
    /// Projected light for the scene's eye, emission, and delta lights by single scattering.
    Scattering,
    /// The same with light that is stored for every eye, as A and B.
    Directed,
}

/// Delta lights that one sample visits at most.
const MAX_LIGHTS_PER_SAMPLE: u32 = 8;

/// Strides along y, depth and first step of the lattice of `samples` points whose stride along x is 1: Korobov's (a, a², a³)
/// with the a whose points are spread most evenly, by the worst error of smooth periodic functions (P₂; Sloan and Joe 1994).
pub fn lattice(samples: u32) -> [u32; 3] {
    // The first step matters least.
    const WEIGHTS: [f64; 4] = [1.0, 1.0, 1.0, 0.25];
    // Of large lattices some are tried.
    const MOST_TRIED: usize = 64;
    let n = u64::from(samples);
    let strides = |a: u32| {
        let a = u64::from(a);
        [a % n, a * a % n, a * a % n * a % n].map(|s| s as u32)
    };
    let error = |a: u32| -> f64 {
        let [y, depth, start] = strides(a);
        let kernel = |i: u64, stride: u32, weight: f64| {
            let x = (i * u64::from(stride) % n) as f64 / n as f64;
            1.0 + weight * 2.0 * std::f64::consts::PI.powi(2) * (x * x - x + 1.0 / 6.0)
        };
        let all = [1, y, depth, start];
        (0..n).map(|i| (0..4).map(|d| kernel(i, all[d], WEIGHTS[d])).product::<f64>()).sum()
    };
    let gcd = |mut a: u32, mut b: u32| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let coprime: Vec<u32> = (1..=samples).filter(|&a| gcd(a, samples) == 1).collect();
    // Spread by the golden section: even steps would all be alike in their low bits.
    let golden = |k: usize| ((0.618_033_988_75 * k as f64).fract() * coprime.len() as f64) as usize;
    let all = 0..coprime.len();
    let tried: Vec<usize> = if all.len() > MOST_TRIED { (0..MOST_TRIED).map(golden).collect() } else { all.collect() };
    let best = tried.iter().map(|&k| coprime[k]).min_by(|&a, &b| error(a).total_cmp(&error(b)));
    strides(best.expect("1 is coprime to everything"))
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
    /// `steps`: distance between samples of camera rays, and of those towards the lights, in voxels.
    ///
    /// Errors: such rays through the volume take more iterations than an invocation may run.
    pub fn new(
        ctx: &Context,
        scene: &SceneData,
        background: Background,
        steps: [f32; 2],
        samples: u32,
        content: Content,
    ) -> Result<Self> {
        let [step, light_step] = steps;
        let [longest, to_light] = steps.map(|step| ray_iterations(scene.params.dims, step));
        let is_scattering = content != Content::Local;
        let is_lit = is_scattering && scene.light_count > 0;
        // The camera ray, and where it is lit the ray again and one ray per light.
        let budget = constants::MAX_ITERATIONS - constants::MAX_ITERATIONS / 10;
        let left = budget.checked_sub(longest * if is_lit { 2 } else { 1 });
        let rays_left = left.map_or(0, |left| if is_lit { left / to_light } else { 1 });
        if rays_left == 0 {
            let (flag, step, most) = if is_lit && to_light > longest {
                ("--gather-step", light_step, to_light)
            } else {
                ("--camera-step", step, longest)
            };
            return Err(Error::input(
                flag,
                format!("{step} voxels make rays of {most} steps, too many for {}", constants::MAX_ITERATIONS),
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
            ("DIRECTED", (content == Content::Directed).into()),
            ("EVEN_ALBEDO", scene.has_even_albedo.into()),
        ];
        let pipeline = Pipeline::new(ctx, &shaders::CAMERA, &specialization)?;
        Ok(Self { pipeline, step, light_step, samples, lattice: lattice(samples), lights_per_sample })
    }

    /// An image for a picture of `size` pixels: linear RGB premultiplied by alpha.
    pub fn picture(ctx: &Context, size: [u32; 2]) -> Result<Image> {
        ctx.image_2d("picture", size, ImageFormat::Rgba32Float)
    }

    /// Adds sample `sample` of the pixels in rows `rows` to `picture`. `extinction`: in its fourth component, as in
    /// `total`. `emitted`: the emitted source, anything where nothing emits. Ordered after all compute accesses before.
    #[allow(clippy::too_many_arguments, reason = "resources and range of one dispatch")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        emptiness: &Image,
        total: &Source,
        extinction: &Image,
        emitted: &Image,
        picture: &Image,
        sample: u32,
        rows: std::ops::Range<u32>,
    ) {
        order_compute(rec);
        let [y_stride, depth_stride, start_stride] = self.lattice;
        let push = CameraPush {
            row_begin: rows.start,
            row_end: rows.end,
            sample_index: sample,
            samples: self.samples,
            step_voxels: self.step,
            light_count: scene.light_count,
            lights_per_sample: self.lights_per_sample,
            light_step: self.light_step,
            y_stride,
            depth_stride,
            start_stride,
        };
        let binds = [
            ("scene_block", scene.block.bind()),
            ("scattering", scene.scattering(extinction).sampled(Filter::Linear)),
            ("lights", scene.lights.bind()),
            ("total", total.a.sampled(Filter::Linear)),
            ("extinction", extinction.sampled(Filter::Linear)),
            ("total_x", total.b[0].sampled(Filter::Linear)),
            ("total_y", total.b[1].sampled(Filter::Linear)),
            ("total_z", total.b[2].sampled(Filter::Linear)),
            ("emitted", emitted.sampled(Filter::Linear)),
            ("emptiness", emptiness.sampled(Filter::Nearest)),
            ("environment_image", scene.environment_image.sampled(Filter::Nearest)),
            ("picture", picture.storage()),
        ];
        let groups = [scene.params.size[0].div_ceil(8), (rows.end - rows.start).div_ceil(8), 1];
        rec.dispatch(&self.pipeline, &binds, &push, groups);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No two coordinates of the points are tied to each other: in every projection on two axes all cells of a grid with a
    /// third as many cells along each axis as there are rows of points are met.
    #[test]
    fn lattices_fill_every_plane() {
        for n in [16, 32, 48, 53, 64, 127, 128, 1000, 1021, 1024, 65536] {
            let [y, depth, start] = lattice(n);
            let axes = [1, y, depth, start].map(u64::from);
            let cells = ((f64::from(n).sqrt() / 3.0) as u64).max(2);
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                let cell = |k: u64, axis: usize| k * axes[axis] % u64::from(n) * cells / u64::from(n);
                let met: std::collections::HashSet<_> = (0..u64::from(n)).map(|k| (cell(k, i), cell(k, j))).collect();
                assert_eq!(met.len() as u64, cells * cells, "{n} points, axes {i} and {j}: strides {axes:?}");
            }
        }
        assert_eq!(lattice(1), [0, 0, 0]);
    }
}
