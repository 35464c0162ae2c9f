//! Structs shared with GLSL. `build.rs` checks size, offsets and member types of each against the shaders.

use bytemuck::{Pod, Zeroable};

/// `canary.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CanaryPush {
    /// Words to copy.
    pub count: u32,
    /// Added to the index of what is written.
    pub shift: u32,
}

/// `phase_probe.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct PhaseProbePush {
    /// Unit vector of propagation before scattering.
    pub before: [f32; 3],
    /// Mean cosine.
    pub g: f32,
    /// Cosines, and pairs of random numbers.
    pub count: u32,
}

/// `dispatch_args.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct DispatchArgsPush {
    /// Element of `counts` that holds the count.
    pub offset: u32,
    /// Largest count that there is room for.
    pub capacity: u32,
    /// Items per workgroup.
    pub tile_items: u32,
    /// Workgroups that there are even for no item: 0 or 1.
    pub least_tiles: u32,
}

/// `column_scan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ColumnScanPush {
    /// First word of the first row.
    pub first: u32,
    /// How many rows there are.
    pub rows: u32,
}

/// `bench_copy.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BenchCopyPush {
    /// Words, a multiple of the width of a load.
    pub count: u32,
}

/// `scan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ScanPush {
    /// Items, or `COUNT_ON_DEVICE`.
    pub count: u32,
    /// Element of `totals` for the sum of all items.
    pub total_at: u32,
}

/// `select.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SelectPush {
    /// Items, or `COUNT_ON_DEVICE`.
    pub count: u32,
    /// Element of `totals` for the number of selected items.
    pub total_at: u32,
}

/// `radix_histogram.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixHistogramPush {
    /// Keys, or `COUNT_ON_DEVICE`.
    pub count: u32,
    /// First bit to sort by.
    pub bit_begin: u32,
    /// Bit after the last to sort by.
    pub bit_end: u32,
    /// Bits of a digit, at most `RADIX_BITS`.
    pub digit_bits: u32,
    /// Passes that follow.
    pub passes: u32,
}

/// `radix_scan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixScanPush {
    /// Status rows per pass: tiles + 1.
    pub rows: u32,
}

/// `radix_onesweep.comp` and `radix_runs.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RadixPassPush {
    /// Pairs, or `COUNT_ON_DEVICE`.
    pub count: u32,
    /// Which digit, from 0.
    pub pass: u32,
    /// How many passes there are.
    pub passes: u32,
    /// First bit to sort by.
    pub bit_begin: u32,
    /// Bit after the last to sort by.
    pub bit_end: u32,
    /// Bits of a digit, at most `RADIX_BITS`.
    pub digit_bits: u32,
    /// Status rows per pass: tiles + 1.
    pub rows: u32,
}

/// `scene.glsl`: the scene's numbers for all kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[allow(missing_docs, reason = "scene.glsl documents the members")]
pub struct SceneParams {
    pub world_of_x: [f32; 3],
    pub world_of_y: [f32; 3],
    pub world_of_z: [f32; 3],
    pub world_of_origin: [f32; 3],
    pub index_of_x: [f32; 3],
    pub index_of_y: [f32; 3],
    pub index_of_z: [f32; 3],
    pub index_of_origin: [f32; 3],
    pub dims: [u32; 3],
    pub light_edge: u32,
    pub light_dims: [u32; 3],
    pub transfer_points: u32,
    pub eye: [f32; 3],
    pub forward: [f32; 3],
    pub right: [f32; 3],
    pub up: [f32; 3],
    pub size: [u32; 2],
    pub unit_distance: f32,
    pub density_scale: f32,
    pub max_extinction: f32,
    pub radiance_scale: f32,
    pub g: f32,
    pub emission_scale: f32,
    pub albedo_scale: [f32; 3],
    pub even_albedo: [f32; 3],
    pub environment: [f32; 3],
    pub background: [f32; 3],
    pub environment_rotation: f32,
    pub environment_size: [u32; 2],
    pub mean_spacing: f32,
    pub seed_low: u32,
    pub seed_high: u32,
}

/// `transfer.glsl`: one point of the transfer function.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct TransferPointData {
    /// Scalar in the volume's unit.
    pub value: f32,
    /// Opacity or extinction, before the density scale.
    pub opacity: f32,
    /// Albedo or emitted colour.
    pub color: [f32; 3],
    /// Emitted radiance.
    pub emission: [f32; 3],
}

/// `single_scatter.comp`, `phong.comp`: a delta light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LightData {
    /// Directional: direction of travel; point: position. World.
    pub vector: [f32; 3],
    /// 1 for a point light.
    pub is_point: u32,
    /// Irradiance or radiant intensity.
    pub power: [f32; 3],
}

/// A chunk of the list of active voxels (`encode.comp`, `source_max.comp`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ChunkPush {
    /// First list item.
    pub chunk_begin: u32,
    /// List items of a chunk.
    pub chunk_items: u32,
}

/// `chunk_args.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ChunkArgsPush {
    /// Chunks, one indirect dispatch each.
    pub chunks: u32,
    /// List items of a chunk.
    pub chunk_items: u32,
    /// Workgroup size of the kernel that is dispatched.
    pub workgroup: u32,
    /// Its workgroups along y.
    pub groups_y: u32,
}

/// `compact.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CompactPush {
    /// First index of the range.
    pub first: u32,
    /// Indices of the range.
    pub count: u32,
    /// Voxels along the edge of a block.
    pub edge: u32,
}

/// `mark.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct MarkPush {
    /// Voxels along the edge of a block.
    pub edge: u32,
}

/// `spread.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SpreadPush {
    /// 1: what is spread is added to the total.
    pub adds: u32,
    /// 1: light that was solved for before joins.
    pub joins: u32,
}

/// `see.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SeePush {
    /// Rays per pixel along each axis of the picture.
    pub rays: u32,
    /// First row of rays.
    pub row_begin: u32,
    /// Row after the last.
    pub row_end: u32,
    /// Step of the rays in voxels.
    pub step_voxels: f32,
}

/// `single_scatter.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "single_scatter.comp documents the members")]
pub struct SingleScatterPush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub light_begin: u32,
    pub light_end: u32,
    pub environment_begin: u32,
    pub environment_end: u32,
    pub environment_directions: u32,
    pub step_voxels: f32,
}

/// `phong.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct PhongPush {
    /// First list item.
    pub chunk_begin: u32,
    /// List items of a chunk.
    pub chunk_items: u32,
    /// Lights in the list.
    pub lights_count: u32,
    /// Mean radiance of the environment.
    pub ambient: [f32; 3],
}

/// `compress_runs.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CompressRunsPush {
    /// Voxels of the volume.
    pub count: u32,
    /// Runs that fit into the lists.
    pub capacity: u32,
}

/// `color_histogram.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ColorHistogramPush {
    /// Voxels of the volume.
    pub count: u32,
}

/// `proxy_plan.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ProxyPlanPush {
    /// Runs that fit into the lists.
    pub capacity: u32,
    /// Workgroups of an attempt along x.
    pub groups_x: u32,
    /// Workgroups of an attempt along y.
    pub groups_y: u32,
    /// 1 before the first attempt.
    pub is_start: u32,
    /// Mask of the first attempt, as [`PROXY_MASK`](crate::shaders::constants::PROXY_MASK).
    pub mask: u32,
}

/// `compress_buckets.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CompressBucketsPush {
    /// `COUNT_ON_DEVICE`.
    pub count: u32,
    /// Voxels of the volume.
    pub voxels: u32,
}

/// `bucket_light.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BucketLightPush {
    /// `COUNT_ON_DEVICE`.
    pub count: u32,
}

/// `gather_proxy.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "gather_proxy.comp documents the members")]
pub struct GatherProxyPush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub order: u32,
    pub candidates: u32,
    pub directions: u32,
    pub block: u32,
    pub step_voxels: f32,
    /// 1: nobody but the eye will see what is gathered.
    pub for_eye: u32,
}

/// `gather_select.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "gather_select.comp documents the members")]
pub struct GatherSelectPush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub order: u32,
    pub candidates: u32,
    pub directions: u32,
    pub defence: f32,
}

/// `gather_base.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "gather_base.comp documents the members")]
pub struct GatherBasePush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub order: u32,
    pub candidates: u32,
    pub directions: u32,
    pub slot_begin: u32,
    pub slot_end: u32,
    /// 1: nobody but the eye will see what is gathered.
    pub for_eye: u32,
}

/// `gather_trace.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "gather_trace.comp documents the members")]
pub struct GatherTracePush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub order: u32,
    pub lattice: u32,
    pub slot_begin: u32,
    pub slot_end: u32,
    pub directions: u32,
    pub step_voxels: f32,
    pub light: u32,
    /// 1: nobody but the eye will see what is gathered.
    pub for_eye: u32,
}

/// `pilot.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "pilot.comp documents the members")]
pub struct PilotPush {
    pub cells: u32,
    pub directions: u32,
    pub block: u32,
    pub step_voxels: f32,
    pub proxy_step_voxels: f32,
}

/// `pilot.comp`: what one replicate found in one cell, or in a block of its directions.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[allow(missing_docs, reason = "pilot.comp documents the members")]
pub struct PilotSample {
    pub traced: [f32; 3],
    pub base: [f32; 3],
    pub residual: [f32; 3],
    pub traced_steps: u32,
    pub proxy_steps: u32,
}

impl std::ops::Add for PilotSample {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let sum = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|c| a[c] + b[c]);
        Self {
            traced: sum(self.traced, other.traced),
            base: sum(self.base, other.base),
            residual: sum(self.residual, other.residual),
            traced_steps: self.traced_steps + other.traced_steps,
            proxy_steps: self.proxy_steps + other.proxy_steps,
        }
    }
}

/// `include/scatter_sample.glsl`: light that a point of a cell scatters.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "scatter_sample.glsl documents the members")]
pub struct ScatterSample {
    pub light: [f32; 3],
    pub travel: [f32; 3],
    pub point: u32,
}

/// `project_deposit.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "project_deposit.comp documents the members")]
pub struct ProjectDepositPush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub slots: u32,
    pub corner: u32,
    pub is_seen: u32,
}

/// `project_solve.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "project_solve.comp documents the members")]
pub struct ProjectSolvePush {
    pub chunk_begin: u32,
    pub chunk_items: u32,
    pub adds: u32,
    pub joins: u32,
    pub factor: f32,
}

/// `distance.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct DistancePush {
    /// 0, 1, 2 = x, y, z.
    pub axis: u32,
}

/// `cubes.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CubesPush {
    /// Level that is made; the largest one, when it is spread.
    pub level: u32,
}

/// `bench_rays.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "bench_rays.comp documents the members")]
pub struct BenchRaysPush {
    pub cell_begin: u32,
    pub cell_end: u32,
    pub cell_count: u32,
    pub directions: u32,
    pub block: u32,
    pub step_voxels: f32,
    pub reach: f32,
}

/// `camera.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "camera.comp documents the members")]
pub struct CameraPush {
    pub row_begin: u32,
    pub row_end: u32,
    pub sample_index: u32,
    pub samples: u32,
    pub step_voxels: f32,
    pub light_count: u32,
    pub lights_per_sample: u32,
    pub light_step: f32,
    pub y_stride: u32,
    pub depth_stride: u32,
    pub start_stride: u32,
}

/// `path.comp`: a path under way.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "path.comp documents the members")]
pub struct PathState {
    pub position: [f32; 3],
    pub direction: [f32; 3],
    pub cell: [i32; 3],
    pub t: f32,
    pub next: [f32; 3],
    pub throughput: [f32; 3],
    pub radiance: [f32; 3],
    pub pending: [f32; 3],
    pub transmittance: f32,
    pub reach: f32,
    pub density: f32,
    pub stage: u32,
    pub scatterings: u32,
    pub done: u32,
    pub draws: u32,
}

/// `path.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[allow(missing_docs, reason = "path.comp documents the members")]
pub struct PathPush {
    pub row_begin: u32,
    pub row_end: u32,
    pub sample_begin: u32,
    pub sample_count: u32,
    pub orders: u32,
    pub light_count: u32,
    pub budget: u32,
    pub event_cost: u32,
}
