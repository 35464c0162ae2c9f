//! `tyndall check`: every pass under validation.

use std::path::PathBuf;

use super::interrupt;
use super::render::{progress_bar, show};
use crate::check::{self, Options, allow};
use crate::stats::name_of;
use crate::vk::{Injection, Validation};
use crate::{Error, Result, output};

/// Render small scenes that use every pass and every specialization, under the Vulkan validation layer.
///
/// Any message, leak or hazard fails the case that caused it, and makes the exit code 1. Each kind of validation gets a run of
/// its own. No picture is written.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Kinds of validation, separated by commas: core (with synchronization validation), best-practices, gpu-assisted (slow on
    /// CPUs: up to a minute per kernel)
    #[arg(long, value_name = "KINDS", value_delimiter = ',', default_value = "core,best-practices")]
    kinds: Vec<Validation>,

    /// Only cases whose names contain this; may be repeated.
    #[arg(long, value_name = "PART")]
    only: Vec<String>,

    /// List the cases.
    #[arg(long)]
    list: bool,

    /// Let the messages of this list through: TOML, [[allow]] with id, layer (its version), reason, and text
    #[arg(long, value_name = "FILE")]
    allow: Option<PathBuf>,

    /// Put a fault into what is recorded, under the validation that must notice it: exit code 0 if it does
    #[arg(long, value_name = "FAULT", conflicts_with_all = ["kinds", "only", "list", "junit", "allow"])]
    inject: Option<Injection>,

    /// Write JUnit's XML, which CI systems read.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    junit: Option<PathBuf>,

    /// Write the report as JSON to a file.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    stats: Option<PathBuf>,

    /// Print the report as JSON instead of text.
    #[arg(long, help_heading = "Output")]
    json: bool,

    /// No progress bar, nothing on stdout.
    #[arg(short, long, conflicts_with = "json", help_heading = "Output")]
    quiet: bool,

    /// Vulkan device: its index in `tyndall devices`, or part of its name [default: the first real GPU, else the CPU].
    #[arg(long, value_name = "DEVICE", help_heading = "Device")]
    device: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    for path in [&args.junit, &args.stats].into_iter().flatten() {
        output::check_writable(path)?;
    }
    if let Some(kind) = args.inject {
        return inject(args, kind);
    }
    if args.kinds.contains(&Validation::Off) {
        return Err(Error::usage("--kinds", "'off' checks nothing", "give core, best-practices or gpu-assisted"));
    }
    let allowed = args.allow.as_deref().map_or(Ok(Vec::new()), allow::load)?;
    let (device, kinds, only) = (args.device.clone(), args.kinds.clone(), args.only.clone());
    let options = Options { device, kinds, only, allowed, injection: None };
    let cases = options.cases();
    if cases.is_empty() {
        let problem = format!("no case has '{}' in its name", args.only.join("' or '"));
        return Err(Error::usage("--only", problem, "see --list"));
    }
    if args.list {
        return Ok(cases.iter().map(|case| format!("{}\n", case.name)).collect());
    }
    interrupt::listen();
    let bar = progress_bar(args.quiet);
    let report = check::run(&options, &mut |p| show(&bar, &p))?;
    bar.finish_and_clear();

    if let Some(path) = &args.junit {
        report.write_junit(path)?;
    }
    if let Some(path) = &args.stats {
        output::write_atomically(path, report.to_json().as_bytes())?;
    }
    let (failed, count) = report.failures();
    let text = if args.json { report.to_json() } else { report.text() };
    if failed > 0 {
        if !args.quiet {
            print!("{text}");
        }
        return Err(Error::Cases { failed, count });
    }
    Ok(if args.quiet { String::new() } else { text })
}

fn inject(args: &Args, kind: Injection) -> Result<String> {
    let injected = check::inject(args.device.clone(), kind)?;
    if let Some(path) = &args.stats {
        output::write_atomically(path, crate::stats::to_json(&injected).as_bytes())?;
    }
    if injected.noticed_by.is_empty() {
        let said: Vec<_> = injected.messages.iter().map(|m| m.id.as_str()).collect();
        let said =
            if said.is_empty() { "nothing was said".into() } else { format!("said was only {}", said.join(", ")) };
        let said = injected.error.map_or(said.clone(), |error| format!("{said}; the render failed with: {error}"));
        let cure = "see that the validation layer is a recent one; if it is, report this";
        return Err(Error::input(
            format!("--inject {}", name_of(&kind)),
            format!("the fault was not noticed: {said}"),
            cure,
        ));
    }
    if args.json {
        return Ok(crate::stats::to_json(&injected));
    }
    let text = format!("{} was noticed: {}\n", name_of(&kind), injected.noticed_by.join(", "));
    Ok(if args.quiet { String::new() } else { text })
}
