//! The path tracer against the table of reference values for radiative transfer (DESIGN section 5): `transport.json` in
//! the folder `shared/reference` beside the checkout, or in the one that TYNDALL_REFERENCE names. Its README.md says
//! what each number means. The table is not part of the repository.
//!
//! Slabs are single voxels, 1 thick and `WIDTH` wide: `path` has no grid error, and a test shows that the width does not
//! matter. Every value is measured to a standard error of 0.3 %; three albedos are three channels of one render.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/transport.rs"]
mod transport;

use glam::{DVec3, Vec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;
use transport::{aim, beam, homogeneous, look, matter, sun, unit_cube};
use tyndall::cpu;
use tyndall::passes::phase_probe::PhaseProbe;
use tyndall::render::path::PathRender;
use tyndall::scene::{Background, Environment, LatLong, Model, Scene, UNLIMITED};
use tyndall::verify::phase::{self, DENSITY_ERROR};
use tyndall::verify::single::slab_radiance;
use tyndall::vk::{Context, Validation};
use tyndall::volume::{Grid, VoxelData};

/// Standard error that measurements reach, relative.
const PRECISION: f64 = 3e-3;
/// Largest |z| of a single value: of the about 1000 in the table's full sweep, chance exceeds it once in 16 sweeps.
const MOST_Z: f64 = 4.0;
/// Width of slabs over their thickness.
const WIDTH: f64 = 1e4;

fn table() -> Option<Value> {
    let folder =
        std::env::var_os("TYNDALL_REFERENCE").map_or_else(|| PathBuf::from("../shared/reference"), PathBuf::from);
    let path = folder.join("transport.json");
    match std::fs::read_to_string(&path) {
        Ok(text) => Some(serde_json::from_str(&text).unwrap()),
        Err(error) => {
            println!("SKIP reference values: {}: {error}", path.display());
            None
        }
    }
}

/// A render, and what its three channels should be.
struct Probe {
    id: String,
    what: String,
    scene: Scene,
    expected: [f64; 3],
    uncertainty: f64,
}

struct Measured {
    mean: [f64; 3],
    error: [f64; 3],
}

/// Renders until every channel's standard error is `PRECISION` of what it should be, or `samples` are taken.
fn measure(ctx: &Context, scene: &Scene, expected: [f64; 3], samples: u32) -> Measured {
    let mut render = PathRender::new(ctx, scene).unwrap();
    let mut count = 16;
    loop {
        render.advance(count, &mut |_| ControlFlow::Continue(())).unwrap();
        let e = render.sums().unwrap().estimate(scene.settings.size);
        let missing = (0..3)
            .filter(|&c| expected[c] > 0.0)
            .map(|c| (e.mean_error[c] / (PRECISION * expected[c])).powi(2))
            .fold(0.0, f64::max);
        let taken = render.samples();
        if missing <= 1.0 || taken >= samples {
            // What one path in all may do is not told apart, even where no path differs from another.
            let paths = e.picture.pixels.len() as f64 * f64::from(taken);
            let error = [0, 1, 2].map(|c| e.mean_error[c].max(expected[c] / paths));
            return Measured { mean: e.mean, error };
        }
        // As many as are missing, but no leap by an error that is not known well yet.
        let more = f64::from(taken) * (1.02 * missing - 1.0).clamp(0.05, 7.0);
        count = (more.ceil() as u32).min(samples - taken).max(1);
    }
}

fn number(parameters: &Value, name: &str) -> f64 {
    parameters[name].as_f64().unwrap_or_else(|| panic!("{name} in {parameters}"))
}

/// A slab from z = 0 to 1 of three albedos in darkness, `orders` of scattering.
fn slab(tau: f64, g: f64, albedo: [f64; 3], orders: u32) -> Scene {
    let mut scene = transport::slab(tau, WIDTH, Vec3::from(albedo.map(|a| a as f32)));
    scene.g = g as f32;
    scene.settings.orders = orders;
    scene.settings.max_events = 1_000_000;
    scene
}

/// Radiance 1 from every direction above.
fn upper_half() -> Environment {
    let pixels = vec![[1.0; 3], [1.0; 3], [0.0; 3], [0.0; 3]];
    Environment::LatLong(LatLong { width: 2, height: 2, pixels, rotation_degrees: 0.0 })
}

/// How each problem is set up, or why it is not.
fn probes(table: &Value) -> (Vec<Probe>, BTreeMap<String, &'static str>) {
    let mut probes = Vec::new();
    let mut skipped = BTreeMap::new();
    for case in table["cases"].as_array().unwrap() {
        let (id, p) = (case["id"].as_str().unwrap().to_owned(), &case["parameters"]);
        let quantities = || case["quantities"].as_array().unwrap().iter();
        let value = |q: &Value| (number(q, "value"), number(q, "uncertainty"));
        let at = |q: &Value, name: &str| q["at"][name].as_f64();
        let mut add = |what: String, scene: Scene, expected: [f64; 3], uncertainty: f64| {
            // Below that too few paths arrive to measure it.
            if expected[0] > 1e-4 {
                let mut scene = scene;
                // Values of one set of random numbers would be wrong together, and their chi-square too wide.
                scene.settings.seed = probes.len() as u64;
                probes.push(Probe { id: id.clone(), what, scene, expected, uncertainty });
            }
        };
        let reason = match case["problem"].as_str().unwrap() {
            "slab_single_scattering" if number(p, "tau") < 1e-2 => "met by one path in a hundred at most",
            "slab_single_scattering" => {
                for (name, reflected) in
                    [("single_reflected_radiance_per_albedo", true), ("single_transmitted_radiance_per_albedo", false)]
                {
                    let q = quantities().find(|q| q["name"] == name).unwrap();
                    let (radiance, uncertainty) = value(q);
                    let phi = p["phi_degrees"].as_f64().unwrap_or(0.0);
                    // What `verify` expects is the table's value.
                    let [tau, g, mu, mu0] = ["tau", "g", "mu", "mu0"].map(|name| number(p, name));
                    let closed = slab_radiance(tau, g, reflected, mu, mu0, phi);
                    assert!((closed - radiance).abs() <= 1e-9 * radiance + 1e-300, "{id} {name}: {closed}");
                    if radiance > 1e-6 {
                        let mut scene = slab(tau, g, [1.0, 0.5, 0.25], 1);
                        beam(&mut scene, mu0);
                        look(&mut scene, reflected, mu, phi);
                        add(name.to_owned(), scene, [1.0, 0.5, 0.25].map(|a| a * radiance), uncertainty);
                    }
                }
                ""
            }
            "box_single_scattering" if number(p, "sigma_t") < 1e-2 => "met by one path in a hundred at most",
            "box_single_scattering" => {
                let vector = |name: &str| [0, 1, 2].map(|i| p[name][i].as_f64().unwrap());
                let q = quantities().find(|q| q["name"] == "single_radiance_per_albedo").unwrap();
                let (radiance, uncertainty) = value(q);
                let mut scene = homogeneous(unit_cube(5), number(p, "sigma_t"), Vec3::new(1.0, 0.5, 0.25));
                (scene.settings.model, scene.settings.orders, scene.g) = (Model::Path, 1, number(p, "g") as f32);
                scene.lights.push(sun(vector("light_travel_direction")));
                aim(&mut scene, vector("ray_origin"), vector("ray_direction"), [32, 32]);
                add("single_radiance".into(), scene, [1.0, 0.5, 0.25].map(|a| a * radiance), uncertainty);
                ""
            }
            "ray_transmittance_linear" | "ray_transmittance_exponential" | "ray_transmittance_gaussian" => {
                "a profile that voxels only approximate; `verify` has a piecewise linear one"
            }
            "ray_transmittance_steps" => "interpolation has no steps",
            "slab_multiple_scattering" | "slab_published_radiance" => {
                let albedo = number(p, "albedo");
                for q in quantities() {
                    let name = q["name"].as_str().unwrap();
                    let reflected = name.starts_with("radiance_reflected");
                    if !name.starts_with("radiance") {
                        continue;
                    }
                    let (radiance, uncertainty) = value(q);
                    let mut scene = slab(number(p, "tau"), number(p, "g"), [albedo; 3], UNLIMITED);
                    let mu = at(q, "mu").unwrap();
                    if name.ends_with("uniform_above") {
                        (scene.environment, scene.background) = (Some(upper_half()), Background::Environment);
                    } else {
                        beam(&mut scene, at(q, "mu0").or(p["mu0"].as_f64()).unwrap());
                    }
                    look(&mut scene, reflected, mu, at(q, "phi_degrees").unwrap_or(0.0));
                    add(format!("{name} {}", q["at"]), scene, [radiance; 3], uncertainty);
                }
                ""
            }
            "slab_orders" => {
                // Sums over the orders 1 to K, of three albedos.
                let mut sums: BTreeMap<String, ([f64; 3], f64)> = BTreeMap::new();
                let albedo = [1.0, 0.9, 0.5];
                for q in quantities() {
                    let name = q["name"].as_str().unwrap();
                    if !name.starts_with("radiance") {
                        continue;
                    }
                    let mut place = q["at"].clone();
                    let order = place["order"].take().as_u64().unwrap() as u32;
                    let (sum, error) = sums.entry(format!("{name} {place}")).or_default();
                    for c in 0..3 {
                        sum[c] += number(q, "value") * f64::powi(albedo[c], order as i32);
                    }
                    *error += number(q, "uncertainty");
                    let mut scene = slab(number(p, "tau"), number(p, "g"), albedo, order);
                    beam(&mut scene, at(q, "mu0").unwrap());
                    let reflected = name.starts_with("radiance_reflected");
                    look(&mut scene, reflected, at(q, "mu").unwrap(), at(q, "phi_degrees").unwrap_or(0.0));
                    add(format!("{name} {} summed", q["at"]), scene, *sum, *error);
                }
                ""
            }
            "half_space_radiance" => {
                // exp(−2 k τ) of the light comes back from beyond the depth τ, k = √(3 (1 − a)): less than 1e-12.
                let albedo = number(p, "albedo");
                for q in quantities() {
                    let (radiance, uncertainty) = value(q);
                    let mut scene = slab(80.0, 0.0, [albedo; 3], UNLIMITED);
                    beam(&mut scene, at(q, "mu0").unwrap());
                    look(&mut scene, true, at(q, "mu").unwrap(), 0.0);
                    add(format!("reflected_radiance {}", q["at"]), scene, [radiance; 3], uncertainty);
                }
                ""
            }
            "slab_uniform_environment" | "slab_uniform_environment_orders" => {
                let mut sums: BTreeMap<String, f64> = BTreeMap::new();
                for q in quantities() {
                    let (radiance, uncertainty) = value(q);
                    let mu = at(q, "mu").unwrap();
                    let order = at(q, "order");
                    let sum = sums.entry(mu.to_string()).or_default();
                    *sum += radiance;
                    if order == Some(0.0) {
                        continue;
                    }
                    let orders = order.map_or(UNLIMITED, |k| k as u32);
                    let albedo = p["albedo"].as_f64().unwrap_or(1.0);
                    let mut scene = slab(number(p, "tau"), number(p, "g"), [albedo; 3], orders);
                    scene.environment = Some(Environment::Constant(Vec3::ONE));
                    scene.background = Background::Environment;
                    look(&mut scene, true, mu, 0.0);
                    let expected = if order.is_some() { *sum } else { radiance };
                    add(format!("radiance_out {}", q["at"]), scene, [expected; 3], uncertainty);
                }
                ""
            }
            "white_furnace" => "its noise is zero: `a_white_furnace_is_white` has it exactly",
            // No renders: `the_phase_function` has them.
            "hg_value" | "hg_moments" | "hg_cdf" | "hg_inverse_cdf" => "",
            "sphere_uniform_environment" | "sphere_orders" => {
                "no voxel grid is a sphere: `spheres` shows the refinement"
            }
            "sphere_beam_hemispheres" | "sphere_beam_intensity" => "powers in all directions, no radiance of a ray",
            "half_space_H" | "half_space_reflectance" | "slab_published_flux" => {
                "a hemispherical power, no radiance of a ray; by reciprocity that of `uniform_above`"
            }
            "mean_scatterings" => "a count of events, no radiance",
            other => panic!("unknown problem {other}"),
        };
        if !reason.is_empty() {
            skipped.insert(id, reason);
        }
    }
    (probes, skipped)
}

/// Measures the probes and judges them one by one and all together.
/// At most the share `most_imprecise` of them may stay above `PRECISION` after so many samples; they are printed, and judged
/// by the error that they have.
fn judge(ctx: &Context, probes: &[&Probe], samples: u32, most_imprecise: f64) {
    let (mut squares, mut counted, mut imprecise, mut failures) = (0.0, 0u32, Vec::new(), Vec::new());
    let mut ids = BTreeMap::new();
    for probe in probes {
        let start = Instant::now();
        let m = measure(ctx, &probe.scene, probe.expected, samples);
        // What single precision adds, in the geometry and in every scattering.
        let rounding = 2e-6;
        let z = |c: usize| {
            let rest = (m.mean[c] - probe.expected[c]).abs() - probe.uncertainty - rounding * probe.expected[c];
            rest.max(0.0) / m.error[c].max(1e-300) * (m.mean[c] - probe.expected[c]).signum()
        };
        let relative = (0..3).map(|c| m.error[c] / probe.expected[c]).fold(0.0, f64::max);
        println!(
            "{} {}: {:.6e} expected {:.6e} ± {:.2} % z {:+.2} ({:.1} s)",
            probe.id,
            probe.what,
            m.mean[0],
            probe.expected[0],
            100.0 * relative,
            z(0),
            start.elapsed().as_secs_f64()
        );
        if relative > 1.05 * PRECISION {
            imprecise.push(format!("{} {}: {:.2} %", probe.id, probe.what, 100.0 * relative));
        }
        if let Some(c) = (0..3).find(|&c| z(c).abs() > MOST_Z) {
            failures.push(format!("{} {}, channel {c}: z = {:+.2}", probe.id, probe.what, z(c)));
        }
        // The channels of a render share its paths: one of them counts.
        squares += z(0).powi(2);
        counted += 1;
        *ids.entry(&probe.id).or_insert(0) += 1;
    }
    let n = f64::from(counted);
    println!("{counted} values of {} cases, chi-square {squares:.1}", ids.len());
    println!("{} did not reach {} %: {imprecise:#?}", imprecise.len(), 100.0 * PRECISION);
    assert!(failures.is_empty(), "{failures:#?}");
    assert!((squares - n).abs() < 4.0 * (2.0 * n).sqrt(), "chi-square {squares} of {n} values");
    assert!(imprecise.len() as f64 <= most_imprecise * n, "{} of {n} values are imprecise", imprecise.len());
}

/// Not under GPU-assisted validation, which makes lavapipe many times slower: tests/path.rs has the kernels there.
fn gpu_test(body: impl FnOnce(&Context, &Value)) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP reference values under GPU-assisted validation");
    } else if let Some(table) = table() {
        common::gpu_test(|ctx| body(ctx, &table));
    }
}

#[test]
fn some_values_of_the_table() {
    gpu_test(|ctx, table| {
        let (probes, skipped) = probes(table);
        // What takes seconds: thick slabs, and light scattered back against a strong forward peak.
        let quick = |p: &&Probe| ["tau16", "tau64", "tau32", "D-", "g0.9"].iter().all(|s| !p.id.contains(s));
        let chosen: Vec<&Probe> = probes.iter().filter(quick).step_by(67).collect();
        println!("{} of {} values; {} cases are not set up", chosen.len(), probes.len(), skipped.len());
        assert!(chosen.len() > 40, "the table has shrunk");
        judge(ctx, &chosen, 1 << 16, 0.05);
    });
}

#[test]
#[ignore = "long: several values of every case of the reference table"]
fn every_case_of_the_table() {
    gpu_test(|ctx, table| {
        let (probes, skipped) = probes(table);
        for (id, reason) in &skipped {
            println!("skipped {id}: {reason}");
        }
        // Of every case, values that differ from case to case.
        let mut chosen = Vec::new();
        let mut cases: BTreeMap<&str, Vec<&Probe>> = BTreeMap::new();
        probes.iter().for_each(|p| cases.entry(&p.id).or_default().push(p));
        for (i, of_case) in cases.values().enumerate() {
            chosen.extend((0..of_case.len().min(2)).map(|k| of_case[(5 * i + k * of_case.len() / 2) % of_case.len()]));
        }
        judge(ctx, &chosen, 1 << 16, 0.25);
    });
}

/// Group A: densities, the sampler's directions, and integrals of the density, of the device and of its twin.
#[test]
fn the_phase_function() {
    gpu_test(|ctx, table| {
        let probe = PhaseProbe::new(ctx).unwrap();
        let twin = |g: f32, cosines: &[f32]| cosines.iter().map(|&c| cpu::sphere::phase_hg(g, c)).collect::<Vec<f32>>();
        let mut compared = BTreeMap::new();
        for case in table["cases"].as_array().unwrap().iter().filter(|case| case["group"] == "A") {
            let (id, problem) = (case["id"].as_str().unwrap(), case["problem"].as_str().unwrap());
            let exact = number(&case["parameters"], "g");
            let g = exact as f32;
            // The table's reader is off by a unit in the last place now and then.
            if (f64::from(g) - exact).abs() > 1e-15 {
                println!("skipped {id}: g is no 32-bit number");
                continue;
            }
            let quantities = case["quantities"].as_array().unwrap();
            let mut near = |q: &Value, got: f64, tolerance: f64| {
                let (value, uncertainty) = (number(q, "value"), number(q, "uncertainty"));
                let error = (got - value).abs();
                assert!(error <= uncertainty + tolerance, "{id} {q}: {got}, allowed {tolerance:e}");
                *compared.entry(problem).or_insert(0) += 1;
            };
            match problem {
                "hg_value" => {
                    let cosines: Vec<f32> = quantities.iter().map(|q| number(&q["at"], "cos") as f32).collect();
                    let randoms = vec![[0.0; 2]; cosines.len()];
                    let (densities, _) = probe.evaluate(ctx, g, Vec3::Z, &cosines, &randoms).unwrap();
                    for (i, q) in quantities.iter().enumerate() {
                        near(q, densities[i].into(), DENSITY_ERROR * number(q, "value"));
                        near(q, twin(g, &cosines)[i].into(), 1e-7 * number(q, "value"));
                    }
                }
                "hg_inverse_cdf" => {
                    let randoms: Vec<[f32; 2]> =
                        quantities.iter().map(|q| [number(&q["at"], "xi") as f32, 0.3]).collect();
                    let cosines = vec![0.0; randoms.len()];
                    let (_, directions) = probe.evaluate(ctx, g, Vec3::Z, &cosines, &randoms).unwrap();
                    for (i, q) in quantities.iter().enumerate() {
                        for after in [directions[i], cpu::sphere::sample_hg(g, Vec3::Z, randoms[i])] {
                            let after = after.as_dvec3();
                            // Half the square of a distance, the distance known to 4e-7 besides.
                            let half_square = |from: DVec3| (after - from).length_squared() / 2.0;
                            let rounding = |x: f64| 1e-6 * x + 4e-7 * (2.0 * x).sqrt() + 1e-13;
                            match q["name"].as_str().unwrap() {
                                // 8 ulp: four operations, and the denominator's square doubles theirs.
                                "cos" => near(q, after.z, 1e-6),
                                "one_minus_cos" => near(q, half_square(DVec3::Z), rounding(number(q, "value"))),
                                "one_plus_cos" => near(q, half_square(-DVec3::Z), rounding(number(q, "value"))),
                                other => panic!("{id}: unknown quantity {other}"),
                            }
                        }
                    }
                }
                "hg_moments" | "hg_cdf" => {
                    let points = 1 << 16;
                    let cosines = phase::quantiles(g, points);
                    let (densities, _) = probe.evaluate(ctx, g, Vec3::Z, &cosines, &vec![[0.0; 2]; points]).unwrap();
                    for densities in [densities, twin(g, &cosines)] {
                        for q in quantities {
                            let integral = |f: &dyn Fn(f64) -> f64| phase::integral(g, &cosines, &densities, f);
                            let below = |limit: f64| integral(&|c| f64::from(u8::from(c <= limit)));
                            // A step moves past one of the points at most.
                            let step = 1.0 / points as f64;
                            match q["name"].as_str().unwrap() {
                                "normalisation" => near(q, integral(&|_| 1.0), DENSITY_ERROR),
                                "mean_cos" => near(q, integral(&|c| c), DENSITY_ERROR),
                                "mean_cos_squared" => near(q, integral(&|c| c * c), DENSITY_ERROR),
                                "backward_fraction" => near(q, below(0.0), DENSITY_ERROR + step),
                                "cdf" => {
                                    let limit = number(&q["at"], "cos");
                                    // Points are rounded by up to 6e-8, across the limit perhaps.
                                    let rounded = 2.0 * PI * phase::density(exact, limit) * 6e-8;
                                    near(q, below(limit), DENSITY_ERROR + step + rounded);
                                }
                                other => panic!("{id}: unknown quantity {other}"),
                            }
                        }
                    }
                }
                other => panic!("unknown problem {other}"),
            }
        }
        println!("compared {compared:?}");
        for (problem, least) in [("hg_value", 84), ("hg_moments", 56), ("hg_cdf", 56), ("hg_inverse_cdf", 594)] {
            assert!(compared.get(problem).is_some_and(|&n| n >= least), "{problem}: {compared:?}");
        }
    });
}

/// Wider than 100 times its thickness, a slab is as good as infinite, thin or thick.
#[test]
fn the_width_of_a_slab_does_not_matter() {
    gpu_test(|ctx, _| {
        for (tau, orders) in [(1.0, 4), (16.0, 12)] {
            let [narrow, medium, wide] = [3.0, 100.0, 1e4].map(|width| {
                let mut scene = slab(tau, 0.0, [1.0; 3], orders);
                scene.volume.grid = Grid::axis_aligned([1, 1, 1], [width, width, 1.0], [0.0, 0.0, 0.5]);
                beam(&mut scene, 0.5);
                look(&mut scene, true, 0.5, 90.0);
                measure(ctx, &scene, [0.05; 3], 4096)
            });
            let z = |a: &Measured, b: &Measured| (a.mean[0] - b.mean[0]) / a.error[0].hypot(b.error[0]);
            assert!(z(&medium, &wide).abs() < 4.0, "tau {tau}: {}", z(&medium, &wide));
            assert!(tau > 1.0 || z(&narrow, &wide) < -4.0, "a narrow slab loses light: {}", z(&narrow, &wide));
        }
    });
}

/// Radiance 1 from all around is radiance 1 out of any white body, without noise: every path ends in the sky unweakened.
#[test]
fn a_white_furnace_is_white() {
    gpu_test(|ctx, _| {
        let clouds: Vec<f32> = bodies::random_values(3, 7 * 6 * 5);
        for (extinction, g) in [(1.0, 0.0), (50.0, 0.9), (50.0, -0.5), (8.0, 0.999), (8.0, -0.999)] {
            let grid = Grid::axis_aligned([7, 6, 5], [0.2; 3], [0.1; 3]);
            let mut scene = homogeneous(grid, extinction, Vec3::ONE);
            scene.volume.data = VoxelData::F32(clouds.clone());
            scene.transfer = matter(extinction, Vec3::ONE, Vec3::ZERO);
            scene.g = g;
            scene.environment = Some(Environment::Constant(Vec3::ONE));
            scene.background = Background::Environment;
            (scene.settings.model, scene.settings.orders) = (Model::Path, UNLIMITED);
            // From outside and from inside.
            for origin in [[-2.0, 0.5, 0.4], [0.7, 0.6, 0.5]] {
                aim(&mut scene, origin, [1.0, 0.1, 0.2], [16, 16]);
                let mut render = PathRender::new(ctx, &scene).unwrap();
                render.advance(16, &mut |_| ControlFlow::Continue(())).unwrap();
                let e = render.sums().unwrap().estimate(scene.settings.size);
                assert!(
                    e.picture.pixels.iter().all(|p| p[..3].iter().all(|c| (c - 1.0).abs() < 1e-5)),
                    "{g} {:?}",
                    e.mean
                );
                assert_eq!(e.truncated, 0.0);
            }
            // A cap cuts paths, and says how much.
            scene.settings.max_events = 3;
            let mut render = PathRender::new(ctx, &scene).unwrap();
            render.advance(64, &mut |_| ControlFlow::Continue(())).unwrap();
            let e = render.sums().unwrap().estimate(scene.settings.size);
            assert!(e.truncated > 0.0 && (e.mean[0] + e.truncated - 1.0).abs() < 1e-5, "{:?} {}", e.mean, e.truncated);
        }
    });
}
