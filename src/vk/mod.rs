//! Raw Vulkan: the only unsafe code of the crate. It knows no pass.
//!
//! What this layer promises: objects live as long as anything uses them (recorders keep what they bind), every
//! submission waits for the one before it, every object has a name, host access to a resource happens only through
//! [`Context::upload`] and [`Context::read_back`], and in debug builds and whenever validation is on, every recorder
//! checks for itself that barriers separate conflicting accesses ([`access`]).
//!
//! What it leaves to callers: barriers between dispatches, and that shaders stay inside their buffers.
//!
//! Device, command buffer and buffers may also be somebody else's: [`Context::borrowed`], [`Recorder::borrowed`],
//! [`Buffer::borrowed`]. Then their owner submits, waits, and keeps everything alive; these functions are `unsafe` and say
//! what must hold.
#![allow(unsafe_code, reason = "the one module that talks to Vulkan")]

pub mod access;
mod buffer;
mod context;
mod image;
mod injection;
mod pipeline;
mod pipeline_cache;
mod recorder;
mod statistics;
mod validation;

pub use access::Access;
pub use ash::vk::DriverId;
pub use buffer::{Bind, Buffer, Filter, HostWords};
pub use context::{BorrowedDevice, Context, ContextConfig, DeviceInfo, ImageReadBack, PipelineStats};
pub use context::{enable_features, list_devices};
pub use image::{Image, ImageFormat};
pub use injection::Injection;
pub use pipeline::{KernelForm, Pipeline};
pub use pipeline_cache::user_cache_dir;
pub use recorder::{Recorded, Recorder, Submission, TimedPass};
pub use statistics::KernelStatistics;
pub use validation::{Message, Severity, Validation, no_messages};
