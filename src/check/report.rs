//! What a check found, as text, JSON and JUnit's XML.

use super::allow::Allowed;
use crate::stats::{DeviceStats, name_of, to_json};
use crate::vk::{KernelForm, Message, Validation};
use crate::{Error, Result};
use quick_junit::{NonSuccessKind, TestCase, TestCaseStatus, TestSuite};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

/// Everything.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// One per kind of validation.
    pub runs: Vec<RunReport>,
    /// Entries of the allow-list for the layer's version that let nothing through.
    pub unused: Vec<Allowed>,
}

/// All cases under one kind of validation.
#[derive(Clone, Debug, Serialize)]
pub struct RunReport {
    /// The kind.
    pub kind: Validation,
    /// Where it ran.
    pub device: DeviceStats,
    /// Version of the validation layer.
    pub layer: Option<String>,
    /// Different kernels that ran.
    pub kernels: usize,
    /// Different forms of them: kernels with values of their specialization constants.
    pub forms: usize,
    /// Set-up, the scenes, teardown.
    pub cases: Vec<CaseReport>,
    /// Entries of the allow-list that let something through.
    #[serde(skip)]
    used: Vec<Allowed>,
}

/// One case.
#[derive(Clone, Debug, Serialize)]
pub struct CaseReport {
    /// What it is for.
    pub name: String,
    /// Elapsed time.
    pub seconds: f64,
    /// Why it did not come to its end, or what it left.
    pub error: Option<String>,
    /// What was said, but for what is allowed.
    pub messages: Vec<Message>,
    /// Messages that were let through.
    pub allowed: usize,
}

impl CaseReport {
    /// Was nothing said, and did it end well?
    pub fn passes(&self) -> bool {
        self.error.is_none() && self.messages.is_empty()
    }

    /// What is wrong: why it did not end well; and of every id the first message, and how many there are.
    fn complaints(&self) -> Vec<String> {
        let mut by_id: Vec<(&Message, usize)> = Vec::new();
        for message in &self.messages {
            match by_id.iter_mut().find(|(first, _)| first.id == message.id) {
                Some((_, count)) => *count += 1,
                None => by_id.push((message, 1)),
            }
        }
        let line = |(message, count): (&Message, usize)| match count {
            1 => message.to_string(),
            _ => format!("{count} times, first: {message}"),
        };
        self.error.iter().cloned().chain(by_id.into_iter().map(line)).collect()
    }
}

impl RunReport {
    pub(super) fn new(
        kind: Validation,
        device: DeviceStats,
        layer: Option<String>,
        kernel_forms: &[KernelForm],
        mut cases: Vec<CaseReport>,
        allowed: &[Allowed],
    ) -> Self {
        let version = layer.clone().unwrap_or_default();
        let mut is_used = vec![false; allowed.len()];
        for case in &mut cases {
            let all = case.messages.len();
            case.messages.retain(|message| {
                let by = allowed.iter().position(|a| a.covers(message, &version));
                by.inspect(|&i| is_used[i] = true).is_none()
            });
            case.allowed = all - case.messages.len();
        }
        let used = allowed.iter().zip(is_used).filter(|(_, used)| *used).map(|(a, _)| a.clone()).collect();
        let mut names: Vec<_> = kernel_forms.iter().map(|form| form.name).collect();
        names.dedup();
        Self { kind, device, layer, kernels: names.len(), forms: kernel_forms.len(), cases, used }
    }

    /// Cases that do not pass.
    pub fn failures(&self) -> usize {
        self.cases.iter().filter(|case| !case.passes()).count()
    }

    /// For people.
    fn print(&self, out: &mut String) -> std::fmt::Result {
        let layer = self.layer.as_deref().unwrap_or("of unknown version");
        let (kind, device) = (name_of(&self.kind), &self.device);
        writeln!(out, "{kind}: {}, {}; layer {layer}", device.name, device.driver)?;
        for case in self.cases.iter().filter(|case| !case.passes()) {
            writeln!(out, "FAILED  {}", case.name)?;
            for complaint in case.complaints().iter().take(MOST_LINES) {
                writeln!(out, "        {}", complaint.replace('\n', "\n        "))?;
            }
            let more = case.complaints().len().saturating_sub(MOST_LINES);
            if more > 0 {
                writeln!(out, "        and {more} more")?;
            }
        }
        let sum = |of: fn(&CaseReport) -> usize| self.cases.iter().map(of).sum::<usize>();
        let seconds: f64 = self.cases.iter().map(|case| case.seconds).sum();
        writeln!(
            out,
            "{} of {} cases passed, {} messages, {} allowed; {} kernels in {} forms; {seconds:.1} s",
            self.cases.len() - self.failures(),
            self.cases.len(),
            sum(|case| case.messages.len()),
            sum(|case| case.allowed),
            self.kernels,
            self.forms
        )?;
        Ok(())
    }

    /// Is the entry for this version of the layer?
    pub(super) fn might_use(&self, entry: &Allowed) -> bool {
        self.layer.as_ref().is_some_and(|layer| entry.is_for(layer))
    }

    /// Did the entry let something through?
    pub(super) fn has_used(&self, entry: &Allowed) -> bool {
        self.used.contains(entry)
    }
}

/// Complaints that are shown of a case.
const MOST_LINES: usize = 5;

impl Report {
    /// Cases that do not pass, and all.
    pub fn failures(&self) -> (usize, usize) {
        let sum = |of: fn(&RunReport) -> usize| self.runs.iter().map(of).sum();
        (sum(RunReport::failures), sum(|run| run.cases.len()))
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        self.runs.iter().try_for_each(|run| run.print(&mut out)).expect("writing to a String cannot fail");
        for entry in &self.unused {
            out += &format!("the allow-list's {} (layer {}) let nothing through\n", entry.id, entry.layer);
        }
        out
    }

    /// The JSON object.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// JUnit's XML: a suite per kind of validation, a test case per scene.
    pub fn to_junit(&self) -> Result<String> {
        let mut junit = quick_junit::Report::new("tyndall check");
        for run in &self.runs {
            let mut suite = TestSuite::new(name_of(&run.kind));
            for case in &run.cases {
                let mut status = TestCaseStatus::success();
                if !case.passes() {
                    status = TestCaseStatus::non_success(NonSuccessKind::Failure);
                    let complaints = case.complaints();
                    status.set_message(complaints[0].lines().next().unwrap_or_default());
                    status.set_description(complaints.join("\n"));
                }
                let mut test = TestCase::new(&case.name, status);
                test.set_classname(format!("tyndall.check.{}", name_of(&run.kind)));
                test.set_time(Duration::from_secs_f64(case.seconds));
                suite.add_test_case(test);
            }
            junit.add_test_suite(suite);
        }
        junit.to_string().map_err(|e| Error::input("JUnit report", e.to_string(), "report this as a bug"))
    }

    /// Writes JUnit's XML to a file.
    pub fn write_junit(&self, path: &Path) -> Result<()> {
        crate::output::write_atomically(path, self.to_junit()?.as_bytes())
    }
}
