//! Procedural phantoms: volumes that need no file.
//!
//! Each is an implicit function of the position in a box, so that it is the same body at every size. Values lie in
//! 0 to 1; a voxel is *active* above [`ACTIVE`]. Bodies stand upright in LPS (z up) and face the front (−y).

mod field;
mod heart;
mod simple;
mod skull;
mod tree;

use super::{Grid, Volume, VoxelData};
use crate::parallel::fill_chunks;
use crate::{Error, Result};
use field::{bijection, hash};
use glam::{DVec3, Vec3};

/// Values above this are active; below lies only the soft edge of a body.
pub const ACTIVE: f64 = 0.1;

/// World units (mm) per unit of the phantoms' own coordinates.
const SCALE: f64 = 100.0;

/// A function of the position in the phantom's own coordinates.
trait Body: Sync {
    /// The value in 0 to 1.
    fn value(&self, p: Vec3) -> f32;

    /// True only if the value is 0 everywhere within `radius` of `p`. Saves most of the work on empty space.
    fn empty_within(&self, _p: Vec3, _radius: f32) -> bool {
        false
    }
}

impl<F: Fn(Vec3) -> f32 + Sync> Body for F {
    fn value(&self, p: Vec3) -> f32 {
        self(p)
    }
}

/// Distances to ellipsoids and their unions are too large by at most this factor.
const DISTANCE_ERROR: f32 = 2.0;

/// Edge length in voxels of the blocks that are tested for emptiness.
const BLOCK: usize = 8;

struct Phantom {
    name: &'static str,
    /// Default size in voxels.
    dims: [u32; 3],
    /// The box that the grid spans, in the phantom's own coordinates.
    low: Vec3,
    high: Vec3,
    /// Sets up the function; `None`: each voxel's value is drawn from its index.
    body: Option<fn() -> Box<dyn Body>>,
}

const fn phantom(name: &'static str, dims: [u32; 3], low: Vec3, high: Vec3, body: fn() -> Box<dyn Body>) -> Phantom {
    Phantom { name, dims, low, high, body: Some(body) }
}

/// All phantoms. What the values of each mean stands at its function.
static PHANTOMS: [Phantom; 9] = [
    phantom("skull", [256; 3], skull::SKULL_LOW, skull::SKULL_HIGH, skull::skull),
    phantom("head", [256; 3], skull::HEAD_LOW, skull::HEAD_HIGH, skull::head),
    phantom("heart", [256; 3], heart::LOW, heart::HIGH, heart::heart),
    phantom("tree", [512, 512, 182], Vec3::NEG_ONE, Vec3::ONE, tree::tree),
    phantom("cloud", [128; 3], simple::CLOUD_LOW, simple::CLOUD_HIGH, simple::cloud),
    Phantom { name: "noise", dims: [64; 3], low: Vec3::NEG_ONE, high: Vec3::ONE, body: None },
    phantom("sphere", [64; 3], Vec3::NEG_ONE, Vec3::ONE, simple::sphere),
    phantom("constant", [32; 3], Vec3::NEG_ONE, Vec3::ONE, simple::constant),
    phantom("corner", [48, 40, 32], Vec3::NEG_ONE, Vec3::ONE, simple::corner),
];

/// Names of the phantoms.
pub fn names() -> impl Iterator<Item = &'static str> {
    PHANTOMS.iter().map(|p| p.name)
}

/// Makes the phantom `name` with `size` voxels (its own default if `None`). The body keeps its size in the world
/// whatever the number of voxels; the box's centre is near the world's origin.
///
/// `noise` has u32 data, all different in every volume; all others have u8 data, value = stored / 255.
///
/// # Errors
/// Unknown name, a size of zero or of more than 2³²−1 voxels, too little memory.
pub fn generate(name: &str, size: Option<[u32; 3]>) -> Result<Volume> {
    let what = format!("phantom '{name}'");
    let Some(phantom) = PHANTOMS.iter().find(|p| p.name == name) else {
        let known: Vec<_> = names().collect();
        return Err(Error::input(what, "there is none of this name", format!("use one of {}", known.join(", "))));
    };
    let dims = Grid::checked_dims(size.unwrap_or(phantom.dims).map(u64::from), &what)?;
    let extent = (phantom.high - phantom.low).as_dvec3() * SCALE;
    let spacing = extent / DVec3::from(dims.map(f64::from));
    let origin = phantom.low.as_dvec3() * SCALE + spacing / 2.0;
    let grid = Grid::axis_aligned(dims, spacing.to_array(), origin.to_array());
    let (data, largest) = match phantom.body {
        Some(body) => (VoxelData::U8(sample(phantom, &*body(), dims, &what)?), f64::from(u8::MAX)),
        None => {
            let mut values = reserve(&what, grid.voxels())?;
            values.extend((0..grid.voxels()).map(|i| bijection(i as u32)));
            (VoxelData::U32(values), f64::from(u32::MAX))
        }
    };
    Ok(Volume { name: format!("phantom:{name}"), grid, data, slope: 1.0 / largest, intercept: 0.0 })
}

fn reserve<T>(what: &str, count: u64) -> Result<Vec<T>> {
    let mut values = Vec::new();
    let bytes = count.saturating_mul(size_of::<T>() as u64);
    usize::try_from(count).ok().and_then(|n| values.try_reserve_exact(n).ok()).ok_or_else(|| {
        Error::input(what, format!("there is not enough memory for its {bytes} bytes"), "give a smaller size")
    })?;
    Ok(values)
}

/// The function at all voxel centres, slabs of [`BLOCK`] slices shared out over the processor's cores.
fn sample(phantom: &Phantom, body: &dyn Body, dims: [u32; 3], what: &str) -> Result<Vec<u8>> {
    let [nx, ny, nz] = dims.map(|d| d as usize);
    let mut values = reserve(what, (nx * ny * nz) as u64)?;
    values.resize(nx * ny * nz, 0);
    let step = (phantom.high - phantom.low) / Vec3::new(nx as f32, ny as f32, nz as f32);
    let centre = |x: usize, y: usize, z: usize| phantom.low + (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * step;
    let fill = |slab: &mut [u8], first: usize| {
        let z0 = first / (nx * ny);
        let z1 = z0 + slab.len() / (nx * ny);
        for y0 in (0..ny).step_by(BLOCK) {
            for x0 in (0..nx).step_by(BLOCK) {
                let (x1, y1) = (nx.min(x0 + BLOCK), ny.min(y0 + BLOCK));
                let (first, last) = (centre(x0, y0, z0), centre(x1 - 1, y1 - 1, z1 - 1));
                if body.empty_within((first + last) / 2.0, (last - first).length() / 2.0) {
                    continue;
                }
                for z in z0..z1 {
                    for y in y0..y1 {
                        let row = nx * (y + ny * (z - z0));
                        for x in x0..x1 {
                            let value = body.value(centre(x, y, z)).clamp(0.0, 1.0);
                            slab[row + x] = (value * f32::from(u8::MAX)).round() as u8;
                        }
                    }
                }
            }
        }
    };
    fill_chunks(&mut values, BLOCK * nx * ny, fill);
    Ok(values)
}

/// Adds noise, evenly distributed in ±`amplitude` (in the volume's value unit) and different in every voxel. Integers
/// that would leave their type are reflected at its end, so that no two neighbours become equal by clamping.
pub fn add_noise(volume: &mut Volume, amplitude: f64, seed: u32) {
    // Amplitude in stored units; a slope of 0 makes every value the same, with or without noise.
    let amplitude = if volume.slope == 0.0 { 0.0 } else { amplitude / volume.slope };
    let noise = |i: usize| {
        let uniform = f64::from(hash([i as u32, seed, 0])) / f64::from(u32::MAX);
        amplitude * (2.0 * uniform - 1.0)
    };
    macro_rules! integers {
        ($values:expr, $type:ty) => {{
            let (low, high) = (f64::from(<$type>::MIN), f64::from(<$type>::MAX));
            for (i, v) in $values.iter_mut().enumerate() {
                let noisy = f64::from(*v) + noise(i);
                let reflected = if noisy < low {
                    2.0 * low - noisy
                } else if noisy > high {
                    2.0 * high - noisy
                } else {
                    noisy
                };
                // Saturates where the amplitude exceeds the type's whole range.
                *v = reflected.round() as $type;
            }
        }};
    }
    match &mut volume.data {
        VoxelData::U8(values) => integers!(values, u8),
        VoxelData::I8(values) => integers!(values, i8),
        VoxelData::U16(values) => integers!(values, u16),
        VoxelData::I16(values) => integers!(values, i16),
        VoxelData::U32(values) => integers!(values, u32),
        VoxelData::I32(values) => integers!(values, i32),
        VoxelData::F32(values) => values.iter_mut().enumerate().for_each(|(i, v)| *v += noise(i) as f32),
        VoxelData::F64(values) => values.iter_mut().enumerate().for_each(|(i, v)| *v += noise(i)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{active_fraction, summary};

    /// The paper's four data sets and their shares of active voxels (table 2).
    const PAPER: [(&str, f64); 4] = [("skull", 0.18), ("head", 0.51), ("heart", 0.23), ("tree", 0.32)];

    #[test]
    fn active_fractions_are_those_of_the_paper_at_every_size() {
        for (name, target) in PAPER {
            for size in [[64; 3], [96, 48, 80], [128; 3]] {
                let active = active_fraction(&generate(name, Some(size)).unwrap(), ACTIVE);
                assert!((active - target).abs() <= 0.02, "{name} at {size:?}: {active:.4} active, not {target}");
            }
        }
    }

    #[test]
    fn every_phantom_fits_its_description() {
        for name in names() {
            let v = generate(name, Some([24, 20, 16])).unwrap();
            assert_eq!(v.name, format!("phantom:{name}"));
            assert_eq!((v.grid.dims, v.data.len()), ([24, 20, 16], 24 * 20 * 16));
            let s = summary(&v);
            assert!(s.min >= 0.0 && s.max <= 1.0, "{name}: {} to {}", s.min, s.max);
            assert!(s.max > ACTIVE, "{name} has no active voxel");
            assert_eq!(generate(name, Some([24, 20, 16])).unwrap(), v, "{name} is not reproducible");
        }
    }

    /// What lies at the box's faces is cut off there, which pictures show: single leaves may, a crown may not. (The head's
    /// shoulders and the heart's vessels do end there, and the tree stands on its floor.)
    #[test]
    fn bodies_end_within_their_box() {
        const N: usize = 96;
        for name in ["skull", "tree"] {
            let volume = generate(name, Some([N as u32; 3])).unwrap();
            for (axis, end) in [(0, 0), (0, N - 1), (1, 0), (1, N - 1), (2, N - 1)] {
                let is_active = |i: usize| {
                    let mut at = [i % N, i / N, i / N];
                    at[usize::from(axis == 0)] = i % N;
                    at[axis] = end;
                    volume.value(at[0] + N * (at[1] + N * at[2])) > ACTIVE
                };
                let share = (0..N * N).filter(|&i| is_active(i)).count() as f64 / (N * N) as f64;
                assert!(share < 0.02, "{name}: {share:.3} of the face at {end} along axis {axis} is active");
            }
        }
    }

    #[test]
    fn leaving_out_empty_blocks_changes_nothing() {
        struct Everything<'a>(&'a dyn Body);
        impl Body for Everything<'_> {
            fn value(&self, p: Vec3) -> f32 {
                self.0.value(p)
            }
        }
        for phantom in &PHANTOMS {
            let Some(body) = phantom.body else { continue };
            for dims in [[64, 60, 70], [96; 3]] {
                let quick = sample(phantom, &*body(), dims, "test").unwrap();
                let thorough = sample(phantom, &Everything(&*body()), dims, "test").unwrap();
                let different = quick.iter().zip(&thorough).filter(|(a, b)| a != b).count();
                assert_eq!(different, 0, "{} at {dims:?}", phantom.name);
            }
        }
    }

    #[test]
    fn one_voxel_and_thin_sizes_work() {
        for size in [[1, 1, 1], [1, 9, 1], [3, 5, 7]] {
            for name in names() {
                assert_eq!(generate(name, Some(size)).unwrap().grid.dims, size);
            }
        }
    }

    #[test]
    fn the_body_keeps_its_size_whatever_the_voxels() {
        let (low, high) = generate("tree", Some([8, 8, 4])).unwrap().grid.world_bounds();
        let (fine_low, fine_high) = generate("tree", Some([16, 4, 10])).unwrap().grid.world_bounds();
        assert!((low - fine_low).length() < 1e-9 && (high - fine_high).length() < 1e-9);
        assert!((low + DVec3::splat(SCALE)).length() < 1e-9 && (high - DVec3::splat(SCALE)).length() < 1e-9);
    }

    #[test]
    fn noise_is_different_in_every_voxel() {
        let v = generate("noise", Some([40, 30, 50])).unwrap();
        let VoxelData::U32(values) = &v.data else { panic!("noise has u32 data") };
        let mut sorted = values.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), values.len());
        let s = summary(&v);
        assert!((s.mean - 0.5).abs() < 0.005, "mean {}", s.mean);
    }

    #[test]
    fn added_noise_has_its_amplitude_and_follows_its_seed() {
        let clean = generate("sphere", Some([32; 3])).unwrap();
        let noisy = |amplitude, seed| {
            let mut v = clean.clone();
            add_noise(&mut v, amplitude, seed);
            v
        };
        assert_eq!(noisy(0.0, 1), clean);
        assert_eq!(noisy(0.1, 1), noisy(0.1, 1));
        assert_ne!(noisy(0.1, 1), noisy(0.1, 2));
        let v = noisy(0.1, 1);
        let changes: Vec<f64> = (0..v.data.len()).map(|i| (v.value(i) - clean.value(i)).abs()).collect();
        assert!(changes.iter().all(|&c| c <= 0.1 + 0.5 / 255.0));
        let mean = changes.iter().sum::<f64>() / changes.len() as f64;
        assert!((mean - 0.05).abs() < 0.002, "mean change {mean}");
        // Neighbours in the empty corner differ as well: reflected, not clamped.
        let equal = (0..31).filter(|&i| v.value(i) == v.value(i + 1)).count();
        assert!(equal < 8, "{equal} of 31 neighbours are equal");
    }

    #[test]
    fn unknown_names_and_impossible_sizes_are_refused() {
        let text = generate("bust", None).unwrap_err().to_string();
        assert!(text.contains("phantom 'bust'") && text.contains("skull, head, heart, tree"), "{text}");
        let text = generate("skull", Some([8, 0, 8])).unwrap_err().to_string();
        assert!(text.contains("phantom 'skull'") && text.contains("zero"), "{text}");
        let text = generate("skull", Some([65536, 65536, 2])).unwrap_err().to_string();
        assert!(text.contains("phantom 'skull'") && text.contains("more than"), "{text}");
    }

    #[test]
    fn corner_has_no_symmetry() {
        let n = 24;
        let v = generate("corner", Some([n; 3])).unwrap();
        let at = |p: [u32; 3]| v.value((p[0] + n * (p[1] + n * p[2])) as usize);
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            for flips in 0..8 {
                if (order, flips) == ([0, 1, 2], 0) {
                    continue;
                }
                let moved = |p: [u32; 3]| {
                    let mut q = [0; 3];
                    for a in 0..3 {
                        q[a] = if flips >> a & 1 == 1 { n - 1 - p[order[a]] } else { p[order[a]] };
                    }
                    q
                };
                let cells = (0..n * n * n).map(|i| [i % n, i / n % n, i / n / n]);
                let different = cells.filter(|&p| at(p) != at(moved(p))).count();
                assert!(different > 100, "order {order:?}, flips {flips}: {different} voxels differ");
            }
        }
    }
}
