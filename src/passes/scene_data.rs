//! The scene on the GPU: its numbers, transfer function, lights, environment and scalars, shared by all passes.

use super::Stored;
use super::compact::Blocks;
use crate::abi::{LightData, SceneParams, TransferPointData};
use crate::cpu::classify::classify;
use crate::scene::environment::EnvironmentTable;
use crate::scene::{Background, Camera, Environment, Light, Model, OpacityUnit, Scene};
use crate::shaders::constants;
use crate::vk::{Buffer, Context, Image, ImageFormat};
use crate::{Error, Result};
use glam::{DAffine3, DVec3, Vec3};

/// Everything that is uploaded once.
pub struct SceneData {
    /// Host copy of the numbers.
    pub params: SceneParams,
    /// Host copy of the transfer function.
    pub points: Vec<TransferPointData>,
    pub(super) block: Buffer<SceneParams>,
    pub(super) transfer: Buffer<TransferPointData>,
    pub(super) lights: Buffer<LightData>,
    pub(super) scalar: Image,
    /// σ_s and extinction of every voxel, once they are classified (`passes::classify`). A single texel in models that store no light,
    /// and where one albedo makes them out of the extinction.
    pub(super) scattering: Image,
    /// Has all of the medium one albedo?
    pub has_even_albedo: bool,
    pub(super) environment_image: Image,
    pub(super) environment_table: Buffer<f32>,
    /// Delta lights.
    pub light_count: u32,
    /// Are there point lights among them?
    pub has_point_lights: bool,
    /// `constants::ENVIRONMENT_*`.
    pub environment: u32,
    /// Mean radiance of the environment.
    pub ambient: Vec3,
    /// Does anything in the medium emit?
    pub has_emission: bool,
    /// How light is stored.
    pub stored: Stored,
    origin: DVec3,
}

fn f3(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

/// The origin of positions on the GPU, world: the volume's centre. Single precision would lose a volume that is far from
/// the world's own origin.
fn origin(scene: &Scene) -> DVec3 {
    let grid = &scene.volume.grid;
    grid.index_to_world.transform_point3(0.5 * DVec3::from(grid.dims.map(f64::from)))
}

/// The transfer function as the GPU gets it.
pub fn transfer_points(scene: &Scene) -> Vec<TransferPointData> {
    let points = scene.transfer.points.iter();
    points
        .map(|p| TransferPointData { value: p.value as f32, opacity: p.opacity, color: p.color, emission: p.emission })
        .collect()
}

/// The delta lights as the GPU gets them.
pub fn lights(scene: &Scene) -> Vec<LightData> {
    let origin = origin(scene);
    let data = |light: &Light| match light {
        Light::Directional { direction, irradiance } => {
            LightData { vector: f3(*direction), is_point: 0, power: irradiance.to_array() }
        }
        Light::Point { position, intensity } => {
            LightData { vector: f3(*position - origin), is_point: 1, power: intensity.to_array() }
        }
    };
    scene.lights.iter().map(data).collect()
}

/// Largest radiance that can arrive at any voxel, averaged over directions: the range of what fields store.
fn arrival_bound(scene: &Scene, emitted: f32) -> f64 {
    let four_pi = 4.0 * std::f64::consts::PI;
    let (low, high) = scene.volume.grid.world_bounds();
    let lights: f64 = scene
        .lights
        .iter()
        .map(|light| match light {
            Light::Directional { irradiance, .. } => f64::from(irradiance.max_element()) / four_pi,
            Light::Point { position, intensity } => {
                let distance = position.distance(position.clamp(low, high));
                let least = distance.max(0.5 * scene.volume.grid.mean_spacing());
                f64::from(intensity.max_element()) / (least * least * four_pi)
            }
        })
        .sum();
    let environment = scene.environment.as_ref().map_or(0.0, |e| f64::from(e.mean_radiance().max_element()));
    lights + environment + f64::from(emitted)
}

/// Radiance below which its scale grows no more: that is near the end of single precision.
const LEAST_BOUND: f64 = 1e-33;

/// Largest radiance that the model stores. `emitted`: the medium's largest.
fn radiance_bound(scene: &Scene, emitted: f32) -> f64 {
    let arriving = arrival_bound(scene, emitted);
    // Towards the eye the phase function can exceed its mean by this factor.
    let g = f64::from(scene.g.abs());
    let peak = (1.0 + g) / (1.0 - g).powi(2);
    match scene.settings.model {
        // The transfer function's colours.
        Model::Absorption => 1.0,
        // Local shading is colour times light, without the mean over directions.
        Model::Phong | Model::Single | Model::Multiple => arriving * peak.max(4.0 * std::f64::consts::PI),
        // Sums of whole samples, in single precision.
        Model::Path => match scene.background {
            Background::Color(color) => arriving * peak + f64::from(color.max_element()),
            _ => arriving * peak,
        },
    }
}

/// Is all light in the medium of one colour, and that of no hue? Then its channels are equal, bit by bit. What lies behind the
/// medium is another thing.
fn is_grey(scene: &Scene) -> bool {
    let is_one = |c: &[f32]| c[0] == c[1] && c[1] == c[2];
    let points = transfer_points(scene);
    let lights = lights(scene);
    is_one(&scene.albedo_scale.to_array())
        && points.iter().all(|p| is_one(&p.color) && is_one(&p.emission))
        && lights.iter().all(|l| is_one(&l.power))
        && match &scene.environment {
            None => true,
            Some(Environment::Constant(radiance)) => is_one(&radiance.to_array()),
            Some(Environment::LatLong(image)) => image.pixels.iter().all(|p| is_one(&p[..])),
        }
}

/// `origin`: of positions on the GPU, world.
fn set_eye(params: &mut SceneParams, camera: &Camera, origin: DVec3) {
    let half_height = (camera.fov_degrees.to_radians() / 2.0).tan();
    let [width, height] = params.size;
    let half_width = half_height * f64::from(width) / f64::from(height);
    params.eye = f3(camera.position - origin);
    params.forward = f3(camera.forward);
    params.right = f3(camera.right * half_width);
    params.up = f3(camera.up * half_height);
}

/// Albedo at the transfer function's first point.
fn even_albedo(scene: &Scene) -> Vec3 {
    let color = scene.transfer.points.first().map_or([0.0; 3], |p| p.color);
    (Vec3::from(color) * scene.albedo_scale).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Is light stored?
fn scatters(scene: &Scene) -> bool {
    matches!(scene.settings.model, Model::Single | Model::Multiple)
}

/// The scene's numbers. `max_extinction` and `radiance_scale` follow from the data.
pub fn params(scene: &Scene) -> SceneParams {
    let grid = &scene.volume.grid;
    // Other models store no light.
    let light = Blocks::of(grid.dims, if scatters(scene) { scene.settings.light_grid } else { 1 });
    let origin = origin(scene);
    let to_world = DAffine3::from_translation(-origin) * grid.index_to_world;
    let to_index = to_world.inverse();
    let environment = match &scene.environment {
        Some(Environment::Constant(radiance)) => *radiance,
        _ => Vec3::ZERO,
    };
    let mut params = SceneParams {
        world_of_x: f3(to_world.matrix3.x_axis),
        world_of_y: f3(to_world.matrix3.y_axis),
        world_of_z: f3(to_world.matrix3.z_axis),
        world_of_origin: f3(to_world.translation),
        index_of_x: f3(to_index.matrix3.x_axis),
        index_of_y: f3(to_index.matrix3.y_axis),
        index_of_z: f3(to_index.matrix3.z_axis),
        index_of_origin: f3(to_index.translation),
        dims: grid.dims,
        light_edge: light.edge,
        light_dims: light.dims,
        transfer_points: scene.transfer.points.len() as u32,
        eye: [0.0; 3],
        forward: [0.0; 3],
        right: [0.0; 3],
        up: [0.0; 3],
        size: scene.settings.size,
        unit_distance: match scene.transfer.opacity_unit {
            OpacityUnit::PerDistance(unit) => unit.unwrap_or(grid.mean_spacing()) as f32,
            OpacityUnit::Extinction => 0.0,
        },
        density_scale: scene.density_scale as f32,
        max_extinction: 1.0,
        radiance_scale: 1.0,
        g: scene.g,
        emission_scale: scene.emission_scale,
        albedo_scale: scene.albedo_scale.to_array(),
        even_albedo: even_albedo(scene).to_array(),
        environment: environment.to_array(),
        background: match scene.background {
            Background::Color(color) => color.to_array(),
            _ => [0.0; 3],
        },
        environment_rotation: 0.0,
        environment_size: [1, 1],
        mean_spacing: grid.mean_spacing() as f32,
        seed_low: scene.settings.seed as u32,
        seed_high: (scene.settings.seed >> 32) as u32,
    };
    set_eye(&mut params, &scene.camera, origin);
    // Extinction is monotone between points, so its maximum is at one of them.
    let points = transfer_points(scene);
    let at_points = || points.iter().map(|p| classify(&params, &points, p.value));
    let most = at_points().map(|m| m.extinction).fold(0.0, f32::max);
    let emitted = at_points().map(|m| Vec3::from(m.emission).max_element()).fold(0.0, f32::max);
    // A step's two points of one value hide the first from `classify`, but not from its left neighbourhood.
    let left = points.iter().map(|p| crate::cpu::classify::extinction(&params, p.opacity)).fold(0.0, f32::max);
    let most = most.max(left);
    let emitted =
        points.iter().map(|p| Vec3::from(p.emission).max_element() * scene.emission_scale).fold(emitted, f32::max);
    if most > 0.0 {
        params.max_extinction = most;
    }
    // Half of the range is left free for what interpolation and accumulation round up. Darkness needs no scale.
    let bound = radiance_bound(scene, emitted).max(LEAST_BOUND);
    params.radiance_scale = (f64::from(constants::MAX_HALF) / (2.0 * bound)) as f32;
    params
}

impl SceneData {
    /// Uploads the scene.
    ///
    /// Errors: the volume or the environment is larger than the device's images, or memory runs out.
    pub fn new(ctx: &Context, scene: &Scene) -> Result<Self> {
        Self::with_color(ctx, scene, false)
    }

    /// The same, where `stores_color` with three channels of light, whether there is colour or not.
    pub fn with_color(ctx: &Context, scene: &Scene, stores_color: bool) -> Result<Self> {
        let mut params = params(scene);
        let points = transfer_points(scene);
        if !(params.max_extinction.is_finite() && params.radiance_scale.is_normal()) {
            return Err(Error::input(
                "scene",
                "extinctions or lights are beyond the range of 32-bit floats",
                "scale the transfer function or the lights down",
            ));
        }
        let dims = scene.volume.grid.dims;
        let layer = dims[0] as usize * dims[1] as usize;
        let scalar = ctx.image_3d("scalar", dims, ImageFormat::R32Float)?;
        ctx.upload_image(&scalar, |z| {
            scene.volume.values_f32(z.start as usize * layer..z.end as usize * layer, constants::NO_VALUE)
        })?;
        let mut environment = constants::ENVIRONMENT_NONE;
        let mut pixels = vec![[0.0f32; 4]];
        let mut size = [1, 1];
        let mut table = vec![0.0f32];
        match &scene.environment {
            None => {}
            Some(Environment::Constant(radiance)) if *radiance == Vec3::ZERO => {}
            Some(Environment::Constant(_)) => environment = constants::ENVIRONMENT_CONSTANT,
            Some(Environment::LatLong(image)) => {
                environment = constants::ENVIRONMENT_IMAGE;
                size = [image.width, image.height];
                pixels = image.pixels.iter().map(|p| [p[0], p[1], p[2], 1.0]).collect();
                let sampling = EnvironmentTable::new(image);
                params.environment_size = [sampling.columns, sampling.rows];
                params.environment_rotation = image.rotation_degrees.to_radians() as f32;
                table = [sampling.marginal, sampling.conditional].concat();
            }
        }
        let environment_image = ctx.image_2d("environment", size, ImageFormat::Rgba32Float)?;
        ctx.upload_image(&environment_image, |_| std::mem::take(&mut pixels))?;
        let lights = lights(scene);
        let stored = Stored::of(ctx, scene.settings.precision, !stores_color && is_grey(scene));
        let has_even_albedo = points.iter().all(|p| p.color == points[0].color);
        let scattering = if scatters(scene) && !has_even_albedo { dims } else { [1; 3] };
        Ok(Self {
            block: ctx.upload("scene", &[params])?,
            transfer: ctx.upload("transfer", &points)?,
            lights: ctx.upload("lights", &lights)?,
            scalar,
            scattering: ctx.image_3d("scattering", scattering, stored.format())?,
            has_even_albedo,
            environment_image,
            environment_table: ctx.upload("environment.table", &table)?,
            light_count: lights.len() as u32,
            has_point_lights: lights.iter().any(|l| l.is_point != 0),
            environment,
            ambient: scene.environment.as_ref().map_or(Vec3::ZERO, Environment::mean_radiance),
            has_emission: scene.emission_scale > 0.0 && points.iter().any(|p| p.emission.iter().any(|&e| e > 0.0)),
            stored,
            params,
            points,
            origin: origin(scene),
        })
    }

    /// Changes the random numbers.
    pub fn set_seed(&mut self, ctx: &Context, seed: u64) -> Result<()> {
        self.change(ctx, SceneParams { seed_low: seed as u32, seed_high: (seed >> 32) as u32, ..self.params })
    }

    /// Moves the eye.
    pub fn set_camera(&mut self, ctx: &Context, camera: &Camera) -> Result<()> {
        let mut changed = self.params;
        set_eye(&mut changed, camera, self.origin);
        self.change(ctx, changed)
    }

    fn change(&mut self, ctx: &Context, changed: SceneParams) -> Result<()> {
        if bytemuck::bytes_of(&changed) != bytemuck::bytes_of(&self.params) {
            self.params = changed;
            self.block = ctx.upload("scene", &[changed])?;
        }
        Ok(())
    }

    /// An image for a field of light and extinction.
    pub fn field(&self, ctx: &Context, name: &str, dims: [u32; 3]) -> Result<Image> {
        ctx.image_3d(name, dims, self.stored.format())
    }

    /// Where samplers find σ_s, given where they find the extinction in the fourth component (`glsl/include/scattering.glsl`).
    pub fn scattering<'i>(&'i self, extinction: &'i Image) -> &'i Image {
        if self.has_even_albedo { extinction } else { &self.scattering }
    }

    /// Has the image of scattering coefficients room for those of every voxel?
    pub(super) fn stores_scattering(&self) -> bool {
        !self.has_even_albedo && self.scattering.extent() == self.params.dims
    }

    /// The blocks of the light grid.
    pub fn light_blocks(&self) -> Blocks {
        Blocks { edge: self.params.light_edge, dims: self.params.light_dims }
    }

    /// Are they larger than voxels?
    pub fn is_coarse(&self) -> bool {
        self.params.light_edge > 1
    }

    /// Voxels of the volume.
    pub fn voxels(&self) -> u64 {
        self.params.dims.iter().map(|&d| u64::from(d)).product()
    }
}
