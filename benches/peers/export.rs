//! Writes a scene as other renderers take it: `scene.json`, and the extinction of every voxel in `extinction.f32`
//! (little endian, x fastest), as the library's own classification gives it.
//!
//!     cargo run --release --example peers-export -- FOLDER [SCENE.toml] [flags of `tyndall render`]

use clap::Parser;
use glam::Vec3;
use serde_json::json;
use std::fs::{create_dir_all, write};
use std::path::PathBuf;
use tyndall::cpu::classify::{albedo_of, classify};
use tyndall::cpu::scene::HostScene;
use tyndall::scene::{Environment, Light, Overrides, load_scene};

#[derive(Parser)]
struct Args {
    /// Folder to write to.
    folder: PathBuf,
    /// Scene file.
    scene: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = Args::parse();
    let scene = load_scene(args.scene.as_deref(), &args.overrides)?;
    let host = HostScene::new(&scene);
    let mut extinctions = Vec::with_capacity(host.scalar.texels.len());
    let mut albedo: Option<Vec3> = None;
    for &value in &host.scalar.texels {
        let m = classify(&host.params, &host.points, value);
        extinctions.push(m.extinction);
        if m.extinction > 0.0 {
            if m.emission != [0.0; 3] {
                return Err("the medium emits, which this comparison leaves out".into());
            }
            // Between voxels Tyndall interpolates the scattering coefficient, others the albedo: the same only where
            // it is one albedo.
            let here = Vec3::from(albedo_of(&host.params, &m));
            // Interpolation in the transfer function rounds.
            if !albedo.get_or_insert(here).abs_diff_eq(here, 1e-6) {
                return Err("the albedo varies, and renderers interpolate it in different ways".into());
            }
        }
    }
    let lights = scene.lights.iter().map(|light| match light {
        Light::Directional { direction, irradiance } => {
            json!({"direction": direction.to_array(), "irradiance": irradiance.to_array()})
        }
        Light::Point { position, intensity } => {
            json!({"position": position.to_array(), "intensity": intensity.to_array()})
        }
    });
    let environment = match scene.environment {
        None => None,
        Some(Environment::Constant(radiance)) => Some(radiance.to_array()),
        Some(Environment::LatLong(_)) => return Err("environment images are left out of this comparison".into()),
    };
    let grid = &scene.volume.grid;
    let map = grid.index_to_world;
    // The world's steps of one voxel along x, y and z, and the outer corner of the first voxel.
    let columns = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis, map.translation].map(|v| v.to_array());
    let camera = scene.camera;
    let description = json!({
        "name": scene.volume.name,
        "dims": grid.dims,
        "index_to_world": columns,
        "albedo": albedo.ok_or("the volume is empty")?.to_array(),
        "g": scene.g,
        "lights": lights.collect::<Vec<_>>(),
        "environment": environment,
        "camera": {
            "position": camera.position.to_array(),
            "forward": camera.forward.to_array(),
            "up": camera.up.to_array(),
            "fov_degrees": camera.fov_degrees,
        },
        "size": scene.settings.size,
        "orders": scene.settings.orders,
    });
    create_dir_all(&args.folder)?;
    write(args.folder.join("scene.json"), serde_json::to_string_pretty(&description)?)?;
    let bytes: Vec<u8> = extinctions.iter().flat_map(|e| e.to_le_bytes()).collect();
    write(args.folder.join("extinction.f32"), bytes)?;
    Ok(())
}
