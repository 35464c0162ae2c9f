//! NRRD and NHDR: <https://teem.sourceforge.net/nrrd/format.html>, magics NRRD0001 to NRRD0005.

use super::fields::{Fields, clip, next_line};
use super::source::{self, Encoding, MAX_HEADER, Payload};
use super::{Grid, ScalarType, Volume, check_spacing, file_name};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::path::Path;

/// Spellings of the types, from the definition's "type" field.
const TYPES: [(ScalarType, &[&str]); 8] = [
    (ScalarType::I8, &["signed char", "int8", "int8_t"]),
    (ScalarType::U8, &["uchar", "unsigned char", "uint8", "uint8_t"]),
    (ScalarType::I16, &["short", "short int", "signed short", "signed short int", "int16", "int16_t"]),
    (ScalarType::U16, &["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"]),
    (ScalarType::I32, &["int", "signed int", "int32", "int32_t"]),
    (ScalarType::U32, &["uint", "unsigned int", "uint32", "uint32_t"]),
    (ScalarType::F32, &["float"]),
    (ScalarType::F64, &["double"]),
];

/// Three-dimensional spaces with the signs that turn their coordinates into LPS. A space without anatomical names
/// keeps its coordinates; a left-handed one has its first axis turned, since the world is right-handed and nothing
/// may come out mirrored.
const SPACES: [(&str, &str, [f64; 3]); 6] = [
    ("left-posterior-superior", "lps", [1.0, 1.0, 1.0]),
    ("right-anterior-superior", "ras", [-1.0, -1.0, 1.0]),
    ("left-anterior-superior", "las", [1.0, -1.0, 1.0]),
    ("scanner-xyz", "scanner-xyz", [1.0, 1.0, 1.0]),
    ("3d-right-handed", "3d-right-handed", [1.0, 1.0, 1.0]),
    ("3d-left-handed", "3d-left-handed", [-1.0, 1.0, 1.0]),
];

/// What `kinds` may say of an axis that is one of space.
const SPATIAL_KINDS: [&str; 4] = ["domain", "space", "none", "???"];

const CONVERT: &str = "convert it, for example with `unu save -f nrrd -e gzip -i FILE -o NEW.nrrd`";

/// Loads a volume with an attached or a detached header.
pub(super) fn load(path: &Path) -> Result<Volume> {
    let head = source::read_head(path)?;
    let (fields, header_end) = parse(path, &head)?;
    let grid = placement(&fields)?;
    let scalar = scalar_type(&fields)?;
    let encoding = encoding(&fields)?;
    let (data_path, start) = match fields.get("data file") {
        None => (path.to_owned(), header_end),
        Some(text) if text.starts_with("LIST") || text.contains('%') => {
            return Err(fields.error("data file", "data spread over several files are not read", CONVERT));
        }
        Some(text) => (fields.sibling(text), 0),
    };
    let lines: u64 = fields.get("line skip").map_or(Ok(0), |text| fields.parse("line skip", text))?;
    let bytes: i64 = fields.get("byte skip").map_or(Ok(0), |text| fields.parse("byte skip", text))?;
    let mut payload = Payload {
        path: &data_path,
        start: source::skip_lines(&data_path, start, lines)?,
        encoding,
        skip: 0,
        scalar,
        big_endian: big_endian(&fields, scalar)?,
        voxels: grid.voxels(),
    };
    // In compressed data `line skip` counts packed and `byte skip` unpacked bytes; -1 means "the end of the file".
    match (bytes, encoding) {
        (-1, Encoding::Raw) => {
            let (_, size) = source::open(&data_path)?;
            payload.start = size.checked_sub(payload.bytes()).ok_or_else(|| {
                fields.error(
                    "byte skip",
                    format!(
                        "-1 asks for the last {} bytes of {}, which has {size}",
                        payload.bytes(),
                        data_path.display()
                    ),
                    "correct the sizes and the type, or copy the data file again if it is truncated",
                )
            })?;
        }
        (0.., _) => payload.skip = bytes as u64,
        _ => return Err(fields.error("byte skip", format!("{bytes} is not possible here"), "give 0 or more bytes")),
    }
    Ok(Volume { name: file_name(path), grid, data: payload.read()?, slope: 1.0, intercept: 0.0 })
}

/// The fields and the file offset behind the header.
fn parse(path: &Path, head: &[u8]) -> Result<(Fields, u64)> {
    let mut fields = Fields::new(path);
    let mut at = 0;
    let magic = next_line(head, &mut at).unwrap_or_default();
    if !matches!(magic, b"NRRD0001" | b"NRRD0002" | b"NRRD0003" | b"NRRD0004" | b"NRRD0005") {
        return Err(Error::file(
            path,
            "the first line is not NRRD0001 to NRRD0005",
            "name an NRRD file, or give the file the ending of its real format",
        ));
    }
    while let Some(line) = next_line(head, &mut at) {
        if line.is_empty() {
            return Ok((fields, at as u64));
        }
        add_line(&mut fields, path, &String::from_utf8_lossy(line))?;
    }
    // Only a detached header may end with its file.
    if fields.get("data file").is_none() || head.len() as u64 >= MAX_HEADER {
        return Err(Error::file(
            path,
            format!("the header does not end: no empty line within {} bytes", head.len()),
            "copy the file again if it is truncated, or add 'data file:' to a detached header",
        ));
    }
    Ok((fields, at as u64))
}

/// Takes in one header line: `field: value`; comments (`#`) and keys of the user's own (`key:=value`) are passed over.
fn add_line(fields: &mut Fields, path: &Path, line: &str) -> Result<()> {
    if line.starts_with('#') {
        return Ok(());
    }
    match line.split_once(':') {
        Some((_, value)) if value.starts_with('=') => Ok(()),
        Some((name, value)) => fields.insert(name, value),
        None => Err(Error::file(
            path,
            format!("the header line '{}' is not 'field: value'", clip(line)),
            "correct the header; an empty line must stand between it and attached data",
        )),
    }
}

fn scalar_type(fields: &Fields) -> Result<ScalarType> {
    let text = fields.need("type")?.to_ascii_lowercase();
    let found = TYPES.iter().find(|(_, names)| names.contains(&text.as_str()));
    found.map(|&(scalar, _)| scalar).ok_or_else(|| {
        fields.error(
            "type",
            format!("'{}' is not supported", clip(&text)),
            "convert to 8, 16 or 32-bit integers, float or double",
        )
    })
}

fn encoding(fields: &Fields) -> Result<Encoding> {
    match fields.need("encoding")?.to_ascii_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gzip" | "gz" => Ok(Encoding::Gzip),
        other => {
            Err(fields.error("encoding", format!("'{}' is not read, only raw and gzip are", clip(other)), CONVERT))
        }
    }
}

fn big_endian(fields: &Fields, scalar: ScalarType) -> Result<bool> {
    match fields.get("endian").map(str::to_ascii_lowercase).as_deref() {
        Some("little") => Ok(false),
        Some("big") => Ok(true),
        None if scalar.size() == 1 => Ok(false),
        None => Err(fields.error(
            "endian",
            format!("missing, but {scalar} has several bytes"),
            "add 'endian: little' or 'endian: big'",
        )),
        Some(other) => {
            Err(fields.error("endian", format!("'{}' is neither little nor big", clip(other)), "correct the header"))
        }
    }
}

/// Size and place of the grid, in LPS.
fn placement(fields: &Fields) -> Result<Grid> {
    let dimension: u32 = fields.parse("dimension", fields.need("dimension")?)?;
    if dimension != 3 {
        return Err(fields.error(
            "dimension",
            format!(
                "the data have {dimension} dimensions (sizes {}), not 3",
                clip(fields.get("sizes").unwrap_or("missing"))
            ),
            "take one 3D volume out first, for example with `unu slice -a AXIS -p INDEX`, also for an axis of size 1",
        ));
    }
    if let Some(kinds) = fields.get("kinds")
        && let Some(kind) = kinds.split_whitespace().find(|k| !SPATIAL_KINDS.contains(&k.to_ascii_lowercase().as_str()))
    {
        return Err(fields.error(
            "kinds",
            format!("an axis is of kind '{}', not one of space", clip(kind)),
            "give a volume of one scalar per voxel with three axes of space",
        ));
    }
    let dims = Grid::checked_dims(fields.numbers("sizes", fields.need("sizes")?)?, &fields.what("sizes"))?;

    let to_lps = DMat3::from_diagonal(space_signs(fields)?);
    let (steps, steps_field) = match (fields.get("space directions"), fields.get("spacings")) {
        (Some(text), _) => {
            let columns = vectors::<3>(fields, "space directions", text)?;
            (DMat3::from_cols_array_2d(&columns), "space directions")
        }
        (None, Some(text)) => {
            let spacing = fields.numbers("spacings", text)?;
            check_spacing(spacing, &fields.what("spacings"))?;
            (DMat3::from_diagonal(DVec3::from(spacing)), "spacings")
        }
        (None, None) => (DMat3::IDENTITY, "spacings"),
    };
    let origin = match fields.get("space origin") {
        None => DVec3::ZERO,
        Some(text) => {
            let [origin] = vectors::<1>(fields, "space origin", text)?;
            DVec3::from(origin)
        }
    };
    Grid::checked(
        dims,
        to_lps * steps,
        (to_lps * origin).to_array(),
        &fields.what(steps_field),
        &fields.what("space origin"),
    )
}

/// Signs that turn the coordinates of the file's space into LPS.
fn space_signs(fields: &Fields) -> Result<DVec3> {
    if let Some(text) = fields.get("space dimension")
        && fields.parse::<u32>("space dimension", text)? != 3
    {
        return Err(fields.error(
            "space dimension",
            format!("'{}' is not 3", clip(text)),
            "give the volume a 3D space",
        ));
    }
    let Some(space) = fields.get("space") else { return Ok(DVec3::ONE) };
    let space = space.to_ascii_lowercase();
    let found = SPACES.iter().find(|(long, short, _)| *long == space || *short == space);
    found.map(|&(_, _, signs)| DVec3::from(signs)).ok_or_else(|| {
        let known: Vec<_> = SPACES.iter().map(|&(long, _, _)| long).collect();
        fields.error("space", format!("'{}' is not known", clip(&space)), format!("use one of {}", known.join(", ")))
    })
}

/// N vectors of the form `(x,y,z)`.
fn vectors<const N: usize>(fields: &Fields, name: &str, text: &str) -> Result<[[f64; 3]; N]> {
    let wrong = || {
        fields.error(
            name,
            format!("'{}' is not {N} vector(s) of the form (x,y,z)", clip(text)),
            "correct the header; an axis without a direction ('none') must be taken out of the data first",
        )
    };
    let mut found = Vec::new();
    for vector in text.trim().split_terminator(')') {
        let inner = vector.trim().strip_prefix('(').ok_or_else(wrong)?;
        let parts: Option<Vec<f64>> = inner.split(',').map(|c| c.trim().parse().ok()).collect();
        found.push(parts.and_then(|parts| parts.try_into().ok()).ok_or_else(wrong)?);
    }
    found.try_into().map_err(|_| wrong())
}
