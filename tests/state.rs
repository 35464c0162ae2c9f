//! Saved renders: resumed to the same bytes, merged to the same light, refused when damaged or of something else.

mod common;
#[path = "common/place.rs"]
mod place;

use place::Place;
use std::fs;
use tyndall::output::read_picture;
use tyndall::render::state::{State, Stream};

/// A path-traced render of a small built-in volume under sun and sky.
const RENDER: [&str; 12] = [
    "render",
    "--volume",
    "phantom:cloud:24x20x16",
    "--model",
    "path",
    "--size",
    "20x14",
    "--orders",
    "5",
    "--light",
    "directional:30,40,2",
    "--environment=0.5",
];

fn render<'a>(more: &[&'a str]) -> Vec<&'a str> {
    RENDER.iter().chain(more).copied().collect()
}

/// Renders `spp` samples of `seed` into NAME.state and NAME.exr.
fn save(place: &Place, name: &str, seed: u32, spp: u32) {
    let (state, picture) = (format!("{name}.state"), format!("{name}.exr"));
    let (seed, spp) = (seed.to_string(), spp.to_string());
    place.succeeds(&render(&["--seed", &seed, "--spp", &spp, "--state", &state, "-o", &picture]));
}

#[test]
fn a_resumed_render_has_the_bytes_of_an_uninterrupted_one() {
    let place = Place::new();
    for spp in [3, 4, 11, 30] {
        save(&place, "resumed", 7, spp);
    }
    save(&place, "whole", 7, 30);
    place.succeeds(&render(&["--seed", "7", "--spp", "30", "-o", "stateless.exr"]));
    let file = |name: &str| fs::read(place.path(name)).unwrap();
    assert!(file("resumed.state") == file("whole.state"));
    assert!(file("resumed.exr") == file("whole.exr"));
    assert!(file("stateless.exr") == file("whole.exr"));
    // Fewer samples than there are: the picture of all of them.
    save(&place, "resumed", 7, 5);
    assert!(file("resumed.exr") == file("whole.exr"));
    assert!(file("resumed.state") == file("whole.state"));
}

#[test]
fn time_limits_save_what_there_is() {
    let place = Place::new();
    let some = ["--seconds", "0.3", "--state", "timed.state", "-o", "timed.exr"];
    place.succeeds(&render(&some));
    let first = State::load(&place.path("timed.state")).unwrap().sums.samples;
    assert!(first > 0);
    place.succeeds(&render(&some));
    assert!(State::load(&place.path("timed.state")).unwrap().sums.samples > first);
}

/// However many samples there are already, the time limit is looked at after a few more.
#[test]
fn a_resumed_render_keeps_to_its_time() {
    let place = Place::new();
    save(&place, "a", 7, 64);
    let all_out = ["--seed", "7", "--seconds", "1e-6", "--state", "a.state", "-o", "a.exr"];
    place.succeeds(&render(&all_out));
    assert_eq!(State::load(&place.path("a.state")).unwrap().sums.samples, 68);
}

#[test]
fn merged_renders_are_the_mean_of_all_samples() {
    let place = Place::new();
    for (name, seed, spp) in [("a", 1, 6), ("b", 2, 10), ("c", 3, 2)] {
        save(&place, name, seed, spp);
    }
    let said = place.succeeds(&["merge", "a.state", "b.state", "-o", "ab.exr", "--state", "ab.state"]);
    assert!(said.contains("16 samples per pixel of 2 seeds"), "{said}");
    place.succeeds(&["merge", "ab.state", "c.state", "-o", "abc.exr"]);
    place.succeeds(&["merge", "c.state", "b.state", "a.state", "-o", "cba.exr"]);
    let pixels = |name: &str| read_picture(&place.path(name)).unwrap().pixels;
    let (a, b, c, all, other) =
        (pixels("a.exr"), pixels("b.exr"), pixels("c.exr"), pixels("abc.exr"), pixels("cba.exr"));
    for i in 0..a.len() {
        for k in 0..4 {
            let mean = (6.0 * a[i][k] + 10.0 * b[i][k] + 2.0 * c[i][k]) / 18.0;
            assert!((all[i][k] - mean).abs() <= 3e-6 * mean, "{} {mean}", all[i][k]);
            assert!((all[i][k] - other[i][k]).abs() <= 1e-6 * mean);
        }
    }
    let merged = State::load(&place.path("ab.state")).unwrap();
    assert_eq!(merged.header.streams, [Stream { seed: 1, samples: 6 }, Stream { seed: 2, samples: 10 }]);
}

#[test]
fn states_of_something_else_are_refused() {
    let place = Place::new();
    save(&place, "a", 1, 2);
    save(&place, "b", 2, 2);
    let to_a = |more: &[&'static str]| render(&[&["--spp", "4", "--state", "a.state", "-o", "x.exr"], more].concat());
    place.fails(&to_a(&[]), 1, &["a.state", "seed 1", "--seed 1"]);
    for other in [
        &["--seed", "1", "--g", "0.1"][..],
        &["--seed", "1", "--azimuth", "3"],
        &["--seed", "1", "--density", "2"],
        &["--seed", "1", "--background", "transparent"],
    ] {
        place.fails(&to_a(other), 1, &["a.state", "another scene"]);
    }
    let mut sized = to_a(&["--seed", "1"]);
    sized[6] = "20x15";
    place.fails(&sized, 1, &["a.state", "20x14"]);
    let mut volume = to_a(&["--seed", "1"]);
    volume[2] = "phantom:cloud:24x20x17";
    place.fails(&volume, 1, &["a.state", "another scene"]);

    place.fails(&["merge", "a.state", "a.state", "-o", "x.exr"], 1, &["a.state", "seed 1", "twice"]);
    place.fails(&["merge", "a.state"], 2, &["--output"]);
    place.fails(&["merge", "-o", "x.exr"], 2, &["STATE"]);
    place.succeeds(&["merge", "a.state", "b.state", "--state", "ab.state"]);
    let onto = render(&["--seed", "1", "--spp", "9", "--state", "ab.state", "-o", "x.exr"]);
    place.fails(&onto, 1, &["ab.state", "merged of 2 seeds", "new seed"]);
    let local = ["render", "--volume", "phantom:cloud:9x9x9", "--state", "a.state"];
    place.fails(&local, 2, &["--state", "--model path"]);
    place.fails(&render(&["--state", "nowhere/a.state"]), 1, &["nowhere"]);
}

#[test]
fn damaged_states_are_refused() {
    let place = Place::new();
    save(&place, "good", 1, 2);
    let good = fs::read(place.path("good.state")).unwrap();
    let header = u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    let refused = |bytes: &[u8], parts: &[&str]| {
        place.write("bad.state", bytes);
        place.fails(&["merge", "bad.state", "-o", "x.exr"], 1, &[&["bad.state"], parts].concat());
        let resume = render(&["--seed", "1", "--spp", "4", "--state", "bad.state", "-o", "x.exr"]);
        place.fails(&resume, 1, &["bad.state"]);
    };
    for length in [0, 7, 15, 16, 40, 16 + header, good.len() / 2, good.len() - 1] {
        refused(&good[..length], &["cure"]);
    }
    refused(&[&good[..], &[0]].concat(), &["bytes where its header asks for"]);
    for at in [16 + header, good.len() / 2, good.len() - 1] {
        let mut bytes = good.clone();
        bytes[at] ^= 4;
        refused(&bytes, &["checksum"]);
    }
    let changed = |at: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[at] = byte;
        bytes
    };
    refused(&changed(0, b'X'), &["no saved render"]);
    refused(&changed(8, 9), &["version 9"]);
    refused(&changed(15, 0xFF), &["absurdly long"]);
    refused(&changed(16, b'['), &["header"]);
    // Promises of gigabytes, before memory is reserved for them.
    let text = String::from_utf8(good[16..16 + header].to_vec()).unwrap();
    for (from, to) in
        [("[20,14]", "[4294967295,4294967295]"), ("[20,14]", "[20,0]"), ("\"samples\":2", "\"samples\":-2")]
    {
        let text = text.replace(from, to);
        assert!(text.contains(to), "{text}");
        let mut bytes = [&good[..12], &(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        bytes.extend_from_slice(&good[16 + header..]);
        refused(&bytes, &["header"]);
    }
}
