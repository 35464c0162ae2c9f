//! The phase function and its sampler on the device against their twins.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{cases, random_values};
use common::gpu_test;
use glam::Vec3;
use tyndall::cpu::sphere::{phase_hg, sample_hg};
use tyndall::passes::phase_probe::PhaseProbe;
use tyndall::verify::phase::{DENSITY_ERROR, RANGE};

#[test]
fn density_and_samples_agree_with_the_twins() {
    gpu_test(|ctx| {
        let probe = PhaseProbe::new(ctx).unwrap();
        let befores = [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::new(0.48, -0.6, 0.64), Vec3::new(1e-3, 2e-3, -1.0)];
        for before in cases(befores.to_vec()).into_iter().map(Vec3::normalize) {
            for g in RANGE {
                // No multiple of the workgroup.
                let n = 1001;
                let mut cosines: Vec<f32> = random_values(1, n).iter().map(|x| 2.0 * x - 1.0).collect();
                cosines[..3].copy_from_slice(&[-1.0, 0.0, 1.0]);
                let mut randoms: Vec<[f32; 2]> = random_values(2, 2 * n).chunks(2).map(|u| [u[0], u[1]]).collect();
                randoms[0] = [0.0, 0.0];
                randoms[1] = [1.0 - f32::EPSILON / 2.0, 0.5];
                let (densities, directions) = probe.evaluate(ctx, g, before, &cosines, &randoms).unwrap();
                assert_eq!((densities.len(), directions.len()), (n, n));
                for i in 0..n {
                    let p = phase_hg(g, cosines[i]);
                    let error = (densities[i] / p - 1.0).abs();
                    // The twin rounds its double precision once.
                    assert!(f64::from(error) < DENSITY_ERROR + 1e-7, "g {g}, {}: {} {p}", cosines[i], densities[i]);
                    let v = sample_hg(g, before, randoms[i]);
                    let apart = (directions[i] - v).length();
                    assert!(apart < 3e-6, "g {g}, {before}, {:?}: {} {v}", randoms[i], directions[i]);
                }
            }
        }
    });
}
