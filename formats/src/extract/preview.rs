//! A small GLB of a pack, for programs that open nothing else: the coarsest of what it has, at zero, under a limit of bytes.

use super::ExtractError;
use super::choose;
use super::format::{Format, Target};
use super::output::Output;
use super::reduce::WINDOW;
use super::stream;
use kilwa_pack::{Reader, Source};
use std::path::Path;

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preview {
    /// Length of the file.
    pub bytes: u64,
    /// Triangles in it.
    pub triangles: u64,
    /// Certified error against the finest surface, metres.
    pub error: f32,
}

/// Bytes of a triangle with its share of the vertices: 12 and half of 32, and seams.
const BYTES_PER_TRIANGLE: u64 = 30;
/// How often fewer triangles are tried.
const TRIES: u32 = 6;

/// Write the best surface of a pack that takes at most `max_bytes` as GLB to `to`, a new file.
/// The model is at the origin, because viewers that compute in `float` fail far from it; its position is recorded in `asset.extras`.
///
/// # Errors
/// When the pack cannot be read, even its simplest surface takes more than that, or the file cannot be written.
pub fn preview<S: Source + Sync>(reader: &Reader<S>, to: &Path, max_bytes: u64) -> Result<Preview, ExtractError> {
    let mut max = (max_bytes / BYTES_PER_TRIANGLE).max(1);
    let format = Format::Glb { compressed: false };
    for _ in 0..TRIES {
        let chosen = choose::choose(reader, None, Some(max), WINDOW, None)?;
        let target = Target::new(reader, &chosen, None, format)?;
        let target = Target { at_zero: true, ..target };
        let mut encoder = format.encoder(&target);
        let output = Output::prepare(to, false)?;
        let mut scratch = output.scratch()?;
        let source = stream::Chunks { reader, repaint: None };
        let counts = stream::stream(&source, &chosen, None, &mut *encoder, &mut scratch, &|_, _| {})?;
        if counts.triangles == 0 {
            return Err(ExtractError::Empty);
        }
        let mut bytes = Vec::new();
        encoder
            .assemble(&mut bytes, &mut scratch, counts)
            .map_err(|source| ExtractError::Write { path: to.to_owned(), source })?;
        let length = bytes.len() as u64;
        if length <= max_bytes {
            output.write(|out| out.write_all(&bytes))?;
            return Ok(Preview { bytes: length, triangles: counts.triangles, error: counts.error });
        }
        if counts.triangles > max {
            break;
        }
        max = (counts.triangles * max_bytes / length).min(max * 9 / 10).max(1);
    }
    Err(ExtractError::TooLarge { limit: max_bytes })
}
