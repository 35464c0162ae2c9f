//! From which of its cell's points each direction of a gather is followed.
//!
//! What is gathered are means over directions at every point, not over all points alike: light falls off within a cell, and the hat
//! functions weigh points differently. So with f(p, ω) the light that arrives at point p from ω, sums Σ χ(p) f(p, ω) have to be right
//! for every function χ on the points, and those that change along one axis matter most: the directions of the points on one side of
//! the cell have to be spread as evenly as those of the other side. Points are dealt out to the directions so that the worst-case
//! error of such sums is small.

use crate::cpu::project::point_of_sample;
use crate::cpu::rng::{pcg_hash, unit_float};
use crate::cpu::sphere::lattice_direction;
use crate::shaders::constants::CELL_POINTS;
use glam::Vec3;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Beyond so many directions there are enough for every point, however they are dealt out.
const MOST: u32 = 96;
/// Shifts of the lattice of directions that errors are averaged over.
const SHIFTS: u32 = 64;
/// Of functions on the points that change along one axis, two, or all.
const WEIGHTS: [f64; 3] = [1.0, 0.3, 0.1];
/// Exchanges that are tried per direction.
const TRIES: u32 = 400;

/// χ(p): one of the eight products of signs along the axes.
fn sign(function: usize, point: u32) -> f64 {
    if (function as u32 & point).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// Worst-case error of sums over both directions, for functions on the sphere that are smooth: 4/3 less the distance of the two,
/// whose mean is 0 (Brauchart and Dick 2013, from Stolarsky's principle); the mean over shifts of the lattice.
fn kernel(count: u32) -> Vec<f64> {
    let mut kernel = vec![0.0; (count * count) as usize];
    for k in 0..SHIFTS {
        let shift = [0.754_877_7, 0.569_840_3].map(|step: f32| (step * k as f32).fract());
        let directions: Vec<Vec3> = (0..count).map(|i| lattice_direction(i, count, shift)).collect();
        for (i, a) in directions.iter().enumerate() {
            for (j, b) in directions.iter().enumerate() {
                kernel[i * count as usize + j] += (4.0 / 3.0 - f64::from(a.distance(*b))) / f64::from(SHIFTS);
            }
        }
    }
    kernel
}

/// Points of as many directions, spread evenly over the sphere ([`lattice_direction`]).
pub fn points_of(count: u32) -> Vec<u32> {
    static KNOWN: Mutex<BTreeMap<u32, Vec<u32>>> = Mutex::new(BTreeMap::new());
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(count).or_insert_with(|| dealt_out(count)).clone()
}

/// By simulated annealing, from what is good for any number of directions ([`point_of_sample`]). The same every time.
fn dealt_out(count: u32) -> Vec<u32> {
    let mut points: Vec<u32> = (0..count).map(|k| point_of_sample(k, 0)).collect();
    if !(2..=MOST).contains(&count) {
        return points;
    }
    let (kernel, n) = (kernel(count), count as usize);
    let weights: [f64; 8] = std::array::from_fn(|f| if f == 0 { 0.0 } else { WEIGHTS[f.count_ones() as usize - 1] });
    // Σⱼ K(i, j) χ(pⱼ) for every function and direction: an exchange changes few of its terms.
    let mut sums: Vec<[f64; 8]> = Vec::with_capacity(n);
    for row in kernel.chunks_exact(n) {
        sums.push(std::array::from_fn(|f| row.iter().zip(&points).map(|(k, &p)| k * sign(f, p)).sum()));
    }
    let mut error: f64 =
        (0..n).map(|i| (0..8).map(|f| weights[f] * sign(f, points[i]) * sums[i][f]).sum::<f64>()).sum();
    let mut best = (error, points.clone());
    let tries = TRIES * count;
    let mut word = count;
    let mut random = || {
        word = pcg_hash(word);
        word
    };
    for attempt in 0..tries {
        let [i, j] = [0; 2].map(|_: u32| (random() % count) as usize);
        // It cools down to nothing from a part of what an exchange changes the error by.
        let temperature =
            0.05 * best.0 * (1.0 - f64::from(attempt) / f64::from(tries)).powi(2) / f64::from(count).sqrt();
        let chance = f64::from(unit_float(random()));
        let change: [f64; 8] = std::array::from_fn(|f| sign(f, points[j]) - sign(f, points[i]));
        let between = kernel[i * n + i] + kernel[j * n + j] - 2.0 * kernel[i * n + j];
        let of = |f: usize| weights[f] * (2.0 * change[f] * (sums[i][f] - sums[j][f]) + change[f].powi(2) * between);
        let more: f64 = (0..8).map(of).sum();
        if points[i] == points[j] || more > 0.0 && chance >= (-more / temperature).exp() {
            continue;
        }
        points.swap(i, j);
        error += more;
        for (k, sums) in sums.iter_mut().enumerate() {
            let by = kernel[k * n + i] - kernel[k * n + j];
            for (sum, change) in sums.iter_mut().zip(change) {
                *sum += change * by;
            }
        }
        if error < best.0 {
            best = (error, points.clone());
        }
    }
    best.1
}

/// The same for directions some of which are drawn by the phase function towards the eye: `glsl/include/aim.glsl`.
pub fn aimed_points_of(count: u32) -> Vec<u32> {
    halves(count).map(points_of).concat()
}

fn halves(count: u32) -> [u32; 2] {
    [count / 2, count - count / 2]
}

/// Of every direction: does its point have one more than others?
fn has_more(points: &[u32]) -> impl Iterator<Item = bool> {
    let mut counts = [0; CELL_POINTS as usize];
    points.iter().for_each(|&point| counts[point as usize] += 1);
    points.iter().map(move |&point| counts[point as usize] > points.len() / counts.len())
}

/// Weights of directions that go from these points, over that of the mean of all: where every point has a direction, all points weigh
/// the same.
pub fn weights_of(points: &[u32]) -> Vec<f32> {
    let (count, all) = (points.len(), CELL_POINTS as usize);
    let weight = |more: bool| count as f32 / (all * (count / all + usize::from(more))) as f32;
    if count < all { vec![1.0; count] } else { has_more(points).map(weight).collect() }
}

/// The same of [`aimed_points_of`].
pub fn aimed_weights_of(count: u32) -> Vec<f32> {
    halves(count).map(|half| weights_of(&points_of(half))).concat()
}

/// Eight to a word, as `glsl/include/points.glsl` reads them: points of `count` directions, each with whether it has more of them than
/// others.
pub(super) fn packed(count: u32) -> Vec<u32> {
    pack(&dealt(count))
}

/// The same of [`aimed_points_of`], each half by itself.
pub(super) fn aimed_packed(count: u32) -> Vec<u32> {
    pack(&halves(count).map(dealt).concat())
}

fn dealt(count: u32) -> Vec<u32> {
    let points = points_of(count);
    points.iter().zip(has_more(&points)).map(|(&point, more)| point | u32::from(more) << 3).collect()
}

fn pack(dealt: &[u32]) -> Vec<u32> {
    let word = |eight: &[u32]| eight.iter().rev().fold(0, |word, dealt| word << 4 | dealt);
    dealt.chunks(CELL_POINTS as usize).map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As [`dealt_out`] has it.
    fn error(points: &[u32]) -> f64 {
        let (kernel, n) = (kernel(points.len() as u32), points.len());
        let of = |f: usize| -> f64 {
            let pairs = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
            let sum: f64 = pairs.map(|(i, j)| sign(f, points[i]) * sign(f, points[j]) * kernel[i * n + j]).sum();
            sum * WEIGHTS[f.count_ones() as usize - 1]
        };
        (1..8).map(of).sum()
    }

    #[test]
    fn points_are_dealt_out_evenly() {
        for (count, most) in [(2, 1.0), (6, 0.99), (8, 0.8), (12, 0.85), (16, 0.65), (24, 0.95), (48, 0.97), (96, 0.9)]
        {
            let (dealt, pattern) = (points_of(count), (0..count).map(|k| point_of_sample(k, 0)).collect::<Vec<_>>());
            let of = |points: &[u32], point| points.iter().filter(|&&p| p == point).count();
            for point in 0..CELL_POINTS {
                assert_eq!(of(&dealt, point), of(&pattern, point), "{count}: {point}");
            }
            let ratio = error(&dealt) / error(&pattern);
            assert!(ratio < most + 1e-9, "{count}: {ratio}");
        }
        assert_eq!(points_of(200), (0..200).map(|k| point_of_sample(k, 0)).collect::<Vec<_>>());
    }

    #[test]
    fn all_points_weigh_the_same() {
        for count in [1, 7, 8, 9, 12, 16, 31, 200] {
            let (points, weights) = (points_of(count), weights_of(&points_of(count)));
            let of = |point| points.iter().zip(&weights).filter(|(p, _)| **p == point).map(|(_, w)| w).sum::<f32>();
            let each = count as f32 / CELL_POINTS as f32;
            if count < CELL_POINTS {
                assert!(weights.iter().all(|&w| w == 1.0), "{count}");
            } else {
                assert!((0..CELL_POINTS).all(|point| (of(point) / each - 1.0).abs() < 1e-6), "{count}: {weights:?}");
            }
        }
        // Halves by themselves: 10 and 11 directions.
        let aimed = aimed_weights_of(21);
        let sums = [&aimed[..10], &aimed[10..]].map(|half| half.iter().sum::<f32>());
        assert!((sums[0] - 10.0).abs() < 1e-5 && (sums[1] - 11.0).abs() < 1e-5, "{sums:?}");
    }

    #[test]
    fn points_are_packed_with_who_has_more() {
        // Of nine directions one point has two; each half by itself.
        let check = |words: &[u32], points: &[u32]| {
            assert_eq!(words.len(), points.len().div_ceil(8));
            for (k, &point) in points.iter().enumerate() {
                let dealt = words[k / 8] >> (4 * (k % 8)) & 15;
                assert_eq!(dealt & 7, point);
                let nine = &points[k / 9 * 9..k / 9 * 9 + 9];
                assert_eq!(dealt >> 3 == 1, nine.iter().filter(|&&p| p == point).count() == 2, "{points:?}");
            }
        };
        check(&packed(9), &points_of(9));
        check(&aimed_packed(18), &aimed_points_of(18));
    }
}
