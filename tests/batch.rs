//! `tyndall batch` as a user meets it: frames, what is done once, what is skipped, what fails.

#[path = "common/place.rs"]
mod place;

use place::{Place, text};
use std::fs;

/// A turntable of four small frames, g ≠ 0, with light of every kind.
const SMALL: &str = "batch --volume phantom:cloud:12x10x8 --size 16x12 --orders 2 --spp 2 --directions 4 --candidates 8 \
    --environment-directions 8 --environment=0.5 --light directional:30,40,2 --g 0.4 --turntable 4";

fn flags<'a>(more: &[&'a str]) -> Vec<&'a str> {
    SMALL.split_ascii_whitespace().chain(more.iter().copied()).collect()
}

fn stats(place: &Place) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(place.path("s.json")).unwrap()).unwrap()
}

/// Of every frame a figure.
fn of_frames(stats: &serde_json::Value, field: &str) -> Vec<serde_json::Value> {
    stats["frames"].as_array().unwrap().iter().map(|f| f[field].clone()).collect()
}

fn names(place: &Place) -> Vec<String> {
    place.files().into_iter().map(|f| f.0).collect()
}

#[test]
fn light_is_computed_once_and_frames_are_those_of_render() {
    let place = Place::new();
    let report = place.succeeds(&flags(&["-o", "f{:02}.exr", "--stats", "s.json"]));
    assert!(report.contains("4 frames rendered, 0 were there"), "{report}");
    assert_eq!(names(&place), ["f00.exr", "f01.exr", "f02.exr", "f03.exr", "s.json"]);
    let stats = stats(&place);
    assert_eq!(of_frames(&stats, "outcome"), ["rendered"; 4]);
    let [gpu, camera] = ["gpu_ms", "camera_ms"]
        .map(|field| of_frames(&stats, field).iter().map(|ms| ms.as_f64().unwrap()).collect::<Vec<_>>());
    assert!(camera[0] > 0.0 && gpu[0] > camera[0], "{gpu:?} {camera:?}");
    assert_eq!(gpu[1..], camera[1..], "more than the camera pass");
    assert!((stats["gpu_ms"].as_f64().unwrap() - gpu.iter().sum::<f64>()).abs() < 1e-6);
    assert_eq!(stats["settings"]["light_for"], "every-view");

    let frames: Vec<_> = place.files().into_iter().map(|f| f.1).collect();
    assert!(frames[0] != frames[1] && frames[1] != frames[2], "the camera stands still");
    let first: Vec<_> =
        flags(&["-o", "one.exr", "--quiet"]).into_iter().map(|f| f.replace("batch", "render")).collect();
    place.succeeds(&first.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(fs::read(place.path("one.exr")).unwrap() == frames[0], "render takes another picture than frame 0");
}

/// Whatever was there before, the same pictures come out: light and exposure depend on no frame's turn.
#[test]
fn a_new_start_renders_what_is_missing() {
    let place = Place::new();
    place.succeeds(&flags(&["--quiet"]));
    let all = place.files();
    assert_eq!(all.len(), 4);
    fs::remove_file(place.path("frame_0002.png")).unwrap();
    place.write("frame_0001.png", "kept");
    let report = place.succeeds(&flags(&["--stats", "s.json"]));
    assert!(report.contains("1 frames rendered, 3 were there"), "{report}");
    assert_eq!(of_frames(&stats(&place), "outcome"), ["skipped", "skipped", "rendered", "skipped"]);
    assert_eq!(fs::read(place.path("frame_0001.png")).unwrap(), b"kept");
    assert!(place.files()[2] == all[2], "frame 2 alone is another one");
    // Nothing to do is no failure.
    assert!(place.succeeds(&flags(&[])).contains("0 frames rendered, 4 were there"));
    place.succeeds(&flags(&["--quiet", "--force", "--frames", "1..2"]));
    assert!(place.files()[..4] == all[..], "--force");
}

#[test]
fn a_frame_that_fails_stops_no_other() {
    let place = Place::new();
    fs::create_dir(place.path("frame_0001.png")).unwrap();
    let output = place.run(&flags(&["--stats", "s.json"]));
    let stderr = text(&output.stderr);
    assert_eq!((output.status.code(), text(&output.stdout).as_str()), (Some(1), ""), "{stderr}");
    for part in ["frame 1: ", "frame_0001.png", "is a directory", "1 of 4 frames failed", "cure"] {
        assert!(stderr.contains(part), "'{part}' is missing in {stderr}");
    }
    let stats = stats(&place);
    assert_eq!(of_frames(&stats, "outcome"), ["rendered", "failed", "rendered", "rendered"]);
    assert!(stats["frames"][1]["error"].as_str().unwrap().contains("is a directory"), "{stats}");
    assert!(place.path("frame_0003.png").is_file());
}

/// `path` and light for one view start anew with every frame, and arrive at other pictures.
#[test]
fn other_models_take_frames_too() {
    for more in [&["--light-for", "view"][..], &["--model", "path"], &["--model", "phong"], &["--model", "absorption"]]
    {
        let place = Place::new();
        place
            .succeeds(&flags(&[&["--quiet", "-o", "f{}.exr", "--frames", "1..3", "--stats", "s.json"], more].concat()));
        assert_eq!(names(&place), ["f1.exr", "f2.exr", "s.json"], "{more:?}");
        let stats = stats(&place);
        let second: Vec<_> =
            stats["frames"][1]["passes"].as_array().unwrap().iter().map(|p| p["name"].clone()).collect();
        assert_eq!(second == ["camera"], more.contains(&"absorption"), "{more:?}: {second:?}");
    }
}

#[test]
fn validation_has_nothing_to_say() {
    let place = Place::new();
    place.succeeds(&flags(&["--quiet", "--validate", "--sampling", "phase", "--frames", "0..2", "--stats", "s.json"]));
    assert_eq!(stats(&place)["validation"], serde_json::json!({"enabled": true, "errors": 0, "warnings": 0}));
}

#[test]
fn bad_input_is_named() {
    let place = Place::new();
    let none = ["batch", "--volume", "phantom:cloud:8x8x8"];
    place.fails(&none, 2, &["--turntable", "cure"]);
    let small = [&none[..], &["--turntable", "4"]].concat();
    let fails = |more: &[&str], code: i32, parts: &[&str]| place.fails(&[&small[..], more].concat(), code, parts);
    fails(&["--frames", "2..5"], 2, &["--frames", "2..5", "4 frames", "cure"]);
    fails(&["--frames", "2..2"], 2, &["--frames", "2..2"]);
    fails(&["-o", "frame.png"], 2, &["frame.png", "{:04}"]);
    fails(&["-o", "f{}.jpg"], 1, &["'.jpg'", ".exr"]);
    fails(&["-o", "missing/f{}.png"], 1, &["not an existing directory"]);
    place.fails(&[&none[..], &["--turntable", "0"]].concat(), 2, &["--turntable", "from 1 to"]);
    place.fails(&[&small[..], &["--turntable-degrees", "inf"]].concat(), 2, &["--turntable-degrees"]);
    place.write("a.toml", "[volume]\nphantom = \"cloud\"\n[turntable]\nframes = 0\n");
    place.fails(&["batch", "a.toml"], 1, &["a.toml:4", "turntable.frames"]);
}
