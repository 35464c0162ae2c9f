//! `tyndall compare`: how far a picture is from a reference.

use std::path::PathBuf;

use crate::Result;
use crate::measure::metrics::{self, Metrics};
use crate::output::{self, Format};
use crate::stats::times;
use crate::stats::to_json;

/// Compare two pictures (PNG, EXR or HDR) of the same size in linear radiance.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The picture under test.
    #[arg(value_name = "A")]
    picture: PathBuf,

    /// The reference, to which relative figures refer.
    #[arg(value_name = "B")]
    reference: PathBuf,

    /// The reference once more with another seed: then RMSE, relMSE and PSNR are without the references' noise.
    #[arg(value_name = "B2")]
    second: Option<PathBuf>,

    /// Print JSON. Infinite figures (of equal or black pictures) become null.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    let a = output::read_picture(&args.picture)?;
    let b = output::read_picture(&args.reference)?;
    let metrics = match &args.second {
        Some(second) => metrics::compare_to_two(&a, [&b, &output::read_picture(second)?])?,
        None => metrics::compare(&a, &b)?,
    };
    if args.json {
        return Ok(to_json(&metrics));
    }
    let pictures = [Some(&args.picture), Some(&args.reference), args.second.as_ref()];
    let display = pictures.iter().flatten().any(|p| Format::of(p).is_ok_and(|f| f == Format::Png));
    let note = if display {
        "a PNG's exposure and tone curve are part of it: compare EXR for errors in radiance\n"
    } else {
        ""
    };
    Ok(text(&metrics) + note)
}

fn text(m: &Metrics) -> String {
    let [r, g, b] = m.bias.map(|v| 100.0 * v);
    format!(
        "size            {}\n\
         RMSE            {:.6e}\n\
         relMSE          {:.6e}\n\
         bias R G B      {r:+.4} % {g:+.4} % {b:+.4} %\n\
         block bias      {:.4} %\n\
         PSNR            {:.2} dB\n\
         max difference  {:.6e}\n\
         alpha RMSE      {:.6e}\n",
        times(&m.size),
        m.rmse,
        m.rel_mse,
        100.0 * m.block_bias,
        m.psnr,
        m.max_difference,
        m.alpha_rmse
    )
}
