//! What became of every frame: kept for the figures, logged as it happens.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{SystemTime, UNIX_EPOCH};

use indicatif::ProgressBar;
use serde::Serialize;

use crate::stats::{FrameStats, Outcome};
use crate::{Error, Result};

/// Shared by all threads of a batch.
pub struct Ledger {
    bar: ProgressBar,
    log: Option<(PathBuf, File)>,
    entries: Mutex<Entries>,
}

#[derive(Default)]
struct Entries {
    frames: Vec<FrameStats>,
    /// The first that the log could not take; what counts is the pictures.
    log_error: Option<Error>,
}

/// A line of the log.
#[derive(Serialize)]
struct Line<'a, T> {
    /// Seconds since 1970.
    time: f64,
    event: &'a str,
    #[serde(flatten)]
    figures: T,
}

impl Ledger {
    /// With a log in the file at `log`, to which lines are added.
    pub fn new(bar: ProgressBar, log: Option<&Path>) -> Result<Self> {
        let open = |path: &Path| {
            let file = File::options().append(true).create(true).open(path);
            Ok::<_, Error>((path.to_owned(), file.map_err(|e| Error::io(path, "open", e))?))
        };
        Ok(Self { bar, log: log.map(open).transpose()?, entries: Mutex::default() })
    }

    /// Notes what became of a frame.
    pub fn enter(&self, frame: FrameStats) {
        if let Some(error) = &frame.error {
            self.bar.suspend(|| log::warn!("{}: {error}", frame.title()));
        }
        self.say("frame", frame.without_passes());
        self.entries().frames.push(frame);
    }

    /// Adds a line to the log. One write each, so that batches can share a log.
    pub fn say(&self, event: &str, figures: impl Serialize) {
        let Some((path, file)) = &self.log else { return };
        let time = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
        let mut line = serde_json::to_string(&Line { time, event, figures }).expect("figures always serialise");
        line.push('\n');
        let mut file: &File = file;
        if let Err(e) = file.write_all(line.as_bytes()) {
            self.entries().log_error.get_or_insert(Error::io(path, "write", e));
        }
    }

    fn entries(&self) -> MutexGuard<'_, Entries> {
        self.entries.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// How many frames ended so.
    pub fn count(&self, outcome: Outcome) -> usize {
        self.entries().frames.iter().filter(|f| f.outcome == outcome).count()
    }

    /// Everything noted, in the order of scenes and frames; and whether the log has it all.
    pub fn finish(&self) -> (Vec<FrameStats>, Result<()>) {
        let mut entries = self.entries();
        let mut frames = std::mem::take(&mut entries.frames);
        frames.sort_by_key(|f| f.index);
        (frames, entries.log_error.take().map_or(Ok(()), Err))
    }
}
