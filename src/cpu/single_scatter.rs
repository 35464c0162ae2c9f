//! Twin of `single_scatter.comp`.

use super::classify::{albedo_of, classify};
use super::contribute::{Arrived, Orders, add_to, arrive};
use super::march::{Ray, make_ray};
use super::rng::{random_float, stream_key};
use super::scene::{HostScene, direction_to_eye, voxel_from_linear, world_from_index};
use super::texture::Texture;
use crate::abi::{LightData, SceneParams};
use glam::{Vec3, Vec4};
use std::f32::consts::PI;

/// Transmittance along `ray` up to `limit`; 0 below e⁻⁷.
pub fn transmittance(scene: &SceneParams, field: &Texture<Vec4>, ray: Ray, limit: f32) -> f32 {
    let mut tau = 0.0;
    for (p, stride) in ray.steps(ray.dt, limit) {
        tau += field.sample(p).w * scene.max_extinction * stride;
    }
    if tau < 7.0 { (-tau).exp() } else { 0.0 }
}

/// Direction of travel and irradiance of a light at `world`, and how far away it is.
fn light_at(scene: &SceneParams, light: &LightData, world: Vec3) -> (Vec3, Vec3, f32) {
    let (vector, power) = (Vec3::from(light.vector), Vec3::from(light.power));
    if light.is_point == 0 {
        return (vector, power, f32::INFINITY);
    }
    let distance = (world - vector).length();
    let least = distance.max(0.5 * scene.mean_spacing);
    let travel = if distance > 0.0 { (world - vector) / distance } else { Vec3::Z };
    (travel, power / (least * least), distance)
}

/// Adds order 1 of the listed voxels to `orders`.
pub fn single_scatter(
    scene: &HostScene,
    active_voxels: &[u32],
    field: &Texture<Vec4>,
    environment_directions: u32,
    step_voxels: f32,
    orders: &mut Orders,
) {
    let s = &scene.params;
    for &index in active_voxels {
        let voxel = voxel_from_linear(s, index);
        let position = voxel.as_vec3() + 0.5;
        let world = world_from_index(s, position);
        let to_eye = direction_to_eye(s, position);
        let seen =
            |towards: Vec3, limit: f32| transmittance(s, field, make_ray(s, position, towards, step_voxels), limit);
        let mut sum = Arrived::default();
        for light in &scene.lights {
            let (travel, irradiance, reach) = light_at(s, light, world);
            arrive(s, &mut sum, irradiance * (seen(-travel, reach) / (4.0 * PI)), travel, to_eye);
        }
        let key = stream_key(index, 1, s.seed_low, s.seed_high);
        let shift = [random_float(key, 0), random_float(key, 1)];
        for i in 0..environment_directions {
            let Some(sample) = scene.environment.sample_environment(i, environment_directions, shift) else { break };
            let t = seen(sample.direction, f32::INFINITY);
            arrive(s, &mut sum, sample.radiance * (t * sample.weight / (4.0 * PI)), -sample.direction, to_eye);
        }
        let m = classify(s, &scene.points, scene.scalar.fetch(voxel));
        let extinction = m.extinction / s.max_extinction;
        let scattering = Vec3::from(albedo_of(s, &m)) * extinction * s.radiance_scale;
        add_to(s, voxel, scattering, &sum, extinction, true, orders);
    }
}
