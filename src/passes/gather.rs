//! The gather of one scattering order (DESIGN section 2): candidates estimated in the proxy (`gather_proxy.comp`), some
//! of them chosen (`gather_select.comp`), those traced in the data (`gather_trace.comp`). For `residual` nothing is chosen:
//! what the proxy says is taken as it is (`gather_base.comp`), and traced rays bring what it is off by.

use super::compact::{Chunk, ChunkArgs, List};
use super::points::{aimed_packed, packed};
use super::project::{Kept, Scattering, Source};
use super::proxy::Proxy;
use super::scene_data::SceneData;
use super::{LIST_WORKGROUP, order_compute, rays_per_invocation, share_of};
use crate::Result;
use crate::abi::{GatherBasePush, GatherProxyPush, GatherSelectPush, GatherTracePush};
use crate::scene::{Sampling, Settings};
use crate::shaders::{self, constants};
use crate::vk::{Buffer, Context, Filter, Pipeline, Recorder};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

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
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// The settings' choice; `auto` starts as `phase`.
    pub fn of(settings: &Settings) -> Self {
        Self {
            sampling: match settings.sampling {
                Sampling::Auto => Sampling::Phase,
                sampling => sampling,
            },
            candidates: settings.candidates,
            directions: settings.directions,
            defence: settings.defence,
            step: settings.gather_step,
            proxy_step: settings.proxy_step,
        }
    }

    /// Directions of a cell that are followed in the proxy, of M candidates and N traced ones.
    fn estimates(&self, [candidates, directions]: [u32; 2]) -> u32 {
        match self.sampling {
            Sampling::Phase => 0,
            Sampling::Top | Sampling::Resample => candidates,
            Sampling::Residual => candidates + directions,
            Sampling::Auto => unreachable!("{UNDECIDED}"),
        }
    }

    /// Largest number of list items per chunk that keeps the chunk's lists within `bytes`.
    pub fn max_chunk(&self, bytes: u64) -> u32 {
        let choices = if self.sampling.is_choice() { 2 * self.directions } else { 0 };
        let words = self.estimates([self.candidates, self.directions]).max(choices);
        (bytes / (4 * u64::from(words)).max(1)).min(1 << 30) as u32
    }
}

const UNDECIDED: &str = "GatherConfig::of decides what `auto` starts as";

/// The pass.
pub struct Gather {
    config: GatherConfig,
    /// `gather_proxy.comp`, and `gather_select.comp` or `gather_base.comp`, where the sampling uses the proxy.
    estimate: Option<[Pipeline; 2]>,
    trace: Pipeline,
    weights: Buffer<f32>,
    chosen: Buffer<[u32; 2]>,
    /// Directions of one invocation of `gather_proxy.comp`.
    block: u32,
    is_anisotropic: bool,
    /// By numbers of directions.
    points: Mutex<BTreeMap<u32, Buffer<u32>>>,
}

/// Arguments of the three kernels' dispatches over one list.
pub struct GatherArgs {
    /// M and N for its cells.
    counts: [u32; 2],
    estimate: Option<[ChunkArgs; 2]>,
    trace: ChunkArgs,
    /// Of even directions, and of those that are aimed at the eye.
    points: Buffer<u32>,
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
            Sampling::Residual => constants::SAMPLING_RESIDUAL,
            Sampling::Auto => unreachable!("{UNDECIDED}"),
        };
        let is_anisotropic = is_projected && scene.params.g != 0.0;
        let workgroup = ("WORKGROUP", LIST_WORKGROUP);
        let anisotropic = ("ANISOTROPIC", is_anisotropic.into());
        let even_albedo = ("EVEN_ALBEDO", scene.has_even_albedo.into());
        let trace = [
            workgroup,
            anisotropic,
            even_albedo,
            ("SOURCE", source),
            ("SKY", has_sky.into()),
            ("POINT_LIGHTS", scene.has_point_lights.into()),
            ("SAMPLING", sampling),
        ];
        let estimate = if config.sampling.uses_proxy() {
            let proxy = [workgroup, ("SKY", has_sky.into()), ("SAMPLING", sampling)];
            let second = match config.sampling {
                Sampling::Residual => {
                    Pipeline::new(ctx, &shaders::GATHER_BASE, &[workgroup, anisotropic, even_albedo])?
                }
                _ => Pipeline::new(ctx, &shaders::GATHER_SELECT, &[workgroup, ("SAMPLING", sampling)])?,
            };
            Some([Pipeline::new(ctx, &shaders::GATHER_PROXY, &proxy)?, second])
        } else {
            None
        };
        let estimates = config.estimates([config.candidates, config.directions]);
        let of_chunk = |is_used: bool, each: u32| if is_used { chunk_items as usize * each as usize } else { 1 };
        Ok(Self {
            estimate,
            trace: Pipeline::new(ctx, &shaders::GATHER_TRACE, &trace)?,
            weights: ctx.device_buffer("gather.weights", of_chunk(estimates > 0, estimates))?,
            chosen: ctx.device_buffer("gather.chosen", of_chunk(config.sampling.is_choice(), config.directions))?,
            block: rays_per_invocation(scene.params.dims, config.proxy_step).min(estimates.max(1)),
            is_anisotropic,
            points: Mutex::default(),
            config,
        })
    }

    /// Energies that the directions of the latest chunk have in the proxy, `[direction][item]` as in `gather_proxy.comp`, for
    /// tests.
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
        let counts = self.counts(share);
        f64::from(counts[1]) + 0.3 * f64::from(self.config.estimates(counts))
    }

    /// Arguments for all chunks of a list whose cells get the given share of directions; see [`List::chunk_args`].
    pub fn args(&self, ctx: &Context, rec: &mut Recorder, list: &List, share: f32) -> Result<GatherArgs> {
        let counts = self.counts(share);
        let ranks = if self.config.sampling == Sampling::Top { counts[0] } else { 1 };
        let estimate = if self.estimate.is_some() {
            let blocks = self.config.estimates(counts).div_ceil(self.block);
            Some([list.chunk_args(ctx, rec, blocks)?, list.chunk_args(ctx, rec, ranks)?])
        } else {
            None
        };
        Ok(GatherArgs { counts, estimate, trace: list.chunk_args(ctx, rec, 1)?, points: self.points(ctx, counts[1])? })
    }

    /// From which points `directions` directions are followed: the same for all lists and lights, so uploaded once.
    fn points(&self, ctx: &Context, directions: u32) -> Result<Buffer<u32>> {
        let mut known = self.points.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(points) = known.get(&directions) {
            return Ok(points.clone());
        }
        let aimed = if self.is_anisotropic { aimed_packed(directions) } else { Vec::new() };
        let points = ctx.upload("gather.points", &[packed(directions), aimed].concat())?;
        known.insert(directions, points.clone());
        Ok(points)
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
        let for_eye = u32::from(self.is_anisotropic && scattering.kept == Kept::Eye);
        order_compute(rec);
        if let Some([estimate, second]) = &self.estimate {
            let (proxy, [estimate_args, second_args]) = proxy.zip(args.estimate.as_ref()).expect("a built proxy");
            rec.begin_pass("gather.proxy", stream);
            let push = GatherProxyPush {
                chunk_begin,
                chunk_items,
                order,
                candidates,
                directions,
                block: self.block,
                step_voxels: c.proxy_step,
                for_eye,
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
            if c.sampling == Sampling::Residual {
                rec.begin_pass("gather.base", stream);
                // Without anisotropy every point gets the mean over all directions.
                let samples = if self.is_anisotropic { candidates } else { constants::CELL_POINTS };
                scattering.record_blocks(rec, chunk, samples, c.step, is_seen, |rec, slots| {
                    let push = GatherBasePush {
                        chunk_begin,
                        chunk_items,
                        order,
                        candidates,
                        directions,
                        slot_begin: slots.start,
                        slot_end: slots.end,
                        for_eye,
                    };
                    let binds = [
                        ("scene_block", scene.block.bind()),
                        ("scattering", scene.scattering(scattering.field).sampled(Filter::Linear)),
                        ("weights", self.weights.bind()),
                        ("samples", scattering.projection.samples().bind()),
                    ];
                    chunk.dispatch(rec, second, &binds, &push, second_args);
                });
            } else {
                rec.begin_pass("gather.select", stream);
                let push =
                    GatherSelectPush { chunk_begin, chunk_items, order, candidates, directions, defence: c.defence };
                let binds = [
                    ("scene_block", scene.block.bind()),
                    ("weights", self.weights.bind()),
                    ("chosen", self.chosen.bind()),
                ];
                chunk.dispatch(rec, second, &binds, &push, second_args);
            }
            rec.end_pass();
        }
        rec.begin_pass("gather.trace", stream);
        let lattice = if c.sampling.is_choice() { candidates } else { directions };
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
                for_eye,
            };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("lights", scene.lights.bind()),
                ("emptiness", emptiness.sampled(Filter::Nearest)),
                ("scattering", scene.scattering(scattering.field).sampled(Filter::Linear)),
                ("source_a", source.a.sampled(Filter::Linear)),
                ("source_x", source.b[0].sampled(Filter::Linear)),
                ("source_y", source.b[1].sampled(Filter::Linear)),
                ("source_z", source.b[2].sampled(Filter::Linear)),
                ("chosen", self.chosen.bind()),
                ("weights", self.weights.bind()),
                ("samples", scattering.projection.samples().bind()),
                ("points", args.points.bind()),
            ];
            chunk.dispatch(rec, &self.trace, &binds, &push, &args.trace);
        });
        rec.end_pass();
    }
}
