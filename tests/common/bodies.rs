//! Small awkward scenes for tests of single passes, their set-up on the device, and tolerant comparison.

#![allow(dead_code, reason = "each test file uses a part of it")]

use super::common::validation;
use super::data::Random;
use bytemuck::Pod;
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, Vec4};
use half::f16;
use tyndall::abi::ScatterSample;
use tyndall::cpu::scene::HostScene;
use tyndall::cpu::texture::Texture;
use tyndall::passes::classify::{Classify, Emitted};
use tyndall::passes::compact::{Blocks, List, Listed, Marks};
use tyndall::passes::emptiness::Emptiness;
use tyndall::passes::project::Source;
use tyndall::passes::proxy::Proxy;
use tyndall::passes::scene_data::SceneData;
use tyndall::scene::camera::{Framing, frame};
use tyndall::scene::{
    Background, Camera, Environment, Exposure, LatLong, Light, OpacityUnit, Scene, Settings, ToneCurve,
    TransferFunction, TransferPoint,
};
use tyndall::shaders::constants;
use tyndall::vk::{Context, Image, ImageFormat, Recorder, Validation};
use tyndall::volume::{Grid, Volume, VoxelData};

/// List items of a chunk in these tests: no volume here needs a second one.
pub const CHUNK: u32 = 1 << 15;

/// All cases, or the first where GPU-assisted validation makes lavapipe compile each pipeline for up to a minute: cases
/// differ in numbers, not in the ways that addresses are made.
pub fn cases<T>(mut all: Vec<T>) -> Vec<T> {
    if validation() == Validation::GpuAssisted {
        all.truncate(1);
    }
    all
}

/// Random numbers in [0, 1).
pub fn random_values(seed: u64, n: usize) -> Vec<f32> {
    let mut random = Random(seed);
    (0..n).map(|_| (random.word() >> 8) as f32 / 16_777_216.0).collect()
}

fn volume(grid: Grid, values: Vec<f32>) -> Volume {
    Volume { name: "test".into(), grid, data: VoxelData::F32(values), slope: 1.0, intercept: 0.0 }
}

/// Empty below 0.3, then a step, coloured extinction, and light of its own from 0.8 on. Extinctions are chosen so
/// that the box has an optical depth of a few.
fn transfer(grid: &Grid) -> TransferFunction {
    let (low, high) = grid.world_bounds();
    let unit = (high - low).length() as f32;
    let point =
        |value, color, opacity: f32, emission| TransferPoint { value, color, opacity: opacity / unit, emission };
    TransferFunction {
        points: vec![
            point(0.3, [0.9, 0.5, 0.2], 0.0, [0.0; 3]),
            point(0.3, [0.9, 0.5, 0.2], 2.0, [0.0; 3]),
            point(0.8, [0.3, 0.7, 1.0], 5.0, [0.0; 3]),
            point(1.0, [0.6, 0.6, 0.6], 9.0, [0.4, 0.2, 0.1]),
        ],
        opacity_unit: OpacityUnit::Extinction,
    }
}

/// A small sky with a sun, turned about z.
pub fn sky() -> Environment {
    let mut pixels: Vec<[f32; 3]> = random_values(77, 32).iter().map(|&x| [x, 0.5 * x, 0.2 + 0.3 * x]).collect();
    pixels[11] = [40.0, 30.0, 20.0];
    Environment::LatLong(LatLong { width: 8, height: 4, pixels, rotation_degrees: 37.0 })
}

/// A volume under a directional light, a point light and the sky, seen from an oblique direction.
pub fn scene_of(grid: Grid, values: Vec<f32>) -> Scene {
    let size = [9, 7];
    let (low, high) = grid.world_bounds();
    let (middle, extent) = (0.5 * (low + high), (high - low).length());
    let framing = Framing { azimuth: 31.0, elevation: 17.0, roll: 5.0, zoom: 1.1, fov: 40.0 };
    Scene {
        transfer: transfer(&grid),
        camera: frame(&grid, &framing, size),
        views: vec![],
        lights: vec![
            Light::Directional {
                direction: DVec3::new(0.6, 0.5, -0.62).normalize(),
                irradiance: Vec3::new(2.0, 3.0, 4.0),
            },
            Light::Point {
                position: middle + extent * DVec3::new(0.4, -0.7, 0.9),
                intensity: Vec3::new(3.0, 2.0, 1.0) * (extent * extent) as f32,
            },
        ],
        volume: volume(grid, values).into(),
        g: 0.0,
        albedo_scale: Vec3::new(0.9, 1.0, 0.8),
        density_scale: 1.0,
        emission_scale: 1.0,
        environment: Some(sky()),
        background: Background::Transparent,
        settings: Settings { size, seed: 5, ..Settings::default() },
        exposure: Exposure::Stops(0.0),
        tone: ToneCurve::Linear,
        path: None,
    }
}

/// A mostly random volume under a directional light, a point light and a sky, seen from outside, 3 orders.
pub fn cloud(size: [u32; 2]) -> Scene {
    let grid = Grid::axis_aligned([9, 7, 5], [1.0, 0.8, 1.5], [-4.0, 2.0, 1.0]);
    let mut scene = scene_of(grid, random_values(12, 9 * 7 * 5));
    scene.settings.size = size;
    scene.settings.orders = 3;
    scene
}

/// Turns volume, camera and delta lights. The sky stays.
pub fn turn_scene(scene: &mut Scene, turn: DMat3) {
    let grid = &mut scene.volume_mut().grid;
    grid.index_to_world = DAffine3::from_mat3(turn) * grid.index_to_world;
    let c = scene.camera;
    let [position, forward, right, up] = [c.position, c.forward, c.right, c.up].map(|v| turn * v);
    scene.camera = Camera { position, forward, right, up, fov_degrees: c.fov_degrees };
    for light in &mut scene.lights {
        match light {
            Light::Directional { direction, .. } => *direction = turn * *direction,
            Light::Point { position, .. } => *position = turn * *position,
        }
    }
}

/// Volumes that are no cubes, down to one voxel; flat, turned, mirrored and mostly empty ones.
pub fn scenes() -> Vec<(&'static str, Scene)> {
    let aligned = |dims: [u32; 3], spacing| Grid::axis_aligned(dims, spacing, [3.0, -20.0, 7.0]);
    let turned = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(0.8);
    let mirrored = DMat3::from_diagonal(DVec3::new(-0.8, 1.1, 0.9));
    let oblique = Grid::oriented([7, 6, 5], turned * mirrored, [-4.0, 2.0, 50.0]);
    let random = |grid: Grid, seed| scene_of(grid, random_values(seed, grid.voxels() as usize));
    // More macrocells than one along every axis, nearly all of them empty.
    let sparse = aligned([41, 10, 26], [1.0; 3]);
    let islands = random_values(9, 41 * 10 * 26).into_iter().enumerate().map(|(i, value)| {
        let (x, y, z) = (i % 41, i / 41 % 10, i / 41 / 10);
        let inside = (x < 4 && y < 5 && z > 20) || (x > 36 && y > 6 && z < 6) || (x, y, z) == (20, 9, 13);
        if inside { 0.31 + 0.69 * value } else { 0.2 }
    });
    let mut one_albedo = random(aligned([5, 8, 6], [1.0; 3]), 6);
    one_albedo.transfer.points.iter_mut().for_each(|p| p.color = [0.7, 0.9, 0.5]);
    cases(vec![
        ("odd", random(aligned([13, 7, 5], [1.0; 3]), 1)),
        ("one voxel", scene_of(aligned([1, 1, 1], [2.0; 3]), vec![0.9])),
        ("line", random(aligned([1, 9, 1], [1.0; 3]), 3)),
        ("flat voxels", random(aligned([6, 5, 9], [0.5, 1.0, 4.0]), 4)),
        ("oblique, mirrored", random(oblique, 5)),
        ("islands", scene_of(sparse, islands.collect())),
        ("one albedo", one_albedo),
        ("nothing", scene_of(aligned([9, 3, 2], [1.0; 3]), vec![0.1; 54])),
    ])
}

/// A scene on the device, classified and marked; and its host copy.
pub struct Setup {
    pub data: SceneData,
    pub host: HostScene,
    /// Emitted source and extinction.
    pub field: Image,
    pub emptiness: Emptiness,
    pub marks: Marks,
}

impl Setup {
    /// Classifies and marks.
    pub fn new(ctx: &Context, scene: &Scene) -> Self {
        let data = SceneData::new(ctx, scene).unwrap();
        let dims = data.params.dims;
        let classify = Classify::new(ctx, &data, Emitted::Emission).unwrap();
        let field = data.field(ctx, "field", dims).unwrap();
        let emptiness = Emptiness::for_rays(ctx, dims).unwrap();
        let marks = Marks::new(ctx, data.light_blocks()).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        classify.record(&mut rec, &data, &field);
        emptiness.record(&mut rec, &data, &field);
        marks.record(&mut rec, &data, &field, &emptiness);
        rec.submit_and_wait().unwrap();
        Self { host: HostScene::new(scene), data, field, emptiness, marks }
    }

    /// A list, and its items read back.
    pub fn list(&self, ctx: &Context, listed: Listed) -> (List, Vec<u32>) {
        let mut list = List::new(ctx, self.data.light_blocks(), listed, CHUNK, None).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        list.record(&mut rec, &self.data, &self.marks);
        rec.submit_and_wait().unwrap();
        list.read_counts(ctx).unwrap();
        let items = list.read_back(ctx).unwrap();
        (list, items)
    }

    /// The voxels about the medium, whatever the blocks of the light grid: what a proxy encodes.
    pub fn voxels(&self, ctx: &Context) -> List {
        let blocks = Blocks::of(self.host.params.dims, 1);
        let marks = Marks::new(ctx, blocks).unwrap();
        let mut list = List::new(ctx, blocks, Listed::Nodes, CHUNK, None).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        marks.record(&mut rec, &self.data, &self.field, &self.emptiness);
        list.record(&mut rec, &self.data, &marks);
        rec.submit_and_wait().unwrap();
        list.read_counts(ctx).unwrap();
        list
    }
}

/// An image, read back.
pub fn texture(ctx: &Context, image: &Image) -> Texture<Vec4> {
    let half = |texels: Vec<[f16; 4]>| texels.iter().map(|t| Vec4::from(t.map(f32::from))).collect();
    let grey = |[light, extinction]: [f32; 2]| Vec4::new(light, light, light, extinction);
    let texels = match image.format() {
        ImageFormat::Rgba32Float => ctx.read_back_image(image).unwrap(),
        ImageFormat::Rgba16Float => half(ctx.read_back_image(image).unwrap()),
        ImageFormat::GreyAlpha32Float => ctx.read_back_image(image).unwrap().into_iter().map(grey).collect(),
        ImageFormat::GreyAlpha16Float => {
            let texels: Vec<[f16; 2]> = ctx.read_back_image(image).unwrap();
            texels.into_iter().map(|t| grey(t.map(f32::from))).collect()
        }
        ImageFormat::R32Float => {
            ctx.read_back_image(image).unwrap().into_iter().map(|light: f32| grey([light, 1.0])).collect()
        }
        format => panic!("{format:?} is no field"),
    };
    Texture::new(image.extent(), texels)
}

/// An image of half floats with the given texels.
pub fn image(ctx: &Context, name: &str, texels: &Texture<Vec4>) -> Image {
    image_of(ctx, name, ImageFormat::Rgba16Float, texels, |t| t.to_array().map(f16::from_f32))
}

/// An image of another format; `stored`: what it has for a texel.
pub fn image_of<T, P: Pod>(
    ctx: &Context,
    name: &str,
    format: ImageFormat,
    texels: &Texture<T>,
    stored: impl Fn(&T) -> P,
) -> Image {
    let image = ctx.image_3d(name, texels.dims.to_array(), format).unwrap();
    let layer = (texels.dims.x * texels.dims.y) as usize;
    let layers = |z: std::ops::Range<u32>| {
        texels.texels[z.start as usize * layer..z.end as usize * layer].iter().map(&stored).collect()
    };
    ctx.upload_image(&image, layers).unwrap();
    image
}

/// A field of random light, stored without rounding by half floats.
pub fn random_light(dims: [u32; 3], seed: u64, low: f32, high: f32) -> Texture<Vec4> {
    let n = dims.iter().product::<u32>() as usize;
    let values = random_values(seed, 4 * n);
    let round = |x: f32| f16::from_f32(low + (high - low) * x).to_f32();
    Texture::new(dims, values.chunks(4).map(|v| Vec4::from([v[0], v[1], v[2], v[3]].map(round))).collect())
}

/// Random light of a gather in the extinction of the scene: |B| stays below A, as it does for radiance.
pub fn random_source(ctx: &Context, setup: &Setup) -> Source {
    let dims = setup.host.params.dims;
    let field = texture(ctx, &setup.field);
    let lit = |seed: u64, low: f32, high: f32| {
        let light = random_light(dims, seed, low, high).texels;
        let texels = light.iter().zip(&field.texels).map(|(l, f)| l.truncate().extend(f.w)).collect();
        image(ctx, "source", &Texture::new(dims, texels))
    };
    Source { a: lit(31, 0.0, 900.0), b: [32, 33, 34].map(|seed| lit(seed, -300.0, 300.0)) }
}

/// Light and extinction of every voxel's bucket.
pub fn proxy_light(ctx: &Context, proxy: &Proxy, dims: [u32; 3]) -> Texture<Vec2> {
    let contents = proxy.read_back(ctx).unwrap();
    let buckets: Vec<[f16; 2]> = ctx.read_back(proxy.bucket_light()).unwrap().into_iter().map(bytemuck::cast).collect();
    let of = |&id: &u32| Vec2::from(buckets[id as usize].map(f32::from));
    Texture::new(dims, contents.bucket_id.iter().map(of).collect())
}

/// What a gather brings of the environment, in the fields' units.
pub fn gathered_sky(setup: &Setup) -> Vec3 {
    let is_constant = setup.data.environment == constants::ENVIRONMENT_CONSTANT;
    let params = &setup.host.params;
    if is_constant { Vec3::from(params.environment) * params.radiance_scale } else { Vec3::ZERO }
}

/// Every component within `relative` of the expected one, plus `absolute` of the largest expected one.
#[track_caller]
pub fn assert_close(case: &str, got: &[Vec4], expected: &[Vec4], relative: f32, absolute: f32) {
    assert_nearly_all_close(case, got, expected, relative, absolute, 0);
}

/// The same with at most `outliers` exceptions.
#[track_caller]
pub fn assert_nearly_all_close(
    case: &str,
    got: &[Vec4],
    expected: &[Vec4],
    relative: f32,
    absolute: f32,
    outliers: usize,
) {
    assert_eq!(got.len(), expected.len(), "{case}: length");
    let most = expected.iter().map(|e| e.abs().max_element()).fold(0.0, f32::max);
    let allowed = |e: &Vec4| e.abs() * relative + Vec4::splat(most * absolute);
    // Written so that a NaN is wrong.
    let is_wrong = |i: &usize| !(got[*i] - expected[*i]).abs().cmple(allowed(&expected[*i])).all();
    let wrong: Vec<usize> = (0..got.len()).filter(is_wrong).collect();
    if wrong.len() > outliers {
        let i = wrong[0];
        let worst = (0..got.len()).map(|i| (got[i] - expected[i]).abs().max_element()).fold(0.0, f32::max);
        panic!(
            "{case}: {} of {} differ, the first at {i}: {} instead of {}; largest error {worst}, largest value {most}",
            wrong.len(),
            got.len(),
            got[i],
            expected[i],
        );
    }
}

/// Samples of every cell: the same points and directions, and light within `relative` plus `absolute` of the largest, with at
/// most `outliers` exceptions.
#[track_caller]
pub fn assert_same_samples(
    case: &str,
    got: &[Vec<ScatterSample>],
    expected: &[Vec<ScatterSample>],
    relative: f32,
    absolute: f32,
    outliers: usize,
) {
    let sizes = |cells: &[Vec<ScatterSample>]| cells.iter().map(Vec::len).collect::<Vec<_>>();
    assert_eq!(sizes(got), sizes(expected), "{case}: samples of every cell");
    let (got, expected): (Vec<_>, Vec<_>) = (got.iter().flatten().collect(), expected.iter().flatten().collect());
    for (i, (a, b)) in got.iter().zip(&expected).enumerate() {
        assert_eq!(a.point, b.point, "{case}: point of sample {i}");
        let turn = Vec3::from(a.travel).distance(Vec3::from(b.travel));
        assert!(turn < 1e-4, "{case}: direction of sample {i}: {:?} instead of {:?}", a.travel, b.travel);
    }
    let light =
        |samples: Vec<&ScatterSample>| samples.iter().map(|s| Vec3::from(s.light).extend(0.0)).collect::<Vec<_>>();
    assert_nearly_all_close(case, &light(got), &light(expected), relative, absolute, outliers);
}
