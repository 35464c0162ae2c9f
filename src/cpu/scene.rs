//! Twin of `include/scene.glsl`, and of what `SceneData` uploads.

use super::classify::scattering;
use super::environment::EnvironmentLight;
use super::texture::Texture;
use crate::abi::{LightData, SceneParams, TransferPointData};
use crate::passes::scene_data;
use crate::scene::Scene;
use crate::shaders::constants::NO_VALUE;
use glam::{UVec3, Vec2, Vec3, Vec4};

/// What every kernel reads.
pub struct HostScene {
    /// The scene's numbers.
    pub params: SceneParams,
    /// The transfer function.
    pub points: Vec<TransferPointData>,
    /// Delta lights.
    pub lights: Vec<LightData>,
    /// The volume's scalars.
    pub scalar: Texture<f32>,
    /// σ_s per channel and extinction of every voxel, relative to the largest extinction.
    pub scattering: Texture<Vec4>,
    /// Light from all around.
    pub environment: EnvironmentLight,
}

impl HostScene {
    /// The scene as the kernels see it.
    pub fn new(scene: &Scene) -> Self {
        let grid = &scene.volume.grid;
        let values = scene.volume.values_f32(0..grid.voxels() as usize, NO_VALUE);
        let (params, points) = (scene_data::params(scene), scene_data::transfer_points(scene));
        let scalar = Texture::new(grid.dims, values);
        Self {
            scattering: scattering(&params, &points, &scalar),
            params,
            points,
            lights: scene_data::lights(scene),
            scalar,
            environment: EnvironmentLight::new(scene.environment.as_ref()),
        }
    }
}

/// Where the eye looks, a unit vector, at a place in the picture: (0, 0) its upper left, (1, 1) its lower right corner.
pub fn eye_direction(scene: &SceneParams, place: Vec2) -> Vec3 {
    let film = place * 2.0 - 1.0;
    let direction = Vec3::from(scene.forward) + film.x * Vec3::from(scene.right) - film.y * Vec3::from(scene.up);
    direction.normalize()
}

/// Index space to world.
pub fn world_from_index(scene: &SceneParams, p: Vec3) -> Vec3 {
    Vec3::from(scene.world_of_x) * p.x
        + Vec3::from(scene.world_of_y) * p.y
        + Vec3::from(scene.world_of_z) * p.z
        + Vec3::from(scene.world_of_origin)
}

/// World to index space, for directions.
pub fn index_from_world_direction(scene: &SceneParams, d: Vec3) -> Vec3 {
    Vec3::from(scene.index_of_x) * d.x + Vec3::from(scene.index_of_y) * d.y + Vec3::from(scene.index_of_z) * d.z
}

/// World to index space.
pub fn index_from_world(scene: &SceneParams, p: Vec3) -> Vec3 {
    index_from_world_direction(scene, p) + Vec3::from(scene.index_of_origin)
}

/// Propagation direction of light that goes from a voxel to the eye.
pub fn direction_to_eye(scene: &SceneParams, index_position: Vec3) -> Vec3 {
    let d = Vec3::from(scene.eye) - world_from_index(scene, index_position);
    if d == Vec3::ZERO { -Vec3::from(scene.forward) } else { d.normalize() }
}

/// Voxel of a linear index.
pub fn voxel_from_linear(scene: &SceneParams, i: u32) -> UVec3 {
    let [x, y, _] = scene.dims;
    UVec3::new(i % x, i / x % y, i / x / y)
}
