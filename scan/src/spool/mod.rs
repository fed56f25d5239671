//! The spool: one station's samples in a binary file of the survey, 20 bytes a sample.
//!
//! ```text
//! header    256 bytes: see `header`
//! samples   20 bytes each, in the order of the grid: x y z (f32, metres from `origin`), intensity (f32), red green blue state
//! table     for each block of 1024 samples the first 8 bytes of its BLAKE3 hash
//! ```
//!
//! All numbers are little-endian. A cell without anything is 20 zero bytes, so that a grid with few samples takes little disk as a sparse
//! file. The header holds the hash of the table and its own, so any changed byte is found when it is read.
//!
//! Precision: a coordinate is the nearest `f32` to the one of the source, wrong by at most 2^-24 of its size: 0.5 µm at 8 m, 4 µm at 64 m, 8 µm at
//! 128 m. Coordinates that the source has as `f32`, and decimal ones of up to seven significant digits, come back exactly.
//!
//! Memory: the writer keeps some blocks, the reader one; neither grows with the scan but for 8 bytes of table a block (0.04 % of the file).

mod header;
mod reader;
mod writer;

#[cfg(test)]
mod tests;

pub use header::{Header, Statistics};
pub use reader::Reader;
pub use writer::{Layout, Writer};

use glam::Vec3;
use kilwa_scan_core::{Kind, Sample, State};

/// Bytes of a sample.
pub const SAMPLE_BYTES: usize = 20;
/// Samples of a block, which is read, checked and written as a whole.
const BLOCK_SAMPLES: u64 = 1024;
const BLOCK_BYTES: usize = BLOCK_SAMPLES as usize * SAMPLE_BYTES;

pub(crate) fn encode(sample: &Sample, out: &mut [u8]) {
    if sample.state.kind() == Kind::Empty {
        out.fill(0);
        return;
    }
    let Vec3 { x, y, z } = sample.position;
    for (at, number) in [x, y, z, sample.intensity].into_iter().enumerate() {
        out[4 * at..4 * at + 4].copy_from_slice(&number.to_le_bytes());
    }
    out[16..19].copy_from_slice(&sample.color);
    out[19] = sample.state.to_byte();
}

/// The sample in 20 bytes; `None` if its state is unknown or a measured position is not finite.
pub(crate) fn decode(bytes: &[u8]) -> Option<Sample> {
    let number = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let state = State::from_byte(bytes[19])?;
    if state.kind() == Kind::Empty {
        return Some(Sample::EMPTY);
    }
    let position = Vec3::new(number(0), number(4), number(8));
    let color = [bytes[16], bytes[17], bytes[18]];
    position.is_finite().then_some(Sample { position, intensity: number(12), color, state })
}
