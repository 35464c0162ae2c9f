//! Volumes of texels, read as the GPU's samplers do.

use glam::{IVec3, UVec3, Vec3, Vec4};

/// Texels of a box, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture<T> {
    /// Texels along x, y, z.
    pub dims: UVec3,
    /// The texels.
    pub texels: Vec<T>,
}

impl<T: Copy> Texture<T> {
    /// A box of `dims` with the given texels.
    pub fn new(dims: [u32; 3], texels: Vec<T>) -> Self {
        assert_eq!(dims.iter().map(|&d| d as usize).product::<usize>(), texels.len(), "texels of {dims:?}");
        Self { dims: dims.into(), texels }
    }

    /// A box of `dims` full of `value`.
    pub fn filled(dims: [u32; 3], value: T) -> Self {
        Self::new(dims, vec![value; dims.iter().map(|&d| d as usize).product()])
    }

    fn index(&self, at: UVec3) -> usize {
        let d = self.dims.as_usizevec3();
        let p = at.as_usizevec3();
        (p.z * d.y + p.y) * d.x + p.x
    }

    /// The texel at `at`, which is inside.
    pub fn fetch(&self, at: UVec3) -> T {
        self.texels[self.index(at)]
    }

    /// The texel nearest to `at`.
    pub fn fetch_clamped(&self, at: IVec3) -> T {
        self.fetch(at.clamp(IVec3::ZERO, self.dims.as_ivec3() - 1).as_uvec3())
    }

    /// The texel at `at`, to be changed.
    pub fn texel_mut(&mut self, at: UVec3) -> &mut T {
        let index = self.index(at);
        &mut self.texels[index]
    }
}

impl Texture<Vec4> {
    /// Trilinear interpolation at `p` in texels (centres at i + ½); the edge value holds beyond the last centre.
    pub fn sample(&self, p: Vec3) -> Vec4 {
        let p = p - 0.5;
        let low = p.floor();
        let f = p - low;
        let mut sum = Vec4::ZERO;
        for corner in 0..8 {
            let high = UVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let weight = Vec3::select(high.cmpeq(UVec3::ONE), f, 1.0 - f).element_product();
            sum += weight * self.fetch_clamped(low.as_ivec3() + high.as_ivec3());
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_functions_are_interpolated_exactly_and_held_at_the_edges() {
        let dims = [3, 2, 4];
        let value = |p: Vec3| Vec4::new(p.x, p.y, p.z, p.x + 2.0 * p.y - 3.0 * p.z);
        let mut t = Texture::filled(dims, Vec4::ZERO);
        for z in 0..4 {
            for y in 0..2 {
                for x in 0..3 {
                    let at = UVec3::new(x, y, z);
                    *t.texel_mut(at) = value(at.as_vec3() + 0.5);
                }
            }
        }
        for p in [Vec3::new(0.9, 0.7, 2.2), Vec3::new(2.5, 1.5, 3.5), Vec3::new(1.5, 0.5, 0.5)] {
            assert!((t.sample(p) - value(p)).length() < 1e-5, "{p}");
        }
        assert!((t.sample(Vec3::new(-4.0, 9.0, 2.0)) - value(Vec3::new(0.5, 1.5, 2.0))).length() < 1e-5);
    }
}
