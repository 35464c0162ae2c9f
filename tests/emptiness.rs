//! What rays and paths skip by, against its CPU twin.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{Setup, cases, scene_of, scenes, texture};
use common::gpu_test;
use data::assert_same;
use glam::Vec4;
use tyndall::cpu::emptiness;
use tyndall::cpu::texture::Texture;
use tyndall::passes::emptiness::{Emptiness, Measure};
use tyndall::shaders::constants::{MAX_EMPTINESS, OCTANT_BITS, SKIP_SIZE};
use tyndall::vk::{Context, Recorder};
use tyndall::volume::Grid;

fn measured(ctx: &Context, setup: &Setup, edge: u32, measure: Measure) -> Texture<u32> {
    let pass = Emptiness::new(ctx, setup.host.params.dims, edge, measure).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    pass.record(&mut rec, &setup.data, &setup.field);
    rec.submit_and_wait().unwrap();
    Texture::new(pass.image.extent(), ctx.read_back_image(&pass.image).unwrap())
}

#[test]
fn all_measures_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            let setup = Setup::new(ctx, &scene);
            for edge in cases(vec![4, 8, 3]) {
                let occupied = emptiness::occupancy(&setup.host.params, &texture(ctx, &setup.field), edge);
                let got = |measure| measured(ctx, &setup, edge, measure).texels;
                let is_occupied = |&is: &bool| if is { 0 } else { MAX_EMPTINESS };
                let expected: Vec<u32> = occupied.texels.iter().map(is_occupied).collect();
                assert_same(name, &got(Measure::Occupied), &expected);
                assert_same(name, &got(Measure::Distance), &emptiness::distance(&occupied).texels);
                assert_same(name, &got(Measure::Octants), &emptiness::octants(&occupied).texels);
            }
        }
    });
}

/// By hand: a line of cells with one occupied voxel. Interpolation carries it into the neighbour cell only from the
/// cell's edge. Distances stop at the limit.
#[test]
fn distances_by_hand() {
    gpu_test(|ctx| {
        let setup = |voxels: u32, occupied: usize| {
            let mut values = vec![0.0; voxels as usize];
            values[occupied] = 0.9;
            let grid = Grid::axis_aligned([voxels, 1, 1], [1.0; 3], [0.0; 3]);
            Setup::new(ctx, &scene_of(grid, values))
        };
        let distances = |voxels, occupied| measured(ctx, &setup(voxels, occupied), 8, Measure::Distance).texels;
        assert_eq!(distances(45, 20), [2, 1, 0, 1, 2, 3]);
        assert_eq!(distances(45, 16), [1, 0, 0, 1, 2, 3]);
        assert_eq!(distances(45, 23), [2, 1, 0, 0, 1, 2]);
        let long = distances(320, 0);
        assert_eq!(long[30..35], [30, 31, 32, 32, 32]);
        assert_eq!(long[39], 32);
        // Towards larger x the ways in front of the occupied cell count, towards smaller x those behind it.
        let octants = measured(ctx, &setup(45, 20), 8, Measure::Octants).texels;
        let towards = |octant: u32| octants.iter().map(|word| word >> (OCTANT_BITS * octant) & 15).collect::<Vec<_>>();
        for octant in 0..8 {
            let expected = if octant & 1 == 1 { [2, 1, 0, 15, 15, 15] } else { [15, 15, 0, 1, 2, 3] };
            assert_eq!(towards(octant), expected, "octant {octant}");
        }
    });
}

/// The octants' distances are right for rays: along every direction from a cell, all that a ray may cross is empty.
#[test]
fn nothing_is_skipped_that_holds_extinction() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            let setup = Setup::new(ctx, &scene);
            let field = texture(ctx, &setup.field);
            let reach = measured(ctx, &setup, SKIP_SIZE, Measure::Octants);
            for i in 0..field.texels.len() as u32 {
                let voxel = tyndall::cpu::scene::voxel_from_linear(&setup.host.params, i);
                let cell = (voxel / SKIP_SIZE).as_ivec3();
                for octant in 0..8u32 {
                    let way = glam::IVec3::new(octant as i32 & 1, octant as i32 >> 1 & 1, octant as i32 >> 2) * 2 - 1;
                    // A cell from which this one can be reached.
                    let from = cell - way;
                    let inside = from.cmpge(glam::IVec3::ZERO).all() && from.as_uvec3().cmplt(reach.dims).all();
                    let crosses = |cell: glam::IVec3, cells: u32| {
                        reach.fetch(cell.as_uvec3()) >> (OCTANT_BITS * octant) & 15 >= cells
                    };
                    if crosses(cell, 1) || inside && crosses(from, 2) {
                        let corners = [0.02f32, 0.5, 0.98].map(|f| field.sample(voxel.as_vec3() + f));
                        assert!(corners.iter().all(|c: &Vec4| c.w == 0.0), "{name}: extinction near {voxel}");
                    }
                }
            }
        }
    });
}
