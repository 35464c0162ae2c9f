//! A video or an animated picture of finished frames, by ffmpeg.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::output::{Format, replace};
use crate::{Error, Result};

const PROGRAM: &str = "ffmpeg";

/// Refuses what could not be made once the frames are there.
pub fn check(video: &Path, frames: &Path) -> Result<()> {
    if Format::of(frames)? != Format::Png {
        let problem = format!("a video is made of PNGs, and '{}' is none", frames.display());
        return Err(Error::usage("--video", problem, "name the frames .png"));
    }
    crate::output::check_writable(video)?;
    let is_there = Command::new(PROGRAM).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    match is_there {
        Ok(status) if status.success() => Ok(()),
        _ => {
            let problem = format!("the program {PROGRAM}, which makes it, does not run here");
            Err(Error::usage("--video", problem, "install ffmpeg, or leave --video out and make it elsewhere"))
        }
    }
}

/// Makes the video that its name asks for: an animated WebP or GIF, otherwise H.264.
///
/// # Errors
/// A frame cannot be read, or ffmpeg fails; no video is there then, or the one that was there before.
pub fn make(video: &Path, frames: &[PathBuf], fps: f64) -> Result<()> {
    replace(video, |temporary| {
        let mut child = start(temporary, fps).map_err(|e| Error::io(video, "start ffmpeg for", e))?;
        let mut complaints = child.stderr.take().expect("it was asked for");
        // Read beside, or ffmpeg waits for us once it has much to say.
        let reader = std::thread::spawn(move || {
            let mut text = String::new();
            let _ = complaints.read_to_string(&mut text);
            text
        });
        let fed = feed(&mut child, frames);
        let status = child.wait().map_err(|e| Error::io(video, "wait for ffmpeg with", e))?;
        let complaints = reader.join().unwrap_or_default();
        if !status.success() {
            let said = complaints.trim().lines().last().unwrap_or("nothing").to_owned();
            let cure = "see what ffmpeg says; the frames are finished, starting again makes the video only";
            return Err(Error::file(video, format!("ffmpeg failed ({status}) and said: {said}"), cure));
        }
        fed
    })
}

fn start(video: &Path, fps: f64) -> io::Result<Child> {
    // Whatever the name of a frame: ffmpeg gets their bytes.
    Command::new(PROGRAM)
        .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "image2pipe", "-c:v", "png"])
        .args(["-framerate", &fps.to_string(), "-i", "-"])
        .args(encoding(video))
        .arg(video)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
}

/// What ffmpeg is to make of the frames.
fn encoding(video: &Path) -> &'static [&'static str] {
    let extension = video.extension().unwrap_or_default().to_ascii_lowercase();
    match extension.to_str() {
        // Both are shown over and over (`-loop 0`).
        Some("webp") => &["-c:v", "libwebp_anim", "-quality", "80", "-loop", "0"],
        // The 256 colours that suit all frames best.
        Some("gif") => &["-filter_complex", "split[a][b];[a]palettegen[colours];[b][colours]paletteuse", "-loop", "0"],
        // H.264 of common players has even sizes and 4:2:0.
        _ => &["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-crf", "16", "-pix_fmt", "yuv420p"],
    }
}

fn feed(child: &mut Child, frames: &[PathBuf]) -> Result<()> {
    let mut stdin = child.stdin.take().expect("it was asked for");
    for frame in frames {
        let mut file = File::open(frame).map_err(|e| Error::io(frame, "open", e))?;
        match io::copy(&mut file, &mut stdin) {
            // It has ended; its exit status says why.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => break,
            other => other.map_err(|e| Error::io(frame, "send", e))?,
        };
    }
    Ok(())
}
