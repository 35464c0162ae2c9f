//! The error of a setting from pictures of several seeds: bias and noise apart, without the references' noise.

use serde::{Deserialize, Serialize};

use super::metrics::{self, block_bias};
use crate::output::Picture;
use crate::{Error, Result};

/// Squares are relative as in relMSE: per pixel and channel over b² + ε, ε = 0.01·mean(b)². Here b is the references' mean
/// over 3×3 pixels: a single pixel's noise would be in dividend and divisor, which looks like an error where it is dark.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeedErrors {
    /// Expected relMSE of one picture: `bias_squared` + `noise_squared`. By chance it may be negative.
    pub rel_mse: f64,
    /// Mean squared difference of the pictures' expectation from the references'. By chance it may be negative.
    pub bias_squared: f64,
    /// Standard error of `bias_squared`, from its spread over blocks of 8×8 pixels.
    pub bias_squared_error: f64,
    /// Mean variance of one picture.
    pub noise_squared: f64,
    /// mean(a−b) / mean(b) of R, G and B, a the mean of the pictures.
    pub bias: [f64; 3],
    /// [`block_bias`] of the mean of the pictures.
    pub block_bias: f64,
}

impl SeedErrors {
    /// Root of `rel_mse`: the error that settings are compared by.
    pub fn error(&self) -> f64 {
        self.rel_mse.max(0.0).sqrt()
    }

    /// Root mean square of the relative bias; 0 where less was found than nothing.
    pub fn bias_rms(&self) -> f64 {
        self.bias_squared.max(0.0).sqrt()
    }

    /// Root mean square of one picture's relative noise.
    pub fn noise_rms(&self) -> f64 {
        self.noise_squared.sqrt()
    }

    /// What the root mean square of the bias stays below with 95 % confidence.
    pub fn bias_bound(&self) -> f64 {
        (self.bias_squared.max(0.0) + 2.0 * self.bias_squared_error).sqrt()
    }

    /// Is the bias more than chance?
    pub fn bias_is_seen(&self) -> bool {
        self.bias_squared > 2.0 * self.bias_squared_error
    }
}

/// The mean of pictures of one size; at least one.
pub fn mean(pictures: &[Picture]) -> Picture {
    let mut mean = pictures[0].clone();
    let count = pictures.len() as f64;
    for (i, pixel) in mean.pixels.iter_mut().enumerate() {
        *pixel = std::array::from_fn(|c| {
            let sum: f64 = pictures.iter().map(|p| f64::from(p.pixels[i][c])).sum();
            (sum / count) as f32
        });
    }
    mean
}

/// Means over 3×3 pixels; over those that there are at the border.
fn smooth(picture: &Picture) -> Picture {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let near = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
        let window: Vec<_> = near(y, height).flat_map(|y| near(x, width).map(move |x| y * width + x)).collect();
        std::array::from_fn(|c| window.iter().map(|&j| picture.pixels[j][c]).sum::<f32>() / window.len() as f32)
    };
    Picture { pixels: (0..picture.pixels.len()).map(pixel).collect(), ..*picture }
}

/// The error of pictures with independent seeds against two references with independent noise, of one expectation.
///
/// With n pictures aₛ of mean ā and variance s², E (ā−b₁)(ā−b₂) is the squared bias plus s²/n: what is left of the noise
/// is taken out, and the references' noise is not in it.
///
/// Errors: sizes differ, there is one picture only, or the references are black.
pub fn seed_errors(pictures: &[Picture], references: &[Picture; 2]) -> Result<SeedErrors> {
    let [b1, b2] = references;
    let sizes = || pictures.iter().chain(references).map(|p| (p.width, p.height));
    if pictures.len() < 2 || sizes().any(|size| size != (b1.width, b1.height)) {
        let problem = format!("{} pictures, or pictures of several sizes, are given", pictures.len());
        return Err(Error::input("error of seeds", problem, "give at least two, all of the references' size"));
    }
    let n = pictures.len() as f64;
    let (a, b) = (mean(pictures), mean(references));
    let count = 3.0 * b.pixels.len() as f64;
    let mean_b = b.pixels.iter().flat_map(|p| &p[..3]).map(|&v| f64::from(v)).sum::<f64>() / count;
    if mean_b.is_nan() || mean_b <= 0.0 {
        let cure = "let light reach the medium and the medium the picture";
        return Err(Error::input("error of seeds", "the references are black: no error is relative to them", cure));
    }
    let epsilon = 0.01 * mean_b * mean_b;
    let smooth = smooth(&b);
    let mut noise_squared = 0.0;
    let mut blocks = Vec::new();
    for block in metrics::blocks(b.width, b.height) {
        let mut bias = 0.0;
        for (_, _, i) in block.pixels() {
            for c in 0..3 {
                let [a, b, b1, b2] = [&a, &smooth, b1, b2].map(|p| f64::from(p.pixels[i][c]));
                let weight = 1.0 / (count * (b * b + epsilon));
                let spread = pictures.iter().map(|p| (f64::from(p.pixels[i][c]) - a).powi(2)).sum::<f64>();
                let variance = spread / (n - 1.0);
                noise_squared += weight * variance;
                bias += weight * ((a - b1) * (a - b2) - variance / n);
            }
        }
        blocks.push(bias);
    }
    let bias_squared: f64 = blocks.iter().sum();
    let spread: f64 = blocks.iter().map(|x| (x - bias_squared / blocks.len() as f64).powi(2)).sum();
    Ok(SeedErrors {
        rel_mse: bias_squared + noise_squared,
        bias_squared,
        bias_squared_error: spread.sqrt(),
        noise_squared,
        bias: metrics::compare(&a, &b)?.bias,
        block_bias: block_bias(&a, &b),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::metrics::{compare_to_two, tests::noisy};

    const SIZE: u32 = 256;

    /// Noise of `amplitude` is uniform: its variance is amplitude²/3.
    fn errors(base: f32, amplitude: f32, seeds: u64) -> SeedErrors {
        let pictures: Vec<_> = (0..seeds).map(|s| noisy(base, amplitude, SIZE, 10 + s)).collect();
        seed_errors(&pictures, &[noisy(1.0, 0.3, SIZE, 1), noisy(1.0, 0.3, SIZE, 2)]).unwrap()
    }

    fn near(value: f64, wanted: f64, tolerance: f64) {
        assert!((value - wanted).abs() < tolerance, "{value} instead of {wanted} ± {tolerance}");
    }

    /// 1/(1 + ε), and what the noise left in b adds: three times its variance of 0.09/3/2/9.
    const SCALE: f64 = 1.005 / 1.01;

    #[test]
    fn bias_and_noise_are_told_apart() {
        for seeds in [2, 3, 8] {
            let e = errors(1.05, 0.4, seeds);
            near(e.noise_squared, SCALE * 0.16 / 3.0, 0.001);
            near(e.bias_squared, SCALE * 0.0025, 0.0005);
            near(e.rel_mse, e.bias_squared + e.noise_squared, 1e-12);
            near(e.bias[1], 0.05, 0.002);
            assert!(e.bias_is_seen(), "{e:?}");
        }
    }

    #[test]
    fn noise_alone_is_no_bias() {
        for seeds in [2, 3, 8] {
            let e = errors(1.0, 0.4, seeds);
            // The noise left in the mean of the seeds is a hundred times the standard error.
            assert!(e.bias_squared.abs() < 4.0 * e.bias_squared_error, "{e:?}");
            assert!(e.bias_squared_error < 0.01 * e.noise_squared, "{e:?}");
            assert!(e.bias_bound() < 0.05, "{e:?}");
        }
    }

    #[test]
    fn bias_alone_is_no_noise() {
        let e = errors(1.1, 0.0, 3);
        assert_eq!(e.noise_squared, 0.0);
        near(e.bias_squared, SCALE * 0.01, 0.001);
        near(e.error(), 0.1, 0.005);
    }

    /// The standard error says how far estimates of the same bias are from each other.
    #[test]
    fn standard_error_of_the_bias_is_right() {
        let runs: Vec<SeedErrors> = (0..40u64)
            .map(|run| {
                let picture = |k: u64| noisy(1.0, 0.3, 64, 100 * run + k);
                seed_errors(&[picture(1), picture(2), picture(3)], &[picture(4), picture(5)]).unwrap()
            })
            .collect();
        let rms = |f: &dyn Fn(&SeedErrors) -> f64| (runs.iter().map(|e| f(e).powi(2)).sum::<f64>() / 40.0).sqrt();
        let ratio = rms(&|e| e.bias_squared) / rms(&|e| e.bias_squared_error);
        assert!((0.7..1.4).contains(&ratio), "{ratio}");
    }

    /// The mean relMSE of single pictures is the same figure, where the references are even.
    #[test]
    fn sum_is_the_mean_of_the_single_pictures() {
        let references = [noisy(1.0, 0.0, 64, 1), noisy(1.1, 0.0, 64, 2)];
        let pictures: Vec<_> = (3..7).map(|seed| noisy(1.05, 0.2, 64, seed)).collect();
        let single = |p| compare_to_two(p, [&references[0], &references[1]]).unwrap().rel_mse;
        let mean = pictures.iter().map(single).sum::<f64>() / 4.0;
        near(seed_errors(&pictures, &references).unwrap().rel_mse, mean, 1e-6);
    }

    /// In the dark a reference's noise exceeds its light.
    #[test]
    fn noise_of_dark_references_is_no_error() {
        let dark = |seed| {
            let mut p = noisy(0.1, 0.2, 128, seed);
            p.pixels[..128 * 64].fill([2.0; 4]);
            p
        };
        let a = || {
            let mut p = noisy(0.1, 0.0, 128, 0);
            p.pixels[..128 * 64].fill([2.0; 4]);
            p
        };
        let e = seed_errors(&[a(), a()], &[dark(1), dark(2)]).unwrap();
        assert!(e.bias_squared.abs() < 3.0 * e.bias_squared_error && e.bias_squared_error < 0.01, "{e:?}");
    }

    #[test]
    fn what_has_no_error_is_refused() {
        let [grey, black] = [1.0, 0.0].map(|v| Picture::filled(9, 9, [v; 4]));
        let pair = |p: &Picture| [p.clone(), p.clone()];
        assert!(seed_errors(&pair(&grey), &pair(&grey)).unwrap().error() == 0.0);
        assert!(seed_errors(&pair(&grey), &pair(&black)).is_err());
        assert!(seed_errors(&pair(&grey)[..1], &pair(&grey)).is_err());
        assert!(seed_errors(&[grey.clone(), Picture::filled(8, 9, [1.0; 4])], &pair(&grey)).is_err());
    }
}
