//! The camera against its CPU twin: backgrounds, samples, bands of rows, eyes in awkward places.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, assert_close, cases, image, image_of, scene_of, scenes, sky, texture};
use common::gpu_test;
use glam::{DVec3, Vec3, Vec4};
use tyndall::cpu;
use tyndall::cpu::texture::Texture;
use tyndall::passes::camera::{Camera, Content};
use tyndall::passes::project::Source;
use tyndall::scene::camera::{self, look_at};
use tyndall::scene::{Background, Environment, Light, LightFor, Model, Scene};
use tyndall::vk::{Context, ImageFormat, Recorder};
use tyndall::volume::Grid;

/// Both read the same half floats and compute in single precision. Rays are cut at a transmittance of 1e-3, and
/// rounding decides on which side of that a step falls: 1e-3 of what lies behind.
const ROUNDING: f32 = 1e-3;
const CUT: f32 = 3e-4;

const STEP: f32 = 0.6;

/// Takes a picture of random light in the scene's extinction, in bands of 3 rows; checks against the twin.
fn check(ctx: &Context, name: &str, scene: &Scene, samples: u32) -> Vec<Vec4> {
    check_within(ctx, name, scene, samples, CUT)
}

/// [`check`] with another tolerance, in units of the brightest pixel.
fn check_within(ctx: &Context, name: &str, scene: &Scene, samples: u32, tolerance: f32) -> Vec<Vec4> {
    let setup = Setup::new(ctx, scene);
    let p = setup.host.params;
    let field = texture(ctx, &setup.field);
    // Light only where there is extinction, as everywhere in the method.
    let light = bodies::random_light(p.dims, 21, 0.0, 1.0);
    let texels = light.texels.iter().zip(&field.texels).map(|(l, f)| (l.truncate() * f.w * 500.0).extend(f.w));
    let total_image = image(ctx, "total", &Texture::new(p.dims, texels.collect()));
    let total = texture(ctx, &total_image);
    // Where nothing else can be read.
    let extinction = image_of(ctx, "extinction", ImageFormat::Alpha32Float, &total, |f| f.w);

    let is_lit = scene.settings.model == Model::Single;
    let is_directed = scene.settings.light_for == LightFor::EveryView;
    let content = match (is_lit, is_directed) {
        (false, _) => Content::Local,
        (true, false) => Content::Scattering,
        (true, true) => Content::Directed,
    };
    let b_images = [22, 23, 24].map(|seed| image(ctx, "b", &bodies::random_light(p.dims, seed, -200.0, 200.0)));
    let b = b_images.each_ref().map(|b| texture(ctx, b));
    let source = Source { a: total_image, b: b_images };
    let pass = Camera::new(ctx, &setup.data, scene.background, [STEP; 2], samples, content).unwrap();
    let picture = Camera::picture(ctx, p.size).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    for sample in 0..samples {
        for begin in (0..p.size[1]).step_by(3) {
            let rows = begin..p.size[1].min(begin + 3);
            let (emptiness, emitted) = (&setup.emptiness.image, &setup.field);
            pass.record(&mut rec, &setup.data, emptiness, &source, &extinction, emitted, &picture, sample, rows);
        }
    }
    rec.submit_and_wait().unwrap();
    let got: Vec<Vec4> = ctx.read_back_image(&picture).unwrap();
    let lights = if is_lit { scene.lights.len().min(8) as u32 } else { 0 };
    let content =
        cpu::camera::Content { total: &total, b: is_directed.then_some(&b), emitted: is_lit.then_some(&field) };
    let expected = cpu::camera::camera(&setup.host, scene.background, content, samples, STEP, lights);
    assert_close(name, &got, &expected, ROUNDING, tolerance);
    got
}

#[test]
fn pictures_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            for samples in cases(vec![5, 1]) {
                check(ctx, &format!("{name}, {samples} samples"), &scene, samples);
            }
        }
    });
}

/// Order 1 of delta lights: at one point per sample, of few lights all, of many some.
#[test]
fn lit_pictures_agree_with_the_twin() {
    gpu_test(|ctx| {
        // Scenes in which B makes a difference.
        let mut directed = 0;
        for (name, mut scene) in scenes() {
            scene.settings.model = Model::Single;
            for (samples, g) in cases(vec![(5, 0.6), (1, 0.0)]) {
                scene.g = g;
                check(ctx, &format!("{name}, {samples} samples, g {g}"), &scene, samples);
            }
            let around = |i: i32| Light::Directional {
                direction: camera::towards(f64::from(37 * i), f64::from(i - 20)),
                irradiance: Vec3::new(0.1, 0.2, 0.3) * i as f32,
            };
            scene.settings.light_for = LightFor::EveryView;
            let got = check(ctx, &format!("{name}, light for every view"), &scene, 5);
            scene.settings.light_for = LightFor::View;
            directed += usize::from(got != check(ctx, &format!("{name}, light for one view"), &scene, 5));
            scene.lights.extend((0..11).map(around));
            check(ctx, &format!("{name}, 13 lights"), &scene, 3);
        }
        assert!(directed > 0, "B is not seen");
    });
}

#[test]
fn backgrounds_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, mut scene) in scenes() {
            let blue = Vec3::new(0.1, 0.2, 2.0);
            let backgrounds = [
                (Background::Environment, Some(sky())),
                (Background::Color(blue), Some(sky())),
                (Background::Environment, Some(Environment::Constant(blue))),
                (Background::Environment, None),
            ];
            for (background, environment) in cases(backgrounds.to_vec()) {
                (scene.background, scene.environment) = (background, environment);
                let got = check(ctx, &format!("{name}, {background:?}"), &scene, 1);
                assert!(got.iter().all(|p| p.w == 1.0), "{name}: a background leaves no hole");
            }
        }
    });
}

/// Inside the volume, at a voxel's centre, on a face, along an axis through edges, a million units away, and nearly
/// half of the sphere in one picture.
#[test]
fn eyes_in_awkward_places() {
    gpu_test(|ctx| {
        let (_, mut scene) = scenes().swap_remove(0);
        // The box is [2.5, 15.5] x [-20.5, -13.5] x [6.5, 11.5].
        let middle = DVec3::new(9.0, -17.0, 9.0);
        let places = [
            ("inside", DVec3::new(8.2, -16.3, 8.8), DVec3::new(20.0, -10.0, 3.0), 60.0, CUT),
            ("at a centre", middle, middle + DVec3::X, 90.0, CUT),
            ("on a face", DVec3::new(2.5, -17.0, 9.0), middle, 50.0, CUT),
            ("along an edge", DVec3::new(-30.0, -20.5, 6.5), DVec3::new(30.0, -20.5, 6.5), 20.0, CUT),
            ("along an axis", DVec3::new(9.0, -60.0, 9.0), middle, 20.0, CUT),
            // A float of 1e6 resolves 0.06 voxels: so far away a ray is that unsure of where it enters.
            ("far away", middle + DVec3::new(0.0, -1e6, 0.0), middle, 1e-3, 0.05),
            ("wide", middle + DVec3::new(0.0, -9.0, 0.0), middle, 170.0, CUT),
        ];
        for (name, eye, target, fov, tolerance) in cases(places.to_vec()) {
            scene.camera = look_at(eye, target, DVec3::Z, fov);
            let got = check_within(ctx, name, &scene, 1, tolerance);
            assert!(got.iter().all(|p| p.is_finite()), "{name}");
            assert!(got.iter().any(|p| p.w > 0.1), "{name}: sees nothing");
        }
    });
}

/// The picture's axes are those of `Camera::ray`, which frames and documents them.
#[test]
fn pixels_look_where_the_scene_says() {
    gpu_test(|ctx| {
        let mut scene = scene_of(Grid::axis_aligned([3, 2, 1], [1.0; 3], [0.0; 3]), vec![0.0; 6]);
        scene.background = Background::Environment;
        scene.environment = Some(sky());
        scene.settings.size = [16, 5];
        let Some(environment) = scene.environment.clone() else { unreachable!() };
        let got = check(ctx, "sky", &scene, 1);
        let mut differ = 0;
        for y in 0..5 {
            for x in 0..16 {
                let towards = scene.camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5, scene.settings.size);
                let expected = environment.radiance(towards);
                differ += usize::from(got[(y * 16 + x) as usize].truncate() != expected);
            }
        }
        assert_eq!(differ, 0, "pixels that see another texel");
    });
}
