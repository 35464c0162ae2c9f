//! The sweep of `tyndall tradeoff`: renders settings around a scene's own, measures the error and the time of each
//! against the path tracer, and keeps what it has measured.
//!
//! A folder holds the references as saved states (`reference-*.state`) and one pair of files per setting in `settings/`:
//! the picture of the first seed and the record, which is written last. Their names are a digest of all that they depend
//! on, so that a sweep goes on where it was and takes nothing for another scene's.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::knobs::{self, Knob, Setting};
use super::processor_ms;
use super::seeds::{SeedErrors, mean, seed_errors};
use crate::output::{self, BitDepth, Picture, PngOptions};
use crate::render::state::{Header, hex_digest};
use crate::render::{self, Internals, Progress, Renderer};
use crate::scene::file::MAX_SPP;
use crate::scene::{Exposure, Model, Scene, Settings};
use crate::stats::{DeviceStats, PassStats};
use crate::vk::{Context, no_messages};
use crate::{Error, Result, shaders};

/// Seeds of the two references.
const REFERENCE_SEEDS: [u64; 2] = [0x5245_4631, 0x5245_4632];

/// When a reference is good enough.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effort {
    /// So many samples per pixel.
    Samples(u32),
    /// The root mean square of the pixels' standard errors, over the mean radiance, is at most this.
    Error(f64),
}

/// Which clock says what a picture costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// The device's timestamps.
    Device,
    /// Processor time of this process, all cores together: for a device that is the processor, where timestamps count
    /// what else runs on the machine
    Processor,
}

impl Clock {
    /// What it shows.
    pub fn name(self) -> &'static str {
        match self {
            Clock::Device => "GPU time",
            Clock::Processor => "processor time",
        }
    }
}

/// What to sweep, and how well to measure it.
#[derive(Clone, Debug)]
pub struct Options {
    /// Knobs to turn.
    pub knobs: Vec<Knob>,
    /// Pictures per setting, at least two: with the scene's seed and those that follow it.
    pub seeds: u32,
    /// The references' quality.
    pub effort: Effort,
}

/// What was measured of one setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// Bias and noise.
    pub errors: SeedErrors,
    /// GPU time of every seed's picture.
    pub gpu_ms: Vec<f64>,
    /// Processor time of every seed's picture; empty where the system does not tell.
    pub processor_ms: Vec<f64>,
    /// GPU time of the passes, mean over the seeds.
    pub passes: Vec<PassTime>,
    /// Share of the voxels with extinction.
    pub active_fraction: f64,
    /// Elapsed time of all seeds, with the set-up.
    pub wall_ms: f64,
}

/// GPU time of a pass, summed over the orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassTime {
    /// Its name.
    pub name: String,
    /// Its time.
    pub ms: f64,
}

impl Record {
    /// Time of every seed's picture, in ms.
    pub fn times(&self, clock: Clock) -> &[f64] {
        match clock {
            Clock::Device => &self.gpu_ms,
            Clock::Processor => &self.processor_ms,
        }
    }

    /// Time of a picture in ms: the least of the seeds', since other work on the machine only adds to it.
    pub fn time(&self, clock: Clock) -> f64 {
        self.times(clock).iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Time of the passes whose names begin so.
    fn part(&self, prefix: &str) -> f64 {
        self.passes.iter().filter(|p| p.name.starts_with(prefix)).map(|p| p.ms).sum()
    }
}

/// One of the two references.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The picture.
    pub picture: Picture,
    /// Samples of every pixel.
    pub samples: u32,
    /// As [`Effort::Error`].
    pub noise: f64,
}

/// A measured setting.
#[derive(Debug)]
pub struct Row<'s> {
    /// The setting.
    pub setting: &'s Setting,
    /// What was measured.
    pub record: &'s Record,
    /// The picture of the first seed, in the sweep's folder.
    pub picture: PathBuf,
}

/// A sweep, in progress or done.
pub struct Sweep<'a> {
    ctx: &'a Context,
    scene: Scene,
    folder: PathBuf,
    options: Options,
    plan: Vec<Setting>,
    keys: Vec<String>,
    records: Vec<Option<Record>>,
    references: Option<[Reference; 2]>,
}

type Watch<'w> = &'w mut dyn FnMut(Progress) -> ControlFlow<()>;

impl<'a> Sweep<'a> {
    /// Makes the plan and finds out what is already measured. The folder is made if it is not there.
    ///
    /// Errors: the scene's model is not `multiple`, a knob has no effect, the folder cannot be made.
    pub fn open(ctx: &'a Context, scene: Scene, folder: &Path, options: Options) -> Result<Self> {
        let plan = knobs::plan(&scene, &options.knobs);
        Self::of_plan(ctx, scene, folder, plan, options)
    }

    /// The same for a plan of one's own, at least one setting. The first is in the place of the scene's own: its orders are
    /// the references'.
    ///
    /// Errors: the folder cannot be made.
    pub fn of_plan(
        ctx: &'a Context,
        scene: Scene,
        folder: &Path,
        plan: Vec<Setting>,
        options: Options,
    ) -> Result<Self> {
        let settings = folder.join("settings");
        crate::output::make_folder(&settings)?;
        let mut sweep = Self {
            ctx,
            scene,
            folder: folder.to_owned(),
            options,
            plan,
            keys: Vec::new(),
            records: Vec::new(),
            references: None,
        };
        sweep.find_records();
        Ok(sweep)
    }

    fn find_records(&mut self) {
        let base = self.base().clone();
        self.scene.settings = self.reference_settings(0);
        let header = Header::new(&self.scene);
        self.scene.settings = base;
        let version = hex_digest(shaders::ALL.iter().map(|shader| shader.spirv));
        let key = |setting: &Setting| {
            let parts = (
                (env!("CARGO_PKG_VERSION"), &version, DeviceStats::of(self.ctx)),
                (&header.program, &header.scene, self.options.effort),
                (self.options.seeds, &setting.settings),
            );
            let text = serde_json::to_vec(&parts).expect("numbers and strings always serialise");
            hex_digest([&text[..]])[..32].to_owned()
        };
        self.keys = self.plan.iter().map(key).collect();
        self.records = self.keys.iter().map(|key| self.load(key)).collect();
    }

    /// A damaged record is measured again.
    fn load(&self, key: &str) -> Option<Record> {
        let record = std::fs::read(self.file(key, "json")).ok()?;
        self.file(key, "png").exists().then(|| serde_json::from_slice(&record).ok()).flatten()
    }

    fn file(&self, key: &str, extension: &str) -> PathBuf {
        self.folder.join("settings").join(format!("{key}.{extension}"))
    }

    /// The scene's own settings.
    pub fn base(&self) -> &Settings {
        &self.plan[0].settings
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Where it runs.
    pub fn device(&self) -> DeviceStats {
        DeviceStats::of(self.ctx)
    }

    /// What is asked for.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Settings of the plan.
    pub fn planned(&self) -> usize {
        self.plan.len()
    }

    /// Settings that are measured.
    pub fn measured(&self) -> usize {
        self.records.iter().flatten().count()
    }

    /// The measured settings, in the plan's order; the first are the scene's own if those are measured.
    pub fn rows(&self) -> Vec<Row<'_>> {
        let all = self.plan.iter().zip(&self.records).zip(&self.keys);
        all.filter_map(|((setting, record), key)| {
            Some(Row { setting, record: record.as_ref()?, picture: self.file(key, "png") })
        })
        .collect()
    }

    /// Share of the voxels with extinction, once a setting is measured.
    pub fn active_fraction(&self) -> f64 {
        self.records.iter().flatten().next().map_or(0.0, |record| record.active_fraction)
    }

    /// The references, once they are rendered.
    pub fn references(&self) -> &[Reference; 2] {
        self.references.as_ref().expect("render_references comes first")
    }

    fn reference_settings(&self, which: usize) -> Settings {
        let (spp, target_error) = match self.options.effort {
            Effort::Samples(samples) => (samples, None),
            Effort::Error(error) => (MAX_SPP, Some(error)),
        };
        Settings { model: Model::Path, spp, target_error, seed: REFERENCE_SEEDS[which], ..self.base().clone() }
    }

    /// Renders the references, or goes on with saved ones.
    ///
    /// Errors: as [`render::path::render`].
    pub fn render_references(&mut self, progress: Watch<'_>) -> Result<()> {
        let mut render = |which: usize| {
            self.scene.settings = self.reference_settings(which);
            let header = Header::new(&self.scene);
            let key = hex_digest([header.program.as_bytes(), header.scene.as_bytes()]);
            let state = self.folder.join(format!("reference-{}-{}.state", &key[..16], which + 1));
            let mut half = |p: Progress| {
                let done = 0.5 * (which as f64 + p.done);
                progress(Progress { done, phase: "references" })
            };
            let (picture, stats) = render::path::render(self.ctx, &self.scene, Some(&state), &mut half)?;
            let path = stats.path.expect("the path tracer's figures");
            Ok::<_, Error>(Reference { picture, samples: path.samples, noise: path.noise })
        };
        let references = [render(0)?, render(1)?];
        self.references = Some(references);
        self.scene.settings = self.base().clone();
        no_messages(&self.ctx.messages())
    }

    /// The references' mean, and how pictures beside it are exposed.
    pub fn reference_picture(&self) -> (Picture, PngOptions) {
        let [a, b] = self.references();
        let picture = mean(&[a.picture.clone(), b.picture.clone()]);
        let (exposure, tone) = (self.scene.exposure, self.scene.tone);
        let stops = output::stops_of(&picture, &PngOptions { bits: BitDepth::Eight, exposure, tone });
        (picture, PngOptions { bits: BitDepth::Eight, exposure: Exposure::Stops(stops), tone })
    }

    /// Measures the scene's own settings, if they are not measured yet.
    ///
    /// Errors: as [`Sweep::measure_rest`].
    pub fn measure_base(&mut self, progress: Watch<'_>) -> Result<()> {
        if self.records[0].is_none() {
            self.measure(0, &mut |part| progress(Progress { done: part, phase: "the scene's own" }))?;
        }
        Ok(())
    }

    /// Milliseconds that the settings which are not measured yet will take, at most `limit` of them: a rough guess from
    /// the scene's own.
    pub fn expected_ms(&self, limit: usize) -> f64 {
        self.left(limit).iter().map(|&i| self.expected_ms_of(i)).sum()
    }

    fn left(&self, limit: usize) -> Vec<usize> {
        (0..self.plan.len()).filter(|&i| self.records[i].is_none()).take(limit).collect()
    }

    fn expected_ms_of(&self, i: usize) -> f64 {
        let Some(base) = &self.records[0] else { return 0.0 };
        let [voxels, single, camera] =
            [base.part("gather") + base.part("proxy"), base.part("single"), base.part("camera")];
        let others = (base.time(Clock::Device) - voxels - single - camera).max(0.0);
        let parts = [voxels, single, camera, others];
        let seeds = f64::from(self.options.seeds);
        let set_up = (base.wall_ms - base.gpu_ms.iter().sum::<f64>()).max(0.0);
        seeds * knobs::estimate(parts, self.base(), &self.plan[i].settings) + set_up
    }

    /// Measures the settings that are not measured yet, at most `limit` of them.
    ///
    /// Errors: a render fails, the validation layer reports something, or a record cannot be written. What was measured
    /// before is kept.
    pub fn measure_rest(&mut self, limit: usize, progress: Watch<'_>) -> Result<()> {
        let left = self.left(limit);
        let total = self.expected_ms(limit);
        let mut done = 0.0;
        for i in left {
            let own = self.expected_ms_of(i);
            self.measure(i, &mut |part| progress(Progress { done: (done + part * own) / total, phase: "settings" }))?;
            done += own;
        }
        Ok(())
    }

    fn measure(&mut self, i: usize, progress: &mut dyn FnMut(f64) -> ControlFlow<()>) -> Result<()> {
        let start = Instant::now();
        self.scene.settings = self.plan[i].settings.clone();
        let mut renderer = Renderer::new(self.ctx, &self.scene, Internals::default())?;
        let seeds = self.options.seeds;
        let (mut pictures, mut passes) = (Vec::new(), Vec::new());
        let (mut gpu_ms, mut spent, mut active_fraction) = (Vec::new(), Vec::new(), 0.0);
        for s in 0..seeds {
            let seed = self.scene.settings.seed.wrapping_add(s.into());
            let mut part = |p: Progress| progress((f64::from(s) + p.done) / f64::from(seeds));
            let before = processor_ms();
            pictures.push(renderer.render(seed, &mut part)?);
            spent.extend(processor_ms().zip(before).map(|(after, before)| after - before));
            let stats = renderer.stats(&self.scene, 0.0)?;
            gpu_ms.push(stats.gpu_ms);
            active_fraction = stats.volume.active_fraction;
            add_passes(&mut passes, &stats.passes, f64::from(seeds));
        }
        drop(renderer);
        self.scene.settings = self.base().clone();
        // Nothing is kept of a render that the validation layer finds fault with.
        no_messages(&self.ctx.messages())?;
        let [a, b] = self.references();
        let references = [a.picture.clone(), b.picture.clone()];
        let errors = seed_errors(&pictures, &references)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let record = Record { errors, gpu_ms, processor_ms: spent, passes, active_fraction, wall_ms };
        let (_, png) = self.reference_picture();
        output::write_picture(&self.file(&self.keys[i], "png"), &pictures[0], &png)?;
        let text = crate::stats::to_json(&record);
        output::write_atomically(&self.file(&self.keys[i], "json"), text.as_bytes())?;
        self.records[i] = Some(record);
        Ok(())
    }
}

/// Adds a picture's times, as one of `seeds`.
fn add_passes(to: &mut Vec<PassTime>, passes: &[PassStats], seeds: f64) {
    for pass in passes {
        match to.iter_mut().find(|p| p.name == pass.name) {
            Some(known) => known.ms += pass.ms / seeds,
            None => to.push(PassTime { name: pass.name.clone(), ms: pass.ms / seeds }),
        }
    }
}
