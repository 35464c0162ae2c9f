//! MetaImage (.mha, .mhd): <https://itk.org/Wiki/ITK/MetaIO/Documentation>. Its world is LPS.

use super::fields::{Fields, clip, next_line};
use super::source::{self, Encoding, Payload};
use super::{Grid, ScalarType, Volume, check_spacing, file_name};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::path::Path;

/// MetaIO's types. A MET_LONG has four bytes there on every machine.
const TYPES: [(&str, ScalarType); 10] = [
    ("MET_UCHAR", ScalarType::U8),
    ("MET_CHAR", ScalarType::I8),
    ("MET_USHORT", ScalarType::U16),
    ("MET_SHORT", ScalarType::I16),
    ("MET_UINT", ScalarType::U32),
    ("MET_INT", ScalarType::I32),
    ("MET_ULONG", ScalarType::U32),
    ("MET_LONG", ScalarType::I32),
    ("MET_FLOAT", ScalarType::F32),
    ("MET_DOUBLE", ScalarType::F64),
];

/// The field that ends the header.
const DATA_FILE: &str = "ElementDataFile";

/// Loads a volume with its data in the same file or beside it.
pub(super) fn load(path: &Path) -> Result<Volume> {
    let head = source::read_head(path)?;
    let (fields, header_end) = parse(path, &head)?;
    let grid = placement(&fields)?;
    let scalar = scalar_type(&fields)?;
    if !flag(&fields, &["BinaryData"], true)? {
        return Err(fields.error("BinaryData", "data written as text are not read", "write the image as binary data"));
    }
    let compressed = flag(&fields, &["CompressedData"], false)?;

    let data_file = fields.need(DATA_FILE)?;
    let local = data_file.eq_ignore_ascii_case("local");
    if data_file.starts_with("LIST") || data_file.contains('%') {
        return Err(fields.error(
            DATA_FILE,
            "data spread over several files are not read",
            "write the image as one .mha file",
        ));
    }
    let data_path = if local { path.to_owned() } else { fields.sibling(data_file) };
    let mut payload = Payload {
        path: &data_path,
        start: if local { header_end } else { 0 },
        encoding: if compressed { Encoding::Zlib } else { Encoding::Raw },
        skip: 0,
        scalar,
        big_endian: flag(&fields, &["ElementByteOrderMSB", "BinaryDataByteOrderMSB"], false)?,
        voxels: grid.voxels(),
    };
    let header_size: i64 = fields.get("HeaderSize").map_or(Ok(0), |text| fields.parse("HeaderSize", text))?;
    match header_size {
        0 => {}
        // "The end of the file".
        -1 if !compressed => {
            let (_, size) = source::open(&data_path)?;
            payload.start =
                size.checked_sub(payload.bytes()).filter(|&start| start >= payload.start).ok_or_else(|| {
                    fields.error(
                        "HeaderSize",
                        format!(
                            "-1 asks for the last {} bytes of {}, which has {size}",
                            payload.bytes(),
                            data_path.display()
                        ),
                        "correct the size and the type, or copy the data file again if it is truncated",
                    )
                })?;
        }
        // Counted from the start of the file, also when the header itself stands there.
        1.. if header_size as u64 >= payload.start => payload.start = header_size as u64,
        _ => {
            return Err(fields.error(
                "HeaderSize",
                format!("{header_size} is not possible here"),
                "give the bytes before the data, counted from the start of their file, or -1 for uncompressed data",
            ));
        }
    }
    Ok(Volume { name: file_name(path), grid, data: payload.read()?, slope: 1.0, intercept: 0.0 })
}

/// The fields and the file offset behind the header.
fn parse(path: &Path, head: &[u8]) -> Result<(Fields, u64)> {
    let mut fields = Fields::new(path);
    let mut at = 0;
    while let Some(line) = next_line(head, &mut at) {
        let line = String::from_utf8_lossy(line);
        if line.trim().is_empty() {
            continue;
        }
        let Some((name, value)) = line.split_once('=') else {
            return Err(Error::file(
                path,
                format!("the header line '{}' is not 'Field = value'", clip(&line)),
                "name a MetaImage file, or correct its header",
            ));
        };
        fields.insert(name, value)?;
        if name.trim().eq_ignore_ascii_case(DATA_FILE) {
            return Ok((fields, at as u64));
        }
    }
    Err(fields.error(DATA_FILE, "the header ends without this field", "copy the file again if it is truncated"))
}

fn scalar_type(fields: &Fields) -> Result<ScalarType> {
    let text = fields.need("ElementType")?;
    if let Some(channels) = fields.get("ElementNumberOfChannels")
        && channels != "1"
    {
        return Err(fields.error(
            "ElementNumberOfChannels",
            format!("'{}' channels instead of 1", clip(channels)),
            "give a volume of one scalar per voxel",
        ));
    }
    TYPES.iter().find(|(name, _)| *name == text).map(|&(_, scalar)| scalar).ok_or_else(|| {
        let known: Vec<_> = TYPES.iter().map(|&(name, _)| name).collect();
        fields.error(
            "ElementType",
            format!("'{}' is not supported", clip(text)),
            format!("use one of {}", known.join(" ")),
        )
    })
}

/// A field that is True or False, by any of its names.
fn flag(fields: &Fields, names: &[&str], default: bool) -> Result<bool> {
    let Some((name, text)) = fields.any(names) else { return Ok(default) };
    match text.to_ascii_lowercase().as_str() {
        "true" | "t" | "1" => Ok(true),
        "false" | "f" | "0" => Ok(false),
        _ => Err(fields.error(name, format!("'{}' is neither True nor False", clip(text)), "correct the header")),
    }
}

fn placement(fields: &Fields) -> Result<Grid> {
    let dimensions: u32 = fields.parse("NDims", fields.need("NDims")?)?;
    if dimensions != 3 {
        return Err(fields.error(
            "NDims",
            format!("the image has {dimensions} dimensions, not 3"),
            "take one 3D volume out of it first",
        ));
    }
    let dims = Grid::checked_dims(fields.numbers("DimSize", fields.need("DimSize")?)?, &fields.what("DimSize"))?;
    // ElementSize is the voxel's own size; it stands in for the distance of centres where that is missing.
    let (spacing_field, spacing) = match fields.any(&["ElementSpacing", "ElementSize"]) {
        Some((name, text)) => (name, fields.numbers(name, text)?),
        None => ("ElementSpacing", [1.0; 3]),
    };
    check_spacing(spacing, &fields.what(spacing_field))?;
    let (origin_field, origin) = match fields.any(&["Offset", "Position", "Origin"]) {
        Some((name, text)) => (name, fields.numbers(name, text)?),
        None => ("Offset", [0.0; 3]),
    };
    // The matrix decides where both are given, as in ITK. Its first three numbers are the direction of the x axis.
    let (steps_field, directions) =
        if let Some((name, text)) = fields.any(&["TransformMatrix", "Rotation", "Orientation"]) {
            (name, DMat3::from_cols_array(&fields.numbers(name, text)?))
        } else if let Some(letters) = fields.get("AnatomicalOrientation").filter(|letters| !letters.contains('?')) {
            ("AnatomicalOrientation", anatomical(fields, letters)?)
        } else {
            (spacing_field, DMat3::IDENTITY)
        };
    let steps = directions * DMat3::from_diagonal(DVec3::from(spacing));
    Grid::checked(dims, steps, origin, &fields.what(steps_field), &fields.what(origin_field))
}

/// Axis directions from three letters, each the side that its axis comes *from*, as MetaIO writes them: RAI is LPS.
fn anatomical(fields: &Fields, letters: &str) -> Result<DMat3> {
    let direction = |letter| match letter {
        'R' => Some(DVec3::X),
        'L' => Some(DVec3::NEG_X),
        'A' => Some(DVec3::Y),
        'P' => Some(DVec3::NEG_Y),
        'I' => Some(DVec3::Z),
        'S' => Some(DVec3::NEG_Z),
        _ => None,
    };
    let columns: Option<Vec<DVec3>> = letters.chars().map(direction).collect();
    match columns.as_deref() {
        Some(&[x, y, z]) if DMat3::from_cols(x, y, z).determinant() != 0.0 => Ok(DMat3::from_cols(x, y, z)),
        _ => Err(fields.error(
            "AnatomicalOrientation",
            format!("'{}' does not name each of the three axes once", clip(letters)),
            "use one letter each of R/L, A/P and I/S, for example RAI",
        )),
    }
}
