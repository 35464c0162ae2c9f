//! Radix sort, scan and selection (stream compaction) on the GPU for other programs: on a Vulkan device, in buffers and in a
//! command buffer that may all be the caller's.
//!
//! ```no_run
//! # use tyndall::primitives::*;
//! # fn example(ctx: &Context, keys: &Buffer<f32>, recorder: Recorder) -> tyndall::Result<()> {
//! let sort = Sort::<f32>::new(ctx, Order::Descending, Payloads::None)?;
//! let scratch = sort.scratch(ctx, 1_000_000)?;
//! let mut recording = Recording::new(ctx, recorder)?;
//! sort.record_keys(&mut recording, keys, Count::Host(1_000_000), 0..32, &scratch)?;
//! let recorded = recording.finish()?;
//! // Submit the command buffer and wait for it; then:
//! recorded.check()?;
//! # Ok(())
//! # }
//! ```
//!
//! `examples/sort_your_buffer.rs` is a whole program.
//!
//! # What is whose
//!
//! | | the caller's | ours |
//! |---|---|---|
//! | device | [`Context::borrowed`], with the features of [`enable_features`] | [`Context::new`] |
//! | arrays | [`Buffer::borrowed`]: `VkBuffer`, offset, size | [`Context::device_buffer`], [`Context::upload`] |
//! | scratch memory | [`Sort::scratch_in`] and its like, of at least [`Sort::scratch_bytes`] | [`Sort::scratch`] and its like |
//! | command buffer | [`Recorder::borrowed`], [`Recording::finish`] | [`Recorder::new`], [`Recording::submit_and_wait`] |
//!
//! The functions called `borrowed` are `unsafe`: they trust the caller about the handles. All else is safe, and what can be
//! checked is an [`Error`].
//!
//! # Memory accesses and barriers
//!
//! Each `record…` says how its buffers are first and last accessed. Recorded inside are global memory barriers
//!
//! - at the beginning of a [`Recording`] and of each `record…`, from all that compute shaders and transfer commands did before
//!   (`COMPUTE_SHADER` with `SHADER_STORAGE_READ | SHADER_SAMPLED_READ | SHADER_STORAGE_WRITE`; `ALL_TRANSFER` with
//!   `TRANSFER_WRITE`): what a kernel wrote or a copy brought earlier on the queue may be sorted without a barrier of the
//!   caller's, and what one primitive wrote the next may read;
//! - between its own steps;
//! - at the end of a recording, from compute shaders to copies that read (`ALL_TRANSFER`, `TRANSFER_READ`), and from the copy
//!   of the report to the host.
//!
//! The caller orders everything else: what other stages (graphics, ray tracing) did before the first access, and the last
//! access before all uses but those by these primitives and by copies out. Barriers order what is in submission order on
//! the same queue; between queues it takes the caller's semaphores. What the host wrote before the submission needs nothing.
//!
//! A recording changes the compute pipeline, its descriptor set 0 and its push constants in the command buffer.
//!
//! # Counts
//!
//! How many items there are is known to the host, or it is a word that the GPU reads when the commands run
//! ([`Count::Gpu`]). It is read by a compute shader (`COMPUTE_SHADER`, `SHADER_STORAGE_READ`), never as indirect arguments:
//! those are made from it in scratch memory. Items beyond the count are neither read nor written. There may be
//! [`MAX_ITEMS`] = 2³⁰ − 1 items, and as many as fit the device's `maxStorageBufferRange`.
//!
//! # Forward progress
//!
//! Tiles look back at what earlier ones have published where the driver is known to go on running workgroups that have started,
//! and leave it to barriers between dispatches where it is not ([`carry_of`], [`Carry`]). Results are the same bits. The
//! constructors `with_carry` choose either way.
//!
//! # When it goes wrong
//!
//! Kernels that could not do their work write to no wrong place and say so: [`Recorded::check`] is an error then, for all
//! that was recorded. It also counts how often a tile had to be computed in place of one that did not come forth.

mod scan;
mod select;
mod sort;

pub use crate::passes::lookback::{Carry, Count, MAX_ITEMS, Report};
pub use crate::passes::tuning::{carry_of, carry_on};
pub use crate::vk::{BorrowedDevice, Buffer, Context, DriverId, Recorder, enable_features};
pub use scan::{Scan, ScanKind, ScanScratch};
pub use select::{Select, SelectScratch, Selected};
pub use sort::{FromTo, Key, Order, Payloads, Sort, SortScratch};

use crate::passes::lookback::Diagnostics;
use crate::shaders::constants;
use crate::vk::{self, Access, HostWords};
use crate::{Error, Result};

/// One word of a buffer, for a number that the GPU writes.
#[derive(Clone, Copy)]
pub struct Word<'a> {
    /// Holds it.
    pub buffer: &'a Buffer<u32>,
    /// Element of `buffer`.
    pub offset: u32,
}

/// Commands being recorded, and what they will report.
pub struct Recording {
    recorder: Recorder,
    diagnostics: Diagnostics,
    report: HostWords,
}

/// What [`Recorded::check`] finds before the commands have run.
const NOT_YET: u32 = u32::MAX;

impl Recording {
    /// Starts with a recorder, of the caller's command buffer ([`Recorder::borrowed`]) or of one of ours
    /// ([`Recorder::new`]). Takes some words of memory for the report.
    pub fn new(ctx: &Context, mut recorder: Recorder) -> Result<Self> {
        let diagnostics = Diagnostics::uncleared(ctx)?;
        let report = HostWords::new(ctx, "report", &[NOT_YET; constants::DIAGNOSTICS_WORDS as usize])?;
        // The commands may be submitted more than once: the copy at their end comes before this fill and that copy.
        recorder.barrier(Access::TransferRead, Access::TransferWrite);
        recorder.barrier(Access::TransferWrite, Access::TransferWrite);
        diagnostics.clear(&mut recorder);
        Ok(Self { recorder, diagnostics, report })
    }

    fn close(mut self) -> (Recorder, HostWords) {
        self.recorder.barrier(Access::ComputeReadWrite, Access::TransferRead);
        self.recorder.copy_to_host(self.diagnostics.buffer(), &self.report);
        (self.recorder, self.report)
    }

    /// Ends the recording in a command buffer of the caller's, which may go on with commands of its own.
    ///
    /// Keep what is returned until the device is done with every submission of the command buffer. Pipelines, scratch
    /// memory and buffers need not be kept beside it, but for what the caller owns.
    ///
    /// Errors: what Vulkan refused while recording; the command buffer must not be submitted then.
    pub fn finish(self) -> Result<Recorded> {
        let (recorder, report) = self.close();
        Ok(Recorded { report, _commands: recorder.finish()? })
    }

    /// Submits commands of ours, waits for them, and does what [`Recorded::check`] does.
    pub fn submit_and_wait(self) -> Result<Report> {
        let (recorder, report) = self.close();
        recorder.submit_and_wait()?;
        report_of(&report)?.check(PASS)
    }
}

/// How errors call the work of a recording.
const PASS: &str = "primitives";

fn report_of(words: &HostWords) -> Result<Report> {
    let report = Report::of(&words.read());
    if report.errors == NOT_YET {
        return Err(Error::Device { pass: PASS, problem: "the commands have not run, or not to their end".into() });
    }
    Ok(report)
}

/// What was recorded into a command buffer of the caller's: keeps alive what the commands use, and has their report.
#[must_use = "what the commands use must outlive them"]
pub struct Recorded {
    report: HostWords,
    _commands: vk::Recorded,
}

impl Recorded {
    /// What the latest submission of the commands reports, once the caller has waited for it (fence or semaphore).
    ///
    /// Errors: the commands have not run to their end; a look-back ran out of its loop budget, or a count on the GPU
    /// exceeded the capacity, or subgroups were not full. Then what was recorded has not come to its right result.
    pub fn check(&self) -> Result<Report> {
        report_of(&self.report)?.check(PASS)
    }
}

/// The items of the count or, where only the GPU knows it, that there is room for. An error that names `what` if it is more
/// than `room`.
fn most_items(what: &str, count: Count<'_>, room: usize) -> Result<usize> {
    match count {
        Count::Host(n) if n as usize > room => Err(Error::input(
            what,
            format!("{n} items, but its buffers and its scratch memory have room for {room}"),
            "give a smaller count or longer buffers, or make scratch memory for more",
        )),
        Count::Host(n) => Ok(n as usize),
        Count::Gpu { buffer, offset } => {
            check_word(what, "count", buffer, offset)?;
            Ok(room)
        }
    }
}

fn check_word(what: &str, role: &str, buffer: &Buffer<u32>, offset: u32) -> Result<()> {
    if offset as usize >= buffer.len() {
        let problem = format!("its {role} is element {offset} of '{}', which has {}", buffer.name(), buffer.len());
        return Err(Error::input(what, problem, "give an element that there is"));
    }
    Ok(())
}

/// An error that names `what` if two of the arrays share memory.
fn check_apart(what: &str, arrays: &[(&str, &Buffer<u32>)]) -> Result<()> {
    for (i, (role, array)) in arrays.iter().enumerate() {
        for (other_role, other) in &arrays[..i] {
            if array.overlaps(other) {
                let problem = format!("{other_role} ('{}') and {role} ('{}') overlap", other.name(), array.name());
                return Err(Error::input(what, problem, "give memory that does not overlap"));
            }
        }
    }
    Ok(())
}

/// What a kernel over `items` items may touch, at least one element: nothing empty can be bound.
fn bound(array: &Buffer<u32>, items: usize) -> Buffer<u32> {
    array.slice(0..items.max(1))
}
