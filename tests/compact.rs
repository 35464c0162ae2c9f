//! Lists of voxels and cells against their CPU twin, whole and in segments.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{CHUNK, Setup, cases, random_light, scene_of, scenes, texture};
use common::gpu_test;
use data::assert_same;
use tyndall::cpu::compact::compact;
use tyndall::cpu::see::Sight;
use tyndall::passes::compact::{Blocks, List, Listed, Marks};
use tyndall::passes::lookback::Carry;
use tyndall::shaders::constants::MAX_LIGHT_EDGE;
use tyndall::vk::Recorder;
use tyndall::volume::Grid;

const ALL: [Listed; 3] = [Listed::Cells, Listed::Nodes, Listed::Voxels];

/// Indices that there are.
fn count(blocks: Blocks, listed: Listed) -> u32 {
    let counts = if matches!(listed, Listed::Voxels | Listed::Nodes) { blocks.dims } else { blocks.cells() };
    counts.iter().product()
}

#[test]
fn lists_agree_with_the_twin() {
    gpu_test(|ctx| {
        // Without see.comp nothing is seen, and all is out of reach.
        let all = [&ALL[..], &[Listed::SeenCells, Listed::HiddenCells, Listed::RemoteCells]].concat();
        for (name, mut scene) in scenes() {
            let mut active = Vec::new();
            for edge in 1..=MAX_LIGHT_EDGE {
                scene.settings.light_grid = edge;
                let setup = Setup::new(ctx, &scene);
                let (params, field, blocks) =
                    (&setup.host.params, texture(ctx, &setup.field), setup.data.light_blocks());
                let nothing = vec![Sight::default(); count(blocks, Listed::Cells) as usize];
                for &listed in &cases(all.clone()) {
                    let expected = compact(params, blocks, &field, &nothing, listed, 0, count(blocks, listed));
                    let case = format!("{name}, blocks of {edge}, {listed:?}");
                    assert_same(&case, &setup.list(ctx, listed).1, &expected);
                }
                // Voxels, whatever the blocks.
                active.push(setup.marks.active_voxels(ctx).unwrap());
                let is_active = |f: &&glam::Vec4| f.w > 0.0;
                assert_eq!(active[0], field.texels.iter().filter(is_active).count() as u64, "{name}");
            }
            assert!(active.iter().all(|&n| n == active[0]), "{name}: {active:?}");
        }
    });
}

/// By hand: one voxel in the middle, one in a corner of the volume.
#[test]
fn one_voxel_has_eight_cells_and_twenty_seven_nodes() {
    gpu_test(|ctx| {
        let listed = |at: usize| {
            let mut values = vec![0.0; 5 * 4 * 3];
            values[at] = 0.9;
            let grid = Grid::axis_aligned([5, 4, 3], [1.0; 3], [0.0; 3]);
            let setup = Setup::new(ctx, &scene_of(grid, values));
            ALL.map(|listed| setup.list(ctx, listed).1.len())
        };
        assert_eq!(listed(20 + 2 * 5 + 3), [8, 27, 1]);
        assert_eq!(listed(0), [8, 8, 1]);
    });
}

/// Segments list ranges of indices; together they are the whole list, whatever their length and the chunks'.
#[test]
fn segments_and_chunks_leave_nothing_out() {
    gpu_test(|ctx| {
        // Several tiles of the scan.
        let grid = Grid::axis_aligned([29, 23, 31], [1.0; 3], [0.0; 3]);
        let setup = Setup::new(ctx, &scene_of(grid, bodies::random_values(3, 29 * 23 * 31)));
        let (params, blocks) = (&setup.host.params, setup.data.light_blocks());
        let voxels = 29 * 23 * 31;
        for (listed, segment, chunk) in [
            (Listed::Voxels, None, CHUNK),
            (Listed::Voxels, None, 777),
            (Listed::Voxels, Some(voxels), 64),
            (Listed::Voxels, Some(9000), 1000),
            (Listed::Cells, Some(4096), 4096),
        ] {
            let expected = compact(params, blocks, &texture(ctx, &setup.field), &[], listed, 0, count(blocks, listed));
            assert!(expected.len() > 10_000);
            for carry in [Carry::LookBack, Carry::Dispatches] {
                let mut list = List::with_carry(ctx, blocks, listed, chunk, segment, carry).unwrap();
                let mut rec = Recorder::new(ctx).unwrap();
                list.record(&mut rec, &setup.data, &setup.marks);
                rec.submit_and_wait().unwrap();
                assert_eq!(list.read_counts(ctx).unwrap(), expected.len() as u64);
                assert_eq!(list.items(), expected.len() as u64);
                let case = format!("{listed:?}, segments of {segment:?}, chunks of {chunk}, {carry:?}");
                assert_same(&case, &list.read_back(ctx).unwrap(), &expected);
                // The chunks cover every segment's count.
                let covered: u64 = list.chunks().map(|c| u64::from(c.items)).sum();
                assert!(covered >= expected.len() as u64, "{case}: {covered}");
            }
        }
    });
}

/// Extinction alone decides, down to the smallest half float.
#[test]
fn light_without_extinction_is_not_listed() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([5, 4, 3], [1.0; 3], [0.0; 3]);
        let setup = Setup::new(ctx, &scene_of(grid, vec![0.9; 60]));
        let mut light = random_light([5, 4, 3], 8, 1.0, 2.0);
        for (i, texel) in light.texels.iter_mut().enumerate() {
            texel.w = [0.0, 5.96e-8, 1.0][i % 3];
        }
        let blocks = setup.data.light_blocks();
        let marks = Marks::new(ctx, blocks).unwrap();
        let mut list = List::new(ctx, blocks, Listed::Voxels, CHUNK, None).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        marks.record(&mut rec, &setup.data, &bodies::image(ctx, "light", &light), &setup.emptiness);
        list.record(&mut rec, &setup.data, &marks);
        rec.submit_and_wait().unwrap();
        list.read_counts(ctx).unwrap();
        let expected: Vec<u32> = (0..60).filter(|i| i % 3 != 0).collect();
        assert_same("light", &list.read_back(ctx).unwrap(), &expected);
    });
}
