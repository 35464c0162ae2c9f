//! `tyndall bench scenes`: the paper's second table again. Its four scenes as phantoms, with the ways to choose directions
//! side by side: time and error at the paper's own settings, time at equal noise with each at its best, and error against the
//! number of iterations.

use super::time_at;
use crate::measure::knobs::Setting;
use crate::measure::sweep::{Clock, Effort, Options, Sweep};
use crate::render::Progress;
use crate::scene::{Overrides, Sampling, Scene, Settings, load_scene, load_scene_text};
use crate::vk::Context;
use crate::{Result, stats};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// A scene of the paper (Liu et al. 2015, table 2).
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Case {
    /// Name of the phantom.
    pub name: &'static str,
    /// The paper's volume, in voxels.
    pub dims: [u32; 3],
    /// The paper's share of active voxels, in percent.
    pub paper_active: f64,
    /// The paper's speedups over sampling by the phase function, on a GT 540M and a GTX 550 Ti.
    pub paper_speedups: [f64; 2],
    /// A measured volume of its kind.
    #[serde(skip)]
    pub real: Real,
}

/// A measured volume.
#[derive(Clone, Copy, Debug)]
pub struct Real {
    /// Name of its file.
    pub file: &'static str,
    /// Text of its scene file.
    scene: &'static str,
}

/// The four scenes, from few active voxels to many.
pub const CASES: [Case; 4] = [
    Case { name: "skull", dims: [256, 256, 256], paper_active: 18.0, paper_speedups: [2.99, 2.79], real: SKULL },
    Case { name: "heart", dims: [256, 256, 256], paper_active: 23.0, paper_speedups: [2.80, 2.72], real: HEART },
    Case { name: "tree", dims: [512, 512, 182], paper_active: 32.0, paper_speedups: [2.20, 2.22], real: TREE },
    Case { name: "head", dims: [256, 256, 256], paper_active: 51.0, paper_speedups: [1.96, 2.19], real: HEAD },
];

const SKULL: Real = Real { file: "skull_ct.nrrd", scene: include_str!("../../scenes/skull.toml") };
const HEART: Real = Real { file: "heart_ct.nii.gz", scene: include_str!("../../scenes/heart.toml") };
const TREE: Real = Real { file: "bonsai_ct.nii.gz", scene: include_str!("../../scenes/bonsai.toml") };
const HEAD: Real = Real { file: "head_ct.nrrd", scene: include_str!("../../scenes/head.toml") };

/// Options.
#[derive(Clone, Debug)]
pub struct Config {
    /// Folder of measured volumes to take in place of the phantoms.
    pub real: Option<PathBuf>,
    /// Voxels along the longest axis; 0: as many as the paper's scenes have.
    pub edge: u32,
    /// Pixels.
    pub size: [u32; 2],
    /// N of `phase` whose noise the others have to reach; these have shapes of as many directions.
    pub directions: Vec<u32>,
    /// What is compared with `phase`, in this order.
    pub samplings: Vec<Sampling>,
    /// Pictures per setting.
    pub seeds: u32,
    /// Samples per pixel of each of the two references.
    pub reference_spp: u32,
    /// Which clock counts.
    pub clock: Clock,
    /// Most iterations of the error against iterations; 0: none.
    pub iterations: u32,
}

/// Orders of the paper's pictures: single scattering and three iterations; it says three to five.
const ORDERS: u32 = 4;
/// N, and M of N that are chosen from; or that lie below N traced differences.
const SHAPES: [[u32; 2]; 7] = [[1, 4], [2, 8], [4, 8], [4, 16], [8, 16], [8, 32], [16, 32]];
/// The paper's N of M.
const PAPER: [u32; 2] = [8, 16];

/// What was measured of one setting.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// How directions are chosen.
    pub sampling: Sampling,
    /// N.
    pub directions: u32,
    /// M; 0 where it is not set.
    pub candidates: u32,
    /// K.
    pub orders: u32,
    /// Time of a picture, in ms, proxy builds included: the median of the seeds'.
    pub ms: f64,
    /// Root mean square of the relative error, of the bias and of the noise.
    pub error: f64,
    /// See `error`.
    pub bias: f64,
    /// What the bias is below with 95 % confidence.
    pub bias_bound: f64,
    /// See `error`.
    pub noise: f64,
    /// Mean of the pictures over that of the references, minus 1, for R, G and B.
    pub mean_bias: [f64; 3],
}

/// Time at equal noise.
#[derive(Clone, Debug, Serialize)]
pub struct Equal {
    /// Who is compared with `phase`.
    pub sampling: Sampling,
    /// N of `phase`, and its time over the least time in which the other has as little noise.
    pub speedups: Vec<(u32, f64)>,
}

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// The paper's.
    pub case: Case,
    /// Voxels.
    pub dims: [u32; 3],
    /// Share of cells with extinction.
    pub active_fraction: f64,
    /// Settings, with four orders.
    pub rows: Vec<Row>,
    /// Time at equal noise.
    pub equal: Vec<Equal>,
    /// Error against iterations, with the paper's N of M.
    pub iterations: Vec<Row>,
}

type Watch<'w> = &'w mut dyn FnMut(Progress) -> ControlFlow<()>;

fn scene_of(case: &Case, config: &Config, orders: u32) -> Result<Scene> {
    let overrides = Overrides { size: Some(config.size), ..Overrides::default() };
    let mut scene = match &config.real {
        Some(folder) => {
            let overrides = Overrides { volume: Some(folder.join(case.real.file)), ..overrides };
            load_scene_text(case.real.scene, Path::new(case.name), &overrides)?
        }
        None => {
            let longest = case.dims.iter().copied().max().unwrap_or(1);
            let edge = if config.edge == 0 { longest } else { config.edge };
            let dims = case.dims.map(|d| (u64::from(d) * u64::from(edge)).div_ceil(u64::from(longest)).max(2) as u32);
            let volume = format!("phantom:{}:{}", case.name, stats::times(&dims));
            load_scene(None, &Overrides { volume: Some(volume.into()), ..overrides })?
        }
    };
    scene.settings.orders = orders;
    Ok(scene)
}

fn with(base: &Settings, sampling: Sampling, [directions, candidates]: [u32; 2]) -> Settings {
    Settings { sampling, directions, candidates, ..base.clone() }
}

/// The first is the sweep's base: `phase` with the paper's N.
fn settings(base: &Settings, config: &Config) -> Vec<Settings> {
    let counts = || config.directions.iter().copied();
    let counted = |s: Sampling, n: u32| with(base, s, [n, base.candidates]);
    let mut all = vec![counted(Sampling::Phase, PAPER[0])];
    all.extend(counts().filter(|&n| n != PAPER[0]).map(|n| counted(Sampling::Phase, n)));
    for &sampling in &config.samplings {
        // `auto` finds M by itself: N says how little noise is wanted.
        match sampling {
            Sampling::Auto => all.extend(counts().map(|n| counted(sampling, n))),
            _ => {
                let shapes = SHAPES.into_iter().filter(|&[n, _]| n == PAPER[0] || counts().any(|c| c == n));
                all.extend(shapes.map(|shape| with(base, sampling, shape)));
            }
        }
    }
    all
}

fn iterations(base: &Settings, config: &Config) -> Vec<Settings> {
    let ways = [Sampling::Phase].into_iter().chain(config.samplings.iter().copied());
    // The base has the references' orders: it comes first.
    let orders: Vec<u32> = (1..=config.iterations).rev().collect();
    ways.flat_map(|s| orders.iter().map(move |&orders| Settings { orders, ..with(base, s, PAPER) })).collect()
}

fn rows(sweep: &Sweep<'_>, config: &Config) -> Vec<Row> {
    let row = |r: &crate::measure::sweep::Row<'_>| {
        let (s, e) = (&r.setting.settings, &r.record.errors);
        Row {
            sampling: s.sampling,
            directions: s.directions,
            candidates: if matches!(s.sampling, Sampling::Phase | Sampling::Auto) { 0 } else { s.candidates },
            orders: s.orders,
            ms: stats::median(r.record.times(config.clock)),
            error: e.error(),
            bias: e.bias_rms(),
            bias_bound: e.bias_bound(),
            noise: e.noise_rms(),
            mean_bias: e.bias,
        }
    };
    let mut rows: Vec<Row> = sweep.rows().iter().map(row).collect();
    let place = |s: Sampling| config.samplings.iter().position(|&r| r == s).map_or(0, |i| i + 1);
    rows.sort_by_key(|r| (place(r.sampling), r.orders, r.directions, r.candidates));
    rows
}

fn equal_noise(rows: &[Row], samplings: &[Sampling]) -> Vec<Equal> {
    let of = |sampling: Sampling| rows.iter().filter(move |r| r.sampling == sampling);
    let compare = |&sampling: &Sampling| {
        let all: Vec<[f64; 2]> = of(sampling).map(|r| [r.ms, r.noise]).collect();
        let speedup = |phase: &Row| Some((phase.directions, phase.ms / time_at(&all, phase.noise)?));
        let mut speedups: Vec<_> = of(Sampling::Phase).filter_map(speedup).collect();
        speedups.sort_by_key(|s| s.0);
        Equal { sampling, speedups }
    };
    samplings.iter().map(compare).collect()
}

fn measure<'a>(
    ctx: &'a Context,
    scene: Scene,
    folder: &Path,
    settings: Vec<Settings>,
    config: &Config,
    progress: Watch<'_>,
) -> Result<Sweep<'a>> {
    let options = Options { knobs: vec![], seeds: config.seeds, effort: Effort::Samples(config.reference_spp) };
    let plan = settings.into_iter().map(|settings| Setting { settings, knobs: vec![] }).collect();
    let mut sweep = Sweep::of_plan(ctx, scene, folder, plan, options)?;
    sweep.render_references(progress)?;
    sweep.measure_base(progress)?;
    sweep.measure_rest(usize::MAX, progress)?;
    Ok(sweep)
}

/// Measures one scene, in a folder that keeps what was measured before.
///
/// Errors: a render fails, or the folder cannot be written.
pub fn run(ctx: &Context, case: Case, config: &Config, folder: &Path, progress: Watch<'_>) -> Result<Table> {
    let kind = if config.real.is_some() { "-real" } else { "" };
    let folder = folder.join(format!("{}{kind}", case.name));
    let scene = scene_of(&case, config, ORDERS)?;
    let (dims, all) = (scene.volume.grid.dims, settings(&scene.settings, config));
    let sweep = measure(ctx, scene, &folder, all, config, progress)?;
    let rows = rows(&sweep, config);
    let active_fraction = sweep.active_fraction();
    let mut table =
        Table { case, dims, active_fraction, equal: equal_noise(&rows, &config.samplings), rows, iterations: vec![] };
    if config.iterations > 0 {
        let scene = scene_of(&case, config, config.iterations)?;
        let all = iterations(&scene.settings, config);
        let sweep = measure(ctx, scene, &folder, all, config, progress)?;
        table.iterations = self::rows(&sweep, config);
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(sampling: Sampling, directions: u32, ms: f64, noise: f64) -> Row {
        Row {
            sampling,
            directions,
            candidates: 0,
            orders: 4,
            ms,
            error: noise,
            bias: 0.0,
            bias_bound: 0.0,
            noise,
            mean_bias: [0.0; 3],
        }
    }

    #[test]
    fn speedups_are_of_equal_noise() {
        let rows = [
            row(Sampling::Phase, 16, 100.0, 0.1),
            row(Sampling::Phase, 4, 25.0, 0.2),
            row(Sampling::Resample, 4, 50.0, 0.1),
            row(Sampling::Resample, 1, 12.5, 0.2),
        ];
        let equal = equal_noise(&rows, &[Sampling::Resample]);
        let resample = equal.iter().find(|e| e.sampling == Sampling::Resample).unwrap();
        assert_eq!(resample.speedups.iter().map(|s| s.0).collect::<Vec<_>>(), [4, 16]);
        assert!(resample.speedups.iter().all(|s| (s.1 - 2.0).abs() < 1e-9), "{resample:?}");
    }

    #[test]
    fn phantoms_keep_the_shape_of_the_paper_s_volumes() {
        let config = Config {
            real: None,
            edge: 32,
            size: [8, 8],
            directions: vec![1, 16],
            samplings: vec![Sampling::Residual, Sampling::Auto],
            seeds: 2,
            reference_spp: 1,
            clock: Clock::Device,
            iterations: 0,
        };
        for case in CASES {
            let scene = scene_of(&case, &config, 4).unwrap();
            let expected = if case.name == "tree" { [32, 32, 12] } else { [32; 3] };
            assert_eq!(scene.volume.grid.dims, expected);
            let all = settings(&scene.settings, &config);
            let shapes: Vec<_> = all.iter().map(|s| (s.sampling, s.directions)).collect();
            let of = |sampling, counts: &[u32]| counts.iter().map(|&n| (sampling, n)).collect::<Vec<_>>();
            let expected = [
                of(Sampling::Phase, &[PAPER[0], 1, 16]),
                of(Sampling::Residual, &[1, 8, 8, 16]),
                of(Sampling::Auto, &[1, 16]),
            ];
            assert_eq!(shapes, expected.concat());
            assert!(all.iter().enumerate().all(|(i, s)| !all[..i].contains(s)), "nothing twice");
        }
    }
}
