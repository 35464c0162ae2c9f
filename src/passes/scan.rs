//! Scan (prefix sum, modulo 2³²) of u32 items in one pass: `glsl/scan.comp`.

use super::lookback::{self, Count, Diagnostics, DispatchArgs};
use crate::Result;
use crate::abi::ScanPush;
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Pipeline, Recorder};

/// Options of a [`Scan`]. The defaults are right except for tests.
#[derive(Clone, Copy, Debug)]
pub struct ScanConfig {
    /// Whether a sum includes its own item.
    pub inclusive: bool,
    /// Invocations of a workgroup: a multiple of the subgroup size.
    pub workgroup: u32,
    /// Vectors of four items per invocation, 1 to 32.
    pub vectors: u32,
    /// Polls of a missing predecessor before its tile is computed in its place.
    pub spin_limit: u32,
    /// When not 0, every so-manieth tile behaves as if suspended for ever.
    pub withhold: u32,
}

impl Default for ScanConfig {
    fn default() -> Self {
        Self { inclusive: false, workgroup: 256, vectors: 4, spin_limit: 64, withhold: 0 }
    }
}

/// The pass.
pub struct Scan {
    pipeline: Pipeline,
    args: DispatchArgs,
    tile: u32,
}

/// What a scan of up to `capacity` items needs besides input and output.
pub struct ScanScratch {
    capacity: u32,
    status: Buffer<u32>,
    args: Buffer<u32>,
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
        assert!((1..=32).contains(&config.vectors), "{} vectors; scan.comp takes 1 to 32", config.vectors);
        lookback::check_workgroup(ctx, "scan", config.workgroup)?;
        let specialization = [
            ("WORKGROUP", config.workgroup),
            ("SUBGROUP_MIN", ctx.min_subgroup_size()),
            ("SPIN_LIMIT", config.spin_limit),
            ("WITHHOLD", config.withhold),
            ("VECTORS", config.vectors),
            ("INCLUSIVE_SCAN", config.inclusive.into()),
        ];
        Ok(Self {
            pipeline: Pipeline::new(ctx, &shaders::SCAN, &specialization)?,
            args: DispatchArgs::new(ctx)?,
            tile: config.workgroup * config.vectors * 4,
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
        lookback::check_capacity("scan", capacity)?;
        Ok(ScanScratch {
            capacity,
            status: ctx.device_buffer("scan.status", lookback::status_words(capacity.div_ceil(self.tile)))?,
            args: DispatchArgs::buffer(ctx, "scan.args")?,
            diagnostics: Diagnostics::new(ctx)?,
        })
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
        let capacity = (scratch.capacity as usize).min(input.len()).min(output.len()) as u32;
        let tiles = match count {
            Count::Host(n) => {
                assert!(n <= capacity, "scan of {n} items with room for {capacity}");
                n.div_ceil(self.tile)
            }
            Count::Gpu { buffer, offset } => {
                let (args, diagnostics) = (&scratch.args, &scratch.diagnostics);
                self.args.record(rec, (buffer, offset), capacity, [self.tile; 2], args, diagnostics);
                capacity.div_ceil(self.tile)
            }
        };
        rec.part("clear");
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill_range(&scratch.status, 0..lookback::status_words(tiles) as u64, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
        rec.part("scan");
        let binds = [
            ("items", input.bind()),
            ("sums", output.bind()),
            ("args", scratch.args.bind()),
            ("status", scratch.status.bind()),
            ("diagnostics", scratch.diagnostics.buffer().bind()),
        ];
        let push = ScanPush { count: count.pushed() };
        lookback::dispatch_tiles(rec, &self.pipeline, &binds, &push, count, self.tile, (&scratch.args, 0));
    }
}
