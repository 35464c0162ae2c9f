//! Tyndall: headless volume rendering with physically based multiple scattering on raw Vulkan compute.
//!
//! Where to begin:
//!
//! - A picture of a volume in memory: [`scene::resolve`] makes a [`scene::Scene`] of it, [`render::render`] a picture,
//!   [`output::write_picture`] a file. `examples/render_a_volume.rs` does this in thirty lines.
//! - Further pictures of the same scene: [`render::Renderer`]. Frames of a turntable, key frames, a series: [`scene::Sequence`].
//! - Scan, radix sort and selection on your own Vulkan device: [`primitives`], and `examples/sort_your_buffer.rs`.
//! - How it works, by one voxel's way from file to pixel: [`architecture`].
//!
//! # In your own project
//!
//! The build script compiles the kernels with shaderc, whose library Debian and Ubuntu ship in a form that does not link.
//! `scripts/setup` in a checkout of Tyndall puts together one that does; tell Cargo where, in your project's `.cargo/config.toml`:
//!
//! ```toml
//! [env]
//! SHADERC_LIB_DIR = "/path/to/tyndall/.cache/shaderc"
//! ```
//!
//! Where no shaderc is installed, it is built from source (with CMake, Ninja and Python, in some minutes).
//!
//! Whatever fails is an [`Error`] that names what it is about and the cure. Vulkan's validation layer runs along where
//! [`vk::ContextConfig`] asks for it.

pub mod abi;
#[doc = include_str!("../ARCHITECTURE.md")]
pub mod architecture {}
pub mod bench;
pub mod check;
pub mod cli;
pub mod cpu;
pub mod error;
pub mod input;
pub mod measure;
pub mod output;
mod parallel;
pub mod passes;
pub mod primitives;
pub mod render;
pub mod scene;
pub mod shaders;
pub mod stats;
pub mod verify;
pub mod vk;
pub mod volume;

pub use error::{Error, Result};
