//! The list of active voxels against its CPU twin, whole and in segments.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{CHUNK, Setup, random_light, scene_of, scenes, texture};
use common::gpu_test;
use data::assert_same;
use tyndall::cpu::compact::compact;
use tyndall::passes::compact::ActiveList;
use tyndall::vk::Recorder;
use tyndall::volume::Grid;

#[test]
fn lists_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            let setup = Setup::new(ctx, &scene);
            let field = texture(ctx, &setup.field);
            let expected = compact(&setup.host.params, &field, 0, field.texels.len() as u32);
            assert_same(name, &setup.active, &expected);
        }
    });
}

/// Segments list ranges of voxels; together they are the whole list, whatever their length and the chunks'.
#[test]
fn segments_and_chunks_leave_nothing_out() {
    gpu_test(|ctx| {
        // Several tiles of the scan.
        let grid = Grid::axis_aligned([29, 23, 31], [1.0; 3], [0.0; 3]);
        let setup = Setup::new(ctx, &scene_of(grid, bodies::random_values(3, 29 * 23 * 31)));
        let voxels = 29 * 23 * 31;
        let expected = compact(&setup.host.params, &texture(ctx, &setup.field), 0, voxels);
        assert!(expected.len() > 10_000);
        for (segment, chunk) in [(None, CHUNK), (None, 777), (Some(voxels), 64), (Some(9000), 1000), (Some(4096), 4096)]
        {
            let mut list = ActiveList::new(ctx, &setup.data, chunk, segment).unwrap();
            let mut rec = Recorder::new(ctx).unwrap();
            list.record(&mut rec, &setup.data, &setup.field);
            rec.submit_and_wait().unwrap();
            assert_eq!(list.read_counts(ctx).unwrap(), expected.len() as u64);
            let case = format!("segments of {segment:?}, chunks of {chunk}");
            assert_same(&case, &list.read_back(ctx).unwrap(), &expected);
            // The chunks cover every segment's count.
            let covered: u64 = list.chunks().map(|c| u64::from(c.items)).sum();
            assert!(covered >= expected.len() as u64, "{case}: {covered}");
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
        let mut list = ActiveList::new(ctx, &setup.data, CHUNK, None).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        list.record(&mut rec, &setup.data, &bodies::image(ctx, "light", &light));
        rec.submit_and_wait().unwrap();
        list.read_counts(ctx).unwrap();
        let expected: Vec<u32> = (0..60).filter(|i| i % 3 != 0).collect();
        assert_same("light", &list.read_back(ctx).unwrap(), &expected);
    });
}
