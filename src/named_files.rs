//! The files that the arguments of a verb name: files, folders (every file in them that is recognised by its content, not those in subfolders)
//! and patterns that the shell has left alone (`'blocks/*.ply'`). Each file comes once, sorted by path.
//!
//! Refused: a file that does not exist, a file named twice, a pattern that nothing matches, a folder without such files, a folder with something
//! that is named like one but is not one, something that matches a pattern but is not a readable regular file (a broken link, a folder, a
//! pipe), a link in a folder to a file outside of it.

use anyhow::{Context, bail};
use kilwa_files::plain_file;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// What files of a verb are.
pub(crate) struct Wanted {
    /// In a sentence, for example "mesh".
    pub(crate) what: &'static str,
    /// The formats in a sentence.
    pub(crate) formats: &'static str,
    /// Whether a file in a folder must be one, because of its name.
    pub(crate) is_named: fn(&Path) -> bool,
    /// Fails unless the file is one.
    pub(crate) recognise: fn(&Path) -> anyhow::Result<()>,
}

/// The files that arguments name, each once, sorted; and those in given folders that are something else.
pub(crate) fn named(
    inputs: &[PathBuf],
    allow_outside: bool,
    wanted: &Wanted,
) -> anyhow::Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let mut found = Named { allow_outside, wanted, files: Vec::new(), passed_over: Vec::new() };
    for given in inputs {
        found.expand(given)?;
    }
    let Named { mut files, passed_over, .. } = found;
    files.sort();
    refuse_twice(&files)?;
    Ok((files, passed_over))
}

/// The files that arguments name.
struct Named<'a> {
    allow_outside: bool,
    wanted: &'a Wanted,
    files: Vec<PathBuf>,
    /// Files in folders that are not meshes, and links that lead out of the folders.
    passed_over: Vec<PathBuf>,
}

impl Named<'_> {
    /// The files that one argument names.
    fn expand(&mut self, given: &Path) -> anyhow::Result<()> {
        if given.is_dir() {
            return self.folder(given);
        }
        // A file may have brackets in its name: what is there is meant as it stands.
        let text = given.to_str().filter(|text| text.contains(['*', '?', '[']) && !given.exists());
        let Some(pattern) = text else {
            self.files.push(given.to_owned());
            return Ok(());
        };
        let found = glob::glob(pattern).with_context(|| format!("{pattern} is not a valid pattern"))?;
        let real = fixed_part(given);
        let real = real
            .canonicalize()
            .with_context(|| format!("no file matches {pattern}: {} cannot be opened", real.display()))?;
        let before = self.files.len();
        for path in found {
            let path = path.with_context(|| format!("cannot look for {pattern}"))?;
            refuse_unreadable(
                &path,
                &format!(
                    "everything that matches a pattern must be a {} file; change the pattern, or restore the file",
                    self.wanted.what
                ),
            )?;
            if !self.allow_outside {
                refuse_link_out(&path, &real)?;
            }
            self.files.push(path);
        }
        if self.files.len() == before {
            bail!("no file matches {pattern}");
        }
        Ok(())
    }

    /// Every file in a folder that is wanted.
    fn folder(&mut self, folder: &Path) -> anyhow::Result<()> {
        let cannot = || format!("cannot list {}", folder.display());
        let real = folder.canonicalize().with_context(cannot)?;
        let before = self.files.len();
        for entry in std::fs::read_dir(folder).with_context(cannot)? {
            let path = entry.with_context(cannot)?.path();
            let hidden = path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
            if hidden {
                continue;
            }
            if !path.is_file() {
                if (self.wanted.is_named)(&path) {
                    refuse_unreadable(
                        &path,
                        &format!(
                            "everything with the name of a {} file must be one; restore, rename or remove it",
                            self.wanted.what
                        ),
                    )?;
                }
                // A pipe, a socket, a device, a broken link.
                if !path.is_dir() {
                    self.passed_over.push(path);
                }
                continue;
            }
            if !self.allow_outside
                && let Err(e) = refuse_link_out(&path, &real)
            {
                if (self.wanted.is_named)(&path) {
                    return Err(e);
                }
                self.passed_over.push(path);
                continue;
            }
            match (self.wanted.recognise)(&path) {
                Ok(()) => self.files.push(path),
                // A block that is damaged must not go missing without a word.
                Err(e) if (self.wanted.is_named)(&path) => return Err(e),
                Err(_) => self.passed_over.push(path),
            }
        }
        if self.files.len() == before {
            bail!(
                "{} contains no readable {} ({}); its subfolders are not searched",
                folder.display(),
                self.wanted.what,
                self.wanted.formats
            );
        }
        Ok(())
    }
}

/// Refuse anything that should be a mesh because of its name but is not a readable regular file, so that no block is lost unnoticed.
fn refuse_unreadable(path: &Path, advice: &str) -> anyhow::Result<()> {
    let Err(e) = plain_file::open(path) else { return Ok(()) };
    let cause = match std::fs::read_link(path) {
        Ok(target) if e.kind() == std::io::ErrorKind::NotFound => {
            format!("it is a link to {}, which does not exist", target.display())
        }
        _ => e.to_string(),
    };
    bail!("{} cannot be read: {cause}; {advice}", path.display());
}

/// The folder that a pattern looks in: its parts before the first with a wildcard, which the user has named as they are.
fn fixed_part(pattern: &Path) -> PathBuf {
    let is_fixed = |part: &Component<'_>| !part.as_os_str().as_encoded_bytes().iter().any(|b| b"*?[".contains(b));
    let fixed: PathBuf = pattern.components().take_while(is_fixed).collect();
    if fixed.as_os_str().is_empty() { PathBuf::from(".") } else { fixed }
}

/// Refuse what a link in a folder leads to outside of it: whoever made the folder could name any file with it.
pub(crate) fn refuse_link_out(path: &Path, folder: &Path) -> anyhow::Result<()> {
    let target = path.canonicalize().with_context(|| format!("{} cannot be opened", path.display()))?;
    if !target.starts_with(folder) {
        bail!(
            "{} is a link to {}, outside the folder {}; remove it, name that file directly, or use --allow-outside",
            path.display(),
            target.display(),
            folder.display()
        );
    }
    Ok(())
}

/// Refuse a file that is named twice, by whatever path.
pub(crate) fn refuse_twice(files: &[PathBuf]) -> anyhow::Result<()> {
    let mut seen = BTreeMap::new();
    for path in files {
        let real = path.canonicalize().with_context(|| format!("{} cannot be opened", path.display()))?;
        if let Some(other) = seen.insert(real, path) {
            if other == path {
                bail!("{} is given twice", path.display());
            }
            bail!("{} and {} are the same file", other.display(), path.display());
        }
    }
    Ok(())
}
