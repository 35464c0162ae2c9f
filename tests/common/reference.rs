//! The table of reference values for radiative transfer (DESIGN section 5), and how `path` is measured against it:
//! `transport.json` in the folder `shared/reference` beside the checkout, or in the one that TYNDALL_REFERENCE names.
//! Its README.md says what each number means. The table is not part of the repository.

#![allow(dead_code, reason = "each test file uses a part of it")]

use super::common;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use tyndall::render::path::PathRender;
use tyndall::scene::Scene;
use tyndall::vk::{Context, Validation};

/// Standard error that measurements reach, relative.
pub const PRECISION: f64 = 3e-3;
/// Largest |z| of a single value: of the about 1000 in the table's full sweep, chance exceeds it once in 16 sweeps.
pub const MOST_Z: f64 = 4.0;
/// What single precision adds to a path, relative: in the geometry and in every scattering.
pub const ROUNDING: f64 = 2e-6;

fn table() -> Option<Value> {
    let folder =
        std::env::var_os("TYNDALL_REFERENCE").map_or_else(|| PathBuf::from("../shared/reference"), PathBuf::from);
    let path = folder.join("transport.json");
    match std::fs::read_to_string(&path) {
        Ok(text) => Some(serde_json::from_str(&text).unwrap()),
        Err(error) => {
            println!("SKIP reference values: {}: {error}", path.display());
            None
        }
    }
}

/// Runs `body` with the table. Not under GPU-assisted validation, which makes lavapipe many times slower: tests/path.rs
/// has the kernels there.
pub fn gpu_test(body: impl FnOnce(&Context, &Value)) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP reference values under GPU-assisted validation");
    } else if let Some(table) = table() {
        common::gpu_test(|ctx| body(ctx, &table));
    }
}

/// The number `name` of a case's parameters or of a quantity.
#[track_caller]
pub fn number(parameters: &Value, name: &str) -> f64 {
    parameters[name].as_f64().unwrap_or_else(|| panic!("{name} in {parameters}"))
}

/// The cases of a problem: id, parameters, quantities.
pub fn cases<'a>(table: &'a Value, problem: &str) -> Vec<(&'a str, &'a Value, &'a Vec<Value>)> {
    let all = table["cases"].as_array().unwrap().iter().filter(|c| c["problem"] == problem);
    all.map(|c| (c["id"].as_str().unwrap(), &c["parameters"], c["quantities"].as_array().unwrap())).collect()
}

/// Of the values of every case two, others from case to case.
pub fn two_of_each<'a, T>(all: impl Iterator<Item = &'a T>, id: impl Fn(&'a T) -> &'a str) -> Vec<&'a T> {
    let mut cases: BTreeMap<&str, Vec<&T>> = BTreeMap::new();
    all.for_each(|item| cases.entry(id(item)).or_default().push(item));
    let mut chosen = Vec::new();
    for (i, of_case) in cases.values().enumerate() {
        chosen.extend((0..of_case.len().min(2)).map(|k| of_case[(5 * i + k * of_case.len() / 2) % of_case.len()]));
    }
    chosen
}

/// Means of a picture's channels with their standard errors.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    pub mean: [f64; 3],
    pub error: [f64; 3],
}

/// Renders with `path` until every channel's standard error is `precision` of what it should be, or `samples` of every
/// pixel are taken.
pub fn measure(ctx: &Context, scene: &Scene, expected: [f64; 3], precision: f64, samples: u32) -> Measured {
    let mut render = PathRender::new(ctx, scene).unwrap();
    let mut count = 16;
    loop {
        render.advance(count, &mut |_| ControlFlow::Continue(())).unwrap();
        let e = render.sums().unwrap().estimate(scene.settings.size);
        let missing = (0..3)
            .filter(|&c| expected[c] > 0.0)
            .map(|c| (e.mean_error[c] / (precision * expected[c])).powi(2))
            .fold(0.0, f64::max);
        let taken = render.samples();
        if missing <= 1.0 || taken >= samples {
            // What one path in all may do is not told apart, even where no path differs from another.
            let paths = e.picture.pixels.len() as f64 * f64::from(taken);
            let error = [0, 1, 2].map(|c| e.mean_error[c].max(expected[c] / paths));
            return Measured { mean: e.mean, error };
        }
        // As many as are missing, but no leap by an error that is not known well yet.
        let more = f64::from(taken) * (1.02 * missing - 1.0).clamp(0.05, 7.0);
        count = (more.ceil() as u32).min(samples - taken).max(1);
    }
}
