//! Tyndall: headless volume rendering with physically based multiple scattering on raw Vulkan compute.

pub mod error;
pub mod scene;
pub mod volume;

pub use error::{Error, Result};
