//! Further views of a scene that is set up: what light is reused, and that its pictures are those of a fresh start.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/transport.rs"]
mod transport;

use std::ops::ControlFlow;
use transport::mean;
use tyndall::output::Picture;
use tyndall::render::{Internals, Renderer};
use tyndall::scene::camera::{Framing, frame};
use tyndall::scene::{Camera, Environment, LightFor, Model, Scene};
use tyndall::vk::{Context, Validation};

const SEED: u64 = 3;

/// Runs `body` on a device, but not under GPU-assisted validation, as in tests/analytic.rs.
fn gpu_test(body: impl FnOnce(&Context)) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP whole renders under GPU-assisted validation");
    } else {
        common::gpu_test(body);
    }
}

/// Half of the box is hidden from either.
fn views(scene: &Scene) -> [Camera; 2] {
    [20.0, 110.0].map(|azimuth| {
        let framing = Framing { azimuth, elevation: 15.0, ..Framing::default() };
        frame(&scene.volume.grid, &framing, scene.settings.size)
    })
}

/// A dense random body under a sky, a directional and a point light, glowing; little of it is visible.
fn body(g: f32, light_for: LightFor) -> Scene {
    let mut scene = bodies::cloud([10, 8]);
    scene.g = g;
    scene.density_scale = 8.0;
    scene.settings.light_for = light_for;
    scene.settings.spp = 2;
    scene.settings.directions = 6;
    scene.settings.candidates = 12;
    scene.settings.environment_directions = 12;
    scene.views = views(&scene).to_vec();
    scene.camera = scene.views[0];
    scene
}

/// Passes of the latest picture.
fn passes(renderer: &Renderer<'_>, scene: &Scene) -> Vec<String> {
    let mut names: Vec<_> = renderer.stats(scene, 0.0).unwrap().passes.into_iter().map(|p| p.name).collect();
    names.dedup();
    names
}

fn going_on(_: tyndall::render::Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The picture of the second view after that of the first, and of a fresh start, with the passes of the former.
fn second_view(ctx: &Context, scene: &Scene) -> ([Picture; 2], Vec<String>) {
    let mut renderer = Renderer::new(ctx, scene, Internals::default()).unwrap();
    let first = renderer.render(SEED, &mut going_on).unwrap();
    let [a, b] = views(scene);
    renderer.look(&b).unwrap();
    let second = renderer.picture(&mut going_on).unwrap();
    assert_ne!(first, second, "both eyes see the same");
    let names = passes(&renderer, scene);
    // And back.
    renderer.look(&a).unwrap();
    assert_eq!(renderer.picture(&mut going_on).unwrap(), first, "the first view, again");
    let fresh = Scene { camera: b, ..scene.clone() };
    let fresh = Renderer::new(ctx, &fresh, Internals::default()).unwrap().render(SEED, &mut going_on).unwrap();
    ([second, fresh], names)
}

#[test]
fn light_for_every_view_is_computed_once() {
    gpu_test(|ctx| {
        let all = vec![(0.5, Model::Multiple), (0.0, Model::Multiple), (-0.4, Model::Single), (0.0, Model::Single)];
        for (g, model) in all {
            for (what, keeps) in [("all light", 2), ("delta lights", 1), ("sky and glow", 0)] {
                for knows_views in [true, false] {
                    let mut scene = body(g, LightFor::EveryView);
                    scene.settings.model = model;
                    if !knows_views {
                        scene.views.clear();
                    }
                    match keeps {
                        0 => scene.lights.clear(),
                        1 => (scene.environment, scene.emission_scale) = (None, 0.0),
                        _ => {}
                    }
                    let case = format!("{model:?}, g {g}, {what}, views known: {knows_views}");
                    let ([second, fresh], passes) = second_view(ctx, &scene);
                    assert_eq!(passes, ["camera"], "{case}");
                    assert!(second == fresh, "{case}: other bytes than from a fresh start");
                    assert!(second.pixels.iter().any(|p| p[0] > 0.0), "{case}: dark");
                }
            }
        }
    });
}

/// Light for one view is computed anew where it depends on the eye, and only there.
#[test]
fn light_for_one_view_is_reused_where_it_does_not_depend_on_the_eye() {
    gpu_test(|ctx| {
        let all = vec![
            (Model::Multiple, 0.0, 0.25, false),
            (Model::Multiple, 0.0, 1.0, true),
            (Model::Multiple, 0.5, 1.0, false),
            (Model::Absorption, 0.0, 0.25, true),
            (Model::Phong, 0.0, 0.25, false),
        ];
        for (model, g, hidden_share, is_reused) in all {
            let mut scene = body(g, LightFor::View);
            (scene.settings.model, scene.settings.hidden_share) = (model, hidden_share);
            let case = format!("{model:?}, g {g}, share {hidden_share}");
            let ([second, fresh], passes) = second_view(ctx, &scene);
            assert_eq!(passes == ["camera"], is_reused, "{case}: {passes:?}");
            assert!(second == fresh, "{case}: other bytes than from a fresh start");
        }
    });
}

/// What one of the known views sees is hidden from none: more cells than either sees get all directions, and every cell where
/// no view is known.
#[test]
fn cells_that_any_view_sees_get_their_share() {
    gpu_test(|ctx| {
        let cells = |views: &[Camera]| {
            let mut scene = body(0.0, LightFor::EveryView);
            scene.views = views.to_vec();
            scene.density_scale = 500.0;
            let mut renderer = Renderer::new(ctx, &scene, Internals::default()).unwrap();
            renderer.render(SEED, &mut going_on).unwrap();
            renderer.listed_cells()
        };
        let all = views(&body(0.0, LightFor::EveryView));
        let [seen, hidden, remote] = cells(&all[..1]);
        let [other, ..] = cells(&all[1..]);
        let [both, rest, of_none] = cells(&all);
        assert!(both > seen.max(other) && both <= seen + other, "{seen} and {other} cells, together {both}");
        assert!(remote > of_none, "{remote} cells are out of one eye's reach, {of_none} out of that of two");
        let count = seen + hidden + remote;
        assert_eq!(both + rest + of_none, count);
        assert_eq!(cells(&[]), [count, 0, 0]);
    });
}

/// Another eye than those that were named may come near any cell: for it light is computed in all of them, whatever there was
/// before.
#[test]
fn an_eye_that_was_not_expected_sees_light_everywhere() {
    gpu_test(|ctx| {
        let mut scene = body(0.0, LightFor::EveryView);
        scene.views.truncate(1);
        scene.density_scale = 500.0;
        let mut renderer = Renderer::new(ctx, &scene, Internals::default()).unwrap();
        renderer.render(SEED, &mut going_on).unwrap();
        assert!(renderer.listed_cells()[2] > 0, "every cell is near what the eye reaches");
        let ([second, fresh], passes) = second_view(ctx, &scene);
        assert_ne!(passes, ["camera"]);
        assert!(second == fresh, "other bytes than from a fresh start");
        let everywhere = Internals { gathers_everywhere: true, ..Internals::default() };
        let scene = Scene { camera: views(&scene)[1], ..scene };
        let all = Renderer::new(ctx, &scene, everywhere).unwrap().render(SEED, &mut going_on).unwrap();
        assert!(second == all, "cells are left out");
    });
}

/// Isotropic media store the same for one view and for every view, but for the shares; others nearly the same on average.
#[test]
fn light_for_every_view_is_nearly_that_for_one() {
    gpu_test(|ctx| {
        let picture = |g: f32, light_for: LightFor| {
            let mut scene = body(g, light_for);
            scene.settings.hidden_share = 1.0;
            (scene.settings.directions, scene.settings.environment_directions) = (64, 64);
            scene.settings.candidates = 64;
            scene.density_scale = 1.0;
            scene.environment = Some(Environment::Constant(glam::Vec3::ONE));
            Renderer::new(ctx, &scene, Internals::default()).unwrap().render(SEED, &mut going_on).unwrap()
        };
        assert_eq!(picture(0.0, LightFor::View), picture(0.0, LightFor::EveryView));
        for g in [0.4, -0.4] {
            let (one, every) = (picture(g, LightFor::View), picture(g, LightFor::EveryView));
            let off = ((mean(&every) - mean(&one)) / mean(&one)).abs().max_element();
            println!("g {g}: mean off by {off}");
            assert!(off > 0.0 && off < 0.02, "g {g}: {off}");
        }
    });
}
