//! The gather against its CPU twins: energies of candidates in the proxy, choice of directions, traced light.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{
    CHUNK, Setup, assert_close, assert_same_samples, cases, gathered_sky, proxy_light, random_source, random_values,
    scene_of, scenes, texture,
};
use common::gpu_test;
use glam::{Vec2, Vec3, Vec4};
use tyndall::abi::ScatterSample;
use tyndall::cpu;
use tyndall::cpu::gather::{Carried, Choice, Lattice};
use tyndall::cpu::project::Sums;
use tyndall::cpu::texture::Texture;
use tyndall::passes::compact::Listed;
use tyndall::passes::gather::{Gather, GatherConfig, Gathered as What};
use tyndall::passes::points::{aimed_weights_of, points_of, weights_of};
use tyndall::passes::project::{Kept, Projection, Scattering};
use tyndall::passes::proxy::{Proxy, ProxyConfig};
use tyndall::scene::{Environment, LightFor, Mask, Sampling, Scene};
use tyndall::vk::{Access, Buffer, Context, Image, Recorder};
use tyndall::volume::Grid;

/// Both read half floats and compute in single precision.
const ROUNDING: f32 = 1e-3;
/// In units of the largest value: sums that cancel, and rays that are cut one step earlier or later at 1e-3.
const CANCELLED: f32 = 1e-3;

const ORDER: u32 = 3;

const CONFIG: GatherConfig = GatherConfig {
    sampling: Sampling::Resample,
    candidates: 12,
    directions: 5,
    defence: 0.2,
    step: 0.8,
    proxy_step: 1.7,
};

/// A gather on the device, with all it read and wrote.
struct Ran {
    setup: Setup,
    cells: Vec<u32>,
    /// A, then B by component.
    source: [Texture<Vec4>; 4],
    /// Of the last block of samples, by cell of the list.
    samples: Vec<Vec<ScatterSample>>,
    sums: [Texture<Vec4>; 5],
    /// By cell of the list.
    weights: Vec<Vec<f32>>,
    chosen: Vec<Vec<Choice>>,
    /// What the proxy says of every voxel.
    light: Texture<Vec2>,
    /// Directions were drawn for the eye.
    for_eye: bool,
}

/// `[row][item]` in chunks to `[item][row]`.
fn transposed<T: Copy>(rows: &[T], items: usize) -> Vec<Vec<T>> {
    (0..items).map(|item| rows.iter().copied().skip(item).step_by(CHUNK as usize).collect()).collect()
}

fn gather(ctx: &Context, scene: &Scene, config: GatherConfig, what: What, light: u32, is_last: bool) -> Ran {
    let setup = Setup::new(ctx, scene);
    let dims = setup.host.params.dims;
    let source = random_source(ctx, &setup);

    let proxy_config = ProxyConfig::of(Mask::Channels([0xF0; 4]));
    let proxy = config.sampling.uses_proxy().then(|| Proxy::new(ctx, &setup.data, proxy_config).unwrap());
    let pass = Gather::new(ctx, &setup.data, config, CHUNK, what).unwrap();
    let projection = Projection::new(ctx, &setup.data, CHUNK, 1, true, LightFor::View).unwrap();
    let (list, cells) = setup.list(ctx, Listed::Cells);
    let voxels = setup.voxels(ctx);
    let mut rec = Recorder::new(ctx).unwrap();
    projection.record_clear_all(&mut rec);
    rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
    let [cell_args, voxel_args] = [&list, &voxels].map(|list| list.chunk_args(ctx, &mut rec, 1).unwrap());
    let args = pass.args(ctx, &mut rec, &list, 1.0).unwrap();
    if let Some(proxy) = &proxy {
        proxy.record_clear(&mut rec);
        proxy.record(&mut rec, &setup.data, &voxels, &voxel_args, &source.a, ORDER);
    }
    let scattering = Scattering {
        scene: &setup.data,
        emptiness: &setup.emptiness.image,
        field: &setup.field,
        projection: &projection,
        args: &cell_args,
        kept: projection.kept(!is_last),
    };
    for chunk in list.chunks() {
        pass.record(&mut rec, &scattering, &chunk, &args, proxy.as_ref(), &source, ORDER, light, true);
    }
    rec.submit_and_wait().unwrap();

    let items = cells.len();
    let choice = |c: &[u32; 2]| Choice { candidate: c[0], weight: f32::from_bits(c[1]), less: 0.0 };
    let for_eye = what == What::Projected && projection.kept(!is_last) == Kept::Eye;
    let dealt = if for_eye { aimed_weights_of(config.directions) } else { weights_of(&points_of(config.directions)) };
    let all = |less: &dyn Fn(u32) -> f32| {
        let weight = |candidate: u32| dealt[candidate as usize] / config.directions as f32;
        let choice = |candidate| Choice { candidate, weight: weight(candidate), less: less(candidate) };
        (0..config.directions).map(choice).collect()
    };
    let read = |buffer: &Buffer<[u32; 2]>| transposed(&ctx.read_back(buffer).unwrap(), items);
    let (weights, chosen, light) = match &proxy {
        None => (vec![], vec![all(&|_| 0.0); items], Texture::filled(dims, Vec2::ZERO)),
        Some(proxy) => {
            let weights = transposed(&ctx.read_back(pass.weights()).unwrap(), items);
            let chosen = if config.sampling.is_choice() {
                let of_cell = |slots: &Vec<_>| slots.iter().map(choice).filter(|c| c.weight > 0.0).collect();
                read(pass.chosen()).iter().map(of_cell).collect()
            } else {
                weights.iter().map(|w| all(&|direction| w[direction as usize])).collect()
            };
            (weights, chosen, proxy_light(ctx, proxy, dims))
        }
    };
    let is_used = |s: &&ScatterSample| s.light != [0.0; 3];
    let samples = transposed(&ctx.read_back(projection.samples()).unwrap(), items);
    let nodes = setup.host.params.light_dims;
    let small = |i: &Image| i.extent() != nodes;
    Ran {
        source: [&source.a, &source.b[0], &source.b[1], &source.b[2]].map(|i| texture(ctx, i)),
        samples: samples
            .iter()
            .map(|s| s.iter().take(config.directions as usize).filter(is_used).copied().collect())
            .collect(),
        sums: std::array::from_fn(|i| {
            let image = &projection.sums()[i];
            if small(image) {
                return Texture::filled(nodes, Vec4::ZERO);
            }
            Texture::new(nodes, ctx.read_back_image(image).unwrap())
        }),
        weights,
        chosen,
        light,
        cells,
        setup,
        for_eye,
    }
}

/// An environment that the gather itself brings.
fn constant_sky() -> Option<Environment> {
    Some(Environment::Constant(Vec3::new(2.0, 1.0, 3.0)))
}

/// Traces the same choices in the twin.
fn check_trace(name: &str, g: Ran, config: GatherConfig, what: What, light: u32) {
    let lattice = if config.sampling.is_choice() { config.candidates } else { config.directions };
    let host = &g.setup.host;
    let carried = match what {
        What::Projected => Carried::Projected(&g.source, gathered_sky(&g.setup)),
        What::Emitted => Carried::Emitted(&g.source[0]),
        What::Light => Carried::Light(&g.source[0], &host.lights[light as usize]),
    };
    let GatherConfig { directions, step, .. } = config;
    let expected =
        cpu::gather::gather_trace(host, &g.cells, carried, &g.chosen, ORDER, lattice, directions, step, g.for_eye);
    let case = format!("{name}, {:?}, g {}, {what:?} {light}", config.sampling, host.params.g);
    let mut sums = Sums::zero(host.params.light_dims);
    if config.sampling == Sampling::Residual {
        let energies: Vec<_> = g.weights.iter().map(|w| w[config.directions as usize..].to_vec()).collect();
        let base = cpu::gather::gather_base(host, &g.cells, &energies, ORDER, g.for_eye);
        cpu::project::project_deposit(&host.params, &g.cells, &base, true, &mut sums);
    }
    cpu::project::project_deposit(&host.params, &g.cells, &expected, true, &mut sums);
    let same = |what: &str, got: &Texture<Vec4>, expected: &Texture<Vec4>| {
        assert_close(&format!("{case}: {what}"), &got.texels, &expected.texels, ROUNDING, CANCELLED);
    };
    if !g.for_eye {
        same("A", &g.sums[0], &sums.a);
    }
    if host.params.g != 0.0 && !g.for_eye {
        for axis in 0..3 {
            same(["Bx", "By", "Bz"][axis], &g.sums[axis + 1], &sums.b[axis]);
        }
    }
    if host.params.g != 0.0 {
        same("eye", &g.sums[4], &sums.eye);
    }
    if g.chosen.iter().all(|c| c.len() <= 16) {
        // All samples are of one block.
        let is_used = |s: &&ScatterSample| s.light != [0.0; 3];
        let expected: Vec<Vec<_>> = expected.iter().map(|s| s.iter().filter(is_used).copied().collect()).collect();
        assert_same_samples(&case, &g.samples, &expected, ROUNDING, CANCELLED, 0);
    }
}

/// The energies of all candidates. Nearest reads: a sample on a voxel's face may fall into either, and a ray may be cut
/// at 1e-2 one step earlier or later.
fn check_proxy(name: &str, g: &Ran, config: GatherConfig) {
    let (params, cells) = (&g.setup.host.params, &g.cells);
    let (candidates, step) = (config.candidates, config.proxy_step);
    let lattices = match config.sampling {
        Sampling::Residual => vec![(Lattice::Traced, config.directions), (Lattice::Base, candidates)],
        _ => vec![(Lattice::Traced, candidates)],
    };
    let sky = gathered_sky(&g.setup);
    let expected = cpu::gather::gather_proxy(params, cells, &g.light, sky, ORDER, &lattices, step, g.for_eye).concat();
    let got = g.weights.concat();
    assert_eq!(got.len(), expected.len(), "{name}");
    let most = expected.iter().copied().fold(0.0, f32::max);
    let is_right = |i: usize| (got[i] - expected[i]).abs() <= 1e-3 * expected[i] + 1e-5 * most;
    let wrong: Vec<usize> = (0..got.len()).filter(|&i| !is_right(i)).collect();
    assert!(
        wrong.len() * 100 <= got.len(),
        "{name}: {} of {} energies differ; the first: {} instead of {}, most {most}",
        wrong.len(),
        got.len(),
        got[wrong[0]],
        expected[wrong[0]],
    );
    assert!(cells.len() < 3 || most > 0.0, "{name}: no light in the proxy");
}

/// The choice, from the device's own energies.
fn check_select(name: &str, g: &Ran, config: GatherConfig) {
    let params = &g.setup.host.params;
    let mut differ = 0;
    for ((&index, weights), got) in g.cells.iter().zip(&g.weights).zip(&g.chosen) {
        let expected = if config.sampling == Sampling::Top {
            cpu::gather::select_top(weights, config.directions)
        } else {
            let u = cpu::gather::select_shift(params, index, ORDER);
            cpu::gather::select_resample(weights, config.directions, config.defence, u)
        };
        let agree =
            |(a, b): (&Choice, &Choice)| a.candidate == b.candidate && (a.weight - b.weight).abs() <= 1e-5 * b.weight;
        differ += usize::from(got.len() != expected.len() || !got.iter().zip(&expected).all(agree));
    }
    // Single precision may count a hit for the next candidate, where a share ends at a whole number.
    let shares = g.chosen.len() * config.candidates as usize;
    let allowed = if config.sampling == Sampling::Top { 0 } else { shares / 10_000 };
    assert!(differ <= allowed, "{name}: {differ} of {} cells chose otherwise", g.chosen.len());
}

fn check(ctx: &Context, name: &str, scene: &Scene, config: GatherConfig) {
    // What the eye alone sees is gathered in other directions.
    for is_last in if scene.g == 0.0 { &[false][..] } else { &[false, true] } {
        check_one(ctx, &format!("{name}, last: {is_last}"), scene, config, *is_last);
    }
}

fn check_one(ctx: &Context, name: &str, scene: &Scene, config: GatherConfig, is_last: bool) {
    let gathered = gather(ctx, scene, config, What::Projected, 0, is_last);
    if config.sampling.uses_proxy() {
        check_proxy(name, &gathered, config);
    }
    if config.sampling.is_choice() {
        check_select(name, &gathered, config);
    }
    check_trace(name, gathered, config, What::Projected, 0);
}

#[test]
fn phase_sampling_agrees_with_the_twin() {
    gpu_test(|ctx| {
        let config = GatherConfig { sampling: Sampling::Phase, ..CONFIG };
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            for g in cases(vec![0.6, 0.0, -0.5]) {
                scene.g = g;
                if i % 2 == 0 {
                    scene.environment = constant_sky();
                }
                check(ctx, name, &scene, config);
            }
        }
    });
}

#[test]
fn resampling_agrees_with_the_twin() {
    gpu_test(|ctx| {
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            scene.g = [0.0, 0.6][i % 2];
            scene.environment = [constant_sky(), scene.environment][i / 2 % 2].clone();
            check(ctx, name, &scene, CONFIG);
        }
    });
}

#[test]
fn the_brightest_are_chosen_as_in_the_twin() {
    gpu_test(|ctx| {
        let config = GatherConfig { sampling: Sampling::Top, ..CONFIG };
        for (name, scene) in scenes().into_iter().step_by(2) {
            check(ctx, name, &scene, config);
        }
    });
}

/// Both levels: proxy energies of two sets of directions, their mean, and what traced rays say beyond them.
#[test]
fn both_levels_of_residual_agree_with_the_twin() {
    gpu_test(|ctx| {
        let config = GatherConfig { sampling: Sampling::Residual, ..CONFIG };
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            scene.g = [0.0, 0.6][i % 2];
            scene.environment = [constant_sky(), scene.environment][i / 2 % 2].clone();
            check(ctx, name, &scene, config);
        }
    });
}

/// Cells of larger blocks: their points scatter by the voxels around them.
#[test]
fn blocks_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (i, (name, mut scene)) in scenes().into_iter().enumerate() {
            scene.settings.light_grid = 2 + i as u32 % 3;
            for (g, sampling) in
                cases(vec![(0.0, Sampling::Phase), (0.6, Sampling::Residual), (0.0, Sampling::Residual)])
            {
                scene.g = g;
                let config = GatherConfig { sampling, ..CONFIG };
                check(ctx, &format!("{name}, blocks of {}", scene.settings.light_grid), &scene, config);
            }
        }
    });
}

/// Emitted light as classification stores it, where the source is not multiplied by the extinction.
#[test]
fn light_that_was_not_projected() {
    gpu_test(|ctx| {
        let config = GatherConfig { sampling: Sampling::Phase, ..CONFIG };
        for (name, scene) in scenes().into_iter().take(2) {
            check_trace(name, gather(ctx, &scene, config, What::Emitted, 0, false), config, What::Emitted, 0);
        }
    });
}

/// Order 1 of single lights, whose phase function is not stored: of a directional light, and of a point light.
#[test]
fn light_of_one_direction() {
    gpu_test(|ctx| {
        let config = GatherConfig { sampling: Sampling::Phase, ..CONFIG };
        for (name, mut scene) in scenes() {
            for (light, g) in cases(vec![(0, 0.6), (1, 0.6), (0, -0.9)]) {
                scene.g = g;
                check_trace(name, gather(ctx, &scene, config, What::Light, light, false), config, What::Light, light);
            }
        }
    });
}

/// One direction, M = N, one candidate, all chance (β = 1) and nearly none.
#[test]
fn ends_of_the_knobs() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([6, 5, 7], [1.0; 3], [0.0; 3]);
        let scene = scene_of(grid, random_values(6, 210));
        let knobs = vec![(9, 1, 0.2), (7, 7, 0.2), (1, 1, 0.5), (30, 8, 1.0), (30, 8, 1e-3)];
        for (candidates, directions, defence) in cases(knobs) {
            for sampling in cases(vec![Sampling::Resample, Sampling::Top, Sampling::Residual]) {
                let config = GatherConfig { sampling, candidates, directions, defence, ..CONFIG };
                check(ctx, &format!("N {directions} of M {candidates}, β {defence}"), &scene, config);
            }
        }
    });
}

/// More rays than one invocation may follow: candidates in blocks, traced directions in several dispatches.
#[test]
fn many_directions_are_split() {
    gpu_test(|ctx| {
        let grid = Grid::axis_aligned([5, 3, 4], [1.0; 3], [0.0; 3]);
        let scene = scene_of(grid, random_values(7, 60));
        // 716 iterations per ray: 40 rays per invocation.
        let config = GatherConfig { candidates: 100, directions: 90, step: 0.01, proxy_step: 0.01, ..CONFIG };
        assert!(tyndall::passes::rays_per_invocation([5, 3, 4], 0.01) < 45);
        for sampling in cases(vec![Sampling::Resample, Sampling::Residual]) {
            check(ctx, "blocks and dispatches", &scene, GatherConfig { sampling, ..config });
        }
    });
}

/// The rule behind `resample`: over all shifts its estimate is the mean over the candidates, whatever the energies say,
/// and it makes exactly N hits. For `top` the same mean is far off, which is why it is called biased.
#[test]
fn resampling_has_no_bias_and_top_has() {
    let m = 12;
    for (case, seed) in [1u64, 2, 3, 4].into_iter().enumerate() {
        let mut weights = random_values(seed, m);
        // Energies that are wrong, zero, or all the same.
        match case {
            1 => weights[3..9].fill(0.0),
            2 => weights.fill(0.0),
            3 => weights[5] = 1000.0,
            _ => {}
        }
        let radiance = random_values(seed + 100, m);
        let truth = radiance.iter().sum::<f32>() / m as f32;
        for n in [1u32, 5, 12] {
            let shifts = 20_000;
            let (mut mean, mut hits) = (0.0f64, 0.0f64);
            for k in 0..shifts {
                let u = (k as f32 + 0.5) / shifts as f32;
                for choice in cpu::gather::select_resample(&weights, n, 0.2, u) {
                    mean += f64::from(choice.weight * radiance[choice.candidate as usize]) / f64::from(shifts);
                    hits += f64::from(choice.weight) / f64::from(shifts);
                }
            }
            // Every boundary of a share is met to one shift in 20,000.
            assert!((mean - f64::from(truth)).abs() < 2e-3, "case {case}, N {n}: {mean} instead of {truth}");
            assert!((hits - 1.0).abs() < 2e-3, "case {case}, N {n}: weights add up to {hits}");
        }
    }
    // An honest proxy: energies are the radiances.
    let radiance = random_values(9, m);
    let truth = radiance.iter().sum::<f32>() / m as f32;
    let top: f32 =
        cpu::gather::select_top(&radiance, 4).iter().map(|c| c.weight * radiance[c.candidate as usize]).sum();
    assert!(top > 1.2 * truth, "{top} and {truth}");
}
