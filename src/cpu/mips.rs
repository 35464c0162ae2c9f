//! Twin of `mips.comp`.

use super::emptiness::boxed;
use super::texture::Texture;
use glam::{UVec3, Vec3, Vec4};

/// Means of a source (rgb = source function, a = extinction) over blocks of 2^`level` voxels: rgb = source function times
/// extinction, a = extinction.
pub fn mips(source: &Texture<Vec4>, level: u32) -> Texture<Vec4> {
    let dims = source.dims.to_array().map(|d| d.div_ceil(1 << level));
    let of_voxel = |voxel: UVec3| {
        // The middles of its octants.
        let at = |k: u32| voxel.as_vec3() + 0.25 + 0.5 * UVec3::new(k & 1, k >> 1 & 1, k >> 2).as_vec3();
        (0..8).map(|k| source.sample(at(k))).map(|f| (f.truncate() * f.w).extend(f.w)).sum::<Vec4>() / 8.0
    };
    let all = || boxed(UVec3::ZERO, UVec3::from(dims) - 1);
    if level == 0 {
        return Texture::new(dims, all().map(of_voxel).collect());
    }
    // By halves, as the kernel does: at the volume's end parts with fewer voxels weigh as much as others.
    let below = mips(source, level - 1);
    let of_block = |block: UVec3| {
        let parts: Vec<Vec4> =
            boxed(2 * block, (2 * block + 1).min(below.dims - 1)).map(|part| below.fetch(part)).collect();
        parts.iter().sum::<Vec4>() / parts.len() as f32
    };
    Texture::new(dims, all().map(of_block).collect())
}

/// The same as what nearest reads find: source function (mean of the channels), extinction.
pub fn values(mean: Vec4) -> [f32; 2] {
    let light = if mean.w > 0.0 { mean.truncate().dot(Vec3::splat(1.0 / 3.0)) / mean.w } else { 0.0 };
    [light, mean.w]
}
