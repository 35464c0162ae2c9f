//! Twin of `include/march.glsl`, without its skipping of empty cells.

use super::scene::index_from_world_direction;
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::shaders::constants::{NEAR_STEP, STEP_SAMPLES};
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

/// A step of a ray, or one of its halves.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Where it begins.
    pub t: f32,
    /// World length.
    pub stride: f32,
    /// The place that stands for it, index space: the middle of a step, one of Gauss's two points for a half.
    pub p: Vec3,
}

/// Where Gauss's points are in a step.
pub const GAUSS: [f32; STEP_SAMPLES as usize] = [0.211_324_87, 0.788_675_1];

impl Ray {
    /// Every step before `limit`. The first one is `first` long.
    pub fn steps(self, first: f32, limit: f32) -> impl Iterator<Item = Step> {
        self.steps_of(std::iter::once(first).chain(std::iter::repeat(self.dt)), limit)
    }

    /// The halves of a step of this ray.
    pub fn halves(self, Step { t, stride, .. }: Step) -> [Step; 2] {
        let half = 0.5 * stride;
        let of = |k: usize| Step {
            t: t + k as f32 * half,
            stride: half,
            p: self.origin + self.direction * (t + GAUSS[k] * stride),
        };
        [of(0), of(1)]
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

/// Where in a step of `ray` its optical depth is `share` of the whole step's, from 0 to 1: by finer parts.
pub fn place_of_depth(field: &Texture<Vec4>, ray: Ray, step: Step, share: f32) -> f32 {
    const PARTS: u8 = 6;
    let begin = |k: u8| f32::from(k) / f32::from(PARTS);
    let place = |k: u8| ray.origin + ray.direction * (step.t + (begin(k) + 0.5 / f32::from(PARTS)) * step.stride);
    let sigma: Vec<(u8, f32)> = (0..PARTS).map(|k| (k, field.sample(place(k)).w)).collect();
    let mut left = share * sigma.iter().map(|(_, sigma)| sigma).sum::<f32>();
    let mut found = share;
    for (k, sigma) in sigma {
        if sigma > 0.0 && left > 0.0 {
            found = begin(k) + (left / sigma).min(1.0) / f32::from(PARTS);
        }
        left -= sigma;
    }
    found
}

/// (1 − e^−τ)/τ: the mean of the transmittance over a step of optical depth τ.
pub fn mean_transmittance(tau: f32) -> f32 {
    if tau > 1e-3 { -(-tau).exp_m1() / tau } else { 1.0 - 0.5 * tau }
}

/// 1/τ − 1/(e^τ − 1): where in a step of optical depth τ, from 0 to 1, the light that leaves it at 0 comes from in the mean.
pub fn mean_place(tau: f32) -> f32 {
    if tau > 0.1 { 1.0 / tau - 1.0 / tau.exp_m1() } else { 0.5 - tau / 12.0 }
}

/// Transmittance along `ray` up to `limit`, two samples per step; `field` holds relative extinction. 0 below e⁻⁷.
pub fn transmittance(scene: &SceneParams, field: &Texture<Vec4>, ray: Ray, limit: f32) -> f32 {
    let depth = |step: Step| field.sample(step.p).w * scene.max_extinction * step.stride;
    let tau: f32 = ray.near_steps(limit).flat_map(|step| ray.halves(step)).map(depth).sum();
    if tau < 7.0 { (-tau).exp() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Extinction 0 up to voxel 8, then 1, 2, 3, ... per voxel: a kink at 8, where the rule of middles finds too little.
    fn ramp() -> Texture<Vec4> {
        let value = |x: u32| Vec4::splat(x.saturating_sub(8) as f32);
        Texture::new([16, 1, 1], (0..16).map(value).collect())
    }

    fn ray(begin: f32, length: f32) -> Ray {
        Ray { origin: Vec3::new(begin, 0.5, 0.5), direction: Vec3::X, begin: 0.0, end: length, dt: 1.0 }
    }

    #[test]
    fn depths_across_a_kink_are_right_in_the_mean() {
        let (field, phases) = (ramp(), 1000);
        let error = |samples: &dyn Fn(Ray, Step) -> Vec<Step>| -> f32 {
            let one = |i: i32| {
                // From the kink's step, whose phase is random, into the ramp; the steps end where the ray does.
                let ray = ray(6.5 + i as f32 / phases as f32, 5.0);
                let steps = ray.steps(1.0, f32::INFINITY).flat_map(|step| samples(ray, step));
                let depth: f32 = steps.map(|Step { p, stride, .. }| field.sample(p).w * stride).sum();
                depth - 0.5 * (ray.origin.x + 5.0 - 8.5).powi(2)
            };
            (0..phases).map(one).sum::<f32>() / phases as f32
        };
        let middles = error(&|_, step| vec![step]);
        let gauss = error(&|ray, step| ray.halves(step).to_vec());
        assert!((middles + 1.0 / 24.0).abs() < 1e-3, "a step of 1 and a slope of 1: -1/24, and not {middles}");
        assert!(gauss.abs() < 1e-3, "{gauss}");
    }

    #[test]
    fn places_of_depths_are_those_of_the_extinction() {
        let field = ramp();
        let place = |begin: f32, share: f32| {
            place_of_depth(&field, ray(begin, 9.0), Step { t: 0.0, stride: 2.0, p: Vec3::ZERO }, share)
        };
        for share in [0.01, 0.2, 0.5, 0.9, 1.0f32] {
            // The depth is (x - 8.5)²/2, from 7.5 to 9.5 and from 8.5 to 10.5.
            let x = 8.5 + share.sqrt();
            assert!((place(7.5, share) - (x - 7.5) / 2.0).abs() < 0.05, "{share}: {}", place(7.5, share));
            let x = 8.5 + 2.0 * share.sqrt();
            assert!((place(8.5, share) - (x - 8.5) / 2.0).abs() < 0.05, "{share}: {}", place(8.5, share));
        }
        // Nothing there.
        assert_eq!(place(1.0, 0.3), 0.3);
    }

    #[test]
    fn mean_places_are_those_of_what_leaves_a_step() {
        for tau in [0.0, 1e-3, 0.09, 0.11, 1.0, 10.0, 50.0f32] {
            let weight = |i: i32| (-tau * (i as f32 + 0.5) / 1e4).exp();
            let (sum, first) = (0..10_000).fold((0.0f64, 0.0f64), |(sum, first), i| {
                let w = f64::from(weight(i));
                (sum + w, first + w * (f64::from(i) + 0.5) / 1e4)
            });
            assert!(
                (f64::from(mean_place(tau)) - first / sum).abs() < 1e-4,
                "{tau}: {} and {}",
                mean_place(tau),
                first / sum
            );
        }
    }
}
