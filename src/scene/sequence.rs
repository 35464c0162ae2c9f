//! The frames of a scene: a still, a turntable, key frames, a series of volumes.

use super::animation::{KeyTable, layer_at};
use super::camera::{self, Framing};
use super::file::{MAX_FRAMES, SceneFile, VolumeTable};
use super::resolve::{self, file_layer, load_volume, merge};
use super::{Camera, Exposure, LightFor, Overrides, Scene, ToneCurve};
use crate::volume::Volume;
use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most angles that a moving camera's distance is chosen for; more frames than these lie closer together than the margin
/// around the volume is wide.
const MOST_ANGLES: usize = 720;

/// A scene before its volume is read: what every frame of it shows.
#[derive(Clone, Debug)]
pub struct Sequence {
    command_line: SceneFile,
    file: SceneFile,
    path: Option<PathBuf>,
    /// The volumes, in order, where there are several.
    series: Vec<PathBuf>,
    /// None where nothing says how many.
    frames: Option<u32>,
    /// What the camera is framed for, where it moves by key frames.
    angles: Vec<Framing>,
}

/// Reads a scene, as its first frame shows it: the command line over the scene file over presets. Without a scene file and a
/// volume it is the built-in default scene.
///
/// # Errors
/// A file cannot be read, or a value is out of range; the error names the file and line, or the flag.
pub fn load_scene(scene_file: Option<&Path>, overrides: &Overrides) -> Result<Scene> {
    Sequence::load(scene_file, overrides)?.scene(0)
}

/// The same for the text of a scene file; `name` is for errors. Files that it names are relative to the current folder.
pub fn load_scene_text(text: &str, name: &Path, overrides: &Overrides) -> Result<Scene> {
    Sequence::new(overrides.layer()?, SceneFile::parse(text, name)?, None)?.scene(0)
}

impl Sequence {
    /// Reads a scene file, but no volume. `None` as for [`load_scene`].
    ///
    /// # Errors
    /// As [`load_scene`], as far as the first frame and the number of frames tell.
    pub fn load(scene_file: Option<&Path>, overrides: &Overrides) -> Result<Self> {
        let command_line = overrides.layer()?;
        let file = file_layer(scene_file, &command_line)?;
        Self::new(command_line, file, scene_file)
    }

    fn new(command_line: SceneFile, file: SceneFile, path: Option<&Path>) -> Result<Self> {
        let path = path.map(Path::to_owned);
        let mut sequence = Self { command_line, file, path, series: Vec::new(), frames: None, angles: Vec::new() };
        let first = sequence.layers(0)?;
        if let Some(file) = first.volume.file.as_deref() {
            sequence.series = files_of(file)?;
        }
        sequence.frames = sequence.count(&first)?;
        if sequence.moves_by_keys() {
            let frames = sequence.frames() as usize;
            let angles = frames.min(MOST_ANGLES);
            let frame = |i: usize| (i * (frames - 1) / (angles - 1).max(1)) as u32;
            let framing = |i| Ok(resolve::framing(&sequence.layers(frame(i))?.camera));
            sequence.angles = (0..angles).map(framing).collect::<Result<_>>()?;
        }
        Ok(sequence)
    }

    /// Frames of the scene whose first is given, if anything says how many; what does must agree.
    fn count(&self, first: &SceneFile) -> Result<Option<u32>> {
        let turntable = first.turntable.frames;
        let animation = self.file.animation.frames;
        if let (Some(turntable), Some(animation)) = (turntable, animation)
            && turntable != animation
        {
            let problem = format!("is {animation}, but the turntable has {turntable} frames");
            let cure = "leave one of them out, or let them agree";
            return Err(self.error("animation.frames", problem, cure));
        }
        if turntable.is_some() && self.moves_by_keys() {
            let cure = "leave the turntable or the keys' camera out (an azimuth of 360 more is a turn)";
            return Err(self.error("animation.key", "moves the camera, and so does the turntable", cure));
        }
        if turntable.is_none() && self.file.animation == Default::default() && self.series.len() < 2 {
            return Ok(None);
        }
        let last_key = self.keys().last().map_or(0, |key| key.frame.ceil() as u32 + 1);
        let needed = (self.series.len() as u32).max(last_key).max(1);
        let frames = turntable.or(animation).unwrap_or(needed);
        if frames > MAX_FRAMES {
            let cure = format!("let [animation] frames say how many, at most {MAX_FRAMES}");
            return Err(self.error("volume.file", format!("has {frames} files"), cure));
        }
        Ok(Some(frames))
    }

    fn error(&self, field: &str, problem: impl Into<String>, cure: impl Into<String>) -> Error {
        let what = self.path.as_ref().map_or("scene".into(), |p| p.display().to_string());
        Error::input(format!("{what}: field '{field}'"), problem, cure)
    }

    fn keys(&self) -> &[KeyTable] {
        self.file.animation.keys()
    }

    fn moves_by_keys(&self) -> bool {
        self.keys().iter().any(|key| key.camera != Default::default())
    }

    /// Do all frames have the same light?
    fn only_moves(&self) -> bool {
        self.series.len() < 2 && self.keys().iter().all(KeyTable::moves_only)
    }

    /// Frames; at least 1.
    pub fn frames(&self) -> u32 {
        self.frames.unwrap_or(1)
    }

    /// Does nothing say how many frames there are?
    pub fn is_still(&self) -> bool {
        self.frames.is_none()
    }

    /// The scene file.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The exposure of a frame.
    pub fn exposure(&self, frame: u32) -> Result<Exposure> {
        Ok(resolve::display(&self.layers(frame)?.output).0)
    }

    /// Everything that frame `frame` shows, checked.
    fn layers(&self, frame: u32) -> Result<SceneFile> {
        let keyed = layer_at(self.keys(), f64::from(frame));
        let mut layers = merge(self.command_line.clone(), keyed.over(self.file.clone()))?;
        layers.animation = Default::default();
        if !self.series.is_empty() {
            let at = u64::from(frame) * self.series.len() as u64 / u64::from(self.frames());
            layers.volume.file = Some(self.series[at as usize].clone());
        }
        // All frames alike: a change would be seen.
        if self.frames() > 1 && !self.only_moves() {
            layers.render.light_for.get_or_insert(LightFor::View);
        }
        Ok(layers)
    }

    /// The scene of a frame.
    ///
    /// # Errors
    /// As [`load_scene`].
    pub fn scene(&self, frame: u32) -> Result<Scene> {
        let layers = self.layers(frame)?;
        let volume = load_volume(&layers.volume, self.path.as_deref())?;
        self.resolve(layers, volume.into(), frame)
    }

    fn resolve(&self, mut layers: SceneFile, volume: Arc<Volume>, frame: u32) -> Result<Scene> {
        let only_moves = self.only_moves();
        if self.frames() > 1 && only_moves {
            layers.render.light_for.get_or_insert(LightFor::EveryView);
        }
        let mut scene = resolve::resolve(layers.clone(), volume)?;
        scene.path = self.path.clone();
        scene.camera = self.camera(&layers, &scene, frame)?;
        if !only_moves {
            scene.views.clear();
        } else if self.moves_by_keys() {
            let camera = |frame| self.camera(&self.layers(frame)?, &scene, frame);
            scene.views = (0..self.frames()).map(camera).collect::<Result<_>>()?;
        }
        Ok(scene)
    }

    /// The camera of a frame, which `layers` are of, in a scene of this sequence.
    fn camera(&self, layers: &SceneFile, scene: &Scene, frame: u32) -> Result<Camera> {
        let (grid, size, table) = (&scene.volume.grid, scene.settings.size, &layers.camera);
        let turns = layers.turntable.turns();
        if let Some(&turn) = turns.get(frame as usize) {
            return Ok(resolve::camera(table, grid, size, &turns)?.turned(camera::centre(grid), turn));
        }
        if self.angles.is_empty() || table.position.is_some() {
            return resolve::camera(table, grid, size, &[]);
        }
        Ok(camera::frame_moving(grid, &resolve::framing(table), size, &self.angles))
    }
}

/// Goes through frames of a sequence; makes anew only what changes from one to the next.
pub struct Player {
    sequence: Arc<Sequence>,
    last: Option<(SceneFile, Arc<Scene>)>,
}

/// What a frame shows.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The scene; the same one as long as nothing changes but camera, exposure and tone, which are those of the frame that it
    /// was made for.
    pub scene: Arc<Scene>,
    /// The frame's camera.
    pub camera: Camera,
    /// The frame's exposure.
    pub exposure: Exposure,
    /// The frame's tone curve.
    pub tone: ToneCurve,
}

impl Player {
    /// Before the first frame.
    pub fn new(sequence: Arc<Sequence>) -> Self {
        Self { sequence, last: None }
    }

    /// Goes to a frame.
    ///
    /// # Errors
    /// As [`load_scene`].
    pub fn go(&mut self, frame: u32) -> Result<Shot> {
        let layers = self.sequence.layers(frame)?;
        let volume_of = |table: &VolumeTable| match &self.last {
            Some((last, scene)) if last.volume == *table => Ok(scene.volume.clone()),
            _ => load_volume(table, self.sequence.path()).map(Arc::new),
        };
        let scene = match &self.last {
            Some((last, scene)) if lights_as(last, &layers) => scene.clone(),
            _ => {
                let volume = volume_of(&layers.volume)?;
                // What is not needed any more makes room for what is.
                self.last = None;
                Arc::new(self.sequence.resolve(layers.clone(), volume, frame)?)
            }
        };
        let camera = self.sequence.camera(&layers, &scene, frame)?;
        let (exposure, tone) = resolve::display(&layers.output);
        self.last = Some((layers, scene.clone()));
        Ok(Shot { scene, camera, exposure, tone })
    }
}

/// Do they differ by camera, exposure and tone at most?
fn lights_as(a: &SceneFile, b: &SceneFile) -> bool {
    let moved = SceneFile { camera: b.camera.clone(), output: b.output.clone(), ..a.clone() };
    moved == *b
}

/// Is it no file, but a pattern of names?
fn is_pattern(path: &Path) -> bool {
    path.to_str().is_some_and(|p| p.contains(['*', '?', '['])) && !path.exists()
}

/// The files of a pattern: `*` stands for any part of a name, `?` for a character, `[0-9]` for one of these. Numbers in names
/// count as such: 9 comes before 10. What is no pattern is one file, whether there is one or not.
pub fn files_of(pattern: &Path) -> Result<Vec<PathBuf>> {
    if !is_pattern(pattern) {
        return Ok(vec![pattern.to_owned()]);
    }
    let cure =
        "write e.g. \"smoke_*.nrrd\": * stands for any part of a name, ? for a character, [0-9] for one of these";
    let text = pattern.to_str().expect("a pattern is text");
    let found = glob::glob(text).map_err(|e| Error::file(pattern, format!("is no pattern of files: {e}"), cure))?;
    let path = |file: glob::GlobResult| file.map_err(|e| Error::io(e.path(), "read", e.error().kind().into()));
    let mut files = found.map(path).collect::<Result<Vec<_>>>()?;
    if files.is_empty() {
        return Err(Error::file(pattern, "no file has such a name", cure));
    }
    alphanumeric_sort::sort_path_slice(&mut files);
    Ok(files)
}
