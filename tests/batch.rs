//! `tyndall batch` as a user meets it: frames, what is done once, what is skipped, what fails, how it is stopped and goes on.

#[path = "common/place.rs"]
mod place;

use place::{Place, text};
use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

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

/// A scene of `[volume]` and what follows; small, and quick to render.
fn scene(more: &str) -> String {
    format!(
        "[volume]\nphantom = \"cloud\"\nsize = [12, 10, 8]\n\
         [render]\nsize = [16, 12]\norders = 2\nspp = 2\ndirections = 4\n{more}"
    )
}

fn picture(place: &Place, name: &str) -> Vec<u8> {
    fs::read(place.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn passes(stats: &serde_json::Value, frame: usize) -> Vec<String> {
    let passes = stats["frames"][frame]["passes"].as_array().unwrap();
    passes.iter().map(|p| p["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_camera_goes_from_key_to_key_in_one_light() {
    let place = Place::new();
    let key = |frame: u32, azimuth: f64, zoom: f64| {
        format!("[[animation.key]]\nframe = {frame}\ncamera = {{ azimuth = {azimuth}, zoom = {zoom} }}\n")
    };
    place.write("move.toml", scene(&[key(0, 0.0, 1.0), key(2, 90.0, 2.0), key(4, 100.0, 2.0)].concat()));
    place.succeeds(&["batch", "move.toml", "-o", "f{}.exr", "--stats", "s.json", "--quiet"]);
    assert_eq!(names(&place), ["f0.exr", "f1.exr", "f2.exr", "f3.exr", "f4.exr", "move.toml", "s.json"]);
    let stats = stats(&place);
    assert!(passes(&stats, 0).len() > 1);
    (1..5).for_each(|frame| assert_eq!(passes(&stats, frame), ["camera"], "frame {frame}"));
    assert_eq!(stats["settings"]["light_for"], "every-view");
    let frames: Vec<_> = (0..5).map(|i| picture(&place, &format!("f{i}.exr"))).collect();
    frames.windows(2).for_each(|pair| assert!(pair[0] != pair[1], "the camera stands still"));
    // The first frame is what render shows; whatever comes last, a later one is the same by itself.
    place.succeeds(&["render", "move.toml", "-o", "first.exr", "--quiet"]);
    assert!(picture(&place, "first.exr") == frames[0]);
    place.succeeds(&["batch", "move.toml", "-o", "again{}.exr", "--frames", "3..4", "--quiet"]);
    assert!(picture(&place, "again3.exr") == frames[3]);
}

/// What keys change, frame by frame, is what a scene with these values shows.
#[test]
fn lights_media_and_transfer_functions_have_keys() {
    let parts = |strength: f64, g: f64, opacity: f64, sky: f64, stops: f64| {
        let point = |value: f64, opacity: f64| format!("{{ value = {value}, color = 0.8, opacity = {opacity} }}");
        [
            ("light", format!("[{{ azimuth = 30, elevation = 40, irradiance = {strength} }}]")),
            ("medium", format!("{{ g = {g} }}")),
            ("transfer", format!("{{ points = [{}, {}] }}", point(0.0, 0.0), point(1.0, opacity))),
            ("environment", format!("{{ radiance = {sky} }}")),
            ("output", format!("{{ exposure = {stops} }}")),
        ]
    };
    let fields = |values: [(&str, String); 5]| values.map(|(name, value)| format!("{name} = {value}\n")).concat();
    let place = Place::new();
    let key = |frame: u32, values| format!("[[animation.key]]\nframe = {frame}\n{}", fields(values));
    let keys = key(0, parts(1.0, 0.0, 0.2, 0.5, 0.0)) + &key(2, parts(3.0, 0.5, 0.6, 0.1, 1.0));
    place.write("change.toml", scene(&keys));
    place.write("middle.toml", fields(parts(2.0, 0.25, 0.4, 0.3, 0.5)) + &scene(""));
    place.succeeds(&["batch", "change.toml", "--quiet", "--stats", "s.json"]);
    place.succeeds(&["render", "middle.toml", "-o", "middle.png", "--quiet"]);
    assert!(picture(&place, "middle.png") == picture(&place, "frame_0001.png"));
    let stats = stats(&place);
    assert!((0..3).all(|frame| passes(&stats, frame).len() > 1), "light of another frame");
    assert_eq!(stats["settings"]["light_for"], "view");
}

/// Numbers of files count as numbers; a frame may show the same volume as the one before it, in the light that is there.
#[test]
fn a_series_of_volumes() {
    let place = Place::new();
    for (number, level) in [(2, 60), (9, 120), (10, 240)] {
        let voxels: Vec<u8> = (0..8 * 8 * 8).map(|i| if i % 3 == 0 { level } else { level / 2 }).collect();
        place.write(&format!("v_{number}.raw"), voxels);
    }
    let flags =
        ["--raw-size", "8x8x8", "--raw-type", "u8", "--size", "16x12", "--spp", "2", "--directions", "4", "--quiet"];
    let run = |command: &str, volume: &str, more: &[&str]| {
        place.succeeds(&[&[command, "--volume", volume], &flags[..], more].concat());
    };
    run("batch", "v_*.raw", &["-o", "f{}.exr"]);
    for (frame, number) in [2, 9, 10].into_iter().enumerate() {
        run("render", &format!("v_{number}.raw"), &["-o", "one.exr"]);
        assert!(picture(&place, "one.exr") == picture(&place, &format!("f{frame}.exr")), "frame {frame}");
    }
    run("render", "v_*.raw", &["-o", "one.exr"]);
    assert!(picture(&place, "one.exr") == picture(&place, "f0.exr"));
    // Six frames of a turn around three volumes.
    run("batch", "v_*.raw", &["-o", "t{}.exr", "--turntable", "6", "--light-for", "every-view", "--stats", "s.json"]);
    let stats = stats(&place);
    for frame in 0..6 {
        assert_eq!(passes(&stats, frame) == ["camera"], frame % 2 == 1, "frame {frame}");
    }
    place.fails(&["batch", "--volume", "w_*.raw"], 1, &["w_*.raw", "no file has such a name", "cure"]);
}

#[test]
fn parts_and_one_by_one_give_the_same_bytes() {
    let whole = Place::new();
    whole.succeeds(&flags(&["--quiet"]));
    let parts = Place::new();
    for part in ["3/3", "1/3", "2/3"] {
        parts.succeeds(&flags(&["--quiet", "--shard", part]));
    }
    assert!(whole.files() == parts.files());
    assert_eq!(whole.files().len(), 4);
    let slow = Place::new();
    slow.succeeds(&flags(&["--quiet", "--one-by-one"]));
    assert!(whole.files() == slow.files());
}

#[test]
fn many_scenes_of_which_one_is_broken() {
    let place = Place::new();
    place.write("a1.toml", scene(""));
    place.write("a2.toml", scene("[turntable]\nframes = 2\n"));
    place.write("a3.toml", scene("[turntable]\nframe = 2\n"));
    place.write("a4.toml", "[volume]\nfile = \"absent.nrrd\"\n");
    let output = place.run(&["batch", "a*.toml", "--quiet", "--stats", "s.json", "--log", "log.jsonl"]);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    for part in ["a3.toml:10", "a4, frame 0: absent.nrrd", "1 of 4 frames failed"] {
        assert!(stderr.contains(part), "'{part}' is missing in {stderr}");
    }
    let pictures: Vec<_> = names(&place).into_iter().filter(|n| n.ends_with("png")).collect();
    assert_eq!(pictures, ["a1_0000.png", "a2_0000.png", "a2_0001.png"]);
    assert_eq!(of_frames(&stats(&place), "scene"), ["a1", "a2", "a2", "a4"]);

    let log = fs::read_to_string(place.path("log.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.iter().map(|l| l["event"].as_str().unwrap()).collect::<String>(), "beginframeframeframeframeend");
    assert_eq!((&lines[0]["wanted"], &lines[5]["rendered"], &lines[5]["failed"]), (&4.into(), &3.into(), &1.into()));
    assert!(lines[1..5].iter().any(|l| l["outcome"] == "failed" && l["file"] == "a4_0000.png"), "{log}");
    assert!(lines.iter().all(|l| l["time"].as_f64().unwrap() > 1.7e9));

    // One broken file among whole ones is a failure too, and only that is left.
    fs::remove_file(place.path("a4.toml")).unwrap();
    let output = place.run(&["batch", "a*.toml", "--quiet"]);
    assert!(text(&output.stderr).contains("1 of 3 scenes could not be read"), "{}", text(&output.stderr));
    fs::remove_file(place.path("a3.toml")).unwrap();
    place.succeeds(&["batch", "a1.toml", "a2.toml", "--quiet"]);
    fs::create_dir(place.path("b")).unwrap();
    place.write("b/a1.toml", scene(""));
    place.fails(&["batch", "a1.toml", "b/a1.toml", "-o", "x{scene}.png"], 2, &["two scenes", "xa1.png", "cure"]);
    place.fails(&["batch", "a1.toml", "a2.toml", "-o", "x{}.png"], 2, &["x{}.png", "{scene}"]);
}

/// Flags of a batch of many frames.
fn long(more: &[&'static str]) -> Vec<&'static str> {
    let small = SMALL.strip_suffix("--turntable 4").unwrap();
    let long = small.split_ascii_whitespace().chain(["--turntable", "200", "--quiet"]);
    long.chain(more.iter().copied()).collect()
}

/// Such a batch, begun; two of its frames are there.
fn begun(place: &Place) -> Child {
    let mut command = place.command(&long(&[]));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(120);
    while !place.path("frame_0001.png").exists() {
        assert!(Instant::now() < deadline && child.try_wait().unwrap().is_none(), "it ended early");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

fn long_run() -> Vec<(String, Vec<u8>)> {
    let place = Place::new();
    place.succeeds(&long(&["--frames", "0..12"]));
    place.files()
}

#[test]
fn what_is_killed_goes_on() {
    let place = Place::new();
    let mut child = begun(&place);
    child.kill().unwrap();
    child.wait().unwrap();
    // Left by a process that was killed while writing; and one that is being written.
    place.write(".tyndall-left.png", "half");
    let locked = fs::File::create(place.path(".tyndall-busy.png")).unwrap();
    locked.lock().unwrap();
    assert!(!place.path("frame_0199.png").exists(), "it was too fast to be killed");
    place.succeeds(&long(&["--frames", "0..12"]));
    drop(locked);
    let files = place.files();
    assert_eq!(files.iter().map(|f| &f.0).filter(|n| n.starts_with('.')).collect::<Vec<_>>(), [".tyndall-busy.png"]);
    let frames: Vec<_> = files.into_iter().filter(|f| f.0.starts_with("frame_00")).take(12).collect();
    assert!(frames == long_run());
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_whole_frames() {
    let place = Place::new();
    let child = begun(&place);
    place::interrupt(&child);
    let output = child.wait_with_output().unwrap();
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("stopped") && stderr.contains("start again to render what is missing"), "{stderr}");
    let names = names(&place);
    assert!(names.len() >= 2 && names.len() < 200 && names.iter().all(|n| n.starts_with("frame_")), "{names:?}");
    place.succeeds(&long(&["--frames", "0..12"]));
    assert!(place.files()[..12] == long_run()[..]);
}

/// The device is gone: one error, what was finished is whole, and another start goes on from there.
#[test]
fn a_lost_device_ends_the_batch() {
    let place = Place::new();
    let output = place.run(&long(&["--inject", "device-loss", "--log", "log.jsonl"]));
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(
        stderr.starts_with("error: the device was lost") && stderr.contains("finished pictures are whole"),
        "{stderr}"
    );
    let log = fs::read_to_string(place.path("log.jsonl")).unwrap();
    assert!(log.lines().last().unwrap().contains("\"event\":\"end\""), "{log}");
    fs::remove_file(place.path("log.jsonl")).unwrap();
    let names = names(&place);
    assert!(!names.is_empty() && names.len() < 200 && names.iter().all(|n| n.starts_with("frame_")), "{names:?}");
    place.succeeds(&long(&["--frames", "0..12"]));
    assert!(place.files()[..12] == long_run()[..]);
}

/// A program in ffmpeg's place, which notes what it gets.
#[cfg(unix)]
#[test]
fn videos_are_made_of_all_frames() {
    use std::os::unix::fs::PermissionsExt;
    let place = Place::new();
    fs::create_dir(place.path("bin")).unwrap();
    let with_path = |path: &str, more: &[&str]| {
        let video = if more.contains(&"--video") { vec![] } else { vec!["--video", "turn.mp4"] };
        let mut command = place.command(&flags(&[video.as_slice(), &["--fps", "12.5"], more].concat()));
        command.env("PATH", format!("{}:{path}", place.path("bin").display()));
        command
    };
    place.fails_as(with_path("", &[]), 2, &["--video", "ffmpeg", "cure"]);
    let program = "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\nfor last; do :; done\necho \"$*\" >args\n\
        case $last in *.mp4 | *.webp | *.gif) ;; *) exit 3 ;; esac\ncat >\"$last\"\n[ -e fail ] && echo no room >&2 && exit 1\nexit 0\n";
    place.write("bin/ffmpeg", program);
    fs::set_permissions(place.path("bin/ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let run = |more: &[&str]| with_path("/usr/bin:/bin", more).output().unwrap();

    let part = run(&["--shard", "1/2"]);
    assert!(text(&part.stdout).contains("no turn.mp4 yet: 2 frames are missing"), "{}", text(&part.stdout));
    place.write("fail", "");
    let failed = run(&[]);
    assert_eq!(failed.status.code(), Some(1));
    assert!(text(&failed.stderr).contains("ffmpeg failed") && text(&failed.stderr).contains("no room"));
    assert!(!place.path("turn.mp4").exists());
    fs::remove_file(place.path("fail")).unwrap();
    let made = run(&[]);
    assert!(text(&made.stdout).contains("wrote turn.mp4"), "{}", text(&made.stderr));
    let frames: Vec<u8> = (0..4).flat_map(|i| picture(&place, &format!("frame_{i:04}.png"))).collect();
    assert!(picture(&place, "turn.mp4") == frames);
    let args = || text(&picture(&place, "args"));
    assert!(args().contains("-framerate 12.5 -i -") && args().contains("libx264"), "{}", args());
    for (video, encoding) in [("turn.webp", "-c:v libwebp_anim"), ("turn.gif", "paletteuse")] {
        run(&["--video", video]);
        assert!(picture(&place, video) == frames && args().contains(encoding), "{}", args());
        assert!(!args().contains("libx264"), "{}", args());
    }
    let exr = with_path("/usr/bin:/bin", &["-o", "f{}.exr"]).output().unwrap();
    assert!(text(&exr.stderr).contains("a video is made of PNGs"), "{}", text(&exr.stderr));
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
    fails(&["-o", "{x}.png"], 2, &["{x}", "{:04}"]);
    fails(&["--shard", "4/3"], 2, &["4/3", "I/N"]);
    fails(&["--log", "missing/log"], 1, &["not an existing directory"]);
    fails(&["-o", "f{}.jpg"], 1, &["'.jpg'", ".exr"]);
    fails(&["-o", "missing/f{}.png"], 1, &["not an existing directory"]);
    place.fails(&[&none[..], &["--turntable", "0"]].concat(), 2, &["--turntable", "from 1 to"]);
    place.fails(&[&small[..], &["--turntable-degrees", "inf"]].concat(), 2, &["--turntable-degrees"]);
    place.write("a.toml", "[volume]\nphantom = \"cloud\"\n[turntable]\nframes = 0\n");
    place.fails(&["batch", "a.toml"], 1, &["a.toml:4", "turntable.frames"]);
    place.fails(&["batch", "b*.toml"], 1, &["b*.toml", "no file has such a name"]);
    let keys = |name: &str, text: &str, parts: &[&str]| {
        place.write(name, format!("[volume]\nphantom = \"cloud\"\n{text}"));
        place.fails(&["batch", name], 1, &[&[name, "cure"], parts].concat());
    };
    let key = "[[animation.key]]\nframe = ";
    keys("order.toml", &format!("{key}3\n{key}3\n"), &["order.toml:6", "animation.key.1.frame", "order the keys"]);
    keys("range.toml", &format!("{key}0\ncamera.fov = 200\n"), &["range.toml:5", "animation.key.0.camera.fov"]);
    let light = "light = [{ azimuth = 0, irradiance = 1 }]\n";
    keys("more.toml", &format!("{key}0\n{light}{key}1\nlight = []\n"), &["animation.key.1.light", "as many"]);
    keys("frame.toml", "[[animation.key]]\ncamera.fov = 20\n", &["frame.toml", "frame"]);
    let both = format!("[turntable]\nframes = 4\n{key}0\ncamera.azimuth = 20\n");
    keys("both.toml", &both, &["moves the camera", "turntable"]);
    keys("count.toml", "[turntable]\nframes = 4\n[animation]\nframes = 5\n", &["animation.frames", "4 frames"]);
    // Two kinds of place at one light: what is between them would be neither.
    let two = format!("{key}0\n{light}{key}1\nlight = [{{ position = [0, 0, 9], intensity = 1 }}]\n");
    keys("kinds.toml", &two, &["kinds.toml:5", "animation.key.0.light.0", "in one way"]);
}
