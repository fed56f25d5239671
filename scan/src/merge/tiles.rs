//! Tile by tile: the field of a tile's pieces, and the surface in its bricks.

use super::accuracy::Sigmas;
use super::piles::{Piles, Run, morton};
use super::{Fill, MESH_STATION, Options};
use crate::ScanError;
use crate::import::Progress;
use glam::IVec3;
use kilwa_scan_core::tsdf::{Backing, Cubes, Field, MARGIN, Patch, Region};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Tiles in a batch for each thread.
const BATCH: usize = 8;

/// Receives the surfaces of bricks along the Morton curve.
pub(super) type PatchSink<'a> = dyn FnMut(IVec3, Patch) -> Result<(), ScanError> + 'a;

/// The surfaces of the bricks of a tile.
type Made = Result<Vec<(IVec3, Patch)>, ScanError>;

/// The inputs from which the surface is made.
pub(super) struct TileInputs<'a> {
    pub(super) piles: &'a Piles,
    /// The uncertainties of the stations, if known.
    pub(super) sigmas: Option<&'a Sigmas<'a>>,
    /// Bricks along the edge of a tile, as a power of two.
    pub(super) tile_log2: u32,
}

/// Bricks along the edge of a tile, as a power of two, for a given amount of memory.
pub(super) fn size_log2(memory: u64, threads: usize, has_sigmas: bool) -> u32 {
    let share = memory / threads.max(1) as u64;
    // As if every seventh brick had a surface; a tile that needs more is divided.
    let bytes = |log2: u32| (1u64 << (3 * log2)) / 7 * Field::brick_bytes(has_sigmas) as u64;
    (1..=4).rev().find(|log2| bytes(*log2) <= share / 2).unwrap_or(1)
}

/// Pass the surfaces of all tiles to `sink`.
pub(super) fn surfaces(
    of: &TileInputs<'_>,
    options: &Options,
    progress: &(dyn Progress + Sync),
    sink: &mut PatchSink<'_>,
) -> Result<(), ScanError> {
    let TileInputs { piles, sigmas, tile_log2 } = *of;
    let tiles: Vec<(IVec3, Vec<Run>)> = piles.tiles().into_values().collect();
    let threads = options.threads.max(1);
    let budget =
        usize::try_from(options.memory / 2).unwrap_or(usize::MAX) / threads / Field::brick_bytes(sigmas.is_some());
    let cubes = Cubes::default();
    let mut done = 0;
    for batch in tiles.chunks(BATCH * threads) {
        let made: Vec<Mutex<Made>> = batch.iter().map(|_| Mutex::new(Ok(Vec::new()))).collect();
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                let Some((min, runs)) = batch.get(number) else { return };
                let region = Region { min: *min, bricks: 1 << tile_log2 };
                let mut patches = Vec::new();
                let result = if progress.is_stopped() {
                    Err(ScanError::Stopped)
                } else {
                    Tile { piles, runs, sigmas, budget, cubes: &cubes, fill: &options.fill }
                        .surface(region, &mut patches)
                };
                *made[number].lock().unwrap_or_else(PoisonError::into_inner) = result.map(|()| patches);
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(work);
            }
        });
        for tile in made {
            for (brick, patch) in tile.into_inner().unwrap_or_else(PoisonError::into_inner)? {
                sink(brick, patch)?;
            }
        }
        done += batch.len();
        progress.update("merging", done as u64, tiles.len() as u64);
    }
    Ok(())
}

/// What the surface of a tile is made of.
struct Tile<'a> {
    piles: &'a Piles,
    runs: &'a [Run],
    sigmas: Option<&'a Sigmas<'a>>,
    /// Bricks that may be in memory.
    budget: usize,
    cubes: &'a Cubes,
    fill: &'a Fill,
}

impl Tile<'_> {
    /// The surface of a region, which is divided if its field is too large for the budget.
    fn surface(&self, region: Region, out: &mut Vec<(IVec3, Patch)>) -> Result<(), ScanError> {
        let mut field = Field::new(region);
        let mut backing = self
            .fill
            .is_backed()
            .then(|| Backing::new(region, self.fill.mesh.is_some(), self.fill.levels(), self.fill.coarser));
        let margin = self.fill.margin();
        let mut is_full = false;
        for run in self.runs {
            self.piles.read(*run, &mut |piece| {
                if is_full || !region.needs(piece, margin) {
                    return;
                }
                if run.station == MESH_STATION {
                    if let Some(backing) = &mut backing {
                        backing.add_mesh(piece);
                    }
                } else {
                    if region.needs(piece, MARGIN) {
                        let sigma = self.sigmas.and_then(|sigmas| sigmas.at(run.station, piece));
                        field.add(run.station, piece, sigma);
                    }
                    if let Some(backing) = &mut backing {
                        backing.add(run.station, piece);
                    }
                }
                let bricks = field.bricks() + backing.as_ref().map_or(0, Backing::bricks);
                is_full = bricks > self.budget && region.bricks > 1;
            })?;
            if is_full {
                drop((field, backing));
                let half = region.bricks / 2;
                for part in 0..8 {
                    let at = IVec3::new(part & 1, part >> 1 & 1, part >> 2) * half;
                    self.surface(Region { min: region.min + at, bricks: half }, out)?;
                }
                return Ok(());
            }
        }
        let all = 0..region.bricks;
        let mut bricks: Vec<IVec3> = all
            .clone()
            .flat_map(|z| all.clone().flat_map(move |y| (0..region.bricks).map(move |x| IVec3::new(x, y, z))))
            .map(|at| region.min + at)
            .collect();
        bricks.sort_unstable_by_key(|brick| morton(*brick));
        let patch = |brick| Some((brick, field.patch(self.cubes, brick, backing.as_ref())?));
        out.extend(bricks.into_iter().filter_map(patch));
        Ok(())
    }
}
