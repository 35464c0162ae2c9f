//! Scenes for tests: TOML text over a volume that is already in memory.

#![allow(dead_code, reason = "each test file uses a part of it")]

use std::path::Path;
use tyndall::scene::file::SceneFile;
use tyndall::scene::{Scene, merge, resolve};
use tyndall::volume::{Grid, Volume, VoxelData, phantom};

/// The scene of `toml` over `volume`; presets named in it are applied.
pub fn scene_of(toml: &str, volume: Volume) -> Scene {
    let layers = SceneFile::parse(toml, Path::new("test.toml")).unwrap_or_else(|e| panic!("{e}"));
    resolve(merge(layers, SceneFile::default()).unwrap(), volume).unwrap_or_else(|e| panic!("{e}"))
}

/// A phantom of `size` voxels with its own preset's medium and lights, and `render` as the `[render]` table's lines.
pub fn phantom_scene(name: &str, size: [u32; 3], render: &str) -> Scene {
    let toml = format!("[volume]\nphantom = \"{name}\"\n[render]\n{render}");
    scene_of(&toml, phantom::generate(name, Some(size)).unwrap())
}

/// A volume of the given values, voxels 1×1×1.
pub fn volume_of(dims: [u32; 3], values: Vec<f32>) -> Volume {
    let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]);
    Volume { name: "test".into(), grid, data: VoxelData::F32(values), slope: 1.0, intercept: 0.0 }
}
