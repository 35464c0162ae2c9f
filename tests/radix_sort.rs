//! The radix sort against its CPU twin. Every payload is the pair's original index, so one exact comparison proves
//! order, pairing, stability, and that no pair was lost or doubled. `scripts/test` repeats all of it at several
//! subgroup sizes and thread counts.

mod common;
#[path = "common/data.rs"]
mod data;

use common::{gpu_test, tiles_in_order_test};
use data::{Random, assert_same};
use std::ops::Range;
use tyndall::cpu;
use tyndall::passes::lookback::{Carry, Count, MAX_ITEMS, Report};
use tyndall::passes::radix_sort::{KeyKind, RadixSort, RadixSortConfig, RadixSortScratch};
use tyndall::passes::tuning::Tuning;
use tyndall::vk::{Context, Recorder, Validation};

/// Many tiles (of 128 pairs) for little work.
const SMALL_TILES: RadixSortConfig = RadixSortConfig {
    workgroup: Some(128),
    keys: 1,
    blocked: false,
    rounds: 1,
    payloads: true,
    kind: KeyKind::U32,
    descending: false,
    ends_amid: false,
    carry: Carry::LookBack,
    spin_limit: 64,
    withhold: 0,
    mask_rows: 0,
    ahead: 1,
    histogram_workgroup: 128,
};

/// The same where every invocation has a run (of one vector; a workgroup is a subgroup).
const SMALL_RUNS: RadixSortConfig = RadixSortConfig { workgroup: None, keys: 4, blocked: true, ..SMALL_TILES };

/// Both, with the pairs of a tile.
fn small_tiles(ctx: &Context) -> [(RadixSortConfig, usize); 2] {
    [(SMALL_TILES, 128), (SMALL_RUNS, 4 * ctx.max_subgroup_size() as usize)]
}

/// What this device gets, and what the others get: rows of a subgroup on GPUs, runs on processors.
fn both_kinds(ctx: &Context) -> [RadixSortConfig; 2] {
    let tuned = Tuning::of(ctx).sort;
    let portable = Tuning::portable().sort;
    let other = if tuned.blocked { portable } else { RadixSortConfig { keys: 1016, blocked: true, ..portable } };
    [tuned, other]
}

fn indices(n: usize) -> Vec<u32> {
    (0..n as u32).collect()
}

/// Sorts and compares with the twin. One more pair than the count lies behind the others and must stay.
fn check(
    ctx: &Context,
    sort: &RadixSort,
    scratch: &RadixSortScratch,
    bits: Range<u32>,
    keys: &[u32],
    case: &str,
) -> Report {
    let n = keys.len();
    let case = format!("{case}: {n} pairs by bits {bits:?}");
    let guarded = |data: &[u32]| [data, &[0xDEAD_BEEF]].concat();
    let key_buffer = ctx.upload("keys", &guarded(keys)).unwrap();
    let payload_buffer = ctx.upload("payloads", &guarded(&indices(n))).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    scratch.diagnostics().clear(&mut rec);
    let sorted = sort.record(&mut rec, &key_buffer, &payload_buffer, Count::Host(n as u32), bits.clone(), scratch);
    rec.submit_and_wait().unwrap();
    let (expected_keys, expected_payloads) = cpu::radix_sort::sort_pairs(keys, &indices(n), bits.start, bits.end);
    assert_same(&format!("{case}, payloads"), &ctx.read_back_range(sorted.payloads, 0..n).unwrap(), &expected_payloads);
    assert_same(&format!("{case}, keys"), &ctx.read_back_range(sorted.keys, 0..n).unwrap(), &expected_keys);
    for buffer in [&key_buffer, &payload_buffer] {
        assert_eq!(ctx.read_back_range(buffer, n..n + 1).unwrap(), [0xDEAD_BEEF], "{case}: beyond '{}'", buffer.name());
    }
    scratch.diagnostics().check(ctx, "radix sort").unwrap()
}

/// The ways in which counts get from tile to tile: all sort as the twin does, hence alike.
const CARRIES: [Carry; 2] = [Carry::LookBack, Carry::Dispatches];

fn check_sizes(ctx: &Context, config: RadixSortConfig, bits: Range<u32>, sizes: &[usize]) {
    for carry in CARRIES {
        check_sizes_by(ctx, RadixSortConfig { carry, ..config }, bits.clone(), sizes);
    }
}

fn check_sizes_by(ctx: &Context, config: RadixSortConfig, bits: Range<u32>, sizes: &[usize]) {
    let most = *sizes.iter().max().unwrap();
    check_keys_by(ctx, config, bits, &Random(1).words(most), sizes);
}

/// The first so many of `keys`.
fn check_keys_by(ctx: &Context, config: RadixSortConfig, bits: Range<u32>, keys: &[u32], sizes: &[usize]) {
    let sort = RadixSort::new(ctx, config).unwrap();
    let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
    for &n in sizes {
        let report = check(ctx, &sort, &scratch, bits.clone(), &keys[..n], &format!("{config:?}"));
        if config.carry == Carry::Dispatches {
            assert_eq!((report.spins, report.fallbacks), (0, 0), "{config:?}, {n} pairs");
        }
    }
}

#[test]
fn exact_around_every_boundary() {
    gpu_test(|ctx| {
        let s = ctx.device_info().subgroup_size as usize;
        for config in both_kinds(ctx) {
            let tile = RadixSort::new(ctx, config).unwrap().tile() as usize;
            let mut sizes = vec![0, 1, 2, 3, s - 1, s, s + 1, 255, 256, 257, tile - 1, tile, tile + 1];
            sizes.extend([2 * tile - 1, 2 * tile, 2 * tile + 1, 32_767, 32_768, 32_769, 65_537]);
            check_sizes(ctx, config, 0..32, &sizes);
        }
    });
}

#[test]
fn exact_at_a_million() {
    gpu_test(|ctx| both_kinds(ctx).iter().for_each(|&config| check_sizes(ctx, config, 0..32, &[1_000_003])));
}

#[test]
fn exact_with_more_tiles_than_a_step_of_the_column_scan() {
    gpu_test(|ctx| {
        // And more keys than one step of the histogram's workgroups.
        let config = RadixSortConfig { carry: Carry::Dispatches, histogram_workgroup: 64, ..SMALL_TILES };
        check_sizes_by(ctx, config, 0..8, &[128 * 4100 + 3]);
    });
}

#[test]
fn exact_at_every_size_between_one_and_two_tiles() {
    gpu_test(|ctx| {
        for (config, tile) in small_tiles(ctx) {
            check_sizes(ctx, config, 0..16, &(tile..=2 * tile).collect::<Vec<_>>());
        }
    });
}

#[test]
fn exact_in_every_shape_and_by_all_ways_of_matching() {
    gpu_test(|ctx| {
        // GPU-assisted validation makes pipelines of long unrolled loops take minutes, and shapes change no address.
        let shapes = [(128, 3), (64, 15), (128, 32), (96, 5), (128, 15)];
        let shapes = if ctx.validation() == Validation::GpuAssisted { &shapes[..1] } else { &shapes };
        let random_words = Random(2).words(20_021);
        for &(workgroup, keys) in shapes {
            for (mask_rows, ahead, rounds) in [(0, 1, 1), (0, 4, 2), (2, 3, 3), (32, 1, 1)] {
                let config = RadixSortConfig {
                    // Masks of more subgroups of 4 do not fit the shared memory.
                    workgroup: Some(if mask_rows > 0 { 64 } else { workgroup }),
                    keys,
                    rounds,
                    mask_rows,
                    ahead,
                    ..Default::default()
                };
                check_sizes(ctx, config, 0..32, &[1, 1_000, 20_021]);
                if mask_rows > 0 {
                    // No digit of random keys is frequent. Here one is in the first pass, none is in the second and third, and all keys
                    // share that of the fourth.
                    let keys: Vec<u32> =
                        random_words.iter().map(|w| if w % 5 == 0 { w % 0xFF_FFFF } else { *w & 0xFF_FF00 }).collect();
                    check_keys_by(ctx, config, 0..32, &keys, &[1_000, 20_021]);
                }
            }
        }
        for keys in if ctx.validation() == Validation::GpuAssisted { vec![8] } else { vec![4, 20, 516, 2048] } {
            for ahead in [1, 3] {
                let config = RadixSortConfig { keys, ahead, ..SMALL_RUNS };
                check_sizes(ctx, config, 0..32, &[1, 1_000, 20_021]);
            }
        }
    });
}

/// The key patterns that have broken radix sorts.
fn patterns(n: usize, tile: usize) -> Vec<(String, Vec<u32>)> {
    let mut random = Random(6);
    let mut all: Vec<(String, Vec<u32>)> = Vec::new();
    let mut add = |name: &str, keys: Vec<u32>| all.push((name.to_owned(), keys));
    // The AND of k random words has ever fewer ones: entropy 1, 0.811, 0.544, 0.337, 0.201 bits per bit.
    for k in 1..=5 {
        add(&format!("AND of {k}"), (0..n).map(|_| (0..k).fold(!0, |key, _| key & random.word())).collect());
    }
    for key in [0, 0x8000_0000, 0x1234_5678, u32::MAX] {
        add(&format!("all {key:#x}"), vec![key; n]);
    }
    add("two values", (0..n).map(|_| if random.word() & 1 == 0 { 5 } else { 0xFFFF_FFFE }).collect());
    add("sorted", (0..n as u32).map(|i| i * 1_000).collect());
    add("reversed", (0..n as u32).rev().map(|i| i * 1_000).collect());
    for digit in 0..4 {
        let shift = 8 * digit;
        let keys = (0..n).map(|_| 0x5A5A_5A5A & !(0xFF << shift) | (random.word() & 0xFF) << shift).collect();
        add(&format!("only digit {digit} varies"), keys);
    }
    add("organ pipe", (0..n).map(|i| i.min(n - 1 - i) as u32).collect());
    add("sawtooth", (0..n as u32).map(|i| i % 256).collect());
    add("a value per tile", (0..n).map(|i| (i / tile) as u32 ^ 1).collect());
    let mut odd = vec![7; n];
    odd[n / 2] = 3;
    add("one smaller", odd.clone());
    odd[n / 2] = u32::MAX;
    add("one larger", odd);
    all
}

#[test]
fn exact_for_every_pattern_of_keys() {
    gpu_test(|ctx| {
        for (carry, config) in CARRIES.into_iter().flat_map(|carry| both_kinds(ctx).map(|config| (carry, config))) {
            let sort = RadixSort::new(ctx, RadixSortConfig { carry, ..config }).unwrap();
            let n = 3 * sort.tile() as usize + 77;
            let scratch = sort.scratch(ctx, n as u32).unwrap();
            for (name, keys) in patterns(n, sort.tile() as usize) {
                check(ctx, &sort, &scratch, 0..32, &keys, &format!("{name}, {config:?}, {carry:?}"));
            }
        }
    });
}

#[test]
fn every_kind_of_key_in_both_orders_with_and_without_payloads() {
    gpu_test(|ctx| {
        let n = 20_021; // and no whole number of vectors
        let mut random = Random(15);
        // Every key several times over, so that an unstable sort shows; and the ends of the order of floats.
        let few = random.words(n / 3);
        let mut keys: Vec<u32> = (0..n).map(|_| few[random.word() as usize % few.len()]).collect();
        let ends = [0, 1, 0x7F80_0000, 0x7F80_0001, 0x7FFF_FFFF, 0x8000_0000, 0xFF80_0000, 0xFFC0_0000, u32::MAX];
        keys[..ends.len()].copy_from_slice(&ends);
        // GPU-assisted validation takes its time for long unrolled loops.
        let is_slow = ctx.validation() == Validation::GpuAssisted;
        let shapes =
            both_kinds(ctx).map(|config| RadixSortConfig { keys: if is_slow { 4 } else { config.keys }, ..config });
        let kinds = [KeyKind::F32, KeyKind::I32, KeyKind::U32];
        for (config, kind, descending) in shapes
            .into_iter()
            .flat_map(|config| kinds.iter().take(if is_slow { 1 } else { 3 }).map(move |&kind| (config, kind)))
            .flat_map(|(config, kind)| [true, false].map(|descending| (config, kind, descending)))
        {
            let images: Vec<u32> =
                keys.iter().map(|&key| cpu::radix_sort::image_of_key(key, kind.code(), descending)).collect();
            let (_, by_payload) = cpu::radix_sort::sort_pairs(&images, &indices(n), 0, 32);
            let expected: Vec<u32> = by_payload.iter().map(|&i| keys[i as usize]).collect();
            for payloads in [true, false] {
                let config = RadixSortConfig { kind, descending, payloads, ends_amid: true, ..config };
                let sort = RadixSort::new(ctx, config).unwrap();
                let scratch = sort.scratch(ctx, n as u32).unwrap();
                let (key_buffer, payload_buffer) =
                    (ctx.upload("keys", &keys).unwrap(), ctx.upload("payloads", &indices(n)).unwrap());
                let mut rec = Recorder::new(ctx).unwrap();
                scratch.diagnostics().clear(&mut rec);
                let count = Count::Host(n as u32);
                let (sorted, carried) = if payloads {
                    let sorted = sort.record(&mut rec, &key_buffer, &payload_buffer, count, 0..32, &scratch);
                    (sorted.keys, Some(sorted.payloads))
                } else {
                    (sort.record_keys(&mut rec, &key_buffer, count, 0..32, &scratch), None)
                };
                rec.submit_and_wait().unwrap();
                scratch.diagnostics().check(ctx, "radix sort").unwrap();
                assert_same(&format!("{config:?}, keys"), &ctx.read_back(sorted).unwrap(), &expected);
                if let Some(carried) = carried {
                    assert_same(&format!("{config:?}, payloads"), &ctx.read_back(carried).unwrap(), &by_payload);
                }
            }
        }
    });
}

#[test]
fn a_digit_that_all_keys_share_is_passed_by_without_look_back() {
    gpu_test(|ctx| {
        for (config, tile) in small_tiles(ctx) {
            // Tiles that never publish: whoever looks back must count them.
            let sort = RadixSort::new(ctx, RadixSortConfig { withhold: 1, ..config }).unwrap();
            let mut random = Random(12);
            let n = tile * 20 + 7;
            let scratch = sort.scratch(ctx, n as u32).unwrap();
            let report = check(ctx, &sort, &scratch, 0..32, &vec![0x1234_5678; n], "one key");
            assert_eq!((report.fallbacks, report.spins), (0, 0));
            let first = check(ctx, &sort, &scratch, 0..8, &random.words(n), "random").fallbacks;
            let keys: Vec<u32> = (0..n).map(|_| 0x1234_0078 | (random.word() & 0xFF00)).collect();
            let report = check(ctx, &sort, &scratch, 0..32, &keys, "one digit");
            assert!(report.fallbacks >= 20 && report.fallbacks < 2 * first, "{report:?} where a pass has {first}");
        }
    });
}

#[test]
fn any_window_of_bits_any_number_of_passes() {
    gpu_test(|ctx| {
        for carry in CARRIES {
            let sort = RadixSort::new(ctx, RadixSortConfig { carry, ..Tuning::of(ctx).sort }).unwrap();
            let keys = Random(7).words(sort.tile() as usize + 3_001);
            let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
            let windows = [
                0..0,
                7..7,
                32..32,
                0..1,
                3..4,
                31..32,
                0..8,
                24..32,
                0..9,
                0..16,
                5..17,
                8..24,
                4..28,
                0..24,
                1..31,
                0..31,
            ];
            for bits in windows {
                check(ctx, &sort, &scratch, bits, &keys, "random");
            }
        }
    });
}

#[test]
fn the_count_may_come_from_the_gpu() {
    gpu_test(|ctx| {
        let capacity = 40_000;
        let keys = Random(8).words(capacity);
        for (carry, config) in CARRIES.into_iter().flat_map(|carry| both_kinds(ctx).map(|config| (carry, config))) {
            let sort = RadixSort::new(ctx, RadixSortConfig { carry, ..config }).unwrap();
            let tile = sort.tile() as usize;
            let scratch = sort.scratch(ctx, capacity as u32).unwrap();
            let sort_counted = |n: u32| {
                let counts = ctx.upload("counts", &[7, n]).unwrap();
                let key_buffer = ctx.upload("keys", &keys).unwrap();
                let payload_buffer = ctx.upload("payloads", &indices(capacity)).unwrap();
                let mut rec = Recorder::new(ctx).unwrap();
                scratch.diagnostics().clear(&mut rec);
                let count = Count::Gpu { buffer: &counts, offset: 1 };
                let sorted = sort.record(&mut rec, &key_buffer, &payload_buffer, count, 0..16, &scratch);
                rec.submit_and_wait().unwrap();
                let report = scratch.diagnostics().check(ctx, "radix sort");
                (ctx.read_back(sorted.keys).unwrap(), ctx.read_back(sorted.payloads).unwrap(), report)
            };
            for n in [0, 1, tile - 1, tile, tile + 1, 32_768, 32_769, capacity - 1, capacity] {
                let (sorted_keys, sorted_payloads, report) = sort_counted(n as u32);
                report.unwrap();
                let (mut expected_keys, mut expected_payloads) =
                    cpu::radix_sort::sort_pairs(&keys[..n], &indices(n), 0, 16);
                // The rest stays as it was: two passes end in place.
                expected_keys.extend(&keys[n..]);
                expected_payloads.extend(n as u32..capacity as u32);
                assert_same(&format!("{n} on the GPU, payloads"), &sorted_payloads, &expected_payloads);
                assert_same(&format!("{n} on the GPU, keys"), &sorted_keys, &expected_keys);
            }
            for n in [capacity as u32 + 1, u32::MAX] {
                let error = sort_counted(n).2.unwrap_err().to_string();
                assert!(error.contains("'radix sort'") && error.contains("capacity"), "{error}");
            }
            sort_counted(5).2.expect("a cleared error is gone");
        }
    });
}

#[test]
fn a_count_on_the_gpu_may_take_the_histogram_several_steps() {
    gpu_test(|ctx| {
        // In one step of its 256 workgroups it takes 2^18 keys; with a workgroup of runs 2^15 at most, of up to 64 lanes.
        let keys = Random(14).words((1 << 19) + 3);
        let sizes = [1000, (1 << 15) - 1, (1 << 15) + 1, (1 << 18) - 1, (1 << 18) + 1, keys.len()];
        let made = both_kinds(ctx).map(|config| {
            let sort = RadixSort::new(ctx, RadixSortConfig { histogram_workgroup: 64, ..config }).unwrap();
            let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
            (sort, scratch)
        });
        for ((sort, scratch), n) in made.iter().flat_map(|made| sizes.map(|n| (made, n))) {
            let counts = ctx.upload("counts", &[n as u32]).unwrap();
            let (key_buffer, payloads) =
                (ctx.upload("keys", &keys).unwrap(), ctx.upload("payloads", &indices(keys.len())).unwrap());
            let mut rec = Recorder::new(ctx).unwrap();
            let count = Count::Gpu { buffer: &counts, offset: 0 };
            let sorted = sort.record(&mut rec, &key_buffer, &payloads, count, 20..32, scratch);
            rec.submit_and_wait().unwrap();
            scratch.diagnostics().check(ctx, "radix sort").unwrap();
            let (_, expected) = cpu::radix_sort::sort_pairs(&keys[..n], &indices(n), 20, 32);
            assert_same(&format!("{n} on the GPU"), &ctx.read_back_range(sorted.payloads, 0..n).unwrap(), &expected);
        }
    });
}

#[test]
fn tiles_in_order_find_what_they_wait_for() {
    // Then nothing that was published is missing.
    tiles_in_order_test(|ctx| {
        for (config, _) in small_tiles(ctx) {
            let sort = RadixSort::new(ctx, config).unwrap();
            let scratch = sort.scratch(ctx, 10_000).unwrap();
            let report = check(ctx, &sort, &scratch, 0..32, &Random(13).words(10_000), "in order");
            assert_eq!((report.spins, report.fallbacks), (0, 0));
        }
    });
}

#[test]
fn a_suspended_tile_is_counted_by_those_that_need_it() {
    gpu_test(|ctx| {
        let random_words = Random(9).words(256 * 60 + 5);
        for ((small, tile), withhold) in
            small_tiles(ctx).into_iter().flat_map(|small| [1, 2, 5, 30].map(|withhold| (small, withhold)))
        {
            let keys = &random_words[..tile * 60 + 5];
            for spin_limit in [0, 1, 64] {
                let config = RadixSortConfig { withhold, spin_limit, ..small };
                let sort = RadixSort::new(ctx, config).unwrap();
                let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
                let report = check(ctx, &sort, &scratch, 4..20, keys, &format!("{config:?}"));
                // In both passes, all withheld tiles but the last one, which nobody needs.
                assert!(report.fallbacks >= 2 * 60u32.div_ceil(withhold), "{config:?}: {report:?}");
                assert!(report.spins >= report.fallbacks, "{config:?}: {report:?}");
            }
        }
    });
}

#[test]
fn without_look_back_no_tile_waits_for_what_is_withheld() {
    gpu_test(|ctx| {
        // With look-back the first of these counts every tile anew, and the second is an error.
        for (withhold, spin_limit) in [(1, 0), (1, u32::MAX), (2, u32::MAX), (5, 64)] {
            for (small, tile) in small_tiles(ctx) {
                let config = RadixSortConfig { carry: Carry::Dispatches, withhold, spin_limit, ..small };
                check_sizes_by(ctx, config, 4..20, &[1, tile * 6, tile * 60 + 5]);
            }
        }
    });
}

#[test]
fn an_exhausted_budget_is_an_error_and_no_pair_is_misplaced() {
    gpu_test(|ctx| small_tiles(ctx).into_iter().for_each(|(small, tile)| budget_test(ctx, small, tile)));
}

fn budget_test(ctx: &Context, small: RadixSortConfig, tile: usize) {
    let keys = Random(10).words(tile * 6);
    let sort = RadixSort::new(ctx, RadixSortConfig { withhold: 2, spin_limit: u32::MAX, ..small }).unwrap();
    let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
    let key_buffer = ctx.upload("keys", &keys).unwrap();
    let count = Count::Host(keys.len() as u32);
    // A sort that works leaves marks where the result will be: one pass ends in the scratch memory.
    let marks = ctx.upload("payloads", &vec![u32::MAX; keys.len()]).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    RadixSort::new(ctx, small).unwrap().record(&mut rec, &key_buffer, &marks, count, 0..8, &scratch);
    rec.submit_and_wait().unwrap();
    let payload_buffer = ctx.upload("payloads", &indices(keys.len())).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    let sorted = sort.record(&mut rec, &key_buffer, &payload_buffer, count, 0..8, &scratch);
    rec.submit_and_wait().unwrap();
    let error = scratch.diagnostics().check(ctx, "radix sort").unwrap_err().to_string();
    assert!(error.contains("'radix sort'") && error.contains("loop budget"), "{error}");
    let payloads = ctx.read_back(sorted.payloads).unwrap();
    let (_, expected) = cpu::radix_sort::sort_pairs(&keys, &indices(keys.len()), 0, 8);
    assert!(payloads.iter().zip(&expected).all(|(&got, &right)| got == right || got == u32::MAX));
    assert_eq!(payloads.iter().filter(|&&got| got != u32::MAX).count(), tile, "tile 0 alone needs nobody");
}

#[test]
fn memory_is_reused_within_and_across_submissions() {
    gpu_test(|ctx| {
        for carry in CARRIES {
            let sort = RadixSort::new(ctx, RadixSortConfig { carry, ..Tuning::of(ctx).sort }).unwrap();
            let scratch = sort.scratch(ctx, 100_000).unwrap();
            let mut random = Random(11);
            for n in [100_000, 1, 257, 100_000, 0, 4_000, 3] {
                check(ctx, &sort, &scratch, 0..24, &random.words(n), "reused");
            }
            // Three sorts in a row in one command buffer, two of them with the same memory.
            let other = sort.scratch(ctx, 50_000).unwrap();
            let lists: Vec<Vec<u32>> = [50_000, 50_000, 12_345].iter().map(|&n| random.words(n)).collect();
            let buffers: Vec<_> = lists
                .iter()
                .map(|keys| (ctx.upload("keys", keys).unwrap(), ctx.upload("payloads", &indices(keys.len())).unwrap()))
                .collect();
            let mut rec = Recorder::new(ctx).unwrap();
            let sorted: Vec<_> = buffers
                .iter()
                .zip([&scratch, &other, &scratch])
                .map(|((keys, payloads), scratch)| {
                    sort.record(&mut rec, keys, payloads, Count::Host(keys.len() as u32), 0..32, scratch)
                })
                .collect();
            rec.submit_and_wait().unwrap();
            for (keys, sorted) in lists.iter().zip(sorted) {
                let (_, expected) = cpu::radix_sort::sort_pairs(keys, &indices(keys.len()), 0, 32);
                assert_same("in a row", &ctx.read_back(sorted.payloads).unwrap(), &expected);
            }
        }
    });
}

#[test]
fn too_large_a_capacity_is_refused_before_anything_is_allocated() {
    gpu_test(|ctx| {
        let sort = RadixSort::new(ctx, Tuning::of(ctx).sort).unwrap();
        let before = ctx.peak_bytes();
        let error = sort.scratch(ctx, MAX_ITEMS + 1).err().expect("refused").to_string();
        assert!(error.contains("1073741824 items"), "{error}");
        assert_eq!(ctx.peak_bytes(), before);
    });
}

#[test]
#[ignore = "long: the largest buffers that lavapipe binds"]
fn exact_at_the_largest_sizes() {
    gpu_test(|ctx| {
        let most = (ctx.max_storage_bytes() / 4).min(1 << 28) as usize;
        check_sizes(ctx, Tuning::of(ctx).sort, 0..32, &[(1 << 24) - 1, 1 << 24, (1 << 24) + 1, most - 1]);
    });
}

#[test]
#[ignore = "long: every size in one sweep of the default tile"]
fn exact_at_every_size_between_one_and_two_default_tiles() {
    gpu_test(|ctx| {
        let tile = RadixSort::new(ctx, Tuning::of(ctx).sort).unwrap().tile() as usize;
        check_sizes(ctx, Tuning::of(ctx).sort, 0..32, &(tile..=2 * tile).collect::<Vec<_>>());
    });
}
