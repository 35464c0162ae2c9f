//! The pilot of the sampling `auto` against its CPU twin, and what it counts.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, gathered_sky, proxy_light, random_source, scenes, texture};
use common::gpu_test;
use glam::Vec3;
use tyndall::abi::PilotSample;
use tyndall::cpu;
use tyndall::cpu::gather::Carried;
use tyndall::passes::compact::Listed;
use tyndall::passes::pilot::{Look, Pilot};
use tyndall::passes::proxy::{Proxy, ProxyConfig};
use tyndall::scene::{Environment, Mask, Scene};
use tyndall::vk::{Context, Recorder};

const DIRECTIONS: u32 = 11;

/// What the device finds in a scene full of random light, and what the twin does.
struct Ran {
    device: [Vec<PilotSample>; 2],
    twin: [Vec<PilotSample>; 2],
}

fn pilot(ctx: &Context, scene: &Scene, look: Look, steps: [f32; 2]) -> Ran {
    let setup = Setup::new(ctx, scene);
    let dims = setup.host.params.dims;
    let source = random_source(ctx, &setup);
    let config = ProxyConfig::of(Mask::Channels([0xF0; 4]));
    let proxy = Proxy::new(ctx, &setup.data, config).unwrap();
    let pass = Pilot::new(ctx, &setup.data, DIRECTIONS, steps).unwrap();
    let (list, cells) = setup.list(ctx, Listed::Cells);
    let voxels = setup.voxels(ctx);
    if cells.is_empty() {
        assert_eq!(Pilot::cells(&list), 0);
        return Ran { device: [vec![], vec![]], twin: [vec![], vec![]] };
    }
    let mut rec = Recorder::new(ctx).unwrap();
    let voxel_args = voxels.chunk_args(ctx, &mut rec, 1).unwrap();
    proxy.record_clear(&mut rec);
    proxy.record(&mut rec, &setup.data, &voxels, &voxel_args, &source.a, 2);
    pass.record(&mut rec, look, &setup.data, &setup.emptiness.image, &list, &proxy, &source);
    rec.submit_and_wait().unwrap();

    let light = proxy_light(ctx, &proxy, dims);
    let images = [&source.a, &source.b[0], &source.b[1], &source.b[2]].map(|i| texture(ctx, i));
    let sky = gathered_sky(&setup);
    let device = pass.samples(ctx, look, &list).unwrap();
    let directions = pass.directions(look);
    assert_eq!(pass.rays(look, &list), device.iter().map(Vec::len).sum::<usize>() as u64 * u64::from(directions));
    let drawn = cpu::pilot::pilot_cells(&setup.host, &cells, device[0].len() as u32);
    let twin = [0, 1].map(|replicate| {
        let carried = Carried::Projected(&images, sky);
        cpu::pilot::pilot(&setup.host, &drawn, carried, &light, sky, replicate, directions, steps)
    });
    Ran { device, twin }
}

fn agree(case: &str, got: &[PilotSample], expected: &[PilotSample], value: fn(&PilotSample) -> [f32; 3]) {
    assert_eq!(got.len(), expected.len(), "{case}");
    let values = |samples: &[PilotSample]| samples.iter().flat_map(value).collect::<Vec<f32>>();
    let (got, expected) = (values(got), values(expected));
    let most = expected.iter().fold(0.0f32, |most, v| most.max(v.abs()));
    assert!(got.is_empty() || most > 0.0, "{case}: nothing to compare");
    // Nearest reads on a face may fall to either side, and a ray may be cut one step earlier or later.
    let is_right = |(a, b): (&f32, &f32)| (a - b).abs() <= 2e-3 * b.abs() + 1e-3 * most;
    let right = got.iter().zip(&expected).filter(|&pair| is_right(pair)).count();
    assert!(right * 20 >= got.len() * 19, "{case}: {right} of {} agree", got.len());
}

#[test]
fn the_pilot_finds_what_the_twin_finds() {
    gpu_test(|ctx| {
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            scene.g = [0.0, 0.6][i % 2];
            scene.settings.light_grid = [1, 1, 3][i % 3];
            if i / 2 % 2 == 0 {
                scene.environment = Some(Environment::Constant(Vec3::new(2.0, 1.0, 3.0)));
            }
            let first = pilot(ctx, &scene, Look::First, [0.8, 1.7]);
            for (replicate, (got, expected)) in first.device.iter().zip(&first.twin).enumerate() {
                agree(&format!("{name}, first look, replicate {replicate}"), got, expected, |s| s.traced);
                assert!(
                    got.iter().all(|s| s.proxy_steps == 0 && s.base == [0.0; 3] && s.residual == s.traced),
                    "{name}"
                );
            }
            let ran = pilot(ctx, &scene, Look::Pilot, [0.8, 1.7]);
            for (replicate, (got, expected)) in ran.device.iter().zip(&ran.twin).enumerate() {
                let case = |what| format!("{name}, {what}, replicate {replicate}");
                agree(&case("traced"), got, expected, |s| s.traced);
                agree(&case("base"), got, expected, |s| s.base);
                agree(&case("residual"), got, expected, |s| s.residual);
            }
            let [a, b] = &ran.device;
            assert!(a.is_empty() || a != b, "{name}: the replicates are the same");
        }
    });
}

/// Cost is told by these: half the step takes twice as many, in the data alone.
#[test]
fn steps_are_counted() {
    gpu_test(|ctx| {
        let (name, scene) = scenes().swap_remove(0);
        let counts = |steps| {
            let [a, b] = pilot(ctx, &scene, Look::Pilot, steps).device;
            let sum = |of: fn(&PilotSample) -> u32| a.iter().chain(&b).map(of).sum::<u32>();
            let rays = (a.len() + b.len()) as f64 * f64::from(DIRECTIONS);
            (f64::from(sum(|s| s.traced_steps)) / rays, f64::from(sum(|s| s.proxy_steps)) / rays)
        };
        let [coarse, fine] = [0.2, 0.1].map(|step| counts([step, 1.0]));
        println!("{name}: steps per ray {coarse:?}, {fine:?}");
        assert!(coarse.0 > 5.0 && coarse.1 > 1.0, "{coarse:?}");
        assert!((1.7..2.1).contains(&(fine.0 / coarse.0)) && fine.1 == coarse.1, "{coarse:?}, {fine:?}");
    });
}
