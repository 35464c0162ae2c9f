//! What a picture must not depend on: how wide the device's subgroups are and how many threads it has, which way the
//! world's axes point, and in which order lights are listed. The deterministic models' symmetries are in
//! tests/analytic.rs.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/place.rs"]
mod place;
#[path = "common/transport.rs"]
mod transport;

use bodies::turn_scene;
use common::is_full;
use glam::{DMat3, DVec3, Vec3};
use place::{Place, text};
use std::ops::ControlFlow;
use transport::mean;
use tyndall::output::{Picture, read_picture};
use tyndall::passes::Stored;
use tyndall::render;
use tyndall::render::path::{Estimate, PathRender};
use tyndall::render::{Internals, Renderer};
use tyndall::scene::{Background, Environment, Light, LightFor, Model, Precision, Sampling, Scene};
use tyndall::vk::{Context, Validation};

// ---- the device's shape -------------------------------------------------------------------------------------------

/// A scene of every kind of pass: proxy and gather with moments, or paths with all they can meet.
const SCENE: [&str; 17] = [
    "render",
    "--volume",
    "phantom:cloud:24x20x16",
    "--size",
    "24x24",
    "--orders",
    "3",
    "--light",
    "directional:30,40,2",
    "--light",
    "point:3,-40,50,2000",
    "--environment=0.5",
    "--g",
    "0.4",
    "-o",
    "out.exr",
    "--json",
];

/// Renders on lavapipe with vectors of `width` bits and `threads` worker threads; `None` if the device is another one.
/// The file's bytes, and the subgroup size that the device reports.
fn render_on(width: u32, threads: u32, model: &[&str]) -> Option<(Vec<u8>, Picture, u64)> {
    let place = Place::new();
    let mut command = place.command(&[&SCENE[..], model].concat());
    command.env("LP_NATIVE_VECTOR_WIDTH", width.to_string()).env("LP_NUM_THREADS", threads.to_string());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{width} bits, {threads} threads: {}", text(&output.stderr));
    let stats: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let name = stats["device"]["name"].as_str().unwrap();
    if !name.contains("llvmpipe") {
        let any = std::env::var("TYNDALL_TEST_DEVICE").unwrap_or_default();
        println!("SKIP subgroup widths and threads: {name} is not lavapipe (TYNDALL_TEST_DEVICE='{any}')");
        return None;
    }
    let path = place.path("out.exr");
    let size = stats["device"]["subgroup_size"].as_u64().unwrap();
    Some((std::fs::read(&path).unwrap(), read_picture(&path).unwrap(), size))
}

/// Threads change no byte. The width of subgroups changes the code that the driver makes, and with it the last bits of
/// exponentials and logarithms (Mesa 22.3: none of them shows). Where a random decision hangs on such a bit (a path's collision, a candidate's hit)
/// another one is taken; that is a matter of single samples: at most `outliers` of 576 pixels differ by more than 1e-4
/// of the brightest value, none by more than `most`, and the mean by no more than 1e-4.
fn same_on_every_device_shape(model: &[&str], outliers: usize, most: f32) {
    let Some((_, expected, size)) = render_on(256, 2, model) else { return };
    assert_eq!(size, 8, "256 bits are 8 lanes");
    let shapes: Vec<(u32, u32)> = if is_full() {
        [128, 256, 512].into_iter().flat_map(|width| [0, 1, 2, 8].map(|threads| (width, threads))).collect()
    } else {
        vec![(256, 0), (256, 1), (256, 8), (128, 2), (128, 8), (512, 2), (512, 0)]
    };
    let mut of_width: Vec<(u32, Vec<u8>)> = Vec::new();
    for (width, threads) in shapes {
        let case = format!("{model:?}, {width} bits, {threads} threads");
        let (bytes, picture, size) = render_on(width, threads, model).expect("the device is still lavapipe");
        assert_eq!(size, u64::from(width / 32), "{case}");
        match of_width.iter().find(|(w, _)| *w == width) {
            Some((_, others)) => assert!(bytes == *others, "{case}: other bytes than with other threads"),
            None => of_width.push((width, bytes)),
        }
        let flat = |p: &Picture| p.pixels.iter().flatten().copied().collect::<Vec<f32>>();
        let brightest = flat(&expected).into_iter().fold(0.0, f32::max);
        let of_pixel =
            |(a, b): (&[f32; 4], &[f32; 4])| (0..4).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max) / brightest;
        let all: Vec<f32> = picture.pixels.iter().zip(&expected.pixels).map(of_pixel).collect();
        assert!(all.iter().all(|d| d.is_finite()), "{case}");
        let differ = all.iter().filter(|d| **d > 1e-4).count();
        let worst = all.iter().copied().fold(0.0, f32::max);
        let off = (mean(&picture) / mean(&expected) - 1.0).abs().max_element();
        println!("{case}: {differ} of 576 pixels differ, the worst by {worst}; the mean by {off}");
        assert!(differ <= outliers && worst <= most && off <= 1e-4, "{case}: {differ} pixels, {worst}, {off}");
    }
}

#[test]
fn subgroups_and_threads_multiple() {
    same_on_every_device_shape(&["--model", "multiple", "--sampling", "resample", "--spp", "2"], 6, 1e-3);
}

#[test]
fn subgroups_and_threads_path() {
    // A sample that goes another way is an eighth of its pixel.
    same_on_every_device_shape(&["--model", "path", "--spp", "8"], 6, 0.125);
}

// ---- symmetries of the scene ---------------------------------------------------------------------------------------

/// Runs `body` on a device, but not under GPU-assisted validation, as in tests/analytic.rs.
fn gpu_test(body: impl FnOnce(&Context)) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP whole renders under GPU-assisted validation");
    } else {
        common::gpu_test(body);
    }
}

const SIZE: u32 = 16;
/// Edge of the blocks whose means are compared.
const BLOCK: u32 = 4;

fn cloud() -> Scene {
    let mut scene = bodies::cloud([SIZE; 2]);
    scene.g = 0.3;
    scene
}

/// The whole scene turned by `turn`, with the sky about z by `sky_degrees`.
fn turned(mut scene: Scene, turn: DMat3, sky_degrees: f64) -> Scene {
    turn_scene(&mut scene, turn);
    if let Some(Environment::LatLong(sky)) = &mut scene.environment {
        sky.rotation_degrees += sky_degrees;
    }
    scene
}

/// Quarter turns about every axis; only about z can the sky be turned, so others have a uniform one.
fn quarter_turns() -> Vec<(&'static str, DMat3, f64, Option<Environment>)> {
    let uniform = || Some(Environment::Constant(Vec3::new(0.5, 0.7, 1.0)));
    vec![
        ("x", DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y), 0.0, uniform()),
        ("y", DMat3::from_cols(-DVec3::Z, DVec3::Y, DVec3::X), 0.0, uniform()),
        ("z", DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z), 90.0, Some(bodies::sky())),
    ]
}

fn trace(ctx: &Context, scene: &Scene, seed: u64, spp: u32) -> Estimate {
    let scene = Scene {
        settings: tyndall::scene::Settings { model: Model::Path, seed, ..scene.settings.clone() },
        ..scene.clone()
    };
    let mut render = PathRender::new(ctx, &scene).unwrap();
    render.advance(spp, &mut |_| ControlFlow::Continue(())).unwrap();
    render.sums().unwrap().estimate(scene.settings.size)
}

/// Means of blocks of pixels, per channel, with their variances.
fn blocks(e: &Estimate) -> Vec<(f64, f64)> {
    let n = (SIZE / BLOCK) as usize;
    let mut sums = vec![(0.0, 0.0); n * n * 3];
    for (i, (p, v)) in e.picture.pixels.iter().zip(&e.variance).enumerate() {
        let (x, y) = (i as u32 % SIZE / BLOCK, i as u32 / SIZE / BLOCK);
        for c in 0..3 {
            let sum = &mut sums[(y as usize * n + x as usize) * 3 + c];
            *sum = (sum.0 + f64::from(p[c]), sum.1 + v[c]);
        }
    }
    let count = f64::from(BLOCK * BLOCK);
    sums.into_iter().map(|(mean, variance)| (mean / count, variance / (count * count))).collect()
}

/// Independent renders of one expected picture: every block's and channel's difference within 4.5 of its own standard
/// errors (once in 3,000 comparisons of 48 it is not), their mean square near 1 (channels of a block go together, so it
/// is that of 16 numbers), and errors small enough that a wrong picture would be seen.
#[track_caller]
fn assert_within_noise(case: &str, a: &Estimate, b: &Estimate) {
    let (a, b) = (blocks(a), blocks(b));
    let z: Vec<f64> = a.iter().zip(&b).map(|(a, b)| (a.0 - b.0) / (a.1 + b.1).sqrt().max(1e-12)).collect();
    let worst = z.iter().fold(0.0f64, |most, z| most.max(z.abs()));
    let square = z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64;
    let brightest = a.iter().map(|a| a.0).fold(0.0, f64::max);
    let error = (a.iter().map(|a| a.1).sum::<f64>() / a.len() as f64).sqrt() / brightest;
    println!("{case}: largest |z| {worst:.2}, mean z² {square:.2}, standard error {error:.4} of the brightest block");
    assert!(worst < 4.5 && square < 2.6, "{case}: largest |z| {worst}, mean square {square}");
    assert!(error < 0.02, "{case}: a standard error of {error} shows nothing");
}

#[test]
fn turning_the_whole_scene_changes_no_path() {
    gpu_test(|ctx| {
        for (axis, turn, sky, environment) in quarter_turns() {
            let scene = Scene { environment, ..cloud() };
            // Other seeds: the same random numbers in both would hide differences in each other's noise.
            let before = trace(ctx, &scene, 1, 512);
            let after = trace(ctx, &turned(scene, turn, sky), 2, 512);
            assert_within_noise(axis, &before, &after);
        }
    });
}

/// The same for the cached models with sky and g ≠ 0, whose directions are drawn in the world and do not turn with it:
/// noise of a few thousandths is left of 256 directions per voxel and order.
#[test]
fn turning_the_whole_scene_changes_no_cached_light() {
    gpu_test(|ctx| {
        for (axis, turn, sky, environment) in quarter_turns() {
            for model in [Model::Single, Model::Multiple] {
                let mut scene =
                    Scene { environment: environment.clone(), background: Background::Transparent, ..cloud() };
                scene.settings.model = model;
                scene.settings.sampling = Sampling::Phase;
                scene.settings.directions = 128;
                scene.settings.environment_directions = 256;
                scene.settings.orders = 2;
                let picture = |scene: &Scene| render::render(ctx, scene, &mut |_| ControlFlow::Continue(())).unwrap().0;
                let before = picture(&scene);
                let after = picture(&turned(scene, turn, sky));
                let brightest = before.pixels.iter().flat_map(|p| &p[..3]).copied().fold(0.0, f32::max);
                let light = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
                let worst = after.pixels.iter().zip(&before.pixels).map(light).fold(0.0, f32::max) / brightest;
                let opacity =
                    after.pixels.iter().zip(&before.pixels).map(|(a, b)| (a[3] - b[3]).abs()).fold(0.0, f32::max);
                let off = ((mean(&after) - mean(&before)) / mean(&before)).abs().max_element();
                println!("{axis}, {model:?}: worst pixel {worst}, opacity {opacity}, mean {off}");
                assert!(worst < 0.03 && opacity < 1e-3 && off < 5e-3, "{axis}, {model:?}: {worst} {opacity} {off}");
            }
        }
    });
}

/// Of two lights `path` draws one by its share in what arrives: exchanged, other random numbers choose, and the expected
/// picture is the same. (The other models visit all of few lights: `analytic::exchanging_two_lights_changes_nothing`.)
#[test]
fn exchanging_two_lights_changes_no_path() {
    gpu_test(|ctx| {
        for environment in [None, Some(bodies::sky())] {
            let case = if environment.is_some() { "with sky" } else { "without sky" };
            let mut scene = Scene { environment, ..cloud() };
            for light in &mut scene.lights {
                let (Light::Directional { irradiance: power, .. } | Light::Point { intensity: power, .. }) = light;
                // Brighter than the sky and its noise.
                *power *= 8.0;
            }
            let before = trace(ctx, &scene, 1, 512);
            scene.lights.reverse();
            assert_within_noise(case, &before, &trace(ctx, &scene, 2, 512));
            // A light less is seen, so this could fail.
            scene.lights.pop();
            let fewer = trace(ctx, &scene, 2, 512);
            let error = before.mean_error[0].hypot(fewer.mean_error[0]);
            assert!(
                before.mean[0] - fewer.mean[0] > 5.0 * error,
                "{case}: {} {} {error}",
                before.mean[0],
                fewer.mean[0]
            );
        }
    });
}

/// Of many lights a camera sample visits eight: reversed, it visits others, and the mean over the samples stays.
#[test]
fn reversing_many_lights_changes_nothing() {
    gpu_test(|ctx| {
        let mut scene = cloud();
        scene.environment = None;
        scene.settings.model = Model::Single;
        scene.settings.spp = 64;
        scene.lights = (0..13)
            .map(|i| Light::Directional {
                direction: tyndall::scene::camera::towards(f64::from(37 * i), f64::from(7 * i - 45)),
                irradiance: Vec3::new(0.1, 0.2, 0.3) * i as f32,
            })
            .collect();
        let picture = |scene: &Scene| render::render(ctx, scene, &mut |_| ControlFlow::Continue(())).unwrap().0;
        let before = picture(&scene);
        scene.lights.reverse();
        let after = picture(&scene);
        let off = ((mean(&after) - mean(&before)) / mean(&before)).abs().max_element();
        println!("mean: {off}");
        // 256 pixels of 64 samples, each light seen by 8 of 13 of them.
        assert!(off < 5e-3, "{off}");
    });
}

// ---- scenes without colour ------------------------------------------------------------------------------------------

/// The same scene without colour, but for its background, which no light that is stored comes from.
fn grey(mut scene: Scene) -> Scene {
    for point in &mut scene.transfer.points {
        point.color = [point.color[1]; 3];
        point.emission = [point.emission[1]; 3];
    }
    scene.albedo_scale = Vec3::splat(scene.albedo_scale.y);
    for light in &mut scene.lights {
        let (Light::Directional { irradiance: power, .. } | Light::Point { intensity: power, .. }) = light;
        *power = Vec3::splat(power.y);
    }
    match &mut scene.environment {
        Some(Environment::Constant(radiance)) => *radiance = Vec3::splat(radiance.y),
        Some(Environment::LatLong(image)) => image.pixels.iter_mut().for_each(|p| *p = [p[1]; 3]),
        None => {}
    }
    scene.background = Background::Color(Vec3::new(0.1, 0.2, 0.3));
    scene
}

/// The picture, and whether light was stored in one channel.
fn picture_of(ctx: &Context, scene: &Scene, stores_color: bool) -> (Picture, bool) {
    let internals = Internals { stores_color, ..Internals::default() };
    let mut renderer = Renderer::new(ctx, scene, internals).unwrap();
    let picture = renderer.render(7, &mut |_| ControlFlow::Continue(())).unwrap();
    (picture, renderer.stores_grey())
}

/// One channel of light instead of three changes no byte, whatever the model and the ways to store.
#[test]
fn light_without_colour_is_stored_in_one_channel() {
    gpu_test(|ctx| {
        let uniform = Some(Environment::Constant(Vec3::ONE));
        let mut all = Vec::new();
        for (model, g) in [
            (Model::Absorption, 0.0),
            (Model::Phong, 0.0),
            (Model::Single, 0.0),
            (Model::Single, -0.3),
            (Model::Multiple, 0.0),
            (Model::Multiple, 0.4),
        ] {
            for precision in [Precision::Half, Precision::Single] {
                let mut scene = grey(cloud());
                (scene.g, scene.settings.model, scene.settings.precision) = (g, model, precision);
                all.push((format!("{model:?}, g {g}, {precision:?}"), scene));
            }
        }
        let mut add = |case: &str, change: &dyn Fn(&mut Scene)| {
            let mut scene = grey(cloud());
            change(&mut scene);
            all.push((case.to_owned(), scene));
        };
        add("blocks", &|s| s.settings.light_grid = 2);
        add("every view", &|s| s.settings.light_for = LightFor::EveryView);
        add("constant environment", &|s| s.environment = uniform.clone());
        add("residual", &|s| s.settings.sampling = Sampling::Residual);
        add("top", &|s| s.settings.sampling = Sampling::Top);
        for (case, scene) in all {
            if !Stored::of(ctx, scene.settings.precision, true).is_grey {
                println!("SKIP {case}: the device stores no images of two channels");
                continue;
            }
            let ((one, is_grey), (three, is_not)) = (picture_of(ctx, &scene, false), picture_of(ctx, &scene, true));
            assert!(is_grey && !is_not, "{case}: {is_grey}, {is_not}");
            assert!(one == three, "{case}: other bytes");
            assert!(one.pixels.iter().any(|p| p[0] > 0.2), "{case}: dark");
        }
    });
}

/// Any colour that light may take on needs all three.
#[test]
fn any_colour_is_noticed() {
    gpu_test(|ctx| {
        let is_grey = |change: &dyn Fn(&mut Scene)| {
            let mut scene = grey(cloud());
            change(&mut scene);
            picture_of(ctx, &scene, false).1
        };
        assert_eq!(is_grey(&|_| {}), Stored::of(ctx, Precision::Half, true).is_grey);
        assert!(!is_grey(&|s| s.transfer.points[1].color[2] *= 0.999));
        assert!(!is_grey(&|s| s.transfer.points[1].emission[0] += 0.1));
        assert!(!is_grey(&|s| s.albedo_scale.x *= 0.9));
        for light in 0..2 {
            assert!(!is_grey(&|s| {
                let (Light::Directional { irradiance: power, .. } | Light::Point { intensity: power, .. }) =
                    &mut s.lights[light];
                power.z += 0.1;
            }));
        }
        assert!(!is_grey(&|s| s.environment = Some(Environment::Constant(Vec3::new(1.0, 1.0, 0.9)))));
        assert!(!is_grey(&|s| {
            let Some(Environment::LatLong(image)) = &mut s.environment else { panic!("no sky") };
            image.pixels[20][1] += 0.1;
        }));
    });
}
