//! Building blocks of the phantoms: signed distances, smooth unions, and noise from integer hashes.

use glam::{Mat3, Vec3};

/// Scrambles a number; different inputs give different outputs (an invertible multiply-xorshift mix).
pub(super) fn bijection(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}

/// A hash of three numbers.
pub(super) fn hash([x, y, z]: [u32; 3]) -> u32 {
    bijection(x ^ bijection(y ^ bijection(z ^ 0x9e37_79b9)))
}

/// A number in 0 to below 1 from a hash's upper 24 bits, which f32 holds exactly.
pub(super) fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / (1 << 24) as f32
}

/// Gradient noise in about [-1,1] with features of size 1, zero at integer points.
pub(super) fn noise(p: Vec3) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let [x, y, z] = [cell.x as i32 as u32, cell.y as i32 as u32, cell.z as i32 as u32];
    // Hash the coordinates one after the other, so that corners share the work.
    let zs = [bijection(z), bijection(z.wrapping_add(1))];
    let mut corner = [0.0; 8];
    for (i, value) in corner.iter_mut().enumerate() {
        let (dx, dy, dz) = ((i & 1) as u32, (i >> 1 & 1) as u32, i >> 2);
        let h = bijection(x.wrapping_add(dx) ^ (y.wrapping_add(dy) ^ zs[dz]).wrapping_mul(0x9e37_79b1));
        let gradient = Vec3::new((h & 0x3ff) as f32, (h >> 10 & 0x3ff) as f32, (h >> 20 & 0x3ff) as f32) / 511.5 - 1.0;
        *value = gradient.dot(f - Vec3::new(dx as f32, dy as f32, dz as f32));
    }
    let t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let low = mix(mix(corner[0], corner[1], t.x), mix(corner[2], corner[3], t.x), t.y);
    let high = mix(mix(corner[4], corner[5], t.x), mix(corner[6], corner[7], t.x), t.y);
    mix(low, high, t.z)
}

/// Sum of octaves of [`noise`], each half as large and twice as fine as the one before.
pub(super) fn fbm(p: Vec3, octaves: u32) -> f32 {
    let mut sum = 0.0;
    let mut amplitude = 1.0;
    let mut q = p;
    for _ in 0..octaves {
        sum += amplitude * noise(q);
        amplitude *= 0.5;
        // An offset keeps the zeros at integer points from falling together.
        q = 2.0 * q + 17.3;
    }
    sum
}

/// 0 below `from`, 1 above `to`, smooth between.
pub(super) fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Share of the inside at signed distance `d`, for an edge of the given width.
pub(super) fn inside(d: f32, width: f32) -> f32 {
    smoothstep(width / 2.0, -width / 2.0, d)
}

/// Union of two distances with a fillet of size `k`.
#[inline]
pub(super) fn smooth_min(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0);
    a.min(b) - h * h * (0.25 / k)
}

/// Distance `a` without the inside of `b`, with a rounded rim of size `k`.
pub(super) fn carve(a: f32, b: f32, k: f32) -> f32 {
    -smooth_min(-a, b, k)
}

/// Distance to an ellipsoid: exact at the surface's first order, which is all that thin edges need.
#[inline]
pub(super) fn ellipsoid(p: Vec3, centre: Vec3, radii: Vec3) -> f32 {
    // The reciprocal of literal radii is worked out at compile time.
    let inverse = 1.0 / radii;
    let q = (p - centre) * inverse;
    let k0 = q.length();
    let k1 = (q * inverse).length();
    if k1 > 0.0 { k0 * (k0 - 1.0) / k1 } else { -radii.min_element() }
}

/// An ellipsoid whose axes are the columns of a rotation.
pub(super) fn turned_ellipsoid(p: Vec3, centre: Vec3, axes: &Mat3, radii: Vec3) -> f32 {
    ellipsoid(axes.transpose() * (p - centre), Vec3::ZERO, radii)
}

/// A tapered rod with round ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rod {
    pub from: Vec3,
    axis: Vec3,
    inverse_length_squared: f32,
    from_radius: f32,
    growth: f32,
}

impl Rod {
    pub const fn new(from: [f32; 3], from_radius: f32, to: [f32; 3], to_radius: f32) -> Self {
        let axis = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        Self {
            from: Vec3::from_array(from),
            axis: Vec3::from_array(axis),
            inverse_length_squared: 1.0 / (axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]),
            from_radius,
            growth: to_radius - from_radius,
        }
    }

    /// Distance to its surface; exact where the radius is constant.
    pub fn distance(&self, p: Vec3) -> f32 {
        let q = p - self.from;
        let along = (q.dot(self.axis) * self.inverse_length_squared).clamp(0.0, 1.0);
        (q - along * self.axis).length() - (self.from_radius + along * self.growth)
    }

    /// The box around it, widened by `reach`.
    pub fn bounds(&self, reach: f32) -> (Vec3, Vec3) {
        let to = self.from + self.axis;
        let reach = reach + self.from_radius.max(self.from_radius + self.growth);
        (self.from.min(to) - reach, self.from.max(to) + reach)
    }
}

/// Smooth union of rods; `far` if there are none.
pub(super) fn rods(p: Vec3, rods: &[Rod], k: f32, far: f32) -> f32 {
    rods.iter().fold(far, |d, rod| smooth_min(d, rod.distance(p), k))
}

/// Cells of [`Bins`] along each axis.
const CELLS: usize = 32;

/// A look-up grid over a box: for each cell the items whose bounds touch it, in their given order.
pub(super) struct Bins<T> {
    low: Vec3,
    /// Cells per unit.
    scale: Vec3,
    cells: Vec<Vec<T>>,
}

impl<T: Copy> Bins<T> {
    pub fn new(low: Vec3, high: Vec3, items: &[T], bounds: impl Fn(&T) -> (Vec3, Vec3)) -> Self {
        let scale = CELLS as f32 / (high - low);
        let mut bins = Self { low, scale, cells: vec![Vec::new(); CELLS.pow(3)] };
        for item in items {
            let (from, to) = bounds(item);
            let (a, b) = (bins.coordinates(from), bins.coordinates(to));
            for z in a[2]..=b[2] {
                for y in a[1]..=b[1] {
                    for x in a[0]..=b[0] {
                        bins.cells[x + CELLS * (y + CELLS * z)].push(*item);
                    }
                }
            }
        }
        bins
    }

    /// Cell of a point; points outside belong to the nearest one.
    fn coordinates(&self, p: Vec3) -> [usize; 3] {
        let q = ((p - self.low) * self.scale).clamp(Vec3::ZERO, Vec3::splat(CELLS as f32 - 1.0));
        q.to_array().map(|c| c as usize)
    }

    /// The items that can matter at a point.
    pub fn near(&self, p: Vec3) -> &[T] {
        let [x, y, z] = self.coordinates(p);
        &self.cells[x + CELLS * (y + CELLS * z)]
    }
}
