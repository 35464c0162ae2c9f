//! The `tyndall` binary: parses, runs, prints the result or the error chain.

use std::error::Error as _;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use clap::Parser;
use tyndall::cli::Cli;

fn main() -> ExitCode {
    log::set_logger(&Warnings).expect("no other logger is set");
    log::set_max_level(log::LevelFilter::Warn);
    // On wrong usage clap prints its message and exits with code 2.
    let text = match Cli::parse().run() {
        Ok(text) => text,
        Err(error) => {
            print_error(&error);
            return ExitCode::from(error.exit_code());
        }
    };
    let mut stdout = std::io::stdout();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        // The reader (`| head`) has seen enough.
        Err(e) if e.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(e) => {
            let _ = writeln!(std::io::stderr(), "error: stdout: cannot write: {e}");
            ExitCode::FAILURE
        }
        Ok(()) => ExitCode::SUCCESS,
    }
}

/// The error and its causes, as far as their text is not part of the error's own.
fn print_error(error: &tyndall::Error) {
    let mut text = format!("error: {error}");
    let mut cause = error.source();
    while let Some(error) = cause {
        if !text.contains(&error.to_string()) {
            text += &format!("\n  caused by: {error}");
        }
        cause = error.source();
    }
    // stderr may be closed; there is no other place to complain to.
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Sends the library's warnings to stderr.
struct Warnings;

impl log::Log for Warnings {
    fn enabled(&self, metadata: &log::Metadata) -> bool {
        metadata.level() <= log::Level::Warn
    }

    fn log(&self, record: &log::Record) {
        if self.enabled(record.metadata()) {
            let level = record.level().as_str().to_ascii_lowercase();
            let _ = writeln!(std::io::stderr(), "{level}: {}", record.args());
        }
    }

    fn flush(&self) {}
}
