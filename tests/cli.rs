//! The command line as a user meets it: exit codes, messages, and no file left behind by a run that failed.

#[path = "common/place.rs"]
mod place;

#[cfg(unix)]
use place::interrupt;
use place::{Place, text};
use std::fs;
use std::path::Path;
use std::process::Stdio;

use tyndall::output::{self, BitDepth, Picture, PngOptions};
use tyndall::scene::{Exposure, ToneCurve};

/// A built-in volume that is quick to make.
const PHANTOM: &str = "phantom:cloud:24x20x16";

impl Place {
    /// Writes a 4×5×6 u8 volume, `bytes` of whose 120 voxels are there; voxel i has the value i.
    fn write_nrrd(&self, name: &str, sizes: &str, bytes: u8) {
        let header = format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nspacings: 1 1 2\nencoding: raw\nendian: little\n\n"
        );
        let data: Vec<u8> = (0..bytes).collect();
        self.write(name, [header.as_bytes(), &data].concat());
    }

    fn write_picture(&self, name: &str, width: u32, radiance: f32) {
        let options = PngOptions { bits: BitDepth::Sixteen, exposure: Exposure::Stops(0.0), tone: ToneCurve::Linear };
        let picture = Picture::filled(width, 8, [radiance, radiance, radiance, 1.0]);
        output::write_picture(&self.path(name), &picture, &options).unwrap();
    }
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e} in {text}"))
}

/// Rays on a tiny phantom: what is exact is, rows are complete, and text and CSV agree on the structures.
#[test]
fn bench_proxy_compares_structures() {
    let place = Place::new();
    let tiny = ["bench", "proxy", "--volume", PHANTOM, "--rays", "256", "--runs", "1"];
    let report = json(&place.succeeds(&[&tiny[..], &["--json", "--csv", "table.csv"]].concat()));
    let table = &report["tables"][0];
    let rows = table["rows"].as_array().unwrap();
    assert_eq!(table["rays"], 256);
    let exact: Vec<_> = rows.iter().filter(|row| row["is_exact"] == true).collect();
    assert!(exact.len() > 8 && rows.len() > exact.len() + 8);
    for row in rows {
        let number = |field: &str| row[field].as_f64().unwrap_or_else(|| panic!("{field} of {row}"));
        assert!(number("rays_per_second") > 0.0 && number("steps") > 0.0 && number("relative_time") > 0.0, "{row}");
        // Steps of a voxel against quarter steps in a smooth cloud.
        assert!(row["is_exact"] == false || number("error") < 0.05 && number("nearest") <= number("steps"), "{row}");
        assert!(row["is_exact"] == true || number("gain") > 0.0 && number("residual_variance") < 3.0, "{row}");
    }
    let samples =
        |name: &str| exact.iter().find(|row| row["structure"] == name).unwrap()["trilinear"].as_f64().unwrap();
    assert!(samples("octants 4³") <= samples("distance 4³") && samples("distance 4³") < samples("uniform steps"));
    let csv = fs::read_to_string(place.path("table.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    for (line, row) in csv.lines().skip(1).zip(rows) {
        assert!(line.contains(row["structure"].as_str().unwrap()), "{line}");
    }
}

#[test]
fn bench_scan_and_sort_compare_with_copies() {
    let place = Place::new();
    let tiny = ["--sizes", "8:12:4", "--runs", "2", "--json", "--csv", "t.csv", "--plot", "t.svg"];
    for (subject, more, rows) in [
        // Five copies and what is measured, at both sizes; the sort with and without payloads.
        ("scan", &[][..], 2 * (5 + 1)),
        ("sort", &["--ands", "1,4", "--bits", "12"], 2 * (5 + 2 * 2)),
    ] {
        let report = json(&place.succeeds(&[&["bench", subject], &tiny[..], more].concat()));
        let found = report["rows"].as_array().unwrap();
        assert_eq!(found.len(), rows, "{subject}");
        for row in found {
            let number = |name: &str| row[name].as_f64().unwrap();
            assert!(row["ms"]["p10"].as_f64() <= row["ms"]["median"].as_f64(), "{row}");
            let per_second = number("items") / (1e-3 * row["ms"]["median"].as_f64().unwrap());
            assert!((per_second / number("items_per_second") - 1.0).abs() < 1e-9, "{row}");
            assert!(number("of_copy") > 0.0, "{row}");
        }
        // Copies are compared with the fastest of them.
        let copies = found.iter().filter(|r| r["items"] == 4096 && r["parts"].as_array().unwrap().is_empty());
        assert_eq!(copies.map(|r| r["of_copy"].as_f64().unwrap()).fold(0.0, f64::max), 1.0);
        let csv = fs::read_to_string(place.path("t.csv")).unwrap();
        assert_eq!(csv.lines().count(), 1 + rows);
        let svg = fs::read_to_string(place.path("t.svg")).unwrap();
        assert!(svg.contains("items per second") && svg.contains(subject), "{svg}");
    }
    let text = place.succeeds(&["bench", "sort", "--sizes", "8:8:1", "--runs", "1", "--ands", "1", "--details"]);
    for word in ["histogram ", "pass 4 ", "polls in vain", "fallbacks", "% copy"] {
        assert!(text.contains(word), "{word}: {text}");
    }
}

#[test]
fn bench_scan_and_sort_refuse_what_does_not_fit() {
    let place = Place::new();
    place.fails(&["bench", "scan", "--sizes", "24:10:2"], 2, &["--sizes", "FROM:TO:STEP"]);
    place.fails(&["bench", "scan", "--sizes", "8:8:1", "--workgroup", "100"], 1, &["100 invocations", "multiples of"]);
    for (args, says) in [
        (["--blocked", "false", "--workgroup", "1024", "--keys", "32"], ["32 keys", "1024 invocations", "fewer keys"]),
        (["--blocked", "false", "--workgroup", "64", "--keys", "36"], ["--keys", "36 keys", "1 to 32"]),
        (["--blocked", "true", "--workgroup", "64", "--keys", "6"], ["--keys", "6 keys", "multiple of 4"]),
        (["--blocked", "true", "--workgroup", "256", "--keys", "8"], ["counters", "256 invocations", "smaller"]),
    ] {
        place.fails(&[&["bench", "sort", "--sizes", "8:8:1"], &args[..]].concat(), 1, &says);
    }
    place.fails(&["bench", "sort", "--sizes", "8:8:1", "--plot", "nowhere/t.svg"], 1, &["nowhere/t.svg"]);
}

/// Every way to choose directions is there at every size, is compared with `phase`, and is not measured twice.
#[test]
fn bench_scenes_keeps_what_it_measured() {
    let place = Place::new();
    let tiny = ["--edge", "8", "--pixels", "8", "--reference-spp", "8", "--iterations", "2", "--scenes", "tree"];
    let args = [&["bench", "scenes", "-o", "kept", "--json"], &tiny[..]].concat();
    let first = place.succeeds(&args);
    let report = json(&first);
    let table = &report["tables"][0];
    assert_eq!(table["dims"], serde_json::json!([8, 8, 3]));
    let rows = table["rows"].as_array().unwrap();
    for sampling in ["phase", "top", "resample", "residual", "auto"] {
        let of: Vec<_> = rows.iter().filter(|r| r["sampling"] == sampling).collect();
        let directions: Vec<u64> = of.iter().map(|r| r["directions"].as_u64().unwrap()).collect();
        assert!(directions.is_sorted() && directions.len() >= 5, "{sampling}: {directions:?}");
        assert!(of.iter().all(|r| r["ms"].as_f64() > Some(0.0) && r["noise"].as_f64() > Some(0.0)), "{of:?}");
        let orders = table["iterations"].as_array().unwrap().iter().filter(|r| r["sampling"] == sampling);
        assert_eq!(orders.map(|r| r["orders"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2], "{sampling}");
        let equal = table["equal"].as_array().unwrap().iter().find(|e| e["sampling"] == sampling);
        assert_eq!(equal.map(|e| e["speedups"].as_array().unwrap().len()), (sampling != "phase").then_some(5));
    }
    assert_eq!(place.succeeds(&args), first, "measured times are kept");
    place.write("file", "");
    place.fails(&["bench", "scenes", "-o", "file"], 1, &["file", "is no folder"]);
    place.fails(&["bench", "scenes", "-o", "x", "--scenes", "teapot"], 2, &["teapot", "skull"]);
}

/// Fixed and adaptive masks on a tiny phantom: more levels are less wrong, and a tolerance holds.
#[test]
fn bench_masks_compares_masks() {
    let place = Place::new();
    let tiny = ["bench", "masks", "--volume", PHANTOM, "--rays", "256", "--runs", "1"];
    let masks = ["--masks", "8,2,adaptive:0,adaptive:0.1,adaptive:1", "--json", "--csv", "masks.csv"];
    let report = json(&place.succeeds(&[&tiny[..], &masks].concat()));
    let rows = report["tables"][0]["rows"].as_array().unwrap();
    let number = |row: usize, field: &str| rows[row][field].as_f64().unwrap_or_else(|| panic!("{field} of {rows:?}"));
    let (eight, two, exact, tenth, whole) = (0, 1, 2, 3, 4);
    // Both are lossless; the adaptive one has no levels that do not occur.
    for field in ["runs", "buckets", "energy_error", "residual_variance"] {
        assert_eq!(number(eight, field), number(exact, field), "{field}");
    }
    for field in ["runs", "buckets", "hash_bits"] {
        assert!(number(exact, field) >= number(tenth, field) && number(tenth, field) > number(whole, field), "{field}");
    }
    assert!(number(exact, "hash_bits") < number(eight, "hash_bits"));
    // 8 bits are wrong by something, too.
    assert!(number(tenth, "energy_error") < 0.1 + number(exact, "energy_error"));
    assert!(number(exact, "energy_error") < number(tenth, "energy_error"));
    assert!(number(tenth, "energy_error") < number(two, "energy_error"));
    for row in 0..rows.len() {
        assert!(number(row, "build_ms") > 0.0 && number(row, "relative_time") > 0.0, "{rows:?}");
        assert_eq!(rows[row]["mask"], rows[row]["mask_used"]);
    }
    let csv = fs::read_to_string(place.path("masks.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    place.fails(&["bench", "masks", "--volume", PHANTOM, "--masks", "9"], 2, &["--masks", "'9' is no mask"]);
    place.fails(&["bench", "masks", "--all", "--volume", PHANTOM], 2, &["--all", "--volume"]);
}

/// One gather by every way: more directions are less noisy, `top` is too bright, and the others are right.
#[test]
fn bench_gather_compares_ways() {
    let place = Place::new();
    let tiny = ["bench", "gather", "--volume", PHANTOM, "--pixels", "16", "--seeds", "4"];
    let ways = ["--counts", "2,16", "--ratios", "2", "--json", "--csv", "gather.csv"];
    let report = json(&place.succeeds(&[&tiny[..], &ways].concat()));
    let table = &report["tables"][0];
    let rows = table["rows"].as_array().unwrap();
    let shapes: Vec<_> =
        rows.iter().map(|r| (r["sampling"].as_str().unwrap(), r["directions"].as_u64().unwrap())).collect();
    let of = |way, counts: &[u64]| counts.iter().map(|&n| (way, n)).collect::<Vec<_>>();
    let expected = ["top", "resample", "residual"].map(|way| of(way, &[2, 16])).concat();
    assert_eq!(shapes, [of("phase", &[2, 16, 32, 64]), expected].concat());
    let number =
        |row: &serde_json::Value, field: &str| row[field].as_f64().unwrap_or_else(|| panic!("{field} of {row}"));
    for row in rows {
        let has_proxy = row["sampling"] != "phase";
        assert_eq!(number(row, "build_ms") > 0.0 && number(row, "proxy_ms") > 0.0, has_proxy, "{row}");
        for field in ["trace_ms", "ms", "sampling_rate", "noise", "gain"] {
            assert!(number(row, field) > 0.0, "{field} of {row}");
        }
        let bias = number(row, "mean_bias");
        if row["sampling"] == "top" {
            assert!(bias > 0.02 && number(row, "bias") > 0.02, "{row}");
        } else {
            assert!(bias.abs() < 0.003 + 0.2 * number(row, "noise"), "{row}");
        }
    }
    for pair in rows.windows(2).filter(|pair| pair[0]["sampling"] == pair[1]["sampling"]) {
        assert!(number(&pair[1], "noise") < number(&pair[0], "noise"), "{pair:?}");
    }
    for field in ["traced_samples", "proxy_reads", "plain_samples_per_second", "solve_ms"] {
        assert!(number(table, field) > 0.0, "{field} of {table}");
    }
    let csv = fs::read_to_string(place.path("gather.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    place.fails(&["bench", "gather", "--ways", "auto"], 2, &["--ways", "auto", "residual"]);
    place.fails(&[&tiny[..], &["--light", "none"]].concat(), 1, &["no light", "cure"]);
}

#[test]
fn bench_proxy_refuses_what_has_no_light() {
    let place = Place::new();
    place.fails(&["bench"], 2, &["proxy"]);
    place.fails(&["bench", "proxy", "--rays", "1"], 2, &["--rays", "256"]);
    place.fails(&["bench", "proxy", "--all", "--volume", PHANTOM], 2, &["--all", "--volume"]);
    place.fails(&["bench", "proxy", "--volume", PHANTOM, "--csv", "nowhere/t.csv"], 1, &["nowhere/t.csv"]);
    let dark = ["bench", "proxy", "--volume", PHANTOM, "--rays", "256", "--runs", "1", "--light", "none"];
    place.fails(&dark, 1, &["no light", "cure"]);
    let empty = ["bench", "proxy", "--volume", PHANTOM, "--rays", "256", "--runs", "1", "--density", "0"];
    place.fails(&empty, 1, &["extinction", "cure"]);
}

// Wrong usage: exit code 2.

#[test]
fn wrong_usage_is_named() {
    let place = Place::new();
    place.fails(&[], 2, &["Usage"]);
    place.fails(&["rendr"], 2, &["rendr", "render"]);
    place.fails(&["render", "--nosuch"], 2, &["--nosuch"]);
    place.fails(&["render", "--model", "magic"], 2, &["magic", "--model", "absorption", "multiple"]);
    place.fails(&["render", "--sampling", "best"], 2, &["best", "--sampling", "resample"]);
    place.fails(&["render", "--bits", "12"], 2, &["12", "--bits"]);
    place.fails(&["render", "--validate=all"], 2, &["all", "--validate", "core", "gpu-assisted"]);
    place.fails(&["render", "--orders", "many"], 2, &["many", "--orders"]);
    place.fails(&["render", "--seed", "-1"], 2, &["-1"]);
    place.fails(&["compare", "a.exr"], 2, &["<B>"]);
    place.fails(&["inspect"], 2, &["<FILE>"]);
}

#[test]
fn bad_flag_values_are_named_with_their_bounds() {
    let place = Place::new();
    for (flag, value) in [
        ("--size", "0x512"),
        ("--size", "large"),
        ("--orders", "0"),
        ("--directions", "0"),
        ("--candidates", "100000"),
        ("--spp", "0"),
        ("--raw-size", "4x4"),
    ] {
        place.fails(&["render", flag, value], 2, &[flag]);
    }
}

#[test]
fn help_of_every_command_names_its_flags() {
    let place = Place::new();
    for (command, flags) in [
        ("render", &["--device", "--validate", "--seed", "--stats", "--output", "--bits", "--quiet"][..]),
        ("inspect", &["--json"]),
        ("compare", &["--json"]),
        ("devices", &["--json"]),
        ("bench", &["proxy"]),
    ] {
        let help = place.succeeds(&[command, "--help"]);
        for flag in flags {
            assert!(help.contains(flag), "{command}: {flag} is missing in {help}");
        }
    }
}

// Outputs that cannot be written are refused before anything is computed.

#[test]
fn shells_and_man_know_the_command_line() {
    let place = Place::new();
    for (shell, part) in [("bash", "complete -F"), ("zsh", "#compdef tyndall"), ("fish", "complete -c tyndall")] {
        let script = place.succeeds(&["completions", shell]);
        assert!(script.contains(part) && script.contains("light-grid") && script.contains("batch"), "{shell}");
    }
    place.fails(&["completions", "tcsh"], 2, &["tcsh", "bash"]);
    place.write("file", "");
    place.fails(&["man", "-o", "file"], 1, &["file", "is no folder", "cure"]);
    let report = place.succeeds(&["man", "-o", "pages"]);
    assert!(report.contains("pages to pages"), "{report}");
    for (page, part) in
        [("tyndall", "tyndall\\-render(1)"), ("tyndall-render", "light\\-grid"), ("tyndall-check", "inject")]
    {
        let text = fs::read_to_string(place.path(&format!("pages/{page}.1"))).unwrap();
        assert!(text.starts_with(".ie") && text.contains(part), "{page}: {text}");
    }
}

#[test]
fn unwritable_outputs_are_refused() {
    let place = Place::new();
    place.write("file", "");
    fs::create_dir(place.path("directory.png")).unwrap();
    let render = |flags: &[&str], parts: &[&str]| place.fails(&[&["render"], flags].concat(), 1, parts);
    render(&["-o", "missing/a.png"], &["missing/a.png", "not an existing directory", "cure"]);
    // A path under a regular file cannot be created even by root.
    render(&["-o", "file/a.png"], &["file/a.png", "not an existing directory"]);
    render(&["-o", "directory.png"], &["directory.png", "is a directory"]);
    render(&["--stats", "missing/stats.json"], &["missing/stats.json", "not an existing directory"]);
}

#[test]
fn unknown_picture_formats_are_refused() {
    let place = Place::new();
    place.fails(&["render", "-o", "a.jpg"], 1, &["a.jpg", "'.jpg'", ".png", ".exr"]);
    place.fails(&["render", "-o", "a"], 1, &["no extension", ".png"]);
}

// Input files.

/// Both commands that load a volume must refuse it alike.
fn volume_is_refused(place: &Place, name: &str, parts: &[&str]) {
    place.fails(&["inspect", name], 1, parts);
    place.fails(&["render", "--volume", name, "-o", "a.png"], 1, parts);
}

#[test]
fn missing_files_are_named() {
    let place = Place::new();
    volume_is_refused(&place, "nosuch.nrrd", &["nosuch.nrrd", "o such "]);
    place.fails(&["render", "nosuch.toml", "-o", "a.png"], 1, &["nosuch.toml", "No such file"]);
    place.write_picture("a.exr", 8, 0.5);
    place.fails(&["compare", "a.exr", "nosuch.exr"], 1, &["nosuch.exr", "No such file"]);
}

/// Devices and pipes may never end.
#[test]
#[cfg(unix)]
fn what_is_no_regular_file_is_not_read() {
    let place = Place::new();
    for args in [
        &["render", "/dev/zero"][..],
        &["render", "--volume", PHANTOM, "--transfer", "/dev/zero"],
        &["render", "--volume", PHANTOM, "--environment", "/dev/zero"],
        &["render", "--volume", "/dev/zero", "--raw-size", "1x1x1", "--raw-type", "u8"],
        &["compare", "/dev/zero", "/dev/zero"],
        &["merge", "/dev/zero", "-o", "a.exr"],
        &["check", "--allow", "/dev/zero"],
    ] {
        place.fails(args, 1, &["/dev/zero: this is not a regular file", "cure"]);
    }
}

#[test]
fn truncated_data_is_refused() {
    let place = Place::new();
    place.write_nrrd("short.nrrd", "4 5 6", 119);
    volume_is_refused(&place, "short.nrrd", &["short.nrrd", "120", "119", "cure"]);
}

#[test]
fn absurd_headers_are_refused_before_memory_is_reserved() {
    let place = Place::new();
    place.write_nrrd("huge.nrrd", "4096 4096 1024", 120);
    volume_is_refused(&place, "huge.nrrd", &["huge.nrrd", "cure"]);
    place.write_nrrd("overflow.nrrd", "4294967295 4294967295 4294967295", 120);
    volume_is_refused(&place, "overflow.nrrd", &["overflow.nrrd", "cure"]);
    place.write_nrrd("empty.nrrd", "4 0 6", 120);
    volume_is_refused(&place, "empty.nrrd", &["empty.nrrd", "cure"]);
    place.write("noise.nrrd", [0xFFu8; 300]);
    volume_is_refused(&place, "noise.nrrd", &["noise.nrrd", "cure"]);
}

#[test]
fn unknown_volume_formats_are_refused() {
    let place = Place::new();
    place.write("data.bin", [0u8; 64]);
    volume_is_refused(&place, "data.bin", &["data.bin", "cure"]);
}

#[test]
fn bad_scene_fields_are_named() {
    let place = Place::new();
    for (name, content, parts) in [
        ("unknown.toml", "[render]\nordres = 3\n", &["unknown.toml", "ordres", "orders"][..]),
        ("type.toml", "[render]\norders = \"many\"\n", &["type.toml", "orders"]),
        ("syntax.toml", "[render\n", &["syntax.toml"]),
    ] {
        place.write(name, content);
        place.fails(&["render", name, "-o", "a.png"], 1, parts);
    }
}

// Devices.

#[test]
fn unknown_device_is_refused() {
    let place = Place::new();
    let render = ["render", "--volume", PHANTOM, "--device"];
    place.fails(&[&render[..], &["nosuch"]].concat(), 1, &["nosuch", "cure"]);
    place.fails(&[&render[..], &["99"]].concat(), 1, &["99", "cure"]);
}

#[test]
fn machine_without_vulkan_devices_is_refused() {
    let place = Place::new();
    for args in [&["render", "--volume", PHANTOM][..], &["devices"]] {
        let mut command = place.command(args);
        // The second is the name that loaders before 1.3.234 know.
        command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        place.fails_as(command, 1, &["Vulkan", "cure"]);
    }
}

#[test]
fn devices_lists_name_limits_and_what_is_missing() {
    let place = Place::new();
    let list = json(&place.succeeds(&["devices", "--json"]));
    let devices = list.as_array().unwrap();
    assert!(!devices.is_empty());
    for device in devices {
        assert!(device["name"].as_str().is_some_and(|n| !n.is_empty()), "{device}");
        assert!(device["subgroup_size"].as_u64().is_some_and(|n| n > 0), "{device}");
        assert!(device["limits"].as_object().is_some_and(|l| !l.is_empty()), "{device}");
        assert!(device["missing"].is_array(), "{device}");
        let carry = device["carry"].as_str().unwrap();
        assert!(carry == "look-back" || carry == "dispatches", "{device}");
    }
    let text = place.succeeds(&["devices"]);
    assert!(text.contains(&format!("carry sums by {}", devices[0]["carry"].as_str().unwrap())), "{text}");
    assert!(text.contains(devices[0]["name"].as_str().unwrap()), "{text}");
}

// Inspect.

#[test]
fn inspect_reports_the_volume() {
    let place = Place::new();
    place.write_nrrd("a.nrrd", "4 5 6", 120);
    let report = json(&place.succeeds(&["inspect", "a.nrrd", "--json"]));
    assert_eq!(report["dims"], serde_json::json!([4, 5, 6]));
    assert_eq!(report["scalar_type"], "u8");
    assert_eq!(report["spacing"], serde_json::json!([1.0, 1.0, 2.0]));
    assert_eq!((&report["range"][0], &report["range"][1]), (&0.0.into(), &119.0.into()));
    let counts: u64 = report["histogram"]["counts"].as_array().unwrap().iter().map(|c| c.as_u64().unwrap()).sum();
    assert_eq!(counts, 120);
    let active = json(&place.succeeds(&["inspect", "a.nrrd", "--json", "--threshold", "-1,59,119"]));
    let fractions: Vec<_> = active["active"].as_array().unwrap().iter().map(|a| a["fraction"].clone()).collect();
    assert_eq!(fractions, [1.0, 0.5, 0.0]);
    let text = place.succeeds(&["inspect", "a.nrrd"]);
    for part in ["4x5x6", "u8", "119", "#"] {
        assert!(text.contains(part), "'{part}' is missing in {text}");
    }
}

#[test]
fn inspect_reads_raw_files_with_flags() {
    let place = Place::new();
    place.write("a.raw", [0, 0, 0, 1, 0, 2, 0, 3, 1, 0]);
    let flags = ["--raw-size", "2x2x1", "--raw-type", "u16", "--raw-endian", "big", "--raw-skip", "2"];
    let report = json(&place.succeeds(&[&["inspect", "a.raw", "--json"], &flags[..]].concat()));
    assert_eq!((&report["range"][0], &report["range"][1]), (&1.0.into(), &256.0.into()));
    place.fails(&["inspect", "a.raw", "--raw-size", "2x2x1"], 1, &["--raw-type", "cure"]);
    place.fails(&["inspect", "a.raw", "--raw-size", "0x2x1", "--raw-type", "u8"], 2, &["--raw-size", "cure"]);
}

#[test]
fn inspect_knows_phantoms() {
    let place = Place::new();
    let report = json(&place.succeeds(&["inspect", "phantom:cloud:12x10x8", "--json"]));
    assert_eq!((&report["name"], &report["dims"]), (&"phantom:cloud".into(), &serde_json::json!([12, 10, 8])));
    place.fails(&["inspect", "phantom:cloud:12x10"], 2, &["FILE", "three numbers", "cure"]);
    place.fails(&["inspect", "phantom:fog"], 1, &["'fog'", "cloud", "cure"]);
    let raw = ["inspect", "phantom:cloud", "--raw-size", "2x2x1", "--raw-type", "u8"];
    place.fails(&raw, 2, &["--raw-size", "no raw file", "cure"]);
}

// Compare.

#[test]
fn compare_reports_the_metrics() {
    let place = Place::new();
    place.write_picture("a.exr", 8, 0.55);
    place.write_picture("b.exr", 8, 0.5);
    let metrics = json(&place.succeeds(&["compare", "a.exr", "b.exr", "--json"]));
    assert!((metrics["bias"][0].as_f64().unwrap() - 0.1).abs() < 1e-6, "{metrics}");
    assert!((metrics["rmse"].as_f64().unwrap() - 0.05).abs() < 1e-6, "{metrics}");
    let text = place.succeeds(&["compare", "a.exr", "b.exr"]);
    assert!(text.contains("+10.0000 %"), "{text}");
    assert!(!text.contains("tone curve"), "{text}");

    let equal = json(&place.succeeds(&["compare", "a.exr", "a.exr", "--json"]));
    assert_eq!((&equal["rmse"], &equal["psnr"]), (&0.0.into(), &serde_json::Value::Null));
    place.write_picture("a.png", 8, 0.55);
    assert!(place.succeeds(&["compare", "a.png", "b.exr"]).contains("tone curve"));
}

#[test]
fn compare_refuses_different_sizes_and_other_files() {
    let place = Place::new();
    place.write_picture("a.exr", 8, 0.5);
    place.write_picture("b.exr", 9, 0.5);
    place.fails(&["compare", "a.exr", "b.exr"], 1, &["8x8", "9x8", "cure"]);
    place.write("c.exr", "text");
    place.fails(&["compare", "a.exr", "c.exr"], 1, &["c.exr", "not a picture", "cure"]);
}

// Streams.

#[test]
fn closed_stdout_is_no_error() {
    let place = Place::new();
    place.write_picture("a.exr", 8, 0.5);
    let mut child =
        place.command(&["compare", "a.exr", "a.exr"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
}

#[test]
#[cfg(target_os = "linux")]
fn full_stdout_is_an_error() {
    let place = Place::new();
    place.write_picture("a.exr", 8, 0.5);
    let full = fs::File::options().write(true).open(Path::new("/dev/full")).unwrap();
    let output = place.command(&["compare", "a.exr", "a.exr"]).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("stdout: cannot write"));
}

// Rendering.

const SMALL: [&str; 9] = ["render", "--volume", PHANTOM, "--size", "24x16", "--orders", "2", "--spp", "1"];

#[test]
fn render_writes_picture_and_figures() {
    let place = Place::new();
    let text = place.succeeds(&[&SMALL[..], &["-o", "a.exr", "--stats", "s.json"]].concat());
    assert!(text.contains("24x16") && text.contains("wrote a.exr"), "{text}");
    let names: Vec<_> = place.files().into_iter().map(|f| f.0).collect();
    assert_eq!(names, ["a.exr", "s.json"]);
    let stats = json(&fs::read_to_string(place.path("s.json")).unwrap());
    assert_eq!(stats["settings"]["orders"], 2);
    assert!(stats["volume"]["active_fraction"].as_f64().is_some_and(|f| f > 0.0 && f < 1.0), "{stats}");
    assert!(!stats["passes"].as_array().unwrap().is_empty() && stats["wall_ms"].as_f64().unwrap() > 0.0);
    let picture = output::read_picture(&place.path("a.exr")).unwrap();
    assert_eq!((picture.width, picture.height), (24, 16));
    assert!(picture.pixels.iter().any(|p| p[0] > 0.0));
}

/// Without look-back everything is the same: what a device is told to do where it stalls.
#[test]
fn the_way_of_carrying_sums_changes_no_byte() {
    let place = Place::new();
    let dispatches = ["look-back", "dispatches"].map(|way| {
        let proxy = ["--sampling", "resample", "--candidates", "16", "--directions", "4", "--carry", way];
        place.succeeds(&[&SMALL[..], &proxy, &["-o", &format!("{way}.exr"), "--stats", "s.json", "--quiet"]].concat());
        let stats = json(&fs::read_to_string(place.path("s.json")).unwrap());
        assert_eq!(stats["device"]["carry"], way);
        let passes = stats["passes"].as_array().unwrap();
        ["compact", "proxy.compress1", "proxy.sort", "proxy.compress2"].map(|name| {
            let pass = passes.iter().find(|p| p["name"] == name).expect("every pass is there");
            pass["dispatches"].as_u64().unwrap()
        })
    });
    assert!(dispatches[0].iter().zip(dispatches[1]).all(|(one, three)| three > *one), "{dispatches:?}");
    let bytes = |name: &str| fs::read(place.path(name)).unwrap();
    assert!(bytes("look-back.exr") == bytes("dispatches.exr"));
    place.fails(&[&SMALL[..], &["--carry", "pigeon"]].concat(), 2, &["--carry", "look-back", "dispatches"]);
}

#[test]
fn same_seed_gives_same_bytes_and_another_seed_others() {
    let place = Place::new();
    for (name, seed) in [("a.exr", "7"), ("b.exr", "7"), ("c.exr", "8")] {
        place.succeeds(&[&SMALL[..], &["-o", name, "--seed", seed, "--quiet"]].concat());
    }
    let files = place.files();
    assert_eq!(files[0].1, files[1].1);
    assert_ne!(files[0].1, files[2].1);
}

#[test]
fn quiet_is_quiet_and_json_is_json() {
    let place = Place::new();
    assert_eq!(place.succeeds(&[&SMALL[..], &["--quiet"]].concat()), "");
    assert!(place.path("tyndall.png").exists());
    assert!(json(&place.succeeds(&[&SMALL[..], &["--json"]].concat()))["gpu_ms"].is_number());
}

#[test]
fn validation_has_nothing_to_say() {
    let place = Place::new();
    let kind = std::env::var("TYNDALL_VALIDATION").unwrap_or("core".into());
    // lavapipe takes minutes to compile the proxy's kernels once GPU-assisted validation has instrumented them.
    let sampling = if kind == "gpu-assisted" { "phase" } else { "resample" };
    let flags = [&format!("--validate={kind}"), "--stats", "s.json", "--sampling", sampling];
    place.succeeds(&[&SMALL[..], &flags].concat());
    let stats = json(&fs::read_to_string(place.path("s.json")).unwrap());
    assert_eq!(stats["validation"], serde_json::json!({"enabled": true, "errors": 0, "warnings": 0}));
}

/// Without barriers there are hazards.
#[test]
fn a_validation_message_ends_with_exit_code_1_and_no_picture() {
    let place = Place::new();
    let faulty = ["--validate", "--inject", "missing-barrier", "--stats", "s.json"];
    let output = place.run(&[&SMALL[..], &faulty].concat());
    let stderr = text(&output.stderr);
    assert_eq!((output.status.code(), text(&output.stdout).as_str()), (Some(1), ""), "{stderr}");
    assert!(stderr.contains("validation reported") && stderr.contains("HAZARD"), "{stderr}");
    // The figures, which count the messages, are all that is left.
    let names: Vec<_> = place.files().into_iter().map(|f| f.0).collect();
    assert_eq!(names, ["s.json"]);
    let stats = json(&fs::read_to_string(place.path("s.json")).unwrap());
    assert!(stats["validation"]["errors"].as_u64().unwrap() > 0, "{stats}");
}

/// As a full disk does it: a limit on the size of files stops the write amid the picture.
#[test]
#[cfg(unix)]
fn a_full_disk_leaves_no_file() {
    let place = Place::new();
    for name in ["a.png", "a.exr"] {
        let mut shell = std::process::Command::new("sh");
        let limited = "trap '' XFSZ; ulimit -f 1; exec \"$@\"";
        let render = ["render", "--volume", PHANTOM, "--size", "64x48", "--spp", "1", "--orders", "1", "-o", name];
        let program = env!("CARGO_BIN_EXE_tyndall");
        shell.args(["-c", limited, "sh", program]).args(render).current_dir(place.0.path());
        shell.env("TYNDALL_CACHE_DIR", "");
        place.fails_as(shell, 1, &[name, "cannot write", "File too large"]);
    }
}

#[test]
#[cfg(unix)]
fn interrupt_leaves_no_file() {
    let place = Place::new();
    // Long enough that the interrupt surely comes first.
    let args = ["-o", "a.png", "--stats", "s.json", "--size", "2048x2048", "--spp", "64", "--orders", "8"];
    let args = [&["render", "--volume", PHANTOM], &args[..]].concat();
    for wait in [500, 2000, 8000] {
        let child = place.command(&args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(wait));
        interrupt(&child);
        let output = child.wait_with_output().unwrap();
        assert!(place.files().is_empty(), "{:?}", place.files());
        // Before the render begins the system ends the program.
        if output.status.code().is_some() {
            let stderr = text(&output.stderr);
            assert_eq!(output.status.code(), Some(130), "{stderr}");
            assert!(stderr.contains("stopped before it was done"), "{stderr}");
            return;
        }
    }
    panic!("the render did not begin within 8 seconds");
}
