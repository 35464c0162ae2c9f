//! Classify (`glsl/classify.comp`), and how far every macrocell is from extinction (`glsl/occupancy.comp`,
//! `glsl/distance.comp`): what rays skip.

use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::DistancePush;
use crate::shaders::{self, constants};
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};

/// The source that classification writes beside the extinction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emitted {
    /// None.
    Nothing,
    /// σ_a times the emitted radiance.
    Emission,
    /// σ_t times the transfer function's colour: the absorption model.
    Color,
}

/// The pass.
pub struct Classify {
    classify: Pipeline,
    /// For fields with extinction in their fourth component, and in their only one.
    occupancy: [Pipeline; 2],
    distance: Pipeline,
}

/// Distances of the macrocells to extinction.
pub struct Emptiness {
    /// The distances.
    pub image: Image,
    /// The other side of the ping-pong while they are made.
    other: Image,
}

/// Macrocells of a volume of `dims` voxels.
pub fn cells(dims: [u32; 3]) -> [u32; 3] {
    dims.map(|d| d.div_ceil(constants::CELL_SIZE))
}

/// Workgroups of an 8 × 8 × 1 kernel over `dims` voxels.
pub(super) fn voxel_grid(dims: [u32; 3]) -> [u32; 3] {
    [dims[0].div_ceil(8), dims[1].div_ceil(8), dims[2]]
}

impl Classify {
    /// Makes the pipelines.
    pub fn new(ctx: &Context, emitted: Emitted) -> Result<Self> {
        let emitted = match emitted {
            Emitted::Nothing => constants::EMITTED_NOTHING,
            Emitted::Emission => constants::EMITTED_EMISSION,
            Emitted::Color => constants::EMITTED_COLOR,
        };
        Ok(Self {
            classify: Pipeline::new(ctx, &shaders::CLASSIFY, &[("EMITTED", emitted)])?,
            occupancy: [
                Pipeline::new(ctx, &shaders::OCCUPANCY, &[("COMPONENT", 3)])?,
                Pipeline::new(ctx, &shaders::OCCUPANCY, &[("COMPONENT", 0)])?,
            ],
            distance: Pipeline::new(ctx, &shaders::DISTANCE, &[])?,
        })
    }

    /// Images for the macrocells.
    pub fn emptiness(ctx: &Context, dims: [u32; 3]) -> Result<Emptiness> {
        let image = |name| ctx.image_3d(name, cells(dims), ImageFormat::R32Uint);
        Ok(Emptiness { image: image("emptiness")?, other: image("emptiness.other")? })
    }

    /// Writes source and extinction of every voxel to `field`. Ordered after all compute accesses before; ends
    /// with `field` written by compute.
    pub fn record(&self, rec: &mut Recorder, scene: &SceneData, field: &Image) {
        order_compute(rec);
        rec.dispatch(
            &self.classify,
            &[
                ("scene_block", scene.block.bind()),
                ("transfer_block", scene.transfer.bind()),
                ("scalar", scene.scalar.sampled(Filter::Nearest)),
                ("field", field.storage()),
            ],
            &(),
            voxel_grid(scene.params.dims),
        );
    }

    /// Finds for every macrocell the distance to the nearest one in which `field` has extinction. Ordered after all
    /// compute accesses before; ends with `emptiness.image` written by compute.
    pub fn record_emptiness(&self, rec: &mut Recorder, scene: &SceneData, field: &Image, emptiness: &Emptiness) {
        let groups = cells(scene.params.dims).map(|c| c.div_ceil(4));
        order_compute(rec);
        rec.dispatch(
            &self.occupancy[(field.format() == ImageFormat::R32Float) as usize],
            &[
                ("scene_block", scene.block.bind()),
                ("field", field.sampled(Filter::Nearest)),
                ("occupancy", emptiness.other.storage()),
            ],
            &(),
            groups,
        );
        // Three axes: from `other` to `image`, back, and again to `image`.
        for axis in 0..3 {
            let (before, after) = match axis {
                1 => (&emptiness.image, &emptiness.other),
                _ => (&emptiness.other, &emptiness.image),
            };
            order_compute(rec);
            let binds = [("before", before.sampled(Filter::Nearest)), ("after", after.storage())];
            rec.dispatch(&self.distance, &binds, &DistancePush { axis }, groups);
        }
    }
}
