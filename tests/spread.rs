//! From the nodes of a coarse light grid to the voxels: against the CPU twin, and by hand.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, assert_close, image, random_light, scene_of, scenes, texture};
use common::gpu_test;
use glam::{Vec3, Vec4};
use tyndall::cpu::spread::spread;
use tyndall::cpu::texture::Texture;
use tyndall::passes::spread::Spread;
use tyndall::vk::{Context, Image, Recorder};
use tyndall::volume::Grid;

/// Half floats.
const ROUNDING: f32 = 1e-3;

/// Spreads on the device: what rays read, and what the eye sees, which had 1 and the same extinction before.
fn spread_on_device(
    ctx: &Context,
    setup: &Setup,
    nodes: &Texture<Vec4>,
    adds: bool,
    fixed: Option<&Image>,
) -> [Texture<Vec4>; 2] {
    let dims = setup.host.params.dims;
    let field = texture(ctx, &setup.field);
    let of = |name, value| {
        let texels = field.texels.iter().map(|f| Vec4::new(value, value, value, f.w)).collect();
        image(ctx, name, &Texture::new(dims, texels))
    };
    let (solution, sum, unused) = (of("solution", 7.0), of("sum", 1.0), of("unused", 0.0));
    let nodes = image(ctx, "nodes", nodes);
    let mut rec = Recorder::new(ctx).unwrap();
    let seen = adds.then_some(&sum);
    let pass = Spread::new(ctx, &setup.data).unwrap();
    pass.record(&mut rec, &setup.data, &nodes, &setup.field, &solution, seen, &unused, fixed);
    rec.submit_and_wait().unwrap();
    [texture(ctx, &solution), texture(ctx, &sum)]
}

#[test]
fn voxels_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            for edge in [2, 3, 4] {
                scene.settings.light_grid = edge;
                let setup = Setup::new(ctx, &scene);
                let params = &setup.host.params;
                let mut nodes = random_light(params.light_dims, 5, -1.0, 100.0);
                for (i, node) in nodes.texels.iter_mut().enumerate() {
                    *node = if i % 5 == 3 { Vec4::ZERO } else { node.truncate().extend(1.0) };
                }
                let expected = spread(params, &nodes, &texture(ctx, &setup.field));
                let [got, seen] = spread_on_device(ctx, &setup, &nodes, true, None);
                let case = format!("{name}, blocks of {edge}");
                assert_close(&case, &got.texels, &expected.texels, ROUNDING, ROUNDING);
                let added: Vec<Vec4> = expected.texels.iter().map(|e| (e.truncate() + 1.0).extend(e.w)).collect();
                assert_close(&case, &seen.texels, &added, ROUNDING, ROUNDING);
                // Light beside it joins, and is not seen; what is not added leaves the sum alone.
                let beside = random_light(params.dims, 6, 0.0, 50.0);
                let [got, seen] = spread_on_device(ctx, &setup, &nodes, false, Some(&image(ctx, "fixed", &beside)));
                let add = |(e, b): (&Vec4, &Vec4)| *e + b.truncate().extend(0.0);
                let joined: Vec<Vec4> = expected.texels.iter().zip(&beside.texels).map(add).collect();
                assert_close(&case, &got.texels, &joined, ROUNDING, ROUNDING);
                assert!(seen.texels.iter().all(|s| s.truncate() == Vec3::ONE), "{case}");
            }
        }
    });
}

/// By hand: nodes at 1 and 3 of a row of 5 voxels, and one at 5, its end; values hold beyond the outer ones, and where a node
/// has none.
#[test]
fn voxels_lie_between_nodes() {
    gpu_test(|ctx| {
        let mut scene = scene_of(Grid::axis_aligned([5, 1, 1], [1.0; 3], [0.0; 3]), vec![0.9; 5]);
        scene.settings.light_grid = 2;
        let setup = Setup::new(ctx, &scene);
        for (last, expected) in
            [(Vec4::new(0.0, 0.0, 0.0, 1.0), [8.0, 10.0, 14.0, 12.0, 4.0]), (Vec4::ZERO, [8.0, 10.0, 14.0, 16.0, 16.0])]
        {
            let [first, second] = [8.0, 16.0].map(|v| Vec4::new(v, v, v, 1.0));
            let nodes = Texture::new([3, 1, 1], vec![first, second, last]);
            let [got, _] = spread_on_device(ctx, &setup, &nodes, false, None);
            let values: Vec<f32> = got.texels.iter().map(|t| t.x).collect();
            assert_eq!(values, expected);
        }
    });
}
