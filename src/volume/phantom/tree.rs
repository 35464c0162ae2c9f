//! A broad-leaved tree: a branching skeleton of rods with leaves in balls around its twigs.

use super::Body;
use super::field::{Bins, Rod, bijection, fbm, inside, noise, rods, smoothstep, unit};
use glam::{Quat, Vec3, vec3};
use std::f32::consts::TAU;

/// Width of the wood's soft edge.
const EDGE: f32 = 0.016;

/// Size of the fillets between branches.
const FILLET: f32 = 0.03;

/// Generations of branches, the trunk being 0; leaves grow from `FIRST_LEAVES` on.
const GENERATIONS: u32 = 5;
const FIRST_LEAVES: u32 = 4;

/// Share of a ball's radius to which its leaves reach, but for single tips.
const LEAF_REACH: f32 = 0.9;

/// Chosen for a well-balanced crown.
const SEED: u32 = 400;

/// Numbers in 0 to below 1, the same in every run.
struct Dice(u32);

impl Dice {
    fn next(&mut self) -> f32 {
        self.0 += 1;
        unit(bijection(self.0))
    }
}

/// A branch before it is fitted into the box.
struct Branch {
    from: Vec3,
    to: Vec3,
    from_radius: f32,
    to_radius: f32,
}

struct Skeleton {
    branches: Vec<Branch>,
    /// Centre and radius of each ball of leaves.
    leaves: Vec<(Vec3, f32)>,
    dice: Dice,
}

impl Skeleton {
    fn grow(&mut self, from: Vec3, direction: Vec3, length: f32, radius: f32, generation: u32) {
        // A bend in the middle, so that no branch is straight.
        let wobble = |dice: &mut Dice| vec3(dice.next() - 0.5, dice.next() - 0.5, 0.6 * (dice.next() - 0.5));
        let middle = from + 0.5 * length * (direction + 0.25 * wobble(&mut self.dice)).normalize();
        let to = middle + 0.5 * length * (direction + 0.35 * wobble(&mut self.dice)).normalize();
        let end_radius = 0.66 * radius;
        let middle_radius = 0.82 * radius;
        self.branches.push(Branch { from, to: middle, from_radius: radius, to_radius: middle_radius });
        self.branches.push(Branch { from: middle, to, from_radius: middle_radius, to_radius: end_radius });
        if generation >= FIRST_LEAVES {
            self.leaves.push((to, 0.245 + 0.08 * self.dice.next()));
        }
        if generation == GENERATIONS {
            return;
        }
        let children = if generation == 0 { 5 } else { 3 };
        let turn = self.dice.next();
        let (across, _) = direction.any_orthonormal_pair();
        for child in 0..children {
            let azimuth = TAU * (turn + (child as f32 + 0.5 * (self.dice.next() - 0.5)) / children as f32);
            let tilt = if generation == 0 { 0.78 } else { 0.55 } * (0.75 + 0.5 * self.dice.next());
            let sideways = Quat::from_axis_angle(direction, azimuth) * across;
            // Branches bend to the light a little.
            let new = direction * tilt.cos() + sideways * tilt.sin() + 0.08 * Vec3::Z;
            let shrink = if generation == 0 { 0.62 } else { 0.76 } * (0.85 + 0.25 * self.dice.next());
            self.grow(to, new.normalize(), length * shrink, end_radius, generation + 1);
        }
        // The trunk goes on upwards through the crown.
        if generation == 0 {
            self.grow(to, vec3(0.05, -0.03, 1.0).normalize(), 0.55 * length, 0.9 * end_radius, 1);
        }
    }
}

/// Leaves 0.15 to 0.6, wood 0.8 to 1.
pub(super) fn tree() -> Box<dyn Body> {
    let mut skeleton = Skeleton { branches: Vec::new(), leaves: Vec::new(), dice: Dice(SEED) };
    skeleton.grow(Vec3::ZERO, vec3(0.02, 0.0, 1.0).normalize(), 0.66, 0.085, 0);

    // Stretch the crown to fill the box; the trunk's foot stands on its floor.
    let (mut low, mut high) = (Vec3::ZERO, Vec3::ZERO);
    for &(centre, _) in &skeleton.leaves {
        low = low.min(centre);
        high = high.max(centre);
    }
    let margin = 0.175;
    let scale = (2.0 - vec3(2.0 * margin, 2.0 * margin, margin)) / vec3(high.x - low.x, high.y - low.y, high.z);
    let fit = |p: Vec3| (p - vec3(low.x, low.y, 0.0)) * scale + vec3(margin - 1.0, margin - 1.0, -1.0);

    let foot = fit(Vec3::ZERO);
    let mut rods: Vec<Rod> = skeleton
        .branches
        .iter()
        .map(|b| Rod::new(fit(b.from).into(), b.from_radius, fit(b.to).into(), b.to_radius))
        .collect();
    const ROOTS: u32 = 7;
    for i in 0..ROOTS {
        let (sin, cos) = (TAU * (i as f32 + 0.4 * skeleton.dice.next()) / ROOTS as f32).sin_cos();
        let reach = 0.16 + 0.1 * skeleton.dice.next();
        let from = foot + vec3(0.03 * cos, 0.03 * sin, 0.13);
        rods.push(Rod::new(from.into(), 0.055, (foot + vec3(reach * cos, reach * sin, 0.0)).into(), 0.02));
    }
    // The outermost balls are moved inwards: leaves end within the box, not at its faces.
    let within = |centre: Vec3, radius: f32| {
        let room = 1.0 - LEAF_REACH * radius;
        centre.clamp(Vec3::splat(-room), Vec3::splat(room))
    };
    let leaves: Vec<_> =
        skeleton.leaves.iter().map(|&(centre, radius)| (within(fit(centre), radius), radius)).collect();
    Box::new(Tree {
        rods: Bins::new(Vec3::NEG_ONE, Vec3::ONE, &rods, |rod| rod.bounds(FILLET + EDGE)),
        leaves: Bins::new(Vec3::NEG_ONE, Vec3::ONE, &leaves, |&(centre, radius)| (centre - radius, centre + radius)),
    })
}

struct Tree {
    rods: Bins<Rod>,
    leaves: Bins<(Vec3, f32)>,
}

impl Body for Tree {
    fn value(&self, p: Vec3) -> f32 {
        let mut value = 0.0f32;
        // Each ball adds a bump that ends smoothly at its radius.
        let bump = |&(centre, radius): &(Vec3, f32)| {
            let t = (1.0 - (p - centre).length_squared() / (radius * radius)).max(0.0);
            t * t
        };
        let foliage: f32 = self.leaves.near(p).iter().map(bump).sum();
        if foliage > 0.02 {
            let clumps = foliage.min(1.0) + 0.55 * fbm(p * 9.0, 2);
            value = 0.58 * smoothstep(0.10, 0.56, clumps + 0.30 * noise(p * 34.0));
        }
        let d = rods(p, self.rods.near(p), FILLET, 1.0);
        if d < EDGE {
            let bark = 0.004 * noise(p * vec3(40.0, 40.0, 10.0));
            value = value.max(inside(d + bark, EDGE) * (0.9 + 0.1 * noise(p * 20.0)));
        }
        value
    }
}
