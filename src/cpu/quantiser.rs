//! Twin of `color_histogram.comp` and `quantiser.comp`.

use crate::scene::Mask;
use crate::shaders::constants::{
    ADAPTIVE_CAPS, ADAPTIVE_STEP, CODE_SQUARE, CODES, HISTOGRAM_ENERGY, HISTOGRAM_LIGHT, HISTOGRAM_ROWS,
    HISTOGRAM_VOXELS, QUANTISER_FLOORS, QUANTISER_LEVELS, QUANTISER_VALUES, QUANTISER_WORDS,
};

const ROWS: usize = HISTOGRAM_ROWS as usize;
const ALL: usize = CODES as usize;
const CHANNEL_A: usize = 3;

/// Sums over voxels by code: `[row][code]`.
pub type Histogram = [[u64; ALL]; ROWS];

/// Histograms of the colours of all voxels but empty ones: codes of R, G and B weighted by squared opacity; codes of A by
/// squared light, by light, and not at all.
pub fn color_histogram(color: &[u32]) -> Histogram {
    let mut sums = [[0; ALL]; ROWS];
    for color in color.iter().filter(|&&color| color != 0) {
        let codes = color.to_le_bytes();
        let [r, g, b, a] = codes.map(u64::from);
        let light = (r * r + g * g + b * b) / 3;
        for (row, &code) in sums.iter_mut().zip(&codes[..CHANNEL_A]) {
            row[usize::from(code)] += a * a;
        }
        let a = usize::from(codes[CHANNEL_A]);
        sums[HISTOGRAM_ENERGY as usize][a] += (light * light / u64::from(CODE_SQUARE)).max(1);
        sums[HISTOGRAM_LIGHT as usize][a] += light;
        sums[HISTOGRAM_VOXELS as usize][a] += 1;
    }
    sums
}

/// The levels of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Level of every code.
    pub level: [u32; ALL],
    /// Lowest code of every level.
    pub floor: Vec<u32>,
    /// What the level of every code stands for: squares of codes for R, G, B, codes for A.
    pub value: [f32; ALL],
}

/// The quantiser of colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantiser {
    /// Of R, G, B, A.
    pub channels: [Channel; 4],
}

/// What a code stands for by itself: light as its square, opacity as it is.
fn place_of(channel: usize, code: f32) -> f32 {
    if channel == CHANNEL_A { code } else { code * code }
}

/// `histogram` is read of an adaptive mask only.
pub fn quantiser(mask: Mask, histogram: &Histogram) -> Quantiser {
    let of = |channel: usize| match mask {
        Mask::Channels(kept) => masked(channel, kept[channel]),
        Mask::Adaptive(tolerance) => adaptive(channel, tolerance, histogram),
    };
    Quantiser { channels: [0, 1, 2, 3].map(of) }
}

fn masked(channel: usize, kept: u8) -> Channel {
    let floor: Vec<u32> = (0..CODES).filter(|code| code & !u32::from(kept) == 0).collect();
    let lowest = |code: usize| code as u32 & u32::from(kept);
    let level = std::array::from_fn(|code| floor.partition_point(|&f| f < lowest(code)) as u32);
    let middle = |code: usize| (lowest(code) as f32 + 0.5 * f32::from(!kept)).min(255.0);
    Channel { level, floor, value: std::array::from_fn(|code| place_of(channel, middle(code))) }
}

fn adaptive(channel: usize, tolerance: f32, histogram: &Histogram) -> Channel {
    let sum = |row: u32, code: usize| {
        let sum = histogram[row as usize][code];
        (sum >> 32) as f32 * 4_294_967_296.0 + sum as u32 as f32
    };
    let (mut voxels, mut light, mut energy) = (0.0, 0.0, 0.0);
    for code in 0..ALL {
        voxels += sum(HISTOGRAM_VOXELS, code);
        light += code as f32 * sum(HISTOGRAM_LIGHT, code);
        energy += sum(HISTOGRAM_ENERGY, code);
    }
    let mean = |of: f32| if voxels > 0.0 { of / voxels } else { 0.0 };
    let weights: [f32; ALL] = std::array::from_fn(|code| {
        let weight = sum(channel as u32, code);
        let hidden = || sum(HISTOGRAM_VOXELS, code) * mean(energy);
        if channel == CHANNEL_A { (weight + hidden()) * CODE_SQUARE as f32 } else { weight }
    });
    let allowed = 0.5 * tolerance * mean(light);
    let most = allowed * allowed * voxels;
    let caps = std::iter::successors(Some(most), |cap| Some(cap * ADAPTIVE_STEP));
    let tried: Vec<(Channel, f32)> =
        caps.take(ADAPTIVE_CAPS as usize).map(|cap| grow(channel, &weights, tolerance, cap)).collect();
    let mut best = tried.len() - 1;
    for i in (0..best).rev() {
        let key = |i: usize| (tried[i].0.floor.len(), tried[i].1);
        if tried[i].1 <= most && key(i) < key(best) {
            best = i;
        }
    }
    tried[best].0.clone()
}

/// Levels that grow under `cap`, and their squared error.
fn grow(channel: usize, weights: &[f32; ALL], tolerance: f32, cap: f32) -> (Channel, f32) {
    let mut made = Channel { level: [0; ALL], floor: vec![0], value: [0.0; ALL] };
    let (mut weight, mut mean, mut error, mut total) = (0.0, 0.0, 0.0, 0.0);
    let close = |made: &mut Channel, end: usize, mean: f32| {
        let first = *made.floor.last().expect("the first level is there") as usize;
        made.level[first..end].fill(made.floor.len() as u32 - 1);
        made.value[first..end].fill(mean);
    };
    for (code, &added) in weights.iter().enumerate().filter(|(_, added)| **added > 0.0) {
        let place = place_of(channel, code as f32);
        let sum: f32 = weight + added;
        let apart: f32 = place - mean;
        let grown: f32 = error + apart * apart * (weight * added / sum);
        let is_apart = cap == 0.0 || grown > cap || channel == CHANNEL_A && made.floor.len() == 1;
        if code > 0 && is_apart && tolerance <= 1.0 {
            total += error;
            close(&mut made, code, mean);
            made.floor.push(code as u32);
            (weight, mean, error) = (added, place, 0.0);
        } else {
            mean += apart * (added / sum);
            (weight, error) = (sum, grown);
        }
    }
    close(&mut made, ALL, mean);
    (made, total + error)
}

impl Quantiser {
    /// Numbers of levels.
    pub fn levels(&self) -> [u32; 4] {
        self.channels.each_ref().map(|channel| channel.floor.len() as u32)
    }

    /// The lowest codes of a colour's levels.
    pub fn quantised(&self, color: u32) -> u32 {
        let codes = color.to_le_bytes().into_iter().zip(&self.channels);
        codes.rev().fold(0, |all, (code, c)| all << 8 | c.floor[c.level[usize::from(code)] as usize])
    }

    /// What the levels of a colour stand for.
    pub fn values(&self, color: u32) -> [f32; 4] {
        let codes = color.to_le_bytes();
        std::array::from_fn(|c| self.channels[c].value[usize::from(codes[c])])
    }

    /// From the words of the tables on the device, and the numbers of levels.
    pub fn from_words(words: &[u32], levels: [u32; 4]) -> Self {
        assert_eq!(words.len(), QUANTISER_WORDS as usize);
        let channel = |c: usize| {
            let row = |first: u32| &words[first as usize + c * ALL..][..ALL];
            Channel {
                level: row(QUANTISER_LEVELS).try_into().expect("256 words"),
                floor: row(QUANTISER_FLOORS)[..levels[c] as usize].to_vec(),
                value: std::array::from_fn(|code| f32::from_bits(row(QUANTISER_VALUES)[code])),
            }
        };
        Self { channels: [0, 1, 2, 3].map(channel) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: Histogram = [[0; ALL]; ROWS];

    #[test]
    fn masks_by_hand() {
        let q = quantiser(Mask::Channels([0xF0, 0x81, 0, 0xFF]), &NOTHING);
        assert_eq!(q.levels(), [16, 4, 1, 256]);
        assert_eq!(q.channels[1].floor, [0, 1, 128, 129]);
        assert_eq!((q.channels[1].level[0x7F], q.channels[1].level[0xFE]), (1, 2));
        assert_eq!(q.quantised(0xABCD_7F34), 0xAB00_0130);
        assert_eq!(q.values(0xABCD_7F34), [55.5f32.powi(2), 64f32.powi(2), 127.5f32.powi(2), 171.0]);
    }

    #[test]
    fn levels_by_hand() {
        // Opacity 1 everywhere; greys 10 and 11 often, 200 and 201 once.
        let greys = [10, 11].repeat(100).into_iter().chain([200, 201]);
        let colors: Vec<u32> = greys.map(|grey: u32| 0xFF00_0000 | (grey * 0x1_0101)).collect();
        let of = |tolerance| quantiser(Mask::Adaptive(tolerance), &color_histogram(&colors));
        // Code 0 is that of empty voxels, and joins the level above it where there is any tolerance.
        let exact = of(0.0);
        assert_eq!(exact.levels(), [5, 5, 5, 2]);
        assert!(colors.iter().all(|&color| exact.quantised(color) == color));
        // Light is 507 in the mean, so that 33,000 are allowed for 0.05. Errors are 200 · 10.5² = 22,050 for 10 and 11 together,
        // 2 · 200.5² = 80,400 for 200 and 201.
        assert_eq!(of(0.05).channels[1].floor, [0, 200, 201]);
        let coarse = of(0.1);
        assert_eq!(coarse.channels[1].floor, [0, 200]);
        let middle = (100.0 + 121.0) / 2.0;
        assert!((coarse.channels[1].value[10] - middle).abs() < 1e-3, "{}", coarse.channels[1].value[10]);
        assert_eq!(of(2.0).levels(), [1; 4]);
    }
}
