//! Checks of a device against known numbers: closed forms, reference values, exact integers. `tyndall verify` runs them.
//!
//! Every check states what it tolerates and why. Monte Carlo results are allowed four of their own standard errors.

pub mod bodies;
mod furnace;
mod lookback;
mod orders;
pub mod phase;
pub mod single;
mod transmittance;
mod voxels;

use crate::Result;
use crate::cpu::rng;
use crate::output::Picture;
use crate::render::path::{Estimate, PathRender};
use crate::render::{Internals, Progress, Renderer};
use crate::scene::Scene;
use crate::stats::DeviceStats;
use crate::vk::Context;
use glam::Vec4;
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::Instant;

/// Standard errors that a Monte Carlo mean may be off: chance exceeds them once in 16,000 checks.
const SIGMAS: f64 = 4.0;

/// What single precision adds to a path's radiance, relative: in the geometry and in every scattering.
const ROUNDING: f64 = 2e-6;

/// Why Monte Carlo results have the tolerance that they have.
const STATISTICAL: &str = "4 standard errors of the estimate (exceeded by chance once in 16,000) and 2e-6 of rounding";

/// A part of the checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// Scan and sort against the CPU, and their progress when tiles are suspended.
    Primitives,
    /// Phase function: normalisation, mean cosine, sampler.
    Phase,
    /// exp(−τ).
    Transmittance,
    /// Light scattered once, in closed form.
    Single,
    /// Slabs, order by order.
    Orders,
    /// One voxel or many of the same value.
    Voxels,
    /// Uniform light from all around: a white body is not seen.
    Furnace,
    /// Fails always, to show that a failure is noticed. No part of [`Group::ALL`].
    #[value(hide = true)]
    Canary,
}

impl Group {
    /// What `tyndall verify` runs.
    pub const ALL: [Group; 7] = [
        Group::Primitives,
        Group::Phase,
        Group::Transmittance,
        Group::Single,
        Group::Orders,
        Group::Voxels,
        Group::Furnace,
    ];

    /// For the progress bar.
    fn phase(self) -> &'static str {
        match self {
            Group::Primitives => "scan and sort",
            Group::Phase => "phase function",
            Group::Transmittance => "transmittance",
            Group::Single => "single scattering",
            Group::Orders => "orders of slabs",
            Group::Voxels => "voxels",
            Group::Furnace => "white furnace",
            Group::Canary => "canary",
        }
    }

    /// Rough share of the time.
    fn weight(self) -> f64 {
        match self {
            Group::Primitives => 2.0,
            Group::Phase => 1.0,
            Group::Transmittance => 3.0,
            Group::Single => 5.0,
            Group::Orders => 9.0,
            Group::Voxels => 8.0,
            Group::Furnace => 10.0,
            Group::Canary => 0.0,
        }
    }

    fn run(self, bench: &mut Bench<'_>) -> Result<()> {
        match self {
            Group::Primitives => lookback::run(bench),
            Group::Phase => phase::run(bench),
            Group::Transmittance => transmittance::run(bench),
            Group::Single => single::run(bench),
            Group::Orders => orders::run(bench),
            Group::Voxels => voxels::run(bench),
            Group::Furnace => furnace::run(bench),
            Group::Canary => {
                bench.check("one is two".into(), 1.0, 2.0, 0.5, "wrong on purpose");
                Ok(())
            }
        }
    }
}

/// One number and what it should be.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// The part it belongs to.
    pub group: Group,
    /// What was measured.
    pub case: String,
    /// What came out.
    pub value: f64,
    /// What should.
    pub expected: f64,
    /// Largest difference that passes; 0 = none.
    pub tolerance: f64,
    /// Why the tolerance is what it is.
    pub why: &'static str,
}

impl Check {
    /// Whether the value is within the tolerance; NaN is not.
    pub fn passes(&self) -> bool {
        (self.value - self.expected).abs() <= self.tolerance
    }
}

/// All checks of a run.
#[derive(Clone, Debug)]
pub struct Report {
    /// Where it ran.
    pub device: DeviceStats,
    /// Fixes every random number.
    pub seed: u64,
    /// In the order in which they were made.
    pub checks: Vec<Check>,
    /// Elapsed time.
    pub seconds: f64,
}

impl Report {
    /// Checks that do not pass.
    pub fn failures(&self) -> usize {
        self.checks.iter().filter(|c| !c.passes()).count()
    }

    /// Whether there are checks and all of them pass.
    pub fn passes(&self) -> bool {
        !self.checks.is_empty() && self.failures() == 0
    }
}

/// Runs the checks of `groups`. `progress` is called before each of them.
///
/// Errors: the device cannot hold a scene, or fails.
pub fn run(ctx: &Context, seed: u64, groups: &[Group], progress: &mut dyn FnMut(Progress)) -> Result<Report> {
    let start = Instant::now();
    let total: f64 = groups.iter().map(|g| g.weight()).sum();
    let mut done = 0.0;
    let mut bench = Bench { ctx, seed, group: Group::Canary, checks: Vec::new() };
    for &group in groups {
        progress(Progress { done: done / total.max(1.0), phase: group.phase() });
        bench.group = group;
        group.run(&mut bench)?;
        done += group.weight();
    }
    let device = DeviceStats::of(ctx);
    Ok(Report { device, seed, checks: bench.checks, seconds: start.elapsed().as_secs_f64() })
}

/// What the groups work with.
struct Bench<'a> {
    ctx: &'a Context,
    seed: u64,
    group: Group,
    checks: Vec<Check>,
}

impl Bench<'_> {
    /// Notes a check.
    fn check(&mut self, case: String, value: f64, expected: f64, tolerance: f64, why: &'static str) {
        self.checks.push(Check { group: self.group, case, value, expected, tolerance, why });
    }

    /// Notes the first channel of a path-traced mean.
    fn check_path(&mut self, case: String, estimate: &Estimate, expected: f64) {
        let tolerance = SIGMAS * estimate.mean_error[0] + ROUNDING * expected;
        self.check(case, estimate.mean[0], expected, tolerance, STATISTICAL);
    }

    /// Random words that the seed fixes; `stream` tells uses apart.
    fn words(&self, stream: u32, n: usize) -> impl Iterator<Item = u32> {
        let key = rng::stream_key(0, stream, self.seed as u32, (self.seed >> 32) as u32);
        (0..n as u32).map(move |i| rng::random_word(key, i))
    }

    /// Mean of a picture by the scene's model, which is not `path`.
    fn render(&self, scene: &Scene) -> Result<Vec4> {
        let picture: Picture = Renderer::new(self.ctx, scene, Internals::default())?
            .render(self.seed, &mut |_| ControlFlow::Continue(()))?;
        Ok(bodies::mean(&picture))
    }

    /// The scene path-traced with `samples` of every pixel.
    fn trace(&self, scene: &Scene, samples: u32) -> Result<Estimate> {
        let mut scene = scene.clone();
        scene.settings.seed = self.seed;
        let mut render = PathRender::new(self.ctx, &scene)?;
        render.advance(samples, &mut |_| ControlFlow::Continue(()))?;
        Ok(render.sums()?.estimate(scene.settings.size))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::lookback::Carry;

    fn check(value: f64, expected: f64, tolerance: f64) -> Check {
        Check { group: Group::Canary, case: "case".into(), value, expected, tolerance, why: "test" }
    }

    #[test]
    fn a_check_fails_beyond_its_tolerance_and_without_a_number() {
        assert!(check(1.0, 1.5, 0.5).passes() && check(2.0, 2.0, 0.0).passes());
        for (value, expected, tolerance) in [
            (1.0, 1.6, 0.5),
            (2.2, 1.6, 0.5),
            (f64::NAN, 1.0, 10.0),
            (1.0, f64::NAN, 10.0),
            (1.0, 1.0, f64::NAN),
            (f64::INFINITY, 1.0, 1e300),
            (f64::INFINITY, f64::INFINITY, 1.0),
        ] {
            assert!(!check(value, expected, tolerance).passes(), "{value} {expected} {tolerance}");
        }
        let device = DeviceStats { name: "d".into(), driver: "v".into(), subgroup_size: 8, carry: Carry::LookBack };
        let report = |checks| Report { device: device.clone(), seed: 0, checks, seconds: 0.0 };
        assert!(report(vec![check(1.0, 1.0, 0.0)]).passes());
        assert!(!report(vec![check(1.0, 1.0, 0.0), check(f64::NAN, 1.0, 1.0)]).passes());
        assert!(!report(vec![]).passes(), "nothing was checked");
    }
}
