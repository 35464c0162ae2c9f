//! Saved states of the path tracer: the sums of a picture, and which random numbers are in them.
//!
//! File: `MAGIC`, format version and length of the header (u32, little endian), the header as JSON, the sums (f32, little
//! endian; values high and low, squares high and low), and the SHA-256 of all that.

use super::path::Sums;
use crate::output::write_atomically;
use crate::passes::scene_data;
use crate::scene::{Background, Environment, Scene};
use crate::shaders;
use crate::shaders::constants::NO_VALUE;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::io::Read;
use std::path::Path;

const MAGIC: &[u8; 8] = b"TYNDPATH";
const VERSION: u32 = 1;
/// Longest header that is read, in bytes.
const MAX_HEADER: usize = 1 << 20;
const DIGEST: usize = 32;

/// Samples 0 to `samples` of one seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stream {
    /// The seed.
    pub seed: u64,
    /// Samples of every pixel.
    pub samples: u32,
}

/// What the sums are of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// Digest of the path tracer's kernels.
    pub program: String,
    /// Digest of everything that the picture depends on, but for seed and number of samples.
    pub scene: String,
    /// Pixels along x and y.
    pub size: [u32; 2],
    /// What radiance is multiplied by in the sums.
    pub radiance_scale: f64,
    /// The random numbers that are in the sums, one entry per seed.
    pub streams: Vec<Stream>,
}

/// A saved render.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// What the sums are of.
    pub header: Header,
    /// The sums.
    pub sums: Sums,
}

fn hex(digest: Sha256) -> String {
    digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of all parts and their lengths, in hexadecimal.
pub fn hex_digest<'b>(parts: impl IntoIterator<Item = &'b [u8]>) -> String {
    let mut digest = Sha256::new();
    for part in parts {
        digest.update((part.len() as u64).to_le_bytes());
        digest.update(part);
    }
    hex(digest)
}

impl Header {
    /// The header of a render of `scene` with the settings' seed, before the first sample.
    pub fn new(scene: &Scene) -> Self {
        let mut program = Sha256::new();
        for shader in [&shaders::EXTINCTION, &shaders::MAJORANT, &shaders::PATH] {
            program.update(shader.spirv);
        }
        let mut params = scene_data::params(scene);
        let radiance_scale = f64::from(params.radiance_scale);
        (params.seed_low, params.seed_high) = (0, 0);
        let mut digest = Sha256::new();
        let mut add = |bytes: &[u8]| {
            digest.update((bytes.len() as u64).to_le_bytes());
            digest.update(bytes);
        };
        add(bytemuck::bytes_of(&params));
        add(bytemuck::cast_slice(&scene_data::transfer_points(scene)));
        add(bytemuck::cast_slice(&scene_data::lights(scene)));
        add(match scene.background {
            Background::Transparent => b"transparent",
            Background::Color(_) => b"color",
            Background::Environment => b"environment",
        });
        if let Some(Environment::LatLong(image)) = &scene.environment {
            add(bytemuck::cast_slice(&[image.width, image.height]));
            add(&image.rotation_degrees.to_le_bytes());
            add(bytemuck::cast_slice(&image.pixels));
        }
        add(&scene.settings.orders.to_le_bytes());
        add(&scene.settings.max_events.to_le_bytes());
        // A slab at a time: the whole would double the volume's memory.
        let voxels = scene.volume.grid.voxels() as usize;
        for begin in (0..voxels).step_by(1 << 20) {
            add(bytemuck::cast_slice(&scene.volume.values_f32(begin..voxels.min(begin + (1 << 20)), NO_VALUE)));
        }
        Self {
            program: hex(program),
            scene: hex(digest),
            size: scene.settings.size,
            radiance_scale,
            streams: vec![Stream { seed: scene.settings.seed, samples: 0 }],
        }
    }

    /// Refuses sums of another picture.
    fn check_same(&self, other: &Self, path: &Path) -> Result<()> {
        let refuse = |problem: &str, cure: &str| Err(Error::file(path, problem, cure));
        if self.size != other.size {
            let problem = format!("its picture has {}x{} pixels", other.size[0], other.size[1]);
            return refuse(&problem, &format!("render at {}x{}", self.size[0], self.size[1]));
        }
        if self.program != other.program {
            let cure = "render it anew: its samples are not those of this version";
            return refuse("it was made by another version of the path tracer", cure);
        }
        if self.scene != other.scene {
            let cure = "give the scene, volume, camera, lights and orders it was made with, or another state file";
            return refuse("it is of another scene", cure);
        }
        Ok(())
    }
}

impl State {
    /// The saved render, checked to be whole.
    ///
    /// Errors: the file cannot be read, is no state, or is damaged.
    pub fn load(path: &Path) -> Result<Self> {
        let damaged = |problem: &str| Error::file(path, problem.to_owned(), "delete it, or take a copy that is whole");
        let (mut file, length) = crate::input::open(path, "a file that --state has written")?;
        let mut start = [0u8; 16];
        let read = |file: &mut std::fs::File, to: &mut [u8]| match file.read_exact(to) {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Err(damaged("it is cut off")),
            other => other.map_err(|e| Error::io(path, "read", e)),
        };
        read(&mut file, &mut start)?;
        let word = |at: usize| u32::from_le_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]]);
        if &start[..8] != MAGIC {
            return Err(Error::file(path, "it is no saved render", "name a file that --state has written"));
        }
        if word(8) != VERSION {
            let problem = format!("its format is version {}; this one is {VERSION}", word(8));
            return Err(Error::file(path, problem, "use the version of Tyndall that wrote it, or render anew"));
        }
        let header_bytes = word(12) as usize;
        if header_bytes > MAX_HEADER {
            return Err(damaged("its header is absurdly long"));
        }
        let mut text = vec![0u8; header_bytes];
        read(&mut file, &mut text)?;
        let header: Header =
            serde_json::from_slice(&text).map_err(|e| damaged(&format!("its header cannot be read: {e}")))?;
        // Before memory is reserved for what the header promises.
        let pixels = header.size.map(u64::from).iter().product::<u64>();
        let array = pixels.saturating_mul(16);
        let expected = (16 + header_bytes as u64 + DIGEST as u64).saturating_add(array.saturating_mul(4));
        if length != expected {
            return Err(damaged(&format!("it has {length} bytes where its header asks for {expected}")));
        }
        let mut digest = Sha256::new();
        digest.update(start);
        digest.update(&text);
        let mut arrays = [const { Vec::new() }; 4];
        for values in &mut arrays {
            let mut bytes = vec![0u8; array as usize];
            read(&mut file, &mut bytes)?;
            digest.update(&bytes);
            let float = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            let pixel = |b: &[u8]| [float(b), float(&b[4..]), float(&b[8..]), float(&b[12..])];
            *values = bytes.chunks_exact(16).map(pixel).collect();
        }
        let mut stored = [0u8; DIGEST];
        read(&mut file, &mut stored)?;
        if digest.finalize()[..] != stored {
            return Err(damaged("its contents do not match their checksum"));
        }
        let samples = header.streams.iter().try_fold(0u32, |sum, s| sum.checked_add(s.samples));
        let samples = samples.ok_or_else(|| damaged("it has too many samples"))?;
        let [value, value_low, square, square_low] = arrays;
        let radiance_scale = header.radiance_scale;
        let sums = Sums { samples, value: [value, value_low], square: [square, square_low], radiance_scale };
        Ok(Self { header, sums })
    }

    /// Writes the file, whole or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_vec(&self.header).expect("numbers and strings always serialise");
        let arrays = self.sums.value.iter().chain(&self.sums.square);
        let mut bytes = Vec::with_capacity(16 + text.len() + DIGEST + 64 * self.sums.value[0].len());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&(text.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&text);
        bytes.extend(arrays.flatten().flatten().flat_map(|f| f.to_le_bytes()));
        let digest = Sha256::digest(&bytes);
        bytes.extend_from_slice(&digest);
        write_atomically(path, &bytes)
    }

    /// Loads a state to go on with the render that `expected` describes.
    ///
    /// Errors: as [`State::load`]; it is of another scene or seed, or a merged one.
    pub fn resume(path: &Path, expected: &Header) -> Result<Self> {
        let state = Self::load(path)?;
        expected.check_same(&state.header, path)?;
        let seed = expected.streams[0].seed;
        match state.header.streams[..] {
            [stream] if stream.seed == seed => Ok(state),
            [stream] => Err(Error::file(
                path,
                format!("it was rendered with seed {}, not {seed}", stream.seed),
                format!("give --seed {}, or another state file and merge both later", stream.seed),
            )),
            _ => Err(Error::file(
                path,
                format!("it is merged of {} seeds", state.header.streams.len()),
                "render with a new seed to a new file, and merge that with it",
            )),
        }
    }

    /// Adds another state's samples.
    ///
    /// Errors: it is of another picture, or has a seed in common with this one. `path` names it.
    pub fn merge(&mut self, other: &Self, path: &Path) -> Result<()> {
        self.header.check_same(&other.header, path)?;
        let own = &self.header.streams;
        if let Some(both) = other.header.streams.iter().find(|s| own.iter().any(|o| o.seed == s.seed)) {
            return Err(Error::file(
                path,
                format!("seed {} is in another of the states too: its samples would count twice", both.seed),
                "merge states of different seeds",
            ));
        }
        let samples = self
            .sums
            .samples
            .checked_add(other.sums.samples)
            .ok_or_else(|| Error::file(path, "too many samples to count come together", "leave it out"))?;
        self.header.streams.extend(&other.header.streams);
        self.sums.samples = samples;
        add_pairs(&mut self.sums.value, &other.sums.value);
        add_pairs(&mut self.sums.square, &other.sums.square);
        Ok(())
    }
}

/// Adds sums that are pairs of floats, exactly to what a pair holds.
fn add_pairs(to: &mut [Vec<[f32; 4]>; 2], from: &[Vec<[f32; 4]>; 2]) {
    let [high, low] = to;
    for i in 0..high.len() {
        for c in 0..4 {
            let sum = [high[i][c], low[i][c], from[0][i][c], from[1][i][c]].map(f64::from).iter().sum::<f64>();
            high[i][c] = sum as f32;
            low[i][c] = (sum - f64::from(high[i][c])) as f32;
        }
    }
}
