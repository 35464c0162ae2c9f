//! Rays of `tyndall bench proxy`: exact structures find what uniform steps find, stretches of equal light what a walk from
//! voxel to voxel finds, and all of them the closed form in a uniform medium.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, cases, image, random_light, random_values, scene_of, scenes, texture};
use common::gpu_test;
use data::Random;
use glam::{Vec2, Vec4};
use half::f16;
use tyndall::abi::SceneParams;
use tyndall::cpu::bench_rays as twin;
use tyndall::cpu::march::Ray;
use tyndall::cpu::texture::Texture;
use tyndall::passes::bench_rays::{BenchRays, RayConfig, RayInputs};
use tyndall::passes::compact::Listed;
use tyndall::passes::cubes::Cubes;
use tyndall::passes::emptiness::{Emptiness, Measure};
use tyndall::passes::mips::Mips;
use tyndall::shaders::constants;
use tyndall::vk::{Buffer, Context, Image, ImageFormat, Recorder};
use tyndall::volume::Grid;

/// Rays of a cell: more than one block where the loop budget says so.
const DIRECTIONS: u32 = 6;

/// A scene with light in it, and all structures.
struct World {
    setup: Setup,
    cells: Vec<u32>,
    source: Image,
    /// Of random blocks of voxels: bucketIDs, and the light of each bucket.
    ids: Image,
    bucket_light: Buffer<u32>,
    light: Texture<Vec2>,
    cubes: Cubes,
    mips: Mips,
}

impl World {
    fn new(ctx: &Context, setup: Setup, source: &Texture<Vec4>) -> Self {
        let dims = setup.host.params.dims;
        let (_, cells) = setup.list(ctx, Listed::Cells);
        let source = image(ctx, "source", source);
        // Five buckets in blocks of two voxels; the first is empty.
        let mut random = Random(17);
        let of_block: Vec<u32> = (0..997).map(|_| random.word() % 5).collect();
        let id = |i: u32| {
            let [x, y, z] = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(|v| v / 2);
            of_block[((z * 31 + y) * 31 + x) as usize % of_block.len()]
        };
        let id_texels: Vec<u32> = (0..dims.iter().product()).map(id).collect();
        let buckets = [[0.0, 0.0], [40.0, 0.1], [7.0, 0.3], [900.0, 0.02], [100.0, 1.0]].map(|b| b.map(f16::from_f32));
        let words: Vec<u32> = buckets.iter().map(|&b| bytemuck::cast(b)).collect();
        let light = id_texels.iter().map(|&id| Vec2::from(buckets[id as usize].map(f32::from))).collect();
        let ids = ctx.image_3d("ids", dims, ImageFormat::R32Uint).unwrap();
        let layer = (dims[0] * dims[1]) as usize;
        ctx.upload_image(&ids, |z| id_texels[z.start as usize * layer..z.end as usize * layer].to_vec()).unwrap();
        let (cubes, mips) = (Cubes::new(ctx, dims).unwrap(), Mips::new(ctx, dims).unwrap());
        let mut rec = Recorder::new(ctx).unwrap();
        cubes.record(&mut rec, &ids);
        mips.record(&mut rec, &source, &setup.emptiness.image);
        rec.submit_and_wait().unwrap();
        let bucket_light = ctx.upload("bucket light", &words).unwrap();
        Self { setup, cells, source, ids, bucket_light, light: Texture::new(dims, light), cubes, mips }
    }

    fn inputs(&self) -> RayInputs<'_> {
        RayInputs {
            source: &self.source,
            emptiness: &self.setup.emptiness.image,
            skips: &self.setup.emptiness.image,
            values: &self.mips.values[0],
            bucket_light: &self.bucket_light,
            coarse_values: [&self.mips.values[1], &self.mips.values[2]],
            coarse_source: [&self.mips.means[1], &self.mips.means[2]],
        }
    }

    fn follow(&self, ctx: &Context, config: RayConfig, inputs: RayInputs<'_>) -> Vec<[f32; 2]> {
        let pass = BenchRays::new(ctx, config).unwrap();
        let cells = ctx.upload("cells", &self.cells).unwrap();
        let rays = self.cells.len() * DIRECTIONS as usize;
        let results = ctx.device_buffer("results", rays).unwrap();
        let counts = ctx.device_buffer("counts", rays).unwrap();
        let run = |counts: Option<&Buffer<[u32; 3]>>| -> Vec<[f32; 2]> {
            let mut rec = Recorder::new(ctx).unwrap();
            pass.record(&mut rec, &self.setup.data, inputs, &cells, DIRECTIONS, &results, counts);
            rec.submit_and_wait().unwrap();
            ctx.read_back(&results).unwrap()
        };
        let found = run(None);
        assert_eq!(found, run(Some(&counts)), "counting changes what is found");
        let counted: Vec<[u32; 3]> = ctx.read_back(&counts).unwrap();
        assert!(counted.iter().all(|c| c[0] > 0 && c[1] + c[2] >= c[0]), "{config:?}: {counted:?}");
        found
    }

    /// What the twin finds along the same rays.
    fn expected(&self, step: f32, of: impl Fn(&SceneParams, Ray) -> [f32; 2]) -> Vec<[f32; 2]> {
        let params = &self.setup.host.params;
        let along = |d: u32| self.cells.iter().map(move |&cell| (cell, d));
        (0..DIRECTIONS)
            .flat_map(along)
            .map(|(cell, d)| of(params, twin::ray(params, cell, d, DIRECTIONS, step)))
            .collect()
    }
}

const PLAIN: RayConfig =
    RayConfig { structure: constants::STRUCTURE_NONE, edge: constants::SKIP_SIZE, step: 0.9, reach: 2.0 };

/// At most one ray in a hundred, which ends a step earlier or later or grazes an edge, is further off than `tolerance` of
/// its value plus of the mean.
#[track_caller]
fn assert_agree(case: &str, got: &[[f32; 2]], expected: &[[f32; 2]], tolerance: f32) {
    assert_eq!(got.len(), expected.len(), "{case}");
    for k in 0..2 {
        let mean = expected.iter().map(|e| e[k]).sum::<f32>() / expected.len().max(1) as f32;
        // Written so that a NaN is wrong.
        let is_right = |i: &usize| (got[*i][k] - expected[*i][k]).abs() <= tolerance * (expected[*i][k] + mean);
        let wrong: Vec<usize> = (0..got.len()).filter(|i| !is_right(i)).collect();
        assert!(
            wrong.len() * 100 <= got.len(),
            "{case}: {} of {} rays differ in component {k}; the first: {} instead of {}",
            wrong.len(),
            got.len(),
            got[wrong[0]][k],
            expected[wrong[0]][k]
        );
    }
}

#[test]
fn exact_structures_find_what_uniform_steps_find() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            let setup = Setup::new(ctx, &scene);
            let (dims, field) = (setup.host.params.dims, texture(ctx, &setup.field));
            let light = random_light(dims, 5, 0.0, 900.0);
            let texels = light.texels.iter().zip(&field.texels).map(|(l, f)| l.truncate().extend(f.w)).collect();
            let source = Texture::new(dims, texels);
            let world = World::new(ctx, setup, &source);
            let uniform = world.follow(ctx, PLAIN, world.inputs());
            let expected = world.expected(PLAIN.step, |params, ray| twin::exact(params, &source, ray));
            assert_agree(&format!("{name}: uniform steps"), &uniform, &expected, 2e-3);
            // More macrocells than one along every axis are in the islands alone.
            let edges = if name == "islands" { vec![4, 8] } else { vec![4] };
            for edge in cases(edges) {
                for (structure, measure) in [
                    (constants::STRUCTURE_CELLS, Measure::Occupied),
                    (constants::STRUCTURE_DISTANCE, Measure::Distance),
                    (constants::STRUCTURE_OCTANTS, Measure::Octants),
                    (constants::STRUCTURE_FLAT, Measure::Octants),
                    (constants::STRUCTURE_OCTREE, Measure::Occupied),
                ] {
                    let emptiness = Emptiness::new(ctx, dims, edge, measure).unwrap();
                    let octree = Cubes::new(ctx, emptiness.image.extent()).unwrap();
                    let mut rec = Recorder::new(ctx).unwrap();
                    emptiness.record(&mut rec, &world.setup.data, &world.setup.field);
                    octree.record(&mut rec, &emptiness.image);
                    rec.submit_and_wait().unwrap();
                    let is_octree = structure == constants::STRUCTURE_OCTREE;
                    let skips = if is_octree { &octree.image } else { &emptiness.image };
                    let inputs = RayInputs { emptiness: &emptiness.image, skips, ..world.inputs() };
                    let found = world.follow(ctx, RayConfig { structure, edge, ..PLAIN }, inputs);
                    assert_agree(&format!("{name}: structure {structure}, cells of {edge}"), &found, &uniform, 1e-4);
                }
            }
        }
    });
}

#[test]
fn runs_and_cubes_find_what_a_walk_from_voxel_to_voxel_finds() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            let setup = Setup::new(ctx, &scene);
            let source = random_light(setup.host.params.dims, 5, 0.0, 1.0);
            let world = World::new(ctx, setup, &source);
            let expected = world.expected(1.0, |params, ray| twin::voxels(params, &world.light, ray));
            for (structure, values) in
                [(constants::STRUCTURE_RUNS, &world.ids), (constants::STRUCTURE_CUBES, &world.cubes.image)]
            {
                let inputs = RayInputs { values, ..world.inputs() };
                let found = world.follow(ctx, RayConfig { structure, ..PLAIN }, inputs);
                // The kernel stops at a transmittance of a hundredth, a cube may begin a thousandth of a voxel late.
                let most = world.light.texels.iter().map(|l| l.x).fold(0.0, f32::max);
                for (got, expected) in found.iter().zip(&expected) {
                    let off = (got[0] - expected[0]).abs();
                    assert!(off <= 0.011 * most + 2e-3 * expected[0], "{name} {structure}: {got:?}, {expected:?}");
                }
                let clear = |r: &[[f32; 2]]| -> Vec<[f32; 2]> {
                    r.iter().zip(&expected).filter(|(_, e)| e[1] > 0.02).map(|(r, _)| *r).collect()
                };
                let tolerance = 1e-2;
                assert_agree(&format!("{name}: structure {structure}"), &clear(&found), &clear(&expected), tolerance);
            }
        }
    });
}

/// S (1 − e^−σd) along every ray, whatever the structure; estimates stop at a transmittance of a hundredth.
#[test]
fn a_uniform_medium_is_met_by_all() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([17, 9, 12], [1.0, 0.5, 2.0], [0.0; 3]);
        let dims = grid.dims;
        let values: Vec<f32> = random_values(3, dims.iter().product::<u32>() as usize).iter().map(|_| 0.9).collect();
        let setup = Setup::new(ctx, &scene_of(grid, values));
        let source = Texture::filled(dims, Vec4::new(30.0, 60.0, 90.0, texture(ctx, &setup.field).texels[0].w));
        let world = World::new(ctx, setup, &source);
        let sigma = source.texels[0].w * world.setup.host.params.max_extinction;
        let closed = |_: &SceneParams, ray: Ray| {
            let passed = (-sigma * (ray.end - ray.begin)).exp();
            [60.0 * (1.0 - passed), passed]
        };
        let one_bucket = ctx.image_3d("ids", dims, ImageFormat::R32Uint).unwrap();
        let layer = (dims[0] * dims[1]) as usize;
        ctx.upload_image(&one_bucket, |z| vec![0u32; z.len() * layer]).unwrap();
        let word: u32 = bytemuck::cast([f16::from_f32(60.0), f16::from_f32(source.texels[0].w)]);
        let bucket_light = ctx.upload("bucket light", &[word]).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        world.cubes.record(&mut rec, &one_bucket);
        rec.submit_and_wait().unwrap();
        let expected = world.expected(1.0, closed);
        for (structure, values, step) in [
            (constants::STRUCTURE_NONE, &one_bucket, 1.0),
            (constants::STRUCTURE_RUNS, &one_bucket, 1.0),
            (constants::STRUCTURE_CUBES, &world.cubes.image, 1.0),
            (constants::STRUCTURE_BUCKETS, &one_bucket, 2.0),
            (constants::STRUCTURE_VOXELS, &world.mips.values[0], 4.0),
            (constants::STRUCTURE_MIPS, &world.mips.values[0], 1.0),
            (constants::STRUCTURE_NEAREST_MIPS, &world.mips.values[0], 1.0),
        ] {
            let inputs = RayInputs { values, bucket_light: &bucket_light, ..world.inputs() };
            let found = world.follow(ctx, RayConfig { structure, step, ..PLAIN }, inputs);
            for (got, expected) in found.iter().zip(&expected) {
                let off = (got[0] - expected[0]).abs() / 60.0;
                assert!(off <= 0.011 && (got[1] - expected[1]).abs() <= 0.011, "{structure}: {got:?}, {expected:?}");
            }
            assert!(expected.iter().any(|e| e[1] > 0.3) && expected.iter().any(|e| e[1] < 0.1), "rays of all lengths");
        }
    });
}
