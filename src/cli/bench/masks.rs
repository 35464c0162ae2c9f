//! `tyndall bench masks`.

use super::super::in_string;
use super::{Tables, TablesArgs};
use crate::Result;
use crate::bench::masks::{self, Config, Row, Table};
use crate::scene::Mask;
use crate::stats::times;
use std::fmt::Write as _;

/// Compare masks of the proxy, fixed and adaptive: buckets, time of the build, and errors, on light scattered once.
#[derive(clap::Args, Debug)]
pub struct MasksArgs {
    #[command(flatten)]
    tables: TablesArgs,

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
}

/// Runs `tyndall bench masks`.
pub fn run(args: &MasksArgs) -> Result<String> {
    let config = Config { masks: args.masks.clone(), rays: args.rays, runs: args.runs };
    let rows = |t: &Table| t.rows.iter().map(|r| columns(t, r)).collect();
    args.tables.measure("builds", |ctx, scene, progress| masks::run(ctx, scene, &config, progress), rows, text)
}

fn text(report: &Tables<Table>) -> String {
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
