//! `tyndall bench gather`.

use super::super::in_string;
use super::{Tables, TablesArgs};
use crate::Result;
use crate::bench::gather::{self, Config, MOST, Row, Table};
use crate::scene::Sampling;
use crate::stats::{name_of, times};
use std::fmt::Write as _;

/// Compare ways to choose directions in one gather of light scattered once: time of its parts, noise, bias, and time at equal noise.
#[derive(clap::Args, Debug)]
pub struct GatherArgs {
    #[command(flatten)]
    tables: TablesArgs,

    /// N of every way, separated by commas; `phase` gets twice and four times the most, too.
    #[arg(
        long = "counts",
        value_name = "N,...",
        value_delimiter = ',',
        default_value = "1,4,8,16,48",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST)),
        help_heading = "Bench"
    )]
    counts: Vec<u32>,

    /// M/N of the ways that have candidates, separated by commas; what is beyond 1024 candidates is left out.
    #[arg(
        long,
        value_name = "RATIO,...",
        value_delimiter = ',',
        default_value = "2,4",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST)),
        help_heading = "Bench"
    )]
    ratios: Vec<u32>,

    /// What is compared with `phase`, separated by commas.
    #[arg(
        long,
        value_name = "MODE,...",
        value_delimiter = ',',
        default_value = "top,resample,residual",
        value_parser = ["phase", "top", "resample", "residual"],
        help_heading = "Bench"
    )]
    ways: Vec<String>,

    /// Gathers of every way, in turns, each with another seed: times are their medians.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 5,
        value_parser = clap::value_parser!(u32).range(2..=1000),
        help_heading = "Bench"
    )]
    seeds: u32,

    /// Pixels along both axes of the pictures whose noise is measured.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 128,
        value_parser = clap::value_parser!(u32).range(8..=4096),
        help_heading = "Bench"
    )]
    pixels: u32,
}

/// Runs `tyndall bench gather`.
pub fn run(args: &GatherArgs) -> Result<String> {
    let sampling =
        |name: &String| <Sampling as clap::ValueEnum>::from_str(name, false).expect("names that clap checked");
    let config = Config {
        directions: args.counts.clone(),
        ratios: args.ratios.clone(),
        samplings: args.ways.iter().map(sampling).collect(),
        seeds: args.seeds,
        pixels: args.pixels,
    };
    let rows = |t: &Table| t.rows.iter().map(|r| columns(t, r)).collect();
    args.tables.measure("gathers", |ctx, scene, progress| gather::run(ctx, scene, &config, progress), rows, text)
}

fn text(report: &Tables<Table>) -> String {
    in_string(|out| {
        for t in &report.tables {
            writeln!(out, "{} {}; {} cells, {} seeds", t.volume, times(&t.dims), t.cells, t.seeds)?;
            writeln!(
                out,
                "ray in the data: {:.1} samples, in the proxy: {:.1} reads; plain march: {:.0} M samples/s; solution: {:.2} ms",
                t.traced_samples,
                t.proxy_reads,
                t.plain_samples_per_second * 1e-6,
                t.solve_ms
            )?;
            writeln!(
                out,
                "sampling       N     M  build ms  proxy ms  trace ms        ms   rate  noise %  bias %  mean bias %   gain"
            )?;
            for r in &t.rows {
                writeln!(
                    out,
                    "{:<11} {:>4} {:>5} {:>9.2} {:>9.2} {:>9.2} {:>9.2} {:>6.2} {:>8.2} {:>7.2} {:>+12.2} {:>6.2}",
                    name_of(&r.sampling),
                    r.directions,
                    r.candidates,
                    r.build_ms,
                    r.proxy_ms,
                    r.trace_ms,
                    r.ms,
                    r.sampling_rate,
                    100.0 * r.noise,
                    100.0 * r.bias,
                    100.0 * r.mean_bias,
                    r.gain,
                )?;
            }
            writeln!(out)?;
        }
        writeln!(
            out,
            "ms: all three parts (CPU time on a CPU); rate: samples per second over those of a plain march; noise and bias of\n\
             pictures, against `phase` with most directions; gain: time of `phase` at equal noise over ms."
        )?;
        writeln!(out, "on {} ({})", report.device.name, report.device.driver)
    })
}

/// Names and values of the CSV.
fn columns(t: &Table, r: &Row) -> Vec<(&'static str, String)> {
    vec![
        ("volume", t.volume.clone()),
        ("sampling", name_of(&r.sampling)),
        ("directions", r.directions.to_string()),
        ("candidates", r.candidates.to_string()),
        ("build_ms", r.build_ms.to_string()),
        ("proxy_ms", r.proxy_ms.to_string()),
        ("trace_ms", r.trace_ms.to_string()),
        ("ms", r.ms.to_string()),
        ("sampling_rate", r.sampling_rate.to_string()),
        ("noise", r.noise.to_string()),
        ("bias", r.bias.to_string()),
        ("mean_bias", r.mean_bias.to_string()),
        ("gain", r.gain.to_string()),
    ]
}
