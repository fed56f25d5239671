//! The folder `../shared/data`: real files, and a README with what a reference parser found in them.

use kilwa_formats::RawMesh;
use kilwa_formats::read::ReadError;
use std::path::{Path, PathBuf};

/// The folder, if it is present.
pub(crate) fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if folder.join("README.md").is_file() {
        return Some(folder);
    }
    eprintln!("skipped: {} is not there", folder.display());
    None
}

/// All files of a folder and the folders in it, in order.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    entries.into_iter().flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Those of [`files`] that have one of the given extensions, which are in lower case.
pub(crate) fn files_of(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = files(folder);
    found.retain(|path| extensions.contains(&extension(path).as_str()));
    found
}

/// The extension of a file's name, in lower case; empty if there is none.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The message of a refusal, which names the file; it is printed, too.
pub(crate) fn refusal_of(path: &Path, error: &ReadError) -> String {
    println!("refused {error}");
    let text = error.to_string();
    assert!(text.contains(path.file_name().unwrap().to_str().unwrap()), "names the file: {text}");
    text
}

/// Properties of every mesh that is read.
pub(crate) fn check_invariants(mesh: &RawMesh, name: &str) {
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().all(|p| p.is_finite()), "{name}: positions are finite");
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n), "{name}: indices are in range");
    assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]), "{name}");
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n, "{name}: a colour per vertex");
    assert!(mesh.normals.is_empty() || mesh.normals.len() == n, "{name}: a normal per vertex");
    assert!(mesh.scalars.iter().all(|(_, v)| v.len() == n), "{name}: a value per vertex");
    assert!(!mesh.triangles.is_empty(), "{name}");
}
