//! Presets: a transfer function with a medium, lights and a background that suit it. Each is a layer in the scene
//! file's own form, so that it can be copied into a scene and changed.

use super::file::SceneFile;
use std::path::Path;
use std::sync::LazyLock;

/// A named layer.
#[derive(Clone, Copy, Debug)]
pub struct Preset {
    /// Name on the command line and in scene files.
    pub name: &'static str,
    /// What data it is for.
    pub about: &'static str,
    /// The layer as TOML.
    pub toml: &'static str,
}

macro_rules! presets {
    ($($name:literal: $about:literal,)*) => {
        /// All presets.
        pub const PRESETS: &[Preset] = &[
            $(Preset { name: $name, about: $about, toml: include_str!(concat!("presets/", $name, ".toml")) },)*
        ];
    };
}

presets! {
    "ramp": "any volume: a grey ramp from the 1st to the 99th percentile of its values",
    "ct-bone": "CT in Hounsfield units: ivory bone",
    "ct-skin": "CT in Hounsfield units: skin over bone",
    "ct-heart": "CT with contrast agent in Hounsfield units: heart, vessels and ribs",
    "mr": "MR, scaled to the data",
    "vessels": "angiography of vessels alone, 0 to about 560",
    "smoke": "smoke or cloud density, 0 to about 6",
    "tree": "CT of a plant, 0 to 255",
    "engine": "CT of a cast part, 0 to 255",
    "phantom-skull": "the phantom of this name",
    "phantom-head": "the phantom of this name",
    "phantom-heart": "the phantom of this name",
    "phantom-tree": "the phantom of this name",
    "phantom-cloud": "the phantom of this name",
}

/// All presets as layers, in the order of [`PRESETS`].
static LAYERS: LazyLock<Vec<SceneFile>> = LazyLock::new(|| {
    let layer = |p: &Preset| {
        let path = format!("preset {}", p.name);
        SceneFile::parse(p.toml, Path::new(&path)).expect("the presets are tested")
    };
    PRESETS.iter().map(layer).collect()
});

/// The preset of this name, if there is one.
pub fn find(name: &str) -> Option<SceneFile> {
    let at = PRESETS.iter().position(|p| p.name == name)?;
    Some(LAYERS[at].clone())
}

/// The names of all presets.
pub fn names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|p| p.name)
}
