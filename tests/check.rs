//! `tyndall check`: its scenes use everything, faults are noticed, reports say what was found.

mod common;
#[path = "common/place.rs"]
mod place;

use place::{Place, text};
use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use tyndall::check::{self, Options, cases::CASES};
use tyndall::render::path::PathRender;
use tyndall::render::{Internals, Renderer};
use tyndall::scene::{Model, Overrides, Scene, load_scene_text};
use tyndall::vk::{Context, Injection, Validation};

/// Under GPU-assisted validation lavapipe compiles for up to a minute per kernel; the passes' own tests are run there.
fn is_gpu_assisted() -> bool {
    let skips = common::validation() == Validation::GpuAssisted;
    if skips {
        println!("SKIP the scenes of check: the passes' own tests have the kernels under GPU-assisted validation");
    }
    skips
}

fn options(kinds: &[Validation]) -> Options {
    Options { kinds: kinds.to_vec(), device: common::config().device, ..Options::default() }
}

#[test]
fn all_scenes_are_silent() {
    if is_gpu_assisted() {
        return;
    }
    let place = Place::new();
    let report = place.succeeds(&["check", "--junit", "check.xml", "--stats", "check.json"]);
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(place.path("check.json")).unwrap()).unwrap();
    let junit = std::fs::read_to_string(place.path("check.xml")).unwrap();
    for (run, kind) in ["core", "best-practices"].into_iter().enumerate() {
        let run = &stats["runs"][run];
        let names: Vec<_> =
            run["cases"].as_array().unwrap().iter().map(|case| case["name"].as_str().unwrap()).collect();
        let expected: Vec<_> = ["set-up"].into_iter().chain(CASES.iter().map(|c| c.name)).chain(["teardown"]).collect();
        assert_eq!((run["kind"].as_str(), names), (Some(kind), expected));
        assert!(run["kernels"].as_u64().unwrap() > 30 && run["layer"].is_string(), "{run}");
        assert!(report.contains(&format!("{kind}: ")), "{report}");
        assert!(junit.contains(&format!("<testsuite name=\"{kind}\" tests=\"{}\"", CASES.len() + 2)), "{junit}");
    }
    assert!(!junit.contains("<failure"), "{junit}");
}

/// A kernel, one of its specialization constants, and a value of it.
type Use = (&'static str, String, u32);

fn uses(ctx: &Context) -> BTreeSet<Use> {
    let uses =
        |form: tyndall::vk::KernelForm| form.constants.into_iter().map(move |(name, value)| (form.name, name, value));
    ctx.kernels().into_iter().flat_map(uses).collect()
}

fn set_up(ctx: &Context, scene: &Scene) {
    if scene.settings.model == Model::Path {
        PathRender::new(ctx, scene).unwrap();
    } else {
        Renderer::new(ctx, scene, Internals::default()).unwrap();
    }
}

/// What random scenes use the scenes of check use, too: every value of every constant.
#[test]
fn random_scenes_use_nothing_else() {
    if is_gpu_assisted() {
        return;
    }
    let _turn = common::one_at_a_time();
    let mut state = 1u64;
    let mut pick = |choices: &[&str]| {
        // Knuth's MMIX generator; the upper bits are good.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        choices[(state >> 33) as usize % choices.len()].to_owned()
    };
    let lights = [
        "",
        "light = []\n",
        "light = [{ azimuth = 3, elevation = 4, irradiance = 2 }]\n",
        "light = [{ position = [20, -20, 9], intensity = 500 }, { azimuth = 3, elevation = 4, irradiance = 2 }]\n",
    ];
    let glow = "transfer.points = [{ value = 0, color = [0.9, 0.8, 0.2], opacity = 0 }, \
        { value = 1, color = 0.5, opacity = 0.9, emission = [3, 1, 0.2] }]\n";
    let plain = common::context();
    let random = common::context();
    for case in CASES {
        set_up(&plain, &case.scene().unwrap());
    }
    for i in 0..300 {
        let model = pick(&["absorption", "phong", "single", "multiple", "multiple", "multiple", "path"]);
        let sampling = pick(&["phase", "top", "resample", "residual", "auto"]);
        let orders = if model == "path" { pick(&["1", "3", "'unlimited'"]) } else { pick(&["1", "2", "3"]) };
        let text = [
            pick(&["", "background = 'transparent'\n", "background = 'environment'\n", "background = 0.5\n"]),
            pick(&lights),
            pick(&["", "environment.radiance = 0\n", "environment.radiance = 0.7\n"]),
            pick(&["", "medium.g = 0.4\n", "medium.g = -0.2\n"]),
            pick(&["", "", glow]),
            format!("[render]\nmodel = '{model}'\nsampling = '{sampling}'\norders = {orders}\n"),
            pick(&["", "precision = 'single'\n"]),
            pick(&["", "light_grid = 2\n", "light_grid = 4\n"]),
            pick(&["", "light_for = 'every-view'\n"]),
            pick(&["", "hidden_share = 1\n"]),
            pick(&["", "mask = '8'\n", "mask = '0'\n", "mask = 'adaptive:0.3'\n"]),
            "[volume]\nphantom = 'cloud'\nsize = [13, 11, 9]\n".to_owned(),
        ]
        .concat();
        let few = Overrides {
            size: Some([17, 13]),
            spp: Some(2),
            directions: Some(6),
            candidates: Some(9),
            ..Overrides::default()
        };
        let mut scene =
            load_scene_text(&text, Path::new("random.toml"), &few).unwrap_or_else(|e| panic!("{e} in {text}"));
        if i % 3 == 0 {
            scene.environment =
                CASES.iter().find(|case| case.name.contains("sky")).unwrap().scene().unwrap().environment;
        }
        set_up(&random, &scene);
    }
    let (known, used) = (uses(&plain), uses(&random));
    let missing: Vec<_> = used.difference(&known).collect();
    assert!(known.len() > 100 && missing.is_empty(), "no scene of check has {missing:?}");
    common::assert_silent(&plain.close());
    common::assert_silent(&random.close());
}

/// Each fault by the id of the detector that is there for it.
#[test]
fn every_injected_fault_is_noticed() {
    let place = Place::new();
    for (kind, ids) in [
        ("missing-barrier", &["TYNDALL-HAZARD", "SYNC-HAZARD-READ-AFTER-WRITE"][..]),
        ("write-after-write", &["TYNDALL-HAZARD"]),
        ("out-of-bounds", &["VUID-vkCmdDispatch-"]),
        ("leak", &["TYNDALL-LEAK"]),
        ("stale-descriptor", &["VUID-vkCmdDispatch-None-0"]),
    ] {
        let report = place.succeeds(&["check", "--inject", kind]);
        assert!(report.starts_with(&format!("{kind} was noticed: ")), "{report}");
        assert!(ids.iter().all(|id| report.contains(id)), "{report}");
    }
}

/// Without barriers every case has messages, of the layer and of our own check.
#[test]
fn a_message_fails_its_case_unless_it_is_allowed() {
    if is_gpu_assisted() {
        return;
    }
    let _turn = common::one_at_a_time();
    let run = |options: &Options| check::run(options, &mut |_| ControlFlow::Continue(())).unwrap();
    let options = options(&[Validation::CoreAndSync]);
    let mut options =
        Options { only: vec!["absorption".into()], injection: Some(Injection::MissingBarrier), ..options };
    let bare = run(&options);
    let failed: Vec<_> =
        bare.runs[0].cases.iter().filter(|case| !case.passes()).map(|case| case.name.as_str()).collect();
    let cases: Vec<_> = options.cases().iter().map(|case| case.name).collect();
    assert_eq!((failed, bare.failures()), (cases.clone(), (cases.len(), cases.len() + 2)));
    let text = bare.text();
    for part in ["FAILED  absorption\n", "times, first: [Error] SYNC-HAZARD", "TYNDALL-HAZARD", "2 of "] {
        assert!(text.contains(part), "'{part}' is missing in {text}");
    }
    let junit = bare.to_junit().unwrap();
    let failures = format!("failures=\"{}\"", cases.len());
    assert!(junit.contains("<failure") && junit.contains("SYNC-HAZARD") && junit.contains(&failures), "{junit}");

    let messages = bare.runs[0].cases.iter().flat_map(|case| &case.messages);
    let ids: BTreeSet<_> = messages.map(|m| m.id.as_str()).chain(["never seen"]).collect();
    let entry = |id: &&str| format!("[[allow]]\nid = '{id}'\nlayer = '1'\nreason = 'test'\n");
    let list: String = ids.iter().map(entry).collect();
    options.allowed = check::allow::parse(&list, Path::new("list.toml")).unwrap();
    let allowed = run(&options);
    assert_eq!(allowed.failures(), (0, cases.len() + 2));
    assert_eq!(allowed.unused.iter().map(|a| a.id.as_str()).collect::<Vec<_>>(), ["never seen"]);
    assert!(allowed.text().contains("the allow-list's never seen"), "{}", allowed.text());
}

#[test]
fn bad_input_is_named() {
    let place = Place::new();
    let list = text(&place.run(&["check", "--list"]).stdout);
    assert_eq!(list.lines().collect::<Vec<_>>(), CASES.iter().map(|case| case.name).collect::<Vec<_>>());
    place.fails(&["check", "--only", "no such case"], 2, &["--only", "no such case", "--list"]);
    place.fails(&["check", "--kinds", "off"], 2, &["--kinds", "'off' checks nothing", "cure"]);
    place.fails(&["check", "--kinds", "all"], 2, &["--kinds", "core", "best-practices", "gpu-assisted"]);
    place.fails(&["check", "--inject", "rust"], 2, &["--inject", "missing-barrier", "stale-descriptor"]);
    place.fails(&["check", "--inject", "leak", "--only", "phong"], 2, &["--inject", "--only"]);
    place.fails(&["check", "--junit", "missing/check.xml"], 1, &["missing/check.xml", "not an existing directory"]);
    place.fails(&["check", "--allow", "none.toml"], 1, &["none.toml"]);
    place.write("list.toml", "[[allow]]\nid = 'A'\nlayer = '1.3'\n");
    place.fails(&["check", "--allow", "list.toml"], 1, &["list.toml", "reason", "cure"]);
}
