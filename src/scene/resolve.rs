//! From layers to a scene: files are read, automatic values chosen, and what must fit together is checked.

use super::camera::{self, Framing};
use super::file::{CameraTable, RenderTable, TransferTable, ValueScale, VolumeTable};
use super::file::{EnvironmentTable, LightTable, MAX_SPP, OpacityConvention, OutputTable, RawEndian, SceneFile};
use super::values::Rgb;
use super::{Background, Camera, Environment, Exposure, LatLong, Light, LightFor, Model, OpacityUnit, Scene, Settings};
use super::{ToneCurve, TransferFunction, TransferPoint, UNLIMITED, presets};
use crate::volume::{self, Grid, RawLayout, Volume};
use crate::{Error, Result};
use glam::{DAffine3, DVec3, Vec3};
use std::path::Path;
use std::sync::Arc;

/// What is rendered when nothing is named.
const DEFAULT_SCENE: &str = include_str!("../../scenes/default.toml");

/// Seed of `[volume] noise`: part of the volume, so the same whatever the picture's seed.
const NOISE_SEED: u32 = 0;

/// The layer of a scene file; without one and without a volume the built-in default scene.
pub(super) fn file_layer(scene_file: Option<&Path>, command_line: &SceneFile) -> Result<SceneFile> {
    let is_named = command_line.volume.file.is_some() || command_line.volume.phantom.is_some();
    match scene_file {
        Some(path) => SceneFile::load(path),
        None if is_named => Ok(SceneFile::default()),
        None => SceneFile::parse(DEFAULT_SCENE, Path::new("default.toml")),
    }
}

/// Lays `command_line` over `file`, each over the preset that it names, and checks the result. A scene that names none
/// gets the phantom's own preset. At the bottom lies `ramp`, whose lights and background come in only if nothing above
/// gives lights or an environment.
pub fn merge(command_line: SceneFile, file: SceneFile) -> Result<SceneFile> {
    let with_preset = |layer: SceneFile| match layer.preset.as_deref().and_then(presets::find) {
        Some(preset) => layer.over(preset),
        None => layer,
    };
    let mut layers = with_preset(command_line).over(with_preset(file));
    if layers.preset.is_none() {
        let own = layers.volume.phantom.as_ref().map(|name| format!("phantom-{name}"));
        layers.preset = own.filter(|name| presets::names().any(|n| n == name));
        layers = with_preset(layers);
    }
    let mut ramp = presets::find("ramp").expect("there is a preset 'ramp'");
    if layers.light.is_some() || layers.environment.has_source() {
        (ramp.light, ramp.environment, ramp.background) = (None, EnvironmentTable::default(), None);
    }
    let layers = layers.over(ramp);
    layers.validate().map_err(|e| Error::input(format!("scene: field '{}'", e.field), e.problem, e.cure))?;
    Ok(layers)
}

/// The volume that a `[volume]` table describes, in world axes with z up and its values' offset applied.
pub(super) fn load_volume(table: &VolumeTable, scene_file: Option<&Path>) -> Result<Volume> {
    let mut volume = match (&table.file, &table.phantom) {
        (Some(path), _) => {
            if !path.exists() {
                let cure = "give the volume's place with --volume FILE, or in the scene as [volume] file = \"...\"";
                return Err(Error::file(path, "there is no such volume", cure));
            }
            volume::load(path, raw_layout(table)?.as_ref())?
        }
        (None, Some(name)) => volume::phantom::generate(name, table.size)?,
        (None, None) => {
            let what = scene_file.map_or("scene".into(), |p| p.display().to_string());
            let cure = "give --volume FILE, or in the scene [volume] with a file or a phantom";
            return Err(Error::input(what, "names no volume", cure));
        }
    };
    if let Some(amplitude) = table.noise {
        volume::phantom::add_noise(&mut volume, amplitude, NOISE_SEED);
    }
    volume.intercept += table.value_offset.unwrap_or(0.0);
    if let Some(up) = table.up {
        let grid = &mut volume.grid;
        grid.index_to_world = DAffine3::from_mat3(up.to_z()) * grid.index_to_world;
    }
    Ok(volume)
}

/// The layout of a raw file as far as the table tells; `None` without a table.
pub(super) fn raw_layout(table: &VolumeTable) -> Result<Option<RawLayout>> {
    let Some(raw) = &table.raw else { return Ok(None) };
    let missing = |field: &str, flag: &str, example: &str| {
        let cure = format!("give {flag} {example}, or {field} in the scene's [volume] raw");
        Error::input("raw volume", format!("its '{field}' is not known"), cure)
    };
    Ok(Some(RawLayout {
        dims: raw.size.ok_or_else(|| missing("size", "--raw-size", "256x256x128"))?,
        scalar: raw.r#type.ok_or_else(|| missing("type", "--raw-type", "u16"))?,
        big_endian: raw.endian == Some(RawEndian::Big),
        spacing: raw.spacing.unwrap_or([1.0; 3]),
        origin: [0.0; 3],
        skip: raw.skip.unwrap_or(0),
    }))
}

/// The scene that layers from [`merge`] describe, for a volume that is already loaded; key frames are left out.
pub fn resolve(layers: SceneFile, volume: impl Into<Arc<Volume>>) -> Result<Scene> {
    let volume = volume.into();
    let turns = layers.turntable.turns();
    let settings = settings(&layers.render, volume.grid.dims, turns.len())?;
    let camera = camera(&layers.camera, &volume.grid, settings.size, &turns)?;
    let centre = camera::centre(&volume.grid);
    let views: Vec<_> = turns.iter().map(|&turn| camera.turned(centre, turn)).collect();
    let transfer = transfer_function(layers.transfer, &volume)?;
    let density_scale = layers.medium.density.unwrap_or(1.0);
    let mean_spacing = volume.grid.mean_spacing();
    let most = f64::from(transfer.max_extinction(mean_spacing)) * density_scale;
    if !(most as f32).is_finite() {
        let cure = "raise transfer.unit_distance, or lower the extinctions or medium.density (--density)";
        return Err(Error::input("scene: extinction", format!("the greatest is {most} per unit"), cure));
    }
    let lights = layers.light.iter().flatten().enumerate();
    let lights = lights.map(|(i, table)| light(table, i, &volume.grid)).collect::<Result<_>>()?;
    let (exposure, tone) = display(&layers.output);
    Ok(Scene {
        transfer,
        g: layers.medium.g.unwrap_or(0.0) as f32,
        albedo_scale: layers.medium.albedo.unwrap_or(Rgb([1.0; 3])).into(),
        density_scale,
        emission_scale: layers.medium.emission.unwrap_or(1.0) as f32,
        lights,
        environment: environment(&layers.environment)?,
        camera: views.first().copied().unwrap_or(camera),
        views,
        background: layers.background.map_or(Background::Environment, |b| b.0),
        settings,
        exposure,
        tone,
        volume,
        path: None,
    })
}

/// How radiance becomes a PNG.
pub(super) fn display(table: &OutputTable) -> (Exposure, ToneCurve) {
    (table.exposure.map_or(Exposure::Auto, |e| e.0), table.tone.unwrap_or(ToneCurve::Filmic))
}

/// Camera rays per pixel where none are asked for: so many per voxel if pixels are wider than voxels, to a limit.
fn usual_spp(dims: [u32; 3], size: [u32; 2], per_voxel: u32) -> u32 {
    const MOST: f64 = 128.0;
    let longest = f64::from(dims.into_iter().max().expect("three axes"));
    let voxels_per_pixel = longest * longest / (f64::from(size[0]) * f64::from(size[1]));
    (f64::from(per_voxel) * voxels_per_pixel.max(1.0)).round().min(MOST.max(per_voxel.into())) as u32
}

fn settings(table: &RenderTable, dims: [u32; 3], views: usize) -> Result<Settings> {
    let default = table.quality.unwrap_or_default().settings();
    let size = table.size.unwrap_or(default.size);
    let usual_spp = match table.model {
        Some(Model::Path) => default.spp,
        _ => usual_spp(dims, size, default.spp),
    };
    let step = |given: Option<f64>, default: f32| given.map_or(default, |s| s as f32);
    let stops_itself = table.seconds.is_some() || table.target_error.is_some();
    let settings = Settings {
        model: table.model.unwrap_or(default.model),
        sampling: table.sampling.unwrap_or(default.sampling),
        candidates: table.candidates.unwrap_or(default.candidates),
        directions: table.directions.unwrap_or(default.directions),
        inner_share: step(table.inner_share, default.inner_share),
        orders: table.orders.map_or(default.orders, |k| k.0),
        max_events: table.max_events.unwrap_or(default.max_events),
        environment_directions: table.environment_directions.unwrap_or(default.environment_directions),
        camera_step: step(table.camera_step, default.camera_step),
        gather_step: step(table.gather_step, default.gather_step),
        proxy_step: step(table.proxy_step, default.proxy_step),
        precision: table.precision.unwrap_or(default.precision),
        light_grid: table.light_grid.unwrap_or(default.light_grid),
        projection_steps: table.projection_steps.unwrap_or(default.projection_steps),
        hidden_share: step(table.hidden_share, default.hidden_share),
        light_for: table.light_for.unwrap_or(if views > 1 { LightFor::EveryView } else { default.light_for }),
        defence: step(table.defence, default.defence),
        mask: table.mask.unwrap_or(default.mask),
        size,
        spp: table.spp.unwrap_or(if stops_itself { MAX_SPP } else { usual_spp }),
        seconds: table.seconds,
        target_error: table.target_error,
        seed: table.seed.unwrap_or(default.seed),
    };
    let (n, m) = (settings.directions, settings.candidates);
    if settings.sampling.is_choice() && n > m {
        let problem = format!("{n} directions are more than the {m} candidates they are chosen from");
        let cure = format!("raise candidates (--candidates {n}), lower directions, or choose sampling phase");
        return Err(Error::input("scene: field 'render.directions'", problem, cure));
    }
    if settings.model != Model::Path {
        let only_path = |field: &str, problem: &str, cure: &str| {
            Err(Error::input(format!("scene: field 'render.{field}'"), problem, cure))
        };
        if settings.orders == UNLIMITED {
            return only_path("orders", "only the model path takes unlimited orders", "give a number (--orders 16)");
        }
        if settings.spp > 65536 {
            return only_path("spp", "only the model path takes more than 65536 rays per pixel", "give fewer");
        }
        if stops_itself {
            let field = if settings.seconds.is_some() { "seconds" } else { "target_error" };
            return only_path(
                field,
                "only the model path stops by itself",
                "leave it out, or render with --model path",
            );
        }
    }
    Ok(settings)
}

fn transfer_function(mut table: TransferTable, volume: &Volume) -> Result<TransferFunction> {
    if let Some(path) = table.file.take() {
        // The scene's window and level go over the file's.
        table = table.over(TransferTable::load(&path)?);
    }
    let points = table.points.unwrap_or_default();
    let points = points.iter().map(|p| TransferPoint {
        value: p.value,
        color: p.color.0,
        opacity: p.opacity as f32,
        emission: p.emission.unwrap_or(Rgb([0.0; 3])).0,
    });
    let opacity_unit = match table.convention {
        Some(OpacityConvention::Extinction) => OpacityUnit::Extinction,
        _ => OpacityUnit::PerDistance(table.unit_distance),
    };
    let mut transfer = TransferFunction { points: points.collect(), opacity_unit };
    if table.scale == Some(ValueScale::Relative) {
        transfer.make_absolute(volume);
    }
    if table.window.is_some() || table.level.is_some() {
        transfer.window_level(table.window, table.level);
    }
    if let Some(p) = transfer.points.iter().find(|p| !(p.value as f32).is_finite()) {
        let problem = format!("a point comes to the value {}", p.value);
        return Err(Error::input("scene: transfer function", problem, "give a smaller window and level"));
    }
    Ok(transfer)
}

fn light(table: &LightTable, index: usize, grid: &Grid) -> Result<Light> {
    let strength = table.strength.unwrap_or(1.0) as f32;
    let irradiance = table.irradiance.map(|e| Vec3::from(e) * strength);
    let (lo, hi) = grid.world_bounds();
    let (centre, half) = (0.5 * (lo + hi), 0.5 * (hi - lo));
    let position = match (table.position, table.relative_position) {
        (Some(position), _) => DVec3::from(position),
        (None, Some(relative)) => centre + DVec3::from(relative) * half,
        (None, None) => {
            let direction = match table.direction {
                Some(direction) => DVec3::from(direction).normalize(),
                None => -camera::towards(table.azimuth.unwrap_or(0.0), table.elevation.unwrap_or(0.0)),
            };
            return Ok(Light::Directional { direction, irradiance: irradiance.unwrap_or(Vec3::ZERO) });
        }
    };
    let intensity = match (irradiance, table.intensity) {
        (Some(irradiance), _) => irradiance * position.distance_squared(centre) as f32,
        (None, intensity) => Vec3::from(intensity.unwrap_or(Rgb([0.0; 3]))) * strength,
    };
    if !intensity.is_finite() || (irradiance.is_some() && position == centre) {
        let problem = "its intensity does not follow from its irradiance at the centre of the volume";
        let cure = "give the point light's 'intensity' instead, or move it";
        return Err(Error::input(format!("scene: field 'light.{index}'"), problem, cure));
    }
    Ok(Light::Point { position, intensity })
}

fn environment(table: &EnvironmentTable) -> Result<Option<Environment>> {
    let strength = table.strength.unwrap_or(1.0) as f32;
    if let Some(path) = &table.file {
        let image = LatLong::load(path, strength, table.rotation.unwrap_or(0.0))?;
        return Ok(Some(Environment::LatLong(image)));
    }
    let radiance = table.radiance.map_or(Vec3::ZERO, |r| Vec3::from(r) * strength);
    if !radiance.is_finite() {
        let problem = format!("radiance times strength is {radiance}");
        return Err(Error::input("scene: field 'environment.strength'", problem, "lower the strength"));
    }
    Ok((radiance != Vec3::ZERO).then_some(Environment::Constant(radiance)))
}

/// The angles of a camera that frames the volume by itself.
pub(super) fn framing(table: &CameraTable) -> Framing {
    let default = Framing::default();
    Framing {
        azimuth: table.azimuth.unwrap_or(default.azimuth),
        elevation: table.elevation.unwrap_or(default.elevation),
        roll: table.roll.unwrap_or(default.roll),
        zoom: table.zoom.map_or(default.zoom, |z| z.0),
        fov: table.fov.unwrap_or(default.fov),
    }
}

/// The camera, or the first of a turntable.
pub(super) fn camera(table: &CameraTable, grid: &Grid, size: [u32; 2], turns: &[f64]) -> Result<Camera> {
    let framing = framing(table);
    if let Some(position) = table.position {
        let (lo, hi) = grid.world_bounds();
        let position = DVec3::from(position);
        let target = table.look_at.map_or(0.5 * (lo + hi), DVec3::from);
        let sight = target - position;
        if !(sight.length() > 0.0 && sight.length().is_finite()) {
            let problem = format!("no line of sight leads from {position} to {target}");
            return Err(Error::input("scene: field 'camera.look_at'", problem, "let it differ from 'position'"));
        }
        return Ok(camera::look_at(position, target, table.up.map_or(DVec3::Z, DVec3::from), framing.fov));
    }
    if table.look_at.is_some() || table.up.is_some() {
        let cure = "give the camera's 'position' too, or frame by azimuth and elevation";
        return Err(Error::input("scene: field 'camera'", "has 'look_at' or 'up' but no 'position'", cure));
    }
    Ok(if turns.is_empty() {
        camera::frame(grid, &framing, size)
    } else {
        camera::frame_turning(grid, &framing, size, turns)
    })
}
