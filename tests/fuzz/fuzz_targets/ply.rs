//! Any bytes as a PLY: the reader ends, does not panic, and returns a sound mesh no larger than the file justifies.
#![no_main]

use kilwa_builder::read::read_mesh_from;
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let Ok(mesh) = read_mesh_from(std::io::Cursor::new(bytes), bytes.len() as u64, Path::new("fuzz.ply"), &mut |_, _| {}) else {
        return;
    };
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().flatten().all(|v| v.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
    assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n);
    assert!(mesh.normals.is_empty() || mesh.normals.len() == n);
    assert!(mesh.scalars.iter().all(|(_, values)| values.len() == n));
    assert!(mesh.positions.capacity() * 24 + mesh.triangles.capacity() * 12 <= 100 * bytes.len());
});
