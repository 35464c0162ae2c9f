//! Twin of the radix sort (`glsl/radix_*.comp`).

use crate::shaders::constants;

/// The word by which a key of a kind (`KEY_*`) is sorted: words in ascending order are keys in the order asked for.
pub fn image_of_key(key: u32, kind: u32, descending: bool) -> u32 {
    let image = match kind {
        constants::KEY_I32 => key ^ 0x8000_0000,
        constants::KEY_F32 if key >> 31 != 0 => !key,
        constants::KEY_F32 => key ^ 0x8000_0000,
        _ => key,
    };
    if descending { !image } else { image }
}

/// Its inverse.
pub fn key_of_image(image: u32, kind: u32, descending: bool) -> u32 {
    let key = if descending { !image } else { image };
    match kind {
        constants::KEY_I32 => key ^ 0x8000_0000,
        constants::KEY_F32 if key >> 31 != 0 => key ^ 0x8000_0000,
        constants::KEY_F32 => !key,
        _ => key,
    }
}

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
    fn images_are_in_the_order_of_the_keys() {
        let words = [0, 1, 0x7F7F_FFFF, 0x7F80_0000, 0x7F80_0001, 0x7FC0_0000, 0x7FFF_FFFF, 0x3F80_0000];
        let words: Vec<u32> = words.iter().flat_map(|&w| [w, w | 0x8000_0000]).collect();
        for descending in [false, true] {
            for kind in [constants::KEY_U32, constants::KEY_I32, constants::KEY_F32] {
                for &a in &words {
                    let image = image_of_key(a, kind, descending);
                    assert_eq!(key_of_image(image, kind, descending), a);
                    for &b in &words {
                        let order = match kind {
                            constants::KEY_I32 => (a as i32).cmp(&(b as i32)),
                            constants::KEY_F32 => f32::from_bits(a).total_cmp(&f32::from_bits(b)),
                            _ => a.cmp(&b),
                        };
                        let order = if descending { order.reverse() } else { order };
                        assert_eq!(image.cmp(&image_of_key(b, kind, descending)), order, "{a:#x}, {b:#x}, kind {kind}");
                    }
                }
            }
        }
    }

    #[test]
    fn by_hand() {
        let keys = [0x31, 0x12, 0x21, 0x11];
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 0, 32), (vec![0x11, 0x12, 0x21, 0x31], vec![3, 1, 2, 0]));
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 4, 8).1, [1, 3, 2, 0]);
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 0, 4).1, [0, 2, 3, 1]);
        assert_eq!(sort_pairs(&keys, &[0, 1, 2, 3], 32, 32).1, [0, 1, 2, 3]);
    }
}
