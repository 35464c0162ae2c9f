//! The phase function as the device evaluates and samples it (`glsl/phase_probe.comp`); its twin is `cpu::sphere`.

use super::LIST_WORKGROUP;
use crate::Result;
use crate::abi::PhaseProbePush;
use crate::shaders::{self, constants};
use crate::vk::{Context, Pipeline, Recorder};
use glam::Vec3;

/// The pass.
pub struct PhaseProbe {
    pipeline: Pipeline,
}

impl PhaseProbe {
    /// Makes the pipeline.
    pub fn new(ctx: &Context) -> Result<Self> {
        Ok(Self { pipeline: Pipeline::new(ctx, &shaders::PHASE_PROBE, &[("WORKGROUP", LIST_WORKGROUP)])? })
    }

    /// `phase_hg(g, cosine)` [1/sr] of every cosine, and `sample_hg(g, before, u)` of as many pairs `u` in [0, 1), at
    /// most 2²¹. Waits for the device.
    pub fn evaluate(
        &self,
        ctx: &Context,
        g: f32,
        before: Vec3,
        cosines: &[f32],
        randoms: &[[f32; 2]],
    ) -> Result<(Vec<f32>, Vec<Vec3>)> {
        assert_eq!(cosines.len(), randoms.len(), "cosines and pairs of random numbers");
        let groups = (cosines.len() as u32).div_ceil(LIST_WORKGROUP);
        assert!(groups <= constants::MAX_GRID, "{} cosines", cosines.len());
        let densities = ctx.device_buffer::<f32>("densities", cosines.len())?;
        let directions = ctx.device_buffer::<Vec3>("directions", cosines.len())?;
        let (cosines, randoms) = (ctx.upload("cosines", cosines)?, ctx.upload("randoms", randoms)?);
        let mut rec = Recorder::new(ctx)?;
        let binds = [
            ("cosines", cosines.bind()),
            ("randoms", randoms.bind()),
            ("densities", densities.bind()),
            ("directions", directions.bind()),
        ];
        let push = PhaseProbePush { before: before.to_array(), g, count: cosines.len() as u32 };
        rec.dispatch(&self.pipeline, &binds, &push, [groups, 1, 1]);
        rec.submit_and_wait()?;
        Ok((ctx.read_back(&densities)?, ctx.read_back(&directions)?))
    }
}
