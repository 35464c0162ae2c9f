//! `tyndall::primitives` as another program uses it: a device of its own under the validation layer, its own buffers between
//! guards and at offsets, its own command buffer. Any message of the layer fails the test. Truth is the standard library's
//! stable sort; payloads are the items' indices, so one comparison proves order, pairing and stability.

mod common;
#[path = "common/data.rs"]
mod data;
#[allow(dead_code, reason = "its main is not called")]
#[path = "../examples/sort_your_buffer.rs"]
mod sort_your_buffer;

use ash::vk::{AccessFlags2, CommandBuffer, PipelineStageFlags2, ValidationFeatureEnableEXT};
use data::{Random, assert_same};
use sort_your_buffer::own_device::{OwnBuffer, OwnDevice};
use std::cmp::Ordering;
use std::ops::Range;
use tyndall::cpu;
use tyndall::primitives::*;
use tyndall::vk::Validation;
use tyndall::{Error, Result};

/// What memory holds where nothing may be written.
const GUARD: u32 = 0xDEAD_BEEF;
/// Words before and after every array: a multiple of every device's alignment.
const GUARDS: usize = 64;

const SORTED: (PipelineStageFlags2, AccessFlags2) =
    (PipelineStageFlags2::COMPUTE_SHADER, AccessFlags2::SHADER_STORAGE_WRITE);
const HOST: (PipelineStageFlags2, AccessFlags2) = (PipelineStageFlags2::HOST, AccessFlags2::HOST_READ);
const COPIED: (PipelineStageFlags2, AccessFlags2) = (PipelineStageFlags2::COPY, AccessFlags2::TRANSFER_WRITE);

fn own_device() -> OwnDevice {
    OwnDevice::new(Some(match common::validation() {
        Validation::GpuAssisted => ValidationFeatureEnableEXT::GPU_ASSISTED,
        _ => ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION,
    }))
}

/// Runs `body` on a device that is not Tyndall's; returns what the layer and the recorder's own check say.
fn messages_of(body: impl FnOnce(&OwnDevice, &Context)) -> Vec<String> {
    let _turn = common::one_at_a_time();
    let own = own_device();
    let ctx = own.context().unwrap();
    body(&own, &ctx);
    let ours = ctx.close();
    let mut messages = own.close();
    messages.extend(ours.iter().map(|message| message.to_string()));
    messages
}

/// The same; any message fails the test.
fn own_test(body: impl FnOnce(&OwnDevice, &Context)) {
    let messages = messages_of(body);
    assert!(messages.is_empty(), "{} message(s), the first: {}", messages.len(), messages[0]);
}

/// An array of the caller's, between guards.
struct Array {
    own: OwnBuffer,
    len: usize,
}

impl Array {
    fn new(own: &OwnDevice, words: &[u32]) -> Self {
        let array = Self { own: own.buffer(words.len() + 2 * GUARDS), len: words.len() };
        array.own.write(0, &vec![GUARD; words.len() + 2 * GUARDS]);
        array.own.write(GUARDS, words);
        array
    }

    /// The array alone, but for one word where there is none: nothing of no size can be bound.
    fn part<T: bytemuck::Pod>(&self, ctx: &Context) -> Buffer<T> {
        self.own.part(ctx, 4 * GUARDS as u64, 4 * self.len.max(1) as u64).unwrap()
    }

    #[track_caller]
    fn read(&self, case: &str) -> Vec<u32> {
        let words = self.own.read();
        let (before, rest) = words.split_at(GUARDS);
        let (array, behind) = rest.split_at(self.len);
        assert!(before.iter().chain(behind).all(|&word| word == GUARD), "{case}: a guard is overwritten");
        array.to_vec()
    }
}

/// Records, submits, waits; what is written is for the host.
fn run(own: &OwnDevice, ctx: &Context, record: impl FnOnce(&mut Recording)) -> Result<Report> {
    let commands = own.begin();
    let recorded = record_into(own, ctx, commands, record);
    own.barrier(commands, SORTED, HOST);
    own.end(commands);
    own.submit_and_wait(commands);
    recorded.check()
}

fn record_into(
    own: &OwnDevice,
    ctx: &Context,
    commands: CommandBuffer,
    record: impl FnOnce(&mut Recording),
) -> Recorded {
    let mut recording = Recording::new(ctx, own.recorder(ctx, commands)).unwrap();
    record(&mut recording);
    recording.finish().unwrap()
}

/// How the keys' words compare by the type's own order.
fn compare<K: Key>(a: u32, b: u32) -> Ordering {
    let (a, b) = (bytemuck::bytes_of(&a), bytemuck::bytes_of(&b));
    match std::any::type_name::<K>() {
        "u32" => bytemuck::pod_read_unaligned::<u32>(a).cmp(&bytemuck::pod_read_unaligned(b)),
        "i32" => bytemuck::pod_read_unaligned::<i32>(a).cmp(&bytemuck::pod_read_unaligned(b)),
        _ => bytemuck::pod_read_unaligned::<f32>(a).total_cmp(&bytemuck::pod_read_unaligned(b)),
    }
}

/// Indices of the keys in the order asked for.
fn sorted_indices<K: Key>(keys: &[u32], order: Order, bits: Range<u32>) -> Vec<u32> {
    let mut indices: Vec<u32> = (0..keys.len() as u32).collect();
    let key = |i: &u32| keys[*i as usize];
    if bits == (0..32) {
        indices.sort_by(|a, b| match order {
            Order::Ascending => compare::<K>(key(a), key(b)),
            Order::Descending => compare::<K>(key(b), key(a)),
        });
    } else {
        let image = |i: &u32| cpu::radix_sort::image_of_key(key(i), K::KIND.code(), order == Order::Descending);
        let images: Vec<u32> = indices.iter().map(image).collect();
        indices = cpu::radix_sort::sort_pairs(&images, &indices, bits.start, bits.end).1;
    }
    indices
}

/// Sorts with a capacity of all keys and a count of the first `count`, and compares everything.
struct Check<'a, K> {
    own: &'a OwnDevice,
    ctx: &'a Context,
    sort: &'a Sort<K>,
    scratch: &'a SortScratch,
    order: Order,
    payloads: Payloads,
}

impl<K: Key> Check<'_, K> {
    fn run(&self, keys: &[u32], count: usize, bits: Range<u32>, in_place: bool, on_gpu: bool) {
        let Self { own, ctx, order, .. } = *self;
        let n = keys.len();
        let kind = std::any::type_name::<K>();
        let case = format!(
            "{count} of {n} {kind} {order:?} {:?} by bits {bits:?}, in place: {in_place}, count on the GPU: {on_gpu}",
            self.payloads
        );
        let indices: Vec<u32> = (0..n as u32).collect();
        let (from, payloads_from) = (Array::new(own, keys), Array::new(own, &indices));
        let unwritten = vec![0x5555_5555; n];
        let (to, payloads_to) = (Array::new(own, &unwritten), Array::new(own, &unwritten));
        let counts = Array::new(own, &[GUARD, count as u32]);
        let (key_parts, payload_parts) = ([&from, &to].map(|a| a.part::<K>(ctx)), [&payloads_from, &payloads_to]);
        let payload_parts = payload_parts.map(|a| a.part::<u32>(ctx));
        let target = if in_place { 0 } else { 1 };
        let counts_part = counts.part(ctx);
        let count_of = if on_gpu { Count::Gpu { buffer: &counts_part, offset: 1 } } else { Count::Host(count as u32) };
        let report = run(own, ctx, |recording| {
            let keys = (&key_parts[0], &key_parts[target]);
            let payloads = (&payload_parts[0], &payload_parts[target]);
            match self.payloads {
                Payloads::None => self.sort.record_keys(recording, keys, count_of, bits.clone(), self.scratch),
                Payloads::U32 => {
                    self.sort.record_pairs(recording, keys, payloads, count_of, bits.clone(), self.scratch)
                }
            }
            .unwrap();
        });
        report.unwrap();
        let expected = sorted_indices::<K>(&keys[..count], order, bits);
        let with_rest = |mut words: Vec<u32>, rest: &[u32]| {
            words.extend(&rest[count..]);
            words
        };
        let sorted_keys = expected.iter().map(|&i| keys[i as usize]).collect();
        if !in_place {
            assert_same(&format!("{case}: the source"), &from.read(&case), keys);
            assert_same(&format!("{case}: the payloads' source"), &payloads_from.read(&case), &indices);
        }
        let (got, got_payloads) = if in_place { (&from, &payloads_from) } else { (&to, &payloads_to) };
        let (rest, payloads_rest) = if in_place { (keys, &indices[..]) } else { (&unwritten[..], &unwritten[..]) };
        assert_same(&format!("{case}: keys"), &got.read(&case), &with_rest(sorted_keys, rest));
        let expected_payloads = match self.payloads {
            Payloads::U32 => with_rest(expected, payloads_rest),
            Payloads::None => payloads_rest.to_vec(),
        };
        assert_same(&format!("{case}: payloads"), &got_payloads.read(&case), &expected_payloads);
        counts.read(&case);
    }
}

/// The ways in which sums get from tile to tile: results are the same.
const CARRIES: [Carry; 2] = [Carry::LookBack, Carry::Dispatches];

/// Random keys, many of them equal, among them all that is special about floats.
fn awkward_keys(n: usize, seed: u64) -> Vec<u32> {
    let special =
        [0, 1, 0x7FFF, 0x007F_FFFF, 0x0080_0000, 0x3F80_0000, 0x7F7F_FFFF, 0x7F80_0000, 0x7F80_0001, 0x7FC0_0000];
    let special: Vec<u32> = special.iter().chain(&[0x7FFF_FFFF]).flat_map(|&w| [w, w | 0x8000_0000]).collect();
    let mut random = Random(seed);
    (0..n)
        .map(|_| match random.word() % 4 {
            0 => special[random.word() as usize % special.len()],
            1 => (random.word() % 2000) as f32 as u32,
            2 => (1.0 - (random.word() % 1000) as f32 * 1e-3).to_bits() ^ (random.word() & 0x8000_0000),
            _ => random.word(),
        })
        .collect()
}

fn check_kind<K: Key>(own: &OwnDevice, ctx: &Context) {
    for (order, carry) in [Order::Ascending, Order::Descending].into_iter().flat_map(|o| CARRIES.map(|c| (o, c))) {
        for payloads in [Payloads::None, Payloads::U32] {
            let sort = Sort::<K>::with_carry(ctx, order, payloads, carry).unwrap();
            let tile = sort.tile() as usize;
            let most = 3 * tile + 77;
            let scratch = sort.scratch(ctx, most as u32).unwrap();
            let check = Check { own, ctx, sort: &sort, scratch: &scratch, order, payloads };
            let keys = awkward_keys(most, 1);
            for n in [0, 1, 2, 3, tile - 1, tile, tile + 1, most] {
                check.run(&keys[..n], n, 0..32, n % 2 == 0, false);
            }
            check.run(&vec![0xFFFF_FFFF; tile + 5], tile + 5, 0..32, false, false);
        }
    }
}

#[test]
fn unsigned_keys_in_both_orders_are_exact_and_stable() {
    own_test(check_kind::<u32>);
}

#[test]
fn signed_keys_in_both_orders_are_exact_and_stable() {
    own_test(check_kind::<i32>);
}

#[test]
fn floats_are_in_total_order_in_both_orders_and_keep_their_bits() {
    own_test(check_kind::<f32>);
}

#[test]
fn the_ends_of_the_order_of_floats() {
    own_test(|own, ctx| {
        let floats = [f32::NAN, 0.0, -0.0, f32::NEG_INFINITY, -f32::NAN, f32::INFINITY, -1e-45, 1e-45];
        let keys = Array::new(own, &floats.map(f32::to_bits));
        let part = keys.part::<f32>(ctx);
        let sort = Sort::<f32>::new(ctx, Order::Ascending, Payloads::None).unwrap();
        let scratch = sort.scratch(ctx, 8).unwrap();
        run(own, ctx, |recording| sort.record_keys(recording, &part, Count::Host(8), 0..32, &scratch).unwrap())
            .unwrap();
        let expected = [-f32::NAN, f32::NEG_INFINITY, -1e-45, -0.0, 0.0, 1e-45, f32::INFINITY, f32::NAN];
        assert_same("the ends", &keys.read("the ends"), &expected.map(f32::to_bits));
    });
}

#[test]
fn any_window_of_bits_in_place_and_elsewhere() {
    own_test(|own, ctx| {
        let windows = [0..0, 7..7, 32..32, 0..1, 31..32, 0..8, 24..32, 0..9, 5..17, 8..32, 0..24, 1..31];
        let keys = awkward_keys(5_003, 2);
        let (order, payloads) = (Order::Descending, Payloads::U32);
        let sort = Sort::<f32>::new(ctx, order, payloads).unwrap();
        let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
        let check = Check { own, ctx, sort: &sort, scratch: &scratch, order, payloads };
        for bits in &windows {
            for in_place in [false, true] {
                check.run(&keys, keys.len(), bits.clone(), in_place, false);
            }
        }
        let (order, payloads) = (Order::Ascending, Payloads::None);
        let sort = Sort::<u32>::new(ctx, order, payloads).unwrap();
        let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
        let check = Check { own, ctx, sort: &sort, scratch: &scratch, order, payloads };
        for bits in windows {
            check.run(&keys, keys.len(), bits.clone(), bits.start % 2 == 0, false);
        }
    });
}

#[test]
fn counts_on_the_gpu_leave_what_is_beyond_them_alone() {
    own_test(|own, ctx| {
        let (order, payloads) = (Order::Descending, Payloads::U32);
        let sort = Sort::<i32>::new(ctx, order, payloads).unwrap();
        let tile = sort.tile() as usize;
        let keys = awkward_keys(2 * tile + 9, 3);
        let scratch = sort.scratch(ctx, keys.len() as u32).unwrap();
        let check = Check { own, ctx, sort: &sort, scratch: &scratch, order, payloads };
        for count in [0, 1, tile - 1, tile, tile + 1, keys.len()] {
            check.run(&keys, count, 0..32, true, true);
            check.run(&keys, count, 0..8, true, true);
            check.run(&keys, count, 4..28, false, true);
        }
    });
}

#[test]
fn a_count_beyond_the_capacity_is_an_error_after_the_work() {
    own_test(|own, ctx| {
        let keys = Array::new(own, &awkward_keys(1000, 4));
        let part = keys.part::<u32>(ctx);
        let sort = Sort::<u32>::new(ctx, Order::Ascending, Payloads::None).unwrap();
        let scratch = sort.scratch(ctx, 1000).unwrap();
        for (count, is_right) in [(1001, false), (u32::MAX, false), (1000, true)] {
            let counts = Array::new(own, &[count]);
            let counts_part = counts.part(ctx);
            let count = Count::Gpu { buffer: &counts_part, offset: 0 };
            let report = run(own, ctx, |recording| sort.record_keys(recording, &part, count, 0..32, &scratch).unwrap());
            match report {
                Ok(_) => assert!(is_right),
                Err(error) => {
                    assert!(matches!(error, Error::Device { .. }) && error.to_string().contains("capacity"), "{error}");
                    assert!(!is_right);
                }
            }
            keys.read("a count beyond the capacity");
        }
    });
}

#[test]
fn the_report_is_that_of_the_latest_submission() {
    own_test(|own, ctx| {
        let words = awkward_keys(10_000, 5);
        let keys = Array::new(own, &words);
        let counts = Array::new(own, &[10_001]);
        let (part, counts_part) = (keys.part::<i32>(ctx), counts.part(ctx));
        let sort = Sort::<i32>::new(ctx, Order::Ascending, Payloads::None).unwrap();
        let scratch = sort.scratch(ctx, 10_000).unwrap();
        let commands = own.begin();
        let count = Count::Gpu { buffer: &counts_part, offset: 0 };
        let recorded = record_into(own, ctx, commands, |recording| {
            sort.record_keys(recording, &part, count, 0..32, &scratch).unwrap();
        });
        own.barrier(commands, SORTED, HOST);
        own.end(commands);
        let error = recorded.check().unwrap_err().to_string();
        assert!(error.contains("have not run"), "{error}");
        own.submit_and_wait(commands);
        assert!(recorded.check().unwrap_err().to_string().contains("capacity"));
        // The same commands again, on other contents.
        counts.own.write(GUARDS, &[10_000]);
        keys.own.write(GUARDS, &words);
        own.submit_and_wait(commands);
        let report = recorded.check().unwrap();
        assert_eq!(report.errors, 0);
        let expected = sorted_indices::<i32>(&words, Order::Ascending, 0..32);
        let expected: Vec<u32> = expected.iter().map(|&i| words[i as usize]).collect();
        assert_same("submitted again", &keys.read("submitted again"), &expected);
    });
}

#[test]
fn scratch_memory_may_be_the_callers() {
    own_test(|own, ctx| {
        let keys = awkward_keys(20_001, 6);
        let (order, payloads) = (Order::Ascending, Payloads::U32);
        let sort = Sort::<f32>::new(ctx, order, payloads).unwrap();
        let capacity = keys.len() as u32;
        let bytes = sort.scratch_bytes(ctx, capacity);
        // Poisoned: scratch memory need not be cleared.
        let memory = Array::new(own, &vec![0xFFFF_FFFF; bytes as usize / 4]);
        let part = memory.part::<u32>(ctx);
        let scratch = sort.scratch_in(ctx, &part, capacity).unwrap();
        let check = Check { own, ctx, sort: &sort, scratch: &scratch, order, payloads };
        check.run(&keys, keys.len(), 0..32, true, false);
        check.run(&keys, 7_777, 0..24, false, true);
        check.run(&keys[..300], 300, 0..32, false, false);
        memory.read("scratch memory");
        let error = sort.scratch_in(ctx, &part.slice(0..part.len() - 1), capacity).err().expect("refused");
        assert!(matches!(error, Error::DeviceMemory { needed, .. } if needed == bytes), "{error}");
    });
}

#[test]
fn scans_with_total_at_every_boundary() {
    own_test(|own, ctx| {
        for (kind, carry) in
            [ScanKind::Exclusive, ScanKind::Inclusive].into_iter().flat_map(|k| CARRIES.map(|c| (k, c)))
        {
            let scan = Scan::with_carry(ctx, kind, true, carry).unwrap();
            let tile = scan.tile() as usize;
            let most = 3 * tile + 6;
            let memory = Array::new(own, &vec![0xFFFF_FFFF; scan.scratch_bytes(ctx, most as u32) as usize / 4]);
            let scratch = scan.scratch_in(ctx, &memory.part(ctx), most as u32).unwrap();
            let items = Random(7).words(most);
            for n in [0, 1, 2, 3, 4, 5, tile - 1, tile, tile + 1, 2 * tile + 2, most] {
                for on_gpu in [false, true] {
                    let case = format!("{n} items, {kind:?}, {carry:?}, count on the GPU: {on_gpu}");
                    // With a count on the GPU there is more than is to be scanned.
                    let all = if on_gpu { &items } else { &items[..n] };
                    let unwritten = vec![0x5555_5555; all.len()];
                    let (from, to) = (Array::new(own, all), Array::new(own, &unwritten));
                    let (counts, total) = (Array::new(own, &[n as u32]), Array::new(own, &[1, 2, 3]));
                    let [from_part, to_part, counts_part, total_part] =
                        [&from, &to, &counts, &total].map(|a| a.part(ctx));
                    let count =
                        if on_gpu { Count::Gpu { buffer: &counts_part, offset: 0 } } else { Count::Host(n as u32) };
                    let total_word = Some(Word { buffer: &total_part, offset: 1 });
                    run(own, ctx, |recording| {
                        scan.record(recording, &from_part, &to_part, total_word, count, &scratch).unwrap();
                    })
                    .unwrap();
                    let mut expected = match kind {
                        ScanKind::Exclusive => cpu::scan::exclusive(&all[..n]),
                        ScanKind::Inclusive => cpu::scan::inclusive(&all[..n]),
                    };
                    expected.extend(&unwritten[n..]);
                    assert_same(&case, &to.read(&case), &expected);
                    let sum = all[..n].iter().fold(0u32, |sum, &item| sum.wrapping_add(item));
                    assert_eq!(total.read(&case), [1, sum, 3], "{case}");
                    assert_same(&case, &from.read(&case), all);
                }
            }
            memory.read("scratch memory");
        }
    });
}

#[test]
fn a_scan_without_total_writes_none() {
    own_test(|own, ctx| {
        let scan = Scan::new(ctx, ScanKind::Exclusive, false).unwrap();
        let scratch = scan.scratch(ctx, 10_001).unwrap();
        let items = Random(8).words(10_001);
        let (from, to) = (Array::new(own, &items), Array::new(own, &items));
        let parts = [&from, &to].map(|a| a.part(ctx));
        let count = Count::Host(10_001);
        run(own, ctx, |recording| scan.record(recording, &parts[0], &parts[1], None, count, &scratch).unwrap())
            .unwrap();
        assert_same("without total", &to.read("without total"), &cpu::scan::exclusive(&items));
    });
}

#[test]
fn buffers_may_end_amid_a_vector() {
    own_test(|own, ctx| {
        // No guards: the checks on the GPU know where a buffer ends, not where the array does.
        let words = Random(14).words(10_001);
        let [items, sums] = [(); 2].map(|()| own.buffer(10_001));
        items.write(0, &words);
        let parts = [&items, &sums].map(|buffer| buffer.part::<u32>(ctx, 0, buffer.bytes).unwrap());
        let scan = Scan::new(ctx, ScanKind::Inclusive, false).unwrap();
        let sort = Sort::<u32>::new(ctx, Order::Descending, Payloads::None).unwrap();
        let scratches = (scan.scratch(ctx, 10_001).unwrap(), sort.scratch(ctx, 10_001).unwrap());
        let count = Count::Host(10_001);
        run(own, ctx, |recording| {
            scan.record(recording, &parts[0], &parts[1], None, count, &scratches.0).unwrap();
            sort.record_keys(recording, &parts[0], count, 0..32, &scratches.1).unwrap();
        })
        .unwrap();
        assert_same("sums", &sums.read(), &cpu::scan::inclusive(&words));
        let mut expected = words;
        expected.sort_by(|a, b| b.cmp(a));
        assert_same("sorted", &items.read(), &expected);
    });
}

#[test]
fn selections_of_none_some_and_all() {
    own_test(|own, ctx| {
        for (selected, carry) in [Selected::Items, Selected::Indices].into_iter().flat_map(|s| CARRIES.map(|c| (s, c)))
        {
            let select = Select::with_carry(ctx, selected, carry).unwrap();
            let most = 9_001;
            let scratch = select.scratch(ctx, most as u32).unwrap();
            let mut random = Random(9);
            let items = random.words(most);
            let indices: Vec<u32> = (0..most as u32).collect();
            let of = if selected == Selected::Items { &items } else { &indices };
            // Of every `rarity`th word a bit is set; 0: none.
            for (n, rarity) in
                [(0, 1), (1, 1), (1, 0), (2_048, 1), (2_049, 3), (most, 1), (most, 0), (most, 2), (most, 500)]
            {
                for on_gpu in [false, true] {
                    let case = format!("{n} {selected:?}, {carry:?}, every {rarity}th, count on the GPU: {on_gpu}");
                    let mut flag = || {
                        if rarity != 0 && random.word().is_multiple_of(rarity) { 1 << (random.word() % 32) } else { 0 }
                    };
                    let flags: Vec<u32> = (0..most).map(|_| flag()).collect();
                    let unwritten = vec![0x5555_5555; most];
                    let arrays =
                        [&flags[..], &items, &unwritten, &[n as u32], &[7, 8]].map(|words| Array::new(own, words));
                    let [flags_part, items_part, to, counts, total] = [0, 1, 2, 3, 4].map(|i| arrays[i].part(ctx));
                    let count = if on_gpu { Count::Gpu { buffer: &counts, offset: 0 } } else { Count::Host(n as u32) };
                    let given = (selected == Selected::Items).then_some(&items_part);
                    let total = Word { buffer: &total, offset: 1 };
                    run(own, ctx, |recording| {
                        select.record(recording, &flags_part, given, &to, total, count, &scratch).unwrap();
                    })
                    .unwrap();
                    let mut expected = cpu::select::select(&flags[..n], of);
                    assert_eq!(arrays[4].read(&case), [7, expected.len() as u32], "{case}");
                    expected.extend(&unwritten[expected.len()..]);
                    assert_same(&case, &arrays[2].read(&case), &expected);
                }
            }
        }
    });
}

#[test]
fn what_one_writes_the_next_may_take_without_a_barrier() {
    own_test(|own, ctx| {
        // Select, then sort as many as were selected, then scan them: one recording, one piece of scratch memory each.
        let (flags, items) = (Random(10).words(30_000), awkward_keys(30_000, 11));
        let flags: Vec<u32> = flags.iter().map(|word| word & 1).collect();
        let arrays = [&flags[..], &items, &vec![0; 30_000], &[0], &vec![0; 30_000]].map(|words| Array::new(own, words));
        let [flags_part, items_part, selected, total, sums] = [0, 1, 2, 3, 4].map(|i| arrays[i].part(ctx));
        let select = Select::new(ctx, Selected::Items).unwrap();
        let sort = Sort::<u32>::new(ctx, Order::Descending, Payloads::None).unwrap();
        let scan = Scan::new(ctx, ScanKind::Inclusive, false).unwrap();
        let scratches = (
            select.scratch(ctx, 30_000).unwrap(),
            sort.scratch(ctx, 30_000).unwrap(),
            scan.scratch(ctx, 30_000).unwrap(),
        );
        run(own, ctx, |recording| {
            let (word, all) = (Word { buffer: &total, offset: 0 }, Count::Host(30_000));
            select.record(recording, &flags_part, Some(&items_part), &selected, word, all, &scratches.0).unwrap();
            let count = Count::Gpu { buffer: &total, offset: 0 };
            sort.record_keys(recording, &selected, count, 0..32, &scratches.1).unwrap();
            scan.record(recording, &selected, &sums, None, count, &scratches.2).unwrap();
        })
        .unwrap();
        let mut expected = cpu::select::select(&flags, &items);
        expected.sort_by(|a, b| b.cmp(a));
        let n = expected.len();
        assert_same("sorted", &arrays[2].read("sorted")[..n], &expected);
        assert_same("scanned", &arrays[4].read("scanned")[..n], &cpu::scan::inclusive(&expected));
    });
}

/// What follows a sort in the same command buffer.
#[derive(PartialEq)]
enum Next {
    CopyOut,
    OverwriteAfterBarrier,
    Overwrite,
}

/// Copies keys in, sorts them without a barrier of the caller's, and goes on.
fn sort_between_copies(next: Next) -> Vec<String> {
    messages_of(|own, ctx| {
        let words = awkward_keys(5_000, 12);
        let [given, keys, taken] = [(); 3].map(|()| own.buffer(5_000));
        given.write(0, &words);
        let part = keys.part::<u32>(ctx, 0, keys.bytes).unwrap();
        let sort = Sort::<u32>::new(ctx, Order::Ascending, Payloads::None).unwrap();
        let scratch = sort.scratch(ctx, 5_000).unwrap();
        let commands = own.begin();
        own.copy(commands, &given, &keys, keys.bytes);
        let recorded = record_into(own, ctx, commands, |recording| {
            sort.record_keys(recording, &part, Count::Host(5_000), 0..32, &scratch).unwrap();
        });
        if next == Next::CopyOut {
            own.copy(commands, &keys, &taken, keys.bytes);
        } else {
            if next == Next::OverwriteAfterBarrier {
                own.barrier(commands, SORTED, COPIED);
            }
            own.copy(commands, &given, &keys, keys.bytes);
        }
        own.barrier(commands, COPIED, HOST);
        own.end(commands);
        own.submit_and_wait(commands);
        recorded.check().unwrap();
        if next == Next::CopyOut {
            let expected = cpu::radix_sort::sort_pairs(&words, &words, 0, 32).0;
            assert_same("copied out", &taken.read(), &expected);
        }
    })
}

#[test]
fn copies_before_and_after_are_ordered_and_other_uses_are_the_callers_to_order() {
    assert_eq!(sort_between_copies(Next::CopyOut), [""; 0]);
    assert_eq!(sort_between_copies(Next::OverwriteAfterBarrier), [""; 0]);
    let messages = sort_between_copies(Next::Overwrite);
    // The other validation does not look for hazards.
    assert!(
        common::validation() == Validation::GpuAssisted
            || messages.iter().any(|m| m.contains("SYNC-HAZARD-WRITE-AFTER-WRITE")),
        "{messages:?}"
    );
}

#[test]
fn wrong_use_is_refused_by_name() {
    own_test(|own, ctx| {
        let array = own.buffer(8192);
        let part = |from: u64, to: u64| array.part::<u32>(ctx, 4 * from, 4 * (to - from)).unwrap();
        let (a, b, across) = (part(0, 1024), part(1024, 2048), part(512, 1536));
        let keys_only = Sort::<u32>::new(ctx, Order::Ascending, Payloads::None).unwrap();
        let pairs = Sort::<u32>::new(ctx, Order::Ascending, Payloads::U32).unwrap();
        let scan = Scan::new(ctx, ScanKind::Exclusive, false).unwrap();
        let select = Select::new(ctx, Selected::Indices).unwrap();
        let (scratch, small) = (keys_only.scratch(ctx, 1024).unwrap(), keys_only.scratch(ctx, 1000).unwrap());
        let pairs_scratch = pairs.scratch(ctx, 1024).unwrap();
        let scan_scratch = scan.scratch(ctx, 1024).unwrap();
        let select_scratch = select.scratch(ctx, 1024).unwrap();
        let within = keys_only.scratch_in(ctx, &part(1024, 8192), 256).unwrap();
        let all = Count::Host(1024);
        run(own, ctx, |r| {
            let word = Word { buffer: &b, offset: 1024 };
            for (result, part) in [
                (keys_only.record_pairs(r, &a, &b, all, 0..32, &scratch), "Payloads::None"),
                (pairs.record_keys(r, &a, all, 0..32, &pairs_scratch), "Payloads::U32"),
                (keys_only.record_keys(r, &a, Count::Host(1025), 0..32, &scratch), "room for 1024"),
                (keys_only.record_keys(r, &a, all, 0..32, &small), "room for 1000"),
                (keys_only.record_keys(r, (&a, &a.slice(0..512)), Count::Host(512), 0..32, &scratch), "overlap"),
                (keys_only.record_keys(r, &a, all, 0..33, &scratch), "0..33"),
                (keys_only.record_keys(r, (&a, &across), all, 0..32, &scratch), "overlap"),
                (keys_only.record_keys(r, &b, Count::Host(256), 0..32, &within), "scratch memory"),
                (
                    keys_only.record_keys(r, &a, Count::Gpu { buffer: &b, offset: 1024 }, 0..32, &scratch),
                    "element 1024",
                ),
                (pairs.record_pairs(r, &a, &a, all, 0..32, &pairs_scratch), "overlap"),
                (pairs.record_pairs(r, &a, (&b, &part(2048, 3072)), all, 0..32, &pairs_scratch), "not both"),
                (scan.record(r, &a, &a, None, all, &scan_scratch), "overlap"),
                (scan.record(r, &a, &b, Some(Word { buffer: &b, offset: 0 }), all, &scan_scratch), "has_total"),
                (select.record(r, &a, Some(&b), &b, word, all, &select_scratch), "Selected::Indices"),
                (select.record(r, &a, None, &part(2048, 3072), word, all, &select_scratch), "element 1024"),
            ] {
                let error = result.expect_err(part);
                assert!(matches!(error, Error::Input { .. }) && error.to_string().contains(part), "{part}: {error}");
            }
        })
        .unwrap();
        let refused = [array.part::<u32>(ctx, 4, 64), array.part::<u32>(ctx, 0, 62), array.part::<u32>(ctx, 0, 0)];
        assert!(refused.into_iter().all(|part| matches!(part, Err(Error::Input { .. }))));
        let error = keys_only.scratch(ctx, MAX_ITEMS + 1).err().expect("refused").to_string();
        assert!(error.contains("1073741824 items"), "{error}");
        let error = ctx.upload("words", &[1u32]).err().expect("refused").to_string();
        assert!(error.contains("borrowed"), "{error}");
    });
}

#[test]
fn a_queue_family_that_cannot_compute_is_named() {
    let _turn = common::one_at_a_time();
    let mut own = own_device();
    let right = std::mem::replace(&mut own.queue_family, 1_000);
    let error = own.context().err().expect("refused");
    assert!(matches!(&error, Error::MissingFeatures { missing, .. } if missing == &["a compute queue"]), "{error}");
    own.queue_family = right;
    assert_eq!(own.close(), [""; 0]);
}

#[test]
fn device_buffers_and_commands_may_be_ours() {
    common::gpu_test(|ctx| {
        let keys: Vec<f32> = awkward_keys(3_000, 13).into_iter().map(f32::from_bits).collect();
        let buffer = ctx.upload("keys", &keys).unwrap();
        let sort = Sort::<f32>::new(ctx, Order::Ascending, Payloads::None).unwrap();
        let scratch = sort.scratch(ctx, 3_000).unwrap();
        let mut recording = Recording::new(ctx, Recorder::new(ctx).unwrap()).unwrap();
        sort.record_keys(&mut recording, &buffer, Count::Host(3_000), 0..32, &scratch).unwrap();
        recording.submit_and_wait().unwrap();
        let mut expected = keys.clone();
        expected.sort_by(f32::total_cmp);
        let bits = |keys: Vec<f32>| keys.into_iter().map(f32::to_bits).collect::<Vec<_>>();
        assert_same("ours", &bits(ctx.read_back(&buffer).unwrap()), &bits(expected));
    });
}

#[test]
fn the_example_sorts_and_is_silent() {
    let _turn = common::one_at_a_time();
    let text = sort_your_buffer::run(true).unwrap();
    assert!(text.starts_with("1000000 keys sorted"), "{text}");
}
