//! Volumes: the voxel grid and its placement in the world, file formats, procedural phantoms, summaries.
//!
//! Every reader puts its data in world LPS (x towards the patient's left, y towards the back, z towards the head), so
//! that the same body loads to the same place from whichever format and axis order it was stored in.
//! A header is never believed: sizes are checked against the file's before memory is reserved.

mod fields;
pub mod grid;
mod metaimage;
mod nifti;
mod nrrd;
pub mod phantom;
mod source;
pub mod summary;

pub use grid::{Grid, ScalarType, Volume, VoxelData};
pub use summary::{Summary, active_fraction, summary};

use crate::{Error, Result};
use glam::{DMat3, DVec3};
use source::{Encoding, Payload};
use std::path::Path;

/// What a raw file does not say about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawLayout {
    /// Voxels along x, y, z (x fastest).
    pub dims: [u32; 3],
    /// Type of the stored scalars.
    pub scalar: ScalarType,
    /// Byte order of scalars of more than one byte.
    pub big_endian: bool,
    /// Voxel size in world units along x, y, z.
    pub spacing: [f64; 3],
    /// World position of the first voxel's centre.
    pub origin: [f64; 3],
    /// Bytes before the first scalar.
    pub skip: u64,
}

type Reader = fn(&Path) -> Result<Volume>;

/// File name endings with a header, and their readers. Longer endings come before their own tails.
const READERS: [(&str, Reader); 7] = [
    (".nrrd", nrrd::load),
    (".nhdr", nrrd::load),
    (".mha", metaimage::load),
    (".mhd", metaimage::load),
    (".nii.gz", nifti::load),
    (".nii", nifti::load),
    (".hdr", nifti::load),
];

/// Loads a volume; the reader follows from the file name's ending (.nrrd .nhdr .mha .mhd .nii .nii.gz .hdr, or any
/// other with a `raw` layout).
///
/// # Errors
/// The file cannot be read, its header is wrong or unsupported, or it holds less than the header promises.
pub fn load(path: &Path, raw: Option<&RawLayout>) -> Result<Volume> {
    let name = file_name(path).to_ascii_lowercase();
    let reader = READERS.iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, reader)| reader);
    match (reader, raw) {
        (Some(reader), None) => reader(path),
        (None, Some(layout)) => load_raw(path, layout),
        (Some(_), Some(_)) => Err(Error::file(
            path,
            "a raw layout was given, but this kind of file has a header that states it",
            "leave the raw layout out, or rename the file to .raw if it has no header",
        )),
        (None, None) if path.is_dir() => Err(Error::file(
            path,
            "this is a directory; DICOM folders are not read",
            "convert it to NIfTI or NRRD first, for example with dcm2niix",
        )),
        (None, None) => {
            let endings: Vec<_> = READERS.iter().map(|&(ending, _)| ending).collect();
            Err(Error::file(
                path,
                format!("no reader knows this file name (known: {})", endings.join(" ")),
                "for a raw file state its size and scalar type, else convert it to one of these formats",
            ))
        }
    }
}

fn load_raw(path: &Path, layout: &RawLayout) -> Result<Volume> {
    let what = |field: &str| format!("{}: raw {field}", path.display());
    let dims = Grid::checked_dims(layout.dims.map(u64::from), &what("size"))?;
    check_spacing(layout.spacing, &what("spacing"))?;
    let steps = DMat3::from_diagonal(DVec3::from(layout.spacing));
    let grid = Grid::checked(dims, steps, layout.origin, &what("spacing"), &what("origin"))?;
    let data = Payload {
        path,
        start: layout.skip,
        encoding: Encoding::Raw,
        skip: 0,
        scalar: layout.scalar,
        big_endian: layout.big_endian,
        voxels: grid.voxels(),
    }
    .read()?;
    Ok(Volume { name: file_name(path), grid, data, slope: 1.0, intercept: 0.0 })
}

/// Refuses spacings that are not positive (NaN included).
fn check_spacing(spacing: [f64; 3], what: &str) -> Result<()> {
    if spacing.iter().all(|&s| s > 0.0) {
        return Ok(());
    }
    Err(Error::input(what, format!("the spacing {spacing:?} is not positive"), "give three positive voxel sizes"))
}

/// Last part of the path, for messages and [`Volume::name`].
fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
