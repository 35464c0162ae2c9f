//! Light scattered once in slabs and in a cube, in closed form or as one integral.

use super::bodies::{PENCIL, aim, beam, homogeneous, look, slab, sun, unit_cube};
use super::{Bench, phase};
use crate::Result;
use crate::scene::{Model, Scene};
use crate::volume::Grid;
use glam::{DVec3, Vec3};

const CACHED: &str =
    "0.4 %: a standard error below 0.1 % of 16,384 stratified points, and rays that end at e⁻⁷ or 1e-3";

/// Radiance of order 1 per albedo of a slab of optical thickness `tau`, irradiance 1 (Chandrasekhar 1960, chapter IX);
/// cosines as in [`look`].
pub fn slab_radiance(tau: f64, g: f64, is_reflected: bool, mu: f64, mu0: f64, phi_degrees: f64) -> f64 {
    let s = (1.0 - mu * mu).max(0.0).sqrt() * (1.0 - mu0 * mu0).max(0.0).sqrt() * phi_degrees.to_radians().cos();
    let p = phase::density(g, if is_reflected { s - mu * mu0 } else { s + mu * mu0 });
    if is_reflected {
        p * mu0 / (mu + mu0) * -(-tau * (1.0 / mu + 1.0 / mu0)).exp_m1()
    } else {
        // (e^−τ/μ₀ − e^−τ/μ) / (μ₀ − μ), without cancellation where the cosines are alike.
        let x = tau * (mu0 - mu).abs() / (mu * mu0);
        let ratio = if x == 0.0 { 1.0 } else { -(-x).exp_m1() / x };
        p * tau / mu * (-tau / mu.max(mu0)).exp() * ratio
    }
}

/// Distances from a point to the faces of the unit cube along `direction`: to the first that the ray enters through,
/// and to the last that it leaves through.
fn crossing(origin: DVec3, direction: DVec3) -> (f64, f64) {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        if direction[axis] != 0.0 {
            let [a, b] = [0.0, 1.0].map(|face| (face - origin[axis]) / direction[axis]);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
    }
    (enter, leave)
}

/// Radiance of order 1 per albedo along a ray through [`unit_cube`] under a beam of irradiance 1: the integral over
/// the ray, by the midpoint rule in double precision.
pub fn box_radiance(extinction: f64, g: f64, travel: [f64; 3], origin: [f64; 3], direction: [f64; 3]) -> f64 {
    const STEPS: u32 = 100_000;
    let [travel, origin, direction] = [travel, origin, direction].map(DVec3::from);
    let (enter, leave) = crossing(origin, direction);
    let step = (leave - enter) / f64::from(STEPS);
    let at = |i: u32| {
        let t = (f64::from(i) + 0.5) * step;
        let lit_through = crossing(origin + (enter + t) * direction, -travel).1;
        (-extinction * (t + lit_through)).exp()
    };
    phase::density(g, -travel.dot(direction)) * extinction * step * (0..STEPS).map(at).sum::<f64>()
}

/// `single` and `path` against the same number.
fn both(bench: &mut Bench<'_>, case: &str, scene: &mut Scene, expected: f64, samples: u32) -> Result<()> {
    scene.settings.orders = 1;
    scene.settings.spp = 16;
    scene.settings.model = Model::Single;
    let seen = bench.render(scene)?.x;
    bench.check(format!("single, {case}"), seen.into(), expected, 4e-3 * expected, CACHED);
    scene.settings.model = Model::Path;
    let estimate = bench.trace(scene, samples)?;
    bench.check_path(format!("path, {case}"), &estimate, expected);
    Ok(())
}

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    for (tau, g, mu, mu0, phi) in
        [(0.1, 0.0, 1.0, 1.0, 0.0), (1.0, 0.0, 1.0, 1.0, 0.0), (1.0, 0.75, 0.6, 0.8, 40.0), (2.0, -0.5, 0.5, 1.0, 0.0)]
    {
        for is_reflected in [true, false] {
            let mut scene = slab(tau, 1e3, Vec3::ONE);
            scene.g = g as f32;
            // Thin voxels: steps are measured in them.
            let layers = 8;
            scene.volume_mut().grid = Grid::axis_aligned([1, 1, layers], [1e3, 1e3, 0.125], [0.0, 0.0, 0.0625]);
            scene.volume_mut().data = crate::volume::VoxelData::F32(vec![1.0; layers as usize]);
            beam(&mut scene, mu0);
            look(&mut scene, is_reflected, mu, phi);
            let side = if is_reflected { "reflected" } else { "transmitted" };
            let case = format!("slab tau {tau}, g {g}, mu {mu}, mu0 {mu0}: {side}");
            both(bench, &case, &mut scene, slab_radiance(tau, g, is_reflected, mu, mu0, phi), 512)?;
        }
    }
    let half = 0.5f64.sqrt();
    let third = 3f64.sqrt().recip();
    let down = [0.0, -1.0, 0.0];
    for (name, extinction, g, travel, origin, direction) in [
        ("lit from the side", 1.0, 0.0, down, [-1.0, 0.75, 0.5], [1.0, 0.0, 0.0]),
        ("lit from behind", 1.0, 0.75, down, [0.5, -1.0, 0.5], [0.0, 1.0, 0.0]),
        ("lit obliquely", 8.0, 0.0, [half, -half, 0.0], [-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]),
        ("oblique ray", 8.0, 0.5, [third, -third, third], [-1.0, 0.3, 0.2], [0.96, 0.192, 0.2036663938904694]),
    ] {
        let mut scene = homogeneous(unit_cube(6), extinction, Vec3::ONE);
        scene.g = g as f32;
        scene.lights.push(sun(travel));
        let direction = DVec3::from(direction).normalize().to_array();
        aim(&mut scene, origin, direction, PENCIL);
        let expected = box_radiance(extinction, g, travel, origin, direction);
        both(bench, &format!("cube of {extinction}, g {g}, {name}"), &mut scene, expected, 512)?;
    }
    Ok(())
}
