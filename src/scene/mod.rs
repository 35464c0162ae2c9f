//! What to render: the scene as plain data, and how it is read from TOML and the command line.
//!
//! World axes are the volume file's physical space, z up by default. Radiance is linear RGB (Rec. 709).

pub mod animation;
pub mod camera;
pub mod environment;
pub mod file;
mod overrides;
mod paraview;
pub mod presets;
mod quality;
mod resolve;
mod sequence;
pub mod transfer;
pub mod values;

pub use overrides::{LightFlag, Overrides, RawFlags, phantom_of};
pub use quality::Quality;
pub use resolve::{merge, resolve};
pub use sequence::{Player, Sequence, Shot, files_of, load_scene, load_scene_text};
pub use values::Mask;

use glam::{DVec3, Vec3};
use std::path::PathBuf;
use std::sync::Arc;

/// Which light transport is computed (DESIGN section 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Emission-absorption: the transfer function's colour is emitted.
    Absorption,
    /// Local gradient shading of the transfer function's colour.
    Phong,
    /// Light scattered once.
    Single,
    /// Light scattered 1 to `orders` times.
    Multiple,
    /// The same by an unbiased path tracer: the reference.
    Path,
}

/// [`Settings::orders`] of a path tracer whose paths end by Russian roulette only.
pub const UNLIMITED: u32 = u32::MAX;

/// How the gather chooses the directions that it traces (DESIGN section 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// N directions from the phase function.
    Phase,
    /// The N of M candidates with the most proxy energy, as the paper does. Biased.
    Top,
    /// N of M candidates drawn in proportion to the proxy energy. Unbiased.
    Resample,
    /// Mean of the proxy energies of M directions, plus the mean of (traced − proxy) over N others. Unbiased: a two-level
    /// Monte Carlo.
    Residual,
    /// `phase`, or `residual` with M and N of its own choice where that takes less time for as little noise as `phase` has
    /// with N directions. A pilot of a few cells decides.
    Auto,
}

impl Sampling {
    /// Does it estimate light in the proxy, or may it?
    pub fn uses_proxy(self) -> bool {
        self != Sampling::Phase
    }

    /// Are the traced directions some of the candidates?
    pub fn is_choice(self) -> bool {
        matches!(self, Sampling::Top | Sampling::Resample)
    }
}

/// How fields of light and extinction are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// 16-bit floats, whose range is chosen from the data.
    Half,
    /// 32-bit floats: twice the memory.
    Single,
}

/// Which eye light is computed for (`single`, `multiple`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightFor {
    /// That of the picture.
    View,
    /// Any: a moving camera needs it once. For g ≠ 0 what the eye sees is less exact.
    EveryView,
}

/// How a transfer function's `opacity` becomes an extinction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OpacityUnit {
    /// VTK's convention: σ_t = −ln(1−α)/unit_distance; `None` = the volume's mean spacing.
    PerDistance(Option<f64>),
    /// The points' `opacity` is σ_t itself, in 1/unit.
    Extinction,
}

/// One point of a piecewise linear transfer function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferPoint {
    /// Scalar value in the volume's own unit.
    pub value: f64,
    /// Albedo per channel (`single`, `multiple`) or emitted colour (`absorption`, `phong`), linear RGB from 0 to 1.
    pub color: [f32; 3],
    /// Opacity from 0 to 1 or extinction ≥ 0, see [`OpacityUnit`].
    pub opacity: f32,
    /// L_e, the emitted radiance of the medium in thermal equilibrium (the source is σ_a L_e), linear RGB ≥ 0.
    pub emission: [f32; 3],
}

/// Piecewise linear map from scalar to colour and extinction. Constant beyond the first and the last point.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// At least one point, `value` non-decreasing. Two points of one value make a step; at the step the later one holds.
    pub points: Vec<TransferPoint>,
    /// Meaning of `opacity`.
    pub opacity_unit: OpacityUnit,
}

/// A light that is not part of the environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// Parallel light.
    Directional {
        /// Direction in which the light travels (unit vector, world).
        direction: DVec3,
        /// Irradiance on a perpendicular plane, linear RGB.
        irradiance: Vec3,
    },
    /// Isotropic point light.
    Point {
        /// Place in the world.
        position: DVec3,
        /// Radiant intensity, linear RGB.
        intensity: Vec3,
    },
}

/// Light from infinitely far away, in all directions.
#[derive(Clone, Debug, PartialEq)]
pub enum Environment {
    /// The same radiance from everywhere.
    Constant(Vec3),
    /// A latitude-longitude image of radiance. Row 0 looks along +up, the image's centre column along `forward`.
    LatLong(LatLong),
}

/// A latitude-longitude radiance image.
#[derive(Clone, Debug, PartialEq)]
pub struct LatLong {
    /// Columns (azimuth).
    pub width: u32,
    /// Rows (polar angle, row 0 at +z of the world).
    pub height: u32,
    /// Linear RGB radiance, row by row, finite and ≥ 0.
    pub pixels: Vec<[f32; 3]>,
    /// Rotation about the world's z axis in degrees, counter-clockwise seen from +z.
    pub rotation_degrees: f64,
}

/// Perspective pinhole camera, resolved (no automatic parts left).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Eye, world.
    pub position: DVec3,
    /// Unit vector of sight, world.
    pub forward: DVec3,
    /// Unit vector to the right of the picture, world.
    pub right: DVec3,
    /// Unit vector upwards in the picture, world.
    pub up: DVec3,
    /// Vertical field of view in degrees, in (0, 180).
    pub fov_degrees: f64,
}

/// What is seen behind the medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// The environment itself.
    Environment,
    /// A colour (linear RGB radiance) that lights nothing.
    Color(Vec3),
    /// Nothing; the picture's alpha is 1 − transmittance.
    Transparent,
}

/// Tone curve of the PNG output; EXR is always linear and unscaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneCurve {
    /// Exposure and the sRGB curve only; clips at 1.
    Linear,
    /// A filmic shoulder: bright parts roll off instead of clipping.
    Filmic,
}

/// Exposure of the PNG output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// Chosen from the picture: its bright parts come out just below white.
    Auto,
    /// Fixed, in stops (EV): pixel values are multiplied by 2^EV.
    Stops(f32),
}

/// Knobs of the method; every one is on the command line too.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// Light transport.
    pub model: Model,
    /// Choice of traced directions.
    pub sampling: Sampling,
    /// M: directions per cell and order that are estimated in the proxy. 1..=1024.
    pub candidates: u32,
    /// N: directions per cell traced in the data, in the gather that the eye sees. 1..=1024; N ≤ M where the sampling chooses
    /// them from the candidates.
    pub directions: u32,
    /// Share of N and M that the gathers before that one get, in (0, 1], but no less than a direction for each point of a cell: their
    /// noise reaches the eye only as means over several cells.
    pub inner_share: f32,
    /// K: light scattered 1..K times, ≥ 1; [`UNLIMITED`] for `path` only.
    #[serde(serialize_with = "values::write_orders")]
    pub orders: u32,
    /// Scatterings after which a path of unlimited orders is cut.
    pub max_events: u32,
    /// Directions in which a cell samples an environment image, or any environment where no further order is gathered.
    pub environment_directions: u32,
    /// Share of their directions that cells get which the eye does not see, in (0, 1].
    pub hidden_share: f32,
    /// Which eye light is computed for. For every view no cell is hidden, but for those that none of [`Scene::views`] sees.
    pub light_for: LightFor,
    /// Distance between samples of camera rays in voxels: half a step (`include/march.glsl`).
    pub camera_step: f32,
    /// The same of gather and shadow rays.
    pub gather_step: f32,
    /// Step of proxy rays in voxels.
    pub proxy_step: f32,
    /// How fields of light and extinction are stored.
    pub precision: Precision,
    /// Voxels along the edge of a block of the light grid: light is computed and solved for per block, 1 to 4.
    pub light_grid: u32,
    /// Steps of the solution for what is stored per voxel (`passes::project`). 1..=64.
    pub projection_steps: u32,
    /// β of `resample`: share of the uniform defence in the draw, in (0, 1].
    pub defence: f32,
    /// What the proxy's hash keeps of a colour.
    pub mask: Mask,
    /// Picture width and height in pixels.
    pub size: [u32; 2],
    /// Camera rays per pixel; for `path` the most there may be.
    pub spp: u32,
    /// `path`: stop after so many seconds.
    pub seconds: Option<f64>,
    /// `path`: stop when the root mean square of the pixels' standard errors over the mean radiance is at most this.
    pub target_error: Option<f64>,
    /// Random seed.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            model: Model::Multiple,
            sampling: Sampling::Phase,
            candidates: 64,
            directions: 48,
            inner_share: 0.33,
            orders: 4,
            max_events: 100_000,
            environment_directions: 64,
            hidden_share: 0.25,
            light_for: LightFor::View,
            camera_step: 0.5,
            gather_step: 1.0,
            proxy_step: 2.0,
            precision: Precision::Half,
            light_grid: 1,
            projection_steps: 6,
            defence: 0.5,
            mask: Mask::Channels([0xF0; 4]),
            size: [512, 512],
            spp: 48,
            seconds: None,
            target_error: None,
            seed: 0,
        }
    }
}

/// Everything a picture depends on, resolved: no file is left to be read, no automatic value to be chosen.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The data.
    pub volume: Arc<crate::volume::Volume>,
    /// Scalar to colour and extinction.
    pub transfer: TransferFunction,
    /// Henyey-Greenstein mean cosine in (−1, 1).
    pub g: f32,
    /// Multiplies the transfer function's colour to give the albedo, per channel, from 0 to 1.
    pub albedo_scale: Vec3,
    /// Multiplies every extinction.
    pub density_scale: f64,
    /// Multiplies every emission.
    pub emission_scale: f32,
    /// Directional and point lights, any number.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Option<Environment>,
    /// The camera.
    pub camera: Camera,
    /// The cameras of all frames that differ from this one by nothing else, which light for every view is for; none where
    /// they are not known.
    pub views: Vec<Camera>,
    /// What is seen behind the medium.
    pub background: Background,
    /// Knobs.
    pub settings: Settings,
    /// Exposure of PNG output.
    pub exposure: Exposure,
    /// Tone curve of PNG output.
    pub tone: ToneCurve,
    /// The scene file, if there was one.
    pub path: Option<PathBuf>,
}

impl Scene {
    /// The volume, to be changed; another scene that shares it keeps what it has.
    pub fn volume_mut(&mut self) -> &mut crate::volume::Volume {
        Arc::make_mut(&mut self.volume)
    }
}
