//! How much scratch space a merge needs, estimated from a sample of its triangles before anything is written.

use super::cut::Station;
use super::{Options, Scale};
use crate::ScanError;
use crate::free_space::free_space;
use crate::mesh::{MeshVertex, Surface, sample_strips};
use glam::DVec3;
use kilwa_files::size::binary;
use kilwa_scan_core::tsdf::{BRICK, PIECE_BYTES, expected_pieces};

/// Strips between two lines of the grid that are looked at in each station.
const STRIPS: usize = 48;

/// The approximate size of the scratch file, bytes.
pub(super) fn scratch_bytes(
    stations: &[Station<'_>],
    of_mesh: f64,
    options: &Options,
    scale: Scale,
    tile_log2: u32,
) -> Result<u64, ScanError> {
    let mut pieces = of_mesh;
    for station in stations {
        let mut counter = Counter { scale, bounds: options.bounds, window: Vec::new(), pieces: 0.0 };
        let share = sample_strips(&mut station.open()?, station.pose, &station.options, STRIPS, &mut counter)?;
        pieces += counter.pieces / share.max(f64::MIN_POSITIVE);
    }
    // A piece is stored in every tile whose margin it lies in.
    let edge = f64::from(BRICK << tile_log2);
    let copies = (1.0 + 2.0 * f64::from(options.fill.margin()) / edge).powi(3);
    Ok((pieces * copies * PIECE_BYTES as f64) as u64)
}

/// Fail if the scratch folder has less free space than that.
pub(super) fn check(needed: u64, options: &Options) -> Result<(), ScanError> {
    // If the system does not report its free space, the merge goes ahead.
    let free = free_space(&options.scratch);
    if free >= needed {
        return Ok(());
    }
    Err(ScanError::Request(format!(
        "the merge needs about {} of scratch space, and the disk that holds {} has {} free; use a larger --voxel, limit the area with --box, or choose a folder on a larger disk with --scratch",
        binary(needed),
        options.scratch.display(),
        binary(free)
    )))
}

/// Counts the pieces that triangles will be cut into.
struct Counter {
    scale: Scale,
    bounds: Option<[DVec3; 2]>,
    window: Vec<DVec3>,
    pieces: f64,
}

impl Surface for Counter {
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        self.window.push(vertex.position);
        Ok(self.window.len() as u32 - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        let corners = corners.map(|k| self.window[k as usize]);
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        if self.bounds.is_none_or(|[low, high]| middle.cmpge(low).all() && middle.cmple(high).all()) {
            let within = [DVec3::NEG_INFINITY, DVec3::INFINITY];
            self.pieces += expected_pieces(corners.map(|p| self.scale.to_voxels(p)), within);
        }
        Ok(())
    }
}
