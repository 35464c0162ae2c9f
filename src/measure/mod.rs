//! Measuring the error of pictures, and what settings cost and bring.

pub mod front;
pub mod knobs;
pub mod metrics;
mod plot;
pub mod report;
pub mod seeds;
pub mod sweep;
