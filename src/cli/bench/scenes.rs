//! `tyndall bench scenes`.

use super::super::render::{progress_bar, show_by_phase};
use super::super::tradeoff::check_clock;
use super::super::{DeviceArgs, in_string};
use crate::bench::scenes::{self, CASES, Case, Config, Row, Table};
use crate::measure::sweep::Clock;
use crate::output;
use crate::scene::Sampling;
use crate::scene::file::MAX_SPP;
use crate::stats::{DeviceStats, name_of, times, to_json};
use crate::vk::{Context, no_messages};
use crate::{Error, Result};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The paper's table 2 again, on phantoms of its four scenes: time and error of the ways to choose directions, time at equal
/// noise, and error against iterations.
///
/// What is measured is kept in the folder: a run that was stopped goes on where it was.
#[derive(clap::Args, Debug)]
pub struct ScenesArgs {
    /// Folder to keep results in; it is made if it is not there.
    #[arg(short, long, value_name = "DIR", help_heading = "Bench")]
    output: PathBuf,

    /// Scenes, separated by commas.
    #[arg(
        long,
        value_name = "NAME,...",
        value_delimiter = ',',
        default_value = "skull,heart,tree,head",
        value_parser = ["skull", "heart", "tree", "head"],
        help_heading = "Bench"
    )]
    scenes: Vec<String>,

    /// Folder with skull_ct.nrrd, heart_ct.nii.gz, bonsai_ct.nii.gz or head_ct.nrrd: those that are there take the place of the
    /// phantoms, and scenes whose file is missing are left out.
    #[arg(long, value_name = "DIR", help_heading = "Bench")]
    real: Option<PathBuf>,

    /// Voxels along the longest axis of a phantom; 0: as many as the paper's volumes have.
    #[arg(
        long,
        value_name = "VOXELS",
        default_value_t = 64,
        value_parser = clap::value_parser!(u32).range(0..=512),
        help_heading = "Bench"
    )]
    edge: u32,

    /// Pixels along both axes.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 128,
        value_parser = clap::value_parser!(u32).range(8..=4096),
        help_heading = "Bench"
    )]
    pixels: u32,

    /// N of `phase` whose noise the others have to reach, separated by commas.
    #[arg(
        long,
        value_name = "N,...",
        value_delimiter = ',',
        default_value = "1,2,4,8,16",
        value_parser = clap::value_parser!(u32).range(1..=16),
        help_heading = "Bench"
    )]
    directions: Vec<u32>,

    /// What is compared with `phase`, separated by commas.
    #[arg(
        long,
        value_name = "MODE,...",
        value_delimiter = ',',
        default_value = "top,resample,residual,auto",
        help_heading = "Bench"
    )]
    sampling: Vec<Sampling>,

    /// Pictures per setting.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 2,
        value_parser = clap::value_parser!(u32).range(2..=1000),
        help_heading = "Bench"
    )]
    seeds: u32,

    /// Samples per pixel of each of the two references.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1024,
        value_parser = clap::value_parser!(u32).range(2..=i64::from(MAX_SPP)),
        help_heading = "Bench"
    )]
    reference_spp: u32,

    /// Most iterations of the error against iterations; 0: none.
    #[arg(
        long,
        value_name = "K",
        default_value_t = 8,
        value_parser = clap::value_parser!(u32).range(0..=64),
        help_heading = "Bench"
    )]
    iterations: u32,

    /// What counts as time.
    #[arg(long, value_name = "CLOCK", default_value = "device", help_heading = "Bench")]
    clock: Clock,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,

    #[command(flatten)]
    device: DeviceArgs,
}

/// The JSON object.
#[derive(Serialize)]
struct Report {
    device: DeviceStats,
    pixels: u32,
    clock: Clock,
    tables: Vec<Table>,
}

/// Runs `tyndall bench scenes`.
pub fn run(args: &ScenesArgs) -> Result<String> {
    output::check_folder(&args.output)?;
    check_clock(args.clock)?;
    let ctx = Context::new(&args.device.config())?;
    let device = DeviceStats::of(&ctx);
    let config = Config {
        real: args.real.clone(),
        edge: args.edge,
        size: [args.pixels; 2],
        directions: once(&args.directions),
        samplings: once(&args.sampling).into_iter().filter(|&s| s != Sampling::Phase).collect(),
        seeds: args.seeds,
        reference_spp: args.reference_spp,
        clock: args.clock,
        iterations: args.iterations,
    };
    let bar = progress_bar(false);
    let is_there = |c: &Case| args.real.as_ref().is_none_or(|folder| folder.join(c.real.file).exists());
    let named = CASES.into_iter().filter(|c| args.scenes.iter().any(|name| name == c.name));
    let (chosen, missing): (Vec<Case>, Vec<Case>) = named.partition(is_there);
    for case in &missing {
        eprintln!("left out: {} has no {}", args.real.as_deref().unwrap_or(Path::new("")).display(), case.real.file);
    }
    if chosen.is_empty() {
        return Err(Error::input("--real", "none of the scenes' volumes is there", "name the folder that they are in"));
    }
    let mut tables = Vec::new();
    for case in chosen {
        tables.push(scenes::run(&ctx, case, &config, &args.output, &mut show_by_phase(&bar))?);
    }
    bar.finish_and_clear();
    no_messages(&ctx.close())?;
    let report = Report { device, pixels: args.pixels, clock: args.clock, tables };
    Ok(if args.json { to_json(&report) } else { text(&report) })
}

/// Without what was named before.
fn once<T: Copy + PartialEq>(named: &[T]) -> Vec<T> {
    let is_first = |&(i, value): &(usize, &T)| !named[..i].contains(value);
    named.iter().enumerate().filter(is_first).map(|(_, &value)| value).collect()
}

fn text(report: &Report) -> String {
    in_string(|out| {
        for t in &report.tables {
            let (active, paper) = (100.0 * t.active_fraction, t.case.paper_active);
            writeln!(
                out,
                "{} {}, {active:.0} % of the voxels active (the paper's: {paper:.0} %), {2}x{2} pixels",
                t.case.name,
                times(&t.dims),
                report.pixels
            )?;
            writeln!(out, "{HEAD}")?;
            for row in &t.rows {
                writeln!(out, "{}", line(row))?;
            }
            let [a, b] = t.case.paper_speedups;
            writeln!(out, "time of `phase` over that at equal noise (the paper, without an error: {a} and {b}):")?;
            for equal in &t.equal {
                let speedups: Vec<String> = equal.speedups.iter().map(|(n, x)| format!("N {n}: {x:.2}")).collect();
                writeln!(out, "  {:<10} {}", name_of(&equal.sampling), speedups.join("   "))?;
            }
            if !t.iterations.is_empty() {
                let most = t.iterations.iter().map(|r| r.orders).max().unwrap_or(0);
                writeln!(out, "against {most} orders:\n{HEAD}")?;
                for row in &t.iterations {
                    writeln!(out, "{}", line(row))?;
                }
            }
            writeln!(out)?;
        }
        writeln!(
            out,
            "ms: {}, the median of the seeds'. error, bias and noise: roots of relMSE and its parts, in %, against two\n\
             pictures of `path`; < is a bound.",
            report.clock.name()
        )?;
        writeln!(out, "on {} ({})", report.device.name, report.device.driver)
    })
}

/// Above the columns of [`line`].
const HEAD: &str = "sampling      N    M  orders         ms    error     bias    noise   mean bias R, G, B";

fn line(row: &Row) -> String {
    let seen = row.bias_bound < 2.0 * row.bias;
    let bias = if seen { format!("{:.2}", 100.0 * row.bias) } else { format!("<{:.2}", 100.0 * row.bias_bound) };
    let mean: Vec<String> = row.mean_bias.iter().map(|b| format!("{:+.2}", 100.0 * b)).collect();
    format!(
        "{:<10} {:>4} {:>4} {:>7} {:>10.1} {:>8.2} {:>8} {:>8.2}   {}",
        name_of(&row.sampling),
        row.directions,
        if row.candidates == 0 { "-".to_owned() } else { row.candidates.to_string() },
        row.orders,
        row.ms,
        100.0 * row.error,
        bias,
        100.0 * row.noise,
        mean.join(", ")
    )
}
