//! Measuring the error of pictures.

pub mod metrics;
