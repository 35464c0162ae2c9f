//! Twin of the radix sort (`glsl/radix_*.comp`).

/// Pairs in the order of bits `bit_begin..bit_end` of their keys; pairs that agree in them keep their order.
pub fn sort_pairs(keys: &[u32], payloads: &[u32], bit_begin: u32, bit_end: u32) -> (Vec<u32>, Vec<u32>) {
    assert!(bit_begin <= bit_end && bit_end <= 32, "bits {bit_begin}..{bit_end} of a 32-bit key");
    let mask = ((1u64 << (bit_end - bit_begin)) - 1) as u32;
    let mut pairs: Vec<(u32, u32)> = keys.iter().copied().zip(payloads.iter().copied()).collect();
    // Zero bits wide: every key agrees; shifting by 32 would not.
    pairs.sort_by_key(|&(key, _)| (u64::from(key) >> bit_begin) as u32 & mask);
    pairs.into_iter().unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let keys = [0x31, 0x12, 0x21, 0x11];
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 0, 32), (vec![0x11, 0x12, 0x21, 0x31], vec![3, 1, 2, 0]));
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 4, 8).1, [1, 3, 2, 0]);
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 0, 4).1, [0, 2, 3, 1]);
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 32, 32).1, [0, 1, 2, 3]);
    }
}
