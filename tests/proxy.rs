//! The hash-bucket proxy against its CPU twin, on colours that are made up, and as the renderer builds it.

mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/scenes.rs"]
mod scenes;

use common::gpu_test;
use data::{Random, assert_same};
use half::f16;
use scenes::{phantom_scene, scene_of, volume_of};
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use tyndall::abi::SceneParams;
use tyndall::cpu;
use tyndall::cpu::quantiser::{Quantiser, color_histogram, quantiser};
use tyndall::passes::compact::{List, Listed, Marks};
use tyndall::passes::emptiness::Emptiness;
use tyndall::passes::lookback::{Carry, Report};
use tyndall::passes::proxy::{Proxy, ProxyConfig, ProxyContents};
use tyndall::passes::scene_data::SceneData;
use tyndall::render::{Internals, Renderer};
use tyndall::scene::{Mask, Scene};
use tyndall::vk::{Context, Image, ImageFormat, Recorder, Validation};
use tyndall::volume;

const LOSSLESS: Mask = Mask::Channels([0xFF; 4]);

/// All cases, or the first where GPU-assisted validation makes each proxy's pipelines take a minute: cases differ in
/// numbers, not in the ways that addresses are made.
fn cases<T>(all: &[T]) -> &[T] {
    if common::validation() == Validation::GpuAssisted { &all[..1] } else { all }
}

/// Texel of a field: source and extinction, in the units of `SceneParams`.
type Texel = [f32; 4];

const PLAIN: ProxyConfig = ProxyConfig::of(LOSSLESS);

/// A scene whose only parts that matter here are its size and its largest extinction.
fn scene_of_size(dims: [u32; 3]) -> Scene {
    let toml = "[transfer]\nconvention = \"extinction\"\npoints = [{ value = 0, color = 1, opacity = 0.7 }]";
    scene_of(toml, volume_of(dims, vec![0.0; dims.iter().product::<u32>() as usize]))
}

/// A proxy on the device and the field it is built from.
struct Bench {
    data: SceneData,
    emptiness: Emptiness,
    marks: Marks,
    list: List,
    field: Image,
    proxy: Proxy,
}

impl Bench {
    fn new(ctx: &Context, dims: [u32; 3], config: ProxyConfig) -> Self {
        let data = SceneData::new(ctx, &scene_of_size(dims)).unwrap();
        Self {
            // Chunks so small that every test has several.
            list: List::new(ctx, data.light_blocks(), Listed::Nodes, 1024, None).unwrap(),
            marks: Marks::new(ctx, data.light_blocks()).unwrap(),
            emptiness: Emptiness::for_rays(ctx, dims).unwrap(),
            field: ctx.image_3d("field", dims, ImageFormat::Rgba16Float).unwrap(),
            proxy: Proxy::new(ctx, &data, config).unwrap(),
            data,
        }
    }

    fn build(&self, ctx: &Context, field: &[Texel]) -> ProxyContents {
        let texels: Vec<[f16; 4]> = field.iter().map(|t| t.map(f16::from_f32)).collect();
        let [x, y, _] = self.data.params.dims;
        let layer = (x * y) as usize;
        let layers = |z: std::ops::Range<u32>| texels[z.start as usize * layer..z.end as usize * layer].to_vec();
        ctx.upload_image(&self.field, layers).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        self.emptiness.record(&mut rec, &self.data, &self.field);
        self.marks.record(&mut rec, &self.data, &self.field, &self.emptiness);
        self.list.record(&mut rec, &self.data, &self.marks);
        let args = self.list.chunk_args(ctx, &mut rec, 1).unwrap();
        self.proxy.record_clear(&mut rec);
        self.proxy.record(&mut rec, &self.data, &self.list, &args, &self.field, 2);
        rec.submit_and_wait().unwrap();
        self.proxy.check(ctx).unwrap();
        self.proxy.read_back(ctx).unwrap()
    }
}

/// Compares a proxy with the twin's of the same colours, and checks the invariants themselves.
fn check(case: &str, got: &ProxyContents, mask: Mask) {
    assert_eq!(got.counts.mask, mask, "{case}: mask in use");
    let q = Quantiser::from_words(&got.quantiser, got.counts.levels);
    let expected = quantiser(mask, &color_histogram(&got.color));
    assert_eq!(q.levels(), expected.levels(), "{case}: levels");
    assert_eq!(q, expected, "{case}: quantiser");
    let twin = cpu::proxy::build(&got.color, &q);
    assert_eq!(got.counts.runs, twin.runs, "{case}: runs");
    assert_eq!(got.counts.buckets as usize, twin.hash_value.len(), "{case}: buckets");
    assert_same(&format!("{case}: hashValue"), &got.hash_value, &twin.hash_value);
    assert_same(&format!("{case}: bucketColor"), &got.bucket_color, &twin.bucket_color);
    assert_same(&format!("{case}: bucketSize"), &got.bucket_size, &twin.bucket_size);
    assert_same(&format!("{case}: bucketBase"), &got.bucket_base, &twin.bucket_base);
    assert_same(&format!("{case}: bucketID"), &got.bucket_id, &twin.bucket_id);

    // What the table promises, whatever way it was made.
    let voxels: u64 = got.bucket_size.iter().map(|&size| u64::from(size)).sum();
    assert_eq!(voxels, got.color.len() as u64, "{case}: the bucket sizes do not sum up to the voxels");
    assert!(got.hash_value.is_sorted_by(|a, b| a < b), "{case}: hashes are not ascending and distinct");
    assert_same(&format!("{case}: scan of the sizes"), &got.bucket_base, &cpu::scan::exclusive(&got.bucket_size));
    let quantised: Vec<u32> = match mask {
        Mask::Channels(_) => got.color.iter().map(|&color| color & mask.word()).collect(),
        Mask::Adaptive(_) => got.color.iter().map(|&color| q.quantised(color)).collect(),
    };
    let of_bucket: Vec<u32> = got.bucket_id.iter().map(|&id| got.bucket_color[id as usize]).collect();
    assert_same(&format!("{case}: the voxels' buckets' colours"), &of_bucket, &quantised);
    let mut sizes = vec![0u32; got.bucket_size.len()];
    got.bucket_id.iter().for_each(|&id| sizes[id as usize] += 1);
    assert_same(&format!("{case}: voxels counted per bucket"), &got.bucket_size, &sizes);
}

/// Compares the 8-bit codes and the buckets' light with the twin. The device's exp, log and sqrt may round otherwise.
fn check_codes(case: &str, got: &ProxyContents, scene: &SceneParams, field: &[Texel]) {
    let field: Vec<Texel> = field.iter().map(|t| t.map(|v| f16::from_f32(v).to_f32())).collect();
    let most = cpu::proxy::source_max(&field);
    assert!((got.source_max - most).abs() <= 1e-5 * most, "{case}: largest source {} not {most}", got.source_max);
    let mut different = 0;
    for (i, (&texel, &color)) in field.iter().zip(&got.color).enumerate() {
        let twin = cpu::proxy::encode_color(scene, texel, most);
        let apart = color.to_le_bytes().into_iter().zip(twin.to_le_bytes()).map(|(a, b)| a.abs_diff(b)).max();
        assert!(apart <= Some(1), "{case}: voxel {i} has colour {color:#x}, the twin's is {twin:#x}");
        different += usize::from(color != twin);
    }
    // A level apart is rounding, which is rare.
    assert!(different <= 1 + field.len() / 100, "{case}: {different} of {} colours are not the twin's", field.len());
    let q = Quantiser::from_words(&got.quantiser, got.counts.levels);
    for (&color, &light) in got.bucket_color.iter().zip(&got.bucket_light) {
        let twin = cpu::proxy::decode_color(scene, color, q.values(color), most);
        let halves = [light as u16, (light >> 16) as u16].map(|bits| f16::from_bits(bits).to_f32());
        for (got, twin) in halves.into_iter().zip(twin) {
            // Half of a half float's step, and least steps below the normal numbers.
            let tolerance = 1e-3 * twin + 1e-7;
            assert!((got - twin).abs() <= tolerance, "{case}: light of {color:#x}: {halves:?} instead of {twin}");
        }
    }
}

/// Voxels with `active` probability of extinction, whose light has few distinct values in stretches, as real data have.
fn random_field(voxels: usize, active: f32, seed: u64) -> Vec<Texel> {
    let mut random = Random(seed);
    let mut uniform = || (random.word() >> 8) as f32 / (1 << 24) as f32;
    let mut field = Vec::with_capacity(voxels);
    while field.len() < voxels {
        let a = if uniform() < active { 0.002 + 0.998 * uniform() } else { 0.0 };
        let texel = [uniform() * a * 900.0, uniform().powi(4) * a * 900.0, uniform() * a, a];
        let stretch = 1 + (uniform() * 4.0) as usize;
        field.extend(std::iter::repeat_n(texel, stretch.min(voxels - field.len())));
    }
    field
}

fn voxels(dims: [u32; 3]) -> usize {
    dims.iter().product::<u32>() as usize
}

#[test]
fn random_volumes_of_odd_sizes_under_every_kind_of_mask() {
    // Lossless; 4 bits; 1 bit; none; each channel its own, some scattered; no opacity; chosen from the data.
    let bits = [[0xF0; 4], [0x80; 4], [0; 4], [0xE0, 0x81, 0x00, 0xFF], [0xFF, 0xFF, 0xFF, 0x00]];
    let adaptive = [0.0, 0.1, 1.0].map(Mask::Adaptive);
    let masks = [vec![LOSSLESS], bits.map(Mask::Channels).to_vec(), adaptive.to_vec()].concat();
    let sizes = [[19, 17, 13], [1, 1, 1], [1, 37, 1], [3, 5, 7], [33, 29, 31]];
    gpu_test(|ctx| {
        for (i, &dims) in cases(&sizes).iter().enumerate() {
            for (j, &mask) in cases(&masks).iter().enumerate() {
                // The other sizes need not meet every mask.
                if ((1..4).contains(&i) && j % 3 != 0) || (i == 4 && j > 1) {
                    continue;
                }
                let case = format!("{dims:?} under {mask}");
                let field = random_field(voxels(dims), if j % 2 == 0 { 0.4 } else { 1.0 }, 10 + (7 * i + j) as u64);
                let bench = Bench::new(ctx, dims, ProxyConfig { mask, ..PLAIN });
                let got = bench.build(ctx, &field);
                check(&case, &got, mask);
                check_codes(&case, &got, &bench.data.params, &field);
                if [LOSSLESS, Mask::Adaptive(0.0)].contains(&mask) {
                    let exact: Vec<u32> = got.bucket_id.iter().map(|&id| got.bucket_color[id as usize]).collect();
                    assert_same(&format!("{case}: a lossless mask is exact"), &exact, &got.color);
                }
            }
        }
    });
}

#[test]
fn a_constant_volume_has_one_bucket_and_an_empty_one_too() {
    gpu_test(|ctx| {
        let dims = [21, 20, 19];
        let bench = Bench::new(ctx, dims, PLAIN);
        for (case, texel, color) in [("constant", [4.0, 1.0, 0.0, 1.0], 0xFF00_80FF), ("empty", [0.0; 4], 0)] {
            let got = bench.build(ctx, &vec![texel; voxels(dims)]);
            check(case, &got, LOSSLESS);
            assert_eq!((got.counts.runs, got.counts.buckets), (1, 1), "{case}");
            assert_eq!((got.bucket_size[0] as usize, got.bucket_color[0]), (voxels(dims), color), "{case}");
        }
    });
}

#[test]
fn all_different_voxels_have_a_bucket_each() {
    gpu_test(|ctx| {
        let dims = [23, 19, 17];
        // Level l of 255 is what encodes (l / 255)²; the first voxel has the brightest source.
        let texel = |i: u32| [255 - (i & 0xFF), i >> 8, 128, 0].map(|level| (level as f32 / 255.0).powi(2));
        let field: Vec<Texel> =
            (0..voxels(dims) as u32).map(|i| [texel(i)[0], texel(i)[1], texel(i)[2], 1.0]).collect();
        let got = Bench::new(ctx, dims, PLAIN).build(ctx, &field);
        check("all different", &got, LOSSLESS);
        assert_eq!(got.counts.buckets as usize, voxels(dims));
        assert!(got.bucket_size.iter().all(|&size| size == 1));
    });
}

#[test]
fn one_bright_voxel_has_its_own_bucket() {
    gpu_test(|ctx| {
        let dims = [20, 20, 20];
        let mut field = vec![[0.0, 0.0, 0.0, 0.01]; voxels(dims)];
        field[4211] = [9000.0, 5.0, 5.0, 1.0];
        for &mask in cases(&[LOSSLESS, Mask::Channels([0xF0; 4]), Mask::Adaptive(0.05)]) {
            let got = Bench::new(ctx, dims, ProxyConfig { mask, ..PLAIN }).build(ctx, &field);
            check("one bright voxel", &got, mask);
            assert_eq!((got.counts.runs, got.counts.buckets), (3, 2));
            assert_eq!(got.bucket_size[got.bucket_id[4211] as usize], 1);
        }
    });
}

#[test]
fn rebuilt_for_other_light_it_is_as_if_new() {
    gpu_test(|ctx| {
        let dims = [19, 18, 17];
        for &mask in cases(&[Mask::Channels([0xF0; 4]), Mask::Adaptive(0.02)]) {
            let bench = Bench::new(ctx, dims, ProxyConfig { mask, ..PLAIN });
            // More buckets, fewer, more again: nothing of an earlier build may be left.
            for (i, active) in [0.9, 0.1, 0.6].into_iter().enumerate() {
                let field = random_field(voxels(dims), active, 70 + i as u64);
                let case = format!("build {i} under {mask}");
                let got = bench.build(ctx, &field);
                check(&case, &got, mask);
                check_codes(&case, &got, &bench.data.params, &field);
            }
        }
    });
}

#[test]
fn too_many_runs_take_the_finest_coarser_mask_that_fits() {
    gpu_test(|ctx| {
        let dims = [19, 17, 16];
        let field = random_field(voxels(dims), 0.9, 31);
        let plan = |mask: Mask, capacity: u32| {
            let config = ProxyConfig { mask, capacity: Some(capacity), ..PLAIN };
            let got = Bench::new(ctx, dims, config).build(ctx, &field);
            let (mask, _) = cpu::proxy::proxy_plan(&got.color, mask, capacity);
            let case = format!("capacity {capacity}, {mask}");
            check(&case, &got, mask);
            assert!(got.counts.runs <= capacity);
            mask
        };
        let runs = Bench::new(ctx, dims, PLAIN).build(ctx, &field).counts.runs;
        for &lossless in cases(&[LOSSLESS, Mask::Adaptive(0.0)]) {
            assert_eq!(plan(lossless, runs), lossless, "what just fits is not made coarser");
            // 8 bits per channel are lost one by one, or the tolerance grows; the last attempt leaves one run.
            let capacities = [1, 7, runs / 4, runs / 2, runs - 1];
            let masks: Vec<Mask> = cases(&capacities).iter().map(|&capacity| plan(lossless, capacity)).collect();
            let is_finer = |a: &Mask, b: &Mask| match (a, b) {
                (Mask::Channels(a), Mask::Channels(b)) => a <= b,
                (Mask::Adaptive(a), Mask::Adaptive(b)) => a >= b,
                _ => false,
            };
            assert!(masks.is_sorted_by(is_finer) && masks.iter().all(|&mask| mask != lossless), "{masks:?}");
            assert!(masks[0] == Mask::Channels([0; 4]) || masks[0] == Mask::Adaptive(2.0), "{masks:?}");
        }
        plan(Mask::Channels([0xE0, 0x81, 0x00, 0xFF]), runs / 4);
        plan(Mask::Adaptive(0.01), runs / 4);
    });
}

#[test]
fn workgroups_that_never_publish_are_computed_for() {
    gpu_test(|ctx| {
        let dims = [33, 29, 31];
        let field = random_field(voxels(dims), 1.0, 5);
        for &withhold in cases(&[2, 1]) {
            let bench = Bench::new(ctx, dims, ProxyConfig { withhold, ..PLAIN });
            check(&format!("withhold {withhold}"), &bench.build(ctx, &field), LOSSLESS);
            let Report { fallbacks, errors, .. } = bench.proxy.check(ctx).unwrap();
            assert!(fallbacks > 0 && errors == 0, "{fallbacks} fallbacks, errors {errors:#x}");
        }
    });
}

#[test]
fn without_look_back_the_proxy_is_the_same() {
    gpu_test(|ctx| {
        let dims = [33, 29, 31];
        let field = random_field(voxels(dims), 1.0, 5);
        // The second has retries: attempts of which some are not made.
        for capacity in [None, Some(2_000)] {
            let config = ProxyConfig { carry: Some(Carry::LookBack), capacity, ..PLAIN };
            let expected = Bench::new(ctx, dims, config).build(ctx, &field);
            let bench = Bench::new(ctx, dims, ProxyConfig { carry: Some(Carry::Dispatches), withhold: 1, ..config });
            let got = bench.build(ctx, &field);
            assert!(format!("{got:?}") == format!("{expected:?}"), "capacity {capacity:?}");
            assert_eq!(bench.proxy.check(ctx).unwrap(), Report { spins: 0, fallbacks: 0, errors: 0 });
        }
    });
}

const QUICK: &str = "sampling = 'resample'\nsize = [8, 8]\nspp = 1\nenvironment_directions = 2\ncandidates = 4\ndirections = 2\nseed = 3\n";

/// Renders with the given number of orders and returns the proxy that the last of them used.
fn proxy_of(ctx: &Context, scene: &Scene) -> ProxyContents {
    let mut renderer = Renderer::new(ctx, scene, Internals::default()).unwrap();
    renderer.render(scene.settings.seed, &mut |_| ControlFlow::Continue(())).unwrap();
    let contents = renderer.proxy().expect("a proxy").read_back(ctx).unwrap();
    let stats = renderer.stats(scene, 0.0).unwrap();
    assert_eq!(stats.proxy.len() as u32, scene.settings.orders - 1, "a build per order beyond the first");
    let last = stats.proxy.last().unwrap();
    assert_eq!((last.runs, last.buckets), (contents.counts.runs.into(), contents.counts.buckets.into()));
    assert_eq!(last.mask_used, contents.counts.mask);
    assert_eq!((last.levels, last.hash_bits), (contents.counts.levels, contents.counts.hash_bits()));
    contents
}

#[test]
fn the_renderer_builds_it_anew_for_every_order() {
    gpu_test(|ctx| {
        let all = [
            ("skull", [31, 33, 29], Mask::Channels([0xF0; 4]), [2, 3, 4].as_slice()),
            ("head", [24, 23, 25], LOSSLESS, &[3]),
            ("tree", [33, 32, 12], Mask::Channels([0xC0; 4]), &[2]),
            ("heart", [25, 23, 24], Mask::Adaptive(0.05), &[2, 3]),
        ];
        for &(name, size, mask, orders) in cases(&all) {
            let mut before: Option<ProxyContents> = None;
            for &orders in cases(orders) {
                let case = format!("{name}, order {orders}");
                let scene = phantom_scene(name, size, &format!("{QUICK}orders = {orders}\nmask = '{mask}'"));
                let got = proxy_of(ctx, &scene);
                check(&case, &got, mask);
                assert!(got.counts.buckets > 1, "{case}: an empty picture tests nothing");
                if let Some(before) = before {
                    assert!(before.color != got.color, "{case}: the colours are those of the order before");
                    assert!(before.source_max != got.source_max, "{case}: the range is that of the order before");
                }
                before = Some(got);
            }
        }
    });
}

/// Real volumes at full resolution, where they are at hand; see tests/volume_real.rs.
#[test]
#[ignore = "long; scripts/test --full"]
fn real_volumes() {
    let folder = std::env::var_os("TYNDALL_VOLUMES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/volumes"), PathBuf::from);
    // Written past the test harness, which would swallow it.
    let tell = |line: String| writeln!(std::io::stderr(), "{line}").unwrap();
    for (file, preset) in [("skull_ct.nrrd", "ct-bone"), ("heart_ct.nii.gz", "ct-heart")] {
        let path = folder.join(file);
        if !path.exists() {
            tell(format!("SKIPPED: no {}; set TYNDALL_VOLUMES to its folder", path.display()));
            continue;
        }
        for mask in [Mask::Channels([0xF0; 4]), LOSSLESS, Mask::Adaptive(0.05)] {
            gpu_test(|ctx| {
                let toml = format!("preset = \"{preset}\"\n[render]\n{QUICK}orders = 2\nmask = '{mask}'");
                let got = proxy_of(ctx, &scene_of(&toml, volume::load(&path, None).unwrap()));
                check(&format!("{file}, {mask}"), &got, mask);
                tell(format!("{file}, {mask}: {:?} of {} voxels", got.counts, got.color.len()));
            });
        }
    }
}
