//! Single scattering against its CPU twin: delta lights, environment, isotropic and not, split dispatches.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, cases, scene_of, scenes, sky, texture};
use common::gpu_test;
use glam::{DVec3, Vec3, Vec4};
use tyndall::abi::ScatterSample;
use tyndall::cpu;
use tyndall::passes::compact::{List, Listed};
use tyndall::passes::project::{Kept, Projection, Scattering};
use tyndall::passes::single_scatter::SingleScatter;
use tyndall::scene::{Environment, Light, LightFor, Scene};
use tyndall::shaders::constants;
use tyndall::vk::{Access, Context, Recorder};
use tyndall::volume::Grid;

/// Both compute in single precision, in another order.
const ROUNDING: f32 = 1e-3;
/// In units of the largest value.
const SMALL: f32 = 1e-5;

const DIRECTIONS: u32 = 10;
const STEP: f32 = 0.7;

/// Which light the pass samples.
#[derive(Clone, Copy)]
enum Kind {
    Lights,
    Environment,
}

/// Runs the pass for the listed cells into an empty projection.
fn deposit(ctx: &Context, setup: &Setup, pass: &SingleScatter, projection: &Projection, list: &List, kind: Kind) {
    let mut rec = Recorder::new(ctx).unwrap();
    projection.record_clear_all(&mut rec);
    rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
    let args = list.chunk_args(ctx, &mut rec, 1).unwrap();
    let scattering = Scattering {
        scene: &setup.data,
        emptiness: &setup.emptiness.image,
        field: &setup.field,
        projection,
        args: &args,
        kept: Kept::Mean,
    };
    for chunk in list.chunks() {
        match kind {
            Kind::Lights => pass.record_lights(&mut rec, &scattering, &chunk, 0..setup.data.light_count),
            Kind::Environment => pass.record_environment(&mut rec, &scattering, &chunk, DIRECTIONS, true),
        }
    }
    rec.submit_and_wait().unwrap();
}

/// Samples of the pass, by cell of the list, as [`cpu::single_scatter::single_scatter`] has them.
fn run(ctx: &Context, setup: &Setup) -> ([Vec<Vec<ScatterSample>>; 2], Vec<u32>) {
    let (list, cells) = setup.list(ctx, Listed::Cells);
    let pass = SingleScatter::new(ctx, &setup.data, STEP).unwrap();
    let projection = Projection::new(ctx, &setup.data, bodies::CHUNK, 1, true, LightFor::View).unwrap();
    let has_environment = setup.data.environment != constants::ENVIRONMENT_NONE;
    let directions = if has_environment { DIRECTIONS } else { 0 };
    let kinds = [(Kind::Lights, pass.light_rays(&setup.data)), (Kind::Environment, directions)];
    let read = kinds.map(|(kind, rays)| {
        deposit(ctx, setup, &pass, &projection, &list, kind);
        let samples = ctx.read_back(projection.samples()).unwrap();
        let slots = rays.min(projection.slots()) as usize;
        let of_cell = |item: usize| (0..slots).map(|slot| samples[slot * bodies::CHUNK as usize + item]).collect();
        (0..cells.len()).map(of_cell).collect()
    });
    (read, cells)
}

/// What a check computed, for tests that look at it.
struct Checked {
    expected: [Vec<Vec<ScatterSample>>; 2],
    cells: usize,
}

fn check(ctx: &Context, name: &str, scene: &Scene) -> Checked {
    let setup = Setup::new(ctx, scene);
    let (got, cells) = run(ctx, &setup);
    let field = texture(ctx, &setup.field);
    let expected = cpu::single_scatter::single_scatter(&setup.host, &cells, &field, DIRECTIONS, STEP);
    // A direction on the edge between two texels of the sky may fall into either; an acos is good to 5e-5.
    let outliers = 2 * usize::from(matches!(scene.environment, Some(Environment::LatLong(_))));
    for (what, got, expected) in [("lights", &got[0], &expected[0]), ("environment", &got[1], &expected[1])] {
        bodies::assert_same_samples(&format!("{name}: {what}"), got, expected, ROUNDING, SMALL, outliers);
    }
    Checked { expected, cells: cells.len() }
}

#[test]
fn delta_lights_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            scene.environment = None;
            check(ctx, name, &scene);
        }
    });
}

#[test]
fn blocks_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            scene.settings.light_grid = 2 + i as u32 % 3;
            check(ctx, &format!("{name}, blocks of {}", scene.settings.light_grid), &scene);
        }
    });
}

#[test]
fn the_environment_agrees_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            scene.lights.clear();
            for environment in cases(vec![sky(), Environment::Constant(Vec3::new(1.0, 0.5, 0.25))]) {
                scene.environment = Some(environment);
                check(ctx, name, &scene);
            }
        }
    });
}

#[test]
fn all_together_and_in_darkness() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            let lit = check(ctx, name, &scene);
            assert!(
                lit.cells == 0 || lit.expected.iter().all(|e| e.iter().flatten().any(|s| s.light[0] > 0.0)),
                "{name}"
            );
            scene.lights.clear();
            scene.environment = None;
            let dark = check(ctx, name, &scene);
            assert!(dark.expected.iter().flatten().all(Vec::is_empty), "{name}");
        }
    });
}

/// A light at a voxel's centre, in a voxel, on a face.
#[test]
fn lights_inside() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([5, 4, 3], [1.0, 2.0, 1.0], [0.5, 1.0, 0.5]);
        let mut scene = scene_of(grid, vec![0.9; 60]);
        scene.environment = None;
        let places = [DVec3::new(2.5, 3.0, 1.5), DVec3::new(2.4, 3.1, 1.7), DVec3::new(2.0, 4.0, 1.0), DVec3::ZERO];
        for position in cases(places.to_vec()) {
            scene.lights = vec![Light::Point { position, intensity: Vec3::ONE }];
            let result = check(ctx, &format!("light at {position}"), &scene);
            assert!(result.expected[0].iter().flatten().all(|s| Vec3::from(s.light).is_finite()));
        }
    });
}

/// More lights than one dispatch may march to, and than a chunk's samples have room for: the deposits add up.
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
        let setup = Setup::new(ctx, &scene);
        let (list, cells) = setup.list(ctx, Listed::Cells);
        let field = texture(ctx, &setup.field);
        let samples = cpu::single_scatter::single_scatter(&setup.host, &cells, &field, DIRECTIONS, 0.01);
        let mut expected = cpu::project::Sums::zero(setup.host.params.dims);
        cpu::project::project_deposit(&setup.host.params, &cells, &samples[0], false, &mut expected);
        // Rays of 1,037 steps: 27 to a dispatch; of 20, as many as there is room for.
        for step in [0.01, 0.5] {
            let pass = SingleScatter::new(ctx, &setup.data, step).unwrap();
            assert_eq!(pass.light_rays(&setup.data), 280);
            let projection = Projection::new(ctx, &setup.data, bodies::CHUNK, 1, true, LightFor::View).unwrap();
            deposit(ctx, &setup, &pass, &projection, &list, Kind::Lights);
            let sums: Vec<Vec4> = ctx.read_back_image(&projection.sums()[0]).unwrap();
            // Steps of half a voxel see what steps of a hundredth see to some per cent.
            let tolerance = if step < 0.1 { ROUNDING } else { 0.1 };
            bodies::assert_close(&format!("steps of {step}"), &sums, &expected.a.texels, tolerance, SMALL);
        }
    });
}
