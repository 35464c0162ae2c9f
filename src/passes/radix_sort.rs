//! Stable OneSweep radix sort of u32 keys, with u32 payloads or without: `glsl/radix_histogram.comp`, `radix_scan.comp`,
//! `radix_onesweep.comp` or, on processors, `radix_runs.comp`. Without look-back a pass is three dispatches: count, `column_scan.comp`, place.

use super::lookback::{self, Carry, Columns, Count, Diagnostics, DispatchArgs, Groups, TileKernel};
use crate::abi::{RadixHistogramPush, RadixPassPush, RadixScanPush};
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Pipeline, Recorder};
use crate::{Error, Result};
use std::ops::Range;

/// Words of the histograms of all passes. Behind them a storage buffer may begin: 4 KiB are a multiple of any device's alignment.
const HISTOGRAM_WORDS: u32 = constants::RADIX_PASSES * constants::RADIX_DIGITS;
/// Most counters per digit and pass of all workgroups of the histogram: workgroups with one of each fill a large device, and more would
/// only add to what they write.
const HISTOGRAM_COUNTERS: u32 = 256;

/// Fewest invocations of a workgroup of `radix_onesweep.comp`: with fewer a fallback takes longer than it is charged.
const LEAST_OF_ROWS: u32 = 64;

/// What the keys' words are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants say it")]
pub enum KeyKind {
    U32,
    I32,
    /// In the order of [`f32::total_cmp`].
    F32,
}

impl KeyKind {
    /// The number that shaders and twins know it by.
    pub fn code(self) -> u32 {
        match self {
            KeyKind::U32 => constants::KEY_U32,
            KeyKind::I32 => constants::KEY_I32,
            KeyKind::F32 => constants::KEY_F32,
        }
    }
}

/// Options of a [`RadixSort`]; [`Tuning`](super::tuning::Tuning) has those that suit a device.
#[derive(Clone, Copy, Debug)]
pub struct RadixSortConfig {
    /// Invocations of a workgroup, a multiple of the subgroup size; `None`: 256, or 128 where subgroups are so narrow
    /// that their counters would not fit the shared memory; if `blocked`, a subgroup.
    pub workgroup: Option<u32>,
    /// Keys per invocation, 1 to 32; if `blocked`, a multiple of 4 up to 2048.
    pub keys: u32,
    /// Whether an invocation owns a run of keys and has counters of its own, instead of every so-manieth key of its subgroup's: for
    /// processors (`radix_runs.comp`).
    pub blocked: bool,
    /// In how many rounds they go through shared memory: more take less of it, so that larger tiles fit. 1 to `keys`.
    pub rounds: u32,
    /// Whether every key has a payload.
    pub payloads: bool,
    /// What the keys are.
    pub kind: KeyKind,
    /// Whether the largest key comes first. Equal keys keep their order all the same.
    pub descending: bool,
    /// Whether the buffer of keys may end amid a vector of four.
    pub ends_amid: bool,
    /// How counts get from tile to tile.
    pub carry: Carry,
    /// Polls of a missing predecessor before its tile is counted in its place.
    pub spin_limit: u32,
    /// When not 0, every so-manieth tile behaves as if suspended for ever.
    pub withhold: u32,
    /// Of an invocation's keys, for how many equal digits are found by masks in shared memory, where subgroups have at most 32
    /// lanes and digits are not skewed; for the others by ballots.
    pub mask_rows: u32,
    /// Status words that a step of look-back loads at once.
    pub ahead: u32,
    /// Invocations of a workgroup of the histogram; if `blocked`, of the scan of it.
    pub histogram_workgroup: u32,
}

impl Default for RadixSortConfig {
    fn default() -> Self {
        Self {
            workgroup: None,
            keys: 15,
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
            histogram_workgroup: 256,
        }
    }
}

impl RadixSortConfig {
    /// Can an invocation have so many keys?
    pub fn keys_fit(&self) -> bool {
        if self.blocked {
            self.keys.is_multiple_of(4) && (4..=4 * constants::RADIX_RUN_VECTORS).contains(&self.keys)
        } else {
            (1..=32).contains(&self.keys)
        }
    }

    /// Invocations of a workgroup of `radix_onesweep.comp`, and its specialization.
    fn workgroup_of_rows(&self, ctx: &Context) -> Result<(u32, Vec<(&'static str, u32)>)> {
        assert!(self.keys_fit(), "{} keys; radix_onesweep.comp takes 1 to 32", self.keys);
        assert!((1..=self.keys).contains(&self.rounds), "{} rounds of {} keys", self.rounds, self.keys);
        let narrow = ctx.min_subgroup_size();
        let limit = ctx.max_shared_bytes();
        let has_masks = self.mask_rows > 0 && ctx.max_subgroup_size() <= 32;
        let shared = |workgroup| Shared::of(workgroup, self.keys.div_ceil(self.rounds), has_masks, narrow);
        let workgroup = self.workgroup.unwrap_or(if shared(256).bytes <= limit { 256 } else { 128 });
        let shared = shared(workgroup);
        lookback::check_workgroup(ctx, "radix sort", workgroup)?;
        // Places and counts have 16 bits.
        assert!(workgroup * self.keys <= 0xFFFF, "tiles of {workgroup} x {}", self.keys);
        if workgroup < LEAST_OF_ROWS {
            let text = format!("workgroups of {workgroup} invocations");
            return Err(Error::input(
                "radix sort",
                text,
                format!("give them at least {LEAST_OF_ROWS}, or runs of keys"),
            ));
        }
        if shared.bytes > limit {
            let keys = self.keys;
            return Err(Error::input(
                "radix sort",
                format!(
                    "{keys} keys for each of {workgroup} invocations in subgroups of {narrow}: {} bytes",
                    shared.bytes
                ),
                format!(
                    "the device shares {limit} bytes among a workgroup: use fewer keys, more rounds or smaller workgroups"
                ),
            ));
        }
        let specialization = vec![
            ("ROUNDS", self.rounds),
            ("SCRATCH_WORDS", shared.scratch_words),
            ("BALLOT_WORDS", if ctx.max_subgroup_size() <= 32 { 1 } else { 4 }),
            ("MASK_ROWS", if has_masks { self.mask_rows } else { 0 }),
        ];
        Ok((workgroup, specialization))
    }

    /// Invocations of a workgroup of `radix_runs.comp`.
    fn workgroup_of_runs(&self, ctx: &Context) -> Result<u32> {
        let workgroup = self.workgroup.unwrap_or(ctx.max_subgroup_size());
        lookback::check_workgroup(ctx, "radix sort", workgroup)?;
        assert!(self.keys_fit(), "{} keys in a run", self.keys);
        if !constants::RADIX_DIGITS.is_multiple_of(workgroup) {
            let text = format!("{workgroup} invocations for {} digits", constants::RADIX_DIGITS);
            return Err(Error::input("radix sort", text, "use workgroups of a power of two"));
        }
        // The counters of all, the digits, the partial sums of the subgroups, the ticket and the row that is missing.
        let words = (workgroup + 1) * constants::RADIX_DIGITS + workgroup / ctx.min_subgroup_size() + 2;
        let limit = ctx.max_shared_bytes();
        if 4 * words > limit {
            return Err(Error::input(
                "radix sort",
                format!("counters for each of {workgroup} invocations: {} bytes", 4 * words),
                format!("the device shares {limit} bytes among a workgroup: use smaller workgroups"),
            ));
        }
        Ok(workgroup)
    }
}

/// The pass.
pub struct RadixSort {
    histogram: Pipeline,
    scan: Pipeline,
    pass: TileKernel,
    args: DispatchArgs,
    tile: u32,
    /// Keys that a workgroup of the histogram has under way together.
    histogram_step: u32,
    /// Most of its workgroups, unless their loops got too long.
    histogram_groups: u32,
    payloads: bool,
}

/// Memory of a sort of up to `capacity` pairs.
pub(crate) struct SortMemory {
    capacity: u32,
    keys: Buffer<u32>,
    payloads: Buffer<u32>,
    /// In place of the caller's payloads, where there are none: of the source's and of the target's, since one pass binds
    /// both.
    none: [Buffer<u32>; 2],
    /// Zero before a sort: the histogram, and the status words behind it.
    zeroed: Buffer<u32>,
    histogram: Buffer<u32>,
    status: Buffer<u32>,
    args: Buffer<u32>,
}

/// What a sort of up to `capacity` pairs needs besides keys and payloads.
pub struct RadixSortScratch {
    memory: SortMemory,
    diagnostics: Diagnostics,
}

impl RadixSortScratch {
    /// What the kernels report; check it after the submission.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }
}

/// Where the sorted pairs are.
#[derive(Clone, Copy)]
pub struct Sorted<'a> {
    /// Sorted keys.
    pub keys: &'a Buffer<u32>,
    /// The payload of each key.
    pub payloads: &'a Buffer<u32>,
}

/// Shared memory of `radix_onesweep.comp`.
#[derive(Clone, Copy)]
struct Shared {
    scratch_words: u32,
    bytes: u32,
}

impl Shared {
    /// The scratch holds a round of a tile's keys, or for every subgroup two digit counters to a word and a mask per digit.
    fn of(workgroup: u32, round_keys: u32, has_masks: bool, min_subgroup_size: u32) -> Self {
        let words = constants::RADIX_DIGITS / 2 + if has_masks { constants::RADIX_DIGITS } else { 0 };
        let scratch_words = (workgroup * round_keys).max(workgroup / min_subgroup_size * words);
        // The digits, the partial sums of the subgroups; the ticket, the window and a word to align it, what the keys are like, the
        // row that is missing.
        let small = constants::RADIX_DIGITS + workgroup / min_subgroup_size + 1 + 3 + 1 + 1;
        Self { scratch_words, bytes: 4 * (scratch_words + small) }
    }
}

impl RadixSort {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, config: RadixSortConfig) -> Result<Self> {
        assert!((1..=32).contains(&config.ahead), "{} status words at once", config.ahead);
        lookback::check_workgroup(ctx, "radix sort", config.histogram_workgroup)?;
        let (kind, descending) = (("KEY_KIND", config.kind.code()), ("DESCENDING", config.descending.into()));
        let (shader, workgroup, of_shader) = if config.blocked {
            (&shaders::RADIX_RUNS, config.workgroup_of_runs(ctx)?, vec![])
        } else {
            let (workgroup, of_shader) = config.workgroup_of_rows(ctx)?;
            (&shaders::RADIX_ONESWEEP, workgroup, of_shader)
        };
        let (of_histogram, bins, of_scan) = if config.blocked {
            let lanes = ctx.max_subgroup_size();
            let bins = if 4 * HISTOGRAM_WORDS * lanes <= ctx.max_shared_bytes() { lanes } else { 1 };
            (lanes, bins, config.histogram_workgroup)
        } else {
            (config.histogram_workgroup, 1, workgroup)
        };
        let histogram =
            [("WORKGROUP", of_histogram), ("BINS", bins), ("ENDS_AMID", config.ends_amid.into()), kind, descending];
        let scan = [("WORKGROUP", of_scan), ("SUBGROUP_MIN", ctx.min_subgroup_size())];
        let of_pass = [
            ("WORKGROUP", workgroup),
            ("SUBGROUP_MIN", ctx.min_subgroup_size()),
            ("SPIN_LIMIT", config.spin_limit),
            ("WITHHOLD", config.withhold),
            ("KEYS", config.keys),
            ("PAYLOADS", config.payloads.into()),
            ("AHEAD", config.ahead),
            kind,
            descending,
        ];
        Ok(Self {
            histogram: Pipeline::new(ctx, &shaders::RADIX_HISTOGRAM, &histogram)?,
            scan: Pipeline::new(ctx, &shaders::RADIX_SCAN, &scan)?,
            pass: TileKernel::new(ctx, shader, &[&of_pass[..], &of_shader].concat(), config.carry)?,
            args: DispatchArgs::new(ctx)?,
            tile: workgroup * config.keys,
            histogram_step: of_histogram * constants::RADIX_STEP_KEYS,
            histogram_groups: HISTOGRAM_COUNTERS / bins,
            payloads: config.payloads,
        })
    }

    /// Pairs of a tile.
    pub fn tile(&self) -> u32 {
        self.tile
    }

    /// Workgroups of the histogram of up to `most` keys.
    fn histogram_groups(&self, most: u32) -> u32 {
        let least = most.div_ceil(self.histogram_step * constants::RADIX_STEPS_MAX);
        most.div_ceil(self.histogram_step).min(self.histogram_groups.max(least))
    }

    /// Status rows of one pass: a row per tile and one before the first.
    fn rows(&self, count: u32) -> u32 {
        count.div_ceil(self.tile) + 1
    }

    fn zeroed_words(&self, count: u32, passes: u32) -> u64 {
        let words = u64::from(passes) * u64::from(self.rows(count)) * u64::from(constants::RADIX_DIGITS);
        u64::from(HISTOGRAM_WORDS) + u64::from(constants::RADIX_HEAD) + words
    }

    /// Bytes of device memory that [`RadixSort::scratch`] takes.
    pub fn scratch_bytes(&self, capacity: u32) -> u64 {
        let small = constants::ARGS_WORDS + constants::DIAGNOSTICS_WORDS;
        4 * ((1 + u64::from(self.payloads)) * u64::from(capacity)
            + self.zeroed_words(capacity, constants::RADIX_PASSES)
            + u64::from(small))
    }

    /// Memory for sorts of up to `capacity` pairs.
    pub fn scratch(&self, ctx: &Context, capacity: u32) -> Result<RadixSortScratch> {
        Ok(RadixSortScratch { memory: self.memory(ctx, None, capacity)?, diagnostics: Diagnostics::new(ctx)? })
    }

    fn parts(&self, capacity: u32) -> [(&'static str, u64); 6] {
        [
            ("radix_sort.keys", capacity.into()),
            ("radix_sort.payloads", if self.payloads { capacity.into() } else { 0 }),
            ("radix_sort.none", 0),
            ("radix_sort.none_sorted", 0),
            ("radix_sort.counts", self.zeroed_words(capacity, constants::RADIX_PASSES)),
            ("radix_sort.args", constants::ARGS_WORDS.into()),
        ]
    }

    /// Words that [`RadixSort::memory`] takes of what it is given.
    pub(crate) fn memory_words(&self, ctx: &Context, capacity: u32) -> u64 {
        lookback::arrays_words(ctx, &self.parts(capacity))
    }

    /// Memory for sorts of up to `capacity` pairs: new, or a part of `within`.
    pub(crate) fn memory(&self, ctx: &Context, within: Option<&Buffer<u32>>, capacity: u32) -> Result<SortMemory> {
        lookback::check_capacity("radix sort", capacity)?;
        let [keys, payloads, none, none_sorted, zeroed, args] = lookback::arrays(ctx, within, self.parts(capacity))?;
        let at = HISTOGRAM_WORDS as usize;
        let (histogram, status) = (zeroed.slice(0..at), zeroed.slice(at..zeroed.len()));
        Ok(SortMemory { capacity, keys, payloads, none: [none, none_sorted], zeroed, histogram, status, args })
    }

    /// Sorts the first `count` keys by bits `bits`, of a sort without payloads; else as [`RadixSort::record`].
    pub fn record_keys<'a>(
        &self,
        rec: &mut Recorder,
        keys: &'a Buffer<u32>,
        count: Count<'_>,
        bits: Range<u32>,
        scratch: &'a RadixSortScratch,
    ) -> &'a Buffer<u32> {
        assert!(!self.payloads, "a sort of pairs, without payloads");
        self.record_alternating(rec, Sorted { keys, payloads: &scratch.memory.none[0] }, count, bits, scratch).keys
    }

    /// Sorts the first `count` pairs by bits `bits` of their keys; pairs that agree in them keep their order. Takes
    /// one pass per 8 bits, from the given buffers to those of `scratch` and back: with an even number of passes the
    /// result is in place, with an odd number in `scratch`. What is returned says where.
    ///
    /// Starts by ordering all compute accesses recorded before, so that kernels may have written the pairs; ends with
    /// the result written as [`Access::ComputeWrite`] (nothing is recorded when `bits` is empty).
    pub fn record<'a>(
        &self,
        rec: &mut Recorder,
        keys: &'a Buffer<u32>,
        payloads: &'a Buffer<u32>,
        count: Count<'_>,
        bits: Range<u32>,
        scratch: &'a RadixSortScratch,
    ) -> Sorted<'a> {
        assert!(self.payloads, "a sort of keys alone, with payloads");
        self.record_alternating(rec, Sorted { keys, payloads }, count, bits, scratch)
    }

    fn record_alternating<'a>(
        &self,
        rec: &mut Recorder,
        given: Sorted<'a>,
        count: Count<'_>,
        bits: Range<u32>,
        RadixSortScratch { memory, diagnostics }: &'a RadixSortScratch,
    ) -> Sorted<'a> {
        let passes = bits.len().div_ceil(constants::RADIX_BITS as usize) as u32;
        let outputs = [Sorted { keys: &memory.keys, payloads: &memory.payloads }, given];
        self.record_passes(rec, given, outputs, count, (bits, passes, constants::RADIX_BITS), memory, diagnostics);
        if passes.is_multiple_of(2) { given } else { outputs[0] }
    }

    /// Sorts the first `count` pairs of `source` into `target`, which is `source` itself or other memory; then `source`
    /// stays as it is. Payloads are left out where the sort has none. Accesses: as [`RadixSort::record`].
    pub(crate) fn record_into<'a>(
        &self,
        rec: &mut Recorder,
        source: (&'a Buffer<u32>, Option<&'a Buffer<u32>>),
        target: (&'a Buffer<u32>, Option<&'a Buffer<u32>>),
        count: Count<'_>,
        bits: Range<u32>,
        (memory, diagnostics): (&'a SortMemory, &Diagnostics),
    ) {
        let is_in_place = source.0.overlaps(target.0);
        if is_in_place && bits.is_empty() {
            return;
        }
        let pair = |given: (&'a Buffer<u32>, Option<&'a Buffer<u32>>), none| Sorted {
            keys: given.0,
            payloads: given.1.unwrap_or(none),
        };
        let (source, target) = (pair(source, &memory.none[0]), pair(target, &memory.none[1]));
        let width = bits.len() as u32;
        let mut passes = width.div_ceil(constants::RADIX_BITS).max(1);
        if is_in_place {
            // There and back.
            passes = passes.next_multiple_of(2);
        }
        let between = Sorted { keys: &memory.keys, payloads: &memory.payloads };
        let outputs = if passes.is_multiple_of(2) { [between, target] } else { [target, between] };
        let digits = (bits, passes, width.div_ceil(passes));
        self.record_passes(rec, source, outputs, count, digits, memory, diagnostics);
    }

    /// Passes over `digits`: window of bits, number of passes, bits of each. They read `source`, write the first output,
    /// read that, write the second, read that, write the first again, and so on.
    #[allow(clippy::too_many_arguments, reason = "the one place where both ways of choosing the memory meet")]
    fn record_passes(
        &self,
        rec: &mut Recorder,
        source: Sorted<'_>,
        outputs: [Sorted<'_>; 2],
        count: Count<'_>,
        digits: (Range<u32>, u32, u32),
        memory: &SortMemory,
        diagnostics: &Diagnostics,
    ) {
        let (Range { start: bit_begin, end: bit_end }, passes, digit_bits) = digits;
        assert!(bit_begin <= bit_end && bit_end <= 32, "bits {bit_begin}..{bit_end} of a 32-bit key");
        if passes == 0 {
            return;
        }
        let lengths = [source, outputs[0], outputs[1]]
            .map(|s| if self.payloads { s.keys.len().min(s.payloads.len()) } else { s.keys.len() });
        let capacity = lengths.into_iter().fold(memory.capacity as usize, usize::min) as u32;
        let most = match count {
            Count::Host(n) => n,
            Count::Gpu { .. } => capacity,
        };
        assert!(most <= capacity, "sort of {most} pairs with room for {capacity}");
        if let Count::Gpu { buffer, offset } = count {
            self.args.record(rec, (buffer, offset), capacity, (self.tile, 0), &memory.args, diagnostics);
        }
        let rows = self.rows(most);
        let pushed = count.pushed();

        rec.part("clear");
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill_range(&memory.zeroed, 0..self.zeroed_words(most, passes), 0);
        rec.barriers(&[
            (Access::TransferWrite, Access::ComputeReadWrite),
            (Access::ComputeReadWrite, Access::ComputeReadWrite),
        ]);

        rec.part("histogram");
        let binds =
            [("keys", source.keys.bind()), ("args", memory.args.bind()), ("histogram", memory.histogram.bind())];
        let push = RadixHistogramPush { count: pushed, bit_begin, bit_end, digit_bits, passes };
        rec.dispatch(&self.histogram, &binds, &push, [self.histogram_groups(most), 1, 1]);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);

        let status = || [("status", memory.status.bind()), ("diagnostics", diagnostics.buffer().bind())];
        rec.part("digits");
        let [words, reports] = status();
        let binds = [("histogram", memory.histogram.bind()), words, reports];
        rec.dispatch(&self.scan, &binds, &RadixScanPush { rows }, [passes, 1, 1]);

        let mut source = source;
        for pass in 0..passes {
            let target = outputs[pass as usize % 2];
            rec.part(["pass 1", "pass 2", "pass 3", "pass 4"][pass as usize]);
            // Histogram's reads and the pass before: its keys are read now, what it read is overwritten.
            rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
            let [words, reports] = status();
            let binds = [
                ("keys_in", source.keys.bind()),
                ("payloads_in", source.payloads.bind()),
                ("keys_out", target.keys.bind()),
                ("payloads_out", target.payloads.bind()),
                ("args", memory.args.bind()),
                words,
                reports,
            ];
            let push = RadixPassPush { count: pushed, pass, passes, bit_begin, bit_end, digit_bits, rows };
            let sums = Columns {
                status: &memory.status,
                diagnostics,
                first: constants::RADIX_HEAD + pass * rows * constants::RADIX_DIGITS,
                columns: constants::RADIX_DIGITS,
                rows,
            };
            let groups = Groups::of_tiles(count, self.tile, &memory.args);
            self.pass.run(rec, &binds, &push, groups, &sums);
            source = target;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_memory_fits_every_subgroup_size() {
        let keys = RadixSortConfig::default().keys;
        for subgroup in [4, 8, 16, 32, 64, 128] {
            assert!(Shared::of(128, keys, false, subgroup).bytes <= constants::SHARED_BYTES, "subgroup {subgroup}");
            assert_eq!(Shared::of(256, keys, false, subgroup).bytes <= constants::SHARED_BYTES, subgroup > 4);
        }
    }

    #[test]
    fn an_invocation_has_as_many_keys_as_the_kernels_take() {
        let fit = |blocked, keys| RadixSortConfig { blocked, keys, ..RadixSortConfig::default() }.keys_fit();
        assert!([1, 3, 32].iter().all(|&n| fit(false, n)) && ![0, 33, 64].iter().any(|&n| fit(false, n)));
        assert!([4, 12, 2048].iter().all(|&n| fit(true, n)) && ![0, 6, 2050, 2052].iter().any(|&n| fit(true, n)));
    }
}
