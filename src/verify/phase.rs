//! The phase function on the device: density and sampler against closed forms in double precision.

use super::Bench;
use crate::Result;
use crate::cpu::rng;
use crate::passes::phase_probe::PhaseProbe;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Mean cosines from end to end of the range.
pub const RANGE: [f32; 9] = [-0.999, -0.9, -0.5, -1e-6, 0.0, 1e-6, 0.5, 0.9, 0.999];

/// Points of the integrals, and samples of each distribution.
const POINTS: usize = 1 << 16;
/// Bins of equal probability.
const BINS: usize = 64;
/// Standard deviations of a normal distribution that chi-square may reach, and how often chance takes it further.
const CHI_SIGMAS: f64 = 5.0;

/// Largest relative error of the density. Vulkan allows a division 2.5 ulp and a square root 4.5 (by its inverse);
/// the other operations, rounded correctly, add 4.5, those before the power 3/2 counted one and a half times.
pub const DENSITY_ERROR: f64 = 1.5e-6;

const DENSITY: &str = "12 ulp of single precision: what Vulkan allows the division, the square root and the products";
const MEAN_COSINE: &str = "those 12 ulp of the mean cosine, and 5e-7: the density near 1/4π is stored in steps of 8e-9";
const CHI_SQUARE: &str = "5 standard deviations above the 63 degrees of freedom: chance exceeds it once in 3.5 million";
const SAMPLED_MEAN: &str =
    "5 standard errors, √((1 − g²)/3) each over √65,536 samples: exceeded about once in 2 million";

/// Henyey-Greenstein [1/sr] in double precision, without cancellation for |g| near 1.
pub fn density(g: f64, cosine: f64) -> f64 {
    let a = g.abs();
    let d = (1.0 - a).powi(2) + 2.0 * a * (1.0 - g.signum() * cosine);
    (1.0 - a) * (1.0 + a) / (4.0 * PI * d * d.sqrt())
}

/// 1 − cosine below which the share 1 − `xi` of the scattered light stays, in full relative precision: the inverse
/// distribution function, rearranged.
pub fn one_minus_cosine(g: f64, xi: f64) -> f64 {
    2.0 * (1.0 - xi) * (1.0 - g).powi(2) * (1.0 + g * xi) / (1.0 - g + 2.0 * g * xi).powi(2)
}

/// `n` cosines, each of which stands for the share 1/n of the scattered light.
pub fn quantiles(g: f32, n: usize) -> Vec<f32> {
    let cosine = |i: usize| {
        let (xi, g) = ((i as f64 + 0.5) / n as f64, f64::from(g));
        // 1 + cosine is 1 − cosine of the mirrored distribution.
        let (less, more) = (one_minus_cosine(g, xi), one_minus_cosine(-g, 1.0 - xi));
        if less < more { 1.0 - less } else { more - 1.0 }
    };
    (0..n).map(|i| cosine(i) as f32).collect()
}

/// ∫ p f dω of a density p that was evaluated at [`quantiles`] of `g`: the mean of p over the exact density, times f.
pub fn integral(g: f32, cosines: &[f32], densities: &[f32], f: impl Fn(f64) -> f64) -> f64 {
    let term = |(&c, &p): (&f32, &f32)| f64::from(p) / density(g.into(), c.into()) * f(c.into());
    cosines.iter().zip(densities).map(term).sum::<f64>() / cosines.len() as f64
}

/// 1 − |cosine| on the side of the peak, from the vectors, in full relative precision: |after ∓ before|²/2.
fn deviation(g: f32, before: Vec3, after: Vec3) -> f64 {
    let forward = if g < 0.0 { -before } else { before };
    (after.as_dvec3() - forward.as_dvec3()).length_squared() / 2.0
}

/// Upper bound of χ² with `bins − 1` degrees of freedom (Wilson and Hilferty 1931).
fn chi_square_limit(bins: usize) -> f64 {
    let k = (bins - 1) as f64;
    let v = 2.0 / (9.0 * k);
    k * (1.0 - v + CHI_SIGMAS * v.sqrt()).powi(3)
}

fn chi_square(counts: &[u32]) -> f64 {
    let n: u32 = counts.iter().sum();
    let expected = f64::from(n) / counts.len() as f64;
    counts.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum()
}

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    let probe = PhaseProbe::new(bench.ctx)?;
    let befores = [
        ("+z", Vec3::Z),
        ("-z", -Vec3::Z),
        ("oblique", Vec3::new(0.48, -0.6, 0.64).normalize()),
        // Where the construction of a frame around it divides by little.
        ("almost -z", Vec3::new(1e-3, 2e-3, -1.0).normalize()),
    ];
    // One bound for the upper tail; χ² cannot be below 0.
    let (freedom, limit) = ((BINS - 1) as f64, chi_square_limit(BINS));
    for (i, g) in RANGE.into_iter().enumerate() {
        let cosines = quantiles(g, POINTS);
        for (k, (name, before)) in befores.into_iter().enumerate() {
            let words: Vec<u32> = bench.words((befores.len() * i + k) as u32, 2 * POINTS).collect();
            let randoms: Vec<[f32; 2]> = words.chunks(2).map(|w| [w[0], w[1]].map(rng::unit_float)).collect();
            let (densities, after) = probe.evaluate(bench.ctx, g, before, &cosines, &randoms)?;
            if k == 0 {
                let exact = f64::from(g);
                let total = integral(g, &cosines, &densities, |_| 1.0);
                bench.check(format!("g {g}: integral"), total, 1.0, DENSITY_ERROR, DENSITY);
                let mean = integral(g, &cosines, &densities, |c| c);
                let tolerance = DENSITY_ERROR * exact.abs() + 5e-7;
                bench.check(format!("g {g}: mean cosine"), mean, exact, tolerance, MEAN_COSINE);
                let error = |(&c, &p): (&f32, &f32)| (f64::from(p) / density(exact, c.into()) - 1.0).abs();
                // By hand, since f64::max drops NaN.
                let worse = |a: f64, b: f64| if b <= a { a } else { b };
                let worst = cosines.iter().zip(&densities).map(error).fold(0.0, worse);
                bench.check(format!("g {g}: largest relative error"), worst, 0.0, DENSITY_ERROR, DENSITY);
            }
            let case = |what: &str| format!("g {g}, from {name}: {what}");
            let (polar, around, deviation) = tally(g, before, &after);
            bench.check(case("chi-square of cosines"), polar, freedom, limit - freedom, CHI_SQUARE);
            bench.check(case("chi-square of azimuths"), around, freedom, limit - freedom, CHI_SQUARE);
            let (g, n) = (f64::from(g), POINTS as f64);
            let sigma = ((1.0 - g * g) / 3.0 / n).sqrt();
            let mean = if g < 0.0 { deviation - 1.0 } else { 1.0 - deviation };
            bench.check(case("mean sampled cosine"), mean, g, 5.0 * sigma, SAMPLED_MEAN);
        }
    }
    Ok(())
}

/// χ² of the cosines and of the azimuths of sampled directions, and their mean [`deviation`]. A direction that is no
/// number makes the mean NaN.
fn tally(g: f32, before: Vec3, after: &[Vec3]) -> (f64, f64, f64) {
    let size = f64::from(g).abs();
    let edges: Vec<f64> = (1..BINS).rev().map(|k| one_minus_cosine(size, k as f64 / BINS as f64)).collect();
    let axis = before.as_dvec3();
    let a = axis.cross(if axis.x.abs() < 0.5 { DVec3::X } else { DVec3::Y }).normalize();
    let b = axis.cross(a);
    let (mut polar, mut around, mut sum) = ([0u32; BINS], [0u32; BINS], 0.0);
    for &v in after {
        let d = deviation(g, before, v);
        polar[edges.partition_point(|&e| e <= d)] += 1;
        let turn = v.as_dvec3().dot(b).atan2(v.as_dvec3().dot(a)) / (2.0 * PI) + 0.5;
        around[((turn * BINS as f64) as usize).min(BINS - 1)] += 1;
        sum += d;
    }
    (chi_square(&polar), chi_square(&around), sum / after.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_invert_the_density() {
        for g in [-0.999, -0.5, 0.0, 1e-6, 0.9] {
            // dξ = 2π p dc, by the difference of neighbouring quantiles.
            let h = 1e-4;
            for xi in [0.1, 0.5, 0.8] {
                let c = 1.0 - one_minus_cosine(g, xi);
                let slope = (one_minus_cosine(g, xi - h) - one_minus_cosine(g, xi + h)) / (2.0 * h);
                let product = 2.0 * PI * density(g, c) * slope;
                assert!((product - 1.0).abs() < 1e-4, "g {g}, {xi}: {product}");
            }
        }
    }

    #[test]
    fn a_wrong_sampler_is_noticed() {
        // The sampler of another g, by the distribution's own tally.
        let sample = |g: f32| -> Vec<Vec3> {
            let u = |i: u32, n: u32| rng::random_float(rng::stream_key(i, 1, 2, 3), n);
            (0..1 << 16).map(|i| crate::cpu::sphere::sample_hg(g, Vec3::Z, [u(i, 0), u(i, 1)])).collect()
        };
        let limit = chi_square_limit(BINS);
        assert!((limit - 136.3).abs() < 0.1, "{limit}");
        for (g, wrong) in [(0.9, 0.91), (0.0, 0.02), (-0.999, -0.9991)] {
            let (polar, around, _) = tally(g, Vec3::Z, &sample(g));
            assert!(polar < limit && around < limit, "{g}: {polar} {around}");
            assert!(tally(wrong, Vec3::Z, &sample(g)).0 > limit, "{g} passes for {wrong}");
        }
        let squeezed: Vec<Vec3> = sample(0.5).into_iter().map(|v| Vec3::new(v.x, 0.9 * v.y, v.z)).collect();
        assert!(tally(0.5, Vec3::Z, &squeezed).1 > limit);
    }
}
