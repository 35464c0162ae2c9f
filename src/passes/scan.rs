//! Scan (prefix sum, modulo 2³²) of u32 items, in one pass or by reduce-then-scan: `glsl/scan.comp`.

use super::lookback::{self, Carry, Columns, Count, Diagnostics, DispatchArgs, Groups, TileKernel};
use crate::Result;
use crate::abi::ScanPush;
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Recorder};

/// Options of a [`Scan`]; [`Tuning`](super::tuning::Tuning) has those that suit a device.
#[derive(Clone, Copy, Debug)]
pub struct ScanConfig {
    /// Whether a sum includes its own item.
    pub inclusive: bool,
    /// Whether the sum of all items is wanted.
    pub total: bool,
    /// Whether input and output may end amid a vector of four items.
    pub ends_amid: bool,
    /// Invocations of a workgroup: a multiple of the subgroup size.
    pub workgroup: u32,
    /// Vectors of four items per invocation, 1 to 32; if `blocked`, a multiple of 8 up to 256.
    pub vectors: u32,
    /// Whether an invocation owns a run of vectors, instead of every so-manieth of its subgroup's: fewer operations of a subgroup,
    /// and loads of neighbouring invocations that are apart, which only a processor does not mind.
    pub blocked: bool,
    /// How sums get from tile to tile.
    pub carry: Carry,
    /// Polls of a missing predecessor before its tile is computed in its place.
    pub spin_limit: u32,
    /// When not 0, every so-manieth tile behaves as if suspended for ever.
    pub withhold: u32,
}

impl ScanConfig {
    /// Can an invocation have so many vectors? The loops of scan.comp take 1 to 32 steps.
    pub fn vectors_fit(&self) -> bool {
        let each = if self.blocked { constants::SCAN_RUN_VECTORS } else { 1 };
        self.vectors.is_multiple_of(each) && (1..=32).contains(&(self.vectors / each))
    }
}

impl Default for ScanConfig {
    fn default() -> Self {
        Self {
            inclusive: false,
            total: false,
            ends_amid: false,
            workgroup: 256,
            vectors: 4,
            blocked: false,
            carry: Carry::LookBack,
            spin_limit: 64,
            withhold: 0,
        }
    }
}

/// The pass.
pub struct Scan {
    kernel: TileKernel,
    args: DispatchArgs,
    tile: u32,
    total: bool,
}

/// Memory of a scan of up to `capacity` items.
pub(crate) struct ScanMemory {
    capacity: u32,
    /// In place of the caller's total, where none is wanted.
    none: Buffer<u32>,
    status: Buffer<u32>,
    args: Buffer<u32>,
}

/// What a scan of up to `capacity` items needs besides input and output.
pub struct ScanScratch {
    memory: ScanMemory,
    diagnostics: Diagnostics,
}

impl ScanScratch {
    /// What the kernels report; check it after the submission.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }
}

impl Scan {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, config: ScanConfig) -> Result<Self> {
        assert!(config.vectors_fit(), "{config:?}");
        lookback::check_workgroup(ctx, "scan", config.workgroup)?;
        let specialization = [
            ("WORKGROUP", config.workgroup),
            ("SUBGROUP_MIN", ctx.min_subgroup_size()),
            ("SPIN_LIMIT", config.spin_limit),
            ("WITHHOLD", config.withhold),
            ("VECTORS", config.vectors),
            ("BLOCKED", config.blocked.into()),
            ("INCLUSIVE_SCAN", config.inclusive.into()),
            ("TOTAL", config.total.into()),
            ("ENDS_AMID", config.ends_amid.into()),
        ];
        Ok(Self {
            kernel: TileKernel::new(ctx, &shaders::SCAN, &specialization, config.carry)?,
            args: DispatchArgs::new(ctx)?,
            tile: config.workgroup * config.vectors * 4,
            total: config.total,
        })
    }

    /// Items of a tile.
    pub fn tile(&self) -> u32 {
        self.tile
    }

    /// Bytes of device memory that [`Scan::scratch`] takes.
    pub fn scratch_bytes(&self, capacity: u32) -> u64 {
        let words = lookback::status_words(capacity.div_ceil(self.tile)) as u64;
        4 * (words + u64::from(constants::ARGS_WORDS + constants::DIAGNOSTICS_WORDS))
    }

    /// Memory for scans of up to `capacity` items.
    pub fn scratch(&self, ctx: &Context, capacity: u32) -> Result<ScanScratch> {
        Ok(ScanScratch { memory: self.memory(ctx, None, capacity)?, diagnostics: Diagnostics::new(ctx)? })
    }

    fn parts(&self, capacity: u32) -> [(&'static str, u64); 3] {
        let status = lookback::status_words(capacity.div_ceil(self.tile)) as u64;
        [("scan.none", 1), ("scan.status", status), ("scan.args", constants::ARGS_WORDS.into())]
    }

    /// Words that [`Scan::memory`] takes of what it is given.
    pub(crate) fn memory_words(&self, ctx: &Context, capacity: u32) -> u64 {
        lookback::arrays_words(ctx, &self.parts(capacity))
    }

    /// Memory for scans of up to `capacity` items: new, or a part of `within`.
    pub(crate) fn memory(&self, ctx: &Context, within: Option<&Buffer<u32>>, capacity: u32) -> Result<ScanMemory> {
        lookback::check_capacity("scan", capacity)?;
        let [none, status, args] = lookback::arrays(ctx, within, self.parts(capacity))?;
        Ok(ScanMemory { capacity, none, status, args })
    }

    /// Writes the sums of the first `count` items of `input` to `output`, which must be another buffer.
    ///
    /// Starts by ordering all compute accesses recorded before, so that kernels may have written `input`; ends with
    /// `output` written as [`Access::ComputeWrite`].
    pub fn record(
        &self,
        rec: &mut Recorder,
        input: &Buffer<u32>,
        output: &Buffer<u32>,
        count: Count<'_>,
        scratch: &ScanScratch,
    ) {
        self.record_with_total(rec, [input, output], None, count, &scratch.memory, &scratch.diagnostics);
    }

    /// The same with input and output, and the total to element `total.1` of `total.0`, of a scan made to write it; that is
    /// written by compute too, also for no item.
    pub(crate) fn record_with_total(
        &self,
        rec: &mut Recorder,
        [input, output]: [&Buffer<u32>; 2],
        total: Option<(&Buffer<u32>, u32)>,
        count: Count<'_>,
        memory: &ScanMemory,
        diagnostics: &Diagnostics,
    ) {
        assert_eq!(total.is_some(), self.total, "a total is written by scans that are made to");
        let (totals, total_at) = total.unwrap_or((&memory.none, 0));
        assert!((total_at as usize) < totals.len(), "element {total_at} of '{}'", totals.name());
        let capacity = (memory.capacity as usize).min(input.len()).min(output.len()) as u32;
        let tiles = match count {
            Count::Host(n) => {
                assert!(n <= capacity, "scan of {n} items with room for {capacity}");
                n.div_ceil(self.tile)
            }
            Count::Gpu { buffer, offset } => {
                let (counts, args) = ((buffer, offset), &memory.args);
                self.args.record(rec, counts, capacity, (self.tile, self.total.into()), args, diagnostics);
                capacity.div_ceil(self.tile)
            }
        };
        rec.part("clear");
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill_range(&memory.status, 0..lookback::status_words(tiles) as u64, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
        rec.part("scan");
        let binds = [
            ("items", input.bind()),
            ("sums", output.bind()),
            ("args", memory.args.bind()),
            ("status", memory.status.bind()),
            ("diagnostics", diagnostics.buffer().bind()),
            ("totals", totals.bind()),
        ];
        let push = ScanPush { count: count.pushed(), total_at };
        let dispatched = if self.total { count.at_least_one() } else { count };
        let groups = Groups::of_tiles(dispatched, self.tile, &memory.args);
        self.kernel.run(rec, &binds, &push, groups, &Columns::of_tiles(&memory.status, diagnostics, tiles));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_invocation_has_as_many_vectors_as_the_loops_take() {
        let fit = |blocked, vectors| ScanConfig { blocked, vectors, ..ScanConfig::default() }.vectors_fit();
        assert!([1, 3, 32].iter().all(|&n| fit(false, n)) && ![0, 33, 64].iter().any(|&n| fit(false, n)));
        assert!([8, 24, 256].iter().all(|&n| fit(true, n)) && ![0, 4, 260, 264].iter().any(|&n| fit(true, n)));
    }
}
