//! Measurements of the device: `tyndall bench`, one file per subject. Times are GPU timestamps; what is compared runs in
//! turns, so that a machine that is busy now and then is so for all.

pub mod lit;
pub mod masks;
pub mod primitives;
pub mod proxy;
pub mod rivals;
pub mod scenes;

use crate::measure::processor_ms;
use crate::passes::order_compute;
use crate::vk::{Context, Recorder, TimedPass};
use crate::{Error, Result};
use std::time::{Duration, Instant};

/// Times of what a recorder recorded, in ms.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// By GPU timestamps.
    pub gpu: f64,
    /// CPU time of the process, where the device is a CPU: the better measure on a machine that others use too.
    pub cpu: Option<f64>,
}

impl Timing {
    /// What structures are compared by.
    pub fn best(&self) -> f64 {
        self.cpu.unwrap_or(self.gpu)
    }
}

/// Times what `record` records, as one pass.
///
/// Errors: as [`time_passes`].
pub(crate) fn time(ctx: &Context, mut record: impl FnMut(&mut Recorder)) -> Result<Timing> {
    time_passes(ctx, |rec| {
        rec.begin_pass("bench", 0);
        record(rec);
        order_compute(rec);
        rec.end_pass();
    })
}

/// Times the passes that `record` records, together.
///
/// Errors: the device has no timestamps, or fails.
pub(crate) fn time_passes(ctx: &Context, mut record: impl FnMut(&mut Recorder)) -> Result<Timing> {
    let mut rec = Recorder::new(ctx)?;
    record(&mut rec);
    let before = processor_ms();
    let gpu = rec.submit_and_wait()?.iter().map(|pass| pass.ms).sum();
    let cpu = if ctx.is_cpu() { processor_ms().zip(before).map(|(after, before)| after - before) } else { None };
    if gpu > 0.0 { Ok(Timing { gpu, cpu: cpu.filter(|&ms| ms > 0.0) }) } else { Err(no_timestamps()) }
}

/// How a measurement starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Start {
    /// The device may have idled: it works for a while before times count, because clocks rise slowly under load.
    Cold,
    /// Another measurement has just ended.
    Warm,
}

/// How long a cold GPU works first.
const WARM_UP: Duration = Duration::from_millis(400);
/// Runs that never count.
const WARM_UPS: u32 = 3;

/// One run of what `record` records, after `prepare`, untimed; in its parts ([`Recorder::part`]) or as one pass.
fn run_once(
    ctx: &Context,
    in_parts: bool,
    prepare: impl Fn(&mut Recorder),
    record: impl Fn(&mut Recorder),
) -> Result<Vec<TimedPass>> {
    let mut rec = Recorder::new(ctx)?;
    if in_parts {
        rec.time_parts();
    }
    prepare(&mut rec);
    order_compute(&mut rec);
    rec.begin_pass("bench", 0);
    record(&mut rec);
    rec.end_pass();
    rec.submit_and_wait()
}

/// The parts of `runs` runs of what `record` records ([`Recorder::part`]); before each, untimed, what `prepare` records.
///
/// Errors: the device fails.
pub(crate) fn time_parts(
    ctx: &Context,
    runs: u32,
    prepare: impl Fn(&mut Recorder),
    record: impl Fn(&mut Recorder),
) -> Result<Vec<Vec<TimedPass>>> {
    (0..runs).map(|_| run_once(ctx, true, &prepare, &record)).collect()
}

/// GPU times of `runs` runs of what `record` records, in ms, after some that do not count; before each, untimed, what
/// `prepare` records.
///
/// Errors: the device has no timestamps, or fails.
pub(crate) fn time_each(
    ctx: &Context,
    start: Start,
    runs: u32,
    prepare: impl Fn(&mut Recorder),
    record: impl Fn(&mut Recorder),
) -> Result<Vec<f64>> {
    let run = || -> Result<f64> {
        let ms = run_once(ctx, false, &prepare, &record)?.iter().map(|pass| pass.ms).sum();
        if ms > 0.0 { Ok(ms) } else { Err(no_timestamps()) }
    };
    let (began, warms_up) = (Instant::now(), start == Start::Cold && !ctx.is_cpu());
    for warm_up in 0.. {
        if warm_up >= WARM_UPS && !(warms_up && began.elapsed() < WARM_UP) {
            break;
        }
        run()?;
    }
    (0..runs).map(|_| run()).collect()
}

fn no_timestamps() -> Error {
    Error::input("--device", "the device has no timestamps", "choose another one: see `tyndall devices`")
}
