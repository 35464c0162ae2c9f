//! The knobs of `--model multiple` that trade accuracy for time: which values a sweep tries, and how they are written.

use clap::ValueEnum;
use serde::Serialize;
use serde_json::Value;

use crate::scene::{Environment, Mask, Precision, Sampling, Scene, Settings};
use crate::stats::name_of;

/// A knob, named as its flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knob {
    /// N; candidates keep their ratio to it.
    Directions,
    /// M.
    Candidates,
    /// Every mode there is.
    Sampling,
    /// Camera rays per pixel.
    Spp,
    /// Share of the directions that gathers before the last one get.
    InnerShare,
    /// Directions that sample the environment, where no gather brings it.
    EnvironmentDirections,
    /// Share of the directions that unseen cells get.
    HiddenShare,
    /// Step of gather and shadow rays.
    GatherStep,
    /// Step of camera rays.
    CameraStep,
    /// Step of proxy rays.
    ProxyStep,
    /// Floats that fields are stored as.
    Precision,
    /// Blocks that light is computed in.
    LightGrid,
    /// Steps of the solution for stored light.
    ProjectionSteps,
    /// Share of `resample`'s draw that ignores the proxy.
    Defence,
    /// Bits that the proxy keeps, or the tolerance of levels chosen from the data.
    Mask,
    /// Scattering orders: other orders are another truth, so their error is what truncation costs.
    Orders,
}

/// The knobs whose values are tried together.
const GRID: [Knob; 3] = [Knob::Directions, Knob::Spp, Knob::Sampling];

/// Settings to measure, and which curves they are on.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The settings.
    pub settings: Settings,
    /// The knobs of which they are a value; all for the scene's own settings, none for most of the grid.
    pub knobs: Vec<Knob>,
}

impl Knob {
    /// Its name on the command line.
    pub fn flag(self) -> String {
        name_of(&self)
    }

    /// Its name in scene files.
    pub fn field(self) -> String {
        self.flag().replace('-', "_")
    }

    /// Does it change anything in this scene?
    pub fn is_used(self, scene: &Scene) -> bool {
        match self {
            Knob::InnerShare => scene.settings.orders > 1,
            Knob::EnvironmentDirections => match scene.environment {
                None => false,
                Some(Environment::Constant(_)) => scene.settings.orders == 1,
                Some(Environment::LatLong(_)) => true,
            },
            Knob::Candidates => !matches!(scene.settings.sampling, Sampling::Phase | Sampling::Auto),
            Knob::Defence => scene.settings.sampling == Sampling::Resample,
            Knob::ProxyStep | Knob::Mask => scene.settings.sampling.uses_proxy(),
            _ => true,
        }
    }

    /// Its value as it is written on the command line.
    pub fn value(self, settings: &Settings) -> String {
        if self == Knob::Mask {
            return settings.mask.to_string();
        }
        // As text first: a float becomes the shortest decimal that means it.
        let json = serde_json::to_string(settings).expect("settings always serialise");
        let json: Value = serde_json::from_str(&json).expect("JSON that was just written");
        match &json[self.field()] {
            Value::String(text) => text.clone(),
            number => number.to_string(),
        }
    }

    /// `base` with other values of this knob. `coarse`: the few that the grid takes.
    fn variants(self, base: &Settings, coarse: bool) -> Vec<Settings> {
        let with = |change: &dyn Fn(&mut Settings)| {
            let mut settings = base.clone();
            change(&mut settings);
            settings
        };
        let counts = |now: u32, most: u32, factors: &[f64], change: &dyn Fn(&mut Settings, u32)| {
            let count = |factor: &f64| ((f64::from(now) * factor).round() as u32).clamp(1, most);
            factors.iter().map(|factor| with(&|s| change(s, count(factor)))).collect::<Vec<_>>()
        };
        let floats = |now: f32, range: [f32; 2], factors: &[f32], change: &dyn Fn(&mut Settings, f32)| {
            let value = |factor: &f32| (now * factor).clamp(range[0], range[1]);
            factors.iter().map(|factor| with(&|s| change(s, value(factor)))).collect::<Vec<_>>()
        };
        let step = [0.1, 8.0];
        match self {
            Knob::Directions => {
                let factors: &[f64] = if coarse { &[0.25, 2.0] } else { &[0.25, 0.5, 2.0, 4.0] };
                let ratio = f64::from(base.candidates) / f64::from(base.directions);
                counts(base.directions, 1024, factors, &|s, n| {
                    s.directions = n;
                    s.candidates = ((f64::from(n) * ratio).round() as u32).clamp(1, 1024);
                })
            }
            Knob::Candidates => counts(base.directions, 1024, &[1.0, 2.0, 4.0], &|s, m| s.candidates = m),
            Knob::Sampling => Sampling::value_variants()
                .iter()
                .map(|&mode| {
                    with(&|s| {
                        s.sampling = mode;
                        // `phase` may have had fewer, since it needs none.
                        s.candidates = s.candidates.max(s.directions);
                    })
                })
                .collect(),
            Knob::Spp => {
                let factors: &[f64] = if coarse { &[0.25] } else { &[0.125, 0.25, 0.5, 2.0] };
                counts(base.spp, 65536, factors, &|s, n| s.spp = n)
            }
            Knob::EnvironmentDirections => {
                counts(base.environment_directions, 1024, &[0.125, 0.25, 0.5, 2.0], &|s, n| {
                    s.environment_directions = n
                })
            }
            Knob::InnerShare => [1.0, 0.5, 0.33, 0.2].iter().map(|share| with(&|s| s.inner_share = *share)).collect(),
            Knob::HiddenShare => {
                let share = |share: &f32| with(&|s| s.hidden_share = *share);
                [1.0, 0.5, 0.25, 0.125].iter().map(share).collect()
            }
            Knob::GatherStep => floats(base.gather_step, step, &[2.0, 0.5], &|s, v| s.gather_step = v),
            Knob::CameraStep => floats(base.camera_step, step, &[2.0, 0.5], &|s, v| s.camera_step = v),
            Knob::ProxyStep => floats(base.proxy_step, step, &[2.0, 0.5], &|s, v| s.proxy_step = v),
            Knob::Precision => {
                Precision::value_variants().iter().map(|&precision| with(&|s| s.precision = precision)).collect()
            }
            Knob::LightGrid => (1..=3).map(|edge| with(&|s| s.light_grid = edge)).collect(),
            Knob::ProjectionSteps => {
                let steps = |steps: &u32| with(&|s| s.projection_steps = *steps);
                [4, 6, 12].iter().map(steps).collect()
            }
            Knob::Defence => [0.2, 0.5, 0.8].iter().map(|share| with(&|s| s.defence = *share)).collect(),
            Knob::Mask => {
                let bits = [2, 4, 8].map(|bits| Mask::Channels([(0xFF00u32 >> bits) as u8; 4]));
                let adaptive = [0.02, 0.1, 0.3].map(Mask::Adaptive);
                bits.into_iter().chain(adaptive).map(|mask| with(&|s| s.mask = mask)).collect()
            }
            Knob::Orders => counts(base.orders, 1024, &[0.5, 0.75, 1.5], &|s, k| s.orders = k),
        }
    }
}

/// What a sweep of `knobs` around the scene's settings measures: these first, then one knob at a time, then the grid.
/// Nothing is in it twice.
pub fn plan(scene: &Scene, knobs: &[Knob]) -> Vec<Setting> {
    let base = &scene.settings;
    let knobs: Vec<Knob> = knobs.iter().copied().filter(|k| k.is_used(scene)).collect();
    let mut plan = vec![Setting { settings: base.clone(), knobs: knobs.clone() }];
    for &knob in &knobs {
        for settings in knob.variants(base, false) {
            match plan.iter_mut().find(|s| s.settings == settings) {
                Some(known) if known.knobs.contains(&knob) => {}
                Some(known) => known.knobs.push(knob),
                None => plan.push(Setting { settings, knobs: vec![knob] }),
            }
        }
    }
    let mut grid = vec![base.clone()];
    for knob in GRID.into_iter().filter(|k| knobs.contains(k)) {
        grid = grid.iter().flat_map(|s| [vec![s.clone()], knob.variants(s, true)].concat()).collect();
    }
    for settings in grid {
        if plan.iter().all(|s| s.settings != settings) {
            plan.push(Setting { settings, knobs: Vec::new() });
        }
    }
    plan
}

/// The knobs in which two settings differ.
pub fn changed(from: &Settings, to: &Settings) -> Vec<Knob> {
    Knob::value_variants().iter().copied().filter(|k| k.value(from) != k.value(to)).collect()
}

/// The flags that turn settings `from` into `to`.
pub fn flags(from: &Settings, to: &Settings) -> String {
    let flags = changed(from, to).into_iter().map(|k| format!("--{} {}", k.flag(), k.value(to)));
    flags.collect::<Vec<_>>().join(" ")
}

/// The lines of a scene file's `[render]` that turn settings `from` into `to`.
pub fn toml_lines(from: &Settings, to: &Settings) -> Vec<String> {
    let line = |knob: Knob| {
        let value = knob.value(to);
        let is_text = matches!(knob, Knob::Sampling | Knob::Mask | Knob::Precision);
        if is_text { format!("{} = \"{value}\"", knob.field()) } else { format!("{} = {value}", knob.field()) }
    };
    changed(from, to).into_iter().map(line).collect()
}

/// Rough time of a picture, to tell how long a sweep goes on: `parts` are what gathering, the environment and the camera
/// took with the settings `from`, and what else there was.
pub fn estimate(parts: [f64; 4], from: &Settings, to: &Settings) -> f64 {
    let gathers = |s: &Settings| 1.0 + f64::from(s.inner_share) * f64::from(s.orders.saturating_sub(2));
    let voxels = |s: &Settings| f64::from(s.directions) * gathers(s) / f64::from(s.gather_step);
    let environment = |s: &Settings| f64::from(s.environment_directions) / f64::from(s.gather_step);
    let camera = |s: &Settings| f64::from(s.spp) / f64::from(s.camera_step);
    let hidden = |s: &Settings| 0.3 + f64::from(s.hidden_share);
    let ratio = |f: &dyn Fn(&Settings) -> f64| if f(from) > 0.0 { f(to) / f(from) } else { 1.0 };
    let shared = ratio(&hidden);
    parts[0] * ratio(&voxels) * shared + parts[1] * ratio(&environment) * shared + parts[2] * ratio(&camera) + parts[3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Overrides, load_scene};
    use clap::Args;

    fn scene(flags: &[&str]) -> Scene {
        let command = Overrides::augment_args(clap::Command::new("test"));
        let matches = command.get_matches_from([&["test", "--volume", "phantom:cloud:4x4x4"], flags].concat());
        load_scene(None, &clap::FromArgMatches::from_arg_matches(&matches).unwrap()).unwrap()
    }

    /// A new field of `Settings` is a knob, or is named here.
    #[test]
    fn every_setting_is_a_knob_or_no_trade() {
        let json = serde_json::to_value(Settings::default()).unwrap();
        let mut fields: Vec<_> = json.as_object().unwrap().keys().cloned().collect();
        let mut known: Vec<_> = Knob::value_variants().iter().map(|k| k.field()).collect();
        known.extend(["model", "light_for", "max_events", "size", "seconds", "target_error", "seed"].map(String::from));
        fields.sort();
        known.sort();
        assert_eq!(fields, known);
    }

    #[test]
    fn plan_tries_every_knob_and_every_sampling_once() {
        let scene = scene(&["--environment", "1", "--sampling", "resample"]);
        let plan = plan(&scene, Knob::value_variants());
        assert_eq!(plan[0].settings, scene.settings);
        for (i, setting) in plan.iter().enumerate() {
            assert!(plan[..i].iter().all(|s| s.settings != setting.settings), "{setting:?} is there twice");
            assert!(setting.settings.directions <= setting.settings.candidates);
            let changed = changed(&scene.settings, &setting.settings);
            let candidates_follow = |k: &Knob| setting.knobs.contains(k) || *k == Knob::Candidates;
            assert!(i == 0 || setting.knobs.is_empty() || changed.iter().all(candidates_follow), "{setting:?}");
        }
        // The gathers bring this environment.
        for &knob in Knob::value_variants().iter().filter(|&&k| k != Knob::EnvironmentDirections) {
            let values = plan.iter().filter(|s| s.knobs.contains(&knob)).count();
            assert!(values >= if knob == Knob::Precision { 2 } else { 3 }, "{knob:?} has {values} values");
        }
        for &mode in Sampling::value_variants() {
            assert!(plan.iter().filter(|s| s.settings.sampling == mode).count() >= 6, "{mode:?}");
        }
    }

    #[test]
    fn knobs_that_change_nothing_are_left_out() {
        let is_tried =
            |scene: &Scene, knob| plan(scene, Knob::value_variants()).iter().any(|s| s.knobs.contains(&knob));
        let dark = scene(&["--environment", "0", "--sampling", "phase"]);
        assert!(dark.environment.is_none());
        for knob in [Knob::EnvironmentDirections, Knob::Mask, Knob::Candidates] {
            assert!(!is_tried(&dark, knob), "{knob:?}");
        }
        // Without further gathers single scattering samples the environment, and there is no inner gather.
        let lit = |orders| scene(&["--environment", "1", "--orders", orders]);
        for (orders, environment) in [("1", true), ("2", false)] {
            assert_eq!(is_tried(&lit(orders), Knob::EnvironmentDirections), environment, "orders {orders}");
            assert_eq!(is_tried(&lit(orders), Knob::InnerShare), !environment, "orders {orders}");
        }
    }

    /// What is recommended leads back to the settings, as flags and as scene lines.
    #[test]
    fn flags_and_lines_mean_the_settings() {
        let base = scene(&["--environment", "1"]);
        // Of another scene, so that the knobs of candidates are in it.
        let plan = plan(&scene(&["--environment", "1", "--sampling", "resample"]), Knob::value_variants());
        for setting in &plan {
            let flags = flags(&base.settings, &setting.settings);
            let words: Vec<_> = flags.split_whitespace().collect();
            assert_eq!(scene(&words).settings, setting.settings, "{flags}");
            let text = format!("[render]\n{}\n", toml_lines(&base.settings, &setting.settings).join("\n"));
            let file = crate::scene::file::SceneFile::parse(&text, "test.toml".as_ref()).unwrap();
            let layers = crate::scene::merge(file, Default::default()).unwrap();
            let settings = crate::scene::resolve(layers, base.volume.clone()).unwrap().settings;
            assert_eq!(settings, setting.settings, "{text}");
        }
        assert!(plan.len() > 40);
    }
}
