//! Plain twins of the GPU passes: the same names and argument order, the simplest code that is right. Tests compare
//! the passes with them.
//!
//! Fields are [`Texture`](texture::Texture)s in single precision, so a twin differs from its pass by the half floats
//! that the GPU stores. Rays visit every step: what the GPU skips must add nothing.

pub mod bench_rays;
pub mod camera;
pub mod classify;
pub mod compact;
pub mod cubes;
pub mod delta_lights;
pub mod emptiness;
pub mod environment;
pub mod gather;
pub mod march;
pub mod mips;
pub mod path;
pub mod phong;
pub mod pilot;
pub mod project;
pub mod proxy;
pub mod quantiser;
pub mod radix_sort;
pub mod rng;
pub mod scan;
pub mod scene;
pub mod see;
pub mod select;
pub mod single_scatter;
pub mod sphere;
pub mod spread;
pub mod texture;
