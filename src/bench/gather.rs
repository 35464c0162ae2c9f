//! `tyndall bench gather`: one gather of light that was scattered once, with one way to choose directions after another: what its
//! parts take, and how noisy a picture is of what comes out of it.
//!
//! The time of a whole picture hides that: what is the same for all ways, the camera and the projection above all, takes most of
//! it. Here is the most that a choice of directions can bring. Noise is that of pictures nevertheless: in the voxels it is mostly
//! of the kind that goes up and down from one to the next, which no picture shows. All pictures have the same camera rays, so that the
//! camera's own noise is none.

use super::lit::Lit;
use super::proxy::draw_cells;
use super::{Timing, time, time_at};
use crate::measure::processor_ms;
use crate::passes::bench_rays::{BenchRays, RayConfig};
use crate::passes::camera::{Camera, Content};
use crate::passes::compact::ChunkArgs;
use crate::passes::gather::{Gather, GatherConfig, Gathered};
use crate::passes::mips::Mips;
use crate::passes::pilot::{Look, Pilot};
use crate::passes::project::{Kept, Projection, Scattering, Source};
use crate::passes::proxy::{Proxy, ProxyConfig};
use crate::render::{auto, bands, chunk_items};
use crate::scene::{Background, Sampling, Scene, Settings};
use crate::shaders::constants;
use crate::stats::median;
use crate::vk::{Buffer, Context, Image, Recorder, TimedPass};
use crate::{Error, Result};
use serde::Serialize;

/// Options.
#[derive(Clone, Debug)]
pub struct Config {
    /// N.
    pub directions: Vec<u32>,
    /// M/N of the ways that have candidates.
    pub ratios: Vec<u32>,
    /// What is compared with `phase`.
    pub samplings: Vec<Sampling>,
    /// Gathers of every way, with as many seeds.
    pub seeds: u32,
    /// Along both axes of the pictures.
    pub pixels: u32,
}

/// Most directions and candidates.
pub const MOST: u32 = 1024;
/// Cells that rays of [`Table::plain_samples_per_second`] start in.
const PLAIN_CELLS: u32 = 1 << 12;
/// Directions of each.
const PLAIN_DIRECTIONS: u32 = 16;
/// Of which the median is taken.
const PLAIN_RUNS: usize = 5;
/// Camera rays of a pixel.
const CAMERA_RAYS: u32 = 16;
/// The order whose gather it is.
const ORDER: u32 = 2;

/// What was measured of one way.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Choice of directions.
    pub sampling: Sampling,
    /// N, traced in the data.
    pub directions: u32,
    /// M, followed in the proxy; 0 with `phase`.
    pub candidates: u32,
    /// GPU time of the proxy, means over voxels included, in ms. All times are medians over the seeds.
    pub build_ms: f64,
    /// GPU time of rays in the proxy and of the choice, in ms.
    pub proxy_ms: f64,
    /// GPU time of rays in the data and of what adds their light up, in ms.
    pub trace_ms: f64,
    /// All of it: CPU time where the device is a CPU, else GPU time, in ms.
    pub ms: f64,
    /// Samples of rays in the data per second of `trace_ms`, over [`Table::plain_samples_per_second`].
    pub sampling_rate: f64,
    /// Standard deviation of a pixel, root mean square over the picture weighted by what the medium covers, over the root mean square
    /// of the pixels' means.
    pub noise: f64,
    /// The same of its mean less that of `phase` with most directions, less what both are noisy: 0 where nothing is left.
    pub bias: f64,
    /// Mean of the pictures over that of `phase` with most directions, minus 1.
    pub mean_bias: f64,
    /// Time in which `phase` is as little noisy, over `ms`.
    pub gain: f64,
}

/// A scene's table.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Volume.
    pub volume: String,
    /// Its voxels along x, y, z.
    pub dims: [u32; 3],
    /// Cells with extinction.
    pub cells: u64,
    /// Gathers of every way.
    pub seeds: u32,
    /// Samples of a ray in the data.
    pub traced_samples: f64,
    /// Reads of a ray in the proxy.
    pub proxy_reads: f64,
    /// Samples per second of rays that march through the source in uniform steps, and do nothing else.
    pub plain_samples_per_second: f64,
    /// GPU time of the projection's solution, which is the same for all ways, in ms.
    pub solve_ms: f64,
    /// Ways.
    pub rows: Vec<Row>,
}

/// How a gather chooses its directions.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Way {
    sampling: Sampling,
    directions: u32,
    candidates: u32,
}

impl Way {
    fn config(self, settings: &Settings) -> GatherConfig {
        let Self { sampling, directions, candidates } = self;
        GatherConfig { sampling, directions, candidates, ..GatherConfig::of(settings) }
    }
}

/// `phase` comes first, with two and four times the most directions, too: its noise falls faster than with the root of time, so that
/// what is beyond them should be measured.
fn ways(config: &Config) -> Vec<Way> {
    let most = config.directions.iter().copied().max().unwrap_or(1);
    let beyond = [2, 4].map(|factor| factor * most);
    let mut all = Vec::new();
    let mut add = |sampling, directions: u32, candidates: u32| {
        let way = Way { sampling, directions, candidates };
        if directions.max(candidates) <= MOST && !all.contains(&way) {
            all.push(way);
        }
    };
    for &directions in config.directions.iter().chain(&beyond) {
        add(Sampling::Phase, directions, 0);
    }
    for &sampling in config.samplings.iter().filter(|s| !matches!(s, Sampling::Phase | Sampling::Auto)) {
        for &directions in &config.directions {
            for ratio in &config.ratios {
                add(sampling, directions, ratio * directions);
            }
        }
    }
    all
}

/// Mean and sum of squared differences from it of every pixel, by Welford's method.
struct Spread {
    count: f32,
    of_pixels: Vec<[f32; 2]>,
}

impl Spread {
    fn new(pixels: usize) -> Self {
        Self { count: 0.0, of_pixels: vec![[0.0; 2]; pixels] }
    }

    fn add(&mut self, values: impl Iterator<Item = f32>) {
        self.count += 1.0;
        for ([mean, squares], value) in self.of_pixels.iter_mut().zip(values) {
            let before = value - *mean;
            *mean += before / self.count;
            *squares += before * (value - *mean);
        }
    }

    /// Weighted sums over the pixels: of the mean, of its square, and of the variance of one value.
    fn sums(&self, weights: &[f32]) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (&[mean, squares], &weight) in self.of_pixels.iter().zip(weights) {
            let (mean, weight) = (f64::from(mean), f64::from(weight));
            let variance = f64::from(squares) / f64::from(self.count - 1.0);
            for (sum, value) in sums.iter_mut().zip([mean, mean * mean, variance]) {
                *sum += weight * value;
            }
        }
        sums
    }

    /// Weighted sum of the squared differences of the means.
    fn squared_difference(&self, other: &Self, weights: &[f32]) -> f64 {
        let pairs = self.of_pixels.iter().zip(&other.of_pixels).zip(weights);
        pairs.map(|((a, b), &w)| f64::from(w) * f64::from(a[0] - b[0]).powi(2)).sum()
    }

    /// Noise, bias and mean bias as [`Row`] has them.
    fn errors(&self, truth: &Self, weights: &[f32]) -> [f64; 3] {
        let [mean, square, variance] = self.sums(weights);
        let [true_mean, _, true_variance] = truth.sums(weights);
        if std::ptr::eq(self, truth) {
            return [(variance / square).sqrt(), 0.0, 0.0];
        }
        let by_noise = (variance + true_variance) / f64::from(self.count);
        let left = (self.squared_difference(truth, weights) - by_noise).max(0.0);
        [(variance / square).sqrt(), (left / square).sqrt(), mean / true_mean - 1.0]
    }
}

/// What all gathers of a scene have in common.
struct World<'a> {
    ctx: &'a Context,
    lit: Lit,
    settings: Settings,
    chunk: u32,
    source: Source,
    means: Mips,
    proxy: Proxy,
    projection: Projection,
    node_args: ChunkArgs,
    cell_args: ChunkArgs,
    solution: Source,
    camera: Camera,
    emitted: Image,
    picture: Image,
}

impl<'a> World<'a> {
    fn new(ctx: &'a Context, mut scene: Scene, ways: &[Way], pixels: u32) -> Result<Self> {
        scene.settings.size = [pixels; 2];
        let settings = scene.settings.clone();
        let of_way = |way: &Way| chunk_items(ctx, Some(&way.config(&settings)));
        let chunk = ways.iter().map(of_way).min().expect("at least one way");
        let lit = Lit::new(ctx, scene, chunk)?;
        let solution = Source::new(ctx, &lit.data, "solution", false)?;
        let proxy = Proxy::new(ctx, &lit.data, ProxyConfig::of(settings.mask))?;
        let steps = settings.projection_steps;
        let projection = Projection::new(ctx, &lit.data, chunk, steps, true, settings.light_for)?;
        let steps = [settings.camera_step, settings.gather_step];
        let content = Content::Scattering;
        let camera = Camera::new(ctx, &lit.data, Background::Transparent, steps, CAMERA_RAYS, content)?;
        // What the medium emits is no matter of directions.
        let emitted = lit.data.field(ctx, "emitted", [1; 3])?;
        let mut rec = Recorder::new(ctx)?;
        rec.clear_image(&emitted);
        solution.clear(&mut rec);
        proxy.record_clear(&mut rec);
        projection.record_clear_all(&mut rec);
        let (node_args, cell_args) = (lit.node_args(ctx, &mut rec)?, lit.cells.chunk_args(ctx, &mut rec, 1)?);
        rec.submit_and_wait()?;
        Ok(Self {
            ctx,
            source: Source { a: lit.source.clone(), b: solution.b.clone() },
            means: Mips::means_of_voxels(ctx, lit.data.params.dims)?,
            lit,
            chunk,
            proxy,
            projection,
            node_args,
            cell_args,
            solution,
            camera,
            emitted,
            picture: Camera::picture(ctx, settings.size)?,
            settings,
        })
    }

    fn record_proxy(&self, rec: &mut Recorder) {
        rec.begin_pass("proxy.means", ORDER);
        self.means.record(rec, &self.lit.source, &self.lit.emptiness.image);
        rec.end_pass();
        self.proxy.record(rec, &self.lit.data, &self.lit.nodes, &self.node_args, &self.means.means[0], ORDER);
    }

    /// One gather: its passes, and its time as [`Row::ms`] has it.
    fn gather(&self, way: Way) -> Result<(Vec<TimedPass>, f64)> {
        let (ctx, lit) = (self.ctx, &self.lit);
        let gather = Gather::new(ctx, &lit.data, way.config(&self.settings), self.chunk, Gathered::Projected)?;
        let mut rec = Recorder::new(ctx)?;
        let args = gather.args(ctx, &mut rec, &lit.cells, 1.0)?;
        self.projection.record_clear(&mut rec);
        rec.submit_and_wait()?;
        let scattering = Scattering {
            scene: &lit.data,
            emptiness: &lit.emptiness.image,
            field: &lit.source,
            projection: &self.projection,
            args: &self.cell_args,
            kept: Kept::Mean,
        };
        let mut rec = Recorder::new(ctx)?;
        let before = processor_ms();
        let proxy = way.sampling.uses_proxy().then_some(&self.proxy);
        if proxy.is_some() {
            self.record_proxy(&mut rec);
        }
        for chunk in lit.cells.chunks() {
            gather.record(&mut rec, &scattering, &chunk, &args, proxy, &self.source, ORDER, 0, false);
        }
        let passes = rec.submit_and_wait()?;
        let timing = Timing::since(ctx, before, &passes)?;
        if let Some(proxy) = proxy {
            proxy.check(ctx)?;
        }
        Ok((passes, timing.best()))
    }

    /// Solves for the source that was gathered.
    fn solve(&self) -> Result<Vec<TimedPass>> {
        let mut rec = Recorder::new(self.ctx)?;
        rec.begin_pass("project", ORDER);
        let Lit { data, nodes, .. } = &self.lit;
        let (into, total) = (&self.solution, &self.source);
        self.projection.record_solve(&mut rec, data, nodes, &self.node_args, into, None, total, false);
        rec.end_pass();
        rec.submit_and_wait()
    }

    /// A picture of what was solved for.
    fn picture(&self) -> Result<Vec<[f32; 4]>> {
        let Lit { data, emptiness, source, .. } = &self.lit;
        for sample in 0..CAMERA_RAYS {
            let mut rec = Recorder::new(self.ctx)?;
            for rows in bands(self.ctx, data.params.size) {
                let (total, emitted, picture) = (&self.solution, &self.emitted, &self.picture);
                self.camera.record(&mut rec, data, &emptiness.image, total, source, emitted, picture, sample, rows);
            }
            rec.submit_and_wait()?;
        }
        self.ctx.read_back_image(&self.picture)
    }

    /// Samples of a ray in the data, and reads of one in the proxy.
    fn samples(&self) -> Result<[f64; 2]> {
        let (ctx, data) = (self.ctx, &self.lit.data);
        let steps = [self.settings.gather_step, self.settings.proxy_step];
        let pilot = Pilot::new(ctx, data, PLAIN_DIRECTIONS, steps)?;
        let mut rec = Recorder::new(ctx)?;
        self.record_proxy(&mut rec);
        let (cells, emptiness) = (&self.lit.cells, &self.lit.emptiness.image);
        pilot.record(&mut rec, Look::Pilot, data, emptiness, cells, &self.proxy, &self.source);
        rec.submit_and_wait()?;
        let (found, directions) = (pilot.samples(ctx, Look::Pilot, cells)?, pilot.directions(Look::Pilot));
        let traced = auto::steps_per_ray(&found, directions, |s| s.traced_steps);
        let in_proxy = auto::steps_per_ray(&found, directions, |s| s.proxy_steps);
        Ok([f64::from(constants::STEP_SAMPLES) * traced, in_proxy])
    }

    /// See [`Table::plain_samples_per_second`].
    fn plain_samples_per_second(&self) -> Result<f64> {
        let (ctx, lit) = (self.ctx, &self.lit);
        let cells = draw_cells(&lit.cells.read_back(ctx)?, PLAIN_CELLS, lit.data.params.seed_low);
        let rays = cells.len() * PLAIN_DIRECTIONS as usize;
        let cells = ctx.upload("bench.cells", &cells)?;
        let inputs = lit.ray_inputs(&self.proxy, &self.means.means[0]);
        let edge = constants::SKIP_SIZE;
        let pass = BenchRays::new(
            ctx,
            RayConfig { structure: constants::STRUCTURE_NONE, edge, step: self.settings.gather_step, reach: 0.0 },
        )?;
        let results: Buffer<[f32; 2]> = ctx.device_buffer("bench.results", rays)?;
        let counts: Buffer<[u32; 3]> = ctx.device_buffer("bench.counts", rays)?;
        let follow =
            |counts| time(ctx, |rec| pass.record(rec, &lit.data, inputs, &cells, PLAIN_DIRECTIONS, &results, counts));
        follow(Some(&counts))?;
        let samples: f64 = ctx.read_back(&counts)?.iter().map(|count| f64::from(count[1])).sum();
        follow(None)?; // lavapipe compiles at first use
        let times: Vec<f64> = (0..PLAIN_RUNS).map(|_| Ok(follow(None)?.gpu)).collect::<Result<_>>()?;
        Ok(samples / (1e-3 * median(&times)))
    }
}

/// Time of the passes whose names begin so, in ms.
fn ms_of(passes: &[TimedPass], begin: &str) -> f64 {
    passes.iter().filter(|pass| pass.name.starts_with(begin)).fold(0.0, |sum, pass| sum + pass.ms)
}

/// Measures all ways on `scene`. `progress` is told the share that is done.
///
/// Errors: the scene is empty or dark, or the device fails.
pub fn run(ctx: &Context, scene: Scene, config: &Config, progress: &mut dyn FnMut(f64)) -> Result<Table> {
    let ways = ways(config);
    let (volume, seed) = (scene.volume.name.clone(), scene.settings.seed);
    let mut world = World::new(ctx, scene, &ways, config.pixels)?;
    let [traced_samples, proxy_reads] = world.samples()?;
    let plain_samples_per_second = world.plain_samples_per_second()?;
    // lavapipe compiles at first use.
    for (i, &way) in ways.iter().enumerate() {
        if ways[..i].iter().all(|before| before.sampling != way.sampling) {
            world.gather(way)?;
        }
    }
    world.solve()?;
    let first = world.picture()?;
    let covered: Vec<usize> = (0..first.len()).filter(|&i| first[i][3] > 0.0).collect();
    let weights: Vec<f32> = covered.iter().map(|&i| first[i][3]).collect();
    let mean = |pixel: [f32; 4]| (pixel[0] + pixel[1] + pixel[2]) / 3.0;
    if covered.iter().all(|&i| mean(first[i]) == 0.0) {
        let cure = "add a light or an environment, or look where the medium is";
        return Err(Error::input("scene", "no light reaches the eye", cure));
    }

    let mut spreads: Vec<Spread> = ways.iter().map(|_| Spread::new(covered.len())).collect();
    // Proxy, its rays, rays in the data, all.
    let mut times = vec![[const { Vec::new() }; 4]; ways.len()];
    let mut solve_times = Vec::new();
    for run in 0..config.seeds {
        for ((&way, spread), times) in ways.iter().zip(&mut spreads).zip(&mut times) {
            world.lit.data.set_seed(ctx, seed.wrapping_add(u64::from(run)))?;
            let (passes, all) = world.gather(way)?;
            let [build, trace] = ["proxy.", "gather.trace"].map(|name| ms_of(&passes, name));
            let in_proxy = ms_of(&passes, "gather.") - trace;
            for (times, ms) in times.iter_mut().zip([build, in_proxy, trace, all]) {
                times.push(ms);
            }
            solve_times.push(ms_of(&world.solve()?, "project"));
            world.lit.data.set_seed(ctx, seed)?;
            let picture = world.picture()?;
            spread.add(covered.iter().map(|&i| mean(picture[i])));
        }
        progress(f64::from(run + 1) / f64::from(config.seeds));
    }

    let cells = world.lit.cells.items();
    let truth = (0..ways.len()).filter(|&i| ways[i].sampling == Sampling::Phase).max_by_key(|&i| ways[i].directions);
    let truth = &spreads[truth.expect("`phase` is among them")];
    let mut rows = Vec::new();
    for ((way, spread), times) in ways.iter().zip(&spreads).zip(&times) {
        let [build_ms, proxy_ms, trace_ms, ms] = [0, 1, 2, 3].map(|part: usize| median(&times[part]));
        let samples = cells as f64 * f64::from(way.directions) * traced_samples;
        let [noise, bias, mean_bias] = spread.errors(truth, &weights);
        rows.push(Row {
            sampling: way.sampling,
            directions: way.directions,
            candidates: way.candidates,
            build_ms,
            proxy_ms,
            trace_ms,
            ms,
            sampling_rate: samples / (1e-3 * trace_ms) / plain_samples_per_second,
            noise,
            bias,
            mean_bias,
            gain: 1.0,
        });
    }
    let phase: Vec<[f64; 2]> = rows.iter().filter(|r| r.sampling == Sampling::Phase).map(|r| [r.ms, r.noise]).collect();
    for row in rows.iter_mut().filter(|r| r.sampling != Sampling::Phase) {
        row.gain = time_at(&phase, row.noise).expect("`phase` is among them") / row.ms;
    }
    let dims = world.lit.data.params.dims;
    let solve_ms = median(&solve_times);
    let seeds = config.seeds;
    Ok(Table { volume, dims, cells, seeds, traced_samples, proxy_reads, plain_samples_per_second, solve_ms, rows })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_are_what_was_asked_for() {
        let samplings = vec![Sampling::Phase, Sampling::Residual, Sampling::Auto];
        let config = Config { directions: vec![4, 400], ratios: vec![2, 3], samplings, seeds: 2, pixels: 8 };
        let all: Vec<_> = ways(&config).iter().map(|w| (w.sampling, w.directions, w.candidates)).collect();
        let phase = [4, 400, 800].map(|n| (Sampling::Phase, n, 0));
        let residual = [(4, 8), (4, 12), (400, 800)].map(|(n, m)| (Sampling::Residual, n, m));
        assert_eq!(all, [phase, residual].concat(), "nothing beyond {MOST}, nothing but `phase` without candidates");
    }

    #[test]
    fn noise_and_bias_by_hand() {
        let spread = |values: [[f32; 2]; 2]| {
            let mut spread = Spread::new(2);
            values.into_iter().for_each(|v| spread.add(v.into_iter()));
            spread
        };
        // Means 2 and 4, variances 2 and 0.
        let noisy = spread([[1.0, 4.0], [3.0, 4.0]]);
        let weights = [1.0, 3.0];
        let truth = spread([[2.0, 3.0], [2.0, 3.0]]);
        let [noise, bias, mean_bias] = noisy.errors(&truth, &weights);
        let square = 4.0 + 3.0 * 16.0f64;
        assert!((noise - (2.0 / square).sqrt()).abs() < 1e-7, "{noise}");
        // The second voxel is wrong by 1; half of the first one's variance is taken off.
        assert!((bias - ((3.0 - 1.0) / square).sqrt()).abs() < 1e-7, "{bias}");
        assert!((mean_bias - (14.0 / 11.0 - 1.0)).abs() < 1e-7, "{mean_bias}");
        assert_eq!(noisy.errors(&noisy, &weights)[1..], [0.0, 0.0]);
    }
}
