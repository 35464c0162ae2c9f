//! Twin of `single_scatter.comp`.

use super::classify::{albedo_of, classify};
use super::contribute::{Arrived, Orders, add_to, arrive, arrive_unseen};
use super::delta_lights::light_at;
use super::march::{make_ray, transmittance};
use super::rng::{random_float, stream_key};
use super::scene::{HostScene, direction_to_eye, voxel_from_linear, world_from_index};
use super::texture::Texture;
use glam::{Vec3, Vec4};
use std::f32::consts::PI;

/// Adds order 1 of the listed voxels to `orders`; delta lights for the next order only.
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
            let light = light_at(s, light, world);
            arrive_unseen(&mut sum, light.irradiance * (seen(-light.travel, light.reach) / (4.0 * PI)), light.travel);
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
