//! The one error type of the crate.
//!
//! An error names what it is about (file, field, flag or Vulkan object), what is wrong, and the cure.
//! Misuse of the API by the programmer is a panic with a message, never an `Error`.

use std::path::{Path, PathBuf};

/// Exit code after Ctrl-C: what shells give to programs that SIGINT ends.
pub const STOPPED: u8 = 130;

/// Result of every fallible operation of the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong at run time.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Bad input: a file, a field of a file, or the value of a flag.
    #[error("{what}: {problem}\n  cure: {cure}")]
    Input {
        /// The file, the field or the flag: `skull.nrrd: field 'sizes'`, `--size`.
        what: String,
        /// What is wrong with it.
        problem: String,
        /// What the user can do about it.
        cure: String,
    },
    /// Wrong use of the command line (exit code 2).
    #[error("{what}: {problem}\n  cure: {cure}")]
    Usage {
        /// The flag or argument.
        what: String,
        /// What is wrong with it.
        problem: String,
        /// What the user can do about it.
        cure: String,
    },
    /// The operating system refused an operation on a file.
    #[error("{}: cannot {operation}: {source}", path.display())]
    Io {
        /// File or directory.
        path: PathBuf,
        /// Verb phrase: "open", "read", "write", "create".
        operation: &'static str,
        /// The system's word.
        source: std::io::Error,
    },
    /// No Vulkan loader, or no usable device.
    #[error("{problem}\n  cure: {cure}")]
    NoDevice {
        /// What was looked for and what was found.
        problem: String,
        /// What to install or which flag to change.
        cure: String,
    },
    /// The device lacks features or limits that Tyndall needs.
    #[error("device '{device}' lacks: {}\n  cure: choose another device with --device (see `tyndall devices`) or update its driver", missing.join(", "))]
    MissingFeatures {
        /// Device name as the driver reports it.
        device: String,
        /// Vulkan names of the missing features, extensions or limits.
        missing: Vec<String>,
    },
    /// A Vulkan call failed.
    #[error("{operation} failed for '{object}': {result}")]
    Vulkan {
        /// The Vulkan function or the step.
        operation: &'static str,
        /// The debug name of the object.
        object: String,
        /// The driver's word.
        result: ash::vk::Result,
    },
    /// The device does not work any more.
    #[error(
        "the device {problem}\n  cure: finished pictures are whole; the system's log has the driver's reason. Start again, with fewer voxels or pixels, or another device (--device) if it comes back"
    )]
    DeviceGone {
        /// "was lost", or how long it was waited for.
        problem: String,
    },
    /// The device has too little memory free.
    #[error(
        "'{object}' needs {} of device memory, but {} of {} are in use\n  cure: {cure}",
        crate::stats::mebibytes_text(*needed), crate::stats::mebibytes_text(*used), crate::stats::mebibytes_text(*total)
    )]
    OutOfDeviceMemory {
        /// The debug name of the object.
        object: String,
        /// Bytes asked for.
        needed: u64,
        /// Bytes that this program uses.
        used: u64,
        /// Bytes that the device has.
        total: u64,
        /// What would fit.
        cure: String,
    },
    /// A size exceeds one of the device's limits, or the memory that was handed over.
    #[error("'{object}' needs {needed} bytes, but {limit_name} allows {limit}\n  cure: {cure}")]
    DeviceMemory {
        /// The debug name of the object.
        object: String,
        /// Bytes asked for.
        needed: u64,
        /// What there is.
        limit: u64,
        /// Name of the limit.
        limit_name: &'static str,
        /// What would fit.
        cure: String,
    },
    /// The validation layer or Tyndall's own checks reported something.
    #[error("validation reported {count} message(s); the first: {first}")]
    Validation {
        /// Number of messages.
        count: usize,
        /// Text of the first.
        first: String,
    },
    /// Checks of `tyndall verify` failed.
    #[error(
        "{failed} of {count} checks failed on this device\n  cure: see the lines marked FAILED; try another driver version or device (--device), and report them if they stay"
    )]
    Checks {
        /// Checks that failed.
        failed: usize,
        /// All checks.
        count: usize,
    },
    /// Cases of `tyndall check` failed.
    #[error(
        "{failed} of {count} cases failed\n  cure: see the messages above; report them if they stay with another driver"
    )]
    Cases {
        /// Cases that failed.
        failed: usize,
        /// All cases.
        count: usize,
    },
    /// Frames of a batch failed; each was named when it did.
    #[error("{failed} of {count} frames failed\n  cure: see the warnings above; start again to render what is missing")]
    Frames {
        /// Frames that failed.
        failed: usize,
        /// All frames.
        count: usize,
    },
    /// Scenes of a batch could not be read; each was named.
    #[error("{failed} of {count} scenes could not be read\n  cure: see the warnings above; the others are rendered")]
    Scenes {
        /// Scenes that failed.
        failed: usize,
        /// All scenes.
        count: usize,
    },
    /// The caller, or the user by Ctrl-C, asked to stop.
    #[error("stopped before it was done\n  cure: {cure}")]
    Stopped {
        /// What the user can do to go on.
        cure: &'static str,
    },
    /// A GPU pass found that its result cannot be trusted.
    #[error("pass '{pass}' reported a failure on the device: {problem}")]
    Device {
        /// Name of the pass.
        pass: &'static str,
        /// What its status word says.
        problem: String,
    },
}

impl Error {
    /// Bad input named by `what`.
    pub fn input(what: impl Into<String>, problem: impl Into<String>, cure: impl Into<String>) -> Self {
        Error::Input { what: what.into(), problem: problem.into(), cure: cure.into() }
    }

    /// Bad input in a file.
    pub fn file(path: &Path, problem: impl Into<String>, cure: impl Into<String>) -> Self {
        Error::input(path.display().to_string(), problem, cure)
    }

    /// Wrong use of the command line.
    pub fn usage(what: impl Into<String>, problem: impl Into<String>, cure: impl Into<String>) -> Self {
        Error::Usage { what: what.into(), problem: problem.into(), cure: cure.into() }
    }

    /// A refused file operation.
    pub fn io(path: &Path, operation: &'static str, source: std::io::Error) -> Self {
        Error::Io { path: path.to_owned(), operation, source }
    }

    /// Exit code of the command line: 1 = failed, 2 = wrong usage, 130 = stopped by the user.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Usage { .. } => 2,
            Error::Stopped { .. } => STOPPED,
            _ => 1,
        }
    }

    /// Is there no use in going on with something else on the same device?
    pub fn is_final(&self) -> bool {
        matches!(self, Error::Stopped { .. } | Error::DeviceGone { .. })
    }
}
