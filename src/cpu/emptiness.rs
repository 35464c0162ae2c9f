//! Twins of `occupancy.comp`, `distance.comp` and `octants.comp`.

use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::emptiness::cells;
use crate::shaders::constants::{MAX_EMPTINESS, MAX_OCTANT, OCTANT_BITS};
use glam::{IVec3, UVec3, Vec4};

/// Can a ray meet extinction in a macrocell of `edge` voxels?
pub fn occupancy(scene: &SceneParams, field: &Texture<Vec4>, edge: u32) -> Texture<bool> {
    let mut cells = Texture::filled(cells(scene.dims, edge), false);
    for voxel in boxed(UVec3::ZERO, field.dims - 1) {
        if field.fetch(voxel).w > 0.0 {
            // Interpolation carries it to the next voxels too.
            let low = (voxel.as_ivec3() - 1).max(IVec3::ZERO).as_uvec3() / edge;
            let high = (voxel + 1).min(field.dims - 1) / edge;
            for cell in boxed(low, high) {
                *cells.texel_mut(cell) = true;
            }
        }
    }
    cells
}

/// Chebyshev distance of every macrocell to the nearest occupied one, at most [`MAX_EMPTINESS`].
pub fn distance(occupied: &Texture<bool>) -> Texture<u32> {
    nearest(occupied, MAX_EMPTINESS, |_| true)
}

/// For each octant the Chebyshev distance to the nearest occupied macrocell that lies in it, at most [`MAX_OCTANT`];
/// [`OCTANT_BITS`] bits each, that of octant 0 lowest.
pub fn octants(occupied: &Texture<bool>) -> Texture<u32> {
    let mut words = Texture::filled(occupied.dims.to_array(), 0);
    for octant in 0..8 {
        let ahead =
            |way: IVec3| (0..3).all(|axis| if octant >> axis & 1 == 1 { way[axis] >= 0 } else { way[axis] <= 0 });
        for (word, found) in words.texels.iter_mut().zip(nearest(occupied, MAX_OCTANT, ahead).texels) {
            *word |= found << (OCTANT_BITS * octant);
        }
    }
    words
}

/// Chebyshev distance of every cell to the nearest occupied one that `counts` by the way to it, at most `most`.
fn nearest(occupied: &Texture<bool>, most: u32, counts: impl Fn(IVec3) -> bool) -> Texture<u32> {
    let all = || boxed(UVec3::ZERO, occupied.dims - 1);
    let there: Vec<UVec3> = all().filter(|&cell| occupied.fetch(cell)).collect();
    let to = |cell: UVec3| {
        let ways = there.iter().map(|o| o.as_ivec3() - cell.as_ivec3()).filter(|&way| counts(way));
        ways.map(|way| way.abs().max_element() as u32).min().unwrap_or(most).min(most)
    };
    Texture::new(occupied.dims.to_array(), all().map(to).collect())
}

/// The points of a box, its upper corner included, x fastest.
pub(super) fn boxed(low: UVec3, high: UVec3) -> impl Iterator<Item = UVec3> {
    (low.z..=high.z)
        .flat_map(move |z| (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| UVec3::new(x, y, z))))
}
