//! Twin of `spread.comp`.

use super::emptiness::boxed;
use super::texture::Texture;
use crate::abi::SceneParams;
use glam::{UVec3, Vec3, Vec4};

/// The values of `nodes` at the voxels, trilinear between those that have one (rgb = value, a = 1; else all is 0), with the
/// extinction of `field`.
pub fn spread(scene: &SceneParams, nodes: &Texture<Vec4>, field: &Texture<Vec4>) -> Texture<Vec4> {
    let at = |voxel: UVec3| {
        let u = nodes.sample((voxel.as_vec3() + 0.5) / scene.light_edge as f32);
        let u = if u.w > 0.0 { u.truncate() / u.w } else { Vec3::ZERO };
        u.extend(field.fetch(voxel).w)
    };
    Texture::new(scene.dims, boxed(UVec3::ZERO, UVec3::from(scene.dims) - 1).map(at).collect())
}
