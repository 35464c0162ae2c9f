//! Means over blocks of voxels against their CPU twin.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;

use bodies::{assert_close, image, image_of, random_light, texture};
use bytemuck::Zeroable;
use common::gpu_test;
use glam::Vec4;
use half::f16;
use tyndall::abi::SceneParams;
use tyndall::cpu;
use tyndall::cpu::texture::Texture;
use tyndall::passes::mips::Mips;
use tyndall::shaders::constants;
use tyndall::vk::{Context, Image, ImageFormat, Recorder};

/// Half floats at every level.
const ROUNDING: f32 = 3e-3;

/// What rays skip by: macrocells without extinction.
fn emptiness(ctx: &Context, source: &Texture<Vec4>) -> Image {
    let params = SceneParams { dims: source.dims.to_array(), ..SceneParams::zeroed() };
    let occupied = cpu::emptiness::occupancy(&params, source, constants::SKIP_SIZE);
    image_of(
        ctx,
        "emptiness",
        ImageFormat::R32Uint,
        &occupied,
        |&is_occupied| if is_occupied { 0 } else { 0x1111_1111u32 },
    )
}

#[test]
fn means_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (seed, dims, one_of) in
            [(1, [8, 8, 8], 2), (2, [7, 5, 9], 2), (3, [1, 1, 1], 2), (4, [17, 3, 2], 2), (5, [21, 14, 17], 400)]
        {
            // Half of the voxels are empty, or nearly all, but have light: interpolation carries it to those that are not.
            let mut source = random_light(dims, seed, 0.0, 900.0);
            for (i, texel) in source.texels.iter_mut().enumerate() {
                texel.w = if i % one_of == 0 { texel.w / 900.0 } else { 0.0 };
                texel.w = f16::from_f32(texel.w).to_f32();
            }
            let pass = Mips::new(ctx, dims).unwrap();
            let mut rec = Recorder::new(ctx).unwrap();
            let emptiness = emptiness(ctx, &source);
            let words = ctx.read_back_image::<u32>(&emptiness).unwrap();
            assert_eq!(words.iter().any(|&word| word != 0), one_of > 2, "{dims:?}: {words:?}");
            pass.record(&mut rec, &image(ctx, "source", &source), &emptiness);
            rec.submit_and_wait().unwrap();
            for level in 0..3 {
                let case = format!("{dims:?}, level {level}, seed {seed}");
                let expected = cpu::mips::mips(&source, level as u32);
                let means = texture(ctx, &pass.means[level]);
                // The first level is not multiplied by the extinction.
                let product = |f: &Vec4| if level == 0 { (f.truncate() * f.w).extend(f.w) } else { *f };
                let products: Vec<Vec4> = means.texels.iter().map(product).collect();
                assert_close(&case, &products, &expected.texels, ROUNDING, ROUNDING);
                let values: Vec<[f16; 2]> =
                    ctx.read_back_image::<u32>(&pass.values[level]).unwrap().into_iter().map(bytemuck::cast).collect();
                let pair = |[light, extinction]: [f32; 2]| Vec4::new(light, extinction, 0.0, 0.0);
                let got: Vec<Vec4> = values.iter().map(|v| pair(v.map(f32::from))).collect();
                let expected: Vec<Vec4> = expected.texels.iter().map(|&f| pair(cpu::mips::values(f))).collect();
                assert_close(&case, &got, &expected, ROUNDING, ROUNDING);
            }
        }
    });
}

#[test]
fn a_uniform_medium_stays_what_it_is() {
    gpu_test(|ctx| {
        let dims = [6, 5, 7];
        let pass = Mips::new(ctx, dims).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        let uniform = Vec4::new(4.0, 8.0, 12.0, 0.5);
        let source = Texture::filled(dims, uniform);
        pass.record(&mut rec, &image(ctx, "source", &source), &emptiness(ctx, &source));
        rec.submit_and_wait().unwrap();
        assert!(texture(ctx, &pass.means[0]).texels.iter().all(|&f| f == uniform));
        for means in &pass.means[1..] {
            assert!(texture(ctx, means).texels.iter().all(|&f| f == Vec4::new(2.0, 4.0, 6.0, 0.5)));
        }
        for values in &pass.values {
            let words: Vec<[f16; 2]> =
                ctx.read_back_image::<u32>(values).unwrap().into_iter().map(bytemuck::cast).collect();
            assert!(words.iter().all(|v| v.map(f32::from) == [8.0, 0.5]), "{words:?}");
        }
    });
}

/// Not looked at where nothing is: with extinction there all the same, there is nothing.
#[test]
fn what_is_empty_is_skipped() {
    gpu_test(|ctx| {
        let dims = [9, 4, 4];
        let full = Texture::filled(dims, Vec4::new(4.0, 8.0, 12.0, 0.5));
        let mut half = full.clone();
        for (i, texel) in half.texels.iter_mut().enumerate() {
            texel.w = if i % 9 == 8 { 0.5 } else { 0.0 };
        }
        let pass = Mips::new(ctx, dims).unwrap();
        let mut rec = Recorder::new(ctx).unwrap();
        pass.record(&mut rec, &image(ctx, "source", &full), &emptiness(ctx, &half));
        rec.submit_and_wait().unwrap();
        let means = texture(ctx, &pass.means[0]).texels;
        // Of the macrocells [0, 4), [4, 8) and [8, 9) the first is empty, and interpolation reaches into the second.
        let expected = |i: usize| if i % 9 < 4 { Vec4::ZERO } else { full.texels[i] };
        assert!(means.iter().enumerate().all(|(i, &f)| f == expected(i)), "{means:?}");
    });
}
