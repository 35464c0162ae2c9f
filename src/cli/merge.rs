//! `tyndall merge`: one picture from saved renders of different seeds.

use std::path::PathBuf;

use crate::output::{self, BitDepth, PngOptions};
use crate::render::state::State;
use crate::scene::ToneCurve;
use crate::scene::values::ExposureValue;
use crate::stats::times;
use crate::{Error, Result};

/// Merge saved renders (render --model path --state FILE) of the same scene and different seeds.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The saved renders.
    #[arg(value_name = "STATE", required = true)]
    states: Vec<PathBuf>,

    /// Picture to write: .png or .exr.
    #[arg(short, long, value_name = "FILE", required_unless_present = "state")]
    output: Option<PathBuf>,

    /// Saved render to write, for further merging.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,

    /// Bits per channel of a PNG.
    #[arg(long, value_name = "BITS", default_value = "8")]
    bits: BitDepth,

    /// Exposure of a PNG: auto, or stops.
    #[arg(long, value_name = "STOPS", default_value = "auto", allow_hyphen_values = true)]
    exposure: ExposureValue,

    /// Tone curve of a PNG.
    #[arg(long, value_name = "CURVE", default_value = "filmic")]
    tone: ToneCurve,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    if let Some(path) = &args.output {
        output::check_picture_path(path)?;
    }
    if let Some(path) = &args.state {
        output::check_writable(path)?;
    }
    let (first, others) = args.states.split_first().expect("clap asks for one");
    let mut merged = State::load(first)?;
    for path in others {
        merged.merge(&State::load(path)?, path)?;
    }
    if merged.sums.samples == 0 {
        return Err(Error::file(first, "it has no samples", "merge renders that have some"));
    }
    let estimate = merged.sums.estimate(merged.header.size);
    if let Some(path) = &args.state {
        merged.save(path)?;
    }
    if let Some(path) = &args.output {
        let png = PngOptions { bits: args.bits, exposure: args.exposure.0, tone: args.tone };
        output::write_picture(path, &estimate.picture, &png)?;
    }
    Ok(format!(
        "{}, {} samples per pixel of {} seeds; noise {:.4} % of the mean radiance\n",
        times(&merged.header.size),
        merged.sums.samples,
        merged.header.streams.len(),
        100.0 * estimate.noise
    ))
}
