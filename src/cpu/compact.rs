//! Twin of `mark.comp` and `compact.comp`.

use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::compact::Listed;
use glam::{IVec3, UVec3, Vec4};

/// Linear indices, in their order, of the listed among the `count` from `first` on. `field` has the extinction.
pub fn compact(scene: &SceneParams, field: &Texture<Vec4>, listed: Listed, first: u32, count: u32) -> Vec<u32> {
    let dims = UVec3::from(scene.dims);
    let has_extinction = |v: IVec3| {
        let is_voxel = v.cmpge(IVec3::ZERO).all() && v.cmplt(dims.as_ivec3()).all();
        is_voxel && field.fetch(v.as_uvec3()).w > 0.0
    };
    let counts = if listed == Listed::Cells { dims + 1 } else { dims };
    // Neighbours that make an item listed.
    let reach = match listed {
        Listed::Voxels => 0..=0,
        Listed::Nodes => -1..=1,
        Listed::Cells => -1..=0,
    };
    let is_listed = |&i: &u32| {
        let at = UVec3::new(i % counts.x, i / counts.x % counts.y, i / counts.x / counts.y).as_ivec3();
        let along = || reach.clone();
        along().any(|z| along().any(|y| along().any(|x| has_extinction(at + IVec3::new(x, y, z)))))
    };
    (first..first + count).filter(is_listed).collect()
}
