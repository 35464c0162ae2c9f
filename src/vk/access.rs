//! Kinds of access, what they mean to Vulkan, and the hazard check that needs no GPU.
//!
//! Synchronization validation 1.3.239 does not see write-after-write, nor in-place updates of one buffer, nor missing
//! host-read barriers. The recorder knows what each command touches (shader reflection says whether a binding is
//! `readonly` or `writeonly`), so it checks by itself.

use ash::vk;
use std::collections::HashMap;
use std::ops::Range;

/// What a command does with a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// A compute shader reads a storage buffer, a storage image or a sampled image.
    ComputeRead,
    /// A compute shader writes.
    ComputeWrite,
    /// A compute shader reads and writes.
    ComputeReadWrite,
    /// Arguments of an indirect dispatch are read.
    IndirectRead,
    /// A copy reads.
    TransferRead,
    /// A copy or a fill writes.
    TransferWrite,
    /// The host reads after the submission has finished.
    HostRead,
}

/// The single kinds as bits; [`Access::ComputeReadWrite`] is two of them.
const COMPUTE_READ: u8 = 1;
const COMPUTE_WRITE: u8 = 2;
const INDIRECT_READ: u8 = 4;
const TRANSFER_READ: u8 = 8;
const TRANSFER_WRITE: u8 = 16;
const HOST_READ: u8 = 32;
const WRITES: u8 = COMPUTE_WRITE | TRANSFER_WRITE;

impl Access {
    fn bits(self) -> u8 {
        match self {
            Access::ComputeRead => COMPUTE_READ,
            Access::ComputeWrite => COMPUTE_WRITE,
            Access::ComputeReadWrite => COMPUTE_READ | COMPUTE_WRITE,
            Access::IndirectRead => INDIRECT_READ,
            Access::TransferRead => TRANSFER_READ,
            Access::TransferWrite => TRANSFER_WRITE,
            Access::HostRead => HOST_READ,
        }
    }

    /// Vulkan's pipeline stage and access flags: the only table of this kind.
    pub(super) fn to_vk(self) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
        use vk::{AccessFlags2 as A, PipelineStageFlags2 as S};
        match self {
            Access::ComputeRead => (S::COMPUTE_SHADER, A::SHADER_STORAGE_READ | A::SHADER_SAMPLED_READ),
            Access::ComputeWrite => (S::COMPUTE_SHADER, A::SHADER_STORAGE_WRITE),
            Access::ComputeReadWrite => {
                (S::COMPUTE_SHADER, A::SHADER_STORAGE_READ | A::SHADER_SAMPLED_READ | A::SHADER_STORAGE_WRITE)
            }
            Access::IndirectRead => (S::DRAW_INDIRECT, A::INDIRECT_COMMAND_READ),
            Access::TransferRead => (S::ALL_TRANSFER, A::TRANSFER_READ),
            Access::TransferWrite => (S::ALL_TRANSFER, A::TRANSFER_WRITE),
            Access::HostRead => (S::HOST, A::HOST_READ),
        }
    }
}

/// The stages of all kinds but the host's, whose reads wait for the submission's end.
pub(super) const ALL_STAGES: vk::PipelineStageFlags2 = vk::PipelineStageFlags2::from_raw(
    vk::PipelineStageFlags2::COMPUTE_SHADER.as_raw()
        | vk::PipelineStageFlags2::DRAW_INDIRECT.as_raw()
        | vk::PipelineStageFlags2::ALL_TRANSFER.as_raw(),
);

/// Kinds whose commands run in the stages of the kinds in `bits`: an execution dependency covers whole stages.
fn same_stages(bits: u8) -> u8 {
    let mut all = bits;
    if bits & (COMPUTE_READ | COMPUTE_WRITE) != 0 {
        all |= COMPUTE_READ | COMPUTE_WRITE;
    }
    if bits & (TRANSFER_READ | TRANSFER_WRITE) != 0 {
        all |= TRANSFER_READ | TRANSFER_WRITE;
    }
    all
}

/// An earlier access that later ones may conflict with.
#[derive(Clone, Debug)]
struct Past {
    range: Range<u64>,
    kind: u8,
    /// Kinds of later access that barriers have ordered after this one.
    ordered: u8,
    command: String,
}

/// Two conflicting accesses without a barrier between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hazard {
    /// "read after write", "write after read" or "write after write".
    pub kind: &'static str,
    /// Name of the resource.
    pub resource: String,
    /// The earlier command.
    pub earlier: String,
    /// The later command.
    pub later: String,
}

impl std::fmt::Display for Hazard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} hazard on '{}': '{}' then '{}' with no barrier that names both",
            self.kind, self.resource, self.earlier, self.later
        )
    }
}

/// Follows the accesses of one submission and reports hazards. Pure logic, no Vulkan.
#[derive(Default)]
pub struct HazardTracker {
    past: HashMap<u64, Vec<Past>>,
    hazards: Vec<Hazard>,
}

impl HazardTracker {
    /// Global memory barriers, each between two kinds of access, by one command.
    pub fn barriers(&mut self, barriers: &[(Access, Access)]) {
        for past in self.past.values_mut().flatten() {
            let before = past.ordered;
            for (from, to) in barriers.iter().map(|&(from, to)| (from.bits(), to.bits())) {
                // A write must be named to be made visible; a read needs only the execution dependency of its stage. A
                // kind that an earlier command ordered after the access chains on to this one.
                let is_source =
                    if past.kind & WRITES != 0 { from & past.kind != 0 } else { same_stages(from) & past.kind != 0 };
                let is_chained = before & same_stages(from) != 0;
                if is_source || is_chained {
                    past.ordered |= to;
                }
            }
        }
    }

    /// One command's access to bytes `range` of resource `id`.
    pub fn access(&mut self, id: u64, resource: &str, range: Range<u64>, access: Access, command: &str) {
        let now = access.bits();
        let past = self.past.entry(id).or_default();
        for earlier in past.iter() {
            let overlaps = earlier.range.start < range.end && range.start < earlier.range.end;
            let wrote = earlier.kind & WRITES != 0;
            let writes = now & WRITES != 0;
            if overlaps && (wrote || writes) && now & !earlier.ordered != 0 {
                self.hazards.push(Hazard {
                    kind: match (wrote, writes) {
                        (true, true) => "write after write",
                        (true, false) => "read after write",
                        _ => "write after read",
                    },
                    resource: resource.to_owned(),
                    earlier: earlier.command.clone(),
                    later: command.to_owned(),
                });
            }
        }
        if now & WRITES != 0 {
            past.retain(|p| p.range.start < range.start || p.range.end > range.end);
        }
        for bit in [COMPUTE_READ, COMPUTE_WRITE, INDIRECT_READ, TRANSFER_READ, TRANSFER_WRITE, HOST_READ] {
            let is_known = past.iter().any(|p| p.kind == bit && p.range == range && p.ordered == 0);
            if now & bit != 0 && !is_known {
                past.push(Past { range: range.clone(), kind: bit, ordered: 0, command: command.to_owned() });
            }
        }
    }

    /// What was found since the last call.
    pub fn take_hazards(&mut self) -> Vec<Hazard> {
        std::mem::take(&mut self.hazards)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An access and the barrier after it, both optional.
    type Step = (Option<Access>, Option<(Access, Access)>);

    fn run(steps: &[Step]) -> Vec<&'static str> {
        let mut t = HazardTracker::default();
        for (i, (access, barrier)) in steps.iter().enumerate() {
            if let Some(a) = access {
                t.access(1, "buffer", 0..64, *a, &format!("step {i}"));
            }
            if let Some((from, to)) = barrier {
                t.barriers(&[(*from, *to)]);
            }
        }
        t.take_hazards().iter().map(|h| h.kind).collect()
    }

    use Access::*;

    #[test]
    fn the_three_hazards_are_reported_without_a_barrier() {
        assert_eq!(run(&[(Some(ComputeWrite), None), (Some(ComputeRead), None)]), ["read after write"]);
        assert_eq!(run(&[(Some(ComputeRead), None), (Some(ComputeWrite), None)]), ["write after read"]);
        assert_eq!(run(&[(Some(TransferWrite), None), (Some(ComputeWrite), None)]), ["write after write"]);
    }

    #[test]
    fn in_place_updates_need_a_barrier_too() {
        assert!(!run(&[(Some(ComputeReadWrite), None), (Some(ComputeReadWrite), None)]).is_empty());
        let barrier = Some((ComputeReadWrite, ComputeReadWrite));
        assert!(run(&[(Some(ComputeReadWrite), barrier), (Some(ComputeReadWrite), None)]).is_empty());
    }

    #[test]
    fn a_barrier_must_name_the_access() {
        let wrong = Some((ComputeWrite, TransferRead));
        assert_eq!(run(&[(Some(ComputeWrite), wrong), (Some(ComputeRead), None)]), ["read after write"]);
        let right = Some((ComputeWrite, ComputeRead));
        assert!(run(&[(Some(ComputeWrite), right), (Some(ComputeRead), None)]).is_empty());
        let indirect = Some((ComputeWrite, ComputeRead));
        assert_eq!(run(&[(Some(ComputeWrite), indirect), (Some(IndirectRead), None)]), ["read after write"]);
        assert_eq!(run(&[(Some(ComputeWrite), None), (Some(HostRead), None)]), ["read after write"]);
    }

    #[test]
    fn barriers_chain() {
        let steps = [
            (Some(ComputeWrite), Some((ComputeWrite, TransferRead))),
            (None, Some((TransferRead, ComputeRead))),
            (Some(ComputeRead), None),
        ];
        assert!(run(&steps).is_empty());
    }

    #[test]
    fn barriers_of_one_command_do_not_chain() {
        let mut t = HazardTracker::default();
        t.access(1, "buffer", 0..64, ComputeWrite, "a");
        t.barriers(&[(ComputeWrite, TransferRead), (TransferRead, ComputeRead)]);
        t.access(1, "buffer", 0..64, ComputeRead, "b");
        assert_eq!(t.take_hazards().len(), 1);
        t.barriers(&[(TransferRead, ComputeRead), (ComputeWrite, IndirectRead)]);
        t.access(1, "buffer", 0..64, ComputeRead, "c");
        assert!(t.take_hazards().is_empty(), "the command before ordered transfers");
    }

    #[test]
    fn reads_do_not_conflict_and_ranges_are_apart() {
        assert!(run(&[(Some(ComputeRead), None), (Some(ComputeRead), None)]).is_empty());
        let mut t = HazardTracker::default();
        t.access(1, "buffer", 0..64, ComputeWrite, "a");
        t.access(1, "buffer", 64..128, ComputeWrite, "b");
        t.access(2, "other", 0..64, ComputeRead, "c");
        assert!(t.take_hazards().is_empty());
        t.access(1, "buffer", 60..68, ComputeRead, "d");
        assert_eq!(t.take_hazards().len(), 2);
    }
}
