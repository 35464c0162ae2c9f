//! The quantiser of the proxy's colours: which codes of a channel are one level (`glsl/quantiser.comp`), for an adaptive mask by
//! the histogram of all colours (`glsl/color_histogram.comp`).

use super::scene_data::SceneData;
use super::{lookback, order_compute};
use crate::Result;
use crate::abi::ColorHistogramPush;
use crate::scene::Mask;
use crate::shaders::{self, constants};
use crate::vk::{Access, Buffer, Context, Filter, Image, Pipeline, Recorder};

/// Invocations of a workgroup of `color_histogram.comp`, and voxels of an invocation.
const HISTOGRAM_SHAPE: [u32; 2] = [256, 64];

/// Voxels of a workgroup.
const HISTOGRAM_TILE: u32 = HISTOGRAM_SHAPE[0] * HISTOGRAM_SHAPE[1];

// A workgroup's sums have 32 bits.
const _: () = assert!(HISTOGRAM_TILE <= u32::MAX / constants::CODE_SQUARE);

/// The pass and its tables.
pub struct Quantiser {
    /// Of an adaptive mask.
    histogram_pass: Option<Pipeline>,
    pipeline: Pipeline,
    histogram: Buffer<u32>,
    table: Buffer<u32>,
}

impl Quantiser {
    /// Pipelines and memory for masks of the kind of `mask`.
    pub fn new(ctx: &Context, mask: Mask) -> Result<Self> {
        let is_adaptive = mask.is_adaptive();
        let histogram = || {
            let specialization = [("WORKGROUP", HISTOGRAM_SHAPE[0]), ("VOXELS", HISTOGRAM_SHAPE[1])];
            Pipeline::new(ctx, &shaders::COLOR_HISTOGRAM, &specialization)
        };
        let rows = if is_adaptive { constants::HISTOGRAM_ROWS } else { 0 };
        Ok(Self {
            histogram_pass: is_adaptive.then(histogram).transpose()?,
            pipeline: Pipeline::new(ctx, &shaders::QUANTISER, &[("ADAPTIVE", is_adaptive.into())])?,
            histogram: ctx.device_buffer("quantiser.histogram", (2 * rows * constants::CODES) as usize)?,
            table: ctx.device_buffer("quantiser.table", constants::QUANTISER_WORDS as usize)?,
        })
    }

    /// The tables, laid out as `constants::QUANTISER_*`.
    pub fn table(&self) -> &Buffer<u32> {
        &self.table
    }

    /// Sums of the histogram, two words each; none of a fixed mask.
    pub fn histogram(&self) -> &Buffer<u32> {
        &self.histogram
    }

    /// Takes the histogram of `color` if the mask is adaptive. Ordered after all compute accesses before; ends with it
    /// written by compute.
    pub fn record_histogram(&self, rec: &mut Recorder, scene: &SceneData, color: &Image) {
        let Some(pass) = &self.histogram_pass else { return };
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        rec.fill(&self.histogram, 0);
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        order_compute(rec);
        let binds = [
            ("scene_block", scene.block.bind()),
            ("color", color.sampled(Filter::Nearest)),
            ("color_histogram", self.histogram.bind()),
        ];
        let count = scene.voxels() as u32;
        rec.dispatch(pass, &binds, &ColorHistogramPush { count }, lookback::grid(count.div_ceil(HISTOGRAM_TILE)));
    }

    /// Makes the tables for the mask in `control`, and writes the channels' numbers of levels there, by the indirect dispatch
    /// at word `offset` of `args`: a workgroup per channel, or none. Ordered after all compute accesses before.
    pub fn record(&self, rec: &mut Recorder, control: &Buffer<u32>, args: &Buffer<u32>, offset: usize) {
        order_compute(rec);
        let binds = [
            ("proxy_control", control.bind()),
            ("quantiser", self.table.bind()),
            ("color_histogram", self.histogram.bind()),
        ];
        rec.dispatch_indirect(&self.pipeline, &binds, &(), args, offset);
    }
}
