//! Renders small scenes that use every pass and every specialization, under validation, and collects what it says.
//! `tyndall check` runs it.

pub mod allow;
pub mod cases;
mod report;

pub use report::{CaseReport, Report, RunReport};

use self::allow::Allowed;
use self::cases::{CASES, Case};
use crate::render::auto::FREE_PILOT;
use crate::render::{self, Internals, Progress, Renderer};
use crate::scene::Model;
use crate::stats::DeviceStats;
use crate::vk::{Context, ContextConfig, Injection, Message, Validation};
use crate::{Error, Result};
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::Instant;

/// How a run begins: instance and device are made.
const SET_UP: &str = "set-up";
/// How it ends: leaks are noticed when everything is torn down.
const TEARDOWN: &str = "teardown";

/// What to check.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The device, as on the command line.
    pub device: Option<String>,
    /// Kinds of validation, each of which gets a run of its own.
    pub kinds: Vec<Validation>,
    /// Cases whose names contain one of these; none: all.
    pub only: Vec<String>,
    /// Messages to let through.
    pub allowed: Vec<Allowed>,
    /// A fault in every run: for tests of the report.
    pub injection: Option<Injection>,
}

impl Options {
    /// The cases of a run.
    pub fn cases(&self) -> Vec<&'static Case> {
        let is_wanted =
            |case: &&Case| self.only.is_empty() || self.only.iter().any(|part| case.name.contains(part.as_str()));
        CASES.iter().filter(is_wanted).collect()
    }
}

type OnProgress<'p> = &'p mut dyn FnMut(Progress) -> ControlFlow<()>;

/// Runs everything.
///
/// # Errors
/// No device, no validation layer, or `progress` broke off. What a case fails with is in the report.
pub fn run(options: &Options, progress: OnProgress<'_>) -> Result<Report> {
    let cases = options.cases();
    let all = (options.kinds.len() * cases.len()).max(1) as f64;
    let mut runs = Vec::new();
    for (k, &kind) in options.kinds.iter().enumerate() {
        let (device, injection) = (options.device.clone(), options.injection);
        let config = ContextConfig { device, validation: kind, injection, ..ContextConfig::default() };
        let mut run = Watched::begin(&config, kind)?;
        for (i, case) in cases.iter().enumerate() {
            let done = (k * cases.len() + i) as f64 / all;
            if progress(Progress { done, phase: case.name }).is_break() {
                return Err(Error::Stopped { cure: "start it again, with --only for some of the cases" });
            }
            run.case(case.name, |ctx| render_twice(ctx, case));
        }
        runs.push(run.end(&options.allowed));
    }
    let is_unused =
        |entry: &&Allowed| runs.iter().any(|run| run.might_use(entry)) && !runs.iter().any(|run| run.has_used(entry));
    let unused = options.allowed.iter().filter(is_unused).cloned().collect();
    Ok(Report { runs, unused })
}

/// What became of a fault put in on purpose.
#[derive(Clone, Debug, Serialize)]
pub struct Injected {
    /// The fault.
    pub kind: Injection,
    /// Ids of the messages that show that it was noticed; none if it was not.
    pub noticed_by: Vec<String>,
    /// What the render failed with.
    pub error: Option<String>,
    /// Everything that was said.
    #[serde(skip)]
    pub messages: Vec<Message>,
}

/// Renders one scene with a fault, under the validation that must notice it.
///
/// # Errors
/// No device, or no validation layer.
pub fn inject(device: Option<String>, kind: Injection) -> Result<Injected> {
    let validation = kind.validation();
    let config = ContextConfig { device, validation, injection: Some(kind), ..ContextConfig::default() };
    let ctx = Context::new(&config)?;
    // It says nothing of the fault whether the picture comes out.
    let error = render_twice(&ctx, &cases::FAULTY).err().map(|e| e.to_string());
    let messages = ctx.close();
    Ok(Injected { kind, noticed_by: kind.noticed_in(&messages), error, messages })
}

/// A picture, and another one from elsewhere: what is kept is used too.
fn render_twice(ctx: &Context, case: &Case) -> Result<()> {
    let scene = case.scene()?;
    let mut go_on = |_: Progress| ControlFlow::Continue(());
    if scene.settings.model == Model::Path {
        return render::render(ctx, &scene, &mut go_on).map(drop);
    }
    // Scenes as small as these have no pilot otherwise.
    let internals = Internals { costs: Some(FREE_PILOT), ..Internals::default() };
    let mut renderer = Renderer::new(ctx, &scene, internals)?;
    renderer.picture(&mut go_on)?;
    let turned = scene.camera.turned(crate::scene::camera::centre(&scene.volume.grid), 40.0);
    renderer.look(&turned)?;
    renderer.picture(&mut go_on)?;
    Ok(())
}

/// A context, and what is said case by case.
struct Watched {
    ctx: Context,
    kind: Validation,
    notes: Notes,
}

#[derive(Default)]
struct Notes {
    cases: Vec<CaseReport>,
    /// Messages that belong to one of them.
    seen: usize,
}

impl Notes {
    fn add(&mut self, name: &str, start: Instant, error: Option<String>, all: &[Message]) {
        let messages = all[self.seen..].to_vec();
        self.seen = all.len();
        let seconds = start.elapsed().as_secs_f64();
        self.cases.push(CaseReport { name: name.into(), seconds, error, messages, allowed: 0 });
    }
}

impl Watched {
    fn begin(config: &ContextConfig, kind: Validation) -> Result<Self> {
        let start = Instant::now();
        let ctx = Context::new(config)?;
        let mut notes = Notes::default();
        notes.add(SET_UP, start, None, &ctx.messages());
        Ok(Self { ctx, kind, notes })
    }

    fn case(&mut self, name: &str, body: impl FnOnce(&Context) -> Result<()>) {
        let start = Instant::now();
        let before = self.ctx.bytes();
        let result = body(&self.ctx);
        let held = self.ctx.bytes().saturating_sub(before);
        let mut error = result.err().map(|e| e.to_string());
        if error.is_none() && held > 0 {
            error = Some(format!("{held} bytes of device memory are still held"));
        }
        self.notes.add(name, start, error, &self.ctx.messages());
    }

    fn end(self, allowed: &[Allowed]) -> RunReport {
        let start = Instant::now();
        let Self { ctx, kind, mut notes } = self;
        let (device, layer, kernels) = (DeviceStats::of(&ctx), ctx.layer_version(), ctx.kernels());
        notes.add(TEARDOWN, start, None, &ctx.close());
        RunReport::new(kind, device, layer, &kernels, notes.cases, allowed)
    }
}
