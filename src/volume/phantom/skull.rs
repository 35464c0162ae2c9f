//! The skull, and the head around it. Coordinates: 1 is half the skull's height; the chin is at z = −1, the crown at
//! z = 1, the face at y = −0.8. Both sides are alike, so the distances are taken at |x|.

use super::field::{Rod, carve, ellipsoid, fbm, inside, noise, rods, smooth_min, smoothstep};
use super::{Body, DISTANCE_ERROR};
use glam::{Vec3, vec3};

pub(super) const SKULL_LOW: Vec3 = Vec3::new(-0.74, -0.96, -1.04);
pub(super) const SKULL_HIGH: Vec3 = Vec3::new(0.74, 0.92, 1.02);

pub(super) const HEAD_LOW: Vec3 = Vec3::new(-0.83, -1.00, -1.58);
pub(super) const HEAD_HIGH: Vec3 = Vec3::new(0.83, 0.97, 1.09);

/// Width of the soft edges.
const EDGE: f32 = 0.022;

/// Thickness of the cranium.
const SHELL: f32 = 0.115;

/// The mandible's right half, from the chin up to the joint.
const JAW: [Rod; 6] = [
    Rod::new([0.0, -0.79, -0.92], 0.095, [0.17, -0.75, -0.92], 0.1),
    Rod::new([0.17, -0.75, -0.92], 0.1, [0.33, -0.50, -0.86], 0.085),
    Rod::new([0.33, -0.50, -0.86], 0.085, [0.48, -0.14, -0.74], 0.08),
    Rod::new([0.48, -0.12, -0.72], 0.075, [0.54, 0.01, -0.32], 0.055),
    Rod::new([0.46, -0.22, -0.72], 0.065, [0.50, -0.22, -0.36], 0.035),
    Rod::new([0.48, -0.17, -0.70], 0.065, [0.51, -0.10, -0.46], 0.05),
];

/// Cheek bone, its arch to the temple, and the brow.
const CHEEK: [Rod; 4] = [
    Rod::new([0.34, -0.68, -0.32], 0.07, [0.52, -0.54, -0.22], 0.075),
    Rod::new([0.52, -0.54, -0.22], 0.06, [0.63, -0.22, -0.22], 0.04),
    Rod::new([0.63, -0.22, -0.22], 0.04, [0.60, 0.04, -0.20], 0.05),
    Rod::new([0.50, -0.60, -0.20], 0.05, [0.50, -0.62, 0.04], 0.05),
];

/// The dental arch seen from above: an ellipse's front half.
const ARCH_CENTRE: (f32, f32) = (0.0, -0.40);
const ARCH_RADII: (f32, f32) = (0.265, 0.40);

/// Angle between neighbouring teeth, and how many there are on each side.
const TOOTH_STEP: f32 = 0.205;
const TEETH: f32 = 7.0;

/// Distances that the skull and the head share, at |x|.
struct Bones {
    /// Bone, hollow where a skull is.
    bone: f32,
    /// The brain's room.
    brain: f32,
    /// Teeth.
    teeth: f32,
}

fn cranium(p: Vec3, inset: f32) -> f32 {
    let back = ellipsoid(p, vec3(0.0, 0.10, 0.34), vec3(0.70, 0.78, 0.64) - inset);
    let front = ellipsoid(p, vec3(0.0, -0.26, 0.22), vec3(0.56, 0.51, 0.52) - inset);
    smooth_min(back, front, 0.22)
}

fn bones(p: Vec3) -> Bones {
    // Nothing of the face reaches up here.
    if p.z > 0.45 {
        let brain = cranium(p, SHELL);
        return Bones { bone: cranium(p, 0.0).max(-brain), brain, teeth: 1.0 };
    }
    // Eye sockets, ever narrower to the back and to the middle; a wall parts them from the brain.
    let socket = Rod::new([0.285, -0.86, -0.115], 0.19, [0.15, -0.36, -0.09], 0.06).distance(p);
    let brain = carve(cranium(p, SHELL), socket - 0.05, 0.05);
    let mut d = cranium(p, 0.0);
    // Temples, then the face in front of the cranium.
    d = carve(d, ellipsoid(p, vec3(0.74, -0.42, -0.06), vec3(0.19, 0.32, 0.32)), 0.10);
    let face = ellipsoid(p, vec3(0.0, -0.50, -0.30), vec3(0.41, 0.34, 0.38));
    d = smooth_min(d, face, 0.12);
    let upper_jaw = ellipsoid(p, vec3(0.0, -0.58, -0.56), vec3(0.29, 0.26, 0.12));
    d = smooth_min(d, upper_jaw, 0.06);
    let brow = Rod::new([0.07, -0.79, 0.05], 0.055, [0.46, -0.66, 0.07], 0.06).distance(p);
    d = smooth_min(d, brow, 0.10);
    d = smooth_min(d, rods(p, &CHEEK, 0.05, 1.0), 0.05);
    let mastoid = ellipsoid(p, vec3(0.52, 0.20, -0.30), vec3(0.09, 0.11, 0.19));
    d = smooth_min(d, mastoid, 0.08);

    d = d.max(-brain);
    d = carve(d, socket, 0.04);
    // The nose's opening: a pear; behind it the nasal room with its septum, beside it the sinuses.
    let nostril = Rod::new([0.055, 0.0, -0.42], 0.085, [0.02, 0.0, -0.20], 0.04);
    let nostril = nostril.distance(vec3(p.x, (p.y + 0.45).max(0.0), p.z));
    d = carve(d, nostril.max(0.012 - p.x), 0.02);
    let bridge = Rod::new([0.0, -0.80, 0.0], 0.055, [0.0, -0.93, -0.19], 0.035).distance(p);
    d = smooth_min(d, carve(bridge, nostril, 0.02), 0.04);
    d = carve(d, ellipsoid(p, vec3(0.22, -0.50, -0.40), vec3(0.10, 0.15, 0.12)), 0.03);
    // Where the spinal cord leaves, and the ear.
    d = carve(d, Rod::new([0.0, 0.22, -0.6], 0.13, [0.0, 0.2, -0.1], 0.13).distance(p), 0.04);
    d = carve(d, Rod::new([0.75, 0.09, -0.20], 0.05, [0.5, 0.05, -0.18], 0.03).distance(p), 0.03);

    d = d.min(rods(p, &JAW, 0.05, 1.0));
    let gum = Rod::new([0.10, -0.78, -0.87], 0.05, [0.27, -0.47, -0.83], 0.05).distance(p);
    d = smooth_min(d, gum, 0.05);
    Bones { bone: d, brain, teeth: teeth(p) }
}

fn teeth(p: Vec3) -> f32 {
    // Far from the rows only the sign matters.
    if (p.z + 0.74).abs() > 0.25 || p.y > -0.25 {
        return 0.2;
    }
    let (x, y) = ((p.x - ARCH_CENTRE.0) / ARCH_RADII.0, (ARCH_CENTRE.1 - p.y) / ARCH_RADII.1);
    let number = (x.atan2(y) / TOOTH_STEP).floor().clamp(0.0, TEETH - 1.0);
    let (sin, cos) = ((number + 0.5) * TOOTH_STEP).sin_cos();
    let foot = vec3(ARCH_CENTRE.0 + ARCH_RADII.0 * sin, ARCH_CENTRE.1 - ARCH_RADII.1 * cos, 0.0);
    // Incisors are narrow and long, molars wide and short.
    let (radius, length) = (0.026 + 0.002 * number, 0.085 - 0.004 * number);
    let row = |crown: f32, root: f32| {
        let q = p - foot;
        Rod::new([0.0, 0.0, crown], radius, [0.0, 0.0, root], 0.8 * radius).distance(q)
    };
    row(-0.755 + length, -0.58).min(row(-0.755 + 0.02 - radius, -0.755 + 0.02 - radius)).min(row(-0.79, -0.90))
}

/// Bone's density at a distance below its surface: dense outside, spongy within.
fn bone_density(p: Vec3, d: f32) -> f32 {
    let cortex = smoothstep(-0.045, -0.01, d);
    0.62 + 0.26 * cortex + 0.14 * fbm(p * 9.0, 3)
}

/// A skull: bone 0.5 to 0.9, teeth 1, hollow (0) inside.
pub(super) fn skull() -> Box<dyn Body> {
    Box::new(Skull)
}

struct Skull;

/// How far noise moves a surface at most.
const ROUGHNESS: f32 = 0.007;

impl Body for Skull {
    fn value(&self, p: Vec3) -> f32 {
        let bones = bones(vec3(p.x.abs(), p.y, p.z));
        if bones.bone.min(bones.teeth) > EDGE {
            return 0.0;
        }
        let d = bones.bone + ROUGHNESS * noise(p * 7.0);
        (inside(d, EDGE) * bone_density(p, d).min(0.92)).max(inside(bones.teeth, EDGE))
    }

    fn empty_within(&self, p: Vec3, radius: f32) -> bool {
        let bones = bones(vec3(p.x.abs(), p.y, p.z));
        bones.bone.min(bones.teeth) > DISTANCE_ERROR * radius + EDGE
    }
}

/// Neck and shoulders, at |x|.
const BUST: [Rod; 2] = [
    Rod::new([0.0, 0.20, -0.4], 0.50, [0.0, 0.12, -1.35], 0.53),
    Rod::new([0.0, 0.04, -1.60], 0.62, [1.0, 0.10, -1.72], 0.60),
];

/// Nose: bridge, tip and wing.
const NOSE: [Rod; 3] = [
    Rod::new([0.0, -0.79, -0.04], 0.07, [0.0, -0.90, -0.34], 0.072),
    Rod::new([0.0, -0.88, -0.36], 0.072, [0.07, -0.83, -0.39], 0.065),
    Rod::new([0.0, -0.80, -0.42], 0.08, [0.0, -0.84, -0.52], 0.06),
];

fn skin(p: Vec3) -> f32 {
    let back = ellipsoid(p, vec3(0.0, 0.10, 0.32), vec3(0.79, 0.86, 0.76));
    let front = ellipsoid(p, vec3(0.0, -0.24, 0.14), vec3(0.67, 0.64, 0.70));
    let mut d = smooth_min(back, front, 0.25);
    d = smooth_min(d, ellipsoid(p, vec3(0.0, -0.38, -0.42), vec3(0.59, 0.51, 0.57)), 0.20);
    d = smooth_min(d, ellipsoid(p, vec3(0.0, -0.72, -0.92), vec3(0.24, 0.18, 0.14)), 0.16);
    d = smooth_min(d, Rod::new([0.16, -0.70, -0.88], 0.17, [0.44, -0.16, -0.72], 0.18).distance(p), 0.12);
    d = smooth_min(d, ellipsoid(p, vec3(0.40, -0.54, -0.34), vec3(0.22, 0.22, 0.22)), 0.14);
    d = smooth_min(d, rods(p, &BUST, 0.25, 1.0), 0.12);
    // Eyes lie deep under the brow, their lids before them.
    d = carve(d, ellipsoid(p, vec3(0.29, -0.94, -0.10), vec3(0.19, 0.15, 0.10)), 0.14);
    d = smooth_min(d, ellipsoid(p, vec3(0.285, -0.71, -0.11), vec3(0.13, 0.13, 0.10)), 0.03);
    d = smooth_min(d, rods(p, &NOSE, 0.06, 1.0), 0.07);
    // Nostrils and lips.
    d = carve(d, ellipsoid(p, vec3(0.055, -0.90, -0.44), vec3(0.028, 0.06, 0.035)), 0.02);
    d = smooth_min(d, ellipsoid(p, vec3(0.0, -0.84, -0.62), vec3(0.19, 0.07, 0.035)), 0.05);
    d = smooth_min(d, ellipsoid(p, vec3(0.0, -0.83, -0.70), vec3(0.16, 0.07, 0.04)), 0.05);
    d = carve(d, ellipsoid(p, vec3(0.0, -0.93, -0.657), vec3(0.21, 0.06, 0.012)), 0.03);
    // Ears: a leaning shell.
    let ear = ellipsoid(p, vec3(0.76, 0.12, -0.12), vec3(0.06, 0.17, 0.25));
    let shell = carve(ear, ellipsoid(p, vec3(0.82, 0.07, -0.11), vec3(0.06, 0.10, 0.16)), 0.03);
    smooth_min(d, shell, 0.05)
}

/// A head with neck and shoulders: skin 0.3, fat and muscle 0.2 to 0.35, brain 0.42, bone 0.6 to 0.95, teeth 1.
pub(super) fn head() -> Box<dyn Body> {
    Box::new(Head)
}

struct Head;

/// Least thickness of the flesh over the bones.
const COVER: f32 = 0.05;

/// The spine and the airway from the nose down the throat.
const SPINE: Rod = Rod::new([0.0, 0.24, -0.42], 0.10, [0.0, 0.38, -1.7], 0.13);
const AIRWAY: [Rod; 2] = [
    Rod::new([0.0, -0.62, -0.36], 0.06, [0.0, -0.12, -0.40], 0.07),
    Rod::new([0.0, -0.12, -0.40], 0.07, [0.0, -0.08, -1.7], 0.07),
];

impl Body for Head {
    fn value(&self, p: Vec3) -> f32 {
        let side = vec3(p.x.abs(), p.y, p.z);
        let skin = skin(side);
        if skin > EDGE {
            return 0.0;
        }
        let fibre = fbm(vec3(5.0, 5.0, 2.5) * p, 3);
        let mut value = 0.28 + 0.08 * fibre;
        // The skin's own layer over the fat.
        value += 0.06 * smoothstep(-0.05, -0.02, skin) - 0.05 * inside((skin + 0.075).abs() - 0.02, 0.02);
        // Eyeballs, the spine with its discs, the airway.
        value = value.max(0.45 * inside(ellipsoid(side, vec3(0.285, -0.68, -0.11), Vec3::splat(0.115)), EDGE));
        if p.z < -0.3 {
            let spine = SPINE.distance(side) + 0.018 * (p.z * 42.0).sin();
            value = value.max(inside(spine, EDGE) * bone_density(p, spine).min(0.85));
            value *= 1.0 - inside(rods(side, &AIRWAY, 0.05, 1.0), EDGE);
        }
        // The skull sits a little behind the face and ends above the neck; flesh covers it everywhere.
        if p.z > -1.0 && skin < EDGE - COVER {
            let q = (side - vec3(0.0, 0.02, 0.02)) / 0.95;
            // In the middle of the brain there is no bone to look for.
            let deep = q.y > -0.2 && cranium(q, SHELL + 0.1) < 0.0;
            let bones = if deep { Bones { bone: 1.0, brain: -1.0, teeth: 1.0 } } else { bones(q) };
            // The brain's folds of grey over white, cut in halves.
            let room = inside(bones.brain + 0.02, EDGE);
            if room > 0.0 {
                let folds = smoothstep(0.02, 0.16, fbm(p * 5.5, 2).abs());
                let cleft = smoothstep(0.0, 0.02, side.x - 0.004);
                value += (0.30 + 0.14 * folds * cleft - value) * room;
            }
            let bone = bones.bone.max(skin + COVER);
            if bone < EDGE {
                value = value.max(inside(bone, EDGE) * bone_density(p, bone));
            }
            value = value.max(inside(bones.teeth.max(skin + COVER), EDGE));
        }
        value * inside(skin, EDGE)
    }

    fn empty_within(&self, p: Vec3, radius: f32) -> bool {
        skin(vec3(p.x.abs(), p.y, p.z)) > DISTANCE_ERROR * radius + EDGE
    }
}
