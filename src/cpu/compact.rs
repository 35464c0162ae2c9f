//! Twin of `mark.comp` and `compact.comp`.

use super::emptiness::boxed;
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::compact::{Blocks, Listed};
use glam::{IVec3, UVec3, Vec4};

/// Linear indices, in their order, of the listed among the `count` from `first` on. `field` has the extinction; `seen` says
/// of every cell whether the eye sees it ([`super::see::see`]), and is read for lists of seen or hidden cells only.
pub fn compact(
    scene: &SceneParams,
    blocks: Blocks,
    field: &Texture<Vec4>,
    seen: &[bool],
    listed: Listed,
    first: u32,
    count: u32,
) -> Vec<u32> {
    let (dims, edge) = (IVec3::from(scene.dims.map(|d| d as i32)), blocks.edge as i32);
    // Twice the place of the planes between which extinction is looked for, from the block's begin on: then all are whole.
    let (counts, low, high) = match listed {
        Listed::Voxels => (blocks.dims, 1, 2 * edge - 1),
        Listed::Nodes => (blocks.dims, -edge, 3 * edge),
        Listed::Cells | Listed::SeenCells | Listed::HiddenCells => (blocks.cells(), -edge, edge),
    };
    let is_listed = |&i: &u32| {
        let at = UVec3::new(i % counts[0], i / counts[0] % counts[1], i / counts[0] / counts[1]).as_ivec3();
        let is_wanted = match listed {
            Listed::SeenCells => seen[i as usize],
            Listed::HiddenCells => !seen[i as usize],
            _ => true,
        };
        // Voxel v matters between 2v − 1 and 2v + 3.
        let begin = 2 * edge * at;
        let first = IVec3::from_array((begin + low - 1).to_array().map(|x| x.div_euclid(2))).max(IVec3::ZERO);
        let last = IVec3::from_array((begin + high).to_array().map(|x| x.div_euclid(2))).min(dims - 1);
        let is_there = (begin + low).cmplt(2 * dims).all() && first.cmple(last).all();
        is_wanted && is_there && boxed(first.as_uvec3(), last.as_uvec3()).any(|v| field.fetch(v).w > 0.0)
    };
    (first..first + count).filter(is_listed).collect()
}
