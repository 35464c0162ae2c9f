//! Measuring the error of pictures, and what settings cost and bring.

pub mod front;
pub mod knobs;
pub mod metrics;
pub mod plot;
pub mod report;
pub mod seeds;
pub mod sweep;

/// Processor time of this process so far, in ms; `None` where the system does not tell.
pub fn processor_ms() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6)
    }
    #[cfg(not(unix))]
    None
}

#[cfg(test)]
mod tests {
    use super::processor_ms;

    #[test]
    fn processor_time_passes() {
        let Some(before) = processor_ms() else { return };
        let mut x = 1u64;
        while processor_ms().unwrap() < before + 5.0 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        assert!(x != 0);
    }
}
