//! Comparisons with known numbers: the bodies and pencils of rays of `verify`, and a tolerant assertion.

#![allow(dead_code, unused_imports, reason = "each test file uses a part of it")]

pub use tyndall::verify::bodies::*;

#[track_caller]
pub fn assert_near(case: &str, got: f32, expected: f64, tolerance: f64) {
    let error = f64::from(got) - expected;
    assert!(error.abs() <= tolerance, "{case}: {got} instead of {expected}, error {error:e}, allowed {tolerance:e}");
}
