//! Twin of `compact.comp`.

use super::scene::voxel_from_linear;
use super::texture::Texture;
use crate::abi::SceneParams;
use glam::Vec4;

/// Linear indices of the voxels with extinction among the `count` from `first` on, in their order.
pub fn compact(scene: &SceneParams, field: &Texture<Vec4>, first: u32, count: u32) -> Vec<u32> {
    (first..first + count).filter(|&i| field.fetch(voxel_from_linear(scene, i)).w > 0.0).collect()
}
