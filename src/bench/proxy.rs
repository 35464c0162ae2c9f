//! `tyndall bench proxy`: which structure lets rays through a volume run fastest, and what its estimates are worth.
//!
//! All structures get the same rays: from points of cells drawn at random, in evenly spread directions, as the gather's.
//! Exact structures take the steps that `gather_trace.comp` takes and differ in what they skip; estimates read less.
//! An estimate is judged by the two-level Monte Carlo that could be made of it: the mean of M estimates plus the mean of N
//! differences to traced rays, with the best M and N.

use super::lit::Lit;
use super::{Timing, time, time_passes};
use crate::passes::bench_rays::{BenchRays, RayConfig, RayInputs};
use crate::passes::cubes::Cubes;
use crate::passes::emptiness::{Emptiness, Measure};
use crate::passes::mips::Mips;
use crate::passes::proxy::{Proxy, ProxyConfig};
use crate::render::chunk_items;
use crate::scene::{Mask, Scene};
use crate::shaders::constants;
use crate::stats::median;
use crate::vk::{Buffer, Context, Image, Recorder};
use crate::{Error, Result};
use serde::Serialize;

/// Options.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Rays, in rounded-up multiples of [`DIRECTIONS`].
    pub rays: u32,
    /// Timed runs of every structure.
    pub runs: u32,
}

/// Directions per cell.
pub const DIRECTIONS: u32 = 16;

/// Step that the errors are measured against, in voxels.
const FINE_STEP: f32 = 0.25;

/// Exact structures may differ from uniform steps by this, root mean square relative to that of the radiance: rounding
/// moves samples a little, and the end of a ray at a thousandth of transmittance from one step to the next.
pub const ROUNDING: f64 = 2e-4;

/// What was measured of one structure.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name.
    pub structure: String,
    /// Does it find what uniform steps find?
    pub is_exact: bool,
    /// GPU time of its construction, median, in ms.
    pub build_ms: f64,
    /// Device memory of what rays read beside the source.
    pub bytes: u64,
    /// Steps per ray.
    pub steps: f64,
    /// Trilinear samples per ray.
    pub trilinear: f64,
    /// Nearest reads per ray.
    pub nearest: f64,
    /// GPU time of all rays, median, in ms.
    pub ms: f64,
    /// Least and largest time of all runs, in ms.
    pub range_ms: [f64; 2],
    /// CPU time of all rays where the device is a CPU, median, in ms.
    pub cpu_ms: Option<f64>,
    /// Rays per second by GPU timestamps.
    pub rays_per_second: f64,
    /// Time over that of the best exact structure, median over the runs: CPU time where there is one.
    pub relative_time: f64,
    /// Root mean square error of the radiance of a ray against fine steps, relative to the rays' root mean square.
    pub error: f64,
    /// Mean radiance over that of fine steps, minus 1.
    pub bias: f64,
    /// Root mean square error of the transmittance against fine steps.
    pub transmittance_error: f64,
    /// Of estimates.
    #[serde(flatten)]
    pub two_level: Option<TwoLevel>,
}

/// What a two-level estimator of the mean over directions would gain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TwoLevel {
    /// Variance of the estimate over that of the radiance, over the directions of a cell.
    pub estimate_variance: f64,
    /// Variance of (radiance − estimate) over that of the radiance.
    pub residual_variance: f64,
    /// Time of the plain estimator over that of the two-level one, at equal error.
    pub gain: f64,
    /// M/N: estimates per traced ray.
    pub estimates_per_ray: f64,
}

/// A scene's table.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Volume.
    pub volume: String,
    /// Its voxels along x, y, z.
    pub dims: [u32; 3],
    /// Cells with extinction over all cells.
    pub active_fraction: f64,
    /// Cells that rays start in.
    pub cells: u32,
    /// Rays.
    pub rays: u32,
    /// Timed runs.
    pub runs: u32,
    /// Index of the fastest exact structure.
    pub best_exact: usize,
    /// Structures.
    pub rows: Vec<Row>,
}

/// Two-level Monte Carlo against plain: variances relative to that of a traced ray, times of an estimate and of a
/// traced ray. The residual needs both.
pub fn two_level(estimate_variance: f64, residual_variance: f64, estimate_time: f64, traced_time: f64) -> TwoLevel {
    let both = estimate_time + traced_time;
    let cost = ((estimate_variance * estimate_time).sqrt() + (residual_variance * both).sqrt()).powi(2);
    TwoLevel {
        estimate_variance,
        residual_variance,
        gain: traced_time / cost,
        estimates_per_ray: (estimate_variance * both / (residual_variance * estimate_time)).sqrt(),
    }
}

/// Mean over cells of the variance over a cell's directions; `value[direction][cell]` by index.
pub fn variance(cells: usize, directions: usize, value: impl Fn(usize) -> f64) -> f64 {
    let of_cell = |cell: usize| {
        let values = || (0..directions).map(|d| value(d * cells + cell));
        let mean = values().sum::<f64>() / directions as f64;
        values().map(|v| (v - mean).powi(2)).sum::<f64>() / (directions - 1) as f64
    };
    (0..cells).map(of_cell).sum::<f64>() / cells as f64
}

/// Something that rays read, with what it took to make it.
struct Built<'a> {
    ms: f64,
    bytes: u64,
    image: &'a Image,
}

/// A structure under test.
struct Contender<'a> {
    name: String,
    is_exact: bool,
    build_ms: f64,
    bytes: u64,
    inputs: RayInputs<'a>,
    pass: BenchRays,
}

/// Edge of the cells of the octree, in voxels.
const OCTREE_EDGE: u32 = 4;
/// Edges of macrocells that are tried, in voxels.
const EDGES: [u32; 3] = [4, 8, 16];

/// Measures all structures on `scene`. `progress` is told the share that is done.
///
/// Errors: the scene is empty or dark, an exact structure is not exact, or the device fails.
pub fn run(ctx: &Context, scene: Scene, config: Config, progress: &mut dyn FnMut(f64)) -> Result<Table> {
    let volume = scene.volume.name.clone();
    let lit = Lit::new(ctx, scene, chunk_items(ctx, None))?;
    let (data, dims) = (&lit.data, lit.data.params.dims);
    let cells = draw_cells(&lit.cells.read_back(ctx)?, config.rays.div_ceil(DIRECTIONS), data.params.seed_low);
    let cell_count = cells.len() as u32;
    let cells = ctx.upload("bench.cells", &cells)?;
    let runs = config.runs;

    // Build everything.
    let median_of = |once: &dyn Fn() -> Result<Timing>| -> Result<f64> {
        once()?; // lavapipe compiles at first use
        let times = (0..runs).map(|_| Ok(once()?.gpu)).collect::<Result<Vec<_>>>()?;
        Ok(median(&times))
    };
    let build = |record: &dyn Fn(&mut Recorder)| median_of(&|| time(ctx, record));
    let mut skips = Vec::new();
    for measure in [Measure::Occupied, Measure::Distance, Measure::Octants] {
        for edge in EDGES {
            let emptiness = Emptiness::new(ctx, dims, edge, measure)?;
            let ms = build(&|rec| emptiness.record(rec, data, &lit.source))?;
            skips.push((measure, edge, emptiness, ms));
        }
    }
    let skip = |measure: Measure, edge: u32| {
        let found = skips.iter().find(|s| (s.0, s.1) == (measure, edge));
        let (.., emptiness, ms) = found.expect("all are built");
        Built { ms: *ms, bytes: emptiness.image.bytes(), image: &emptiness.image }
    };
    let occupied = skip(Measure::Occupied, OCTREE_EDGE);
    let octree = Cubes::new(ctx, occupied.image.extent())?;
    let octree_ms = build(&|rec| octree.record(rec, occupied.image))? + occupied.ms;
    let mips = Mips::new(ctx, dims)?;
    let mips_ms = build(&|rec| mips.record(rec, &lit.source, &lit.emptiness.image))?;
    let mut proxies = Vec::new();
    for (of, bits) in [(&lit.source, 4u32), (&mips.means[0], 4), (&mips.means[0], 8)] {
        let mask = Mask::Channels([(0xFFu32 << (8 - bits)) as u8; 4]);
        let proxy = Proxy::new(ctx, data, ProxyConfig::of(mask))?;
        let mut rec = Recorder::new(ctx)?;
        let args = lit.node_args(ctx, &mut rec)?;
        proxy.record_clear(&mut rec);
        rec.submit_and_wait()?;
        let ms = median_of(&|| time_passes(ctx, |rec| proxy.record(rec, data, &lit.nodes, &args, of, 0)))?;
        proxy.check(ctx)?;
        let cubes = Cubes::new(ctx, dims)?;
        let cubes_ms = build(&|rec| cubes.record(rec, proxy.bucket_id()))? + ms;
        let buckets = proxy.counts(&ctx.read_back(proxy.control())?).buckets;
        proxies.push((bits, proxy, ms, cubes, cubes_ms, 4 * u64::from(buckets)));
    }
    progress(0.2);

    // Who takes part.
    let octants = skip(Measure::Octants, constants::SKIP_SIZE);
    let inputs = RayInputs {
        source: &lit.source,
        emptiness: octants.image,
        skips: octants.image,
        values: &mips.values[0],
        bucket_light: proxies[0].1.bucket_light(),
        coarse_values: [&mips.values[1], &mips.values[2]],
        coarse_source: [&mips.means[1], &mips.means[2]],
    };
    let plain = RayConfig { structure: constants::STRUCTURE_NONE, edge: constants::SKIP_SIZE, step: 1.0, reach: 0.0 };
    let mut contenders = Vec::new();
    let mut add = |name: String, is_exact: bool, build_ms: f64, bytes: u64, inputs, config| -> Result<()> {
        contenders.push(Contender { name, is_exact, build_ms, bytes, inputs, pass: BenchRays::new(ctx, config)? });
        Ok(())
    };
    add("uniform steps".into(), true, 0.0, 0, inputs, plain)?;
    for (structure, measure, name) in [
        (constants::STRUCTURE_CELLS, Measure::Occupied, "macrocells"),
        (constants::STRUCTURE_DISTANCE, Measure::Distance, "distance"),
        (constants::STRUCTURE_OCTANTS, Measure::Octants, "octants"),
    ] {
        for edge in EDGES {
            let built = skip(measure, edge);
            let inputs = RayInputs { skips: built.image, emptiness: built.image, ..inputs };
            let config = RayConfig { structure, edge, ..plain };
            add(format!("{name} {edge}³"), true, built.ms, built.bytes, inputs, config)?;
        }
    }
    let flat = RayConfig { structure: constants::STRUCTURE_FLAT, ..plain };
    add(format!("octants {}³, flat", flat.edge), true, octants.ms, octants.bytes, inputs, flat)?;
    let octree_inputs = RayInputs { skips: &octree.image, ..inputs };
    let config = RayConfig { structure: constants::STRUCTURE_OCTREE, edge: OCTREE_EDGE, ..plain };
    add(format!("octree {OCTREE_EDGE}³"), true, octree_ms, octree.image.bytes(), octree_inputs, config)?;
    for (bits, proxy, ms, cubes, cubes_ms, bucket_bytes) in &proxies[1..] {
        let runs = RayInputs { values: proxy.bucket_id(), bucket_light: proxy.bucket_light(), ..inputs };
        let config = RayConfig { structure: constants::STRUCTURE_RUNS, ..plain };
        add(format!("runs, {bits} bits"), false, *ms, proxy.bucket_id().bytes() + bucket_bytes, runs, config)?;
        let inputs = RayInputs { values: &cubes.image, ..runs };
        let config = RayConfig { structure: constants::STRUCTURE_CUBES, ..plain };
        add(format!("cubes, {bits} bits"), false, *cubes_ms, cubes.image.bytes() + bucket_bytes, inputs, config)?;
    }
    for (p, step, name) in
        [(0, 2.0, "buckets of centres"), (1, 1.0, "buckets"), (1, 2.0, "buckets"), (1, 4.0, "buckets")]
    {
        let (_, proxy, proxy_ms, .., bucket_bytes) = &proxies[p];
        let inputs = RayInputs { values: proxy.bucket_id(), bucket_light: proxy.bucket_light(), ..inputs };
        let bytes = proxy.bucket_id().bytes() + bucket_bytes + octants.bytes;
        let config = RayConfig { structure: constants::STRUCTURE_BUCKETS, step, ..plain };
        add(format!("{name}, step {step}"), false, proxy_ms + octants.ms, bytes, inputs, config)?;
    }
    for step in [1.0, 2.0, 4.0] {
        let bytes = mips.values[0].bytes() + octants.bytes;
        let config = RayConfig { structure: constants::STRUCTURE_VOXELS, step, ..plain };
        add(format!("voxels, step {step}"), false, mips_ms + octants.ms, bytes, inputs, config)?;
    }
    let value_bytes: u64 = mips.values.iter().map(Image::bytes).sum::<u64>() + octants.bytes;
    let blended_bytes: u64 = mips.means[1..].iter().map(Image::bytes).sum::<u64>() + octants.bytes;
    for (structure, name, bytes) in [
        (constants::STRUCTURE_NEAREST_MIPS, "mips nearest", value_bytes),
        (constants::STRUCTURE_MIPS, "mips trilinear", blended_bytes),
    ] {
        for reach in [2.0, 4.0, 8.0] {
            let config = RayConfig { structure, reach, ..plain };
            add(format!("{name}, reach {reach}"), false, mips_ms + octants.ms, bytes, inputs, config)?;
        }
    }

    // Results and counts, untimed; what is compiled at first use is compiled now.
    let rays = cell_count * DIRECTIONS;
    let results: Buffer<[f32; 2]> = ctx.device_buffer("bench.results", rays as usize)?;
    let counts: Buffer<[u32; 3]> = ctx.device_buffer("bench.counts", rays as usize)?;
    let follow = |pass: &BenchRays, inputs, counts: Option<&Buffer<[u32; 3]>>| -> Result<Timing> {
        time(ctx, |rec| pass.record(rec, data, inputs, &cells, DIRECTIONS, &results, counts))
    };
    let fine = BenchRays::new(ctx, RayConfig { step: FINE_STEP, ..plain })?;
    follow(&fine, inputs, None)?;
    let fine: Vec<[f32; 2]> = ctx.read_back(&results)?;
    let mut found = Vec::new();
    let mut means = Vec::new();
    for c in &contenders {
        follow(&c.pass, c.inputs, Some(&counts))?;
        let counted = ctx.read_back(&counts)?;
        let mean = |k: usize| counted.iter().map(|c| f64::from(c[k])).sum::<f64>() / f64::from(rays);
        means.push([mean(0), mean(1), mean(2)]);
        follow(&c.pass, c.inputs, None)?;
        found.push(ctx.read_back(&results)?);
    }
    progress(0.4);

    // In turns.
    let mut times = vec![Vec::new(); contenders.len()];
    for run in 0..runs {
        for (c, times) in contenders.iter().zip(&mut times) {
            times.push(follow(&c.pass, c.inputs, None)?);
        }
        progress(0.4 + 0.6 * f64::from(run + 1) / f64::from(runs));
    }

    let best_time = |i: usize| median(&times[i].iter().map(Timing::best).collect::<Vec<_>>());
    let exact = (0..contenders.len()).filter(|&i| contenders[i].is_exact);
    let best_exact = exact.min_by(|&a, &b| best_time(a).total_cmp(&best_time(b))).expect("there are some");
    let traced = &found[0];
    let n = cell_count as usize;
    let variance_of = |value: &dyn Fn(usize) -> f64| variance(n, DIRECTIONS as usize, value);
    let whole = variance_of(&|i| f64::from(traced[i][0]));
    if whole.is_nan() || whole <= 0.0 {
        return Err(Error::input("scene", "no light reaches the medium", "add a light or an environment"));
    }
    let mut rows = Vec::new();
    for (i, c) in contenders.iter().enumerate() {
        let got = &found[i];
        if c.is_exact {
            let off = rms(got, traced, 0) / rms(traced, &[], 0);
            // Written so that a NaN is wrong.
            if off.is_nan() || off > ROUNDING {
                return Err(Error::Device {
                    pass: "bench_rays",
                    problem: format!("rays by '{}' are {off:.1e} off what uniform steps find", c.name),
                });
            }
        }
        let gpu: Vec<f64> = times[i].iter().map(|t| t.gpu).collect();
        let cpu: Option<Vec<f64>> = times[i].iter().map(|t| t.cpu).collect();
        let ms = median(&gpu);
        let sum = |of: &[[f32; 2]]| of.iter().map(|r| f64::from(r[0])).sum::<f64>();
        let ratios: Vec<f64> = times[i].iter().zip(&times[best_exact]).map(|(a, b)| a.best() / b.best()).collect();
        let estimate = |i: usize| f64::from(got[i][0]);
        let two_level = (!c.is_exact).then(|| {
            let estimated = variance_of(&estimate) / whole;
            let residual = variance_of(&|i| f64::from(traced[i][0]) - estimate(i)) / whole;
            two_level(estimated, residual, median(&ratios), 1.0)
        });
        let [steps, trilinear, nearest] = means[i];
        rows.push(Row {
            structure: c.name.clone(),
            is_exact: c.is_exact,
            build_ms: c.build_ms,
            bytes: c.bytes,
            steps,
            trilinear,
            nearest,
            ms,
            range_ms: [gpu.iter().copied().fold(f64::INFINITY, f64::min), gpu.iter().copied().fold(0.0, f64::max)],
            cpu_ms: cpu.map(|cpu| median(&cpu)),
            rays_per_second: f64::from(rays) / ms * 1e3,
            relative_time: median(&ratios),
            error: rms(got, &fine, 0) / rms(&fine, &[], 0),
            bias: sum(got) / sum(&fine) - 1.0,
            transmittance_error: rms(got, &fine, 1),
            two_level,
        });
    }
    let all_cells: f64 = dims.iter().map(|&d| f64::from(d + 1)).product();
    Ok(Table {
        volume,
        dims,
        active_fraction: lit.cells.items() as f64 / all_cells,
        cells: cell_count,
        rays,
        runs,
        best_exact,
        rows,
    })
}

/// Root mean square of component `k` of a − b; b is zero where it is empty.
fn rms(a: &[[f32; 2]], b: &[[f32; 2]], k: usize) -> f64 {
    let at = |i: usize| b.get(i).map_or(0.0, |b| f64::from(b[k]));
    let sum: f64 = a.iter().enumerate().map(|(i, a)| (f64::from(a[k]) - at(i)).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// At most `count` of `all`, one at random of each of as many equal parts: neighbours in the list are near each other, as in
/// the gather.
pub(super) fn draw_cells(all: &[u32], count: u32, seed: u32) -> Vec<u32> {
    use crate::cpu::rng::{random_float, stream_key};
    let count = (count as usize).min(all.len());
    let key = stream_key(0, u32::from_le_bytes(*b"cell"), seed, 0);
    let part = all.len() as f64 / count as f64;
    let at = |i: usize| ((i as f64 + f64::from(random_float(key, i as u32))) * part) as usize;
    (0..count).map(|i| all[at(i).min(all.len() - 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_by_hand() {
        // An estimate that is free and perfect to a tenth of the variance: ten times less work.
        let free = two_level(0.9, 0.1, 1e-12, 1.0);
        assert!((free.gain - 10.0).abs() < 1e-4, "{free:?}");
        // V0 = 1, C0 = 1/4, V1 = 1/5, C1 = 5/4: (1/2 + 1/2)² = 1, and 5/2 estimates per ray.
        let even = two_level(1.0, 0.2, 0.25, 1.0);
        assert!((even.gain - 1.0).abs() < 1e-12 && (even.estimates_per_ray - 5.0).abs() < 1e-12, "{even:?}");
    }

    #[test]
    fn variances_are_within_cells() {
        // Two cells far apart, whose directions differ by ±1: 2 of 2 − 1 each.
        let values = [10.0, 20.0, 12.0, 22.0];
        assert_eq!(variance(2, 2, |i| values[i]), 2.0);
    }

    #[test]
    fn cells_are_spread_over_the_list() {
        let all: Vec<u32> = (100..1100).collect();
        let drawn = draw_cells(&all, 50, 7);
        assert_eq!(drawn.len(), 50);
        assert!(drawn.iter().enumerate().all(|(i, &c)| (c as usize - 100) / 20 == i), "{drawn:?}");
        assert_eq!(draw_cells(&all, 5000, 7).len(), 1000);
    }
}
