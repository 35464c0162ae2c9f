//! What `tyndall inspect` says of a volume's values.

use super::VoxelData;
use super::grid::{Volume, for_each_type};

/// Number of histogram bins.
pub const BINS: usize = 256;

/// Figures over all voxels, in the volume's value unit (slope and intercept applied).
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Least finite value; 0 if there is none.
    pub min: f64,
    /// Greatest finite value; 0 if there is none.
    pub max: f64,
    /// Mean of the finite values; 0 if there is none.
    pub mean: f64,
    /// Voxels that are NaN.
    pub nan_count: u64,
    /// Voxels that are infinite.
    pub inf_count: u64,
    /// Voxels per bin: [`BINS`] equal bins from `min` to `max`, which lies in the last one. All of a constant volume
    /// lies in the first.
    pub histogram: Vec<u64>,
}

/// Figures of a volume.
pub fn summary(volume: &Volume) -> Summary {
    let (min, max) = volume.range();
    let (slope, intercept) = (volume.slope, volume.intercept);
    // Halves, since max - min may overflow.
    let scale = BINS as f64 / (max / 2.0 - min / 2.0);
    let mut histogram = vec![0u64; BINS];
    let (mut nan_count, mut inf_count) = (0, 0);
    let mut offsets = 0.0;
    let inverse_count = 1.0 / volume.data.len() as f64;
    for_each_type!(&volume.data, stored => for &s in stored {
        let value = slope * f64::from(s) + intercept;
        if value.is_finite() {
            let bin = ((value / 2.0 - min / 2.0) * scale) as usize;
            histogram[bin.min(BINS - 1)] += 1;
            // Divided before adding up, since the sum of the largest values overflows.
            offsets += value * inverse_count;
        } else if value.is_nan() {
            nan_count += 1;
        } else {
            inf_count += 1;
        }
    });
    let finite: u64 = histogram.iter().sum();
    let mean = if finite == 0 { 0.0 } else { (offsets / (finite as f64 * inverse_count)).clamp(min, max) };
    Summary { min, max, mean, nan_count, inf_count, histogram }
}

/// Share of voxels with a value above `threshold`, in 0 to 1. A NaN is not above it.
pub fn active_fraction(volume: &Volume, threshold: f64) -> f64 {
    let (slope, intercept) = (volume.slope, volume.intercept);
    let active = for_each_type!(&volume.data, stored => {
        stored.iter().filter(|&&s| slope * f64::from(s) + intercept > threshold).count()
    });
    active as f64 / volume.data.len().max(1) as f64
}

impl Summary {
    /// The value below which `percent` (0 to 100) of the finite voxels lie, to within one bin's width.
    pub fn percentile(&self, percent: f64) -> f64 {
        let finite: u64 = self.histogram.iter().sum();
        let goal = percent.clamp(0.0, 100.0) / 100.0 * finite as f64;
        let mut below = 0.0;
        for (bin, &count) in self.histogram.iter().enumerate() {
            let count = count as f64;
            if count > 0.0 && below + count >= goal {
                let position = (bin as f64 + (goal - below) / count) / BINS as f64;
                return self.min * (1.0 - position) + self.max * position;
            }
            below += count;
        }
        self.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Grid;

    fn volume(values: Vec<f32>) -> Volume {
        let grid = Grid::axis_aligned([values.len() as u32, 1, 1], [1.0; 3], [0.0; 3]);
        Volume { name: "test".into(), grid, data: VoxelData::F32(values), slope: 2.0, intercept: 1.0 }
    }

    #[test]
    fn figures_of_known_values() {
        let mut values: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        values.extend([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
        let v = volume(values);
        let s = summary(&v);
        assert_eq!((s.min, s.max, s.nan_count, s.inf_count), (1.0, 1999.0, 1, 2));
        assert!((s.mean - 1000.0).abs() < 1e-9, "mean {}", s.mean);
        assert_eq!(s.histogram.iter().sum::<u64>(), 1000);
        assert!(s.histogram.iter().all(|&n| n == 3 || n == 4), "{:?}", s.histogram);
        let bin = 1998.0 / BINS as f64;
        for percent in [0.0, 1.0, 25.0, 50.0, 99.0, 100.0] {
            let expected = 1.0 + 1998.0 * percent / 100.0;
            assert!((s.percentile(percent) - expected).abs() <= bin, "{percent}: {}", s.percentile(percent));
        }
        // +inf and the 500 values above 2*499+1.
        assert_eq!(active_fraction(&v, 999.0), 501.0 / 1003.0);
    }

    #[test]
    fn extremes_stay_finite() {
        let constant = summary(&volume(vec![3.0; 7]));
        assert_eq!((constant.min, constant.max, constant.mean, constant.histogram[0]), (7.0, 7.0, 7.0, 7));
        assert_eq!(constant.percentile(50.0), 7.0);
        let nothing = summary(&volume(vec![f32::NAN; 3]));
        assert_eq!((nothing.min, nothing.max, nothing.mean, nothing.nan_count), (0.0, 0.0, 0.0, 3));
        let grid = Grid::axis_aligned([2, 1, 1], [1.0; 3], [0.0; 3]);
        let data = VoxelData::F64(vec![-f64::MAX, f64::MAX]);
        let huge = summary(&Volume { name: "test".into(), grid, data, slope: 1.0, intercept: 0.0 });
        assert_eq!((huge.mean, huge.histogram[0], huge.histogram[BINS - 1]), (0.0, 1, 1));
        let end_of_first_bin = f64::MAX / 128.0 - f64::MAX;
        assert!((huge.percentile(50.0) / end_of_first_bin - 1.0).abs() < 1e-12, "{}", huge.percentile(50.0));
    }
}
