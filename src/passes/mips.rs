//! Means of source and extinction in full, half and quarter resolution (`glsl/mips.comp`).

use super::order_compute;
use crate::Result;
use crate::shaders;
use crate::vk::{Context, Filter, Image, ImageFormat, Pipeline, Recorder};

/// The pass, and what it makes: one of each for voxels, and for blocks of 2³ and 4³ voxels.
pub struct Mips {
    levels: Vec<Pipeline>,
    /// Two half floats: source function (mean of the channels), extinction; a single texel where nobody reads them.
    pub values: Vec<Image>,
    /// Rgb = source function, but for the first level times extinction; a = extinction.
    pub means: Vec<Image>,
}

impl Mips {
    /// Makes pipelines and images of all three levels for a volume of `dims` voxels.
    pub fn new(ctx: &Context, dims: [u32; 3]) -> Result<Self> {
        Self::with(ctx, dims, 3, true)
    }

    /// The same for the means over voxels alone, without [`Self::values`].
    pub fn means_of_voxels(ctx: &Context, dims: [u32; 3]) -> Result<Self> {
        Self::with(ctx, dims, 1, false)
    }

    fn with(ctx: &Context, dims: [u32; 3], levels: u32, has_values: bool) -> Result<Self> {
        let level = |level| Pipeline::new(ctx, &shaders::MIPS, &[("LEVEL", level), ("HAS_VALUES", has_values.into())]);
        let blocks = |edge: u32| dims.map(|d| d.div_ceil(edge));
        let values = |edge| {
            let extent = if has_values { blocks(edge) } else { [1; 3] };
            ctx.image_3d("mips.values", extent, ImageFormat::R32Uint)
        };
        let means = |edge| ctx.image_3d("mips.means", blocks(edge), ImageFormat::Rgba16Float);
        Ok(Self {
            levels: (0..levels).map(level).collect::<Result<_>>()?,
            values: (0..levels).map(|level| values(1 << level)).collect::<Result<_>>()?,
            means: (0..levels).map(|level| means(1 << level)).collect::<Result<_>>()?,
        })
    }

    /// Takes the means of `source`: rgb = source function, a = extinction. `emptiness`: of macrocells of
    /// [`SKIP_SIZE`](shaders::constants::SKIP_SIZE) voxels, nonzero where the source has no extinction. Ordered after all compute accesses before;
    /// ends with all images written by compute.
    pub fn record(&self, rec: &mut Recorder, source: &Image, emptiness: &Image) {
        for level in 0..self.levels.len() {
            let (values, means) = (&self.values[level], &self.means[level]);
            let before = match level {
                0 => source.sampled(Filter::Linear),
                _ => self.means[level - 1].sampled(Filter::Nearest),
            };
            order_compute(rec);
            let binds = [
                ("before", before),
                ("values", values.storage()),
                ("means", means.storage()),
                ("emptiness", emptiness.sampled(Filter::Nearest)),
            ];
            rec.dispatch(&self.levels[level], &binds, &(), means.extent().map(|d| d.div_ceil(4)));
        }
    }
}
