//! The mesh that fills holes (`--fill-mesh`): read into memory, and cut into pieces as the triangles of stations are.

use super::piles::{Gathered, Piles};
use super::{BEST_SIGMA, MESH_STATION, Options, Scale};
use crate::ScanError;
use crate::import::Progress;
use glam::DVec3;
use kilwa_formats::RawMesh;
use kilwa_formats::read::read_mesh;
use kilwa_scan_core::tsdf::{Corner, pieces};
use std::path::Path;

/// Triangles between two checks whether to stop.
const ASK_EVERY: usize = 1 << 12;

/// A mesh in the coordinates of the survey.
pub(super) struct PatchMesh {
    mesh: RawMesh,
    pub(super) bounds: [DVec3; 2],
}

impl PatchMesh {
    /// Read a mesh of any format that `kilwa build` reads.
    pub(super) fn read(path: &Path, progress: &dyn Progress) -> Result<Self, ScanError> {
        let mesh = read_mesh(path, &mut |done, total| progress.update("reading the mesh", done, total))?;
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let bounds = mesh.positions.iter().fold(start, |[low, high], p| [low.min(*p), high.max(*p)]);
        Ok(Self { mesh, bounds })
    }

    /// Cut the part inside `bounds` into pieces.
    pub(super) fn cut(
        &self,
        options: &Options,
        bounds: [DVec3; 2],
        scale: Scale,
        piles: &Piles,
        tile_log2: u32,
        progress: &dyn Progress,
    ) -> Result<(), ScanError> {
        let [low, high] = bounds.map(|corner| scale.to_voxels(corner));
        let best = (scale.voxel / BEST_SIGMA).powi(2);
        let most = usize::try_from(options.memory / 2).unwrap_or(usize::MAX);
        let mut gathered = Gathered::new(piles, MESH_STATION, [tile_log2, options.fill.margin().cast_unsigned()], most);
        let mut failure = None;
        for (number, triangle) in self.mesh.triangles.iter().enumerate() {
            if number.is_multiple_of(ASK_EVERY) {
                if progress.is_stopped() {
                    return Err(ScanError::Stopped);
                }
                progress.update("reading the mesh", number as u64, self.mesh.triangles.len() as u64);
            }
            let corners = triangle.map(|k| Corner {
                position: scale.to_voxels(self.mesh.positions[k as usize]),
                color: self.mesh.colors.get(k as usize).copied(),
                intensity: None,
                quality: best,
            });
            let [a, b, c] = corners.map(|corner| corner.position);
            if a.max(b).max(c).cmplt(low).any() || a.min(b).min(c).cmpgt(high).any() {
                continue;
            }
            pieces(&corners, best, &mut |piece| {
                let at = piece.position();
                if failure.is_none() && at.cmpge(low).all() && at.cmple(high).all() {
                    failure = gathered.add(&piece).err();
                }
            });
            if let Some(failure) = failure {
                return Err(failure);
            }
        }
        gathered.flush()
    }
}
