//! Local shading against its CPU twin, and its gradient by hand.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, assert_close, scene_of, scenes, texture};
use common::gpu_test;
use glam::{DMat3, DVec3, Vec3, Vec4};
use std::f32::consts::PI;
use tyndall::cpu;
use tyndall::cpu::texture::Texture;
use tyndall::passes::compact::Listed;
use tyndall::passes::phong::Phong;
use tyndall::scene::{Environment, Light, Scene};
use tyndall::vk::{Context, Recorder};
use tyndall::volume::Grid;

/// A half float that is cut off (9.8e-4), and the 40th power of a cosine that is good to a few 1e-7.
const ROUNDING: f32 = 1.1e-3;
const SMALLEST: f32 = 1e-5;

/// Shades the scene; checks against the twin.
fn check(ctx: &Context, name: &str, scene: &Scene) -> Texture<Vec4> {
    let setup = Setup::new(ctx, scene);
    let pass = Phong::new(ctx, &setup.data).unwrap();
    let total = bodies::image(ctx, "total", &Texture::filled(setup.host.params.dims, Vec4::ZERO));
    let mut rec = Recorder::new(ctx).unwrap();
    let (list, active) = setup.list(ctx, Listed::Voxels);
    let args = list.chunk_args(ctx, &mut rec, 1).unwrap();
    for chunk in list.chunks() {
        pass.record(&mut rec, &setup.data, &chunk, &args, &total);
    }
    rec.submit_and_wait().unwrap();
    let mut expected = Texture::filled(setup.host.params.dims, Vec4::ZERO);
    let ambient = scene.environment.as_ref().map_or(Vec3::ZERO, Environment::mean_radiance);
    cpu::phong::phong(&setup.host, &active, ambient, &mut expected);
    let got = texture(ctx, &total);
    assert_close(name, &got.texels, &expected.texels, ROUNDING, SMALLEST);
    got
}

#[test]
fn shading_agrees_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            check(ctx, name, &scene);
            scene.environment = None;
            scene.lights.truncate(1);
            check(ctx, name, &scene);
        }
    });
}

/// On a turned, flattened grid the values grow along one world direction; a light from there shines on the surface at
/// full strength: albedo/π times irradiance (Lambert), and nothing from the side.
#[test]
fn the_gradient_lives_in_the_world() {
    gpu_test(|ctx| {
        let steps = DMat3::from_rotation_y(0.4)
            * DMat3::from_rotation_x(-0.7)
            * DMat3::from_diagonal(DVec3::new(1.0, -2.0, 0.5));
        let grid = Grid::oriented([7, 7, 7], steps, [1.0, 2.0, 3.0]);
        let up = DVec3::new(0.2, -0.5, 0.8).normalize();
        let (low, high) = grid.world_bounds();
        let value = |i: usize| {
            let index = DVec3::new((i % 7) as f64, (i / 7 % 7) as f64, (i / 49) as f64) + 0.5;
            let along = (grid.index_to_world.transform_point3(index) - 0.5 * (low + high)).dot(up);
            (0.6 + 0.01 * along) as f32
        };
        let mut scene = scene_of(grid, (0..343).map(value).collect());
        scene.environment = None;
        // Seen at a right angle to the light: no highlight at cos⁴⁰ 45° = 1e-6.
        let side = up.cross(DVec3::X).normalize();
        scene.camera.position = 0.5 * (low + high) + 1e6 * (side + 1e-3 * up);
        for (towards, expected) in [(up, 1.0), (side, 0.0), ((up + 3f64.sqrt() * side.cross(up)) / 2.0, 0.5)] {
            scene.lights = vec![Light::Directional { direction: -towards, irradiance: Vec3::splat(PI) }];
            let setup = Setup::new(ctx, &scene);
            let p = setup.host.params;
            let got = check(ctx, "plane", &scene);
            let middle = 3 * 49 + 3 * 7 + 3;
            let m = cpu::classify::classify(&p, &setup.host.points, setup.host.scalar.texels[middle]);
            let light = got.texels[middle].truncate() / got.texels[middle].w / p.radiance_scale;
            let lambert = Vec3::from(m.color) * expected;
            assert!((light - lambert).abs().max_element() < 4e-3, "{towards}: {light} instead of {lambert}");
        }
    });
}

/// Nothing is undefined at a light, at the eye, or where the scalar is flat.
#[test]
fn light_and_eye_at_a_voxels_centre() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([3, 3, 3], [1.0; 3], [0.0; 3]);
        let mut scene = scene_of(grid, vec![0.9; 27]);
        scene.camera.position = DVec3::ONE;
        scene.lights.push(Light::Point { position: DVec3::ONE, intensity: Vec3::ONE });
        let got = check(ctx, "centre", &scene);
        assert!(got.texels.iter().all(|t| t.is_finite()));
    });
}

/// Infinities make gradients as large values do; where there is no scalar there is no gradient.
#[test]
fn neighbours_that_are_no_numbers() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([5, 4, 6], [1.0; 3], [0.0; 3]);
        let mut values = bodies::random_values(2, 120);
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -3e38];
        values.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0).for_each(|(i, v)| *v = odd[i / 3 % 5]);
        let got = check(ctx, "odd neighbours", &scene_of(grid, values));
        assert!(got.texels.iter().all(|t| t.is_finite()));
    });
}
