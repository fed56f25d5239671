//! BagIt (RFC 8493): an object wrapped for deposit, `<slug>.bag/` with the object as its payload in `data/`.
//!
//! Files are linked where the file system can (nothing that is published ever changes in place), copied else. Written under a hidden name and
//! renamed; a bag that is there is replaced. Cut off between the two renames there is no bag until the same command is run again: it is made of the
//! object, which is untouched.

use super::checksums::{Checksums, sha256, sha256_of};
use super::disk;
use super::draft::{DraftError, Steps};
use super::layout::Slug;
use super::lock::Lock;
use super::scratch::{self, Scratch};
use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

/// The fields of bag-info.txt.
#[derive(Debug, Clone)]
pub struct BagInfo {
    /// Who gives it away.
    pub organization: Option<String>,
    /// Identifier of the object.
    pub identifier: String,
    /// What it is, one line.
    pub description: String,
    /// Day, from the publication.
    pub date: String,
    /// Program and version.
    pub tool: String,
}

/// Wrap the object `slug` of the locked folder; the folder of the bag.
///
/// # Errors
/// [`DraftError::Disk`]; an existing bag is kept in that case.
pub fn wrap(lock: &Lock, slug: &Slug, info: &BagInfo, steps: Steps<'_>) -> Result<PathBuf, DraftError> {
    let shelf = lock.folder();
    let object = shelf.join(slug.as_str());
    let bag = shelf.join(format!("{slug}.bag"));
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |reason| DraftError::Disk { what: "write", path, reason }
    };
    steps("bag").map_err(failed(&bag))?;
    scratch::sweep(shelf, &|name| scratch::is_of(slug, name), steps)?;
    let hidden = Scratch::create(shelf, &scratch::prefix(slug), steps)?;
    let whole = hidden.path().join("bag");
    disk::create_dir(&whole, steps)?;
    let mut payload = Checksums::default();
    let (mut bytes, mut files) = (0, 0);
    let mut all = Vec::new();
    list(&object, "", &mut all).map_err(failed(&object))?;
    for path in all {
        let (from, to) = (object.join(&path), whole.join("data").join(&path));
        steps(&path).map_err(failed(&to))?;
        let (length, sum) = take(&from, &to).map_err(failed(&to))?;
        payload.add(format!("data/{path}"), sum);
        bytes += length;
        files += 1;
    }
    let mut tags = Checksums::default();
    let texts = [
        ("bagit.txt", "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n".to_owned()),
        ("bag-info.txt", bag_info(info, bytes, files)),
        ("manifest-sha256.txt", payload.to_text()),
    ];
    for (name, text) in texts {
        tags.add(name, sha256(text.as_bytes()));
        disk::write(&whole.join(name), text.as_bytes(), steps)?;
    }
    disk::write(&whole.join("tagmanifest-sha256.txt"), tags.to_text().as_bytes(), steps)?;
    disk::open_to_all(&whole, steps)?;
    disk::sync_folders(&whole)?;
    if bag.exists() {
        disk::rename(&bag, &hidden.path().join("old"), steps)?;
    }
    disk::rename(&whole, &bag, steps)?;
    hidden.close(steps)?;
    Ok(bag)
}

fn bag_info(info: &BagInfo, bytes: u64, files: u64) -> String {
    let line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let organization = info.organization.as_ref().map(|o| format!("Source-Organization: {}\n", line(o)));
    format!(
        "Bag-Software-Agent: {}\nBagging-Date: {}\n{}External-Description: {}\nExternal-Identifier: {}\nPayload-Oxum: {bytes}.{files}\n",
        line(&info.tool),
        info.date,
        organization.unwrap_or_default(),
        line(&info.description),
        line(&info.identifier)
    )
}

/// Every file of an object, relative, sorted; hidden ones are none of it.
fn list(folder: &Path, prefix: &str, into: &mut Vec<String>) -> io::Result<()> {
    let mut entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        let path = if prefix.is_empty() { name } else { format!("{prefix}/{name}") };
        if entry.file_type()?.is_dir() { list(&entry.path(), &path, into)? } else { into.push(path) }
    }
    Ok(())
}

fn take(from: &Path, to: &Path) -> io::Result<(u64, String)> {
    if let Some(parent) = to.parent() {
        fs::create_dir_all(parent)?;
    }
    if fs::hard_link(from, to).is_err() {
        fs::copy(from, to)?;
        File::open(to)?.sync_all()?;
    }
    sha256_of(BufReader::new(File::open(to)?))
}
