//! Twins of `occupancy.comp` and `distance.comp`.

use super::texture::Texture;
use crate::abi::SceneParams;
use crate::passes::classify::cells;
use crate::shaders::constants::{CELL_SIZE, MAX_EMPTINESS};
use glam::{IVec3, UVec3, Vec4};

/// 0 for the macrocells in which a ray can meet extinction, else [`MAX_EMPTINESS`].
pub fn occupancy(scene: &SceneParams, field: &Texture<Vec4>) -> Texture<u32> {
    let mut cells = Texture::filled(cells(scene.dims), MAX_EMPTINESS);
    for z in 0..scene.dims[2] {
        for y in 0..scene.dims[1] {
            for x in 0..scene.dims[0] {
                let voxel = UVec3::new(x, y, z);
                if field.fetch(voxel).w > 0.0 {
                    // Interpolation carries it to the next voxels too.
                    let low = (voxel.as_ivec3() - 1).max(IVec3::ZERO).as_uvec3() / CELL_SIZE;
                    let high = (voxel + 1).min(field.dims - 1) / CELL_SIZE;
                    for cell in boxed(low, high) {
                        *cells.texel_mut(cell) = 0;
                    }
                }
            }
        }
    }
    cells
}

/// Chebyshev distance of every macrocell to the nearest occupied one, at most [`MAX_EMPTINESS`].
pub fn distance(before: &Texture<u32>) -> Texture<u32> {
    let all = || boxed(UVec3::ZERO, before.dims - 1);
    let occupied: Vec<UVec3> = all().filter(|&cell| before.fetch(cell) == 0).collect();
    let to = |cell: UVec3| occupied.iter().map(|o| (o.as_ivec3() - cell.as_ivec3()).abs().max_element() as u32).min();
    let distances = all().map(|cell| to(cell).unwrap_or(MAX_EMPTINESS).min(MAX_EMPTINESS));
    Texture::new(before.dims.to_array(), distances.collect())
}

/// The points of a box, its upper corner included, x fastest.
fn boxed(low: UVec3, high: UVec3) -> impl Iterator<Item = UVec3> {
    (low.z..=high.z)
        .flat_map(move |z| (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| UVec3::new(x, y, z))))
}
