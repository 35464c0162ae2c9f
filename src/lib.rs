//! Tyndall: headless volume rendering with physically based multiple scattering on raw Vulkan compute.

pub mod abi;
pub mod error;
pub mod scene;
pub mod shaders;
pub mod vk;
pub mod volume;

pub use error::{Error, Result};
