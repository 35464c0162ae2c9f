//! The projection: from samples of scattered light in cells to the source that is stored per voxel
//! (`glsl/project_deposit.comp`, `glsl/project_solve.comp`).
//!
//! A source is extinction times a function that is trilinear between values at the nodes: the voxels' centres, or those of
//! larger blocks, whose values are then spread to the voxels (`passes::spread`). The values are those that meet
//! the sampled σ_s L best in the least-squares sense: a finite-element solution. Light falls off within a voxel where the
//! medium is dense; values at voxel centres alone would miss what lies between them.

use super::compact::{Chunk, ChunkArgs, List};
use super::scene_data::SceneData;
use super::spread::Spread;
use super::{LIST_WORKGROUP, order_compute, rays_per_invocation};
use crate::Result;
use crate::abi::{ProjectDepositPush, ProjectSolvePush, ScatterSample};
use crate::scene::LightFor;
use crate::shaders;
use crate::vk::{Access, Buffer, Context, Filter, Image, Pipeline, Recorder};
use std::ops::Range;

/// Source of one order, or of all that the eye sees: σ (A + B·ω), ω the propagation direction; B = 0 where g = 0.
#[derive(Clone)]
pub struct Source {
    /// rgb = A, a = extinction.
    pub a: Image,
    /// B's x, y, z; a 1×1×1 image where g = 0.
    pub b: [Image; 3],
}

impl Source {
    /// Images for a source. Zeroed by [`Source::clear`], not here.
    pub fn new(ctx: &Context, scene: &SceneData, name: &str, is_anisotropic: bool) -> Result<Self> {
        let dims = scene.params.dims;
        let small = if is_anisotropic { dims } else { [1; 3] };
        let image = |part, dims| scene.field(ctx, &format!("{name}.{part}"), dims);
        Ok(Self { a: image("a", dims)?, b: [image("x", small)?, image("y", small)?, image("z", small)?] })
    }

    /// Sets everything to zero ([`Access::TransferWrite`]).
    pub fn clear(&self, rec: &mut Recorder) {
        rec.clear_image(&self.a);
        for b in &self.b {
            rec.clear_image(b);
        }
    }
}

/// What is kept of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// Their mean over directions as A: all there is for g = 0.
    Mean,
    /// For g ≠ 0: the eye's share.
    Eye,
    /// For g ≠ 0: A, B, and the eye's share.
    MomentsAndEye,
    /// For g ≠ 0: A and B.
    Moments,
}

/// What a pass that scatters light reads, and where its samples go.
#[derive(Clone, Copy)]
pub struct Scattering<'a> {
    /// The scene.
    pub scene: &'a SceneData,
    /// Empty space, which rays skip.
    pub emptiness: &'a Image,
    /// Extinction in its fourth component.
    pub field: &'a Image,
    /// What takes the samples.
    pub projection: &'a Projection,
    /// Arguments of kernels with one invocation per cell of the list.
    pub args: &'a ChunkArgs,
    /// What is kept of the samples.
    pub kept: Kept,
}

impl Scattering<'_> {
    /// Takes `samples` samples of every cell of a chunk in as many dispatches as the loop budget for rays of `step` voxels
    /// and the room for samples need. `trace` records the dispatch of a range of them.
    pub(super) fn record_blocks(
        &self,
        rec: &mut Recorder,
        chunk: &Chunk<'_>,
        samples: u32,
        step: f32,
        is_seen: bool,
        mut trace: impl FnMut(&mut Recorder, Range<u32>),
    ) {
        let most = rays_per_invocation(self.scene.params.dims, step).min(self.projection.slots);
        for begin in (0..samples).step_by(most as usize) {
            let block = begin..samples.min(begin + most);
            let slots = block.end - block.start;
            order_compute(rec);
            trace(rec, block);
            self.projection.record_deposit(rec, self.scene, chunk, self.args, slots, is_seen, self.kept);
        }
    }
}

/// Right-hand sides, and everything else that a projection needs.
pub struct Projection {
    deposit: Vec<(Kept, Pipeline)>,
    /// The first step, and every other.
    solve: [Pipeline; 2],
    is_anisotropic: bool,
    light_for: LightFor,
    samples: Buffer<ScatterSample>,
    slots: u32,
    /// Of A, B by component, and the eye's share; single texels where g = 0 and they are not used.
    sums: [Image; 5],
    scratch: Image,
    /// Where nodes are no voxels: what the steps write by turns with `scratch`, and the way to the voxels.
    coarse: Option<(Image, Spread)>,
    factors: Vec<f32>,
}

/// Most samples of a cell between two deposits: the loop of `project_deposit.comp`.
const MAX_SLOTS: u64 = 32;
/// Room for the samples of a chunk [bytes].
const SAMPLES_BYTES: u64 = 64 << 20;

/// Smallest eigenvalue of D⁻¹M that the steps are made for. Fields that vary along one axis have at least 1/3; what is
/// smaller varies along several at once from voxel to voxel, is mostly noise, and is met less exactly.
const LEAST_EIGENVALUE: f64 = 1.0 / 9.0;

/// Factors of `steps` Richardson steps for eigenvalues from `LEAST_EIGENVALUE` to 1: the inverse roots of Chebyshev's
/// polynomial, large and small ones by turns, since large ones alone would blow up rounding errors.
pub fn step_factors(steps: u32) -> Vec<f32> {
    let (middle, half) = (0.5 * (1.0 + LEAST_EIGENVALUE), 0.5 * (1.0 - LEAST_EIGENVALUE));
    let n = f64::from(steps);
    let root = |k: u32| middle - half * ((f64::from(k) + 0.5) * std::f64::consts::PI / n).cos();
    let order = (0..steps).map(|i| if i % 2 == 0 { i / 2 } else { steps - 1 - i / 2 });
    order.map(|k| (1.0 / root(k)) as f32).collect()
}

impl Projection {
    /// Makes pipelines and memory for chunks of `chunk_items` cells. `steps` of the solution, at least one, follow the first
    /// guess.
    pub fn new(
        ctx: &Context,
        scene: &SceneData,
        chunk_items: u32,
        steps: u32,
        has_next: bool,
        light_for: LightFor,
    ) -> Result<Self> {
        let is_anisotropic = scene.params.g != 0.0;
        let has_eye = is_anisotropic && light_for == LightFor::View;
        let deposit = |&kept: &Kept| {
            let specialization = [
                ("WORKGROUP", LIST_WORKGROUP),
                ("MOMENTS", matches!(kept, Kept::Moments | Kept::MomentsAndEye).into()),
                ("EYE", matches!(kept, Kept::Eye | Kept::MomentsAndEye).into()),
            ];
            let kernel = scene.stored.version(shaders::PROJECT_DEPOSIT_VERSIONS);
            Ok((kept, Pipeline::new(ctx, kernel, &specialization)?))
        };
        let used = match light_for {
            _ if !is_anisotropic => &[Kept::Mean][..],
            LightFor::View => &[Kept::Mean, Kept::Eye, Kept::MomentsAndEye],
            LightFor::EveryView => &[Kept::Mean, Kept::Moments],
        };
        let bytes = u64::from(chunk_items) * size_of::<ScatterSample>() as u64;
        let slots = (SAMPLES_BYTES / bytes).clamp(1, MAX_SLOTS) as u32;
        let dims = scene.params.light_dims;
        let is_coarse = scene.is_coarse();
        let scratch = |name| scene.field(ctx, name, dims);
        let sum = |name, is_used| ctx.image_3d(name, if is_used { dims } else { [1; 3] }, scene.stored.sum_format());
        let solve = |is_first: bool| {
            let specialization =
                [("WORKGROUP", LIST_WORKGROUP), ("COARSE", is_coarse.into()), ("FIRST", is_first.into())];
            Pipeline::new(ctx, scene.stored.version(shaders::PROJECT_SOLVE_VERSIONS), &specialization)
        };
        let has_b = is_anisotropic && (has_next || !has_eye);
        Ok(Self {
            deposit: used.iter().map(deposit).collect::<Result<_>>()?,
            solve: [solve(true)?, solve(false)?],
            is_anisotropic,
            light_for,
            samples: ctx.device_buffer("project.samples", (chunk_items * slots) as usize)?,
            slots,
            sums: [
                sum("project.a", has_next || !has_eye)?,
                sum("project.x", has_b)?,
                sum("project.y", has_b)?,
                sum("project.z", has_b)?,
                sum("project.eye", has_eye)?,
            ],
            scratch: scratch("project.scratch")?,
            coarse: if is_coarse { Some((scratch("project.nodes")?, Spread::new(ctx, scene)?)) } else { None },
            factors: step_factors(steps),
        })
    }

    /// Where the samples of a chunk's cells go, `[slot][item]`.
    pub fn samples(&self) -> &Buffer<ScatterSample> {
        &self.samples
    }

    /// Samples of a cell that there is room for.
    pub fn slots(&self) -> u32 {
        self.slots
    }

    /// Right-hand sides of A, B by component, and the eye's share, for tests.
    pub fn sums(&self) -> &[Image; 5] {
        &self.sums
    }

    /// Does the eye see what [`Self::record_solve_eye`] finds, instead of the orders' sources?
    pub fn has_eye(&self) -> bool {
        self.is_anisotropic && self.light_for == LightFor::View
    }

    /// What is kept of the samples of an order, the last one or not.
    pub fn kept(&self, has_next: bool) -> Kept {
        match (self.is_anisotropic, self.has_eye(), has_next) {
            (false, ..) => Kept::Mean,
            (true, false, _) => Kept::Moments,
            (true, true, false) => Kept::Eye,
            (true, true, true) => Kept::MomentsAndEye,
        }
    }

    /// Empties scratch memory and all right-hand sides ([`Access::TransferWrite`]). Once, before the first order.
    pub fn record_clear_all(&self, rec: &mut Recorder) {
        for image in self.sums.iter().chain([&self.scratch]).chain(self.coarse.iter().map(|(nodes, _)| nodes)) {
            rec.clear_image(image);
        }
    }

    /// Starts an order: empties its right-hand sides. Ordered between all compute accesses before and after.
    pub fn record_clear(&self, rec: &mut Recorder) {
        rec.barrier(Access::ComputeReadWrite, Access::TransferWrite);
        for image in &self.sums[..4] {
            rec.clear_image(image);
        }
        rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
    }

    /// Adds the samples of a chunk's cells, `slots` of each. `is_seen`: the eye shall see them through what is stored.
    ///
    /// Ordered after all compute accesses before; ends with the right-hand sides written by compute.
    #[allow(clippy::too_many_arguments, reason = "what is read, and for whom")]
    pub fn record_deposit(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        chunk: &Chunk<'_>,
        args: &ChunkArgs,
        slots: u32,
        is_seen: bool,
        kept: Kept,
    ) {
        let [a, x, y, z, eye] = &self.sums;
        let pipeline = self.deposit.iter().find(|(k, _)| *k == kept).map(|(_, pipeline)| pipeline);
        let pipeline = pipeline.expect("a pipeline for what is kept");
        for corner in 0..8 {
            order_compute(rec);
            let push = ProjectDepositPush {
                chunk_begin: chunk.begin,
                chunk_items: chunk.items,
                slots,
                corner,
                is_seen: is_seen.into(),
            };
            let binds = [
                ("scene_block", scene.block.bind()),
                ("samples", self.samples.bind()),
                ("sum_a", a.storage()),
                ("sum_x", x.storage()),
                ("sum_y", y.storage()),
                ("sum_z", z.storage()),
                ("sum_eye", eye.storage()),
            ];
            chunk.dispatch(rec, pipeline, &binds, &push, args);
        }
    }

    /// Solves for a source. `nodes` with its chunks' `args`; `total` has the extinction. `fixed`: light that enters the source
    /// beside what is solved for. `is_seen`: what is solved for is added to `total`.
    ///
    /// Ordered after all compute accesses before; ends with `source` and `total` written by compute.
    #[allow(clippy::too_many_arguments, reason = "what is read and written is named one by one")]
    pub fn record_solve(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        nodes: &List,
        args: &ChunkArgs,
        source: &Source,
        fixed: Option<&Source>,
        total: &Source,
        is_seen: bool,
    ) {
        let (field, a) = (&total.a, fixed.map(|f| &f.a));
        self.solve(rec, scene, nodes, args, &self.sums[0], &source.a, a, field, is_seen.then_some(field));
        if self.is_anisotropic {
            for (axis, b) in source.b.iter().enumerate() {
                let (sums, fixed) = (&self.sums[1 + axis], fixed.map(|f| &f.b[axis]));
                self.solve(rec, scene, nodes, args, sums, b, fixed, field, is_seen.then_some(&total.b[axis]));
            }
        }
    }

    /// Solves for A alone, and writes it to `solution`; `field` has the extinction. Ordered as [`Self::record_solve`].
    pub fn record_solve_mean(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        nodes: &List,
        args: &ChunkArgs,
        solution: &Image,
        field: &Image,
    ) {
        self.solve(rec, scene, nodes, args, &self.sums[0], solution, None, field, None);
    }

    /// Where [`Self::has_eye`], after the last order: adds what the eye sees to `total`. `source` is overwritten.
    ///
    /// Ordered as [`Self::record_solve`].
    pub fn record_solve_eye(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        nodes: &List,
        args: &ChunkArgs,
        source: &Source,
        total: &Image,
    ) {
        self.solve(rec, scene, nodes, args, &self.sums[4], &source.a, None, total, Some(total));
    }

    #[allow(clippy::too_many_arguments, reason = "what is read and written is named one by one")]
    fn solve(
        &self,
        rec: &mut Recorder,
        scene: &SceneData,
        nodes: &List,
        args: &ChunkArgs,
        sums: &Image,
        solution: &Image,
        fixed: Option<&Image>,
        field: &Image,
        sum: Option<&Image>,
    ) {
        let last = self.factors.len();
        let result = self.coarse.as_ref().map_or(solution, |(nodes, _)| nodes);
        let target = |step: usize| if (last - step).is_multiple_of(2) { result } else { &self.scratch };
        // The last step ends what there is to do, unless its values are spread.
        let ends = |step: usize| step == last && self.coarse.is_none();
        for step in 0..=last {
            // Nodes that are voxels have extinction wherever the step before wrote, and in `field` from the beginning.
            let before = if step == 0 { field } else { target(step - 1) };
            // Only an end, which is not the first step, touches what it adds to.
            let seen = match &self.coarse {
                Some(_) => solution,
                None if step == 0 => target(1),
                None => sum.unwrap_or(field),
            };
            for chunk in nodes.chunks() {
                order_compute(rec);
                let push = ProjectSolvePush {
                    chunk_begin: chunk.begin,
                    chunk_items: chunk.items,
                    adds: (sum.is_some() && ends(step)).into(),
                    joins: (fixed.is_some() && ends(step)).into(),
                    factor: if step == 0 { 0.0 } else { self.factors[step - 1] },
                };
                let binds = [
                    ("scene_block", scene.block.bind()),
                    ("sums", sums.sampled(Filter::Nearest)),
                    ("before", before.sampled(Filter::Nearest)),
                    ("after", target(step).storage()),
                    ("total", seen.storage()),
                    ("fixed_light", fixed.unwrap_or(sums).sampled(Filter::Nearest)),
                    // Read where nodes are no voxels.
                    ("field", if self.coarse.is_some() { field } else { before }.sampled(Filter::Linear)),
                ];
                chunk.dispatch(rec, &self.solve[usize::from(step > 0)], &binds, &push, args);
            }
        }
        if let Some((nodes, spread)) = &self.coarse {
            spread.record(rec, scene, nodes, field, solution, sum, &self.scratch, fixed);
        }
    }
}
