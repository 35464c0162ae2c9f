//! Twin of `single_scatter.comp`.

use super::delta_lights::light_at;
use super::march::{make_ray, transmittance};
use super::project::{Cell, point_of_sample};
use super::rng::{random_float, stream_key};
use super::scene::{HostScene, world_from_index};
use super::texture::Texture;
use crate::abi::ScatterSample;
use crate::shaders::constants::{CELL_POINTS, LIGHT_POINTS, STEP_SAMPLES};
use glam::{Vec3, Vec4};
use std::f32::consts::PI;

/// Samples of order 1 of the listed cells, by cell: those of the delta lights, then those of the environment.
pub fn single_scatter(
    scene: &HostScene,
    cells: &[u32],
    field: &Texture<Vec4>,
    environment_directions: u32,
    step_voxels: f32,
) -> [Vec<Vec<ScatterSample>>; 2] {
    let s = &scene.params;
    let key = |index: u32| stream_key(index, 1, s.seed_low, s.seed_high);
    let flip = |index: u32| (random_float(key(index), 2) * CELL_POINTS as f32) as u32;
    let sample = |cell: &Cell, point: u32, travel: Vec3, reach: f32, light: Vec3| {
        let t = transmittance(
            s,
            field,
            make_ray(s, cell.position(point), -travel, STEP_SAMPLES as f32 * step_voxels),
            reach,
        );
        let light = cell.scattering(scene, point) * light * (t * s.radiance_scale / (4.0 * PI));
        ScatterSample { light: light.into(), travel: travel.into(), point }
    };
    let of_lights = |&index: &u32| {
        let cell = Cell::from_linear(s, index);
        let numbers = (0..scene.lights.len() as u32).flat_map(|l| (0..LIGHT_POINTS).map(move |k| (l, k)));
        let one = |(l, k)| {
            let point = point_of_sample(k, flip(index));
            let light = light_at(s, &scene.lights[l as usize], world_from_index(s, cell.position(point)));
            sample(&cell, point, light.travel, light.reach, light.irradiance / LIGHT_POINTS as f32)
        };
        numbers.map(one).collect()
    };
    let of_environment = |&index: &u32| {
        let cell = Cell::from_linear(s, index);
        let shift = [random_float(key(index), 0), random_float(key(index), 1)];
        let one = |i| {
            let e = scene.environment.sample_environment(i, environment_directions, shift)?;
            let point = point_of_sample(i, flip(index));
            Some(sample(&cell, point, -e.direction, f32::INFINITY, e.radiance * e.weight))
        };
        (0..environment_directions).map_while(one).collect()
    };
    [cells.iter().map(of_lights).collect(), cells.iter().map(of_environment).collect()]
}
