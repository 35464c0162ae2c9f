//! `tyndall bench`: what this device is fast at.

mod masks;
mod primitives;
mod scenes;

use super::render::{progress_bar, show};
use super::{DeviceArgs, SceneArgs, in_string};
use crate::Result;
use crate::bench::proxy::{self, Row, Table, TwoLevel};
use crate::output;
use crate::render::Progress;
use crate::scene::{self, Scene};
use crate::stats::{DeviceStats, csv_of, times, to_json};
use crate::vk::{Context, no_messages};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Measure what this device is fast at, by GPU timestamps.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(clap::Subcommand, Debug)]
enum Subject {
    Proxy(Box<ProxyArgs>),
    Masks(Box<masks::MasksArgs>),
    Scan(primitives::ScanArgs),
    Sort(primitives::SortArgs),
    Scenes(scenes::ScenesArgs),
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    match &args.subject {
        Subject::Proxy(args) => run_proxy(args),
        Subject::Masks(args) => masks::run(args),
        Subject::Scan(args) => primitives::run_scan(args),
        Subject::Sort(args) => primitives::run_sort(args),
        Subject::Scenes(args) => scenes::run(args),
    }
}

/// Compare structures that rays skip by, and cheap estimates of what rays find, on light scattered once.
#[derive(clap::Args, Debug)]
pub struct ProxyArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// The phantoms skull, head, heart, tree and cloud, of VOXELS along each axis.
    #[arg(
        long,
        value_name = "VOXELS",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "64",
        conflicts_with_all = ["scene", "volume"],
        value_parser = clap::value_parser!(u32).range(8..=512),
        help_heading = "Bench"
    )]
    all: Option<u32>,

    /// Rays of a run.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1 << 18,
        value_parser = clap::value_parser!(u32).range(256..=1 << 23),
        help_heading = "Bench"
    )]
    rays: u32,

    /// Timed runs of every structure, in turns; figures are their medians.
    #[arg(
        long,
        value_name = "R",
        default_value_t = 5,
        value_parser = clap::value_parser!(u32).range(1..=1000),
        help_heading = "Bench"
    )]
    runs: u32,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,

    /// Write the table as CSV, too.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    csv: Option<PathBuf>,

    #[command(flatten)]
    device: DeviceArgs,
}

/// Phantoms of `--all`.
const PHANTOMS: [&str; 5] = ["skull", "head", "heart", "tree", "cloud"];

/// Scenes of the phantoms, of `edge` voxels along each axis.
fn phantoms(args: &SceneArgs, edge: u32) -> Result<Vec<Scene>> {
    let of = |name: &&str| {
        let mut overrides = args.overrides.clone();
        overrides.volume = Some(format!("phantom:{name}:{edge}x{edge}x{edge}").into());
        scene::load_scene(None, &overrides)
    };
    PHANTOMS.iter().map(of).collect()
}

fn run_proxy(args: &ProxyArgs) -> Result<String> {
    if let Some(path) = &args.csv {
        output::check_writable(path)?;
    }
    let scenes = match args.all {
        Some(edge) => phantoms(&args.scene, edge)?,
        None => vec![args.scene.load()?],
    };
    let ctx = Context::new(&args.device.config())?;
    let device = DeviceStats::of(&ctx);
    let config = proxy::Config { rays: args.rays, runs: args.runs };
    let bar = progress_bar(false);
    let count = scenes.len() as f64;
    let mut tables = Vec::new();
    for (i, scene) in scenes.into_iter().enumerate() {
        tables.push(proxy::run(&ctx, scene, config, &mut |done| {
            let _ = show(&bar, &Progress { done: (i as f64 + done) / count, phase: "rays" });
        })?);
    }
    bar.finish_and_clear();
    no_messages(&ctx.close())?;
    if let Some(path) = &args.csv {
        output::write_atomically(path, csv(&tables).as_bytes())?;
    }
    let report = Report { device, tables };
    Ok(if args.json { to_json(&report) } else { text(&report) })
}

/// The JSON object.
#[derive(Serialize)]
struct Report {
    device: DeviceStats,
    tables: Vec<Table>,
}

/// Above the columns of [`text`].
const HEAD: &str = "structure                     build ms      MiB   steps  trilin  nearest  Mrays/s   cpu ms   time   \
                    error %    bias %  T error   V1/V   gain    M/N";

fn text(report: &Report) -> String {
    in_string(|out| {
        for t in &report.tables {
            let share = 100.0 * t.active_fraction;
            writeln!(
                out,
                "{} {}, {share:.1} % of the cells active; {} rays from {} cells, {} runs",
                t.volume,
                times(&t.dims),
                t.rays,
                t.cells,
                t.runs
            )?;
            writeln!(out, "{HEAD}")?;
            for row in &t.rows {
                writeln!(out, "{}", line(row))?;
            }
            writeln!(out, "fastest exact structure: {}\n", t.rows[t.best_exact].structure)?;
        }
        writeln!(
            out,
            "steps, trilinear samples and nearest reads per ray; time over that of the fastest exact structure; error, bias\n\
             and T error (transmittance) against quarter steps; V1/V, gain and M/N of a two-level estimator."
        )?;
        writeln!(out, "on {} ({})", report.device.name, report.device.driver)
    })
}

fn line(row: &Row) -> String {
    let two_level = row.two_level.map_or_else(String::new, |t| {
        format!(" {:>6.3} {:>6.2} {:>6.1}", t.residual_variance, t.gain, t.estimates_per_ray)
    });
    format!(
        "{:<28} {:>9.2} {:>8.2} {:>7.1} {:>7.1} {:>8.1} {:>8.3} {:>8.1} {:>6.2} {:>9.3} {:>9.3} {:>8.4}{two_level}",
        row.structure,
        row.build_ms,
        row.bytes as f64 / f64::from(1 << 20),
        row.steps,
        row.trilinear,
        row.nearest,
        row.rays_per_second * 1e-6,
        row.cpu_ms.unwrap_or(0.0),
        row.relative_time,
        100.0 * row.error,
        100.0 * row.bias,
        row.transmittance_error,
    )
}

fn csv(tables: &[Table]) -> String {
    csv_of(tables.iter().flat_map(|t| t.rows.iter().map(move |r| columns(t, r))))
}

/// Names and values of the CSV.
fn columns(t: &Table, r: &Row) -> Vec<(&'static str, String)> {
    let of = |value: fn(&TwoLevel) -> f64| r.two_level.as_ref().map_or_else(String::new, |t| value(t).to_string());
    vec![
        ("volume", t.volume.clone()),
        ("structure", r.structure.clone()),
        ("exact", r.is_exact.to_string()),
        ("build_ms", r.build_ms.to_string()),
        ("bytes", r.bytes.to_string()),
        ("steps", r.steps.to_string()),
        ("trilinear", r.trilinear.to_string()),
        ("nearest", r.nearest.to_string()),
        ("ms", r.ms.to_string()),
        ("rays_per_second", r.rays_per_second.to_string()),
        ("relative_time", r.relative_time.to_string()),
        ("error", r.error.to_string()),
        ("bias", r.bias.to_string()),
        ("transmittance_error", r.transmittance_error.to_string()),
        ("estimate_variance", of(|t| t.estimate_variance)),
        ("residual_variance", of(|t| t.residual_variance)),
        ("gain", of(|t| t.gain)),
        ("estimates_per_ray", of(|t| t.estimates_per_ray)),
    ]
}
