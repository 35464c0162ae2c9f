//! The examples that other tests do not run.

mod common;
#[allow(dead_code, reason = "its main is not called")]
#[path = "../examples/render_a_volume.rs"]
mod render_a_volume;

#[test]
fn a_volume_in_memory_is_rendered() {
    let _turn = common::one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fog.png");
    render_a_volume::run(&path, [20, 20, 16], [40, 40]).unwrap();
    let picture = tyndall::output::read_picture(&path).unwrap();
    let brightness = |x: usize, y: usize| picture.pixels[y * 40 + x][..3].iter().sum::<f32>();
    assert!(brightness(20, 20) > 0.5 && brightness(1, 1) < 0.1, "{} {}", brightness(20, 20), brightness(1, 1));
}
