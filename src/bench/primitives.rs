//! `tyndall bench scan` and `tyndall bench sort`: how fast the primitives are, against copies of as many words in the
//! same run. Every result is checked before its times count.

use super::{FOUR_VECTORS, Timer};
use crate::cpu;
use crate::parallel::fill_chunks;
use crate::passes::bench_copy::{BenchCopy, CopyShape};
use crate::passes::lookback::{Carry, Count, Diagnostics, MAX_ITEMS};
use crate::passes::radix_sort::{RadixSort, RadixSortConfig, Sorted};
use crate::passes::scan::{Scan, ScanConfig};
use crate::stats::median;
use crate::vk::{Access, Buffer, Context, Recorder};
use crate::{Error, Result};
use serde::Serialize;
use std::cell::Cell;
use std::time::Instant;

/// Options.
#[derive(Clone, Debug)]
pub struct Config {
    /// Items of a run.
    pub sizes: Vec<u32>,
    /// Words of which a key is the AND: 1 = random bits, more = ever fewer ones ([`entropy_of`]).
    pub ands: Vec<u32>,
    /// Bits of a key that may be set, and that are sorted by: 1 to 32.
    pub bits: u32,
    /// Timed runs of everything.
    pub runs: u32,
    /// Whether keys are sorted on the CPU too ([`super::rivals`]).
    pub rivals: bool,
}

/// Bytes that a scan must move per item: one read and one write.
pub const SCAN_BYTES: u64 = 8;

/// Bytes that a radix sort by `bits` bits must move per key (with its payload): the histogram's read, then one read
/// and one write of both per pass.
pub fn sort_bytes(bits: u32, payloads: bool) -> u64 {
    let passes = u64::from(bits.div_ceil(crate::shaders::constants::RADIX_BITS));
    4 + passes * if payloads { 16 } else { 8 }
}

/// Bits of entropy of a key's bit that is the AND of `ands` random bits.
pub fn entropy_of(ands: u32) -> f64 {
    let one = 0.5f64.powi(ands as i32);
    let term = |p: f64| if p > 0.0 { -p * p.log2() } else { 0.0 };
    term(one) + term(1.0 - one)
}

/// Median and spread of times, in ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Half of the runs took less.
    pub median: f64,
    /// A tenth of the runs took less.
    pub p10: f64,
    /// Nine tenths of the runs took less.
    pub p90: f64,
}

impl Spread {
    /// Of these times; zeros of none.
    pub fn of(times: &[f64]) -> Self {
        let mut sorted = times.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = share * (sorted.len().max(1) - 1) as f64;
            let of = |i: f64| sorted.get(i as usize).copied().unwrap_or(0.0);
            of(place.floor()) + (of(place.ceil()) - of(place.floor())) * place.fract()
        };
        Self { median: at(0.5), p10: at(0.1), p90: at(0.9) }
    }
}

/// One figure.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What ran.
    pub what: String,
    /// Items.
    pub items: u32,
    /// Bits of entropy per key bit, of sorts.
    pub entropy: Option<f64>,
    /// GPU time.
    pub ms: Spread,
    /// Items per second at the median.
    pub items_per_second: f64,
    /// Bytes that had to move, per second.
    pub bytes_per_second: f64,
    /// That over the fastest copy of as many words.
    pub of_copy: f64,
    /// Medians of the parts' times, in ms, of runs of their own.
    pub parts: Vec<(&'static str, f64)>,
    /// Per run, polls that found the status of an earlier tile missing.
    pub spins: f64,
    /// Per run, tiles that were computed in place of their owner.
    pub fallbacks: f64,
}

impl Row {
    fn new(what: &str, items: u32, entropy: Option<f64>, bytes_each: u64, times: &[f64]) -> Self {
        let ms = Spread::of(times);
        let items_per_second = f64::from(items) / (1e-3 * ms.median);
        let bytes_per_second = items_per_second * bytes_each as f64;
        Self {
            what: what.into(),
            items,
            entropy,
            ms,
            items_per_second,
            bytes_per_second,
            of_copy: 0.0,
            parts: vec![],
            spins: 0.0,
            fallbacks: 0.0,
        }
    }
}

/// A name for figures: `what`, and the way in which it carries sums unless that is look-back.
fn name_of(what: &str, carry: Carry) -> String {
    match carry {
        Carry::LookBack => what.to_owned(),
        Carry::Dispatches => format!("{what}, no look-back"),
    }
}

/// Runs by which parts and look-back are judged.
const PART_RUNS: u32 = 5;

/// Adds to `row` what [`PART_RUNS`] runs of its own show.
fn add_parts(
    timer: &Timer<'_>,
    row: &mut Row,
    diagnostics: &Diagnostics,
    prepare: impl Fn(&mut Recorder),
    record: impl Fn(&mut Recorder),
) -> Result<()> {
    let mut rec = Recorder::new(timer.ctx)?;
    diagnostics.clear(&mut rec);
    rec.submit_and_wait()?;
    let runs: Vec<_> = (0..PART_RUNS).map(|_| timer.run_once(true, &prepare, &record)).collect::<Result<_>>()?;
    let report = diagnostics.check(timer.ctx, "bench")?;
    // The first is empty: it ends where the first part begins.
    row.parts = (1..runs[0].len())
        .map(|part| (runs[0][part].name, median(&runs.iter().map(|run| run[part].ms).collect::<Vec<_>>())))
        .collect();
    row.spins = f64::from(report.spins) / f64::from(PART_RUNS);
    row.fallbacks = f64::from(report.fallbacks) / f64::from(PART_RUNS);
    Ok(())
}

/// Copies that a kernel is compared with: the fastest counts.
const COPIES: [(&str, CopyShape); 4] = [
    ("copy 1 word", CopyShape { workgroup: 256, rows: 1, width: 1 }),
    ("copy 16 words", CopyShape { workgroup: 256, rows: 16, width: 1 }),
    ("copy 1 vector", CopyShape { workgroup: 256, rows: 1, width: 4 }),
    ("copy 4 vectors", FOUR_VECTORS),
];

/// Keys that are the AND of `ands` random words.
pub fn keys(count: u32, ands: u32) -> Vec<u32> {
    let word = |i: u32, k: u32| cpu::rng::random_word(cpu::rng::stream_key(i, k, 0, 0), 1);
    let key = |i: u32| (0..ands).fold(u32::MAX, |key, k| key & word(i, k));
    let mut keys = vec![0; count as usize];
    fill_chunks(&mut keys, 1 << 16, |keys, first| {
        keys.iter_mut().zip(first as u32..).for_each(|(word, i)| *word = key(i));
    });
    keys
}

fn most(config: &Config) -> u32 {
    config.sizes.iter().copied().max().unwrap_or(0)
}

/// Sizes that the device and the look-back words take.
pub fn fitting(ctx: &Context, sizes: impl IntoIterator<Item = u64>) -> Vec<u32> {
    let limit = (ctx.max_storage_bytes() / 4).min(u64::from(MAX_ITEMS));
    sizes.into_iter().filter(|&n| n <= limit).map(|n| n as u32).collect()
}

fn wrong(pass: &'static str, what: &str, items: u32) -> Error {
    Error::Device { pass, problem: format!("{what} of {items} items came out wrong: its times count for nothing") }
}

/// Times of copies of `n` words, and the largest bandwidth among them.
fn copies(
    timer: &Timer<'_>,
    shapes: &[(&str, BenchCopy)],
    (from, to): (&Buffer<u32>, &Buffer<u32>),
    n: u32,
    runs: u32,
) -> Result<Vec<Row>> {
    let row = |what: &str, times: &[f64]| Row::new(what, n, None, SCAN_BYTES, times);
    let mut rows = Vec::new();
    let times = timer.each(
        runs,
        |_| {},
        |rec| {
            rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
            rec.barrier(Access::TransferWrite, Access::TransferWrite);
            rec.copy(from, 0, to, 0, n as usize);
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        },
    )?;
    rows.push(row("vkCmdCopyBuffer", &times));
    for (name, copy) in shapes {
        if n.is_multiple_of(4) {
            rows.push(row(name, &timer.each(runs, |_| {}, |rec| copy.record(rec, from, to, n))?));
        }
    }
    let best = rows.iter().map(|r| r.bytes_per_second).fold(0.0, f64::max);
    for row in &mut rows {
        row.of_copy = row.bytes_per_second / best;
    }
    Ok(rows)
}

fn copy_shapes(ctx: &Context) -> Result<Vec<(&'static str, BenchCopy)>> {
    COPIES.iter().map(|&(name, shape)| Ok((name, BenchCopy::new(ctx, shape)?))).collect()
}

fn best_copy(rows: &[Row], n: u32) -> f64 {
    rows.iter().filter(|r| r.items == n && r.entropy.is_none()).map(|r| r.bytes_per_second).fold(0.0, f64::max)
}

/// Times scans and copies. `progress` gets the part that is done.
///
/// Errors: the device fails, has no timestamps, or computes a wrong sum.
pub fn scan(ctx: &Context, config: &Config, shape: ScanConfig, progress: &mut dyn FnMut(f64)) -> Result<Vec<Row>> {
    let timer = Timer::new(ctx)?;
    let scan = Scan::new(ctx, shape)?;
    let shapes = copy_shapes(ctx)?;
    let most = most(config);
    let scratch = scan.scratch(ctx, most)?;
    let items = keys(most, 1);
    let input = ctx.upload("bench.items", &items)?;
    let output = ctx.device_buffer("bench.sums", most as usize)?;
    let mut rows = Vec::new();
    for (i, &n) in config.sizes.iter().enumerate() {
        rows.extend(copies(&timer, &shapes, (&input, &output), n, config.runs)?);
        let record = |rec: &mut Recorder| scan.record(rec, &input, &output, Count::Host(n), &scratch);
        let times = timer.each(config.runs, |_| {}, record)?;
        let mut row = Row::new(&name_of("scan", shape.carry), n, None, SCAN_BYTES, &times);
        add_parts(&timer, &mut row, scratch.diagnostics(), |_| {}, record)?;
        let sums = ctx.read_back_range(&output, 0..n as usize)?;
        let expected = if shape.inclusive { cpu::scan::inclusive } else { cpu::scan::exclusive };
        if sums != expected(&items[..n as usize]) {
            return Err(wrong("scan", "a scan", n));
        }
        row.of_copy = row.bytes_per_second / best_copy(&rows, n);
        rows.push(row);
        progress((i + 1) as f64 / config.sizes.len() as f64);
    }
    scratch.diagnostics().check(ctx, "scan")?;
    Ok(rows)
}

/// Are `sorted` the keys `keys` in order? And have `payloads`, the places in `keys`, come along and kept their order
/// where keys are equal?
fn is_sorted(keys: &[u32], sorted: &[u32], payloads: Option<&[u32]>) -> bool {
    match payloads {
        Some(payloads) => {
            let came_along = sorted.iter().zip(payloads).all(|(&key, &place)| keys.get(place as usize) == Some(&key));
            // Strictly growing pairs: no place twice, so all of them once.
            let pairs: Vec<_> = sorted.iter().zip(payloads).collect();
            came_along && pairs.windows(2).all(|p| p[0] < p[1])
        }
        None => {
            let sums = |keys: &[u32]| {
                keys.iter().fold((0u64, 0u64), |(plain, hashed), &key| {
                    (plain + u64::from(key), hashed.wrapping_add(mixed(key)))
                })
            };
            sorted.is_sorted() && sums(keys) == sums(sorted)
        }
    }
}

/// A hash of a key, for sums over a multiset of keys.
fn mixed(key: u32) -> u64 {
    let key = u64::from(key).wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (key ^ key >> 29).wrapping_mul(0x94D0_49BB_1331_11EB)
}

/// Times sorts of keys on the CPU, by the clock.
fn rivals(config: &Config, keys: &[u32], ands: u32) -> Vec<Row> {
    let mut rows = Vec::new();
    for (what, sort) in super::rivals::sorts() {
        for &n in &config.sizes {
            let times: Vec<f64> = (0..config.runs)
                .map(|_| {
                    let mut keys = keys[..n as usize].to_vec();
                    let start = Instant::now();
                    sort(&mut keys);
                    1e3 * start.elapsed().as_secs_f64()
                })
                .collect();
            // What had to move is a figure of the GPU's sort.
            rows.push(Row::new(what, n, Some(entropy_of(ands)), 0, &times));
        }
    }
    rows
}

/// Times sorts of keys, with and without payloads, and copies. `progress` gets the part that is done.
///
/// Errors: the device fails, has no timestamps, or sorts wrongly.
pub fn sort(ctx: &Context, config: &Config, shape: RadixSortConfig, progress: &mut dyn FnMut(f64)) -> Result<Vec<Row>> {
    let timer = Timer::new(ctx)?;
    let shapes = copy_shapes(ctx)?;
    let most = most(config);
    let places: Vec<u32> = (0..most).collect();
    let key_buffer = ctx.device_buffer("bench.keys", most as usize)?;
    let payload_buffer = ctx.device_buffer("bench.payloads", most as usize)?;
    let place_buffer = ctx.upload("bench.places", &places)?;
    let mut rows = Vec::new();
    let mut done = 0.0;
    for &n in &config.sizes {
        rows.extend(copies(&timer, &shapes, (&place_buffer, &payload_buffer), n, config.runs)?);
    }
    for payloads in [false, true] {
        let sort = RadixSort::new(ctx, RadixSortConfig { payloads, ..shape })?;
        let scratch = sort.scratch(ctx, most)?;
        let what = name_of(if payloads { "sort pairs" } else { "sort keys" }, shape.carry);
        for &ands in &config.ands {
            let keys: Vec<u32> = keys(most, ands).into_iter().map(|key| key >> (32 - config.bits)).collect();
            if config.rivals && !payloads {
                rows.extend(rivals(config, &keys, ands));
            }
            let unsorted = ctx.upload("bench.unsorted", &keys)?;
            for &n in &config.sizes {
                let prepare = |rec: &mut Recorder| {
                    rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
                    rec.copy(&unsorted, 0, &key_buffer, 0, n as usize);
                    rec.copy(&place_buffer, 0, &payload_buffer, 0, n as usize);
                    rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
                };
                let count = Count::Host(n);
                let result = Cell::new(None);
                let record = |rec: &mut Recorder| {
                    let bits = 0..config.bits;
                    result.set(Some(if payloads {
                        sort.record(rec, &key_buffer, &payload_buffer, count, bits, &scratch)
                    } else {
                        let keys = sort.record_keys(rec, &key_buffer, count, bits, &scratch);
                        Sorted { keys, payloads: keys }
                    }));
                };
                let times = timer.each(config.runs, prepare, record)?;
                let entropy = Some(entropy_of(ands));
                let mut row = Row::new(&what, n, entropy, sort_bytes(config.bits, payloads), &times);
                add_parts(&timer, &mut row, scratch.diagnostics(), prepare, record)?;
                let result = result.get().expect("every run sets it");
                let sorted = ctx.read_back_range(result.keys, 0..n as usize)?;
                let places = if payloads { Some(ctx.read_back_range(result.payloads, 0..n as usize)?) } else { None };
                if !is_sorted(&keys[..n as usize], &sorted, places.as_deref()) {
                    return Err(wrong("radix sort", &what, n));
                }
                row.of_copy = row.bytes_per_second / best_copy(&rows, n);
                rows.push(row);
                done += 1.0;
                progress(done / (2 * config.ands.len() * config.sizes.len()) as f64);
            }
        }
        scratch.diagnostics().check(ctx, "radix sort")?;
    }
    rows.sort_by_key(|r| r.items);
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_of_few_times() {
        assert_eq!(Spread::of(&[]), Spread { median: 0.0, p10: 0.0, p90: 0.0 });
        assert_eq!(Spread::of(&[2.0]), Spread { median: 2.0, p10: 2.0, p90: 2.0 });
        let eleven: Vec<f64> = (0..11).rev().map(f64::from).collect();
        assert_eq!(Spread::of(&eleven), Spread { median: 5.0, p10: 1.0, p90: 9.0 });
        assert_eq!(Spread::of(&[1.0, 2.0]).median, 1.5);
    }

    #[test]
    fn entropies_and_floors() {
        let close = |a: f64, b: f64| (a - b).abs() < 5e-4;
        let published = [1.0, 0.811, 0.544, 0.337, 0.201];
        assert!((1..).zip(published).all(|(ands, e)| close(entropy_of(ands), e)));
        assert_eq!((sort_bytes(32, false), sort_bytes(32, true), sort_bytes(16, true)), (36, 68, 36));
    }

    #[test]
    fn wrong_orders_are_found() {
        let keys = [3, 1, 3, 0];
        assert!(is_sorted(&keys, &[0, 1, 3, 3], None));
        assert!(!is_sorted(&keys, &[0, 1, 2, 3], None) && !is_sorted(&keys, &[0, 3, 1, 3], None));
        assert!(is_sorted(&keys, &[0, 1, 3, 3], Some(&[3, 1, 0, 2])));
        assert!(!is_sorted(&keys, &[0, 1, 3, 3], Some(&[3, 1, 2, 0])), "not stable");
        assert!(!is_sorted(&keys, &[0, 1, 3, 3], Some(&[3, 1, 0, 0])), "lost");
        assert!(!is_sorted(&keys, &[0, 1, 3, 3], Some(&[1, 3, 0, 2])), "wrong pairs");
    }
}
