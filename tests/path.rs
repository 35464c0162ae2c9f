//! The path tracer against closed forms, its CPU twin, and its own word on its errors.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/transport.rs"]
mod transport;

use bodies::{assert_nearly_all_close, cases, scenes};
use common::gpu_test;
use glam::{DVec4, Vec3, Vec4};
use std::ops::ControlFlow;
use transport::{SLAB_REFLECTED, aim, slab, sun};
use tyndall::cpu::path::PathScene;
use tyndall::cpu::scene::HostScene;
use tyndall::cpu::texture::Texture;
use tyndall::passes::path::PathConfig;
use tyndall::render::path::PathRender;
use tyndall::scene::{Background, Environment, Light, Model, Scene, UNLIMITED};
use tyndall::shaders::constants::CELL_SIZE;
use tyndall::vk::Context;
use tyndall::{cpu, render};

fn config(scene: &Scene) -> PathConfig {
    let is_unlimited = scene.settings.orders == UNLIMITED;
    PathConfig { orders: if is_unlimited { scene.settings.max_events } else { scene.settings.orders }, is_unlimited }
}

/// Checks what paths fly through, and the mean of `spp` paths per pixel, against the twin.
fn check(ctx: &Context, name: &str, scene: &Scene) {
    let render = &mut PathRender::new(ctx, scene).unwrap();
    let host = HostScene::new(scene);
    let extinction = cpu::path::extinction(&host);
    // The occupancy's twin reads a field's fourth component.
    let field = extinction.texels.iter().map(|&e| Vec4::splat(e)).collect();
    let occupancy = cpu::emptiness::occupancy(&host.params, &Texture::new(host.params.dims, field), CELL_SIZE);
    let majorants = cpu::path::majorant(&extinction, &cpu::emptiness::distance(&occupancy));
    let close = |got: &[f32], expected: &[f32], what: &str| {
        let is_wrong = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-5 * b.abs();
        let wrong = got.iter().zip(expected).filter(|&pair| is_wrong(pair)).count();
        assert!(got.len() == expected.len() && wrong == 0, "{name}: {wrong} of {} {what} are wrong", expected.len());
    };
    close(&ctx.read_back_image(render.tracer().extinction()).unwrap(), &extinction.texels, "extinctions");
    close(&ctx.read_back_image(render.tracer().majorants()).unwrap(), &majorants.texels, "majorants");

    let samples = scene.settings.spp;
    render.advance(samples, &mut |_| ControlFlow::Continue(())).unwrap();
    let got = render.sums().unwrap().estimate(scene.settings.size).picture;
    let paths = PathScene { scene: &host, background: scene.background, config: config(scene), extinction, majorants };
    let [width, height] = scene.settings.size;
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    let mean = |pixel| (0..samples).map(|i| paths.path(pixel, i).as_dvec4()).sum::<DVec4>() / f64::from(samples);
    let expected: Vec<Vec4> = pixels.map(|pixel| mean(pixel).as_vec4()).collect();
    let got: Vec<Vec4> = got.pixels.iter().map(|&p| Vec4::from(p)).collect();
    // A path whose random decision hangs on the last bit of a logarithm goes another way: few pixels have one.
    assert_nearly_all_close(name, &got, &expected, 1e-3, 1e-4, 2);
}

/// All kinds of volume, light, background, phase function and end of paths.
#[test]
fn paths_agree_with_the_twin() {
    gpu_test(|ctx| {
        let behind = [Background::Transparent, Background::Environment, Background::Color(Vec3::new(1.0, 2.0, 3.0))];
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            scene.settings.model = Model::Path;
            scene.settings.spp = 8;
            for (k, (g, orders)) in cases(vec![(0.0, 1), (0.6, 4), (-0.9, UNLIMITED)]).into_iter().enumerate() {
                scene.g = g;
                scene.settings.orders = orders;
                scene.background = behind[(i + k) % 3];
                check(ctx, &format!("{name}, g {g}, orders {orders}"), &scene);
            }
            let lights = std::mem::take(&mut scene.lights);
            check(ctx, &format!("{name}, sky only"), &scene);
            (scene.lights, scene.environment) = (lights, None);
            check(ctx, &format!("{name}, lights only"), &scene);
            scene.environment = Some(Environment::Constant(Vec3::new(0.5, 1.0, 2.0)));
            check(ctx, &format!("{name}, lights and a constant sky"), &scene);
            // What the kernel leaves out: the transfer function's search, distances to lights.
            scene.lights.retain(|light| matches!(light, Light::Directional { .. }));
            for point in &mut scene.transfer.points {
                (point.color, point.emission) = ([0.9, 0.5, 0.2], [0.0; 3]);
            }
            check(ctx, &format!("{name}, one albedo, directional lights"), &scene);
        }
    });
}

/// A loop budget that ends amid paths, and rounds of any size, change no byte.
#[test]
fn interruptions_change_no_byte() {
    gpu_test(|ctx| {
        let scene = &mut scenes().remove(0).1;
        scene.settings.model = Model::Path;
        scene.settings.orders = 6;
        scene.density_scale = 20.0;
        let sums = |rounds: &[u32], budget: Option<u32>| {
            let mut render = PathRender::new(ctx, scene).unwrap();
            if let Some(budget) = budget {
                render.fix_budget(budget);
            }
            for &round in rounds {
                render.advance(round, &mut |_| ControlFlow::Continue(())).unwrap();
            }
            render.sums().unwrap()
        };
        let whole = sums(&[40], None);
        assert_eq!(whole.samples, 40);
        assert!(whole == sums(&[40], Some(1)), "the least budget per dispatch");
        assert!(whole == sums(&[1, 16, 3, 20], Some(300)), "rounds");
        assert!(whole != sums(&[39], None), "a sample less");
    });
}

/// A sum of 100,000 samples is exact to single precision, as one of 64 is.
#[test]
fn long_sums_lose_nothing() {
    gpu_test(|ctx| {
        let mut scene = slab(1.0, 1.0, Vec3::ONE);
        scene.density_scale = 0.0;
        scene.background = Background::Color(Vec3::new(0.1, 1e-3, 7.7));
        scene.settings.size = [8, 8];
        let mut render = PathRender::new(ctx, &scene).unwrap();
        render.advance(100_000, &mut |_| ControlFlow::Continue(())).unwrap();
        let sums = render.sums().unwrap();
        assert!(sums.value[1].iter().any(|low| low[0] != 0.0), "the low part is at work");
        for (expected, c) in [(0.1f32, 0), (1e-3, 1), (7.7, 2)] {
            let got = sums.estimate([8, 8]).picture.pixels[13][c];
            // Scaling to the fields' unit and back rounds once each.
            assert!((got / expected - 1.0).abs() < 2e-7, "{got} {expected}");
        }
    });
}

/// Order 1 to 4 of a slab (transport C-orders-tau1-g0, μ = μ₀ = 1), 400 seeds: means are off by their own standard errors
/// as often as a normal distribution says, and the mean of all is right.
#[test]
fn errors_are_as_large_as_they_say() {
    const SEEDS: u32 = 400;
    let truth: f64 = SLAB_REFLECTED.iter().sum();
    gpu_test(|ctx| {
        let mut scene = slab(1.0, 1000.0, Vec3::ONE);
        scene.lights.push(sun([0.0, 0.0, -1.0]));
        aim(&mut scene, [0.0, 0.0, 2.0], [0.0, 0.0, -1.0], [32, 32]);
        scene.settings.orders = 4;
        let mut render = PathRender::new(ctx, &scene).unwrap();
        let z: Vec<f64> = (0..SEEDS)
            .map(|seed| {
                render.restart(seed.into()).unwrap();
                render.advance(4, &mut |_| ControlFlow::Continue(())).unwrap();
                let e = render.sums().unwrap().estimate(scene.settings.size);
                (e.mean[0] - truth) / e.mean_error[0]
            })
            .collect();
        let share = |limit: f64| z.iter().filter(|z| z.abs() < limit).count() as f64 / f64::from(SEEDS);
        // Standard errors of the shares: 2.3, 1.0 and 0.26 %.
        for (limit, expected, tolerance) in [(1.0, 0.683, 0.09), (2.0, 0.954, 0.04), (3.0, 0.9973, 0.01)] {
            assert!((share(limit) - expected).abs() < tolerance, "|z| < {limit}: {} of {expected}", share(limit));
        }
        let mean = z.iter().sum::<f64>() / f64::from(SEEDS).sqrt();
        assert!(mean.abs() < 4.0, "the mean of all seeds is {mean} standard errors off");
    });
}

/// Stops at the error asked for, which independent seeds confirm.
#[test]
fn target_error_is_met() {
    gpu_test(|ctx| {
        let mut scene = slab(1.0, 1000.0, Vec3::ONE);
        scene.lights.push(sun([0.0, 0.0, -1.0]));
        aim(&mut scene, [0.0, 0.0, 2.0], [0.0, 0.0, -1.0], [16, 16]);
        (scene.settings.spp, scene.settings.target_error) = (1 << 20, Some(0.05));
        let mut deviations = Vec::new();
        for seed in 0..8 {
            scene.settings.seed = seed;
            let (picture, stats) = render::path::render(ctx, &scene, None, &mut |_| ControlFlow::Continue(())).unwrap();
            let path = stats.path.unwrap();
            assert!(path.noise <= 0.05 && path.noise > 0.03 && path.samples < 4000, "{path:?}");
            let mean = path.mean[0];
            deviations.extend(picture.pixels.iter().map(|p| (f64::from(p[0]) / mean - 1.0).powi(2)));
        }
        // All pixels see the same: their spread is the noise.
        let spread = (deviations.iter().sum::<f64>() / deviations.len() as f64).sqrt();
        assert!((spread - 0.047).abs() < 0.008, "{spread}");
    });
}
