//! Twin of `phong.comp`.

use super::classify::classify;
use super::delta_lights::light_at;
use super::scene::{HostScene, direction_to_eye, voxel_from_linear, world_from_index};
use super::texture::Texture;
use crate::shaders::constants::{MAX_HALF, NO_VALUE};
use glam::{DVec3, IVec3, Vec3, Vec4};
use std::f32::consts::PI;

const SPECULAR: f32 = 0.25;
const SHININESS: f32 = 40.0;

/// Writes the shaded colour of the listed voxels to `total`. `ambient`: mean radiance of the environment.
pub fn phong(scene: &HostScene, active_voxels: &[u32], ambient: Vec3, total: &mut Texture<Vec4>) {
    let s = &scene.params;
    for &index in active_voxels {
        let voxel = voxel_from_linear(s, index);
        let m = classify(s, &scene.points, scene.scalar.fetch(voxel));
        let color = Vec3::from(m.color);
        let position = voxel.as_vec3() + 0.5;
        let world = world_from_index(s, position);
        let here = scene.scalar.fetch(voxel);
        let at = |step: IVec3| match scene.scalar.fetch_clamped(voxel.as_ivec3() + step) {
            NO_VALUE => f64::from(here),
            value => f64::from(value),
        };
        let slope = DVec3::from([IVec3::X, IVec3::Y, IVec3::Z].map(|axis| at(axis) - at(-axis)));
        let covector = |column: [f32; 3]| Vec3::from(column).as_dvec3().dot(slope);
        let gradient = DVec3::new(covector(s.index_of_x), covector(s.index_of_y), covector(s.index_of_z));
        let to_eye = direction_to_eye(s, position);
        let normal = gradient.try_normalize().map_or(to_eye, |n| n.as_vec3());
        let normal = if normal.dot(to_eye) < 0.0 { -normal } else { normal };
        let mut lit = color * ambient;
        for light in &scene.lights {
            let light = light_at(s, light, world);
            let to_light = -light.travel;
            let facing = normal.dot(to_light).max(0.0);
            let half = (to_light + to_eye).normalize_or_zero();
            let shine = if facing > 0.0 { normal.dot(half).max(0.0).powf(SHININESS) } else { 0.0 };
            lit += light.irradiance / PI * (color * facing + SPECULAR * shine);
        }
        let extinction = m.extinction / s.max_extinction;
        let light = (lit * extinction * s.radiance_scale).min(Vec3::splat(MAX_HALF));
        *total.texel_mut(voxel) = light.extend(extinction);
    }
}
