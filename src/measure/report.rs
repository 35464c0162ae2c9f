//! What a sweep found, for people and for programs: table, CSV, JSON, plots, and one page that needs nothing else.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use clap::ValueEnum as _;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

use super::front::{Goal, Point, front, recommend};
use super::knobs::{self, Knob};
use super::plot::{self, Mark, Panel};
use super::seeds::SeedErrors;
use super::sweep::{Clock, Effort, PassTime, Sweep};
use crate::output::{self, Picture, PngOptions};
use crate::scene::Settings;
use crate::stats::{DeviceStats, csv_of, times, to_json};
use crate::{Error, Result};

/// The JSON object of a sweep.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Version of Tyndall.
    version: &'static str,
    /// Where it ran.
    device: DeviceStats,
    /// Name of the volume.
    volume: String,
    /// Its voxels.
    dims: [u32; 3],
    /// Pixels.
    size: [u32; 2],
    /// The scene's own settings.
    own: Settings,
    /// What `time` is.
    clock: Clock,
    /// Pictures per setting.
    seeds: u32,
    /// What the references were to be.
    reference_effort: Effort,
    /// Samples per pixel of the two.
    reference_samples: [u32; 2],
    /// Their noise, relative to the mean radiance.
    reference_noise: [f64; 2],
    /// Settings of the whole plan.
    planned: usize,
    /// The measured ones, the scene's own first.
    settings: Vec<Entry>,
    /// Those on the front, the fastest first: indices of `settings`.
    front: Vec<usize>,
    /// What the goals led to.
    recommended: Vec<Recommended>,
}

/// A measured setting.
#[derive(Debug, Serialize)]
struct Entry {
    /// The knobs of which it is a value; none: a point of the grid.
    knobs: Vec<Knob>,
    /// Flags that turn the scene's own settings into these.
    flags: String,
    settings: Settings,
    /// Root of the relMSE of one picture.
    error: f64,
    bias: f64,
    noise: f64,
    errors: SeedErrors,
    /// Seconds by the report's clock, the least of the seeds'.
    time: f64,
    gpu_ms: Vec<f64>,
    processor_ms: Vec<f64>,
    passes: Vec<PassTime>,
    wall_ms: f64,
    /// Other orders than the scene's are another truth: no part of the front.
    is_same_truth: bool,
    /// Index of an earlier setting with the same pictures, as `auto` has where it is `phase`. It counts instead: that this one took
    /// less time is chance.
    same_as: Option<usize>,
    on_front: bool,
    /// The picture of the first seed.
    picture: PathBuf,
}

/// The setting for a goal.
#[derive(Debug, Serialize)]
struct Recommended {
    goal: Goal,
    /// Does it meet the goal, or only come nearest?
    is_met: bool,
    /// Index of the setting.
    setting: usize,
    flags: String,
    /// Lines of a scene file.
    scene: Vec<String>,
}

impl Entry {
    fn label(&self) -> &str {
        if self.flags.is_empty() { "the scene's own" } else { &self.flags }
    }

    fn point(&self) -> Point {
        Point { time: self.time, error: self.error }
    }

    /// `0.41 %`, or `< 0.2 %` where it may be chance.
    fn bias_text(&self) -> String {
        if self.errors.bias_is_seen() { percent(self.bias) } else { format!("< {}", percent(self.errors.bias_bound())) }
    }

    /// Names and values of the CSV.
    fn columns(&self) -> Vec<(String, String)> {
        let swept: Vec<_> = self.knobs.iter().map(|k| k.flag()).collect();
        let mut columns = vec![("knobs".to_owned(), swept.join(" ")), ("flags".to_owned(), self.flags.clone())];
        columns.extend(Knob::value_variants().iter().map(|k| (k.field(), k.value(&self.settings))));
        let e = &self.errors;
        let figures = [
            ("error", self.error),
            ("bias", self.bias),
            ("noise", self.noise),
            ("rel_mse", e.rel_mse),
            ("bias_squared", e.bias_squared),
            ("bias_squared_error", e.bias_squared_error),
            ("noise_squared", e.noise_squared),
            ("bias_red", e.bias[0]),
            ("bias_green", e.bias[1]),
            ("bias_blue", e.bias[2]),
            ("block_bias", e.block_bias),
            ("time", self.time),
            ("wall_ms", self.wall_ms),
        ];
        columns.extend(figures.map(|(name, figure)| (name.to_owned(), figure.to_string())));
        columns.push(("same_as".to_owned(), self.same_as.map_or(String::new(), |i| i.to_string())));
        let flags = [("same_truth", self.is_same_truth), ("on_front", self.on_front)];
        columns.extend(flags.map(|(name, flag)| (name.to_owned(), flag.to_string())));
        columns
    }

    fn mark(&self, label: String) -> Mark {
        let group = Knob::Sampling.value(&self.settings);
        Mark { point: self.point(), bias: self.bias, label, group, is_own: self.flags.is_empty() }
    }
}

impl Goal {
    fn text(self, clock: Clock) -> String {
        match self {
            Goal::Error(most) => format!("error of at most {}", percent(most)),
            Goal::Time(most) => format!("{} of at most {}", clock.name(), seconds(most)),
        }
    }
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

fn seconds(time: f64) -> String {
    format!("{time:.3} s")
}

impl Report {
    /// The report of what is measured so far: at least the scene's own settings. Without goals it asks for as little
    /// error, and for as little time, as the scene's own settings have.
    pub fn new(sweep: &Sweep<'_>, goals: &[Goal], clock: Clock) -> Self {
        let own = sweep.base();
        let entry = |row: super::sweep::Row<'_>| {
            let (record, settings) = (row.record, &row.setting.settings);
            Entry {
                knobs: row.setting.knobs.clone(),
                flags: knobs::flags(own, settings),
                error: record.errors.error(),
                bias: record.errors.bias_rms(),
                noise: record.errors.noise_rms(),
                errors: record.errors,
                time: record.time(clock) / 1e3,
                gpu_ms: record.gpu_ms.clone(),
                processor_ms: record.processor_ms.clone(),
                passes: record.passes.clone(),
                wall_ms: record.wall_ms,
                is_same_truth: settings.orders == own.orders,
                same_as: None,
                on_front: false,
                picture: row.picture,
                settings: settings.clone(),
            }
        };
        let mut settings: Vec<Entry> = sweep.rows().into_iter().map(entry).collect();
        for i in 1..settings.len() {
            // Every figure of `SeedErrors` is of all pixels, and the same to the last bit.
            settings[i].same_as = (0..i).find(|&before| settings[before].errors == settings[i].errors);
        }
        let candidate = |e: &Entry| {
            let counts = e.is_same_truth && e.same_as.is_none();
            Point { time: e.time, error: if counts { e.error } else { f64::INFINITY } }
        };
        let points: Vec<Point> = settings.iter().map(candidate).collect();
        let front = front(&points);
        for &i in &front {
            settings[i].on_front = true;
        }
        let own_goals = [Goal::Error(points[0].error), Goal::Time(points[0].time)];
        let goals = if goals.is_empty() { &own_goals[..] } else { goals };
        let recommended = goals.iter().filter_map(|&goal| {
            let (setting, is_met) = recommend(&points, goal)?;
            let scene = knobs::toml_lines(own, &settings[setting].settings);
            Some(Recommended { goal, is_met, setting, flags: settings[setting].flags.clone(), scene })
        });
        let [a, b] = sweep.references();
        Self {
            version: env!("CARGO_PKG_VERSION"),
            device: sweep.device(),
            volume: sweep.scene().volume.name.clone(),
            dims: sweep.scene().volume.grid.dims,
            size: own.size,
            own: own.clone(),
            clock,
            seeds: sweep.options().seeds,
            reference_effort: sweep.options().effort,
            reference_samples: [a.samples, b.samples],
            reference_noise: [a.noise, b.noise],
            planned: sweep.planned(),
            recommended: recommended.collect(),
            settings,
            front,
        }
    }

    /// Writes `results.csv`, `results.json`, `front.svg`, `knobs.svg` and `index.html` into the sweep's folder.
    ///
    /// Errors: a file cannot be written, or a picture of the sweep cannot be read.
    pub fn write(&self, folder: &Path, reference: &(Picture, PngOptions)) -> Result<()> {
        let write = |name: &str, text: &str| output::write_atomically(&folder.join(name), text.as_bytes());
        let (front, knobs) = (self.front_plot(), self.knob_plot());
        write("results.csv", &self.csv())?;
        write("results.json", &self.to_json())?;
        write("front.svg", &front)?;
        write("knobs.svg", &knobs)?;
        write("index.html", &self.page([&front, &knobs], reference)?)
    }

    /// The JSON object.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    fn front_plot(&self) -> String {
        let kept: Vec<usize> = (0..self.settings.len()).filter(|&i| self.settings[i].is_same_truth).collect();
        let marks: Vec<Mark> =
            kept.iter().map(|&i| self.settings[i].mark(self.settings[i].label().to_owned())).collect();
        let front: Vec<usize> = self.front.iter().filter_map(|i| kept.iter().position(|k| k == i)).collect();
        plot::front_plot(&marks, &front, self.clock.name())
    }

    fn knob_plot(&self) -> String {
        let panel = |knob: &Knob| {
            let mut entries: Vec<&Entry> = self.settings.iter().filter(|e| e.knobs.contains(knob)).collect();
            let number = |e: &&Entry| knob.value(&e.settings).parse::<f64>().unwrap_or(0.0);
            entries.sort_by(|a, b| number(a).total_cmp(&number(b)));
            let marks: Vec<Mark> = entries.iter().map(|e| e.mark(knob.value(&e.settings))).collect();
            (marks.len() > 1).then(|| Panel { title: knob.flag(), marks })
        };
        let panels: Vec<Panel> = Knob::value_variants().iter().filter_map(panel).collect();
        plot::knob_plot(&panels, self.clock.name())
    }

    fn csv(&self) -> String {
        csv_of(self.settings.iter().map(|e| e.columns()))
    }

    /// What was measured, against what.
    fn summary(&self) -> String {
        let [a, b] = self.reference_samples;
        format!(
            "{} {}, {} pixels, orders {}; {} of {} settings, {} seeds each, against path with {a} and {b} samples \
             (noise {}); on {} ({})",
            self.volume,
            times(&self.dims),
            times(&self.size),
            self.own.orders,
            self.settings.len(),
            self.planned,
            self.seeds,
            percent(self.reference_noise[0].max(self.reference_noise[1])),
            self.device.name,
            self.device.driver
        )
    }

    /// The front and what is recommended, for a terminal.
    pub fn text(&self) -> String {
        let mut lines = vec![
            self.summary(),
            String::new(),
            "No other setting is both faster and more accurate (error: root of relMSE, bias and noise together):"
                .into(),
            format!("{:>14} {:>10} {:>10} {:>10}  {}", self.clock.name(), "error", "bias", "noise", "flags"),
        ];
        for &i in &self.front {
            let e = &self.settings[i];
            let (time, error, noise) = (seconds(e.point().time), percent(e.error), percent(e.noise));
            lines.push(format!("{time:>14} {error:>10} {:>10} {noise:>10}  {}", e.bias_text(), e.label()));
        }
        for r in &self.recommended {
            let e = &self.settings[r.setting];
            let verdict = if r.is_met { "" } else { " (nothing measured meets it; this comes nearest)" };
            let (time, error) = (seconds(e.point().time), percent(e.error));
            lines.push(String::new());
            lines.push(format!("{}{verdict}: {time}, {error}", r.goal.text(self.clock)));
            lines.push(format!("  flags: {}", if r.flags.is_empty() { "none, as it is" } else { &r.flags }));
            if !r.scene.is_empty() {
                lines.push("  scene file:".into());
                lines.extend(["[render]".to_owned()].iter().chain(&r.scene).map(|line| format!("    {line}")));
            }
        }
        lines.push(String::new());
        lines.join("\n")
    }

    /// `plots` are SVG.
    fn page(&self, plots: [&str; 2], (reference, png): &(Picture, PngOptions)) -> Result<String> {
        let image = |bytes: &[u8], text: &str| {
            let data = base64::engine::general_purpose::STANDARD.encode(bytes);
            html! { figure { img src=(format!("data:image/png;base64,{data}")) alt=(text); figcaption { (text) } } }
        };
        let mut shown = self.front.clone();
        if !shown.contains(&0) {
            shown.push(0);
        }
        let mut pictures = vec![image(&output::encode_8_bit_png(reference, png)?, "path, the reference")];
        for i in shown {
            let e = &self.settings[i];
            let bytes = std::fs::read(&e.picture).map_err(|error| Error::io(&e.picture, "read", error))?;
            let text = format!("{}: {}, error {}", e.label(), seconds(e.point().time), percent(e.error));
            pictures.push(image(&bytes, &text));
        }
        let [front, knobs] = plots;
        let title = format!("Accuracy against time: {}", self.volume);
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head { meta charset="utf-8"; title { (title) } style { (PreEscaped(STYLE)) } }
                body {
                    h1 { (title) }
                    p { (self.summary()) }
                    h2 { "Recommended" }
                    @for r in &self.recommended { (self.recommended(r)) }
                    h2 { "Error against time" }
                    p {
                        "Error is the root of relMSE of one picture: bias and noise together, without the references' "
                        "noise. The line is the Pareto front: no other setting is both faster and more accurate."
                    }
                    (PreEscaped(front))
                    h2 { "Pictures" }
                    div.pictures { @for picture in &pictures { (picture) } }
                    h2 { "Each knob alone" }
                    p {
                        "Dots are the error, rings the bias, which more directions or rays do not take away; a ring at the "
                        "foot is a bias of nothing. Black: the scene's own settings. Other orders than the scene's are "
                        "another truth: their error is what cutting the series there costs against the scene's own orders."
                    }
                    (PreEscaped(knobs))
                    h2 { "All settings" }
                    (self.table())
                }
            }
        };
        Ok(page.into_string())
    }

    fn recommended(&self, r: &Recommended) -> Markup {
        let e = &self.settings[r.setting];
        html! {
            h3 { (r.goal.text(self.clock)) @if !r.is_met { " (nothing measured meets it; this comes nearest)" } }
            p { (seconds(e.point().time)) ", error " (percent(e.error)) }
            @if r.flags.is_empty() { p { "The scene's own settings." } } @else {
                pre { code { (r.flags) } }
                pre { code { "[render]" @for line in &r.scene { "\n" (line) } } }
            }
        }
    }

    fn table(&self) -> Markup {
        html! {
            table {
                thead { tr {
                    @for name in ["setting", self.clock.name(), "error", "bias", "noise", "R", "G", "B", "on the front"] {
                        th { (name) }
                    }
                } }
                tbody { @for e in &self.settings { tr.front[e.on_front] {
                    td { code { (e.label()) } }
                    td { (seconds(e.point().time)) }
                    td { (percent(e.error)) }
                    td { (e.bias_text()) }
                    td { (percent(e.noise)) }
                    @for bias in e.errors.bias { td { (format!("{:+.2} %", 100.0 * bias)) } }
                    td {
                        @if e.on_front { "yes" }
                        @else if !e.is_same_truth { "other orders" }
                        @else if e.same_as.is_some() { "same pictures as one above" }
                    }
                } } }
            }
        }
    }
}

const STYLE: &str = "\
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1060px; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; } th, td { padding: 2px 10px; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; } tr.front { background: #eef4ff; }
pre { background: #f4f4f4; padding: 6px 10px; overflow-x: auto; } svg { max-width: 100%; height: auto; }
.pictures { display: flex; flex-wrap: wrap; gap: 10px; } figure { margin: 0; width: 190px; }
figure img { width: 100%; image-rendering: pixelated; background: #888; } figcaption { font-size: 12px; }
";
