//! `tyndall inspect`: what is in a volume file.

use std::fmt::Write as _;
use std::path::PathBuf;

use serde::Serialize;

use super::in_string;
use crate::scene::{RawFlags, phantom_of};
use crate::stats::{times, to_json};
use crate::volume::{self, ScalarType, Volume};
use crate::{Error, Result};

/// Show a volume's size, placement, values, and how much of it thresholds leave.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// NRRD, MetaImage, NIfTI or raw file, or phantom:NAME or phantom:NAME:XxYxZ.
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// Values above which voxels count as active [default: eight across the range].
    #[arg(long, value_name = "VALUES", value_delimiter = ',', allow_hyphen_values = true)]
    threshold: Vec<f64>,

    /// Print JSON.
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    raw: RawFlags,
}

/// Everything that the command reports.
#[derive(Serialize)]
struct Report {
    name: String,
    dims: [u32; 3],
    scalar_type: String,
    spacing: [f64; 3],
    /// World position of the first voxel's centre.
    origin: [f64; 3],
    /// World directions of the three voxel steps.
    axes: [[f64; 3]; 3],
    /// Two corners of the world-space box around the voxels' faces.
    bounds: [[f64; 3]; 2],
    range: [f64; 2],
    mean: f64,
    nan_voxels: u64,
    infinite_voxels: u64,
    percentiles: Vec<Percentile>,
    histogram: Histogram,
    active: Vec<Active>,
    suggested_preset: Option<&'static str>,
}

#[derive(Serialize)]
struct Percentile {
    percent: f64,
    value: f64,
}

/// Voxels per bin of equal width between `min` and `max`.
#[derive(Serialize)]
struct Histogram {
    min: f64,
    max: f64,
    counts: Vec<u64>,
}

#[derive(Serialize)]
struct Active {
    threshold: f64,
    fraction: f64,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    let volume = match (phantom_of(&args.file, "FILE")?, args.raw.layout()?) {
        (Some((name, size)), None) => volume::phantom::generate(&name, size)?,
        (Some(_), Some(_)) => {
            return Err(Error::usage("--raw-size", "a phantom is no raw file", "leave the --raw flags out"));
        }
        (None, layout) => volume::load(&args.file, layout.as_ref())?,
    };
    let report = report(&volume, &args.threshold);
    Ok(if args.json { to_json(&report) } else { text(&report) })
}

fn report(volume: &Volume, thresholds: &[f64]) -> Report {
    let grid = &volume.grid;
    let summary = volume::summary(volume);
    let steps = grid.index_to_world.matrix3;
    let (low, high) = grid.world_bounds();
    let at = |tenths: u32| summary.min * f64::from(10 - tenths) / 10.0 + summary.max * f64::from(tenths) / 10.0;
    let thresholds = if thresholds.is_empty() { (1..=8).map(at).collect() } else { thresholds.to_vec() };
    Report {
        name: volume.name.clone(),
        dims: grid.dims,
        scalar_type: volume.data.scalar_type().to_string(),
        spacing: grid.spacing(),
        origin: grid.index_to_world.transform_point3(glam::DVec3::splat(0.5)).into(),
        axes: [steps.x_axis, steps.y_axis, steps.z_axis].map(|a| a.normalize_or_zero().into()),
        bounds: [low.into(), high.into()],
        range: [summary.min, summary.max],
        mean: summary.mean,
        nan_voxels: summary.nan_count,
        infinite_voxels: summary.inf_count,
        percentiles: percentiles(volume),
        active: thresholds
            .into_iter()
            .map(|threshold| Active { threshold, fraction: volume::active_fraction(volume, threshold) })
            .collect(),
        suggested_preset: suggested_preset(volume, [summary.min, summary.max]),
        histogram: Histogram { min: summary.min, max: summary.max, counts: summary.histogram },
    }
}

/// Percentiles of the finite values by nearest rank: exact, unlike the summary's, which are good to a bin.
fn percentiles(volume: &Volume) -> Vec<Percentile> {
    let mut values: Vec<f32> = (0..volume.data.len()).map(|i| volume.value(i) as f32).collect();
    values.retain(|v| v.is_finite());
    let Some(last) = values.len().checked_sub(1) else { return Vec::new() };
    let at = |percent: f64| {
        let rank = (percent / 100.0 * last as f64).round() as usize;
        let value = f64::from(*values.select_nth_unstable_by(rank, f32::total_cmp).1);
        Percentile { percent, value }
    };
    [1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0, 99.9].map(at).into()
}

fn text(r: &Report) -> String {
    in_string(|out| {
        writeln!(out, "volume       {}", r.name)?;
        writeln!(out, "size         {} voxels, {}", times(&r.dims), r.scalar_type)?;
        writeln!(out, "spacing      {}", vector(r.spacing))?;
        writeln!(out, "first voxel  {}", vector(r.origin))?;
        writeln!(out, "axes         i {}, j {}, k {}", axis(r.axes[0]), axis(r.axes[1]), axis(r.axes[2]))?;
        writeln!(out, "box          {}  to  {}", vector(r.bounds[0]), vector(r.bounds[1]))?;
        writeln!(out, "values       {} to {}, mean {}", number(r.range[0]), number(r.range[1]), number(r.mean))?;
        if r.nan_voxels + r.infinite_voxels > 0 {
            writeln!(out, "not finite   {} voxels NaN, {} infinite", r.nan_voxels, r.infinite_voxels)?;
        }
        writeln!(out, "percentiles")?;
        for p in &r.percentiles {
            writeln!(out, "{:>12} %  {}", p.percent, number(p.value))?;
        }
        histogram(out, &r.histogram)?;
        writeln!(out, "active voxels")?;
        for a in &r.active {
            writeln!(out, "{:>14}  above {}", format!("{:.2} %", 100.0 * a.fraction), number(a.threshold))?;
        }
        match r.suggested_preset {
            Some(name) => writeln!(out, "preset       try --preset {name}"),
            None => Ok(()),
        }
    })
}

/// Rows of the printed histogram.
const ROWS: usize = 16;
/// Length of its longest bar.
const BAR: f64 = 40.0;

/// Bars as long as the logarithm of the counts: the air around an object would dwarf all else.
fn histogram(out: &mut String, h: &Histogram) -> std::fmt::Result {
    let rows: Vec<u64> = h.counts.chunks(h.counts.len().div_ceil(ROWS)).map(|bins| bins.iter().sum()).collect();
    let log = |count: u64| (count as f64).ln_1p();
    let longest = rows.iter().copied().map(log).fold(1.0, f64::max);
    let at = |i: usize| {
        let t = i as f64 / rows.len() as f64;
        number(h.min * (1.0 - t) + h.max * t)
    };
    writeln!(out, "histogram (logarithmic bars)")?;
    for (i, &count) in rows.iter().enumerate() {
        let bar = "#".repeat((log(count) / longest * BAR).round() as usize);
        let row = format!("{:>11} .. {:<11} {bar:<40} {count}", at(i), at(i + 1));
        writeln!(out, "{}", row.trim_end())?;
    }
    Ok(())
}

/// A number with at most six significant digits.
fn number(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 || (1e-3..1e7).contains(&magnitude) {
        let decimals = if value == 0.0 { 0 } else { (5 - magnitude.log10().floor() as i32).max(0) as usize };
        let text = format!("{value:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.5e}")
    }
}

fn vector(v: [f64; 3]) -> String {
    v.map(number).join("  ")
}

/// `+x`, `-z`, or the direction itself where it is oblique.
fn axis(direction: [f64; 3]) -> String {
    let aligned = (0..3).find(|&i| direction[i].abs() > 1.0 - 1e-9);
    match aligned {
        Some(i) => format!("{}{}", if direction[i] < 0.0 { '-' } else { '+' }, ["x", "y", "z"][i]),
        None => format!("({})", vector(direction)),
    }
}

/// The preset for data that look like these: a guess from range and type, never more.
fn suggested_preset(volume: &Volume, range: [f64; 2]) -> Option<&'static str> {
    let [min, max] = range;
    Some(match volume.data.scalar_type() {
        _ if min == max => return None,
        // Air in Hounsfield units is -1000, bone above 300.
        _ if (-5000.0..-500.0).contains(&min) && max > 500.0 => "ct-bone",
        ScalarType::F32 | ScalarType::F64 if min >= 0.0 && max <= 20.0 => "smoke",
        ScalarType::U16 | ScalarType::I16 if min >= 0.0 => "mr",
        _ => "ramp",
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::presets;
    use crate::volume::{Grid, VoxelData};

    #[test]
    fn numbers_have_six_digits_and_no_idle_zeros() {
        let cases = [
            (0.0, "0"),
            (-1024.0, "-1024"),
            (0.95703125, "0.957031"),
            (120000.0, "120000"),
            (-1.5, "-1.5"),
            (1e30, "1.00000e30"),
            (1e-6, "1.00000e-6"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn suggested_presets_exist_and_follow_the_data() {
        let grid = Grid::axis_aligned([2, 1, 1], [1.0; 3], [0.0; 3]);
        let suggested = |data: VoxelData, intercept| {
            let volume = Volume { name: "test".into(), grid, data, slope: 1.0, intercept };
            let name = suggested_preset(&volume, volume.range().into());
            assert!(name.is_none_or(|n| presets::names().any(|p| p == n)), "{name:?} is no preset");
            name
        };
        assert_eq!(suggested(VoxelData::U16(vec![0, 4000]), -1024.0), Some("ct-bone"));
        assert_eq!(suggested(VoxelData::U16(vec![0, 4000]), 0.0), Some("mr"));
        assert_eq!(suggested(VoxelData::F32(vec![0.0, 5.7]), 0.0), Some("smoke"));
        assert_eq!(suggested(VoxelData::U8(vec![0, 255]), 0.0), Some("ramp"));
        assert_eq!(suggested(VoxelData::U8(vec![7, 7]), 0.0), None);
    }

    #[test]
    fn percentiles_are_exact_and_of_finite_values() {
        let data: Vec<f32> = (0..=1000).rev().map(|v| v as f32).chain([f32::NAN, f32::INFINITY]).collect();
        let grid = Grid::axis_aligned([data.len() as u32, 1, 1], [1.0; 3], [0.0; 3]);
        let volume = Volume { name: "test".into(), grid, data: VoxelData::F32(data), slope: 2.0, intercept: 1.0 };
        let values: Vec<f64> = percentiles(&volume).iter().map(|p| p.value).collect();
        assert_eq!(values, [21.0, 101.0, 501.0, 1001.0, 1501.0, 1901.0, 1981.0, 1999.0]);
        let empty = Volume { data: VoxelData::F32(vec![f32::NAN]), ..volume };
        assert!(percentiles(&empty).is_empty());
    }

    #[test]
    fn axes_are_named_where_they_are_aligned() {
        assert_eq!(axis([0.0, -1.0, 0.0]), "-y");
        assert_eq!(axis([0.6, 0.8, 0.0]), "(0.6  0.8  0)");
    }
}
