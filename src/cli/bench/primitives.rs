//! `tyndall bench scan` and `tyndall bench sort`.

use super::super::render::{progress_bar, show};
use super::super::{DeviceArgs, in_string};
use crate::bench::primitives::{self, Config, Row};
use crate::measure::plot::{self, Curve};
use crate::output;
use crate::passes::radix_sort::RadixSortConfig;
use crate::passes::scan::ScanConfig;
use crate::passes::tuning::Tuning;
use crate::render::Progress;
use crate::shaders::constants::{RADIX_RUN_VECTORS, SCAN_RUN_VECTORS};
use crate::stats::{DeviceStats, csv_of, to_json};
use crate::vk::{Context, ContextConfig, KernelStatistics, no_messages};
use crate::{Error, Result};
use serde::Serialize;
use std::path::PathBuf;

/// What both have in common.
#[derive(clap::Args, Debug)]
struct PrimitiveArgs {
    /// Powers of two of the sizes: the first, the last, and the distance between them. What the device does not hold is
    /// left out.
    #[arg(long, value_name = "FROM:TO:STEP", default_value = "10:24:2", value_parser = exponents, help_heading = "Bench")]
    sizes: Exponents,

    /// Timed runs of everything; figures are their medians, tenths and nine tenths.
    #[arg(
        long,
        value_name = "R",
        default_value_t = 11,
        value_parser = clap::value_parser!(u32).range(1..=10_000),
        help_heading = "Bench"
    )]
    runs: u32,

    /// Also print the times of the parts, polls and fallbacks of look-back, and what the driver says about the kernels.
    #[arg(long, help_heading = "Output")]
    details: bool,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,

    /// Write the table as CSV, too.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    csv: Option<PathBuf>,

    /// Draw items per second against size, as SVG.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    plot: Option<PathBuf>,

    #[command(flatten)]
    device: DeviceArgs,
}

/// Time exclusive scans of u32 against copies of as many words.
#[derive(clap::Args, Debug)]
pub struct ScanArgs {
    #[command(flatten)]
    common: PrimitiveArgs,

    /// Invocations of a workgroup instead of the device's usual number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(64..=1024), help_heading = "Bench")]
    workgroup: Option<u32>,

    /// Vectors of four items of an invocation instead of the device's usual number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(32 * SCAN_RUN_VECTORS)), help_heading = "Bench")]
    vectors: Option<u32>,

    /// Whether an invocation owns a run of vectors, instead of every so-manieth of its subgroup's.
    #[arg(long, value_name = "BOOL", help_heading = "Bench")]
    blocked: Option<bool>,

    /// Polls of a missing predecessor before its tile is computed in its place.
    #[arg(long, value_name = "N", help_heading = "Bench")]
    spin_limit: Option<u32>,
}

/// Time radix sorts of u32 keys, alone and with u32 payloads, against copies of as many words.
#[derive(clap::Args, Debug)]
pub struct SortArgs {
    #[command(flatten)]
    common: PrimitiveArgs,

    /// How many random words a key is the AND of: 1 to 5 leave 1, 0.81, 0.54, 0.34 and 0.20 bits of entropy per bit.
    #[arg(
        long,
        value_name = "K,...",
        value_delimiter = ',',
        default_values_t = [1, 2, 3, 4, 5],
        value_parser = clap::value_parser!(u32).range(1..=32),
        help_heading = "Bench"
    )]
    ands: Vec<u32>,

    /// Bits of a key that may be set, and that are sorted by.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 32,
        value_parser = clap::value_parser!(u32).range(1..=32),
        help_heading = "Bench"
    )]
    bits: u32,

    /// Invocations of a workgroup instead of the device's usual number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..=1024), help_heading = "Bench")]
    workgroup: Option<u32>,

    /// Keys of an invocation instead of the device's usual number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(4 * RADIX_RUN_VECTORS)), help_heading = "Bench")]
    keys: Option<u32>,

    /// Whether an invocation owns a run of keys, instead of every so-manieth of its subgroup's.
    #[arg(long, value_name = "BOOL", help_heading = "Bench")]
    blocked: Option<bool>,

    /// In how many rounds the keys of a tile go through shared memory, instead of the device's usual number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32), help_heading = "Bench")]
    rounds: Option<u32>,

    /// Of an invocation's keys, for how many equal digits are found by masks in shared memory.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=32), help_heading = "Bench")]
    mask_rows: Option<u32>,

    /// Invocations of a workgroup of the histogram.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(64..=1024), help_heading = "Bench")]
    histogram_workgroup: Option<u32>,

    /// Status words that a step of look-back loads at once.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32), help_heading = "Bench")]
    ahead: Option<u32>,

    /// Polls of a missing predecessor before its tile is counted in its place.
    #[arg(long, value_name = "N", help_heading = "Bench")]
    spin_limit: Option<u32>,

    /// Also time sorts of the same keys on the CPU, by the clock: sort_unstable, and rayon's par_sort_unstable and
    /// radsort where they were built in (cargo build --features rivals).
    #[arg(long, help_heading = "Bench")]
    rivals: bool,
}

#[derive(Clone, Copy, Debug)]
struct Exponents {
    from: u32,
    to: u32,
    step: u32,
}

fn exponents(text: &str) -> std::result::Result<Exponents, String> {
    let wanted = "give powers of two as FROM:TO:STEP, such as 10:28:2; FROM at least 2, TO at most 29";
    let numbers: Vec<u32> = text.split(':').map_while(|n| n.parse().ok()).collect();
    match numbers[..] {
        [from, to, step] if (2..=29).contains(&from) && (from..=29).contains(&to) && step > 0 => {
            Ok(Exponents { from, to, step })
        }
        _ => Err(wanted.into()),
    }
}

/// The JSON object.
#[derive(Serialize)]
struct Report {
    device: DeviceStats,
    rows: Vec<Row>,
    kernels: Vec<KernelStatistics>,
}

/// Runs `tyndall bench scan`.
pub fn run_scan(args: &ScanArgs) -> Result<String> {
    run(&args.common, vec![], 32, false, |ctx, config, progress| {
        let usual = Tuning::of(ctx).scan;
        let shape = ScanConfig {
            workgroup: args.workgroup.unwrap_or(usual.workgroup),
            vectors: args.vectors.unwrap_or(usual.vectors),
            blocked: args.blocked.unwrap_or(usual.blocked),
            spin_limit: args.spin_limit.unwrap_or(usual.spin_limit),
            ..usual
        };
        if !shape.vectors_fit() {
            let text = format!("{} vectors for an invocation", shape.vectors);
            let (each, most) = (SCAN_RUN_VECTORS, 32 * SCAN_RUN_VECTORS);
            let cure = format!("give 1 to 32, or with --blocked true a multiple of {each} up to {most}");
            return Err(Error::input("--vectors", text, cure));
        }
        primitives::scan(ctx, config, shape, progress)
    })
}

/// Runs `tyndall bench sort`.
pub fn run_sort(args: &SortArgs) -> Result<String> {
    run(&args.common, args.ands.clone(), args.bits, args.rivals, |ctx, config, progress| {
        let usual = Tuning::of(ctx).sort;
        let shape = RadixSortConfig {
            workgroup: args.workgroup.or(usual.workgroup),
            keys: args.keys.unwrap_or(usual.keys),
            blocked: args.blocked.unwrap_or(usual.blocked),
            rounds: args.rounds.unwrap_or(usual.rounds),
            mask_rows: args.mask_rows.unwrap_or(usual.mask_rows),
            ahead: args.ahead.unwrap_or(usual.ahead),
            histogram_workgroup: args.histogram_workgroup.unwrap_or(usual.histogram_workgroup),
            spin_limit: args.spin_limit.unwrap_or(usual.spin_limit),
            ..usual
        };
        if !shape.keys_fit() {
            let text = format!("{} keys for an invocation", shape.keys);
            let cure = format!("give 1 to 32, or with --blocked true a multiple of 4 up to {}", 4 * RADIX_RUN_VECTORS);
            return Err(Error::input("--keys", text, cure));
        }
        if shape.rounds > shape.keys {
            let text = format!("{} rounds for the {} keys of an invocation", shape.rounds, shape.keys);
            return Err(Error::input("--rounds", text, "give at most as many as keys"));
        }
        primitives::sort(ctx, config, shape, progress)
    })
}

fn run(
    args: &PrimitiveArgs,
    ands: Vec<u32>,
    bits: u32,
    rivals: bool,
    measure: impl FnOnce(&Context, &Config, &mut dyn FnMut(f64)) -> Result<Vec<Row>>,
) -> Result<String> {
    for path in args.csv.iter().chain(&args.plot) {
        output::check_writable(path)?;
    }
    let ctx = Context::new(&ContextConfig { kernel_statistics: args.details, ..args.device.config() })?;
    let device = DeviceStats::of(&ctx);
    let Exponents { from, to, step } = args.sizes;
    let sizes = primitives::fitting(&ctx, (from..=to).step_by(step as usize).map(|e| 1 << e));
    if sizes.is_empty() {
        let most = primitives::fitting(&ctx, (2..=29).map(|e| 1 << e)).last().map_or(0, |n| n.ilog2());
        let cure = format!("this device takes up to 2^{most}: give a smaller FROM");
        return Err(Error::input("--sizes", "no size of these fits a storage buffer of the device", cure));
    }
    let bar = progress_bar(false);
    let rows = measure(&ctx, &Config { sizes, ands, bits, runs: args.runs, rivals }, &mut |done| {
        let _ = show(&bar, &Progress { done, phase: "bench" });
    })?;
    bar.finish_and_clear();
    let kernels = ctx.kernel_statistics();
    no_messages(&ctx.close())?;
    if let Some(path) = &args.csv {
        output::write_atomically(path, csv(&rows).as_bytes())?;
    }
    if let Some(path) = &args.plot {
        output::write_atomically(path, plot::size_plot(&curves(&rows)).as_bytes())?;
    }
    let report = Report { device, rows, kernels };
    Ok(if args.json { to_json(&report) } else { text(&report, args.details) })
}

fn name(row: &Row) -> String {
    row.entropy.map_or_else(|| row.what.clone(), |e| format!("{}, entropy {e:.2}", row.what))
}

fn curves(rows: &[Row]) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for row in rows {
        let (name, at) = (name(row), (f64::from(row.items), row.items_per_second * 1e-9));
        match curves.iter_mut().find(|c| c.name == name) {
            Some(curve) => curve.points.push(at),
            None => curves.push(Curve { name, points: vec![at] }),
        }
    }
    curves
}

fn text(report: &Report, has_details: bool) -> String {
    in_string(|out| {
        use std::fmt::Write as _;
        writeln!(
            out,
            "{:>10}  {:<28} {:>10} {:>10} {:>10} {:>9} {:>8} {:>8}",
            "items", "what", "ms", "p10", "p90", "Gitems/s", "GB/s", "% copy"
        )?;
        let mut before = None;
        for row in &report.rows {
            if before.is_some_and(|n| n != row.items) {
                writeln!(out)?;
            }
            before = Some(row.items);
            writeln!(
                out,
                "{:>10}  {:<28} {:>10.4} {:>10.4} {:>10.4} {:>9.3} {:>8.1} {:>8.1}",
                row.items,
                name(row),
                row.ms.median,
                row.ms.p10,
                row.ms.p90,
                row.items_per_second * 1e-9,
                row.bytes_per_second * 1e-9,
                100.0 * row.of_copy
            )?;
            if has_details && !row.parts.is_empty() {
                let parts: Vec<String> = row.parts.iter().map(|(name, ms)| format!("{name} {ms:.4}")).collect();
                let (parts, spins, fallbacks) = (parts.join(", "), row.spins, row.fallbacks);
                writeln!(out, "{:12}{parts}; {spins:.0} polls in vain, {fallbacks:.1} fallbacks", "")?;
            }
        }
        for kernel in &report.kernels {
            let values: Vec<String> = kernel.values.iter().map(|(name, value)| format!("{name} {value}")).collect();
            writeln!(out, "{}: {}", kernel.kernel, values.join(", "))?;
        }
        writeln!(
            out,
            "GB/s: bytes that had to move (scan 8 per item, sort 36 per key, 68 per pair) by GPU timestamps; % of the fastest\n\
             copy of as many words."
        )?;
        writeln!(out, "on {} ({})", report.device.name, report.device.driver)
    })
}

fn csv(rows: &[Row]) -> String {
    let columns = |r: &Row| {
        let text = [("what", r.what.clone()), ("items", r.items.to_string())];
        let entropy = [("entropy", r.entropy.map_or_else(String::new, |e| e.to_string()))];
        let numbers = [
            ("ms", r.ms.median),
            ("p10_ms", r.ms.p10),
            ("p90_ms", r.ms.p90),
            ("items_per_second", r.items_per_second),
            ("bytes_per_second", r.bytes_per_second),
            ("of_copy", r.of_copy),
        ];
        text.into_iter().chain(entropy).chain(numbers.map(|(name, x)| (name, x.to_string()))).collect()
    };
    csv_of(rows.iter().map(columns))
}

#[cfg(test)]
mod tests {
    use super::exponents;

    #[test]
    fn sizes_are_three_numbers_in_order() {
        let e = exponents("10:24:2").unwrap();
        assert_eq!((e.from, e.to, e.step), (10, 24, 2));
        for bad in ["", "10", "10:24", "24:10:2", "10:24:0", "1:24:2", "10:30:1", "a:b:c", "10:24:2:1"] {
            assert!(exponents(bad).unwrap_err().contains("FROM:TO:STEP"), "{bad}");
        }
    }
}
