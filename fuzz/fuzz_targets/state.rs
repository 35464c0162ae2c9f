//! A saved render.
#![no_main]

use tyndall::render::state::State;
use tyndall_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file(".state", bytes, |path| {
    let _ = State::load(path);
}));
