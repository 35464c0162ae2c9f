//! Reads ParaView's JSON colour maps: `RGBPoints` (value, r, g, b) and `Points` (value, opacity, midpoint, sharpness).
//!
//! Colours are display colours (sRGB) and become linear. They are interpolated in linear RGB, whatever the map's own
//! colour space; add points to the map where that matters.

use super::file::{OpacityConvention, PointTable, TransferTable, ValueScale};
use super::values::{Rgb, srgb_to_linear};
use super::{OpacityUnit, TransferFunction, TransferPoint};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct ColorMap {
    #[serde(rename = "RGBPoints")]
    rgb_points: Option<Vec<f64>>,
    points: Option<Vec<f64>>,
}

/// The first colour map of the file's list. The error is the problem, without the file's name.
pub fn parse(text: &str) -> Result<TransferTable, String> {
    let maps: Vec<ColorMap> = serde_json::from_str(text).map_err(|e| format!("is no list of colour maps: {e}"))?;
    let map = maps.into_iter().next().ok_or("holds no colour map")?;
    let rgb = map.rgb_points.ok_or("the first colour map has no 'RGBPoints'")?;
    let opacity = map.points.ok_or("the first colour map has no opacities ('Points')")?;
    let rgb = rows(&rgb, "RGBPoints")?;
    let opacity = rows(&opacity, "Points")?;
    if opacity[..opacity.len() - 1].iter().any(|p| p[2] != 0.5 || p[3] != 0.0) {
        return Err("'Points' has a midpoint other than 0.5 or a sharpness other than 0".into());
    }
    let colors = function(rgb, |p| ([p[1], p[2], p[3]].map(|c| srgb_to_linear(c) as f32), 0.0));
    let opacities = function(opacity, |p| ([0.0; 3], p[1] as f32));
    let mut values: Vec<f64> = rgb.iter().chain(opacity).map(|p| p[0]).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let point = |value: f64| {
        let (color, opacity) = (colors.evaluate(value, 1.0).color, opacities.evaluate(value, 1.0).extinction);
        PointTable { value, color: Rgb(color), opacity: f64::from(opacity), emission: None }
    };
    Ok(TransferTable {
        points: Some(values.into_iter().map(point).collect()),
        scale: Some(ValueScale::Value),
        convention: Some(OpacityConvention::Opacity),
        ..TransferTable::default()
    })
}

fn rows<'a>(list: &'a [f64], name: &str) -> Result<&'a [[f64; 4]], String> {
    let (rows, rest) = list.as_chunks::<4>();
    if rows.is_empty() || !rest.is_empty() {
        return Err(format!("'{name}' has {} numbers, not a multiple of 4", list.len()));
    }
    if !rows.is_sorted_by(|a, b| a[0] < b[0]) {
        return Err(format!("the values in '{name}' do not increase"));
    }
    Ok(rows)
}

/// A function whose colour and extinction are those that `read` gives, for interpolation alone.
fn function(rows: &[[f64; 4]], read: impl Fn(&[f64; 4]) -> ([f32; 3], f32)) -> TransferFunction {
    let point = |row: &[f64; 4]| {
        let (color, opacity) = read(row);
        TransferPoint { value: row[0], color, opacity, emission: [0.0; 3] }
    };
    TransferFunction { points: rows.iter().map(point).collect(), opacity_unit: OpacityUnit::Extinction }
}
