//! `tyndall verify`: it passes on this device, says what it promises, and can fail.

mod common;
#[path = "common/place.rs"]
mod place;

use place::{Place, text};
use serde_json::Value;
use tyndall::vk::Validation;

/// Runs the body, but not under GPU-assisted validation: lavapipe takes up to a minute for each instrumented kernel.
fn unless_instrumented(body: impl FnOnce()) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP verify under GPU-assisted validation: the passes' own tests have the kernels there");
    } else {
        body();
    }
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e} in {text}"))
}

#[test]
fn this_device_passes() {
    unless_instrumented(|| {
        let report = json(&Place::new().succeeds(&["verify", "--validate", "--json", "--seed", "1"]));
        let checks = report["checks"].as_array().unwrap();
        assert_eq!((&report["passed"], &report["failed"]), (&Value::Bool(true), &0.into()));
        assert_eq!(report["seed"], 1);
        assert!(report["device"]["name"].is_string() && report["device"]["subgroup_size"].is_u64());
        assert!(report["seconds"].as_f64().unwrap() > 0.0);
        for c in checks {
            let [value, expected, tolerance] = ["value", "expected", "tolerance"].map(|k| c[k].as_f64().unwrap());
            assert!((value - expected).abs() <= tolerance, "{c}");
            assert_eq!(c["passed"], true);
            assert!(c["why"].as_str().unwrap().len() > 20 && !c["case"].as_str().unwrap().is_empty(), "{c}");
        }
        // Every part is there, and no case stands for two.
        let count = |group: &str| checks.iter().filter(|c| c["group"] == group).count();
        for (group, least) in [
            ("primitives", 40),
            ("phase", 100),
            ("transmittance", 30),
            ("single", 20),
            ("orders", 16),
            ("voxels", 7),
            ("furnace", 24),
        ] {
            assert!(count(group) >= least, "{group}: {}", count(group));
        }
        assert_eq!(count("canary"), 0);
        let mut cases: Vec<String> = checks.iter().map(|c| c["group"].to_string() + &c["case"].to_string()).collect();
        cases.sort();
        let all = cases.len();
        cases.dedup();
        assert_eq!(cases.len(), all, "cases of the same name");
    });
}

#[test]
fn a_failed_check_is_seen_by_exit_code_and_report() {
    unless_instrumented(|| {
        let place = Place::new();
        let output = place.run(&["verify", "--group", "canary"]);
        assert_eq!(output.status.code(), Some(1));
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        for part in ["canary", "FAILED one is two: 1, expected 2", "wrong on purpose", "1 checks, 1 FAILED"] {
            assert!(stdout.contains(part), "'{part}' is missing in: {stdout}");
        }
        assert!(stderr.contains("1 of 1 checks failed"), "{stderr}");

        let output = place.run(&["verify", "--group", "canary", "--json"]);
        assert_eq!(output.status.code(), Some(1));
        let report = json(&text(&output.stdout));
        assert_eq!((&report["passed"], &report["failed"]), (&Value::Bool(false), &1.into()));
        assert_eq!(report["checks"][0]["passed"], false);

        let text = place.succeeds(&["verify", "--group", "primitives"]);
        for part in
            ["primitives\n", "  ok     scan, 1 items: wrong sums: 0, expected 0 ± 0", ", all passed; ", "seed 0"]
        {
            assert!(text.contains(part), "'{part}' is missing in: {text}");
        }
        place.fails(&["verify", "--group", "nothing"], 2, &["nothing", "--group", "phase"]);
        place.fails(&["verify", "--device", "no such device"], 1, &["no such device", "tyndall devices"]);
    });
}
