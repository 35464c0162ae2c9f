//! Picture files: what is written is what is read, whole or not at all.

use std::fs;
use std::path::Path;

use tyndall::output::{self, BitDepth, Picture, PngOptions};
use tyndall::scene::{Exposure, ToneCurve};

const LINEAR: PngOptions =
    PngOptions { bits: BitDepth::Sixteen, exposure: Exposure::Stops(0.0), tone: ToneCurve::Linear };

/// Every pixel different, alpha from 0 to 1, colours not above alpha.
fn gradient(width: u32, height: u32) -> Picture {
    let pixel = |i: u32| {
        let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / (height - 1) as f32);
        [x * y, (1.0 - x) * y, 0.25 * y, y]
    };
    Picture { width, height, pixels: (0..width * height).map(pixel).collect() }
}

fn names_in(directory: &Path) -> Vec<String> {
    fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

fn greatest_difference(a: &Picture, b: &Picture) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn exr_keeps_every_bit() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    let mut picture = gradient(37, 11);
    picture.pixels[5] = [1e30, -2.5, 1e-40, 1.0];
    output::write_picture(&path, &picture, &LINEAR).unwrap();
    assert_eq!(output::read_picture(&path).unwrap(), picture);
    assert_eq!(names_in(directory.path()), ["a.exr"]);
}

#[test]
fn equal_pictures_give_equal_bytes() {
    let directory = tempfile::tempdir().unwrap();
    for name in ["a.exr", "a.png"] {
        let path = directory.path().join(name);
        let write = || {
            output::write_picture(&path, &gradient(300, 200), &LINEAR).unwrap();
            fs::read(&path).unwrap()
        };
        assert_eq!(write(), write(), "{name}");
    }
}

#[test]
fn png_round_trip_is_within_its_quantisation() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let picture = gradient(64, 33);
    // One step of the sRGB code is at most 2.3 times as large in linear light as on a linear scale.
    for (bits, step) in [(BitDepth::Eight, 1.0 / 255.0), (BitDepth::Sixteen, 0.5 / 65535.0)] {
        output::write_picture(&path, &picture, &PngOptions { bits, ..LINEAR }).unwrap();
        let difference = greatest_difference(&output::read_picture(&path).unwrap(), &picture);
        // Colour and alpha are each off by at most a step.
        assert!(difference <= 3.3 * step, "{bits:?}: {difference} in steps of {step}");
    }
}

#[test]
fn exposure_is_in_stops_and_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let picture = Picture::filled(8, 8, [0.125, 0.125, 0.125, 1.0]);
    let options = PngOptions { exposure: Exposure::Stops(2.0), ..LINEAR };
    assert_eq!(output::write_picture(&path, &picture, &options).unwrap(), Some(2.0));
    let read = output::read_picture(&path).unwrap().pixels[0][0];
    assert!((read - 0.5).abs() < 1e-4, "{read}");
}

#[test]
fn pixels_that_are_not_finite_are_refused_by_place() {
    let directory = tempfile::tempdir().unwrap();
    for name in ["a.png", "a.exr"] {
        let mut picture = gradient(16, 16);
        picture.pixels[16 * 3 + 7][1] = f32::NAN;
        picture.pixels[16 * 9][0] = f32::INFINITY;
        let error = output::write_picture(&directory.path().join(name), &picture, &LINEAR).unwrap_err().to_string();
        assert!(error.contains("2 pixel(s)") && error.contains("column 7, row 3"), "{error}");
    }
    assert!(names_in(directory.path()).is_empty());
}

#[test]
fn unwritable_places_and_unknown_formats_are_found_early() {
    let directory = tempfile::tempdir().unwrap();
    let inside = |name: &str| directory.path().join(name);
    fs::write(inside("file"), "").unwrap();
    fs::create_dir(inside("d.png")).unwrap();
    for (name, part) in [
        ("a.jpg", "'.jpg'"),
        ("a", "no extension"),
        ("missing/a.png", "not an existing directory"),
        ("file/a.png", "not an existing directory"),
        ("d.png", "is a directory"),
    ] {
        let error = output::check_picture_path(&inside(name)).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains(name), "{name}: {error}");
    }
    output::check_picture_path(&inside("good.PNG")).unwrap();
    let mut names = names_in(directory.path());
    names.sort();
    assert_eq!(names, ["d.png", "file"]);
}

#[test]
#[cfg(unix)]
fn replacing_a_file_follows_links_and_keeps_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let directory = tempfile::tempdir().unwrap();
    let (target, link) = (directory.path().join("target.json"), directory.path().join("link.json"));
    fs::write(&target, "old").unwrap();
    std::os::unix::fs::symlink(&target, &link).unwrap();
    output::write_atomically(&link, b"new").unwrap();
    assert_eq!(fs::read(&target).unwrap(), b"new");
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    // A file made the ordinary way tells what the umask leaves.
    let ordinary = directory.path().join("ordinary");
    fs::write(&ordinary, "").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&target), mode(&ordinary));
}

#[test]
#[cfg(unix)]
fn devices_are_written_to_and_not_replaced() {
    use std::os::unix::fs::FileTypeExt;
    let null = Path::new("/dev/null");
    output::check_writable(null).unwrap();
    output::write_atomically(null, b"text").unwrap();
    assert!(fs::metadata(null).unwrap().file_type().is_char_device());
}

#[test]
fn files_that_are_no_pictures_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    fs::write(&path, "text").unwrap();
    let error = output::read_picture(&path).unwrap_err().to_string();
    assert!(error.contains("a.png") && error.contains("not a picture"), "{error}");

    output::write_picture(&path, &gradient(64, 64), &LINEAR).unwrap();
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let error = output::read_picture(&path).unwrap_err().to_string();
    assert!(error.contains("a.png") && error.contains("cannot be decoded"), "{error}");
}
