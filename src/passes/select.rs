//! The items whose flag is set, in their order (stream compaction): `glsl/select.comp`.

use super::compact::{TILE, lookback_constants};
use super::lookback::{self, Carry, Columns, Count, Diagnostics, DispatchArgs, Groups, TileKernel};
use crate::Result;
use crate::abi::SelectPush;
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Recorder};

/// The pass.
pub(crate) struct Select {
    kernel: TileKernel,
    args: DispatchArgs,
    of_indices: bool,
}

/// Memory of selections of up to `capacity` items.
pub(crate) struct SelectMemory {
    capacity: u32,
    /// In place of the caller's items, where they are their own indices.
    none: Buffer<u32>,
    status: Buffer<u32>,
    args: Buffer<u32>,
}

impl Select {
    /// Makes the pipelines. `of_indices`: what is selected are not items of a buffer but their indices.
    pub(crate) fn new(ctx: &Context, of_indices: bool, carry: Carry) -> Result<Self> {
        let specialization = [&lookback_constants(ctx)[..], &[("INDICES", of_indices.into())]].concat();
        Ok(Self {
            kernel: TileKernel::new(ctx, &shaders::SELECT, &specialization, carry)?,
            args: DispatchArgs::new(ctx)?,
            of_indices,
        })
    }

    fn parts(capacity: u32) -> [(&'static str, u64); 3] {
        let status = lookback::status_words(capacity.div_ceil(TILE)) as u64;
        [("select.none", 0), ("select.status", status), ("select.args", constants::ARGS_WORDS.into())]
    }

    /// Words that [`Select::memory`] takes of what it is given.
    pub(crate) fn memory_words(&self, ctx: &Context, capacity: u32) -> u64 {
        lookback::arrays_words(ctx, &Self::parts(capacity))
    }

    /// Memory for selections of up to `capacity` items: new, or a part of `within`.
    pub(crate) fn memory(&self, ctx: &Context, within: Option<&Buffer<u32>>, capacity: u32) -> Result<SelectMemory> {
        lookback::check_capacity("select", capacity)?;
        let [none, status, args] = lookback::arrays(ctx, within, Self::parts(capacity))?;
        Ok(SelectMemory { capacity, none, status, args })
    }

    /// Writes those of the first `count` items whose flag is not 0 to `selected`, which must be another buffer and hold
    /// them all, and their number to element `total.1` of `total.0`.
    ///
    /// Starts by ordering all compute accesses recorded before; ends with `selected` and `total` written as
    /// [`Access::ComputeWrite`].
    pub(crate) fn record(
        &self,
        rec: &mut Recorder,
        (flags, items): (&Buffer<u32>, Option<&Buffer<u32>>),
        (selected, total): (&Buffer<u32>, (&Buffer<u32>, u32)),
        count: Count<'_>,
        memory: &SelectMemory,
        diagnostics: &Diagnostics,
    ) {
        assert_eq!(items.is_none(), self.of_indices, "a selection of items has a buffer of them");
        let most = items.map_or(usize::MAX, Buffer::len).min(flags.len()).min(selected.len());
        let capacity = (memory.capacity as usize).min(most) as u32;
        let tiles = match count {
            Count::Host(n) => {
                assert!(n <= capacity, "selection from {n} items with room for {capacity}");
                n.div_ceil(TILE)
            }
            Count::Gpu { buffer, offset } => {
                self.args.record(rec, (buffer, offset), capacity, (TILE, 1), &memory.args, diagnostics);
                capacity.div_ceil(TILE)
            }
        };
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill_range(&memory.status, 0..lookback::status_words(tiles) as u64, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
        let binds = [
            ("flags", flags.bind()),
            ("items", items.unwrap_or(&memory.none).bind()),
            ("selected", selected.bind()),
            ("args", memory.args.bind()),
            ("totals", total.0.bind()),
            ("status", memory.status.bind()),
            ("diagnostics", diagnostics.buffer().bind()),
        ];
        let push = SelectPush { count: count.pushed(), total_at: total.1 };
        let groups = Groups::of_tiles(count.at_least_one(), TILE, &memory.args);
        self.kernel.run(rec, &binds, &push, groups, &Columns::of_tiles(&memory.status, diagnostics, tiles));
    }
}
