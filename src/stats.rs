//! What a run measured: the JSON object of `--stats` (DESIGN section 6) and its table for people.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use crate::Result;
use crate::passes::lookback::Carry;
use crate::passes::tuning::carry_on;
use crate::scene::{Mask, Sampling, Scene, Settings};
use crate::vk::{Context, PipelineStats, Severity, TimedPass, Validation};
use crate::volume::Volume;

/// One run's figures. Times are in milliseconds, sizes in bytes.
#[derive(Clone, Debug, Serialize)]
pub struct Stats {
    /// Where it ran.
    pub device: DeviceStats,
    /// What it rendered.
    pub volume: VolumeStats,
    /// With which knobs.
    pub settings: Settings,
    /// GPU time per pass and iteration.
    pub passes: Vec<PassStats>,
    /// The hash-bucket proxy, one entry per iteration that built one.
    pub proxy: Vec<ProxyStats>,
    /// What the sampling `auto` decided on, and why; absent where there was no gather to decide on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub auto: Option<AutoStats>,
    /// What the path tracer knows of its own errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<PathStats>,
    /// Sum of the passes' GPU times.
    pub gpu_ms: f64,
    /// Elapsed time of the whole render, uploads and shader compilation included.
    pub wall_ms: f64,
    /// The pipelines that were made for it.
    pub pipelines: PipelineStats,
    /// Most device memory that was allocated at one time.
    pub peak_device_bytes: u64,
    /// What the validation layer said.
    pub validation: ValidationStats,
}

/// The Vulkan device of a run.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceStats {
    /// As the driver reports it.
    pub name: String,
    /// Driver name and version.
    pub driver: String,
    /// Invocations per subgroup.
    pub subgroup_size: u32,
    /// How scans and sorts carry sums from tile to tile there.
    pub carry: Carry,
}

/// The volume of a run.
#[derive(Clone, Debug, Serialize)]
pub struct VolumeStats {
    /// File name or `phantom:NAME`.
    pub name: String,
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// Lengths of the voxel steps in world units.
    pub spacing: [f64; 3],
    /// Share of the voxels with extinction above zero.
    pub active_fraction: f64,
}

/// GPU time of one pass in one iteration.
#[derive(Clone, Debug, Serialize)]
pub struct PassStats {
    /// Name of the pass.
    pub name: String,
    /// Scattering order it belongs to; 0 for what runs once.
    pub iteration: u32,
    /// Number of dispatches.
    pub dispatches: u32,
    /// GPU time of them all.
    pub ms: f64,
}

/// The hash-bucket proxy of one iteration.
#[derive(Clone, Debug, Serialize)]
pub struct ProxyStats {
    /// Scattering order it was built for.
    pub iteration: u32,
    /// Voxels that were hashed.
    pub voxels: u64,
    /// Runs of equal hash (first compression).
    pub runs: u64,
    /// Buckets (second compression).
    pub buckets: u64,
    /// Device memory of the proxy.
    pub bytes: u64,
    /// GPU time from hash to decompress.
    pub build_ms: f64,
    /// Mask that the settings asked for: bits of R G B A, or `adaptive:TOLERANCE`.
    pub mask_requested: Mask,
    /// Mask that was used: coarser if the runs would not have fitted.
    pub mask_used: Mask,
    /// Levels of R G B A.
    pub levels: [u32; 4],
    /// Bits of a hash: as many as the combinations of levels need.
    pub hash_bits: u32,
}

/// The sampling `auto`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AutoStats {
    /// What was chosen: `phase` or `residual`.
    pub sampling: Sampling,
    /// M of it; 0 for `phase`.
    pub candidates: u32,
    /// N of it.
    pub directions: u32,
    /// Scattering order whose gather was looked at.
    pub iteration: u32,
    /// Steps of a ray in the data, by the first look.
    pub traced_steps: f64,
    /// What a pilot and its proxy were expected to take, over the time of the gathers that were left with `phase`.
    pub pilot_share: f64,
    /// There is a pilot up to this share, and `phase` without one beyond.
    pub most_pilot_share: f64,
    /// What the pilot found.
    pub pilot: Option<PilotStats>,
}

/// What the pilot of the sampling `auto` found. Variances are per cell and direction, in squares of the scattered light's own
/// unit; costs are per ray in nanoseconds of GPU time, from counted steps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PilotStats {
    /// What `residual` would gain at best: the gathers' time with `phase` over that with `residual`, at the same noise; 0
    /// where that takes more traced directions than `phase`, or more candidates than there may be.
    pub residual_gain: f64,
    /// It is chosen from this gain on.
    pub least_gain: f64,
    /// Of the light of traced directions.
    pub phase_variance: f64,
    /// V0: of their light in the proxy.
    pub proxy_variance: f64,
    /// V1: of traced less proxy.
    pub residual_variance: f64,
    /// Of a traced ray.
    pub phase_cost: f64,
    /// C0: of a ray in the proxy.
    pub proxy_cost: f64,
    /// C1: of both.
    pub residual_cost: f64,
    /// Steps of a traced ray.
    pub traced_steps: f64,
    /// Steps of a ray in the proxy.
    pub proxy_steps: f64,
    /// Cells that it looked at.
    pub cells: u32,
    /// Directions that it followed in all.
    pub rays: u64,
}

/// A batch: the figures of the whole run, and of every frame.
#[derive(Clone, Debug, Serialize)]
pub struct BatchStats {
    /// Of all frames together; settings and volume are those of the first that was rendered. None if none was.
    #[serde(flatten)]
    pub all: Option<Stats>,
    /// In the order of scenes and numbers.
    pub frames: Vec<FrameStats>,
}

/// One frame of a batch.
#[derive(Clone, Debug, Serialize)]
pub struct FrameStats {
    /// Its place among all frames of all scenes.
    #[serde(skip)]
    pub index: usize,
    /// Its scene's name, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// Its number.
    pub frame: u32,
    /// Where its picture is.
    pub file: PathBuf,
    /// How it ended.
    pub outcome: Outcome,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// GPU time of all its passes.
    pub gpu_ms: f64,
    /// GPU time of the pass `camera`.
    pub camera_ms: f64,
    /// From when it was begun until its file was written, other frames' work in between included.
    pub wall_ms: f64,
    /// GPU time per pass and iteration.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub passes: Vec<PassStats>,
}

/// How a frame of a batch ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// Rendered and written.
    Rendered,
    /// It was there already.
    Skipped,
    /// Not written.
    Failed,
}

impl FrameStats {
    /// A frame of which nothing else is known.
    pub fn new(index: usize, scene: Option<String>, frame: u32, file: PathBuf, outcome: Outcome) -> Self {
        let (error, passes) = (None, Vec::new());
        Self { index, scene, frame, file, outcome, error, gpu_ms: 0.0, camera_ms: 0.0, wall_ms: 0.0, passes }
    }

    /// The same, for which these passes were needed.
    pub fn with_passes(self, passes: Vec<PassStats>) -> Self {
        let of = |is: fn(&&PassStats) -> bool| passes.iter().filter(is).map(|p| p.ms).sum();
        let (gpu_ms, camera_ms) = (of(|_| true), of(|p| p.name == "camera"));
        Self { gpu_ms, camera_ms, passes, ..self }
    }

    /// The same, ended now.
    pub fn ended(self, begun: Instant, error: Option<crate::Error>) -> Self {
        let wall_ms = begun.elapsed().as_secs_f64() * 1e3;
        Self { wall_ms, error: error.map(|e| e.to_string()), ..self }
    }

    /// The same in a few words.
    pub fn without_passes(&self) -> Self {
        Self { passes: Vec::new(), ..self.clone() }
    }

    /// `skull, frame 3`.
    pub fn title(&self) -> String {
        let scene = self.scene.as_ref().map_or_else(String::new, |scene| format!("{scene}, "));
        format!("{scene}frame {}", self.frame)
    }
}

impl BatchStats {
    /// The JSON object, indented, with a final line break.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Writes the JSON object to a file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        crate::output::write_atomically(path, self.to_json().as_bytes())
    }
}

/// A path-traced picture.
#[derive(Clone, Debug, Serialize)]
pub struct PathStats {
    /// Samples of every pixel.
    pub samples: u32,
    /// Mean radiance of the picture, per channel.
    pub mean: [f64; 3],
    /// Standard error of `mean`.
    pub mean_error: [f64; 3],
    /// Root mean square of the pixels' standard errors over the mean radiance.
    pub noise: f64,
    /// Mean weight, per sample, of the paths that the event cap cut; their light is missing.
    pub truncated: f64,
}

/// Messages of the validation layer and of Tyndall's own checks.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ValidationStats {
    /// True if validation was on.
    pub enabled: bool,
    /// Number of errors.
    pub errors: u64,
    /// Number of warnings.
    pub warnings: u64,
}

impl DeviceStats {
    /// The device of `ctx`.
    pub fn of(ctx: &Context) -> Self {
        let info = ctx.device_info();
        Self {
            name: info.name.clone(),
            driver: info.driver.clone(),
            subgroup_size: info.subgroup_size,
            carry: carry_on(ctx),
        }
    }
}

impl VolumeStats {
    /// The figures of `volume`, of whose voxels the share `active_fraction` is active.
    pub fn of(volume: &Volume, active_fraction: f64) -> Self {
        Self { name: volume.name.clone(), dims: volume.grid.dims, spacing: volume.grid.spacing(), active_fraction }
    }
}

/// CSV of rows of names and values; the first row's names are its head.
pub fn csv_of<N: AsRef<[u8]>>(rows: impl IntoIterator<Item = Vec<(N, String)>>) -> String {
    let mut csv = csv::Writer::from_writer(Vec::new());
    for (i, columns) in rows.into_iter().enumerate() {
        if i == 0 {
            csv.write_record(columns.iter().map(|c| &c.0)).expect("a vector takes any record");
        }
        csv.write_record(columns.iter().map(|c| &c.1)).expect("a vector takes any record");
    }
    let bytes = csv.into_inner().expect("a vector takes any record");
    String::from_utf8(bytes).expect("CSV of text is text")
}

/// The middle one, or the mean of the two in the middle; 0 of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    if n == 0 { 0.0 } else { 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]) }
}

/// The name that a value has on the command line.
pub fn name_of(value: &impl clap::ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
}

/// Sizes for people: `256x256x108`.
pub fn times<T: ToString>(sizes: &[T]) -> String {
    sizes.iter().map(T::to_string).collect::<Vec<_>>().join("x")
}

/// Times by pass and iteration.
pub fn pass_stats(times: &[TimedPass]) -> Vec<PassStats> {
    let of = |t: &TimedPass| PassStats {
        name: t.name.to_owned(),
        iteration: t.iteration,
        dispatches: t.dispatches,
        ms: t.ms,
    };
    let mut passes = Vec::new();
    for t in times {
        add_passes(&mut passes, &[of(t)]);
    }
    passes
}

/// Adds the times of `more` to those of the same pass and iteration.
pub fn add_passes(passes: &mut Vec<PassStats>, more: &[PassStats]) {
    for pass in more {
        match passes.iter_mut().find(|p| p.name == pass.name && p.iteration == pass.iteration) {
            Some(p) => {
                p.dispatches += pass.dispatches;
                p.ms += pass.ms;
            }
            None => passes.push(pass.clone()),
        }
    }
}

impl Stats {
    /// The figures of a render on `ctx`, of which the caller measured `wall_ms`.
    pub fn new(
        ctx: &Context,
        scene: &Scene,
        volume: VolumeStats,
        passes: Vec<PassStats>,
        proxy: Vec<ProxyStats>,
        wall_ms: f64,
    ) -> Self {
        let messages = ctx.messages();
        let count = |severity| messages.iter().filter(|m| m.severity == severity).count() as u64;
        Self {
            device: DeviceStats::of(ctx),
            volume,
            settings: scene.settings.clone(),
            gpu_ms: passes.iter().map(|p| p.ms).sum(),
            passes,
            proxy,
            auto: None,
            path: None,
            wall_ms,
            pipelines: ctx.pipeline_stats(),
            peak_device_bytes: ctx.peak_bytes(),
            validation: ValidationStats {
                enabled: ctx.validation() != Validation::Off,
                errors: count(Severity::Error),
                warnings: count(Severity::Warning),
            },
        }
    }

    /// The JSON object, indented, with a final line break.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Writes the JSON object to a file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        crate::output::write_atomically(path, self.to_json().as_bytes())
    }

    /// Times and proxy as text for people.
    pub fn table(&self) -> String {
        let mut out = String::new();
        self.print_passes(&mut out)
            .and_then(|()| self.print_proxy(&mut out))
            .and_then(|()| self.print_auto(&mut out))
            .and_then(|()| self.print_path(&mut out))
            .expect("writing to a String cannot fail");
        out
    }

    fn print_passes(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "{:<24} {:>10} {:>12}", "pass", "dispatches", "ms")?;
        let mut rows: Vec<(&str, u32, f64)> = Vec::new();
        for pass in &self.passes {
            match rows.iter_mut().find(|row| row.0 == pass.name) {
                Some(row) => {
                    row.1 += pass.dispatches;
                    row.2 += pass.ms;
                }
                None => rows.push((&pass.name, pass.dispatches, pass.ms)),
            }
        }
        for (name, dispatches, ms) in rows {
            writeln!(out, "{name:<24} {dispatches:>10} {ms:>12.3}")?;
        }
        writeln!(out, "{:<24} {:>10} {:>12.3}", "all on the GPU", "", self.gpu_ms)?;
        writeln!(out, "{:<24} {:>10} {:>12.3}", "elapsed", "", self.wall_ms)?;
        let PipelineStats { made, cached, ms } = self.pipelines;
        writeln!(out, "pipelines: {made} made in {ms:.0} ms, {cached} of them from the cache on disk")?;
        writeln!(out, "device memory at its peak: {}", mebibytes_text(self.peak_device_bytes))
    }

    fn print_auto(&self, out: &mut String) -> std::fmt::Result {
        let Some(auto) = &self.auto else { return Ok(()) };
        let Some(pilot) = &auto.pilot else {
            let [share, most] = [auto.pilot_share, auto.most_pilot_share].map(|share| 100.0 * share);
            return writeln!(
                out,
                "\nauto: phase, since a pilot and its proxy would take {share:.0} % of the time of the gathers left; at most \
                 {most:.0} % are tried"
            );
        };
        match auto.sampling {
            Sampling::Residual => write!(
                out,
                "\nauto: residual, {} directions and {} in the proxy, expected to take {:.2} of the time of phase",
                auto.directions,
                auto.candidates,
                1.0 / pilot.residual_gain
            )?,
            _ if pilot.residual_gain > 0.0 => {
                write!(out, "\nauto: phase, since residual would only be {:.2} times as fast", pilot.residual_gain)?;
            }
            _ => write!(out, "\nauto: phase, since residual would be noisier")?,
        }
        let [v0, v1] = [pilot.proxy_variance, pilot.residual_variance].map(|v| v / pilot.phase_variance);
        let [c0, c1] = [pilot.proxy_cost, pilot.residual_cost].map(|c| c / pilot.phase_cost);
        let cells = pilot.cells;
        writeln!(out, "; relative to a traced ray V0 {v0:.2}, V1 {v1:.2}, C0 {c0:.2}, C1 {c1:.2}; {cells} cells")
    }

    fn print_path(&self, out: &mut String) -> std::fmt::Result {
        let Some(path) = &self.path else { return Ok(()) };
        let [r, g, b] = path.mean;
        let [er, eg, eb] = path.mean_error;
        writeln!(out, "\nsamples per pixel {}; noise {:.4} % of the mean radiance", path.samples, 100.0 * path.noise)?;
        writeln!(out, "mean radiance {r:.6e} {g:.6e} {b:.6e}, standard errors {er:.1e} {eg:.1e} {eb:.1e}")?;
        if path.truncated > 0.0 {
            writeln!(
                out,
                "the event cap cut paths of a mean weight of {:.3e}: their light is missing",
                path.truncated
            )?;
        }
        Ok(())
    }

    fn print_proxy(&self, out: &mut String) -> std::fmt::Result {
        if self.proxy.is_empty() {
            return Ok(());
        }
        writeln!(
            out,
            "\n{:<6} {:>11} {:>11} {:>9} {:>10} {:>10} {:>5}  mask",
            "proxy", "voxels", "runs", "buckets", "MiB", "build ms", "bits"
        )?;
        for p in &self.proxy {
            write!(
                out,
                "{:<6} {:>11} {:>11} {:>9} {:>10.2} {:>10.3} {:>5}  {}",
                p.iteration,
                p.voxels,
                p.runs,
                p.buckets,
                mebibytes(p.bytes),
                p.build_ms,
                p.hash_bits,
                mask_text(p.mask_used)
            )?;
            if p.mask_used != p.mask_requested {
                write!(out, " (coarser than the {} asked for: too many runs)", mask_text(p.mask_requested))?;
            }
            writeln!(out)?;
        }
        Ok(())
    }
}

/// Any serialisable value as indented JSON with a final line break. Infinite and NaN figures become `null`.
pub fn to_json(value: &impl Serialize) -> String {
    let mut json = serde_json::to_string_pretty(value).expect("figures with string keys always serialise");
    json.push('\n');
    json
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

/// `12.3 MiB`.
pub fn mebibytes_text(bytes: u64) -> String {
    format!("{:.1} MiB", mebibytes(bytes))
}

/// `F0F0F0F0`: the bits of R, G, B, A in hexadecimal; an adaptive mask as it is written.
fn mask_text(mask: Mask) -> String {
    match mask {
        Mask::Channels(bits) => bits.map(|m| format!("{m:02X}")).concat(),
        Mask::Adaptive(_) => mask.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(median(&[]), 0.0);
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 9.0]), 3.0);
    }

    fn example() -> Stats {
        let pass = |name: &str, iteration, ms| PassStats { name: name.into(), iteration, dispatches: 2, ms };
        Stats {
            device: DeviceStats { name: "d".into(), driver: "v".into(), subgroup_size: 8, carry: Carry::LookBack },
            volume: VolumeStats {
                name: "phantom:x".into(),
                dims: [3, 5, 7],
                spacing: [1.0, 1.0, 2.0],
                active_fraction: 0.25,
            },
            settings: Settings::default(),
            passes: vec![pass("gather", 2, 1.5), pass("hash", 2, 0.25), pass("gather", 3, 2.0)],
            proxy: vec![ProxyStats {
                iteration: 2,
                voxels: 105,
                runs: 50,
                buckets: 9,
                bytes: 1 << 20,
                build_ms: 0.5,
                mask_requested: Mask::Channels([255; 4]),
                mask_used: Mask::Channels([0xF0; 4]),
                levels: [16; 4],
                hash_bits: 16,
            }],
            auto: None,
            path: None,
            gpu_ms: 3.75,
            wall_ms: 10.0,
            pipelines: PipelineStats::default(),
            peak_device_bytes: 3 << 20,
            validation: ValidationStats::default(),
        }
    }

    #[test]
    fn json_has_the_documented_fields() {
        let json: serde_json::Value = serde_json::from_str(&example().to_json()).unwrap();
        for pointer in [
            "/device/name",
            "/device/driver",
            "/device/subgroup_size",
            "/device/carry",
            "/volume/name",
            "/volume/dims/2",
            "/volume/spacing/2",
            "/volume/active_fraction",
            "/settings/orders",
            "/passes/0/name",
            "/passes/0/iteration",
            "/passes/0/dispatches",
            "/passes/0/ms",
            "/proxy/0/iteration",
            "/proxy/0/voxels",
            "/proxy/0/runs",
            "/proxy/0/buckets",
            "/proxy/0/bytes",
            "/proxy/0/build_ms",
            "/proxy/0/mask_requested/3",
            "/proxy/0/mask_used/3",
            "/proxy/0/levels/3",
            "/proxy/0/hash_bits",
            "/gpu_ms",
            "/wall_ms",
            "/pipelines/made",
            "/pipelines/cached",
            "/pipelines/ms",
            "/peak_device_bytes",
            "/validation/enabled",
            "/validation/errors",
            "/validation/warnings",
        ] {
            assert!(json.pointer(pointer).is_some(), "{pointer} is missing in {json:#}");
        }
    }

    #[test]
    fn table_sums_iterations_and_reports_a_coarser_mask() {
        let table = example().table();
        let gather = table.lines().find(|l| l.starts_with("gather")).unwrap();
        assert_eq!(gather.split_whitespace().collect::<Vec<_>>(), ["gather", "4", "3.500"]);
        assert!(table.contains("F0F0F0F0 (coarser than the FFFFFFFF asked for"), "{table}");
    }
}
