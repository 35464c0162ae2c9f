//! Deterministic test data and exact comparison.

#![allow(dead_code, reason = "each test file uses a part of it")]

/// A sequence of random words that the seed fixes (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// The next word.
    pub fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 32) as u32
    }

    /// `n` words.
    pub fn words(&mut self, n: usize) -> Vec<u32> {
        (0..n).map(|_| self.word()).collect()
    }
}

/// Compares whole arrays, but prints only where they part.
pub fn assert_same(case: &str, got: &[u32], expected: &[u32]) {
    assert_eq!(got.len(), expected.len(), "{case}: length");
    if let Some(i) = (0..got.len()).find(|&i| got[i] != expected[i]) {
        let wrong = (0..got.len()).filter(|&i| got[i] != expected[i]).count();
        panic!("{case}: {wrong} of {} differ, the first at {i}: {} instead of {}", got.len(), got[i], expected[i]);
    }
}
