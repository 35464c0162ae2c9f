//! Too little device memory: what is asked for, what there is, what would fit, and that it does.

mod common;

use std::ops::ControlFlow;
use std::path::Path;
use tyndall::Error;
use tyndall::render::path::PathRender;
use tyndall::render::{self, Internals, Renderer};
use tyndall::scene::{Overrides, Scene, load_scene_text};
use tyndall::vk::{Context, ContextConfig, Validation};

/// In colour: without, the smallest trial would take more than the smallest limit here leaves.
fn scene(render: &str) -> Scene {
    let text = format!(
        "medium.g = 0.4\n[volume]\nphantom = \"cloud\"\nsize = [70, 64, 48]\n[environment]\nradiance = [1, 0.9, 0.8]\n\
         [render]\nsize = [16, 12]\nspp = 1\ndirections = 2\norders = 2\n{render}"
    );
    load_scene_text(&text, Path::new("scene.toml"), &Overrides::default()).unwrap()
}

fn with_limit<T>(memory_limit: Option<u64>, body: impl FnOnce(&Context) -> T) -> T {
    let _turn = common::one_at_a_time();
    // Too much for a CPU under GPU-assisted validation.
    let config = ContextConfig { validation: Validation::CoreAndSync, memory_limit, ..common::config() };
    let ctx = Context::new(&config).unwrap();
    let result = body(&ctx);
    common::assert_silent(&ctx.close());
    result
}

/// The text of the error, and nothing is left on the device.
fn refusal(ctx: &Context, scene: &Scene) -> String {
    let Err(error) = render::render(ctx, scene, &mut |_| ControlFlow::Continue(())) else { panic!("it fits") };
    assert!(matches!(error, Error::OutOfDeviceMemory { .. }), "{error}");
    assert_eq!(ctx.bytes(), 0, "of what was made before");
    error.to_string()
}

/// The number before ` MiB` that follows `before`.
fn mebibytes_after(text: &str, before: &str) -> f64 {
    let rest = text.split_once(before).unwrap_or_else(|| panic!("'{before}' is missing in {text}")).1;
    rest.split_once(" MiB").unwrap().0.trim().parse().unwrap()
}

fn taken(scene: &Scene) -> u64 {
    with_limit(None, |ctx| {
        let _renderer = Renderer::new(ctx, scene, Internals::default()).unwrap();
        ctx.bytes()
    })
}

fn taken_by_path(scene: &Scene) -> u64 {
    with_limit(None, |ctx| {
        let _render = PathRender::new(ctx, scene).unwrap();
        ctx.bytes()
    })
}

const MIB: f64 = 1048576.0;

#[test]
fn what_would_fit_is_said_and_fits() {
    let whole = scene("");
    let bytes = taken(&whole);
    let coarse = taken(&scene("light_grid = 2\n"));
    let limit = (bytes + coarse) / 2;
    with_limit(Some(limit), |ctx| {
        let text = refusal(ctx, &whole);
        let there_is = mebibytes_after(text.split_once(", but ").unwrap().1, " MiB of ");
        assert!((there_is * MIB - limit as f64).abs() < 0.1 * MIB, "{text}");
        let [all, two] =
            [mebibytes_after(&text, "takes about "), mebibytes_after(&text, "--light-grid 2 would take about ")];
        assert!((all * MIB / bytes as f64 - 1.0).abs() < 0.05, "{all} MiB, it is {}", bytes as f64 / MIB);
        assert!((two * MIB / coarse as f64 - 1.0).abs() < 0.1, "{two} MiB, it is {}", coarse as f64 / MIB);
        render::render(ctx, &scene("light_grid = 2\n"), &mut |_| ControlFlow::Continue(())).unwrap();
    });
}

/// The least loss comes first; where nothing fits that is said.
#[test]
fn the_least_loss_is_advised() {
    let single = scene("precision = 'single'\nsampling = 'resample'\n");
    let half = scene("precision = 'half'\nsampling = 'resample'\n");
    let taken_half = taken(&half);
    let limit = (taken(&single) + taken_half) / 2;
    with_limit(Some(limit), |ctx| {
        let text = refusal(ctx, &single);
        assert!(text.contains("; --precision half would take about "), "{text}; it takes {}", taken_half as f64 / MIB);
    });
    let least = taken(&scene("precision = 'half'\nsampling = 'resample'\nmodel = 'single'\n"))
        .min(taken(&scene("precision = 'half'\nlight_grid = 4\n")));
    with_limit(Some(least * 3 / 4), |ctx| {
        let text = refusal(ctx, &half);
        assert!(text.contains("use a smaller volume") && text.contains("; even --"), "{text}");
    });
    let path = scene("model = 'path'\n");
    with_limit(Some(taken_by_path(&path) * 3 / 4), |ctx| {
        let text = refusal(ctx, &path);
        assert!(text.contains("use a smaller volume or picture") && text.contains("the scene takes about"), "{text}");
    });
}
