//! What the choice of directions may change: the noise, and nothing else. Means over independent seeds are compared
//! block by block; `top` is biased and must be found out by the same test.

mod common;
#[path = "common/scenes.rs"]
mod scenes;

use clap::ValueEnum as _;
use common::gpu_test;
use scenes::{scene_of, volume_of};
use std::ops::{ControlFlow, Range};
use std::process::Command;
use tyndall::measure::metrics::{block_z_scores, compare};
use tyndall::output::Picture;
use tyndall::render::{Internals, Renderer};
use tyndall::scene::camera::{Framing, frame};
use tyndall::scene::{Environment, Mask, Precision, Sampling, Scene};
use tyndall::vk::{Context, Validation};

const NORMAL: Internals = Internals {
    zero_bucket_colors: false,
    proxy_capacity: None,
    segment_voxels: None,
    costs: None,
    gathers_everywhere: false,
    stores_color: false,
};

/// A lumpy cube of `edge`³ voxels that fills the picture, lit from one side only, so that the light within comes from
/// few directions. Camera samples enough that the noise is mostly the gathers.
fn scene(edge: u32, sampling: Sampling, render: &str) -> Scene {
    let lump = |i: u32, f: f32| (f * (i as f32 + 0.5) / edge as f32 * std::f32::consts::TAU).sin();
    let value = |i: u32| {
        let (x, y, z) = (i % edge, i / edge % edge, i / (edge * edge));
        1.0 + 0.5 * lump(x, 2.0) * lump(y, 1.5) * lump(z, 2.5)
    };
    // Optical depth along an edge is the same for all sizes.
    let dense = 8.0 / edge as f32;
    let toml = format!(
        r#"
        [transfer]
        convention = "extinction"
        points = [
            {{ value = 0, color = [0.95, 0.9, 0.85], opacity = {thin} }},
            {{ value = 2, color = [0.9, 0.95, 0.98], opacity = {dense} }},
        ]
        [[light]]
        azimuth = -60
        elevation = 35
        irradiance = 10
        [camera]
        azimuth = 20
        elevation = 10
        zoom = 1.9
        [render]
        size = [24, 24]
        spp = 16
        orders = 3
        sampling = "{sampling}"
        {render}
        "#,
        thin = dense / 25.0,
        sampling = format!("{sampling:?}").to_lowercase(),
    );
    scene_of(&toml, volume_of([edge; 3], (0..edge.pow(3)).map(value).collect()))
}

fn pictures(ctx: &Context, scene: &Scene, internals: Internals, seeds: Range<u64>) -> Vec<Picture> {
    let mut renderer = Renderer::new(ctx, scene, internals).unwrap();
    seeds.map(|seed| picture(&mut renderer, seed)).collect()
}

fn picture(renderer: &mut Renderer<'_>, seed: u64) -> Picture {
    renderer.render(seed, &mut |_| ControlFlow::Continue(())).unwrap()
}

/// Mean over pixels and RGB of the variance over the pictures.
fn variance(pictures: &[Picture]) -> f64 {
    let n = pictures.len() as f64;
    let values = pictures[0].pixels.len() * 3;
    let of_value = |i: usize| {
        let samples = pictures.iter().map(|p| f64::from(p.pixels[i / 3][i % 3]));
        let mean = samples.clone().sum::<f64>() / n;
        samples.map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0)
    };
    (0..values).map(of_value).sum::<f64>() / values as f64
}

fn mean(picture: &Picture) -> f64 {
    let sum: f64 = picture.pixels.iter().flat_map(|p| &p[..3]).map(|&v| f64::from(v)).sum();
    sum / (3 * picture.pixels.len()) as f64
}

/// Means over many pictures show nothing that GPU-assisted validation looks for, and take it hours: the other tests here
/// run the same kernels.
fn skips_statistics(test: &str) -> bool {
    let skips = common::validation() == Validation::GpuAssisted;
    if skips {
        println!("SKIP {test}: statistics, not under GPU-assisted validation");
    }
    skips
}

/// The means of two sets of pictures agree in every block, and the test is sharp enough to say so.
#[track_caller]
fn assert_agree(case: &str, a: &[Picture], b: &[Picture], most_error: f64) {
    let test = block_z_scores(a, b);
    println!("{case}: {test:?}");
    assert_eq!(test.blocks, 9, "{case}: blocks that are lit");
    assert!(test.max_standard_error_relative <= most_error, "{case}: not sharp enough: {test:?}");
    assert!(test.max_abs_z <= 4.0, "{case}: the means differ: {test:?}");
}

const SEEDS: u64 = 64;

#[test]
fn resample_and_residual_have_the_mean_of_phase_with_and_without_the_proxy_and_top_has_not() {
    if skips_statistics("resample_and_residual_have_the_mean_of_phase_with_and_without_the_proxy_and_top_has_not") {
        return;
    }
    gpu_test(|ctx| {
        let knobs = "candidates = 16\ndirections = 4";
        let set =
            |sampling, internals, first| pictures(ctx, &scene(16, sampling, knobs), internals, first..first + SEEDS);
        let phase = set(Sampling::Phase, NORMAL, 0);
        let resample = set(Sampling::Resample, NORMAL, 1000);
        assert_agree("resample", &resample, &phase, 0.003);
        let gain = variance(&phase) / variance(&resample);
        println!("resample has {gain:.2} times less variance than phase");
        assert!(gain > 1.1, "resample does not pay: the variance is {gain} times less");

        // Both levels together have the mean, with less noise than as many traced directions alone.
        let residual = set(Sampling::Residual, NORMAL, 4000);
        assert_agree("residual", &residual, &phase, 0.003);
        let gain = variance(&phase) / variance(&residual);
        println!("residual has {gain:.2} times less variance than phase");
        assert!(gain > 1.1, "residual does not pay: the variance is {gain} times less");

        // The same test must find the bias of the N brightest of M. It brightens.
        let top = set(Sampling::Top, NORMAL, 2000);
        let test = block_z_scores(&top, &phase);
        println!("top: {test:?}");
        println!("top is brighter by {:.1} %", 100.0 * test.mean_difference_relative);
        assert!(test.max_abs_z > 4.0 && test.rms_z > 4.0, "top passes for unbiased: {test:?}");
        assert!(test.mean_difference_relative > 0.1, "top should brighten: {test:?}");

        // The proxy is not decoration: without its light resample has the same mean and more noise, top another picture.
        const BLIND: Internals = Internals { zero_bucket_colors: true, ..NORMAL };
        let blind = set(Sampling::Resample, BLIND, 3000);
        assert_agree("resample without the proxy's light", &blind, &resample, 0.003);
        let loss = variance(&blind) / variance(&resample);
        println!("without the proxy's light resample has {loss:.2} times the variance");
        assert!(loss > 1.3, "the proxy is decoration: {loss} times the variance without it");
        let blind_top = pictures(ctx, &scene(16, Sampling::Top, knobs), BLIND, 2000..2001);
        assert!(top[..1] != blind_top, "top does not look at the proxy");
    });
}

#[test]
fn resample_and_residual_have_the_mean_of_phase_where_scattering_is_forward() {
    if skips_statistics("resample_and_residual_have_the_mean_of_phase_where_scattering_is_forward") {
        return;
    }
    gpu_test(|ctx| {
        let set = |sampling, first| {
            let mut scene = scene(12, sampling, "candidates = 32\ndirections = 16");
            scene.g = 0.6;
            pictures(ctx, &scene, NORMAL, first..first + SEEDS)
        };
        let phase = set(Sampling::Phase, 0);
        assert_agree("resample, g = 0.6", &set(Sampling::Resample, 1000), &phase, 0.008);
        assert_agree("residual, g = 0.6", &set(Sampling::Residual, 2000), &phase, 0.008);
    });
}

/// Cells that the eye does not see get fewer directions, which costs noise only. The body is opaque enough to hide most of
/// itself.
#[test]
fn fewer_directions_for_hidden_cells_keep_the_mean() {
    if skips_statistics("fewer_directions_for_hidden_cells_keep_the_mean") {
        return;
    }
    gpu_test(|ctx| {
        let set = |share, first| {
            let mut scene =
                scene(12, Sampling::Resample, "candidates = 16\ndirections = 8\nenvironment_directions = 16");
            scene.density_scale = 4.0;
            scene.settings.hidden_share = share;
            pictures(ctx, &scene, NORMAL, first..first + SEEDS)
        };
        let (all, quarter) = (set(1.0, 0), set(0.25, 1000));
        assert_agree("hidden share 0.25", &quarter, &all, 0.01);
        // The share is not without effect.
        assert!(variance(&quarter) > 1.05 * variance(&all), "{} {}", variance(&quarter), variance(&all));
    });
}

/// What is out of the eye's reach is left out of the last gather, and that changes nothing that it could see: less than a
/// thousandth of the noise. Where its rays are too far apart to know, nothing is left out.
#[test]
fn cells_out_of_reach_need_no_last_gather() {
    if skips_statistics("cells_out_of_reach_need_no_last_gather") {
        return;
    }
    gpu_test(|ctx| {
        for (g, orders) in [(0.0, 3), (0.4, 3), (0.0, 1)] {
            let both = |zoom: f64| {
                let mut scene = scene(20, Sampling::Phase, "directions = 8\nenvironment_directions = 8");
                scene.density_scale = 12.0;
                (scene.g, scene.settings.orders) = (g, orders);
                scene.environment = Some(Environment::Constant(glam::Vec3::ONE));
                let framing = Framing { azimuth: 20.0, elevation: 10.0, zoom, ..Framing::default() };
                scene.camera = frame(&scene.volume.grid, &framing, scene.settings.size);
                [false, true].map(|gathers_everywhere| {
                    let internals = Internals { gathers_everywhere, ..NORMAL };
                    let mut renderer = Renderer::new(ctx, &scene, internals).unwrap();
                    ([5, 6].map(|seed| picture(&mut renderer, seed)), renderer.listed_cells())
                })
            };
            let case = format!("g {g}, orders {orders}");
            let [([near, _], [seen, hidden, remote]), ([all, other], cells)] = both(1.9);
            assert_eq!(cells, [seen, hidden + remote, 0], "{case}");
            assert!(4 * remote > seen, "{case}: {remote} cells are out of reach, {seen} are seen");
            let [off, noise] = [&near, &other].map(|b| compare(&all, b).unwrap().rel_mse);
            println!(
                "{case}: {remote} of {} cells are out of reach: relMSE {off:.1e}, noise {noise:.1e}",
                cells[0] + cells[1]
            );
            assert!(off > 0.0 && off < 1e-3 * noise, "{case}: {off} of {noise}");
            let [(far, [.., remote]), (all, _)] = both(0.05);
            assert_eq!(remote, 0, "{case}: nothing is known of it");
            assert!(far == all, "{case}: far away");
        }
    });
}

#[test]
fn a_seed_fixes_every_byte() {
    gpu_test(|ctx| {
        for &sampling in Sampling::value_variants() {
            let scene = scene(12, sampling, "candidates = 8\ndirections = 3");
            let mut renderer = Renderer::new(ctx, &scene, NORMAL).unwrap();
            let [first, other, again] = [7, 8, 7].map(|seed| picture(&mut renderer, seed));
            assert!(first == again, "{sampling:?}: seed 7 twice, with another between");
            assert!(first != other, "{sampling:?}: seeds 7 and 8");
            assert!(first == pictures(ctx, &scene, NORMAL, 7..8)[0], "{sampling:?}: seed 7, all made anew");
            // Both halves of the seed count.
            assert!(first != picture(&mut renderer, 7 + (1 << 32)), "{sampling:?}: seed 7 + 2^32");
        }
    });
}

#[test]
fn a_seed_fixes_every_byte_of_the_command_line_s_file() {
    let folder = tempfile::tempdir().unwrap();
    let run = |file: &str, seed: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tyndall"));
        command.args("render --volume phantom:cloud:16x15x14 --size 16x16 --orders 3 --spp 2 --seed".split(' '));
        if let Some(device) = std::env::var_os("TYNDALL_DEVICE") {
            command.arg("--device").arg(device);
        }
        let output =
            command.args([seed, "-o", file]).current_dir(&folder).env("TYNDALL_CACHE_DIR", "").output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(folder.path().join(file)).unwrap()
    };
    let first = run("a.exr", "5");
    assert!(first == run("b.exr", "5"), "the same seed gives other bytes");
    assert!(first != run("c.exr", "6"), "another seed gives the same bytes");
}

#[test]
fn all_candidates_traced_once_are_phase_s_directions() {
    gpu_test(|ctx| {
        let render = |sampling, internals| {
            // Without a proxy's means inner gathers need a direction for every point: they would have more.
            let scene = scene(12, sampling, "candidates = 8\ndirections = 8\ninner_share = 1");
            pictures(ctx, &scene, internals, 3..4).remove(0)
        };
        let phase = render(Sampling::Phase, NORMAL);
        // Equal weights hit every candidate exactly once.
        let blind = render(Sampling::Resample, Internals { zero_bucket_colors: true, ..NORMAL });
        assert!(phase == blind, "N = M, equal weights: {:?}", compare(&blind, &phase).unwrap());
        // A proxy that is dark leaves what is traced, in the same directions.
        let blind = render(Sampling::Residual, Internals { zero_bucket_colors: true, ..NORMAL });
        assert!(phase == blind, "residual of nothing: {:?}", compare(&blind, &phase).unwrap());
        // The brightest 8 of 8 are all of them, but from other points of the cell: no bias is left.
        let top = compare(&render(Sampling::Top, NORMAL), &phase).unwrap();
        assert!(top.rel_mse < 2e-3 && top.bias.iter().all(|b| b.abs() < 0.01), "top with N = M: {top:?}");
        // With the proxy's weights some are hit twice and some not at all, still of the same 8.
        let resample = compare(&render(Sampling::Resample, NORMAL), &phase).unwrap();
        assert!(resample.rel_mse > 1e-6 && resample.bias.iter().all(|b| b.abs() < 0.02), "N = M: {resample:?}");
    });
}

#[test]
fn one_direction_and_many_candidates() {
    if skips_statistics("one_direction_and_many_candidates") {
        return;
    }
    gpu_test(|ctx| {
        let mean_of = |sampling, knobs: &str, seeds| {
            let pictures = pictures(ctx, &scene(8, sampling, knobs), NORMAL, 0..seeds);
            assert!(pictures.iter().flat_map(|p| &p.pixels).flatten().all(|v| v.is_finite()), "{sampling:?}, {knobs}");
            pictures.iter().map(mean).sum::<f64>() / seeds as f64
        };
        let expected = mean_of(Sampling::Phase, "directions = 256", 4);
        for (knobs, seeds, tolerance) in [
            ("candidates = 16\ndirections = 1", 24, 0.02),
            ("candidates = 1\ndirections = 1", 24, 0.04),
            ("candidates = 1024\ndirections = 1", 24, 0.02),
            ("candidates = 1024\ndirections = 1024", 1, 0.005),
        ] {
            let found = mean_of(Sampling::Resample, knobs, seeds);
            assert!((found / expected - 1.0).abs() < tolerance, "{knobs}: mean {found} instead of {expected}");
        }
        let brighter = mean_of(Sampling::Top, "candidates = 1024\ndirections = 1", 1) / expected;
        assert!(brighter > 1.3, "the brightest of 1024 directions gives only {brighter} times the light");
    });
}

#[test]
fn a_split_list_of_cells_changes_nothing_but_rounding() {
    gpu_test(|ctx| {
        for sampling in [Sampling::Phase, Sampling::Resample, Sampling::Residual] {
            let scene = scene(13, sampling, "candidates = 8\ndirections = 3");
            let render = |segment_voxels| pictures(ctx, &scene, Internals { segment_voxels, ..NORMAL }, 4..5);
            let whole = render(None);
            // Segments of which the last is smaller, and segments of a single row of voxels.
            for segment in [1000, 13] {
                // A voxel's sums are added up in another order.
                let (split, same) = (render(Some(segment)), |a: &f32, b: &f32| (a - b).abs() <= 1e-3 * b.abs() + 1e-6);
                let all = |p: &[Picture]| p[0].pixels.iter().flatten().copied().collect::<Vec<f32>>();
                let agree = all(&split).iter().zip(&all(&whole)).all(|(a, b)| same(a, b));
                assert!(agree, "{sampling:?}, segments of {segment}");
            }
        }
    });
}

/// Fields of 32-bit floats show the same picture without the rounding of 16 bits, also from larger blocks and with a proxy.
#[test]
fn precision_changes_nothing_but_rounding() {
    gpu_test(|ctx| {
        let cases = [(Sampling::Phase, 0.0, 1), (Sampling::Resample, 0.0, 1), (Sampling::Phase, 0.5, 2)];
        for (sampling, g, edge) in cases {
            let [half, single] = [Precision::Half, Precision::Single].map(|precision| {
                let mut scene = scene(13, sampling, "candidates = 8\ndirections = 3");
                (scene.settings.precision, scene.settings.light_grid, scene.g) = (precision, edge, g);
                pictures(ctx, &scene, NORMAL, 4..5).remove(0)
            });
            let difference = compare(&half, &single).unwrap();
            println!("{sampling:?}, g {g}, blocks of {edge}: relMSE {:e}", difference.rel_mse);
            // The choice of candidates may turn over by a last digit, which changes the noise of single cells.
            let most = if sampling == Sampling::Phase { 1e-6 } else { 1e-4 };
            assert!(half != single && difference.rel_mse < most, "{sampling:?}: {:e}", difference.rel_mse);
        }
    });
}

/// Light in larger blocks is a little blurred, and as bright; with the proxy too, which keeps to voxels. The eye sees more
/// noise.
#[test]
fn a_coarse_light_grid_is_as_bright() {
    if skips_statistics("a_coarse_light_grid_is_as_bright") {
        return;
    }
    gpu_test(|ctx| {
        for (sampling, g) in [(Sampling::Phase, 0.0), (Sampling::Residual, 0.0), (Sampling::Phase, 0.5)] {
            let set = |edge| {
                let mut scene = scene(21, sampling, "candidates = 24\ndirections = 12");
                (scene.settings.light_grid, scene.g) = (edge, g);
                pictures(ctx, &scene, NORMAL, 0..6)
            };
            let brightness = |pictures: &[Picture]| pictures.iter().map(mean).sum::<f64>() / pictures.len() as f64;
            let fine = set(1);
            for edge in [2, 3] {
                let coarse = set(edge);
                let ratio = brightness(&coarse) / brightness(&fine);
                println!("{sampling:?}, g {g}, blocks of {edge}: {ratio}, {} {}", variance(&coarse), variance(&fine));
                assert!((ratio - 1.0).abs() < 0.03, "{sampling:?}, g {g}, blocks of {edge}: {ratio} times as bright");
                assert!(variance(&coarse) > 1.1 * variance(&fine), "{sampling:?}: as little noise with fewer cells");
            }
        }
    });
}

#[test]
fn a_proxy_with_too_little_room_gets_coarser_and_costs_only_noise() {
    if skips_statistics("a_proxy_with_too_little_room_gets_coarser_and_costs_only_noise") {
        return;
    }
    gpu_test(|ctx| {
        let scene = scene(14, Sampling::Resample, "candidates = 16\ndirections = 4\nmask = 8");
        let capacity = 2000;
        let mut renderer = Renderer::new(ctx, &scene, Internals { proxy_capacity: Some(capacity), ..NORMAL }).unwrap();
        let coarse: Vec<_> = (0..SEEDS / 2).map(|seed| picture(&mut renderer, seed)).collect();
        for proxy in renderer.stats(&scene, 0.0).unwrap().proxy {
            assert_eq!(proxy.mask_requested, Mask::Channels([0xFF; 4]));
            assert_ne!(proxy.mask_used, Mask::Channels([0xFF; 4]), "the mask in use is not reported: {proxy:?}");
            assert!((2..=u64::from(capacity)).contains(&proxy.runs), "{proxy:?}");
        }
        let fine = pictures(ctx, &scene, NORMAL, 1000..1000 + SEEDS / 2);
        assert_agree("coarser mask", &coarse, &fine, 0.005);
    });
}
