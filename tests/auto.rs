//! The sampling `auto`: it decides by its pilot and the device's costs alone, right, and to the same bytes.

mod common;
#[path = "common/place.rs"]
mod place;
#[path = "common/scenes.rs"]
mod scenes;

use common::{assert_silent, context_with_cache, gpu_test, one_at_a_time};
use place::Place;
use scenes::{scene_of, volume_of};
use std::ops::ControlFlow;
use tyndall::output::Picture;
use tyndall::render::auto::{Costs, FREE_PILOT, USUAL_COSTS};
use tyndall::render::{Internals, Renderer};
use tyndall::scene::{Sampling, Scene};
use tyndall::stats::Stats;
use tyndall::vk::Context;

/// A smooth blob, seen whole. `density`: optical depth through its middle. `light`: lines of the scene file.
fn scene(sampling: &str, density: f32, light: &str, render: &str) -> Scene {
    sized_scene(20, 3, sampling, density, light, render)
}

fn sized_scene(edge: u32, orders: u32, sampling: &str, density: f32, light: &str, render: &str) -> Scene {
    let value = |i: u32| {
        let half = 0.5 * edge as f32;
        let [x, y, z] = [i % edge, i / edge % edge, i / (edge * edge)].map(|v| (v as f32 + 0.5) / half - 1.0);
        (1.0 - (x * x + y * y + z * z)).max(0.0)
    };
    let toml = format!(
        r#"
        {light}
        [transfer]
        convention = "extinction"
        points = [
            {{ value = 0, color = [1, 1, 1], opacity = 0 }},
            {{ value = 1, color = [1, 1, 1], opacity = {opacity} }},
        ]
        [render]
        size = [16, 16]
        spp = 2
        orders = {orders}
        hidden_share = 1
        sampling = "{sampling}"
        {render}
        "#,
        opacity = 1.5 * density / edge as f32,
    );
    scene_of(&toml, volume_of([edge; 3], (0..edge.pow(3)).map(value).collect()))
}

const SUN: &str = "[[light]]\nazimuth = -60\nelevation = 35\nirradiance = 10";
const FLAT: &str = "[environment]\nradiance = 1";
/// Long rays of many short steps in a thin medium: what the proxy is good at.
const FINE: &str = "directions = 8\ngather_step = 0.1\nproxy_step = 1\nmask = 8";

fn render(ctx: &Context, scene: &Scene) -> (Picture, Stats) {
    render_with(ctx, scene, Internals::default())
}

/// Where there is always a pilot.
fn render_with_pilot(ctx: &Context, scene: &Scene) -> (Picture, Stats) {
    render_with(ctx, scene, Internals { costs: Some(FREE_PILOT), ..Internals::default() })
}

fn render_with(ctx: &Context, scene: &Scene, internals: Internals) -> (Picture, Stats) {
    let mut renderer = Renderer::new(ctx, scene, internals).unwrap();
    let picture = renderer.render(scene.settings.seed, &mut |_| ControlFlow::Continue(())).unwrap();
    let stats = renderer.stats(scene, 0.0).unwrap();
    (picture, stats)
}

#[test]
fn flat_light_is_left_to_phase() {
    gpu_test(|ctx| {
        for (light, density) in [(FLAT, 8.0), (SUN, 8.0), (FLAT, 0.5)] {
            let (picture, stats) = render_with_pilot(ctx, &scene("auto", density, light, ""));
            let auto = stats.auto.as_ref().expect("what auto decided");
            assert_eq!((auto.sampling, auto.candidates, auto.directions), (Sampling::Phase, 0, 48), "{auto:?}");
            let pilot = auto.pilot.as_ref().expect("what the pilot found");
            assert!(
                pilot.phase_variance > 0.0 && pilot.proxy_cost > 0.0 && pilot.residual_cost > pilot.phase_cost,
                "{auto:?}"
            );
            // The first look told the pilot's steps.
            assert!((auto.traced_steps / pilot.traced_steps - 1.0).abs() < 0.15, "{auto:?}");
            // The pilot leaves nothing behind: the same bytes, and a proxy for its own order only.
            let (phase, _) = render(ctx, &scene("phase", density, light, ""));
            assert!(picture == phase, "not the picture of phase: {auto:?}");
            let built: Vec<_> = stats.proxy.iter().map(|p| p.iteration).collect();
            assert_eq!((built, auto.iteration), (vec![2], 2));
        }
    });
}

/// Some thousand cells are gathered as fast as a pilot looks at some hundred.
#[test]
fn there_is_no_pilot_where_it_takes_too_long() {
    gpu_test(|ctx| {
        let (picture, stats) = render(ctx, &scene("auto", 8.0, SUN, ""));
        let auto = stats.auto.as_ref().expect("what auto decided");
        assert!(auto.pilot.is_none() && auto.pilot_share > auto.most_pilot_share, "{auto:?}");
        assert!(auto.traced_steps > 1.0 && auto.pilot_share < 1.0, "{auto:?}");
        assert_eq!((auto.sampling, auto.candidates, auto.directions), (Sampling::Phase, 0, 48), "{auto:?}");
        assert!(stats.proxy.is_empty(), "{:?}", stats.proxy);
        let has = |name: &str| stats.passes.iter().any(|p| p.name.starts_with(name));
        assert!(has("pilot.first") && !has("proxy"), "{:?}", stats.passes);
        assert!(stats.passes.iter().all(|p| p.name != "pilot"), "{:?}", stats.passes);
        assert!(picture == render(ctx, &scene("phase", 8.0, SUN, "")).0, "not the picture of phase: {auto:?}");
    });
}

#[test]
fn residual_is_chosen_where_it_pays_and_is_that_of_its_m_and_n() {
    gpu_test(|ctx| {
        let scene = |sampling| sized_scene(28, 4, sampling, 0.5, SUN, FINE);
        let (picture, stats) = render(ctx, &scene("auto"));
        let auto = stats.auto.as_ref().expect("what auto decided");
        println!("{auto:?}");
        assert_eq!(auto.sampling, Sampling::Residual, "{auto:?}");
        assert_eq!(stats.proxy.iter().map(|p| p.iteration).collect::<Vec<_>>(), [2, 3, 4]);
        let mut same = scene("residual");
        (same.settings.candidates, same.settings.directions) = (auto.candidates, auto.directions);
        let (residual, of_residual) = render(ctx, &same);
        assert!(picture == residual, "not the picture of residual with its M and N");
        assert!(of_residual.auto.is_none());
        // Made anew it decides the same.
        let (again, more) = render(ctx, &scene("auto"));
        assert!(picture == again && more.auto == stats.auto, "{:?}", more.auto);
    });
}

/// Nothing to scatter, nothing to gather, no light: nothing to decide, and a picture all the same.
#[test]
fn auto_without_anything_to_decide() {
    gpu_test(|ctx| {
        let empty = scene("auto", 0.0, FLAT, "");
        assert!(render(ctx, &empty).1.auto.is_none());
        let mut single = scene("auto", 2.0, SUN, "");
        single.settings.orders = 1;
        assert!(render(ctx, &single).1.auto.is_none());
        let mut dark = scene("auto", 2.0, "", "");
        dark.lights.clear();
        dark.environment = None;
        let stats = render(ctx, &dark).1;
        assert!(stats.auto.is_none_or(|auto| auto.sampling == Sampling::Phase));
    });
}

/// The device's costs in a context of its own.
fn costs(folder: Option<&Place>) -> Costs {
    let _turn = one_at_a_time();
    let ctx = context_with_cache(folder.map(|place| place.0.path().to_owned()));
    let costs = Costs::of(&ctx).unwrap();
    assert_silent(&ctx.close());
    costs
}

#[test]
fn costs_are_measured_once_per_device_and_damage_is_mended() {
    assert_eq!(costs(None), USUAL_COSTS, "measured for nothing");
    let place = Place::new();
    let measured = costs(Some(&place));
    println!("{measured:?}");
    assert_ne!(measured, USUAL_COSTS, "not measured");
    let (name, sound) =
        place.files().into_iter().find(|(name, _)| name.starts_with("costs-")).expect("a file of costs");
    // What is there is taken, without another measurement, which would hardly agree to the last digit.
    assert_eq!(costs(Some(&place)), measured, "measured again");
    let mut flipped = sound.clone();
    flipped[60] ^= 1;
    for damaged in [&flipped[..], &sound[..sound.len() - 1]] {
        place.write(&name, damaged);
        let mended = costs(Some(&place));
        let files = place.files();
        let (_, file) = files.iter().find(|(other, _)| *other == name).expect("the file is there again");
        assert!(file != damaged && file.len() == sound.len(), "damaged, and taken");
        assert_eq!(costs(Some(&place)), mended, "not mended");
    }
}
