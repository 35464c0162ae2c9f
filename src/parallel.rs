//! Work of the host shared out over the processor's cores.

use std::num::NonZero;
use std::thread;

/// Calls `fill` with every chunk of `chunk` values (the last may be shorter) and the index of its first value. Every thread takes
/// each so-manieth chunk, since neighbours often cost about the same.
pub(crate) fn fill_chunks<T: Send>(values: &mut [T], chunk: usize, fill: impl Fn(&mut [T], usize) + Sync) {
    let threads = thread::available_parallelism().map_or(1, NonZero::get);
    let mut shares: Vec<Vec<_>> = (0..threads).map(|_| Vec::new()).collect();
    for (i, values) in values.chunks_mut(chunk).enumerate() {
        shares[i % threads].push((values, i * chunk));
    }
    thread::scope(|scope| {
        for share in shares {
            scope.spawn(|| share.into_iter().for_each(|(values, first)| fill(values, first)));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_chunk_is_filled_once_from_its_own_place() {
        for (len, chunk) in [(0, 3), (1, 3), (3, 3), (1000, 7), (5, 100)] {
            let mut values = vec![0; len];
            fill_chunks(&mut values, chunk, |values, first| {
                values.iter_mut().zip(first..).for_each(|(value, i)| *value += i + 1);
            });
            assert!(values.iter().copied().eq(1..=len), "{len} values by {chunk}: {values:?}");
        }
    }
}
