//! `tyndall verify`: does this device compute what it should?

use std::fmt::Write as _;
use std::io::Write as _;

use serde::Serialize;

use super::render::{progress_bar, show};
use super::{DeviceArgs, in_string};
use crate::stats::{DeviceStats, name_of, to_json};
use crate::verify::{self, Check, Group, Report};
use crate::vk::{Context, no_messages};
use crate::{Error, Result};

/// Check this device against closed forms, reference values and the CPU; about a minute on a CPU with two cores. The
/// exit code is 1 if any check fails.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run only this part; may be repeated [default: all].
    #[arg(long, value_name = "GROUP")]
    group: Vec<Group>,

    /// Random seed.
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    seed: u64,

    /// Print JSON. A value that is no number becomes null.
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    device: DeviceArgs,
}

/// Runs the command. The report of a run with failures goes to stdout too, before the error.
pub fn run(args: &Args) -> Result<String> {
    let groups = if args.group.is_empty() { Group::ALL.to_vec() } else { args.group.clone() };
    let ctx = Context::new(&args.device.config())?;
    let bar = progress_bar(false);
    let report = verify::run(&ctx, args.seed, &groups, &mut |progress| {
        let _ = show(&bar, &progress);
    })?;
    bar.finish_and_clear();
    let messages = ctx.close();
    let text = if args.json { to_json(&object(&report)) } else { text(&report) };
    let error = if let Err(error) = no_messages(&messages) {
        error
    } else if report.passes() {
        return Ok(text);
    } else {
        Error::Checks { failed: report.failures(), count: report.checks.len() }
    };
    // A closed stdout (`| head`) must not hide the failure.
    let _ = std::io::stdout().write_all(text.as_bytes());
    Err(error)
}

/// The JSON object.
#[derive(Serialize)]
struct Object<'a> {
    device: &'a DeviceStats,
    seed: u64,
    passed: bool,
    failed: usize,
    seconds: f64,
    checks: Vec<Judged<'a>>,
}

#[derive(Serialize)]
struct Judged<'a> {
    #[serde(flatten)]
    check: &'a Check,
    passed: bool,
}

fn object(report: &Report) -> Object<'_> {
    Object {
        device: &report.device,
        seed: report.seed,
        passed: report.passes(),
        failed: report.failures(),
        seconds: report.seconds,
        checks: report.checks.iter().map(|check| Judged { check, passed: check.passes() }).collect(),
    }
}

fn text(report: &Report) -> String {
    in_string(|out| {
        let mut group = None;
        for c in &report.checks {
            if group != Some(c.group) {
                group = Some(c.group);
                writeln!(out, "{}", name_of(&c.group))?;
            }
            let verdict = if c.passes() { "ok    " } else { "FAILED" };
            writeln!(
                out,
                "  {verdict} {}: {}, expected {} ± {}\n           {}",
                c.case,
                number(c.value),
                number(c.expected),
                number(c.tolerance),
                c.why
            )?;
        }
        let (count, failed) = (report.checks.len(), report.failures());
        let outcome = if report.passes() { "all passed".to_owned() } else { format!("{failed} FAILED") };
        let device = &report.device;
        writeln!(
            out,
            "{count} checks, {outcome}; {:.1} s, seed {}, on {} ({})",
            report.seconds, report.seed, device.name, device.driver
        )
    })
}

/// Whole numbers as they are, others to seven digits.
fn number(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e9 { format!("{value}") } else { format!("{value:.6e}") }
}
