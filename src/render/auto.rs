//! The sampling `auto`: from what a pilot finds in a few cells to how the gather draws its directions (DESIGN section 2,
//! "Choosing directions").
//!
//! `directions` says how little noise is wanted: as little as `phase` has with as many. What `residual` takes for as little
//! follows from the variances of its two levels and from what their rays cost; it is chosen where it saves time for certain.
//! `resample` is no choice: how noisy it is cannot be told from the two levels, and it never paid where it was measured
//! (docs/accuracy.md).
//!
//! A pilot and its proxy must not cost more than they can be worth: where they are expected to take more than a small part of
//! the gathers that are left, by the steps that a first look counts in the data, there is none, and it is `phase`.
//!
//! Costs are counted steps times what a step costs on the device. That is measured once and kept in the user's cache folder,
//! so that the same seed gives the same bytes; where nothing can be kept, costs are the usual ones.

use super::{Internals, Renderer};
use crate::Result;
use crate::abi::PilotSample;
use crate::passes::gather::GatherConfig;
use crate::scene::{Overrides, Sampling, Scene, load_scene};
use crate::shaders::constants::PILOT_REPLICATES;
use crate::stats::{AutoStats, PilotStats, Stats, median};
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
    /// A proxy of hardly any voxels.
    pub least_build: f64,
    /// Rays of the pilot, over what the same rays cost in a gather.
    pub pilot_factor: f64,
    /// A pilot of hardly any rays.
    pub least_pilot: f64,
}

/// Measured on lavapipe (docs/accuracy.md).
pub const USUAL_COSTS: Costs = Costs {
    traced_step: 80.0,
    traced_ray: 150.0,
    proxy_step: 38.0,
    proxy_ray: 80.0,
    base: 3200.0,
    voxel: 700.0,
    least_build: 1e6,
    pilot_factor: 1.0,
    least_pilot: 1e6,
};

/// By which a pilot costs nothing: there is one wherever there are cells.
pub const FREE_PILOT: Costs =
    Costs { voxel: 0.0, least_build: 0.0, pilot_factor: 0.0, least_pilot: 0.0, ..USUAL_COSTS };

/// How the name of the kept file begins. Another number where the factors in it are others.
const KEPT: &str = "costs-2-";
/// The factors in it: of rays in the data, of rays in the proxy, of the lower level, of a proxy's voxels, of the least proxy, of
/// the pilot's rays, and of the least pilot.
type Factors = [f64; 7];
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

    /// The usual costs times these.
    fn from_factors(bytes: &[u8]) -> Option<Self> {
        let factors: Factors = bytemuck::try_pod_read_unaligned(bytes).ok()?;
        let [traced, proxy, base, voxel, least_build, pilot, least_pilot] = factors;
        let c = USUAL_COSTS;
        factors.iter().all(|f| (1.0 / MOST_FACTOR..MOST_FACTOR).contains(f)).then_some(Self {
            traced_step: traced * c.traced_step,
            traced_ray: traced * c.traced_ray,
            proxy_step: proxy * c.proxy_step,
            proxy_ray: proxy * c.proxy_ray,
            base: base * c.base,
            voxel: voxel * c.voxel,
            least_build: least_build * c.least_build,
            pilot_factor: pilot * c.pilot_factor,
            least_pilot: least_pilot * c.least_pilot,
        })
    }

    /// A ray in the data of so many steps, and one in the proxy.
    fn rays(&self, traced_steps: f64, proxy_steps: f64) -> [f64; 2] {
        [self.traced_ray + self.traced_step * traced_steps, self.proxy_ray + self.proxy_step * proxy_steps]
    }

    /// A proxy. What is small takes as long as the device takes for anything.
    fn build(&self, voxels: f64) -> f64 {
        self.least_build.max(self.voxel * voxels)
    }

    /// A pilot that follows so many directions in both, without its proxy.
    fn pilot(&self, directions: f64, traced_steps: f64, proxy_steps: f64) -> f64 {
        let [traced, proxy] = self.rays(traced_steps, proxy_steps);
        self.least_pilot.max(self.pilot_factor * directions * (traced + proxy))
    }
}

/// A phantom, rendered some times.
struct Measured {
    renders: Vec<Stats>,
    auto: Option<AutoStats>,
    /// Cells that gather.
    cells: f64,
}

impl Measured {
    fn of(ctx: &Context, scene: &mut Scene, sampling: Sampling) -> Result<Self> {
        scene.settings.sampling = sampling;
        let internals = Internals { costs: Some(FREE_PILOT), ..Internals::default() };
        let mut renderer = Renderer::new(ctx, scene, internals)?;
        let mut renders = Vec::new();
        // One more: drivers compile at first use.
        for _ in 0..=RENDERS {
            renderer.render(0, &mut |_| ControlFlow::Continue(()))?;
            renders.push(renderer.stats(scene, 0.0)?);
        }
        let first = renders.remove(0);
        Ok(Self { renders, auto: first.auto, cells: renderer.listed_cells()[0] as f64 })
    }

    /// GPU time of the passes whose names begin like this, in nanoseconds: the renders' median.
    fn ns(&self, prefix: &str) -> f64 {
        let ns = |stats: &Stats| stats.passes.iter().filter(|p| p.name.starts_with(prefix)).map(|p| p.ms * 1e6).sum();
        median(&self.renders.iter().map(ns).collect::<Vec<f64>>())
    }
}

/// Renders phantoms and compares the time of their passes with what the usual costs say of them. They have colour: without, rays
/// in the data cost about 0.73 of this on lavapipe, which is within what `LEAST_GAIN` allows for.
fn measured_factors(ctx: &Context) -> Result<Factors> {
    let cloud = |edge: u32| {
        let volume = format!("phantom:cloud:{edge}x{edge}x{edge}");
        let mut scene = load_scene(None, &Overrides { volume: Some(volume.into()), ..Overrides::default() })?;
        let s = &mut scene.settings;
        (s.orders, s.size, s.spp, s.hidden_share, s.environment_directions) = (2, [8, 8], 1, 1.0, 1);
        (s.candidates, s.directions) = (96, 32);
        Ok(scene)
    };
    // One that fills the device, and one that is next to nothing.
    let edge = if ctx.is_cpu() { 32 } else { 160 };
    let mut large = cloud(edge)?;
    let mut small = cloud(8)?;
    small.settings.directions = 1;
    let (m, n) = (f64::from(large.settings.candidates), f64::from(large.settings.directions));
    let auto = Measured::of(ctx, &mut large, Sampling::Auto)?;
    let residual = Measured::of(ctx, &mut large, Sampling::Residual)?;
    let least = Measured::of(ctx, &mut small, Sampling::Auto)?;
    let pilot = auto.auto.as_ref().and_then(|auto| auto.pilot.as_ref());
    let [traced_steps, proxy_steps, rays] =
        pilot.map_or([f64::NAN; 3], |p| [p.traced_steps, p.proxy_steps, p.rays as f64]);
    let c = USUAL_COSTS;
    let [traced_ns, proxy_ns] = c.rays(traced_steps, proxy_steps);
    let traced = residual.ns("gather.trace") / (residual.cells * n * traced_ns);
    let proxy = residual.ns("gather.proxy") / (residual.cells * (m + n) * proxy_ns);
    Ok([
        traced,
        proxy,
        residual.ns("gather.base") / (residual.cells * c.base),
        residual.ns("proxy.") / (f64::from(edge).powi(3) * c.voxel),
        least.ns("proxy.") / c.least_build,
        auto.ns("pilot") / (rays * (traced * traced_ns + proxy * proxy_ns)) / c.pilot_factor,
        least.ns("pilot") / c.least_pilot,
    ])
}

/// `residual` must be expected to take this much less time than `phase`: then it is no slower where the variances, which come
/// from a few cells, or the costs are off by as much.
const LEAST_GAIN: f64 = 1.25;
/// Most that a pilot and its proxy may be expected to take, over the gathers that are left: what `auto` loses at most where
/// `phase` is right. A picture is more than these gathers, so that it is less of a picture's time, even where costs are off.
const MOST_PILOT: f64 = 0.07;
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
    /// Cells that were looked at.
    pub cells: u32,
    /// Directions that were followed in all.
    pub rays: u64,
}

impl Found {
    /// From what two replicates found in the same cells, each with `directions` directions.
    pub fn of(replicates: &[Vec<PilotSample>; PILOT_REPLICATES as usize], directions: u32) -> Self {
        let n = f64::from(directions);
        let [first, second] = replicates;
        // Two numbers of one distribution differ by √2 of its standard deviation, root mean square.
        let variance = |value: fn(&PilotSample) -> [f32; 3]| {
            let of_cell = |(a, b): (&PilotSample, &PilotSample)| -> f64 {
                value(a).iter().zip(value(b)).map(|(a, b)| 0.5 * (f64::from(*a) - f64::from(b)).powi(2)).sum()
            };
            n * first.iter().zip(second).map(of_cell).sum::<f64>() / first.len() as f64
        };
        Self {
            phase: variance(|s| s.traced),
            proxy: variance(|s| s.base),
            residual: variance(|s| s.residual),
            traced_steps: steps_per_ray(replicates, directions, |s| s.traced_steps),
            proxy_steps: steps_per_ray(replicates, directions, |s| s.proxy_steps),
            cells: first.len() as u32,
            rays: rays(replicates, directions),
        }
    }
}

fn rays(replicates: &[Vec<PilotSample>], directions: u32) -> u64 {
    replicates.iter().map(Vec::len).sum::<usize>() as u64 * u64::from(directions)
}

/// Steps of a ray, from what replicates counted in their cells, each with `directions` directions.
pub fn steps_per_ray(replicates: &[Vec<PilotSample>], directions: u32, count: fn(&PilotSample) -> u32) -> f64 {
    let steps: f64 = replicates.iter().flatten().map(|s| f64::from(count(s))).sum();
    steps / rays(replicates, directions) as f64
}

/// What is left to be gathered.
#[derive(Clone, Copy, Debug)]
pub struct Work {
    /// Gathers of cells, each counted by its share of the directions.
    pub shares: f64,
    /// Gathers of cells.
    pub cells: f64,
    /// Voxels of a proxy.
    pub voxels: f64,
    /// Gathers that are left, but for the next.
    pub later: f64,
}

/// Is a pilot of so many rays worth its time? Where it is not, it is `phase`. `traced_steps`: of a ray in the data.
pub fn begin(traced_steps: f64, costs: &Costs, work: &Work, wanted: &GatherConfig, rays: u64) -> AutoStats {
    // Empty space is skipped in the proxy as in the data.
    let proxy_steps = traced_steps * f64::from(wanted.step / wanted.proxy_step);
    let [phase_ray, _] = costs.rays(traced_steps, proxy_steps);
    let pilot = costs.pilot(rays as f64, traced_steps, proxy_steps) + costs.build(work.voxels);
    let gathers = work.shares * f64::from(wanted.directions) * phase_ray;
    AutoStats {
        sampling: Sampling::Phase,
        candidates: 0,
        directions: wanted.directions,
        traced_steps,
        pilot_share: pilot / gathers,
        most_pilot_share: MOST_PILOT,
        iteration: 0,
        pilot: None,
    }
}

/// Decides by what the pilot found. `words`: of the lists of a cell.
pub fn decide(
    begun: AutoStats,
    found: &Found,
    costs: &Costs,
    work: &Work,
    wanted: &GatherConfig,
    words: u32,
) -> AutoStats {
    let [phase_ray, proxy_ray] = costs.rays(found.traced_steps, found.proxy_steps);
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
        + work.later * costs.build(work.voxels);
    let phase_time = work.shares * f64::from(wanted.directions) * phase_ray;
    let fits = candidates + directions <= f64::from(words);
    let reaches = fits && variance > found.proxy / candidates && directions <= f64::from(wanted.directions);
    let gain = if reaches { phase_time / time } else { 0.0 };
    let pays = gain >= LEAST_GAIN;
    AutoStats {
        sampling: if pays { Sampling::Residual } else { Sampling::Phase },
        candidates: if pays { candidates as u32 } else { 0 },
        directions: if pays { directions as u32 } else { wanted.directions },
        pilot: Some(PilotStats {
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
            cells: found.cells,
            rays: found.rays,
        }),
        ..begun
    }
}

impl AutoStats {
    /// Shall there be a pilot?
    pub fn is_worth_a_pilot(&self) -> bool {
        self.pilot_share <= self.most_pilot_share
    }

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

    const WORK: Work = Work { shares: 1e6, cells: 1.5e6, voxels: 1e6, later: 1.0 };

    /// As on a GPU.
    const WORDS: u32 = 256;
    /// The most that they hold of candidates.
    const MOST: u32 = 192;

    /// Variances relative to `phase`, and steps.
    fn found(proxy: f64, residual: f64, traced_steps: f64) -> Found {
        let (proxy, residual) = (3.0 * proxy, 3.0 * residual);
        Found { phase: 3.0, proxy, residual, traced_steps, proxy_steps: 5.0, cells: 4096, rays: 4096 * 96 }
    }

    fn decided(found: Found) -> AutoStats {
        decided_for(found, &USUAL_COSTS, &WORK, &WANTED, WORDS)
    }

    fn decided_for(found: Found, costs: &Costs, work: &Work, wanted: &GatherConfig, words: u32) -> AutoStats {
        let begun = begin(found.traced_steps, costs, work, wanted, found.rays);
        assert_eq!(
            (begun.sampling, begun.config(wanted)),
            (Sampling::Phase, GatherConfig { candidates: 1, ..*wanted })
        );
        decide(begun, &found, costs, work, wanted, words)
    }

    fn pilot(stats: &AutoStats) -> &PilotStats {
        stats.pilot.as_ref().expect("what a pilot found")
    }

    #[test]
    fn residual_is_as_noisy_as_phase_with_the_best_ratio() {
        let found = found(0.9, 0.1, 60.0);
        let d = decided(found);
        assert_eq!(d.sampling, Sampling::Residual, "{d:?}");
        let (m, n) = (f64::from(d.candidates), f64::from(d.directions));
        let p = pilot(&d);
        let best = (found.proxy * p.residual_cost / (found.residual * p.proxy_cost)).sqrt();
        assert!((m / n / best - 1.0).abs() < 0.15, "M {m}, N {n}, M/N should be {best}");
        let (variance, wanted) = (found.proxy / m + found.residual / n, found.phase / 48.0);
        assert!(variance <= wanted && variance > 0.9 * wanted, "{variance} and {wanted}");
        // What it says of the time is true of M and N.
        let time = WORK.shares * (m * p.proxy_cost + n * p.residual_cost) + 1.5e6 * 3200.0 + 1e6 * 700.0;
        assert!((p.residual_gain * time / (WORK.shares * 48.0 * p.phase_cost) - 1.0).abs() < 1e-9, "{d:?}");
    }

    #[test]
    fn phase_is_left_where_residual_is_noisy_dear_or_nothing_is_known() {
        for (case, found) in [
            ("a poor proxy", found(1.0, 1.2, 60.0)),
            ("a useless proxy", found(0.0, 1.0, 60.0)),
            ("short rays", found(0.9, 0.1, 5.0)),
            ("no light", Found { phase: 0.0, proxy_steps: 9.0, ..found(0.0, 0.0, 9.0) }),
            ("no noise", Found { phase: 0.0, ..found(0.9, 0.1, 60.0) }),
            ("no number", Found { phase: f64::NAN, ..found(0.9, 0.1, 60.0) }),
            ("no number of the proxy", Found { proxy: f64::INFINITY, ..found(0.9, 0.1, 60.0) }),
        ] {
            let d = decided(found);
            assert_eq!((d.sampling, d.candidates, d.directions), (Sampling::Phase, 0, 48), "{case}: {d:?}");
            assert!(pilot(&d).residual_gain < LEAST_GAIN, "{case}: {d:?}");
            assert_eq!(d.config(&WANTED), GatherConfig { candidates: 1, ..WANTED }, "{case}");
        }
        // A build of many voxels for few cells.
        let d = decided_for(found(0.9, 0.1, 60.0), &USUAL_COSTS, &Work { voxels: 1e9, ..WORK }, &WANTED, WORDS);
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
            let d = decided_for(smooth, &cheap, &WORK, &wanted(512), words);
            assert_eq!(d.sampling, sampling, "{d:?}");
        }
    }

    #[test]
    fn a_pilot_takes_a_small_part_of_the_gathers_at_most() {
        let costs = USUAL_COSTS;
        // Ten steps in the data are five in the proxy.
        let ray = costs.traced_ray + 10.0 * costs.traced_step;
        let both = ray + costs.proxy_ray + 5.0 * costs.proxy_step;
        let gathers = WORK.shares * 48.0 * ray;
        let share = |rays, work: &Work, costs: &Costs| begin(10.0, costs, work, &WANTED, rays).pilot_share;
        let is_near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
        assert!(is_near(share(1 << 20, &WORK, &costs) * gathers, f64::from(1 << 20) * both + 7e8));
        // What is small takes the least there is.
        assert!(is_near(share(1, &Work { voxels: 1.0, ..WORK }, &costs) * gathers, 2e6));
        let slow = Costs { pilot_factor: 3.0, ..costs };
        assert!(is_near(share(1 << 20, &WORK, &slow) * gathers, f64::from(1 << 20) * both * 3.0 + 7e8));
        let is_worth_it = |work: &Work| begin(10.0, &costs, work, &WANTED, 1 << 19).is_worth_a_pilot();
        assert!(is_worth_it(&WORK));
        assert!(!is_worth_it(&Work { shares: 2e5, ..WORK }) && !is_worth_it(&Work { voxels: 1e7, ..WORK }));
        // Nothing is left to gather, or nothing costs anything.
        assert!(!is_worth_it(&Work { shares: 0.0, ..WORK }));
        assert!(!begin(f64::NAN, &costs, &WORK, &WANTED, 1).is_worth_a_pilot());
    }

    #[test]
    fn kept_factors_must_make_sense() {
        let of = |factors: Factors| Costs::from_factors(bytemuck::bytes_of(&factors));
        assert_eq!(of([1.0; 7]), Some(USUAL_COSTS));
        let costs = of([2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]).unwrap();
        let c = USUAL_COSTS;
        assert_eq!((costs.traced_step, costs.proxy_ray), (2.0 * c.traced_step, 3.0 * c.proxy_ray));
        assert_eq!((costs.base, costs.voxel), (4.0 * c.base, 5.0 * c.voxel));
        assert_eq!(
            (costs.least_build, costs.pilot_factor, costs.least_pilot),
            (6.0 * c.least_build, 7.0 * c.pilot_factor, 8.0 * c.least_pilot)
        );
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert_eq!(of([1.0, wrong, 1.0, 1.0, 1.0, 1.0, 1.0]), None, "{wrong}");
        }
        assert_eq!(Costs::from_factors(&[0; 55]), None);
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
        assert_eq!((found.cells, found.rays), (2, 40));
    }
}
