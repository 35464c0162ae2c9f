//! `tyndall bench masks`.

use super::super::render::{progress_bar, show};
use super::super::{DeviceArgs, SceneArgs, in_string};
use super::phantoms;
use crate::Result;
use crate::bench::masks::{self, Config, Row, Table};
use crate::output;
use crate::render::Progress;
use crate::scene::Mask;
use crate::stats::{DeviceStats, csv_of, times, to_json};
use crate::vk::{Context, no_messages};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Compare masks of the proxy, fixed and adaptive: buckets, time of the build, and errors, on light scattered once.
#[derive(clap::Args, Debug)]
pub struct MasksArgs {
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

    /// Masks, separated by commas: numbers of bits, binary digits, adaptive:TOLERANCE. Times are relative to the first.
    #[arg(
        long,
        value_name = "MASK,...",
        value_delimiter = ',',
        default_value = "4,2,3,5,8,adaptive:0,adaptive:0.05,adaptive:0.1,adaptive:0.2,adaptive:0.3,adaptive:0.5",
        help_heading = "Bench"
    )]
    masks: Vec<Mask>,

    /// Rays that V1/V is measured with.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1 << 16,
        value_parser = clap::value_parser!(u32).range(256..=1 << 23),
        help_heading = "Bench"
    )]
    rays: u32,

    /// Timed builds of every mask, in turns; figures are their medians.
    #[arg(
        long,
        value_name = "R",
        default_value_t = 9,
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

/// Runs `tyndall bench masks`.
pub fn run(args: &MasksArgs) -> Result<String> {
    if let Some(path) = &args.csv {
        output::check_writable(path)?;
    }
    let scenes = match args.all {
        Some(edge) => phantoms(&args.scene, edge)?,
        None => vec![args.scene.load()?],
    };
    let ctx = Context::new(&args.device.config())?;
    let device = DeviceStats::of(&ctx);
    let config = Config { masks: args.masks.clone(), rays: args.rays, runs: args.runs };
    let bar = progress_bar(false);
    let count = scenes.len() as f64;
    let mut tables = Vec::new();
    for (i, scene) in scenes.into_iter().enumerate() {
        tables.push(masks::run(&ctx, scene, &config, &mut |done| {
            let _ = show(&bar, &Progress { done: (i as f64 + done) / count, phase: "builds" });
        })?);
    }
    bar.finish_and_clear();
    no_messages(&ctx.close())?;
    if let Some(path) = &args.csv {
        let rows = tables.iter().flat_map(|t| t.rows.iter().map(move |r| columns(t, r)));
        output::write_atomically(path, csv_of(rows).as_bytes())?;
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

fn text(report: &Report) -> String {
    in_string(|out| {
        for t in &report.tables {
            writeln!(out, "{} {}; {} rays, {} builds of each", t.volume, times(&t.dims), t.rays, t.runs)?;
            writeln!(
                out,
                "mask                 runs  buckets  levels R,G,B,A   bits  build ms   time  error %   bias %   V1/V"
            )?;
            for r in &t.rows {
                write!(
                    out,
                    "{:<16} {:>8} {:>8}  {:<16} {:>4} {:>9.2} {:>6.2} {:>8.2} {:>8.2} {:>6.3}",
                    r.mask,
                    r.runs,
                    r.buckets,
                    r.levels.map(|n| n.to_string()).join(","),
                    r.hash_bits,
                    r.build_ms,
                    r.relative_time,
                    100.0 * r.energy_error,
                    100.0 * r.energy_bias,
                    r.residual_variance,
                )?;
                if r.mask_used != r.mask {
                    write!(out, "  ({}: too many runs)", r.mask_used)?;
                }
                writeln!(out)?;
            }
            writeln!(out)?;
        }
        writeln!(
            out,
            "time of the build over that of the first mask; error and bias of the light that voxels send out; V1/V: variance of\n\
             (traced ray − its estimate) over that of traced rays."
        )?;
        writeln!(out, "on {} ({})", report.device.name, report.device.driver)
    })
}

/// Names and values of the CSV.
fn columns(t: &Table, r: &Row) -> Vec<(&'static str, String)> {
    vec![
        ("volume", t.volume.clone()),
        ("mask", r.mask.clone()),
        ("mask_used", r.mask_used.clone()),
        ("runs", r.runs.to_string()),
        ("buckets", r.buckets.to_string()),
        ("levels_r", r.levels[0].to_string()),
        ("levels_g", r.levels[1].to_string()),
        ("levels_b", r.levels[2].to_string()),
        ("levels_a", r.levels[3].to_string()),
        ("hash_bits", r.hash_bits.to_string()),
        ("build_ms", r.build_ms.to_string()),
        ("relative_time", r.relative_time.to_string()),
        ("energy_error", r.energy_error.to_string()),
        ("energy_bias", r.energy_bias.to_string()),
        ("residual_variance", r.residual_variance.to_string()),
    ]
}
