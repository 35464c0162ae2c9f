//! The hash-bucket proxy of the volume's current colours (DESIGN section 2), rebuilt on the GPU for every order:
//! hash (`source_max.comp`, `encode.comp`, and the [quantiser](super::quantiser)), compress 1 (`compress_runs.comp`), sort,
//! compress 2 (`compress_buckets.comp`), decompress (`decompress.comp`).
//!
//! Differences from the paper: the sort's payload is the run's number, not its base, since a number gives base and size
//! with one read each; bucketBase is the scan of bucketSize, positions in the voxels ordered by hash.
//! Counts never leave the GPU. If there are more runs than the lists hold, the pass tries coarser masks by itself
//! (`proxy_plan.comp`), and the mask in use is reported.

use super::classify::voxel_grid;
use super::compact::{ChunkArgs, List, TILE, lookback_constants};
use super::lookback::{self, Carry, Columns, Count, Diagnostics, DispatchArgs, Groups, Report, TileKernel};
use super::quantiser::Quantiser;
use super::radix_sort::{RadixSort, RadixSortConfig, RadixSortScratch, Sorted};
use super::scan::{Scan, ScanConfig, ScanScratch};
use super::scene_data::SceneData;
use super::tuning::{Tuning, carry_on};
use super::{LIST_WORKGROUP, order_compute};
use crate::Result;
use crate::abi::{BucketLightPush, ChunkPush, CompressBucketsPush, CompressRunsPush, ProxyPlanPush};
use crate::scene::Mask;
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Filter, Image, ImageFormat, Pipeline, Recorder};
use std::ops::Range;

/// Options of a [`Proxy`].
#[derive(Clone, Copy, Debug)]
pub struct ProxyConfig {
    /// What the hash keeps of a colour.
    pub mask: Mask,
    /// Runs that the lists hold; `None`: one per voxel, as far as a storage buffer goes.
    pub capacity: Option<u32>,
    /// For tests: every bucketColor is set to zero after the build, which makes all candidates look the same.
    pub zero_colors: bool,
    /// For tests: when not 0, every `withhold`-th tile of each look-back never publishes, as if it had been suspended.
    pub withhold: u32,
    /// For tests: how sums get from tile to tile, instead of the device's way.
    pub carry: Option<Carry>,
}

impl ProxyConfig {
    /// What users get.
    pub const fn of(mask: Mask) -> Self {
        Self { mask, capacity: None, zero_colors: false, withhold: 0, carry: None }
    }
}

/// The proxy with all its memory.
pub struct Proxy {
    config: ProxyConfig,
    capacity: u32,
    bytes: u64,
    source_max_pass: Pipeline,
    encode: Pipeline,
    quantiser: Quantiser,
    plan: Pipeline,
    compress_runs: TileKernel,
    compress_buckets: TileKernel,
    bucket_light_pass: Pipeline,
    decompress: Pipeline,
    sort: RadixSort,
    sort_scratch: RadixSortScratch,
    scan: Scan,
    scan_scratch: ScanScratch,
    args_pass: DispatchArgs,
    run_args: Buffer<u32>,
    bucket_args: Buffer<u32>,
    plan_args: Buffer<u32>,
    status: Buffer<u32>,
    diagnostics: Diagnostics,
    source_max: Buffer<u32>,
    control: Buffer<u32>,
    run_hash: Buffer<u32>,
    run_base: Buffer<u32>,
    run_number: Buffer<u32>,
    run_bucket: Buffer<u32>,
    color: Image,
    tables: BucketTable,
    pub(super) bucket_id: Image,
    pub(super) bucket_light: Buffer<u32>,
}

/// The paper's bucket table.
struct BucketTable {
    color: Buffer<u32>,
    hash: Buffer<u32>,
    base: Buffer<u32>,
    size: Buffer<u32>,
}

/// What one build found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProxyCounts {
    /// Runs of equal hash.
    pub runs: u32,
    /// Buckets.
    pub buckets: u32,
    /// Mask in use: the configured one or a coarser one.
    pub mask: Mask,
    /// Levels of R, G, B, A.
    pub levels: [u32; 4],
}

impl ProxyCounts {
    /// Bits of the largest hash that there may be.
    pub fn hash_bits(&self) -> u32 {
        let hashes: u64 = self.levels.iter().map(|&levels| u64::from(levels)).product();
        u64::BITS - hashes.saturating_sub(1).leading_zeros()
    }
}

/// A proxy read back, for tests.
#[derive(Clone, Debug)]
pub struct ProxyContents {
    /// Counts and mask.
    pub counts: ProxyCounts,
    /// Colour of every voxel before masking, x fastest.
    pub color: Vec<u32>,
    /// Bucket of every voxel.
    pub bucket_id: Vec<u32>,
    /// bucketColor.
    pub bucket_color: Vec<u32>,
    /// hashValue.
    pub hash_value: Vec<u32>,
    /// bucketBase.
    pub bucket_base: Vec<u32>,
    /// bucketSize.
    pub bucket_size: Vec<u32>,
    /// Largest source function of the volume, times radiance_scale.
    pub source_max: f32,
    /// What proxy rays read of every bucket: two half floats, source function and extinction.
    pub bucket_light: Vec<u32>,
    /// The quantiser's tables, laid out as `constants::QUANTISER_*`.
    pub quantiser: Vec<u32>,
}

/// Coarser masks that may be tried: after eight every channel has lost all its bits, or the tolerance exceeds 1 and allows
/// anything, and one run is left.
const MAX_RETRIES: u32 = 8;

impl Proxy {
    /// Makes the pipelines and allocates everything for the volume of `scene`.
    pub fn new(ctx: &Context, scene: &SceneData, config: ProxyConfig) -> Result<Self> {
        let voxels = u32::try_from(scene.voxels()).unwrap_or(u32::MAX);
        let most = (ctx.max_storage_bytes() / 4).min(u64::from(lookback::MAX_ITEMS)) as u32;
        let capacity = config.capacity.unwrap_or(u32::MAX).min(voxels).min(most).max(1);
        // A hash of b bits has at most 2^b values.
        let buckets = match config.mask {
            Mask::Channels(_) => {
                1_u32.checked_shl(config.mask.word().count_ones()).map_or(capacity, |n| capacity.min(n))
            }
            Mask::Adaptive(_) => capacity,
        };
        let withhold = config.withhold;
        let specialization = [&lookback_constants(ctx)[..], &[("WITHHOLD", withhold)]].concat();
        let list = [("WORKGROUP", LIST_WORKGROUP)];
        let tuning = Tuning::of(ctx);
        let carry = config.carry.unwrap_or_else(|| carry_on(ctx));
        let sort = RadixSort::new(ctx, RadixSortConfig { withhold, carry, ..tuning.sort })?;
        let scan = Scan::new(ctx, ScanConfig { withhold, carry, ..tuning.scan })?;
        let tiles = voxels.div_ceil(TILE);
        let runs = |name| ctx.device_buffer::<u32>(name, capacity as usize);
        let table = |name| ctx.device_buffer::<u32>(name, buckets as usize);
        let dims = scene.params.dims;
        let mut proxy = Self {
            capacity,
            bytes: 0,
            source_max_pass: Pipeline::new(ctx, &shaders::SOURCE_MAX, &list)?,
            encode: Pipeline::new(ctx, &shaders::ENCODE, &list)?,
            quantiser: Quantiser::new(ctx, config.mask)?,
            plan: Pipeline::new(ctx, &shaders::PROXY_PLAN, &[("ADAPTIVE", config.mask.is_adaptive().into())])?,
            compress_runs: TileKernel::new(ctx, &shaders::COMPRESS_RUNS, &specialization, carry)?,
            compress_buckets: TileKernel::new(ctx, &shaders::COMPRESS_BUCKETS, &specialization, carry)?,
            bucket_light_pass: Pipeline::new(ctx, &shaders::BUCKET_LIGHT, &list)?,
            decompress: Pipeline::new(ctx, &shaders::DECOMPRESS, &[])?,
            sort_scratch: sort.scratch(ctx, capacity)?,
            scan_scratch: scan.scratch(ctx, buckets)?,
            args_pass: DispatchArgs::new(ctx)?,
            run_args: DispatchArgs::buffer(ctx, "proxy.run_args")?,
            bucket_args: DispatchArgs::buffer(ctx, "proxy.bucket_args")?,
            plan_args: ctx.device_buffer("proxy.plan_args", 6)?,
            status: ctx.device_buffer("proxy.status", lookback::status_words(tiles))?,
            diagnostics: Diagnostics::new(ctx)?,
            source_max: ctx.device_buffer("proxy.source_max", 1)?,
            control: ctx.upload("proxy.control", &[0u32; constants::PROXY_WORDS as usize])?,
            run_hash: runs("proxy.run_hash")?,
            run_base: runs("proxy.run_base")?,
            run_number: runs("proxy.run_number")?,
            run_bucket: runs("proxy.run_bucket")?,
            color: ctx.image_3d("proxy.color", dims, ImageFormat::R32Uint)?,
            tables: BucketTable {
                color: table("proxy.bucket_color")?,
                hash: table("proxy.hash_value")?,
                base: table("proxy.bucket_base")?,
                size: table("proxy.bucket_size")?,
            },
            bucket_id: ctx.image_3d("proxy.bucket_id", dims, ImageFormat::R32Uint)?,
            bucket_light: ctx.device_buffer("proxy.bucket_light", buckets as usize)?,
            config,
            sort,
            scan,
        };
        let words = 4 * u64::from(capacity) + 5 * u64::from(buckets);
        let scratch = proxy.sort.scratch_bytes(capacity) + proxy.scan.scratch_bytes(buckets) + proxy.status.bytes();
        let quantiser = proxy.quantiser.table().bytes() + proxy.quantiser.histogram().bytes();
        proxy.bytes = 4 * words + scratch + quantiser + proxy.color.bytes() + proxy.bucket_id.bytes();
        Ok(proxy)
    }

    /// Bytes of device memory of the proxy, scratch memory included.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Where the counts of the latest build are: `constants::PROXY_WORDS` words, laid out as `PROXY_*`.
    pub fn control(&self) -> &Buffer<u32> {
        &self.control
    }

    /// Empties the colours. To be recorded once, before the first build: voxels that are not active keep colour 0.
    pub fn record_clear(&self, rec: &mut Recorder) {
        rec.clear_image(&self.color);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
    }

    /// Builds the proxy of `field`'s colours. `list` holds the active voxels, `args` its chunks.
    ///
    /// Ordered after all compute accesses before; ends with the proxy written by compute.
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        list: &List,
        args: &ChunkArgs,
        field: &Image,
        iteration: u32,
    ) {
        rec.begin_pass("proxy.hash", iteration);
        self.record_hash(rec, scene, list, args, field);
        rec.end_pass();
        rec.begin_pass("proxy.compress1", iteration);
        self.record_compress_runs(rec, scene);
        rec.end_pass();
        rec.begin_pass("proxy.sort", iteration);
        let sorted = self.record_sort(rec);
        rec.end_pass();
        rec.begin_pass("proxy.compress2", iteration);
        self.record_compress_buckets(rec, scene, sorted.keys, sorted.payloads);
        rec.end_pass();
        rec.begin_pass("proxy.decompress", iteration);
        order_compute(rec);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("run_bucket", self.run_bucket.bind()),
            ("bucket_id", self.bucket_id.storage()),
        ];
        rec.dispatch(&self.decompress, &binds, &(), voxel_grid(scene.params.dims));
        rec.end_pass();
    }

    fn record_hash(&self, rec: &mut Recorder, scene: &SceneData, list: &List, args: &ChunkArgs, field: &Image) {
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.source_max, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        for chunk in list.chunks() {
            order_compute(rec);
            let push = ChunkPush { chunk_begin: chunk.begin, chunk_items: chunk.items };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("field", field.sampled(Filter::Nearest)),
                ("source_max", self.source_max.bind()),
            ];
            chunk.dispatch(rec, &self.source_max_pass, &binds, &push, args);
        }
        order_compute(rec);
        for chunk in list.chunks() {
            let push = ChunkPush { chunk_begin: chunk.begin, chunk_items: chunk.items };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("field", field.sampled(Filter::Nearest)),
                ("source_max", self.source_max.bind()),
                ("color", self.color.storage()),
            ];
            chunk.dispatch(rec, &self.encode, &binds, &push, args);
            // Chunks write different texels, but the image is one resource.
            order_compute(rec);
        }
        self.quantiser.record_histogram(rec, scene, &self.color);
    }

    fn record_sort(&self, rec: &mut Recorder) -> Sorted<'_> {
        let mut sort = |offset: u32, bits: Range<u32>| {
            let runs = Count::Gpu { buffer: &self.control, offset };
            self.sort.record(rec, &self.run_hash, &self.run_number, runs, bits, &self.sort_scratch)
        };
        match self.config.mask {
            Mask::Channels(_) => sort(constants::PROXY_RUNS, 0..self.config.mask.word().count_ones()),
            // How many bits there are only the GPU knows. Sorting is stable, so the upper ones may be sorted by afterwards, or
            // not at all: of no runs. Either sort has two passes, and leaves its result where it was.
            Mask::Adaptive(_) => {
                sort(constants::PROXY_RUNS, 0..constants::EARLY_BITS);
                sort(constants::PROXY_LATE_RUNS, constants::EARLY_BITS..32)
            }
        }
    }

    fn record_compress_runs(&self, rec: &mut Recorder, scene: &SceneData) {
        let voxels = scene.voxels() as u32;
        let grid = lookback::grid(voxels.div_ceil(TILE));
        let plan = |rec: &mut Recorder, is_start: bool| {
            let push = ProxyPlanPush {
                capacity: self.capacity,
                groups_x: grid[0],
                groups_y: grid[1],
                is_start: is_start.into(),
                mask: self.config.mask.word(),
            };
            order_compute(rec);
            rec.barrier(Access::IndirectRead, Access::ComputeWrite);
            let binds = [("proxy_control", self.control.bind()), ("args", self.plan_args.bind())];
            rec.dispatch(&self.plan, &binds, &push, [1, 1, 1]);
            rec.barrier(Access::ComputeWrite, Access::IndirectRead);
        };
        plan(rec, true);
        // Where every voxel may have a run of its own, the first attempt always fits.
        let retries = if self.capacity < voxels { MAX_RETRIES } else { 0 };
        for _ in 0..=retries {
            self.quantiser.record(rec, &self.control, &self.plan_args, 3);
            rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
            rec.fill(&self.status, 0);
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
            order_compute(rec);
            let binds = [
                ("scene_block", scene.block.bind()),
                ("color", self.color.sampled(Filter::Nearest)),
                ("run_hash", self.run_hash.bind()),
                ("run_base", self.run_base.bind()),
                ("run_number", self.run_number.bind()),
                ("proxy_control", self.control.bind()),
                ("status", self.status.bind()),
                ("diagnostics", self.diagnostics.buffer().bind()),
                ("bucket_id", self.bucket_id.storage()),
                ("quantiser", self.quantiser.table().bind()),
            ];
            let push = CompressRunsPush { count: voxels, capacity: self.capacity };
            let sums = Columns::of_tiles(&self.status, &self.diagnostics, voxels.div_ceil(TILE));
            self.compress_runs.run(rec, &binds, &push, Groups::Indirect(&self.plan_args), &sums);
            plan(rec, false);
        }
    }

    fn record_compress_buckets(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        sorted_hash: &Buffer<u32>,
        sorted_run: &Buffer<u32>,
    ) {
        let runs = (&self.control, constants::PROXY_RUNS);
        self.args_pass.record(rec, runs, self.capacity, (TILE, 0), &self.run_args, &self.diagnostics);
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.status, 0);
        rec.fill(&self.tables.size, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        order_compute(rec);
        let binds = [
            ("args", self.run_args.bind()),
            ("sorted_hash", sorted_hash.bind()),
            ("sorted_run", sorted_run.bind()),
            ("run_base", self.run_base.bind()),
            ("run_bucket", self.run_bucket.bind()),
            ("bucket_color", self.tables.color.bind()),
            ("hash_value", self.tables.hash.bind()),
            ("bucket_size", self.tables.size.bind()),
            ("proxy_control", self.control.bind()),
            ("status", self.status.bind()),
            ("diagnostics", self.diagnostics.buffer().bind()),
            ("quantiser", self.quantiser.table().bind()),
        ];
        let push = CompressBucketsPush { count: constants::COUNT_ON_DEVICE, voxels: scene.voxels() as u32 };
        let sums = Columns::of_tiles(&self.status, &self.diagnostics, self.capacity.div_ceil(TILE));
        self.compress_buckets.run(rec, &binds, &push, Groups::Indirect(&self.run_args), &sums);

        let buckets = Count::Gpu { buffer: &self.control, offset: constants::PROXY_BUCKETS };
        self.scan.record(rec, &self.tables.size, &self.tables.base, buckets, &self.scan_scratch);
        if self.config.zero_colors {
            rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
            rec.fill(&self.tables.color, 0);
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        }
        let (counts, room) = ((&self.control, constants::PROXY_BUCKETS), self.bucket_light.len() as u32);
        self.args_pass.record(rec, counts, room, (LIST_WORKGROUP, 0), &self.bucket_args, &self.diagnostics);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("bucket_color", self.tables.color.bind()),
            ("quantiser", self.quantiser.table().bind()),
            ("source_max", self.source_max.bind()),
            ("args", self.bucket_args.bind()),
            ("bucket_light", self.bucket_light.bind()),
        ];
        let push = BucketLightPush { count: constants::COUNT_ON_DEVICE };
        rec.dispatch_indirect(&self.bucket_light_pass, &binds, &push, &self.bucket_args, 0);
    }

    /// Counts from the words of [`Proxy::control`].
    pub fn counts(&self, words: &[u32]) -> ProxyCounts {
        let levels = constants::PROXY_LEVELS as usize;
        ProxyCounts {
            runs: words[constants::PROXY_RUNS as usize],
            buckets: words[constants::PROXY_BUCKETS as usize],
            mask: self.config.mask.with_word(words[constants::PROXY_MASK as usize]),
            levels: words[levels..levels + 4].try_into().expect("four words"),
        }
    }

    /// What the two compressions reported. Fails if a kernel reported that its result cannot be trusted.
    pub fn check(&self, ctx: &Context) -> Result<Report> {
        self.sort_scratch.diagnostics().check(ctx, "proxy.sort")?;
        self.scan_scratch.diagnostics().check(ctx, "proxy.scan")?;
        self.diagnostics.check(ctx, "proxy")
    }

    /// Bucket of every voxel.
    pub fn bucket_id(&self) -> &Image {
        &self.bucket_id
    }

    /// What rays read of every bucket: two half floats, source function and extinction.
    pub fn bucket_light(&self) -> &Buffer<u32> {
        &self.bucket_light
    }

    /// Everything, for tests.
    pub fn read_back(&self, ctx: &Context) -> Result<ProxyContents> {
        let counts = self.counts(&ctx.read_back(&self.control)?);
        let table = |buffer| ctx.read_back_range(buffer, 0..counts.buckets as usize);
        Ok(ProxyContents {
            counts,
            color: ctx.read_back_image(&self.color)?,
            bucket_id: ctx.read_back_image(&self.bucket_id)?,
            bucket_color: table(&self.tables.color)?,
            hash_value: table(&self.tables.hash)?,
            bucket_base: table(&self.tables.base)?,
            bucket_size: table(&self.tables.size)?,
            source_max: f32::from_bits(ctx.read_back(&self.source_max)?[0]),
            bucket_light: table(&self.bucket_light)?,
            quantiser: ctx.read_back(self.quantiser.table())?,
        })
    }
}
