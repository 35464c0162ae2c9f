//! Host side of the kernels that carry sums from tile to tile (`glsl/include/tile_status.glsl`, `lookback.glsl`): by look-back
//! or without, counts that live on the host or on the GPU, grids, status memory, and what the kernels report.

use super::tuning;
use crate::abi::{ColumnScanPush, DispatchArgsPush};
use crate::shaders::{self, ShaderInfo, constants};
use crate::vk::{Access, Bind, Buffer, Context, Pipeline, Recorder};
use crate::{Error, Result};
use bytemuck::Pod;

/// Largest count of items: look-back words keep 30 bits.
pub const MAX_ITEMS: u32 = (1 << 30) - 1;

/// How sums get from tile to tile. Results are the same, bit for bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Carry {
    /// Within one dispatch: a tile looks back at what earlier ones have published, and computes what stays missing.
    LookBack,
    /// Between three dispatches, which count, sum up and place (reduce-then-scan). No tile waits for another, so nothing is
    /// asked of the order in which the device runs workgroups.
    Dispatches,
}

/// How many items a pass works on.
#[derive(Clone, Copy)]
pub enum Count<'a> {
    /// Known to the host.
    Host(u32),
    /// Written by a kernel: element `offset` of `buffer`. More than the capacity is an error of the pass's
    /// [`Diagnostics`].
    Gpu {
        /// Holds the count.
        buffer: &'a Buffer<u32>,
        /// Element of `buffer`.
        offset: u32,
    },
}

impl Count<'_> {
    /// What the kernels get as push constant.
    pub(super) fn pushed(&self) -> u32 {
        match *self {
            Count::Host(n) => n,
            Count::Gpu { .. } => constants::COUNT_ON_DEVICE,
        }
    }

    /// For the dispatch of a kernel of which one workgroup runs even for no item.
    pub(super) fn at_least_one(self) -> Self {
        match self {
            Count::Host(n) => Count::Host(n.max(1)),
            on_gpu => on_gpu,
        }
    }
}

/// Checks a capacity before anything is allocated for it.
pub(super) fn check_capacity(pass: &str, capacity: u32) -> Result<()> {
    if capacity > MAX_ITEMS {
        return Err(Error::input(
            pass,
            format!("{capacity} items, but a look-back word counts up to {MAX_ITEMS}"),
            "use a smaller volume or a coarser mask",
        ));
    }
    Ok(())
}

/// Checks that the device takes workgroups of this size, in full subgroups.
pub(super) fn check_workgroup(ctx: &Context, pass: &str, workgroup: u32) -> Result<()> {
    let (lanes, most) = (ctx.max_subgroup_size(), ctx.max_workgroup());
    if workgroup == 0 || !workgroup.is_multiple_of(lanes) || workgroup > most {
        return Err(Error::input(
            pass,
            format!("workgroups of {workgroup} invocations"),
            format!("this device takes multiples of {lanes} up to {most}"),
        ));
    }
    Ok(())
}

/// Workgroups along x and y for `tiles` tiles: at least one per tile, few more. Twin of `dispatch_args.comp`.
pub fn grid(tiles: u32) -> [u32; 3] {
    let width = tiles.min(constants::MAX_GRID);
    [width, if width == 0 { 1 } else { tiles.div_ceil(width) }, 1]
}

/// Where the tiles' sums are that a kernel leaves to `column_scan.comp`, and who hears of errors.
pub(super) struct Columns<'a> {
    pub(super) status: &'a Buffer<u32>,
    pub(super) diagnostics: &'a Diagnostics,
    /// First word of the first row.
    pub(super) first: u32,
    /// Words of a row.
    pub(super) columns: u32,
    pub(super) rows: u32,
}

impl<'a> Columns<'a> {
    /// Of a kernel with `lookback.glsl`.
    pub(super) fn of_tiles(status: &'a Buffer<u32>, diagnostics: &'a Diagnostics, tiles: u32) -> Self {
        Self { status, diagnostics, first: constants::LOOKBACK_HEAD, columns: 1, rows: tiles }
    }
}

/// A kernel over tiles that carries sums from each to the next.
pub(super) enum TileKernel {
    /// In one dispatch.
    LookBack(Pipeline),
    /// In three.
    Dispatches { count: Pipeline, columns: Pipeline, given: Pipeline },
}

impl TileKernel {
    /// Makes the pipelines.
    pub(super) fn new(
        ctx: &Context,
        shader: &'static ShaderInfo,
        specialization: &[(&str, u32)],
        carry: Carry,
    ) -> Result<Self> {
        let kernel = |step| Pipeline::new(ctx, shader, &[specialization, &[("CARRY", step)]].concat());
        Ok(match carry {
            Carry::LookBack => Self::LookBack(kernel(constants::CARRY_LOOK_BACK)?),
            Carry::Dispatches => {
                let columns = [("WORKGROUP", tuning::column_workgroup(ctx)), ("SUBGROUP_MIN", ctx.min_subgroup_size())];
                Self::Dispatches {
                    count: kernel(constants::CARRY_COUNT)?,
                    columns: Pipeline::new(ctx, &shaders::COLUMN_SCAN, &columns)?,
                    given: kernel(constants::CARRY_GIVEN)?,
                }
            }
        })
    }

    /// Runs it, with a workgroup per tile. `sums`: where it puts the tiles' sums.
    pub(super) fn run<P: Pod>(
        &self,
        rec: &mut Recorder,
        binds: &[(&str, Bind<'_>)],
        push: &P,
        groups: Groups<'_>,
        sums: &Columns<'_>,
    ) {
        match self {
            Self::LookBack(pipeline) => groups.run(rec, pipeline, binds, push),
            Self::Dispatches { count, columns, given } => {
                groups.run(rec, count, binds, push);
                // The tiles' sums.
                rec.barrier(Access::ComputeWrite, Access::ComputeReadWrite);
                let status = [("status", sums.status.bind()), ("diagnostics", sums.diagnostics.buffer().bind())];
                let of_columns = ColumnScanPush { first: sums.first, rows: sums.rows };
                rec.dispatch(columns, &status, &of_columns, [sums.columns, 1, 1]);
                // What comes before each tile. What the count read is read again, and may be written.
                rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
                groups.run(rec, given, binds, push);
            }
        }
    }
}

/// How many workgroups a kernel runs with.
#[derive(Clone, Copy)]
pub(super) enum Groups<'a> {
    /// Along x, y, z.
    Direct([u32; 3]),
    /// By these arguments.
    Indirect(&'a Buffer<u32>),
}

impl<'a> Groups<'a> {
    /// One per tile of `tile_items` items; for a count on the GPU by the arguments that [`DispatchArgs::record`] wrote to
    /// `args`.
    pub(super) fn of_tiles(count: Count<'_>, tile_items: u32, args: &'a Buffer<u32>) -> Self {
        match count {
            Count::Host(n) => Self::Direct(grid(n.div_ceil(tile_items))),
            Count::Gpu { .. } => Self::Indirect(args),
        }
    }

    /// Runs a kernel with so many.
    pub(super) fn run<P: Pod>(self, rec: &mut Recorder, pipeline: &Pipeline, binds: &[(&str, Bind<'_>)], push: &P) {
        match self {
            Self::Direct(groups) => rec.dispatch(pipeline, binds, push, groups),
            Self::Indirect(args) => rec.dispatch_indirect(pipeline, binds, push, args, 0),
        }
    }
}

/// Words of `status` that a kernel with `lookback.glsl` needs for `tiles` tiles.
pub fn status_words(tiles: u32) -> usize {
    constants::LOOKBACK_HEAD as usize + 2 * tiles as usize
}

/// Arrays of so many words by name: memory of their own, or parts of `memory`, each where a binding may start.
///
/// Errors: memory runs out, `memory` is too small, or an array is longer than a binding may be.
pub(super) fn arrays<const N: usize>(
    ctx: &Context,
    memory: Option<&Buffer<u32>>,
    parts: [(&'static str, u64); N],
) -> Result<[Buffer<u32>; N]> {
    let mut made = Vec::with_capacity(N);
    let mut at = 0;
    for (name, words) in parts {
        made.push(match memory {
            None => ctx.device_buffer(name, words as usize)?,
            Some(memory) => {
                let (end, limit) = (at + words.max(1), ctx.max_storage_bytes());
                if 4 * words > limit {
                    return Err(too_large(name, 4 * words, limit, "maxStorageBufferRange"));
                }
                if end > memory.len() as u64 {
                    let needed = 4 * arrays_words(ctx, &parts);
                    return Err(too_large(memory.name(), needed, 4 * memory.len() as u64, "the memory handed over"));
                }
                memory.slice(at as usize..end as usize)
            }
        });
        at = (at + words.max(1)).next_multiple_of(array_step(ctx));
    }
    Ok(made.try_into().unwrap_or_else(|_| unreachable!("one array per part")))
}

fn too_large(object: &str, needed: u64, limit: u64, limit_name: &'static str) -> Error {
    let cure = "give more memory, or make room for fewer items".into();
    Error::DeviceMemory { object: object.to_owned(), needed, limit, limit_name, cure }
}

/// Words that [`arrays`] takes of `memory`.
pub(super) fn arrays_words(ctx: &Context, parts: &[(&'static str, u64)]) -> u64 {
    parts.iter().fold(0, |at: u64, (_, words)| at.next_multiple_of(array_step(ctx)) + (*words).max(1))
}

/// Words between places where an array may start.
fn array_step(ctx: &Context) -> u64 {
    ctx.storage_alignment().max(16) / 4
}

/// What kernels with look-back report, added up since the last [`Diagnostics::clear`].
#[derive(Clone)]
pub struct Diagnostics {
    buffer: Buffer<u32>,
}

/// Contents of [`Diagnostics`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// Polls that found a predecessor's status missing.
    pub spins: u32,
    /// Tiles that were computed in place of a predecessor that did not come forth.
    pub fallbacks: u32,
    /// `ERROR_*` bits of `constants.glsl`.
    pub errors: u32,
}

impl Diagnostics {
    /// Zeroed counters.
    pub fn new(ctx: &Context) -> Result<Self> {
        Ok(Self { buffer: ctx.upload("lookback.diagnostics", &[0u32; constants::DIAGNOSTICS_WORDS as usize])? })
    }

    /// Counters that [`Diagnostics::clear`] must set to zero before they are used.
    pub(crate) fn uncleared(ctx: &Context) -> Result<Self> {
        Ok(Self { buffer: ctx.device_buffer("lookback.diagnostics", constants::DIAGNOSTICS_WORDS as usize)? })
    }

    /// The buffer that kernels bind as `diagnostics`.
    pub fn buffer(&self) -> &Buffer<u32> {
        &self.buffer
    }

    /// Forgets what was reported. Access: [`Access::TransferWrite`], ordered after and before all compute accesses.
    pub fn clear(&self, rec: &mut Recorder) {
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.buffer, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
    }

    /// The counters, after the submission has finished.
    pub fn read(&self, ctx: &Context) -> Result<Report> {
        Ok(Report::of(&ctx.read_back(&self.buffer)?))
    }

    /// The counters, or an error that names `pass` if a kernel reported that its result cannot be trusted.
    pub fn check(&self, ctx: &Context, pass: &'static str) -> Result<Report> {
        self.read(ctx)?.check(pass)
    }
}

impl Report {
    /// The words of [`Diagnostics::buffer`].
    pub(crate) fn of(words: &[u32]) -> Self {
        Self {
            spins: words[constants::DIAGNOSTICS_SPINS as usize],
            fallbacks: words[constants::DIAGNOSTICS_FALLBACKS as usize],
            errors: words[constants::DIAGNOSTICS_ERRORS as usize],
        }
    }

    /// Itself, or an error that names `pass` if a kernel reported that its result cannot be trusted.
    pub(crate) fn check(self, pass: &'static str) -> Result<Self> {
        let problems: Vec<&str> = [
            (constants::ERROR_BUDGET, "look-back ran out of its loop budget (do without it: --carry dispatches)"),
            (constants::ERROR_COUNT, "a count exceeds the capacity that was allocated for it"),
            (constants::ERROR_SUBGROUPS, "subgroups are not full or smaller than the device promised"),
        ]
        .into_iter()
        .filter_map(|(bit, text)| (self.errors & bit != 0).then_some(text))
        .collect();
        if self.errors == 0 { Ok(self) } else { Err(Error::Device { pass, problem: problems.join("; ") }) }
    }
}

/// Indirect dispatch arguments from a count on the GPU (`dispatch_args.comp`).
pub struct DispatchArgs {
    pipeline: Pipeline,
}

impl DispatchArgs {
    /// Makes the pipeline.
    pub fn new(ctx: &Context) -> Result<Self> {
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::DISPATCH_ARGS, &[])? })
    }

    /// Room for the arguments.
    pub fn buffer(ctx: &Context, name: &str) -> Result<Buffer<u32>> {
        ctx.device_buffer(name, constants::ARGS_WORDS as usize)
    }

    /// Writes into `args`, made by [`DispatchArgs::buffer`], the arguments for tiles of so many items, of which so many workgroups
    /// run even for no item, 0 or 1; and the count, at most `capacity`, at `constants::ARGS_COUNT`.
    ///
    /// Starts by ordering earlier reads of `args`, and all compute accesses; ends by ordering its writes before
    /// [`Access::IndirectRead`] and all compute accesses.
    pub fn record(
        &self,
        rec: &mut Recorder,
        (counts, offset): (&Buffer<u32>, u32),
        capacity: u32,
        (tile_items, least_tiles): (u32, u32),
        args: &Buffer<u32>,
        diagnostics: &Diagnostics,
    ) {
        assert!((offset as usize) < counts.len(), "element {offset} of '{}'", counts.name());
        rec.barrier(Access::IndirectRead, Access::ComputeWrite);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
        rec.dispatch(
            &self.pipeline,
            &[("counts", counts.bind()), ("args", args.bind()), ("diagnostics", diagnostics.buffer().bind())],
            &DispatchArgsPush { offset, capacity, tile_items, least_tiles },
            [1, 1, 1],
        );
        rec.barrier(Access::ComputeWrite, Access::IndirectRead);
        rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_hold_all_tiles_within_the_limit() {
        for tiles in [0, 1, 2, 65_534, 65_535, 65_536, 65_537, 131_070, 131_071, MAX_ITEMS / 128] {
            let [x, y, z] = grid(tiles);
            assert!(x <= constants::MAX_GRID && y <= constants::MAX_GRID && z == 1);
            assert!(u64::from(x) * u64::from(y) >= u64::from(tiles), "{tiles} tiles");
            assert!(u64::from(x) * u64::from(y) < u64::from(tiles) + u64::from(x).max(1), "{tiles} tiles");
        }
    }

    #[test]
    fn too_large_a_capacity_is_refused() {
        assert!(check_capacity("scan", MAX_ITEMS).is_ok());
        assert!(check_capacity("scan", MAX_ITEMS + 1).unwrap_err().to_string().contains("1073741823"));
    }
}
