//! Twin of `include/environment.glsl`, over the scene layer's images and sampling tables.

use super::sphere::{fract, lattice_direction};
use crate::scene::environment::EnvironmentTable;
use crate::scene::{Environment, LatLong};
use glam::Vec3;
use std::f32::consts::PI;

/// Light from all around, ready to be sampled.
pub enum EnvironmentLight {
    /// Darkness.
    None,
    /// The same radiance from everywhere.
    Constant(Vec3),
    /// An image and its table.
    Image(LatLong, EnvironmentTable),
}

/// One of the directions in which the environment is gathered.
pub struct EnvironmentSample {
    /// Away from the volume.
    pub direction: Vec3,
    /// What comes from there.
    pub radiance: Vec3,
    /// Weighted radiances add up to the integral over the sphere.
    pub weight: f32,
}

impl EnvironmentLight {
    /// The scene's.
    pub fn new(environment: Option<&Environment>) -> Self {
        match environment {
            None => Self::None,
            Some(Environment::Constant(radiance)) => Self::Constant(*radiance),
            Some(Environment::LatLong(image)) => Self::Image(image.clone(), EnvironmentTable::new(image)),
        }
    }

    /// Radiance from the direction `towards` (unit vector, world).
    pub fn environment_radiance(&self, towards: Vec3) -> Vec3 {
        match self {
            Self::None => Vec3::ZERO,
            Self::Constant(radiance) => *radiance,
            Self::Image(image, _) => image.radiance(towards.as_dvec3()),
        }
    }

    /// Density [1/sr] of drawing one of two samples of an image with equal chance; 0 where there is no image.
    pub fn environment_density(&self, towards: Vec3) -> f32 {
        match self {
            Self::Image(_, table) => 0.5 / (4.0 * PI) + 0.5 * table.density(towards.as_dvec3()),
            _ => 0.0,
        }
    }

    /// Sample `i` of `n`, shifted by two numbers in [0, 1); `None` in darkness.
    pub fn sample_environment(&self, i: u32, n: u32, shift: [f32; 2]) -> Option<EnvironmentSample> {
        let table = match self {
            Self::None => return None,
            Self::Constant(radiance) => {
                let direction = lattice_direction(i, n, shift);
                return Some(EnvironmentSample { direction, radiance: *radiance, weight: 4.0 * PI / n as f32 });
            }
            Self::Image(_, table) => table,
        };
        // Even directions first, then those drawn from the table.
        let drawn = n / 2;
        let even = n - drawn;
        let (direction, density) = if i < even {
            let direction = lattice_direction(i, even, shift);
            (direction, table.density(direction.as_dvec3()))
        } else {
            let u = fract((i - even) as f32 * 0.618_034 + shift[0]);
            let v = fract(((i - even) as f32 + 0.5) / drawn as f32 + shift[1]);
            let (direction, density) = table.sample([u, v]);
            (direction.as_vec3(), density)
        };
        let weight = 1.0 / (even as f32 / (4.0 * PI) + drawn as f32 * density);
        Some(EnvironmentSample { direction, radiance: self.environment_radiance(direction), weight })
    }
}
