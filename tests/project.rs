//! The projection against its CPU twin, and what it promises: it meets what is trilinear, and keeps the scattered light.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{CHUNK, Setup, assert_close, cases, image, random_values, scene_of, scenes, texture};
use common::gpu_test;
use glam::{Vec3, Vec4};
use tyndall::abi::ScatterSample;
use tyndall::cpu;
use tyndall::cpu::project::{Cell, Sums};
use tyndall::cpu::texture::Texture;
use tyndall::passes::compact::{List, Listed};
use tyndall::passes::project::{Kept, Projection, Source, step_factors};
use tyndall::scene::LightFor;
use tyndall::vk::{Access, Context, Recorder};
use tyndall::volume::Grid;

/// Half floats cut to 11 bits after every step.
const ROUNDING: f32 = 3e-3;
/// In units of the largest value. Early steps overshoot, and what they round off is not all taken back.
const SMALL: f32 = 5e-3;

/// Uploads sums as the deposit would have left them, and solves. Source, and what the eye sees.
fn solve(ctx: &Context, setup: &Setup, sums: &Texture<Vec4>, steps: u32, is_seen: bool) -> [Texture<Vec4>; 2] {
    solve_beside(ctx, setup, sums, steps, None, is_seen)
}

/// [`solve`], with light that enters the source beside what is solved for.
fn solve_beside(
    ctx: &Context,
    setup: &Setup,
    sums: &Texture<Vec4>,
    steps: u32,
    fixed: Option<&Texture<Vec4>>,
    is_seen: bool,
) -> [Texture<Vec4>; 2] {
    let dims = setup.host.params.dims;
    let (nodes, _) = setup.list(ctx, Listed::Nodes);
    let projection = Projection::new(ctx, &setup.data, CHUNK, steps, true, LightFor::View).unwrap();
    let source = Source::new(ctx, &setup.data, "source", false).unwrap();
    let small = source.b.clone();
    let field = texture(ctx, &setup.field);
    let seen = field.texels.iter().map(|f| Vec4::new(1.0, 2.0, 3.0, f.w)).collect();
    let fixed = fixed.map(|texels| Source { a: image(ctx, "fixed", texels), ..source.clone() });
    let total = Source { a: image(ctx, "total", &Texture::new(dims, seen)), b: small };
    let mut rec = Recorder::new(ctx).unwrap();
    source.clear(&mut rec);
    projection.record_clear_all(&mut rec);
    rec.submit_and_wait().unwrap();
    let layer = (sums.dims.x * sums.dims.y) as usize;
    let layers = |z: std::ops::Range<u32>| sums.texels[z.start as usize * layer..z.end as usize * layer].to_vec();
    ctx.upload_image(&projection.sums()[0], layers).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    let args = nodes.chunk_args(ctx, &mut rec, 1).unwrap();
    projection.record_solve(&mut rec, &setup.data, &nodes, &args, &source, fixed.as_ref(), &total, is_seen);
    rec.submit_and_wait().unwrap();
    [texture(ctx, &source.a), texture(ctx, &total.a)]
}

/// Samples of every cell at all its points: σ times `light` of the position, in grey.
fn samples_of(
    setup: &Setup,
    field: &Texture<Vec4>,
    cells: &[u32],
    light: impl Fn(Vec3) -> f32,
) -> Vec<Vec<ScatterSample>> {
    let params = &setup.host.params;
    let of_cell = |&index: &u32| {
        let cell = Cell::from_linear(params, index);
        let of_point = |point| {
            let sigma = field.sample(cell.position(point)).w;
            let light = Vec3::splat(sigma * light(cell.position(point)) / 8.0);
            ScatterSample { light: light.into(), travel: [0.0, 0.0, 1.0], point }
        };
        (0..8).map(of_point).collect()
    };
    cells.iter().map(of_cell).collect()
}

/// Right-hand side of such samples.
fn sums_of(ctx: &Context, setup: &Setup, light: impl Fn(Vec3) -> f32) -> Texture<Vec4> {
    let params = &setup.host.params;
    let (_, cells) = setup.list(ctx, Listed::Cells);
    let mut sums = Sums::zero(params.light_dims);
    let samples = samples_of(setup, &texture(ctx, &setup.field), &cells, light);
    cpu::project::project_deposit(params, &cells, &samples, false, &mut sums);
    sums.a
}

#[test]
fn steps_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (name, scene) in scenes() {
            let setup = Setup::new(ctx, &scene);
            let params = &setup.host.params;
            let field = texture(ctx, &setup.field);
            let sums = sums_of(ctx, &setup, |p| 100.0 + 50.0 * (3.0 * p.x + p.y).sin());
            for steps in cases(vec![6, 1]) {
                let [source, total] = solve(ctx, &setup, &sums, steps, true);
                let expected = cpu::project::project_solve(params, &field, &sums, &step_factors(steps));
                // Voxels that no cell with extinction touches keep what they had: nothing.
                let case = format!("{name}, {steps} steps");
                assert_close(&case, &source.texels, &expected.texels, ROUNDING, SMALL);
                let seen: Vec<Vec4> =
                    expected.texels.iter().map(|e| Vec4::new(e.x + 1.0, e.y + 2.0, e.z + 3.0, e.w)).collect();
                assert_close(&case, &total.texels, &seen, ROUNDING, SMALL);
            }
            // Light beside it enters the source, and is not seen.
            let beside = bodies::random_light(params.dims, 9, 0.0, 200.0);
            let [joined, total] = solve_beside(ctx, &setup, &sums, 2, Some(&beside), true);
            let [alone, seen] = solve(ctx, &setup, &sums, 2, true);
            let (_, nodes) = setup.list(ctx, Listed::Nodes);
            let mut expected = alone.texels;
            for i in nodes {
                expected[i as usize] += beside.texels[i as usize].truncate().extend(0.0);
            }
            assert_close(&format!("{name}, with light beside it"), &joined.texels, &expected, ROUNDING, SMALL);
            assert_eq!(total, seen, "{name}: light beside it is seen");
            let [_, total] = solve(ctx, &setup, &sums, 2, false);
            assert!(
                total.texels.iter().all(|t| t.truncate() == Vec3::new(1.0, 2.0, 3.0)),
                "{name}: seen against orders"
            );
        }
    });
}

/// The same with larger blocks, whose values are spread to the voxels.
#[test]
fn blocks_agree_with_the_twins() {
    gpu_test(|ctx| {
        let all = scenes().into_iter().flat_map(|s| [2, 3, 4].map(|edge| (edge, s.clone()))).collect();
        for (edge, (name, mut scene)) in cases::<(u32, _)>(all) {
            scene.settings.light_grid = edge;
            let setup = Setup::new(ctx, &scene);
            let params = &setup.host.params;
            let field = texture(ctx, &setup.field);
            let sums = sums_of(ctx, &setup, |p| 100.0 + 50.0 * (0.7 * p.x + 0.3 * p.y).sin());
            let beside = bodies::random_light(params.dims, 9, 0.0, 200.0);
            for fixed in [None, Some(&beside)] {
                let [source, total] = solve_beside(ctx, &setup, &sums, 4, fixed, true);
                let nodes = cpu::project::project_solve(params, &field, &sums, &step_factors(4));
                let expected = cpu::spread::spread(params, &nodes, &field);
                let case = format!("{name}, blocks of {edge}, light beside: {}", fixed.is_some());
                let joined: Vec<Vec4> = match fixed {
                    None => expected.texels.clone(),
                    Some(fixed) => {
                        let add = |(e, f): (&Vec4, &Vec4)| *e + f.truncate().extend(0.0);
                        expected.texels.iter().zip(&fixed.texels).map(add).collect()
                    }
                };
                assert_close(&case, &source.texels, &joined, ROUNDING, SMALL);
                let seen: Vec<Vec4> =
                    expected.texels.iter().map(|e| Vec4::new(e.x + 1.0, e.y + 2.0, e.z + 3.0, e.w)).collect();
                assert_close(&case, &total.texels, &seen, ROUNDING, SMALL);
            }
        }
    });
}

/// A constant is met by the first guess already, whatever the points and the extinctions are.
#[test]
fn a_constant_is_met_exactly() {
    gpu_test(|ctx| {
        let all = scenes().into_iter().flat_map(|s| [1, 2, 3, 4].map(|edge| (edge, s.clone()))).collect();
        for (edge, (name, mut scene)) in cases::<(u32, _)>(all) {
            let (_, voxels) = Setup::new(ctx, &scene).list(ctx, Listed::Nodes);
            scene.settings.light_grid = edge;
            let setup = Setup::new(ctx, &scene);
            let [source, _] = solve(ctx, &setup, &sums_of(ctx, &setup, |_| 100.0), 3, false);
            // Islands of single voxels may lie between all points of larger blocks, and then stay dark.
            let mut missed = 0;
            for &index in &voxels {
                let got = source.texels[index as usize].x;
                missed += usize::from(got == 0.0 && edge > 1);
                assert!(
                    (got - 100.0).abs() < 0.3 || got == 0.0 && edge > 1,
                    "{name}, blocks of {edge}: {got} at {index}"
                );
            }
            let most = if name == "islands" { voxels.len() / 10 } else { 0 };
            assert!(missed <= most, "{name}, blocks of {edge}: {missed} of {} voxels are dark", voxels.len());
        }
    });
}

/// The twin, taken to its end: functions that are trilinear between the voxels come back, though neither their values at
/// the voxels nor their means around them were ever seen.
#[test]
fn what_is_trilinear_comes_back() {
    gpu_test(|ctx| {
        let (name, scene) = scenes().swap_remove(0);
        let setup = Setup::new(ctx, &scene);
        let params = &setup.host.params;
        let field = texture(ctx, &setup.field);
        let values = random_values(8, field.texels.len());
        let wanted = Texture::new(params.dims, values.iter().map(|&v| Vec4::splat(v)).collect());
        let sums = sums_of(ctx, &setup, |p| wanted.sample(p).x);
        let error = |steps: u32| {
            let u = cpu::project::project_solve(params, &field, &sums, &step_factors(steps));
            let (_, nodes) = setup.list(ctx, Listed::Nodes);
            let square =
                |i: &u32| (u.texels[*i as usize].x - values[*i as usize]).powi(2) * field.texels[*i as usize].w;
            nodes.iter().map(square).sum::<f32>().sqrt()
        };
        let (few, some, many) = (error(1), error(6), error(64));
        assert!(some < 0.5 * few && many < 0.1 * few, "{name}: {few} {some} {many}");
    });
}

/// σ_s L dx over the volume is that of the samples, however few the steps: light is moved, not lost. M has the columns'
/// sums as its rows' sums.
#[test]
fn scattered_light_is_kept() {
    gpu_test(|ctx| {
        let (_, scene) = scenes().swap_remove(0);
        let setup = Setup::new(ctx, &scene);
        let params = &setup.host.params;
        let field = texture(ctx, &setup.field);
        let sums = sums_of(ctx, &setup, |p| (-0.9 * p.x).exp());
        let ones = sums_of(ctx, &setup, |_| 1.0);
        let all: f32 = sums.texels.iter().map(|s| s.x).sum();
        let first = cpu::project::project_solve(params, &field, &sums, &[]);
        let kept: f32 = first.texels.iter().zip(&ones.texels).map(|(u, row)| u.x * row.x).sum();
        assert!((kept - all).abs() < 1e-4 * all, "{kept} of {all}");
        let solved = cpu::project::project_solve(params, &field, &sums, &step_factors(64));
        let kept: f32 = solved.texels.iter().zip(&ones.texels).map(|(u, row)| u.x * row.x).sum();
        assert!((kept - all).abs() < 1e-3 * all, "{kept} of {all}");
    });
}

/// The deposit of samples that the twin made up, with directions, in anisotropic and isotropic media.
#[test]
fn deposits_are_those_of_the_twin() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([6, 5, 4], [1.0, 2.0, 0.5], [0.0; 3]);
        let mut scene = scene_of(grid, random_values(3, 120));
        let all = vec![
            (0.7, Kept::MomentsAndEye, LightFor::View, 1),
            (0.7, Kept::Eye, LightFor::View, 1),
            (0.7, Kept::Mean, LightFor::View, 1),
            (0.7, Kept::Moments, LightFor::EveryView, 1),
            (0.0, Kept::Mean, LightFor::View, 1),
            (0.7, Kept::MomentsAndEye, LightFor::View, 3),
        ];
        for (g, kept, light_for, edge) in cases(all) {
            scene.g = g;
            scene.settings.light_grid = edge;
            let setup = Setup::new(ctx, &scene);
            let params = &setup.host.params;
            let (list, cells): (List, _) = setup.list(ctx, Listed::Cells);
            let field = texture(ctx, &setup.field);
            let mut samples = samples_of(&setup, &field, &cells, |p| 1.0 + p.x);
            for (i, sample) in samples.iter_mut().flatten().enumerate() {
                sample.travel = Vec3::new((i % 7) as f32 - 3.0, (i % 3) as f32 - 1.0, 0.5).normalize().into();
            }
            let projection = Projection::new(ctx, &setup.data, CHUNK, 1, true, light_for).unwrap();
            let mut buffer = vec![ScatterSample { light: [0.0; 3], travel: [0.0; 3], point: 0 }; 8 * CHUNK as usize];
            for (item, samples) in samples.iter().enumerate() {
                for (slot, sample) in samples.iter().enumerate() {
                    buffer[slot * CHUNK as usize + item] = *sample;
                }
            }
            let staged = ctx.upload("samples", &buffer).unwrap();
            let mut rec = Recorder::new(ctx).unwrap();
            projection.record_clear_all(&mut rec);
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
            rec.copy(&staged, 0, projection.samples(), 0, buffer.len());
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
            let args = list.chunk_args(ctx, &mut rec, 1).unwrap();
            for chunk in list.chunks() {
                projection.record_deposit(&mut rec, &setup.data, &chunk, &args, 8, true, kept);
            }
            rec.submit_and_wait().unwrap();
            let mut expected = Sums::zero(params.light_dims);
            cpu::project::project_deposit(params, &cells, &samples, true, &mut expected);
            let [x, y, z] = &expected.b;
            let moments = matches!(kept, Kept::Moments | Kept::MomentsAndEye);
            let used = [
                ("A", &expected.a, kept != Kept::Eye),
                ("Bx", x, moments),
                ("By", y, moments),
                ("Bz", z, moments),
                ("eye", &expected.eye, matches!(kept, Kept::Eye | Kept::MomentsAndEye)),
            ];
            for ((what, expected, is_used), image) in used.into_iter().zip(projection.sums()) {
                let got: Vec<Vec4> = ctx.read_back_image(image).unwrap();
                let case = format!("g {g}, {kept:?}, blocks of {edge}: {what}");
                if is_used {
                    assert_close(&case, &got, &expected.texels, 1e-4, 1e-5);
                } else {
                    assert!(got.iter().all(|t| *t == Vec4::ZERO), "{case} is not used");
                }
            }
        }
    });
}
