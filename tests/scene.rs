//! The scene layer: files, flags, presets, transfer functions, camera, environment.

use clap::{Parser, ValueEnum};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use tyndall::Result;
use tyndall::scene::camera::{self, Framing};
use tyndall::scene::environment::EnvironmentTable;
use tyndall::scene::file::SceneFile;
use tyndall::scene::transfer::{MAX_OPACITY, data_window};
use tyndall::scene::values::{ADAPTIVE_TOLERANCE, Mask, UpAxis};
use tyndall::scene::{
    Background, Camera, Environment, Exposure, LatLong, Light, LightFor, Model, OpacityUnit, Overrides, Quality,
    Sampling, Scene, Settings, ToneCurve, TransferFunction, TransferPoint, load_scene, merge, presets, resolve,
};
use tyndall::volume::{Grid, Volume, VoxelData, active_fraction, phantom};

#[derive(Parser, Debug)]
struct Flags {
    #[command(flatten)]
    overrides: Overrides,
}

fn flags(args: &[&str]) -> std::result::Result<Overrides, clap::Error> {
    Flags::try_parse_from(std::iter::once(&"tyndall").chain(args)).map(|f| f.overrides)
}

/// A 4×6×8 volume of spacing 1×2×0.5 whose box is (0..4)×(10..22)×(−3..1), values 0..192.
fn small_volume() -> Volume {
    let grid = Grid::axis_aligned([4, 6, 8], [1.0, 2.0, 0.5], [0.5, 11.0, -2.75]);
    let data = VoxelData::F32((0..192).map(|i| i as f32).collect());
    Volume { name: "small".into(), grid, data, slope: 1.0, intercept: 0.0 }
}

fn parse(text: &str) -> Result<SceneFile> {
    SceneFile::parse(text, Path::new("folder/test.toml"))
}

/// The scene of a file's text and flags, over [`small_volume`].
fn scene_of(text: &str, args: &[&str]) -> Result<Scene> {
    let overrides = flags(args).unwrap_or_else(|e| panic!("{e}"));
    resolve(merge(overrides.layer()?, parse(text)?)?, small_volume())
}

#[track_caller]
fn assert_error<T: std::fmt::Debug>(result: Result<T>, exit_code: u8, parts: &[&str]) {
    let error = result.expect_err("an error is due");
    let text = error.to_string();
    for part in parts.iter().chain(&["cure: "]) {
        assert!(text.contains(part), "'{part}' is missing in: {text}");
    }
    assert_eq!(error.exit_code(), exit_code, "{text}");
}

/// The same cases in every run.
fn fixed() -> ProptestConfig {
    let rng_seed = proptest::test_runner::RngSeed::Fixed(1);
    ProptestConfig { rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

// ---- scene files -------------------------------------------------------------------------------------------------

const EVERYTHING: &str = r##"
preset = "ct-bone"
background = "#ff0000"
[volume]
file = "data/x.raw"
raw = { size = [2, 3, 4], type = "i16", endian = "big", spacing = [1, 1, 2.5], skip = 100 }
value_offset = -1024
up = "-y"
[transfer]
points = [
    { value = -100, color = [0.1, 0.2, 0.3], opacity = 0 },
    { value = 300, color = 0.5, opacity = 1, emission = [1, 2, 3] },
]
unit_distance = 2
window = 100
level = 50
[medium]
g = -0.25
albedo = [1, 0.5, 0]
density = 3
emission = 4
[[light]]
direction = [0, 0, -2]
irradiance = 2
strength = 3
[[light]]
relative_position = [0, 0, 3]
irradiance = [1, 2, 3]
[[light]]
position = [7, 8, 9]
intensity = 5
[environment]
radiance = [0.5, 1, 2]
strength = 2
[camera]
position = [2, 0, 0]
look_at = [2, 5, 0]
up = [1, 0, 0]
fov = 50
[render]
model = "single"
sampling = "top"
candidates = 64
directions = 7
orders = 9
inner_share = 0.75
environment_directions = 33
camera_step = 0.25
gather_step = 0.75
proxy_step = 3
defence = 1
mask = [8, "11000000", 0, 3]
size = [640, 480]
spp = 2
seed = 12345678901
[output]
exposure = -1.5
tone = "linear"
"##;

#[test]
fn every_field_of_the_file_arrives() {
    let file = parse(EVERYTHING).unwrap();
    assert_eq!(file.volume.file, Some(PathBuf::from("folder/data/x.raw")), "relative to the scene file");
    let raw = file.volume.raw.clone().unwrap();
    assert_eq!((raw.size, raw.spacing, raw.skip), (Some([2, 3, 4]), Some([1.0, 1.0, 2.5]), Some(100)));
    assert_eq!((file.volume.value_offset, file.volume.up), (Some(-1024.0), Some(UpAxis::MinusY)));

    let s = scene_of(EVERYTHING, &[]).unwrap();
    assert_eq!(s.background, Background::Color(Vec3::X));
    // −100..300 is moved to 0..100.
    let points = [(0.0, [0.1, 0.2, 0.3], 0.0, [0.0; 3]), (100.0, [0.5; 3], 1.0, [1.0, 2.0, 3.0])];
    let points = points.map(|(value, color, opacity, emission)| TransferPoint { value, color, opacity, emission });
    let opacity_unit = OpacityUnit::PerDistance(Some(2.0));
    assert_eq!(s.transfer, TransferFunction { points: points.to_vec(), opacity_unit });
    assert_eq!((s.g, s.albedo_scale, s.density_scale, s.emission_scale), (-0.25, Vec3::new(1.0, 0.5, 0.0), 3.0, 4.0));
    // The box is 4 × 12 × 4 about (2, 16, −1): 3 half heights above its centre is 6 away, so E = I/36.
    let expected = [
        Light::Directional { direction: -DVec3::Z, irradiance: Vec3::splat(6.0) },
        Light::Point { position: DVec3::new(2.0, 16.0, 5.0), intensity: Vec3::new(36.0, 72.0, 108.0) },
        Light::Point { position: DVec3::new(7.0, 8.0, 9.0), intensity: Vec3::splat(5.0) },
    ];
    assert_eq!(s.lights, expected);
    assert_eq!(s.environment, Some(Environment::Constant(Vec3::new(1.0, 2.0, 4.0))));
    let c = s.camera;
    let axes = (DVec3::new(2.0, 0.0, 0.0), DVec3::Y, DVec3::X, -DVec3::Z, 50.0);
    assert_eq!((c.position, c.forward, c.up, c.right, c.fov_degrees), axes);
    let r = s.settings;
    assert_eq!((r.model, r.sampling, r.candidates, r.directions), (Model::Single, Sampling::Top, 64, 7));
    assert_eq!((r.orders, r.environment_directions, r.camera_step, r.gather_step), (9, 33, 0.25, 0.75));
    assert_eq!(r.inner_share, 0.75);
    assert_eq!((r.proxy_step, r.defence, r.mask), (3.0, 1.0, Mask::Channels([0xFF, 0xC0, 0x00, 0xE0])));
    assert_eq!((r.size, r.spp, r.seed), ([640, 480], 2, 12345678901));
    assert_eq!((s.exposure, s.tone), (Exposure::Stops(-1.5), ToneCurve::Linear));
}

#[test]
fn every_flag_covers_the_file() {
    let args = "--volume a.raw --raw-size 5x6x7 --raw-type u8 --raw-endian little --raw-spacing 1x2x0.5 --raw-skip 9
        --value-offset -3 --up y --preset mr --window 10 --level -20 --density 0.5 --g 0.5 --albedo 0.1,0.2,0.3
        --model absorption --sampling phase --candidates 2 --directions 3 --orders 1 --environment-directions 4
        --camera-step 1 --gather-step 2 --proxy-step 4 --defence 0.5 --mask 8,8,8,2 --spp 1 --seed 7
        --azimuth -90 --elevation -10 --zoom 2 --fov 20 --environment 0.1,0.2,0.3 --size 30x40
        --light directional:90,0,2 --light point:1,2,3,4,5,6
        --background transparent --exposure auto --tone filmic";
    let args: Vec<&str> = args.split_whitespace().collect();
    let layer = flags(&args).unwrap().layer().unwrap();
    assert_eq!(layer.volume.file, Some(PathBuf::from("a.raw")));
    let toml = r#"
        preset = "mr"
        background = "transparent"
        light = [{ azimuth = 90, elevation = 0, irradiance = 2 }, { position = [1, 2, 3], intensity = [4, 5, 6] }]
        [volume]
        raw = { size = [5, 6, 7], type = "u8", endian = "little", spacing = [1, 2, 0.5], skip = 9 }
        value_offset = -3
        up = "y"
        [transfer]
        window = 10
        level = -20
        [medium]
        density = 0.5
        g = 0.5
        albedo = [0.1, 0.2, 0.3]
        [environment]
        radiance = [0.1, 0.2, 0.3]
        [camera]
        azimuth = -90
        elevation = -10
        zoom = 2
        fov = 20
        [render]
        model = "absorption"
        sampling = "phase"
        candidates = 2
        directions = 3
        orders = 1
        environment_directions = 4
        camera_step = 1
        gather_step = 2
        proxy_step = 4
        defence = 0.5
        mask = ["11111111", 8, 8, 2]
        size = [30, 40]
        spp = 1
        seed = 7
        [output]
        exposure = "auto"
        tone = "filmic"
    "#;
    let mut same = parse(toml).unwrap();
    same.volume.file = Some("a.raw".into());
    assert_eq!(layer, same);

    // And they do cover the file, all of it. The preset of the command line lies over the file too.
    let s = scene_of(EVERYTHING, &args).unwrap();
    assert_eq!((s.settings.size, s.settings.sampling, s.settings.defence), ([30, 40], Sampling::Phase, 0.5));
    assert_eq!((s.background, s.exposure, s.tone), (Background::Transparent, Exposure::Auto, ToneCurve::Filmic));
    assert_eq!(s.lights.len(), 2);
    assert_eq!(s.environment, Some(Environment::Constant(Vec3::new(0.1, 0.2, 0.3))), "without the file's strength");
    assert!((s.camera.forward - -camera::towards(-90.0, -10.0)).length() < 1e-12, "angles beat a position");
    assert_eq!(s.transfer.opacity_unit, OpacityUnit::PerDistance(Some(1.0)), "the points are the preset's");
    assert_eq!(s.transfer.points.len(), presets::find("mr").unwrap().transfer.points.unwrap().len());
}

#[test]
fn a_layer_hides_what_it_replaces() {
    let over = |above: &str, below: &str| parse(above).unwrap().over(parse(below).unwrap());
    let t = over("transfer.points = [{ value = 0, color = 1, opacity = 1 }]", "transfer = { window = 3, level = 2 }");
    assert_eq!((t.transfer.window, t.transfer.level), (None, None), "a window belongs to its points");
    let t = over("transfer.window = 5", "transfer = { file = 'x', window = 3, level = 2 }");
    assert_eq!((t.transfer.window, t.transfer.level, t.transfer.file.is_some()), (Some(5.0), Some(2.0), true));
    let v = over("volume.file = 'a.nrrd'", "volume = { file = 'b.raw', raw = { skip = 1 }, value_offset = -1024 }");
    assert_eq!((v.volume.raw, v.volume.value_offset), (None, Some(-1024.0)));
    let v = over("volume.raw = { skip = 1 }", "volume = { file = 'b', raw = { skip = 2, endian = 'big' } }");
    let raw = v.volume.raw.unwrap();
    assert_eq!((raw.skip, raw.endian.is_some()), (Some(1), true));
    let c = over("camera.position = [0, 0, 9]", "camera = { azimuth = 3, zoom = 2, fov = 12 }").camera;
    assert_eq!((c.azimuth, c.zoom, c.fov), (None, None, Some(12.0)));
    let e =
        over("environment.file = 'a.hdr'", "environment = { radiance = 1, strength = 3, rotation = 9 }").environment;
    assert_eq!((e.radiance, e.strength, e.rotation), (None, None, None));
    assert_eq!(over("light = []", "[[light]]\nazimuth = 3\nirradiance = 1").light, Some(vec![]));
}

#[test]
fn lights_of_the_ramp_only_where_there_are_none() {
    assert!(!scene_of("", &[]).unwrap().lights.is_empty());
    assert!(scene_of("", &[]).unwrap().environment.is_some());
    assert!(!scene_of("preset = 'ct-bone'", &[]).unwrap().lights.is_empty());
    let lit = scene_of("environment.radiance = 1", &[]).unwrap();
    assert_eq!((lit.lights, lit.environment), (vec![], Some(Environment::Constant(Vec3::ONE))));
    assert_eq!(lit.background, Background::Environment);
    assert_eq!(scene_of("", &["--light", "none"]).unwrap().environment, None);
    assert_eq!(scene_of("", &["--light", "none"]).unwrap().lights, vec![]);
}

#[test]
fn errors_name_line_field_and_cure() {
    let bad = |text: &str, parts: &[&str]| assert_error(parse(text), 1, parts);
    bad("[render]\n\norders = 'x'", &["folder/test.toml:3", "orders", "'x'", "unlimited"]);
    bad("[render]\norder = 3", &["test.toml:2", "unknown field `order`", "orders"]);
    bad("[rendering]", &["test.toml:1", "unknown field `rendering`", "render"]);
    bad("[render]\norders = ", &["test.toml:2", "orders"]);
    bad("[medium]\nalbedo = 'red'", &["test.toml:2", "'red' is no colour", "#rrggbb"]);
    bad("[medium]\nalbedo = [1, 2]", &["test.toml:2", "expected a number, [r, g, b]"]);
    bad("background = '#12345'", &["test.toml:1", "'#12345' is no background"]);
    bad("[transfer]\npoints = [\n{ value = 0, color = 0.5 }]", &["test.toml:3", "missing field `opacity`"]);
    bad("[transfer]\npoints = [\n{ value = 0, colour = 1, opacity = 0 }]", &["test.toml:3", "unknown field `colour`"]);
    bad("[render]\nmask = 9", &["test.toml:2", "'9' is no mask", "binary digits"]);
    bad("[render]\nmask = \"adaptive:2\"", &["test.toml:2", "'adaptive:2' is no mask", "a tolerance of 0 to 1"]);
    bad("[render]\nmask = [1, 2]", &["test.toml:2", "expected a number of bits"]);
    bad("[output]\nexposure = 'bright'", &["test.toml:2", "'bright' is no exposure", "auto"]);
    bad("[camera]\nup = 'z'", &["test.toml:2", "up"]);
    bad("preset = 'ct-bones'", &["test.toml:1: field 'preset'", "ct-bones", "ct-bone,"]);
}

#[test]
fn values_out_of_range_are_refused() {
    // Table, field, refused values, a part of the cure. Each is refused in the file with its line, and each limit that
    // is given last is accepted.
    type Case = (&'static str, &'static str, &'static [&'static str], &'static str, &'static [&'static str]);
    let cases: &[Case] = &[
        ("volume", "size", &["[1, 0, 1]"], "at least 1", &["[1, 1, 1]"]),
        ("volume", "noise", &["-1", "nan"], "at least 0", &["0", "0.5"]),
        ("volume", "value_offset", &["nan", "inf"], "finite", &["-1e9"]),
        (
            "volume",
            "raw",
            &["{ size = [0, 1, 1] }", "{ spacing = [1, 0, 1] }", "{ spacing = [1, inf, 1] }"],
            "three",
            &[],
        ),
        ("transfer", "unit_distance", &["0", "-1", "nan", "inf"], "greater than 0", &["1e-6"]),
        ("transfer", "window", &["0", "inf"], "greater than 0", &["1e-3"]),
        ("transfer", "level", &["nan"], "finite", &["-600"]),
        ("transfer", "points", &["[]"], "at least one point", &[]),
        ("medium", "g", &["1", "-1", "nan", "0.99999999999"], "number", &["0.999", "-0.999", "0", "1e-6"]),
        ("medium", "albedo", &["1.1", "[0, -0.1, 0]", "nan"], "from 0 to 1", &["0", "1", "'#ffffff'"]),
        ("medium", "density", &["-1", "inf", "1e39"], "at least 0", &["0", "1e6"]),
        ("medium", "emission", &["-1", "nan"], "at least 0", &["0"]),
        ("environment", "radiance", &["-1", "[0, inf, 0]"], "at least 0", &["1e5"]),
        ("environment", "strength", &["-1", "nan"], "at least 0", &["0"]),
        ("environment", "rotation", &["inf"], "finite", &["-720"]),
        ("camera", "azimuth", &["inf"], "finite", &["-400"]),
        ("camera", "elevation", &["91", "-90.1", "nan"], "-90 to 90", &["90", "-90"]),
        ("camera", "roll", &["nan"], "finite", &["180"]),
        ("camera", "zoom", &["0", "-1", "nan", "1e9"], "magnification", &["0.5"]),
        ("camera", "position", &["[0, nan, 0]"], "finite", &["[1e6, 0, 0]"]),
        ("camera", "look_at", &["[0, inf, 0]"], "finite", &[]),
        ("camera", "up", &["[0, 0, 0]", "[nan, 0, 1]"], "not 0", &[]),
        ("camera", "fov", &["0", "180", "nan"], "0.1 to 179", &["1", "170"]),
        ("render", "candidates", &["0", "1025"], "1 to 1024", &["1", "1024"]),
        ("render", "directions", &["0", "1025"], "1 to 1024", &["1", "1024"]),
        ("render", "environment_directions", &["0", "1025"], "1 to 1024", &["1024"]),
        ("render", "orders", &["0"], "at least 1", &["1", "64", "'unlimited'"]),
        ("render", "max_events", &["0"], "at least 1", &["1"]),
        ("render", "seconds", &["0", "nan"], "greater than 0", &["0.5"]),
        ("render", "target_error", &["-1", "inf"], "greater than 0", &["0.01"]),
        ("render", "camera_step", &["0.09", "8.1", "nan"], "0.1 to 8", &["0.1", "8"]),
        ("render", "gather_step", &["0"], "0.1 to 8", &["8"]),
        ("render", "proxy_step", &["inf"], "0.1 to 8", &["8"]),
        ("render", "defence", &["0", "1.1", "nan"], "at most 1", &["1", "0.001"]),
        ("render", "size", &["[0, 1]", "[1, 16385]"], "1 to 16384", &["[1, 1]", "[16384, 1]"]),
        ("render", "hidden_share", &["0", "1.01", "-1"], "greater than 0, at most 1", &["0.01", "1"]),
        ("render", "inner_share", &["0", "1.01", "nan"], "greater than 0, at most 1", &["0.01", "1"]),
        ("render", "spp", &["0", "16777217"], "1 to 16777216", &["16777216"]),
        ("output", "exposure", &["nan", "101"], "-100 to 100", &["-100"]),
    ];
    for (table, field, refused, cure, accepted) in cases {
        for value in *refused {
            let text = format!("# one\n[{table}]\n{field} = {value}");
            let parts = ["folder/test.toml:3: field '", &format!("{table}.{field}"), cure];
            assert_error(parse(&text), 1, &parts);
        }
        for value in *accepted {
            parse(&format!("[{table}]\n{field} = {value}")).unwrap();
        }
    }
    for (point, field) in [
        ("{ value = nan, color = 1, opacity = 0 }", "points.1.value"),
        ("{ value = 1e39, color = 1, opacity = 0 }", "points.1.value"),
        ("{ value = -1, color = 1, opacity = 0 }", "points.1.value' is -1, less than the 0 before it"),
        ("{ value = 1, color = 1.5, opacity = 0 }", "points.1.color"),
        ("{ value = 1, color = 1, opacity = 1.01 }", "points.1.opacity"),
        ("{ value = 1, color = 1, opacity = nan }", "points.1.opacity"),
        ("{ value = 1, color = 1, opacity = 1, emission = -1 }", "points.1.emission"),
    ] {
        let text = format!("[transfer]\npoints = [\n{{ value = 0, color = 1, opacity = 1 }},\n{point},\n]");
        assert_error(parse(&text), 1, &["test.toml:4: field 'transfer.", &field.replace("' is", "': is")]);
    }
    let extinction = |sigma: &str| {
        parse(&format!(
            "transfer = {{ convention = 'extinction', points = [{{ value = 0, color = 1, opacity = {sigma} }}] }}"
        ))
    };
    extinction("1e6").unwrap();
    assert_error(extinction("-1"), 1, &["points.0.opacity", "extinction of at least 0"]);
    assert_error(parse("background = [-1, 0, 0]"), 1, &["field 'background'", "at least 0"]);
}

#[test]
fn contradictions_are_refused() {
    let bad = |text: &str, parts: &[&str]| assert_error(parse(text), 1, parts);
    bad("volume = { file = 'a', phantom = 'skull' }", &["volume.phantom", "beside 'file'"]);
    bad("volume = { phantom = 'skull', raw = { skip = 1 } }", &["volume.raw", "beside 'phantom'"]);
    bad("volume = { file = 'a', size = [1, 1, 1] }", &["volume.size", "raw.size"]);
    bad("transfer = { file = 'a', points = [{ value = 0, color = 0, opacity = 0 }] }", &["transfer.points"]);
    bad("environment = { radiance = 1, file = 'a.hdr' }", &["environment.file", "beside 'radiance'"]);
    bad("camera = { azimuth = 1, position = [0, 0, 0] }", &["camera.position", "beside 'azimuth"]);
    bad("[[light]]\nirradiance = 1", &["test.toml:1", "light.0", "exactly one of"]);
    bad("\n[[light]]\nazimuth = 1\nposition = [0, 0, 0]\nirradiance = 1", &["test.toml:2", "exactly one of"]);
    bad("[[light]]\nazimuth = 1", &["light.0", "irradiance = 6"]);
    bad("[[light]]\nazimuth = 1\nintensity = 1", &["light.0.intensity", "only point lights"]);
    bad("[[light]]\nposition = [0, 0, 0]\nintensity = 1\nirradiance = 1", &["light.0.intensity", "beside"]);
    bad("[[light]]\nazimuth = 1\nirradiance = -1", &["test.toml:3", "light.0.irradiance"]);
    bad("[[light]]\ndirection = [0, 0, 0]\nirradiance = 1", &["light.0.direction", "not 0"]);
}

/// The volume is 4x6x8: so many camera rays per voxel where pixels are wider, if none are asked for.
#[test]
fn wide_pixels_get_more_camera_rays() {
    let spp = |text: &str| scene_of(text, &[]).unwrap().settings.spp;
    assert_eq!(spp("render.size = [8, 8]"), 48);
    assert_eq!(spp("render.size = [800, 600]"), 48);
    assert_eq!(spp("render.size = [8, 4]"), 96);
    assert_eq!(spp("render.size = [1, 1]"), 128);
    assert_eq!(spp("render = { size = [1, 1], spp = 7 }"), 7);
    assert_eq!(spp("render = { size = [1, 1], model = 'path' }"), 48);
}

/// A quality is the lowest layer: what a field or a flag says goes over it, wherever the quality was named.
#[test]
fn quality_is_a_set_of_defaults() {
    let settings = |text: &str, args: &[&str]| scene_of(text, args).unwrap().settings;
    let size = "render.size = [8, 8]\n";
    let of = |quality: Quality| Settings { size: [8, 8], ..quality.settings() };
    assert_eq!(settings(size, &[]), of(Quality::Normal));
    assert_eq!(Quality::Normal.settings(), Settings::default());
    for &quality in Quality::value_variants() {
        let name = quality.to_possible_value().unwrap().get_name().to_owned();
        assert_eq!(settings(size, &["--quality", &name]), of(quality), "{name}");
        assert_eq!(settings(&format!("{size}render.quality = '{name}'"), &[]), of(quality), "{name}");
    }
    let high_over_draft = settings(&format!("{size}render.quality = 'draft'"), &["--quality", "high"]);
    assert_eq!(high_over_draft, of(Quality::High));
    let mixed = settings(&format!("{size}render.spp = 7"), &["--quality", "draft", "--gather-step", "0.75"]);
    assert_eq!(mixed, Settings { spp: 7, gather_step: 0.75, ..of(Quality::Draft) });
    assert_error(parse("render.quality = 'best'"), 1, &["best", "draft", "reference"]);
    assert!(flags(&["--quality", "best"]).unwrap_err().to_string().contains("draft"));
}

/// Each is finer than the one before, in every knob.
#[test]
fn qualities_are_in_order() {
    let all: Vec<Settings> = Quality::value_variants().iter().map(|q| q.settings()).collect();
    for pair in all.windows(2) {
        let counts = |s: &Settings| [s.directions, s.candidates, s.environment_directions, s.spp];
        let steps = |s: &Settings| [s.gather_step, s.camera_step, s.proxy_step, 1.0 - s.hidden_share];
        assert!(counts(&pair[0]).iter().zip(counts(&pair[1])).all(|(a, b)| *a <= b), "{pair:?}");
        assert!(steps(&pair[0]).iter().zip(steps(&pair[1])).all(|(a, b)| *a >= b), "{pair:?}");
        assert!(pair[0].directions < pair[1].directions && pair[0].spp < pair[1].spp, "{pair:?}");
    }
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let bad = |text: &str, parts: &[&str]| assert_error(scene_of(text, &[]), 1, parts);
    let resample = "render = { directions = 65, sampling = 'resample' }";
    bad(resample, &["render.directions", "65", "64 candidates", "--candidates 65"]);
    bad("render = { directions = 65, sampling = 'top' }", &["render.directions"]);
    for mode in ["phase", "residual", "auto"] {
        scene_of(&format!("render = {{ directions = 65, sampling = '{mode}' }}"), &[]).unwrap();
    }
    scene_of("render = { directions = 64, sampling = 'resample' }", &[]).unwrap();
    for (setting, part) in [
        ("orders = 'unlimited'", "only the model path"),
        ("spp = 65537", "65536"),
        ("seconds = 1", "only the model path"),
        ("target_error = 0.1", "only the model path"),
    ] {
        bad(&format!("[render]\n{setting}"), &["render.", part]);
        scene_of(&format!("[render]\nmodel = 'path'\n{setting}"), &[]).unwrap();
    }
    bad("camera.look_at = [0, 0, 0]", &["'camera'", "no 'position'"]);
    bad("camera.position = [2, 16, -1]", &["line of sight", "camera.look_at"]);
    bad("[[light]]\nrelative_position = [0, 0, 0]\nirradiance = 1", &["light.0", "'intensity' instead"]);
    bad("environment = { radiance = 1e38, strength = 1e38 }", &["environment.strength"]);
    bad("transfer.unit_distance = 1e-40", &["extinction", "unit_distance"]);
    let missing = scene_of("transfer.file = 'nowhere.toml'", &[]).unwrap_err().to_string();
    assert!(missing.contains("folder/nowhere.toml: cannot open"), "{missing}");
}

#[test]
fn masks_are_read_as_they_are_written() {
    let usual = Mask::Adaptive(ADAPTIVE_TOLERANCE);
    for (text, mask) in [
        ("5", Mask::Channels([0xF8; 4])),
        ("8,11000000,0,3", Mask::Channels([0xFF, 0xC0, 0x00, 0xE0])),
        ("adaptive", usual),
        ("adaptive:0.02", Mask::Adaptive(0.02)),
        ("adaptive:-0", Mask::Adaptive(0.0)),
    ] {
        assert_eq!(text.parse(), Ok(mask), "{text}");
        assert_eq!(mask.to_string().parse(), Ok(mask), "{mask}");
        assert_eq!(mask.with_word(mask.word()), mask);
        let file = format!("[render]\nmask = \"{text}\"");
        assert_eq!(parse(&file).unwrap().render.mask, Some(mask), "{file}");
        assert_eq!(flags(&["--mask", text]).unwrap().layer().unwrap().render.mask, Some(mask));
    }
    assert_eq!("adaptive:-0".parse::<Mask>().unwrap().word(), 0, "the kernels compare bits");
}

#[test]
fn flags_out_of_range_are_wrong_usage() {
    let bad = |args: &[&str], parts: &[&str]| assert_error(flags(args).unwrap().layer(), 2, parts);
    bad(&["--orders", "0"], &["--orders: is 0", "at least 1"]);
    bad(&["--raw-size", "0x1x1"], &["--raw-size: "]);
    bad(&["--camera-step", "9"], &["--camera-step: is 9"]);
    bad(&["--g", "-1"], &["--g: "]);
    bad(&["--environment", "0,-1,0"], &["--environment: "]);
    bad(&["--environment", "#12"], &["--environment: ", "#rrggbb"]);
    bad(&["--light", "directional:0,91,1"], &["--light: "]);
    bad(&["--light", "none", "--light", "directional:0,0,1"], &["--light: ", "beside"]);
    bad(&["--volume", "phantom:skull:5x5"], &["--volume: ", "XxYxZ"]);
    bad(&["--volume", "phantom:skull:5x0x5"], &["--volume: ", "at least 1"]);
    bad(&["--window", "0"], &["--window: "]);
    bad(&["--size", "0x5"], &["--size: "]);
    for (args, part) in [
        (["--size", "512"], "WIDTHxHEIGHT"),
        (["--raw-size", "1x2"], "XxYxZ"),
        (["--mask", "111"], "binary digits"),
        (["--mask", "adaptive:1.5"], "a tolerance of 0 to 1"),
        (["--mask", "adaptive:"], "a tolerance of 0 to 1"),
        (["--mask", "adaptive0.1"], "a tolerance of 0 to 1"),
        (["--light", "spot:1,2,3"], "directional:AZIMUTH"),
        (["--light", "point:1,2,3"], "point:X,Y,Z,INTENSITY"),
        (["--preset", "nope"], "ct-bone"),
        (["--background", "pink"], "transparent"),
        (["--model", "x"], "absorption"),
        (["--albedo", "1,2"], "r,g,b"),
    ] {
        let text = flags(&args).unwrap_err().to_string();
        assert!(text.contains(part) && text.contains(args[0]), "{text}");
    }
}

#[test]
fn help_states_the_true_defaults() {
    let default = tyndall::scene::Settings::default();
    let framing = Framing::default();
    let mask = default.mask.to_string();
    let name = |v: &dyn Fn() -> Option<clap::builder::PossibleValue>| v().unwrap().get_name().to_owned();
    use clap::ValueEnum;
    let expected = [
        ("model", name(&|| default.model.to_possible_value())),
        ("sampling", name(&|| default.sampling.to_possible_value())),
        ("candidates", default.candidates.to_string()),
        ("directions", default.directions.to_string()),
        ("orders", default.orders.to_string()),
        ("environment-directions", default.environment_directions.to_string()),
        ("inner-share", default.inner_share.to_string()),
        ("hidden-share", default.hidden_share.to_string()),
        ("precision", name(&|| default.precision.to_possible_value())),
        ("light-grid", default.light_grid.to_string()),
        ("projection-steps", default.projection_steps.to_string()),
        ("camera-step", default.camera_step.to_string()),
        ("gather-step", default.gather_step.to_string()),
        ("proxy-step", default.proxy_step.to_string()),
        ("defence", default.defence.to_string()),
        ("mask", mask),
        ("max-events", default.max_events.to_string()),
        ("spp", default.spp.to_string()),
        ("seed", default.seed.to_string()),
        ("size", format!("{}x{}", default.size[0], default.size[1])),
        ("azimuth", framing.azimuth.to_string()),
        ("elevation", framing.elevation.to_string()),
        ("zoom", framing.zoom.to_string()),
        ("fov", framing.fov.to_string()),
    ];
    let command = <Flags as clap::CommandFactory>::command();
    for (flag, value) in expected {
        let arg = command.get_arguments().find(|a| a.get_long() == Some(flag)).expect(flag);
        let help = arg.get_help().unwrap().to_string();
        assert!(help.contains(&format!("[default: {value}]")), "--{flag}: {help} lacks {value}");
    }
}

#[test]
fn files_that_are_no_scenes() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let binary = file("volume.raw", &[0xFF, 0xFE, 0x00]);
    assert_error(load_scene(Some(&binary), &Overrides::default()), 1, &["volume.raw", "is not text", "--volume"]);
    let long = dir.path().join("long.toml");
    std::fs::File::create(&long).unwrap().set_len(1 << 30).unwrap();
    assert_error(load_scene(Some(&long), &Overrides::default()), 1, &["long.toml", "bytes long"]);
    let missing = load_scene(Some(&dir.path().join("none.toml")), &Overrides::default()).unwrap_err();
    assert!(missing.to_string().contains("none.toml: cannot open"), "{missing}");
    let empty = file("empty.toml", b"");
    assert_error(load_scene(Some(&empty), &Overrides::default()), 1, &["empty.toml", "names no volume", "--volume"]);
    let absent = file("absent.toml", b"volume.file = 'absent.nrrd'");
    let problem = load_scene(Some(&absent), &Overrides::default());
    assert_error(problem, 1, &["absent.nrrd", "no such volume", "--volume"]);
    let raw = flags(&["--volume", binary.to_str().unwrap(), "--raw-type", "u8"]).unwrap();
    assert_error(load_scene(None, &raw), 1, &["'size' is not known", "--raw-size"]);
}

#[test]
fn a_raw_volume_is_loaded_shifted_and_turned() {
    let dir = tempfile::tempdir().unwrap();
    let values: Vec<u8> = (0..24u16).flat_map(|v| (v * 100).to_be_bytes()).collect();
    std::fs::write(dir.path().join("v.raw"), [&[0u8; 5][..], &values].concat()).unwrap();
    let scene = "[volume]\nfile = 'v.raw'\nvalue_offset = -1000\nup = 'y'\n
        raw = { size = [2, 3, 4], type = 'u16', endian = 'big', spacing = [1, 2, 3], skip = 5 }";
    let path = dir.path().join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    let scene = load_scene(Some(&path), &Overrides::default()).unwrap();
    let v = &scene.volume;
    assert_eq!((v.grid.dims, v.value(0), v.value(23)), ([2, 3, 4], -1000.0, 1300.0));
    assert_eq!(scene.path, Some(path));
    // The file's y is the world's z, its z the world's −y.
    let steps = v.grid.index_to_world.matrix3;
    assert_eq!((steps.x_axis, steps.y_axis, steps.z_axis), (DVec3::X, DVec3::Z * 2.0, DVec3::Y * -3.0));
}

#[test]
fn every_axis_can_be_up_and_nothing_is_mirrored() {
    use UpAxis::*;
    let axes =
        [(X, DVec3::X), (MinusX, -DVec3::X), (Y, DVec3::Y), (MinusY, -DVec3::Y), (Z, DVec3::Z), (MinusZ, -DVec3::Z)];
    for (axis, direction) in axes {
        assert_eq!(axis.to_z() * direction, DVec3::Z, "{axis:?}");
        assert_eq!(axis.to_z().determinant(), 1.0, "{axis:?}");
        assert_eq!(axis.to_z() * axis.to_z().transpose(), DMat3::IDENTITY, "{axis:?}");
    }
}

#[test]
fn presets_and_scenes_parse_and_resolve() {
    for preset in presets::PRESETS {
        let layer = parse(&format!("preset = '{}'", preset.name)).unwrap();
        let scene = resolve(merge(SceneFile::default(), layer).unwrap(), small_volume()).unwrap();
        assert!(!scene.lights.is_empty() && scene.environment.is_some(), "{}", preset.name);
        let most = scene.transfer.max_extinction(1.0);
        assert!(most > 0.0, "{}", preset.name);
        assert_eq!(scene.transfer.evaluate(-1e9, 1.0).extinction, 0.0, "{}: air is not empty", preset.name);
        let colors = scene.transfer.points.iter().flat_map(|p| p.color);
        assert!(colors.clone().all(|c| (0.1..=0.99).contains(&c)), "{}", preset.name);
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut scenes = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            let layers = merge(SceneFile::default(), SceneFile::load(&path).unwrap()).unwrap();
            resolve(layers, small_volume()).unwrap();
            scenes += 1;
        }
    }
    assert!(scenes > 0);
}

#[test]
fn without_arguments_there_is_a_picture() {
    let scene = load_scene(None, &flags(&["--size", "64x48"]).unwrap()).unwrap();
    assert!(scene.volume.name.starts_with("phantom:"), "{}", scene.volume.name);
    assert_eq!((scene.settings.size, scene.path), ([64, 48], None));
}

#[test]
fn phantoms_bring_their_presets() {
    for name in ["skull", "head", "heart", "tree", "cloud"] {
        let overrides = flags(&["--volume", &format!("phantom:{name}:32x32x32")]).unwrap();
        let scene = load_scene(None, &overrides).unwrap();
        assert_eq!((scene.volume.grid.dims, &*scene.volume.name), ([32; 3], &*format!("phantom:{name}")));
        let own = presets::find(&format!("phantom-{name}")).unwrap().transfer.points.unwrap();
        assert_eq!(scene.transfer.points.len(), own.len());
        let active = |&i: &usize| scene.transfer.evaluate(scene.volume.value(i), 1.0).extinction > 0.0;
        let active = (0..32768).filter(active).count() as f64 / 32768.0;
        // The cloud has no soft edge that would have to be left out.
        let threshold = if name == "cloud" { 0.0 } else { phantom::ACTIVE };
        assert_eq!(active, active_fraction(&scene.volume, threshold), "{name}");
        // Another preset or transfer function takes its place.
        let args = ["--volume", &format!("phantom:{name}:8x8x8"), "--preset", "ct-bone"];
        let bone = load_scene(None, &flags(&args).unwrap()).unwrap();
        assert_eq!(bone.transfer.points[0].value, 580.0);
    }
    // One without a preset of its own gets the ramp.
    let scene = load_scene(None, &flags(&["--volume", "phantom:sphere:16x16x16"]).unwrap()).unwrap();
    assert_eq!(scene.transfer.points.len(), presets::find("ramp").unwrap().transfer.points.unwrap().len());
    let unknown = load_scene(None, &flags(&["--volume", "phantom:bust"]).unwrap());
    assert_error(unknown, 1, &["phantom 'bust'", "skull"]);
}

#[test]
fn noise_is_added_to_the_volume() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("noise.toml");
    std::fs::write(&path, "volume = { phantom = 'constant', size = [8, 8, 8], noise = 0.25 }").unwrap();
    let noisy = load_scene(Some(&path), &flags(&["--seed", "5"]).unwrap()).unwrap().volume;
    let values: Vec<f64> = (0..512).map(|i| noisy.value(i)).collect();
    let (lo, hi) = values.iter().fold((1.0f64, 0.0f64), |(lo, hi), &v| (lo.min(v), hi.max(v)));
    assert!(hi - lo > 0.2, "{lo} to {hi}");
    let clean = load_scene(Some(&path), &Overrides::default()).unwrap().volume;
    assert_eq!(clean, noisy, "part of the volume, not of the seed");
}

// ---- transfer functions ------------------------------------------------------------------------------------------

fn point(value: f64, grey: f32, opacity: f32) -> TransferPoint {
    TransferPoint { value, color: [grey; 3], opacity, emission: [grey; 3] }
}

fn function(points: &[(f64, f32, f32)], opacity_unit: OpacityUnit) -> TransferFunction {
    TransferFunction { points: points.iter().map(|&(v, c, o)| point(v, c, o)).collect(), opacity_unit }
}

#[test]
fn transfer_functions_are_piecewise_linear_and_right_continuous() {
    let f = function(
        &[(0.0, 0.0, 0.0), (10.0, 1.0, 4.0), (10.0, 0.5, 1.0), (10.0, 0.25, 2.0), (20.0, 0.25, 0.0)],
        OpacityUnit::Extinction,
    );
    let at = |v: f64| (f.evaluate(v, 1.0).color[0], f.evaluate(v, 1.0).extinction);
    assert_eq!(at(-5.0), (0.0, 0.0));
    assert_eq!(at(0.0), (0.0, 0.0));
    assert_eq!(at(2.5), (0.25, 1.0));
    assert_eq!(at(10.0), (0.25, 2.0), "the last of a step's points holds");
    let before = at(10.0f64.next_down());
    assert!((before.0 - 1.0).abs() < 1e-6 && (before.1 - 4.0).abs() < 1e-6, "{before:?}");
    assert_eq!(at(15.0), (0.25, 1.0));
    assert_eq!(at(20.0), (0.25, 0.0));
    assert_eq!((at(f64::INFINITY), at(f64::NEG_INFINITY), at(f64::NAN)), ((0.25, 0.0), (0.0, 0.0), (0.0, 0.0)));

    let one = function(&[(5.0, 0.5, 0.25)], OpacityUnit::Extinction);
    for v in [-1e30, 5.0, 1e30] {
        assert_eq!((one.evaluate(v, 1.0).color, one.evaluate(v, 1.0).extinction), ([0.5; 3], 0.25));
    }
    let step = function(&[(5.0, 0.0, 0.0), (5.0, 1.0, 3.0)], OpacityUnit::Extinction);
    assert_eq!(step.evaluate(5.0f64.next_down(), 1.0).extinction, 0.0);
    assert_eq!(step.evaluate(5.0, 1.0).extinction, 3.0);
    let huge = function(&[(f64::from(f32::MIN), 0.0, 0.0), (f64::from(f32::MAX), 1.0, 1.0)], OpacityUnit::Extinction);
    assert_eq!(huge.evaluate(0.0, 1.0).extinction, 0.5);
}

#[test]
fn opacity_becomes_extinction() {
    let sigma = |opacity: f32, unit| f64::from(function(&[(0.0, 0.0, opacity)], unit).evaluate(0.0, 0.5).extinction);
    let per = |d| OpacityUnit::PerDistance(Some(d));
    assert_eq!(sigma(0.0, per(1.0)), 0.0);
    assert!((sigma(0.5, per(2.0)) - 0.5 * 2.0f64.ln()).abs() < 1e-7);
    assert_eq!(sigma(0.5, OpacityUnit::PerDistance(None)), sigma(0.5, per(0.5)), "the mean spacing");
    assert!((sigma(1e-20, per(1.0)) / f64::from(1e-20f32) - 1.0).abs() < 1e-6, "1 − 1e-20 is not 1");
    let most = 16.0 * 2.0f64.ln();
    assert!((sigma(1.0, per(1.0)) - most).abs() < 1e-5, "α = 1 is capped at 1 − 2⁻¹⁶");
    assert_eq!(sigma(1.0, per(1.0)), sigma(MAX_OPACITY as f32, per(1.0)));
    assert_eq!(sigma(1e6, OpacityUnit::Extinction), 1e6);
}

#[test]
fn the_greatest_extinction_skips_what_is_never_reached() {
    let extinction = |points: &[(f64, f32, f32)]| function(points, OpacityUnit::Extinction).max_extinction(1.0);
    assert_eq!(extinction(&[(0.0, 0.0, 1.0), (1.0, 0.0, 5.0), (2.0, 0.0, 2.0)]), 5.0, "not monotone");
    assert_eq!(extinction(&[(0.0, 0.0, 1.0), (1.0, 0.0, 2.0), (1.0, 0.0, 9.0), (1.0, 0.0, 3.0)]), 3.0);
    assert_eq!(extinction(&[(0.0, 0.0, 4.0), (1.0, 0.0, 7.0), (1.0, 0.0, 0.0)]), 7.0, "a limit from the left");
    assert_eq!(extinction(&[(1.0, 0.0, 7.0), (1.0, 0.0, 0.0)]), 7.0, "holds below the first");
    assert_eq!(extinction(&[(0.0, 0.0, 0.0)]), 0.0);
}

proptest! {
    #![proptest_config(fixed())]

    #[test]
    fn no_extinction_exceeds_the_greatest(
        points in prop::collection::vec((-3i32..3, 0.0f32..1.0), 1..8),
        values in prop::collection::vec(-4.0f64..4.0, 50),
    ) {
        let mut points: Vec<_> = points.into_iter().map(|(v, o)| (f64::from(v), 0.0, o)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let f = function(&points, OpacityUnit::PerDistance(None));
        let most = f.max_extinction(0.7);
        let edges = (-4..=4).flat_map(|v| [f64::from(v), f64::from(v).next_down()]);
        let reached = values.into_iter().chain(edges).map(|v| f.evaluate(v, 0.7).extinction).fold(0.0, f32::max);
        prop_assert!(reached <= most, "{reached} > {most}");
        // The bound is least: it is a value at, or a limit at, one of the integers.
        prop_assert!(reached >= most * (1.0 - 1e-5), "{reached} << {most}");
    }
}

#[test]
fn window_and_level_move_the_points() {
    let mut f =
        function(&[(0.0, 0.0, 0.0), (25.0, 0.0, 0.5), (25.0, 0.0, 0.6), (100.0, 0.0, 1.0)], OpacityUnit::Extinction);
    let values = |f: &TransferFunction| f.points.iter().map(|p| p.value).collect::<Vec<_>>();
    f.window_level(Some(400.0), Some(40.0));
    assert_eq!(values(&f), [-160.0, -60.0, -60.0, 240.0]);
    f.window_level(None, Some(200.0));
    assert_eq!(values(&f), [0.0, 100.0, 100.0, 400.0]);
    f.window_level(Some(4.0), None);
    assert_eq!(values(&f), [198.0, 199.0, 199.0, 202.0]);
    let mut step = function(&[(5.0, 0.0, 0.0), (5.0, 0.0, 1.0)], OpacityUnit::Extinction);
    step.window_level(Some(9.0), Some(-3.0));
    assert_eq!(values(&step), [-3.0, -3.0]);
}

#[test]
fn relative_values_follow_the_data() {
    let grid = |n: u32| Grid::axis_aligned([n, 1, 1], [1.0; 3], [0.0; 3]);
    let volume = |values: Vec<f32>| Volume {
        name: "line".into(),
        grid: grid(values.len() as u32),
        data: VoxelData::F32(values),
        slope: 2.0,
        intercept: -100.0,
    };
    let (lo, hi) = data_window(&volume((0..1000).map(|i| i as f32).collect()));
    assert!((lo - -80.0).abs() < 10.0 && (hi - 1880.0).abs() < 10.0, "{lo} {hi}");
    let sparse = volume((0..1000).map(|i| if i < 995 { 0.0 } else { 500.0 }).collect());
    assert_eq!(data_window(&sparse), (-100.0, 900.0), "the whole range");
    assert_eq!(data_window(&volume(vec![3.0; 9])), (-94.0, -94.0));
    let mut f = function(&[(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.0, 0.0, 1.0)], OpacityUnit::Extinction);
    f.make_absolute(&sparse);
    assert_eq!(f.points.iter().map(|p| p.value).collect::<Vec<_>>(), [-100.0, 400.0, 900.0]);
}

#[test]
fn transfer_function_files() {
    let dir = tempfile::tempdir().unwrap();
    let scene = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        scene_of("", &["--transfer", path.to_str().unwrap(), "--window", "20"])
    };
    let s = scene(
        "t.toml",
        "convention = 'extinction'\nlevel = 5\npoints = [{ value = 0, color = 0, opacity = 0 }, { value = 1, color = 1, opacity = 7 }]",
    );
    let t = s.unwrap().transfer;
    assert_eq!((t.points[0].value, t.points[1].value), (-5.0, 15.0), "the flag's window about the file's level");
    assert_eq!((t.opacity_unit, t.points[1].opacity), (OpacityUnit::Extinction, 7.0));
    assert_error(scene("u.toml", "\nlevel = nan"), 1, &["u.toml:2: field 'level'"]);
    assert_error(scene("v.toml", "level = 1"), 1, &["v.toml", "no 'points'"]);
    assert_error(scene("w.toml", "points = 3"), 1, &["w.toml:1", "points"]);

    let map =
        |rgb: &str, points: &str| format!("[{{ \"Name\": \"x\", \"RGBPoints\": [{rgb}], \"Points\": [{points}] }}]");
    let s = scene("p.json", &map("0, 0, 0, 0, 10, 1, 1, 1", "0, 0, 0.5, 0, 5, 1, 0.5, 0, 10, 0.5, 0.5, 0")).unwrap();
    let points: Vec<_> = s.transfer.points.iter().map(|p| (p.color[0], p.opacity)).collect();
    assert_eq!(points, [(0.0, 0.0), (0.5, 1.0), (1.0, 0.5)]);
    assert_error(scene("q.json", "{}"), 1, &["q.json", "no list of colour maps"]);
    assert_error(scene("q.json", "[]"), 1, &["q.json", "no colour map"]);
    assert_error(scene("q.json", "[{\"RGBPoints\": [0, 0, 0, 0]}]"), 1, &["q.json", "no opacities"]);
    assert_error(scene("q.json", &map("0, 0, 0", "0, 0, 0.5, 0")), 1, &["'RGBPoints' has 3 numbers"]);
    assert_error(scene("q.json", &map("0, 0, 0, 0, 0, 1, 1, 1", "0, 0, 0.5, 0")), 1, &["do not increase"]);
    assert_error(scene("q.json", &map("0, 0, 0, 0", "0, 0, 0.4, 0, 1, 0, 0.5, 0")), 1, &["midpoint"]);
    assert_error(scene("q.json", &map("0, 0, 0, 0", "0, 2, 0.5, 0")), 1, &["points.0.opacity"]);
}

// ---- camera ------------------------------------------------------------------------------------------------------

/// Pixel coordinates in which the camera sees `p`; `None` behind it.
fn project(c: &tyndall::scene::Camera, p: DVec3, size: [u32; 2]) -> Option<[f64; 2]> {
    let d = p - c.position;
    let depth = d.dot(c.forward);
    let scale = 0.5 * f64::from(size[1]) / (0.5 * c.fov_degrees).to_radians().tan() / depth;
    let [w, h] = size.map(f64::from);
    (depth > 0.0).then(|| [0.5 * w + d.dot(c.right) * scale, 0.5 * h - d.dot(c.up) * scale])
}

proptest! {
    #![proptest_config(fixed())]

    #[test]
    fn automatic_framing_shows_all_corners(
        dims in prop::array::uniform3(1u32..600),
        spacing in prop::array::uniform3(0.01f64..20.0),
        scale in -6i32..7,
        turn in prop::array::uniform3(-3.0f64..3.0),
        azimuth in -400.0f64..400.0, elevation in -90.0f64..=90.0, roll in -180.0f64..180.0,
        fov in 1.0f64..170.0, zoom in 0.1f64..=1.0,
        size in prop::array::uniform2(1u32..2000),
    ) {
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, turn[0], turn[1], turn[2]);
        let steps = turn * DMat3::from_diagonal(DVec3::from(spacing) * 10f64.powi(scale));
        let grid = Grid { dims, index_to_world: DAffine3 { matrix3: steps, translation: DVec3::new(3.0, -70.0, 11.0) } };
        let c = camera::frame(&grid, &Framing { azimuth, elevation, roll, zoom, fov }, size);
        prop_assert!((c.right.cross(c.up) + c.forward).length() < 1e-9, "axes are not right-handed");
        let [w, h] = size.map(f64::from);
        let (mut most, mut nearest) = (0.0f64, f64::INFINITY);
        let corners = camera::corners(&grid);
        for corner in corners {
            let [x, y] = project(&c, corner, size).expect("a corner is behind the camera");
            prop_assert!(x >= 0.0 && x <= w && y >= 0.0 && y <= h, "({x}, {y}) is outside {w} x {h}");
            nearest = nearest.min((corner - c.position).dot(c.forward));
            most = most.max((2.0 * x / w - 1.0).abs()).max((2.0 * y / h - 1.0).abs());
            // The ray of that pixel leads to the corner.
            let ray = c.ray(x, y, size);
            let to = (corner - c.position).normalize();
            prop_assert!((ray - to).length() < 1e-6, "{ray} is not {to}");
        }
        // And no further away than that needs, but for an eye that would come too close to a corner.
        let least = 0.1 * (corners[7] - corners[0]).length() / 2.0;
        let fits = (most - 0.95 * zoom).abs() < 1e-6 || (most < 0.95 * zoom && (nearest / least - 1.0).abs() < 1e-6);
        prop_assert!(fits, "the box fills {most} of the picture from {nearest}");
    }
}

#[test]
fn the_picture_is_not_mirrored() {
    let grid = Grid::axis_aligned([10, 10, 10], [1.0; 3], [-4.5; 3]);
    let size = [200, 100];
    let view = |azimuth, elevation| {
        let c = camera::frame(&grid, &Framing { azimuth, elevation, ..Framing::default() }, size);
        move |p: DVec3| project(&c, p, size).unwrap()
    };
    let (left, back, head) = (DVec3::X, DVec3::Y, DVec3::Z); // LPS
    let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6;
    // Facing the patient: the left hand on the picture's right, the head on top (row 0 is on top).
    let front = view(0.0, 0.0);
    assert!(close(front(DVec3::ZERO), [100.0, 50.0]));
    assert!(front(left)[0] > 101.0 && front(head)[1] < 49.0, "{:?} {:?}", front(left), front(head));
    // From the patient's left: the face (−y) is on the picture's left.
    let side = view(90.0, 0.0);
    assert!(side(-back)[0] < 99.0 && side(head)[1] < 49.0);
    // From behind, from above and from below.
    assert!(view(180.0, 0.0)(left)[0] < 99.0);
    assert!(view(0.0, 90.0)(back)[1] < 49.0 && view(0.0, 90.0)(left)[0] > 101.0);
    assert!(view(0.0, -90.0)(back)[1] > 51.0 && view(0.0, -90.0)(left)[0] > 101.0);
    // A roll of 90° turns the camera clockwise: what was up is now on the left.
    let c = camera::frame(&grid, &Framing { roll: 90.0, ..Framing::default() }, size);
    assert!(project(&c, head, size).unwrap()[0] < 99.0);
    // The zoom magnifies.
    let c = camera::frame(&grid, &Framing { zoom: 2.0, ..Framing::default() }, size);
    let (near, far) = (project(&c, left, size).unwrap()[0] - 100.0, front(left)[0] - 100.0);
    assert!((near / far - 2.0).abs() < 1e-9, "{near} {far}");
}

#[test]
fn placed_cameras() {
    let c = camera::look_at(DVec3::new(0.0, -5.0, 0.0), DVec3::ZERO, DVec3::Z * 3.0, 40.0);
    assert_eq!((c.forward, c.right, c.up), (DVec3::Y, DVec3::X, DVec3::Z));
    // Along the vertical, the axes are those that automatic framing has there.
    let grid = Grid::axis_aligned([2, 2, 2], [1.0; 3], [-0.5; 3]);
    for (elevation, eye) in [(90.0, DVec3::Z), (-90.0, -DVec3::Z)] {
        let placed = camera::look_at(eye * 9.0, DVec3::ZERO, DVec3::Z, 40.0);
        let framed = camera::frame(&grid, &Framing { elevation, ..Framing::default() }, [1, 1]);
        assert!((placed.up - framed.up).length() < 1e-9 && (placed.right - framed.right).length() < 1e-9);
    }
    let along_y = camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Y, 40.0);
    assert_eq!((along_y.forward, along_y.up), (DVec3::Y, DVec3::Z));
    // Corner rays of a 90° square picture.
    let c = camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z, 90.0);
    let ray = c.ray(0.0, 0.0, [64, 64]);
    assert!((ray - DVec3::new(-1.0, 1.0, 1.0).normalize()).length() < 1e-12, "{ray}");
    assert!((c.ray(64.0, 16.0, [64, 32]) - DVec3::new(2.0, 1.0, 0.0).normalize()).length() < 1e-12);
}

// ---- environment -------------------------------------------------------------------------------------------------

/// A sky with a sun of 10⁵ times its radiance, not symmetric in anything.
fn sunny(width: u32, height: u32) -> LatLong {
    let pixel = |i: u32| {
        let (x, y) = (i % width, i / width);
        let sky = 0.2 + 0.3 * (x as f32 / width as f32) + 0.5 * (1.0 - y as f32 / height as f32);
        let sun = if x == width / 3 && y == height / 4 { 1e5 } else { 0.0 };
        [sky + sun, 0.8 * sky + sun, 0.5 * sky + 0.9 * sun]
    };
    LatLong { width, height, pixels: (0..width * height).map(pixel).collect(), rotation_degrees: 37.0 }
}

/// A regular set of numbers in (0,1)².
fn grid_of(n: u32) -> impl Iterator<Item = [f32; 2]> {
    let at = move |i| (i as f32 + 0.5) / n as f32;
    (0..n).flat_map(move |i| (0..n).map(move |j| [at(i), at(j)]))
}

#[test]
fn latlong_directions() {
    let (width, height) = (8, 4);
    let pixels = (0..32).map(|i| [i as f32, 0.0, 0.0]).collect();
    let mut image = LatLong { width, height, pixels, rotation_degrees: 0.0 };
    let at = |image: &LatLong, d: DVec3| image.radiance(d.normalize()).x as u32;
    // Row 0 is up. Column 4 begins at +y and goes towards +x, which is on the right of who looks along +y.
    assert_eq!(at(&image, DVec3::new(0.01, 0.1, 1.0)) / width, 0);
    assert_eq!(at(&image, DVec3::new(0.01, 0.1, -1.0)) / width, 3);
    assert_eq!(at(&image, DVec3::new(0.1, 1.0, 0.1)), width + 4);
    assert_eq!(at(&image, DVec3::new(-0.1, 1.0, 0.1)), width + 3);
    assert_eq!(at(&image, DVec3::new(1.0, 0.1, 0.1)), width + 5);
    assert_eq!(at(&image, DVec3::new(0.1, -1.0, -0.1)), 2 * width + 7);
    assert_eq!(at(&image, DVec3::new(-0.1, -1.0, -0.1)), 2 * width);
    // Turned by 90° counter-clockwise from above, what was at +y is at −x.
    image.rotation_degrees = 90.0;
    assert_eq!(at(&image, DVec3::new(-1.0, 0.1, 0.1)), width + 4);
    for d in [DVec3::Z, -DVec3::Z, DVec3::Y, -DVec3::Y, DVec3::X] {
        assert!(at(&image, d) < 32);
    }
}

#[test]
fn mean_radiance_is_exact() {
    let mut image = sunny(16, 9);
    image.pixels.fill([0.5, 1.0, 2.0]);
    let mean = Environment::LatLong(image.clone()).mean_radiance();
    assert!((mean - Vec3::new(0.5, 1.0, 2.0)).length() < 1e-6, "{mean}");
    // Half the sphere, and one polar cap of solid angle 2π(1 − cos(π/9)).
    image.pixels.fill([0.0; 3]);
    image.pixels[..16].fill([1.0; 3]);
    let cap = (1.0 - (std::f64::consts::PI / 9.0).cos()) / 2.0;
    assert!((f64::from(image.mean_radiance().x) - cap).abs() < 1e-7);
    assert_eq!(Environment::Constant(Vec3::X).mean_radiance(), Vec3::X);
}

#[test]
fn the_table_draws_what_its_density_says() {
    // Sizes below, at and above the table's, which is at most 2048 × 1024.
    for (width, height) in [(1, 1), (7, 5), (64, 32), (4096, 8), (3000, 1500)] {
        let image = sunny(width, height);
        let table = EnvironmentTable::new(&image);
        assert_eq!((table.columns, table.rows), (width.min(2048), height.min(1024)));
        assert_eq!(table.marginal.len(), table.rows as usize + 1);
        assert_eq!(table.conditional.len(), (table.rows * (table.columns + 1)) as usize);
        let sums = |sums: &[f32]| sums[0] == 0.0 && sums[sums.len() - 1] == 1.0 && sums.is_sorted();
        assert!(sums(&table.marginal) && table.conditional.chunks(table.columns as usize + 1).all(sums));

        // Monte Carlo with densities: ∫ 1 dω = 4π and ∫ L dω = 4π·mean. Every density is that of its direction.
        let n = 300;
        let (mut sphere, mut light) = (0.0, 0.0);
        for random in grid_of(n) {
            let (d, density) = table.sample(random);
            assert!((d.length() - 1.0).abs() < 1e-9 && density > 0.0, "{d} {density}");
            let again = f64::from(table.density(d));
            assert!((again / f64::from(density) - 1.0).abs() < 1e-4, "{again} is not {density} at {d}");
            sphere += 1.0 / f64::from(density);
            light += f64::from(image.radiance(d).x) / f64::from(density);
        }
        let count = f64::from(n * n);
        let mean = 4.0 * std::f64::consts::PI * f64::from(image.mean_radiance().x);
        assert!((light / count / mean - 1.0).abs() < 0.02, "{width}x{height}: {} is not {mean}", light / count);
        // 1 is not what the table is made for: a sun takes up to 95 % of the samples.
        let sphere = sphere / count / (4.0 * std::f64::consts::PI);
        assert!((sphere - 1.0).abs() < 0.1, "{width}x{height}: {sphere}");
    }
}

#[test]
fn the_density_integrates_to_one() {
    let image = sunny(64, 32);
    let table = EnvironmentTable::new(&image);
    // Even points over the sphere, 16 in each cell; with the solid angle that a point stands for.
    let (columns, rows) = (4 * 64, 4 * 32);
    let (mut integral, mut least) = (0.0, f32::INFINITY);
    for j in 0..rows {
        let edge = |j: u32| (std::f64::consts::PI * f64::from(j) / f64::from(rows)).cos();
        let weight = (edge(j) - edge(j + 1)) * std::f64::consts::TAU / f64::from(columns);
        let polar = std::f64::consts::PI * (f64::from(j) + 0.5) / f64::from(rows);
        for i in 0..columns {
            let a = std::f64::consts::TAU * ((f64::from(i) + 0.5) / f64::from(columns));
            let density = table.density(DVec3::new(polar.sin() * a.sin(), polar.sin() * a.cos(), polar.cos()));
            integral += weight * f64::from(density);
            least = least.min(density);
        }
    }
    assert!((integral - 1.0).abs() < 1e-5, "{integral}");
    let even = 0.05 / (4.0 * std::f32::consts::PI);
    assert!(least > 0.9 * even, "the least density is {least}, of the even share {even}");

    let mut black = sunny(8, 4);
    black.pixels.fill([0.0; 3]);
    let (_, density) = EnvironmentTable::new(&black).sample([0.3, 0.9]);
    assert!((density * 4.0 * std::f32::consts::PI - 1.0).abs() < 1e-5, "a black sky is drawn evenly");
}

#[test]
fn random_numbers_at_the_ends_are_safe() {
    let mut image = sunny(5, 3);
    image.pixels.fill([0.0; 3]);
    image.pixels[7] = [1e30; 3];
    let table = EnvironmentTable::new(&image);
    let last = 1.0f32.next_down();
    for random in [[0.0, 0.0], [last, last], [0.0, last], [last, 0.0]] {
        let (d, density) = table.sample(random);
        assert!(d.is_finite() && density > 0.0 && density.is_finite(), "{random:?}: {d} {density}");
    }
}

#[test]
fn environment_images_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let pixels = |x: u32, y: u32| image::Rgb([x as f32 + 0.5, y as f32, 100.0]);
    let source = image::Rgb32FImage::from_fn(6, 3, pixels);
    for name in ["sky.exr", "sky.hdr"] {
        let path = dir.path().join(name);
        source.save(&path).unwrap();
        let read = LatLong::load(&path, 2.0, 12.0).unwrap();
        assert_eq!((read.width, read.height, read.rotation_degrees), (6, 3, 12.0));
        for (read, source) in read.pixels.iter().zip(source.pixels()) {
            for c in 0..3 {
                // Radiance HDR shares an exponent of 8-bit mantissas.
                let tolerance = if name.ends_with("hdr") { 2.0 } else { 0.0 };
                assert!((read[c] - 2.0 * source.0[c]).abs() <= tolerance, "{name}: {read:?} {source:?}");
            }
        }
    }
    let scene = scene_of("", &["--environment", dir.path().join("sky.exr").to_str().unwrap()]).unwrap();
    assert!(matches!(scene.environment, Some(Environment::LatLong(_))));
}

#[test]
fn environment_images_that_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let load = |name: &str| LatLong::load(&path(name), 1.0, 0.0);
    let exr = |name: &str, value: f32| {
        let pixel = |x, y| image::Rgb(if (x, y) == (2, 1) { [1.0, value, 1.0] } else { [1.0; 3] });
        image::Rgb32FImage::from_fn(4, 2, pixel).save(path(name)).unwrap();
        load(name)
    };
    assert_error(exr("nan.exr", f32::NAN), 1, &["nan.exr", "column 2, row 1", "NaN", "finite"]);
    assert_error(exr("inf.exr", f32::INFINITY), 1, &["inf.exr", "column 2, row 1", "inf"]);
    assert_eq!(exr("negative.exr", -1.0).unwrap().pixels[6], [1.0, 0.0, 1.0]);
    image::RgbImage::new(4, 2).save(path("sky.png")).unwrap();
    assert_error(load("sky.png"), 1, &["sky.png", "neither Radiance HDR nor OpenEXR", ".exr"]);
    std::fs::write(path("text.hdr"), "not an image").unwrap();
    assert_error(load("text.hdr"), 1, &["text.hdr"]);
    std::fs::write(path("huge.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n").unwrap();
    assert_error(load("huge.hdr"), 1, &["huge.hdr", "200000 x 100000", "scale the image down"]);
    std::fs::write(path("empty.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4000 +X 8000\n").unwrap();
    assert_error(load("empty.hdr"), 1, &["empty.hdr", "promises 8000 x 4000 pixels, but has 51 bytes only"]);
    // Found by fuzzing: tiles of 2^28 pixels, for which the decoder would reserve memory.
    let huge_tiles = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/huge_tiles.exr");
    assert_error(LatLong::load(&huge_tiles, 1.0, 0.0), 1, &["huge_tiles.exr", "promises blocks of", "491 bytes only"]);
    let whole = std::fs::read(path("negative.exr")).unwrap();
    std::fs::write(path("cut.exr"), &whole[..whole.len() - 20]).unwrap();
    assert_error(load("cut.exr"), 1, &["cut.exr", "cannot be decoded"]);
    let missing = load("missing.hdr").unwrap_err().to_string();
    assert!(missing.contains("missing.hdr: cannot open"), "{missing}");
}

/// The turntable: gone by an angle, the camera stands where framing at that azimuth would put it, and looks the same way; and
/// the whole box stays in the picture all the way.
#[test]
fn turned_cameras_are_those_of_the_azimuth() {
    let grid = Grid::axis_aligned([40, 10, 20], [1.0, 1.5, 0.5], [3.0, -7.0, 2.0]);
    let size = [32, 20];
    let turns: Vec<f64> = (0..12).map(|i| 30.0 * f64::from(i)).collect();
    let framing = Framing { azimuth: 20.0, elevation: 25.0, roll: 10.0, ..Framing::default() };
    let first = camera::frame_turning(&grid, &framing, size, &turns);
    let alone = camera::frame(&grid, &framing, size);
    assert_eq!(camera::frame_turning(&grid, &framing, size, &[0.0]), alone);
    let centre = camera::centre(&grid);
    let inside = |c: &Camera| {
        let tan = (0.5 * c.fov_degrees).to_radians().tan();
        camera::corners(&grid).iter().all(|corner| {
            let d = *corner - c.position;
            let (x, y, z) = (d.dot(c.right), d.dot(c.up), d.dot(c.forward));
            z > 0.0 && y.abs() <= z * tan && x.abs() <= z * tan * 32.0 / 20.0
        })
    };
    let mut leaves = 0;
    for turn in turns {
        let turned = first.turned(centre, turn);
        let framed = camera::frame(&grid, &Framing { azimuth: 20.0 + turn, ..framing }, size);
        for (a, b) in [(turned.forward, framed.forward), (turned.right, framed.right), (turned.up, framed.up)] {
            assert!((a - b).length() < 1e-12, "{turn}: {a} {b}");
        }
        let distance = (turned.position - centre).length();
        assert!((distance - (first.position - centre).length()).abs() < 1e-9, "{turn}: {distance}");
        assert!(inside(&turned), "{turn}: a corner is out of the picture");
        leaves += usize::from(!inside(&alone.turned(centre, turn)));
    }
    assert!(leaves > 0, "framing for the first view alone would do");
}

#[test]
fn turntables_make_views_and_light_for_all_of_them() {
    let scene = |toml: &str| scene_of(toml, &[]).unwrap();
    let still = scene("");
    assert!(still.views.is_empty() && still.settings.light_for == LightFor::View);
    let turning = scene("[camera]\nazimuth = 0\nelevation = 0\n[turntable]\nframes = 4\ndegrees = -180\n");
    assert_eq!((turning.views.len(), turning.settings.light_for), (4, LightFor::EveryView));
    assert_eq!(turning.views[0], turning.camera);
    // Clockwise by 45 degrees a frame, from the front to the patient's right.
    let towards = |c: &Camera, azimuth: f64| (c.forward + camera::towards(azimuth, 0.0)).length() < 1e-9;
    assert!((0..4).all(|i| towards(&turning.views[i], -45.0 * i as f64)), "{:?}", turning.views);
    let view = scene("[turntable]\nframes = 4\n[render]\nlight_for = \"view\"\n");
    assert_eq!((view.views.len(), view.settings.light_for), (4, LightFor::View));
    // Flags cover the scene's.
    let flags = scene_of("[turntable]\nframes = 4\n", &["--turntable", "6", "--turntable-degrees", "-90"]).unwrap();
    assert_eq!(flags.views.len(), 6);
    let gone = (flags.views[2].position - flags.views[0].position).length();
    let distance = (flags.views[0].position - camera::centre(&flags.volume.grid)).truncate().length();
    assert!((gone - 2.0 * distance * 15f64.to_radians().sin()).abs() < 1e-9, "{gone}");
    // A camera that is placed keeps its place in the first frame.
    let placed = scene("[turntable]\nframes = 2\n[camera]\nposition = [0.0, -50.0, 3.0]\n");
    assert!((placed.camera.position - DVec3::new(0.0, -50.0, 3.0)).length() < 1e-9);
}
