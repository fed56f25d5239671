//! The reader of STL (3D Systems, "StereoLithography Interface Specification", 1989): binary and text.
//!
//! The two are reported apart by content: a file of exactly 84 + 50 n bytes, n as its header says, is binary, also when it
//! begins with "solid"; one that begins with "solid" and continues as text is text; one whose length does not fit its
//! header is binary where its facets make sense. STL has no units and no up axis: metres and z unless reported.
//!
//! Every facet delivers three vertices of its own; equal positions become one when the mesh is prepared. Memory is
//! constant. Normals are not kept (they are recomputed); those that contradict the order of the corners are counted.
//! Colours of facets are kept in the conventions of VisCAM and SolidView, and of Materialise Magics (see `colors`).
//!
//! Repaired and counted: a count in the header that the file does not have, bytes after the last facet, text facets
//! without `endfacet`, of more than three corners (cut as fans) or of fewer (dropped). Refused with its line: text
//! that is not STL.

mod ascii;
mod binary;
mod colors;
mod facets;
#[cfg(test)]
mod tests;

use super::{Input, MeshSink, ReadError};
use facets::Facets;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::Path;

/// Bytes of the free text at the beginning of a binary file.
const HEADER: usize = 80;
/// Bytes before the first facet: the free text and the count.
const BEFORE: usize = HEADER + 4;
/// Bytes of a facet: normal and three corners as floats, two attribute bytes.
const FACET: usize = 50;
/// Bytes that distinguish text from binary: those that the format detection examines.
const SNIFFED: usize = super::SNIFFED as usize;
/// Bytes read at a time.
const BUFFER: usize = 1 << 20;

/// Whether a file of so many bytes that starts with these is an STL.
pub fn is_stl(start: &[u8], total: u64) -> bool {
    is_text(start) || binary::is_exact(start, total) || binary::is_plausible(start, total)
}

/// "solid", a separation, and somewhere in what is there a word that only a text file has. A binary file has zero bytes
/// or others that no text has among the first facets.
fn is_text(start: &[u8]) -> bool {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start).trim_ascii_start();
    let Some((word, rest)) = start.split_at_checked(5) else { return false };
    let separated = rest.first().is_none_or(u8::is_ascii_whitespace);
    let has = |word: &[u8]| rest.windows(word.len()).any(|w| w.eq_ignore_ascii_case(word));
    word.eq_ignore_ascii_case(b"solid") && separated && !rest.contains(&0) && (has(b"facet") || has(b"endsolid"))
}

/// Deliver the STL.
///
/// # Errors
/// [`ReadError`] for text that is not STL, for a file without facets, and what the sink says.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let Input { path, total, source, progress, .. } = input;
    let mut bytes =
        Bytes { inner: BufReader::with_capacity(BUFFER, source), path, offset: 0, reported: 0, total, progress };
    let mut start = vec![0; SNIFFED];
    let there = bytes.fill(&mut start)?;
    start.truncate(there);
    bytes.seek(0)?;
    let mut facets = Facets::new(sink);
    let binary = binary::is_exact(&start, total) || !is_text(&start);
    if binary {
        binary::read(&mut bytes, &start, &mut facets)?;
    } else {
        ascii::read(&mut bytes, &mut facets)?;
    }
    facets.flush()?;
    let delivered = facets.delivered();
    (bytes.progress)(total, total);
    if delivered > 0 {
        return Ok(());
    }
    let found = if binary { "its header counts no facets" } else { "it has no facet of three corners" };
    let way_out = "Export the mesh again";
    Err(ReadError::NoTriangles { file: path.to_owned(), found: found.to_owned(), way_out })
}

/// The bytes of the file in order, with their offset and progress.
struct Bytes<'a> {
    inner: BufReader<&'a mut dyn super::Bytes>,
    path: &'a Path,
    offset: u64,
    /// Offset at which progress was last reported.
    reported: u64,
    total: u64,
    progress: &'a mut super::OnProgress<'a>,
}

impl Bytes<'_> {
    /// What is there and not yet used; empty at the end of the file.
    fn look(&mut self) -> Result<&[u8], ReadError> {
        if self.offset - self.reported >= BUFFER as u64 {
            self.reported = self.offset;
            (self.progress)(self.offset.min(self.total), self.total);
        }
        // Twice, because the borrow of the first cannot be returned from a loop.
        loop {
            match self.inner.fill_buf() {
                Ok(_) => break,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(source) => return Err(self.io(source)),
            }
        }
        let (file, offset) = (self.path, self.offset);
        self.inner.fill_buf().map_err(|source| ReadError::Io { file: file.to_owned(), offset, source })
    }

    /// Use up `n` of them.
    fn take(&mut self, n: usize) {
        self.inner.consume(n);
        self.offset += n as u64;
    }

    /// Fill `into` as far as the file goes; how many bytes that are.
    fn fill(&mut self, into: &mut [u8]) -> Result<usize, ReadError> {
        let mut done = 0;
        while done < into.len() {
            let there = self.look()?;
            if there.is_empty() {
                break;
            }
            let n = there.len().min(into.len() - done);
            into[done..done + n].copy_from_slice(&there[..n]);
            self.take(n);
            done += n;
        }
        Ok(done)
    }

    /// Go to a place in the file.
    fn seek(&mut self, offset: u64) -> Result<(), ReadError> {
        use std::io::{Seek, SeekFrom};
        self.inner.seek(SeekFrom::Start(offset)).map_err(|source| self.io(source))?;
        (self.offset, self.reported) = (offset, offset);
        Ok(())
    }

    fn io(&self, source: std::io::Error) -> ReadError {
        ReadError::Io { file: self.path.to_owned(), offset: self.offset, source }
    }
}
