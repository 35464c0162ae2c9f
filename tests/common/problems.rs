//! The problems of the table of reference values that a slab or a box can show, as scenes for `path`. Slabs are single
//! voxels, 1 thick and [`WIDTH`] wide; three albedos are three channels of one render.

#![allow(dead_code, reason = "each test file uses a part of it")]

use super::reference::number;
use super::transport::{self, aim, beam, homogeneous, look, sun, unit_cube, upper_half};
use glam::Vec3;
use serde_json::Value;
use std::collections::BTreeMap;
use tyndall::scene::{Background, Environment, Model, Scene, UNLIMITED};
use tyndall::verify::single::slab_radiance;

/// Width of slabs over their thickness.
pub const WIDTH: f64 = 1e4;

/// A render by `path`, and what its three channels should be.
pub struct Probe {
    pub id: String,
    pub what: String,
    pub scene: Scene,
    pub expected: [f64; 3],
    pub uncertainty: f64,
}

impl Probe {
    /// Of the slab, or of the cube's edge.
    pub fn optical_thickness(&self) -> f64 {
        f64::from(self.scene.transfer.points[1].opacity)
    }
}

/// A slab from z = 0 to 1 of three albedos in darkness, `orders` of scattering.
pub fn slab(tau: f64, g: f64, albedo: [f64; 3], orders: u32) -> Scene {
    let mut scene = transport::slab(tau, WIDTH, Vec3::from(albedo.map(|a| a as f32)));
    scene.g = g as f32;
    scene.settings.orders = orders;
    scene.settings.max_events = 1_000_000;
    scene
}

/// How each problem is set up, or why it is not.
pub fn probes(table: &Value) -> (Vec<Probe>, BTreeMap<String, &'static str>) {
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
            "sphere_uniform_environment" | "sphere_orders" | "sphere_beam_hemispheres" | "sphere_beam_intensity" => {
                "no voxel grid is a sphere: tests/reference_spheres.rs refines one"
            }
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
