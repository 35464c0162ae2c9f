//! Twin of `pilot.comp`.

use super::gather::{Carried, Lattice, lattice_shift, point_flip, proxy_energy, traced_radiance};
use super::march::make_ray;
use super::project::Cell;
use super::rng::stream_key;
use super::scene::HostScene;
use super::sphere::lattice_direction;
use super::texture::Texture;
use crate::abi::PilotSample;
use crate::passes::points::{points_of, weights_of};
use crate::shaders::constants::{CELL_POINTS, PILOT_STREAM, STEP_SAMPLES};
use glam::{Vec2, Vec3};

/// The cells that the pilot draws from a list.
pub fn pilot_cells(scene: &HostScene, list: &[u32], cells: u32) -> Vec<u32> {
    let s = &scene.params;
    let part = list.len() as u32 / cells;
    let draw = |number: u32| stream_key(number, PILOT_STREAM - 1, s.seed_low, s.seed_high) % part;
    (0..cells).map(|number| list[(number * part + draw(number)) as usize]).collect()
}

/// What one replicate finds in the cells, but for the steps, of which a twin without skipping has others. `light` and `sky`: as
/// for [`gather_proxy`](super::gather::gather_proxy).
#[allow(clippy::too_many_arguments, reason = "the kernel's arguments")]
pub fn pilot(
    scene: &HostScene,
    cells: &[u32],
    carried: Carried<'_>,
    light: &Texture<Vec2>,
    sky: Vec3,
    replicate: u32,
    directions: u32,
    [step_voxels, proxy_step_voxels]: [f32; 2],
) -> Vec<PilotSample> {
    let s = &scene.params;
    let points = points_of(directions);
    let weights = weights_of(&points);
    let of_cell = |&index: &u32| {
        let cell = Cell::from_linear(s, index);
        let stream = PILOT_STREAM + replicate;
        let (shift, flip) = (lattice_shift(s, index, stream, Lattice::Traced), point_flip(s, index, stream));
        let (mut traced, mut residual, mut energies) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        for slot in 0..directions {
            let point = points[slot as usize] ^ flip;
            let towards = lattice_direction(slot, directions, shift);
            let ray = make_ray(s, cell.position(point), towards, STEP_SAMPLES as f32 * step_voxels);
            let radiance = traced_radiance(s, carried, ray, towards);
            let energy = proxy_energy(s, light, sky, cell.middle(), towards, proxy_step_voxels);
            let scattered = cell.scattering(scene, point) * (weights[slot as usize] / directions as f32);
            traced += radiance * scattered;
            residual += (radiance - energy) * scattered;
            energies += energy / directions as f32;
        }
        let scattered = (0..CELL_POINTS).map(|point| cell.scattering(scene, point)).sum::<Vec3>() / CELL_POINTS as f32;
        PilotSample {
            traced: traced.into(),
            base: (energies * scattered).into(),
            residual: residual.into(),
            ..PilotSample::default()
        }
    };
    cells.iter().map(of_cell).collect()
}
