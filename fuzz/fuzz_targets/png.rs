//! An image file of this kind, as a picture and as an environment.
#![no_main]

use tyndall::scene::LatLong;
use tyndall_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file(".png", bytes, |path| {
    let _ = tyndall::output::read_picture(path);
    let _ = LatLong::load(path, 1.0, 30.0);
}));
