//! A scene file, at some of its frames, for a volume that is there already.
#![no_main]

use std::path::Path;
use tyndall::scene::animation::layer_at;
use tyndall::scene::file::SceneFile;
use tyndall::scene::{merge, resolve};
use tyndall::volume::{Grid, Volume, VoxelData};

libfuzzer_sys::fuzz_target!(|text: &str| {
    // A file of a name that no file has: what the scene names is not there.
    let Ok(file) = SceneFile::parse(text, Path::new("/nowhere/at/all/scene.toml")) else { return };
    for frame in [0.0, 1.5, 1e4] {
        let keyed = layer_at(file.animation.keys(), frame).over(file.clone());
        let Ok(layers) = merge(SceneFile::default(), keyed) else { continue };
        let grid = Grid::axis_aligned([3, 2, 2], [1.0, 2.0, 0.5], [0.0; 3]);
        let data = VoxelData::U8((0..12).collect());
        let volume = Volume { name: "small".into(), grid, data, slope: 1.0, intercept: 0.0 };
        if let Ok(scene) = resolve(layers, volume) {
            assert!(scene.camera.position.is_finite() && scene.camera.forward.is_finite(), "a camera that is nowhere");
        }
    }
});
