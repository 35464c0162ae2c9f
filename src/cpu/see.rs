//! Twin of `see.comp`.

use super::march::{Step, make_ray};
use super::scene::{eye_direction, index_from_world};
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::see::{STEP, rays};
use glam::{UVec3, Vec2, Vec4};

/// Transmittance that a ray must have left in a cell that it sees.
const SEEN_TRANSMITTANCE: f32 = 1.0 / 16.0;

/// By linear index of the cells: does the eye see it? `field` has the extinction.
pub fn see(scene: &SceneParams, field: &Texture<Vec4>) -> Vec<bool> {
    let counts = UVec3::from(scene.light_dims) + 1;
    let mut seen = vec![false; counts.element_product() as usize];
    let [width, height] = scene.size.map(|n| n * rays(scene.dims, scene.size));
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let place = (Vec2::new(x as f32, y as f32) + 0.5) / Vec2::new(width as f32, height as f32);
        let ray = make_ray(scene, index_from_world(scene, scene.eye.into()), eye_direction(scene, place), STEP);
        let mut tau = 0.0f32;
        for Step { p, stride, .. } in ray.steps(ray.dt, f32::INFINITY) {
            if (-tau).exp() <= SEEN_TRANSMITTANCE {
                break;
            }
            let sigma = field.sample(p).w;
            if sigma > 0.0 {
                let cell = (p / scene.light_edge as f32 + 0.5).floor().as_uvec3().min(UVec3::from(scene.light_dims));
                seen[((cell.z * counts.y + cell.y) * counts.x + cell.x) as usize] = true;
            }
            tau += sigma * scene.max_extinction * stride;
        }
    }
    seen
}
