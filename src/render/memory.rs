//! What would fit where a scene does not: settings that take less device memory, and how much they take.

use super::path::PathRender;
use super::{Internals, Renderer};
use crate::scene::{LightFor, Model, Precision, Sampling, Scene};
use crate::stats::mebibytes_text;
use crate::vk::Context;
use crate::volume::{Grid, Volume, VoxelData};
use crate::{Error, Result};
use std::sync::Arc;

/// Adds to an error about the device's memory which settings would fit. Other errors stay as they are.
pub(super) fn advise(ctx: &Context, scene: &Scene, error: Error) -> Error {
    let Error::OutOfDeviceMemory { object, needed, used, total, .. } = error else { return error };
    let left = ctx.memory().saturating_sub(ctx.bytes());
    let cure = cure(ctx, scene, left);
    Error::OutOfDeviceMemory { object, needed, used, total, cure }
}

/// What to change, with flags, and what the scene takes then. From the least loss to the greatest.
fn alternatives(scene: &Scene) -> Vec<(String, Scene)> {
    let s = &scene.settings;
    let mut all = Vec::new();
    let mut add = |is_change: bool, flag: String, change: &dyn Fn(&mut Scene)| {
        if is_change {
            let mut scene = scene.clone();
            change(&mut scene);
            all.push((flag, scene));
        }
    };
    add(s.precision == Precision::Single, "--precision half".into(), &|scene| {
        scene.settings.precision = Precision::Half
    });
    let is_lit = matches!(s.model, Model::Single | Model::Multiple);
    let has_proxy = s.model == Model::Multiple && s.sampling.uses_proxy();
    add(has_proxy, "--sampling phase".into(), &|scene| scene.settings.sampling = Sampling::Phase);
    let is_for_every = is_lit && s.light_for == LightFor::EveryView;
    add(is_for_every, "--light-for view".into(), &|scene| scene.settings.light_for = LightFor::View);
    for edge in s.light_grid + 1..=4 {
        add(is_lit, format!("--light-grid {edge}"), &|scene| scene.settings.light_grid = edge);
    }
    add(s.model == Model::Multiple, "--model single".into(), &|scene| scene.settings.model = Model::Single);
    all
}

fn cure(ctx: &Context, scene: &Scene, left: u64) -> String {
    let smaller = "use a smaller volume or picture, or a device with more memory";
    let all = need(ctx, scene).ok();
    let of_all = all.map(|bytes| format!("the scene takes about {}", mebibytes_text(bytes)));
    let with_need = |(flag, scene): (String, Scene)| Some((flag, need(ctx, &scene).ok()?));
    let needs: Vec<(String, u64)> = alternatives(scene).into_iter().filter_map(with_need).collect();
    let takes = |(flag, bytes): &(String, u64)| format!("{flag} would take about {}", mebibytes_text(*bytes));
    let least = needs.iter().min_by_key(|(_, bytes)| *bytes).filter(|(_, bytes)| all.is_none_or(|all| *bytes < all));
    match (needs.iter().find(|(_, bytes)| *bytes <= left), least) {
        (Some(fits), _) => of_all.into_iter().chain([takes(fits)]).collect::<Vec<_>>().join("; "),
        (None, Some(least)) => format!("{smaller}; even {}", takes(least)),
        (None, None) => of_all.map_or(smaller.into(), |of_all| format!("{smaller}; {of_all}")),
    }
}

/// About how many bytes a scene takes on the device.
fn need(ctx: &Context, scene: &Scene) -> Result<u64> {
    // The larger the closer; the smaller ones for devices with next to no memory.
    extrapolate(ctx, scene, [24.0, 48.0]).or_else(|_| extrapolate(ctx, scene, [8.0, 16.0]))
}

/// The same from two volumes of the same proportions whose longest edges are given: what grows does so with the number of
/// voxels.
fn extrapolate(ctx: &Context, scene: &Scene, edges: [f64; 2]) -> Result<u64> {
    let dims = scene.volume.grid.dims;
    let voxels = |dims: [u32; 3]| dims.iter().map(|&n| f64::from(n)).product::<f64>();
    let longest = f64::from(dims.into_iter().max().expect("three axes"));
    let [small, large] = edges.map(|edge| {
        let share = (edge / longest).min(1.0);
        dims.map(|n| ((f64::from(n) * share).round() as u32).max(1))
    });
    let [at_small, at_large] = [taken(ctx, scene, small)?, taken(ctx, scene, large)?];
    let per_voxel = if voxels(large) > voxels(small) {
        (at_large as f64 - at_small as f64) / (voxels(large) - voxels(small))
    } else {
        0.0
    };
    Ok((at_large as f64 + per_voxel * (voxels(dims) - voxels(large))) as u64)
}

/// Bytes that the scene takes with a volume of this size.
fn taken(ctx: &Context, scene: &Scene, dims: [u32; 3]) -> Result<u64> {
    let grid = Grid { dims, ..scene.volume.grid };
    let data = VoxelData::U8(vec![0; grid.voxels() as usize]);
    let volume = Volume { name: String::new(), grid, data, slope: 1.0, intercept: 0.0 };
    let scene = Scene { volume: Arc::new(volume), ..scene.clone() };
    let before = ctx.bytes();
    let taken = |after: u64| after.saturating_sub(before);
    if scene.settings.model == Model::Path {
        let _render = PathRender::build(ctx, &scene)?;
        return Ok(taken(ctx.bytes()));
    }
    let _renderer = Renderer::build(ctx, &scene, Internals::default())?;
    Ok(taken(ctx.bytes()))
}
