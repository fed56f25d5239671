//! Any bytes as an STL: the reader ends, does not panic, and returns a sound mesh no larger than the file justifies.
#![no_main]

use kilwa_builder::read::{Input, MemorySink, ReadOptions, stl};
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("fuzz.stl");
    let mut sink = MemorySink::new(path);
    let (options, total) = (ReadOptions::default(), bytes.len() as u64);
    let mut source = std::io::Cursor::new(bytes);
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options };
    // Also what the dispatch would not take for an STL.
    if stl::read(input, &mut sink).is_err() {
        return;
    }
    let Ok(mesh) = sink.into_mesh() else { return };
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().flatten().all(|v| v.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n);
    // A text corner takes 13 bytes ("vertex 0 0 0 "), three positions make a facet, and fans deliver three for each.
    assert!(n <= bytes.len());
});
