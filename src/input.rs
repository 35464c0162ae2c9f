//! Files that are read.

use crate::{Error, Result};
use image::{ImageDecoder, ImageFormat, ImageReader};
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{BufRead, Read, Seek};
use std::path::Path;

/// Opens a regular file and gives its size. Devices and pipes are refused, since they may never end. `expected` completes
/// "name ...".
pub fn open(path: &Path, expected: &str) -> Result<(File, u64)> {
    // Ask before opening: opening a pipe would wait for its writer.
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, "open", e))?;
    if !metadata.is_file() {
        return Err(Error::file(path, "this is not a regular file", format!("name {expected}")));
    }
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    Ok((file, metadata.len()))
}

/// Largest text file that is read, in bytes.
const MAX_TEXT_BYTES: u64 = 1 << 24;

/// Reads a text file of bounded size; `expected` completes "name ...".
pub fn read_text(path: &Path, expected: &str) -> Result<String> {
    let (mut file, size) = open(path, expected)?;
    if size > MAX_TEXT_BYTES {
        return Err(Error::file(path, format!("is {size} bytes long"), format!("give {expected}")));
    }
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|e| Error::io(path, "read", e))?;
    String::from_utf8(bytes).map_err(|_| Error::file(path, "is not text", format!("give {expected}")))
}

/// Line (from 1) and text of the line in which byte `at` lies.
pub fn line_of(text: &str, at: usize) -> (usize, &str) {
    let start = text[..at].rfind('\n').map_or(0, |n| n + 1);
    let line = text[start..].lines().next().unwrap_or("");
    (text[..at].matches('\n').count() + 1, line.trim())
}

/// Parses the TOML of a file; an error names the line, and `cure`.
pub fn parse_toml<T: DeserializeOwned>(text: &str, path: &Path, cure: &str) -> Result<T> {
    toml::from_str(text).map_err(|e| {
        let (what, line) = match e.span() {
            Some(span) => {
                let (number, line) = line_of(text, span.start.min(text.len()));
                (format!("{}:{number}", path.display()), format!(" in `{line}`"))
            }
            None => (path.display().to_string(), String::new()),
        };
        let problem = format!("{}{line}", e.message().trim_end().replace('\n', ", "));
        Error::input(what, problem, cure)
    })
}

/// Deflate turns a byte into so many at most.
const DEFLATE: u64 = 1032;

/// Pixels that a byte of an image file holds at most.
fn most_pixels_per_byte(format: Option<ImageFormat>) -> u64 {
    match format {
        // A run of 127 pixels takes two bytes in each of four channels.
        Some(ImageFormat::Hdr) => 16,
        // A half float or more.
        Some(ImageFormat::OpenExr) => DEFLATE / 2,
        // A byte or more: what has less is no picture of ours.
        _ => DEFLATE,
    }
}

/// Decodes an image of a file of so many bytes, which must be enough for the size that its header promises, before memory is
/// reserved for it.
///
/// # Errors
/// In words that complete "the file ...".
pub fn decode<R: BufRead + Seek>(
    mut reader: ImageReader<R>,
    file_bytes: u64,
    most_pixels: u64,
) -> std::result::Result<image::DynamicImage, String> {
    if reader.format() == Some(ImageFormat::OpenExr) {
        let mut inner = reader.into_inner();
        check_blocks(&mut inner, file_bytes)?;
        inner.rewind().map_err(|e| format!("cannot be read: {e}"))?;
        reader = ImageReader::with_format(inner, ImageFormat::OpenExr);
    }
    // Ours go by the decoder's word on the size.
    reader.no_limits();
    let most = file_bytes.saturating_mul(most_pixels_per_byte(reader.format()));
    let decoder = reader.into_decoder().map_err(|e| format!("cannot be decoded: {e}"))?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > most_pixels {
        return Err(format!("has {width} x {height} pixels, but 1 to {most_pixels} are allowed"));
    }
    if pixels > most {
        return Err(format!("promises {width} x {height} pixels, but has {file_bytes} bytes only"));
    }
    image::DynamicImage::from_decoder(decoder).map_err(|e| format!("cannot be decoded: {e}"))
}

/// Refuses an EXR whose header speaks of blocks that the file cannot hold: the decoder reserves memory for a whole one.
fn check_blocks(reader: &mut impl Read, file_bytes: u64) -> std::result::Result<(), String> {
    /// A tile of 1024 x 1024 pixels of four floats, as a small file may have.
    const USUAL: u64 = 16 << 20;
    let meta = exr::meta::MetaData::read_from_buffered(reader, false).map_err(|e| format!("cannot be decoded: {e}"))?;
    let largest = meta.headers.iter().map(|header| header.max_block_byte_size() as u64).max().unwrap_or(0);
    if largest > USUAL.max(file_bytes.saturating_mul(DEFLATE)) {
        return Err(format!("promises blocks of {largest} bytes, but has {file_bytes} bytes only"));
    }
    Ok(())
}
