//! The scene file: its TOML tables, the checks on their values, and how one layer of settings covers another.
//!
//! A preset, a scene file and the command line are three layers of the same form: whatever a layer leaves out comes
//! from the one below. Colours are as [`Rgb`] says; angles are in degrees; lengths in the volume's unit.

use super::animation::{KeyTable, Track, field_at, layer_at};
use super::values::{BackgroundValue, ExposureValue, Factor, Mask, Orders, Rgb, UpAxis};
use super::{Exposure, LightFor, Model, Precision, Quality, Sampling, ToneCurve};
use crate::input::{line_of, parse_toml, read_text};
use crate::shaders::constants::MAX_LIGHT_EDGE;
use crate::volume::ScalarType;
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Most camera rays per pixel: single precision counts them exactly.
pub const MAX_SPP: u32 = 1 << 24;
/// Most frames of a scene.
pub const MAX_FRAMES: u32 = 100_000;

/// A table of which every field may be missing; `over` lays one on another, field by field. A `keyed` one may stand in key
/// frames.
macro_rules! table {
    ($(#[$doc:meta])* keyed $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* }) => {
        table! { $(#[$doc])* $name { $($(#[$field_doc])* $field: $type,)* } }

        impl Track for $name {
            fn between(keys: &[(f64, &Self)], at: f64) -> Self {
                Self { $($field: field_at(keys, at, |key| key.$field.as_ref()),)* }
            }
        }
    };
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: Option<$type>,)*
        }

        impl $name {
            /// These fields where they are given, else those of `below`.
            pub fn over(self, below: Self) -> Self {
                Self { $($field: self.$field.or(below.$field),)* }
            }
        }
    };
}

/// A scene file, or a layer of the same form.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneFile {
    /// Name of the preset below this layer.
    pub preset: Option<String>,
    /// What is seen behind the medium: "environment", "transparent", or a colour that lights nothing.
    pub background: Option<BackgroundValue>,
    /// `[volume]`
    pub volume: VolumeTable,
    /// `[transfer]`
    pub transfer: TransferTable,
    /// `[medium]`
    pub medium: MediumTable,
    /// `[[light]]`; `light = []` takes away the lights of the layer below.
    pub light: Option<Vec<LightTable>>,
    /// `[environment]`
    pub environment: EnvironmentTable,
    /// `[camera]`
    pub camera: CameraTable,
    /// `[turntable]`
    pub turntable: TurntableTable,
    /// `[animation]`
    pub animation: AnimationTable,
    /// `[render]`
    pub render: RenderTable,
    /// `[output]`
    pub output: OutputTable,
}

table! {
    /// The data.
    VolumeTable {
        /// NRRD, MetaImage, NIfTI or raw file.
        file: PathBuf,
        /// Layout of a file without a header; its presence says that the file is raw.
        raw: RawTable,
        /// Name of a built-in volume, instead of `file`.
        phantom: String,
        /// Voxels of the phantom along x, y, z; default: as the phantom's own.
        size: [u32; 3],
        /// Amplitude of even noise added to every voxel, in the volume's unit; default 0. It breaks up homogeneous
        /// regions, the worst case of the proxy.
        noise: f64,
        /// Added to every value, e.g. -1024 for a CT that was stored without its offset to Hounsfield units.
        value_offset: f64,
        /// Axis of the file's space that points up in the world: "x", "-x", "y", "-y", "z" (default), "-z".
        up: UpAxis,
    }
}

table! {
    /// Layout of a raw file.
    RawTable {
        /// Voxels along x, y, z; x is fastest in the file.
        size: [u32; 3],
        /// Type of the stored scalars.
        r#type: ScalarType,
        /// Byte order, default little.
        endian: RawEndian,
        /// Voxel spacing along x, y, z, default 1.
        spacing: [f64; 3],
        /// Bytes before the first voxel, default 0.
        skip: u64,
    }
}

/// Byte order of a raw file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RawEndian {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

table! {
    /// Scalar to colour and extinction. Also the whole of a transfer function file. A layer that gives `points` or
    /// `file` replaces the table below it altogether.
    keyed TransferTable {
        /// A file with the fields of this table (.toml), or a ParaView colour map with opacities (.json).
        file: PathBuf,
        /// Points of the piecewise linear function, by non-decreasing value.
        points: Vec<PointTable>,
        /// What the points' values count in; default "value".
        scale: ValueScale,
        /// What the points' opacities are; default "opacity".
        convention: OpacityConvention,
        /// Distance over which an opacity is reached; default: the mean voxel spacing.
        unit_distance: f64,
        /// Width of the value range onto which the first to the last point are moved.
        window: f64,
        /// Centre of that range.
        level: f64,
    }
}

/// One point of a transfer function.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointTable {
    /// Scalar value, see [`ValueScale`].
    pub value: f64,
    /// Albedo (or emitted colour), from 0 to 1.
    pub color: Rgb,
    /// Opacity from 0 to 1, or extinction [1/unit].
    pub opacity: f64,
    /// Emitted radiance L_e, default 0.
    pub emission: Option<Rgb>,
}

/// Unit of the points' values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ValueScale {
    /// The volume's own unit, e.g. Hounsfield units.
    Value,
    /// 0 = the 1st, 1 = the 99th percentile of the voxels: for data without a unit.
    Relative,
}

/// Meaning of the points' opacities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OpacityConvention {
    /// VTK's: the opacity of one unit distance.
    Opacity,
    /// The extinction itself, 1/unit.
    Extinction,
}

table! {
    /// Properties of the medium that hold everywhere.
    keyed MediumTable {
        /// Henyey-Greenstein mean cosine in (−1, 1); default 0, isotropic.
        g: f64,
        /// Multiplies the transfer function's colour to give the albedo, from 0 to 1; default 1.
        albedo: Rgb,
        /// Multiplies every extinction, ≥ 0; default 1.
        density: f64,
        /// Multiplies every emission, ≥ 0; default 1.
        emission: f64,
    }
}

table! {
    /// A directional light (`azimuth` and `elevation`, or `direction`), or a point light (`position`, or
    /// `relative_position`).
    keyed LightTable {
        /// Where a directional light comes from, as the camera's azimuth.
        azimuth: f64,
        /// Where a directional light comes from, as the camera's elevation.
        elevation: f64,
        /// The direction in which a directional light travels, world.
        direction: [f64; 3],
        /// Place of a point light, world.
        position: [f64; 3],
        /// Place of a point light about the centre of the volume's world box; ±1 are its faces.
        relative_position: [f64; 3],
        /// Irradiance on a plane that faces the light; for a point light: at the centre of the box, medium left out.
        irradiance: Rgb,
        /// Radiant intensity of a point light, instead of `irradiance`.
        intensity: Rgb,
        /// Multiplies either, ≥ 0; default 1.
        strength: f64,
    }
}

table! {
    /// Light from all around. A layer that gives `radiance` or `file` replaces the table below it altogether.
    keyed EnvironmentTable {
        /// The same radiance from everywhere.
        radiance: Rgb,
        /// Latitude-longitude image, .hdr or .exr.
        file: PathBuf,
        /// Multiplies the radiance, ≥ 0; default 1.
        strength: f64,
        /// Turns the image counter-clockwise seen from above; default 0.
        rotation: f64,
    }
}

table! {
    /// The camera: automatic framing by angles, or a `position`. A layer that gives one kind takes the other kind's
    /// fields of the layer below away.
    keyed CameraTable {
        /// Where the eye is: 0 = in front (−y), 90 = at +x (the patient's left); default 0.
        azimuth: f64,
        /// Height above the horizon in −90 to 90; default 0.
        elevation: f64,
        /// Turns the camera clockwise; default 0.
        roll: f64,
        /// Magnification of the picture, > 0; default 1.
        zoom: Factor,
        /// The eye, world; may be inside the volume.
        position: [f64; 3],
        /// What the eye looks at, world; default: the centre of the volume.
        look_at: [f64; 3],
        /// What is up in the picture, world; default +z.
        up: [f64; 3],
        /// Vertical field of view in [0.1, 179]; default 30.
        fov: f64,
    }
}

table! {
    /// Frames of a camera that goes around the vertical axis through the volume's centre, counter-clockwise seen from above.
    /// Without `frames` it stands still.
    TurntableTable {
        /// Frames of the whole turn.
        frames: u32,
        /// The whole turn; default 360. Frame i has gone i / frames of it.
        degrees: f64,
    }
}

table! {
    /// Key frames.
    AnimationTable {
        /// Frames in all; default: a turntable's, else as many as the volume's series has files or the last key needs,
        /// whichever is more.
        frames: u32,
        /// `[[animation.key]]`, in the order of their frames.
        key: Vec<KeyTable>,
    }
}

table! {
    /// Knobs of the method; see [`super::Settings`] for their meaning and defaults.
    #[allow(missing_docs, reason = "the fields are those of Settings")]
    RenderTable {
        model: Model,
        quality: Quality,
        sampling: Sampling,
        candidates: u32,
        directions: u32,
        orders: Orders,
        max_events: u32,
        inner_share: f64,
        environment_directions: u32,
        camera_step: f64,
        gather_step: f64,
        proxy_step: f64,
        precision: Precision,
        light_grid: u32,
        projection_steps: u32,
        hidden_share: f64,
        light_for: LightFor,
        defence: f64,
        mask: Mask,
        size: [u32; 2],
        spp: u32,
        seconds: f64,
        target_error: f64,
        seed: u64,
    }
}

table! {
    /// How radiance becomes a PNG.
    keyed OutputTable {
        /// "auto" (default) or stops.
        exposure: ExposureValue,
        /// Tone curve, default filmic.
        tone: ToneCurve,
    }
}

/// What is wrong with one field, before it is known in which file or flag it was given.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldError {
    /// Path of the field: `render.orders`, `light.0.direction`.
    pub field: String,
    /// What is wrong with it.
    pub problem: String,
    /// What to do.
    pub cure: String,
}

impl FieldError {
    fn new(field: impl Into<String>, problem: impl Into<String>, cure: impl Into<String>) -> Self {
        Self { field: field.into(), problem: problem.into(), cure: cure.into() }
    }
}

type Check = std::result::Result<(), FieldError>;

/// Refuses a given value that is not `ok`; `expected` completes "give ...". NaN must not be `ok`.
fn check<T: std::fmt::Debug>(field: &str, value: &Option<T>, ok: impl Fn(&T) -> bool, expected: &str) -> Check {
    match value {
        Some(v) if !ok(v) => Err(FieldError::new(field, format!("is {v:?}"), format!("give {expected}"))),
        _ => Ok(()),
    }
}

/// Refuses two given fields of which only one makes sense.
fn exclude(table: &str, a: (&str, bool), b: (&str, bool), cure: &str) -> Check {
    if a.1 && b.1 {
        let field = format!("{table}.{}", b.0);
        return Err(FieldError::new(field, format!("is given beside '{}'", a.0), cure));
    }
    Ok(())
}

fn finite(v: &f64) -> bool {
    v.is_finite()
}

fn positive(v: &f64) -> bool {
    *v > 0.0 && v.is_finite()
}

fn non_negative(v: &f64) -> bool {
    *v >= 0.0 && (*v as f32).is_finite()
}

fn finite3(v: &[f64; 3]) -> bool {
    v.iter().all(finite)
}

fn direction3(v: &[f64; 3]) -> bool {
    let length = DVec3::from(*v).length();
    length.is_finite() && length > 0.0
}

fn light_rgb(v: &Rgb) -> bool {
    v.0.iter().all(|c| *c >= 0.0 && c.is_finite())
}

fn unit_rgb(v: &Rgb) -> bool {
    v.0.iter().all(|c| (0.0..=1.0).contains(c))
}

const LIGHT: &str = "finite numbers of at least 0";

impl VolumeTable {
    fn validate(&self) -> Check {
        exclude(
            "volume",
            ("file", self.file.is_some()),
            ("phantom", self.phantom.is_some()),
            "give either a file or a phantom",
        )?;
        exclude(
            "volume",
            ("phantom", self.phantom.is_some()),
            ("raw", self.raw.is_some()),
            "'raw' belongs to a file; a phantom takes 'size'",
        )?;
        exclude(
            "volume",
            ("file", self.file.is_some()),
            ("size", self.size.is_some()),
            "'size' belongs to a phantom; a raw file's is 'raw.size'",
        )?;
        let size_ok = |s: &[u32; 3]| s.iter().all(|&n| n >= 1);
        check("volume.size", &self.size, size_ok, "three numbers of voxels, each at least 1")?;
        check("volume.noise", &self.noise, non_negative, "a finite amplitude of at least 0")?;
        check("volume.value_offset", &self.value_offset, finite, "a finite number")?;
        if let Some(raw) = &self.raw {
            check("volume.raw.size", &raw.size, size_ok, "three numbers of voxels, each at least 1")?;
            let spacing_ok = |s: &[f64; 3]| s.iter().all(positive);
            check("volume.raw.spacing", &raw.spacing, spacing_ok, "three finite lengths greater than 0")?;
        }
        Ok(())
    }

    /// A layer that names the data hides the data below, but keeps its offset and orientation: a scene made for a
    /// file goes on fitting it wherever the file lies.
    fn lay_over(self, below: Self) -> Self {
        let below = if self.file.is_some() || self.phantom.is_some() {
            Self { value_offset: below.value_offset, up: below.up, ..Self::default() }
        } else {
            below
        };
        let raw = match (self.raw.clone(), below.raw.clone()) {
            (Some(above), Some(under)) => Some(above.over(under)),
            (above, under) => above.or(under),
        };
        Self { raw, ..self.over(below) }
    }
}

impl TransferTable {
    /// `prefix` is "transfer." in a scene file and empty in a transfer function file.
    fn validate(&self, prefix: &str) -> Check {
        let field = |name: &str| format!("{prefix}{name}");
        if self.file.is_some() && self.points.is_some() {
            let cure = "give either a file or points";
            return Err(FieldError::new(field("points"), "is given beside 'file'", cure));
        }
        check(&field("unit_distance"), &self.unit_distance, positive, "a finite distance greater than 0")?;
        check(&field("window"), &self.window, positive, "a finite width greater than 0")?;
        check(&field("level"), &self.level, finite, "a finite number")?;
        let extinction = self.convention == Some(OpacityConvention::Extinction);
        let points = self.points.as_deref().unwrap_or_default();
        if self.points.is_some() && points.is_empty() {
            return Err(FieldError::new(field("points"), "is empty", "give at least one point"));
        }
        for (i, p) in points.iter().enumerate() {
            let field = |name: &str| format!("{prefix}points.{i}.{name}");
            // The GPU gets values as f32.
            let value_ok = |v: &f64| (*v as f32).is_finite();
            check(&field("value"), &Some(p.value), value_ok, "a finite number")?;
            check(&field("color"), &Some(p.color), unit_rgb, "an albedo: numbers from 0 to 1")?;
            if extinction {
                check(&field("opacity"), &Some(p.opacity), non_negative, "a finite extinction of at least 0")?;
            } else {
                check(&field("opacity"), &Some(p.opacity), |o| (0.0..=1.0).contains(o), "an opacity from 0 to 1")?;
            }
            check(&field("emission"), &p.emission, light_rgb, LIGHT)?;
            if i > 0 && p.value < points[i - 1].value {
                let problem = format!("is {}, less than the {} before it", p.value, points[i - 1].value);
                return Err(FieldError::new(field("value"), problem, "order the points by value"));
            }
        }
        Ok(())
    }

    /// This table over `below`; a source of points hides everything below.
    pub fn lay_over(self, below: Self) -> Self {
        if self.file.is_some() || self.points.is_some() { self } else { self.over(below) }
    }

    /// Reads a transfer function file: TOML with this table's fields, or a ParaView colour map in JSON.
    pub fn load(path: &Path) -> Result<Self> {
        let text = read_text(path, "a transfer function file")?;
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
            let table = super::paraview::parse(&text).map_err(|problem| {
                Error::file(path, problem, "export the colour map with its opacities from ParaView")
            })?;
            table.validate("").map_err(|e| Error::file(path, format!("{} {}", e.field, e.problem), e.cure))?;
            return Ok(table);
        }
        let table: Self = from_toml(&text, path)?;
        table.validate("").map_err(|e| located(e, &text, path))?;
        if table.points.is_none() {
            return Err(Error::file(
                path,
                "has no 'points'",
                "give at least one point: points = [{ value = ..., ... }]",
            ));
        }
        Ok(table)
    }
}

impl LightTable {
    fn validate(&self, index: usize) -> Check {
        let table = format!("light.{index}");
        let field = |name: &str| format!("{table}.{name}");
        check(&field("azimuth"), &self.azimuth, finite, "a finite angle in degrees")?;
        check(&field("elevation"), &self.elevation, |e| (-90.0..=90.0).contains(e), "degrees from -90 to 90")?;
        check(&field("direction"), &self.direction, direction3, "a finite vector that is not 0")?;
        check(&field("position"), &self.position, finite3, "three finite numbers")?;
        check(&field("relative_position"), &self.relative_position, finite3, "three finite numbers")?;
        check(&field("irradiance"), &self.irradiance, light_rgb, LIGHT)?;
        check(&field("intensity"), &self.intensity, light_rgb, LIGHT)?;
        check(&field("strength"), &self.strength, non_negative, "a finite number of at least 0")?;
        let angles = self.azimuth.is_some() || self.elevation.is_some();
        let places = [angles, self.direction.is_some(), self.position.is_some(), self.relative_position.is_some()];
        if places.iter().filter(|&&p| p).count() != 1 {
            let cure = "give exactly one of azimuth + elevation, direction, position, relative_position";
            return Err(FieldError::new(table, "must say where the light is in one way", cure));
        }
        let point = self.position.is_some() || self.relative_position.is_some();
        match (&self.irradiance, &self.intensity) {
            (None, Some(_)) if !point => {
                let cure = "give its 'irradiance'; only point lights have an 'intensity'";
                Err(FieldError::new(field("intensity"), "is given for a directional light", cure))
            }
            (None, None) => Err(FieldError::new(table, "has no 'irradiance'", "give it, e.g. irradiance = 6")),
            (Some(_), Some(_)) => exclude(&table, ("irradiance", true), ("intensity", true), "give one of them"),
            _ => Ok(()),
        }
    }
}

impl EnvironmentTable {
    fn validate(&self) -> Check {
        exclude(
            "environment",
            ("radiance", self.radiance.is_some()),
            ("file", self.file.is_some()),
            "give either a constant radiance or a file",
        )?;
        check("environment.radiance", &self.radiance, light_rgb, LIGHT)?;
        check("environment.strength", &self.strength, non_negative, "a finite number of at least 0")?;
        check("environment.rotation", &self.rotation, finite, "a finite angle in degrees")
    }

    /// Whether this layer says what the environment is.
    pub fn has_source(&self) -> bool {
        self.radiance.is_some() || self.file.is_some()
    }
}

impl CameraTable {
    fn is_automatic(&self) -> bool {
        self.azimuth.is_some() || self.elevation.is_some() || self.roll.is_some() || self.zoom.is_some()
    }

    fn is_placed(&self) -> bool {
        self.position.is_some() || self.look_at.is_some() || self.up.is_some()
    }

    fn validate(&self) -> Check {
        check("camera.azimuth", &self.azimuth, finite, "a finite angle in degrees")?;
        check("camera.elevation", &self.elevation, |e| (-90.0..=90.0).contains(e), "degrees from -90 to 90")?;
        check("camera.roll", &self.roll, finite, "a finite angle in degrees")?;
        check("camera.zoom", &self.zoom, |z| (1e-3..=1e3).contains(&z.0), "a magnification from 0.001 to 1000")?;
        check("camera.position", &self.position, finite3, "three finite numbers")?;
        check("camera.look_at", &self.look_at, finite3, "three finite numbers")?;
        check("camera.up", &self.up, direction3, "a finite vector that is not 0")?;
        check("camera.fov", &self.fov, |f| (0.1..=179.0).contains(f), "degrees from 0.1 to 179")?;
        let cure = "give either angles for automatic framing, or a position";
        exclude(
            "camera",
            ("azimuth, elevation, roll or zoom", self.is_automatic()),
            ("position", self.is_placed()),
            cure,
        )
    }

    fn lay_over(self, below: Self) -> Self {
        let mut below = below;
        if self.is_automatic() {
            (below.position, below.look_at, below.up) = (None, None, None);
        }
        if self.is_placed() {
            (below.azimuth, below.elevation, below.roll, below.zoom) = (None, None, None, None);
        }
        self.over(below)
    }
}

impl TurntableTable {
    fn validate(&self) -> Check {
        let frames = |n: &u32| (1..=MAX_FRAMES).contains(n);
        check("turntable.frames", &self.frames, frames, &format!("a number from 1 to {MAX_FRAMES}"))?;
        check("turntable.degrees", &self.degrees, finite, "a finite angle in degrees")
    }

    /// How far the camera has gone in each frame, degrees; nothing without frames.
    pub fn turns(&self) -> Vec<f64> {
        let (frames, degrees) = (self.frames.unwrap_or(0), self.degrees.unwrap_or(360.0));
        (0..frames).map(|i| degrees * f64::from(i) / f64::from(frames)).collect()
    }
}

impl AnimationTable {
    /// The keys.
    pub fn keys(&self) -> &[KeyTable] {
        self.key.as_deref().unwrap_or_default()
    }

    fn validate(&self) -> Check {
        let frames = |n: &u32| (1..=MAX_FRAMES).contains(n);
        check("animation.frames", &self.frames, frames, &format!("a number from 1 to {MAX_FRAMES}"))?;
        let keys = self.keys();
        for (i, key) in keys.iter().enumerate() {
            let path = format!("animation.key.{i}");
            let frame = |f: &f64| (0.0..f64::from(MAX_FRAMES)).contains(f);
            let expected = format!("a frame from 0, less than {MAX_FRAMES}");
            check(&format!("{path}.frame"), &Some(key.frame), frame, &expected)?;
            if i > 0 && key.frame <= keys[i - 1].frame {
                let problem = format!("is {}, not after the {} of the key before it", key.frame, keys[i - 1].frame);
                return Err(FieldError::new(format!("{path}.frame"), problem, "order the keys by frame"));
            }
            let below = |e: FieldError| FieldError { field: format!("{path}.{}", e.field), ..e };
            key.camera.validate().map_err(below)?;
            key.transfer.validate("transfer.").map_err(below)?;
            key.medium.validate().map_err(below)?;
            key.environment.validate().map_err(below)?;
            key.output.validate().map_err(below)?;
            for (l, light) in key.light.iter().flatten().enumerate() {
                light.validate(l).map_err(below)?;
            }
            self.check_length(i, "light", |key| Some(key.light.as_ref()?.len()))?;
            self.check_length(i, "transfer.points", |key| Some(key.transfer.points.as_ref()?.len()))?;
        }
        // What other keys give goes on beside what this one gives.
        for (i, key) in keys.iter().enumerate() {
            let together = layer_at(keys, key.frame);
            let below = |e: FieldError| FieldError {
                field: format!("animation.key.{i}.{}", e.field),
                problem: format!("{} (with what other keys give)", e.problem),
                cure: format!("{}, the same in all keys", e.cure),
            };
            together.camera.validate().map_err(below)?;
            for (l, light) in together.light.iter().flatten().enumerate() {
                light.validate(l).map_err(below)?;
            }
        }
        Ok(())
    }

    /// Refuses a list in key `i` that has another length than the last one before it.
    fn check_length(&self, i: usize, field: &str, length: impl Fn(&KeyTable) -> Option<usize>) -> Check {
        let keys = self.keys();
        let before = keys[..i].iter().rev().find_map(&length);
        match (length(&keys[i]), before) {
            (Some(here), Some(before)) if here != before => {
                let problem = format!("has {here} entries, an earlier key {before}");
                let cure = "give as many in every key, so that each has a way to go";
                Err(FieldError::new(format!("animation.key.{i}.{field}"), problem, cure))
            }
            _ => Ok(()),
        }
    }
}

impl MediumTable {
    fn validate(&self) -> Check {
        check("medium.g", &self.g, |&g| g > -1.0 && g < 1.0, "a number between -1 and 1, both excluded")?;
        // f32 is what the GPU gets, and 0.99999999 would be 1 there.
        check("medium.g", &self.g.map(|g| g as f32), |g| g.abs() < 1.0, "a number further from -1 and 1")?;
        check("medium.albedo", &self.albedo, unit_rgb, "numbers from 0 to 1")?;
        check("medium.density", &self.density, non_negative, "a finite number of at least 0")?;
        check("medium.emission", &self.emission, non_negative, "a finite number of at least 0")
    }
}

impl OutputTable {
    fn validate(&self) -> Check {
        let exposure_ok = |e: &ExposureValue| !matches!(e.0, Exposure::Stops(s) if !(-100.0..=100.0).contains(&s));
        check("output.exposure", &self.exposure, exposure_ok, "auto, or stops from -100 to 100")
    }
}

impl RenderTable {
    fn validate(&self) -> Check {
        let up_to_1024 = |n: &u32| (1..=1024).contains(n);
        let step = |s: &f64| (0.1..=8.0).contains(s);
        check("render.candidates", &self.candidates, up_to_1024, "a number from 1 to 1024")?;
        check("render.directions", &self.directions, up_to_1024, "a number from 1 to 1024")?;
        check("render.environment_directions", &self.environment_directions, up_to_1024, "a number from 1 to 1024")?;
        check("render.orders", &self.orders, |k| k.0 >= 1, "a number of at least 1, or \"unlimited\"")?;
        check("render.max_events", &self.max_events, |&n| n >= 1, "a number of at least 1")?;
        check("render.camera_step", &self.camera_step, step, "a step from 0.1 to 8 voxels")?;
        check("render.gather_step", &self.gather_step, step, "a step from 0.1 to 8 voxels")?;
        check("render.proxy_step", &self.proxy_step, step, "a step from 0.1 to 8 voxels")?;
        let is_edge = |n: &u32| (1..=MAX_LIGHT_EDGE).contains(n);
        check("render.light_grid", &self.light_grid, is_edge, "a number of voxels from 1 to 4")?;
        let steps = |n: &u32| (1..=64).contains(n);
        check("render.projection_steps", &self.projection_steps, steps, "a number from 1 to 64")?;
        let is_share = |&s: &f64| s > 0.0 && s <= 1.0;
        for (field, share) in [
            ("render.hidden_share", &self.hidden_share),
            ("render.inner_share", &self.inner_share),
            ("render.defence", &self.defence),
        ] {
            check(field, share, is_share, "a share greater than 0, at most 1")?;
        }
        let pixels = |s: &[u32; 2]| s.iter().all(|n| (1..=16384).contains(n));
        check("render.size", &self.size, pixels, "a width and a height from 1 to 16384 pixels")?;
        check("render.spp", &self.spp, |n| (1..=MAX_SPP).contains(n), &format!("a number from 1 to {MAX_SPP}"))?;
        check("render.seconds", &self.seconds, positive, "a time greater than 0")?;
        check("render.target_error", &self.target_error, positive, "an error greater than 0")
    }
}

impl SceneFile {
    /// Parses and checks scene text. `path` names it in errors, and relative paths in it start at its folder.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let mut scene: Self = from_toml(text, path)?;
        scene.validate().map_err(|e| located(e, text, path))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let keys = scene.animation.key.iter_mut().flatten();
        let of_keys = keys.flat_map(|key| [&mut key.transfer.file, &mut key.environment.file]);
        let own = [&mut scene.volume.file, &mut scene.transfer.file, &mut scene.environment.file];
        for file in own.into_iter().chain(of_keys) {
            *file = file.take().map(|f| folder.join(f));
        }
        Ok(scene)
    }

    /// Reads and checks a scene file.
    pub fn load(path: &Path) -> Result<Self> {
        Self::parse(&read_text(path, "a scene file in TOML (give a volume with --volume)")?, path)
    }

    /// Checks every value for itself; what fits together is known only when all layers are.
    pub fn validate(&self) -> Check {
        let names: Vec<_> = super::presets::names().collect();
        let known = |name: &String| names.contains(&name.as_str());
        check("preset", &self.preset, known, &format!("one of {}", names.join(", ")))?;
        self.volume.validate()?;
        self.transfer.validate("transfer.")?;
        self.medium.validate()?;
        for (i, light) in self.light.iter().flatten().enumerate() {
            light.validate(i)?;
        }
        self.environment.validate()?;
        self.camera.validate()?;
        self.turntable.validate()?;
        self.animation.validate()?;
        self.render.validate()?;
        self.output.validate()?;
        let color = self.background.and_then(|b| match b.0 {
            super::Background::Color(c) => Some(Rgb(c.to_array())),
            _ => None,
        });
        check("background", &color, light_rgb, LIGHT)
    }

    /// This layer over `below`.
    pub fn over(self, below: Self) -> Self {
        Self {
            preset: self.preset.or(below.preset),
            background: self.background.or(below.background),
            volume: self.volume.lay_over(below.volume),
            transfer: self.transfer.lay_over(below.transfer),
            medium: self.medium.over(below.medium),
            light: self.light.or(below.light),
            environment: if self.environment.has_source() {
                self.environment
            } else {
                self.environment.over(below.environment)
            },
            camera: self.camera.lay_over(below.camera),
            turntable: self.turntable.over(below.turntable),
            animation: self.animation.over(below.animation),
            render: self.render.over(below.render),
            output: self.output.over(below.output),
        }
    }
}

fn from_toml<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T> {
    parse_toml(text, path, "correct this line; scenes/README.md lists every field")
}

/// A field's error with the file and line where the field stands.
fn located(error: FieldError, text: &str, path: &Path) -> Error {
    let line = toml::de::DeTable::parse(text).ok().and_then(|document| {
        let mut names = error.field.split('.');
        let mut at = document.get_ref().get(names.next()?)?;
        for name in names {
            // Fields that are missing, or that stand for several, are reported at their table.
            let inner = match name.parse::<usize>() {
                Ok(index) => at.get_ref().get(index),
                Err(_) => at.get_ref().get(name),
            };
            match inner {
                Some(found) => at = found,
                None => break,
            }
        }
        Some(line_of(text, at.span().start).0)
    });
    let line = line.map_or(String::new(), |n| format!(":{n}"));
    Error::input(format!("{}{line}: field '{}'", path.display(), error.field), error.problem, error.cure)
}
