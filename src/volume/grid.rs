//! A scalar volume on a regular grid, placed in the world.

use crate::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};
use std::fmt;
use std::ops::RangeInclusive;

/// Lengths of a voxel step, in world units, that can be rendered in single precision without overflow.
const STEP_LENGTHS: RangeInclusive<f64> = 1e-12..=1e12;

/// Largest accepted |coordinate| of voxel 0, in world units.
const MAX_ORIGIN: f64 = 1e15;

/// Least |determinant| of the three unit vectors along the voxel steps: below it they lie in a plane.
const MIN_DETERMINANT: f64 = 1e-6;

/// Type of the stored scalars.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the variants are the types they name")]
pub enum ScalarType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

/// The scalars as they were stored, x fastest.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the variants are the types they name")]
pub enum VoxelData {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// The grid: size, and the map from voxel indices to world space.
///
/// Voxel i covers [i, i+1) in *index space*; its centre is at i + ½ (DESIGN section 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Voxels along x, y, z (x fastest in memory). Each is at least 1.
    pub dims: [u32; 3],
    /// Index space (continuous, voxel centre at i + ½) to world space, in the volume's unit (usually mm).
    /// Its columns are the world vectors of one voxel step; they may be flipped or rotated. World axes are LPS
    /// for medical formats.
    pub index_to_world: DAffine3,
}

/// A scalar volume in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Where it came from, for messages and statistics: a file name or `phantom:NAME`.
    pub name: String,
    /// Size and placement.
    pub grid: Grid,
    /// Stored scalars; `dims.x * dims.y * dims.z` of them.
    pub data: VoxelData,
    /// value = slope * stored + intercept (NIfTI's scl_slope and scl_inter, DICOM's rescale).
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
}

impl Grid {
    /// A grid with axes along the world's, voxel 0's centre at `origin`, `spacing` in world units.
    pub fn axis_aligned(dims: [u32; 3], spacing: [f64; 3], origin: [f64; 3]) -> Self {
        Self::oriented(dims, DMat3::from_diagonal(DVec3::from(spacing)), origin)
    }

    /// A grid whose voxel steps are the columns of `steps` and whose voxel 0 has its centre at `origin`.
    pub fn oriented(dims: [u32; 3], steps: DMat3, origin: [f64; 3]) -> Self {
        let translation = DVec3::from(origin) - steps * DVec3::splat(0.5);
        Self { dims, index_to_world: DAffine3 { matrix3: steps, translation } }
    }

    /// The same as [`Grid::oriented`] for values from outside: lengths, origin and determinant are checked.
    /// `steps_from` and `origin_from` name their sources (file and field) in the error.
    pub fn checked(
        dims: [u32; 3],
        steps: DMat3,
        origin: [f64; 3],
        steps_from: &str,
        origin_from: &str,
    ) -> Result<Self> {
        for (axis, step) in [steps.x_axis, steps.y_axis, steps.z_axis].into_iter().enumerate() {
            // A NaN lies in no range.
            if !STEP_LENGTHS.contains(&step.length()) {
                return Err(Error::input(
                    steps_from,
                    format!("voxel step {axis} has length {}, not a finite positive one", step.length()),
                    format!(
                        "give each axis a step between {:e} and {:e} world units long",
                        STEP_LENGTHS.start(),
                        STEP_LENGTHS.end()
                    ),
                ));
            }
        }
        let units = DMat3::from_cols(steps.x_axis.normalize(), steps.y_axis.normalize(), steps.z_axis.normalize());
        if units.determinant().abs() < MIN_DETERMINANT {
            return Err(Error::input(
                steps_from,
                "the direction matrix is singular: the three axes lie in one plane",
                "give three linearly independent axis directions",
            ));
        }
        if !origin.iter().all(|c| c.abs() <= MAX_ORIGIN) {
            return Err(Error::input(
                origin_from,
                format!("the origin {origin:?} is not finite or too far away"),
                format!("give finite coordinates of at most {MAX_ORIGIN:e}"),
            ));
        }
        Ok(Self::oriented(dims, steps, origin))
    }

    /// Checks sizes from outside: each at least 1 and at most 2³²−1 voxels in all, the most that a 32-bit voxel
    /// index reaches. `what` names their source (file and field) in the error.
    pub fn checked_dims(dims: [u64; 3], what: &str) -> Result<[u32; 3]> {
        let [x, y, z] = dims;
        if dims.contains(&0) {
            return Err(Error::input(
                what,
                format!("the size {x} x {y} x {z} has a zero"),
                "give at least 1 voxel per axis",
            ));
        }
        match x.checked_mul(y).and_then(|xy| xy.checked_mul(z)) {
            // Each factor is at most the product.
            Some(n) if n <= u64::from(u32::MAX) => Ok(dims.map(|d| d as u32)),
            _ => Err(Error::input(
                what,
                format!("{x} x {y} x {z} is more than {} voxels", u32::MAX),
                "crop or downsample the volume, or correct the size if the header is damaged",
            )),
        }
    }

    /// Number of voxels.
    pub fn voxels(&self) -> u64 {
        self.dims.iter().map(|&d| u64::from(d)).product()
    }

    /// Lengths of the voxel steps in world units.
    pub fn spacing(&self) -> [f64; 3] {
        let m = &self.index_to_world.matrix3;
        [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()]
    }

    /// Mean of the three spacings: the default unit distance of the opacity convention.
    pub fn mean_spacing(&self) -> f64 {
        self.spacing().iter().sum::<f64>() / 3.0
    }

    /// Corners of the world-space axis-aligned box around the voxel faces.
    pub fn world_bounds(&self) -> (DVec3, DVec3) {
        let d = self.dims.map(f64::from);
        let mut lo = DVec3::INFINITY;
        let mut hi = DVec3::NEG_INFINITY;
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 1 { d[axis] } else { 0.0 };
            let p = self.index_to_world.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
            lo = lo.min(p);
            hi = hi.max(p);
        }
        (lo, hi)
    }
}

/// Runs `body` with `v` bound to the vector of whatever type the data have.
macro_rules! for_each_type {
    ($data:expr, $v:ident => $body:expr) => {
        match $data {
            VoxelData::U8($v) => $body,
            VoxelData::I8($v) => $body,
            VoxelData::U16($v) => $body,
            VoxelData::I16($v) => $body,
            VoxelData::U32($v) => $body,
            VoxelData::I32($v) => $body,
            VoxelData::F32($v) => $body,
            #[allow(clippy::useless_conversion, reason = "the body converts every type to f64")]
            VoxelData::F64($v) => $body,
        }
    };
}
pub(super) use for_each_type;

impl ScalarType {
    /// Bytes of one scalar.
    pub fn size(self) -> usize {
        match self {
            ScalarType::U8 | ScalarType::I8 => 1,
            ScalarType::U16 | ScalarType::I16 => 2,
            ScalarType::U32 | ScalarType::I32 | ScalarType::F32 => 4,
            ScalarType::F64 => 8,
        }
    }
}

/// As on the command line and in scene files: `u8`, `f64`.
impl fmt::Display for ScalarType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", format!("{self:?}").to_lowercase())
    }
}

impl VoxelData {
    /// Number of scalars.
    pub fn len(&self) -> usize {
        for_each_type!(self, v => v.len())
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The stored type.
    pub fn scalar_type(&self) -> ScalarType {
        match self {
            VoxelData::U8(_) => ScalarType::U8,
            VoxelData::I8(_) => ScalarType::I8,
            VoxelData::U16(_) => ScalarType::U16,
            VoxelData::I16(_) => ScalarType::I16,
            VoxelData::U32(_) => ScalarType::U32,
            VoxelData::I32(_) => ScalarType::I32,
            VoxelData::F32(_) => ScalarType::F32,
            VoxelData::F64(_) => ScalarType::F64,
        }
    }
}

impl Volume {
    /// Value of voxel `i` in the file's unit (e.g. Hounsfield units), slope and intercept applied.
    pub fn value(&self, i: usize) -> f64 {
        for_each_type!(&self.data, v => self.slope * f64::from(v[i]) + self.intercept)
    }

    /// Values of a range of voxels as f32, the form in which the GPU gets them: NaN becomes `nan_value` (use the
    /// least finite value, see [`Volume::range`]) and infinities and values beyond f32 become ±3e38.
    pub fn values_f32(&self, range: std::ops::Range<usize>, nan_value: f32) -> Vec<f32> {
        let (slope, intercept) = (self.slope, self.intercept);
        let convert = |stored: f64| {
            let v = (slope * stored + intercept) as f32;
            if v.is_nan() { nan_value } else { v.clamp(-3e38, 3e38) }
        };
        for_each_type!(&self.data, v => v[range].iter().map(|&s| convert(f64::from(s))).collect())
    }

    /// Least and greatest finite value; (0, 0) if there is none.
    pub fn range(&self) -> (f64, f64) {
        let mut lo = f64::INFINITY;
        let mut hi = f64::NEG_INFINITY;
        for_each_type!(&self.data, v => for &s in v {
            let x = self.slope * f64::from(s) + self.intercept;
            if x.is_finite() {
                lo = lo.min(x);
                hi = hi.max(x);
            }
        });
        if lo <= hi { (lo, hi) } else { (0.0, 0.0) }
    }
}
