//! Twin of `project_deposit.comp` and `project_solve.comp`, and of `include/cell.glsl`.

use super::rng::{random_float, stream_key};
use super::scene::{HostScene, direction_to_eye};
use super::sphere::phase_hg;
use super::texture::Texture;
use crate::abi::{ScatterSample, SceneParams};
use crate::shaders::constants::{CELL_POINTS, CELL_STREAM};
use glam::{IVec3, UVec3, Vec3, Vec4};
use std::f32::consts::PI;

/// A cell: the eight nodes `index` − 1 + {0, 1}³ and what is between them, cut to the volume.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    index: UVec3,
    nodes: UVec3,
    edge: f32,
    low: Vec3,
    size: Vec3,
    shift: Vec3,
}

/// Bit k: 1 = the upper one along axis k.
fn upper_bits(corner: u32) -> UVec3 {
    UVec3::new(corner & 1, corner >> 1 & 1, corner >> 2 & 1)
}

impl Cell {
    /// The cell of a linear index.
    pub fn from_linear(scene: &SceneParams, i: u32) -> Self {
        let [x, y, _] = scene.light_dims.map(|d| d + 1);
        Self::new(scene, UVec3::new(i % x, i / x % y, i / x / y))
    }

    /// The cell at `index`.
    pub fn new(scene: &SceneParams, index: UVec3) -> Self {
        let (nodes, edge) = (UVec3::from(scene.light_dims), scene.light_edge as f32);
        let low = ((index.as_vec3() - 0.5) * edge).max(Vec3::ZERO);
        let high = ((index.as_vec3() + 0.5) * edge).min(UVec3::from(scene.dims).as_vec3());
        let linear = (index.z * (nodes.y + 1) + index.y) * (nodes.x + 1) + index.x;
        let key = stream_key(linear, CELL_STREAM, scene.seed_low, scene.seed_high);
        let shift = Vec3::from([0, 1, 2].map(|n| random_float(key, n)));
        Self { index, nodes, edge, low, size: (high - low).max(Vec3::ZERO), shift }
    }

    /// Node at a corner, if there is one.
    pub fn corner_node(&self, corner: u32) -> Option<UVec3> {
        let node = self.index.as_ivec3() - 1 + upper_bits(corner).as_ivec3();
        (node.cmpge(IVec3::ZERO).all() && node.cmplt(self.nodes.as_ivec3()).all()).then(|| node.as_uvec3())
    }

    /// Place of a point within the cell, 0 to 1.
    fn place(&self, point: u32) -> Vec3 {
        0.5 * (self.shift + upper_bits(point).as_vec3())
    }

    /// Where a point is, index space.
    pub fn position(&self, point: u32) -> Vec3 {
        self.low + self.size * self.place(point)
    }

    /// Its middle, index space.
    pub fn middle(&self) -> Vec3 {
        self.low + 0.5 * self.size
    }

    /// Index-space volume.
    fn volume(&self) -> f32 {
        self.size.element_product()
    }

    /// Weight of a corner's node at a point.
    pub fn weight(&self, point: u32, corner: u32) -> f32 {
        let (position, bits) = (self.position(point), upper_bits(corner));
        let along = |axis: usize| {
            let upper = match self.index[axis] {
                0 => 1.0,
                i if i == self.nodes[axis] => 0.0,
                i => position[axis] / self.edge + 0.5 - i as f32,
            };
            if bits[axis] == 1 { upper } else { 1.0 - upper }
        };
        along(0) * along(1) * along(2)
    }

    /// What a function that is trilinear between the nodes has at a point; `of` gives it at a node.
    pub fn interpolate(&self, point: u32, of: impl Fn(UVec3) -> Vec4) -> Vec4 {
        let at = |corner| self.corner_node(corner).map_or(Vec4::ZERO, |node| self.weight(point, corner) * of(node));
        (0..8).map(at).sum()
    }

    /// σ_s per channel at a point, relative to the largest extinction.
    pub fn scattering(&self, scene: &HostScene, point: u32) -> Vec3 {
        scene.scattering.sample(self.position(point)).truncate()
    }
}

/// Indices of the cells of a volume.
fn cells(scene: &SceneParams) -> impl Iterator<Item = UVec3> {
    let [nx, ny, nz] = scene.light_dims.map(|d| d + 1);
    (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| UVec3::new(x, y, z))))
}

/// The point that sample `k` of a cell is taken at.
pub fn point_of_sample(k: u32, flip: u32) -> u32 {
    const ORDER: [u32; 8] = [0, 3, 5, 6, 7, 4, 2, 1];
    ORDER[((k + k / CELL_POINTS) % CELL_POINTS) as usize] ^ flip
}

/// Right-hand sides.
#[derive(Clone, Debug)]
pub struct Sums {
    /// Of A.
    pub a: Texture<Vec4>,
    /// Of B by component.
    pub b: [Texture<Vec4>; 3],
    /// Of what the eye sees, for g ≠ 0.
    pub eye: Texture<Vec4>,
}

impl Sums {
    /// Nothing.
    pub fn zero(dims: [u32; 3]) -> Self {
        let zero = || Texture::filled(dims, Vec4::ZERO);
        Self { a: zero(), b: [zero(), zero(), zero()], eye: zero() }
    }
}

/// Adds the samples of the listed cells, `samples[cell in the list][slot]`.
pub fn project_deposit(
    scene: &SceneParams,
    cells: &[u32],
    samples: &[Vec<ScatterSample>],
    is_seen: bool,
    sums: &mut Sums,
) {
    for (&index, samples) in cells.iter().zip(samples) {
        let cell = Cell::from_linear(scene, index);
        for sample in samples {
            let travel = Vec3::from(sample.travel);
            let to_eye = direction_to_eye(scene, cell.position(sample.point));
            for corner in 0..8 {
                let Some(node) = cell.corner_node(corner) else { continue };
                let light = Vec3::from(sample.light) * (cell.weight(sample.point, corner) * cell.volume());
                *sums.a.texel_mut(node) += light.extend(0.0);
                for axis in 0..3 {
                    *sums.b[axis].texel_mut(node) += (3.0 * scene.g * travel[axis] * light).extend(0.0);
                }
                if is_seen {
                    let phase = 4.0 * PI * phase_hg(scene.g, travel.dot(to_eye));
                    *sums.eye.texel_mut(node) += (light * phase).extend(0.0);
                }
            }
        }
    }
}

/// M of the normal equations times `of` at every node: Σ_j ∫ σ v_i v_j dx `of`_j. `field` has σ at the voxels.
fn times_mass(scene: &SceneParams, field: &Texture<Vec4>, of: impl Fn(UVec3) -> Vec3) -> Texture<Vec4> {
    let mut product = Texture::filled(scene.light_dims, Vec4::ZERO);
    for index in cells(scene) {
        let cell = Cell::new(scene, index);
        for point in 0..CELL_POINTS {
            let at = cell.interpolate(point, |node| of(node).extend(0.0));
            let part = field.sample(cell.position(point)).w * cell.volume() / CELL_POINTS as f32;
            for corner in 0..8 {
                if let Some(node) = cell.corner_node(corner) {
                    *product.texel_mut(node) += (at.truncate() * (part * cell.weight(point, corner))).extend(0.0);
                }
            }
        }
    }
    product
}

/// Solves for the values at the nodes by the given factors of Richardson steps; `field` has σ. Where nodes are voxels the
/// result keeps it in its fourth component; else that says 1 where a node has a value.
pub fn project_solve(
    scene: &SceneParams,
    field: &Texture<Vec4>,
    sums: &Texture<Vec4>,
    factors: &[f32],
) -> Texture<Vec4> {
    let rows = times_mass(scene, field, |_| Vec3::ONE);
    let divided = |sum: Vec4, row: Vec4| if row.x > 0.0 { sum / row.x } else { Vec4::ZERO };
    let with_extinction = |values: Vec<Vec4>| {
        let has_value = |i: usize| if rows.texels[i].x > 0.0 { 1.0 } else { 0.0 };
        let kept = |i: usize| if scene.light_edge == 1 { field.texels[i].w } else { has_value(i) };
        let texels = values.iter().enumerate().map(|(i, v)| v.truncate().extend(kept(i))).collect();
        Texture::new(scene.light_dims, texels)
    };
    let first = sums.texels.iter().zip(&rows.texels).map(|(s, r)| divided(*s, *r)).collect();
    factors.iter().fold(with_extinction(first), |u, factor| {
        let product = times_mass(scene, field, |node| u.fetch(node).truncate());
        let step = |i: usize| u.texels[i] + *factor * divided(sums.texels[i] - product.texels[i], rows.texels[i]);
        with_extinction((0..u.texels.len()).map(step).collect())
    })
}
