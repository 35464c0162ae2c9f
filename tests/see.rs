//! Which cells the eye sees: against the CPU twin, and by hand.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{CHUNK, Setup, cases, scene_of, scenes, texture};
use common::gpu_test;
use std::collections::BTreeSet;
use tyndall::cpu::compact::compact;
use tyndall::cpu::see::see;
use tyndall::passes::compact::{List, Listed};
use tyndall::passes::see::{See, rays};
use tyndall::vk::{Context, Recorder};
use tyndall::volume::Grid;

/// Cells that are seen, hidden, and out of reach, each a list that the device made.
fn lists(ctx: &Context, setup: &Setup) -> [BTreeSet<u32>; 3] {
    let pass = See::new(ctx).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    let height = setup.data.params.size[1] * rays(&setup.data.params).per_pixel;
    // In two bands.
    for rows in [0..height / 2, height / 2..height] {
        pass.record(&mut rec, &setup.data, &setup.field, &setup.emptiness.image, &setup.marks, rows);
    }
    let mut lists = [Listed::SeenCells, Listed::HiddenCells, Listed::RemoteCells]
        .map(|listed| List::new(ctx, setup.data.light_blocks(), listed, CHUNK, None).unwrap());
    for list in &lists {
        list.record(&mut rec, &setup.data, &setup.marks);
    }
    rec.submit_and_wait().unwrap();
    for list in &mut lists {
        list.read_counts(ctx).unwrap();
    }
    lists.map(|list| list.read_back(ctx).unwrap().into_iter().collect())
}

/// A ray may meet a cell's face within rounding, or lose sight of what is behind: few cells may differ. The lists together are
/// all cells, each once, whatever is seen.
#[test]
fn cells_agree_with_the_twin() {
    gpu_test(|ctx| {
        let mut at_all = [0; 3];
        let variants = [(1, 1.0), (3, 1.0), (1, 1000.0), (3, 1000.0)];
        let all = scenes().into_iter().flat_map(|s| variants.map(|variant| (variant, s.clone()))).collect();
        for ((edge, density), (name, mut scene)) in cases::<((u32, f64), _)>(all) {
            (scene.settings.light_grid, scene.density_scale) = (edge, density);
            let setup = Setup::new(ctx, &scene);
            let (params, field) = (&setup.host.params, texture(ctx, &setup.field));
            let blocks = setup.data.light_blocks();
            let count = blocks.cells().iter().product();
            let list = |listed| -> BTreeSet<u32> {
                compact(params, blocks, &field, &see(params, &field), listed, 0, count).into_iter().collect()
            };
            let lists = lists(ctx, &setup);
            let mut together: Vec<u32> = lists.iter().flatten().copied().collect();
            together.sort_unstable();
            assert_eq!(together, list(Listed::Cells).into_iter().collect::<Vec<_>>(), "{name}");
            let kinds = [Listed::SeenCells, Listed::HiddenCells, Listed::RemoteCells];
            for ((kind, cells), at_all) in kinds.into_iter().zip(&lists).zip(&mut at_all) {
                let expected = list(kind);
                let different = (cells ^ &expected).len();
                let case = format!("{name}, {kind:?}");
                assert!(different * 100 <= expected.len(), "{case}: {different} cells differ of {}", expected.len());
                *at_all += cells.len();
            }
        }
        assert!(at_all.iter().all(|&n| n > 100), "too few: {at_all:?}");
    });
}

/// By hand: of an opaque block the eye, straight before its face y = 0, sees only the cells at that face, all of them where
/// it looks straight on, and reaches no farther, so that what is beyond the next block of cells is out of reach; of a thin one
/// it sees every cell but those that rays miss at the faces along its sight.
#[test]
fn the_eye_sees_the_face_of_an_opaque_block_and_all_of_a_thin_one() {
    gpu_test(|ctx| {
        let layers = |density: f64| -> [Vec<usize>; 2] {
            let grid = Grid::axis_aligned([12, 10, 11], [1.0; 3], [0.0; 3]);
            let mut scene = scene_of(grid, vec![0.9; 12 * 10 * 11]);
            let framing =
                tyndall::scene::camera::Framing { azimuth: 0.0, elevation: 0.0, roll: 0.0, zoom: 1.0, fov: 10.0 };
            scene.settings.size = [64, 64];
            scene.camera = tyndall::scene::camera::frame(&scene.volume.grid, &framing, scene.settings.size);
            scene.density_scale = density;
            let [seen, _, remote] = lists(ctx, &Setup::new(ctx, &scene));
            let inner = |i: u32, n: u32| i > 0 && i < n;
            [seen, remote].map(|cells| {
                let mut counts = vec![0; 11];
                for cell in cells {
                    let (x, y, z) = (cell % 13, cell / 13 % 11, cell / 13 / 11);
                    counts[y as usize] += usize::from(inner(x, 12) && inner(z, 11));
                }
                counts
            })
        };
        let [opaque, remote] = layers(1000.0);
        assert_eq!(opaque[0], 11 * 10, "{opaque:?}");
        assert_eq!(opaque[2..].iter().sum::<usize>(), 0, "{opaque:?}");
        assert_eq!(remote[..4].iter().sum::<usize>(), 0, "{remote:?}");
        assert!(remote[4..].iter().all(|&n| n == 11 * 10), "{remote:?}");
        let [thin, remote] = layers(0.01);
        assert!(thin.iter().all(|&n| n == 11 * 10), "{thin:?}");
        assert_eq!(remote.iter().sum::<usize>(), 0, "{remote:?}");
    });
}
