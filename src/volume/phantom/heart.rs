//! A heart with its chambers, great vessels and coronary arteries, seen as a contrast CT would show it.

use super::field::{Bins, Rod, carve, fbm, inside, rods, smooth_min, turned_ellipsoid};
use super::{Body, DISTANCE_ERROR};
use glam::{Mat3, Vec3, vec3};

pub(super) const LOW: Vec3 = Vec3::new(-0.74, -0.62, -0.96);
pub(super) const HIGH: Vec3 = Vec3::new(0.74, 0.62, 1.0);

/// Width of the soft edges.
const EDGE: f32 = 0.024;

/// The aorta with the three arteries of its arch.
const AORTA: [Rod; 10] = [
    Rod::new([0.04, 0.02, 0.16], 0.13, [-0.10, -0.06, 0.48], 0.125),
    Rod::new([-0.10, -0.06, 0.48], 0.125, [-0.10, 0.0, 0.70], 0.12),
    Rod::new([-0.10, 0.0, 0.70], 0.12, [0.02, 0.14, 0.80], 0.115),
    Rod::new([0.02, 0.14, 0.80], 0.115, [0.15, 0.30, 0.74], 0.11),
    Rod::new([0.15, 0.30, 0.74], 0.11, [0.20, 0.40, 0.54], 0.10),
    Rod::new([0.20, 0.40, 0.54], 0.10, [0.18, 0.46, -0.10], 0.09),
    Rod::new([0.18, 0.46, -0.10], 0.09, [0.12, 0.47, -1.1], 0.08),
    Rod::new([-0.10, 0.02, 0.75], 0.06, [-0.24, 0.02, 1.1], 0.05),
    Rod::new([0.01, 0.13, 0.84], 0.045, [0.0, 0.12, 1.1], 0.04),
    Rod::new([0.11, 0.25, 0.82], 0.045, [0.17, 0.24, 1.1], 0.04),
];

/// The pulmonary trunk and its two arteries.
const PULMONARY: [Rod; 6] = [
    Rod::new([-0.04, -0.30, 0.10], 0.13, [0.06, -0.28, 0.38], 0.12),
    Rod::new([0.06, -0.28, 0.38], 0.12, [0.15, -0.08, 0.55], 0.11),
    Rod::new([0.15, -0.08, 0.55], 0.10, [0.44, 0.12, 0.54], 0.085),
    Rod::new([0.44, 0.12, 0.54], 0.085, [0.9, 0.20, 0.42], 0.06),
    Rod::new([0.15, -0.08, 0.55], 0.10, [-0.30, 0.14, 0.50], 0.085),
    Rod::new([-0.30, 0.14, 0.50], 0.085, [-0.9, 0.16, 0.40], 0.06),
];

/// The two great veins of the body.
const CAVAE: [Rod; 3] = [
    Rod::new([-0.38, 0.06, 0.24], 0.11, [-0.36, 0.0, 0.70], 0.10),
    Rod::new([-0.36, 0.0, 0.70], 0.10, [-0.40, -0.04, 1.1], 0.095),
    Rod::new([-0.36, 0.14, -0.02], 0.12, [-0.32, 0.20, -1.1], 0.12),
];

/// The lungs' veins into the left atrium.
const LUNG_VEINS: [Rod; 4] = [
    Rod::new([0.20, 0.36, 0.32], 0.075, [0.9, 0.42, 0.40], 0.05),
    Rod::new([0.20, 0.38, 0.20], 0.075, [0.9, 0.46, 0.02], 0.05),
    Rod::new([0.0, 0.36, 0.32], 0.075, [-0.9, 0.40, 0.26], 0.05),
    Rod::new([0.0, 0.38, 0.20], 0.075, [-0.9, 0.42, -0.04], 0.05),
];

/// Points near which the coronary arteries run; they are laid onto the muscle's surface. Each is a list of points from
/// the aorta outwards.
const CORONARIES: [&[[f32; 3]]; 4] = [
    // Down the groove between the ventricles, to the apex, with a branch to the left.
    &[
        [0.16, -0.16, 0.22],
        [0.20, -0.34, 0.08],
        [0.20, -0.44, -0.12],
        [0.24, -0.46, -0.34],
        [0.30, -0.44, -0.54],
        [0.36, -0.34, -0.72],
    ],
    &[[0.20, -0.34, 0.08], [0.34, -0.32, -0.10], [0.44, -0.26, -0.30], [0.50, -0.20, -0.48]],
    // Round the left side.
    &[[0.16, -0.12, 0.22], [0.38, -0.02, 0.14], [0.48, 0.16, 0.0], [0.46, 0.26, -0.20], [0.42, 0.22, -0.42]],
    // Round the right side, along the edge of the right atrium.
    &[
        [-0.06, -0.30, 0.20],
        [-0.26, -0.38, 0.10],
        [-0.42, -0.34, -0.10],
        [-0.44, -0.22, -0.34],
        [-0.30, -0.10, -0.52],
        [-0.06, 0.02, -0.60],
    ],
];

/// The muscle's shape.
struct Chambers {
    /// Columns: two directions across, then the long axis towards the apex (left, front, down).
    axes: Mat3,
}

/// Signed distances at a point.
struct Parts {
    muscle: f32,
    left: f32,
    right: f32,
}

impl Chambers {
    fn new() -> Self {
        let long = vec3(0.50, -0.42, -0.76).normalize();
        let across = long.cross(Vec3::Z).normalize();
        Self { axes: Mat3::from_cols(across, long.cross(across), long) }
    }

    /// The coronary arteries, laid onto the muscle in short pieces that follow its surface.
    fn coronaries(&self) -> Vec<Rod> {
        const PIECES: usize = 6;
        let mut rods = Vec::new();
        for path in CORONARIES {
            let pieces = PIECES * (path.len() - 1);
            let at = |k: usize| {
                let segment = (k / PIECES).min(path.len() - 2);
                let t = (k - segment * PIECES) as f32 / PIECES as f32;
                self.onto_surface(Vec3::from(path[segment]).lerp(path[segment + 1].into(), t))
            };
            let radius = |k: usize| 0.032 - 0.016 * k as f32 / pieces as f32;
            rods.extend((0..pieces).map(|k| Rod::new(at(k).into(), radius(k), at(k + 1).into(), radius(k + 1))));
        }
        rods
    }

    /// The muscle with the chambers' walls, and the blood of the two sides.
    fn parts(&self, p: Vec3) -> Parts {
        let ventricle = |centre, radii| turned_ellipsoid(p, centre, &self.axes, radii);
        let atrium = |centre, radii| turned_ellipsoid(p, centre, &Mat3::IDENTITY, radii);
        let left_centre = vec3(0.14, -0.04, -0.22);
        let left_wall = ventricle(left_centre, vec3(0.38, 0.37, 0.60));
        let left_room = ventricle(left_centre + vec3(-0.02, 0.02, 0.04), vec3(0.22, 0.21, 0.44));
        let right_centre = vec3(-0.16, -0.20, -0.18);
        let right_wall = ventricle(right_centre, vec3(0.34, 0.30, 0.50));
        let right_room = carve(ventricle(right_centre, vec3(0.29, 0.25, 0.44)), left_wall - 0.03, 0.05);
        let left_atrium = vec3(0.10, 0.34, 0.24);
        let right_atrium = vec3(-0.36, 0.08, 0.10);
        let mut muscle = smooth_min(left_wall, right_wall, 0.12);
        muscle = smooth_min(muscle, atrium(left_atrium, vec3(0.32, 0.21, 0.23)), 0.07);
        muscle = smooth_min(muscle, atrium(right_atrium, vec3(0.23, 0.28, 0.32)), 0.07);
        let left = left_room.min(atrium(left_atrium, vec3(0.27, 0.16, 0.18)));
        let right = right_room.min(atrium(right_atrium, vec3(0.18, 0.23, 0.27)));
        Parts { muscle, left, right }
    }

    /// Walks to the muscle's surface along the distance's gradient.
    fn onto_surface(&self, mut p: Vec3) -> Vec3 {
        let distance = |p| self.parts(p).muscle;
        for _ in 0..12 {
            let h = 1e-3;
            let d = distance(p);
            let slope = vec3(
                distance(p + h * Vec3::X) - distance(p - h * Vec3::X),
                distance(p + h * Vec3::Y) - distance(p - h * Vec3::Y),
                distance(p + h * Vec3::Z) - distance(p - h * Vec3::Z),
            ) / (2.0 * h);
            p -= d * slope / slope.length_squared().max(0.1);
        }
        p
    }
}

/// Blood of the left side 0.85, of the right 0.65, coronary arteries 1, muscle and vessel walls 0.25 to 0.4.
pub(super) fn heart() -> Box<dyn Body> {
    let chambers = Chambers::new();
    let bins = |rods: &[Rod]| Bins::new(LOW, HIGH, rods, |rod| rod.bounds(REACH));
    let mut vessels = [&AORTA[..], &PULMONARY, &CAVAE, &LUNG_VEINS].concat();
    let coronaries = chambers.coronaries();
    let heart = Heart {
        aorta: bins(&AORTA),
        pulmonary: bins(&PULMONARY),
        cavae: bins(&CAVAE),
        lung_veins: bins(&LUNG_VEINS),
        coronaries: bins(&coronaries),
        all_vessels: {
            vessels.extend(coronaries);
            vessels
        },
        chambers,
    };
    Box::new(heart)
}

/// Size of the fillets where vessels meet.
const FILLET: f32 = 0.05;

/// Thickness of a vessel's wall.
const WALL: f32 = 0.025;

/// How far noise moves the muscle's surface, in parts of [`fbm`].
const ROUGHNESS: f32 = 0.012;

/// Beyond this distance nothing of the heart is left.
const MARGIN: f32 = 0.045;

/// Beyond this distance a vessel matters to nothing.
const REACH: f32 = MARGIN + FILLET;

struct Heart {
    chambers: Chambers,
    aorta: Bins<Rod>,
    pulmonary: Bins<Rod>,
    cavae: Bins<Rod>,
    lung_veins: Bins<Rod>,
    coronaries: Bins<Rod>,
    all_vessels: Vec<Rod>,
}

impl Body for Heart {
    fn value(&self, p: Vec3) -> f32 {
        let tubes = |bins: &Bins<Rod>| rods(p, bins.near(p), FILLET, 1.0);
        let mut parts = self.chambers.parts(p);
        let [aorta, pulmonary] = [&self.aorta, &self.pulmonary].map(tubes);
        let [cavae, lung_veins] = [&self.cavae, &self.lung_veins].map(tubes);
        let coronary = self.coronaries.near(p).iter().fold(1.0f32, |d, rod| d.min(rod.distance(p)));
        let outside = smooth_min(parts.muscle, aorta.min(pulmonary).min(cavae.min(lung_veins)), FILLET);
        if outside.min(coronary) > MARGIN {
            return 0.0;
        }
        parts.left = parts.left.min(aorta + WALL).min(lung_veins + WALL);
        parts.right = parts.right.min(pulmonary + WALL).min(cavae + WALL);

        let fibre = fbm(p * vec3(7.0, 7.0, 5.0), 3);
        let mut value = inside(outside + ROUGHNESS * fibre, EDGE) * (0.32 + 0.08 * fibre);
        // Streaks where contrast agent and blood mix.
        let mixed = 0.04 * fbm(p * 4.0, 2);
        value = value.max((0.85 + mixed) * inside(parts.left, EDGE));
        value = value.max((0.65 + mixed) * inside(parts.right, EDGE));
        value.max(inside(coronary, EDGE))
    }

    fn empty_within(&self, p: Vec3, radius: f32) -> bool {
        let muscle = self.chambers.parts(p).muscle;
        rods(p, &self.all_vessels, FILLET, muscle) > DISTANCE_ERROR * radius + MARGIN + FILLET
    }
}
