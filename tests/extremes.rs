//! The extremes that DESIGN section 8 lists, each with the number, the bound or the refusal that is due, in every model
//! that it concerns. What other files test is not repeated here:
//!
//! | extreme | test |
//! |---|---|
//! | g = ±0.999, ±1e-6, 0 | here: `phase_functions_of_every_width`, `white_furnace`; passes: `gather`, `single_scatter`, `path` |
//! | σ_t = 0 | here: `nothing_is_seen_through_nothing`; `analytic::an_empty_volume_shows_the_background` |
//! | σ_t = 1e-6 and 1e6 per unit | here: `thin_and_thick_media`, `white_furnace`; `analytic::transmittance` |
//! | thin and dense matter in one scene | here: `haze_beside_dense_matter` |
//! | albedo 0, per channel different | here: `orders_go_with_powers_of_the_albedo` |
//! | albedo 1: furnace of orders 1, 64, unlimited | here: `white_furnace`; order by order: `analytic::white_furnace` |
//! | 1×1×1, 1×N×1, 3×5×7 voxels | here: `any_number_of_voxels_is_the_same_box`; passes: `bodies::scenes` in each pass's own test |
//! | 512×512×182 voxels | here: `path_through_a_large_volume` (long); `big` (long), all other passes |
//! | spacing 1e-6 and 1e6; far from the world's origin | here: `no_scale_and_no_place_is_special` |
//! | spacing 1:1:20 | here: `cameras_inside_far_away_and_wide` |
//! | all zero | here: `nothing_is_seen_through_nothing`; `analytic`, as above |
//! | constant, all different, one bright voxel | `proxy::{a_constant_volume…, all_different_voxels…, one_bright_voxel…}` |
//! | NaN, ±Inf | here for `path`: `scalars_that_are_no_numbers`; `analytic::scalars_that_are_no_numbers`, the other models |
//! | denormals, values at the ends of single precision | here: `scalars_of_every_magnitude`; files: `volume_formats::every_scalar_type…` |
//! | steps of zero width | `classify::steps_and_scalars_that_are_no_numbers`, `scene::transfer_functions_are_piecewise…` |
//! | α = 1, non-monotone transfer functions | here: `opaque_and_non_monotone_matter` |
//! | rays along axes and through corners | here: `rays_within_faces_and_edges`; `analytic::transmittance` |
//! | camera inside, 1e6 units away, fov 1° and 170° | here: `cameras_inside_far_away_and_wide`; `camera::eyes_in_awkward_places` |
//! | light in a voxel, at its centre, below the horizon | here: `lights_inside_and_below`; `single_scatter::lights_and_eyes_inside` |
//! | 0, 1 and 64 lights | here: `many_lights_are_as_bright_as_their_sum`; `single_scatter::many_lights_are_split…` |
//! | environment with a 1e5 sun | here: `a_sun_in_the_environment`, `brightness_is_linear_in_the_light` |
//! | radiance beyond half-float range | here: `brightness_is_linear_in_the_light`, `phase_functions_of_every_width` |
//! | M = N, N = 1, M = 1024 | `sampling::{all_candidates_traced_once…, one_direction_and_many_candidates}` |
//! | images of 1×1 and 8192×1 | here: `pictures_of_one_pixel_and_of_one_row` |
//! | zero-size, truncated, oversized files | `cli`, `volume_formats::{wrong_*, damaged_*}` |
//! | headers that promise 17 GB | `volume_formats::headers_that_promise_gigabytes_reserve_no_memory` |
//! | light beyond single precision | here: `light_beyond_single_precision_is_refused` |
//!
//! Every picture that this file takes is checked to be finite, not negative and of an opacity of at most 1.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/transport.rs"]
mod transport;

use bodies::random_values;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::f64::consts::PI;
use std::ops::ControlFlow;
use transport::{aim, assert_near, homogeneous, matter, mean, sun, unit_cube};
use tyndall::output::Picture;
use tyndall::render;
use tyndall::render::path::{Estimate, PathRender};
use tyndall::scene::camera::look_at;
use tyndall::scene::{
    Background, Environment, LatLong, Light, Model, OpacityUnit, Sampling, Scene, TransferPoint, UNLIMITED,
};
use tyndall::vk::{Context, Validation};
use tyndall::volume::{Grid, VoxelData};

const MODELS: [Model; 5] = [Model::Absorption, Model::Phong, Model::Single, Model::Multiple, Model::Path];
/// Those that scatter light.
const SCATTERING: [Model; 3] = [Model::Single, Model::Multiple, Model::Path];

/// Runs `body` on a device, but not under GPU-assisted validation, as in tests/analytic.rs.
fn gpu_test(body: impl FnOnce(&Context)) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP whole renders under GPU-assisted validation");
    } else {
        common::gpu_test(body);
    }
}

#[track_caller]
fn assert_sound(picture: &Picture) {
    let is_sound = |p: &[f32; 4]| p.iter().all(|c| c.is_finite() && *c >= 0.0) && p[3] <= 1.0;
    if let Some(i) = picture.pixels.iter().position(|p| !is_sound(p)) {
        panic!("pixel {i} is {:?}", picture.pixels[i]);
    }
}

/// The picture in the scene's model; `spp` of the settings is the number of samples of `path` too.
fn render(ctx: &Context, scene: &Scene) -> Picture {
    let (picture, _) = render::render(ctx, scene, &mut |_| ControlFlow::Continue(())).unwrap();
    assert_sound(&picture);
    picture
}

/// The same in another model, with so many samples for `path`.
fn render_as(ctx: &Context, scene: &Scene, model: Model, path_spp: u32) -> Picture {
    let mut scene = scene.clone();
    scene.settings.model = model;
    if model == Model::Path {
        scene.settings.spp = path_spp;
    }
    render(ctx, &scene)
}

/// What `path` knows after `spp` samples per pixel.
fn trace(ctx: &Context, scene: &Scene, spp: u32) -> Estimate {
    let mut render = PathRender::new(ctx, scene).unwrap();
    render.advance(spp, &mut |_| ControlFlow::Continue(())).unwrap();
    let estimate = render.sums().unwrap().estimate(scene.settings.size);
    assert_sound(&estimate.picture);
    estimate
}

/// A share of `samples` that hit is off by no more than chance: four standard errors, and two hits where they are few.
#[track_caller]
fn assert_share(case: &str, got: f64, expected: f64, samples: f64) {
    let tolerance = 4.0 * (expected * (1.0 - expected) / samples).sqrt() + 2.0 / samples;
    assert!((got - expected).abs() <= tolerance, "{case}: {got} instead of {expected}, allowed {tolerance:e}");
}

#[track_caller]
fn assert_relative(case: &str, got: f32, expected: f64, tolerance: f64) {
    assert_near(case, got, expected, tolerance * expected);
}

/// Largest difference of two pictures in units of the brightest value of `expected`, leaving out the `outliers` worst
/// pixels.
fn difference(got: &Picture, expected: &Picture, outliers: usize) -> f32 {
    let most = |p: &[f32; 4]| p[..3].iter().copied().fold(0.0, f32::max);
    let brightest = expected.pixels.iter().map(most).fold(f32::MIN_POSITIVE, f32::max);
    let pairs = got.pixels.iter().zip(&expected.pixels);
    let of = |(a, b): (&[f32; 4], &[f32; 4])| {
        let light = (0..3).map(|c| (a[c] - b[c]).abs() / brightest).fold(0.0, f32::max);
        light.max((a[3] - b[3]).abs())
    };
    let mut all: Vec<f32> = pairs.map(of).collect();
    all.sort_by(f32::total_cmp);
    all[all.len() - 1 - outliers]
}

fn cloud() -> Scene {
    let mut scene = bodies::cloud([16, 16]);
    scene.settings.spp = 4;
    scene.settings.sampling = Sampling::Phase;
    scene
}

/// World scaled by `scale`, then moved by `offset`: all lengths, but nothing else, so that the picture stays.
fn elsewhere(mut scene: Scene, scale: f64, offset: DVec3) -> Scene {
    let map = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(scale)), translation: offset };
    scene.volume_mut().grid.index_to_world = map * scene.volume.grid.index_to_world;
    scene.camera.position = map.transform_point3(scene.camera.position);
    scene.density_scale /= scale;
    for light in &mut scene.lights {
        if let Light::Point { position, intensity } = light {
            *position = map.transform_point3(*position);
            *intensity *= (scale * scale) as f32;
        }
    }
    scene
}

/// Voxels of a nanometre and of a kilometre, and a volume a hundred million units from the world's origin (as maps
/// have): the same picture, but for the rounding of single precision, by which few paths choose another way.
#[test]
fn no_scale_and_no_place_is_special() {
    gpu_test(|ctx| {
        for model in MODELS {
            let before = render_as(ctx, &cloud(), model, 16);
            let cases = [(1e-6, DVec3::ZERO), (1e6, DVec3::ZERO), (1.0, DVec3::new(1e8, -3e7, 2e8))];
            for (scale, offset) in cases {
                let after = render_as(ctx, &elsewhere(cloud(), scale, offset), model, 16);
                let outliers = if model == Model::Path { 5 } else { 0 };
                let worst = difference(&after, &before, outliers);
                assert!(worst < 3e-3, "{model:?}, scale {scale}, offset {offset}: {worst}");
            }
        }
    });
}

/// Order 1 of a cube of extinction 1e-6, 1 and 1e6 with the light behind the eye: E albedo (1 − e^−2τ) / 8π. A voxel
/// that is thicker than a mean free path hides all later orders from the cache: `multiple` is then no brighter than
/// `single` (the truth is up to 8.5 times as bright), and `path` knows.
#[test]
fn thin_and_thick_media() {
    gpu_test(|ctx| {
        for extinction in [1e-6, 1e-3, 1e6] {
            let mut scene = homogeneous(unit_cube(4), extinction, Vec3::new(1.0, 0.5, 0.0));
            scene.lights = vec![Light::Directional { direction: DVec3::X, irradiance: Vec3::splat(1e6) }];
            scene.settings.orders = 1;
            // Stratified points of the ray: a standard error of 0.06 % where light comes from all depths alike.
            scene.settings.spp = 64;
            aim(&mut scene, [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], [16, 16]);
            let expected = -1e6 * (-2.0 * extinction).exp_m1() / (8.0 * PI);
            let opacity = -(-extinction).exp_m1();
            for model in [Model::Single, Model::Multiple] {
                let case = format!("extinction {extinction}, {model:?}");
                let seen = mean(&render_as(ctx, &scene, model, 0));
                assert_relative(&case, seen.w, opacity, 2e-3);
                assert_relative(&case, seen.x, expected, 2e-3);
                assert_relative(&case, seen.y, 0.5 * expected, 2e-3);
                assert_eq!(seen.z, 0.0);
            }
            scene.settings.model = Model::Path;
            let spp = 4096;
            let traced = trace(ctx, &scene, spp);
            let case = format!("extinction {extinction}, path");
            assert_share(&case, mean(&traced.picture).w.into(), opacity, 256.0 * f64::from(spp));
            if extinction > 1e-6 {
                let error = traced.mean_error[0];
                assert!(
                    (traced.mean[0] - expected).abs() < 4.0 * error,
                    "{case}: {} {expected} {error}",
                    traced.mean[0]
                );
            }
            scene.settings.orders = 8;
            let first = mean(&render_as(ctx, &scene, Model::Single, 0)).x;
            let all = mean(&render_as(ctx, &scene, Model::Multiple, 0)).x;
            if extinction > 1.0 {
                assert_relative("later orders", all, first.into(), 1e-3);
                let traced = mean(&render_as(ctx, &scene, Model::Path, 64)).x / first;
                assert!(traced > 3.0 && traced < 8.46, "path sees {traced} times order 1");
            } else {
                assert_relative("later orders", all, first.into(), 2.0 * extinction + 1e-3);
            }
        }
    });
}

/// Haze of optical depth 1 along the ray, in a volume with matter 1e4, 1e6 and 1e9 times as dense. Fields are half floats
/// relative to the densest matter: full digits down to 6e-5 of it, steps of 6e-8, nothing below that. `path` is single
/// precision and sees all (in time that goes with the densest matter of each 8³ voxels, so not within the same).
#[test]
fn haze_beside_dense_matter() {
    gpu_test(|ctx| {
        let opacity = 1.0 - f64::exp(-1.0);
        // A step of the half float is 6 % of 1e-6, and devices may cut it off.
        for (dense, cached, tolerance) in [(1e4, opacity, 1e-3), (1e6, opacity, 0.022), (1e9, 0.0, 0.0)] {
            let mut scene = homogeneous(Grid::axis_aligned([1, 1, 32], [1.0; 3], [0.5; 3]), 1.0, Vec3::ZERO);
            scene.lights.push(sun([1.0, 0.0, 0.0]));
            scene.volume_mut().data = VoxelData::F32((0..32).map(|z| if z == 31 { 2.0 } else { 1.0 }).collect());
            let point = TransferPoint { value: 2.0, opacity: dense, ..scene.transfer.points[1] };
            scene.transfer.points.push(point);
            aim(&mut scene, [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], [8, 8]);
            for model in MODELS {
                let got = mean(&render_as(ctx, &scene, model, 1024)).w;
                let case = format!("beside {dense:e}, {model:?}");
                if model == Model::Path {
                    assert_share(&case, got.into(), opacity, 65536.0);
                } else {
                    assert_near(&case, got, cached, tolerance);
                }
            }
        }
    });
}

/// Extinction 0, by the transfer function, by the density and by the data: exactly the background.
#[test]
fn nothing_is_seen_through_nothing() {
    gpu_test(|ctx| {
        let color = Vec3::new(0.25, 0.5, 2.0);
        for (case, model) in
            [(0, Model::Path), (1, Model::Path), (2, Model::Path), (0, Model::Single), (1, Model::Phong)]
        {
            let mut scene = cloud();
            scene.background = Background::Color(color);
            match case {
                0 => scene.transfer = matter(0.0, Vec3::ONE, Vec3::ONE),
                1 => scene.density_scale = 0.0,
                _ => scene.volume_mut().data = VoxelData::F32(vec![0.0; 315]),
            }
            let picture = render_as(ctx, &scene, model, 8);
            // `path` scales its sums to the range of the light and back, once each.
            let is_right = |p: &[f32; 4]| (Vec3::new(p[0], p[1], p[2]) / color - 1.0).abs().max_element() < 2e-7;
            assert!(picture.pixels.iter().all(is_right), "{case}, {model:?}: {:?}", picture.pixels[0]);
        }
    });
}

/// Albedo 1 in a uniform environment of radiance 1. With unlimited orders every path brings 1, whatever the phase
/// function and however thick the medium, but for what the cap cuts; with K orders nothing is brighter than 1.
#[test]
fn white_furnace() {
    gpu_test(|ctx| {
        let furnace = |extinction: f64| {
            let mut scene = homogeneous(unit_cube(6), extinction, Vec3::ONE);
            scene.environment = Some(Environment::Constant(Vec3::ONE));
            scene.background = Background::Environment;
            scene.settings.size = [8, 8];
            scene.camera = look_at(DVec3::new(0.5, -1.5, 0.7), DVec3::splat(0.5), DVec3::Z, 30.0);
            scene
        };
        for (extinction, g, cap) in [
            (1e-6, 0.0, 100_000),
            (5.0, 0.0, 100_000),
            (5.0, 1e-6, 100_000),
            (5.0, -1e-6, 100_000),
            (5.0, 0.999, 100_000),
            (5.0, -0.999, 100_000),
            (1e6, 0.0, 300),
        ] {
            let mut scene = furnace(extinction);
            (scene.g, scene.settings.model) = (g, Model::Path);
            (scene.settings.orders, scene.settings.max_events) = (UNLIMITED, cap);
            let traced = trace(ctx, &scene, 64);
            let case = format!("extinction {extinction}, g {g}");
            assert_near(&case, (traced.mean[0] + traced.truncated) as f32, 1.0, 1e-6);
            if extinction < 1e6 {
                assert!(traced.picture.pixels.iter().all(|p| (p[0] - 1.0).abs() < 1e-6), "{case}");
            } else {
                // The chance to be still in a half-space after n scatterings falls with √n.
                assert!(traced.truncated > 0.01 && traced.truncated < 0.2, "{}", traced.truncated);
            }
        }
        // Cut at 1 and at 64 orders: `multiple` as `path`.
        let mut scene = furnace(2.0);
        scene.settings.environment_directions = 64;
        scene.settings.directions = 32;
        for (orders, least, most) in [(1, 0.5, 0.95), (64, 0.99, 1.005)] {
            scene.settings.orders = orders;
            let cached = mean(&render_as(ctx, &scene, Model::Multiple, 0)).x;
            let traced = mean(&render_as(ctx, &scene, Model::Path, 256)).x;
            assert!(traced > least && traced <= 1.000_001f32.min(most), "{orders} orders: path {traced}");
            // The outer half of an edge voxel, a sixth of a mean free path, gets its centre's light: 3.5 % too little.
            assert_relative(&format!("{orders} orders"), cached, traced.into(), 0.05);
            assert!(cached < most, "{orders} orders: {cached}");
        }
        // A peak of 4π p = 2·10⁶ that uniform directions meet once in a million times: no picture to be had from
        // `multiple`, but never more than the peak times the environment, and mostly nothing but what is unscattered.
        for g in [0.999, -0.999] {
            scene.g = g;
            scene.settings.orders = 3;
            let picture = render_as(ctx, &scene, Model::Multiple, 0);
            let peak = (1.0 + 0.999) / (1.0f32 - 0.999).powi(2);
            assert!(picture.pixels.iter().all(|p| p[0] <= 3.0 * peak), "g {g}");
        }
    });
}

/// Order 1 of a cube along an axis, the sun before or behind the eye: E p τ e^−τ or E p (1 − e^−2τ)/2 with the exact
/// peaks and troughs of the phase function, 2e-5 to 1.6e5 per steradian.
#[test]
fn phase_functions_of_every_width() {
    gpu_test(|ctx| {
        for (g, is_forward) in [(0.999f32, true), (0.999, false), (-0.999, true), (-0.999, false)] {
            let mut scene = homogeneous(unit_cube(4), 1.5, Vec3::ONE);
            scene.g = g;
            scene.lights.push(sun([if is_forward { -1.0 } else { 1.0 }, 0.0, 0.0]));
            scene.settings.orders = 1;
            aim(&mut scene, [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], [16, 16]);
            let (tau, g) = (1.5, f64::from(g));
            let cosine = if is_forward { 1.0 } else { -1.0 };
            let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5));
            let path_length = if is_forward { tau * f64::exp(-tau) } else { -(-2.0 * tau).exp_m1() / 2.0 };
            let expected = phase * path_length;
            for model in SCATTERING {
                let case = format!("g {g}, forward {is_forward}, {model:?}");
                // In an even body tracking finds a path's light whole or not at all: one sample varies by up to 1.4 of the
                // mean, 256 × 4096 by 1.4e-3.
                let spp = if model == Model::Path { 4096 } else { 16 };
                scene.settings.spp = spp;
                let seen = mean(&render_as(ctx, &scene, model, spp)).x;
                assert_relative(&case, seen, expected, 6e-3);
            }
        }
        // Nearly isotropic is isotropic, by other code: three more images per order, and order 1 of each delta light apart,
        // which makes another noise of order 2.
        for model in [Model::Single, Model::Multiple] {
            let mut scene = cloud();
            let isotropic = render_as(ctx, &scene, model, 0);
            for g in [1e-6, -1e-6] {
                scene.g = g;
                let image = render_as(ctx, &scene, model, 0);
                let (worst, most) =
                    (difference(&image, &isotropic, 0), if model == Model::Single { 2e-3 } else { 0.03 });
                assert!(worst < most, "{model:?}, g {g}: {worst}");
                assert_relative("mean", mean(&image).x, mean(&isotropic).x.into(), 5e-3);
            }
        }
    });
}

/// The k-th order of scattering goes with the k-th power of the albedo; black matter scatters nothing and is as opaque.
#[test]
fn orders_go_with_powers_of_the_albedo() {
    gpu_test(|ctx| {
        for model in [Model::Multiple, Model::Path] {
            let image = |albedo: Vec3, orders: u32| {
                let mut scene = homogeneous(unit_cube(5), 3.0, albedo);
                scene.lights.push(sun([0.6, 0.0, -0.8]));
                scene.environment = Some(Environment::Constant(Vec3::splat(0.3)));
                scene.settings.sampling = Sampling::Phase;
                scene.settings.size = [8, 8];
                scene.camera = look_at(DVec3::new(0.5, -1.5, 0.7), DVec3::splat(0.5), DVec3::Z, 40.0);
                scene.settings.orders = orders;
                mean(&render_as(ctx, &scene, model, 32)).as_dvec4()
            };
            // The same random numbers in every render of as many orders: exact polynomials of the albedo, of their degree and
            // without a constant, and as such their interpolation.
            let case = format!("{model:?}");
            let tolerance = if model == Model::Path { 1e-5 } else { 1e-3 };
            let [one, two, three] = [1, 2, 3].map(|orders| image(Vec3::new(1.0, 0.5, 0.25), orders));
            assert_relative(&case, one.y as f32, 0.5 * one.x, tolerance);
            assert_relative(&case, two.y as f32, two.z * 4.0 / 3.0 + two.x / 6.0, tolerance);
            let between = image(Vec3::new(1.0, 0.75, 0.0), 3);
            assert_relative(&case, between.y as f32, 0.25 * three.x + 1.5 * three.y - three.z, tolerance);
            assert_relative(&case, between.x as f32, three.x, 1e-6);
            assert_eq!(between.z, 0.0, "{case}");
            assert_relative(&case, between.w as f32, three.w, 1e-6);
            assert!(two.x > 1.1 * one.x && three.x > 1.05 * two.x, "{case}: {one} {two} {three}");
        }
    });
}

/// The unit cube in one voxel, in a line, in 3×5×7: opacity, and order 1 of a light from above (transport B-box0).
#[test]
fn any_number_of_voxels_is_the_same_box() {
    gpu_test(|ctx| {
        for dims in [[1, 1, 1], [1, 9, 1], [3, 5, 7]] {
            let spacing = dims.map(|n| 1.0 / f64::from(n));
            let grid = Grid::axis_aligned(dims, spacing, spacing.map(|s| 0.5 * s));
            let mut scene = homogeneous(grid, 1.0, Vec3::new(1.0, 0.5, 0.0));
            scene.lights.push(sun([0.0, -1.0, 0.0]));
            scene.settings.orders = 1;
            aim(&mut scene, [-1.0, 0.75, 0.5], [1.0, 0.0, 0.0], [16, 16]);
            for model in MODELS {
                scene.settings.spp = 16;
                let mut lit = scene.clone();
                if model == Model::Phong {
                    lit.lights = vec![sun([1.0, 0.0, 0.0])];
                    lit.camera.position.x = -1e3;
                }
                let seen = mean(&render_as(ctx, &lit, model, 1024));
                let case = format!("{dims:?}, {model:?}");
                let opacity = 1.0 - f64::exp(-1.0);
                if model == Model::Path {
                    assert_share(&case, seen.w.into(), opacity, 256.0 * 1024.0);
                } else {
                    assert_relative(&case, seen.w, opacity, 1e-5);
                }
                match model {
                    Model::Absorption => assert_relative(&case, seen.x, opacity, 2e-3),
                    // Without a gradient surfaces face the eye: colour and a quarter of highlight, over π.
                    Model::Phong => {
                        assert_relative(&case, seen.x, 1.25 / PI * opacity, 2e-3);
                        assert_relative(&case, seen.z, 0.25 / PI * opacity, 2e-3);
                    }
                    _ => {
                        assert_relative(&case, seen.x, 0.03917566983490719, 6e-3);
                        assert_relative(&case, seen.y, 0.5 * 0.03917566983490719, 6e-3);
                        assert_eq!(seen.z, 0.0, "{case}");
                    }
                }
            }
        }
    });
}

/// `path`: NaN is empty space, infinities are the ends of the scale: byte for byte the picture of finite values.
#[test]
fn scalars_that_are_no_numbers() {
    gpu_test(|ctx| {
        let picture = |nan: f32, most: f32, least: f32| {
            let mut values = random_values(12, 315);
            values.iter_mut().enumerate().for_each(|(i, v)| match i % 11 {
                0 => *v = nan,
                4 => *v = most,
                7 => *v = least,
                _ => {}
            });
            let mut scene = cloud();
            scene.volume_mut().data = VoxelData::F32(values);
            // Matter at the low end too, where NaN is stored.
            let first = scene.transfer.points[0];
            scene.transfer.points.insert(0, TransferPoint { value: -4.0, ..first });
            scene.transfer.points.insert(0, TransferPoint { value: -5.0, opacity: 0.2, ..first });
            render_as(ctx, &scene, Model::Path, 8)
        };
        let expected = picture(0.0, 10.0, -10.0);
        assert!(picture(f32::NAN, f32::INFINITY, f32::NEG_INFINITY) == expected);
        assert!(picture(0.0, 10.0, 10.0) != expected, "the values are seen");
    });
}

/// Between points ±3e38, whose difference no float holds, and at denormals, which devices may take for zero.
#[test]
fn scalars_of_every_magnitude() {
    gpu_test(|ctx| {
        let point = |value: f64, opacity: f32| TransferPoint { value, color: [1.0; 3], opacity, emission: [0.0; 3] };
        let ramp = |low: f64, high: f64| vec![point(low, 0.0), point(high, 4.0)];
        let tiny = f32::from_bits(1);
        for (points, value, least, most) in [
            (ramp(-3e38, 3e38), 0.0, 2.0, 2.0),
            (ramp(-3e38, 3e38), f32::MAX, 4.0, 4.0),
            (ramp(-3e38, 3e38), f32::NEG_INFINITY, 0.0, 0.0),
            (ramp(-3e38, 3e38), f32::INFINITY, 4.0, 4.0),
            (ramp(-1.0, 1.0), tiny, 2.0, 2.0),
            (ramp(-1.0, 1.0), -1e-40, 2.0, 2.0),
            // All of it within the denormals: some value of the function.
            (ramp(1e-40, 3e-40), 2e-40, 0.0, 4.0),
            (ramp(0.0, 1e-36), 0.5e-36, 2.0, 2.0),
        ] {
            let mut scene = homogeneous(unit_cube(2), 1.0, Vec3::ONE);
            let values: Vec<f64> = points.iter().map(|p| p.value).collect();
            scene.transfer.points = points;
            scene.volume_mut().data = VoxelData::F32(vec![value; 8]);
            aim(&mut scene, [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], [8, 8]);
            for model in [Model::Absorption, Model::Path] {
                let opacity = f64::from(mean(&render_as(ctx, &scene, model, 1024)).w);
                // 65,536 paths.
                let tolerance = if model == Model::Path { 4.0 * 0.5 / 256.0 } else { 1e-3 };
                let bounds = [1.0 - f64::exp(-least) - tolerance, 1.0 - f64::exp(-most) + tolerance];
                let case = format!("{value:e} between {values:?}, {model:?}");
                assert!(opacity >= bounds[0] && opacity <= bounds[1], "{case}: {opacity}, not in {bounds:?}");
            }
        }
    });
}

/// α = 1 is an optical depth of 16 ln 2 per unit distance; of a tent's three parts the middle one is matter.
#[test]
fn opaque_and_non_monotone_matter() {
    gpu_test(|ctx| {
        for model in MODELS {
            let opacity = |scene: &mut Scene, y: f64| {
                aim(scene, [-1.0, y, 0.5], [1.0, 0.0, 0.0], [8, 8]);
                f64::from(mean(&render_as(ctx, scene, model, 256)).w)
            };
            let mut scene = homogeneous(unit_cube(3), 1.0, Vec3::ONE);
            scene.lights.push(sun([1.0, 0.0, 0.0]));
            scene.transfer.opacity_unit = OpacityUnit::PerDistance(None);
            scene.transfer.points[1].opacity = 1.0;
            // The mean spacing is the unit: 2⁻⁴⁸ passes three voxels.
            assert_near(&format!("{model:?}, opaque"), opacity(&mut scene, 0.5) as f32, 1.0, 1e-3);
            // One voxel passes 2⁻¹⁶.
            scene.volume_mut().data = VoxelData::F32((0..27).map(|i| if i == 13 { 1.0 } else { 0.0 }).collect());
            assert!(opacity(&mut scene, 0.5) > 0.998, "{model:?}, one opaque voxel");

            let mut scene = homogeneous(unit_cube(3), 1.0, Vec3::ONE);
            scene.lights.push(sun([1.0, 0.0, 0.0]));
            let middle = TransferPoint { value: 0.5, opacity: 2.0, ..scene.transfer.points[0] };
            scene.transfer.points[1].opacity = 0.0;
            scene.transfer.points.insert(1, middle);
            for (value, expected) in [(0.0, 0.0), (0.25, 1.0 - f64::exp(-1.0)), (0.5, 1.0 - f64::exp(-2.0)), (1.0, 0.0)]
            {
                scene.volume_mut().data = VoxelData::F32(vec![value; 27]);
                let case = format!("{model:?}, tent at {value}");
                let got = opacity(&mut scene, 0.5);
                assert_share(&case, got, expected, if model == Model::Path { 64.0 * 256.0 } else { 1e9 });
            }
        }
    });
}

/// Within the plane between voxels and along the line where four meet; in the box's own faces and edges a ray is either
/// inside or outside. (An odd number of pixels has a middle one that looks exactly along the axis.)
#[test]
fn rays_within_faces_and_edges() {
    gpu_test(|ctx| {
        let full = 1.0 - f64::exp(-1.5);
        for model in MODELS {
            for (y, z, is_inside) in [(0.5, 0.3, true), (0.5, 0.5, true), (0.0, 0.3, false), (1.0, 0.0, false)] {
                let mut scene = homogeneous(unit_cube(2), 1.5, Vec3::ONE);
                scene.lights.push(sun([0.0, 0.0, -1.0]));
                scene.environment = Some(Environment::Constant(Vec3::ONE));
                aim(&mut scene, [-1.0, y, z], [1.0, 0.0, 0.0], [9, 9]);
                let picture = render_as(ctx, &scene, model, 256);
                let case = format!("{model:?}, y {y}, z {z}");
                let (got, samples) =
                    (f64::from(mean(&picture).w), if model == Model::Path { 81.0 * 256.0 } else { 1e9 });
                if is_inside {
                    assert_share(&case, got, full, samples);
                } else {
                    assert!(got < full + 0.02, "{case}: {got}");
                }
            }
        }
    });
}

/// Length of a ray within the grid's box.
fn length_inside(grid: &Grid, origin: DVec3, direction: DVec3) -> f64 {
    let to_index = grid.index_to_world.inverse();
    let (o, d) = (to_index.transform_point3(origin), to_index.transform_vector3(direction));
    let dims = DVec3::from(grid.dims.map(f64::from));
    let (a, b) = (-o / d, (dims - o) / d);
    (a.max(b).min_element() - a.min(b).max_element().max(0.0)).max(0.0)
}

/// Opacity of every pixel of a homogeneous box of voxels 1:1:20.
#[test]
fn cameras_inside_far_away_and_wide() {
    gpu_test(|ctx| {
        let middle = DVec3::new(300.0, 400.0, 2000.0);
        for (name, offset, fov) in [
            ("inside", DVec3::new(20.0, -33.0, 101.0), 90.0),
            ("inside, wide", DVec3::new(20.0, -33.0, 101.0), 170.0),
            ("before it", DVec3::new(-900.0, 30.0, 500.0), 1.0),
            ("before it, wide", DVec3::new(-400.0, 30.0, 500.0), 170.0),
            ("far away", DVec3::new(0.6e6, 0.0, 0.8e6), 1.0),
            ("far away, narrow", DVec3::new(0.6e6, 0.0, 0.8e6), 0.1),
        ] {
            let grid = Grid::axis_aligned([6, 8, 2], [100.0, 100.0, 2000.0], [50.0, 50.0, 1000.0]);
            let mut scene = homogeneous(grid, 1e-3, Vec3::ONE);
            scene.lights.push(sun([1.0, 0.0, 0.0]));
            scene.camera = look_at(middle + offset, middle - 0.01 * offset, DVec3::Z, fov);
            scene.settings.size = [16, 16];
            let opacity = |x: f64, y: f64| {
                let direction = scene.camera.ray(x, y, scene.settings.size);
                -(-1e-3 * length_inside(&grid, scene.camera.position, direction)).exp_m1()
            };
            for model in [Model::Absorption, Model::Single] {
                let picture = render_as(ctx, &scene, model, 0);
                for (i, p) in picture.pixels.iter().enumerate() {
                    let expected = opacity((i % 16) as f64 + 0.5, (i / 16) as f64 + 0.5);
                    // Rounding of 1e6 moves the far ray by 0.06 units of 1000.
                    assert_near(&format!("{name}, {model:?}, pixel {i}"), p[3], expected, 1e-3 + 1e-3 * expected);
                }
            }
            let fine = 8;
            let points = (0..(16 * fine) * (16 * fine)).map(|i| {
                let place = |k: u32| (f64::from(k) + 0.5) / f64::from(fine);
                opacity(place(i % (16 * fine)), place(i / (16 * fine)))
            });
            let expected = points.sum::<f64>() / f64::from(256 * fine * fine);
            let got = f64::from(mean(&render_as(ctx, &scene, Model::Path, 256)).w);
            // 65,536 paths; and the grid of points that stands for the integral over the box's edges.
            assert!((got - expected).abs() < 0.008, "{name}: path {got} instead of {expected}");
            assert!(expected > 3e-4, "{name}: nothing to see");
        }
    });
}

/// A light from below is a light from above, turned over; a light in a voxel and at its centre is cut off at half a
/// voxel in every model alike.
#[test]
fn lights_inside_and_below() {
    gpu_test(|ctx| {
        for model in [Model::Phong, Model::Single, Model::Multiple] {
            let picture = |sign: f64| {
                let mut scene = homogeneous(unit_cube(5), 3.0, Vec3::ONE);
                scene.lights.push(sun([0.0, 0.6, -0.8 * sign]));
                scene.settings.sampling = Sampling::Phase;
                scene.settings.directions = 128;
                scene.settings.orders = 2;
                scene.settings.spp = 64;
                let eye = DVec3::new(0.5, -1.5, 0.5 + 0.4 * sign);
                scene.camera = look_at(eye, DVec3::splat(0.5), DVec3::Z, 40.0);
                scene.settings.size = [16, 16];
                render_as(ctx, &scene, model, 0)
            };
            // Random numbers are not mirrored, so quarters of the picture's height are compared, not pixels.
            let quarters = |picture: Picture| {
                let quarter = |rows: &[[f32; 4]]| rows.iter().map(|p| p[0]).sum::<f32>() / rows.len() as f32;
                picture.pixels.chunks(64).map(quarter).collect::<Vec<_>>()
            };
            let (above, mut below) = (quarters(picture(1.0)), quarters(picture(-1.0)));
            let case = format!("{model:?}: {above:?}, {below:?}");
            below.reverse();
            assert!(above.iter().zip(&below).all(|(a, b)| (a / b - 1.0).abs() < 0.01), "{case}");
            assert!(above[1] > 0.01 && (above[1] / above[2] - 1.0).abs() > 0.05, "{case}");
        }
        for position in [DVec3::splat(0.5), DVec3::new(0.47, 0.52, 0.55)] {
            let mut scene = homogeneous(unit_cube(5), 3.0, Vec3::ONE);
            scene.lights.push(Light::Point { position, intensity: Vec3::ONE });
            scene.settings.orders = 1;
            scene.settings.spp = 64;
            scene.settings.size = [16, 16];
            scene.camera = look_at(DVec3::new(0.5, -1.5, 0.9), DVec3::splat(0.5), DVec3::Z, 40.0);
            let single = mean(&render_as(ctx, &scene, Model::Single, 0)).x;
            scene.settings.model = Model::Path;
            let traced = trace(ctx, &scene, 4096);
            let (expected, error) = (traced.mean[0], traced.mean_error[0]);
            // 256 × 64 stratified depths leave as much noise as is allowed for here again.
            assert!(error < 0.005 * expected, "{position}: {error} of {expected}");
            assert_near(&format!("light at {position}"), single, expected, 4.0 * error + 0.02 * expected);
        }
    });
}

/// No light: black. 64 lights of a 64th of the power at one place: as one.
#[test]
fn many_lights_are_as_bright_as_their_sum() {
    gpu_test(|ctx| {
        for model in [Model::Phong, Model::Single, Model::Multiple, Model::Path] {
            let picture = |count: usize| {
                let mut scene = cloud();
                scene.environment = None;
                scene.transfer.points.iter_mut().for_each(|p| p.emission = [0.0; 3]);
                let light = Light::Directional {
                    direction: DVec3::new(0.6, 0.0, -0.8),
                    irradiance: Vec3::new(64.0, 32.0, 16.0) / count.max(1) as f32,
                };
                scene.lights = vec![light; count];
                render_as(ctx, &scene, model, 16)
            };
            let none = picture(0);
            assert!(none.pixels.iter().all(|p| p[..3] == [0.0; 3]), "{model:?}: {}", mean(&none));
            assert!(none.pixels.iter().any(|p| p[3] > 0.5), "{model:?}: nothing there");
            let worst = difference(&picture(64), &picture(1), 0);
            assert!(worst < 3e-3, "{model:?}: {worst}");
        }
    });
}

/// An environment of radiance 0.1 with a sun of 1e5 in one of 512 texels: `multiple` as `path`, and seen directly
/// through the empty part of the volume it is 1e5.
#[test]
fn a_sun_in_the_environment() {
    gpu_test(|ctx| {
        let (width, height) = (32, 16);
        let mut pixels = vec![[0.1; 3]; 512];
        pixels[4 * 32 + 21] = [1e5, 5e4, 2e4];
        let sky = LatLong { width, height, pixels, rotation_degrees: 10.0 };
        let mut scene = homogeneous(unit_cube(8), 2.0, Vec3::splat(0.9));
        scene.environment = Some(Environment::LatLong(sky));
        scene.settings.orders = 3;
        scene.settings.size = [16, 16];
        scene.settings.environment_directions = 64;
        scene.camera = look_at(DVec3::new(0.5, -1.5, 0.9), DVec3::splat(0.5), DVec3::Z, 30.0);
        let cached = mean(&render_as(ctx, &scene, Model::Multiple, 0));
        scene.settings.model = Model::Path;
        let traced = trace(ctx, &scene, 512);
        for c in 0..3 {
            let (expected, error) = (traced.mean[c], traced.mean_error[c]);
            assert!(error < 0.005 * expected, "{error} of {expected}");
            assert_near(&format!("channel {c}"), cached[c], expected, 4.0 * error + 0.03 * expected);
        }
        // The sun's texel: rows have 11.25°; azimuth 0 is the middle column, so 5.5 columns to its right, turned back.
        let (polar, azimuth) = ((4.5f64 * 11.25).to_radians(), (5.5f64 * 11.25 - 10.0).to_radians());
        let towards = DVec3::new(polar.sin() * azimuth.sin(), polar.sin() * azimuth.cos(), polar.cos());
        scene.background = Background::Environment;
        scene.camera = look_at(DVec3::splat(10.0), DVec3::splat(10.0) + towards, DVec3::Z, 1.0);
        scene.settings.size = [4, 4];
        for model in [Model::Multiple, Model::Path] {
            let picture = render_as(ctx, &scene, model, 8);
            let is_sun = |p: &[f32; 4]| (p[0] / 1e5 - 1.0).abs() < 1e-6 && (p[2] / 2e4 - 1.0).abs() < 1e-6;
            assert!(picture.pixels.iter().all(is_sun), "{model:?}: {:?}", picture.pixels[0]);
        }
    });
}

/// All that shines times 1e5, 1e30 and 1e-12: the picture times as much. Fields are half floats, whose range must follow
/// the light up and down; the sums of `path` are single precision.
#[test]
fn brightness_is_linear_in_the_light() {
    gpu_test(|ctx| {
        for model in [Model::Phong, Model::Single, Model::Multiple, Model::Path] {
            let picture = |factor: f32| {
                let mut scene = cloud();
                scene.emission_scale = factor;
                for light in &mut scene.lights {
                    let (Light::Directional { irradiance: power, .. } | Light::Point { intensity: power, .. }) = light;
                    *power *= factor;
                }
                if let Some(Environment::LatLong(sky)) = &mut scene.environment {
                    sky.pixels.iter_mut().flatten().for_each(|c| *c *= factor);
                }
                scene.background = Background::Environment;
                let mut picture = render_as(ctx, &scene, model, 8);
                picture.pixels.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] /= factor));
                picture
            };
            let expected = picture(1.0);
            for factor in [1e5, 1e30, 1e-12] {
                // Half floats are cut off at other places (2⁻¹⁰); random decisions of `path` hang on no brightness but
                // through the rounding of the sky's table.
                let (tolerance, outliers) = if model == Model::Path { (1e-5, 2) } else { (3e-3, 0) };
                let worst = difference(&picture(factor), &expected, outliers);
                assert!(worst < tolerance, "{model:?}, times {factor:e}: {worst}");
            }
        }
        // A background that lights nothing, far brighter and far darker than anything else.
        for model in MODELS {
            for radiance in [1e36, 1e-30] {
                let mut scene = cloud();
                scene.transfer = matter(0.0, Vec3::ONE, Vec3::ZERO);
                scene.background = Background::Color(Vec3::splat(radiance));
                let picture = render_as(ctx, &scene, model, 4);
                let is_right = |p: &[f32; 4]| (p[0] / radiance - 1.0).abs() < 1e-6;
                assert!(picture.pixels.iter().all(is_right), "{model:?}: {:?}", picture.pixels[0]);
            }
        }
    });
}

/// The range of fields follows the light; where it would leave single precision, there is an error and no picture.
#[test]
fn light_beyond_single_precision_is_refused() {
    gpu_test(|ctx| {
        for model in [Model::Phong, Model::Single, Model::Multiple, Model::Path] {
            let mut scene = cloud();
            scene.settings.model = model;
            scene.g = 0.999;
            scene.lights = vec![Light::Directional { direction: DVec3::X, irradiance: Vec3::splat(3e38) }; 64];
            let result = render::render(ctx, &scene, &mut |_| ControlFlow::Continue(()));
            let text = result.map(|_| ()).expect_err("a refusal").to_string();
            assert!(text.contains("beyond the range of 32-bit floats") && text.contains("cure: scale"), "{text}");
        }
    });
}

/// One pixel, and a row of 8192 (at a vertical field of view of 0.02°, 114° wide).
#[test]
fn pictures_of_one_pixel_and_of_one_row() {
    gpu_test(|ctx| {
        let mut scene = homogeneous(unit_cube(3), 2.0, Vec3::ONE);
        scene.lights.push(sun([1.0, 0.0, 0.0]));
        for model in MODELS {
            aim(&mut scene, [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], [1, 1]);
            let one = render_as(ctx, &scene, model, 1 << 14);
            assert_eq!(one.pixels.len(), 1);
            let samples = if model == Model::Path { f64::from(1 << 14) } else { 1e9 };
            assert_share(&format!("{model:?}"), one.pixels[0][3].into(), 1.0 - f64::exp(-2.0), samples);

            scene.camera = look_at(DVec3::new(-1.0, 0.4, 0.6), DVec3::new(0.0, 0.4, 0.6), DVec3::Z, 0.02);
            scene.settings.size = [8192, 1];
            let row = render_as(ctx, &scene, model, 4);
            let opacity = |x: usize| {
                let direction = scene.camera.ray(x as f64 + 0.5, 0.5, scene.settings.size);
                -(-2.0 * length_inside(&scene.volume.grid, scene.camera.position, direction)).exp_m1()
            };
            if model == Model::Path {
                // Eighths of the row: 4096 paths each.
                for part in 0..8 {
                    let range = 1024 * part..1024 * (part + 1);
                    let got = row.pixels[range.clone()].iter().map(|p| f64::from(p[3])).sum::<f64>() / 1024.0;
                    let expected = range.map(opacity).sum::<f64>() / 1024.0;
                    assert_share(&format!("path, part {part}"), got, expected, 4096.0);
                }
            } else {
                for (x, p) in row.pixels.iter().enumerate() {
                    assert_near(&format!("{model:?}, pixel {x}"), p[3], opacity(x), 1e-3);
                }
            }
        }
    });
}

/// 47.7 million voxels, most of them empty, flown through by paths: opacity of a box within.
#[test]
#[ignore = "long: 512×512×182 voxels; scripts/test --full"]
fn path_through_a_large_volume() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([512, 512, 182], [1.0; 3], [0.5; 3]);
        let mut scene = homogeneous(Grid::axis_aligned([1, 1, 1], [1.0; 3], [0.0; 3]), 0.01, Vec3::ONE);
        scene.volume_mut().grid = grid;
        let is_inside = |i: usize| (100..400).contains(&(i % 512)) && (i / 512 % 512) < 300;
        scene.volume_mut().data = VoxelData::U8((0..grid.voxels() as usize).map(|i| u8::from(is_inside(i))).collect());
        aim(&mut scene, [-50.0, 150.0, 90.0], [1.0, 0.0, 0.0], [16, 16]);
        let got = f64::from(mean(&render_as(ctx, &scene, Model::Path, 256)).w);
        assert_share("along x", got, 1.0 - f64::exp(-3.0), 65536.0);
    });
}
