//! Twin of `mark.comp` and `compact.comp`.

use super::emptiness::boxed;
use super::see::Sight;
use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::compact::{Blocks, Listed};
use crate::shaders::constants::REACH_BLOCK;
use glam::{IVec3, UVec3, Vec4};

/// Is no cell reached in the cell's block of `REACH_BLOCK`³ cells, nor in those beside it?
fn is_remote(blocks: Blocks, sight: &[Sight], cell: IVec3) -> bool {
    let (counts, edge) = (IVec3::from(blocks.cells().map(|d| d as i32)), REACH_BLOCK as i32);
    let first = (edge * (cell / edge - 1)).max(IVec3::ZERO);
    let last = (edge * (cell / edge + 2) - 1).min(counts - 1);
    let index = |at: UVec3| ((at.z * counts.y as u32 + at.y) * counts.x as u32 + at.x) as usize;
    !boxed(first.as_uvec3(), last.as_uvec3()).any(|at| sight[index(at)].is_reached)
}

/// Linear indices, in their order, of the listed among the `count` from `first` on. `field` has the extinction; `sight` says
/// of every cell what the eye has to do with it ([`super::see::see`]), and is read where the list depends on that.
pub fn compact(
    scene: &SceneParams,
    blocks: Blocks,
    field: &Texture<Vec4>,
    sight: &[Sight],
    listed: Listed,
    first: u32,
    count: u32,
) -> Vec<u32> {
    let (dims, edge) = (IVec3::from(scene.dims.map(|d| d as i32)), blocks.edge as i32);
    // Twice the place of the planes between which extinction is looked for, from the block's begin on: then all are whole.
    let (counts, low, high) = match listed {
        Listed::Voxels => (blocks.dims, 1, 2 * edge - 1),
        Listed::Nodes => (blocks.dims, -edge, 3 * edge),
        Listed::Cells | Listed::SeenCells | Listed::HiddenCells | Listed::RemoteCells => (blocks.cells(), -edge, edge),
    };
    let is_listed = |&i: &u32| {
        let at = UVec3::new(i % counts[0], i / counts[0] % counts[1], i / counts[0] / counts[1]).as_ivec3();
        let is_wanted = match listed {
            Listed::SeenCells => sight[i as usize].is_seen,
            Listed::HiddenCells => !sight[i as usize].is_seen && !is_remote(blocks, sight, at),
            Listed::RemoteCells => !sight[i as usize].is_seen && is_remote(blocks, sight, at),
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
