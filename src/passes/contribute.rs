//! What the passes that add an order's light share (`glsl/include/contribute.glsl`): the images they add it to, and the
//! specialization and resources of their kernels.

use super::LIST_WORKGROUP;
use super::scene_data::SceneData;
use crate::Result;
use crate::vk::{Bind, Context, Filter, Image, ImageFormat, Recorder};

/// Source of one order: A and extinction, and for g ≠ 0 B by component (`contribute.glsl`).
#[derive(Clone)]
pub struct Source {
    /// rgb = A, a = extinction.
    pub a: Image,
    /// B's x, y, z; a 1×1×1 image where g = 0.
    pub b: [Image; 3],
}

/// What a pass adds an order's light to.
pub struct Orders<'a> {
    /// The next order's source; anything where there is no next order.
    pub next: &'a Source,
    /// rgb = what the eye sees of all orders so far, a = extinction.
    pub total: &'a Image,
}

impl Source {
    /// Images for a source. Zeroed by [`Source::clear`], not here.
    pub fn new(ctx: &Context, name: [&str; 4], dims: [u32; 3], is_anisotropic: bool) -> Result<Self> {
        let small = if is_anisotropic { dims } else { [1; 3] };
        Ok(Self {
            a: ctx.image_3d(name[0], dims, ImageFormat::Rgba16Float)?,
            b: [
                ctx.image_3d(name[1], small, ImageFormat::Rgba16Float)?,
                ctx.image_3d(name[2], small, ImageFormat::Rgba16Float)?,
                ctx.image_3d(name[3], small, ImageFormat::Rgba16Float)?,
            ],
        })
    }

    /// Sets everything to zero ([`crate::vk::Access::TransferWrite`]).
    pub fn clear(&self, rec: &mut Recorder) {
        rec.clear_image(&self.a);
        for b in &self.b {
            rec.clear_image(b);
        }
    }
}

/// Specialization constants of a kernel that adds light; `has_next`: another order follows.
pub(super) fn specialization(scene: &SceneData, has_next: bool) -> [(&'static str, u32); 3] {
    [("WORKGROUP", LIST_WORKGROUP), ("ANISOTROPIC", (scene.params.g != 0.0).into()), ("HAS_NEXT", has_next.into())]
}

/// Resources of a kernel that follows rays through the medium and adds light: scene, empty space (`cells`), and what
/// it writes.
pub(super) fn binds<'a>(scene: &'a SceneData, cells: &'a Image, orders: &Orders<'a>) -> Vec<(&'static str, Bind<'a>)> {
    vec![
        ("scene_block", scene.block.bind()),
        ("transfer_block", scene.transfer.bind()),
        ("emptiness", cells.sampled(Filter::Nearest)),
        ("scalar", scene.scalar.sampled(Filter::Nearest)),
        ("next_a", orders.next.a.storage()),
        ("total", orders.total.storage()),
        ("next_x", orders.next.b[0].storage()),
        ("next_y", orders.next.b[1].storage()),
        ("next_z", orders.next.b[2].storage()),
    ]
}
