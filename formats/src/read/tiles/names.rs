//! Resolves the URIs of a tileset to files in the folder of the first tileset or below it, and nowhere else.
//!
//! Paths must match exactly. Other readers accept a file of the same name in another folder as one that was moved; here it would be a different
//! tile.

use super::super::companions::{Companions, Found, Reference};
use super::super::{ReadError, ReadOptions};
use kilwa_pack::visible::visible;
use percent_encoding::percent_decode_str;
use std::path::{Path, PathBuf};

/// A file of the tileset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Named {
    pub(super) path: PathBuf,
    /// Its folders, relative to that of the first tileset.
    pub(super) folders: Vec<String>,
}

/// Finds files.
pub(super) struct Names<'a> {
    pub(super) companions: &'a Companions<'a>,
    pub(super) options: &'a ReadOptions,
}

/// The file that contains the URI.
#[derive(Clone, Copy)]
pub(super) struct Referrer<'a> {
    pub(super) path: &'a Path,
    pub(super) folders: &'a [String],
}

impl Names<'_> {
    /// The file that `uri` names in `from`, at `place`.
    ///
    /// # Errors
    /// [`ReadError::Part`] where it is a URL, absolute or missing; [`ReadError::Outside`] where it leaves the folder.
    pub(super) fn locate(&self, uri: &str, place: &str, from: Referrer<'_>) -> Result<Named, ReadError> {
        let missing = || ReadError::Part {
            file: from.path.to_owned(),
            part: place.to_owned(),
            found: format!("the file \"{}\", which does not exist", shown(&decoded(uri))),
            expected: "all files of the tileset; copy the missing ones too".to_owned(),
        };
        self.find(uri, place, from)?.ok_or_else(missing)
    }

    /// The same; `None` where it is not there.
    ///
    /// # Errors
    /// As [`Names::locate`].
    pub(super) fn find(&self, uri: &str, place: &str, from: Referrer<'_>) -> Result<Option<Named>, ReadError> {
        let part = |found: String, expected: &str| ReadError::Part {
            file: from.path.to_owned(),
            part: place.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        if is_address(uri) {
            let expected = "the path of a local file; download the whole tileset first";
            return Err(part(format!("the URL \"{}\"", shown(uri)), expected));
        }
        // Some exporters do not escape URIs, so the literal name is tried first.
        // What is behind a question mark may look like any path, so that a refusal counts only if neither name leads to a file.
        let reference = Reference { file: from.path, place, name: uri };
        let mut refused = None;
        for name in [uri, &decoded(uri)] {
            if is_absolute(name) {
                let expected = "a path relative to the tileset; correct the tileset or export it again";
                refused = Some(part(format!("the absolute path \"{}\"", shown(uri)), expected));
                continue;
            }
            let Some((folders, last)) = self.resolved(name, from) else {
                let target = from.path.parent().unwrap_or(Path::new("")).join(name);
                refused = Some(self.companions.refusal(&reference, target));
                continue;
            };
            let mut path = self.companions.folder().to_owned();
            path.extend(folders.iter().chain([&last]));
            match self.companions.exactly(path) {
                Found::File(path) => return Ok(Some(Named { path, folders })),
                Found::Outside(target) => refused = Some(self.companions.refusal(&reference, target)),
                Found::Nothing => {}
            }
        }
        refused.map_or(Ok(None), Err)
    }

    /// Folders and file name, relative to the folder of the first tileset; `None` if the path leaves it.
    fn resolved(&self, name: &str, from: Referrer<'_>) -> Option<(Vec<String>, String)> {
        let mut all = from.folders.to_vec();
        for part in name.split(['/', '\\']).filter(|part| !part.is_empty() && *part != ".") {
            match part {
                ".." if all.last().is_some_and(|last| last != "..") => {
                    all.pop();
                }
                ".." if !self.options.allow_outside => return None,
                _ => all.push(part.to_owned()),
            }
        }
        let last = all.pop().unwrap_or_default();
        Some((all, last))
    }
}

/// The path of a URI without escapes.
fn decoded(uri: &str) -> String {
    let path_of_uri = uri.split(['?', '#']).next().unwrap_or(uri);
    percent_decode_str(path_of_uri).decode_utf8_lossy().into_owned()
}

/// Whether a URI is not a local path: it has a scheme (other than a Windows drive letter) or a host name.
fn is_address(uri: &str) -> bool {
    let is_scheme =
        |scheme: &str| scheme.len() > 1 && scheme.bytes().all(|b| b.is_ascii_alphanumeric() || b"+-.".contains(&b));
    uri.starts_with("//") || uri.starts_with("\\\\") || uri.split_once(':').is_some_and(|(scheme, _)| is_scheme(scheme))
}

fn is_absolute(name: &str) -> bool {
    let is_drive = |name: &str| name.as_bytes().get(1) == Some(&b':');
    name.starts_with(['/', '\\']) || is_drive(name) || name.contains('\0')
}

/// A name for a message.
pub(super) fn shown(uri: &str) -> String {
    visible(&uri.chars().take(80).collect::<String>()).into_owned()
}
