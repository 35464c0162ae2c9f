//! `tyndall render`: one picture.

use std::ops::ControlFlow;
use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};

use super::{DeviceArgs, ReportArgs, SceneArgs, interrupt};
use crate::output::{self, BitDepth, PngOptions};
use crate::render::{self, Progress};
use crate::scene::{Model, Sampling, Scene, UNLIMITED};
use crate::stats::{Stats, name_of, times};
use crate::vk::{Context, no_messages};
use crate::{Error, Result};

/// Render one picture. Without arguments: the embedded phantom, to tyndall.png.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Picture to write: .png (exposed, tone-mapped, sRGB) or .exr (32-bit float, linear radiance).
    #[arg(short, long, value_name = "FILE", default_value = "tyndall.png", help_heading = "Output")]
    output: PathBuf,

    /// Bits per channel of a PNG.
    #[arg(long, value_name = "BITS", default_value = "8", help_heading = "Output")]
    bits: BitDepth,

    /// Path: save the render here as it goes on; if the file exists, go on with it.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    state: Option<PathBuf>,

    #[command(flatten)]
    report: ReportArgs,

    #[command(flatten)]
    device: DeviceArgs,
}

/// Runs the command. Everything that can be refused is refused before the device starts to work.
pub fn run(args: &Args) -> Result<String> {
    output::check_picture_path(&args.output)?;
    if let Some(path) = &args.report.stats {
        output::check_writable(path)?;
    }
    let scene = args.scene.load()?;
    if let Some(path) = &args.state {
        output::check_writable(path)?;
        if scene.settings.model != Model::Path {
            return Err(Error::usage("--state", "only the model path can be saved and resumed", "add --model path"));
        }
    }
    let ctx = Context::new(&args.device.config())?;

    interrupt::listen();
    let bar = progress_bar(args.report.quiet);
    let mut progress = |progress: Progress| show(&bar, &progress);
    let (picture, stats) = match &args.state {
        Some(path) => render::path::render(&ctx, &scene, Some(path), &mut progress)?,
        None => render::render(&ctx, &scene, &mut progress)?,
    };
    bar.finish_and_clear();

    // The figures count the messages, so they are written even when validation fails; the picture is not.
    if let Some(path) = &args.report.stats {
        stats.write(path)?;
    }
    no_messages(&ctx.close())?;
    let png = PngOptions { bits: args.bits, exposure: scene.exposure, tone: scene.tone };
    let stops = output::write_picture(&args.output, &picture, &png)?;

    if args.report.json {
        return Ok(stats.to_json());
    }
    Ok(if args.report.quiet { String::new() } else { report(args, &scene, &stats, stops) })
}

/// Steps of the progress bar.
const BAR_STEPS: u64 = 1000;

/// A bar on stderr; hidden where stderr is not a terminal.
pub(super) fn progress_bar(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{msg:19} [{bar:40}] {percent:>3} %  {eta} left")
        .expect("the template is a constant and valid")
        .progress_chars("=> ");
    ProgressBar::new(BAR_STEPS).with_style(style)
}

/// Moves the bar; breaks off when the user asks for it.
pub(super) fn show(bar: &ProgressBar, progress: &Progress) -> ControlFlow<()> {
    bar.set_message(progress.phase);
    bar.set_position((progress.done * BAR_STEPS as f64) as u64);
    if interrupt::is_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Moves the bar, and starts it again with every phase: what is left is guessed anew from the pace of that.
pub(super) fn show_by_phase(bar: &ProgressBar) -> impl FnMut(Progress) -> ControlFlow<()> {
    let mut phase = "";
    move |progress| {
        if phase != progress.phase {
            bar.reset();
            phase = progress.phase;
        }
        show(bar, &progress)
    }
}

fn report(args: &Args, scene: &Scene, stats: &Stats, stops: Option<f32>) -> String {
    let exposure = stops.map_or_else(String::new, |s| format!(", exposure {s:+.2} stops"));
    let output = args.output.display();
    format!("{}\n{}wrote {output}{exposure}\n", settings_line(scene, stats), stats.table())
}

/// What was rendered, with what, on what.
fn settings_line(scene: &Scene, stats: &Stats) -> String {
    let s = &scene.settings;
    let method = match s.model {
        Model::Multiple => {
            let pool = match s.sampling {
                Sampling::Phase | Sampling::Auto => String::new(),
                Sampling::Top | Sampling::Resample => format!(" of {}", s.candidates),
                Sampling::Residual => format!(" + {} proxy", s.candidates),
            };
            let orders = s.orders;
            format!("multiple, orders {orders}, {} {}{pool} directions", name_of(&s.sampling), s.directions)
        }
        Model::Path if s.orders == UNLIMITED => "path, unlimited orders".to_owned(),
        Model::Path => format!("path, orders {}", s.orders),
        model => name_of(&model),
    };
    let samples = stats.path.as_ref().map_or(s.spp, |path| path.samples);
    format!(
        "{} {}, {:.1} % active; {method}; {}, {} spp, seed {}; on {}",
        scene.volume.name,
        times(&scene.volume.grid.dims),
        100.0 * stats.volume.active_fraction,
        times(&s.size),
        samples,
        s.seed,
        stats.device.name
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_moves_the_bar() {
        let bar = progress_bar(false);
        assert!(show(&bar, &Progress { done: 0.25, phase: "gather" }).is_continue());
        assert_eq!((bar.position(), bar.message().as_str()), (BAR_STEPS / 4, "gather"));
    }
}
