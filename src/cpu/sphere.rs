//! Twin of `include/sphere.glsl`.

use glam::Vec3;
use std::f32::consts::PI;

/// `x` modulo 1.
pub(super) fn fract(x: f32) -> f32 {
    x - x.floor()
}

/// The direction of two numbers in [0, 1): uniform on the sphere where they are uniform.
pub fn sphere_direction(u: f32, v: f32) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = 2.0 * PI * v;
    Vec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// The i-th of n points, spread evenly over the unit square, shifted by two numbers in [0, 1).
pub fn lattice_point(i: u32, n: u32, shift: [f32; 2]) -> [f32; 2] {
    [fract((i as f32 + 0.5) / n as f32 + shift[0]), fract(i as f32 * 0.618_034 + shift[1])]
}

/// The i-th of n directions, spread evenly over the sphere.
pub fn lattice_direction(i: u32, n: u32, shift: [f32; 2]) -> Vec3 {
    let [u, v] = lattice_point(i, n, shift);
    sphere_direction(u, v)
}

/// Henyey-Greenstein [1/sr]; `cosine` between the propagation directions before and after.
pub fn phase_hg(g: f32, cosine: f32) -> f32 {
    // In double precision, where the usual formula needs no care.
    let (g, c) = (f64::from(g), f64::from(cosine));
    ((1.0 - g * g) / (4.0 * std::f64::consts::PI * (1.0 + g * g - 2.0 * g * c).powf(1.5))) as f32
}

/// A direction after scattering, distributed as [`phase_hg`].
pub fn sample_hg(g: f32, before: Vec3, u: [f32; 2]) -> Vec3 {
    let a = g.abs();
    let t = if g < 0.0 { 1.0 - u[0] } else { u[0] };
    let d = 1.0 - a + 2.0 * a * t;
    let less = 2.0 * (1.0 - t) * (1.0 - a) * (1.0 - a) * (1.0 + a * t) / (d * d);
    let more = 2.0 * t * (1.0 + a) * (1.0 + a) * (1.0 - a + a * t) / (d * d);
    let towards_peak = if less < more { 1.0 - less } else { more - 1.0 };
    let cosine = if g < 0.0 { -towards_peak } else { towards_peak };
    let sine = (less * more).max(0.0).sqrt();
    let phi = 2.0 * PI * u[1];
    // Duff et al. 2017.
    let s = if before.z < 0.0 { -1.0 } else { 1.0 };
    let c = -1.0 / (s + before.z);
    let e = before.x * before.y * c;
    let x = Vec3::new(1.0 + s * before.x * before.x * c, s * e, -s * before.x);
    let y = Vec3::new(e, s + before.y * before.y * c, -before.y);
    (before * cosine + (x * phi.cos() + y * phi.sin()) * sine).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values and uncertainties: closed forms of the phase function, DESIGN section 1.
    #[test]
    fn phase_function_is_normalised_with_mean_cosine_g() {
        for g in [-0.9f32, -0.5, 0.0, 1e-6, 0.5, 0.9] {
            // Midpoint rule in the cosine.
            let n = 200_000;
            let (mut sum, mut mean) = (0.0f64, 0.0f64);
            for i in 0..n {
                let c = (i as f64 + 0.5) / n as f64 * 2.0 - 1.0;
                let p = f64::from(phase_hg(g, c as f32)) * 2.0 * std::f64::consts::PI * 2.0 / n as f64;
                sum += p;
                mean += p * c;
            }
            assert!((sum - 1.0).abs() < 1e-5 && (mean - f64::from(g)).abs() < 1e-5, "g = {g}: {sum} {mean}");
        }
    }

    #[test]
    fn lattice_integrates_low_polynomials() {
        // Even in z and around it: ∫ z² = 1/3, ∫ x = 0.
        let n = 64;
        let directions: Vec<Vec3> = (0..n).map(|i| lattice_direction(i, n, [0.3, 0.8])).collect();
        let mean = |f: &dyn Fn(&Vec3) -> f32| directions.iter().map(f).sum::<f32>() / n as f32;
        assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
        assert!((mean(&|d| d.z * d.z) - 1.0 / 3.0).abs() < 0.01);
        assert!((mean(&|d| d.x * d.x) - 1.0 / 3.0).abs() < 0.02);
        assert!(mean(&|d| d.x).abs() < 0.02 && mean(&|d| d.z).abs() < 0.02);
    }
}
