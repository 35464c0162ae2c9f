//! Twin of `include/contribute.glsl`.

use super::sphere::phase_hg;
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::shaders::constants::MAX_HALF;
use glam::{UVec3, Vec3, Vec4};
use std::f32::consts::PI;

/// Light that arrives at a voxel, integrated over directions and divided by 4π; a component per channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arrived {
    /// mean L
    pub a: Vec3,
    /// mean L ω_i: component of x, y, z
    pub b: [Vec3; 3],
    /// mean L 4π p(ω_i · ω_eye), of the light that the eye shall see through the cache
    pub eye: Vec3,
}

/// What an order's light is added to.
#[derive(Clone, Debug)]
pub struct Orders {
    /// Next order's A and extinction.
    pub next_a: Texture<Vec4>,
    /// Next order's B by component.
    pub next_b: [Texture<Vec4>; 3],
    /// What the eye sees of all orders, and extinction.
    pub total: Texture<Vec4>,
}

/// Adds radiance `l` that propagates along `direction` (unit vector, world), weighted; for the next order only.
pub fn arrive_unseen(sum: &mut Arrived, l: Vec3, direction: Vec3) {
    sum.a += l;
    for axis in 0..3 {
        sum.b[axis] += l * direction[axis];
    }
}

/// The same for the next order and for the eye.
pub fn arrive(scene: &SceneParams, sum: &mut Arrived, l: Vec3, direction: Vec3, to_eye: Vec3) {
    arrive_unseen(sum, l, direction);
    sum.eye += l * (4.0 * PI * phase_hg(scene.g, direction.dot(to_eye)));
}

/// Scatters what arrived at a voxel: `scattering` is its scattering coefficient in the fields' units.
pub fn add_to(
    scene: &SceneParams,
    voxel: UVec3,
    scattering: Vec3,
    arrived: &Arrived,
    extinction: f32,
    first: bool,
    orders: &mut Orders,
) {
    let cut = |v: Vec3| v.clamp(Vec3::splat(-MAX_HALF), Vec3::splat(MAX_HALF));
    let add = |texture: &mut Texture<Vec4>, light: Vec3, first: bool, alpha: f32| {
        let texel = texture.texel_mut(voxel);
        let old = if first { Vec3::ZERO } else { texel.truncate() };
        *texel = cut(old + light).extend(alpha);
    };
    add(&mut orders.next_a, arrived.a * scattering, first, extinction);
    for axis in 0..3 {
        add(&mut orders.next_b[axis], 3.0 * scene.g * scattering * arrived.b[axis], first, 0.0);
    }
    add(&mut orders.total, scattering * arrived.eye, false, extinction);
}
