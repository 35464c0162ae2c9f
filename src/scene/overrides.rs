//! The command-line flags that change a scene.

use super::file::{LightTable, RawEndian, RawTable, SceneFile};
use super::values::{BackgroundValue, ExposureValue, Factor, Mask, Orders, Rgb, UpAxis, numbers};
use super::{LightFor, Model, Precision, Quality, Sampling, ToneCurve, presets};
use crate::volume::{RawLayout, ScalarType};
use crate::{Error, Result};
use clap::builder::PossibleValuesParser;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Scene flags. Each one covers the scene file's field of the same meaning.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Overrides {
    /// Volume file (.nrrd .nhdr .mha .mhd .nii .nii.gz, or raw with the --raw flags), or phantom:NAME or phantom:NAME:XxYxZ
    #[arg(long, value_name = "FILE", help_heading = "Volume")]
    pub volume: Option<PathBuf>,
    /// Layout of a raw file.
    #[command(flatten)]
    pub raw: RawFlags,
    /// Added to every value, e.g. -1024 for a CT stored without its offset to Hounsfield units [default: 0]
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true, help_heading = "Volume")]
    pub value_offset: Option<f64>,
    /// Axis of the file's space that points up in the world [default: z]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true, help_heading = "Volume")]
    pub up: Option<UpAxis>,

    /// Transfer function, medium and lights in one [default: ramp, or the phantom's own]
    #[arg(long, value_name = "NAME", help_heading = "Medium")]
    #[arg(value_parser = PossibleValuesParser::new(presets::names()))]
    pub preset: Option<String>,
    /// Transfer function file (.toml, or ParaView's .json)
    #[arg(long, value_name = "FILE", help_heading = "Medium")]
    pub transfer: Option<PathBuf>,
    /// Width of the value range that the transfer function covers, in the volume's unit [default: its own]
    #[arg(long, value_name = "WIDTH", help_heading = "Medium")]
    pub window: Option<f64>,
    /// Centre of that range, in the volume's unit [default: its own]
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true, help_heading = "Medium")]
    pub level: Option<f64>,
    /// Factor on every extinction [default: 1]
    #[arg(long, value_name = "FACTOR", help_heading = "Medium")]
    pub density: Option<f64>,
    /// Henyey-Greenstein mean cosine, between -1 (back) and 1 (forward), both excluded [default: 0]
    #[arg(long, value_name = "G", allow_hyphen_values = true, help_heading = "Medium")]
    pub g: Option<f64>,
    /// Factor on the transfer function's colour that gives the albedo: one number or r,g,b, 0 to 1 [default: 1]
    #[arg(long, value_name = "RGB", help_heading = "Medium")]
    pub albedo: Option<Rgb>,

    /// Light transport [default: multiple]
    #[arg(long, value_name = "MODEL", help_heading = "Method")]
    pub model: Option<Model>,
    /// Defaults of the flags below, from fast to accurate; flags and scene fields go over them [default: normal]
    #[arg(long, value_name = "QUALITY", help_heading = "Method")]
    pub quality: Option<Quality>,
    /// How the gathered directions are chosen [default: phase]
    #[arg(long, value_name = "MODE", help_heading = "Method")]
    pub sampling: Option<Sampling>,
    /// M: directions per cell that top, resample and residual estimate in the proxy, 1 to 1024 [default: 64]
    #[arg(long, value_name = "M", help_heading = "Method")]
    pub candidates: Option<u32>,
    /// N: traced directions per cell, 1 to 1024, at most M for top and resample; auto: as little noise as phase has with so
    /// many [default: 48]
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub directions: Option<u32>,
    /// Share of the directions that gathers before the last one get, whose noise averages out, greater than 0, at most 1; at least
    /// eight directions, if the last one has as many [default: 0.33]
    #[arg(long, value_name = "SHARE", help_heading = "Method")]
    pub inner_share: Option<f64>,
    /// K: light scattered 1 to K times; 'unlimited' for path only [default: 4]
    #[arg(long, value_name = "K", help_heading = "Method")]
    pub orders: Option<Orders>,
    /// Scatterings after which a path of unlimited orders is cut [default: 100000]
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub max_events: Option<u32>,
    /// Directions in which a cell samples an environment image, or any environment for the model single, 1 to 1024
    /// [default: 64]
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub environment_directions: Option<u32>,
    /// Share of their directions that cells get which the eye does not see, greater than 0, at most 1 [default: 0.25]
    #[arg(long, value_name = "SHARE", help_heading = "Method")]
    pub hidden_share: Option<f64>,
    /// Which eye the light is for; light for every view is computed once for a moving camera, and less exact for g ≠ 0
    /// [default: view, of a turntable every-view]
    #[arg(long, value_name = "EYE", help_heading = "Method")]
    pub light_for: Option<LightFor>,
    /// Distance between samples of camera rays in voxels, 0.1 to 8 [default: 0.5]
    #[arg(long, value_name = "VOXELS", help_heading = "Method")]
    pub camera_step: Option<f64>,
    /// Distance between samples of gather and shadow rays in voxels, 0.1 to 8 [default: 1]
    #[arg(long, value_name = "VOXELS", help_heading = "Method")]
    pub gather_step: Option<f64>,
    /// Step of proxy rays in voxels, 0.1 to 8 [default: 2]
    #[arg(long, value_name = "VOXELS", help_heading = "Method")]
    pub proxy_step: Option<f64>,
    /// Floats that light and extinction are stored as [default: half]
    #[arg(long, value_name = "FLOATS", help_heading = "Method")]
    pub precision: Option<Precision>,
    /// Light is computed and solved for in blocks of so many voxels along their edges, 1 to 4; rays and extinction keep all
    /// detail [default: 1]
    #[arg(long, value_name = "VOXELS", help_heading = "Method")]
    pub light_grid: Option<u32>,
    /// Steps of the solution for the light that is stored per voxel, 1 to 64: more are sharper and noisier [default: 6]
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub projection_steps: Option<u32>,
    /// Share of resample's draw that ignores the proxy, greater than 0, at most 1 [default: 0.5]
    #[arg(long, value_name = "SHARE", help_heading = "Method")]
    pub defence: Option<f64>,
    /// Bits per channel that the proxy keeps: 0 to 8 or eight binary digits, once or as r,g,b,a; or adaptive:TOLERANCE, as few
    /// levels as keep the light's root mean square error to that share of its mean, 0 to 1 (0.5 for just adaptive)
    /// [default: 11110000]
    #[arg(long, value_name = "MASK", help_heading = "Method")]
    pub mask: Option<Mask>,
    /// Camera rays per pixel, 1 to 65536, of themselves up to 128 where pixels are wider than voxels; path: to 16777216, which
    /// is its default with --seconds or --target-error [default: 48]
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub spp: Option<u32>,
    /// Path: stop after this time
    #[arg(long, value_name = "SECONDS", help_heading = "Method")]
    pub seconds: Option<f64>,
    /// Path: stop when the pixels' standard error (root mean square, over the mean radiance) is at most this
    #[arg(long, value_name = "ERROR", help_heading = "Method")]
    pub target_error: Option<f64>,
    /// Random seed [default: 0]
    #[arg(long, value_name = "SEED", help_heading = "Method")]
    pub seed: Option<u64>,

    /// Where the eye is, degrees: 0 = in front (-y), 90 = at +x, the patient's left [default: 0]
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, help_heading = "Camera")]
    pub azimuth: Option<f64>,
    /// Height of the eye above the horizon, degrees from -90 to 90 [default: 0]
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, help_heading = "Camera")]
    pub elevation: Option<f64>,
    /// Magnification about the centre of the picture, 0.001 to 1000 [default: 1]
    #[arg(long, value_name = "FACTOR", help_heading = "Camera")]
    pub zoom: Option<f64>,
    /// Vertical field of view before the zoom, degrees from 0.1 to 179 [default: 30]
    #[arg(long, value_name = "DEGREES", help_heading = "Camera")]
    pub fov: Option<f64>,

    /// Frames of a turn around the volume, of which render takes the first [default: none]
    #[arg(long, value_name = "FRAMES", help_heading = "Camera")]
    pub turntable: Option<u32>,
    /// The whole turn, degrees, counter-clockwise seen from above [default: 360]
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, help_heading = "Camera")]
    pub turntable_degrees: Option<f64>,

    /// Light, may be repeated; replaces the scene's: directional:AZIMUTH,ELEVATION,IRRADIANCE (degrees; where it comes
    /// from), point:X,Y,Z,INTENSITY (world), or none. The last number may be r,g,b
    #[arg(long, value_name = "LIGHT", help_heading = "Lighting")]
    pub light: Vec<LightFlag>,
    /// Latitude-longitude image (.hdr, .exr), or constant radiance: one number, r,g,b or #rrggbb
    #[arg(long, value_name = "FILE|RGB", help_heading = "Lighting")]
    pub environment: Option<String>,

    /// Picture width and height in pixels, 1 to 16384 [default: 512x512]
    #[arg(long, value_name = "WxH", value_parser = pair, help_heading = "Picture")]
    pub size: Option<[u32; 2]>,
    /// What is seen behind: environment, transparent, r,g,b (linear) or #rrggbb [default: the preset's]
    #[arg(long, value_name = "BACKGROUND", help_heading = "Picture")]
    pub background: Option<BackgroundValue>,
    /// Exposure of PNG output: auto, or stops from -100 to 100 [default: auto]
    #[arg(long, value_name = "EV", allow_hyphen_values = true, help_heading = "Picture")]
    pub exposure: Option<ExposureValue>,
    /// Tone curve of PNG output [default: filmic]
    #[arg(long, value_name = "CURVE", help_heading = "Picture")]
    pub tone: Option<ToneCurve>,
}

/// Flags that say how a file without a header is laid out.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RawFlags {
    /// Voxels of a raw file along x, y, z (x fastest)
    #[arg(long, value_name = "XxYxZ", value_parser = triple::<u32>, help_heading = "Volume")]
    pub raw_size: Option<[u32; 3]>,
    /// Scalar type of a raw file
    #[arg(long, value_name = "TYPE", help_heading = "Volume")]
    pub raw_type: Option<ScalarType>,
    /// Byte order of a raw file [default: little]
    #[arg(long, value_name = "ORDER", help_heading = "Volume")]
    pub raw_endian: Option<RawEndian>,
    /// Voxel spacing of a raw file along x, y, z, in world units [default: 1x1x1]
    #[arg(long, value_name = "XxYxZ", value_parser = triple::<f64>, help_heading = "Volume")]
    pub raw_spacing: Option<[f64; 3]>,
    /// Bytes to skip at the start of a raw file [default: 0]
    #[arg(long, value_name = "BYTES", help_heading = "Volume")]
    pub raw_skip: Option<u64>,
}

impl RawFlags {
    fn table(&self) -> Option<RawTable> {
        let raw = RawTable {
            size: self.raw_size,
            r#type: self.raw_type,
            endian: self.raw_endian,
            spacing: self.raw_spacing,
            skip: self.raw_skip,
        };
        (raw != RawTable::default()).then_some(raw)
    }

    /// The layout, if any of the flags is given.
    ///
    /// # Errors
    /// A value out of range, or size or type not given; names the flag.
    pub fn layout(&self) -> Result<Option<RawLayout>> {
        let mut layer = SceneFile::default();
        layer.volume.raw = self.table();
        check(&layer)?;
        super::resolve::raw_layout(&layer.volume)
    }
}

/// One `--light`.
#[derive(Clone, Debug, PartialEq)]
pub enum LightFlag {
    /// No light besides the environment.
    None,
    /// A light.
    Light(LightTable),
}

impl FromStr for LightFlag {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let bad = || {
            let forms = "directional:AZIMUTH,ELEVATION,IRRADIANCE, point:X,Y,Z,INTENSITY or none";
            format!("'{text}' is no light: write {forms}")
        };
        let power = |numbers: &[f64]| match *numbers {
            [grey] => Ok(Some(Rgb([grey as f32; 3]))),
            [r, g, b] => Ok(Some(Rgb([r, g, b].map(|c| c as f32)))),
            _ => Err(bad()),
        };
        if text == "none" {
            return Ok(LightFlag::None);
        }
        let (kind, list) = text.split_once(':').ok_or_else(bad)?;
        let list = numbers::<f64>(list, ',').ok_or_else(bad)?;
        let light = match (kind, &list[..]) {
            ("directional", &[azimuth, elevation, ref rest @ ..]) => LightTable {
                azimuth: Some(azimuth),
                elevation: Some(elevation),
                irradiance: power(rest)?,
                ..LightTable::default()
            },
            ("point", &[x, y, z, ref rest @ ..]) => {
                LightTable { position: Some([x, y, z]), intensity: power(rest)?, ..LightTable::default() }
            }
            _ => return Err(bad()),
        };
        Ok(LightFlag::Light(light))
    }
}

fn triple<T: FromStr>(text: &str) -> std::result::Result<[T; 3], String> {
    let list = numbers::<T>(text, 'x').and_then(|n| <[T; 3]>::try_from(n).ok());
    list.ok_or_else(|| format!("'{text}' is not three numbers: write XxYxZ, e.g. 256x256x128"))
}

fn pair(text: &str) -> std::result::Result<[u32; 2], String> {
    let list = numbers(text, 'x').and_then(|n| <[u32; 2]>::try_from(n).ok());
    list.ok_or_else(|| format!("'{text}' is no size: write WIDTHxHEIGHT in pixels, e.g. 512x512"))
}

/// Name and size of the phantom that `volume` names, the value of `flag`; `None` if that is a file.
///
/// # Errors
/// The size is none.
pub fn phantom_of(volume: &Path, flag: &str) -> Result<Option<(String, Option<[u32; 3]>)>> {
    let Some(phantom) = volume.to_str().and_then(|v| v.strip_prefix("phantom:")) else { return Ok(None) };
    let (name, size) = phantom.split_once(':').map_or((phantom, None), |(name, size)| (name, Some(size)));
    let cure = "write phantom:NAME or phantom:NAME:XxYxZ";
    let size = size.map(triple).transpose().map_err(|problem| Error::usage(flag, problem, cure))?;
    Ok(Some((name.to_owned(), size)))
}

impl Overrides {
    /// The flags as a layer over the scene file.
    ///
    /// # Errors
    /// A value out of range; names the flag.
    pub fn layer(&self) -> Result<SceneFile> {
        let mut layer = SceneFile { preset: self.preset.clone(), background: self.background, ..SceneFile::default() };

        match self.volume.as_deref().map(|volume| phantom_of(volume, "--volume")).transpose()?.flatten() {
            Some((name, size)) => (layer.volume.phantom, layer.volume.size) = (Some(name), size),
            None => layer.volume.file = self.volume.clone(),
        }
        layer.volume.raw = self.raw.table();
        layer.volume.value_offset = self.value_offset;
        layer.volume.up = self.up;

        layer.transfer.file = self.transfer.clone();
        layer.transfer.window = self.window;
        layer.transfer.level = self.level;
        layer.medium.g = self.g;
        layer.medium.albedo = self.albedo;
        layer.medium.density = self.density;

        layer.light = self.lights()?;
        if let Some(environment) = &self.environment {
            match environment.parse() {
                Ok(radiance) => layer.environment.radiance = Some(radiance),
                Err(_) if environment.starts_with('#') => {
                    let cure = "give an image file, one number, r,g,b or #rrggbb";
                    return Err(Error::usage("--environment", format!("'{environment}' is no colour"), cure));
                }
                Err(_) => layer.environment.file = Some(environment.into()),
            }
        }

        layer.camera.azimuth = self.azimuth;
        layer.camera.elevation = self.elevation;
        layer.camera.zoom = self.zoom.map(Factor);
        layer.camera.fov = self.fov;

        layer.turntable.frames = self.turntable;
        layer.turntable.degrees = self.turntable_degrees;

        layer.render.model = self.model;
        layer.render.quality = self.quality;
        layer.render.sampling = self.sampling;
        layer.render.candidates = self.candidates;
        layer.render.directions = self.directions;
        layer.render.orders = self.orders;
        layer.render.max_events = self.max_events;
        layer.render.hidden_share = self.hidden_share;
        layer.render.inner_share = self.inner_share;
        layer.render.light_for = self.light_for;
        layer.render.environment_directions = self.environment_directions;
        layer.render.camera_step = self.camera_step;
        layer.render.gather_step = self.gather_step;
        layer.render.proxy_step = self.proxy_step;
        layer.render.precision = self.precision;
        layer.render.light_grid = self.light_grid;
        layer.render.projection_steps = self.projection_steps;
        layer.render.defence = self.defence;
        layer.render.mask = self.mask;
        layer.render.size = self.size;
        layer.render.spp = self.spp;
        layer.render.seconds = self.seconds;
        layer.render.target_error = self.target_error;
        layer.render.seed = self.seed;
        layer.output.exposure = self.exposure;
        layer.output.tone = self.tone;

        check(&layer)?;
        Ok(layer)
    }

    fn lights(&self) -> Result<Option<Vec<LightTable>>> {
        if self.light.len() > 1 && self.light.contains(&LightFlag::None) {
            return Err(Error::usage("--light", "'none' is given beside lights", "give either none or lights"));
        }
        let lights = self.light.iter().filter_map(|l| match l {
            LightFlag::None => None,
            LightFlag::Light(light) => Some(light.clone()),
        });
        Ok((!self.light.is_empty()).then(|| lights.collect()))
    }
}

/// Checks the ranges of a layer of flags.
fn check(layer: &SceneFile) -> Result<()> {
    layer.validate().map_err(|e| Error::usage(flag_of(&e.field), e.problem, e.cure))
}

/// The flag that sets a field of the scene file.
fn flag_of(field: &str) -> String {
    let name = match field.split('.').collect::<Vec<_>>()[..] {
        ["light", ..] => "light",
        ["volume", "file" | "phantom" | "size"] => "volume",
        ["volume", "raw"] => "raw-size",
        ["volume", "raw", raw] => &format!("raw-{raw}"),
        ["transfer", "file"] => "transfer",
        ["turntable", "frames"] => "turntable",
        ["turntable", "degrees"] => "turntable-degrees",
        ["environment", ..] => "environment",
        [.., last] => last,
        [] => field,
    };
    format!("--{}", name.replace('_', "-"))
}
