//! A file without a header, whose layout is in the first bytes.
#![no_main]

use tyndall::volume::{RawLayout, ScalarType};
use tyndall_fuzz::{look_at, with_file};

libfuzzer_sys::fuzz_target!(|input: (u32, u32, u32, u8, bool, u16, [f32; 3], Vec<u8>)| {
    let (x, y, z, scalar, big_endian, skip, spacing, bytes) = input;
    use clap::ValueEnum;
    let types = ScalarType::value_variants();
    let layout = RawLayout {
        dims: [x, y, z],
        scalar: types[scalar as usize % types.len()],
        big_endian,
        spacing: spacing.map(f64::from),
        origin: [0.0; 3],
        skip: skip.into(),
    };
    with_file(".raw", &bytes, |path| {
        if let Ok(volume) = tyndall::volume::load(path, Some(&layout)) {
            look_at(&volume);
        }
    });
});
