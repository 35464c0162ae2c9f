//! NIfTI-1 and NIfTI-2 (.nii, .nii.gz, .hdr with .img), either byte order: <https://nifti.nimh.nih.gov/>. Its world is
//! RAS and is turned into LPS.

use super::source::{self, Encoding, Payload};
use super::{Grid, ScalarType, Volume, check_spacing, file_name};
use crate::{Error, Result};
use glam::{DMat3, DQuat, DVec3};
use std::path::{Path, PathBuf};

/// Byte offsets of the fields in one version of the header (nifti1.h, nifti2.h).
struct Layout {
    /// Size of the header, which is also its first field and tells versions and byte orders apart.
    size: usize,
    magic: usize,
    dim: usize,
    datatype: usize,
    pixdim: usize,
    vox_offset: usize,
    scl_slope: usize,
    scl_inter: usize,
    qform_code: usize,
    sform_code: usize,
    /// Three quaternion numbers, then three offsets.
    quatern_b: usize,
    /// Three rows of four.
    srow_x: usize,
}

const NIFTI1: Layout = Layout {
    size: 348,
    magic: 344,
    dim: 40,
    datatype: 70,
    pixdim: 76,
    vox_offset: 108,
    scl_slope: 112,
    scl_inter: 116,
    qform_code: 252,
    sform_code: 254,
    quatern_b: 256,
    srow_x: 280,
};

const NIFTI2: Layout = Layout {
    size: 540,
    magic: 4,
    dim: 16,
    datatype: 12,
    pixdim: 104,
    vox_offset: 168,
    scl_slope: 176,
    scl_inter: 184,
    qform_code: 344,
    sform_code: 348,
    quatern_b: 352,
    srow_x: 400,
};

/// Codes of `datatype`.
const TYPES: [(i16, ScalarType); 8] = [
    (2, ScalarType::U8),
    (4, ScalarType::I16),
    (8, ScalarType::I32),
    (16, ScalarType::F32),
    (64, ScalarType::F64),
    (256, ScalarType::I8),
    (512, ScalarType::U16),
    (768, ScalarType::U32),
];

/// Header bytes with the version's layout and byte order.
struct Header<'a> {
    path: &'a Path,
    bytes: Vec<u8>,
    layout: &'static Layout,
    big_endian: bool,
}

/// Loads a single-file volume, or a header with its `.img` file.
pub(super) fn load(path: &Path) -> Result<Volume> {
    let gzip = file_name(path).to_ascii_lowercase().ends_with(".gz");
    let header = Header::read(path, gzip)?;
    let grid = header.placement()?;
    let scalar = header.scalar_type()?;
    let (slope, intercept) = header.scaling()?;
    let (data_path, offset) = header.data_place()?;
    let payload = Payload {
        path: &data_path,
        start: if gzip { 0 } else { offset },
        encoding: if gzip { Encoding::Gzip } else { Encoding::Raw },
        skip: if gzip { offset } else { 0 },
        scalar,
        big_endian: header.big_endian,
        voxels: grid.voxels(),
    };
    Ok(Volume { name: file_name(path), grid, data: payload.read()?, slope, intercept })
}

impl<'a> Header<'a> {
    fn read(path: &'a Path, gzip: bool) -> Result<Self> {
        let longest = NIFTI2.size;
        let mut bytes = if gzip { source::read_gzip_head(path, longest as u64)? } else { source::read_head(path)? };
        bytes.truncate(longest);
        let first = bytes.first_chunk::<4>().copied().unwrap_or_default();
        let versions = [(&NIFTI1, false), (&NIFTI1, true), (&NIFTI2, false), (&NIFTI2, true)];
        let version = versions.into_iter().find(|(layout, big_endian)| {
            let size = if *big_endian { u32::from_be_bytes(first) } else { u32::from_le_bytes(first) };
            size as usize == layout.size
        });
        let Some((layout, big_endian)) = version else {
            return Err(Error::input(
                format!("{}: field 'sizeof_hdr'", path.display()),
                "it is neither 348 (NIfTI-1) nor 540 (NIfTI-2)",
                "name a NIfTI file, or give the file the ending of its real format",
            ));
        };
        if bytes.len() < layout.size {
            return Err(Error::file(
                path,
                format!("the file ends after {} of {} bytes of header", bytes.len(), layout.size),
                "copy or download the file again",
            ));
        }
        Ok(Self { path, bytes, layout, big_endian })
    }

    fn version2(&self) -> bool {
        self.layout.size == NIFTI2.size
    }

    fn what(&self, field: &str) -> String {
        format!("{}: field '{field}'", self.path.display())
    }

    fn take<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes: [u8; N] = self.bytes[at..at + N].try_into().expect("a slice of N bytes");
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.take(at))
    }

    /// Element `i` of `dim`.
    fn dim(&self, i: usize) -> i64 {
        let at = self.layout.dim;
        if self.version2() { i64::from_le_bytes(self.take(at + 8 * i)) } else { i64::from(self.i16(at + 2 * i)) }
    }

    /// qform_code or sform_code.
    fn code(&self, at: usize) -> i32 {
        if self.version2() { i32::from_le_bytes(self.take(at)) } else { i32::from(self.i16(at)) }
    }

    /// Element `i` of the real numbers at `at`.
    fn real(&self, at: usize, i: usize) -> f64 {
        if self.version2() {
            f64::from_le_bytes(self.take(at + 8 * i))
        } else {
            f64::from(f32::from_le_bytes(self.take(at + 4 * i)))
        }
    }

    fn vector(&self, at: usize, first: usize) -> DVec3 {
        DVec3::new(self.real(at, first), self.real(at, first + 1), self.real(at, first + 2))
    }

    fn scalar_type(&self) -> Result<ScalarType> {
        let code = self.i16(self.layout.datatype);
        TYPES.iter().find(|(known, _)| *known == code).map(|&(_, scalar)| scalar).ok_or_else(|| {
            let known: Vec<_> = TYPES.iter().map(|(code, scalar)| format!("{code} ({scalar})")).collect();
            Error::input(
                self.what("datatype"),
                format!("{code} is not supported"),
                format!("convert the data to one of {}", known.join(", ")),
            )
        })
    }

    /// value = slope * stored + intercept; a slope of 0 (or none) means "not scaled".
    fn scaling(&self) -> Result<(f64, f64)> {
        let slope = self.real(self.layout.scl_slope, 0);
        let intercept = self.real(self.layout.scl_inter, 0);
        if slope == 0.0 || slope.is_nan() {
            return Ok((1.0, 0.0));
        }
        if !slope.is_finite() || !intercept.is_finite() {
            return Err(Error::input(
                self.what("scl_slope"),
                format!("the scaling {slope} * stored + {intercept} is not finite"),
                "set scl_slope to 0 for data that are not scaled",
            ));
        }
        Ok((slope, intercept))
    }

    /// The file with the voxels and their offset in it (unpacked).
    fn data_place(&self) -> Result<(PathBuf, u64)> {
        let magic = &self.bytes[self.layout.magic..self.layout.magic + 4];
        let offset = if self.version2() {
            i64::from_le_bytes(self.take(self.layout.vox_offset)) as f64
        } else {
            self.real(self.layout.vox_offset, 0)
        };
        let bad_offset = |problem: String| {
            Err(Error::input(self.what("vox_offset"), problem, "correct the header, or convert the file again"))
        };
        // Beyond 2⁵³ neither the float nor any file is exact.
        if !(0.0..9.0e15).contains(&offset) || offset.fract() != 0.0 {
            return bad_offset(format!("{offset} is not a file offset"));
        }
        let offset = offset as u64;
        match magic {
            b"n+1\0" | b"n+2\0" => {
                // Four bytes after the header say whether extensions follow. Some writers leave the offset 0.
                let least = self.layout.size as u64 + 4;
                match offset {
                    0 => Ok((self.path.to_owned(), least)),
                    _ if offset < self.layout.size as u64 => bad_offset(format!("{offset} lies within the header")),
                    _ => Ok((self.path.to_owned(), offset)),
                }
            }
            b"ni1\0" | b"ni2\0" if !self.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz")) => {
                Ok((self.path.with_extension("img"), offset))
            }
            b"ni1\0" | b"ni2\0" => Err(Error::file(
                self.path,
                "a compressed header with a separate .img file is not read",
                "unpack both files, or convert them to one .nii.gz file",
            )),
            _ => Err(Error::input(
                self.what("magic"),
                "it is not that of NIfTI (an Analyze file has no magic and no orientation)",
                "convert the file to NIfTI",
            )),
        }
    }

    fn placement(&self) -> Result<Grid> {
        let what_dim = self.what("dim");
        let count = self.dim(0);
        if !(1..=7).contains(&count) {
            return Err(Error::input(
                what_dim,
                format!("{count} dimensions are not possible"),
                "the header is damaged: copy or convert the file again",
            ));
        }
        let size = |i: usize| if i as i64 <= count { self.dim(i) } else { 1 };
        if size(4) > 1 {
            return Err(Error::input(
                what_dim,
                format!("the file holds a series of {} volumes", size(4)),
                "take one out first, for example with `fslroi IN OUT 0 1`",
            ));
        }
        if let Some(i) = (5..=7).find(|&i| size(i) > 1) {
            return Err(Error::input(
                what_dim,
                format!("the file holds {} numbers per voxel (dimension {i})", size(i)),
                "take one scalar volume out first",
            ));
        }
        let dims = [size(1), size(2), size(3)];
        if let Some(negative) = dims.iter().find(|&&d| d < 0) {
            return Err(Error::input(what_dim, format!("the size {negative} is negative"), "correct the header"));
        }
        let dims = Grid::checked_dims(dims.map(i64::unsigned_abs), &what_dim)?;

        let l = self.layout;
        let ras_to_lps = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        let (steps, origin, steps_field, origin_field) = if self.code(l.sform_code) > 0 {
            let rows = [0, 1, 2].map(|row| self.vector(l.srow_x, 4 * row));
            let steps = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            let origin = [0, 1, 2].map(|row| self.real(l.srow_x, 4 * row + 3));
            (steps, DVec3::from(origin), "srow_x", "srow_x")
        } else {
            let spacing = self.vector(l.pixdim, 1);
            check_spacing(spacing.to_array(), &self.what("pixdim"))?;
            if self.code(l.qform_code) > 0 {
                // qfac: a left-handed index system is stored as a rotation with z turned round.
                let qfac = if self.real(l.pixdim, 0) < 0.0 { -1.0 } else { 1.0 };
                let steps = self.rotation()? * DMat3::from_diagonal(spacing * DVec3::new(1.0, 1.0, qfac));
                (steps, self.vector(l.quatern_b, 3), "pixdim", "qoffset_x")
            } else {
                (DMat3::from_diagonal(spacing), DVec3::ZERO, "pixdim", "pixdim")
            }
        };
        Grid::checked(
            dims,
            ras_to_lps * steps,
            (ras_to_lps * origin).to_array(),
            &self.what(steps_field),
            &self.what(origin_field),
        )
    }

    /// The rotation that the three stored numbers of a unit quaternion mean.
    fn rotation(&self) -> Result<DMat3> {
        let bcd = self.vector(self.layout.quatern_b, 0);
        if !bcd.is_finite() {
            return Err(Error::input(
                self.what("quatern_b"),
                format!("the quaternion {bcd} is not finite"),
                "correct the header, or set qform_code to 0",
            ));
        }
        // Near a half turn rounding decides a², so it counts as 0 there (nifti1_io.c has the same bound).
        let a_squared = 1.0 - bcd.length_squared();
        let a = if a_squared < 1e-7 { 0.0 } else { a_squared.sqrt() };
        Ok(DMat3::from_quat(DQuat::from_xyzw(bcd.x, bcd.y, bcd.z, a).normalize()))
    }
}
