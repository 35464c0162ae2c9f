//! `tyndall completions` and `tyndall man`: what shells and `man` know of the command line, from the same declarations.

use std::path::PathBuf;

use clap::CommandFactory;
use clap_complete::Shell;

use super::Cli;
use crate::{Result, output};

/// Print a script for your shell that completes commands and flags.
///
/// bash: tyndall completions bash > ~/.local/share/bash-completion/completions/tyndall
#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// The shell.
    shell: Shell,
}

/// Write manual pages, one per command, as `man` shows them: man -l tyndall-render.1
#[derive(clap::Args, Debug)]
pub struct ManArgs {
    /// Folder for the pages; it is made if it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// The script.
pub fn completions(args: &CompletionsArgs) -> Result<String> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "tyndall", &mut script);
    Ok(String::from_utf8(script).expect("completions are text"))
}

/// The pages.
pub fn man(args: &ManArgs) -> Result<String> {
    output::make_folder(&args.output)?;
    let mut root = Cli::command();
    // Gives every command its full name.
    root.build();
    let mut written = 0;
    for command in std::iter::once(&root).chain(root.get_subcommands().filter(|c| c.get_name() != "help")) {
        let name = command.get_display_name().unwrap_or_else(|| command.get_name());
        let mut page = Vec::new();
        let rendered = clap_mangen::Man::new(command.clone()).title(name).render(&mut page);
        rendered.expect("a vector takes everything");
        output::write_atomically(&args.output.join(format!("{name}.1")), &page)?;
        written += 1;
    }
    Ok(format!("wrote {written} pages to {}\n", args.output.display()))
}
