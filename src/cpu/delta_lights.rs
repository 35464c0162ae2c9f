//! Twin of `include/delta_lights.glsl`.

use crate::abi::{LightData, SceneParams};
use glam::Vec3;

/// A light as one place sees it, without what lies between.
#[derive(Clone, Copy, Debug)]
pub struct LightArrival {
    /// Propagation direction, unit vector.
    pub travel: Vec3,
    /// On a perpendicular plane.
    pub irradiance: Vec3,
    /// Distance to the light.
    pub reach: f32,
}

/// `light` at `world`.
pub fn light_at(scene: &SceneParams, light: &LightData, world: Vec3) -> LightArrival {
    let (vector, power) = (Vec3::from(light.vector), Vec3::from(light.power));
    if light.is_point == 0 {
        return LightArrival { travel: vector, irradiance: power, reach: f32::INFINITY };
    }
    let reach = (world - vector).length();
    let least = reach.max(0.5 * scene.mean_spacing);
    let travel = if reach > 0.0 { (world - vector) / reach } else { Vec3::Z };
    LightArrival { travel, irradiance: power / (least * least), reach }
}
