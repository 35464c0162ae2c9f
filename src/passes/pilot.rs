//! The pilot of the sampling `auto`: a few cells' gathers in the data and in the proxy (`glsl/pilot.comp`).

use super::compact::List;
use super::points::packed;
use super::project::Source;
use super::proxy::Proxy;
use super::scene_data::SceneData;
use super::{LIST_WORKGROUP, order_compute, rays_per_invocation};
use crate::Result;
use crate::abi::{PilotPush, PilotSample};
use crate::shaders::{self, constants};
use crate::vk::{Buffer, Context, Filter, Image, Pipeline, Recorder};

/// Most cells.
const MOST_CELLS: u64 = 4096;
/// Fewest, where the list has them: with fewer a variance is too uncertain to decide by.
const LEAST_CELLS: u64 = 512;
/// Cells of the list that a cell of the pilot may stand for, between these: what it costs is a part of what it is about.
const CELLS_EACH: u64 = 32;
/// Most directions of a cell: their number matters because means over evenly spread directions get better faster than means
/// over independent ones, and above this that is known well enough.
const MOST_DIRECTIONS: u32 = 64;

/// Directions of an invocation.
const BLOCK: u32 = 4;

/// The first look: most cells, and cells of the list that one stands for at least; most directions of a cell, and directions
/// that one stands for at least. So it costs next to nothing, and tells steps to a few per cent.
const FIRST_CELLS: u64 = 256;
const FIRST_CELLS_EACH: u64 = 16;
const FIRST_DIRECTIONS: u32 = 4;
const FIRST_DIRECTIONS_EACH: u32 = 8;

/// What the pass is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// The steps of a few rays in the data; there is no proxy yet.
    First,
    /// The variances in data and proxy, and the steps in both.
    Pilot,
}

/// What the pilot looks at.
#[derive(Clone, Copy, Debug)]
struct Extent {
    cells: u32,
    directions: u32,
    /// Directions of an invocation.
    block: u32,
}

impl Extent {
    fn blocks(self) -> u32 {
        self.directions.div_ceil(self.block)
    }
}

/// The pass.
pub struct Pilot {
    first: Pipeline,
    pilot: Pipeline,
    samples: Buffer<PilotSample>,
    /// Of the directions of each look.
    points: [Buffer<u32>; 2],
    directions: u32,
    block: u32,
    steps: [f32; 2],
}

impl Pilot {
    /// For gathers of `directions` directions, with steps in the data and in the proxy in voxels.
    pub fn new(ctx: &Context, scene: &SceneData, directions: u32, steps: [f32; 2]) -> Result<Self> {
        let specialization = |with_proxy: bool| {
            [
                ("PROXY", with_proxy.into()),
                ("WORKGROUP", LIST_WORKGROUP),
                ("ANISOTROPIC", (scene.params.g != 0.0).into()),
                ("SOURCE", constants::SOURCE_PROJECTED),
                ("SKY", (scene.environment == constants::ENVIRONMENT_CONSTANT).into()),
                ("POINT_LIGHTS", scene.has_point_lights.into()),
                ("EVEN_ALBEDO", scene.has_even_albedo.into()),
            ]
        };
        // An invocation follows every direction twice.
        let budget = rays_per_invocation(scene.params.dims, steps[0].min(steps[1])) / 2;
        let directions = directions.clamp(1, MOST_DIRECTIONS);
        let block = BLOCK.min(budget).max(1);
        let parts = MOST_CELLS as u32 * constants::PILOT_REPLICATES * directions.div_ceil(block);
        let points = |directions| ctx.upload("pilot.points", &packed(directions));
        Ok(Self {
            points: [points(Self::first_directions(directions))?, points(directions)?],
            first: Pipeline::new(ctx, &shaders::PILOT, &specialization(false))?,
            pilot: Pipeline::new(ctx, &shaders::PILOT, &specialization(true))?,
            samples: ctx.device_buffer("pilot", parts as usize)?,
            directions,
            block,
            steps,
        })
    }

    /// Cells of the list that are looked at: of its longest segment.
    pub fn cells(list: &List) -> u32 {
        let items = Self::items(list);
        (items / CELLS_EACH).clamp(LEAST_CELLS, MOST_CELLS).min(items) as u32
    }

    fn items(list: &List) -> u64 {
        list.longest_segment().map_or(0, |(_, _, items)| u64::from(items))
    }

    /// Rays in the data, of all replicates.
    pub fn rays(&self, look: Look, list: &List) -> u64 {
        let Extent { cells, directions, .. } = self.extent(look, list);
        u64::from(cells) * u64::from(directions) * u64::from(constants::PILOT_REPLICATES)
    }

    /// Directions of a cell.
    pub fn directions(&self, look: Look) -> u32 {
        match look {
            Look::First => Self::first_directions(self.directions),
            Look::Pilot => self.directions,
        }
    }

    fn first_directions(directions: u32) -> u32 {
        (directions / FIRST_DIRECTIONS_EACH).clamp(1, FIRST_DIRECTIONS)
    }

    fn extent(&self, look: Look, list: &List) -> Extent {
        let items = Self::items(list);
        let (cells, block) = match look {
            Look::First => ((items / FIRST_CELLS_EACH).clamp(1, FIRST_CELLS).min(items) as u32, 1),
            Look::Pilot => (Self::cells(list), self.block),
        };
        Extent { cells, directions: self.directions(look), block }
    }

    /// Follows what `source` sends to cells of the list, some of which there must be. For [`Look::Pilot`] `proxy` must be
    /// built from `source`.
    ///
    /// Ordered after all compute accesses before; ends with [`Self::samples`] written by compute.
    #[allow(clippy::too_many_arguments, reason = "what a gather needs")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        look: Look,
        scene: &SceneData,
        emptiness: &Image,
        list: &List,
        proxy: &Proxy,
        source: &Source,
    ) {
        let (items, header, _) = list.longest_segment().expect("a list has a segment");
        let extent @ Extent { cells, directions, block } = self.extent(look, list);
        let [step_voxels, proxy_step_voxels] = self.steps;
        let push = PilotPush { cells, directions, block, step_voxels, proxy_step_voxels };
        let binds = [
            ("list_items", items.bind()),
            ("list_header", header.bind()),
            ("scene_block", scene.block.bind()),
            ("lights", scene.lights.bind()),
            ("emptiness", emptiness.sampled(Filter::Nearest)),
            ("scattering", scene.scattering(&source.a).sampled(Filter::Linear)),
            ("source_a", source.a.sampled(Filter::Linear)),
            ("source_x", source.b[0].sampled(Filter::Linear)),
            ("source_y", source.b[1].sampled(Filter::Linear)),
            ("source_z", source.b[2].sampled(Filter::Linear)),
            ("bucket_id", proxy.bucket_id.sampled(Filter::Nearest)),
            ("bucket_light", proxy.bucket_light.bind()),
            ("pilots", self.samples.bind()),
            ("points", self.points[usize::from(look == Look::Pilot)].bind()),
        ];
        order_compute(rec);
        let groups = [cells.div_ceil(LIST_WORKGROUP), constants::PILOT_REPLICATES, extent.blocks()];
        let pipeline = match look {
            Look::First => &self.first,
            Look::Pilot => &self.pilot,
        };
        rec.dispatch(pipeline, &binds, &push, groups);
    }

    /// What the latest look of this kind found in each cell, `[replicate][cell]`. Waits for the device.
    pub fn samples(
        &self,
        ctx: &Context,
        look: Look,
        list: &List,
    ) -> Result<[Vec<PilotSample>; constants::PILOT_REPLICATES as usize]> {
        let extent = self.extent(look, list);
        let cells = extent.cells as usize;
        let of_block = cells * constants::PILOT_REPLICATES as usize;
        let parts = ctx.read_back_range(&self.samples, 0..of_block * extent.blocks() as usize)?;
        let mut first: Vec<PilotSample> = (0..of_block)
            .map(|i| parts.iter().skip(i).step_by(of_block).fold(PilotSample::default(), |sum, &part| sum + part))
            .collect();
        let second = first.split_off(cells);
        Ok([first, second])
    }
}
