//! Sorts on the CPU, to set beside those of `tyndall bench sort`: what a program without a GPU would take. With the feature
//! `rivals` those of other crates too; without it the program does not grow by them.

/// A name, and what sorts.
pub type Rival = (&'static str, fn(&mut [u32]));

/// Those that were built in.
pub fn sorts() -> &'static [Rival] {
    &[
        ("CPU std", |keys| keys.sort_unstable()),
        #[cfg(feature = "rivals")]
        ("CPU rayon", |keys| rayon::slice::ParallelSliceMut::par_sort_unstable(keys)),
        #[cfg(feature = "rivals")]
        ("CPU radsort", |keys| radsort::sort(keys)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_of_them_sort() {
        for (name, sort) in sorts() {
            let mut keys: Vec<u32> = (0..10_000u32).map(|i| i.wrapping_mul(0x9E37_79B9)).collect();
            sort(&mut keys);
            assert!(keys.is_sorted(), "{name}");
        }
    }
}
