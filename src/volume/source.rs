//! Voxels from a file: raw, gzip or zlib, with every size checked before memory is reserved for it.

use super::{ScalarType, VoxelData};
use crate::{Error, Result};
use flate2::bufread::{GzDecoder, ZlibDecoder};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Deflate turns one byte into at most 1032: a 258-byte match coded in 2 bits.
const MAX_DEFLATE_RATIO: u64 = 1032;

/// Bytes converted at a time; a multiple of every scalar's size.
const CHUNK: usize = 1 << 18;

/// Longest text header that is read.
pub(super) const MAX_HEADER: u64 = 1 << 20;

/// How the voxels are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Gzip,
    Zlib,
}

/// Where the voxels lie and how to read them.
pub(super) struct Payload<'a> {
    /// The file that holds them.
    pub path: &'a Path,
    /// File offset of the (compressed) data.
    pub start: u64,
    /// How they are packed.
    pub encoding: Encoding,
    /// Bytes to skip after unpacking.
    pub skip: u64,
    /// Type of the stored scalars.
    pub scalar: ScalarType,
    /// Byte order of scalars of more than one byte.
    pub big_endian: bool,
    /// Number of scalars.
    pub voxels: u64,
}

/// Opens a volume's file and gives its size.
pub(super) fn open(path: &Path) -> Result<(File, u64)> {
    crate::input::open(path, "a file that holds the volume")
}

/// The first bytes of a file, at most [`MAX_HEADER`] of them.
pub(super) fn read_head(path: &Path) -> Result<Vec<u8>> {
    let (file, _) = open(path)?;
    let mut head = Vec::new();
    file.take(MAX_HEADER).read_to_end(&mut head).map_err(|e| Error::io(path, "read", e))?;
    Ok(head)
}

/// First bytes of what a gzip file unpacks to, at most `limit` of them.
pub(super) fn read_gzip_head(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let (file, _) = open(path)?;
    let mut head = Vec::new();
    match GzDecoder::new(BufReader::new(file)).take(limit).read_to_end(&mut head) {
        // A short file is reported by the caller, who knows how much it needs.
        Err(e) if e.kind() != io::ErrorKind::UnexpectedEof => Err(damaged(path, &e)),
        _ => Ok(head),
    }
}

/// File offset behind the next `lines` line ends after `start`.
pub(super) fn skip_lines(path: &Path, start: u64, lines: u64) -> Result<u64> {
    let fail = |e| Error::io(path, "read", e);
    let (mut file, _) = open(path)?;
    file.seek(SeekFrom::Start(start)).map_err(fail)?;
    let mut reader = BufReader::new(file);
    let mut offset = start;
    for _ in 0..lines {
        let n = reader.skip_until(b'\n').map_err(fail)?;
        if n == 0 {
            return Err(Error::file(
                path,
                format!("the file ends within the {lines} lines to skip"),
                "correct 'line skip' in the header",
            ));
        }
        offset += n as u64;
    }
    Ok(offset)
}

fn damaged(path: &Path, e: &io::Error) -> Error {
    Error::file(path, format!("the compressed data are damaged: {e}"), "copy or download the file again")
}

/// The unpacked bytes of a payload.
enum Stream<R: BufRead> {
    Raw(R),
    /// Gzip allows several members in a row; `None` only while one takes over from another.
    Gzip(Option<GzDecoder<R>>),
    Zlib(ZlibDecoder<R>),
}

impl<R: BufRead> Stream<R> {
    /// Reads from the current gzip member or the only stream; 0 at its end.
    fn read_some(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Stream::Raw(reader) => reader.read(buffer),
            Stream::Gzip(member) => member.as_mut().map_or(Ok(0), |m| m.read(buffer)),
            Stream::Zlib(decoder) => decoder.read(buffer),
        }
    }

    /// Goes on to the next gzip member if there is one.
    fn next_member(&mut self) -> io::Result<bool> {
        let Stream::Gzip(member) = self else { return Ok(false) };
        let Some(mut reader) = member.take().map(GzDecoder::into_inner) else { return Ok(false) };
        let more = !reader.fill_buf()?.is_empty();
        *member = Some(GzDecoder::new(reader));
        Ok(more)
    }

    /// Fills the buffer as far as the data reach.
    fn fill(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.read_some(&mut buffer[filled..]) {
                Ok(0) if self.next_member()? => {}
                Ok(0) => break,
                Ok(n) => filled += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
                Err(e) => return Err(e),
            }
        }
        Ok(filled)
    }
}

impl Payload<'_> {
    /// Bytes of the unpacked scalars.
    pub fn bytes(&self) -> u64 {
        // At most 2³²−1 voxels of 8 bytes each (Grid::checked_dims).
        self.voxels * self.scalar.size() as u64
    }

    /// Reads the scalars. Fails if there are too few; bytes behind them are noted in the log and ignored.
    pub fn read(&self) -> Result<VoxelData> {
        let (mut file, file_size) = open(self.path)?;
        let available = file_size.checked_sub(self.start).ok_or_else(|| {
            Error::file(
                self.path,
                format!("the voxels should start at byte {}, but the file has {file_size} bytes", self.start),
                "correct the header's data offset, or copy the file again if it is truncated",
            )
        })?;
        let needed = self.skip.checked_add(self.bytes());
        let most = match self.encoding {
            Encoding::Raw => available,
            Encoding::Gzip | Encoding::Zlib => available.saturating_mul(MAX_DEFLATE_RATIO),
        };
        if needed.is_none_or(|n| n > most) {
            return Err(Error::file(
                self.path,
                format!(
                    "the header promises {} voxels of {} ({} bytes after {} skipped), but the file holds {} {available} bytes",
                    self.voxels,
                    self.scalar,
                    self.bytes(),
                    self.skip,
                    if self.encoding == Encoding::Raw { "only" } else { "too few compressed ones:" },
                ),
                "correct the size and type in the header, or copy the file again if it is truncated",
            ));
        }
        file.seek(SeekFrom::Start(self.start)).map_err(|e| Error::io(self.path, "read", e))?;
        let reader = BufReader::with_capacity(available.min(CHUNK as u64) as usize, file);
        let mut stream = match self.encoding {
            Encoding::Raw => Stream::Raw(reader),
            Encoding::Gzip => Stream::Gzip(Some(GzDecoder::new(reader))),
            Encoding::Zlib => Stream::Zlib(ZlibDecoder::new(reader)),
        };
        self.discard(&mut stream)?;
        let s = &mut stream;
        let data = match self.scalar {
            ScalarType::U8 => VoxelData::U8(self.scalars(s, available, u8::from_le_bytes, u8::from_be_bytes)?),
            ScalarType::I8 => VoxelData::I8(self.scalars(s, available, i8::from_le_bytes, i8::from_be_bytes)?),
            ScalarType::U16 => VoxelData::U16(self.scalars(s, available, u16::from_le_bytes, u16::from_be_bytes)?),
            ScalarType::I16 => VoxelData::I16(self.scalars(s, available, i16::from_le_bytes, i16::from_be_bytes)?),
            ScalarType::U32 => VoxelData::U32(self.scalars(s, available, u32::from_le_bytes, u32::from_be_bytes)?),
            ScalarType::I32 => VoxelData::I32(self.scalars(s, available, i32::from_le_bytes, i32::from_be_bytes)?),
            ScalarType::F32 => VoxelData::F32(self.scalars(s, available, f32::from_le_bytes, f32::from_be_bytes)?),
            ScalarType::F64 => VoxelData::F64(self.scalars(s, available, f64::from_le_bytes, f64::from_be_bytes)?),
        };
        // Reading on also makes the decoder compare its checksum, which it does only at the end of the data.
        match stream.read_some(&mut [0]) {
            Ok(0) => {}
            Ok(_) => log::warn!("{}: data behind the last voxel are ignored", self.path.display()),
            Err(e) => return Err(self.failed(&e)),
        }
        Ok(data)
    }

    fn discard(&self, stream: &mut Stream<impl BufRead>) -> Result<()> {
        let mut left = self.skip;
        let mut buffer = vec![0; left.min(CHUNK as u64) as usize];
        while left > 0 {
            let want = left.min(CHUNK as u64) as usize;
            let got = stream.fill(&mut buffer[..want]).map_err(|e| self.failed(&e))?;
            if got < want {
                return Err(self.truncated(0));
            }
            left -= want as u64;
        }
        Ok(())
    }

    /// Reads `voxels` scalars of N bytes each. Memory is reserved for as many bytes as the file has; what compressed
    /// data need beyond that grows with what was really unpacked, so a header alone cannot make it large.
    fn scalars<const N: usize, T>(
        &self,
        stream: &mut Stream<impl BufRead>,
        file_bytes: u64,
        little: impl Fn([u8; N]) -> T,
        big: impl Fn([u8; N]) -> T,
    ) -> Result<Vec<T>> {
        let no_memory = |_| {
            Error::file(
                self.path,
                format!("there is not enough memory for its {} bytes of voxels", self.bytes()),
                "crop or downsample the volume",
            )
        };
        let total = usize::try_from(self.voxels).expect("at most 2^32-1 voxels");
        let mut out = Vec::new();
        out.try_reserve_exact(total.min((file_bytes / N as u64) as usize)).map_err(no_memory)?;
        let mut buffer = vec![0; (total * N).min(CHUNK)];
        while out.len() < total {
            let want = ((total - out.len()) * N).min(CHUNK);
            let got = stream.fill(&mut buffer[..want]).map_err(|e| self.failed(&e))?;
            if got < want {
                return Err(self.truncated((out.len() * N + got) as u64));
            }
            let (scalars, _) = buffer[..want].as_chunks::<N>();
            if out.capacity() - out.len() < scalars.len() {
                let goal = total.min((2 * out.capacity()).max(out.len() + scalars.len()));
                out.try_reserve_exact(goal - out.len()).map_err(no_memory)?;
            }
            if self.big_endian {
                out.extend(scalars.iter().map(|&b| big(b)));
            } else {
                out.extend(scalars.iter().map(|&b| little(b)));
            }
        }
        Ok(out)
    }

    fn truncated(&self, got: u64) -> Error {
        Error::file(
            self.path,
            format!("the data end after {got} of {} bytes of voxels", self.bytes()),
            "correct the size and type in the header, or copy the file again if it is truncated",
        )
    }

    fn failed(&self, e: &io::Error) -> Error {
        match self.encoding {
            Encoding::Raw => Error::io(self.path, "read", io::Error::new(e.kind(), e.to_string())),
            Encoding::Gzip | Encoding::Zlib => damaged(self.path, e),
        }
    }
}
