//! The finest surface of a pack in a file, read with all processors and bounded memory.
//!
//! Chunks are read in order and in batches; what each gives is joined in order, so that results do not depend on the number of
//! threads. Only chunks whose box passes are read; of those that hold no finest patch the bytes are checked, not decoded.

use crate::source::FileSource;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kilwa_geometry::Aabb;
use kilwa_measure::leaves::part;
use kilwa_measure::{Failure, Leaves, Read};
use kilwa_pack::{Chunk, Index, PackError, Reader, Source};
use rayon::prelude::*;
use std::io::IsTerminal;

/// Chunks read at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;
/// From this many chunks on progress is shown.
const PROGRESS_MIN: usize = 512;

/// A pack in a file.
pub(super) struct FileLeaves {
    /// The pack.
    pub(super) pack: Reader<FileSource>,
}

impl Leaves for FileLeaves {
    fn index(&self) -> &Index {
        self.pack.index()
    }

    async fn chunk(&self, index: u32) -> Result<Chunk, Failure> {
        Ok(self.pack.chunk(index)?)
    }

    async fn sweep<A: Send>(
        &self,
        meets: impl Fn(&Aabb) -> bool,
        empty: impl Fn() -> A + Sync,
        add: impl Fn(&mut A, &Chunk) + Sync,
        mut join: impl FnMut(A),
    ) -> Result<Read, Failure> {
        let wanted = self.wanted(meets);
        let read = Read::of(self.index(), &wanted);
        let bar = bar(wanted.len(), read.bytes);
        for batch in wanted.chunks(BATCH) {
            let parts: Vec<Result<Option<A>, PackError>> =
                batch.par_iter().map(|&i| self.one(i, &empty, &add)).collect();
            for part in parts {
                if let Some(a) = part? {
                    join(a);
                }
            }
            bar.inc(Read::of(self.index(), batch).bytes);
        }
        bar.finish_and_clear();
        Ok(read)
    }
}

impl FileLeaves {
    fn one<A>(
        &self,
        index: u32,
        empty: &impl Fn() -> A,
        add: &impl Fn(&mut A, &Chunk),
    ) -> Result<Option<A>, PackError> {
        let Some(entry) = self.pack.entries().get(index as usize) else { return Ok(None) };
        let bytes = self.pack.source().read_at(entry.offset, entry.encoded_bytes as usize);
        let bytes = bytes.map_err(|source| PackError::Io { what: format!("chunk {index}"), source })?;
        part(&bytes, index, entry, self.pack.header(), empty, add)
    }
}

/// A bar on stderr with the time left, where it takes long and somebody looks.
fn bar(chunks: usize, bytes: u64) -> ProgressBar {
    if chunks < PROGRESS_MIN || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(bytes), ProgressDrawTarget::stderr_with_hz(5));
    if let Ok(style) = ProgressStyle::with_template("measuring {wide_bar} {percent:>3} %  {eta} left") {
        bar.set_style(style);
    }
    bar
}
