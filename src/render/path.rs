//! The path tracer as a progressive render: rounds of samples, each whole before the next, and what is known so far.

use super::state::{Header, State};
use super::{Progress, stopped};
use crate::Result;
use crate::output::Picture;
use crate::passes::emptiness::Emptiness;
use crate::passes::path::{PathConfig, PathTracer};
use crate::passes::scene_data::SceneData;
use crate::scene::{Scene, Settings, UNLIMITED};
use crate::shaders::constants;
use crate::stats::{PathStats, Stats, VolumeStats, pass_stats};
use crate::vk::{Context, Recorder, TimedPass};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Seconds between saves of a render's state: what can be lost.
const SAVE_SECONDS: f64 = 20.0;

/// Renders `scene` until one of its settings says stop: `spp`, `seconds`, `target_error`. With a `state` file the render
/// goes on from it if it exists, and is saved to it now and then and at the end.
///
/// Errors: the device cannot hold the scene, the state is of another render or cannot be written, or the render was
/// stopped.
pub fn render(
    ctx: &Context,
    scene: &Scene,
    state: Option<&Path>,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<(Picture, Stats)> {
    let start = Instant::now();
    let s = &scene.settings;
    let mut header = state.map(|_| Header::new(scene));
    let saved = match (state, &header) {
        (Some(path), Some(header)) if path.exists() => Some(State::resume(path, header)?),
        _ => None,
    };
    let mut render = PathRender::new(ctx, scene)?;
    if let Some(saved) = &saved {
        render.restore(&saved.sums)?;
    }
    // The random numbers do not depend on how often a render was interrupted, but its pace does.
    let begun = render.samples;
    let mut saved_at = start.elapsed().as_secs_f64();
    let mut next = render.next_round(s, begun, start.elapsed().as_secs_f64(), state.is_some())?;
    while let Some(round) = next {
        let (begin, count) = (f64::from(render.samples), f64::from(round.samples));
        render.advance(round.samples, &mut |part| {
            let done = (begin + count * part) / round.expected;
            progress(Progress { done, phase: "path tracing" })
        })?;
        let now = start.elapsed().as_secs_f64();
        next = render.next_round(s, begun, now, state.is_some())?;
        if let (Some(path), Some(header)) = (state, &mut header)
            && (next.is_none() || now - saved_at > SAVE_SECONDS)
        {
            header.streams[0].samples = render.samples;
            State { header: header.clone(), sums: render.sums()? }.save(path)?;
            saved_at = now;
        }
    }
    let estimate = render.sums()?.estimate(s.size);
    let stats = render.stats(scene, &estimate, start.elapsed().as_secs_f64() * 1e3);
    Ok((estimate.picture, stats))
}

/// Samples that are taken together.
#[derive(Clone, Copy, Debug)]
struct Round {
    /// How many of every pixel.
    samples: u32,
    /// How many of every pixel there will be in the end, as far as is known.
    expected: f64,
}

/// Sums over the samples of every pixel, row by row from the top; as pairs of which the second is what the first lost.
/// Radiance is in the scale `radiance_scale`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums {
    /// Samples of every pixel.
    pub samples: u32,
    /// Sums of radiance (rgb) and opacity.
    pub value: [Vec<[f32; 4]>; 2],
    /// Sums of squared radiance (rgb), and of the weights of paths that were cut at the event cap.
    pub square: [Vec<[f32; 4]>; 2],
    /// What radiance was multiplied by.
    pub radiance_scale: f64,
}

/// What the sums say.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Mean radiance and opacity.
    pub picture: Picture,
    /// Variance of every pixel's mean, per channel. Infinite for fewer than two samples.
    pub variance: Vec<[f64; 3]>,
    /// Mean radiance of the picture, per channel.
    pub mean: [f64; 3],
    /// Standard error of `mean`.
    pub mean_error: [f64; 3],
    /// Root mean square of the pixels' standard errors over the mean radiance: what `--target-error` bounds.
    pub noise: f64,
    /// Largest share of the light that the event cap can have cut: mean weight of the paths that it ended.
    pub truncated: f64,
}

impl Sums {
    /// Means and errors.
    pub fn estimate(&self, size: [u32; 2]) -> Estimate {
        let n = f64::from(self.samples);
        let scale = self.radiance_scale;
        let exact = |pair: &[Vec<[f32; 4]>; 2], i: usize, c: usize| f64::from(pair[0][i][c]) + f64::from(pair[1][i][c]);
        let pixels = self.value[0].len();
        let mut picture = Vec::with_capacity(pixels);
        let mut variance = Vec::with_capacity(pixels);
        let (mut mean, mut errors, mut truncated) = ([0.0; 3], [0.0; 3], 0.0);
        for i in 0..pixels {
            let value: [f64; 4] = std::array::from_fn(|c| exact(&self.value, i, c) / n);
            let of_mean: [f64; 3] = std::array::from_fn(|c| {
                let spread = (exact(&self.square, i, c) / n - value[c] * value[c]).max(0.0);
                spread / (n - 1.0) / (scale * scale)
            });
            let [r, g, b] = [0, 1, 2].map(|c| value[c] / scale);
            for (c, v) in [r, g, b].into_iter().enumerate() {
                mean[c] += v;
                errors[c] += of_mean[c];
            }
            truncated += exact(&self.square, i, 3) / n;
            picture.push([r, g, b, value[3]].map(|v| v as f32));
            variance.push(of_mean.map(|v| if v.is_nan() { f64::INFINITY } else { v }));
        }
        let count = pixels as f64;
        let mean = mean.map(|m| m / count);
        let total: f64 = errors.iter().sum();
        let brightness: f64 = mean.iter().sum::<f64>() / 3.0;
        let noise = if self.samples < 2 {
            f64::INFINITY
        } else if brightness > 0.0 {
            (total / (3.0 * count)).sqrt() / brightness
        } else {
            0.0
        };
        Estimate {
            picture: Picture { width: size[0], height: size[1], pixels: picture },
            variance,
            mean,
            mean_error: errors.map(|e| if self.samples < 2 { f64::INFINITY } else { e.sqrt() / count }),
            noise,
            truncated: truncated / count,
        }
    }
}

/// A scene set up for path tracing.
pub struct PathRender<'a> {
    ctx: &'a Context,
    data: SceneData,
    tracer: PathTracer,
    active_fraction: f64,
    band_rows: u32,
    budget: u32,
    adapts: bool,
    samples: u32,
    times: Vec<TimedPass>,
}

impl<'a> PathRender<'a> {
    /// Uploads the scene, finds the majorants; no sample is taken yet.
    ///
    /// Errors: the device lacks something; of memory, the error says what would fit.
    pub fn new(ctx: &'a Context, scene: &Scene) -> Result<Self> {
        Self::build(ctx, scene).map_err(|error| super::memory::advise(ctx, scene, error))
    }

    pub(super) fn build(ctx: &'a Context, scene: &Scene) -> Result<Self> {
        let s = &scene.settings;
        let data = SceneData::new(ctx, scene)?;
        let is_unlimited = s.orders == UNLIMITED;
        let config = PathConfig { orders: if is_unlimited { s.max_events } else { s.orders }, is_unlimited };
        let most: u32 = if ctx.is_cpu() { 1 << 16 } else { 1 << 19 };
        let [width, height] = s.size;
        let band_rows = (most / width).clamp(1, height);
        let tracer = PathTracer::new(ctx, &data, scene.background, config, band_rows * width)?;
        let emptiness = Emptiness::for_paths(ctx, data.params.dims)?;
        let mut rec = Recorder::new(ctx)?;
        rec.begin_pass("majorants", 0);
        tracer.record_set_up(&mut rec, &data, &emptiness);
        rec.end_pass();
        let times = rec.submit_and_wait()?;
        let active = ctx.read_back(&tracer.tally)?[constants::TALLY_ACTIVE as usize];
        let active_fraction = f64::from(active) / data.voxels() as f64;
        Ok(Self { ctx, data, tracer, active_fraction, band_rows, budget: 1024, adapts: true, samples: 0, times })
    }

    /// Begins anew with another seed.
    pub fn restart(&mut self, seed: u64) -> Result<()> {
        self.data.set_seed(self.ctx, seed)?;
        let mut rec = Recorder::new(self.ctx)?;
        self.tracer.record_clear(&mut rec);
        rec.submit_and_wait()?;
        self.samples = 0;
        Ok(())
    }

    /// Loop iterations of every dispatch from now on, for tests: instead of what keeps the device responsive.
    pub fn fix_budget(&mut self, budget: u32) {
        self.budget = budget;
        self.adapts = false;
    }

    /// The samples to take next; `None` when `s` says stop. `elapsed`: seconds since the render began or went on, with
    /// `begun` samples; `is_saved`: rounds must be short enough to save between them.
    ///
    /// Whatever the number of rounds, the samples are the same.
    fn next_round(&self, s: &Settings, begun: u32, elapsed: f64, is_saved: bool) -> Result<Option<Round>> {
        /// The error is not believed before.
        const LEAST_SAMPLES: u32 = 16;
        let taken = f64::from(self.samples);
        let left = f64::from(s.spp.saturating_sub(self.samples));
        let mut expected = f64::from(s.spp);
        if s.seconds.is_none() && s.target_error.is_none() && !is_saved {
            return Ok((left > 0.0).then_some(Round { samples: left as u32, expected }));
        }
        // A first look, then never more than as many again as this run has taken.
        let own = f64::from(self.samples - begun);
        let mut count = left.min(own.max(4.0));
        let pace = own / elapsed;
        if pace > 0.0 && is_saved {
            count = count.min((SAVE_SECONDS * pace).max(1.0).floor());
        }
        if let (Some(seconds), true) = (s.seconds, pace > 0.0) {
            let affordable = (seconds - elapsed) * pace;
            expected = expected.min(taken + affordable.max(0.0));
            // A sample more than half of which fits into the time is taken.
            count = count.min((affordable + 0.5).floor());
        }
        if let (Some(target), true) = (s.target_error, self.samples > 1) {
            let noise = self.sums()?.estimate(s.size).noise;
            let needed = taken * (noise / target).powi(2) - taken;
            expected = expected.min(taken + needed.max(1.0));
            let least = f64::from(LEAST_SAMPLES) - taken;
            count = count.min(needed.max(least).ceil());
        }
        Ok((count >= 1.0).then_some(Round { samples: count as u32, expected }))
    }

    /// Goes on from saved sums of the same scene and seed.
    fn restore(&mut self, sums: &Sums) -> Result<()> {
        let arrays = sums.value.iter().chain(&sums.square);
        for (image, pixels) in self.tracer.sums.iter().zip(arrays) {
            self.ctx.upload_image(image, |_| pixels.clone())?;
        }
        self.samples = sums.samples;
        Ok(())
    }

    /// Samples of every pixel so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The pass, for tests.
    pub fn tracer(&self) -> &PathTracer {
        &self.tracer
    }

    /// Figures of the render so far. `wall_ms` is what the caller measured.
    pub fn stats(&self, scene: &Scene, estimate: &Estimate, wall_ms: f64) -> Stats {
        let volume = VolumeStats::of(&scene.volume, self.active_fraction);
        let path = PathStats {
            samples: self.samples,
            mean: estimate.mean,
            mean_error: estimate.mean_error,
            noise: estimate.noise,
            truncated: estimate.truncated,
        };
        let passes = pass_stats(&self.times);
        Stats { path: Some(path), ..Stats::new(self.ctx, scene, volume, passes, Vec::new(), wall_ms) }
    }

    /// Takes `count` more samples of every pixel. `progress` gets the share of them that is done.
    ///
    /// Errors: the device fails, or `progress` breaks off; then the samples of this call are lost in part, and the
    /// render must not go on.
    pub fn advance(&mut self, count: u32, progress: &mut dyn FnMut(f64) -> ControlFlow<()>) -> Result<()> {
        let [width, height] = self.data.params.size;
        let all = f64::from(count) * f64::from(width) * f64::from(height);
        let mut done = 0.0;
        let samples = self.samples..self.samples + count;
        for begin in (0..height).step_by(self.band_rows as usize) {
            let rows = begin..height.min(begin + self.band_rows);
            let mut is_begun = false;
            loop {
                let mut rec = Recorder::new(self.ctx)?;
                if !is_begun {
                    self.tracer.record_begin(&mut rec);
                    is_begun = true;
                }
                rec.begin_pass("path", 0);
                self.tracer.record(&mut rec, &self.data, rows.clone(), samples.clone(), self.budget);
                rec.end_pass();
                let times = rec.submit_and_wait()?;
                if self.adapts {
                    self.adapt_budget(times.iter().map(|t| t.ms).sum());
                }
                self.times.extend(times);
                let tally = self.ctx.read_back(&self.tracer.tally)?;
                done += f64::from(tally[constants::TALLY_SAMPLES as usize]);
                if progress(done / all).is_break() {
                    return Err(stopped());
                }
                if tally[constants::TALLY_UNFINISHED as usize] == 0 {
                    break;
                }
            }
        }
        self.samples += count;
        Ok(())
    }

    /// Keeps dispatches near 50 ms on a GPU (a watchdog kills after seconds), 300 ms on a CPU. It changes no result.
    fn adapt_budget(&mut self, ms: f64) {
        let aim = if self.ctx.is_cpu() { 300.0 } else { 50.0 };
        let factor = if ms > 0.0 { (aim / ms).clamp(0.5, 2.0) } else { 1.0 };
        self.budget = (f64::from(self.budget) * factor) as u32;
        self.budget = self.budget.clamp(self.tracer.least_budget(), constants::MAX_ITERATIONS);
    }

    /// The sums so far.
    pub fn sums(&self) -> Result<Sums> {
        let read = |i: usize| self.ctx.read_back_image(&self.tracer.sums[i]);
        Ok(Sums {
            samples: self.samples,
            value: [read(0)?, read(1)?],
            square: [read(2)?, read(3)?],
            radiance_scale: f64::from(self.data.params.radiance_scale),
        })
    }
}
