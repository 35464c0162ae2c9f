//! Twin of `include/rng.glsl`: the same bits.

/// PCG output function as a hash.
pub fn pcg_hash(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Key of an independent stream for item `item`; `stream` tells uses apart.
pub fn stream_key(item: u32, stream: u32, seed_low: u32, seed_high: u32) -> u32 {
    pcg_hash(item ^ pcg_hash(stream ^ pcg_hash(seed_low ^ pcg_hash(seed_high))))
}

/// The n-th word of a stream.
pub fn random_word(key: u32, n: u32) -> u32 {
    pcg_hash(key.wrapping_add(n.wrapping_mul(2_654_435_769)))
}

/// The n-th number of a stream, in [0, 1).
pub fn random_float(key: u32, n: u32) -> f32 {
    unit_float(random_word(key, n))
}

/// Four words from four.
pub fn pcg4d(v: [u32; 4]) -> [u32; 4] {
    let [mut x, mut y, mut z, mut w] = v.map(|c| c.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mut mix = |shift: u32| {
        x = x.wrapping_add(y.wrapping_mul(w));
        y = y.wrapping_add(z.wrapping_mul(x));
        z = z.wrapping_add(x.wrapping_mul(y));
        w = w.wrapping_add(y.wrapping_mul(z));
        if shift > 0 {
            [x, y, z, w] = [x, y, z, w].map(|c| c ^ c >> shift);
        }
    };
    mix(16);
    mix(0);
    [x, y, z, w]
}

/// In [0, 1), from the word's upper 24 bits.
pub fn unit_float(word: u32) -> f32 {
    (word >> 8) as f32 / 16_777_216.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fill_the_unit_interval_evenly() {
        let n = 100_000;
        let mut bins = [0u32; 10];
        for item in 0..n {
            let x = random_float(stream_key(item, 2, 3, 4), 1);
            assert!((0.0..1.0).contains(&x));
            bins[(x * 10.0) as usize] += 1;
        }
        // A bin's standard deviation is 95.
        assert!(bins.iter().all(|&b| b.abs_diff(10_000) < 500), "{bins:?}");
    }
}
