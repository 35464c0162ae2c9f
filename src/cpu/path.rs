//! Twin of `path.comp`, `majorant.comp` and `extinction.comp`: one sample of one pixel at a time.

use super::classify::{albedo_of, classify};
use super::delta_lights::light_at;
use super::environment::EnvironmentLight;
use super::march::make_ray;
use super::rng::{pcg_hash, pcg4d, unit_float};
use super::scene::{HostScene, eye_direction, index_from_world, index_from_world_direction, world_from_index};
use super::sphere::{phase_hg, sample_hg, sphere_direction};
use super::texture::Texture;
use crate::passes::path::PathConfig;
use crate::scene::Background;
use crate::shaders::constants::CELL_SIZE;
use glam::{IVec3, UVec3, Vec2, Vec3, Vec4};

/// Relative extinction of every voxel.
pub fn extinction(scene: &HostScene) -> Texture<f32> {
    let s = &scene.params;
    let relative = |&value: &f32| classify(s, &scene.points, value).extinction / s.max_extinction;
    Texture::new(s.dims, scene.scalar.texels.iter().map(relative).collect())
}

/// Largest relative extinction that interpolation meets in every macrocell, or minus the distance to the nearest
/// occupied cell, from `emptiness`.
pub fn majorant(extinction: &Texture<f32>, emptiness: &Texture<u32>) -> Texture<f32> {
    let mut majorants = Texture::filled(emptiness.dims.to_array(), 0.0);
    for z in 0..emptiness.dims.z {
        for y in 0..emptiness.dims.y {
            for x in 0..emptiness.dims.x {
                let cell = UVec3::new(x, y, z);
                let low = (cell * CELL_SIZE).as_ivec3() - 1;
                let mut most = 0.0f32;
                for dz in 0..CELL_SIZE as i32 + 2 {
                    for dy in 0..CELL_SIZE as i32 + 2 {
                        for dx in 0..CELL_SIZE as i32 + 2 {
                            most = most.max(extinction.fetch_clamped(low + IVec3::new(dx, dy, dz)));
                        }
                    }
                }
                let reach = emptiness.fetch(cell).max(1) as f32;
                *majorants.texel_mut(cell) = if most > 0.0 { most } else { -reach };
            }
        }
    }
    majorants
}

/// What a path flies through.
pub struct PathScene<'a> {
    /// The scene.
    pub scene: &'a HostScene,
    /// What is behind the medium.
    pub background: Background,
    /// When paths end.
    pub config: PathConfig,
    /// As [`extinction`] makes it.
    pub extinction: Texture<f32>,
    /// As [`majorant`] makes it.
    pub majorants: Texture<f32>,
}

/// Random words of one sample.
struct Stream {
    key: [u32; 2],
    sample: u32,
    draws: u32,
}

impl Stream {
    fn draw(&mut self) -> [u32; 4] {
        self.draws += 1;
        pcg4d([self.key[0], self.sample, self.draws - 1, self.key[1]])
    }

    fn floats(&mut self) -> Vec4 {
        Vec4::from(self.draw().map(unit_float))
    }
}

/// Where a flight ended.
enum End {
    /// In this voxel, at this place in index space.
    Collided(UVec3, Vec3),
    Passed,
}

/// Exponentially distributed with mean 1.
fn exponential(word: u32) -> f32 {
    let u = (f64::from(word) + 0.5) / 4_294_967_296.0;
    -(-u).ln_1p() as f32
}

impl PathScene<'_> {
    /// Radiance (rgb) and opacity of one sample of a pixel.
    pub fn path(&self, pixel: [u32; 2], sample: u32) -> Vec4 {
        let s = &self.scene.params;
        let pixel_index = pixel[1] * s.size[0] + pixel[0];
        let key = [pixel_index, pcg_hash(s.seed_low ^ pcg_hash(s.seed_high))];
        let stream = &mut Stream { key, sample, draws: 0 };
        let place = stream.floats();
        let size = Vec2::new(s.size[0] as f32, s.size[1] as f32);
        let mut direction = eye_direction(s, Vec2::new(pixel[0] as f32 + place.x, pixel[1] as f32 + place.y) / size);
        let ray = make_ray(s, index_from_world(s, s.eye.into()), direction, 1.0);
        let mut position = (ray.origin + ray.direction * ray.begin).clamp(Vec3::ZERO, UVec3::from(s.dims).as_vec3());
        let (mut throughput, mut radiance, mut density) = (Vec3::ONE, Vec3::ZERO, 0.0);
        let mut scatterings = 0;
        let mut end = if ray.begin < ray.end { self.fly(stream, position, direction) } else { End::Passed };
        loop {
            let (voxel, at) = match end {
                End::Collided(voxel, at) => (voxel, at),
                End::Passed => {
                    if scatterings > 0 {
                        radiance += throughput * self.sky(direction, density);
                        return radiance.extend(1.0);
                    }
                    return match self.background {
                        Background::Transparent => radiance.extend(0.0),
                        Background::Color(color) => (radiance + color).extend(1.0),
                        Background::Environment => {
                            (radiance + self.scene.environment.environment_radiance(direction)).extend(1.0)
                        }
                    };
                }
            };
            position = at;
            let m = classify(s, &self.scene.points, self.scene.scalar.fetch(voxel));
            let albedo = Vec3::from(albedo_of(s, &m));
            radiance += throughput * (1.0 - albedo) * Vec3::from(m.emission);
            let scattered = throughput * albedo;
            let most = scattered.max_element();
            if scatterings >= self.config.orders || most == 0.0 {
                return radiance.extend(1.0);
            }
            scatterings += 1;
            let u = stream.floats();
            throughput = scattered;
            if self.config.is_unlimited && most < 0.25 {
                let survival = (most * 4.0).max(0.05);
                if u.w >= survival {
                    return radiance.extend(1.0);
                }
                throughput /= survival;
            }
            let after = if s.g != 0.0 { sample_hg(s.g, direction, [u.x, u.y]) } else { sphere_direction(u.x, u.y) };
            density = phase_hg(s.g, direction.dot(after));
            radiance += self.next_event(stream, position, direction, throughput, u.z);
            direction = after;
            let emits = self.scene.points.iter().any(|p| p.emission.iter().any(|&e| e > 0.0)) && s.emission_scale > 0.0;
            let has_sky = !matches!(self.scene.environment, EnvironmentLight::None);
            if !self.scene.lights.is_empty() && scatterings >= self.config.orders && !emits && !has_sky {
                return radiance.extend(1.0);
            }
            end = self.fly(stream, position, direction);
        }
    }

    /// Light of the environment that a path meets by itself, weighted against its being drawn.
    fn sky(&self, direction: Vec3, density: f32) -> Vec3 {
        let radiance = self.scene.environment.environment_radiance(direction);
        match &self.scene.environment {
            EnvironmentLight::Image(..) => {
                let other = self.scene.environment.environment_density(direction);
                radiance * (density / (density + other))
            }
            _ => radiance,
        }
    }

    /// Light that arrives at `position` from a light that is drawn, scattered against `travelled`.
    fn next_event(&self, stream: &mut Stream, position: Vec3, travelled: Vec3, throughput: Vec3, coin: f32) -> Vec3 {
        let s = &self.scene.params;
        let lit = !self.scene.lights.is_empty();
        let sky = matches!(self.scene.environment, EnvironmentLight::Image(..));
        if !lit && !sky {
            return Vec3::ZERO;
        }
        let v = if sky { stream.floats() } else { Vec4::splat(coin) };
        let weight = if lit && sky { 2.0 } else { 1.0 };
        let (towards, reach, light) = if lit && !(sky && coin < 0.5) {
            let world = world_from_index(s, position);
            let (mut sum, mut chosen, mut u) = (0.0, None, v.x);
            for light in &self.scene.lights {
                let arrival = light_at(s, light, world);
                let irradiance = arrival.irradiance * phase_hg(s.g, arrival.travel.dot(-travelled));
                let w = irradiance.element_sum();
                sum += w;
                let chance = if sum > 0.0 { w / sum } else { 0.0 };
                if u < chance {
                    chosen = Some((arrival, irradiance, w));
                    u /= chance;
                } else {
                    u = if chance < 1.0 { (u - chance) / (1.0 - chance) } else { 0.0 };
                }
            }
            let Some((arrival, irradiance, w)) = chosen else { return Vec3::ZERO };
            (-arrival.travel, arrival.reach, irradiance * (sum / w))
        } else {
            let i = if v.y < 0.5 { 0 } else { 1 };
            let sample = self.scene.environment.sample_environment(i, 2, [v.z, v.w]).expect("there is an image");
            let phase = phase_hg(s.g, (-sample.direction).dot(-travelled));
            (sample.direction, f32::INFINITY, sample.radiance * (phase / (0.5 / sample.weight + phase)))
        };
        weight * throughput * light * self.transmittance(stream, position, towards, reach)
    }

    /// Free flight to a collision by null-collision tracking.
    fn fly(&self, stream: &mut Stream, position: Vec3, direction: Vec3) -> End {
        let mut end = End::Passed;
        self.track(stream, position, direction, f32::INFINITY, |voxel, p, ratio, u| {
            let collided = u < ratio;
            if collided {
                end = End::Collided(voxel, p);
            }
            !collided
        });
        end
    }

    /// Transmittance up to `reach` by ratio tracking.
    fn transmittance(&self, stream: &mut Stream, position: Vec3, direction: Vec3, reach: f32) -> f32 {
        let mut transmittance = 1.0;
        self.track(stream, position, direction, reach, |_, _, ratio, u| {
            transmittance *= 1.0 - ratio;
            if transmittance < 0.1 {
                transmittance = if u < 0.5 { 0.0 } else { 2.0 * transmittance };
            }
            transmittance > 0.0
        });
        transmittance
    }

    /// Visits tentative collisions, with the drawn voxel, the place, extinction over majorant, and a random number,
    /// until `visit` says stop or the ray ends.
    fn track(
        &self,
        stream: &mut Stream,
        position: Vec3,
        direction: Vec3,
        reach: f32,
        mut visit: impl FnMut(UVec3, Vec3, f32, f32) -> bool,
    ) {
        let s = &self.scene.params;
        let dims = UVec3::from(s.dims);
        let d = index_from_world_direction(s, direction);
        let longest = d.abs().max_element();
        let inverse =
            Vec3::from_array(d.to_array().map(|c| 1.0 / if c.abs() < longest * 1e-12 { longest * 1e-12 } else { c }));
        let far = (-position * inverse).max((dims.as_vec3() - position) * inverse);
        let limit = far.min_element().min(reach);
        let last = self.majorants.dims.as_ivec3() - 1;
        let mut cell = position.as_uvec3().min(dims - 1).as_ivec3() / CELL_SIZE as i32;
        let mut t = 0.0f32;
        loop {
            let majorant = self.majorants.fetch(cell.as_uvec3());
            let reach = if majorant > 0.0 { 1 } else { -majorant as i32 };
            let (low, high) = (cell - (reach - 1), cell + reach);
            let up = inverse.cmpgt(Vec3::ZERO);
            let face = Vec3::select(up, high.as_vec3(), low.as_vec3()) * CELL_SIZE as f32;
            let exits = (face - position) * inverse;
            let exit = t.max(exits.min_element());
            let end = exit.min(limit);
            let words = stream.draw();
            let flown =
                if majorant > 0.0 { t + exponential(words[0]) / (majorant * s.max_extinction) } else { f32::INFINITY };
            t = flown.min(end);
            let p = position + d * t;
            if flown < end {
                let third = words[2] << 24 | (words[3] & 255) << 16 | (words[1] & 255) << 8;
                let jitter = Vec3::new(unit_float(words[2]), unit_float(words[3]), unit_float(third));
                let voxel = (p + jitter - 0.5).floor().as_ivec3().clamp(IVec3::ZERO, dims.as_ivec3() - 1).as_uvec3();
                let ratio = self.extinction.fetch(voxel) / majorant;
                if !visit(voxel, p.clamp(Vec3::ZERO, dims.as_vec3()), ratio, unit_float(words[1])) {
                    return;
                }
            } else if exit < limit {
                let inside = (p / CELL_SIZE as f32).floor().as_ivec3().clamp(low, high - 1);
                for axis in 0..3 {
                    cell[axis] = inside[axis];
                    if exits[axis] == exits.min_element() {
                        cell[axis] = if up.test(axis) { high[axis] } else { low[axis] - 1 };
                    }
                }
                cell = cell.clamp(IVec3::ZERO, last);
            } else {
                return;
            }
        }
    }
}
