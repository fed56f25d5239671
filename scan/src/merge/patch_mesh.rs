//! The mesh that fills holes (`--fill-mesh`): read into memory, and cut into pieces as the triangles of stations are.

use super::piles::{Gathered, Piles};
use super::{BEST_SIGMA, MESH_STATION, Options, Scale};
use crate::ScanError;
use crate::import::Progress;
use glam::DVec3;
use kilwa_formats::RawMesh;
use kilwa_formats::read::{Placement, read_mesh, recognise};
use kilwa_geometry::LengthUnit;
use kilwa_scan_core::tsdf::{Corner, expected_pieces, pieces};
use std::path::Path;

/// Pieces between two checks whether to stop.
const ASK_EVERY: u64 = 1 << 16;
/// How many times as large as the survey a mesh may be.
const LARGEST: f64 = 20.0;

/// A mesh in the coordinates of the survey.
pub(super) struct PatchMesh {
    mesh: RawMesh,
    pub(super) bounds: [DVec3; 2],
}

impl PatchMesh {
    /// Read a mesh of any format that `kilwa build` reads; glTF with y up. `survey` is the box of the survey, metres.
    pub(super) fn read(path: &Path, survey: [DVec3; 2], progress: &dyn Progress) -> Result<Self, ScanError> {
        let mut mesh = read_mesh(path, &mut |done, total| progress.update("reading the mesh", done, total))?;
        let place = Placement::to_metres(LengthUnit::Metre, recognise(path)?.up);
        for position in &mut mesh.positions {
            *position = place.place(*position);
        }
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let used = mesh.triangles.iter().flatten().map(|k| mesh.positions[*k as usize]);
        let bounds = used.fold(start, |[low, high], p| [low.min(p), high.max(p)]);
        let [size, whole] = [bounds, survey].map(|[low, high]| low.distance(high));
        let room = DVec3::splat(0.1 * whole);
        let is_apart = bounds[0].cmpgt(survey[1] + room).any() || bounds[1].cmplt(survey[0] - room).any();
        if is_apart || size > LARGEST * whole {
            let [mesh, survey] = [bounds, survey].map(|[low, high]| format!("from {low:.1} to {high:.1}"));
            return Err(ScanError::Request(format!(
                "{} does not fit the survey: it extends {mesh}, and the survey {survey}; --fill-mesh needs a mesh in survey coordinates, in metres, z up (y up in glTF)",
                path.display()
            )));
        }
        Ok(Self { mesh, bounds })
    }

    /// The triangles that reach into `bounds`, voxels.
    fn triangles(&self, scale: Scale, [low, high]: [DVec3; 2]) -> impl Iterator<Item = [u32; 3]> {
        self.mesh.triangles.iter().copied().filter(move |triangle| {
            let [a, b, c] = self.corners(scale, *triangle);
            a.max(b).max(c).cmpge(low).all() && a.min(b).min(c).cmple(high).all()
        })
    }

    fn corners(&self, scale: Scale, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|k| scale.to_voxels(self.mesh.positions[k as usize]))
    }

    /// How many pieces there will be, about.
    pub(super) fn expected_pieces(&self, scale: Scale, bounds: [DVec3; 2]) -> f64 {
        let within = bounds.map(|corner| scale.to_voxels(corner));
        self.triangles(scale, within).map(|t| expected_pieces(self.corners(scale, t), within)).sum()
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
        let within = bounds.map(|corner| scale.to_voxels(corner));
        let [low, high] = within;
        let best = (scale.voxel / BEST_SIGMA).powi(2);
        let most = usize::try_from(options.memory / 2).unwrap_or(usize::MAX);
        let mut gathered = Gathered::new(piles, MESH_STATION, [tile_log2, options.fill.margin().cast_unsigned()], most);
        let (mut failure, mut count) = (None, 0_u64);
        for (number, triangle) in self.triangles(scale, within).enumerate() {
            let corners = triangle.map(|k| Corner {
                position: scale.to_voxels(self.mesh.positions[k as usize]),
                color: self.mesh.colors.get(k as usize).copied(),
                intensity: None,
                quality: best,
            });
            pieces(&corners, best, within, &mut |piece| {
                let at = piece.position();
                if failure.is_none() && at.cmpge(low).all() && at.cmple(high).all() {
                    failure = gathered.add(&piece).err();
                }
                if count.is_multiple_of(ASK_EVERY) && progress.is_stopped() {
                    failure.get_or_insert(ScanError::Stopped);
                }
                if count.is_multiple_of(ASK_EVERY) {
                    progress.update("reading the mesh", number as u64, self.mesh.triangles.len() as u64);
                }
                count += 1;
            });
            if let Some(failure) = failure {
                return Err(failure);
            }
        }
        gathered.flush()
    }
}
