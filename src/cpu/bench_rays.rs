//! Twin of `bench_rays.comp`: its rays, and what is along them in the data and in voxels of one light each. Structures
//! differ from these in rounding only.

use super::gather::{Lattice, lattice_shift};
use super::march::{LEAST_TRANSMITTANCE, Ray, Step, make_ray, mean_transmittance};
use super::project::{Cell, point_of_sample};
use super::rng::{random_float, stream_key};
use super::sphere::lattice_direction;
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::shaders::constants::CELL_POINTS;
use glam::{Vec2, Vec3, Vec4};

/// Ray `d` of `directions` from the cell of a linear index.
pub fn ray(scene: &SceneParams, index: u32, d: u32, directions: u32, step_voxels: f32) -> Ray {
    let flip = random_float(stream_key(index, 0, scene.seed_low, scene.seed_high), 3) * CELL_POINTS as f32;
    let position = Cell::from_linear(scene, index).position(point_of_sample(d, flip as u32));
    let shift = lattice_shift(scene, index, 0, Lattice::Traced);
    make_ray(scene, position, lattice_direction(d, directions, shift), step_voxels)
}

/// Radiance (mean of the channels) and transmittance in steps through `source`: rgb = source function, a = extinction.
pub fn exact(scene: &SceneParams, source: &Texture<Vec4>, ray: Ray) -> [f32; 2] {
    let (mut radiance, mut through) = (Vec3::ZERO, 1.0f32);
    for Step { p, stride, .. } in ray.near_steps(f32::INFINITY) {
        if through <= LEAST_TRANSMITTANCE {
            break;
        }
        let f = source.sample(p);
        let tau = f.w * scene.max_extinction * stride;
        radiance += f.truncate() * (through * tau * mean_transmittance(tau));
        through *= (-tau).exp();
    }
    [radiance.dot(Vec3::splat(1.0 / 3.0)), through]
}

/// The same voxel by voxel, in closed form: `light` holds source function and extinction. To the end of the ray, while
/// the kernel stops at a transmittance of 0.01.
pub fn voxels(scene: &SceneParams, light: &Texture<Vec2>, ray: Ray) -> [f32; 2] {
    // Where the ray crosses a face between voxels.
    let mut crossings = vec![ray.begin, ray.end];
    for axis in 0..3 {
        let at = |face: u32| (face as f32 - ray.origin[axis]) / ray.direction[axis];
        crossings.extend((1..scene.dims[axis]).map(at).filter(|&t| t > ray.begin && t < ray.end));
    }
    crossings.sort_by(f32::total_cmp);
    let (mut radiance, mut through) = (0.0, 1.0f32);
    for stretch in crossings.windows(2) {
        let middle = ray.origin + ray.direction * (0.5 * (stretch[0] + stretch[1]));
        let l = light.fetch_clamped(middle.floor().as_ivec3());
        let passed = (-l.y * scene.max_extinction * (stretch[1] - stretch[0])).exp();
        radiance += l.x * through * (1.0 - passed);
        through *= passed;
    }
    [radiance, through]
}
