//! Comparisons with known numbers: the bodies and pencils of rays of `verify`, further ones, and a tolerant assertion.

#![allow(dead_code, unused_imports, reason = "each test file uses a part of it")]

use glam::{DMat3, DVec3, Vec3};
use tyndall::scene::{Environment, LatLong, Scene};
pub use tyndall::verify::bodies::*;
use tyndall::volume::{Grid, VoxelData};

#[track_caller]
pub fn assert_near(case: &str, got: f32, expected: f64, tolerance: f64) {
    let error = f64::from(got) - expected;
    assert!(error.abs() <= tolerance, "{case}: {got} instead of {expected}, error {error:e}, allowed {tolerance:e}");
}

/// Radiance 1 from every direction above.
pub fn upper_half() -> Environment {
    let pixels = vec![[1.0; 3], [1.0; 3], [0.0; 3], [0.0; 3]];
    Environment::LatLong(LatLong { width: 2, height: 2, pixels, rotation_degrees: 0.0 })
}

/// A white ball of radius 1 at the origin in darkness, `n` voxels across: every voxel's value is the share of it that is
/// inside. Two more voxels are on every side; the grid is turned, so that no direction of the world is special in it.
pub fn ball(n: u32, optical_radius: f64) -> Scene {
    /// Points per axis at which a voxel on the surface is asked whether it is inside.
    const FINE: u32 = 8;
    let (h, dims) = (2.0 / f64::from(n), n + 4);
    let turn = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(0.8);
    let first = -h * (f64::from(dims) - 1.0) / 2.0;
    let grid = Grid::oriented([dims; 3], turn * h, (turn * DVec3::splat(first)).to_array());
    let point = |i: u32, m: u32| DVec3::new(f64::from(i % m), f64::from(i / m % m), f64::from(i / m / m));
    let share = |i: u32| {
        let middle = DVec3::splat(first) + h * point(i, dims);
        if (middle.length() - 1.0).abs() > h {
            return if middle.length() < 1.0 { 1.0 } else { 0.0 };
        }
        let place = |k: u32| middle + h * ((point(k, FINE) + 0.5) / f64::from(FINE) - 0.5);
        (0..FINE.pow(3)).filter(|&k| place(k).length() < 1.0).count() as f32 / FINE.pow(3) as f32
    };
    let mut scene = homogeneous(grid, optical_radius, Vec3::ONE);
    scene.volume_mut().data = VoxelData::F32((0..dims.pow(3)).map(share).collect());
    scene
}
