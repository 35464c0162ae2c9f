//! Homogeneous bodies and pencils of rays, for comparisons with known numbers.

#![allow(dead_code, reason = "each test file uses a part of it")]

use crate::bodies::scene_of;
use glam::{DVec3, DVec4, Vec3, Vec4};
use tyndall::output::Picture;
use tyndall::scene::camera::look_at;
use tyndall::scene::{Light, Model, OpacityUnit, Scene, TransferFunction, TransferPoint};
use tyndall::volume::Grid;

/// Mean over the pixels.
pub fn mean(picture: &Picture) -> Vec4 {
    let sum: DVec4 = picture.pixels.iter().map(|&p| Vec4::from(p).as_dvec4()).sum();
    (sum / picture.pixels.len() as f64).as_vec4()
}

/// One extinction, albedo and emission where the scalar is 1, nothing where it is 0, linear in between.
pub fn matter(extinction: f64, albedo: Vec3, emission: Vec3) -> TransferFunction {
    let point = |value: f64| TransferPoint {
        value,
        color: albedo.to_array(),
        opacity: (value * extinction) as f32,
        emission: emission.to_array(),
    };
    TransferFunction { points: vec![point(0.0), point(1.0)], opacity_unit: OpacityUnit::Extinction }
}

/// A homogeneous box in darkness, before a transparent background.
pub fn homogeneous(grid: Grid, extinction: f64, albedo: Vec3) -> Scene {
    let mut scene = scene_of(grid, vec![1.0; grid.voxels() as usize]);
    scene.transfer = matter(extinction, albedo, Vec3::ZERO);
    scene.albedo_scale = Vec3::ONE;
    scene.lights.clear();
    scene.environment = None;
    scene.settings.model = Model::Single;
    scene.settings.spp = 1;
    scene
}

/// The cube [0,1]³ in `n`³ voxels.
pub fn unit_cube(n: u32) -> Grid {
    let spacing = 1.0 / f64::from(n);
    Grid::axis_aligned([n; 3], [spacing; 3], [spacing / 2.0; 3])
}

pub fn sun(direction: [f64; 3]) -> Light {
    Light::Directional { direction: direction.into(), irradiance: Vec3::ONE }
}

#[track_caller]
pub fn assert_near(case: &str, got: f32, expected: f64, tolerance: f64) {
    let error = f64::from(got) - expected;
    assert!(error.abs() <= tolerance, "{case}: {got} instead of {expected}, error {error:e}, allowed {tolerance:e}");
}

/// Aims the camera so that every pixel sees the same ray.
pub fn aim(scene: &mut Scene, origin: [f64; 3], direction: [f64; 3], size: [u32; 2]) {
    let (origin, direction) = (DVec3::from(origin), DVec3::from(direction));
    let up = if direction.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
    scene.camera = look_at(origin, origin + direction, up, 1e-4);
    scene.settings.size = size;
}
