//! Cubes of one value against their CPU twin.

mod common;
#[path = "common/data.rs"]
mod data;

use common::gpu_test;
use data::{Random, assert_same};
use tyndall::cpu;
use tyndall::cpu::texture::Texture;
use tyndall::passes::cubes::Cubes;
use tyndall::shaders::constants::CUBES_VALUE_BITS;
use tyndall::vk::{Context, ImageFormat, Recorder};

fn cubes(ctx: &Context, values: &Texture<u32>) -> Vec<u32> {
    let dims = values.dims.to_array();
    let image = ctx.image_3d("values", dims, ImageFormat::R32Uint).unwrap();
    let layer = (dims[0] * dims[1]) as usize;
    ctx.upload_image(&image, |z| values.texels[z.start as usize * layer..z.end as usize * layer].to_vec()).unwrap();
    let pass = Cubes::new(ctx, dims).unwrap();
    // Twice: what the first one left must not matter.
    for _ in 0..2 {
        let mut rec = Recorder::new(ctx).unwrap();
        pass.record(&mut rec, &image);
        rec.submit_and_wait().unwrap();
    }
    ctx.read_back_image(&pass.image).unwrap()
}

/// Blocks of 1, 2, 4 or 8 voxels have one value of two, so that cubes of every size appear, also at the ends.
#[test]
fn cubes_agree_with_the_twin() {
    gpu_test(|ctx| {
        for (seed, dims) in [(1, [16, 16, 16]), (2, [13, 7, 9]), (3, [1, 1, 1]), (4, [33, 2, 1]), (5, [8, 8, 5])] {
            for block in [1u32, 2, 4, 8] {
                let mut random = Random(seed);
                let of_block: Vec<u32> = (0..64 * 64).map(|_| random.word() & 1).collect();
                let at = |i: u32| {
                    let [x, y, z] = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(|v| v / block);
                    of_block[((z * 16 + y) * 16 + x) as usize % of_block.len()]
                };
                let values = Texture::new(dims, (0..dims.iter().product()).map(at).collect());
                let case = format!("{dims:?}, blocks of {block}, seed {seed}");
                assert_same(&case, &cubes(ctx, &values), &cpu::cubes::cubes(&values).texels);
            }
        }
    });
}

#[test]
fn cubes_by_hand() {
    gpu_test(|ctx| {
        // One other voxel in a box of 8³: its octant falls apart, the others stay cubes of 4.
        let mut values = Texture::filled([8; 3], 5u32);
        *values.texel_mut(glam::UVec3::new(1, 0, 0)) = 9;
        let got = Texture::new([8; 3], cubes(ctx, &values));
        let level = |x, y, z| got.fetch(glam::UVec3::new(x, y, z)) >> CUBES_VALUE_BITS;
        assert_eq!([level(0, 0, 0), level(1, 0, 0), level(2, 0, 0), level(3, 3, 3), level(4, 0, 0)], [0, 0, 1, 1, 2]);
        // One value: the whole grid is a cube.
        assert!(cubes(ctx, &Texture::filled([8; 3], 7)).iter().all(|&word| word == 7 | 3 << CUBES_VALUE_BITS));
    });
}
