//! Compiled pipelines on disk, from context to context. What a file must be like is tested beside
//! `src/vk/pipeline_cache.rs`.

mod common;
#[path = "common/place.rs"]
mod place;

use common::{assert_silent, context_with_cache, one_at_a_time};
use place::Place;
use std::fs;
use std::path::Path;
use tyndall::shaders;
use tyndall::vk::{Pipeline, PipelineStats};

/// Makes a pipeline in a context of its own: how it came about, and whether the folder had sound data.
fn make_one(folder: Option<&Path>) -> (PipelineStats, bool) {
    let _turn = one_at_a_time();
    let ctx = context_with_cache(folder.map(Path::to_owned));
    let pipeline = Pipeline::new(&ctx, &shaders::CANARY, &[]).unwrap();
    drop(pipeline);
    let seen = (ctx.pipeline_stats(), ctx.has_cached_pipelines());
    assert_silent(&ctx.close());
    seen
}

/// The folder's only file, and what is in it.
fn only_file(place: &Place) -> (String, Vec<u8>) {
    let mut files = place.files();
    assert_eq!(files.len(), 1);
    files.swap_remove(0)
}

/// Bytes that Vulkan's own header takes: a driver that leaves nothing else keeps no pipelines (lavapipe 22.3).
const EMPTY: usize = 48 + 32;

#[test]
fn a_second_context_finds_what_the_first_compiled() {
    let place = Place::new();
    let (first, had) = make_one(Some(place.0.path()));
    assert!(!had && first.made == 1 && first.cached == 0, "{first:?}");
    let (_, file) = only_file(&place);
    let (second, has) = make_one(Some(place.0.path()));
    assert!(has && second.made == 1, "{second:?}");
    if file.len() > EMPTY {
        assert_eq!(second.cached, 1, "compiled again");
    } else {
        println!("SKIP reuse by the driver: its pipeline cache keeps nothing");
    }
    assert!(!make_one(None).1, "taken from nowhere");
}

#[test]
fn damaged_files_are_ignored_and_replaced() {
    let place = Place::new();
    make_one(Some(place.0.path()));
    let (name, sound) = only_file(&place);
    let mut flipped = sound.clone();
    *flipped.last_mut().unwrap() ^= 1;
    for (what, bytes) in [("cut", &sound[..sound.len() - 1]), ("flipped", &flipped), ("empty", &[])] {
        place.write(&name, bytes);
        assert!(!make_one(Some(place.0.path())).1, "{what}: taken");
        assert!(make_one(Some(place.0.path())).1, "{what}: not replaced");
    }
}

const SMALL: [&str; 8] =
    ["render", "--volume", "phantom:cloud:8x8x8", "--size", "8x8", "--model", "absorption", "--quiet"];

#[test]
fn the_command_line_keeps_them_where_it_is_told() {
    let place = Place::new();
    let folder = place.path("cache");
    let run = |flags: &[&str], cache: &Path| {
        let mut command = place.command(&[&SMALL[..], flags].concat());
        let output = command.env("TYNDALL_CACHE_DIR", cache).output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    };
    // Validation shall see every pipeline compiled.
    run(&["--validate"], &folder);
    assert!(!folder.exists());
    run(&[], &folder);
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    // A folder that cannot be made costs nothing but time.
    place.write("file", "");
    run(&[], &place.path("file"));
}
