//! The passes: sizes, scratch memory, and `record()`, which appends a pass to a [`Recorder`](crate::vk::Recorder).

pub mod lookback;
pub mod radix_sort;
pub mod scan;
