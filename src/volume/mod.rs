//! Volumes: the voxel grid and its placement in the world, file formats, procedural phantoms.

pub mod grid;

pub use grid::{Grid, ScalarType, Volume, VoxelData};
