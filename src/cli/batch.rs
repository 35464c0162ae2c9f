//! `tyndall batch`: the frames of a turntable, with one set-up.

use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

use super::render::{progress_bar, show};
use super::{DeviceArgs, ReportArgs, SceneArgs};
use crate::output::{self, BitDepth, Format, Picture, PngOptions};
use crate::render::{self, Internals, Progress, Renderer};
use crate::scene::{Exposure, Model, Scene};
use crate::stats::{BatchStats, FrameStats, Outcome, PassStats, Stats, VolumeStats, add_passes};
use crate::vk::{Context, no_messages};
use crate::{Error, Result};

/// Render the frames of a turntable. Frames that are there already are skipped.
///
/// The camera of the scene goes around the vertical axis through the volume's centre; light is computed once where it
/// is for every view (--light-for, the default here). --stats has the figures of every frame, too.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Frames A to B - 1 of the turntable, counted from 0 [default: all]
    #[arg(long, value_name = "A..B", value_parser = frame_range, help_heading = "Output")]
    frames: Option<Range<u32>>,

    /// Pictures to write, .png or .exr; {} stands for the frame's number, {:04} for four digits of it. An automatic
    /// exposure is that of frame 0 for all.
    #[arg(short, long, value_name = "PATTERN", default_value = "frame_{:04}.png", help_heading = "Output")]
    output: Pattern,

    /// Bits per channel of a PNG.
    #[arg(long, value_name = "BITS", default_value = "8", help_heading = "Output")]
    bits: BitDepth,

    /// Render frames that are there already, too.
    #[arg(long, help_heading = "Output")]
    force: bool,

    #[command(flatten)]
    report: ReportArgs,

    #[command(flatten)]
    device: DeviceArgs,
}

/// File names by number.
#[derive(Clone, Debug, PartialEq)]
struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

impl FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parts = || {
            let (before, rest) = text.split_once('{')?;
            let (number, after) = rest.split_once('}')?;
            let digits = match number.strip_prefix(":0") {
                Some(digits) => digits.parse().ok().filter(|d| (1..=9).contains(d))?,
                None => number.is_empty().then_some(1)?,
            };
            let is_plain = !before.contains('}') && !after.contains(['{', '}']);
            is_plain.then(|| Self { before: before.into(), digits, after: after.into() })
        };
        parts().ok_or_else(|| format!("'{text}' does not say once where the number goes: write {{}} or {{:04}}"))
    }
}

impl Pattern {
    fn path(&self, frame: u32) -> PathBuf {
        format!("{}{frame:0digits$}{}", self.before, self.after, digits = self.digits).into()
    }
}

fn frame_range(text: &str) -> std::result::Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    ends.filter(|range| !range.is_empty())
        .ok_or_else(|| format!("'{text}' is no range of frames: write A..B with A < B, e.g. 0..36"))
}

/// Runs the command. What concerns all frames is refused before the first is rendered.
pub fn run(args: &Args) -> Result<String> {
    let start = Instant::now();
    // A name that no frame has; only its folder and its extension matter.
    output::check_picture_path(&args.output.path(u32::MAX))?;
    if let Some(path) = &args.report.stats {
        output::check_writable(path)?;
    }
    let scene = args.scene.load()?;
    let count = scene.views.len() as u32;
    if count == 0 {
        let cure = "give --turntable 36, or [turntable] frames = 36 in the scene";
        return Err(Error::usage("--turntable", "the scene does not say how many frames there are", cure));
    }
    let range = args.frames.clone().unwrap_or(0..count);
    if range.end > count {
        let problem = format!("{}..{} goes beyond the turntable's {count} frames", range.start, range.end);
        return Err(Error::usage("--frames", problem, format!("end it at {count}, or give another --turntable")));
    }
    let is_done = |frame: u32| !args.force && args.output.path(frame).is_file();
    let (done, wanted): (Vec<_>, Vec<_>) = range.partition(|&frame| is_done(frame));

    let ctx = Context::new(&args.device.config())?;
    let mut batch = Batch::new(&ctx, args, scene)?;
    let mut frames: Vec<_> = done
        .into_iter()
        .map(|frame| FrameStats::new(frame, args.output.path(frame), Outcome::Skipped, vec![]))
        .collect();
    let bar = progress_bar(args.report.quiet);
    for (i, &frame) in wanted.iter().enumerate() {
        let mut progress =
            |p: Progress| show(&bar, &Progress { done: (i as f64 + p.done) / wanted.len() as f64, phase: p.phase });
        let path = args.output.path(frame);
        let at = Instant::now();
        let mut figures = match batch.finish(frame, &path, &mut progress) {
            Ok(passes) => FrameStats::new(frame, path, Outcome::Rendered, passes),
            Err(error) => {
                bar.suspend(|| log::warn!("frame {frame}: {error}"));
                FrameStats { error: Some(error.to_string()), ..FrameStats::new(frame, path, Outcome::Failed, vec![]) }
            }
        };
        figures.wall_ms = at.elapsed().as_secs_f64() * 1e3;
        frames.push(figures);
    }
    bar.finish_and_clear();
    frames.sort_by_key(|f| f.frame);

    let stats = batch.stats(frames, start.elapsed().as_secs_f64() * 1e3);
    drop(batch);
    if let Some(path) = &args.report.stats {
        stats.write(path)?;
    }
    no_messages(&ctx.close())?;
    let of = |outcome| stats.frames.iter().filter(|f| f.outcome == outcome).count();
    let failed = of(Outcome::Failed);
    if failed > 0 {
        return Err(Error::Frames { failed, count: stats.frames.len() });
    }
    if args.report.json {
        return Ok(stats.to_json());
    }
    let (rendered, skipped) = (of(Outcome::Rendered), of(Outcome::Skipped));
    let text = || format!("{}\n{rendered} frames rendered, {skipped} were there already\n", stats.all.table());
    Ok(if args.report.quiet { String::new() } else { text() })
}

/// What renders the frames.
struct Batch<'a> {
    ctx: &'a Context,
    scene: Scene,
    /// All but `path`, which has no light to reuse.
    renderer: Option<Renderer<'a>>,
    png: PngOptions,
    /// Of everything that was rendered.
    passes: Vec<PassStats>,
    /// The first picture's figures.
    first: Option<Stats>,
}

type OnProgress<'p> = &'p mut dyn FnMut(Progress) -> std::ops::ControlFlow<()>;

impl<'a> Batch<'a> {
    fn new(ctx: &'a Context, args: &Args, scene: Scene) -> Result<Self> {
        let png = PngOptions { bits: args.bits, exposure: scene.exposure, tone: scene.tone };
        let renderer = match scene.settings.model {
            Model::Path => None,
            _ => Some(Renderer::new(ctx, &scene, Internals::default())?),
        };
        Ok(Self { ctx, scene, renderer, png, passes: Vec::new(), first: None })
    }

    /// Renders a frame and writes it; returns its passes.
    fn finish(&mut self, frame: u32, path: &std::path::Path, progress: OnProgress<'_>) -> Result<Vec<PassStats>> {
        output::check_writable(path)?;
        let (picture, passes) = self.take(frame, progress)?;
        if self.png.exposure == Exposure::Auto && Format::of(path)? == Format::Png {
            // Of the same frame whatever frame comes first: a picture must not depend on which others are there already.
            let stops = match frame {
                0 => output::stops_of(&picture, &self.png),
                _ => output::stops_of(&self.take(0, progress)?.0, &self.png),
            };
            self.png.exposure = Exposure::Stops(stops);
        }
        output::write_picture(path, &picture, &self.png)?;
        Ok(passes)
    }

    fn take(&mut self, frame: u32, progress: OnProgress<'_>) -> Result<(Picture, Vec<PassStats>)> {
        self.scene.camera = self.scene.views[frame as usize];
        let (picture, stats) = match &mut self.renderer {
            Some(renderer) => {
                renderer.look(&self.scene.camera)?;
                let picture = renderer.picture(progress)?;
                (picture, renderer.stats(&self.scene, 0.0)?)
            }
            None => render::render(self.ctx, &self.scene, progress)?,
        };
        no_messages(&self.ctx.messages())?;
        let passes = stats.passes.clone();
        add_passes(&mut self.passes, &passes);
        self.first.get_or_insert(stats);
        Ok((picture, passes))
    }

    /// The figures of everything so far, of which the caller measured `wall_ms`.
    fn stats(&self, frames: Vec<FrameStats>, wall_ms: f64) -> BatchStats {
        let volume = match &self.first {
            Some(stats) => stats.volume.clone(),
            None => VolumeStats::of(&self.scene.volume, f64::NAN),
        };
        let proxy = self.first.as_ref().map_or(Vec::new(), |stats| stats.proxy.clone());
        let auto = self.first.as_ref().and_then(|stats| stats.auto.clone());
        let all = Stats::new(self.ctx, &self.scene, volume, self.passes.clone(), proxy, wall_ms);
        BatchStats { all: Stats { auto, ..all }, frames }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_their_number_where_the_pattern_says() {
        let name = |pattern: &str, frame| pattern.parse::<Pattern>().unwrap().path(frame).display().to_string();
        assert_eq!(name("out/f_{:04}.png", 7), "out/f_0007.png");
        assert_eq!(name("{}.exr", 12), "12.exr");
        assert_eq!(name("{:02}", 123), "123");
        for bad in ["frame.png", "{}{}.png", "{:4}.png", "{:00}.png", "{x}.png", "a}{.png", "{:0.png", "}{}", "{:0-1}"]
        {
            assert!(bad.parse::<Pattern>().is_err(), "{bad}");
        }
    }

    #[test]
    fn ranges_are_half_open_and_not_empty() {
        assert_eq!(frame_range("3..7"), Ok(3..7));
        for bad in ["3", "3..", "..7", "7..3", "3..3", "a..b", "-1..3", "3..=7"] {
            assert!(frame_range(bad).is_err(), "{bad}");
        }
    }
}
