//! A slab order by order.

use super::Bench;
use super::bodies::{SLAB_REFLECTED, SLAB_TRANSMITTED, beam, look, slab, voxel_slab};
use crate::Result;
use glam::Vec3;

const CACHED: &str = "2 %: light of order 2 and up is stored at voxels of a quarter of a mean free path";

pub(super) fn run(bench: &mut Bench<'_>) -> Result<()> {
    for (side, is_reflected, orders) in [("reflected", true, SLAB_REFLECTED), ("transmitted", false, SLAB_TRANSMITTED)]
    {
        let mut sum = 0.0;
        for (k, of_order) in (1..).zip(orders) {
            sum += of_order;
            let case = format!("slab tau 1, orders up to {k}, {side}");
            let mut scene = slab(1.0, 1e4, Vec3::ONE);
            scene.settings.orders = k;
            beam(&mut scene, 1.0);
            look(&mut scene, is_reflected, 1.0, 0.0);
            let estimate = bench.trace(&scene, 512)?;
            bench.check_path(format!("path, {case}"), &estimate, sum);
            let seen = bench.render(&voxel_slab(4, k, is_reflected))?.x;
            bench.check(format!("multiple, {case}"), seen.into(), sum, 0.02 * sum, CACHED);
        }
    }
    Ok(())
}
