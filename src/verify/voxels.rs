//! Matter of one voxel or of many that are alike: the same picture.

use super::bodies::{PENCIL, aim, homogeneous, sun, unit_cube};
use super::{Bench, SIGMAS};
use crate::Result;
use crate::render::path::Estimate;
use crate::scene::{Environment, Model, Sampling, Scene, UNLIMITED};
use glam::Vec3;

const TWO_MEANS: &str = "4 standard errors of the difference: exceeded by chance once in 16,000";
const MARCHED: &str = "0.5 %: other steps and other random numbers along the same rays";
const ONE: &str =
    "1.5 %: a single voxel stores one value of the light of order 2 and up, a few percent of all in thin matter";
const CACHED: &str = "2 %: voxels of 1/5 and of 1/10 of a mean free path store the light of order 2 and up";

fn cube(n: u32, extinction: f64, model: Model) -> Scene {
    let mut scene = homogeneous(unit_cube(n), extinction, Vec3::ONE);
    scene.g = if model == Model::Multiple { 0.0 } else { 0.5 };
    scene.lights.push(sun([0.6, 0.0, -0.8]));
    scene.settings.model = model;
    scene.settings.sampling = Sampling::Phase;
    scene.settings.spp = 16;
    // A pencil of rays meets few cells, and one voxel has but eight: many directions keep their noise low.
    scene.settings.directions = if n == 1 { 1024 } else { 64 };
    aim(&mut scene, [-1.0, 0.3, 0.2], [0.9407208683835973, 0.18814417367671946, 0.2822162605150792], PENCIL);
    scene
}

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    for (extinction, orders) in [(0.5, 1), (4.0, 4), (4.0, UNLIMITED)] {
        let [one, many] = [1, 12].map(|n| {
            let mut scene = cube(n, extinction, Model::Path);
            scene.settings.orders = orders;
            // Both kinds of light.
            scene.environment = Some(Environment::Constant(Vec3::splat(0.2)));
            bench.trace(&scene, 128)
        });
        let (one, many): (Estimate, Estimate) = (one?, many?);
        let error = one.mean_error[0].hypot(many.mean_error[0]);
        let count = if orders == UNLIMITED { "unlimited".to_owned() } else { orders.to_string() };
        let case = format!("path, extinction {extinction}, {count} orders: 1728 voxels and 1");
        bench.check(case, many.mean[0], one.mean[0], SIGMAS * error, TWO_MEANS);
    }
    for extinction in [0.5, 4.0] {
        let one = bench.render(&cube(1, extinction, Model::Single))?.x;
        let many = bench.render(&cube(12, extinction, Model::Single))?.x;
        let case = format!("single, extinction {extinction}: 1728 voxels and 1");
        bench.check(case, many.into(), one.into(), 5e-3 * f64::from(one), MARCHED);
    }
    for (extinction, [few, many], tolerance, why) in [(0.1, [1, 10], 0.015, ONE), (2.0, [10, 20], 0.02, CACHED)] {
        let [coarse, fine] = [few, many].map(|n| bench.render(&cube(n, extinction, Model::Multiple)));
        let [coarse, fine] = [coarse?, fine?].map(|mean| f64::from(mean.x));
        let case = format!(
            "multiple, extinction {extinction}, 4 orders: {} voxels and {}",
            few * few * few,
            many * many * many
        );
        bench.check(case, coarse, fine, tolerance * fine, why);
    }
    Ok(())
}
