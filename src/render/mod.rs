//! From a scene to a picture.

use std::ops::ControlFlow;

use crate::output::Picture;
use crate::scene::Scene;
use crate::stats::Stats;
use crate::vk::Context;
use crate::{Error, Result};

/// How far a render is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Share that is done, 0 to 1.
    pub done: f64,
    /// What is being computed.
    pub phase: &'static str,
}

/// Renders `scene` on the device of `ctx`; `progress` may stop it.
pub fn render(
    _ctx: &Context,
    _scene: &Scene,
    _progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<(Picture, Stats)> {
    Err(Error::Device { pass: "render", problem: "not implemented yet".into() })
}
