//! Twin of `camera.comp`.

use super::march::{LEAST_TRANSMITTANCE, make_ray, mean_transmittance};
use super::rng::{random_float, stream_key};
use super::scene::{HostScene, index_from_world};
use super::sphere::fract;
use super::texture::Texture;
use crate::scene::Background;
use glam::{Vec2, Vec3, Vec4};

/// The camera's random-number stream.
const STREAM: u32 = 0x4341_4D45;

/// The picture, row by row from the top: radiance premultiplied by alpha, and alpha.
pub fn camera(
    scene: &HostScene,
    background: Background,
    total: &Texture<Vec4>,
    samples: u32,
    step_voxels: f32,
) -> Vec<Vec4> {
    let [width, height] = scene.params.size;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    pixels
        .map(|pixel| {
            let all = (0..samples).map(|i| one_sample(scene, background, total, pixel, i, samples, step_voxels));
            all.sum::<Vec4>() / samples as f32
        })
        .collect()
}

fn one_sample(
    scene: &HostScene,
    background: Background,
    total: &Texture<Vec4>,
    pixel: [u32; 2],
    sample_index: u32,
    samples: u32,
    step_voxels: f32,
) -> Vec4 {
    let s = &scene.params;
    let mut place = Vec2::splat(0.5);
    let mut start = 1.0;
    if samples > 1 {
        let key = stream_key(pixel[1] * s.size[0] + pixel[0], STREAM, s.seed_low, s.seed_high);
        let i = sample_index as f32;
        place = Vec2::new(
            fract((i + 0.5) / samples as f32 + random_float(key, 0)),
            fract(i * 0.618_034 + random_float(key, 1)),
        );
        start = 1.0 - fract(i * 0.414_213_57 + random_float(key, 2));
    }
    let film = (Vec2::new(pixel[0] as f32, pixel[1] as f32) + place) / Vec2::new(s.size[0] as f32, s.size[1] as f32);
    let film = film * 2.0 - 1.0;
    let direction = Vec3::from(s.forward) + film.x * Vec3::from(s.right) - film.y * Vec3::from(s.up);
    let direction = direction.normalize();

    let ray = make_ray(s, index_from_world(s, s.eye.into()), direction, step_voxels);
    let (mut through, mut radiance) = (1.0f32, Vec3::ZERO);
    for (p, stride) in ray.steps(start * ray.dt, f32::INFINITY) {
        if through <= LEAST_TRANSMITTANCE {
            break;
        }
        let f = total.sample(p);
        let scale = s.max_extinction * stride;
        let tau = f.w * scale;
        radiance += f.truncate() * (through * scale * mean_transmittance(tau));
        through *= (-tau).exp();
    }
    radiance /= s.radiance_scale;
    match background {
        Background::Transparent => radiance.extend(1.0 - through),
        Background::Color(color) => (radiance + through * color).extend(1.0),
        Background::Environment => (radiance + through * scene.environment.environment_radiance(direction)).extend(1.0),
    }
}
