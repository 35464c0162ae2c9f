//! The scenes: small, and together they use every kernel of the renderer in every form.

use crate::Result;
use crate::scene::{Environment, LatLong, Overrides, Scene, load_scene_text};
use std::path::Path;

/// A scene that is rendered.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Unique; what it is for.
    pub name: &'static str,
    /// Its scene file, but for what all have.
    text: &'static str,
    /// Is its environment an image?
    has_sky: bool,
}

/// The volume of all: no cube, no power of two.
const VOLUME: &str = "[volume]\nphantom = \"cloud\"\nsize = [13, 11, 9]\n";

/// Two kinds of light, several of a kind.
macro_rules! lights {
    () => {
        "light = [{ azimuth = 30, elevation = 40, irradiance = 2 }, { direction = [0, 1, -1], irradiance = [1, 0, 0] }, \
         { position = [20, -20, 9], intensity = 500 }]\n"
    };
}

/// Light without colour.
macro_rules! white {
    () => {
        "light = [{ azimuth = 30, elevation = 40, irradiance = 2 }]\nenvironment.radiance = 0.5\n"
    };
}

/// Matter that glows, and whose albedo differs from value to value.
macro_rules! glow {
    () => {
        "transfer.points = [{ value = 0, color = [0.9, 0.8, 0.2], opacity = 0 }, \
         { value = 1, color = 0.5, opacity = 0.9, emission = [3, 1, 0.2] }]\n"
    };
}

const fn case(name: &'static str, text: &'static str) -> Case {
    Case { name, text, has_sky: false }
}

const fn under_sky(name: &'static str, text: &'static str) -> Case {
    Case { name, text, has_sky: true }
}

/// All of them. What is common: few directions, more candidates, two rays per pixel.
pub const CASES: &[Case] = &[
    // Local models.
    case("absorption", "render.model = 'absorption'\nbackground = 'transparent'\n"),
    case("absorption, single precision", "render = { model = 'absorption', precision = 'single' }\n"),
    FAULTY,
    under_sky("phong, lights, sky", concat!("render.model = 'phong'\nbackground = 'environment'\n", lights!())),
    case(
        "phong, single precision",
        "render = { model = 'phong', precision = 'single' }\nbackground = [0.1, 0.2, 0.3]\n",
    ),
    // Light scattered once.
    case("single", "render.model = 'single'\nlight = [{ azimuth = 30, elevation = 40, irradiance = 2 }]\n"),
    case("single, lights, g", concat!("render.model = 'single'\nmedium.g = 0.5\n", lights!())),
    case("single, constant environment", "render.model = 'single'\nlight = []\nenvironment.radiance = 1\n"),
    under_sky("single, sky", concat!("render.model = 'single'\n", lights!())),
    under_sky(
        "single, sky, g, single precision",
        "render = { model = 'single', precision = 'single' }\nmedium.g = -0.3\n",
    ),
    case("single, glow", concat!("render.model = 'single'\nlight = []\n", glow!())),
    under_sky("single, every view, g", "render = { model = 'single', light_for = 'every-view' }\nmedium.g = 0.4\n"),
    // Light scattered many times.
    case("multiple", "render.orders = 3\nenvironment.radiance = 0.5\n"),
    case(
        "multiple, all cells alike",
        "render = { orders = 2, hidden_share = 1 }\nlight = []\nenvironment.radiance = 1\n",
    ),
    case("multiple, lights, no environment", concat!("render.orders = 3\n", lights!())),
    under_sky("multiple, sky", concat!("render.orders = 3\n", lights!())),
    under_sky("multiple, sky, g", concat!("render.orders = 3\nmedium.g = 0.6\n", lights!())),
    case("multiple, g", concat!("render.orders = 3\nmedium.g = 0.6\nenvironment.radiance = 0.5\n", lights!())),
    case("multiple, glow", concat!("render.orders = 3\nlight = []\n", glow!())),
    case("multiple, glow, g, lights", concat!("render.orders = 3\nmedium.g = -0.4\n", glow!(), lights!())),
    case("multiple, single precision", concat!("render = { orders = 3, precision = 'single' }\n", lights!())),
    case(
        "multiple, single precision, g",
        concat!("render = { orders = 3, precision = 'single' }\nmedium.g = 0.3\nenvironment.radiance = 1\n", lights!()),
    ),
    case("multiple, every view", concat!("render = { orders = 3, light_for = 'every-view' }\n", lights!())),
    under_sky(
        "multiple, every view, g",
        concat!("render = { orders = 3, light_for = 'every-view' }\nmedium.g = 0.3\n", glow!(), lights!()),
    ),
    // Light in one channel.
    case("absorption, grey", concat!("render.model = 'absorption'\n", white!())),
    case(
        "absorption, grey, single precision",
        concat!("render = { model = 'absorption', precision = 'single' }\n", white!()),
    ),
    case("phong, grey", concat!("render.model = 'phong'\n", white!())),
    case("phong, grey, single precision", concat!("render = { model = 'phong', precision = 'single' }\n", white!())),
    case("multiple, grey", concat!("render.orders = 3\n", white!())),
    case("multiple, grey, g", concat!("render.orders = 3\nmedium.g = 0.5\n", white!())),
    case("multiple, grey, single precision", concat!("render = { orders = 2, precision = 'single' }\n", white!())),
    case("blocks of 2, grey", concat!("render = { orders = 2, light_grid = 2 }\n", white!())),
    case(
        "blocks of 2, grey, single precision",
        concat!("render = { orders = 2, light_grid = 2, precision = 'single' }\n", white!()),
    ),
    // Light in blocks.
    case("blocks of 2", concat!("render = { orders = 3, light_grid = 2 }\nenvironment.radiance = 0.5\n", lights!())),
    under_sky(
        "blocks of 4, g, glow, single precision",
        concat!("render = { orders = 3, light_grid = 4, precision = 'single' }\nmedium.g = 0.5\n", glow!(), lights!()),
    ),
    case(
        "blocks of 3, every view, g, glow",
        concat!("render = { orders = 3, light_grid = 3, light_for = 'every-view' }\nmedium.g = 0.5\n", glow!()),
    ),
    case("blocks of 2, proxy", concat!("render = { orders = 3, light_grid = 2, sampling = 'residual' }\n", lights!())),
    // Choice of directions.
    case("top", concat!("render = { orders = 3, sampling = 'top' }\n", lights!())),
    case(
        "top, g",
        concat!("render = { orders = 3, sampling = 'top' }\nmedium.g = 0.4\nenvironment.radiance = 1\n", lights!()),
    ),
    case("resample", "render = { orders = 3, sampling = 'resample' }\nenvironment.radiance = 1\n"),
    under_sky("resample, g", concat!("render = { orders = 3, sampling = 'resample' }\nmedium.g = 0.4\n", lights!())),
    case("residual", "render = { orders = 3, sampling = 'residual' }\nenvironment.radiance = 1\n"),
    under_sky("residual, g", concat!("render = { orders = 3, sampling = 'residual' }\nmedium.g = -0.4\n", lights!())),
    case("residual, glow", concat!("render = { orders = 3, sampling = 'residual' }\nlight = []\n", glow!())),
    case("auto", "render = { orders = 3, sampling = 'auto' }\nenvironment.radiance = 1\n"),
    case("auto, glow", concat!("render = { orders = 3, sampling = 'auto' }\n", glow!(), lights!())),
    case("auto, blocks of 2", concat!("render = { orders = 3, sampling = 'auto', light_grid = 2 }\n", lights!())),
    case("auto, g", concat!("render = { orders = 3, sampling = 'auto' }\nmedium.g = 0.4\n", lights!())),
    case("proxy of all bits", "render = { orders = 2, sampling = 'resample', mask = '8' }\nenvironment.radiance = 1\n"),
    case("proxy of no bits", "render = { orders = 2, sampling = 'resample', mask = '0' }\nenvironment.radiance = 1\n"),
    case(
        "adaptive proxy",
        "render = { orders = 3, sampling = 'resample', mask = 'adaptive:0.2' }\nenvironment.radiance = 1\n",
    ),
    // The reference.
    case("path", concat!("render = { model = 'path', orders = 3 }\n", lights!())),
    case(
        "path, unlimited",
        "render = { model = 'path', orders = 'unlimited' }\nmedium.g = 0.6\nenvironment.radiance = 1\n\
         background = 'transparent'\n",
    ),
    under_sky(
        "path, sky, glow",
        concat!("render = { model = 'path', orders = 3 }\nbackground = 'environment'\n", glow!(), lights!()),
    ),
];

/// The scene that faults are put into: kernels that are quick to compile, lists that they write.
pub const FAULTY: Case = case("phong", "render.model = 'phong'\n");

impl Case {
    /// The scene.
    ///
    /// # Errors
    /// None in a release: a test loads all scenes.
    pub fn scene(&self) -> Result<Scene> {
        let small = Overrides {
            size: Some([17, 13]),
            spp: Some(2),
            directions: Some(6),
            candidates: Some(9),
            environment_directions: Some(5),
            ..Overrides::default()
        };
        let mut scene = load_scene_text(&format!("{}{VOLUME}", self.text), Path::new(self.name), &small)?;
        if self.has_sky {
            scene.environment = Some(sky());
        }
        Ok(scene)
    }
}

/// An image of the sky with a bright spot, turned.
fn sky() -> Environment {
    let mut pixels = vec![[0.5, 0.6, 0.8]; 32];
    pixels[11] = [40.0, 30.0, 20.0];
    Environment::LatLong(LatLong { width: 8, height: 4, pixels, rotation_degrees: 37.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_have_names_of_their_own_and_load() {
        let mut names: Vec<_> = CASES.iter().map(|case| case.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), CASES.len());
        for case in CASES {
            case.scene().unwrap_or_else(|e| panic!("{}: {e}", case.name));
        }
    }
}
