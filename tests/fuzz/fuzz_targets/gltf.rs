//! Any bytes as a glTF or GLB: the reader ends, does not panic, and returns a sound mesh. A mesh shown by many nodes is
//! delivered for each, so that its size is not bounded by that of the file; the sink here ends the file when it is large.
#![no_main]

use kilwa_builder::Findings;
use kilwa_builder::read::{Input, MemorySink, MeshSink, ReadError, ReadOptions, VertexBlock, gltf};
use libfuzzer_sys::fuzz_target;
use std::path::{Path, PathBuf};

/// Keeps what comes, up to a limit.
struct Limited(MemorySink, u64);

impl Limited {
    fn spend(&mut self, n: usize) -> Result<(), ReadError> {
        self.1 = self.1.saturating_sub(n as u64);
        let full = || ReadError::TooLarge { file: PathBuf::new(), what: "enough for a fuzzer".to_owned() };
        if self.1 == 0 { Err(full()) } else { Ok(()) }
    }
}

impl MeshSink for Limited {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        self.0.channels(names)
    }
    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        let n = block.positions.len();
        assert!(block.colors.is_empty() || block.colors.len() == n);
        assert!(block.normals.is_empty() || block.normals.len() == n);
        self.spend(n)?;
        self.0.vertices(block)
    }
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        self.spend(triangles.len())?;
        assert!(triangles.iter().flatten().all(|v| *v < self.0.vertex_count()));
        self.0.triangles(triangles, colors)
    }
    fn positions(&mut self, of: &[u64], into: &mut Vec<[f64; 3]>) -> Result<(), ReadError> {
        self.0.positions(of, into)
    }
    fn vertex_count(&self) -> u64 {
        self.0.vertex_count()
    }
    fn findings(&mut self) -> &mut Findings {
        self.0.findings()
    }
}

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("/nowhere/fuzz.gltf");
    let mut sink = Limited(MemorySink::new(path), 1 << 20);
    let options = ReadOptions { texture_bytes: 1 << 22, ..ReadOptions::default() };
    let mut source = std::io::Cursor::new(bytes);
    let total = bytes.len() as u64;
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options };
    if gltf::read(input, &mut sink).is_ok() {
        let _ = sink.0.into_mesh();
    }
});
