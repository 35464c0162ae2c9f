//! Error metrics of linear pictures (DESIGN section 5): no exposure, no tone mapping. Signed errors (bias) and noise
//! are told apart: bias is what is left when independent seeds are averaged.
//!
//! Colour is taken premultiplied by alpha. In every function `a` is the picture under test and `b` the reference.

use serde::Serialize;

use crate::output::Picture;
use crate::{Error, Result};

/// Edge of the blocks of block bias and z-test, in pixels. Blocks at the right and lower border may be smaller.
pub const BLOCK: usize = 8;

/// How far a picture is from a reference. Relative figures are infinite or NaN where the reference is black.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Metrics {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Root mean square of a − b over pixels and RGB, in radiance.
    pub rmse: f64,
    /// mean((a−b)² / (b² + ε)) over pixels and RGB, ε = 0.01·mean(b)², the mean over pixels and RGB.
    pub rel_mse: f64,
    /// mean(a−b) / mean(b) of R, G and B.
    pub bias: [f64; 3],
    /// See [`block_bias`].
    pub block_bias: f64,
    /// 10·log₁₀(max(b)² / rmse²) in dB; infinite for equal pictures.
    pub psnr: f64,
    /// Greatest |a − b| of a pixel's RGB.
    pub max_difference: f64,
    /// Root mean square of the difference of alpha.
    pub alpha_rmse: f64,
}

fn check_sizes(a: &Picture, b: &Picture) -> Result<()> {
    if (a.width, a.height) == (b.width, b.height) {
        return Ok(());
    }
    Err(Error::input(
        "compare",
        format!("the pictures differ in size: {}x{} and {}x{}", a.width, a.height, b.width, b.height),
        "render all with the same --size",
    ))
}

/// All metrics of `a` against two references with independent noise, of the same expectation: their noise is no part of
/// RMSE, relMSE and PSNR, since E (a−b₁)(a−b₂) = E (a−E b)². Everything else refers to their mean. An error if sizes differ.
pub fn compare_to_two(a: &Picture, references: [&Picture; 2]) -> Result<Metrics> {
    let [b1, b2] = references;
    check_sizes(a, b1)?;
    check_sizes(a, b2)?;
    let mut b = b1.clone();
    for (p, q) in b.pixels.iter_mut().zip(&b2.pixels) {
        *p = std::array::from_fn(|c| 0.5 * (p[c] + q[c]));
    }
    let metrics = compare(a, &b)?;
    let pictures = [a, b1, b2, &b];
    let values =
        || (0..a.pixels.len()).flat_map(move |i| (0..3).map(move |c| pictures.map(|p| f64::from(p.pixels[i][c]))));
    let count = 3.0 * a.pixels.len() as f64;
    let epsilon = 0.01 * (values().map(|[.., b]| b).sum::<f64>() / count).powi(2);
    let square = |[a, b1, b2, _]: [f64; 4]| (a - b1) * (a - b2);
    let relative = |v: [f64; 4]| if square(v) == 0.0 { 0.0 } else { square(v) / (v[3] * v[3] + epsilon) };
    // By chance the estimate may be negative.
    let mse = (values().map(square).sum::<f64>() / count).max(0.0);
    let max_b = values().map(|[.., b]| b).fold(0.0, f64::max);
    Ok(Metrics {
        rmse: mse.sqrt(),
        rel_mse: values().map(relative).sum::<f64>() / count,
        psnr: psnr(max_b, mse),
        ..metrics
    })
}

fn psnr(max_b: f64, mse: f64) -> f64 {
    if mse == 0.0 { f64::INFINITY } else { 10.0 * (max_b * max_b / mse).log10() }
}

/// All metrics of `a` against the reference `b`; an error if their sizes differ.
pub fn compare(a: &Picture, b: &Picture) -> Result<Metrics> {
    check_sizes(a, b)?;
    let pairs = || a.pixels.iter().zip(&b.pixels);
    let channels = || pairs().flat_map(|(a, b)| (0..3).map(|c| (f64::from(a[c]), f64::from(b[c]))));
    let pixels = a.pixels.len() as f64;
    let values = 3.0 * pixels;

    let mean_b = channels().map(|(_, b)| b).sum::<f64>() / values;
    let epsilon = 0.01 * mean_b * mean_b;
    let mse = channels().map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / values;
    let max_b = channels().map(|(_, b)| b).fold(0.0, f64::max);
    // A zero difference is no error even where b² + ε is zero (an entirely black reference).
    let relative = |(a, b): (f64, f64)| if a == b { 0.0 } else { (a - b) * (a - b) / (b * b + epsilon) };
    let bias = |c: usize| {
        let difference: f64 = pairs().map(|(a, b)| f64::from(a[c]) - f64::from(b[c])).sum();
        let total: f64 = pairs().map(|(_, b)| f64::from(b[c])).sum();
        if difference == 0.0 { 0.0 } else { difference / total }
    };
    let alpha_mse = pairs().map(|(a, b)| (f64::from(a[3]) - f64::from(b[3])).powi(2)).sum::<f64>() / pixels;
    Ok(Metrics {
        size: [a.width, a.height],
        rmse: mse.sqrt(),
        rel_mse: channels().map(relative).sum::<f64>() / values,
        bias: [bias(0), bias(1), bias(2)],
        block_bias: block_bias(a, b),
        psnr: psnr(max_b, mse),
        max_difference: channels().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
        alpha_rmse: alpha_mse.sqrt(),
    })
}

/// Mean |a − b| of 8×8 blocks without the part that is noise, relative to the mean of `b`, over covered pixels (those
/// that are not black in both).
///
/// |mean difference of a block| would count noise as bias. Instead each block's covered pixels are split like a
/// chessboard into two halves with mean differences d₁ and d₂, and a block counts with
/// ½(sign(d₁)·d₂ + sign(d₂)·d₁), weighted by its covered pixels, per channel. If the noise of the halves is independent
/// then E[sign(d₁)·d₂] = μ·(2Φ(μ/s) − 1) for a block bias μ and noise s of d₁: zero where there is no bias, |μ| where bias
/// exceeds noise, and in between too low, never too high. Noise that neighbouring pixels share (the voxel noise of a
/// cached method) is not told apart from bias here; average seeds, or use [`block_z_scores`].
pub fn block_bias(a: &Picture, b: &Picture) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height), "block_bias needs pictures of equal size");
    let mut weighted = 0.0;
    let mut total_b = 0.0;
    for block in blocks(a.width, a.height) {
        // Sums over the white and the black fields of the chessboard.
        let mut count = [0.0; 2];
        let mut difference = [[0.0; 3]; 2];
        for (x, y, i) in block.pixels() {
            let (pa, pb) = (a.pixels[i], b.pixels[i]);
            if pa[..3].iter().chain(&pb[..3]).all(|&v| v == 0.0) {
                continue;
            }
            let field = (x + y) % 2;
            count[field] += 1.0;
            for c in 0..3 {
                difference[field][c] += f64::from(pa[c]) - f64::from(pb[c]);
                total_b += f64::from(pb[c]);
            }
        }
        if count[0] == 0.0 || count[1] == 0.0 {
            continue;
        }
        for (sum1, sum2) in difference[0].iter().zip(&difference[1]) {
            let (d1, d2) = (sum1 / count[0], sum2 / count[1]);
            weighted += (count[0] + count[1]) * 0.5 * (sign(d1) * d2 + sign(d2) * d1);
        }
    }
    if weighted == 0.0 { 0.0 } else { weighted / total_b }
}

/// Sign with sign(0) = 0, which `f64::signum` lacks.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// Outcome of [`block_z_scores`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockTest {
    /// Blocks that are not black in all pictures; only these are tested.
    pub blocks: usize,
    /// Greatest |z|.
    pub max_abs_z: f64,
    /// Column and row of the block it belongs to, in blocks.
    pub worst_block: [usize; 2],
    /// Root mean square of z: near 1 if the means agree.
    pub rms_z: f64,
    /// Greatest standard error of a block's difference, relative to that block's mean.
    pub max_standard_error_relative: f64,
    /// Mean difference of all tested blocks, relative to their mean: the overall bias of `a` against `b`.
    pub mean_difference_relative: f64,
}

/// Do two sets of pictures, each rendered with different seeds, have the same expectation? Per 8×8 block the mean over
/// pixels and RGB is one sample of a seed, and
/// z = (mean(a) − mean(b)) / √(var(a)/nₐ + var(b)/n_b) (Welch). Seeds are independent, so noise that pixels share is
/// treated rightly. With 64 seeds each, |z| > 4 happens by chance in one block of about 10,000: keep the pictures small.
///
/// The standard error has a floor of one f32 rounding of the mean, for blocks without any noise.
///
/// # Panics
/// If a set has fewer than two pictures or sizes differ.
pub fn block_z_scores(a: &[Picture], b: &[Picture]) -> BlockTest {
    assert!(a.len() >= 2 && b.len() >= 2, "block_z_scores needs at least two seeds of each");
    let (width, height) = (a[0].width, a[0].height);
    assert!(a.iter().chain(b).all(|p| (p.width, p.height) == (width, height)), "pictures differ in size");

    let mut test = BlockTest {
        blocks: 0,
        max_abs_z: 0.0,
        worst_block: [0, 0],
        rms_z: 0.0,
        max_standard_error_relative: 0.0,
        mean_difference_relative: 0.0,
    };
    let mut sum_difference = 0.0;
    let mut sum_mean = 0.0;
    for block in blocks(width, height) {
        let samples = |set: &[Picture]| set.iter().map(|p| block.mean(p)).collect::<Vec<_>>();
        let (samples_a, samples_b) = (samples(a), samples(b));
        if samples_a.iter().chain(&samples_b).all(|&v| v == 0.0) {
            continue;
        }
        let (mean_a, error_a) = mean_and_squared_error(&samples_a);
        let (mean_b, error_b) = mean_and_squared_error(&samples_b);
        let mean = 0.5 * (mean_a + mean_b).abs();
        let error = (error_a + error_b).sqrt().max(f64::from(f32::EPSILON) * mean);
        let z = (mean_a - mean_b) / error;
        test.blocks += 1;
        if z.abs() > test.max_abs_z {
            test.max_abs_z = z.abs();
            test.worst_block = [block.x / BLOCK, block.y / BLOCK];
        }
        test.rms_z += z * z;
        test.max_standard_error_relative = test.max_standard_error_relative.max(error / mean);
        sum_difference += mean_a - mean_b;
        sum_mean += mean_b;
    }
    if test.blocks > 0 {
        test.rms_z = (test.rms_z / test.blocks as f64).sqrt();
        test.mean_difference_relative = sum_difference / sum_mean;
    }
    test
}

/// Mean, and squared standard error of the mean.
fn mean_and_squared_error(samples: &[f64]) -> (f64, f64) {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let variance = samples.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (n - 1.0);
    (mean, variance / n)
}

/// A block of at most 8×8 pixels.
pub(super) struct Block {
    x: usize,
    y: usize,
    x_end: usize,
    y_end: usize,
    picture_width: usize,
}

impl Block {
    /// Column, row and index of its pixels.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        (self.y..self.y_end).flat_map(move |y| (self.x..self.x_end).map(move |x| (x, y, y * self.picture_width + x)))
    }

    /// Mean over its pixels and RGB.
    fn mean(&self, picture: &Picture) -> f64 {
        let pixel = |i: usize| picture.pixels[i][..3].iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
        let count = (self.x_end - self.x) * (self.y_end - self.y);
        self.pixels().map(|(_, _, i)| pixel(i)).sum::<f64>() / count as f64
    }
}

/// The blocks of a picture, row by row.
pub(super) fn blocks(width: u32, height: u32) -> impl Iterator<Item = Block> {
    let (width, height) = (width as usize, height as usize);
    (0..height).step_by(BLOCK).flat_map(move |y| {
        (0..width).step_by(BLOCK).map(move |x| Block {
            x,
            y,
            x_end: (x + BLOCK).min(width),
            y_end: (y + BLOCK).min(height),
            picture_width: width,
        })
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Numbers in [−1, 1) of a 64-bit linear congruential generator (Knuth's MMIX), variance 1/3.
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f32 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    pub(crate) fn noisy(base: f32, amplitude: f32, size: u32, seed: u64) -> Picture {
        let mut noise = Noise(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let mut picture = Picture::filled(size, size, [base, base, base, 1.0]);
        for v in picture.pixels.iter_mut().flat_map(|p| &mut p[..3]) {
            *v += amplitude * noise.next();
        }
        picture
    }

    fn near(value: f64, wanted: f64) {
        assert!((value - wanted).abs() <= 1e-6 * wanted.abs().max(1e-3), "{value} instead of {wanted}");
    }

    #[test]
    fn equal_pictures_have_no_error() {
        for radiance in [0.0, 0.5] {
            let a = Picture::filled(9, 5, [radiance, radiance, radiance, 1.0]);
            let m = compare(&a, &a).unwrap();
            assert_eq!((m.rmse, m.rel_mse, m.bias, m.block_bias), (0.0, 0.0, [0.0; 3], 0.0));
            assert_eq!(m.psnr, f64::INFINITY);
        }
    }

    #[test]
    fn constant_offset_has_the_analytic_metrics() {
        let b = Picture::filled(20, 13, [1.0, 2.0, 3.0, 1.0]);
        let a = Picture::filled(20, 13, [1.1, 2.0, 2.4, 0.5]);
        let m = compare(&a, &b).unwrap();
        let mse = (0.1f64.powi(2) + 0.6f64.powi(2)) / 3.0;
        near(m.rmse, mse.sqrt());
        let epsilon = 0.01 * 4.0;
        near(m.rel_mse, (0.01 / (1.0 + epsilon) + 0.36 / (9.0 + epsilon)) / 3.0);
        near(m.bias[0], 0.1);
        near(m.bias[1], 0.0);
        near(m.bias[2], -0.2);
        // Per channel |0.1| + |0| + |−0.6| against 1 + 2 + 3.
        near(m.block_bias, 0.7 / 6.0);
        near(m.psnr, 10.0 * (9.0 / mse).log10());
        near(m.max_difference, 0.6);
        near(m.alpha_rmse, 0.5);
    }

    /// The picture is off by 0.1 and has noise of variance 0.01/3; the references have nine times that.
    #[test]
    fn two_references_take_their_noise_out() {
        let a = noisy(1.1, 0.1, 256, 1);
        let [b1, b2] = [2, 3].map(|seed| noisy(1.0, 0.3, 256, seed));
        let wanted = 0.01 + 0.01 / 3.0;
        let two = compare_to_two(&a, [&b1, &b2]).unwrap();
        assert!((two.rmse.powi(2) - wanted).abs() < 0.02 * wanted, "{two:?}");
        assert!((two.bias[1] - 0.1).abs() < 0.003, "{two:?}");
        assert!(compare(&a, &b1).unwrap().rmse.powi(2) > 3.0 * wanted);
        // With the same picture twice it is the plain comparison.
        assert_eq!(compare_to_two(&a, [&b1, &b1]).unwrap(), compare(&a, &b1).unwrap());
        let other = Picture::filled(255, 256, [0.0; 4]);
        assert!(compare_to_two(&a, [&b1, &other]).is_err() && compare_to_two(&a, [&other, &b1]).is_err());
    }

    #[test]
    fn sizes_must_agree() {
        let error = compare(&Picture::filled(2, 3, [0.0; 4]), &Picture::filled(3, 2, [0.0; 4])).unwrap_err();
        assert!(error.to_string().contains("2x3 and 3x2"), "{error}");
    }

    #[test]
    fn signed_errors_cancel_in_bias_but_not_in_block_bias() {
        let b = Picture::filled(32, 32, [1.0, 1.0, 1.0, 1.0]);
        let mut a = b.clone();
        for (i, p) in a.pixels.iter_mut().enumerate() {
            let add = if i % 32 < 16 { 0.1 } else { -0.1 };
            *p = [1.0 + add, 1.0 + add, 1.0 + add, 1.0];
        }
        let m = compare(&a, &b).unwrap();
        assert!(m.bias[0].abs() < 1e-6);
        near(m.block_bias, 0.1);
    }

    #[test]
    fn block_bias_is_not_fooled_by_noise_and_finds_bias_in_noise() {
        // Noise of 0.3/√3 per pixel: the mean of 64 pixels has 0.022, so plain |block difference| would be 0.017.
        let b = Picture::filled(256, 256, [1.0, 1.0, 1.0, 1.0]);
        let unbiased = block_bias(&noisy(1.0, 0.3, 256, 1), &b);
        assert!(unbiased.abs() < 0.002, "{unbiased}");
        let biased = block_bias(&noisy(1.1, 0.3, 256, 2), &b);
        assert!((biased - 0.1).abs() < 0.003, "{biased}");
    }

    #[test]
    fn block_bias_is_over_covered_pixels_only() {
        let mut b = Picture::filled(32, 32, [0.0, 0.0, 0.0, 1.0]);
        let mut a = b.clone();
        for i in 0..16 * 32 {
            b.pixels[i] = [1.0, 1.0, 1.0, 1.0];
            a.pixels[i] = [1.25, 1.25, 1.25, 1.0];
        }
        near(block_bias(&a, &b), 0.25);
    }

    #[test]
    fn z_test_accepts_equal_means_and_rejects_a_small_bias() {
        let set = |base: f32, first: u64| (0..64).map(|s| noisy(base, 0.2, 64, first + s)).collect::<Vec<_>>();
        let same = block_z_scores(&set(1.0, 1), &set(1.0, 1000));
        assert_eq!(same.blocks, 64);
        assert!(same.max_abs_z < 4.0 && same.rms_z > 0.7 && same.rms_z < 1.3, "{same:?}");
        // Per value 0.2/√3, over 64 pixels × 3 channels × 64 seeds, two sets: 0.0015 (the greatest of 64 a bit more).
        let expected = 0.2 / 3f64.sqrt() / (64.0f64 * 3.0 * 64.0).sqrt() * 2f64.sqrt();
        assert!(same.max_standard_error_relative > expected, "{same:?}");
        assert!(same.max_standard_error_relative < 1.4 * expected, "{same:?}");

        let shifted = block_z_scores(&set(1.02, 1), &set(1.0, 1000));
        assert!(shifted.max_abs_z > 8.0, "{shifted:?}");
        assert!((shifted.mean_difference_relative - 0.02).abs() < 1e-3, "{shifted:?}");
    }

    #[test]
    fn z_test_finds_one_wrong_block_and_skips_black_ones() {
        let set = |first: u64| {
            let blacken = |mut p: Picture| {
                p.pixels[..16 * 20].fill([0.0; 4]);
                p
            };
            (0..16).map(|s| blacken(noisy(1.0, 0.2, 20, first + s))).collect::<Vec<_>>()
        };
        let (mut a, b) = (set(1), set(500));
        for picture in &mut a {
            for y in 16..20 {
                picture.pixels[y * 20 + 17][1] += 0.8;
            }
        }
        let test = block_z_scores(&a, &b);
        assert_eq!(test.blocks, 3);
        assert_eq!(test.worst_block, [2, 2]);
        assert!(test.max_abs_z > 6.0, "{test:?}");
    }

    #[test]
    fn z_test_of_noiseless_sets_tolerates_rounding_only() {
        let set = |v: f32| vec![Picture::filled(8, 8, [v, v, v, 1.0]); 2];
        assert!(block_z_scores(&set(1.0), &set(1.0 + f32::EPSILON)).max_abs_z <= 1.0);
        assert!(block_z_scores(&set(1.0), &set(1.0001)).max_abs_z > 100.0);
    }
}
