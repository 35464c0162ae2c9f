//! `tyndall tradeoff` as a user meets it: a sweep that is stopped goes on, its files say the same, bad input is named.

#[path = "common/place.rs"]
mod place;

use base64::Engine as _;
use place::{Place, text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;
use tyndall::measure::front::{Point, front};

/// A scene whose every picture takes some milliseconds.
const SCENE: &str = "
[volume]
phantom = 'skull'
size = [12, 12, 12]
[render]
orders = 2
directions = 4
candidates = 8
environment_directions = 2
spp = 4
";
const SWEEP: &[&str] = &[
    "tradeoff",
    "scene.toml",
    "-o",
    "out",
    "--size",
    "16x16",
    "--seeds",
    "2",
    "--reference-spp",
    "32",
    "--knobs",
    "directions,spp,orders",
];
/// The scene's own settings, other directions, spp, orders, and what the grid adds.
const PLANNED: usize = 1 + 4 + 3 + 2 + 2;

fn place() -> Place {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    place
}

/// Runs a sweep; stdout and stderr.
fn sweep(place: &Place, flags: &[&str]) -> (String, String) {
    let output = place.run(&[SWEEP, flags].concat());
    let error = text(&output.stderr);
    assert!(output.status.success(), "{error}");
    (text(&output.stdout), error)
}

/// When each record was written.
fn records(place: &Place) -> BTreeMap<String, SystemTime> {
    let files = fs::read_dir(place.path("out/settings")).unwrap().map(|e| e.unwrap());
    let files = files.filter(|e| e.path().extension().is_some_and(|x| x == "json"));
    files.map(|e| (e.file_name().into_string().unwrap(), e.metadata().unwrap().modified().unwrap())).collect()
}

fn results(place: &Place) -> Value {
    serde_json::from_slice(&fs::read(place.path("out/results.json")).unwrap()).unwrap()
}

/// Start and end tags match; attributes are quoted.
fn assert_balanced(markup: &str) {
    const EMPTY: [&str; 2] = ["meta", "img"];
    let mut open: Vec<&str> = Vec::new();
    for piece in markup.split('<').skip(1) {
        let (tag, _) = piece.split_once('>').unwrap_or_else(|| panic!("no end of <{piece}"));
        assert_eq!(tag.matches('"').count() % 2, 0, "<{tag}>");
        let name = tag.split([' ', '\n', '/']).find(|n| !n.is_empty()).unwrap();
        if let Some(closed) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(closed.trim()));
        } else if !tag.starts_with('!') && !tag.ends_with('/') && !EMPTY.contains(&name) {
            open.push(name);
        }
    }
    assert_eq!(open, [""; 0]);
}

#[test]
fn stopped_sweep_goes_on_and_its_files_agree() {
    let place = place();
    let (out, err) = sweep(&place, &["--limit", "2", "--validate"]);
    assert!(err.contains(&format!("{PLANNED} settings")) && err.contains("; 0 are measured already"), "{err}");
    assert!(out.contains(&format!("{} settings are left", PLANNED - 3)), "{out}");
    let first = records(&place);
    assert_eq!(first.len(), 3);
    assert_eq!(results(&place)["settings"].as_array().unwrap().len(), 3);

    // What a killed sweep may leave: a picture without a record, and half a record.
    let damaged = first.keys().next().unwrap();
    let record = fs::read(place.path("out/settings").join(damaged)).unwrap();
    place.write("out/settings/0123.png", "");
    fs::write(place.path("out/settings").join(damaged), &record[..record.len() / 2]).unwrap();
    let states: Vec<_> = references(&place);
    let (out, err) = sweep(&place, &[]);
    assert!(err.contains("; 2 are measured already"), "{err}");
    assert!(!out.contains("are left"), "{out}");
    let second = records(&place);
    assert_eq!(second.len(), PLANNED);
    for (name, time) in &first {
        assert_eq!(second[name] == *time, name != damaged, "{name}");
    }
    assert_eq!(references(&place), states, "the references were saved");

    // Nothing is left to do, and the same is found.
    let before = results(&place);
    let (again, err) = sweep(&place, &["--json"]);
    assert!(err.contains(&format!("; {PLANNED} are measured already")), "{err}");
    assert_eq!(records(&place), second);
    assert!(serde_json::from_str::<Value>(&again).unwrap() == before, "{again}");

    check_files(&place, &out);

    // Another scene, seed or reference takes nothing of this.
    for flags in [["--density", "2"], ["--seed", "9"], ["--reference-spp", "33"], ["--hidden-share", "0.5"]] {
        let changed: Vec<_> = SWEEP.iter().filter(|f| !["--reference-spp", "32"].contains(f)).copied().collect();
        let fixed: &[&str] = if flags[0] == "--reference-spp" { &[] } else { &["--reference-spp", "32"] };
        let output = place.run(&[&changed[..], fixed, &flags, &["--limit", "0"]].concat());
        let err = text(&output.stderr);
        assert!(output.status.success() && err.contains("; 0 are measured already"), "{flags:?}: {err}");
    }
    assert_eq!(records(&place).len(), PLANNED + 4);
}

/// Names and bytes of the saved references.
fn references(place: &Place) -> Vec<(String, Vec<u8>)> {
    let files = fs::read_dir(place.path("out")).unwrap().map(|e| e.unwrap().path());
    let states = files.filter(|path| path.extension().is_some_and(|x| x == "state"));
    let mut all: Vec<_> = states.map(|p| (p.display().to_string(), fs::read(&p).unwrap())).collect();
    all.sort();
    assert_eq!(all.len(), 2);
    all
}

fn check_files(place: &Place, stdout: &str) {
    let json = results(place);
    let settings = json["settings"].as_array().unwrap();
    let number = |i: usize, name: &str| settings[i][name].as_f64().unwrap();

    // The front of the same truth; what is recommended is on it and meets the scene's own error and time.
    let point = |i: usize| {
        let same = settings[i]["is_same_truth"] == true && settings[i]["same_as"].is_null();
        Point { time: number(i, "time"), error: if same { number(i, "error") } else { f64::NAN } }
    };
    let points: Vec<_> = (0..settings.len()).map(point).collect();
    let indices = |list: &Value| -> Vec<usize> {
        list.as_array().unwrap().iter().map(|i| i.as_u64().unwrap() as usize).collect()
    };
    assert_eq!(indices(&json["front"]), front(&points));
    assert_eq!(settings.iter().filter(|s| s["is_same_truth"] == false).count(), 2, "orders 1 and 3");
    let recommended = json["recommended"].as_array().unwrap();
    assert_eq!(recommended.len(), 2);
    for r in recommended {
        let i = r["setting"].as_u64().unwrap() as usize;
        assert!(indices(&json["front"]).contains(&i) && settings[i]["on_front"] == true, "{r}");
        assert_eq!((&r["is_met"], &r["flags"]), (&Value::Bool(true), &settings[i]["flags"]));
        let flags = r["flags"].as_str().unwrap();
        assert!(stdout.contains(if flags.is_empty() { "as it is" } else { flags }), "{stdout}");
        // The flags set what was measured.
        let words: Vec<_> = flags.split_whitespace().collect();
        let render = ["render", "scene.toml", "--size", "16x16", "--stats", "stats.json", "-q"];
        place.succeeds(&[&render[..], &words].concat());
        let stats: Value = serde_json::from_slice(&fs::read(place.path("stats.json")).unwrap()).unwrap();
        assert_eq!(stats["settings"], settings[i]["settings"], "{flags}");
    }
    for (i, s) in settings.iter().enumerate() {
        let parts = s["errors"]["bias_squared"].as_f64().unwrap() + s["errors"]["noise_squared"].as_f64().unwrap();
        assert!((parts.max(0.0).sqrt() - number(i, "error")).abs() < 1e-9, "{s}");
        assert!(number(i, "time") > 0.0 && number(i, "noise") > 0.0, "{s}");
    }

    // The table says the same.
    let mut csv = csv::Reader::from_path(place.path("out/results.csv")).unwrap();
    let header = csv.headers().unwrap().clone();
    let rows: Vec<_> = csv.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), settings.len());
    for (i, row) in rows.iter().enumerate() {
        let field = |name: &str| &row[header.iter().position(|h| h == name).unwrap_or_else(|| panic!("no {name}"))];
        for name in ["error", "bias", "noise", "time"] {
            assert_eq!(field(name).parse::<f64>().unwrap(), number(i, name), "{name}");
        }
        assert_eq!(field("directions"), settings[i]["settings"]["directions"].to_string());
        assert_eq!(field("flags"), settings[i]["flags"].as_str().unwrap());
        assert_eq!(field("on_front"), settings[i]["on_front"].to_string());
    }

    // The page needs nothing but itself, and its pictures are pictures.
    let page = fs::read_to_string(place.path("out/index.html")).unwrap();
    assert_balanced(&page);
    for outside in ["http", "src=\"/", "href", "url(", "@import", "<script", "<link"] {
        let own = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        assert!(!own.contains(outside), "{outside}");
    }
    let pictures: Vec<_> = page.split("src=\"data:image/png;base64,").skip(1).collect();
    let own_is_shown = settings[0]["on_front"] == true;
    assert_eq!(pictures.len(), indices(&json["front"]).len() + if own_is_shown { 1 } else { 2 });
    assert_eq!(page.matches("<img").count(), pictures.len());
    for picture in pictures {
        let (data, _) = picture.split_once('"').unwrap();
        let bytes = base64::engine::general_purpose::STANDARD.decode(data).unwrap();
        let picture = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png).unwrap();
        assert_eq!((picture.width(), picture.height()), (16, 16));
    }
    assert_eq!(page.matches("<tr").count(), 1 + settings.len());
    for plot in ["front.svg", "knobs.svg"] {
        let svg = fs::read_to_string(place.path("out").join(plot)).unwrap();
        assert_balanced(&svg);
        assert!(svg.starts_with("<svg") && page.contains(&svg), "{plot}");
    }
    for knob in ["directions", "spp", "orders"] {
        assert!(fs::read_to_string(place.path("out/knobs.svg")).unwrap().contains(knob), "{knob}");
    }
}

#[test]
fn of_settings_with_the_same_pictures_the_first_counts() {
    let place = place();
    let knobs = SWEEP.iter().map(|&f| if f == "directions,spp,orders" { "sampling" } else { f });
    place.succeeds(&knobs.collect::<Vec<_>>());
    let json = results(&place);
    let settings = json["settings"].as_array().unwrap();
    let of = |flags: &str| settings.iter().find(|s| s["flags"] == flags).unwrap_or_else(|| panic!("no {flags}"));
    // Here `auto` is `phase`, which may take as long or longer; which of the two came out faster says nothing.
    assert_eq!((&of("--sampling auto")["same_as"], &of("--sampling auto")["on_front"]), (&0.into(), &false.into()));
    for flags in ["", "--sampling top", "--sampling residual"] {
        assert!(of(flags)["same_as"].is_null(), "{flags}");
    }
}

#[test]
fn goals_are_met_or_said_to_be_out_of_reach() {
    let place = place();
    let sweep = |flags: &[&str]| -> Value {
        serde_json::from_str(&place.succeeds(&[SWEEP, &["--limit", "1", "--json", "-q"], flags].concat())).unwrap()
    };
    // With so little noise no sweep ends, and with so much time every one does.
    let json = sweep(&["--target-error", "1e-9", "--seconds", "1e9"]);
    let [error, time] = json["recommended"].as_array().unwrap().first_chunk().unwrap();
    assert_eq!((&error["is_met"], &time["is_met"]), (&Value::Bool(false), &Value::Bool(true)));
    assert_eq!((&error["goal"]["error"], &time["goal"]["time"]), (&Value::from(1e-9), &Value::from(1e9)));
    // Both are the most accurate one.
    assert_eq!(error["setting"], time["setting"]);
    assert_eq!(error["setting"], *json["front"].as_array().unwrap().last().unwrap());
    let text = place.succeeds(&[SWEEP, &["--limit", "0", "--target-error", "1e-9"]].concat());
    assert!(text.contains("nothing measured meets it"), "{text}");
}

#[test]
fn bad_input_is_refused_and_leaves_nothing_behind() {
    let place = place();
    place.write("file", "");
    place.write("path.toml", SCENE.replace("[render]", "[render]\nmodel = 'path'"));
    place.write("dark.toml", SCENE.to_owned() + "[environment]\nradiance = 0\n");
    let tradeoff = |flags: &[&str], code: i32, parts: &[&str]| {
        place.fails(&[&["tradeoff"], flags].concat(), code, parts);
    };
    tradeoff(&["scene.toml"], 2, &["--output"]);
    tradeoff(
        &["scene.toml", "-o", "out", "--knobs", "colour"],
        2,
        &["colour", "--knobs", "directions", "hidden-share"],
    );
    tradeoff(&["scene.toml", "-o", "out", "--seeds", "1"], 2, &["--seeds"]);
    tradeoff(&["scene.toml", "-o", "out", "--reference-spp", "1"], 2, &["--reference-spp"]);
    tradeoff(&["scene.toml", "-o", "out", "--reference-error", "0"], 2, &["--reference-error"]);
    tradeoff(&["scene.toml", "-o", "out", "--target-error", "0"], 2, &["--target-error", "greater than 0"]);
    tradeoff(&["scene.toml", "-o", "file"], 1, &["file", "is no folder", "cure"]);
    tradeoff(&["scene.toml", "-o", "file/out", "--size", "8x8"], 1, &["file/out", "cannot create"]);
    tradeoff(&["nosuch.toml", "-o", "out"], 1, &["nosuch.toml"]);
    tradeoff(&["path.toml", "-o", "out"], 1, &["path.toml", "path", "--model multiple"]);
    tradeoff(&["scene.toml", "-o", "out", "--model", "phong"], 1, &["phong", "--model multiple"]);
    tradeoff(
        &["dark.toml", "-o", "out", "--knobs", "environment-directions"],
        2,
        &["environment-directions", "--knobs"],
    );
    assert!(!Path::new(&place.path("out")).exists());
}
