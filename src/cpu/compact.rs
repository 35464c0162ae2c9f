//! Twin of `mark.comp` and `compact.comp`.

use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::compact::Listed;
use glam::{IVec3, UVec3, Vec4};

/// Linear indices, in their order, of the listed among the `count` from `first` on. `field` has the extinction; `seen` says
/// of every cell whether the eye sees it ([`super::see::see`]), and is read for lists of seen or hidden cells only.
pub fn compact(
    scene: &SceneParams,
    field: &Texture<Vec4>,
    seen: &[bool],
    listed: Listed,
    first: u32,
    count: u32,
) -> Vec<u32> {
    let dims = UVec3::from(scene.dims);
    let has_extinction = |v: IVec3| {
        let is_voxel = v.cmpge(IVec3::ZERO).all() && v.cmplt(dims.as_ivec3()).all();
        is_voxel && field.fetch(v.as_uvec3()).w > 0.0
    };
    // What is counted, and the neighbours that make an item listed.
    let (counts, reach) = match listed {
        Listed::Voxels => (dims, 0..=0),
        Listed::Nodes => (dims, -1..=1),
        Listed::Cells | Listed::SeenCells | Listed::HiddenCells => (dims + 1, -1..=0),
    };
    let is_listed = |&i: &u32| {
        let at = UVec3::new(i % counts.x, i / counts.x % counts.y, i / counts.x / counts.y).as_ivec3();
        let along = || reach.clone();
        let is_wanted = match listed {
            Listed::SeenCells => seen[i as usize],
            Listed::HiddenCells => !seen[i as usize],
            _ => true,
        };
        is_wanted && along().any(|z| along().any(|y| along().any(|x| has_extinction(at + IVec3::new(x, y, z)))))
    };
    (first..first + count).filter(is_listed).collect()
}
