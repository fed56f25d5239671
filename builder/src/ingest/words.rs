//! Records of 32-bit words: what a vertex is once it is on the lattice, and how blocks of them go to disk.
//!
//! A vertex is `x, y, z, colour?, normal?, scalar …`, one word each; a triangle is its three corners one after the other.
//! Words are chosen so that comparing two vertices word by word is the canonical order of vertices (position, colour,
//! normal, scalars bit for bit). On disk words are little-endian.

use crate::scratch::{ScratchError, ScratchFile};
use kilwa_geometry::normal::OctNormal;
use serde::{Deserialize, Serialize};

/// Marks a corner whose vertex cannot be used, in the place of x.
pub(super) const INVALID: u32 = u32::MAX;

/// Which attributes the vertices of a build have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Layout {
    pub(super) colors: bool,
    /// Normals come from the inputs; otherwise they are made, and no word holds them.
    pub(super) normals: bool,
    pub(super) scalars: usize,
}

impl Layout {
    /// Words of a vertex.
    pub(super) fn vertex(self) -> usize {
        3 + usize::from(self.colors) + usize::from(self.normals) + self.scalars
    }

    /// Words of a triangle.
    pub(super) fn triangle(self) -> usize {
        3 * self.vertex()
    }

    /// The word of the colour.
    pub(super) fn color(self) -> Option<usize> {
        self.colors.then_some(3)
    }

    /// The word of the normal.
    pub(super) fn normal(self) -> Option<usize> {
        self.normals.then_some(3 + usize::from(self.colors))
    }

    /// The word of the first scalar.
    pub(super) fn scalar(self) -> usize {
        3 + usize::from(self.colors) + usize::from(self.normals)
    }
}

pub(super) fn word_of_color([r, g, b]: [u8; 3]) -> u32 {
    u32::from_be_bytes([0, r, g, b])
}

pub(super) fn color_of_word(word: u32) -> [u8; 3] {
    let [_, r, g, b] = word.to_be_bytes();
    [r, g, b]
}

/// Sorts as the pair of signed coordinates does.
pub(super) fn word_of_normal(n: OctNormal) -> u32 {
    let [a, b] = n.map(|c| u32::from(c as u16 ^ 0x8000));
    (a << 16) | b
}

pub(super) fn normal_of_word(word: u32) -> OctNormal {
    [(word >> 16) as u16, word as u16].map(|c| (c ^ 0x8000) as i16)
}

/// Words to and from little-endian, in place.
fn little_endian(words: &mut [u32]) {
    if cfg!(target_endian = "big") {
        for w in words {
            *w = w.to_le();
        }
    }
}

/// Append words; returns the byte where they begin.
pub(super) fn append_words(file: &ScratchFile, words: &mut [u32]) -> Result<u64, ScratchError> {
    little_endian(words);
    file.append(bytemuck::cast_slice(words))
}

/// Write words at a position; see [`ScratchFile::write_at`].
pub(super) fn write_words(file: &ScratchFile, at: u64, words: &mut [u32]) -> Result<(), ScratchError> {
    little_endian(words);
    file.write_at(at, bytemuck::cast_slice(words))
}

/// Fill `into` with the words from byte `at` on.
pub(super) fn read_words(file: &ScratchFile, at: u64, into: &mut [u32]) -> Result<(), ScratchError> {
    file.read_into(at, bytemuck::cast_slice_mut(into))?;
    little_endian(into);
    Ok(())
}

/// As [`read_words`]; the bytes of the words are added to a checksum.
pub(super) fn read_words_with_sum(
    file: &ScratchFile,
    at: u64,
    into: &mut [u32],
    sum: &mut crc32fast::Hasher,
) -> Result<(), ScratchError> {
    file.read_into(at, bytemuck::cast_slice_mut(into))?;
    sum.update(bytemuck::cast_slice(into));
    little_endian(into);
    Ok(())
}

/// The words in the bytes of a file; bytes after the last whole word are ignored.
pub(super) fn words_of_bytes(bytes: &[u8]) -> Vec<u32> {
    let mut words = vec![0u32; bytes.len() / 4];
    bytemuck::cast_slice_mut(&mut words).copy_from_slice(&bytes[..bytes.len() / 4 * 4]);
    little_endian(&mut words);
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_colours_and_normals_keep_their_order_and_round_trip() {
        let colors = [[0, 0, 1], [0, 1, 0], [1, 0, 0], [255, 255, 255]];
        assert!(colors.is_sorted_by_key(|c| word_of_color(*c)));
        assert!(colors.iter().all(|c| color_of_word(word_of_color(*c)) == *c));
        let normals = [[-32767, 5], [-1, -1], [-1, 0], [0, -32767], [0, 3], [32767, 0]];
        assert!(normals.is_sorted_by_key(|n| word_of_normal(*n)));
        assert!(normals.iter().all(|n| normal_of_word(word_of_normal(*n)) == *n));
    }
}
