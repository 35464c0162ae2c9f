//! Key frames: what a scene's numbers are at some frames, and between them.
//!
//! Every field is a track of its own, over the keys that give it. Before the first and after the last of these it stands
//! still. Between them numbers run along smooth curves, colours and transfer functions straight; names and files change at
//! the key.

use super::Exposure;
use super::file::{
    CameraTable, EnvironmentTable, LightTable, MediumTable, OpacityConvention, OutputTable, PointTable, SceneFile,
    TransferTable, ValueScale,
};
use super::values::{ExposureValue, Factor, Rgb};
use serde::Deserialize;
use std::path::PathBuf;

/// One key of `[[animation.key]]`: what a scene file says, at one frame.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyTable {
    /// Where it is; frames count from 0. Fractions are welcome.
    pub frame: f64,
    /// As `[camera]`.
    #[serde(default)]
    pub camera: CameraTable,
    /// As `[[light]]`: all lights of the scene, as many in every key that gives any.
    pub light: Option<Vec<LightTable>>,
    /// As `[transfer]`; as many points in every key that gives any.
    #[serde(default)]
    pub transfer: TransferTable,
    /// As `[medium]`.
    #[serde(default)]
    pub medium: MediumTable,
    /// As `[environment]`.
    #[serde(default)]
    pub environment: EnvironmentTable,
    /// As `[output]`.
    #[serde(default)]
    pub output: OutputTable,
}

impl KeyTable {
    /// Does it leave light as it is?
    pub fn moves_only(&self) -> bool {
        let still =
            Self { frame: self.frame, camera: self.camera.clone(), output: self.output.clone(), ..Self::default() };
        *self == still
    }
}

/// The layer that `keys`, which are in order, make at frame `at`.
pub fn layer_at(keys: &[KeyTable], at: f64) -> SceneFile {
    if keys.is_empty() {
        return SceneFile::default();
    }
    SceneFile {
        camera: CameraTable::between(&by_frame(keys, |k| &k.camera), at),
        light: field_at(&by_frame(keys, |k| k), at, |k| k.light.as_ref()),
        transfer: TransferTable::between(&by_frame(keys, |k| &k.transfer), at),
        medium: MediumTable::between(&by_frame(keys, |k| &k.medium), at),
        environment: EnvironmentTable::between(&by_frame(keys, |k| &k.environment), at),
        output: OutputTable::between(&by_frame(keys, |k| &k.output), at),
        ..SceneFile::default()
    }
}

fn by_frame<'a, T>(keys: &'a [KeyTable], of: impl Fn(&'a KeyTable) -> &'a T) -> Vec<(f64, &'a T)> {
    keys.iter().map(|k| (k.frame, of(k))).collect()
}

/// What has a value at every frame once it has some at keys.
pub trait Track: Sized {
    /// The value at frame `at`; of `keys` there is at least one, and their frames ascend.
    fn between(keys: &[(f64, &Self)], at: f64) -> Self;
}

/// The track of a field that not every key gives; none if no key does.
pub fn field_at<T, V: Track>(keys: &[(f64, &T)], at: f64, of: impl Fn(&T) -> Option<&V>) -> Option<V> {
    let given: Vec<_> = keys.iter().filter_map(|&(frame, key)| Some((frame, of(key)?))).collect();
    (!given.is_empty()).then(|| V::between(&given, at))
}

/// Where a frame lies among keys.
enum Place {
    /// At this one, or beyond it where it is the first or the last.
    At(usize),
    /// So much of the way from this one to the next.
    After(usize, f64),
}

fn place<T>(keys: &[(f64, &T)], at: f64) -> Place {
    let next = keys.partition_point(|key| key.0 <= at);
    match next {
        0 => Place::At(0),
        _ if next == keys.len() => Place::At(next - 1),
        _ => Place::After(next - 1, (at - keys[next - 1].0) / (keys[next].0 - keys[next - 1].0)),
    }
}

/// A number of every key.
struct Curve {
    frames: Vec<f64>,
    values: Vec<f64>,
}

impl Curve {
    fn of<T>(keys: &[(f64, &T)], value: impl Fn(&T) -> f64) -> Self {
        Self { frames: keys.iter().map(|k| k.0).collect(), values: keys.iter().map(|k| value(k.1)).collect() }
    }

    fn width(&self, i: usize) -> f64 {
        self.frames[i + 1] - self.frames[i]
    }

    /// Slope of the straight line from key `i` to the next.
    fn secant(&self, i: usize) -> f64 {
        (self.values[i + 1] - self.values[i]) / self.width(i)
    }

    /// Slope at key `i` of the parabola through it and its neighbours; at an end, of that through the three keys there.
    fn parabola_slope(&self, i: usize) -> f64 {
        let last = self.frames.len() - 1;
        if last == 1 {
            return self.secant(0);
        }
        let at = i.clamp(1, last - 1);
        let [h0, h1] = [at - 1, at].map(|j| self.width(j));
        let [d0, d1] = [at - 1, at].map(|j| self.secant(j));
        let middle = (h1 * d0 + h0 * d1) / (h0 + h1);
        match i {
            0 => 2.0 * d0 - middle,
            _ if i == last => 2.0 * d1 - middle,
            _ => middle,
        }
    }

    /// The slope with which no value lies outside of what two neighbouring keys have (Fritsch & Butland 1984; at the ends
    /// that of the parabola, limited as in Moler, Numerical Computing with MATLAB, section 3.4).
    fn monotone_slope(&self, i: usize) -> f64 {
        let last = self.frames.len() - 1;
        if i == 0 || i == last {
            let ends = if i == 0 { (0, 1) } else { (last - 1, last.saturating_sub(2)) };
            let slope = self.parabola_slope(i);
            if last == 1 {
                return slope;
            }
            let (near, far) = (self.secant(ends.0), self.secant(ends.1));
            return if slope * near <= 0.0 {
                0.0
            } else if near * far <= 0.0 && slope.abs() > 3.0 * near.abs() {
                3.0 * near
            } else {
                slope
            };
        }
        let [h0, h1] = [i - 1, i].map(|j| self.width(j));
        let [d0, d1] = [i - 1, i].map(|j| self.secant(j));
        if d0 * d1 <= 0.0 {
            return 0.0;
        }
        let (w0, w1) = (2.0 * h1 + h0, h1 + 2.0 * h0);
        (w0 + w1) / (w0 / d0 + w1 / d1)
    }

    /// The cubic with the given slopes at the keys.
    fn at(&self, place: &Place, slope: impl Fn(&Self, usize) -> f64) -> f64 {
        let (i, s) = match *place {
            Place::At(i) => return self.values[i],
            Place::After(i, s) => (i, s),
        };
        let (y0, y1) = (self.values[i], self.values[i + 1]);
        let [m0, m1] = [i, i + 1].map(|j| slope(self, j) * self.width(i));
        let rest = 1.0 - s;
        y0 + s * (y1 - y0) + s * rest * (rest * (m0 - (y1 - y0)) - s * (m1 - (y1 - y0)))
    }
}

/// Between its neighbours' values, so that what is in range at the keys is so everywhere.
impl Track for f64 {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        Curve::of(keys, |v| *v).at(&place(keys, at), Curve::monotone_slope)
    }
}

impl Track for Factor {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        let place = place(keys, at);
        match place {
            // Exactly; the logarithm would round it.
            Place::At(i) => *keys[i].1,
            Place::After(..) => Self(Curve::of(keys, |v| v.0.ln()).at(&place, Curve::monotone_slope).exp()),
        }
    }
}

/// A place or a direction: a curve through all keys without corners, the same however the axes lie.
impl Track for [f64; 3] {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        let place = place(keys, at);
        std::array::from_fn(|axis| Curve::of(keys, |v| v[axis]).at(&place, Curve::parabola_slope))
    }
}

fn mix(a: f64, b: f64, share: f64) -> f64 {
    a + share * (b - a)
}

/// Straight from key to key.
fn straight<T: Clone>(keys: &[(f64, &T)], at: f64, mix: impl Fn(&T, &T, f64) -> T) -> T {
    match place(keys, at) {
        Place::At(i) => keys[i].1.clone(),
        Place::After(i, share) => mix(keys[i].1, keys[i + 1].1, share),
    }
}

fn mix_rgb(a: &Rgb, b: &Rgb, share: f64) -> Rgb {
    Rgb(std::array::from_fn(|c| mix(a.0[c].into(), b.0[c].into(), share) as f32))
}

impl Track for Rgb {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        straight(keys, at, mix_rgb)
    }
}

/// Straight, so that points keep their order.
impl Track for PointTable {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        straight(keys, at, |a, b, share| {
            let black = Rgb([0.0; 3]);
            let emission = |p: &Self| p.emission.unwrap_or(black);
            Self {
                value: mix(a.value, b.value, share),
                color: mix_rgb(&a.color, &b.color, share),
                opacity: mix(a.opacity, b.opacity, share),
                emission: Some(mix_rgb(&emission(a), &emission(b), share)),
            }
        })
    }
}

/// Entry by entry; the lists have one length.
impl<T: Track> Track for Vec<T> {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        let entry = |i: usize| keys.iter().map(|&(frame, list)| (frame, &list[i])).collect::<Vec<_>>();
        (0..keys[0].1.len()).map(|i| T::between(&entry(i), at)).collect()
    }
}

impl Track for ExposureValue {
    fn between(keys: &[(f64, &Self)], at: f64) -> Self {
        straight(keys, at, |a, b, share| match (a.0, b.0) {
            (Exposure::Stops(x), Exposure::Stops(y)) => Self(Exposure::Stops(mix(x.into(), y.into(), share) as f32)),
            _ => *a,
        })
    }
}

/// What has nothing between two keys.
macro_rules! steps {
    ($($type:ty),*) => {
        $(impl Track for $type {
            fn between(keys: &[(f64, &Self)], at: f64) -> Self {
                straight(keys, at, |a, _, _| a.clone())
            }
        })*
    };
}

steps!(PathBuf, ValueScale, OpacityConvention, super::ToneCurve);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of<T: Track>(keys: &[(f64, T)], at: f64) -> T {
        T::between(&keys.iter().map(|(frame, value)| (*frame, value)).collect::<Vec<_>>(), at)
    }

    fn slope_at<T: Track>(keys: &[(f64, T)], at: f64, value: impl Fn(&T) -> f64) -> [f64; 2] {
        let h = 1e-6;
        let [before, here, after] = [at - h, at, at + h].map(|t| value(&of(keys, t)));
        [(here - before) / h, (after - here) / h]
    }

    #[test]
    fn keys_are_met_and_ends_stand_still() {
        let keys = [(2.0, 5.0), (4.0, -1.0), (10.0, 8.0)];
        assert_eq!([0.0, 2.0, 4.0, 10.0, 99.0].map(|at| of(&keys, at)), [5.0, 5.0, -1.0, 8.0, 8.0]);
        assert_eq!(of(&[(7.0, 3.0)], 0.0), 3.0);
        // Two keys: a straight line, and so are keys that lie on one.
        assert_eq!(of(&[(0.0, 1.0), (4.0, 3.0)], 1.0), 1.5);
        let line = [0.0, 1.0, 5.0, 6.0].map(|t| (t, 2.0 * t - 1.0));
        let line3 = line.map(|(t, v)| (t, [v, -v, 0.0]));
        for t in [0.3, 2.0, 4.7, 5.5] {
            assert!((of(&line, t) - (2.0 * t - 1.0)).abs() < 1e-12);
            assert!((of(&line3, t)[1] + (2.0 * t - 1.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn factors_gain_by_equal_ratios() {
        let keys = [(0.0, Factor(1.0)), (3.0, Factor(1000.0))];
        let at = |frame| of(&keys, frame).0;
        assert_eq!([at(0.0), at(3.0)], [1.0, 1000.0]);
        assert!((at(1.0) - 10.0).abs() < 1e-9 && (at(2.0) - 100.0).abs() < 1e-9);
    }

    #[test]
    fn paths_have_no_corners() {
        let places = [(0.0, [0.0, 0.0, 1.0]), (3.0, [4.0, 1.0, 1.0]), (4.0, [5.0, 5.0, 0.0]), (9.0, [0.0, 6.0, 2.0])];
        let angles = [(0.0, 0.0), (3.0, 50.0), (4.0, 90.0), (9.0, 20.0)];
        for at in [3.0, 4.0] {
            for axis in 0..3 {
                let [before, after] = slope_at(&places, at, |p| p[axis]);
                assert!((before - after).abs() < 1e-4, "{axis} at {at}: {before} {after}");
            }
            let [before, after] = slope_at(&angles, at, |a| *a);
            assert!((before - after).abs() < 1e-3, "at {at}: {before} {after}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// A number stays between its neighbours'.
        #[test]
        fn numbers_do_not_overshoot(
            steps in prop::collection::vec((0.01..10.0f64, -5.0..5.0f64), 1..8),
            shares in prop::collection::vec(0.0..1.0f64, 16),
        ) {
            let mut frame = 0.0;
            let keys: Vec<_> = steps.iter().map(|&(width, value)| { frame += width; (frame, value) }).collect();
            for pair in keys.windows(2) {
                for share in &shares {
                    let value = of(&keys, mix(pair[0].0, pair[1].0, *share));
                    let (low, high) = (pair[0].1.min(pair[1].1), pair[0].1.max(pair[1].1));
                    prop_assert!((low - 1e-9..=high + 1e-9).contains(&value), "{value} of {low}..{high}");
                }
            }
        }
    }
}
