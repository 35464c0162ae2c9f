//! exp(−τ): along camera rays, by marching and by delta tracking, and towards a light, by ratio tracking.

use super::bodies::{PENCIL, aim, homogeneous, slab, sun, unit_cube};
use super::{Bench, ROUNDING, SIGMAS, STATISTICAL};
use crate::Result;
use crate::scene::{Background, Model};
use crate::volume::{Grid, VoxelData};
use glam::Vec3;
use std::f64::consts::PI;

const MARCHED: &str = "single precision: 3e-6 of the sum of the steps' optical depths, and of 1 − T";
const THIN: &str =
    "single precision below 1 has steps of 6e-8, one lost in each of 10 steps of the ray; no opacity would fail";
const CUT_OFF: &str = "camera rays end at a transmittance of 1e-3: what is darker is not told apart";
const SHADOW: &str = "shadow rays end at e⁻⁷ of the light, and steps are summed in single precision: 1e-3 and 0.2 %";

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    marched(bench)?;
    tracked(bench)?;
    towards_a_light(bench)
}

/// Along an axis and along the diagonal of a cube, in voxels.
fn marched(bench: &mut Bench<'_>) -> Result<()> {
    let third = 3f64.sqrt().recip();
    let axis = ("axis", [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], 1.0);
    let diagonal = ("diagonal", [-1.0; 3], [third; 3], 3f64.sqrt());
    let depths = [(1e-6, axis), (1e-4, axis), (1e-2, diagonal), (1.0, axis), (1.0, diagonal), (5.0, axis)];
    let dark = [(10.0, axis), (100.0, diagonal), (1e4, axis)];
    for (tau, (way, origin, direction, length)) in depths.into_iter().chain(dark) {
        let mut scene = homogeneous(unit_cube(5), tau / length, Vec3::ZERO);
        scene.background = Background::Color(Vec3::ONE);
        aim(&mut scene, origin, direction, [4, 4]);
        let transmitted = bench.render(&scene)?.x;
        let expected = (-tau).exp();
        let (tolerance, why) = if expected > 1e-3 { (3e-6, MARCHED) } else { (1e-3, CUT_OFF) };
        bench.check(format!("camera ray, {way}, tau {tau:e}"), transmitted.into(), expected, tolerance, why);
        scene.background = Background::Transparent;
        let opacity = bench.render(&scene)?.w;
        let (tolerance, why) = if tau < 1e-3 { (8e-7, THIN) } else { (tolerance, why) };
        bench.check(format!("opacity, {way}, tau {tau:e}"), opacity.into(), -(-tau).exp_m1(), tolerance, why);
    }
    Ok(())
}

/// The same by delta tracking: a path arrives or does not.
fn tracked(bench: &mut Bench<'_>) -> Result<()> {
    for tau in [1e-6, 1e-3, 1e-1, 1.0, 8.0, 1e4] {
        let mut scene = slab(tau, 2.0, Vec3::ZERO);
        scene.background = Background::Color(Vec3::ONE);
        aim(&mut scene, [0.1, 0.2, 2.0], [0.0, 0.0, -1.0], PENCIL);
        let samples = 256;
        let got = bench.trace(&scene, samples)?.mean[0];
        let (t, n) = ((-tau).exp(), f64::from(samples * PENCIL[0] * PENCIL[1]));
        // Of a count of n trials, and one event more: a Poisson count is not normal where it is small.
        let tolerance = SIGMAS * (t * (1.0 - t) / n).sqrt() + 3.0 / n;
        bench.check(format!("path, camera ray, tau {tau:e}"), got, t, tolerance, COUNTED);
    }
    Ok(())
}

const COUNTED: &str = "4 standard deviations of a count of 262,144 paths, and 3 paths where so few arrive or stay";

/// A camera ray at right angles to the light, at a depth below the lit face: every point of it is lit through the same
/// matter. Radiance of order 1 over that without shadow is the transmittance.
fn towards_a_light(bench: &mut Bench<'_>) -> Result<()> {
    // Extinction grows downwards from voxel centre to voxel centre, and is flat beyond the outer centres.
    let layers = 8u32;
    let sizes: Vec<f64> = (0..layers).map(|i| f64::from(layers - i) / f64::from(layers)).collect();
    let ramp = |z: f64| {
        let at = (z * f64::from(layers) - 0.5).clamp(0.0, f64::from(layers - 1));
        let below = (at as usize).min(layers as usize - 2);
        sizes[below] + (sizes[below + 1] - sizes[below]) * (at - below as f64)
    };
    // Linear pieces with ends at the centres: the trapezoidal rule on any refinement is exact.
    let above = |z: f64| {
        let pieces = 16 * layers;
        let inner = (0..=pieces).map(|i| f64::from(i) / f64::from(pieces)).filter(|&x| x > z);
        let knots: Vec<f64> = std::iter::once(z).chain(inner).collect();
        knots.windows(2).map(|w| (w[1] - w[0]) * (ramp(w[0]) + ramp(w[1])) / 2.0).sum::<f64>()
    };
    let values: Vec<f32> = (0..layers).flat_map(|i| [sizes[i as usize] as f32; 4]).collect();
    let grid =
        Grid::axis_aligned([2, 2, layers], [0.5, 0.5, 1.0 / f64::from(layers)], [0.25, 0.25, 0.5 / f64::from(layers)]);
    let z = 0.1875;
    for tau in [1e-3, 0.1, 1.0, 3.0, 6.0] {
        let extinction = tau / above(z);
        let mut scene = homogeneous(grid, extinction, Vec3::ONE);
        scene.volume_mut().data = VoxelData::F32(values.clone());
        scene.lights.push(sun([0.0, 0.0, -1.0]));
        scene.settings.orders = 1;
        aim(&mut scene, [-1.0, 0.4, z], [1.0, 0.0, 0.0], PENCIL);
        let unshadowed = -(-extinction * ramp(z)).exp_m1() / (4.0 * PI);
        let expected = (-tau).exp();
        scene.settings.spp = 4;
        let marched = f64::from(bench.render(&scene)?.x) / unshadowed;
        let tolerance = 2e-3 * expected + 1e-3;
        bench.check(format!("shadow ray, tau {tau:e}"), marched, expected, tolerance, SHADOW);
        // Few rays meet thin matter: more of them.
        if tau >= 0.1 {
            scene.settings.model = Model::Path;
            let e = bench.trace(&scene, 512)?;
            let error = SIGMAS * e.mean_error[0] / unshadowed + ROUNDING * expected;
            bench.check(
                format!("path, ratio tracking, tau {tau:e}"),
                e.mean[0] / unshadowed,
                expected,
                error,
                STATISTICAL,
            );
        }
    }
    Ok(())
}
