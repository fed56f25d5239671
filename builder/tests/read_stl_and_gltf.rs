//! Every STL and glTF of `../shared/data`, where that folder is present: read with the number of triangles that the
//! reference parser finds, or refused with a message that a person understands.

use kilwa_builder::RawMesh;
use kilwa_builder::read::{ReadError, read_mesh};
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

#[test]
fn every_gltf_is_read_or_refused_with_a_message_for_people() {
    let Some(folder) = data() else { return };
    let mut all = Vec::new();
    files(&folder, "gltf", &mut all);
    files(&folder, "glb", &mut all);
    let (mut read, mut refused) = (0, 0);
    for path in &all {
        let name = path.strip_prefix(&folder).unwrap().display().to_string();
        match read_mesh(path, &mut |_, _| {}) {
            Ok(mesh) => {
                read += 1;
                report(Path::new(&name), &mesh);
                check_invariants(&mesh, &name);
            }
            Err(e) => {
                refused += 1;
                println!("refused {e}");
                let text = e.to_string();
                assert!(text.contains(path.file_name().unwrap().to_str().unwrap()), "names the file: {text}");
                match e {
                    ReadError::Part { part, expected, .. } => {
                        assert!(!part.is_empty() && !expected.is_empty(), "names the part: {text}");
                    }
                    ReadError::Malformed { .. } => assert!(text.contains(", byte "), "names the place: {text}"),
                    ReadError::Needs { .. } | ReadError::Format { .. } => {
                        assert!(text.contains("xport") || text.contains("Give"), "says what to do: {text}");
                    }
                    ReadError::NoTriangles { .. } => {}
                    other => panic!("{name}: {other}"),
                }
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read >= 85 && read + refused >= 300, "{read} {refused}");
}

/// A mesh and its Draco form, made by the same program, have the same triangles within the quantisation.
#[test]
fn a_draco_file_has_the_surface_of_its_plain_form() {
    let Some(folder) = data() else { return };
    let read = |name: &str| read_mesh(&folder.join("IIIF+3d/assets/whale").join(name), &mut |_, _| {}).unwrap();
    let (plain, packed) = (read("whale_cranium.glb"), read("whale_cranium_draco.glb"));
    assert_eq!((plain.triangles.len(), plain.positions.len()), (packed.triangles.len(), packed.positions.len()));
    let area = |mesh: &RawMesh| -> f64 {
        let corner = |v: u32| mesh.positions[v as usize];
        let areas = mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(corner);
            let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            n.iter().map(|x| x * x).sum::<f64>().sqrt() / 2.0
        });
        areas.sum()
    };
    let (a, b) = (area(&plain), area(&packed));
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
}
