//! Twin of the hash-bucket proxy: `include/color_code.glsl`, `include/proxy.glsl`, and the build of
//! `passes/proxy.rs` (hash, compress 1, sort, compress 2, decompress).

use super::quantiser::{self, Quantiser};
use super::radix_sort::sort_pairs;
use super::scan;
use crate::abi::SceneParams;
use crate::scene::Mask;
use crate::shaders::constants::{ADAPTIVE_COARSER, CODE_SQUARE};

/// Opacity over one mean voxel spacing of the largest extinction.
fn most_opacity(scene: &SceneParams) -> f32 {
    1.0 - (-scene.max_extinction * scene.mean_spacing).exp()
}

/// A field's texel (source function, extinction / max_extinction) to RGBA8, R in the lowest byte. `most` = largest source
/// function of the volume.
pub fn encode_color(scene: &SceneParams, field: [f32; 4], most: f32) -> u32 {
    let [r, g, b, a] = field;
    if a <= 0.0 {
        return 0;
    }
    let level = |source: f32| {
        let relative = if most > 0.0 { (source / most).clamp(0.0, 1.0) } else { 0.0 };
        (relative.sqrt() * 255.0 + 0.5) as u32
    };
    let depth = a * scene.max_extinction * scene.mean_spacing;
    let opacity = (1.0 - (-depth).exp()) / most_opacity(scene).max(1e-30);
    let a = (opacity * 255.0 + 0.5).clamp(1.0, 255.0) as u32;
    level(r) | level(g) << 8 | level(b) << 16 | a << 24
}

/// Mean source function of the channels and extinction / max_extinction of a bucket. `value`: what its levels stand for.
/// Colour 0 is empty space.
pub fn decode_color(scene: &SceneParams, color: u32, value: [f32; 4], most: f32) -> [f32; 2] {
    if color == 0 {
        return [0.0; 2];
    }
    let [r, g, b, a] = value;
    let opacity = a / 255.0 * most_opacity(scene);
    let depth = -(1.0 - opacity).max(1.0 / 65536.0).ln();
    let source = (r + g + b) / (3.0 * CODE_SQUARE as f32) * most;
    [source, (depth / (scene.max_extinction * scene.mean_spacing)).min(1.0)]
}

/// Largest source function of all channels of a field.
pub fn source_max(field: &[[f32; 4]]) -> f32 {
    let active = field.iter().filter(|f| f[3] > 0.0);
    active.map(|f| f[0].max(f[1]).max(f[2])).fold(0.0, f32::max)
}

/// The levels of a colour as the digits of one number, R the lowest.
pub fn hash_color(color: u32, q: &Quantiser) -> u32 {
    let codes = color.to_le_bytes().into_iter().zip(&q.channels);
    codes
        .rev()
        .fold(0, |hash, (code, c)| hash.wrapping_mul(c.floor.len() as u32).wrapping_add(c.level[usize::from(code)]))
}

/// The quantised colour of a hash: the lowest codes of its levels.
pub fn color_of_hash(hash: u32, q: &Quantiser) -> u32 {
    let mut rest = hash;
    let mut code = |channel: usize| {
        let floor = &q.channels[channel].floor;
        let level = rest % floor.len() as u32;
        rest /= floor.len() as u32;
        floor[level as usize] << (8 * channel)
    };
    code(0) | code(1) | code(2) | code(3)
}

/// Voxels of equal hash that follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Their hash.
    pub hash: u32,
    /// Linear index of the first.
    pub base: u32,
    /// Their number.
    pub size: u32,
}

/// The runs along the linear voxel order.
pub fn compress_runs(color: &[u32], q: &Quantiser) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (voxel, &color) in color.iter().enumerate() {
        let hash = hash_color(color, q);
        match runs.last_mut() {
            Some(run) if run.hash == hash => run.size += 1,
            _ => runs.push(Run { hash, base: voxel as u32, size: 1 }),
        }
    }
    runs
}

/// Every channel of a mask without its lowest kept bit; twice the tolerance.
pub fn coarser_mask(mask: Mask) -> Mask {
    match mask {
        Mask::Channels(bits) => Mask::Channels(bits.map(|bits| bits & bits.wrapping_sub(1))),
        Mask::Adaptive(tolerance) => Mask::Adaptive((2.0 * tolerance).max(ADAPTIVE_COARSER)),
    }
}

/// The mask itself if its runs fit into `capacity`, else the finest coarser one that is tried whose runs do; with its
/// quantiser.
pub fn proxy_plan(color: &[u32], mask: Mask, capacity: u32) -> (Mask, Quantiser) {
    let histogram = quantiser::color_histogram(color);
    let mut mask = mask;
    loop {
        let q = quantiser::quantiser(mask, &histogram);
        if compress_runs(color, &q).len() <= capacity as usize {
            return (mask, q);
        }
        assert!(q.levels() != [1; 4], "one run does not fit into a capacity of {capacity}");
        mask = coarser_mask(mask);
    }
}

/// The hash-bucket proxy of a volume's colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proxy {
    /// Number of runs.
    pub runs: u32,
    /// Bucket of every voxel.
    pub bucket_id: Vec<u32>,
    /// Quantised colour of every bucket's voxels.
    pub bucket_color: Vec<u32>,
    /// Hash of every bucket; ascending.
    pub hash_value: Vec<u32>,
    /// First place of every bucket in the voxels ordered by hash.
    pub bucket_base: Vec<u32>,
    /// Voxels of every bucket.
    pub bucket_size: Vec<u32>,
}

/// Builds the proxy of `color` by the method's own steps.
pub fn build(color: &[u32], q: &Quantiser) -> Proxy {
    let runs = compress_runs(color, q);
    let hashes: Vec<u32> = runs.iter().map(|run| run.hash).collect();
    let numbers: Vec<u32> = (0..runs.len() as u32).collect();
    let (hashes, numbers) = sort_pairs(&hashes, &numbers, 0, 32);

    let mut run_bucket = vec![0u32; runs.len()];
    let mut hash_value: Vec<u32> = Vec::new();
    let mut bucket_size: Vec<u32> = Vec::new();
    for (hash, number) in hashes.into_iter().zip(numbers) {
        if hash_value.last() != Some(&hash) {
            hash_value.push(hash);
            bucket_size.push(0);
        }
        let bucket = hash_value.len() - 1;
        bucket_size[bucket] += runs[number as usize].size;
        run_bucket[number as usize] = bucket as u32;
    }
    let ids = runs.iter().zip(&run_bucket);
    Proxy {
        runs: runs.len() as u32,
        bucket_id: ids.flat_map(|(run, &bucket)| std::iter::repeat_n(bucket, run.size as usize)).collect(),
        bucket_color: hash_value.iter().map(|&hash| color_of_hash(hash, q)).collect(),
        bucket_base: scan::exclusive(&bucket_size),
        hash_value,
        bucket_size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The quantiser of a fixed mask.
    fn masked(mask: u32) -> Quantiser {
        quantiser::quantiser(Mask::Channels(mask.to_le_bytes()), &quantiser::color_histogram(&[]))
    }

    #[test]
    fn hashes_by_hand() {
        for (mask, hash, color) in
            [(0xFFFF_FFFF, 0xABCD_1234, 0xABCD_1234), (0xF0F0_F0F0, 0xAC13, 0xA0C0_1030), (0, 0, 0)]
        {
            let q = masked(mask);
            assert_eq!((hash_color(0xABCD_1234, &q), color_of_hash(hash, &q)), (hash, color), "{mask:x}");
        }
        let coarser = coarser_mask(Mask::Channels([0x00, 0x80, 0xF0, 0xFF]));
        assert_eq!(coarser, Mask::Channels([0x00, 0x00, 0xE0, 0xFE]));
        assert_eq!(coarser_mask(Mask::Adaptive(0.0)), Mask::Adaptive(ADAPTIVE_COARSER));
        assert_eq!(coarser_mask(Mask::Adaptive(0.25)), Mask::Adaptive(0.5));
    }

    #[test]
    fn hashes_of_odd_numbers_of_levels_are_all_that_there_are() {
        // 3 levels of R, 1 of G, 2 of B, 2 of A: 12 hashes, of which each colour has its own.
        let colors = [0x1001_0000, 0x1001_0005, 0x1001_0009, 0x1000_0009];
        let q = quantiser::quantiser(Mask::Adaptive(0.0), &quantiser::color_histogram(&colors));
        assert_eq!(q.levels(), [3, 1, 2, 2]);
        let mut hashes: Vec<u32> = colors.iter().map(|&color| hash_color(color, &q)).collect();
        assert_eq!(hashes.iter().map(|&hash| color_of_hash(hash, &q)).collect::<Vec<_>>(), colors);
        hashes.sort_unstable();
        hashes.dedup();
        assert!(hashes.len() == 4 && hashes.iter().all(|&hash| hash < 12), "{hashes:?}");
    }

    #[test]
    fn buckets_by_hand() {
        let colors = [7, 7, 3, 7, 9, 9, 9, 3];
        let proxy = build(&colors, &masked(0xFFFF_FFFF));
        assert_eq!(proxy.runs, 5);
        assert_eq!(proxy.hash_value, [3, 7, 9]);
        assert_eq!(proxy.bucket_size, [2, 3, 3]);
        assert_eq!(proxy.bucket_base, [0, 2, 5]);
        assert_eq!(proxy.bucket_id, [1, 1, 0, 1, 2, 2, 2, 0]);
        let plan = |capacity| proxy_plan(&colors, Mask::Channels([0xFF, 0, 0, 0]), capacity).0;
        assert_eq!(plan(5), Mask::Channels([0xFF, 0, 0, 0]));
        // Without the lowest bit 7 7 2 6 8 8 8 2: as many runs. Without two: 4 4 0 4 8 8 8 0. Without three: 0 .. 8 .. 0.
        assert_eq!(plan(4), Mask::Channels([0xF8, 0, 0, 0]));
    }
}
