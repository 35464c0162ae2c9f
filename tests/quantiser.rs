//! The quantiser of the proxy's colours against its CPU twin, and what a tolerance promises.

mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/scenes.rs"]
mod scenes;

use common::gpu_test;
use data::{Random, assert_same};
use scenes::{scene_of, volume_of};
use tyndall::cpu;
use tyndall::cpu::quantiser::{Channel, Quantiser as Twin};
use tyndall::passes::quantiser::Quantiser;
use tyndall::passes::scene_data::SceneData;
use tyndall::scene::Mask;
use tyndall::shaders::constants;
use tyndall::vk::{Context, ImageFormat, Recorder};

/// The quantiser that the device makes for these colours, and its histogram.
fn made(ctx: &Context, dims: [u32; 3], color: &[u32], mask: Mask) -> (Twin, Vec<u32>) {
    let toml = "[transfer]\nconvention = \"extinction\"\npoints = [{ value = 0, color = 1, opacity = 0.7 }]";
    let data = SceneData::new(ctx, &scene_of(toml, volume_of(dims, vec![0.0; color.len()]))).unwrap();
    let image = ctx.image_3d("color", dims, ImageFormat::R32Uint).unwrap();
    let layer = (dims[0] * dims[1]) as usize;
    ctx.upload_image(&image, |z| color[z.start as usize * layer..z.end as usize * layer].to_vec()).unwrap();
    let mut control = vec![0; constants::PROXY_WORDS as usize];
    control[constants::PROXY_MASK as usize] = mask.word();
    let control = ctx.upload("control", &control).unwrap();
    let args = ctx.upload("args", &[7u32, 4, 1, 1]).unwrap();
    let pass = Quantiser::new(ctx, mask).unwrap();
    let mut rec = Recorder::new(ctx).unwrap();
    // Twice: nothing of the first time may be left.
    for _ in 0..2 {
        pass.record_histogram(&mut rec, &data, &image);
        pass.record(&mut rec, &control, &args, 1);
    }
    rec.submit_and_wait().unwrap();
    let control = ctx.read_back(&control).unwrap();
    let levels = &control[constants::PROXY_LEVELS as usize..][..4];
    let table = ctx.read_back(pass.table()).unwrap();
    let histogram = ctx.read_back(pass.histogram()).unwrap();
    (Twin::from_words(&table, levels.try_into().unwrap()), histogram)
}

fn assert_like_twin(case: &str, got: &Twin, color: &[u32], mask: Mask) {
    let twin = cpu::quantiser::quantiser(mask, &cpu::quantiser::color_histogram(color));
    for (c, (got, twin)) in got.channels.iter().zip(&twin.channels).enumerate() {
        let Channel { level, floor, value } = got;
        assert_same(&format!("{case}, channel {c}: lowest codes"), floor, &twin.floor);
        assert_same(&format!("{case}, channel {c}: levels"), level, &twin.level);
        for (code, (&value, &twin)) in value.iter().zip(&twin.value).enumerate() {
            // A device may divide less exactly.
            assert!((value - twin).abs() <= 1e-5 * twin, "{case}, channel {c}, code {code}: {value} instead of {twin}");
        }
    }
}

/// Root mean square error of the light that voxels send out, over its mean: source function times opacity. Of R, G, B alone,
/// of A alone, of all.
fn errors(color: &[u32], q: &Twin) -> [f64; 3] {
    let voxels = color.iter().filter(|&&color| color != 0);
    let (mut count, mut light, mut squares) = (0.0, 0.0, [0.0; 3]);
    for &color in voxels {
        let [r, g, b, a] = color.to_le_bytes().map(f64::from);
        let [qr, qg, qb, qa] = q.values(color).map(f64::from);
        let (source, quantised) = ((r * r + g * g + b * b) / 3.0, (qr + qg + qb) / 3.0);
        for (sum, found) in squares.iter_mut().zip([quantised * a, source * qa, quantised * qa]) {
            *sum += (found - source * a).powi(2);
        }
        count += 1.0;
        light += source * a;
    }
    squares.map(|sum| if light > 0.0 { (sum / count).sqrt() / (light / count) } else { 0.0 })
}

/// Colours with a few bright voxels, much of little light, and gaps between codes; a third of the voxels is empty.
fn random_colors(count: usize, seed: u64) -> Vec<u32> {
    let mut random = Random(seed);
    let mut code = |power: i32| (((random.word() >> 8) as f64 / f64::from(1 << 24)).powi(power) * 255.0) as u32;
    let one = |i: usize| match i % 3 {
        0 => 0,
        _ => code(3) | (code(8) & 0xF7) << 8 | code(1) << 16 | (1 + code(2) * 254 / 255) << 24,
    };
    (0..count).map(one).collect()
}

#[test]
fn histograms_are_exact() {
    gpu_test(|ctx| {
        // Several workgroups, the last one not full; sums beyond 32 bits.
        let cases = [([37, 41, 43], None), ([1, 1, 1], None), ([5, 7, 3], Some(0)), ([48, 48, 48], Some(u32::MAX))];
        for (i, (dims, constant)) in cases.into_iter().enumerate() {
            let count = dims.iter().product::<u32>() as usize;
            let color = constant.map_or_else(|| random_colors(count, i as u64), |color| vec![color; count]);
            let (_, got) = made(ctx, dims, &color, Mask::Adaptive(0.1));
            let twin = cpu::quantiser::color_histogram(&color);
            let words: Vec<u32> = twin.iter().flatten().flat_map(|&sum| [sum as u32, (sum >> 32) as u32]).collect();
            assert_same(&format!("{dims:?}"), &got, &words);
            assert!(constant != Some(u32::MAX) || got.iter().skip(1).step_by(2).any(|&upper| upper > 0));
        }
    });
}

#[test]
fn a_tolerance_holds_with_the_levels_of_the_twin() {
    gpu_test(|ctx| {
        let dims = [37, 41, 13];
        let count = dims.iter().product::<u32>() as usize;
        let mut colors: Vec<Vec<u32>> = (1..4).map(|seed| random_colors(count, seed)).collect();
        // Grey: what is wrong in the three channels is so in the same way, and adds up.
        colors.push(colors[0].iter().map(|&c| (c & 0xFF00_0000) | ((c & 0xFF) * 0x1_0101)).collect());
        // Without light, and without anything.
        colors.push(colors[0].iter().map(|&c| c & 0xFF00_0000).collect());
        colors.push(vec![0; count]);
        for (i, color) in colors.iter().enumerate() {
            let mut before = [256; 4];
            for tolerance in [0.0, 1e-4, 0.01, 0.05, 0.2, 1.0] {
                let case = format!("colours {i}, tolerance {tolerance}");
                let (got, _) = made(ctx, dims, color, Mask::Adaptive(tolerance));
                assert_like_twin(&case, &got, color, Mask::Adaptive(tolerance));
                let [light, opacity, all] = errors(color, &got);
                let allowed = f64::from(tolerance) * (1.0 + 1e-4);
                assert!(light <= allowed / 2.0 && opacity <= allowed / 2.0, "{case}: {light} and {opacity}");
                assert!(all <= allowed, "{case}: an error of {all}");
                assert!(got.levels().iter().zip(before).all(|(&now, before)| now <= before), "{case}: more levels");
                before = got.levels();
                // Empty voxels are alone in their level.
                assert!(color.iter().all(|&c| c == 0 || got.quantised(c) >> 24 != 0), "{case}: matter becomes empty");
                if tolerance == 0.0 {
                    let quantised: Vec<u32> = color.iter().map(|&c| got.quantised(c)).collect();
                    assert_same(&format!("{case}: no tolerance is exact"), &quantised, color);
                } else if i < 4 && (0.01..=0.2).contains(&tolerance) {
                    // Half of the half that each of both has is made use of.
                    assert!(light.max(opacity) > f64::from(tolerance) / 4.0, "{case}: {light} and {opacity}");
                }
            }
        }
    });
}

#[test]
fn fixed_masks_are_tables_too() {
    gpu_test(|ctx| {
        for bits in [[0xFF; 4], [0xF0; 4], [0; 4], [0xE0, 0x81, 0x00, 0x55]] {
            let mask = Mask::Channels(bits);
            let color = [0x1234_5678];
            let (got, _) = made(ctx, [1, 1, 1], &color, mask);
            assert_like_twin(&mask.to_string(), &got, &color, mask);
            assert_eq!(got.quantised(color[0]), color[0] & mask.word());
        }
    });
}

/// Levels grown under one limit are few: no more than a tenth above the fewest that any intervals can have.
#[test]
fn levels_are_nearly_as_few_as_can_be() {
    for seed in 1..4 {
        let color = random_colors(20_000, seed);
        for tolerance in [0.01, 0.05, 0.2] {
            let histogram = cpu::quantiser::color_histogram(&color);
            let got = cpu::quantiser::quantiser(Mask::Adaptive(tolerance), &histogram).channels[0].floor.len();
            let fewest = fewest_levels(&histogram, f64::from(tolerance));
            assert!(got >= fewest && got * 10 <= fewest * 11 + 10, "{seed}, {tolerance}: {got}, at best {fewest}");
        }
    }
}

/// Fewest intervals of codes of R whose squared error keeps to half of `tolerance`, by dynamic programming.
fn fewest_levels(histogram: &cpu::quantiser::Histogram, tolerance: f64) -> usize {
    let sum = |row: u32, f: &dyn Fn(f64) -> f64| -> f64 {
        histogram[row as usize].iter().enumerate().map(|(code, &n)| n as f64 * f(code as f64)).sum()
    };
    let voxels = sum(constants::HISTOGRAM_VOXELS, &|_| 1.0);
    let light = sum(constants::HISTOGRAM_LIGHT, &|code| code);
    let most = (0.5 * tolerance * light / voxels).powi(2) * voxels;
    let mut error = vec![vec![0.0; 257]; 257]; // of codes a..b in one level
    for (a, error) in error.iter_mut().enumerate().take(256) {
        let (mut weight, mut mean, mut spread) = (0.0, 0.0, 0.0);
        for b in a..256 {
            let (added, place) = (histogram[0][b] as f64, (b * b) as f64);
            if added > 0.0 {
                let apart = place - mean;
                weight += added;
                mean += apart * added / weight;
                spread += added * apart * (place - mean);
            }
            error[b + 1] = spread;
        }
    }
    let mut least: Vec<f64> = error[0].clone(); // error of codes 0..b in `levels` levels
    for levels in 1.. {
        if least[256] <= most {
            return levels;
        }
        least = (0..257).map(|b| (0..=b).map(|a| least[a] + error[a][b]).fold(f64::INFINITY, f64::min)).collect();
    }
    unreachable!()
}
