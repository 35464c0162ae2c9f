//! A volume larger than one storage buffer: 512×512×182 voxels are 47.7 million, lavapipe's buffers hold 2²⁵ words.
//! Lists are split, the proxy gets coarser where its runs do not fit, and what happened is reported.

mod common;
#[path = "common/scenes.rs"]
mod scenes;

use common::gpu_test;
use scenes::scene_of;
use std::ops::ControlFlow;
use std::time::Instant;
use tyndall::render::{Internals, Renderer};
use tyndall::scene::{Mask, Scene};
use tyndall::stats::ProxyStats;
use tyndall::vk::Context;
use tyndall::volume::phantom;

const SIZE: [u32; 3] = [512, 512, 182];

/// The tree phantom under a lossless mask; `transfer` may replace its own.
fn scene(noise: Option<f64>, transfer: &str) -> Scene {
    let mut volume = phantom::generate("tree", Some(SIZE)).unwrap();
    if let Some(amplitude) = noise {
        phantom::add_noise(&mut volume, amplitude, 0);
    }
    let toml = format!(
        r#"
        preset = "phantom-tree"
        {transfer}
        [render]
        size = [64, 64]
        spp = 1
        orders = 2
        sampling = "resample"
        candidates = 4
        directions = 2
        environment_directions = 1
        mask = 8
        "#
    );
    scene_of(&toml, volume)
}

/// Renders, reports, and returns the proxy's figures.
fn render(ctx: &Context, case: &str, scene: &Scene) -> ProxyStats {
    let start = Instant::now();
    let mut renderer = Renderer::new(ctx, scene, Internals::default()).unwrap();
    let picture = renderer.render(0, &mut |_| ControlFlow::Continue(())).unwrap();
    let stats = renderer.stats(scene, start.elapsed().as_secs_f64() * 1e3).unwrap();
    let proxy = stats.proxy[0].clone();
    println!(
        "{case}: {:.1} s, {} active, {} runs, {} buckets, mask {}, proxy {} MiB, peak {} MiB, build {:.1} s",
        stats.wall_ms / 1e3,
        renderer.active_voxels(),
        proxy.runs,
        proxy.buckets,
        proxy.mask_used,
        proxy.bytes >> 20,
        stats.peak_device_bytes >> 20,
        proxy.build_ms / 1e3,
    );
    assert!(picture.pixels.iter().flatten().all(|v| v.is_finite()), "{case}: the picture is not finite");
    let lit = picture.pixels.iter().filter(|p| p[1] > 0.05).count();
    assert!(lit > 400, "{case}: only {lit} of 4096 pixels are lit");
    let voxels: u64 = SIZE.map(u64::from).iter().product();
    let room = ctx.max_storage_bytes() / 4;
    assert_eq!((stats.proxy.len(), proxy.voxels), (1, voxels), "{case}");
    assert!(proxy.buckets <= proxy.runs && proxy.runs <= voxels.min(room) && proxy.buckets > 50, "{case}: {proxy:?}");
    proxy
}

#[test]
#[ignore = "long; scripts/test --full"]
fn smooth() {
    gpu_test(|ctx| {
        let proxy = render(ctx, "smooth", &scene(None, ""));
        assert_eq!(proxy.mask_used, Mask::Channels([0xFF; 4]));
    });
}

#[test]
#[ignore = "long; scripts/test --full"]
fn with_noise() {
    gpu_test(|ctx| {
        render(ctx, "noise", &scene(Some(0.1), ""));
    });
}

/// Every voxel is active and unlike its neighbours: more runs than any list holds.
#[test]
#[ignore = "long; scripts/test --full"]
fn with_more_runs_than_a_buffer_holds() {
    gpu_test(|ctx| {
        let transfer = r#"
            [transfer]
            convention = "extinction"
            points = [
                { value = 0, color = [0.5, 0.7, 0.9], opacity = 1 },
                { value = 1, color = [0.9, 0.8, 0.6], opacity = 5 },
            ]"#;
        let proxy = render(ctx, "noise everywhere", &scene(Some(1.0), transfer));
        let voxels = proxy.voxels;
        if ctx.max_storage_bytes() / 4 < voxels {
            assert_ne!(proxy.mask_used, proxy.mask_requested, "{proxy:?}: so many runs cannot fit");
        } else {
            assert!(proxy.runs > voxels / 10 * 9 && proxy.mask_used == Mask::Channels([0xFF; 4]), "{proxy:?}");
        }
    });
}
