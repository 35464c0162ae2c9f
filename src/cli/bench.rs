//! `tyndall bench`: what this device is fast at.

mod gather;
mod masks;
mod primitives;
mod proxy;
mod scenes;

use super::render::{progress_bar, show};
use super::{DeviceArgs, SceneArgs};
use crate::render::Progress;
use crate::scene::{self, Scene};
use crate::stats::{DeviceStats, csv_of, to_json};
use crate::vk::{Context, no_messages};
use crate::{Result, output};
use serde::Serialize;
use std::path::PathBuf;

/// Measure what this device is fast at, by GPU timestamps.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(clap::Subcommand, Debug)]
enum Subject {
    Proxy(Box<proxy::ProxyArgs>),
    Gather(Box<gather::GatherArgs>),
    Masks(Box<masks::MasksArgs>),
    Scan(primitives::ScanArgs),
    Sort(primitives::SortArgs),
    Scenes(scenes::ScenesArgs),
}

/// Runs the command.
pub fn run(args: &Args) -> Result<String> {
    match &args.subject {
        Subject::Proxy(args) => proxy::run(args),
        Subject::Gather(args) => gather::run(args),
        Subject::Masks(args) => masks::run(args),
        Subject::Scan(args) => primitives::run_scan(args),
        Subject::Sort(args) => primitives::run_sort(args),
        Subject::Scenes(args) => scenes::run(args),
    }
}

/// What commands that measure scene by scene have in common.
#[derive(clap::Args, Debug)]
struct TablesArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// The phantoms skull, head, heart, tree and cloud, of VOXELS along each axis.
    #[arg(
        long,
        value_name = "VOXELS",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "64",
        conflicts_with_all = ["scene", "volume"],
        value_parser = clap::value_parser!(u32).range(8..=512),
        help_heading = "Bench"
    )]
    all: Option<u32>,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,

    /// Write the table as CSV, too.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    csv: Option<PathBuf>,

    #[command(flatten)]
    device: DeviceArgs,
}

/// Phantoms of `--all`.
const PHANTOMS: [&str; 5] = ["skull", "head", "heart", "tree", "cloud"];

/// Scenes of the phantoms, of `edge` voxels along each axis.
fn phantoms(args: &SceneArgs, edge: u32) -> Result<Vec<Scene>> {
    let of = |name: &&str| {
        let mut overrides = args.overrides.clone();
        overrides.volume = Some(format!("phantom:{name}:{edge}x{edge}x{edge}").into());
        scene::load_scene(None, &overrides)
    };
    PHANTOMS.iter().map(of).collect()
}

/// What such commands print as JSON.
#[derive(Serialize)]
struct Tables<T> {
    device: DeviceStats,
    tables: Vec<T>,
}

/// Rows of a CSV: names and values of their columns.
type Columns = Vec<Vec<(&'static str, String)>>;

impl TablesArgs {
    /// Measures every scene, and writes the CSV of all `rows`. `phase` is what the progress bar calls it.
    fn measure<T: Serialize>(
        &self,
        phase: &'static str,
        mut run: impl FnMut(&Context, Scene, &mut dyn FnMut(f64)) -> Result<T>,
        rows: impl Fn(&T) -> Columns,
        text: impl Fn(&Tables<T>) -> String,
    ) -> Result<String> {
        if let Some(path) = &self.csv {
            output::check_writable(path)?;
        }
        let scenes = match self.all {
            Some(edge) => phantoms(&self.scene, edge)?,
            None => vec![self.scene.load()?],
        };
        let ctx = Context::new(&self.device.config())?;
        let device = DeviceStats::of(&ctx);
        let bar = progress_bar(false);
        let count = scenes.len() as f64;
        let mut tables = Vec::new();
        for (i, scene) in scenes.into_iter().enumerate() {
            tables.push(run(&ctx, scene, &mut |done| {
                let _ = show(&bar, &Progress { done: (i as f64 + done) / count, phase });
            })?);
        }
        bar.finish_and_clear();
        no_messages(&ctx.close())?;
        if let Some(path) = &self.csv {
            output::write_atomically(path, csv_of(tables.iter().flat_map(rows)).as_bytes())?;
        }
        let report = Tables { device, tables };
        Ok(if self.json { to_json(&report) } else { text(&report) })
    }
}
