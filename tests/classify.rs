//! Classification against its CPU twin.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, assert_close, cases, scene_of, scenes, texture};
use common::gpu_test;
use tyndall::cpu::classify;
use tyndall::passes::classify::{Classify, Emitted};
use tyndall::passes::compact::Listed;
use tyndall::scene::{OpacityUnit, Precision, Scene};
use tyndall::vk::{Context, ImageFormat, Recorder};
use tyndall::volume::Grid;

/// Half floats have 11 bits, and what is stored was rounded to them: 2⁻¹² of it at most, and what both compute. Below their smallest
/// normal (6e-5 in units where extinction is at most 1 and light a few thousand) the error is absolute.
const ROUNDING: f32 = 5e-4;
const SMALLEST: f32 = 1e-7;

fn check_field(ctx: &Context, name: &str, scene: &Scene) {
    for (precision, rounding) in [(Precision::Half, ROUNDING), (Precision::Single, 1e-5)] {
        let mut scene = scene.clone();
        scene.settings.precision = precision;
        check_precision(ctx, name, &scene, rounding);
    }
}

fn check_precision(ctx: &Context, name: &str, scene: &Scene, rounding: f32) {
    let setup = Setup::new(ctx, scene);
    let host = &setup.host;
    for emitted in [Emitted::Nothing, Emitted::Emission, Emitted::Color] {
        let pass = Classify::new(ctx, &setup.data, emitted).unwrap();
        let field = setup.data.field(ctx, "field", host.params.dims).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        pass.record(&mut rec, &setup.data, &field);
        rec.submit_and_wait().unwrap();
        assert!(std::ptr::eq(pass.extinction(&field), &raw const field), "an image of its own, that was not asked for");
        let expected = classify::field(&host.params, &host.points, &host.scalar, emitted);
        let (got, case) = (texture(ctx, &field), format!("{name}, {emitted:?}, {:?}", scene.settings.precision));
        assert_close(&case, &got.texels, &expected.texels, rounding, SMALLEST);
        let scattering = setup.data.scattering(&field);
        if setup.data.has_even_albedo {
            assert!(std::ptr::eq(scattering, &raw const field), "{case}: not made out of the extinction");
        } else {
            assert_close(&case, &texture(ctx, scattering).texels, &host.scattering.texels, rounding, SMALLEST);
        }

        // The extinction alone is the same to the last bit.
        let pass = Classify::with_extinction(ctx, &setup.data, emitted).unwrap();
        let again = setup.data.field(ctx, "field", host.params.dims).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        pass.record(&mut rec, &setup.data, &again);
        rec.submit_and_wait().unwrap();
        assert!(texture(ctx, &again) == got, "{case}: not the same field");
        let alone = pass.extinction(&again);
        if alone.format() != ImageFormat::Alpha32Float {
            println!("SKIP extinction alone: the device cannot interpolate it");
            continue;
        }
        let values: Vec<f32> = ctx.read_back_image(alone).unwrap();
        assert!(values.iter().zip(&got.texels).all(|(value, texel)| *value == texel.w), "{case}: {values:?}");
    }
}

#[test]
fn fields_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            check_field(ctx, name, &scene);
        }
    });
}

#[test]
fn opacities_and_extinctions_of_every_size() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([64, 1, 1], [1.0, 1.0, 1.0], [0.0; 3]);
        // Scalars at, between and beyond the points.
        let mut scene = scene_of(grid, (0..64).map(|i| -0.1 + 1.2 * i as f32 / 63.0).collect());
        for (i, opacity) in [0.0, 1e-4, 0.5, 1.0].into_iter().enumerate() {
            scene.transfer.points[i].opacity = opacity;
        }
        let units = vec![OpacityUnit::PerDistance(None), OpacityUnit::PerDistance(Some(7.0)), OpacityUnit::Extinction];
        for unit in cases(units) {
            scene.transfer.opacity_unit = unit;
            check_field(ctx, &format!("{unit:?}"), &scene);
        }
    });
}

/// A step holds its later point, NaN is empty, infinities are the ends of the scale.
#[test]
fn steps_and_scalars_that_are_no_numbers() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([6, 1, 1], [1.0; 3], [0.0; 3]);
        let below = f32::from_bits(0.3f32.to_bits() - 1);
        let values = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.3, below, 1e-42];
        let setup = Setup::new(ctx, &scene_of(grid, values));
        let alpha: Vec<f32> = texture(ctx, &setup.field).texels.iter().map(|t| t.w).collect();
        let step = alpha[3];
        assert!(step > 0.2 && step < 0.25, "2 of 9: {alpha:?}");
        assert_eq!(alpha, [0.0, 1.0, 0.0, step, 0.0, 0.0]);
        assert_eq!(setup.list(ctx, Listed::Voxels).1, [1, 3]);
    });
}
