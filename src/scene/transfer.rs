//! Transfer functions on the CPU: evaluation, bounds, window and level, and data-relative values.

use super::{OpacityUnit, TransferFunction, TransferPoint};
use crate::volume::{Volume, summary};

/// Greatest opacity that is told apart from 1: α = 1 would be an infinite extinction (DESIGN section 1).
pub const MAX_OPACITY: f64 = 1.0 - 1.0 / 65536.0;

/// What a transfer function says about one scalar, before the scene's albedo, density and emission scales.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classified {
    /// Albedo or emitted colour, linear RGB from 0 to 1.
    pub color: [f32; 3],
    /// σ_t in 1/unit.
    pub extinction: f32,
    /// L_e, linear RGB.
    pub emission: [f32; 3],
}

impl OpacityUnit {
    /// σ_t [1/unit] of an `opacity`; `mean_spacing` is the unit distance if the transfer function names none.
    pub fn extinction(self, opacity: f64, mean_spacing: f64) -> f64 {
        match self {
            // ln_1p keeps the digits of small opacities, where 1 − α rounds to 1.
            OpacityUnit::PerDistance(unit) => -(-opacity.min(MAX_OPACITY)).ln_1p() / unit.unwrap_or(mean_spacing),
            OpacityUnit::Extinction => opacity,
        }
    }
}

impl TransferFunction {
    /// Classifies one scalar: colour, opacity and emission are interpolated linearly, then opacity becomes extinction.
    ///
    /// NaN counts as below the first point, as `Volume::values_f32` lets it become the least value.
    /// `mean_spacing` is the volume's. Needs at least one point (panics otherwise).
    pub fn evaluate(&self, value: f64, mean_spacing: f64) -> Classified {
        let points = &self.points;
        // Right-continuous: of several points at one value the last one holds there.
        let above = points.partition_point(|p| p.value <= value);
        let (a, b) = (&points[above.saturating_sub(1)], &points[above.min(points.len() - 1)]);
        let t = if b.value > a.value { (value - a.value) / (b.value - a.value) } else { 0.0 };
        let mix = |a: f32, b: f32| f64::from(a) + t * (f64::from(b) - f64::from(a));
        let mix3 = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|c| mix(a[c], b[c]) as f32);
        Classified {
            color: mix3(a.color, b.color),
            extinction: self.opacity_unit.extinction(mix(a.opacity, b.opacity), mean_spacing) as f32,
            emission: mix3(a.emission, b.emission),
        }
    }

    /// Least upper bound of σ_t [1/unit] over all scalars.
    ///
    /// σ_t grows with the opacity, so it is found at a point. Between the first and the last point of one value
    /// (a step's two sides) others are never reached and do not count.
    pub fn max_extinction(&self, mean_spacing: f64) -> f32 {
        let reached = |i: usize| {
            let same = |j: Option<&TransferPoint>| j.is_some_and(|p| p.value == self.points[i].value);
            !(i > 0 && same(self.points.get(i - 1)) && same(self.points.get(i + 1)))
        };
        let opacities = (0..self.points.len()).filter(|&i| reached(i)).map(|i| f64::from(self.points[i].opacity));
        self.opacity_unit.extinction(opacities.fold(0.0, f64::max), mean_spacing) as f32
    }

    /// Moves the points so that the first and last come to `level` ∓ `window`/2, in the scalar's unit. A missing
    /// argument keeps the present width or centre. A function of a single value has no width: it moves to `level`.
    pub fn window_level(&mut self, window: Option<f64>, level: Option<f64>) {
        let (lo, hi) = (self.points[0].value, self.points[self.points.len() - 1].value);
        let window = window.unwrap_or(hi - lo);
        let level = level.unwrap_or(lo + 0.5 * (hi - lo));
        for p in &mut self.points {
            let along = if hi > lo { (p.value - lo) / (hi - lo) - 0.5 } else { 0.0 };
            p.value = level + window * along;
        }
    }

    /// Turns values that are relative to the data (0 = 1st, 1 = 99th percentile of the voxels) into scalars.
    pub fn make_absolute(&mut self, volume: &Volume) {
        let (lo, hi) = data_window(volume);
        for p in &mut self.points {
            p.value = lo * (1.0 - p.value) + hi * p.value;
        }
    }
}

/// The 1st and the 99th percentile of a volume's values. The whole range where they are closer than the histogram
/// resolves, as in a volume that is empty but for a few vessels.
pub fn data_window(volume: &Volume) -> (f64, f64) {
    let summary = summary::summary(volume);
    let (lo, hi) = (summary.percentile(1.0), summary.percentile(99.0));
    let bin = summary.max / summary::BINS as f64 - summary.min / summary::BINS as f64;
    if hi - lo > bin { (lo, hi) } else { (summary.min, summary.max) }
}
