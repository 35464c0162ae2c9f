//! `tyndall bench proxy`.

use super::super::in_string;
use super::{Tables, TablesArgs};
use crate::Result;
use crate::bench::proxy::{self, Config, Row, Table, TwoLevel};
use crate::stats::times;
use std::fmt::Write as _;

/// Compare structures that rays skip by, and cheap estimates of what rays find, on light scattered once.
#[derive(clap::Args, Debug)]
pub struct ProxyArgs {
    #[command(flatten)]
    tables: TablesArgs,

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
}

/// Runs `tyndall bench proxy`.
pub fn run(args: &ProxyArgs) -> Result<String> {
    let config = Config { rays: args.rays, runs: args.runs };
    let rows = |t: &Table| t.rows.iter().map(|r| columns(t, r)).collect();
    args.tables.measure("rays", |ctx, scene, progress| proxy::run(ctx, scene, config, progress), rows, text)
}

/// Above the columns of [`text`].
const HEAD: &str = "structure                     build ms      MiB   steps  trilin  nearest  Mrays/s   cpu ms   time   \
                    error %    bias %  T error   V1/V   gain    M/N";

fn text(report: &Tables<Table>) -> String {
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
