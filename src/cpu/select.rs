//! Twin of `glsl/select.comp`.

/// The items whose flag is not 0, in their order.
pub fn select(flags: &[u32], items: &[u32]) -> Vec<u32> {
    flags.iter().zip(items).filter(|(flag, _)| **flag != 0).map(|(_, &item)| item).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        assert_eq!(select(&[0, 1, u32::MAX, 0, 2], &[5, 6, 7, 8, 9]), [6, 7, 9]);
        assert_eq!(select(&[], &[]), [0u32; 0]);
    }
}
