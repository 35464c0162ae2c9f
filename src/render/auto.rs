//! The sampling `auto`: from what a pilot finds in a few cells to how the gather draws its directions (DESIGN section 2,
//! "Choosing directions").
//!
//! `directions` says how little noise is wanted: as little as `phase` has with as many. What `residual` takes for as little
//! follows from the variances of its two levels and from what their rays cost; it is chosen where it saves time for certain.
//! `resample` is no choice: how noisy it is cannot be told from the two levels, and it never paid where it was measured
//! (docs/accuracy.md).
//!
//! Costs are counted steps times what a step costs on the device. That is measured once and kept in the user's cache folder,
//! so that the same seed gives the same bytes; where nothing can be kept, costs are the usual ones.

use super::{Internals, Renderer};
use crate::Result;
use crate::abi::PilotSample;
use crate::passes::gather::GatherConfig;
use crate::scene::{Overrides, Sampling, Scene, load_scene};
use crate::shaders::constants::PILOT_REPLICATES;
use crate::stats::{AutoStats, Stats, median};
use crate::vk::Context;
use std::ops::ControlFlow;

/// What things cost on a device, in nanoseconds of GPU time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// A step of a ray in the data.
    pub traced_step: f64,
    /// What else a ray in the data costs, its sample's way into the projection included.
    pub traced_ray: f64,
    /// A step of a ray in the proxy.
    pub proxy_step: f64,
    /// What else such a ray costs.
    pub proxy_ray: f64,
    /// A cell's lower level, beside its rays.
    pub base: f64,
    /// A voxel of a built proxy.
    pub voxel: f64,
}

/// Measured on lavapipe (docs/accuracy.md).
pub const USUAL_COSTS: Costs =
    Costs { traced_step: 80.0, traced_ray: 150.0, proxy_step: 38.0, proxy_ray: 80.0, base: 3200.0, voxel: 700.0 };

/// How the name of the kept file begins.
const KEPT: &str = "costs-";
/// Renders of which the median is taken.
const RENDERS: usize = 3;
/// Costs beyond this factor of the usual ones are no measurement.
const MOST_FACTOR: f64 = 1e4;

impl Costs {
    /// Those of the device: measured, or the usual ones. The first call for a device takes some seconds on a CPU.
    pub fn of(ctx: &Context) -> Result<Self> {
        let kept = ctx.kept(KEPT, || Ok(bytemuck::bytes_of(&measured_factors(ctx)?).to_vec()))?;
        Ok(kept.and_then(|bytes| Self::from_factors(&bytes)).unwrap_or(USUAL_COSTS))
    }

    /// The usual costs times four factors: of rays in the data, of rays in the proxy, of the lower level, of the proxy.
    fn from_factors(bytes: &[u8]) -> Option<Self> {
        let factors: [f64; 4] = bytemuck::try_pod_read_unaligned(bytes).ok()?;
        let [traced, proxy, base, voxel] = factors;
        let c = USUAL_COSTS;
        factors.iter().all(|f| (1.0 / MOST_FACTOR..MOST_FACTOR).contains(f)).then_some(Self {
            traced_step: traced * c.traced_step,
            traced_ray: traced * c.traced_ray,
            proxy_step: proxy * c.proxy_step,
            proxy_ray: proxy * c.proxy_ray,
            base: base * c.base,
            voxel: voxel * c.voxel,
        })
    }
}

/// Renders a phantom and compares the time of its passes with what the usual costs say of them. It has colour: without, rays
/// in the data cost about 0.73 of this on lavapipe, which is within what `LEAST_GAIN` allows for.
fn measured_factors(ctx: &Context) -> Result<[f64; 4]> {
    // Large enough to fill the device.
    let edge = if ctx.is_cpu() { 32 } else { 160 };
    let volume = format!("phantom:cloud:{edge}x{edge}x{edge}");
    let mut scene = load_scene(None, &Overrides { volume: Some(volume.into()), ..Overrides::default() })?;
    let s = &mut scene.settings;
    (s.orders, s.size, s.spp, s.hidden_share, s.environment_directions) = (2, [8, 8], 1, 1.0, 1);
    (s.candidates, s.directions) = (96, 32);
    let render = |scene: &Scene, times: usize| -> Result<(Vec<Stats>, f64)> {
        let internals = Internals { costs: Some(USUAL_COSTS), ..Internals::default() };
        let mut renderer = Renderer::new(ctx, scene, internals)?;
        let mut all = Vec::new();
        for _ in 0..times {
            renderer.render(0, &mut |_| ControlFlow::Continue(()))?;
            all.push(renderer.stats(scene, 0.0)?);
        }
        Ok((all, renderer.listed_cells()[0] as f64))
    };
    scene.settings.sampling = Sampling::Auto;
    let (pilot, cells) = render(&scene, 1)?;
    let steps = pilot[0].auto.as_ref().map_or([f64::NAN; 2], |auto| [auto.traced_steps, auto.proxy_steps]);
    scene.settings.sampling = Sampling::Residual;
    // One more: drivers compile at first use.
    let (all, _) = render(&scene, 1 + RENDERS)?;
    let usual_ns = |prefix: &str| {
        let ns = |stats: &Stats| stats.passes.iter().filter(|p| p.name.starts_with(prefix)).map(|p| p.ms * 1e6).sum();
        median(&all[1..].iter().map(ns).collect::<Vec<f64>>())
    };
    let c = USUAL_COSTS;
    let (m, n) = (f64::from(scene.settings.candidates), f64::from(scene.settings.directions));
    Ok([
        usual_ns("gather.trace") / (cells * n * (c.traced_ray + c.traced_step * steps[0])),
        usual_ns("gather.proxy") / (cells * (m + n) * (c.proxy_ray + c.proxy_step * steps[1])),
        usual_ns("gather.base") / (cells * c.base),
        usual_ns("proxy.") / (f64::from(edge).powi(3) * c.voxel),
    ])
}

/// `residual` must be expected to take this much less time than `phase`: then it is no slower where the variances, which come
/// from a few cells, or the costs are off by as much.
const LEAST_GAIN: f64 = 1.25;
/// Most candidates in terms of the directions asked for.
const MOST_CANDIDATES: u32 = 4;

/// Most candidates that a cell's lists, of so many words, have room for beside the directions. Longer lists would make the
/// dispatches of all passes smaller, and `phase` slower for what it does not use.
fn most_candidates(wanted: &GatherConfig, words: u32) -> u32 {
    words.saturating_sub(wanted.directions).clamp(1, (MOST_CANDIDATES * wanted.directions).min(1024))
}

/// What a pilot found. Variances are those of a mean over directions, times their number; in units that do not matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Of the traced light.
    pub phase: f64,
    /// V0: of the light in the proxy.
    pub proxy: f64,
    /// V1: of traced less proxy.
    pub residual: f64,
    /// Steps of a ray in the data.
    pub traced_steps: f64,
    /// Steps of a ray in the proxy.
    pub proxy_steps: f64,
}

impl Found {
    /// From what two replicates found in the same cells, each with `directions` directions.
    pub fn of(replicates: &[Vec<PilotSample>; PILOT_REPLICATES as usize], directions: u32) -> Self {
        let n = f64::from(directions);
        let [first, second] = replicates;
        let rays = n * (first.len() + second.len()) as f64;
        // Two numbers of one distribution differ by √2 of its standard deviation, root mean square.
        let variance = |value: fn(&PilotSample) -> [f32; 3]| {
            let of_cell = |(a, b): (&PilotSample, &PilotSample)| -> f64 {
                value(a).iter().zip(value(b)).map(|(a, b)| 0.5 * (f64::from(*a) - f64::from(b)).powi(2)).sum()
            };
            n * first.iter().zip(second).map(of_cell).sum::<f64>() / first.len() as f64
        };
        let steps = |count: fn(&PilotSample) -> u32| {
            first.iter().chain(second).map(|s| f64::from(count(s))).sum::<f64>() / rays
        };
        Self {
            phase: variance(|s| s.traced),
            proxy: variance(|s| s.base),
            residual: variance(|s| s.residual),
            traced_steps: steps(|s| s.traced_steps),
            proxy_steps: steps(|s| s.proxy_steps),
        }
    }
}

/// What is left to be gathered.
#[derive(Clone, Copy, Debug)]
pub struct Work {
    /// Gathers of cells, each counted by its share of the directions.
    pub shares: f64,
    /// Gathers of cells.
    pub cells: f64,
    /// Voxels of the proxies to be built, without the pilot's.
    pub voxels: f64,
}

/// Decides. `words`: of the lists of a cell.
pub fn decide(found: &Found, costs: &Costs, work: &Work, wanted: &GatherConfig, words: u32) -> AutoStats {
    let phase_ray = costs.traced_ray + costs.traced_step * found.traced_steps;
    let proxy_ray = costs.proxy_ray + costs.proxy_step * found.proxy_steps;
    let residual_ray = phase_ray + proxy_ray;
    // The least V0/M + V1/N for a time, and the other way round, has M/N = √(V0 C1/(V1 C0)).
    let variance = found.phase / f64::from(wanted.directions);
    let best = (found.proxy + (found.proxy * found.residual * residual_ray / proxy_ray).sqrt()) / variance;
    let most = most_candidates(wanted, words);
    // A ratio of nothing to nothing is no number, and leads to `phase`.
    let candidates = if best.is_finite() { (best.floor() + 1.0).min(f64::from(most)) } else { 1.0 };
    let directions = (found.residual / (variance - found.proxy / candidates)).ceil().max(1.0);
    let time = work.shares * (candidates * proxy_ray + directions * residual_ray)
        + work.cells * costs.base
        + work.voxels * costs.voxel;
    let phase_time = work.shares * f64::from(wanted.directions) * phase_ray;
    let fits = candidates + directions <= f64::from(words);
    let reaches = fits && variance > found.proxy / candidates && directions <= f64::from(wanted.directions);
    let gain = if reaches { phase_time / time } else { 0.0 };
    let pays = gain >= LEAST_GAIN;
    AutoStats {
        sampling: if pays { Sampling::Residual } else { Sampling::Phase },
        candidates: if pays { candidates as u32 } else { 0 },
        directions: if pays { directions as u32 } else { wanted.directions },
        residual_gain: gain,
        least_gain: LEAST_GAIN,
        phase_variance: found.phase,
        proxy_variance: found.proxy,
        residual_variance: found.residual,
        phase_cost: phase_ray,
        proxy_cost: proxy_ray,
        residual_cost: residual_ray,
        traced_steps: found.traced_steps,
        proxy_steps: found.proxy_steps,
        iteration: 0,
        cells: 0,
    }
}

impl AutoStats {
    /// The gather that was decided on.
    pub fn config(&self, wanted: &GatherConfig) -> GatherConfig {
        let candidates = self.candidates.max(1);
        GatherConfig { sampling: self.sampling, candidates, directions: self.directions, ..*wanted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WANTED: GatherConfig = GatherConfig {
        sampling: Sampling::Phase,
        candidates: 64,
        directions: 48,
        defence: 0.5,
        step: 1.0,
        proxy_step: 2.0,
    };

    const WORK: Work = Work { shares: 1e6, cells: 1.5e6, voxels: 1e6 };

    /// As on a GPU.
    const WORDS: u32 = 256;
    /// The most that they hold of candidates.
    const MOST: u32 = 192;

    /// Variances relative to `phase`, and steps.
    fn found(proxy: f64, residual: f64, traced_steps: f64) -> Found {
        Found { phase: 3.0, proxy: 3.0 * proxy, residual: 3.0 * residual, traced_steps, proxy_steps: 5.0 }
    }

    fn decided(found: Found) -> AutoStats {
        decide(&found, &USUAL_COSTS, &WORK, &WANTED, WORDS)
    }

    #[test]
    fn residual_is_as_noisy_as_phase_with_the_best_ratio() {
        let found = found(0.9, 0.1, 60.0);
        let d = decided(found);
        assert_eq!(d.sampling, Sampling::Residual, "{d:?}");
        let (m, n) = (f64::from(d.candidates), f64::from(d.directions));
        let best = (found.proxy * d.residual_cost / (found.residual * d.proxy_cost)).sqrt();
        assert!((m / n / best - 1.0).abs() < 0.15, "M {m}, N {n}, M/N should be {best}");
        let (variance, wanted) = (found.proxy / m + found.residual / n, found.phase / 48.0);
        assert!(variance <= wanted && variance > 0.9 * wanted, "{variance} and {wanted}");
        // What it says of the time is true of M and N.
        let time = WORK.shares * (m * d.proxy_cost + n * d.residual_cost) + 1.5e6 * 3200.0 + 1e6 * 700.0;
        assert!((d.residual_gain * time / (WORK.shares * 48.0 * d.phase_cost) - 1.0).abs() < 1e-9, "{d:?}");
    }

    #[test]
    fn phase_is_left_where_residual_is_noisy_dear_or_nothing_is_known() {
        for (case, found) in [
            ("a poor proxy", found(1.0, 1.2, 60.0)),
            ("a useless proxy", found(0.0, 1.0, 60.0)),
            ("short rays", found(0.9, 0.1, 5.0)),
            ("no light", Found { phase: 0.0, proxy: 0.0, residual: 0.0, traced_steps: 9.0, proxy_steps: 9.0 }),
            ("no noise", Found { phase: 0.0, ..found(0.9, 0.1, 60.0) }),
            ("no number", Found { phase: f64::NAN, ..found(0.9, 0.1, 60.0) }),
            ("no number of the proxy", Found { proxy: f64::INFINITY, ..found(0.9, 0.1, 60.0) }),
        ] {
            let d = decided(found);
            assert_eq!((d.sampling, d.candidates, d.directions), (Sampling::Phase, 0, 48), "{case}: {d:?}");
            assert!(d.residual_gain < LEAST_GAIN, "{case}: {d:?}");
            assert_eq!(d.config(&WANTED), GatherConfig { candidates: 1, ..WANTED }, "{case}");
        }
        // A build of many voxels for few cells.
        let d = decide(&found(0.9, 0.1, 60.0), &USUAL_COSTS, &Work { voxels: 1e9, ..WORK }, &WANTED, WORDS);
        assert_eq!(d.sampling, Sampling::Phase, "{d:?}");
    }

    #[test]
    fn counts_stay_within_what_lists_have_room_for() {
        // A proxy that is right to the last digit, and next to free.
        let d = decided(Found { residual: 0.0, proxy_steps: 0.0, ..found(1.0, 0.0, 1000.0) });
        assert_eq!((d.sampling, d.directions), (Sampling::Residual, 1), "{d:?}");
        let config = d.config(&WANTED);
        assert!((48..=MOST).contains(&config.candidates), "{config:?}");
        // One that is nearly right would take more than there may be.
        let d = decided(Found { proxy_steps: 0.0, ..found(1.0, 0.01, 1000.0) });
        assert_eq!(d.candidates, MOST, "{d:?}");
        let wanted = |directions| GatherConfig { directions, ..WANTED };
        let most = |directions, words| most_candidates(&wanted(directions), words);
        assert_eq!((most(48, 1 << 20), most(1024, 1 << 20)), (192, 1024));
        // In lists with room for the lower level's M and the upper level's N.
        assert_eq!((most(48, 256), most(48, 240), most(128, 256), most(512, 256)), (192, 192, 128, 1));
        // A smooth proxy whose one candidate takes away 0.4 of the variance: 308 directions instead of 512.
        let smooth = Found { proxy_steps: 0.0, ..found(1e-9, 0.6, 1000.0) };
        let cheap = Costs { proxy_ray: 1e-3, proxy_step: 0.0, base: 0.0, voxel: 0.0, ..USUAL_COSTS };
        for (words, sampling) in [(307, Sampling::Phase), (309, Sampling::Residual)] {
            let d = decide(&smooth, &cheap, &WORK, &wanted(512), words);
            assert_eq!(d.sampling, sampling, "{d:?}");
        }
    }

    #[test]
    fn kept_factors_must_make_sense() {
        let of = |factors: [f64; 4]| Costs::from_factors(bytemuck::bytes_of(&factors));
        assert_eq!(of([1.0; 4]), Some(USUAL_COSTS));
        let costs = of([2.0, 3.0, 4.0, 5.0]).unwrap();
        assert_eq!((costs.traced_step, costs.proxy_ray), (2.0 * USUAL_COSTS.traced_step, 3.0 * USUAL_COSTS.proxy_ray));
        assert_eq!((costs.base, costs.voxel), (4.0 * USUAL_COSTS.base, 5.0 * USUAL_COSTS.voxel));
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert_eq!(of([1.0, wrong, 1.0, 1.0]), None, "{wrong}");
        }
        assert_eq!(Costs::from_factors(&[0; 31]), None);
    }

    #[test]
    fn variances_are_of_means_over_the_directions() {
        let sample = |traced: f32, steps| PilotSample {
            traced: [traced, 0.0, 0.0],
            base: [0.0, 2.0 * traced, 0.0],
            residual: [0.0, 0.0, 3.0 * traced],
            traced_steps: steps,
            proxy_steps: 2 * steps,
        };
        let found = Found::of(&[vec![sample(1.0, 10), sample(5.0, 30)], vec![sample(2.0, 20), sample(5.0, 20)]], 10);
        // Half of the squared difference 1, mean over two cells, times ten directions.
        assert_eq!((found.phase, found.proxy, found.residual), (2.5, 10.0, 22.5));
        assert_eq!((found.traced_steps, found.proxy_steps), (2.0, 4.0));
    }
}
