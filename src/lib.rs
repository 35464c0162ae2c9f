//! Tyndall: headless volume rendering with physically based multiple scattering on raw Vulkan compute.

pub mod abi;
pub mod bench;
pub mod check;
pub mod cli;
pub mod cpu;
pub mod error;
pub mod input;
pub mod measure;
pub mod output;
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
