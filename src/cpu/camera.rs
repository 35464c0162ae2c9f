//! Twin of `camera.comp`.

use super::classify::optical_depth_of_opacity;
use super::delta_lights::light_at;
use super::march::{
    GAUSS, LEAST_TRANSMITTANCE, Ray, Step, make_ray, mean_place, mean_transmittance, place_of_depth, transmittance,
};
use super::rng::{random_float, stream_key};
use super::scene::{HostScene, eye_direction, index_from_world, world_from_index};
use super::sphere::{fract, phase_hg};
use super::texture::Texture;
use crate::passes::camera::lattice;
use crate::scene::Background;
use crate::shaders::constants::{OPAQUE, STEP_SAMPLES};
use glam::{Vec2, Vec3, Vec4};

/// The camera's random-number stream.
const STREAM: u32 = 0x4341_4D45;

/// What there is to see.
#[derive(Clone, Copy)]
pub struct Content<'a> {
    /// rgb = light, a = extinction.
    pub total: &'a Texture<Vec4>,
    /// B by component where `total` is A.
    pub b: Option<&'a [Texture<Vec4>; 3]>,
    /// The emitted source where `total` is projected light, else `None`.
    pub emitted: Option<&'a Texture<Vec4>>,
}

/// The picture, row by row from the top: radiance premultiplied by alpha, and alpha. `lights_per_sample`: how many of
/// the delta lights a sample visits; 0 where they are not seen.
pub fn camera(
    scene: &HostScene,
    background: Background,
    content: Content<'_>,
    samples: u32,
    step_voxels: f32,
    lights_per_sample: u32,
) -> Vec<Vec4> {
    let lattice = lattice(samples);
    let camera = Camera { scene, background, content, samples, lattice, step_voxels, lights_per_sample };
    let [width, height] = scene.params.size;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    pixels
        .map(|pixel| {
            let all = (0..samples).map(|i| camera.sample(pixel, i));
            all.sum::<Vec4>() / samples as f32
        })
        .collect()
}

/// The depth at which the eye has seen the share `u` of what it sees of the medium, which has `opacity` along all of its `depth`. An
/// opaque one is seen as if there were nothing behind it; the few samples that would be there are spread over it again.
fn lit_depth(u: f32, depth: f32, opacity: f32) -> f32 {
    let share = match optical_depth_of_opacity(u) {
        target if opacity > OPAQUE && target < depth => return target,
        _ if opacity > OPAQUE => (u - opacity).max(0.0) / (1.0 - opacity),
        _ => u,
    };
    optical_depth_of_opacity(share * opacity)
}

struct Camera<'a> {
    scene: &'a HostScene,
    background: Background,
    content: Content<'a>,
    samples: u32,
    lattice: [u32; 3],
    step_voxels: f32,
    lights_per_sample: u32,
}

impl Camera<'_> {
    fn sample(&self, pixel: [u32; 2], sample_index: u32) -> Vec4 {
        let s = &self.scene.params;
        let key = stream_key(pixel[1] * s.size[0] + pixel[0], STREAM, s.seed_low, s.seed_high);
        let [y_stride, depth_stride, start_stride] = self.lattice;
        let on_lattice = |stride: u32, shift: u32| {
            fract((sample_index * stride % self.samples) as f32 / self.samples as f32 + random_float(key, shift))
        };
        let (mut place, mut start) = (Vec2::splat(0.5), 1.0);
        if self.samples > 1 {
            place = Vec2::new(on_lattice(1, 0), on_lattice(y_stride, 1));
            start = 1.0 - on_lattice(start_stride, 2);
        }
        let size = Vec2::new(s.size[0] as f32, s.size[1] as f32);
        let direction = eye_direction(s, (Vec2::new(pixel[0] as f32, pixel[1] as f32) + place) / size);

        let ray = make_ray(s, index_from_world(s, s.eye.into()), direction, STEP_SAMPLES as f32 * self.step_voxels);
        let first = start * ray.dt;
        let (mut through, mut depth, mut radiance) = (1.0f32, 0.0f32, Vec3::ZERO);
        for step in ray.steps(first, f32::INFINITY) {
            if through <= LEAST_TRANSMITTANCE {
                break;
            }
            let halves = ray.halves(step);
            let found = halves.map(|Step { p, .. }| {
                let f = self.content.total.sample(p);
                let b = self.content.b.into_iter().flatten().enumerate();
                let directed: Vec3 = b.map(|(axis, b)| b.sample(p).truncate() * direction[axis]).sum();
                (f.truncate() - directed, f.w)
            });
            for (k, Step { p, stride, .. }) in halves.into_iter().enumerate() {
                let (own, extinction) = found[k];
                let scale = s.max_extinction * stride;
                let tau = extinction * scale;
                let along = (0.5 * (k as f32 + mean_place(tau)) - GAUSS[0]) / (GAUSS[1] - GAUSS[0]);
                let source = match self.content.emitted {
                    Some(emitted) => extinction * found[0].0.lerp(found[1].0, along) + emitted.sample(p).truncate(),
                    None => own,
                };
                radiance += source * (through * scale * mean_transmittance(tau));
                through *= (-tau).exp();
                depth += tau;
            }
        }
        radiance = (radiance / s.radiance_scale).max(Vec3::ZERO);
        let opacity = -(-depth).exp_m1();
        if self.lights_per_sample > 0 && depth > 0.0 {
            let target = lit_depth(on_lattice(depth_stride, 3), depth, opacity);
            let p = ray.origin + ray.direction * self.depth_of(ray, first, target);
            radiance += self.lit_radiance(p, -direction, sample_index, key) * opacity;
        }
        match self.background {
            Background::Transparent => radiance.extend(opacity),
            Background::Color(color) => (radiance + through * color).extend(1.0),
            Background::Environment => {
                (radiance + through * self.scene.environment.environment_radiance(direction)).extend(1.0)
            }
        }
    }

    /// Distance along the ray to the optical depth `tau`.
    fn depth_of(&self, ray: Ray, first: f32, tau: f32) -> f32 {
        let (mut passed, mut at) = (0.0, ray.begin);
        for step in ray.steps(first, f32::INFINITY) {
            if passed >= tau {
                break;
            }
            let sigma: f32 = ray.halves(step).map(|half| self.content.total.sample(half.p).w).iter().sum();
            let depth = 0.5 * sigma * self.scene.params.max_extinction * step.stride;
            if depth > 0.0 {
                let share = ((tau - passed) / depth).min(1.0);
                at = step.t + step.stride * place_of_depth(self.content.total, ray, step, share);
            }
            passed += depth;
        }
        at
    }

    /// Radiance that delta lights send towards the eye by one scattering at `p`.
    fn lit_radiance(&self, p: Vec3, to_eye: Vec3, sample_index: u32, key: u32) -> Vec3 {
        let s = &self.scene.params;
        let (lights, visited) = (&self.scene.lights, self.lights_per_sample);
        let count = lights.len() as u32;
        let first = (random_float(key, 4 + sample_index) * count as f32) as u32;
        let mut sum = Vec3::ZERO;
        for i in 0..visited {
            let light = &lights[((first + i * count / visited) % count) as usize];
            let light = light_at(s, light, world_from_index(s, p));
            let t = transmittance(
                s,
                self.content.total,
                make_ray(s, p, -light.travel, STEP_SAMPLES as f32 * self.step_voxels),
                light.reach,
            );
            sum += light.irradiance * (t * phase_hg(s.g, light.travel.dot(to_eye)));
        }
        self.albedo_at(p) * sum * (count as f32 / visited as f32)
    }

    /// Albedo at `p` (index space): σ_s and σ_t interpolated, then divided.
    fn albedo_at(&self, p: Vec3) -> Vec3 {
        let c = self.scene.scattering.sample(p);
        if c.w > 0.0 { c.truncate() / c.w } else { Vec3::ZERO }
    }
}
