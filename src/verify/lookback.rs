//! Scan and radix sort: exact against the CPU at awkward sizes, and progress when tiles are suspended.

use super::Bench;
use crate::Result;
use crate::cpu;
use crate::passes::lookback::{Carry, Count, Report};
use crate::passes::radix_sort::{RadixSort, RadixSortConfig};
use crate::passes::scan::{Scan, ScanConfig};
use crate::passes::tuning::Tuning;
use crate::vk::Recorder;

const EXACT: &str = "integers: every one is right or the pass is wrong";
const SUSPENDED: &str = "the inputs' size fixes it: tiles that never publish, less the last one, which nobody needs";
const ERRORS: &str = "error bits that the kernels report: none may be set";

/// Invocations of a workgroup of the tests with many tiles.
const NARROW: u32 = 128;

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    scans(bench)?;
    sorts(bench)
}

/// Elements that differ, missing ones included.
fn wrong(got: &[u32], expected: &[u32]) -> f64 {
    let differ = got.iter().zip(expected).filter(|(a, b)| a != b).count();
    (differ + got.len().abs_diff(expected.len())) as f64
}

/// Notes that the kernels reported no error, and that suspended tiles were stood in for.
fn check_report(bench: &mut Bench<'_>, what: &str, report: Report, suspended: u32) {
    bench.check(format!("{what}: error bits"), report.errors.into(), 0.0, 0.0, ERRORS);
    if suspended > 0 {
        let stood_in = report.fallbacks.min(suspended);
        bench.check(format!("{what}: suspended tiles stood in for"), stood_in.into(), suspended.into(), 0.0, SUSPENDED);
    }
}

fn scans(bench: &mut Bench<'_>) -> Result<()> {
    let ctx = bench.ctx;
    let tuned = Tuning::of(ctx).scan;
    // Withheld tiles make later ones compute them; with 100 full tiles, all withheld ones have a successor.
    let suspended =
        ScanConfig { workgroup: NARROW, vectors: 1, blocked: false, withhold: 3, carry: Carry::LookBack, ..tuned };
    let tile = Scan::new(ctx, tuned)?.tile() as usize;
    let lane = ctx.device_info().subgroup_size as usize;
    let awkward = [1, lane + 1, 257, tile - 1, tile, tile + 1, 3 * tile + 5, 1_000_003];
    for (name, config, sizes, withheld) in [
        ("scan", tuned, &awkward[..], 0),
        ("inclusive scan", ScanConfig { inclusive: true, ..tuned }, &awkward[3..], 0),
        ("scan with every third tile suspended", suspended, &[4 * NARROW as usize * 100 + 5], 100u32.div_ceil(3)),
    ] {
        let scan = Scan::new(ctx, config)?;
        let most = sizes.iter().copied().max().unwrap_or(0);
        let scratch = scan.scratch(ctx, most as u32)?;
        let items: Vec<u32> = bench.words(1000, most).collect();
        for &n in sizes {
            let input = ctx.upload("items", &items[..n])?;
            let output = ctx.upload("sums", &vec![u32::MAX; n])?;
            let mut rec = Recorder::new(ctx)?;
            scratch.diagnostics().clear(&mut rec);
            scan.record(&mut rec, &input, &output, Count::Host(n as u32), &scratch);
            rec.submit_and_wait()?;
            let expected =
                if config.inclusive { cpu::scan::inclusive(&items[..n]) } else { cpu::scan::exclusive(&items[..n]) };
            let what = format!("{name}, {n} items");
            bench.check(format!("{what}: wrong sums"), wrong(&ctx.read_back(&output)?, &expected), 0.0, 0.0, EXACT);
            check_report(bench, &what, scratch.diagnostics().read(ctx)?, withheld);
        }
    }
    Ok(())
}

/// Payloads are the pairs' indices: their order proves that the sort is stable and that no pair is lost.
fn sorts(bench: &mut Bench<'_>) -> Result<()> {
    let ctx = bench.ctx;
    let tuned = Tuning::of(ctx).sort;
    let (workgroup, keys) = if tuned.blocked { (None, 4) } else { (Some(NARROW), 1) };
    let suspended = RadixSortConfig { workgroup, keys, withhold: 3, carry: Carry::LookBack, ..tuned };
    let usual = RadixSort::new(ctx, tuned)?;
    let tile = usual.tile() as usize;
    let held_up = RadixSort::new(ctx, suspended)?;
    let few = held_up.tile() as usize * 60 + 5;
    let lane = ctx.device_info().subgroup_size as usize;
    let all = 0..32u32;
    // Keys of few values are where an unstable sort shows.
    let many = u32::MAX;
    for (name, sort, n, bits, keep, withheld) in [
        ("radix sort", &usual, 1, all.clone(), many, 0),
        ("radix sort", &usual, lane + 1, all.clone(), many, 0),
        ("radix sort", &usual, tile - 1, all.clone(), many, 0),
        ("radix sort", &usual, tile, all.clone(), many, 0),
        ("radix sort", &usual, tile + 1, all.clone(), many, 0),
        ("radix sort", &usual, 300_007, all.clone(), many, 0),
        ("radix sort, 4 keys", &usual, 100_003, all.clone(), 0x0100_0001, 0),
        ("radix sort, one key", &usual, 50_021, all, 0, 0),
        ("radix sort, bits 5 to 16", &usual, 65_537, 5..17, many, 0),
        // In both passes.
        ("radix sort with every third tile suspended", &held_up, few, 4..20, many, 2 * 60 / 3),
    ] {
        let scratch = sort.scratch(ctx, n as u32)?;
        let keys: Vec<u32> = bench.words(2000, n).map(|word| word & keep).collect();
        let indices: Vec<u32> = (0..n as u32).collect();
        let (key_buffer, payloads) = (ctx.upload("keys", &keys)?, ctx.upload("payloads", &indices)?);
        let mut rec = Recorder::new(ctx)?;
        scratch.diagnostics().clear(&mut rec);
        let sorted = sort.record(&mut rec, &key_buffer, &payloads, Count::Host(n as u32), bits.clone(), &scratch);
        rec.submit_and_wait()?;
        let (by_key, by_payload) = cpu::radix_sort::sort_pairs(&keys, &indices, bits.start, bits.end);
        let misplaced = wrong(&ctx.read_back_range(sorted.payloads, 0..n)?, &by_payload)
            + wrong(&ctx.read_back_range(sorted.keys, 0..n)?, &by_key);
        let what = format!("{name}, {n} pairs");
        bench.check(format!("{what}: misplaced keys and payloads"), misplaced, 0.0, 0.0, EXACT);
        check_report(bench, &what, scratch.diagnostics().read(ctx)?, withheld);
    }
    Ok(())
}
