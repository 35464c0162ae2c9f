//! `tyndall batch`: the frames of scenes, many with one set-up.

mod ledger;
mod pattern;
mod stages;
mod video;

use std::collections::HashMap;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde_json::json;

use self::ledger::Ledger;
use self::pattern::Pattern;
use self::stages::{Job, Studio, Writers};
use super::render::{progress_bar, show};
use super::{DeviceArgs, ReportArgs, interrupt};
use crate::output::{self, BitDepth};
use crate::render::Progress;
use crate::scene::{self, Sequence};
use crate::stats::{BatchStats, Outcome};
use crate::vk::{Context, no_messages};
use crate::{Error, Result};

/// Render the frames of turntables, key frames, series of volumes, or many scenes. Frames that are there already are skipped.
///
/// Light is computed once where only the camera moves (--light-for every-view, the default there). While a frame is rendered
/// the next one's volume is read and the last one is written. A frame that fails stops no other; the exit code is 1 then.
/// After Ctrl-C or a crash, the same command renders what is missing. --stats has the figures of every frame, too.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Scene files (TOML), or patterns of their names ("scenes/*.toml"); flags override what they say. See scenes/README.md
    /// for turntables and key frames; --volume "smoke_*.nrrd" is a series, one volume per frame.
    #[arg(value_name = "SCENE.toml")]
    scenes: Vec<PathBuf>,

    #[command(flatten)]
    overrides: scene::Overrides,

    /// Frames A to B - 1 of each scene, counted from 0 [default: all]
    #[arg(long, value_name = "A..B", value_parser = frame_range, help_heading = "Output")]
    frames: Option<Range<u32>>,

    /// Part I of N of all frames: what N machines render, each with another I, is everything, nothing twice
    #[arg(long, value_name = "I/N", value_parser = shard, help_heading = "Output")]
    shard: Option<Shard>,

    /// Pictures to write, .png or .exr; {} stands for the frame's number, {:04} for four digits of it, {scene} for the name
    /// of the scene file. An automatic exposure is that of frame 0 for all frames of a scene. [default: frame_{:04}.png; of
    /// several scenes {scene}_{:04}.png, or {scene}.png where each has one frame]
    #[arg(short, long, value_name = "PATTERN", help_heading = "Output")]
    output: Option<Pattern>,

    /// Bits per channel of a PNG.
    #[arg(long, value_name = "BITS", default_value = "8", help_heading = "Output")]
    bits: BitDepth,

    /// Render frames that are there already, too.
    #[arg(long, help_heading = "Output")]
    force: bool,

    /// Make a video of the frames once all of them are there (.mp4 and the like, or .webp or .gif, which repeat); takes
    /// ffmpeg. {scene} as above
    #[arg(long, value_name = "FILE.mp4", help_heading = "Output")]
    video: Option<Pattern>,

    /// Frames per second of the video.
    #[arg(long, value_name = "FPS", default_value = "30", value_parser = frame_rate, help_heading = "Output")]
    fps: f64,

    /// Add a line of JSON to this file for the start, every frame as it ends, and the end.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    log: Option<PathBuf>,

    /// Do one thing after the other: to see what doing them at the same time gains.
    #[arg(long, help_heading = "Output")]
    one_by_one: bool,

    #[command(flatten)]
    report: ReportArgs,

    #[command(flatten)]
    device: DeviceArgs,
}

/// One of several equal parts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shard {
    /// From 1.
    part: usize,
    of: usize,
}

impl Shard {
    /// What it has of `count` frames: those that follow each other, since they share light.
    fn range(self, count: usize) -> Range<usize> {
        let begin = |part: usize| (part as u128 * count as u128 / self.of as u128) as usize;
        begin(self.part - 1)..begin(self.part)
    }
}

fn shard(text: &str) -> std::result::Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some(Shard { part: i.parse().ok()?, of: n.parse().ok()? }));
    parts
        .filter(|s| (1..=s.of).contains(&s.part))
        .ok_or_else(|| format!("'{text}' is no part: write I/N with I from 1 to N, e.g. 1/3"))
}

fn frame_range(text: &str) -> std::result::Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    ends.filter(|range| !range.is_empty())
        .ok_or_else(|| format!("'{text}' is no range of frames: write A..B with A < B, e.g. 0..36"))
}

fn frame_rate(text: &str) -> std::result::Result<f64, String> {
    text.parse()
        .ok()
        .filter(|fps| (0.01..=1000.0).contains(fps))
        .ok_or_else(|| "give a number from 0.01 to 1000".into())
}

/// A scene of the batch.
struct Entry {
    /// The scene file's, for `{scene}`.
    name: String,
    sequence: Arc<Sequence>,
    range: Range<u32>,
}

/// Runs the command. What concerns all frames is refused before the first is rendered.
pub fn run(args: &Args) -> Result<String> {
    let start = Instant::now();
    for path in [&args.report.stats, &args.log].into_iter().flatten() {
        output::check_writable(path)?;
    }
    let (entries, broken) = entries(args)?;
    let output = output_pattern(args, &entries)?;
    let jobs = jobs(&entries, &output)?;
    let videos = videos(args, &entries, &output)?;
    let shard = args.shard.map_or(0..jobs.len(), |s| s.range(jobs.len()));
    let (done, wanted): (Vec<_>, Vec<_>) =
        jobs[shard].iter().cloned().partition(|job| !args.force && job.path.is_file());
    let mut folders: Vec<_> = wanted.iter().map(|job| output::directory_of(&job.path)).collect();
    folders.dedup();
    folders.iter().for_each(|folder| output::remove_leftovers(folder));

    let bar = progress_bar(args.report.quiet);
    let ledger = Arc::new(Ledger::new(bar.clone(), args.log.as_deref())?);
    let part = args.shard.map(|s| format!("{}/{}", s.part, s.of));
    ledger.say("begin", json!({ "frames": jobs.len(), "part": part, "done": done.len(), "wanted": wanted.len() }));
    done.iter().for_each(|job| ledger.enter(job.stats(Outcome::Skipped)));
    let ended = render(args, &entries, wanted, &ledger, &bar);
    bar.finish_and_clear();

    let [rendered, skipped, failed] =
        [Outcome::Rendered, Outcome::Skipped, Outcome::Failed].map(|outcome| ledger.count(outcome));
    let wall_ms = start.elapsed().as_secs_f64() * 1e3;
    ledger.say("end", json!({ "rendered": rendered, "skipped": skipped, "failed": failed, "wall_ms": wall_ms }));
    let (frames, logged) = ledger.finish();
    let count = frames.len();
    let (stats, ended) = match ended {
        Ok(all) => (BatchStats { all: all.map(|all| crate::stats::Stats { wall_ms, ..all }), frames }, Ok(())),
        Err(error) => (BatchStats { all: None, frames }, Err(error)),
    };
    if let Some(path) = &args.report.stats {
        stats.write(path)?;
    }
    ended?;
    logged?;
    if failed > 0 {
        return Err(Error::Frames { failed, count });
    }
    if broken > 0 {
        return Err(Error::Scenes { failed: broken, count: broken + entries.len() });
    }
    let made = make_videos(args, &videos)?;
    if args.report.json {
        return Ok(stats.to_json());
    }
    if args.report.quiet {
        return Ok(String::new());
    }
    let table = stats.all.as_ref().map_or_else(String::new, |all| all.table() + "\n");
    Ok(format!("{table}{rendered} frames rendered, {skipped} were there already\n{made}"))
}

/// The scenes, and the number of those that cannot be read: they have been named, and stop no other.
fn entries(args: &Args) -> Result<(Vec<Entry>, usize)> {
    let mut files = Vec::new();
    for path in &args.scenes {
        files.extend(scene::files_of(path)?);
    }
    let are_several = files.len() > 1;
    let given: Vec<Option<PathBuf>> = if files.is_empty() { vec![None] } else { files.into_iter().map(Some).collect() };
    let mut broken = 0;
    let mut entries = Vec::new();
    for file in given {
        match entry(args, file.as_deref(), are_several) {
            Ok(entry) => entries.push(entry),
            Err(error) if !are_several || matches!(error, Error::Usage { .. }) => return Err(error),
            Err(error) => {
                log::warn!("{error}");
                broken += 1;
            }
        }
    }
    Ok((entries, broken))
}

fn entry(args: &Args, file: Option<&Path>, are_several: bool) -> Result<Entry> {
    let sequence = Sequence::load(file, &args.overrides)?;
    let count = sequence.frames();
    if sequence.is_still() && !are_several {
        let cure = "give --turntable 36, [turntable] or [[animation.key]] in the scene, or --volume with a pattern";
        return Err(Error::usage("--turntable", "the scene does not say how many frames there are", cure));
    }
    let mut range = args.frames.clone().unwrap_or(0..count);
    if range.end > count {
        if !are_several {
            let problem = format!("{}..{} goes beyond the scene's {count} frames", range.start, range.end);
            return Err(Error::usage("--frames", problem, format!("end it at {count}, or let the scene have more")));
        }
        range.end = count;
    }
    let stem = file.and_then(Path::file_stem).map_or("scene".into(), |stem| stem.to_string_lossy().into_owned());
    Ok(Entry { name: stem, sequence: sequence.into(), range })
}

/// The pattern given, or the one that suits the scenes; it must tell their frames apart.
fn output_pattern(args: &Args, entries: &[Entry]) -> Result<Pattern> {
    let are_several = entries.len() > 1;
    let have_several = entries.iter().any(|entry| entry.sequence.frames() > 1);
    let usual = match (are_several, have_several) {
        (false, _) => "frame_{:04}.png",
        (true, true) => "{scene}_{:04}.png",
        (true, false) => "{scene}.png",
    };
    let pattern = args.output.clone().unwrap_or_else(|| usual.parse().expect("a constant that is tested"));
    let lacks = |what: &str, cure: &str| {
        Err(Error::usage("--output", format!("'{pattern}' does not say where the {what} goes"), cure))
    };
    if have_several && !pattern.has_number() {
        return lacks("frame's number", "write {} or {:04} there");
    }
    if are_several && !pattern.has_scene() {
        return lacks("scene's name", "write {scene} there");
    }
    // Names that no frame has; only their folders and their extension matter.
    for entry in entries {
        output::check_picture_path(&pattern.path(&entry.name, u32::MAX))?;
    }
    Ok(pattern)
}

/// Every frame of every scene, in order.
fn jobs(entries: &[Entry], output: &Pattern) -> Result<Vec<Job>> {
    let are_several = entries.len() > 1;
    let of = |(sequence, entry): (usize, &Entry)| {
        let scene = are_several.then(|| entry.name.clone());
        let path = |frame| output.path(&entry.name, frame);
        let job = |frame| Job { index: 0, sequence, scene: scene.clone(), frame, path: path(frame) };
        entry.range.clone().map(job).collect::<Vec<_>>()
    };
    let mut jobs: Vec<_> = entries.iter().enumerate().flat_map(of).collect();
    let mut taken = HashMap::new();
    for (index, job) in jobs.iter_mut().enumerate() {
        job.index = index;
        if let Some(other) = taken.insert(job.path.clone(), job.sequence)
            && other != job.sequence
        {
            let problem = format!("two scenes would write '{}'", job.path.display());
            return Err(Error::usage("SCENE.toml", problem, "give the scene files different names"));
        }
    }
    Ok(jobs)
}

/// Renders; the figures of everything together, if there is anything.
fn render(
    args: &Args,
    entries: &[Entry],
    wanted: Vec<Job>,
    ledger: &Arc<Ledger>,
    bar: &indicatif::ProgressBar,
) -> Result<Option<crate::stats::Stats>> {
    if wanted.is_empty() {
        return Ok(None);
    }
    let ctx = Context::new(&args.device.config())?;
    interrupt::listen();
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get().min(MOST_WRITERS));
    let writers = Writers::new(ledger.clone(), if args.one_by_one { 0 } else { threads });
    let mut studio = Studio::new(&ctx, &writers, ledger, args.bits, args.one_by_one);
    let sequences = entries.iter().map(|entry| entry.sequence.clone()).collect();
    let count = wanted.len();
    let mut result = Ok(());
    for (i, loaded) in stages::load(sequences, wanted, args.one_by_one).enumerate() {
        let of_all = |p: Progress| Progress { done: ((i as f64 + p.done) / count as f64).min(1.0), phase: p.phase };
        let mut progress = |p: Progress| -> ControlFlow<()> { show(bar, &of_all(p)) };
        result = studio.render(loaded, &mut progress);
        if result.is_err() {
            break;
        }
    }
    let result = result.and(studio.finish());
    let stats = studio.stats(0.0);
    writers.finish();
    let messages = no_messages(&ctx.close());
    if interrupt::is_asked() {
        return Err(Error::Stopped { cure: "start again to render what is missing" });
    }
    result.and(messages).map(|()| stats)
}

/// Threads that encode and write; a turntable's later frames take a device less time than a PNG takes a thread.
const MOST_WRITERS: usize = 4;

/// The videos to be made, with their frames.
fn videos(args: &Args, entries: &[Entry], output: &Pattern) -> Result<Vec<(PathBuf, Vec<PathBuf>)>> {
    let Some(pattern) = &args.video else { return Ok(Vec::new()) };
    if pattern.has_number() {
        return Err(Error::usage("--video", format!("'{pattern}': a video has no number"), "leave {} out"));
    }
    if entries.len() > 1 && !pattern.has_scene() {
        let problem = format!("'{pattern}' does not say where the scene's name goes");
        return Err(Error::usage("--video", problem, "write {scene} there"));
    }
    let of = |entry: &Entry| {
        let video = pattern.path(&entry.name, 0);
        video::check(&video, &output.path(&entry.name, 0))?;
        Ok((video, entry.range.clone().map(|frame| output.path(&entry.name, frame)).collect()))
    };
    entries.iter().map(of).collect()
}

/// Makes those whose frames are all there; says what it did.
fn make_videos(args: &Args, videos: &[(PathBuf, Vec<PathBuf>)]) -> Result<String> {
    let mut said = String::new();
    for (video, frames) in videos {
        let missing = frames.iter().filter(|frame| !frame.is_file()).count();
        if missing > 0 {
            said += &format!("no {} yet: {missing} frames are missing\n", video.display());
            continue;
        }
        video::make(video, frames, args.fps)?;
        said += &format!("wrote {}\n", video.display());
    }
    Ok(said)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ranges_are_half_open_and_not_empty() {
        assert_eq!(frame_range("3..7"), Ok(3..7));
        for bad in ["3", "3..", "..7", "7..3", "3..3", "a..b", "-1..3", "3..=7"] {
            assert!(frame_range(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn parts_count_from_1() {
        assert_eq!(shard("2/3"), Ok(Shard { part: 2, of: 3 }));
        for bad in ["0/3", "4/3", "1", "1/0", "/3", "a/b", "-1/3"] {
            assert!(shard(bad).is_err(), "{bad}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Every frame is in exactly one part, and parts differ by one frame at most.
        #[test]
        fn parts_are_everything_once(of in 1usize..50, count in 0usize..500) {
            let ranges: Vec<_> = (1..=of).map(|part| Shard { part, of }.range(count)).collect();
            prop_assert_eq!(ranges[0].start, 0);
            prop_assert_eq!(ranges[of - 1].end, count);
            for pair in ranges.windows(2) {
                prop_assert_eq!(pair[0].end, pair[1].start);
            }
            let lengths: Vec<_> = ranges.iter().map(ExactSizeIterator::len).collect();
            prop_assert!(lengths.iter().max().unwrap() - lengths.iter().min().unwrap() <= 1);
        }
    }
}
