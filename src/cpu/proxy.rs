//! Twin of the hash-bucket proxy: `include/color_code.glsl`, `include/proxy.glsl`, and the build of
//! `passes/proxy.rs` (hash, compress 1, sort, compress 2, decompress).

use super::radix_sort::sort_pairs;
use super::scan;
use crate::abi::SceneParams;

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

/// Mean source function of the channels and extinction / max_extinction of a bucket. Colour 0 is empty space.
pub fn decode_color(scene: &SceneParams, color: u32, mask: u32, most: f32) -> [f32; 2] {
    if color == 0 {
        return [0.0; 2];
    }
    // Middle of the levels that share the kept bits.
    let [r, g, b, a] = [0, 8, 16, 24].map(|shift| {
        let (kept, lost) = (color >> shift & 0xFF, !(mask >> shift) & 0xFF);
        (kept as f32 + 0.5 * lost as f32) / 255.0
    });
    let opacity = a.min(1.0) * most_opacity(scene);
    let depth = -(1.0 - opacity).max(1.0 / 65536.0).ln();
    let source = (r * r + g * g + b * b) / 3.0 * most;
    [source, (depth / (scene.max_extinction * scene.mean_spacing)).min(1.0)]
}

/// Largest source function of all channels of a field.
pub fn source_max(field: &[[f32; 4]]) -> f32 {
    let active = field.iter().filter(|f| f[3] > 0.0);
    active.map(|f| f[0].max(f[1]).max(f[2])).fold(0.0, f32::max)
}

/// The bits of `color` that `mask` keeps, packed together.
pub fn hash_color(color: u32, mask: u32) -> u32 {
    let kept = (0..32).filter(|bit| mask >> bit & 1 == 1);
    kept.enumerate().fold(0, |hash, (place, bit)| hash | (color >> bit & 1) << place)
}

/// The masked colour of a hash: the inverse of [`hash_color`].
pub fn color_of_hash(hash: u32, mask: u32) -> u32 {
    let kept = (0..32).filter(|bit| mask >> bit & 1 == 1);
    kept.enumerate().fold(0, |color, (place, bit)| color | (hash >> place & 1) << bit)
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
pub fn compress_runs(color: &[u32], mask: u32) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (voxel, &color) in color.iter().enumerate() {
        let hash = hash_color(color, mask);
        match runs.last_mut() {
            Some(run) if run.hash == hash => run.size += 1,
            _ => runs.push(Run { hash, base: voxel as u32, size: 1 }),
        }
    }
    runs
}

/// Every channel of a mask without its lowest kept bit.
pub fn coarser_mask(mask: u32) -> u32 {
    u32::from_le_bytes(mask.to_le_bytes().map(|bits| bits & bits.wrapping_sub(1)))
}

/// The mask itself if its runs fit into `capacity`, else the finest coarser one whose runs do.
pub fn proxy_plan(color: &[u32], mask: u32, capacity: u32) -> u32 {
    let mut mask = mask;
    while compress_runs(color, mask).len() > capacity as usize {
        assert!(mask != 0, "one run does not fit into a capacity of {capacity}");
        mask = coarser_mask(mask);
    }
    mask
}

/// The hash-bucket proxy of a volume's colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proxy {
    /// Number of runs.
    pub runs: u32,
    /// Bucket of every voxel.
    pub bucket_id: Vec<u32>,
    /// Masked colour of every bucket's voxels.
    pub bucket_color: Vec<u32>,
    /// Hash of every bucket; ascending.
    pub hash_value: Vec<u32>,
    /// First place of every bucket in the voxels ordered by hash.
    pub bucket_base: Vec<u32>,
    /// Voxels of every bucket.
    pub bucket_size: Vec<u32>,
}

/// Builds the proxy of `color` by the method's own steps.
pub fn build(color: &[u32], mask: u32) -> Proxy {
    let runs = compress_runs(color, mask);
    let hashes: Vec<u32> = runs.iter().map(|run| run.hash).collect();
    let numbers: Vec<u32> = (0..runs.len() as u32).collect();
    let (hashes, numbers) = sort_pairs(&hashes, &numbers, 0, mask.count_ones());

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
        bucket_color: hash_value.iter().map(|&hash| color_of_hash(hash, mask)).collect(),
        bucket_base: scan::exclusive(&bucket_size),
        hash_value,
        bucket_size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_by_hand() {
        assert_eq!(hash_color(0xABCD_1234, 0xFFFF_FFFF), 0xABCD_1234);
        assert_eq!(hash_color(0xABCD_1234, 0xF0F0_F0F0), 0xAC13);
        assert_eq!(hash_color(0xABCD_1234, 0), 0);
        assert_eq!(color_of_hash(0xAC13, 0xF0F0_F0F0), 0xA0C0_1030);
        assert_eq!(coarser_mask(0xFFF0_8000), 0xFEE0_0000);
    }

    #[test]
    fn buckets_by_hand() {
        let proxy = build(&[7, 7, 3, 7, 9, 9, 9, 3], 0xFFFF_FFFF);
        assert_eq!(proxy.runs, 5);
        assert_eq!(proxy.hash_value, [3, 7, 9]);
        assert_eq!(proxy.bucket_size, [2, 3, 3]);
        assert_eq!(proxy.bucket_base, [0, 2, 5]);
        assert_eq!(proxy.bucket_id, [1, 1, 0, 1, 2, 2, 2, 0]);
        assert_eq!(proxy_plan(&[7, 7, 3, 7, 9, 9, 9, 3], 0xFF, 5), 0xFF);
        // Without the lowest bit 7 7 2 6 8 8 8 2: as many runs. Without two: 4 4 0 4 8 8 8 0. Without three: 0 .. 8 .. 0.
        assert_eq!(proxy_plan(&[7, 7, 3, 7, 9, 9, 9, 3], 0xFF, 4), 0xF8);
    }
}
