//! Twins of `gather_proxy.comp`, `gather_select.comp`, `gather_base.comp` and `gather_trace.comp`.

use super::delta_lights::light_at;
use super::march::{LEAST_TRANSMITTANCE, Ray, Step, make_ray, mean_transmittance};
use super::project::{Cell, point_of_sample};
use super::rng::{random_float, stream_key};
use super::scene::{HostScene, direction_to_eye, world_from_index};
use super::sphere::{lattice_direction, lattice_point, phase_hg, sample_hg};
use super::texture::Texture;
use crate::abi::{LightData, ScatterSample, SceneParams};
use crate::passes::points::{aimed_points_of, points_of};
use crate::shaders::constants::{CELL_POINTS, STEP_SAMPLES};
use glam::{Vec2, Vec3, Vec4};
use std::f32::consts::PI;

/// A traced candidate and its weight in the estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Which of the candidates.
    pub candidate: u32,
    /// Factor of its radiance.
    pub weight: f32,
    /// Subtracted from its radiance before, for `residual`: the proxy's energy.
    pub less: f32,
}

fn key_of(scene: &SceneParams, index: u32, order: u32) -> u32 {
    stream_key(index, order, scene.seed_low, scene.seed_high)
}

pub(super) fn point_flip(scene: &SceneParams, index: u32, order: u32) -> u32 {
    (random_float(key_of(scene, index, order), 3) * CELL_POINTS as f32) as u32
}

/// A cell's lattices of directions, independent of each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lattice {
    /// Of the traced directions, or of the candidates that they are chosen from.
    Traced,
    /// Of those that `residual` follows in the proxy alone.
    Base,
}

/// Shift of a cell's lattice of directions.
pub(super) fn lattice_shift(scene: &SceneParams, index: u32, order: u32, lattice: Lattice) -> [f32; 2] {
    let key = key_of(scene, index, order);
    let first = match lattice {
        Lattice::Traced => 0,
        Lattice::Base => 4,
    };
    [random_float(key, first), random_float(key, first + 1)]
}

/// Energy of a direction, estimated with nearest reads of `light`: source function and extinction as the proxy has them.
/// `sky`: radiance behind everything, in their units.
pub(super) fn proxy_energy(
    scene: &SceneParams,
    light: &Texture<Vec2>,
    sky: Vec3,
    position: Vec3,
    towards: Vec3,
    step_voxels: f32,
) -> f32 {
    let ray = make_ray(scene, position, towards, step_voxels);
    let (mut through, mut energy) = (1.0f32, 0.0);
    for Step { p, stride, .. } in ray.steps(ray.dt, f32::INFINITY) {
        if through <= 0.01 {
            break;
        }
        let l = light.fetch_clamped(p.floor().as_ivec3());
        let passed = (-l.y * scene.max_extinction * stride).exp();
        energy += through * (1.0 - passed) * l.x;
        through *= passed;
    }
    energy + through * sky.element_sum() / 3.0
}

/// Twin of `include/aim.glsl`.
#[derive(Clone, Copy)]
struct Aim {
    g: f32,
    to_eye: Option<Vec3>,
}

impl Aim {
    fn new(scene: &SceneParams, cell: &Cell, for_eye: bool) -> Self {
        Self { g: scene.g, to_eye: for_eye.then(|| direction_to_eye(scene, cell.middle())) }
    }

    fn direction(self, number: u32, count: u32, shift: [f32; 2]) -> Vec3 {
        let even = if self.to_eye.is_some() { count / 2 } else { count };
        match self.to_eye {
            Some(to_eye) if number >= even => {
                -sample_hg(self.g, to_eye, lattice_point(number - even, count - even, shift))
            }
            _ => lattice_direction(number, even, shift),
        }
    }

    fn eye_density(self, towards: Vec3) -> f32 {
        self.to_eye.map_or(1.0, |to_eye| 4.0 * PI * phase_hg(self.g, -towards.dot(to_eye)))
    }

    fn weight(self, count: u32, towards: Vec3) -> f32 {
        let even = (count / 2) as f32 / count as f32;
        self.to_eye.map_or(1.0, |_| 1.0 / (even + (1.0 - even) * self.eye_density(towards)))
    }
}

/// Energy of every direction of every listed cell, as `proxy_energy` estimates it. `lattices`: whose points are the directions, and
/// how many each has. `weights[cell in the list][direction]`.
#[allow(clippy::too_many_arguments, reason = "the kernel's arguments")]
pub fn gather_proxy(
    scene: &SceneParams,
    cells: &[u32],
    light: &Texture<Vec2>,
    sky: Vec3,
    order: u32,
    lattices: &[(Lattice, u32)],
    step_voxels: f32,
    for_eye: bool,
) -> Vec<Vec<f32>> {
    let of_cell = |&index: &u32| {
        let cell = Cell::from_linear(scene, index);
        let (aim, middle) = (Aim::new(scene, &cell, for_eye), cell.middle());
        let is_choice = lattices.len() == 1;
        let of_lattice = |&(lattice, points): &(Lattice, u32)| {
            let shift = lattice_shift(scene, index, order, lattice);
            (0..points).map(move |i| {
                let towards = aim.direction(i, points, shift);
                // Energies of `residual` are radiances; a choice goes by what the eye would get.
                let share = if is_choice { aim.eye_density(towards) * aim.weight(points, towards) } else { 1.0 };
                share * proxy_energy(scene, light, sky, middle, towards, step_voxels)
            })
        };
        lattices.iter().flat_map(of_lattice).collect()
    };
    cells.iter().map(of_cell).collect()
}

/// `top`: the N candidates with the largest weights, each with the factor 1/N.
pub fn select_top(weights: &[f32], directions: u32) -> Vec<Choice> {
    let mut ranked: Vec<u32> = (0..weights.len() as u32).collect();
    // Stable: of equal weights the first comes first.
    ranked.sort_by(|&a, &b| weights[b as usize].total_cmp(&weights[a as usize]));
    ranked.truncate(directions as usize);
    ranked.iter().map(|&candidate| Choice { candidate, weight: 1.0 / directions as f32, less: 0.0 }).collect()
}

/// `resample`: a systematic draw of N from p_i = (1−β) w_i/Σw + β/M, shifted by `u` in [0, 1); the factor is
/// hits/(M N p).
pub fn select_resample(weights: &[f32], directions: u32, defence: f32, u: f32) -> Vec<Choice> {
    let (m, n) = (weights.len() as f64, f64::from(directions));
    let beta = f64::from(defence);
    let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let mut above = f64::from(u);
    let mut chosen = Vec::new();
    for (c, &w) in weights.iter().enumerate() {
        let p = if sum > 0.0 { (1.0 - beta) * f64::from(w) / sum + beta / m } else { 1.0 / m };
        let below = above;
        above = if c + 1 == weights.len() { n + f64::from(u) } else { above + n * p };
        let hits = above.floor() - below.floor();
        if hits > 0.0 {
            chosen.push(Choice { candidate: c as u32, weight: (hits / (m * n * p)) as f32, less: 0.0 });
        }
    }
    chosen
}

/// The random number of [`select_resample`] for a cell.
pub fn select_shift(scene: &SceneParams, index: u32, order: u32) -> f32 {
    random_float(key_of(scene, index, order), 2)
}

/// `residual`: the samples of its lower level in the listed cells, from the energies of the M directions of
/// [`Lattice::Base`]. For g = 0 every point has the mean over all of them, else each direction its point.
pub fn gather_base(
    scene: &HostScene,
    cells: &[u32],
    energies: &[Vec<f32>],
    order: u32,
    for_eye: bool,
) -> Vec<Vec<ScatterSample>> {
    let s = &scene.params;
    let of_cell = |(&index, energies): (&u32, &Vec<f32>)| {
        let cell = Cell::from_linear(s, index);
        let (flip, m) = (point_flip(s, index, order), energies.len() as u32);
        let shift = lattice_shift(s, index, order, Lattice::Base);
        let mean = energies.iter().sum::<f32>() / m as f32;
        let sample = |slot: u32, energy: f32, towards: Vec3| {
            let point = point_of_sample(slot, flip);
            let light = energy * cell.scattering(scene, point);
            ScatterSample { light: light.into(), travel: (-towards).into(), point }
        };
        if s.g == 0.0 {
            (0..CELL_POINTS).map(|slot| sample(slot, mean / CELL_POINTS as f32, Vec3::ZERO)).collect()
        } else {
            let aim = Aim::new(s, &cell, for_eye);
            let of = |slot: u32| {
                let towards = aim.direction(slot, m, shift);
                sample(slot, energies[slot as usize] / m as f32 * aim.weight(m, towards), towards)
            };
            (0..m).map(of).collect()
        }
    };
    cells.iter().zip(energies).map(of_cell).collect()
}

/// What is gathered, as [`Gathered`](crate::passes::gather::Gathered) says.
#[derive(Clone, Copy)]
pub enum Carried<'a> {
    /// Extinction times A and extinction, B by component; and the radiance behind everything.
    Projected(&'a [Texture<Vec4>; 4], Vec3),
    /// The source itself, and extinction.
    Emitted(&'a Texture<Vec4>),
    /// Extinction times what this delta light brings, but for the phase function; and extinction.
    Light(&'a Texture<Vec4>, &'a LightData),
}

/// Radiance that arrives along the ray, against its direction `towards` (unit vector, world). Of a directional light
/// without the phase function.
pub fn traced_radiance(scene: &SceneParams, carried: Carried<'_>, ray: Ray, towards: Vec3) -> Vec3 {
    let (mut through, mut radiance) = (1.0f32, Vec3::ZERO);
    let halves = ray.near_steps(f32::INFINITY).flat_map(|step| ray.halves(step)).enumerate();
    for (half, Step { p, stride, .. }) in halves {
        // A step is taken whole.
        if half % 2 == 0 && through <= LEAST_TRANSMITTANCE {
            break;
        }
        let (f, source) = match carried {
            Carried::Projected([a, b @ ..], _) => {
                let a = a.sample(p);
                let along = |axis: usize| b[axis].sample(p).truncate() * towards[axis];
                let b = if scene.g == 0.0 { Vec3::ZERO } else { along(0) + along(1) + along(2) };
                (a, a.w * (a.truncate() - b))
            }
            Carried::Emitted(emitted) => (emitted.sample(p), emitted.sample(p).truncate()),
            Carried::Light(image, light) => {
                let f = image.sample(p);
                let travel = light_at(scene, light, world_from_index(scene, p)).travel;
                let phase = match light.is_point {
                    0 => 1.0,
                    _ => 4.0 * PI * phase_hg(scene.g, travel.dot(-towards)),
                };
                (f, f.w * f.truncate() * phase)
            }
        };
        let scale = scene.max_extinction * stride;
        let tau = f.w * scale;
        radiance += source * (through * scale * mean_transmittance(tau));
        through *= (-tau).exp();
    }
    match carried {
        Carried::Projected(_, sky) => radiance + through * sky,
        _ => radiance,
    }
}

/// Samples of what is carried, scattered once more in the listed cells. `chosen` by cell of the list, out of a lattice
/// of `lattice` directions; `directions` slots of a cell.
#[allow(clippy::too_many_arguments, reason = "the kernel's arguments")]
pub fn gather_trace(
    scene: &HostScene,
    cells: &[u32],
    carried: Carried<'_>,
    chosen: &[Vec<Choice>],
    order: u32,
    lattice: u32,
    directions: u32,
    step_voxels: f32,
    for_eye: bool,
) -> Vec<Vec<ScatterSample>> {
    let s = &scene.params;
    let points = if for_eye { aimed_points_of(directions) } else { points_of(directions) };
    let of_cell = |(&index, choices): (&u32, &Vec<Choice>)| {
        let cell = Cell::from_linear(s, index);
        let shift = lattice_shift(s, index, order, Lattice::Traced);
        let flip = point_flip(s, index, order);
        let aim = Aim::new(s, &cell, for_eye);
        let of_choice = |(slot, choice): (usize, &Choice)| {
            let point = points[slot] ^ flip;
            let towards = match carried {
                Carried::Light(_, light) if light.is_point == 0 => {
                    -sample_hg(s.g, light.vector.into(), lattice_point(choice.candidate, lattice, shift))
                }
                _ => aim.direction(choice.candidate, lattice, shift),
            };
            let ray = make_ray(s, cell.position(point), towards, STEP_SAMPLES as f32 * step_voxels);
            let radiance = traced_radiance(s, carried, ray, towards);
            let weight = choice.weight * aim.weight(lattice, towards);
            let light = (radiance - choice.less) * cell.scattering(scene, point) * weight;
            ScatterSample { light: light.into(), travel: (-towards).into(), point }
        };
        choices.iter().enumerate().map(of_choice).collect()
    };
    cells.iter().zip(chosen).map(of_cell).collect()
}
