//! The cloud and the plain test bodies.

use super::Body;
use super::field::{Bins, bijection, fbm, inside, smoothstep, unit};
use glam::Vec3;

pub(super) const CLOUD_LOW: Vec3 = Vec3::new(-1.0, -0.8, -0.62);
pub(super) const CLOUD_HIGH: Vec3 = Vec3::new(1.0, 0.8, 0.72);

/// Height of the cloud's flat base.
const BASE: f32 = -0.48;

/// A cumulus: balls heaped on a flat base, their surface billowed by noise. The value is the droplets' density.
pub(super) fn cloud() -> Box<dyn Body> {
    // Balls lower and larger in the middle; a fixed sequence of hashes.
    let mut balls = Vec::new();
    for i in 0..70u32 {
        let u = |n: u32| unit(bijection(i * 8 + n + 3000));
        let angle = std::f32::consts::TAU * u(0);
        let away = u(1).sqrt();
        let radius = (0.40 - 0.20 * away) * (0.75 + 0.5 * u(2));
        let top = 0.85 * (1.0 - away * away) * (0.75 + 0.25 * (2.0 * angle).sin());
        let height = BASE + 0.45 * radius + u(3) * top.max(0.05);
        balls.push((Vec3::new(0.76 * away * angle.cos(), 0.56 * away * angle.sin(), height), radius));
    }
    let bins = Bins::new(CLOUD_LOW, CLOUD_HIGH, &balls, |&(centre, radius)| (centre - radius, centre + radius));
    Box::new(move |p: Vec3| {
        // Each ball adds a bump that ends smoothly at its radius.
        let bump = |&(centre, radius): &(Vec3, f32)| {
            let t = (1.0 - (p - centre).length_squared() / (radius * radius)).max(0.0);
            t * t
        };
        let heap: f32 = bins.near(p).iter().map(bump).sum();
        if heap <= 0.0 {
            return 0.0;
        }
        // Folded noise has round bumps and sharp valleys, as billows have. It moves the rim, not the core.
        let billow = fbm(p * 3.2, 2).abs() + 0.6 * fbm(p * 8.0 + 9.0, 4).abs();
        let shape = heap.min(0.9) - 0.42 + 0.62 * (billow - 0.33);
        let floor = smoothstep(BASE - 0.03, BASE + 0.08, p.z + 0.06 * fbm(p * 3.0, 2));
        smoothstep(0.0, 0.26, shape) * floor * (0.75 + 0.25 * smoothstep(-0.6, 0.6, fbm(p * 6.0 + 5.0, 3)))
    })
}

/// A ball of value 1 and radius 0.8 of the box's half size, with a soft edge.
pub(super) fn sphere() -> Box<dyn Body> {
    Box::new(|p: Vec3| inside(p.length() - 0.8, 0.08))
}

/// The same value everywhere.
pub(super) fn constant() -> Box<dyn Body> {
    Box::new(|_: Vec3| 0.5)
}

/// Three bars from one corner, of different lengths and values: no rotation and no mirror image of it is the same. The
/// bar along x has value 1, along y 0.7, along z 0.4.
pub(super) fn corner() -> Box<dyn Body> {
    let block = |p: Vec3, low: [f32; 3], high: [f32; 3]| p.cmpge(low.into()).all() && p.cmple(high.into()).all();
    Box::new(move |p: Vec3| {
        if block(p, [-0.8, -0.8, -0.8], [0.8, -0.5, -0.5]) {
            1.0
        } else if block(p, [-0.8, -0.8, -0.8], [-0.5, 0.4, -0.5]) {
            0.7
        } else if block(p, [-0.8, -0.8, -0.8], [-0.5, -0.5, 0.0]) {
            0.4
        } else {
            0.0
        }
    })
}
