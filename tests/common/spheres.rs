//! The spheres of the table of reference values (group F), as scenes for `path` on grids of voxels.

#![allow(dead_code, reason = "each test file uses a part of it")]

use super::reference::{cases, number};
use super::transport::{PENCIL, aim, ball, matter, sun, upper_half};
use glam::{DVec3, Vec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use tyndall::scene::camera::look_at;
use tyndall::scene::{Background, Environment, Model, Scene, UNLIMITED};

/// Albedos of the channels.
const ALBEDO: [f64; 3] = [1.0, 0.9, 0.5];

/// Where light comes from.
#[derive(Clone, Copy, Debug)]
pub enum Lit {
    /// Radiance 1 from all around, seen behind the sphere too.
    Sky,
    /// Radiance 1 from above, not seen itself.
    Above,
    /// A beam of irradiance 1 that travels along +z.
    Beam,
}

/// What is measured.
#[derive(Clone, Copy, Debug)]
pub enum Seen {
    /// The radiance of a ray with this impact parameter.
    Ray(f64),
    /// The mean radiance over the sphere's disc of the light that leaves in the plane y = 0 at this angle to +z, degrees.
    Disc(f64),
}

/// A number of the table, per channel.
pub struct Probe {
    pub id: String,
    pub what: String,
    pub optical_radius: f64,
    pub g: f64,
    pub albedo: [f64; 3],
    pub orders: u32,
    pub lit: Lit,
    pub seen: Seen,
    pub expected: [f64; 3],
    pub uncertainty: f64,
    pub seed: u64,
}

impl Probe {
    /// The sphere in `n` voxels across, for `path`, and how to read the number from the picture.
    pub fn scene(&self, n: u32) -> (Scene, Reading) {
        let mut scene = ball(n, self.optical_radius);
        scene.transfer = matter(self.optical_radius, Vec3::from(self.albedo.map(|a| a as f32)), Vec3::ZERO);
        scene.g = self.g as f32;
        scene.settings.model = Model::Path;
        scene.settings.orders = self.orders;
        scene.settings.max_events = 1_000_000;
        // Grids have random numbers of their own, too.
        scene.settings.seed = self.seed + (u64::from(n) << 32);
        let mut reading = Reading { share: 1.0, behind: 0.0 };
        match self.lit {
            Lit::Sky => {
                scene.environment = Some(Environment::Constant(Vec3::ONE));
                scene.background = Background::Environment;
                reading.behind = 1.0;
            }
            Lit::Above => scene.environment = Some(upper_half()),
            Lit::Beam => scene.lights.push(sun([0.0, 0.0, 1.0])),
        }
        match self.seen {
            Seen::Ray(impact) => aim(&mut scene, [-5.0, impact, 0.0], [1.0, 0.0, 0.0], PENCIL),
            Seen::Disc(angle) => reading.share = aim_at_disc(&mut scene, n, angle),
        }
        (scene, reading)
    }

    /// In what deviations are measured: the light that is expected, or the sky that it is seen against.
    pub fn unit(&self) -> [f64; 3] {
        if matches!(self.lit, Lit::Sky) { [1.0; 3] } else { self.expected }
    }
}

/// What a picture's mean says of the sphere, whose disc is a part of it.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// The disc's share of the picture; a ray has all of it.
    pub share: f64,
    /// Radiance of the rest.
    pub behind: f64,
}

impl Reading {
    /// Mean over the disc.
    pub fn disc(&self, mean: f64) -> f64 {
        self.behind + (mean - self.behind) / self.share
    }
}

/// Looks at the whole sphere against the light that leaves at `angle` to +z in the plane y = 0; returns the disc's share
/// of the picture. From 1000 radii away, directions differ by 1e-3 and the disc is 1e-6 too large.
fn aim_at_disc(scene: &mut Scene, n: u32, angle: f64) -> f64 {
    const AWAY: f64 = 1000.0;
    let (s, c) = angle.to_radians().sin_cos();
    // Interpolation carries the edge this far: half a voxel's diagonal and a whole one.
    let half_side = 1.0 + 1.5 * 3f64.sqrt() * 2.0 / f64::from(n);
    let fov = 2.0 * (half_side / AWAY).atan().to_degrees();
    scene.camera = look_at(AWAY * DVec3::new(s, 0.0, c), DVec3::ZERO, DVec3::Y, fov);
    scene.settings.size = PENCIL;
    PI / (2.0 * half_side).powi(2)
}

/// All probes that group F has.
pub fn probes(table: &Value) -> Vec<Probe> {
    let mut probes: Vec<Probe> = Vec::new();
    let mut add =
        |id: &str, what: String, p: &Value, (albedo, orders): ([f64; 3], u32), (lit, seen), expected, uncertainty| {
            probes.push(Probe {
                id: id.into(),
                what,
                optical_radius: number(p, "optical_radius"),
                g: number(p, "g"),
                albedo,
                orders,
                lit,
                seen,
                expected,
                uncertainty,
                seed: probes.len() as u64,
            });
        };
    let at = |q: &Value, name: &str| q["at"][name].as_f64();
    for (id, p, quantities) in cases(table, "sphere_uniform_environment") {
        let albedo = number(p, "albedo");
        for q in quantities {
            let seen = match q["name"].as_str().unwrap() {
                "escape_fraction" => Seen::Disc(90.0),
                "radiance_out" => Seen::Ray(at(q, "impact_parameter").unwrap()),
                // 1 − escape_fraction, and a count of events.
                _ => continue,
            };
            // White: without noise, `a_white_furnace_is_white`.
            if albedo < 1.0 {
                let what = format!("{} {}", q["name"], q["at"]);
                add(
                    id,
                    what,
                    p,
                    ([albedo; 3], UNLIMITED),
                    (Lit::Sky, seen),
                    [number(q, "value"); 3],
                    number(q, "uncertainty"),
                );
            }
        }
    }
    // Sums over the orders up to K, of three albedos; a place whose order K is missing ends there.
    for problem in ["sphere_orders", "sphere_beam_hemispheres", "sphere_beam_intensity"] {
        for (id, p, quantities) in cases(table, problem) {
            let mut sums: BTreeMap<String, (u32, [f64; 3], f64)> = BTreeMap::new();
            for q in quantities.iter().filter(|q| at(q, "order").is_some()) {
                let (name, order) = (q["name"].as_str().unwrap(), at(q, "order").unwrap() as u32);
                let (lit, seen) = match name {
                    "escape_fraction_order" => (Lit::Sky, Seen::Disc(90.0)),
                    "radiance_out_order" => (Lit::Sky, Seen::Ray(at(q, "impact_parameter").unwrap())),
                    // By reciprocity: of the light from above, that which goes on down, and that which comes back.
                    "escape_forward_order" => (Lit::Above, Seen::Disc(180.0)),
                    "escape_backward_order" => (Lit::Above, Seen::Disc(0.0)),
                    "intensity_order" => (Lit::Beam, Seen::Disc(at(q, "angle_degrees").unwrap())),
                    other => panic!("{id}: unknown quantity {other}"),
                };
                let first = u32::from(!matches!(lit, Lit::Sky));
                let (next, sum, uncertainty) = sums.entry(format!("{name} {seen:?}")).or_insert((first, [0.0; 3], 0.0));
                if order != *next {
                    continue;
                }
                *next += 1;
                *uncertainty += number(q, "uncertainty");
                *sum = std::array::from_fn(|c| sum[c] + number(q, "value") * ALBEDO[c].powi(order as i32));
                if order > 0 {
                    let what = format!("{name} {seen:?} up to {order}");
                    add(id, what, p, (ALBEDO, order), (lit, seen), *sum, *uncertainty);
                }
            }
            // All orders, of the albedos that are given.
            let mut all: BTreeMap<String, ([f64; 3], f64)> = BTreeMap::new();
            for q in quantities.iter().filter(|q| at(q, "albedo").is_some()) {
                let name = q["name"].as_str().unwrap();
                let angle =
                    q["at"]["angle_degrees"].as_f64().unwrap_or(if name.contains("forward") { 180.0 } else { 0.0 });
                let (expected, uncertainty) = all.entry(format!("{name} {angle}")).or_default();
                let albedo = at(q, "albedo").unwrap();
                if let Some(c) = ALBEDO.iter().position(|&a| a == albedo) {
                    expected[c] = number(q, "value");
                    *uncertainty = f64::max(*uncertainty, number(q, "uncertainty"));
                }
                // The last of the table's albedos.
                if albedo == 1.0 {
                    let lit = if name == "intensity" { Lit::Beam } else { Lit::Above };
                    let what = format!("{name} at {angle}");
                    add(id, what, p, (ALBEDO, UNLIMITED), (lit, Seen::Disc(angle)), *expected, *uncertainty);
                }
            }
        }
    }
    probes
}
