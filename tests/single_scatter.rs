//! Single scattering against its CPU twin: delta lights, environment, isotropic and not, split dispatches.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{
    Setup, assert_close, assert_nearly_all_close, cases, image, random_light, scene_of, scenes, sky, texture,
};
use common::gpu_test;
use glam::{DVec3, Vec3, Vec4};
use tyndall::cpu;
use tyndall::cpu::contribute::Orders as HostOrders;
use tyndall::cpu::texture::Texture;
use tyndall::passes::contribute::{Orders, Source};
use tyndall::passes::single_scatter::SingleScatter;
use tyndall::scene::{Environment, Light, Scene};
use tyndall::vk::{Access, Context, Recorder};
use tyndall::volume::Grid;

/// Half floats cut to 11 bits are off by 9.8e-4, and there are two such steps here: old + new, and the result.
const ROUNDING: f32 = 2e-3;
/// In units of the largest value: what is left of sums that cancel, as B's do.
const CANCELLED: f32 = 2e-4;

const DIRECTIONS: u32 = 10;
const STEP: f32 = 0.7;

/// Runs the pass and its twin on what is in the images before; compares all they write.
fn check(ctx: &Context, name: &str, scene: &Scene) -> Checked {
    let case = format!("{name}, g {}", scene.g);
    let setup = Setup::new(ctx, scene);
    let dims = setup.host.params.dims;
    let is_anisotropic = scene.g != 0.0;
    // Leftovers: the first dispatch must replace the source, and add to the total.
    let old = random_light(dims, 11, 0.0, 100.0);
    let next = Source { a: image(ctx, "next.a", &old), b: [(); 3].map(|()| image(ctx, "next.b", &old)) };
    let total = image(ctx, "total", &old);
    let pass = SingleScatter::new(ctx, &setup.data, DIRECTIONS, STEP, true).unwrap();
    let orders = Orders { next: &next, total: &total };
    let mut rec = Recorder::new(ctx).unwrap();
    let args = setup.list.chunk_args(ctx, &mut rec, 1).unwrap();
    for chunk in setup.list.chunks() {
        let cells = &setup.emptiness.image;
        pass.record(&mut rec, &setup.data, cells, &chunk, &args, &setup.field, &orders);
    }
    rec.barrier(Access::ComputeReadWrite, Access::ComputeReadWrite);
    rec.submit_and_wait().unwrap();

    let mut expected = HostOrders { next_a: old.clone(), next_b: [(); 3].map(|()| old.clone()), total: old };
    let field = texture(ctx, &setup.field);
    cpu::single_scatter::single_scatter(&setup.host, &setup.active, &field, DIRECTIONS, STEP, &mut expected);
    // A direction on the edge between two texels of the sky may fall into either; an acos is good to 5e-5.
    let outliers = usize::from(matches!(scene.environment, Some(Environment::LatLong(_))));
    let same = |what: &str, got: &_, expected: &Texture<Vec4>| {
        let (case, got) = (format!("{case}: {what}"), texture(ctx, got));
        assert_nearly_all_close(&case, &got.texels, &expected.texels, ROUNDING, CANCELLED, outliers);
    };
    same("A", &next.a, &expected.next_a);
    same("total", &total, &expected.total);
    if is_anisotropic {
        for (axis, b) in next.b.iter().enumerate() {
            same(["Bx", "By", "Bz"][axis], b, &expected.next_b[axis]);
        }
    }
    Checked { expected, active: setup.active.len() }
}

/// What a check computed, for tests that look at it.
struct Checked {
    expected: HostOrders,
    active: usize,
}

#[test]
fn delta_lights_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            scene.environment = None;
            for g in cases(vec![0.6, 0.0, -0.3]) {
                scene.g = g;
                check(ctx, name, &scene);
            }
        }
    });
}

#[test]
fn the_environment_agrees_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            scene.lights.clear();
            let skies = vec![(sky(), 0.6), (sky(), 0.0), (Environment::Constant(Vec3::new(1.0, 0.5, 0.25)), 0.0)];
            for (environment, g) in cases(skies) {
                scene.environment = Some(environment);
                scene.g = g;
                check(ctx, name, &scene);
            }
        }
    });
}

#[test]
fn all_together_and_in_darkness() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            check(ctx, name, &scene);
            scene.lights.clear();
            scene.environment = None;
            let dark = check(ctx, name, &scene);
            assert!(dark.active == 0 || dark.expected.next_a.texels.iter().any(|t| t.w > 0.0 && t.x == 0.0), "{name}");
        }
    });
}

/// A light at a voxel's centre, in a voxel, on a face, at the eye, and an eye at a voxel's centre.
#[test]
fn lights_and_eyes_inside() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([5, 4, 3], [1.0, 2.0, 1.0], [0.5, 1.0, 0.5]);
        let mut scene = scene_of(grid, vec![0.9; 60]);
        scene.environment = None;
        let places = [DVec3::new(2.5, 3.0, 1.5), DVec3::new(2.4, 3.1, 1.7), DVec3::new(2.0, 4.0, 1.0), DVec3::ZERO];
        for position in cases(places.to_vec()) {
            scene.lights = vec![Light::Point { position, intensity: Vec3::ONE }];
            scene.camera.position = position;
            for g in cases(vec![0.7, 0.0]) {
                scene.g = g;
                let result = check(ctx, &format!("light at {position}"), &scene);
                assert!(result.expected.total.texels.iter().all(|t| t.is_finite()));
            }
        }
    });
}

/// More lights than one dispatch may march to: the dispatches add up. (A thin step makes few rays enough.)
#[test]
fn many_lights_are_split_over_dispatches() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([9, 3, 4], [1.0; 3], [0.0; 3]);
        let mut scene = scene_of(grid, bodies::random_values(4, 108));
        scene.lights = (0..70)
            .map(|i| Light::Directional {
                direction: tyndall::scene::camera::towards(20.0 * f64::from(i), f64::from(i) - 35.0),
                irradiance: Vec3::new(0.1, 0.2, 0.3),
            })
            .collect();
        scene.settings.gather_step = STEP;
        let setup = Setup::new(ctx, &scene);
        let pass = SingleScatter::new(ctx, &setup.data, DIRECTIONS, 0.01, true).unwrap();
        let coarse = SingleScatter::new(ctx, &setup.data, DIRECTIONS, 0.02, true).unwrap();
        assert_eq!(pass.rays(&setup.data), 70 + DIRECTIONS);
        // 80 rays of 1,037 steps need three dispatches, of 523 steps two.
        let run = |pass: &SingleScatter| {
            let dims = setup.host.params.dims;
            let zero = Texture::filled(dims, Vec4::ZERO);
            let next = Source { a: image(ctx, "a", &zero), b: [(); 3].map(|()| image(ctx, "b", &zero)) };
            let total = image(ctx, "total", &zero);
            let mut rec = Recorder::new(ctx).unwrap();
            let args = setup.list.chunk_args(ctx, &mut rec, 1).unwrap();
            for chunk in setup.list.chunks() {
                let orders = Orders { next: &next, total: &total };
                pass.record(&mut rec, &setup.data, &setup.emptiness.image, &chunk, &args, &setup.field, &orders);
            }
            rec.submit_and_wait().unwrap();
            [texture(ctx, &next.a), texture(ctx, &total)]
        };
        let zero = Texture::filled(setup.host.params.dims, Vec4::ZERO);
        let mut expected = HostOrders { next_a: zero.clone(), next_b: [(); 3].map(|()| zero.clone()), total: zero };
        let field = texture(ctx, &setup.field);
        cpu::single_scatter::single_scatter(&setup.host, &setup.active, &field, DIRECTIONS, 0.01, &mut expected);
        for got in [run(&pass), run(&coarse)] {
            // A half float more is cut off per dispatch; steps of 0.01 and 0.02 voxels see the same.
            assert_close("A", &got[0].texels, &expected.next_a.texels, 2.0 * ROUNDING, CANCELLED);
            assert_close("total", &got[1].texels, &expected.total.texels, 2.0 * ROUNDING, CANCELLED);
        }
    });
}
