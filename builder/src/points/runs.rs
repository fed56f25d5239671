//! Runs of splats in one scratch file: any thread appends and reads. Each is checked when it is read.

use super::splat::{BYTES, Splat};
use crate::scratch::{Scratch, ScratchError, ScratchFile};
use rustc_hash::FxHashMap;
use std::sync::{PoisonError, RwLock};

/// Where a run is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    at: u64,
    pub(super) count: u32,
    sum: u32,
}

/// A file of runs.
pub(super) struct RunFile {
    file: ScratchFile,
}

impl RunFile {
    pub(super) fn create(scratch: &Scratch, name: &str) -> Result<Self, ScratchError> {
        Ok(Self { file: scratch.create(name)? })
    }

    /// Append at most 2^32 - 1 splats.
    pub(super) fn append(&self, splats: &[Splat]) -> Result<Run, ScratchError> {
        let bytes: &[u8] = bytemuck::cast_slice(splats);
        let at = self.file.append(bytes)?;
        Ok(Run { at, count: splats.len() as u32, sum: crc32fast::hash(bytes) })
    }

    /// Append the splats of a run to `out`.
    pub(super) fn read(&self, run: Run, out: &mut Vec<Splat>) -> Result<(), ScratchError> {
        let first = out.len();
        out.resize(first + run.count as usize, bytemuck::Zeroable::zeroed());
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut out[first..]);
        debug_assert_eq!(bytes.len(), run.count as usize * BYTES);
        self.file.read_into(run.at, bytes)?;
        if crc32fast::hash(bytes) == run.sum {
            return Ok(());
        }
        Err(ScratchError::damaged(
            self.file.path(),
            format!("the points at byte {} are not those that were written", run.at),
        ))
    }
}

/// Runs by tetrahedron of the tree.
pub(super) struct ByTetrahedron {
    file: RunFile,
    index: RwLock<FxHashMap<u32, Run>>,
}

impl ByTetrahedron {
    pub(super) fn create(scratch: &Scratch, name: &str) -> Result<Self, ScratchError> {
        Ok(Self { file: RunFile::create(scratch, name)?, index: RwLock::default() })
    }

    /// The splats of a tetrahedron that has none yet.
    pub(super) fn append(&self, tetrahedron: u32, splats: &[Splat]) -> Result<(), ScratchError> {
        let run = self.file.append(splats)?;
        self.index.write().unwrap_or_else(PoisonError::into_inner).insert(tetrahedron, run);
        Ok(())
    }

    /// How many splats a tetrahedron has.
    pub(super) fn count(&self, tetrahedron: u32) -> u32 {
        self.run(tetrahedron).map_or(0, |run| run.count)
    }

    /// The splats of a tetrahedron; none where it is empty.
    pub(super) fn read(&self, tetrahedron: u32) -> Result<Vec<Splat>, ScratchError> {
        let mut out = Vec::new();
        if let Some(run) = self.run(tetrahedron) {
            self.file.read(run, &mut out)?;
        }
        Ok(out)
    }

    fn run(&self, tetrahedron: u32) -> Option<Run> {
        self.index.read().unwrap_or_else(PoisonError::into_inner).get(&tetrahedron).copied()
    }
}
