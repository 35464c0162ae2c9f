//! The gather of one scattering order (DESIGN section 2): candidates estimated in the proxy (`gather_proxy.comp`), some
//! of them chosen (`gather_select.comp`), those traced in the data (`gather_trace.comp`).

use super::compact::{Chunk, ChunkArgs, List};
use super::project::{Scattering, Source};
use super::proxy::Proxy;
use super::scene_data::SceneData;
use super::{LIST_WORKGROUP, order_compute, rays_per_invocation, share_of};
use crate::Result;
use crate::abi::{GatherProxyPush, GatherSelectPush, GatherTracePush};
use crate::scene::{Sampling, Settings};
use crate::shaders::{self, constants};
use crate::vk::{Buffer, Context, Filter, Pipeline, Recorder};

/// What is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gathered {
    /// Light of the orders before, and a constant environment behind everything where [`SceneData`] has one.
    Projected,
    /// Emission, as classification stores it.
    Emitted,
    /// Order 1 of one delta light in a medium of g ≠ 0: its direction is known, so its phase function need not be stored.
    Light,
}

/// How one gather chooses its directions.
#[derive(Clone, Copy, Debug)]
pub struct GatherConfig {
    /// Choice of directions.
    pub sampling: Sampling,
    /// M.
    pub candidates: u32,
    /// N.
    pub directions: u32,
    /// β of `resample`.
    pub defence: f32,
    /// Step of traced rays in voxels.
    pub step: f32,
    /// Step of proxy rays in voxels.
    pub proxy_step: f32,
}

impl GatherConfig {
    /// The settings' choice.
    pub fn of(settings: &Settings) -> Self {
        Self {
            sampling: settings.sampling,
            candidates: settings.candidates,
            directions: settings.directions,
            defence: settings.defence,
            step: settings.gather_step,
            proxy_step: settings.proxy_step,
        }
    }

    /// Does it estimate candidates in the proxy?
    pub fn uses_proxy(&self) -> bool {
        self.sampling != Sampling::Phase
    }

    /// Largest number of list items per chunk that keeps the chunk's lists within `bytes`.
    pub fn max_chunk(&self, bytes: u64) -> u32 {
        if self.uses_proxy() {
            let per_item = 4 * u64::from(self.candidates).max(2 * u64::from(self.directions));
            (bytes / per_item).min(1 << 30) as u32
        } else {
            1 << 30
        }
    }
}

/// The pass.
pub struct Gather {
    config: GatherConfig,
    /// `gather_proxy.comp` and `gather_select.comp`, where the sampling has candidates.
    candidates: Option<[Pipeline; 2]>,
    trace: Pipeline,
    weights: Buffer<f32>,
    chosen: Buffer<[u32; 2]>,
    /// Candidates of one invocation of `gather_proxy.comp`.
    block: u32,
}

/// Arguments of the three kernels' dispatches over one list.
pub struct GatherArgs {
    /// M and N for its cells.
    counts: [u32; 2],
    candidates: Option<[ChunkArgs; 2]>,
    trace: ChunkArgs,
}

impl Gather {
    /// Makes the pipelines and the lists of a chunk of `chunk_items`. `gathered` other than light of an order
    /// has no candidates.
    pub fn new(
        ctx: &Context,
        scene: &SceneData,
        config: GatherConfig,
        chunk_items: u32,
        gathered: Gathered,
    ) -> Result<Self> {
        let is_projected = gathered == Gathered::Projected;
        let config = if is_projected { config } else { GatherConfig { sampling: Sampling::Phase, ..config } };
        let has_sky = is_projected && scene.environment == constants::ENVIRONMENT_CONSTANT;
        let source = match gathered {
            Gathered::Projected => constants::SOURCE_PROJECTED,
            Gathered::Emitted => constants::SOURCE_EMITTED,
            Gathered::Light => constants::SOURCE_LIGHT,
        };
        let sampling = match config.sampling {
            Sampling::Phase => constants::SAMPLING_PHASE,
            Sampling::Top => constants::SAMPLING_TOP,
            Sampling::Resample => constants::SAMPLING_RESAMPLE,
        };
        let items = if config.uses_proxy() { chunk_items as usize } else { 1 };
        let workgroup = ("WORKGROUP", LIST_WORKGROUP);
        let trace = [
            workgroup,
            ("ANISOTROPIC", (is_projected && scene.params.g != 0.0).into()),
            ("SOURCE", source),
            ("SKY", has_sky.into()),
            ("POINT_LIGHTS", scene.has_point_lights.into()),
            ("SAMPLING", sampling),
        ];
        let candidates = if config.uses_proxy() {
            let select = [workgroup, ("SAMPLING", sampling)];
            Some([
                Pipeline::new(ctx, &shaders::GATHER_PROXY, &[workgroup, ("SKY", has_sky.into())])?,
                Pipeline::new(ctx, &shaders::GATHER_SELECT, &select)?,
            ])
        } else {
            None
        };
        Ok(Self {
            candidates,
            trace: Pipeline::new(ctx, &shaders::GATHER_TRACE, &trace)?,
            weights: ctx.device_buffer("gather.weights", items * config.candidates as usize)?,
            chosen: ctx.device_buffer("gather.chosen", items * config.directions as usize)?,
            block: rays_per_invocation(scene.params.dims, config.proxy_step).min(config.candidates),
            config,
        })
    }

    /// Energies that the candidates of the latest chunk were given, `[candidate][item]`, for tests.
    pub fn weights(&self) -> &Buffer<f32> {
        &self.weights
    }

    /// Choices for the latest chunk, `[slot][item]`: candidate and bits of its weight, for tests.
    pub fn chosen(&self) -> &Buffer<[u32; 2]> {
        &self.chosen
    }

    /// M and N for cells that get the given share of directions.
    fn counts(&self, share: f32) -> [u32; 2] {
        [self.config.candidates, self.config.directions].map(|count| share_of(count, share))
    }

    /// N for cells that get the given share of directions.
    pub fn directions(&self, share: f32) -> u32 {
        self.counts(share)[1]
    }

    /// Rough cost per cell in traced rays: a proxy ray costs a part of one.
    pub fn rays(&self, share: f32) -> f64 {
        let [candidates, directions] = self.counts(share).map(f64::from);
        directions + if self.candidates.is_some() { 0.3 * candidates } else { 0.0 }
    }

    /// Arguments for all chunks of a list whose cells get the given share of directions; see [`List::chunk_args`].
    pub fn args(&self, ctx: &Context, rec: &mut Recorder, list: &List, share: f32) -> Result<GatherArgs> {
        let counts @ [most, _] = self.counts(share);
        let ranks = if self.config.sampling == Sampling::Top { most } else { 1 };
        let candidates = if self.candidates.is_some() {
            let blocks = most.div_ceil(self.block);
            Some([list.chunk_args(ctx, rec, blocks)?, list.chunk_args(ctx, rec, ranks)?])
        } else {
            None
        };
        Ok(GatherArgs { counts, candidates, trace: list.chunk_args(ctx, rec, 1)? })
    }

    /// Gathers a chunk of cells: samples the light of `source`, scattered once more, and deposits it. `stream` keeps the
    /// random numbers of orders apart. `proxy` must be built from `source` where the sampling uses it. `light`: whose light
    /// `source` is, with [`Gathered::Light`]. `is_seen`: the eye shall see it through what is stored.
    ///
    /// Ordered after all compute accesses before; ends with the projection's sums written by compute.
    #[allow(clippy::too_many_arguments, reason = "what the kernels read and write is named one by one")]
    pub fn record(
        &self,
        rec: &mut Recorder,
        scattering: &Scattering<'_>,
        chunk: &Chunk<'_>,
        args: &GatherArgs,
        proxy: Option<&Proxy>,
        source: &Source,
        stream: u32,
        light: u32,
        is_seen: bool,
    ) {
        let c = &self.config;
        let [candidates, directions] = args.counts;
        let (scene, emptiness) = (scattering.scene, scattering.emptiness);
        let (chunk_begin, chunk_items, order) = (chunk.begin, chunk.items, stream);
        order_compute(rec);
        if let Some([estimate, select]) = &self.candidates {
            let (proxy, [estimate_args, select_args]) = proxy.zip(args.candidates.as_ref()).expect("a built proxy");
            rec.begin_pass("gather.proxy", stream);
            let push = GatherProxyPush {
                chunk_begin,
                chunk_items,
                order,
                candidates,
                block: self.block,
                step_voxels: c.proxy_step,
            };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("emptiness", emptiness.sampled(Filter::Nearest)),
                ("bucket_id", proxy.bucket_id.sampled(Filter::Nearest)),
                ("bucket_light", proxy.bucket_light.bind()),
                ("weights", self.weights.bind()),
            ];
            chunk.dispatch(rec, estimate, &binds, &push, estimate_args);
            rec.end_pass();
            order_compute(rec);
            rec.begin_pass("gather.select", stream);
            let push = GatherSelectPush { chunk_begin, chunk_items, order, candidates, directions, defence: c.defence };
            let binds =
                [("scene_block", scene.block.bind()), ("weights", self.weights.bind()), ("chosen", self.chosen.bind())];
            chunk.dispatch(rec, select, &binds, &push, select_args);
            rec.end_pass();
        }
        rec.begin_pass("gather.trace", stream);
        let lattice = if c.uses_proxy() { candidates } else { directions };
        scattering.record_blocks(rec, chunk, directions, c.step, is_seen, |rec, slots| {
            let push = GatherTracePush {
                chunk_begin,
                chunk_items,
                order,
                lattice,
                slot_begin: slots.start,
                slot_end: slots.end,
                directions,
                step_voxels: c.step,
                light,
            };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("lights", scene.lights.bind()),
                ("transfer_block", scene.transfer.bind()),
                ("emptiness", emptiness.sampled(Filter::Nearest)),
                ("scalar", scene.scalar.sampled(Filter::Nearest)),
                ("source_a", source.a.sampled(Filter::Linear)),
                ("source_x", source.b[0].sampled(Filter::Linear)),
                ("source_y", source.b[1].sampled(Filter::Linear)),
                ("source_z", source.b[2].sampled(Filter::Linear)),
                ("chosen", self.chosen.bind()),
                ("samples", scattering.projection.samples().bind()),
            ];
            chunk.dispatch(rec, &self.trace, &binds, &push, &args.trace);
        });
        rec.end_pass();
    }
}
