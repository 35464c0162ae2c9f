//! A volume file of this kind.
#![no_main]

use tyndall_fuzz::{look_at, with_file};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    with_file(".mha", bytes, |path| {
        if let Ok(volume) = tyndall::volume::load(path, None) {
            look_at(&volume);
        }
    });
});
