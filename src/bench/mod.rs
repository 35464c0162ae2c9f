//! Measurements of the device: `tyndall bench`, one file per subject. Times are GPU timestamps; what is compared runs in
//! turns, so that a machine that is busy now and then is so for all.

pub mod lit;
pub mod proxy;

use crate::passes::order_compute;
use crate::vk::{Context, Recorder};
use crate::{Error, Result};

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

/// Times what `record` records.
///
/// Errors: the device has no timestamps, or fails.
pub(crate) fn time(ctx: &Context, mut record: impl FnMut(&mut Recorder)) -> Result<Timing> {
    let mut rec = Recorder::new(ctx)?;
    rec.begin_pass("bench", 0);
    record(&mut rec);
    order_compute(&mut rec);
    rec.end_pass();
    let before = cpu_time();
    let gpu = rec.submit_and_wait()?.iter().map(|pass| pass.ms).sum();
    let cpu = if ctx.is_cpu() { cpu_time().zip(before).map(|(after, before)| after - before) } else { None };
    if gpu > 0.0 {
        Ok(Timing { gpu, cpu: cpu.filter(|&ms| ms > 0.0) })
    } else {
        Err(Error::input("--device", "the device has no timestamps", "choose another one: see `tyndall devices`"))
    }
}

/// CPU time of all threads of the process so far, in ms; Linux only.
fn cpu_time() -> Option<f64> {
    let threads = std::fs::read_dir("/proc/self/task").ok()?;
    let of = |thread: std::io::Result<std::fs::DirEntry>| -> Option<f64> {
        // Time on a CPU [ns], time in a queue, number of slices.
        let text = std::fs::read_to_string(thread.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    Some(threads.filter_map(of).sum::<f64>() * 1e-6)
}

/// The middle one, or the mean of the two in the middle; 0 of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    if n == 0 { 0.0 } else { 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]) }
}

#[cfg(test)]
mod tests {
    use super::{cpu_time, median};

    #[test]
    fn cpu_time_passes() {
        let Some(before) = cpu_time() else { return };
        let mut x = 1u64;
        while cpu_time().unwrap() < before + 5.0 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        assert!(x != 0);
    }

    #[test]
    fn medians() {
        assert_eq!(median(&[]), 0.0);
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 9.0]), 3.0);
    }
}
