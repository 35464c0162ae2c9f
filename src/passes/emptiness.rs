//! How far every macrocell is from extinction (`glsl/occupancy.comp`, `glsl/distance.comp`, `glsl/octants.comp`): what rays
//! and paths skip.

use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::DistancePush;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};

/// What is known of every macrocell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Measure {
    /// 0 where there is extinction.
    Occupied,
    /// Chebyshev distance to extinction.
    Distance,
    /// The same for each octant of directions.
    Octants,
}

/// The pass, and the distances that it finds.
pub struct Emptiness {
    /// For fields with extinction in their fourth component, and in their only one.
    occupancy: [Pipeline; 2],
    distance: Option<Pipeline>,
    /// The distances.
    pub image: Image,
    /// The other side of the ping-pong while they are made.
    other: Image,
}

/// Macrocells of `edge` voxels of a volume of `dims` voxels.
pub fn cells(dims: [u32; 3], edge: u32) -> [u32; 3] {
    dims.map(|d| d.div_ceil(edge))
}

impl Emptiness {
    /// Makes pipelines and images for a volume of `dims` voxels: what rays that march skip by.
    pub fn for_rays(ctx: &Context, dims: [u32; 3]) -> Result<Self> {
        Self::new(ctx, dims, constants::SKIP_SIZE, Measure::Octants)
    }

    /// The same for paths.
    pub fn for_paths(ctx: &Context, dims: [u32; 3]) -> Result<Self> {
        Self::new(ctx, dims, constants::CELL_SIZE, Measure::Distance)
    }

    /// Macrocells of `edge` voxels, of which `measure` is to be known.
    pub fn new(ctx: &Context, dims: [u32; 3], edge: u32, measure: Measure) -> Result<Self> {
        let image = |name| ctx.image_3d(name, cells(dims, edge), ImageFormat::R32Uint);
        let empty = if measure == Measure::Octants { u32::MAX } else { constants::MAX_EMPTINESS };
        let occupancy = |component| {
            let specialization = [("COMPONENT", component), ("EDGE", edge), ("EMPTY", empty)];
            Pipeline::new(ctx, &shaders::OCCUPANCY, &specialization)
        };
        Ok(Self {
            occupancy: [occupancy(3)?, occupancy(0)?],
            distance: match measure {
                Measure::Occupied => None,
                Measure::Distance => Some(Pipeline::new(ctx, &shaders::DISTANCE, &[])?),
                Measure::Octants => Some(Pipeline::new(ctx, &shaders::OCTANTS, &[])?),
            },
            image: image("emptiness")?,
            other: image("emptiness.other")?,
        })
    }

    /// Finds for every macrocell how far it is from those in which `field` has extinction. Ordered after all
    /// compute accesses before; ends with [`Emptiness::image`] written by compute.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, field: &Image) {
        let groups = self.image.extent().map(|c| c.div_ceil(4));
        let occupancy = if self.distance.is_some() { &self.other } else { &self.image };
        order_compute(rec);
        rec.dispatch(
            &self.occupancy[(field.format() == ImageFormat::R32Float) as usize],
            &[
                ("scene_block", scene.block.bind()),
                ("field", field.sampled(Filter::Nearest)),
                ("occupancy", occupancy.storage()),
            ],
            &(),
            groups,
        );
        let Some(distance) = &self.distance else { return };
        // Three axes: from `other` to `image`, back, and again to `image`.
        for axis in 0..3 {
            let (before, after) = match axis {
                1 => (&self.image, &self.other),
                _ => (&self.other, &self.image),
            };
            order_compute(rec);
            let binds = [("before", before.sampled(Filter::Nearest)), ("after", after.storage())];
            rec.dispatch(distance, &binds, &DistancePush { axis }, groups);
        }
    }
}
