//! What the documents tell people to type is understood, and the gallery shows what its commands make.

use clap::Parser;
use std::fs;
use std::path::{Path, PathBuf};
use tyndall::cli::Cli;

/// What stands for something of the reader's own, and an example of it.
const STAND_INS: [(&str, &str); 8] = [
    ("SCENE", "scene.toml"),
    ("NAME", "skull"),
    ("MODE", "residual"),
    ("SEED", "7"),
    ("QUALITY", "draft"),
    ("FOLDER", "volumes"),
    ("DIR", "pages"),
    ("MASK", "adaptive:0.5"),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The documents at the top and in some folders.
fn documents() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["", "docs", "scenes", "benches/peers"] {
        let entries = fs::read_dir(root().join(folder)).unwrap().map(|e| e.unwrap().path());
        found.extend(entries.filter(|path| path.extension().is_some_and(|e| e == "md")));
    }
    found.sort();
    found
}

/// The commands of a document: indented lines and fenced ones that begin with `tyndall`, as words, without what a shell does with
/// their output.
fn commands(document: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(document).unwrap().replace("\\\n    ", "");
    let mut commands = Vec::new();
    for line in text.lines() {
        let line = line.trim_start().replace("cargo run --release -- ", "tyndall ");
        // A line of prose has backticks somewhere.
        if !line.starts_with("tyndall ") || line.contains('`') {
            continue;
        }
        let words = shell_words::split(&line).unwrap_or_else(|e| panic!("{}: {line}: {e}", document.display()));
        let ends = |word: &String| word.starts_with('#') || [">", "|", "&&"].contains(&word.as_str());
        commands.push(words.into_iter().take_while(|word| !ends(word)).collect());
    }
    commands
}

#[test]
fn every_command_of_the_documents_is_understood() {
    let (mut found, mut problems) = (0, String::new());
    for document in documents() {
        for command in commands(&document) {
            let words = command.iter().filter(|word| *word != "...").map(|word| {
                let replace = |word: String, &(name, example): &(&str, &str)| word.replace(name, example);
                STAND_INS.iter().fold(word.clone(), replace)
            });
            if let Err(error) = Cli::try_parse_from(words) {
                problems += &format!("{}: {}\n{error}\n", document.display(), command.join(" "));
            }
            found += 1;
        }
    }
    assert!(problems.is_empty(), "{problems}");
    assert!(found > 50, "only {found} commands were found");
}

#[test]
fn a_command_that_is_not_understood_is_noticed() {
    assert!(Cli::try_parse_from(["tyndall", "render", "--directoins", "8"]).is_err());
    assert!(Cli::try_parse_from(["tyndall", "render", "--directions", "zero"]).is_err());
}

/// The flight that docs/batch.md explains is the file that it names.
#[test]
fn the_key_frames_shown_are_those_of_the_scene_file() {
    let document = fs::read_to_string(root().join("docs/batch.md")).unwrap();
    let block = document.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("a block of TOML");
    let scene = fs::read_to_string(root().join("scenes/fly.toml")).unwrap();
    assert!(scene.ends_with(block), "docs/batch.md and scenes/fly.toml differ");
}

/// Every picture of the gallery has a command, every command's picture is shown, and none needs a file of one's own.
#[test]
fn the_gallery_shows_what_its_commands_make() {
    let document = root().join("docs/gallery.md");
    let text = fs::read_to_string(&document).unwrap();
    let shown: Vec<&str> =
        text.split("images/gallery/").skip(1).map(|rest| rest.split(')').next().unwrap_or_default()).collect();
    let made: Vec<String> = commands(&document)
        .iter()
        .map(|words| {
            let after = |flag: &str| words.iter().position(|word| word == flag).map(|at| words[at + 1].as_str());
            assert!(after("--volume").is_none_or(|volume| volume.starts_with("phantom:")), "{words:?}");
            after("--video").or(after("-o")).expect("a picture").to_owned()
        })
        .collect();
    assert!(shown.iter().eq(made.iter()), "shown: {shown:?}\nmade: {made:?}");
    if !root().join("docs/images").exists() {
        println!("SKIP: a package has no pictures");
        return;
    }
    for name in shown {
        assert!(root().join("docs/images/gallery").join(name).is_file(), "{name} is not there: run scripts/gallery");
    }
}
