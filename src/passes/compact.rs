//! Lists of the blocks of voxels and the cells that have to do with the medium (`glsl/mark.comp`, `glsl/compact.comp`),
//! and kernels over them in chunks (`glsl/chunk_args.comp`).
//!
//! A volume may have more voxels than one storage buffer holds words, so a list is split: each segment lists a range of
//! linear indices.

use super::classify::voxel_grid;
use super::emptiness::Emptiness;
use super::lookback::{self, Carry, Columns, Diagnostics, Groups, TileKernel};
use super::scene_data::SceneData;
use super::tuning::carry_on;
use super::{LIST_WORKGROUP, order_compute};
use crate::abi::{ChunkArgsPush, CompactPush, MarkPush};
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Filter, Image, ImageFormat, Pipeline, Recorder};
use crate::{Error, Result};

/// Invocations of a workgroup of `compact.comp`, and voxels of each: twice as many would take lavapipe twice as long to
/// compile.
const WORKGROUP: u32 = 256;
const ROWS: u32 = 8;

/// The blocks that a volume is cut into: cubes of voxels, cut at its ends. Nodes are their middles, and cells lie between
/// nodes (`glsl/include/cell.glsl`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Voxels along the edge of a block, 1 to `MAX_LIGHT_EDGE`.
    pub edge: u32,
    /// Blocks along x, y, z.
    pub dims: [u32; 3],
}

impl Blocks {
    /// Those of a volume of `voxels`.
    pub fn of(voxels: [u32; 3], edge: u32) -> Self {
        Self { edge, dims: voxels.map(|d| d.div_ceil(edge)) }
    }

    /// Cells along x, y, z.
    pub fn cells(self) -> [u32; 3] {
        self.dims.map(|d| d + 1)
    }
}

/// What is in a list, by linear index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listed {
    /// Blocks with extinction: voxels, where these are blocks.
    Voxels,
    /// Nodes at a corner of a cell with extinction. Where blocks are voxels: those with extinction and their 26 neighbours.
    Nodes,
    /// Cells with extinction.
    Cells,
    /// Of those, the ones that the eye sees ([`See`](super::see::See)).
    SeenCells,
    /// The other cells with extinction, but for the remote ones.
    HiddenCells,
    /// Cells with extinction that are out of the eye's reach: none of its rays comes near (`REACH_BLOCK`).
    RemoteCells,
}

/// Marks of all blocks, nodes and cells (`glsl/mark.comp`).
pub struct Marks {
    pipeline: Pipeline,
    blocks: Blocks,
    pub(super) image: Image,
    tally: Buffer<u32>,
}

impl Marks {
    /// Marks for a volume's blocks.
    pub fn new(ctx: &Context, blocks: Blocks) -> Result<Self> {
        Ok(Self {
            pipeline: Pipeline::new(ctx, &shaders::MARK, &[])?,
            blocks,
            image: ctx.image_3d("marks", blocks.cells(), ImageFormat::R32Uint)?,
            tally: ctx.device_buffer("marks.tally", 1)?,
        })
    }

    /// Marks by the extinction of `field`, whose distances are in `emptiness`. Ordered after all compute accesses before;
    /// ends with the marks written by compute.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, field: &Image, emptiness: &Emptiness) {
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.tally, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        order_compute(rec);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("field", field.sampled(Filter::Nearest)),
            ("emptiness", emptiness.image.sampled(Filter::Nearest)),
            ("marks", self.image.storage()),
            ("tally", self.tally.bind()),
        ];
        rec.dispatch(&self.pipeline, &binds, &MarkPush { edge: self.blocks.edge }, voxel_grid(self.blocks.cells()));
    }

    /// Voxels with extinction. Waits for the device.
    pub fn active_voxels(&self, ctx: &Context) -> Result<u64> {
        Ok(ctx.read_back(&self.tally)?[0].into())
    }
}

/// A list.
pub struct List {
    edge: u32,
    segments: Vec<Segment>,
    chunk_items: u32,
    kernel: TileKernel,
    args: Pipeline,
    status: Buffer<u32>,
    diagnostics: Diagnostics,
}

struct Segment {
    first: u32,
    count: u32,
    /// Items: at most `count` until [`List::read_counts`], then as many as there are.
    items: u32,
    list: Buffer<u32>,
    header: Buffer<u32>,
    /// Chunks that may have items: all until [`List::read_counts`], then those that do.
    chunks: u32,
}

/// Arguments of indirect dispatches over all chunks of the list.
pub struct ChunkArgs {
    buffers: Vec<Buffer<u32>>,
}

/// One chunk of the list, as kernels see it.
pub struct Chunk<'a> {
    pub(super) list: &'a Buffer<u32>,
    pub(super) header: &'a Buffer<u32>,
    /// First item in the segment's list.
    pub begin: u32,
    /// Items of a full chunk.
    pub items: u32,
    segment: usize,
    index: u32,
}

impl Chunk<'_> {
    /// Runs a kernel over this chunk with the arguments made for it.
    pub(super) fn dispatch<P: bytemuck::Pod>(
        &self,
        rec: &mut Recorder,
        pipeline: &Pipeline,
        binds: &[(&str, crate::vk::Bind<'_>)],
        push: &P,
        args: &ChunkArgs,
    ) {
        let mut all = vec![("list_items", self.list.bind()), ("list_header", self.header.bind())];
        all.extend_from_slice(binds);
        rec.dispatch_indirect(pipeline, &all, push, &args.buffers[self.segment], 3 * self.index as usize);
    }
}

impl List {
    /// Memory for a list of a volume's blocks, to be worked on in chunks of `chunk_items`. `segment_items` limits the indices of a
    /// segment; `None`: as many as a storage buffer takes.
    ///
    /// Errors: the volume has more cells than 32 bits count, or memory runs out.
    pub fn new(
        ctx: &Context,
        blocks: Blocks,
        listed: Listed,
        chunk_items: u32,
        segment_items: Option<u32>,
    ) -> Result<Self> {
        Self::with_carry(ctx, blocks, listed, chunk_items, segment_items, carry_on(ctx))
    }

    /// The same, with sums carried in this way instead of the device's.
    pub fn with_carry(
        ctx: &Context,
        blocks: Blocks,
        listed: Listed,
        chunk_items: u32,
        segment_items: Option<u32>,
        carry: Carry,
    ) -> Result<Self> {
        let counts = match listed {
            Listed::Cells | Listed::SeenCells | Listed::HiddenCells | Listed::RemoteCells => blocks.cells(),
            Listed::Voxels | Listed::Nodes => blocks.dims,
        };
        let all: u64 = counts.iter().map(|&count| u64::from(count)).product();
        if all > u64::from(u32::MAX) {
            return Err(Error::input("volume", format!("{all} cells are too many"), "resample it to fewer voxels"));
        }
        let most = (ctx.max_storage_bytes() / 4).min(u64::from(lookback::MAX_ITEMS));
        let step = segment_items.map_or(most, |s| most.min(u64::from(s)));
        let mut segments = Vec::new();
        let mut first = 0u64;
        while first < all {
            let count = step.min(all - first) as u32;
            segments.push(Segment {
                first: first as u32,
                count,
                items: count,
                list: ctx.device_buffer("list", count as usize)?,
                header: ctx.upload("list.header", &[0u32; 1])?,
                chunks: count.div_ceil(chunk_items),
            });
            first += u64::from(count);
        }
        let longest = segments.iter().map(|s| s.count).max().unwrap_or(0);
        let kind = match listed {
            Listed::Voxels => constants::LISTED_VOXELS,
            Listed::Nodes => constants::LISTED_NODES,
            Listed::Cells => constants::LISTED_CELLS,
            Listed::SeenCells => constants::LISTED_SEEN,
            Listed::HiddenCells => constants::LISTED_HIDDEN,
            Listed::RemoteCells => constants::LISTED_REMOTE,
        };
        let specialization = [&lookback_constants(ctx)[..], &[("LISTED", kind)]].concat();
        Ok(Self {
            edge: blocks.edge,
            segments,
            chunk_items,
            kernel: TileKernel::new(ctx, &shaders::COMPACT, &specialization, carry)?,
            args: Pipeline::new(ctx, &shaders::CHUNK_ARGS, &[("WORKGROUP", LIST_WORKGROUP)])?,
            status: ctx.device_buffer("compact.status", lookback::status_words(longest.div_ceil(TILE)))?,
            diagnostics: Diagnostics::new(ctx)?,
        })
    }

    /// Lists what is marked; the marks must be of the same blocks. Ordered after all compute accesses before; ends with the
    /// list written by compute.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, marks: &Marks) {
        for segment in &self.segments {
            rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
            rec.fill(&self.status, 0);
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
            order_compute(rec);
            let tiles = segment.count.div_ceil(TILE);
            self.kernel.run(
                rec,
                &[
                    ("scene_block", scene.block.bind()),
                    ("marks", marks.image.sampled(Filter::Nearest)),
                    ("list_items", segment.list.bind()),
                    ("list_header", segment.header.bind()),
                    ("status", self.status.bind()),
                    ("diagnostics", self.diagnostics.buffer().bind()),
                ],
                &CompactPush { first: segment.first, count: segment.count, edge: self.edge },
                Groups::Direct(lookback::grid(tiles)),
                &Columns::of_tiles(&self.status, &self.diagnostics, tiles),
            );
        }
    }

    /// Reads how many items there are, so that no chunk is recorded that has none, and checks the scan's report.
    /// A wait for the device, made once per scene: it belongs to the set-up, not to the iterations.
    pub fn read_counts(&mut self, ctx: &Context) -> Result<u64> {
        self.diagnostics.check(ctx, "compact")?;
        let mut total = 0;
        for segment in &mut self.segments {
            let count = ctx.read_back(&segment.header)?[constants::LIST_COUNT as usize];
            segment.items = count;
            segment.chunks = count.div_ceil(self.chunk_items);
            total += u64::from(count);
        }
        Ok(total)
    }

    /// Number of items; of all indices until [`List::read_counts`].
    pub fn items(&self) -> u64 {
        self.segments.iter().map(|s| u64::from(s.items)).sum()
    }

    /// List, header and number of items of the segment that has most of them.
    pub(super) fn longest_segment(&self) -> Option<(&Buffer<u32>, &Buffer<u32>, u32)> {
        self.segments.iter().max_by_key(|s| s.items).map(|s| (&s.list, &s.header, s.items))
    }

    /// Linear indices of the items, for tests.
    pub fn read_back(&self, ctx: &Context) -> Result<Vec<u32>> {
        let mut all = Vec::new();
        for segment in &self.segments {
            let count = ctx.read_back(&segment.header)?[constants::LIST_COUNT as usize];
            all.extend(ctx.read_back_range(&segment.list, 0..count as usize)?);
        }
        Ok(all)
    }

    /// Arguments for kernels of `workgroup` invocations along x and `groups_y` workgroups along y, one dispatch per
    /// chunk. Ordered after all compute accesses; ends ordered before [`Access::IndirectRead`].
    pub fn chunk_args(&self, ctx: &Context, rec: &mut Recorder, groups_y: u32) -> Result<ChunkArgs> {
        let mut buffers = Vec::new();
        order_compute(rec);
        for segment in &self.segments {
            let args = ctx.device_buffer("chunk args", 3 * segment.chunks as usize)?;
            let push = ChunkArgsPush {
                chunks: segment.chunks,
                chunk_items: self.chunk_items,
                workgroup: LIST_WORKGROUP,
                groups_y,
            };
            let binds = [("list_header", segment.header.bind()), ("args", args.bind())];
            rec.dispatch(&self.args, &binds, &push, [segment.chunks.div_ceil(LIST_WORKGROUP), 1, 1]);
            buffers.push(args);
        }
        rec.barrier(Access::ComputeWrite, Access::IndirectRead);
        Ok(ChunkArgs { buffers })
    }

    /// All chunks.
    pub fn chunks(&self) -> impl Iterator<Item = Chunk<'_>> {
        self.segments.iter().enumerate().flat_map(move |(i, segment)| {
            (0..segment.chunks).map(move |index| Chunk {
                list: &segment.list,
                header: &segment.header,
                begin: index * self.chunk_items,
                items: self.chunk_items,
                segment: i,
                index,
            })
        })
    }
}

/// Specialization of a kernel with `tile_rows.glsl`.
pub(super) fn lookback_constants(ctx: &Context) -> [(&'static str, u32); 3] {
    [("WORKGROUP", WORKGROUP), ("SUBGROUP_MIN", ctx.min_subgroup_size()), ("ROWS", ROWS)]
}

/// Items of a tile of such a kernel.
pub(super) const TILE: u32 = WORKGROUP * ROWS;
