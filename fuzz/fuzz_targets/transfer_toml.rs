//! A transfer function file in TOML.
#![no_main]

use tyndall::scene::file::TransferTable;
use tyndall_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file(".toml", bytes, |path| {
    let _ = TransferTable::load(path);
}));
