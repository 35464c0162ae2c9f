//! What is kept on disk: compiled pipelines, and what else is made once. One file per kind, device, driver and version of
//! Tyndall.
//!
//! A file is data behind a header of our own, since drivers do not check theirs against damage. Whatever does not match is
//! ignored and replaced; whatever the system refuses turns the cache off. Nothing of it is ever an error.

use ash::vk;
use sha2::{Digest, Sha256};
use std::fs;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// First bytes of a file.
const MAGIC: &[u8; 8] = b"TYNDPIPE";
/// Length of the data as u64, then the hash of key and data.
const HEADER_BYTES: usize = MAGIC.len() + 8 + 32;
/// Most data of a file. What has grown beyond, from too many scenes, is thrown away whole.
const MAX_BYTES: usize = 64 << 20;
/// How the names of files that are being filled end.
const PART: &str = ".part";
/// Most files of a kind in the folder: each driver and version leaves one.
const MAX_FILES: usize = 8;
/// How the names of files of pipelines begin.
const PIPELINES: &str = "pipelines-";

/// The user's folder for compiled pipelines: `TYNDALL_CACHE_DIR` (empty: none), else `tyndall` in `XDG_CACHE_HOME` or in
/// `~/.cache`. `None` where none of them names a place.
pub fn user_cache_dir() -> Option<PathBuf> {
    cache_dir(|name| std::env::var_os(name).map(PathBuf::from), std::env::home_dir())
}

fn cache_dir(variable: impl Fn(&str) -> Option<PathBuf>, home: Option<PathBuf>) -> Option<PathBuf> {
    if let Some(own) = variable("TYNDALL_CACHE_DIR") {
        return (!own.as_os_str().is_empty()).then_some(own);
    }
    // The XDG specification: relative paths are invalid.
    let xdg = variable("XDG_CACHE_HOME").filter(|path| path.is_absolute());
    let folder = xdg.or_else(|| home.filter(|home| home.is_absolute()).map(|home| home.join(".cache")))?;
    Some(folder.join("tyndall"))
}

/// A file of data of one kind.
pub(super) struct CacheFile {
    path: PathBuf,
    /// How the names of its kind begin.
    prefix: &'static str,
    key: String,
    /// Hash of what is in the file, if that is sound.
    found: Option<[u8; 32]>,
}

impl CacheFile {
    /// The file of pipelines in `folder` for the device with these properties, and the driver's data if there are sound ones.
    pub(super) fn open(folder: &Path, device: &vk::PhysicalDeviceProperties, driver: &str) -> (Self, Vec<u8>) {
        // The name says what a CPU's vectors are like; the version, which shaders there are.
        let name = device.device_name_as_c_str().unwrap_or_default().to_string_lossy();
        let key = format!(
            "{} {name} {:x} {:x} {driver} {:x} {:x?}",
            env!("CARGO_PKG_VERSION"),
            device.vendor_id,
            device.device_id,
            device.driver_version,
            device.pipeline_cache_uuid,
        );
        Self::of_key(folder, PIPELINES, key)
    }

    fn of_key(folder: &Path, prefix: &'static str, key: String) -> (Self, Vec<u8>) {
        let short: String = Sha256::digest(&key).iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        let mut file = Self { path: folder.join(format!("{prefix}{short}")), prefix, key, found: None };
        let data = file.read().unwrap_or_default();
        (file, data)
    }

    /// What is kept for the same device under another prefix, made by `make` where there is nothing sound. Of several who make
    /// it at once one wins, and the others get what that one made. `None` where nothing can be kept: then nothing is made.
    pub(super) fn kept<E>(
        &self,
        prefix: &'static str,
        make: impl FnOnce() -> Result<Vec<u8>, E>,
    ) -> Result<Option<Vec<u8>>, E> {
        let (mut file, data) = Self::of_key(self.folder(), prefix, self.key.clone());
        if file.is_found() {
            return Ok(Some(data));
        }
        let part = match file.new_part() {
            Ok(part) => part,
            Err(error) => {
                log::debug!("{}: cannot be made: {error}", file.path.display());
                return Ok(None);
            }
        };
        let data = make()?;
        Ok(file.settle(part, &data).unwrap_or_else(|error| {
            log::debug!("{}: not written: {error}", file.path.display());
            None
        }))
    }

    /// Writes `data` by way of `part`, unless sound ones have come to be there meanwhile; returns what is there.
    fn settle(&mut self, mut part: NamedTempFile, data: &[u8]) -> std::io::Result<Option<Vec<u8>>> {
        part.write_all(&self.header(data))?;
        part.write_all(data)?;
        for _ in 0..2 {
            part = match part.persist_noclobber(&self.path) {
                Ok(_) => {
                    remove_oldest(self.folder(), self.prefix)?;
                    return Ok(Some(data.to_vec()));
                }
                Err(refused) => refused.file,
            };
            if let Some(found) = self.read() {
                return Ok(Some(found));
            }
            // What is there is damaged. (Should another process mend it just now, the two go by data of their own this once.)
            let _ = fs::remove_file(&self.path);
        }
        Ok(None)
    }

    fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }

    /// A file to be filled: under its name a file is whole, whoever else writes it. A power cut is what the hash is for.
    fn new_part(&self) -> std::io::Result<NamedTempFile> {
        fs::create_dir_all(self.folder())?;
        tempfile::Builder::new().prefix(self.prefix).suffix(PART).tempfile_in(self.folder())
    }

    fn hash(&self, data: &[u8]) -> [u8; 32] {
        Sha256::new().chain_update(self.prefix).chain_update(&self.key).chain_update(data).finalize().into()
    }

    fn read(&mut self) -> Option<Vec<u8>> {
        let file = fs::File::open(&self.path).ok()?;
        let mut bytes = Vec::new();
        let limit = (HEADER_BYTES + MAX_BYTES + 1) as u64;
        file.take(limit).read_to_end(&mut bytes).ok()?;
        let data = self.data_of(&bytes);
        match data {
            Some(_) => self.found = data.map(|data| self.hash(data)),
            None => log::debug!("{}: damaged or foreign, ignored", self.path.display()),
        }
        data.map(<[u8]>::to_vec)
    }

    /// The driver's data in the bytes of a file, if everything about them is right.
    fn data_of<'a>(&self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let (header, data) = bytes.split_at_checked(HEADER_BYTES)?;
        (data.len() <= MAX_BYTES && header == self.header(data)).then_some(data)
    }

    fn header(&self, data: &[u8]) -> Vec<u8> {
        [&MAGIC[..], &(data.len() as u64).to_le_bytes(), &self.hash(data)].concat()
    }

    /// True if sound data were found.
    pub(super) fn is_found(&self) -> bool {
        self.found.is_some()
    }

    /// Replaces the file, unless it has these data already.
    pub(super) fn write(&self, data: &[u8]) {
        if self.found == Some(self.hash(data)) {
            return;
        }
        if let Err(error) = self.try_write(data) {
            log::debug!("{}: not written: {error}", self.path.display());
        }
    }

    fn try_write(&self, data: &[u8]) -> std::io::Result<()> {
        if data.len() > MAX_BYTES {
            return fs::remove_file(&self.path);
        }
        let mut part = self.new_part()?;
        part.write_all(&self.header(data))?;
        part.write_all(data)?;
        part.persist(&self.path)?;
        remove_oldest(self.folder(), self.prefix)
    }
}

/// Removes what is more than `MAX_FILES` files of a kind, the oldest first. Other processes may do the same: what is gone
/// meanwhile is gone, and what they are filling is not counted.
fn remove_oldest(folder: &Path, prefix: &str) -> std::io::Result<()> {
    let is_own = |entry: &fs::DirEntry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with(prefix) && !name.ends_with(PART)
    };
    let dated = |entry: fs::DirEntry| Some((entry.metadata().ok()?.modified().ok()?, entry.path()));
    let mut files: Vec<_> = fs::read_dir(folder)?.filter_map(Result::ok).filter(is_own).filter_map(dated).collect();
    files.sort();
    let excess = files.len().saturating_sub(MAX_FILES);
    for (_, path) in &files[..excess] {
        match fs::remove_file(path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(folder: &Path, key: &str) -> (CacheFile, Vec<u8>) {
        CacheFile::of_key(folder, PIPELINES, key.into())
    }

    fn only_file(folder: &Path) -> PathBuf {
        let files: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 1, "{files:?}");
        files[0].clone()
    }

    const DATA: &[u8] = b"what a driver compiled";

    #[test]
    fn what_was_written_is_found_by_its_key_alone() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("made/when/needed");
        let (file, data) = open(&folder, "a");
        assert!(data.is_empty() && !file.is_found());
        file.write(DATA);
        let (file, data) = open(&folder, "a");
        assert!(data == DATA && file.is_found());
        assert!(open(&folder, "b").1.is_empty());
        // Under another device's name it is foreign.
        let other = open(&folder, "b").0;
        fs::rename(only_file(&folder), &other.path).unwrap();
        let (other, data) = open(&folder, "b");
        assert!(data.is_empty() && !other.is_found());
    }

    #[test]
    fn a_file_of_the_same_data_is_left_alone() {
        let place = tempfile::tempdir().unwrap();
        open(place.path(), "a").0.write(DATA);
        let (file, _) = open(place.path(), "a");
        fs::remove_file(&file.path).unwrap();
        file.write(DATA);
        assert!(!file.path.exists(), "written again");
        file.write(b"more");
        assert_eq!(open(place.path(), "a").1, b"more");
    }

    #[test]
    fn damage_anywhere_is_noticed_and_mended() {
        let place = tempfile::tempdir().unwrap();
        open(place.path(), "a").0.write(DATA);
        let path = only_file(place.path());
        let sound = fs::read(&path).unwrap();
        let is_refused = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            let (file, data) = open(place.path(), "a");
            data.is_empty() && !file.is_found()
        };
        for length in 0..sound.len() {
            assert!(is_refused(&sound[..length]), "cut to {length} bytes");
        }
        for bit in 0..8 * sound.len() {
            let mut bytes = sound.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(is_refused(&bytes), "bit {bit}");
        }
        assert!(is_refused(&[&sound[..], &[0]].concat()), "a byte more");
        open(place.path(), "a").0.write(DATA);
        assert_eq!(fs::read(only_file(place.path())).unwrap(), sound);
    }

    #[test]
    fn writers_at_once_leave_whole_files() {
        let place = tempfile::tempdir().unwrap();
        open(place.path(), "a").0.write(DATA);
        std::thread::scope(|scope| {
            for writer in 0..4u8 {
                let folder = place.path();
                scope.spawn(move || {
                    for i in 0..50 {
                        let (file, _) = open(folder, "a");
                        assert!(file.is_found(), "writer {writer}, turn {i}: a broken file");
                        file.write(&vec![writer; 1000 + i]);
                    }
                });
            }
        });
        assert!(open(place.path(), "a").0.is_found());
        only_file(place.path());
    }

    #[test]
    fn folder_and_files_stay_bounded() {
        let place = tempfile::tempdir().unwrap();
        for i in 0..MAX_FILES + 3 {
            open(place.path(), &i.to_string()).0.write(DATA);
        }
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), MAX_FILES);
        let last = open(place.path(), &(MAX_FILES + 2).to_string());
        assert!(last.0.is_found());
        last.0.write(&vec![0; MAX_BYTES + 1]);
        assert!(!last.0.path.exists(), "too large, and kept");
    }

    #[test]
    fn a_folder_that_cannot_be_turns_it_off() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("file");
        fs::write(&file, "").unwrap();
        open(&file, "a").0.write(DATA);
        assert_eq!(only_file(place.path()), file);
    }

    const COSTS: &str = "costs-";

    fn kept(folder: &Path, make: &dyn Fn() -> Vec<u8>) -> Option<Vec<u8>> {
        open(folder, "a").0.kept(COSTS, || Ok::<_, ()>(make())).unwrap()
    }

    #[test]
    fn what_is_kept_is_made_once_and_made_anew_when_damaged() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("made/when/needed");
        assert_eq!(kept(&folder, &|| b"first".to_vec()).unwrap(), b"first");
        assert_eq!(kept(&folder, &|| panic!("made again")).unwrap(), b"first");
        let path = only_file(&folder);
        let sound = fs::read(&path).unwrap();
        for bit in 0..8 * sound.len() {
            let mut bytes = sound.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            fs::write(&path, bytes).unwrap();
            assert_eq!(kept(&folder, &|| b"mended".to_vec()).unwrap(), b"mended", "bit {bit}");
        }
        assert_eq!(kept(&folder, &|| panic!("made again")).unwrap(), b"mended");
        // A file of one kind is none of another, whatever its name.
        let (pipelines, _) = open(&folder, "a");
        fs::rename(&path, &pipelines.path).unwrap();
        assert!(open(&folder, "a").1.is_empty());
    }

    #[test]
    fn who_makes_the_same_at_once_gets_the_same() {
        let place = tempfile::tempdir().unwrap();
        for turn in 0..30 {
            let folder = place.path().join(turn.to_string());
            let all: Vec<_> = std::thread::scope(|scope| {
                let start = |writer: u8| {
                    let folder = &folder;
                    scope.spawn(move || kept(folder, &|| vec![writer; 9]).unwrap())
                };
                (0..4).map(start).collect::<Vec<_>>().into_iter().map(|thread| thread.join().unwrap()).collect()
            });
            assert!(all.iter().all(|data| *data == all[0]), "{all:?}");
            assert_eq!(kept(&folder, &|| panic!("made again")).unwrap(), all[0]);
            only_file(&folder);
        }
    }

    #[test]
    fn nothing_is_made_where_nothing_can_be_kept() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("file");
        fs::write(&file, "").unwrap();
        assert_eq!(kept(&file, &|| panic!("made for nothing")), None);
    }

    #[test]
    fn the_folder_follows_the_environment() {
        let dir = |own: Option<&str>, xdg: Option<&str>, home: Option<&str>| {
            let variable = |name: &str| if name == "TYNDALL_CACHE_DIR" { own } else { xdg }.map(PathBuf::from);
            cache_dir(variable, home.map(PathBuf::from)).map(|path| path.to_str().unwrap().to_owned())
        };
        assert_eq!(dir(Some("mine"), Some("/x"), Some("/h")).as_deref(), Some("mine"));
        assert_eq!(dir(Some(""), Some("/x"), Some("/h")), None);
        assert_eq!(dir(None, Some("/x"), Some("/h")).as_deref(), Some("/x/tyndall"));
        assert_eq!(dir(None, Some("relative"), Some("/h")).as_deref(), Some("/h/.cache/tyndall"));
        assert_eq!(dir(None, None, Some("/h")).as_deref(), Some("/h/.cache/tyndall"));
        assert_eq!(dir(None, None, None), None);
    }
}
