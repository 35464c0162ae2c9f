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
use spheres::{Lit, Probe, Seen, probes};
use std::collections::BTreeMap;
use tyndall::vk::Context;

/// Voxels across the sphere.
const VOXELS: [u32; 3] = [16, 32, 64];
/// What a value may be off by with the finest voxels, by class: the kind of view and the optical radius; about a third more
/// than the worst that was measured. Of light from all around it is a part of the sky's radiance.
const BOUNDS: [(&str, f64); 9] = [
    ("discs R0.5", 0.015),
    ("discs R2", 0.025),
    ("discs R8", 0.22),
    ("discs against the beam R0.5", 0.015),
    ("discs against the beam R2", 0.025),
    ("discs against the beam R8", 1.3),
    ("rays R0.5", 0.015),
    ("rays R2", 0.015),
    ("rays R8", 0.015),
];
/// Samples of every pixel that a measurement takes at most.
const MOST_SAMPLES: u32 = 1 << 14;

/// Relative deviations of one channel for every size of voxels, and where they lead to, each with its standard error.
#[derive(Debug)]
struct Refined {
    deviations: [f64; 3],
    errors: [f64; 3],
    is_extrapolated: bool,
    limit: f64,
    limit_error: f64,
}

/// Extrapolates a deviation that goes with some power of the voxels' size to voxels of none (Aitken's rule). Where there
/// is no such power to be seen in the noise, the finest is the limit.
fn refine(deviations: [f64; 3], errors: [f64; 3]) -> Refined {
    let [a, b, c] = deviations;
    let (first, second) = (b - a, c - b);
    let ratio = second / first;
    let is_extrapolated = first.abs() > 8.0 * errors[0].hypot(errors[1]) && ratio > 0.1 && ratio < 0.7;
    let (limit, limit_error) = if is_extrapolated {
        let q = ratio / (1.0 - ratio);
        let slope = 1.0 / (1.0 - ratio).powi(2);
        // c + q (c − b), of which q = second / (first − second): derivatives by a, b and c.
        let by = [ratio * ratio * slope, -2.0 * ratio * slope, slope];
        (c + q * second, (0..3).map(|i| (by[i] * errors[i]).powi(2)).sum::<f64>().sqrt())
    } else {
        (c, errors[2])
    };
    Refined { deviations, errors, is_extrapolated, limit, limit_error }
}

fn percent(x: f64) -> String {
    format!("{:.2} %", 100.0 * x)
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(n.max(1))).sqrt()
}

/// What `path` sees of a sphere of `n` voxels across, the first channel.
fn deviation(ctx: &Context, probe: &Probe, n: u32) -> (f64, f64) {
    let (scene, reading) = probe.scene(n);
    let unit = probe.unit()[0];
    // The channels of a render share its paths: the first counts.
    let m = measure(ctx, &scene, [unit * reading.share, 0.0, 0.0], PRECISION, MOST_SAMPLES);
    ((reading.disc(m.mean[0]) - probe.expected[0]) / unit, m.error[0] / reading.share / unit)
}

/// Measures all probes on all grids and judges them class by class.
fn judge(ctx: &Context, probes: &[&Probe]) {
    let mut classes: BTreeMap<String, Vec<Refined>> = BTreeMap::new();
    let mut failures = Vec::new();
    for probe in probes {
        let [a, b, c] = VOXELS.map(|n| deviation(ctx, probe, n));
        let refined = refine([a.0, b.0, c.0], [a.1, b.1, c.1]);
        println!(
            "{} {}: {:.5}, deviations {} ± {}, limit {} ± {}",
            probe.id,
            probe.what,
            probe.expected[0],
            refined.deviations.map(percent).join(" "),
            percent(refined.errors[2]),
            percent(refined.limit),
            percent(refined.limit_error)
        );
        // The power itself grows with finer voxels: a part of the last deviation is extrapolated wrongly.
        let allowed =
            MOST_Z * refined.limit_error + 0.25 * refined.deviations[2].abs() + probe.uncertainty / probe.unit()[0];
        if refined.is_extrapolated && refined.limit.abs() > allowed {
            failures.push(format!("{} {}: limit {} of {allowed}", probe.id, probe.what, refined.limit));
        }
        let kind = match (probe.seen, probe.lit) {
            (Seen::Ray(_), _) => "rays",
            // Through many mean free paths only the edge is seen, the part that the grid gets wrong.
            (Seen::Disc(0.0), Lit::Beam) => "discs against the beam",
            _ => "discs",
        };
        let class = format!("{kind} R{}", probe.optical_radius);
        classes.entry(class).or_default().push(refined);
    }
    for (class, all) in &classes {
        let rms = [0, 1, 2].map(|i| root_mean_square(all.iter().map(|r| r.deviations[i])));
        let worst = all.iter().map(|r| r.deviations[2].abs()).fold(0.0, f64::max);
        let bound = BOUNDS.iter().find(|(name, _)| class == name).unwrap_or_else(|| panic!("{class}")).1;
        println!(
            "{class}: {} values, root mean square {}, worst of the finest {} of {}",
            all.len(),
            rms.map(percent).join(" "),
            percent(worst),
            percent(bound)
        );
        // The root mean square has a floor of noise, and is NaN where a value is.
        let falls = rms.windows(2).all(|w| w[1] <= 0.6 * w[0] + 1.3 * PRECISION);
        if worst > bound || !falls {
            failures.push(format!("{class}: {rms:?}, worst {worst}"));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn some_spheres() {
    gpu_test(|ctx, table| {
        let probes = probes(table);
        // Those that deviate so much that they can be extrapolated, and some of all that take no seconds.
        let clear = [
            ("F-intensity-R2-g0", "intensity_order Disc(45.0) up to 2"),
            ("F-intensity-R2-g0.5", "intensity at 0"),
            ("F-beam-R2-g0.5", "escape_backward_order Disc(0.0) up to 1"),
            ("F-beam-R8-g0", "escape_backward_order Disc(0.0) up to 5"),
        ];
        let is_clear = |p: &&Probe| clear.contains(&(p.id.as_str(), p.what.as_str()));
        let is_quick = |p: &&Probe| p.optical_radius < 8.0 || p.g == 0.0;
        let mut chosen: Vec<&Probe> = probes.iter().filter(is_clear).collect();
        assert_eq!(chosen.len(), clear.len(), "the table has shrunk");
        chosen.extend(probes.iter().filter(is_quick).step_by(61));
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
