//! The scan.

use super::{Buffer, Carry, Context, Count, Recording, Word, bound, carry_on, check_apart, check_word, most_items};
use crate::passes::scan::{self as pass, ScanConfig, ScanMemory};
use crate::passes::tuning::Tuning;
use crate::{Error, Result};

/// What an item's sum is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScanKind {
    /// The items before it.
    Exclusive,
    /// The items before it and the item itself.
    Inclusive,
}

/// Prefix sums of u32 items modulo 2³²: its pipelines.
pub struct Scan {
    pass: pass::Scan,
    has_total: bool,
}

/// Memory of scans of up to so many items.
pub struct ScanScratch {
    memory: ScanMemory,
    capacity: u32,
    /// The caller's memory that it is in.
    within: Option<Buffer<u32>>,
}

const WHAT: &str = "scan";

impl Scan {
    /// Makes the pipelines, in the shape that suits the device. `has_total`: the sum of all items is written too.
    pub fn new(ctx: &Context, kind: ScanKind, has_total: bool) -> Result<Self> {
        Self::with_carry(ctx, kind, has_total, carry_on(ctx))
    }

    /// The same, with sums carried in this way instead of the one for the driver.
    pub fn with_carry(ctx: &Context, kind: ScanKind, has_total: bool, carry: Carry) -> Result<Self> {
        let config = ScanConfig {
            inclusive: kind == ScanKind::Inclusive,
            total: has_total,
            ends_amid: true,
            carry,
            ..Tuning::of(ctx).scan
        };
        Ok(Self { pass: pass::Scan::new(ctx, config)?, has_total })
    }

    /// Items of a tile: what a workgroup scans.
    pub fn tile(&self) -> u32 {
        self.pass.tile()
    }

    /// Bytes that [`Scan::scratch_in`] takes for scans of up to `capacity` items: 8 for every tile, and some. Nothing is
    /// allocated.
    pub fn scratch_bytes(&self, ctx: &Context, capacity: u32) -> u64 {
        4 * self.pass.memory_words(ctx, capacity)
    }

    /// Scratch memory of ours for scans of up to `capacity` items.
    ///
    /// Errors: `capacity` is above [`MAX_ITEMS`](super::MAX_ITEMS), or memory runs out.
    pub fn scratch(&self, ctx: &Context, capacity: u32) -> Result<ScanScratch> {
        Ok(ScanScratch { memory: self.pass.memory(ctx, None, capacity)?, capacity, within: None })
    }

    /// Scratch memory of the caller's for scans of up to `capacity` items: the first [`Scan::scratch_bytes`] of `memory`,
    /// whose buffer has the usages `STORAGE_BUFFER`, `TRANSFER_DST` and `INDIRECT_BUFFER`.
    ///
    /// Errors: as [`Scan::scratch`], and `memory` is too small.
    pub fn scratch_in(&self, ctx: &Context, memory: &Buffer<u32>, capacity: u32) -> Result<ScanScratch> {
        let within = Some(memory.clone());
        Ok(ScanScratch { memory: self.pass.memory(ctx, Some(memory), capacity)?, capacity, within })
    }

    /// Writes the sums of the first `count` items of `items` to `sums`, which must not overlap it, and the sum of all of
    /// them to `total`, which a scan made to write it needs; it is 0 for no items.
    ///
    /// | buffer | first access | last access |
    /// |---|---|---|
    /// | `items` | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | the same |
    /// | `sums`, `total` | `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` | the same |
    /// | count on the GPU | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | the same |
    /// | scratch | `ALL_TRANSFER`, `TRANSFER_WRITE`, and `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` and `SHADER_STORAGE_WRITE`, and `DRAW_INDIRECT`, `INDIRECT_COMMAND_READ` |
    ///
    /// Recorded inside: see the [module](super). Scratch memory may be used again by the next `record…` without a barrier.
    ///
    /// Errors: `total` is wanted and not given, or the other way round; a count beyond buffers or scratch memory (on the
    /// GPU: [`Recorded::check`](super::Recorded::check)); memory that overlaps.
    pub fn record(
        &self,
        recording: &mut Recording,
        items: &Buffer<u32>,
        sums: &Buffer<u32>,
        total: Option<Word<'_>>,
        count: Count<'_>,
        scratch: &ScanScratch,
    ) -> Result<()> {
        if total.is_some() != self.has_total {
            let problem = format!("it was made with has_total = {}", self.has_total);
            return Err(Error::input(WHAT, problem, "give a total to a scan that writes it, and only to such"));
        }
        let mut arrays = vec![("items", items), ("sums", sums)];
        if let Some(Word { buffer, offset }) = total {
            check_word(WHAT, "total", buffer, offset)?;
            arrays.push(("total", buffer));
        }
        arrays.extend(scratch.within.iter().map(|within| ("scratch memory", within)));
        check_apart(WHAT, &arrays)?;
        let n = most_items(WHAT, count, items.len().min(sums.len()).min(scratch.capacity as usize))?;
        self.pass.record_with_total(
            &mut recording.recorder,
            [&bound(items, n), &bound(sums, n)],
            total.map(|word| (word.buffer, word.offset)),
            count,
            &scratch.memory,
            &recording.diagnostics,
        );
        Ok(())
    }
}
