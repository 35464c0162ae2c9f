//! Twin of `glsl/scan.comp`.

/// Sum of the items before each item, modulo 2³².
pub fn exclusive(items: &[u32]) -> Vec<u32> {
    let mut sum = 0u32;
    items
        .iter()
        .map(|&item| {
            let before = sum;
            sum = sum.wrapping_add(item);
            before
        })
        .collect()
}

/// Sum of the items up to and with each item, modulo 2³².
pub fn inclusive(items: &[u32]) -> Vec<u32> {
    let mut sum = 0u32;
    items
        .iter()
        .map(|&item| {
            sum = sum.wrapping_add(item);
            sum
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_by_hand() {
        assert_eq!(exclusive(&[]), [0u32; 0]);
        assert_eq!(exclusive(&[3, 1, 4, 1]), [0, 3, 4, 8]);
        assert_eq!(inclusive(&[3, 1, 4, 1]), [3, 4, 8, 9]);
        assert_eq!(inclusive(&[u32::MAX, 2, 5]), [u32::MAX, 1, 6]);
    }
}
