//! Renders a volume that this program has in memory: a ball of fog with a dense core, as a PNG.
//!
//!     cargo run --release --example render_a_volume

use std::ops::ControlFlow;
use std::path::Path;
use tyndall::output::{BitDepth, PngOptions, write_picture};
use tyndall::render::render;
use tyndall::scene::{file::SceneFile, merge, resolve};
use tyndall::vk::{Context, ContextConfig};
use tyndall::volume::{Grid, Volume, VoxelData};

fn main() -> tyndall::Result<()> {
    run(Path::new("fog.png"), [64, 64, 48], [384, 384])
}

/// Renders to `path`.
pub fn run(path: &Path, dims: [u32; 3], size: [u32; 2]) -> tyndall::Result<()> {
    let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]);
    let density = |x: u32, y: u32, z: u32| {
        let from_middle = [x, y, z].into_iter().zip(dims).map(|(i, n)| ((i as f32 + 0.5) / n as f32 - 0.5).powi(2));
        (1.0 - 2.0 * from_middle.sum::<f32>().sqrt()).max(0.0)
    };
    let along_x = |z, y| (0..dims[0]).map(move |x| density(x, y, z));
    let values = (0..dims[2]).flat_map(|z| (0..dims[1]).flat_map(move |y| along_x(z, y))).collect();
    let volume = Volume { name: "fog".into(), grid, data: VoxelData::F32(values), slope: 1.0, intercept: 0.0 };

    // Everything that a scene file can say; what it leaves out is chosen.
    let text = format!(
        "transfer.points = [{{ value = 0.1, color = 0.9, opacity = 0 }}, {{ value = 1, color = [1, 0.7, 0.4], opacity = 0.6 }}]\n\
         light = [{{ azimuth = -40, elevation = 35, irradiance = 5 }}]\n\
         environment.radiance = [0.15, 0.2, 0.3]\nbackground = [0.01, 0.01, 0.02]\nrender.size = {size:?}\n"
    );
    let scene = resolve(merge(SceneFile::default(), SceneFile::parse(&text, Path::new("fog"))?)?, volume)?;

    let ctx = Context::new(&ContextConfig::default())?;
    let (picture, stats) = render(&ctx, &scene, &mut |_| ControlFlow::Continue(()))?;
    write_picture(path, &picture, &PngOptions { bits: BitDepth::Eight, exposure: scene.exposure, tone: scene.tone })?;
    println!("{}wrote {}", stats.table(), path.display());
    Ok(())
}
