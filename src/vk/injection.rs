//! Faults that are put into recorded commands on purpose, to show that they would be noticed.

use super::validation::{Message, Validation};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Injection {
    /// No barrier is recorded.
    MissingBarrier,
    /// The first dispatch that writes is recorded twice, with no barrier between.
    WriteAfterWrite,
    /// Before the first dispatch that writes a buffer goes one that gets too small a buffer.
    OutOfBounds,
    /// The first buffer that a dispatch uses is never freed.
    Leak,
    /// The first dispatch that uses a buffer gets one that is freed before; it is not run.
    StaleDescriptor,
    /// After some submissions the device says that it is lost. For tests: it shows how a render ends, not what is noticed.
    #[value(hide = true)]
    DeviceLoss,
}

impl Injection {
    /// Submissions that are waited for before [`Self::DeviceLoss`].
    pub(super) const SUBMISSIONS_BEFORE_LOSS: u32 = 500;

    /// The validation that notices it.
    pub fn validation(self) -> Validation {
        match self {
            Self::OutOfBounds => Validation::GpuAssisted,
            _ => Validation::CoreAndSync,
        }
    }

    /// How the ids of the messages begin that must come: one of each group.
    pub fn detectors(self) -> &'static [&'static [&'static str]] {
        match self {
            // The layer must see it, and so must we.
            Self::MissingBarrier => &[&["TYNDALL-HAZARD"], &["SYNC-HAZARD-"]],
            // Layer 1.3.239 does not see it.
            Self::WriteAfterWrite => &[&["TYNDALL-HAZARD"]],
            // Both in the order in which layers have had them; seen here: the first of each.
            Self::OutOfBounds => &[&[
                "VUID-vkCmdDispatch-None-02706",
                "VUID-vkCmdDispatch-None-08613",
                "VUID-vkCmdDispatch-storageBuffers-06936",
            ]],
            Self::Leak => &[&["TYNDALL-LEAK"]],
            Self::StaleDescriptor => &[&["VUID-vkCmdDispatch-None-02699", "VUID-vkCmdDispatch-None-08114"]],
            Self::DeviceLoss => &[],
        }
    }

    /// The ids among `messages` that show that it was noticed; none if something that must notice it did not.
    pub fn noticed_in(self, messages: &[Message]) -> Vec<String> {
        let mut ids = Vec::new();
        for group in self.detectors() {
            let is_of = |m: &&Message| group.iter().any(|prefix| m.id.starts_with(prefix));
            match messages.iter().find(is_of) {
                Some(message) => ids.push(message.id.clone()),
                None => return Vec::new(),
            }
        }
        ids
    }
}

/// The fault of a device, most of which happen once.
#[derive(Default)]
pub(super) struct Faults {
    kind: Option<Injection>,
    has_happened: AtomicBool,
    counted: AtomicU32,
}

impl Faults {
    pub(super) fn new(kind: Option<Injection>) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Is it this one?
    pub(super) fn is(&self, kind: Injection) -> bool {
        self.kind == Some(kind)
    }

    /// Is it this one, and has it not happened yet? From now on it has.
    pub(super) fn strikes(&self, kind: Injection) -> bool {
        self.is(kind) && !self.has_happened.swap(true, Ordering::Relaxed)
    }

    /// Counts from 1.
    pub(super) fn count(&self) -> u32 {
        self.counted.fetch_add(1, Ordering::Relaxed) + 1
    }

    pub(super) fn have_struck(&self, kind: Injection) -> bool {
        self.is(kind) && self.has_happened.load(Ordering::Relaxed)
    }
}
