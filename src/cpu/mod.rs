//! Plain twins of the GPU passes: the same names and argument order, the simplest code that is right. Tests compare
//! the passes with them.

pub mod classify;
pub mod proxy;
pub mod radix_sort;
pub mod scan;
