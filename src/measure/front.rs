//! Which settings are worth having: the Pareto front of error against time, and the choice from it.

use serde::Serialize;

/// What one setting costs and brings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Time of a picture, in any unit.
    pub time: f64,
    /// Its error, in any unit.
    pub error: f64,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Goal {
    /// The fastest setting with at most this error.
    Error(f64),
    /// The most accurate setting that takes at most this time.
    Time(f64),
}

/// The settings of which none other is both as fast and as accurate, the fastest first: their indices. Of equal ones
/// the first counts. Points that are not finite are left out.
pub fn front(points: &[Point]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.retain(|&i| points[i].time.is_finite() && points[i].error.is_finite());
    order.sort_by(|&i, &j| {
        let (a, b) = (points[i], points[j]);
        a.time.total_cmp(&b.time).then(a.error.total_cmp(&b.error))
    });
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let is_better = points[i].error < least;
        least = least.min(points[i].error);
        is_better
    });
    order
}

/// The setting of the front that meets the goal best, and whether it meets it. If none does it is the one that comes
/// nearest. `None` without points.
pub fn recommend(points: &[Point], goal: Goal) -> Option<(usize, bool)> {
    // From the fastest to the most accurate.
    let front = front(points);
    let (found, nearest) = match goal {
        Goal::Error(most) => (front.iter().find(|&&i| points[i].error <= most), front.last()),
        Goal::Time(most) => (front.iter().rev().find(|&&i| points[i].time <= most), front.first()),
    };
    Some((*found.or(nearest)?, found.is_some()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(list: &[(f64, f64)]) -> Vec<Point> {
        list.iter().map(|&(time, error)| Point { time, error }).collect()
    }

    #[test]
    fn front_holds_what_nothing_beats() {
        // Beaten: 1 by 0 (slower, worse), 4 by 3 (as fast, worse), 5 by 2 (slower, as good). 6 equals 3.
        let p = points(&[(2.0, 5.0), (3.0, 6.0), (8.0, 1.0), (4.0, 3.0), (4.0, 4.0), (9.0, 1.0), (4.0, 3.0)]);
        assert_eq!(front(&p), [0, 3, 2]);
        assert_eq!(front(&[]), [0; 0]);
        assert_eq!(front(&points(&[(f64::NAN, 1.0), (1.0, f64::INFINITY), (2.0, 2.0)])), [2]);
    }

    #[test]
    fn every_point_is_on_the_front_or_beaten() {
        let mut word = 1u32;
        let mut random = || {
            word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(word >> 26)
        };
        let p: Vec<Point> = (0..200).map(|_| Point { time: random(), error: random() }).collect();
        let front = front(&p);
        for (i, a) in p.iter().enumerate() {
            let is_beaten = |by: &Point| by.time <= a.time && by.error <= a.error && by != a;
            assert_eq!(p.iter().any(is_beaten), !front.iter().any(|&f| p[f] == *a), "{i}: {a:?}");
        }
    }

    #[test]
    fn recommendation_meets_the_goal_or_comes_nearest() {
        let p = points(&[(8.0, 1.0), (2.0, 5.0), (4.0, 3.0), (5.0, 9.0)]);
        for (goal, expected) in [
            (Goal::Error(3.5), (2, true)),
            (Goal::Error(3.0), (2, true)),
            (Goal::Error(100.0), (1, true)),
            (Goal::Error(0.5), (0, false)),
            (Goal::Time(4.0), (2, true)),
            (Goal::Time(7.9), (2, true)),
            (Goal::Time(100.0), (0, true)),
            (Goal::Time(1.0), (1, false)),
        ] {
            assert_eq!(recommend(&p, goal), Some(expected), "{goal:?}");
        }
        assert_eq!(recommend(&[], Goal::Error(1.0)), None);
    }
}
