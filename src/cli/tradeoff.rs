//! `tyndall tradeoff`: which settings are worth their time?

use std::io::Write as _;
use std::path::PathBuf;

use clap::ValueEnum as _;

use super::render::{progress_bar, show_by_phase};
use super::{DeviceArgs, SceneArgs, interrupt};
use crate::measure::front::Goal;
use crate::measure::knobs::Knob;
use crate::measure::processor_ms;
use crate::measure::report::Report;
use crate::measure::sweep::{Clock, Effort, Options, Sweep};
use crate::output;
use crate::scene::{self, Model};
use crate::stats::{name_of, times};
use crate::vk::Context;
use crate::{Error, Result};

/// Pixels of the pictures unless --size says otherwise: enough to tell settings apart.
const SIZE: [u32; 2] = [128, 128];

/// Measure what the knobs of the model multiple cost and bring: error (bias and noise apart) and GPU time of many
/// settings around the scene's own, against the path tracer. Writes a page (index.html), plots, CSV and JSON.
///
/// Pictures are 128x128 unless --size is given. What is measured is kept in the folder: a sweep that was stopped goes on
/// where it was.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Folder to write to; it is made if it is not there.
    #[arg(short, long, value_name = "DIR", help_heading = "Sweep")]
    output: PathBuf,

    /// Knobs to turn, separated by commas [default: all that the scene uses].
    #[arg(long, value_name = "KNOBS", value_delimiter = ',', help_heading = "Sweep")]
    knobs: Vec<Knob>,

    /// Pictures per setting, with the seed and those that follow it.
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Sweep")]
    #[arg(value_parser = clap::value_parser!(u32).range(2..=1000))]
    seeds: u32,

    /// Samples per pixel of each of the two references.
    #[arg(long, value_name = "N", default_value_t = 1024, help_heading = "Sweep")]
    #[arg(value_parser = clap::value_parser!(u32).range(2..=i64::from(scene::file::MAX_SPP)))]
    reference_spp: u32,

    /// Noise of each reference (root mean square of the pixels' standard errors, over the mean radiance), instead.
    #[arg(long, value_name = "ERROR", conflicts_with = "reference_spp", help_heading = "Sweep")]
    reference_error: Option<f64>,

    /// What counts as time, here and for --seconds.
    #[arg(long, value_name = "CLOCK", default_value = "device", help_heading = "Sweep")]
    clock: Clock,

    /// Measure at most so many more settings beside the scene's own; the next run goes on.
    #[arg(long, value_name = "N", help_heading = "Sweep")]
    limit: Option<usize>,

    /// Print the results as JSON instead of text.
    #[arg(long, help_heading = "Sweep")]
    json: bool,

    /// No progress bar, no announcement; nothing on stdout unless --json is given.
    #[arg(short, long, help_heading = "Sweep")]
    quiet: bool,

    #[command(flatten)]
    device: DeviceArgs,
}

/// Refuses a clock that this system does not have.
pub(super) fn check_clock(clock: Clock) -> Result<()> {
    if clock == Clock::Processor && processor_ms().is_none() {
        let problem = "this system does not tell the processor time";
        return Err(Error::usage("--clock", problem, "leave it out: the device's timestamps count"));
    }
    Ok(())
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    let mut overrides = args.scene.overrides.clone();
    overrides.layer()?;
    // The path tracer's stops are this command's goals.
    let goals = [overrides.target_error.take().map(Goal::Error), overrides.seconds.take().map(Goal::Time)];
    let goals: Vec<Goal> = goals.into_iter().flatten().collect();
    overrides.size.get_or_insert(SIZE);
    output::check_folder(&args.output)?;
    let effort = match args.reference_error {
        Some(error) if error > 0.0 && error.is_finite() => Effort::Error(error),
        Some(error) => {
            return Err(Error::usage("--reference-error", format!("is {error}"), "give an error greater than 0"));
        }
        None => Effort::Samples(args.reference_spp),
    };
    check_clock(args.clock)?;
    let scene = scene::load_scene(args.scene.scene.as_deref(), &overrides)?;
    let model = scene.settings.model;
    if model != Model::Multiple {
        let what = args.scene.scene.as_ref().map_or("--model".into(), |path| path.display().to_string());
        let problem = format!("the model is {}, but the knobs are those of multiple", name_of(&model));
        return Err(Error::input(what, problem, "add --model multiple"));
    }
    if let Some(knob) = args.knobs.iter().find(|k| !k.is_used(&scene)) {
        let problem = format!("{} changes nothing in this scene", knob.flag());
        return Err(Error::usage("--knobs", problem, "leave it out"));
    }
    let knobs = if args.knobs.is_empty() { Knob::value_variants().to_vec() } else { args.knobs.clone() };
    let say = |text: String| {
        if !args.quiet {
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    };
    let ctx = Context::new(&args.device.config())?;
    let options = Options { knobs, seeds: args.seeds, effort };
    let mut sweep = Sweep::open(&ctx, scene, &args.output, options)?;
    let samples = match effort {
        Effort::Samples(samples) => format!("{samples} samples per pixel"),
        Effort::Error(error) => format!("{} % noise", 100.0 * error),
    };
    say(format!(
        "{} settings, {} seeds each, at {} pixels, against two references of {samples}; {} are measured already",
        sweep.planned(),
        args.seeds,
        times(&sweep.base().size),
        sweep.measured()
    ));

    interrupt::listen();
    let bar = progress_bar(args.quiet);
    let mut progress = show_by_phase(&bar);
    sweep.render_references(&mut progress)?;
    sweep.measure_base(&mut progress)?;
    let limit = args.limit.unwrap_or(usize::MAX);
    let expected = sweep.expected_ms(limit);
    if expected > 0.0 {
        bar.suspend(|| say(format!("about {:.0} s of renders to do", expected / 1e3)));
    }
    sweep.measure_rest(limit, &mut progress)?;
    bar.finish_and_clear();

    let report = Report::new(&sweep, &goals, args.clock);
    report.write(&args.output, &sweep.reference_picture())?;
    if args.json {
        return Ok(report.to_json());
    }
    let left = sweep.planned() - sweep.measured();
    let left = if left > 0 { format!("{left} settings are left: run this again to go on\n") } else { String::new() };
    let page = args.output.join("index.html");
    Ok(if args.quiet { String::new() } else { format!("{}\n{left}wrote {}\n", report.text(), page.display()) })
}
