//! The files of a folder: pictures by their names, and files that may hold poses.

use super::Missing;
use crate::ScanError;
use kilwa_formats::read::ReadError;
use std::collections::{HashMap, HashSet};
use std::path::{Component, Path, PathBuf};

/// File extensions of pictures that are read.
const PICTURES: [&str; 3] = ["jpg", "jpeg", "png"];
/// File extensions of files that may contain poses.
const OTHERS: [&str; 8] = ["txt", "bin", "out", "xml", "mlp", "xmp", "e57", "list"];
/// Maximum depth of nested folders.
const DEPTH_MAX: usize = 8;
/// Maximum number of entries.
const ENTRIES_MAX: usize = 1_000_000;

/// What a folder holds, without following links.
pub(super) struct Folder {
    root: PathBuf,
    /// Its pictures, sorted.
    pub(super) pictures: Vec<PathBuf>,
    /// Pictures that are masks.
    masks: HashMap<PathBuf, PathBuf>,
    /// Other files that may be of use, sorted.
    pub(super) others: Vec<PathBuf>,
    /// The pictures by their names in lower case, with and without their endings.
    by_name: HashMap<String, Vec<usize>>,
}

impl Folder {
    /// Walk the folder.
    pub(super) fn walk(root: &Path) -> Result<Self, ScanError> {
        let mut folder = Self {
            root: root.to_owned(),
            pictures: Vec::new(),
            masks: HashMap::new(),
            others: Vec::new(),
            by_name: HashMap::new(),
        };
        let mut pictures = Vec::new();
        let mut open = vec![(root.to_owned(), 0)];
        let mut entries = 0;
        while let Some((at, depth)) = open.pop() {
            let cannot = |source| ReadError::Open { file: at.clone(), source };
            for entry in std::fs::read_dir(&at).map_err(cannot)? {
                let entry = entry.map_err(cannot)?;
                let kind = entry.file_type().map_err(cannot)?;
                entries += 1;
                if entries > ENTRIES_MAX {
                    let what = format!("{} has more than {ENTRIES_MAX} files; choose a smaller folder", root.display());
                    return Err(ScanError::Request(what));
                }
                let path = entry.path();
                if kind.is_dir() && depth < DEPTH_MAX {
                    open.push((path, depth + 1));
                } else if kind.is_file() && has_extension(&path, &PICTURES) {
                    pictures.push(path);
                } else if kind.is_file() && has_extension(&path, &OTHERS) {
                    folder.others.push(path);
                }
            }
        }
        folder.others.sort();
        pictures.sort();
        folder.sort_out(pictures);
        Ok(folder)
    }

    /// Tell masks from photographs, and index both.
    fn sort_out(&mut self, pictures: Vec<PathBuf>) {
        let mut masks = HashMap::new();
        // A picture named like a mask may be a photograph of one (a death mask, say): it is a mask only if the picture
        // it would mask exists.
        let there: HashSet<PathBuf> =
            pictures.iter().flat_map(|path| [path.clone(), path.with_extension("")]).collect();
        for path in pictures {
            match masked(&path).filter(|name| there.contains(name) && !masks.contains_key(name)) {
                Some(name) => drop(masks.insert(name, path)),
                None => self.pictures.push(path),
            }
        }
        for (at, path) in self.pictures.iter().enumerate() {
            for name in names(path) {
                self.by_name.entry(name).or_default().push(at);
            }
        }
        self.masks = masks;
    }

    /// The path of a file in the folder, for people.
    pub(super) fn relative(&self, path: &Path) -> String {
        path.strip_prefix(&self.root).unwrap_or(path).display().to_string()
    }

    /// Where a picture is in the list.
    pub(super) fn position(&self, path: &Path) -> Option<usize> {
        self.pictures.binary_search_by(|picture| picture.as_path().cmp(path)).ok()
    }

    /// The picture that another program's file refers to by this name: the one at this path in the folder; otherwise,
    /// of those with this file name, the one whose parent folders agree most. Backslashes separate folders, too.
    pub(super) fn find(&self, name: &str) -> Result<usize, Missing> {
        let name = name.replace('\\', "/").to_lowercase();
        let parts: Vec<&str> = name.split('/').filter(|part| !part.is_empty()).collect();
        let found = parts.last().and_then(|last| self.by_name.get(*last)).ok_or(Missing::File)?;
        let is_exact = |at: &&usize| self.relative(&self.pictures[**at]).replace('\\', "/").to_lowercase() == name;
        let mut exact = found.iter().filter(is_exact);
        if let (Some(at), None) = (exact.next(), exact.next()) {
            return Ok(*at);
        }
        let agreement = |at: usize| {
            let folders = self.pictures[at].parent().into_iter().flat_map(Path::components).rev();
            let folders = folders.filter_map(|part| match part {
                Component::Normal(part) => Some(part.to_string_lossy().to_lowercase()),
                _ => None,
            });
            folders.zip(parts.iter().rev().skip(1)).take_while(|(a, b)| a == *b).count()
        };
        let best = found.iter().map(|at| agreement(*at)).max().unwrap_or(0);
        let mut rest = found.iter().filter(|at| agreement(**at) == best);
        match (rest.next(), rest.count()) {
            (Some(at), 0) => Ok(*at),
            (_, more) => Err(Missing::Ambiguous(more + 1)),
        }
    }

    /// The mask of a picture.
    pub(super) fn mask(&self, picture: &Path) -> Option<PathBuf> {
        let folder = picture.parent()?;
        let full = folder.join(picture.file_name()?);
        let bare = folder.join(picture.file_stem()?);
        [full, bare].iter().find_map(|key| self.masks.get(key)).cloned()
    }
}

/// The name that a picture is found by, with and without its ending, in lower case.
fn names(path: &Path) -> impl Iterator<Item = String> {
    [path.file_name(), path.file_stem()].into_iter().flatten().map(|name| name.to_string_lossy().to_lowercase())
}

/// The picture (with or without its ending) that this one masks: `NAME.mask.png` and `NAME_mask.png` lie beside it, `masks/NAME.png` in a folder
/// beside it, or in `masks` beside its folder `images`.
fn masked(path: &Path) -> Option<PathBuf> {
    if !has_extension(path, &["png"]) {
        return None;
    }
    let (folder, stem) = (path.parent()?, path.file_stem()?.to_str()?);
    if let Some(name) = stem.strip_suffix(".mask").or_else(|| stem.strip_suffix("_mask")) {
        return Some(folder.join(name));
    }
    let beside = folder.parent()?;
    let is_folder = folder.file_name()?.eq_ignore_ascii_case("masks");
    is_folder.then(|| {
        let images = beside.join("images");
        if images.is_dir() { images.join(stem) } else { beside.join(stem) }
    })
}

/// The mask of a picture whose folder was not walked.
pub(super) fn mask_beside(picture: &Path) -> Option<PathBuf> {
    let (folder, name, stem) = (picture.parent()?, picture.file_name()?.to_str()?, picture.file_stem()?.to_str()?);
    let beside = [name, stem].into_iter().flat_map(|name| [format!("{name}.mask.png"), format!("{name}_mask.png")]);
    let in_folder = [name, stem].map(|name| format!("masks/{name}.png"));
    beside.chain(in_folder).map(|name| folder.join(name)).find(|path| path.is_file())
}

pub(super) fn has_extension(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|ending| endings.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}
