//! The binary in a directory of its own.

#![allow(dead_code, reason = "each test file uses a part of it")]

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

/// A directory of its own, in which the binary runs.
pub struct Place(pub tempfile::TempDir);

impl Place {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    /// Names and contents of all files.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let read = |e: fs::DirEntry| (e.file_name().into_string().unwrap(), fs::read(e.path()).unwrap_or_default());
        let mut files: Vec<_> = fs::read_dir(self.0.path()).unwrap().map(|e| read(e.unwrap())).collect();
        files.sort();
        files
    }

    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tyndall"));
        // Tests depend on no earlier run's compiled pipelines, and leave the user none.
        command.args(args).current_dir(self.0.path()).env("TYNDALL_CACHE_DIR", "");
        command
    }

    pub fn run(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    /// Runs and checks success; returns stdout.
    pub fn succeeds(&self, args: &[&str]) -> String {
        let output = self.run(args);
        assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
        text(&output.stdout)
    }

    /// Runs and checks a failure with this exit code: a message with all the parts on stderr, nothing on stdout, no
    /// panic, no file made or changed.
    pub fn fails(&self, args: &[&str], code: i32, parts: &[&str]) {
        let command = self.command(args);
        self.fails_as(command, code, parts);
    }

    pub fn fails_as(&self, mut command: Command, code: i32, parts: &[&str]) {
        let before = self.files();
        let output = command.output().unwrap();
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{command:?}: {stderr}");
        for part in parts {
            assert!(stderr.contains(part), "{command:?}: '{part}' is missing in: {stderr}");
        }
        for word in ["panicked", "RUST_BACKTRACE", "unwrap"] {
            assert!(!stderr.contains(word), "{command:?}: {stderr}");
        }
        assert_eq!(text(&output.stdout), "", "{command:?}");
        assert_eq!(self.files(), before, "{command:?} changed files");
    }
}

/// Presses Ctrl-C.
#[cfg(unix)]
pub fn interrupt(child: &std::process::Child) {
    // The shell's own kill: a bare system has no other.
    let kill = format!("kill -INT {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}
