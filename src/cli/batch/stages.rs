//! The stages that a frame goes through, each beside the others: its scene is made, which may read a volume; it is rendered;
//! it is encoded and written.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::ledger::Ledger;
use crate::cli::interrupt;
use crate::output::{self, BitDepth, Format, Picture, PngOptions};
use crate::render::{self, Internals, Progress, Renderer, Taken};
use crate::scene::{Exposure, Model, Player, Scene, Sequence, Shot};
use crate::stats::{FrameStats, Outcome, PassStats, Stats, add_passes};
use crate::vk::{Context, no_messages};
use crate::{Error, Result};

/// A frame to be rendered.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its place among all frames of all scenes.
    pub index: usize,
    /// Of the batch's scenes, which one.
    pub sequence: usize,
    /// The scene's name, where there are several.
    pub scene: Option<String>,
    /// Its number.
    pub frame: u32,
    /// Where the picture goes.
    pub path: PathBuf,
}

impl Job {
    /// Its figures, before there are any.
    pub fn stats(&self, outcome: Outcome) -> FrameStats {
        FrameStats::new(self.index, self.scene.clone(), self.frame, self.path.clone(), outcome)
    }
}

/// What the first stage hands on.
pub struct Loaded {
    job: Job,
    /// Rendered only to know the exposure of the job's scene.
    is_probe: bool,
    shot: Result<Shot>,
}

/// Makes the scenes of jobs, in their order.
struct Loader {
    sequences: Vec<Arc<Sequence>>,
    jobs: std::vec::IntoIter<Job>,
    /// Of which sequence, and where it is.
    player: Option<(usize, Player)>,
    /// After the probe that goes before it.
    waiting: Option<Job>,
}

impl Loader {
    fn load(&mut self, job: Job, is_probe: bool) -> Loaded {
        let frame = if is_probe { 0 } else { job.frame };
        let (_, player) = self.player.as_mut().expect("the job's player");
        Loaded { shot: player.go(frame), job, is_probe }
    }
}

impl Iterator for Loader {
    type Item = Loaded;

    fn next(&mut self) -> Option<Loaded> {
        if let Some(job) = self.waiting.take() {
            return Some(self.load(job, false));
        }
        let job = self.jobs.next()?;
        if self.player.as_ref().is_none_or(|(sequence, _)| *sequence != job.sequence) {
            let sequence = &self.sequences[job.sequence];
            self.player = Some((job.sequence, Player::new(sequence.clone())));
            // Whatever frame comes first: a picture must not depend on which others are there already.
            let is_automatic = sequence.exposure(job.frame).is_ok_and(|e| e == Exposure::Auto);
            if job.frame > 0 && is_automatic && is_png(&job) {
                self.waiting = Some(job.clone());
                return Some(self.load(job, true));
            }
        }
        Some(self.load(job, false))
    }
}

fn is_png(job: &Job) -> bool {
    Format::of(&job.path).is_ok_and(|format| format == Format::Png)
}

/// The jobs with their scenes; the next one is made while one is rendered, unless `is_one_by_one`. Ends early when the user
/// asks to stop.
pub fn load(sequences: Vec<Arc<Sequence>>, jobs: Vec<Job>, is_one_by_one: bool) -> Box<dyn Iterator<Item = Loaded>> {
    let loader = Loader { sequences, jobs: jobs.into_iter(), player: None, waiting: None };
    if is_one_by_one {
        return Box::new(loader.take_while(|_| !interrupt::is_asked()));
    }
    // Two volumes are there while the third is read.
    let (sender, receiver) = sync_channel(0);
    // Never joined: when we stop, nobody waits for a large file to be read.
    thread::spawn(move || {
        for loaded in loader {
            if sender.send(loaded).is_err() {
                break;
            }
        }
    });
    Box::new(std::iter::from_fn(move || receive(&receiver)))
}

fn receive(receiver: &Receiver<Loaded>) -> Option<Loaded> {
    while !interrupt::is_asked() {
        match receiver.recv_timeout(Duration::from_millis(50)) {
            Ok(loaded) => return Some(loaded),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return None,
        }
    }
    None
}

/// A picture to be written.
struct Developed {
    job: Job,
    picture: Picture,
    png: PngOptions,
    passes: Vec<PassStats>,
    begun: Instant,
}

impl Developed {
    fn write(self, ledger: &Ledger) {
        let written = output::write_picture(&self.job.path, &self.picture, &self.png);
        let outcome = if written.is_ok() { Outcome::Rendered } else { Outcome::Failed };
        let stats = self.job.stats(outcome).with_passes(self.passes);
        ledger.enter(stats.ended(self.begun, written.err()));
    }
}

/// Encodes and writes pictures.
pub struct Writers {
    ledger: Arc<Ledger>,
    /// None: whoever hands over a picture writes it.
    to_threads: Option<SyncSender<Developed>>,
    threads: Vec<JoinHandle<()>>,
}

impl Writers {
    /// With so many threads.
    pub fn new(ledger: Arc<Ledger>, threads: usize) -> Self {
        if threads == 0 {
            return Self { ledger, to_threads: None, threads: Vec::new() };
        }
        let (sender, receiver) = sync_channel::<Developed>(threads);
        let receiver = Arc::new(Mutex::new(receiver));
        let writer = |_| {
            let (ledger, receiver) = (ledger.clone(), receiver.clone());
            thread::spawn(move || {
                loop {
                    // The lock is let go before the picture is written.
                    let next = receiver.lock().unwrap_or_else(|e| e.into_inner()).recv();
                    let Ok(developed) = next else { break };
                    developed.write(&ledger);
                }
            })
        };
        let threads = (0..threads).map(writer).collect();
        Self { ledger, to_threads: Some(sender), threads }
    }

    fn write(&self, developed: Developed) {
        match &self.to_threads {
            None => developed.write(&self.ledger),
            Some(sender) => {
                let sent = sender.send(developed);
                sent.expect("writers end when there is nothing more to send");
            }
        }
    }

    /// Waits until everything is written.
    pub fn finish(self) {
        drop(self.to_threads);
        for thread in self.threads {
            if let Err(panic) = thread.join() {
                std::panic::resume_unwind(panic);
            }
        }
    }
}

/// What renders the frames.
pub struct Studio<'a> {
    ctx: &'a Context,
    writers: &'a Writers,
    ledger: &'a Ledger,
    bits: BitDepth,
    is_one_by_one: bool,
    /// The scene that is set up; all models but `path`, which has nothing to reuse.
    renderer: Option<(Arc<Scene>, Renderer<'a>)>,
    /// The frame that the device still works on.
    pending: Option<Pending>,
    /// Exposures of the frames 0, by sequence.
    stops: HashMap<usize, f32>,
    /// Of everything that was rendered.
    passes: Vec<PassStats>,
    /// The first picture's scene and figures.
    first: Option<(Arc<Scene>, Stats)>,
}

struct Pending {
    job: Job,
    is_probe: bool,
    shot: Shot,
    taken: Taken,
    begun: Instant,
}

type OnProgress<'p> = &'p mut dyn FnMut(Progress) -> ControlFlow<()>;

impl<'a> Studio<'a> {
    /// Before the first frame.
    pub fn new(
        ctx: &'a Context,
        writers: &'a Writers,
        ledger: &'a Ledger,
        bits: BitDepth,
        is_one_by_one: bool,
    ) -> Self {
        let (stops, passes) = (HashMap::new(), Vec::new());
        Self { ctx, writers, ledger, bits, is_one_by_one, renderer: None, pending: None, stops, passes, first: None }
    }

    /// Renders a frame and has it written. What fails is in the ledger; only what no further frame can survive is an error.
    pub fn render(&mut self, loaded: Loaded, progress: OnProgress<'_>) -> Result<()> {
        let begun = Instant::now();
        let Loaded { job, mut is_probe, shot } = loaded;
        if let Some(error) = if is_probe { None } else { output::check_writable(&job.path).err() } {
            self.ledger.enter(job.stats(Outcome::Failed).ended(begun, Some(error)));
            // Other frames may want its exposure.
            is_probe = job.frame == 0 && is_png(&job);
            if !is_probe {
                return Ok(());
            }
        }
        let result = match shot {
            Ok(shot) if shot.scene.settings.model == Model::Path => self.trace(&job, is_probe, shot, begun, progress),
            Ok(shot) => self.begin(&job, is_probe, shot, begun, progress),
            Err(error) => Err(error),
        };
        self.note(&job, is_probe, begun, result)
    }

    /// Waits for the last frame.
    pub fn finish(&mut self) -> Result<()> {
        let Some(pending) = self.pending.take() else { return Ok(()) };
        let (job, is_probe, begun) = (pending.job.clone(), pending.is_probe, pending.begun);
        let result = self.conclude(pending);
        self.note(&job, is_probe, begun, result)
    }

    fn note(&mut self, job: &Job, is_probe: bool, begun: Instant, result: Result<()>) -> Result<()> {
        match result {
            Err(error) if error.is_final() => Err(error),
            // The frames that it was for say so themselves.
            Err(error) if is_probe => {
                self.renderer = None;
                log::debug!("exposure of {}: {error}", job.path.display());
                Ok(())
            }
            Err(error) => {
                self.renderer = None;
                self.ledger.enter(job.stats(Outcome::Failed).ended(begun, Some(error)));
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// `path`: every frame for itself.
    fn trace(&mut self, job: &Job, is_probe: bool, shot: Shot, begun: Instant, progress: OnProgress<'_>) -> Result<()> {
        let scene = Scene { camera: shot.camera, ..(*shot.scene).clone() };
        let (picture, stats) = render::render(self.ctx, &scene, progress)?;
        let passes = stats.passes.clone();
        self.first.get_or_insert_with(|| (shot.scene.clone(), stats));
        self.develop(job.clone(), is_probe, &shot, picture, passes, begun)
    }

    /// The other models: the device works on while the frame before is read back and handed on.
    fn begin(&mut self, job: &Job, is_probe: bool, shot: Shot, begun: Instant, progress: OnProgress<'_>) -> Result<()> {
        if self.renderer.as_ref().is_none_or(|(scene, _)| !Arc::ptr_eq(scene, &shot.scene)) {
            self.finish()?;
            // What is not needed any more makes room for what is.
            self.renderer = None;
            let renderer = Renderer::new(self.ctx, &shot.scene, Internals::default())?;
            self.renderer = Some((shot.scene.clone(), renderer));
        }
        let (_, renderer) = self.renderer.as_mut().expect("it was just made");
        renderer.look(&shot.camera)?;
        let taken = renderer.begin_picture(progress)?;
        let pending = Pending { job: job.clone(), is_probe, shot, taken, begun };
        self.finish()?;
        self.pending = Some(pending);
        // The first frame's figures are taken before the next one changes them.
        if self.is_one_by_one || self.first.is_none() { self.finish() } else { Ok(()) }
    }

    fn conclude(&mut self, pending: Pending) -> Result<()> {
        let Pending { job, is_probe, shot, taken, begun } = pending;
        let (picture, times) = taken.finish()?;
        let passes = crate::stats::pass_stats(&times);
        if self.first.is_none()
            && let Some((scene, renderer)) = &self.renderer
        {
            self.first = Some((scene.clone(), renderer.stats_of(scene, &times, 0.0)?));
        }
        self.develop(job, is_probe, &shot, picture, passes, begun)
    }

    fn develop(
        &mut self,
        job: Job,
        is_probe: bool,
        shot: &Shot,
        picture: Picture,
        passes: Vec<PassStats>,
        begun: Instant,
    ) -> Result<()> {
        no_messages(&self.ctx.messages())?;
        add_passes(&mut self.passes, &passes);
        let mut png = PngOptions { bits: self.bits, exposure: shot.exposure, tone: shot.tone };
        if png.exposure == Exposure::Auto && is_png(&job) {
            if is_probe || job.frame == 0 {
                self.stops.insert(job.sequence, output::stops_of(&picture, &png));
            }
            let Some(&stops) = self.stops.get(&job.sequence) else {
                let problem = "the automatic exposure is that of frame 0, which could not be rendered";
                return Err(Error::input("--exposure", problem, "see why frame 0 fails, or give --exposure"));
            };
            png.exposure = Exposure::Stops(stops);
        }
        if !is_probe {
            self.writers.write(Developed { job, picture, png, passes, begun });
        }
        Ok(())
    }

    /// The figures of everything rendered, of which the caller measured `wall_ms`; none if nothing was.
    pub fn stats(self, wall_ms: f64) -> Option<Stats> {
        let (scene, first) = self.first?;
        let all = Stats::new(self.ctx, &scene, first.volume, self.passes, first.proxy, wall_ms);
        Some(Stats { auto: first.auto, ..all })
    }
}
