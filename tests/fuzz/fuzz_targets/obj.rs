//! Any bytes as an OBJ, and what follows a zero byte as the library `a.mtl` beside it: the reader ends, does not panic,
//! and returns a sound mesh no larger than the file justifies.
#![no_main]

use kilwa_builder::read::{Input, MemorySink, ReadOptions, obj};
use libfuzzer_sys::fuzz_target;
use std::path::PathBuf;
use std::sync::LazyLock;

/// The folder of this process.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("kilwa-fuzz-obj-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
});

fuzz_target!(|bytes: &[u8]| {
    let (mesh, library) = match bytes.iter().position(|&b| b == 0) {
        Some(n) => (&bytes[..n], &bytes[n + 1..]),
        None => (bytes, &[][..]),
    };
    if !library.is_empty() {
        std::fs::write(FOLDER.join("a.mtl"), library).unwrap();
    }
    let path = &FOLDER.join("fuzz.obj");
    let mut sink = MemorySink::new(path);
    let (options, total) = (ReadOptions::default(), mesh.len() as u64);
    let mut source = std::io::Cursor::new(mesh);
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options };
    // Also what the dispatch would not take for an OBJ.
    if obj::read(input, &mut sink).is_err() {
        return;
    }
    let Ok(mesh) = sink.into_mesh() else { return };
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().flatten().all(|v| v.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
    assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n);
    assert!(mesh.normals.is_empty() || mesh.normals.len() == n);
    // A vertex takes 8 bytes ("v 0 0 0\n"), a corner of a face 2; with a colour for each face it becomes one vertex.
    assert!(n + mesh.triangles.len() <= bytes.len());
});
