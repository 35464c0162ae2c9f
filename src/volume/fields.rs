//! Named fields of a text header, and their conversion with errors that name the file and the field.

use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The fields of one text header. Names are lower case without spaces, so that spellings do not matter.
pub(super) struct Fields {
    path: PathBuf,
    values: BTreeMap<String, (String, String)>,
}

impl Fields {
    /// No fields yet.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), values: BTreeMap::new() }
    }

    /// Adds a field. A field that occurs twice is refused: which of the two is meant is anybody's guess.
    pub fn insert(&mut self, name: &str, value: &str) -> Result<()> {
        let old = self.values.insert(Self::key(name), (name.trim().to_owned(), value.trim().to_owned()));
        if old.is_some() {
            return Err(Error::input(self.what(name.trim()), "the field occurs twice", "remove one of the two lines"));
        }
        Ok(())
    }

    fn key(name: &str) -> String {
        name.chars().filter(|c| !c.is_whitespace()).flat_map(char::to_lowercase).collect()
    }

    /// File and field, as errors name them.
    pub fn what(&self, name: &str) -> String {
        format!("{}: field '{name}'", self.path.display())
    }

    /// A field's text if it is there.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.values.get(&Self::key(name)).map(|(_, value)| value.as_str())
    }

    /// The first of several synonyms that is there: its name and text.
    pub fn any<'a>(&'a self, names: &[&'a str]) -> Option<(&'a str, &'a str)> {
        names.iter().find_map(|&name| self.get(name).map(|value| (name, value)))
    }

    /// A field's text; missing is an error.
    pub fn need(&self, name: &str) -> Result<&str> {
        self.get(name).ok_or_else(|| {
            Error::input(self.what(name), "the header lacks this field", "add it, or convert the file again")
        })
    }

    /// One value.
    pub fn parse<T: FromStr>(&self, name: &str, text: &str) -> Result<T> {
        text.trim().parse().map_err(|_| {
            Error::input(self.what(name), format!("'{}' is not a number it can hold", clip(text)), "correct the header")
        })
    }

    /// N values separated by spaces.
    pub fn numbers<T: FromStr, const N: usize>(&self, name: &str, text: &str) -> Result<[T; N]> {
        let values = text.split_whitespace().map(|word| self.parse(name, word)).collect::<Result<Vec<T>>>()?;
        let found = values.len();
        values.try_into().map_err(|_| {
            Error::input(self.what(name), format!("it has {found} values instead of {N}"), "correct the header")
        })
    }

    /// An error about a field.
    pub fn error(&self, name: &str, problem: impl Into<String>, cure: impl Into<String>) -> Error {
        Error::input(self.what(name), problem, cure)
    }

    /// The path of a detached data file, relative to the header's folder.
    pub fn sibling(&self, data_file: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(data_file)
    }
}

/// A header's text cut to a length fit for a message.
pub(super) fn clip(text: &str) -> String {
    const LONGEST: usize = 60;
    if text.chars().count() <= LONGEST { text.to_owned() } else { text.chars().take(LONGEST).chain(['…']).collect() }
}

/// Splits off the line that starts at `*at`, without its line end, and moves `*at` behind it. `None` at the end.
pub(super) fn next_line<'a>(text: &'a [u8], at: &mut usize) -> Option<&'a [u8]> {
    let rest = &text[*at..];
    if rest.is_empty() {
        return None;
    }
    let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
    *at = text.len().min(*at + length + 1);
    let line = &rest[..length];
    Some(line.strip_suffix(b"\r").unwrap_or(line))
}
