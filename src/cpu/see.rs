//! Twin of `see.comp`.

use super::march::{LEAST_TRANSMITTANCE, Step, make_ray};
use super::scene::{eye_direction, index_from_world};
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::see::{STEP, rays};
use glam::{UVec3, Vec2, Vec4};

/// Transmittance that a ray must have left in a cell that it sees.
const SEEN_TRANSMITTANCE: f32 = 1.0 / 16.0;

/// What the eye has to do with a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    /// It sees it.
    pub is_seen: bool,
    /// One of its rays comes there.
    pub is_reached: bool,
}

/// By linear index of the cells. `field` has the extinction.
pub fn see(scene: &SceneParams, field: &Texture<Vec4>) -> Vec<Sight> {
    let counts = UVec3::from(scene.light_dims) + 1;
    let mut cells = vec![Sight::default(); counts.element_product() as usize];
    let [width, height] = scene.size.map(|n| n * rays(scene).per_pixel);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let place = (Vec2::new(x as f32, y as f32) + 0.5) / Vec2::new(width as f32, height as f32);
        let ray = make_ray(scene, index_from_world(scene, scene.eye.into()), eye_direction(scene, place), STEP);
        let mut tau = 0.0f32;
        for Step { p, stride, .. } in ray.steps(ray.dt, f32::INFINITY) {
            if (-tau).exp() <= LEAST_TRANSMITTANCE {
                break;
            }
            let sigma = field.sample(p).w;
            if sigma > 0.0 {
                let cell = (p / scene.light_edge as f32 + 0.5).floor().as_uvec3().min(UVec3::from(scene.light_dims));
                let sight = &mut cells[((cell.z * counts.y + cell.y) * counts.x + cell.x) as usize];
                sight.is_reached = true;
                sight.is_seen |= (-tau).exp() > SEEN_TRANSMITTANCE;
            }
            tau += sigma * scene.max_extinction * stride;
        }
    }
    cells
}
