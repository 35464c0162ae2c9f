//! The command line: one file per command. A command returns what goes to stdout; `main` prints it.

pub mod batch;
pub mod bench;
pub mod check;
pub mod compare;
pub mod devices;
pub mod inspect;
mod interrupt;
pub mod manual;
pub mod merge;
pub mod render;
pub mod tradeoff;
pub mod verify;

use std::path::PathBuf;

use crate::Result;
use crate::passes::lookback::Carry;
use crate::scene;
use crate::vk::{ContextConfig, Injection, Validation, user_cache_dir};

/// Headless volume renderer with physically based multiple scattering.
///
/// Results go to stdout, errors and progress to stderr. Exit code 0 = done, 1 = failed, 2 = wrong usage,
/// 130 = stopped by Ctrl-C.
#[derive(clap::Parser, Debug)]
#[command(name = "tyndall", version, max_term_width = 110)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand, Debug)]
enum Command {
    Render(Box<render::Args>),
    Batch(Box<batch::Args>),
    Inspect(inspect::Args),
    Compare(compare::Args),
    Merge(merge::Args),
    Tradeoff(Box<tradeoff::Args>),
    Verify(verify::Args),
    Check(check::Args),
    Bench(bench::Args),
    Devices(devices::Args),
    Completions(manual::CompletionsArgs),
    Man(manual::ManArgs),
}

impl Cli {
    /// Runs the command and returns the text for stdout.
    pub fn run(&self) -> Result<String> {
        match &self.command {
            Command::Render(args) => render::run(args),
            Command::Batch(args) => batch::run(args),
            Command::Inspect(args) => inspect::run(args),
            Command::Compare(args) => compare::run(args),
            Command::Merge(args) => merge::run(args),
            Command::Tradeoff(args) => tradeoff::run(args),
            Command::Verify(args) => verify::run(args),
            Command::Check(args) => check::run(args),
            Command::Bench(args) => bench::run(args),
            Command::Devices(args) => devices::run(args),
            Command::Completions(args) => manual::completions(args),
            Command::Man(args) => manual::man(args),
        }
    }
}

/// The scene of every command that renders one.
#[derive(clap::Args, Debug)]
pub struct SceneArgs {
    /// Scene file (TOML); flags override what it says.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,

    #[command(flatten)]
    overrides: scene::Overrides,
}

impl SceneArgs {
    /// The scene.
    fn load(&self) -> Result<scene::Scene> {
        scene::load_scene(self.scene.as_deref(), &self.overrides)
    }
}

/// What commands that render tell of their run.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Output")]
pub struct ReportArgs {
    /// Write times and figures of the run to a JSON file.
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,

    /// Print times and figures of the run as JSON instead of text.
    #[arg(long)]
    json: bool,

    /// No progress bar, nothing on stdout.
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,
}

/// Flags of every command that computes on a device.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Device")]
pub struct DeviceArgs {
    /// Vulkan device: its index in `tyndall devices`, or part of its name [default: the first real GPU, else the CPU].
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,

    /// Turn on the Vulkan validation layer; any message makes the exit code 1. Alone, it means `core` (with
    /// synchronization validation).
    #[arg(
        long,
        value_name = "KIND",
        num_args = 0..=1,
        require_equals = true,
        default_value = "off",
        default_missing_value = "core",
        hide_default_value = true
    )]
    pub validate: Validation,

    /// How scan and sort carry sums from tile to tile; results are the same [default: by driver, see `tyndall devices`].
    #[arg(long, value_enum, value_name = "WAY")]
    pub carry: Option<Carry>,

    /// A fault to put in, for tests.
    #[arg(long, value_name = "FAULT", hide = true)]
    pub inject: Option<Injection>,
}

impl DeviceArgs {
    /// What the device layer is asked for.
    pub fn config(&self) -> ContextConfig {
        // Validation shall see every pipeline compiled.
        let cache_dir = if self.validate == Validation::Off { user_cache_dir() } else { None };
        ContextConfig {
            device: self.device.clone(),
            validation: self.validate,
            cache_dir,
            injection: self.inject,
            forward_progress: self.carry.map(|carry| carry == Carry::LookBack),
            ..ContextConfig::default()
        }
    }
}

/// The text that `write` writes.
fn in_string(write: impl FnOnce(&mut String) -> std::fmt::Result) -> String {
    let mut text = String::new();
    write(&mut text).expect("writing to a String cannot fail");
    text
}
