//! Selection by flags (stream compaction).

use super::{Buffer, Carry, Context, Count, Recording, Word, bound, carry_on, check_apart, check_word, most_items};
use crate::passes::select::{self as pass, SelectMemory};
use crate::{Error, Result};

/// What is selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selected {
    /// Words of a buffer.
    Items,
    /// The indices of the set flags.
    Indices,
}

/// Selects the items whose flag is set, in their order: its pipelines.
pub struct Select {
    pass: pass::Select,
    selected: Selected,
}

/// Memory of selections of up to so many items.
pub struct SelectScratch {
    memory: SelectMemory,
    capacity: u32,
    /// The caller's memory that it is in.
    within: Option<Buffer<u32>>,
}

const WHAT: &str = "select";

impl Select {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, selected: Selected) -> Result<Self> {
        Self::with_carry(ctx, selected, carry_on(ctx))
    }

    /// The same, with sums carried in this way instead of the one for the driver.
    pub fn with_carry(ctx: &Context, selected: Selected, carry: Carry) -> Result<Self> {
        Ok(Self { pass: pass::Select::new(ctx, selected == Selected::Indices, carry)?, selected })
    }

    /// Bytes that [`Select::scratch_in`] takes for selections from up to `capacity` items: 8 for every tile, and some.
    /// Nothing is allocated.
    pub fn scratch_bytes(&self, ctx: &Context, capacity: u32) -> u64 {
        4 * self.pass.memory_words(ctx, capacity)
    }

    /// Scratch memory of ours for selections from up to `capacity` items.
    ///
    /// Errors: `capacity` is above [`MAX_ITEMS`](super::MAX_ITEMS), or memory runs out.
    pub fn scratch(&self, ctx: &Context, capacity: u32) -> Result<SelectScratch> {
        Ok(SelectScratch { memory: self.pass.memory(ctx, None, capacity)?, capacity, within: None })
    }

    /// Scratch memory of the caller's for selections from up to `capacity` items: the first [`Select::scratch_bytes`] of
    /// `memory`, whose buffer has the usages `STORAGE_BUFFER`, `TRANSFER_DST` and `INDIRECT_BUFFER`.
    ///
    /// Errors: as [`Select::scratch`], and `memory` is too small.
    pub fn scratch_in(&self, ctx: &Context, memory: &Buffer<u32>, capacity: u32) -> Result<SelectScratch> {
        let within = Some(memory.clone());
        Ok(SelectScratch { memory: self.pass.memory(ctx, Some(memory), capacity)?, capacity, within })
    }

    /// Writes those of the first `count` items whose word of `flags` is not 0 to `selected`, in their order, and how many
    /// there are to `total`, which the next primitive may take for its [`Count::Gpu`]. `items` is given to a selection of
    /// [`Selected::Items`], and not to one of [`Selected::Indices`]. `selected` has room for `count` items, and what is
    /// behind those selected stays as it is.
    ///
    /// | buffer | first access | last access |
    /// |---|---|---|
    /// | `flags`, `items` | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | the same |
    /// | `selected`, `total` | `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` | the same |
    /// | count on the GPU | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | the same |
    /// | scratch | `ALL_TRANSFER`, `TRANSFER_WRITE`, and `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` and `SHADER_STORAGE_WRITE`, and `DRAW_INDIRECT`, `INDIRECT_COMMAND_READ` |
    ///
    /// Recorded inside: see the [module](super). Scratch memory may be used again by the next `record…` without a barrier.
    ///
    /// Errors: `items` is missing or too much; a count beyond buffers or scratch memory (on the GPU:
    /// [`Recorded::check`](super::Recorded::check)); memory that overlaps (flags may be their own items).
    #[allow(clippy::too_many_arguments, reason = "each is another buffer")]
    pub fn record(
        &self,
        recording: &mut Recording,
        flags: &Buffer<u32>,
        items: Option<&Buffer<u32>>,
        selected: &Buffer<u32>,
        total: Word<'_>,
        count: Count<'_>,
        scratch: &SelectScratch,
    ) -> Result<()> {
        if items.is_some() != (self.selected == Selected::Items) {
            let problem = format!("it was made for Selected::{:?}", self.selected);
            return Err(Error::input(
                WHAT,
                problem,
                "Selected::Items goes with a buffer of items, Selected::Indices without",
            ));
        }
        check_word(WHAT, "total", total.buffer, total.offset)?;
        let own_items = items.filter(|items| !items.is_same(flags));
        let mut arrays = vec![("flags", flags), ("selected", selected), ("total", total.buffer)];
        arrays.extend(own_items.map(|items| ("items", items)));
        arrays.extend(scratch.within.iter().map(|within| ("scratch memory", within)));
        check_apart(WHAT, &arrays)?;
        let lengths = [Some(flags), items, Some(selected)].into_iter().flatten().map(Buffer::len);
        let n = most_items(WHAT, count, lengths.fold(scratch.capacity as usize, usize::min))?;
        let items = items.map(|items| bound(items, n));
        self.pass.record(
            &mut recording.recorder,
            (&bound(flags, n), items.as_ref()),
            (&bound(selected, n), (total.buffer, total.offset)),
            count,
            &scratch.memory,
            &recording.diagnostics,
        );
        Ok(())
    }
}
