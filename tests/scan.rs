//! The scan against its CPU twin: sizes around every boundary, full 32-bit sums, counts on the GPU, forced fallback,
//! exhausted budget, reused memory. `scripts/test` repeats all of it at several subgroup sizes and thread counts.

mod common;
#[path = "common/data.rs"]
mod data;

use common::{gpu_test, tiles_in_order_test};
use data::{Random, assert_same};
use tyndall::cpu;
use tyndall::passes::lookback::{Carry, Count, MAX_ITEMS, Report};
use tyndall::passes::scan::{Scan, ScanConfig, ScanScratch};
use tyndall::passes::tuning::Tuning;
use tyndall::vk::{Context, Recorder, Validation};

/// What the output holds before, to show stores where none may be.
const SENTINEL: u32 = 0xDEAD_BEEF;

/// Items of [`SMALL_TILES`].
const SMALL: usize = 256;
/// Many tiles for little work.
const SMALL_TILES: ScanConfig = ScanConfig {
    inclusive: false,
    total: false,
    ends_amid: false,
    workgroup: 64,
    vectors: 1,
    blocked: false,
    carry: Carry::LookBack,
    spin_limit: 64,
    withhold: 0,
};

/// Items of [`SMALL_RUNS`].
const SMALL_OF_RUNS: usize = 2048;
/// The same where every invocation has a run.
const SMALL_RUNS: ScanConfig = ScanConfig { vectors: 8, blocked: true, ..SMALL_TILES };

/// Scans `items` and compares with the twin. Items are random words, so that sums wrap.
fn check(ctx: &Context, scan: &Scan, scratch: &ScanScratch, config: ScanConfig, items: &[u32]) -> Report {
    let input = ctx.upload("items", items).unwrap();
    let output = ctx.upload("sums", &vec![SENTINEL; items.len() + 1]).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    scratch.diagnostics().clear(&mut rec);
    scan.record(&mut rec, &input, &output, Count::Host(items.len() as u32), scratch);
    rec.submit_and_wait().unwrap();
    let mut sums = ctx.read_back(&output).unwrap();
    assert_eq!(sums.pop(), Some(SENTINEL), "{} items: stored beyond the end", items.len());
    let expected = if config.inclusive { cpu::scan::inclusive(items) } else { cpu::scan::exclusive(items) };
    assert_same(&format!("{} items, {config:?}", items.len()), &sums, &expected);
    let report = scratch.diagnostics().check(ctx, "scan").unwrap();
    if config.carry == Carry::Dispatches {
        assert_eq!((report.spins, report.fallbacks), (0, 0), "{} items, {config:?}", items.len());
    }
    report
}

/// The ways in which sums get from tile to tile: all give the twin's, hence the same.
const CARRIES: [Carry; 2] = [Carry::LookBack, Carry::Dispatches];

fn check_sizes(ctx: &Context, config: ScanConfig, sizes: &[usize]) {
    for carry in CARRIES {
        check_sizes_by(ctx, ScanConfig { carry, ..config }, sizes);
    }
}

fn check_sizes_by(ctx: &Context, config: ScanConfig, sizes: &[usize]) {
    let scan = Scan::new(ctx, config).unwrap();
    let scratch = scan.scratch(ctx, *sizes.iter().max().unwrap() as u32).unwrap();
    let items = Random(1).words(*sizes.iter().max().unwrap());
    for &n in sizes {
        check(ctx, &scan, &scratch, config, &items[..n]);
    }
}

#[test]
fn exact_around_every_boundary() {
    gpu_test(|ctx| {
        let s = ctx.device_info().subgroup_size as usize;
        let config = Tuning::of(ctx).scan;
        let tile = Scan::new(ctx, config).unwrap().tile() as usize;
        let mut sizes = vec![0, 1, 2, 3, s - 1, s, s + 1, 255, 256, 257, tile - 1, tile, tile + 1];
        sizes.extend([2 * tile - 1, 2 * tile, 2 * tile + 1, 65_535, 65_536, 65_537, 1_000_003]);
        check_sizes(ctx, config, &sizes);
    });
}

#[test]
fn exact_at_every_size_between_one_and_two_tiles() {
    gpu_test(|ctx| {
        check_sizes(ctx, SMALL_TILES, &(SMALL..=2 * SMALL).collect::<Vec<_>>());
        // Every place of the end among a lane's vectors, and one more lane.
        check_sizes(ctx, SMALL_RUNS, &(SMALL_OF_RUNS..=SMALL_OF_RUNS + 34).collect::<Vec<_>>());
    });
}

#[test]
fn exact_in_every_shape() {
    gpu_test(|ctx| {
        // GPU-assisted validation makes pipelines of long unrolled loops take minutes, and shapes change no address.
        let shapes = [
            (256, 1, false),
            (128, 3, false),
            (128, 8, true),
            (64, 32, false),
            (128, 4, false),
            (512, 2, false),
            (64, 256, true),
        ];
        let shapes = if ctx.validation() == Validation::GpuAssisted { &shapes[..3] } else { &shapes };
        for &(workgroup, vectors, blocked) in shapes {
            for inclusive in [false, true] {
                let config = ScanConfig { inclusive, workgroup, vectors, blocked, ..ScanConfig::default() };
                check_sizes(ctx, config, &[1, 1_000, 50_021]);
            }
        }
    });
}

#[test]
fn more_workgroups_than_one_axis_holds() {
    gpu_test(|ctx| check_sizes(ctx, SMALL_TILES, &[SMALL * 65_535, SMALL * 65_536 + 1]));
}

#[test]
#[ignore = "long: the largest buffers that lavapipe binds"]
fn exact_at_the_largest_sizes() {
    gpu_test(|ctx| {
        let most = (ctx.max_storage_bytes() / 4).min(1 << 28) as usize;
        check_sizes(ctx, Tuning::of(ctx).scan, &[(1 << 24) - 1, 1 << 24, (1 << 24) + 1, most - 2, most - 1]);
    });
}

#[test]
#[ignore = "long: every size in one sweep of the default tile"]
fn exact_at_every_size_between_one_and_two_default_tiles() {
    gpu_test(|ctx| check_sizes(ctx, ScanConfig::default(), &(4096..=8192).collect::<Vec<_>>()));
}

#[test]
fn tiles_in_order_find_what_they_wait_for() {
    // Then nothing that was published is missing.
    tiles_in_order_test(|ctx| {
        let scan = Scan::new(ctx, SMALL_TILES).unwrap();
        let scratch = scan.scratch(ctx, 10_000).unwrap();
        let report = check(ctx, &scan, &scratch, SMALL_TILES, &Random(13).words(10_000));
        assert_eq!((report.spins, report.fallbacks), (0, 0));
    });
}

#[test]
fn a_suspended_tile_is_computed_by_those_that_need_it() {
    gpu_test(|ctx| {
        let items = Random(2).words(SMALL * 100 + 5);
        for withhold in [1, 2, 3, 7, 50] {
            for spin_limit in [0, 1, 64] {
                let config = ScanConfig { withhold, spin_limit, ..SMALL_TILES };
                let scan = Scan::new(ctx, config).unwrap();
                let scratch = scan.scratch(ctx, items.len() as u32).unwrap();
                let report = check(ctx, &scan, &scratch, config, &items);
                // All of them but the last tile, which nobody needs.
                let withheld = 100u32.div_ceil(withhold);
                assert!(report.fallbacks >= withheld, "{config:?}: {report:?}");
                assert!(report.spins >= withheld * (spin_limit + 1), "{config:?}: {report:?}");
            }
        }
        let config = ScanConfig { withhold: 3, ..SMALL_RUNS };
        let items = Random(2).words(SMALL_OF_RUNS * 10 + 5);
        let scan = Scan::new(ctx, config).unwrap();
        let scratch = scan.scratch(ctx, items.len() as u32).unwrap();
        let report = check(ctx, &scan, &scratch, config, &items);
        assert!(report.fallbacks >= 10u32.div_ceil(3), "{report:?}");
    });
}

#[test]
fn without_look_back_no_tile_waits_for_what_is_withheld() {
    gpu_test(|ctx| {
        // With look-back the first of these computes every tile anew, and the second is an error.
        for (withhold, spin_limit) in [(1, 0), (1, u32::MAX), (2, u32::MAX), (7, 64)] {
            let config = ScanConfig { carry: Carry::Dispatches, withhold, spin_limit, ..SMALL_TILES };
            check_sizes_by(ctx, config, &[1, SMALL * 6, SMALL * 100 + 5]);
        }
    });
}

#[test]
fn an_exhausted_budget_is_an_error_and_no_wrong_sum() {
    gpu_test(|ctx| {
        let items = Random(3).words(SMALL * 6);
        let scan = Scan::new(ctx, ScanConfig { withhold: 2, spin_limit: u32::MAX, ..SMALL_TILES }).unwrap();
        let scratch = scan.scratch(ctx, items.len() as u32).unwrap();
        let input = ctx.upload("items", &items).unwrap();
        let output = ctx.upload("sums", &vec![SENTINEL; items.len()]).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        scan.record(&mut rec, &input, &output, Count::Host(items.len() as u32), &scratch);
        rec.submit_and_wait().unwrap();
        let error = scratch.diagnostics().check(ctx, "scan").unwrap_err().to_string();
        assert!(error.contains("'scan'") && error.contains("loop budget"), "{error}");
        let sums = ctx.read_back(&output).unwrap();
        let expected = cpu::scan::exclusive(&items);
        assert_same("tile 0", &sums[..SMALL], &expected[..SMALL]);
        assert!(sums[SMALL..].iter().all(|&sum| sum == SENTINEL));
    });
}

#[test]
fn the_count_may_come_from_the_gpu() {
    gpu_test(|ctx| {
        let capacity = 10_000usize;
        let items = Random(4).words(capacity);
        let input = ctx.upload("items", &items).unwrap();
        let expected = cpu::scan::exclusive(&items);
        for carry in CARRIES {
            let scan = Scan::new(ctx, ScanConfig { carry, ..Tuning::of(ctx).scan }).unwrap();
            let scratch = scan.scratch(ctx, capacity as u32).unwrap();
            let scan_counted = |n: u32| {
                let counts = ctx.upload("counts", &[7, 8, n]).unwrap();
                let output = ctx.upload("sums", &vec![SENTINEL; capacity]).unwrap();
                let mut rec = Recorder::new(ctx).unwrap();
                scratch.diagnostics().clear(&mut rec);
                scan.record(&mut rec, &input, &output, Count::Gpu { buffer: &counts, offset: 2 }, &scratch);
                rec.submit_and_wait().unwrap();
                (ctx.read_back(&output).unwrap(), scratch.diagnostics().check(ctx, "scan"))
            };
            for n in [0, 1, 4095, 4096, 4097, capacity - 1, capacity] {
                let (sums, report) = scan_counted(n as u32);
                report.unwrap();
                assert_same(&format!("{n} on the GPU"), &sums[..n], &expected[..n]);
                assert!(sums[n..].iter().all(|&sum| sum == SENTINEL), "{n} on the GPU: stored beyond the count");
            }
            for n in [capacity as u32 + 1, u32::MAX] {
                let (sums, report) = scan_counted(n);
                assert!(report.unwrap_err().to_string().contains("capacity"), "{n} on the GPU");
                assert_same("what there is room for", &sums, &expected);
            }
            scan_counted(5).1.expect("a cleared error is gone");
        }
    });
}

#[test]
fn memory_is_reused_within_and_across_submissions() {
    gpu_test(|ctx| {
        for carry in CARRIES {
            let config = ScanConfig { carry, ..SMALL_TILES };
            let scan = Scan::new(ctx, config).unwrap();
            let scratch = scan.scratch(ctx, 200_000).unwrap();
            let mut random = Random(5);
            for n in [200_000, 1, SMALL + 1, 200_000, 50_000, 3, SMALL] {
                check(ctx, &scan, &scratch, config, &random.words(n));
            }
            // Three scans in a row in one command buffer: of the items, of their sums, of those; and one on other memory.
            let items = random.words(150_000);
            let other = scan.scratch(ctx, 150_000).unwrap();
            let buffers: Vec<_> =
                ["a", "b", "c", "d", "e"].iter().map(|name| ctx.upload(name, &items).unwrap()).collect();
            let mut rec = Recorder::new(ctx).unwrap();
            scan.record(&mut rec, &buffers[0], &buffers[1], Count::Host(150_000), &scratch);
            scan.record(&mut rec, &buffers[1], &buffers[2], Count::Host(150_000), &scratch);
            scan.record(&mut rec, &buffers[0], &buffers[4], Count::Host(150_000), &other);
            scan.record(&mut rec, &buffers[2], &buffers[3], Count::Host(150_000), &scratch);
            rec.submit_and_wait().unwrap();
            let mut expected = items.clone();
            for buffer in &buffers[1..4] {
                expected = cpu::scan::exclusive(&expected);
                assert_same(buffer.name(), &ctx.read_back(buffer).unwrap(), &expected);
            }
            assert_same("other", &ctx.read_back(&buffers[4]).unwrap(), &cpu::scan::exclusive(&items));
        }
    });
}

#[test]
fn too_large_a_capacity_is_refused_before_anything_is_allocated() {
    gpu_test(|ctx| {
        let scan = Scan::new(ctx, Tuning::of(ctx).scan).unwrap();
        let before = ctx.peak_bytes();
        let error = scan.scratch(ctx, MAX_ITEMS + 1).err().expect("refused").to_string();
        assert!(error.contains("1073741824 items"), "{error}");
        assert_eq!(ctx.peak_bytes(), before);
    });
}
