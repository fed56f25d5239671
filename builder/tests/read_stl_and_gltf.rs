//! Every STL of `../shared/data`, where that folder is present: read with the number of triangles that the reference
//! parser finds, or refused with a message that a person understands.

use kilwa_builder::RawMesh;
use kilwa_builder::read::read_mesh;
use std::path::{Path, PathBuf};

fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if folder.join("README.md").is_file() {
        return Some(folder);
    }
    eprintln!("skipped: {} is not there", folder.display());
    None
}

fn files(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, extension, found);
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
            found.push(path);
        }
    }
}

/// Triangles that the reference parser found in a file, as the folder's README says.
fn reference(folder: &Path, path: &Path) -> Option<usize> {
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let name = path.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
    let row = readme.lines().find(|l| l.starts_with(&format!("| {name} |")))?;
    row.split('|').nth(6)?.trim().parse().ok()
}

/// What a mesh promises, whatever the file.
fn check_invariants(mesh: &RawMesh, name: &str) {
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().flatten().all(|v| v.is_finite()), "{name}: positions are finite");
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n), "{name}: indices are in range");
    assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]), "{name}");
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n, "{name}: a colour per vertex");
    assert!(mesh.normals.is_empty() || mesh.normals.len() == n, "{name}: a normal per vertex");
    assert!(!mesh.triangles.is_empty(), "{name}");
}

fn report(path: &Path, mesh: &RawMesh) {
    println!("read    {}: {} triangles", path.display(), mesh.triangles.len());
    for (kind, n, places) in mesh.findings.iter() {
        println!("          {n} {kind}: {}", places.join("; "));
    }
}

#[test]
fn every_stl_has_the_triangles_that_the_reference_finds() {
    let Some(folder) = data() else { return };
    let mut all = Vec::new();
    files(&folder, "stl", &mut all);
    for path in &all {
        let name = path.display().to_string();
        let mesh = read_mesh(path, &mut |_, _| {}).unwrap_or_else(|e| panic!("{e}"));
        report(path, &mesh);
        check_invariants(&mesh, &name);
        if let Some(triangles) = reference(&folder, path) {
            assert_eq!(mesh.triangles.len(), triangles, "{name}");
        }
    }
    assert!(all.len() >= 20, "{}", all.len());
}
