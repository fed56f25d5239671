//! Pieces by tile: each tile has the pieces that its surface needs, in runs of one scratch file.

use crate::ScanError;
use crate::scratch::{ScratchFile, Stretch};
use glam::IVec3;
use kilwa_scan_core::tsdf::{BRICK, PIECE_BYTES, Piece, Region, SUB_LOG2};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Bytes read at a time.
const CHUNK: usize = 4096 * PIECE_BYTES;

/// A run: pieces of one station in one tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Run {
    /// The number of the station, from 1.
    pub(super) station: u16,
    stretch: Stretch,
}

/// The file, and the runs of each tile.
pub(super) struct Piles {
    file: ScratchFile,
    runs: Mutex<HashMap<IVec3, Vec<Run>>>,
}

impl Piles {
    /// Create an empty store. The file is unlinked and disappears when this is dropped.
    pub(super) fn create(folder: &Path) -> Result<Self, ScanError> {
        let file = ScratchFile::create(folder, ", or use a larger --voxel")?;
        Ok(Self { file, runs: Mutex::default() })
    }

    fn append(&self, station: u16, tile: IVec3, bytes: &[u8]) -> Result<(), ScanError> {
        let run = Run { station, stretch: self.file.append(bytes)? };
        self.runs.lock().unwrap_or_else(PoisonError::into_inner).entry(tile).or_default().push(run);
        Ok(())
    }

    /// Bytes in the file.
    pub(super) fn bytes(&self) -> u64 {
        self.file.bytes()
    }

    /// The tiles that have pieces, by the Morton codes of their first bricks, and the runs of each by station.
    pub(super) fn tiles(&self) -> BTreeMap<u64, (IVec3, Vec<Run>)> {
        let runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        let sorted = runs.iter().map(|(tile, runs)| {
            let mut runs = runs.clone();
            runs.sort_unstable();
            (morton(*tile), (*tile, runs))
        });
        sorted.collect()
    }

    /// Pass the pieces of a run to `sink`.
    pub(super) fn read(&self, run: Run, sink: &mut dyn FnMut(&Piece)) -> Result<(), ScanError> {
        let bytes = self.file.read(run.stretch)?;
        for piece in bytes.as_chunks::<PIECE_BYTES>().0 {
            sink(&Piece::from_bytes(piece));
        }
        Ok(())
    }
}

/// The Morton code of coordinates from 0 to 2²¹ - 1.
pub(super) fn morton(at: IVec3) -> u64 {
    let spread = |v: i32| {
        let mut v = u64::from(v.cast_unsigned()) & 0x1f_ffff;
        v = (v | v << 32) & 0x001f_0000_0000_ffff;
        v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

/// Gathers the pieces of one station by tile.
pub(super) struct Gathered<'p> {
    piles: &'p Piles,
    station: u16,
    /// Bricks along the edge of a tile, as a power of two.
    tile_log2: u32,
    /// Voxels around a tile from which it needs pieces.
    margin: i32,
    tiles: HashMap<IVec3, Vec<u8>>,
    held: usize,
    most: usize,
    /// Pieces so far, each counted once.
    pub(super) count: u64,
}

impl<'p> Gathered<'p> {
    /// For one station and tiles of `1 << tile_log2` bricks with `margin` voxels around each, holding at most `most` bytes in memory.
    pub(super) fn new(piles: &'p Piles, station: u16, [tile_log2, margin]: [u32; 2], most: usize) -> Self {
        Self { piles, station, tile_log2, margin: margin.cast_signed(), tiles: HashMap::new(), held: 0, most, count: 0 }
    }

    /// Put a piece where it is needed.
    pub(super) fn add(&mut self, piece: &Piece) -> Result<(), ScanError> {
        let tile = |at: IVec3| (at >> SUB_LOG2) >> (BRICK.ilog2() + self.tile_log2);
        let reach = (self.margin + 1) << SUB_LOG2;
        let (low, high) = (tile(piece.at - reach), tile(piece.at + reach));
        let bytes = piece.to_bytes();
        self.count += 1;
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let min = IVec3::new(x, y, z) << self.tile_log2;
                    let region = Region { min, bricks: 1 << self.tile_log2 };
                    if min.cmpge(IVec3::ZERO).all() && region.needs(piece, self.margin) {
                        let pile = self.tiles.entry(min).or_default();
                        pile.extend_from_slice(&bytes);
                        self.held += PIECE_BYTES;
                        if pile.len() >= CHUNK {
                            self.held -= pile.len();
                            self.piles.append(self.station, min, pile)?;
                            *pile = Vec::new();
                        }
                    }
                }
            }
        }
        if self.held > self.most { self.flush() } else { Ok(()) }
    }

    /// Write everything.
    pub(super) fn flush(&mut self) -> Result<(), ScanError> {
        for (tile, bytes) in self.tiles.drain().filter(|(_, bytes)| !bytes.is_empty()) {
            self.piles.append(self.station, tile, &bytes)?;
        }
        self.held = 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_morton_code_of_a_tile_comes_before_those_of_the_bricks_in_it() {
        assert_eq!(morton(IVec3::new(1, 0, 0)), 1);
        assert_eq!(morton(IVec3::new(0, 1, 0)), 2);
        assert_eq!(morton(IVec3::new(3, 5, 6)), 0b_110_101_011);
        let tile = IVec3::new(16, 32, 48);
        for brick in [IVec3::ZERO, IVec3::new(15, 0, 3), IVec3::splat(15)] {
            assert!((morton(tile)..morton(tile) + (1 << 12)).contains(&morton(tile + brick)));
        }
    }
}
