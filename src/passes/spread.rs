//! Spread (`glsl/spread.comp`): from values at the nodes of a coarse light grid to the voxels.

use super::classify::voxel_grid;
use super::order_compute;
use super::scene_data::SceneData;
use crate::Result;
use crate::abi::SpreadPush;
use crate::shaders;
use crate::vk::{Context, Filter, Image, Pipeline, Recorder};

/// The pass.
pub struct Spread {
    pipeline: Pipeline,
}

impl Spread {
    /// Makes the pipeline.
    pub fn new(ctx: &Context, scene: &SceneData) -> Result<Self> {
        let kernel = scene.stored.version(shaders::SPREAD_VERSIONS);
        Ok(Self { pipeline: Pipeline::new(ctx, kernel, &[])? })
    }

    /// Writes what is trilinear between the values of `nodes` to `solution`, with the extinction of `field`. `sum`: what it is
    /// added to, with the same extinction, or nothing; `unused` is bound in its place. `fixed`: light at the voxels that
    /// enters `solution` beside it.
    ///
    /// Ordered after all compute accesses before; ends with `solution` and `sum` written by compute.
    #[allow(clippy::too_many_arguments, reason = "what is read and written is named one by one")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        nodes: &Image,
        field: &Image,
        solution: &Image,
        sum: Option<&Image>,
        unused: &Image,
        fixed: Option<&Image>,
    ) {
        order_compute(rec);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("nodes", nodes.sampled(Filter::Linear)),
            // Not beside `sum`: they may be the same image.
            ("field", sum.map_or(field, |_| nodes).sampled(Filter::Nearest)),
            ("after", solution.storage()),
            ("total", sum.unwrap_or(unused).storage()),
            ("fixed_light", fixed.unwrap_or(nodes).sampled(Filter::Nearest)),
        ];
        let push = SpreadPush { adds: sum.is_some().into(), joins: fixed.is_some().into() };
        rec.dispatch(&self.pipeline, &binds, &push, voxel_grid(scene.params.dims));
    }
}
