//! Means of source and extinction in full, half and quarter resolution (`glsl/mips.comp`).

use super::order_compute;
use crate::Result;
use crate::shaders;
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};

/// The pass, and what it makes: one of each for voxels, and for blocks of 2³ and 4³ voxels.
pub struct Mips {
    levels: Vec<Pipeline>,
    /// Two half floats: source function (mean of the channels), extinction.
    pub values: Vec<Image>,
    /// Rgb = source function, but for the first level times extinction; a = extinction.
    pub means: Vec<Image>,
}

impl Mips {
    /// Makes pipelines and images of the first `levels`, at most three, for a volume of `dims` voxels.
    pub fn new(ctx: &Context, dims: [u32; 3], levels: u32) -> Result<Self> {
        assert!(levels <= 3, "blocks of {levels} sizes");
        let level = |level| Pipeline::new(ctx, &shaders::MIPS, &[("LEVEL", level)]);
        let values = |edge| ctx.image_3d("mips.values", dims.map(|d: u32| d.div_ceil(edge)), ImageFormat::R32Uint);
        let means = |edge| ctx.image_3d("mips.means", dims.map(|d: u32| d.div_ceil(edge)), ImageFormat::Rgba16Float);
        Ok(Self {
            levels: (0..levels).map(level).collect::<Result<_>>()?,
            values: (0..levels).map(|level| values(1 << level)).collect::<Result<_>>()?,
            means: (0..levels).map(|level| means(1 << level)).collect::<Result<_>>()?,
        })
    }

    /// Takes the means of `source`: rgb = source function, a = extinction. Ordered after all compute accesses before;
    /// ends with all images written by compute.
    pub fn record(&self, rec: &mut Recorder, source: &Image) {
        for level in 0..self.levels.len() {
            let (values, means) = (&self.values[level], &self.means[level]);
            let before = match level {
                0 => source.sampled(Filter::Linear),
                _ => self.means[level - 1].sampled(Filter::Nearest),
            };
            order_compute(rec);
            let binds = [("before", before), ("values", values.storage()), ("means", means.storage())];
            rec.dispatch(&self.levels[level], &binds, &(), means.extent().map(|d| d.div_ceil(4)));
        }
    }
}
