//! A colour map of ParaView's.
#![no_main]

use tyndall::scene::file::TransferTable;
use tyndall_fuzz::with_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| with_file(".json", bytes, |path| {
    let _ = TransferTable::load(path);
}));
