//! Copies of words: the bar for memory-bound kernels (`glsl/bench_copy.comp`).

use super::{lookback, order_compute};
use crate::Result;
use crate::abi::BenchCopyPush;
use crate::shaders;
use crate::vk::{Buffer, Context, Pipeline, Recorder};

/// How a kernel copies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CopyShape {
    /// Invocations of a workgroup.
    pub workgroup: u32,
    /// Loads of an invocation that are under way together.
    pub rows: u32,
    /// Words per load: 1 or 4.
    pub width: u32,
}

/// The pass for one shape.
pub struct BenchCopy {
    pipeline: Pipeline,
    shape: CopyShape,
}

impl BenchCopy {
    /// Makes the pipeline.
    pub fn new(ctx: &Context, shape: CopyShape) -> Result<Self> {
        assert!(shape.width == 1 || shape.width == 4, "{} words per load; bench_copy.comp takes 1 or 4", shape.width);
        let specialization = [("WORKGROUP", shape.workgroup), ("ROWS", shape.rows), ("WIDTH", shape.width)];
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::BENCH_COPY, &specialization)?, shape })
    }

    /// Copies the first `count` words, a multiple of the shape's width, ordered after and before compute accesses.
    pub fn record(&self, rec: &mut Recorder, from: &Buffer<u32>, to: &Buffer<u32>, count: u32) {
        let CopyShape { workgroup, rows, width } = self.shape;
        assert!(count.is_multiple_of(width) && count as usize <= from.len().min(to.len()), "a copy of {count} words");
        order_compute(rec);
        let binds = [("from", from.bind()), ("to", to.bind())];
        let groups = lookback::grid(count.div_ceil(workgroup * rows * width));
        rec.dispatch(&self.pipeline, &binds, &BenchCopyPush { count }, groups);
        order_compute(rec);
    }
}
