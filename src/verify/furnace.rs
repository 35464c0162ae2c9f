//! The white furnace: radiance 1 from all around is radiance 1 out of any white body.

use super::bodies::{aim, homogeneous, unit_cube};
use super::{Bench, SIGMAS};
use crate::Result;
use crate::cpu::rng;
use crate::scene::{Background, Environment, Model, Sampling, Scene, UNLIMITED};
use crate::volume::{Grid, VoxelData};
use glam::Vec3;

const NOISELESS: &str = "single precision: no path loses weight, so there is no noise";
const CACHED: &str = "of the scattered light 1 % where it is stored at voxels of 0.04 mean free paths, 3 % at 0.3; and 4 standard errors of `path`";
const RISING: &str = "more orders (2, 4, 8, 16, 64) add light, and none goes above 1 by more than 0.5 %";
const NEARLY_ALL: &str = "0.5 %: after 8 scatterings less than 0.1 % of the light is left in thin matter";
const THICK: &str =
    "3 %: less than 0.1 % is left after 64 scatterings, and voxels of 0.3 mean free paths lose the rest";

fn furnace(mut scene: Scene, model: Model, orders: u32) -> Scene {
    scene.environment = Some(Environment::Constant(Vec3::ONE));
    scene.background = Background::Environment;
    (scene.settings.model, scene.settings.orders) = (model, orders);
    scene
}

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    unlimited(bench)?;
    rising(bench)
}

/// Any shape, density and phase function, seen from outside and from inside.
fn unlimited(bench: &mut Bench<'_>) -> Result<()> {
    let grid = Grid::axis_aligned([7, 6, 5], [0.2; 3], [0.1; 3]);
    let values: Vec<f32> = bench.words(3000, 7 * 6 * 5).map(rng::unit_float).collect();
    for (extinction, g) in [(1.0, 0.0), (50.0, 0.9), (50.0, -0.5), (8.0, 0.999), (8.0, -0.999), (8.0, 1e-6)] {
        for (place, origin) in [("outside", [-2.0, 0.5, 0.4]), ("inside", [0.7, 0.6, 0.5])] {
            let mut scene = furnace(homogeneous(grid, extinction, Vec3::ONE), Model::Path, UNLIMITED);
            scene.volume_mut().data = VoxelData::F32(values.clone());
            scene.g = g;
            aim(&mut scene, origin, [1.0, 0.1, 0.2], [16, 16]);
            let pixels = bench.trace(&scene, 16)?.picture.pixels;
            // The pixel that is furthest from 1; a NaN is.
            let far = |c: f32| (f64::from(c) - 1.0).abs();
            let worst = pixels.iter().flat_map(|p| &p[..3]).fold(1.0f32, |a, &b| if far(b) <= far(a) { a } else { b });
            let case = format!("path, heterogeneous, extinction up to {extinction}, g {g}, from {place}: worst pixel");
            bench.check(case, worst.into(), 1.0, 1e-5, NOISELESS);
        }
    }
    Ok(())
}

/// `multiple` comes up to 1 as its orders grow, and has what `path` has on the way.
fn rising(bench: &mut Bench<'_>) -> Result<()> {
    for (name, extinction, n, all_orders, share) in
        [("thin", 0.5, 12, &[2, 4, 8][..], 0.01), ("thick", 6.0, 20, &[2, 4, 8, 16, 64], 0.03)]
    {
        let mut seen = vec![0.0];
        for &orders in all_orders {
            let mut scene = furnace(homogeneous(unit_cube(n), extinction, Vec3::ONE), Model::Multiple, orders);
            scene.settings.sampling = Sampling::Phase;
            scene.settings.directions = 16;
            scene.settings.environment_directions = 32;
            scene.settings.spp = 4;
            aim(&mut scene, [-1.0, 0.45, 0.55], [1.0, 0.0, 0.0], [16, 16]);
            let value = f64::from(bench.render(&scene)?.x);
            scene.settings.model = Model::Path;
            let path = bench.trace(&scene, 256)?;
            let (expected, error) = (path.mean[0], path.mean_error[0]);
            let scattered = expected - (-extinction).exp();
            let case = format!("multiple, {name} cube (tau {extinction}), {orders} orders, against path");
            bench.check(case, value, expected, share * scattered + SIGMAS * error, CACHED);
            seen.push(value);
        }
        let rises = seen.windows(2).filter(|w| w[1] > w[0] && w[1] < 1.005).count();
        bench.check(
            format!("multiple, {name} cube: steps that rise towards 1"),
            rises as f64,
            all_orders.len() as f64,
            0.0,
            RISING,
        );
        let (tolerance, why) = if extinction < 1.0 { (5e-3, NEARLY_ALL) } else { (0.03, THICK) };
        let (last, orders) = (seen[all_orders.len()], all_orders[all_orders.len() - 1]);
        bench.check(format!("multiple, {name} cube, {orders} orders"), last, 1.0, tolerance, why);
    }
    Ok(())
}
