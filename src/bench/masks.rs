//! `tyndall bench masks`: what the proxy's masks cost and what they are worth, fixed ones beside adaptive ones, on light that
//! was scattered once.

use super::lit::Lit;
use super::proxy::{DIRECTIONS, draw_cells, variance};
use super::{Timing, time_passes};
use crate::passes::bench_rays::{BenchRays, RayConfig};
use crate::passes::mips::Mips;
use crate::passes::proxy::{Proxy, ProxyConfig, ProxyCounts};
use crate::render::chunk_items;
use crate::scene::{Mask, Scene};
use crate::shaders::constants;
use crate::stats::median;
use crate::vk::{Buffer, Context, Recorder};
use crate::{Error, Result};
use half::f16;
use serde::Serialize;

/// Options.
#[derive(Clone, Debug)]
pub struct Config {
    /// Masks; times are relative to the first.
    pub masks: Vec<Mask>,
    /// Rays, in rounded-up multiples of [`DIRECTIONS`].
    pub rays: u32,
    /// Timed builds of every mask.
    pub runs: u32,
}

/// What was measured of one mask.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// As it is written.
    pub mask: String,
    /// The one in use: coarser if the runs do not fit.
    pub mask_used: String,
    /// Runs of equal hash.
    pub runs: u32,
    /// Buckets.
    pub buckets: u32,
    /// Levels of R, G, B, A.
    pub levels: [u32; 4],
    /// Bits of a hash.
    pub hash_bits: u32,
    /// GPU time of the build, median, in ms.
    pub build_ms: f64,
    /// Time of the build over that of the first mask, median over the runs: CPU time where there is one.
    pub relative_time: f64,
    /// Light that a voxel sends out, source function times opacity: root mean square of what its bucket has less its own, over
    /// the mean. The 8 bits of the codes are part of it.
    pub energy_error: f64,
    /// Mean of the light of the voxels' buckets over that of the voxels, minus 1.
    pub energy_bias: f64,
    /// Variance of (traced ray − estimate) over that of traced rays, over the directions of a cell; steps as the scene's.
    pub residual_variance: f64,
}

/// A scene's table.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Volume.
    pub volume: String,
    /// Its voxels along x, y, z.
    pub dims: [u32; 3],
    /// Rays.
    pub rays: u32,
    /// Timed builds.
    pub runs: u32,
    /// Masks.
    pub rows: Vec<Row>,
}

/// Root mean square of b − a over the mean of a, and the mean of b over that of a, minus 1.
fn errors(pairs: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let (mut count, mut means, mut squares) = (0.0, [0.0; 2], 0.0);
    for [a, b] in pairs {
        count += 1.0;
        means[0] += a;
        means[1] += b;
        squares += (b - a).powi(2);
    }
    [(squares / count).sqrt() * count / means[0], means[1] / means[0] - 1.0]
}

/// Measures all masks on `scene`. `progress` is told the share that is done.
///
/// Errors: the scene is empty or dark, or the device fails.
pub fn run(ctx: &Context, scene: Scene, config: &Config, progress: &mut dyn FnMut(f64)) -> Result<Table> {
    let volume = scene.volume.name.clone();
    let step = scene.settings.proxy_step;
    let lit = Lit::new(ctx, scene, chunk_items(ctx, None))?;
    let (data, dims) = (&lit.data, lit.data.params.dims);
    let mips = Mips::means_of_voxels(ctx, dims)?;
    let mut rec = Recorder::new(ctx)?;
    let args = lit.node_args(ctx, &mut rec)?;
    mips.record(&mut rec, &lit.source, &lit.emptiness.image);
    rec.submit_and_wait()?;
    let means = &mips.means[0];

    let mut proxies = Vec::new();
    for &mask in &config.masks {
        let proxy = Proxy::new(ctx, data, ProxyConfig::of(mask))?;
        let mut rec = Recorder::new(ctx)?;
        proxy.record_clear(&mut rec);
        rec.submit_and_wait()?;
        proxies.push(proxy);
    }
    let build = |proxy: &Proxy| time_passes(ctx, |rec| proxy.record(rec, data, &lit.nodes, &args, means, 0));
    for proxy in &proxies {
        build(proxy)?; // lavapipe compiles at first use
    }
    let mut times = vec![Vec::new(); proxies.len()];
    for run in 0..config.runs {
        for (proxy, times) in proxies.iter().zip(&mut times) {
            times.push(build(proxy)?);
        }
        progress(0.8 * f64::from(run + 1) / f64::from(config.runs));
    }

    // Rays.
    let cells = draw_cells(&lit.cells.read_back(ctx)?, config.rays.div_ceil(DIRECTIONS), data.params.seed_low);
    let (cell_count, rays) = (cells.len(), cells.len() as u32 * DIRECTIONS);
    let cells = ctx.upload("bench.cells", &cells)?;
    let results: Buffer<[f32; 2]> = ctx.device_buffer("bench.results", rays as usize)?;
    let follow = |structure, step, proxy: &Proxy| -> Result<Vec<f64>> {
        let config = RayConfig { structure, edge: constants::SKIP_SIZE, step, reach: 0.0 };
        let pass = BenchRays::new(ctx, config)?;
        let inputs = lit.ray_inputs(proxy, means);
        let mut rec = Recorder::new(ctx)?;
        pass.record(&mut rec, data, inputs, &cells, DIRECTIONS, &results, None);
        rec.submit_and_wait()?;
        Ok(ctx.read_back(&results)?.iter().map(|result| f64::from(result[0])).collect())
    };
    let variance_of = |value: &dyn Fn(usize) -> f64| variance(cell_count, DIRECTIONS as usize, value);
    let traced = follow(constants::STRUCTURE_OCTANTS, 1.0, &proxies[0])?;
    let whole = variance_of(&|i| traced[i]);
    if whole.is_nan() || whole <= 0.0 {
        return Err(Error::input("scene", "no light reaches the medium", "add a light or an environment"));
    }

    let depth = f64::from(data.params.max_extinction * data.params.mean_spacing);
    let light = |source: f64, extinction: f64| source * (1.0 - (-extinction * depth).exp());
    let field: Vec<[f16; 4]> = ctx.read_back_image(means)?;
    let mut rows = Vec::new();
    for (i, (proxy, mask)) in proxies.iter().zip(&config.masks).enumerate() {
        proxy.check(ctx)?;
        let counts: ProxyCounts = proxy.counts(&ctx.read_back(proxy.control())?);
        let bucket_id: Vec<u32> = ctx.read_back_image(proxy.bucket_id())?;
        let bucket_light = ctx.read_back_range(proxy.bucket_light(), 0..counts.buckets as usize)?;
        let active = field.iter().zip(&bucket_id).filter(|(texel, _)| texel[3] > f16::ZERO);
        let [energy_error, energy_bias] = errors(active.map(|(texel, &id)| {
            let [r, g, b, a] = texel.map(f64::from);
            let [source, extinction] =
                [0, 16].map(|shift| f64::from(f16::from_bits((bucket_light[id as usize] >> shift) as u16)));
            [light((r + g + b) / 3.0, a), light(source, extinction)]
        }));
        let estimated = follow(constants::STRUCTURE_BUCKETS, step, proxy)?;
        let gpu: Vec<f64> = times[i].iter().map(|t: &Timing| t.gpu).collect();
        let ratios: Vec<f64> = times[i].iter().zip(&times[0]).map(|(a, b)| a.best() / b.best()).collect();
        rows.push(Row {
            mask: mask.to_string(),
            mask_used: counts.mask.to_string(),
            runs: counts.runs,
            buckets: counts.buckets,
            levels: counts.levels,
            hash_bits: counts.hash_bits(),
            build_ms: median(&gpu),
            relative_time: median(&ratios),
            energy_error,
            energy_bias,
            residual_variance: variance_of(&|i| traced[i] - estimated[i]) / whole,
        });
    }
    Ok(Table { volume, dims, rays, runs: config.runs, rows })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_by_hand() {
        // Mean 2, differences 1 and −3: their root mean square is √5, their mean −1.
        let [error, bias] = errors([[1.0, 2.0], [3.0, 0.0]].into_iter());
        assert!((error - 5f64.sqrt() / 2.0).abs() < 1e-12 && (bias + 0.5).abs() < 1e-12, "{error} {bias}");
    }
}
