//! Twin of `include/march.glsl`, without its skipping of empty cells.

use super::scene::index_from_world_direction;
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::shaders::constants::NEAR_STEP;
use glam::{Vec3, Vec4};

/// Below this transmittance a ray ends.
pub const LEAST_TRANSMITTANCE: f32 = 1e-3;

/// A ray through the volume in steps.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Index space: position(t) = origin + direction * t, t in world units.
    pub origin: Vec3,
    /// See `origin`.
    pub direction: Vec3,
    /// Where the ray enters the volume.
    pub begin: f32,
    /// Where it leaves; not beyond `begin` if it misses.
    pub end: f32,
    /// World length of a step.
    pub dt: f32,
}

/// `origin` in index space, `direction` a unit vector in the world, `step_voxels` the length of a step in voxels.
pub fn make_ray(scene: &SceneParams, origin: Vec3, direction: Vec3, step_voxels: f32) -> Ray {
    let direction = index_from_world_direction(scene, direction);
    let (mut begin, mut end) = (0.0f32, f32::INFINITY);
    for axis in 0..3 {
        let (o, d, size) = (origin[axis], direction[axis], scene.dims[axis] as f32);
        if d.abs() > 1e-12 * direction.abs().max_element() {
            let (a, b) = (-o / d, (size - o) / d);
            begin = begin.max(a.min(b));
            end = end.min(a.max(b));
        } else if !(0.0..=size).contains(&o) {
            end = f32::NEG_INFINITY;
        }
    }
    Ray { origin, direction, begin, end, dt: step_voxels / direction.length() }
}

/// A step of a ray.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Where it begins.
    pub t: f32,
    /// World length.
    pub stride: f32,
    /// Its middle, index space.
    pub p: Vec3,
}

impl Ray {
    /// Every step before `limit`. The first one is `first` long.
    pub fn steps(self, first: f32, limit: f32) -> impl Iterator<Item = Step> {
        self.steps_of(std::iter::once(first).chain(std::iter::repeat(self.dt)), limit)
    }

    /// Every step before `limit` of a ray that starts in the medium: the first are short.
    pub fn near_steps(self, limit: f32) -> impl Iterator<Item = Step> {
        let shares = (1u8..).map(|i| (f32::from(i) * NEAR_STEP).min(1.0)).take_while(|&share| share < 1.0);
        self.steps_of(shares.map(move |share| share * self.dt).chain(std::iter::repeat(self.dt)), limit)
    }

    fn steps_of(self, mut lengths: impl Iterator<Item = f32>, limit: f32) -> impl Iterator<Item = Step> {
        let end = self.end.min(limit);
        let mut t = self.begin;
        std::iter::from_fn(move || {
            if t >= end {
                return None;
            }
            let stride = lengths.next()?.min(end - t);
            let step = Step { t, stride, p: self.origin + self.direction * (t + 0.5 * stride) };
            t += stride;
            Some(step)
        })
    }
}

/// (1 − e^−τ)/τ: the mean of the transmittance over a step of optical depth τ.
pub fn mean_transmittance(tau: f32) -> f32 {
    if tau > 1e-3 { -(-tau).exp_m1() / tau } else { 1.0 - 0.5 * tau }
}

/// Transmittance along `ray` up to `limit`; `field` holds relative extinction. 0 below e⁻⁷.
pub fn transmittance(scene: &SceneParams, field: &Texture<Vec4>, ray: Ray, limit: f32) -> f32 {
    let depth = |step: Step| field.sample(step.p).w * scene.max_extinction * step.stride;
    let tau: f32 = ray.near_steps(limit).map(depth).sum();
    if tau < 7.0 { (-tau).exp() } else { 0.0 }
}
