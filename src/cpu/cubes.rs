//! Twin of `cubes.comp`.

use super::emptiness::boxed;
use super::texture::Texture;
use crate::passes::cubes::levels;
use crate::shaders::constants::CUBES_VALUE_BITS;
use glam::UVec3;

/// For every voxel its value, and above `CUBES_VALUE_BITS` bits the level of the largest aligned cube around it, 2^level
/// voxels along its edge, that holds no other value.
pub fn cubes(values: &Texture<u32>) -> Texture<u32> {
    let last = values.dims - 1;
    let is_one = |voxel: UVec3, level: u32| {
        let low = voxel >> level << level;
        boxed(low, (low + (1 << level) - 1).min(last)).all(|v| values.fetch(v) == values.fetch(voxel))
    };
    let word = |voxel: UVec3| {
        let level = (0..=levels(values.dims.to_array())).rev().find(|&level| is_one(voxel, level));
        values.fetch(voxel) | level.unwrap_or(0) << CUBES_VALUE_BITS
    };
    Texture::new(values.dims.to_array(), boxed(UVec3::ZERO, last).map(word).collect())
}
