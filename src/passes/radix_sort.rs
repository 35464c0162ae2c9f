//! Stable OneSweep radix sort of u32 keys, with u32 payloads or without: `glsl/radix_histogram.comp`, `radix_scan.comp`,
//! `radix_onesweep.comp`.

use super::lookback::{self, Count, Diagnostics, DispatchArgs};
use crate::abi::{RadixHistogramPush, RadixOnesweepPush, RadixScanPush};
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Pipeline, Recorder};
use crate::{Error, Result};
use std::ops::Range;

/// Keys per invocation of the histogram: few enough for the loop budget, many enough to make flushing the bins cheap.
const HISTOGRAM_KEYS: u32 = 128;

/// Options of a [`RadixSort`]. The defaults are right except for tests.
#[derive(Clone, Copy, Debug)]
pub struct RadixSortConfig {
    /// Invocations of a workgroup, a multiple of the subgroup size; `None`: 256, or 128 where subgroups are so narrow
    /// that their counters would not fit the shared memory.
    pub workgroup: Option<u32>,
    /// Keys per invocation, 1 to 32.
    pub keys: u32,
    /// Whether every key has a payload.
    pub payloads: bool,
    /// Polls of a missing predecessor before its tile is counted in its place.
    pub spin_limit: u32,
    /// When not 0, every so-manieth tile behaves as if suspended for ever.
    pub withhold: u32,
    /// Widest subgroup that finds equal digits by broadcasts instead of ballots.
    pub broadcast_up_to: u32,
    /// Whether equal digits are found by masks in shared memory, where subgroups have at most 32 lanes.
    pub masks: bool,
    /// Status words that a step of look-back loads at once.
    pub ahead: u32,
    /// Invocations of a workgroup of the histogram.
    pub histogram_workgroup: u32,
    /// Counters per digit of the histogram: 1, 2, 4 or 8.
    pub histogram_parts: u32,
}

impl Default for RadixSortConfig {
    fn default() -> Self {
        Self {
            workgroup: None,
            keys: 15,
            payloads: true,
            spin_limit: 64,
            withhold: 0,
            broadcast_up_to: 8,
            masks: false,
            ahead: 1,
            histogram_workgroup: 256,
            histogram_parts: 1,
        }
    }
}

/// The pass.
pub struct RadixSort {
    histogram: Pipeline,
    scan: Pipeline,
    onesweep: Pipeline,
    args: DispatchArgs,
    tile: u32,
    histogram_tile: u32,
    payloads: bool,
}

/// What a sort of up to `capacity` pairs needs besides keys and payloads.
pub struct RadixSortScratch {
    capacity: u32,
    keys: Buffer<u32>,
    payloads: Buffer<u32>,
    /// In place of the caller's payloads, where there are none.
    none: Buffer<u32>,
    histogram: Buffer<u32>,
    status: Buffer<u32>,
    args: Buffer<u32>,
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
    /// The scratch holds a tile of keys, or for every subgroup two digit counters to a word and a mask per digit.
    fn of(workgroup: u32, keys: u32, has_masks: bool, min_subgroup_size: u32) -> Self {
        let words = constants::RADIX_DIGITS / 2 + if has_masks { constants::RADIX_DIGITS } else { 0 };
        let scratch_words = (workgroup * keys).max(workgroup / min_subgroup_size * words);
        // The last three: the partial sums of the subgroups, the ticket and the window.
        let small = constants::RADIX_DIGITS + workgroup / min_subgroup_size + 1 + 2;
        Self { scratch_words, bytes: 4 * (scratch_words + small) }
    }
}

impl RadixSort {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, config: RadixSortConfig) -> Result<Self> {
        assert!((1..=32).contains(&config.keys), "{} keys; radix_onesweep.comp takes 1 to 32", config.keys);
        let narrow = ctx.min_subgroup_size();
        let limit = ctx.max_shared_bytes();
        let has_masks = config.masks && ctx.max_subgroup_size() <= 32;
        let shared = |workgroup| Shared::of(workgroup, config.keys, has_masks, narrow);
        let workgroup = config.workgroup.unwrap_or(if shared(256).bytes <= limit { 256 } else { 128 });
        let shared = shared(workgroup);
        lookback::check_workgroup(ctx, "radix sort", workgroup)?;
        lookback::check_workgroup(ctx, "radix sort", config.histogram_workgroup)?;
        if shared.bytes > limit {
            let keys = config.keys;
            return Err(Error::input(
                "radix sort",
                format!(
                    "{keys} keys for each of {workgroup} invocations in subgroups of {narrow}: {} bytes",
                    shared.bytes
                ),
                format!("the device shares {limit} bytes among a workgroup: use fewer keys or smaller workgroups"),
            ));
        }
        let histogram =
            [("WORKGROUP", config.histogram_workgroup), ("KEYS", HISTOGRAM_KEYS), ("PARTS", config.histogram_parts)];
        let scan = [("WORKGROUP", workgroup), ("SUBGROUP_MIN", narrow)];
        let onesweep = [
            ("WORKGROUP", workgroup),
            ("SUBGROUP_MIN", narrow),
            ("SPIN_LIMIT", config.spin_limit),
            ("WITHHOLD", config.withhold),
            ("KEYS", config.keys),
            ("BROADCAST_UP_TO", config.broadcast_up_to),
            ("SCRATCH_WORDS", shared.scratch_words),
            ("PAYLOADS", config.payloads.into()),
            ("BALLOT_WORDS", if ctx.max_subgroup_size() <= 32 { 1 } else { 4 }),
            ("AHEAD", config.ahead),
            ("MASKS", has_masks.into()),
        ];
        Ok(Self {
            histogram: Pipeline::new(ctx, &shaders::RADIX_HISTOGRAM, &histogram)?,
            scan: Pipeline::new(ctx, &shaders::RADIX_SCAN, &scan)?,
            onesweep: Pipeline::new(ctx, &shaders::RADIX_ONESWEEP, &onesweep)?,
            args: DispatchArgs::new(ctx)?,
            tile: workgroup * config.keys,
            histogram_tile: config.histogram_workgroup * HISTOGRAM_KEYS,
            payloads: config.payloads,
        })
    }

    /// Pairs of a tile.
    pub fn tile(&self) -> u32 {
        self.tile
    }

    /// Status rows of one pass: a row per tile and one before the first.
    fn rows(&self, count: u32) -> u32 {
        count.div_ceil(self.tile) + 1
    }

    fn status_words(&self, count: u32, passes: u32) -> u64 {
        let words = u64::from(passes) * u64::from(self.rows(count)) * u64::from(constants::RADIX_DIGITS);
        u64::from(constants::RADIX_PASSES) + words
    }

    /// Bytes of device memory that [`RadixSort::scratch`] takes.
    pub fn scratch_bytes(&self, capacity: u32) -> u64 {
        let small =
            constants::RADIX_PASSES * constants::RADIX_DIGITS + constants::ARGS_WORDS + constants::DIAGNOSTICS_WORDS;
        4 * ((1 + u64::from(self.payloads)) * u64::from(capacity)
            + self.status_words(capacity, constants::RADIX_PASSES)
            + u64::from(small))
    }

    /// Memory for sorts of up to `capacity` pairs.
    pub fn scratch(&self, ctx: &Context, capacity: u32) -> Result<RadixSortScratch> {
        lookback::check_capacity("radix sort", capacity)?;
        let status = self.status_words(capacity, constants::RADIX_PASSES) as usize;
        Ok(RadixSortScratch {
            capacity,
            keys: ctx.device_buffer("radix_sort.keys", capacity as usize)?,
            payloads: ctx.device_buffer("radix_sort.payloads", if self.payloads { capacity as usize } else { 0 })?,
            none: ctx.device_buffer("radix_sort.none", 0)?,
            histogram: ctx
                .device_buffer("radix_sort.histogram", (constants::RADIX_PASSES * constants::RADIX_DIGITS) as usize)?,
            status: ctx.device_buffer("radix_sort.status", status)?,
            args: DispatchArgs::buffer(ctx, "radix_sort.args")?,
            diagnostics: Diagnostics::new(ctx)?,
        })
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
        self.record_any(rec, keys, &scratch.none, count, bits, scratch).keys
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
        self.record_any(rec, keys, payloads, count, bits, scratch)
    }

    fn record_any<'a>(
        &self,
        rec: &mut Recorder,
        keys: &'a Buffer<u32>,
        payloads: &'a Buffer<u32>,
        count: Count<'_>,
        bits: Range<u32>,
        scratch: &'a RadixSortScratch,
    ) -> Sorted<'a> {
        assert!(bits.start <= bits.end && bits.end <= 32, "bits {bits:?} of a 32-bit key");
        let (bit_begin, bit_end) = (bits.start, bits.end);
        let passes = (bit_end - bit_begin).div_ceil(constants::RADIX_BITS);
        let most_payloads = if self.payloads { payloads.len() } else { usize::MAX };
        let capacity = (scratch.capacity as usize).min(keys.len()).min(most_payloads) as u32;
        let mut source = Sorted { keys, payloads };
        let mut target = Sorted { keys: &scratch.keys, payloads: &scratch.payloads };
        if passes == 0 {
            return source;
        }
        let most = match count {
            Count::Host(n) => {
                assert!(n <= capacity, "sort of {n} pairs with room for {capacity}");
                n
            }
            Count::Gpu { buffer, offset } => {
                let tiles = [self.histogram_tile, self.tile];
                self.args.record(rec, (buffer, offset), capacity, tiles, &scratch.args, &scratch.diagnostics);
                capacity
            }
        };
        let rows = self.rows(most);
        let pushed = count.pushed();

        rec.part("clear");
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&scratch.histogram, 0);
        rec.fill_range(&scratch.status, 0..self.status_words(most, passes), 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);

        rec.part("histogram");
        let binds = [("keys", keys.bind()), ("args", scratch.args.bind()), ("histogram", scratch.histogram.bind())];
        let push = RadixHistogramPush { count: pushed, bit_begin, bit_end };
        let (pipeline, tile) = (&self.histogram, self.histogram_tile);
        lookback::dispatch_tiles(rec, pipeline, &binds, &push, count, tile, (&scratch.args, 0));
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);

        let status = || [("status", scratch.status.bind()), ("diagnostics", scratch.diagnostics.buffer().bind())];
        rec.part("digits");
        let [words, diagnostics] = status();
        let binds = [("histogram", scratch.histogram.bind()), words, diagnostics];
        rec.dispatch(&self.scan, &binds, &RadixScanPush { rows }, [passes, 1, 1]);

        for pass in 0..passes {
            rec.part(["pass 1", "pass 2", "pass 3", "pass 4"][pass as usize]);
            // Histogram's reads and the pass before: its keys are read now, what it read is overwritten.
            rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
            let [words, diagnostics] = status();
            let binds = [
                ("keys_in", source.keys.bind()),
                ("payloads_in", source.payloads.bind()),
                ("keys_out", target.keys.bind()),
                ("payloads_out", target.payloads.bind()),
                ("args", scratch.args.bind()),
                words,
                diagnostics,
            ];
            let push = RadixOnesweepPush { count: pushed, pass, bit_begin, bit_end, rows };
            lookback::dispatch_tiles(rec, &self.onesweep, &binds, &push, count, self.tile, (&scratch.args, 4));
            std::mem::swap(&mut source, &mut target);
        }
        source
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
}
