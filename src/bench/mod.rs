//! Measurements of the device: `tyndall bench`, one file per subject. Times are GPU timestamps; what is compared runs in
//! turns, so that a machine that is busy now and then is so for all.

pub mod gather;
pub mod lit;
pub mod masks;
pub mod primitives;
pub mod proxy;
pub mod rivals;
pub mod scenes;

use crate::measure::processor_ms;
use crate::passes::bench_copy::{BenchCopy, CopyShape};
use crate::passes::order_compute;
use crate::vk::{Access, Buffer, Context, Recorder, TimedPass};
use crate::{Error, Result};
use std::cell::Cell;
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
    /// Of `passes`, together; `before`: the process's CPU time before their submission.
    ///
    /// Errors: the device has no timestamps.
    fn since(ctx: &Context, before: Option<f64>, passes: &[TimedPass]) -> Result<Self> {
        let gpu = passes.iter().map(|pass| pass.ms).sum();
        let cpu = if ctx.is_cpu() { processor_ms().zip(before).map(|(after, before)| after - before) } else { None };
        if gpu > 0.0 { Ok(Self { gpu, cpu: cpu.filter(|&ms| ms > 0.0) }) } else { Err(no_timestamps()) }
    }

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
    let passes = rec.submit_and_wait()?;
    Timing::since(ctx, before, &passes)
}

/// Time at which something that was measured as pairs of time and noise has this noise: along the line between neighbours of its
/// front, in logarithms; beyond the least noisy, as if noise fell with the root of time.
fn time_at(measured: &[[f64; 2]], noise: f64) -> Option<f64> {
    let mut sorted: Vec<[f64; 2]> = measured.iter().map(|pair| pair.map(f64::ln)).collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut front: Vec<[f64; 2]> = Vec::new();
    for point in sorted {
        if front.last().is_none_or(|last| point[1] < last[1]) {
            front.push(point);
        }
    }
    let wanted = noise.ln();
    let first = front.iter().position(|p| p[1] <= wanted);
    let at = match first {
        Some(0) => front[0][0],
        Some(i) => {
            let ([t0, n0], [t1, n1]) = (front[i - 1], front[i]);
            t0 + (t1 - t0) * (n0 - wanted) / (n0 - n1)
        }
        None => front.last().map(|&[t, n]| t + 2.0 * (n - wanted))?,
    };
    Some(at.exp())
}

/// Runs that never count.
const WARM_UPS: u32 = 3;
/// How long a GPU works before the first run counts: clocks rise slowly.
const WARM_UP: Duration = Duration::from_millis(400);
/// How long it works right before each run: clocks sink while the host records.
const HEAT_MS: f64 = 2.0;
/// After a pause as long as this it is cold.
const PAUSE: Duration = Duration::from_millis(20);
/// Words of the copies that heat it.
const HEAT_WORDS: u32 = 1 << 24;

/// A copy that is fast on any device.
const FOUR_VECTORS: CopyShape = CopyShape { workgroup: 256, rows: 4, width: 4 };

/// Copies that a GPU does before a run.
struct Heat {
    copy: BenchCopy,
    from: Buffer<u32>,
    to: Buffer<u32>,
    copies: Cell<u32>,
}

impl Heat {
    /// With memory that has something in it.
    fn new(ctx: &Context) -> Result<Self> {
        let buffer = |name| ctx.device_buffer(name, HEAT_WORDS as usize);
        let (from, to) = (buffer("bench.heat_from")?, buffer("bench.heat_to")?);
        let mut rec = Recorder::new(ctx)?;
        rec.fill(&from, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        rec.submit_and_wait()?;
        Ok(Self { copy: BenchCopy::new(ctx, FOUR_VECTORS)?, from, to, copies: Cell::new(1) })
    }

    fn record(&self, rec: &mut Recorder) {
        for _ in 0..self.copies.get() {
            self.copy.record(rec, &self.from, &self.to, HEAT_WORDS);
        }
    }

    /// Works until clocks have risen, and finds how many copies take [`HEAT_MS`] then.
    fn warm_up(&self, ctx: &Context) -> Result<()> {
        let began = Instant::now();
        while began.elapsed() < WARM_UP {
            let ms = time(ctx, |rec| self.record(rec))?.gpu / f64::from(self.copies.get());
            self.copies.set(((HEAT_MS / ms).ceil() as u32).clamp(1, 100));
        }
        Ok(())
    }
}

/// Times what is recorded, again and again, on a device that is kept hot: a GPU that idles between short runs lowers its
/// clocks, and small inputs then look several times slower than they are amid other work.
pub(crate) struct Timer<'a> {
    ctx: &'a Context,
    /// Where the device is no CPU.
    heat: Option<Heat>,
    /// When the device last was at work.
    worked: Cell<Option<Instant>>,
}

impl<'a> Timer<'a> {
    /// For this device.
    ///
    /// Errors: no memory for what is copied, or the device fails.
    pub(crate) fn new(ctx: &'a Context) -> Result<Self> {
        let heat = if ctx.is_cpu() { None } else { Some(Heat::new(ctx)?) };
        Ok(Self { ctx, heat, worked: Cell::new(None) })
    }

    /// One run of what `record` records, after `prepare`, untimed; in its parts ([`Recorder::part`]) or as one pass.
    ///
    /// Errors: the device fails.
    pub(crate) fn run_once(
        &self,
        in_parts: bool,
        prepare: impl Fn(&mut Recorder),
        record: impl Fn(&mut Recorder),
    ) -> Result<Vec<TimedPass>> {
        let mut rec = Recorder::new(self.ctx)?;
        if in_parts {
            rec.time_parts();
        }
        if let Some(heat) = &self.heat {
            heat.record(&mut rec);
        }
        prepare(&mut rec);
        order_compute(&mut rec);
        rec.begin_pass("bench", 0);
        record(&mut rec);
        rec.end_pass();
        let passes = rec.submit_and_wait()?;
        self.worked.set(Some(Instant::now()));
        Ok(passes)
    }

    /// GPU times of `runs` runs of what `record` records, in ms, after some that do not count; before each, untimed, what
    /// `prepare` records.
    ///
    /// Errors: the device has no timestamps, or fails.
    pub(crate) fn each(
        &self,
        runs: u32,
        prepare: impl Fn(&mut Recorder),
        record: impl Fn(&mut Recorder),
    ) -> Result<Vec<f64>> {
        let run = |_| {
            let ms = self.run_once(false, &prepare, &record)?.iter().map(|pass| pass.ms).sum();
            if ms > 0.0 { Ok(ms) } else { Err(no_timestamps()) }
        };
        if let Some(heat) = &self.heat
            && self.worked.get().is_none_or(|worked| worked.elapsed() > PAUSE)
        {
            heat.warm_up(self.ctx)?;
        }
        (0..WARM_UPS).try_for_each(|i| run(i).map(drop))?;
        (0..runs).map(run).collect()
    }
}

fn no_timestamps() -> Error {
    Error::input("--device", "the device has no timestamps", "choose another one: see `tyndall devices`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_lie_between_neighbours_of_the_front() {
        // The second is dominated.
        let all = [[10.0, 0.4], [1000.0, 0.3], [40.0, 0.1]];
        let close = |noise: f64, ms: f64| (time_at(&all, noise).unwrap() / ms - 1.0).abs() < 1e-9;
        assert!(close(0.4, 10.0) && close(0.1, 40.0) && close(0.2, 20.0));
        assert!(close(0.9, 10.0), "no faster than the fastest");
        assert!(close(0.05, 160.0), "a quarter of the variance in four times the time");
        assert_eq!(time_at(&[], 0.1), None);
    }
}
