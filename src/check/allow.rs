//! Messages that are let through, each with the versions of the layer that send it and the reason why it is no fault.

use crate::input::{parse_toml, read_text};
use crate::vk::Message;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One entry of an allow-list.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Allowed {
    /// The message's id, whole.
    pub id: String,
    /// A part of its text; any text without it.
    pub text: Option<String>,
    /// Versions of the validation layer: `1.3.239` or, for all that begin so, `1.3`.
    pub layer: String,
    /// Why it is let through.
    pub reason: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    allow: Vec<Allowed>,
}

/// Reads a list: TOML with `[[allow]]` tables.
///
/// # Errors
/// The file cannot be read, or an entry lacks something.
pub fn load(path: &Path) -> Result<Vec<Allowed>> {
    parse(&read_text(path, "an allow-list in TOML")?, path)
}

/// The same for text; `path` is for errors.
pub fn parse(text: &str, path: &Path) -> Result<Vec<Allowed>> {
    let cure =
        "write [[allow]] with id, layer (\"1.3.239\"), reason, and text if only some messages of the id are meant";
    let file: File = parse_toml(text, path, cure)?;
    let is_empty = |a: &&Allowed| a.id.trim().is_empty() || a.layer.trim().is_empty() || a.reason.trim().is_empty();
    match file.allow.iter().find(is_empty) {
        Some(entry) => Err(Error::file(path, format!("the entry for '{}' leaves something empty", entry.id), cure)),
        None => Ok(file.allow),
    }
}

impl Allowed {
    /// Is it for a layer of this version?
    pub fn is_for(&self, layer: &str) -> bool {
        let parts = |version: &str| version.split('.').map(str::to_owned).collect::<Vec<_>>();
        parts(layer).starts_with(&parts(&self.layer))
    }

    /// Does it let `message` of a layer of this version through?
    pub fn covers(&self, message: &Message, layer: &str) -> bool {
        self.is_for(layer) && self.id == message.id && self.text.as_ref().is_none_or(|text| message.text.contains(text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vk::Severity;

    #[test]
    fn an_entry_covers_its_id_text_and_versions() {
        let list = "[[allow]]\nid = 'A'\nlayer = '1.3'\nreason = 'r'\n\
            [[allow]]\nid = 'B'\ntext = 'some'\nlayer = '1.3.239'\nreason = 'r'\n";
        let list = parse(list, Path::new("list.toml")).unwrap();
        let message = |id: &str, text: &str| Message { severity: Severity::Error, id: id.into(), text: text.into() };
        let covers = |id, text, layer| list.iter().any(|a| a.covers(&message(id, text), layer));
        assert!(covers("A", "any", "1.3.239") && covers("A", "any", "1.3.5"));
        assert!(covers("B", "for some reason", "1.3.239"));
        for (id, text, layer) in [
            ("A", "", "1.4.3"),
            ("A", "", "1.30.3"),
            ("AA", "", "1.3.239"),
            ("B", "other", "1.3.239"),
            ("B", "some", "1.3.240"),
        ] {
            assert!(!covers(id, text, layer), "{id} {text} {layer}");
        }
    }

    #[test]
    fn incomplete_entries_are_refused() {
        for bad in [
            "[[allow]]\nid = 'A'\nlayer = '1.3'\n",
            "[[allow]]\nid = 'A'\nlayer = '1.3'\nreason = ' '\n",
            "[[allow]]\nid = ''\nlayer = '1.3'\nreason = 'r'\n",
            "[[allow]]\nid = 'A'\nlayer = '1.3'\nreason = 'r'\nwhy = 'r'\n",
            "allow = 3\n",
        ] {
            let error = parse(bad, Path::new("list.toml")).unwrap_err().to_string();
            assert!(error.contains("list.toml") && error.contains("cure"), "{error}");
        }
        assert_eq!(parse("", Path::new("list.toml")).unwrap(), vec![]);
    }
}
