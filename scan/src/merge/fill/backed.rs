//! Filling with what backs the field: another mesh, and the scans at coarser voxels.

use super::held::Held;
use super::{Filled, Filler, Source};
use crate::ScanError;
use crate::merge::MergedVertex;
use crate::merge::causes::seen_through;
use crate::mesh::MeshVertex;
use glam::DVec3;
use kilwa_scan_core::tsdf::{EdgeKey, PatchVertex};
use std::collections::BTreeMap;

/// Test points of a part of the surface.
const PLACES: usize = 64;

impl Filler<'_, '_, '_> {
    /// Add the surface of the mesh, and the parts at coarser voxels that close holes.
    pub(super) fn backed(
        &mut self,
        held: &Held,
        filled: &mut Filled,
        progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let is_mesh =
            |triangle: &[EdgeKey; 3]| triangle.iter().all(|key| matches!(held.vertices[key].backing, None | Some(0)));
        let mut numbers = BTreeMap::new();
        for triangle in held.triangles.iter().filter(|t| is_mesh(t)) {
            filled.mesh_area += self.area(held, triangle);
            self.held_triangle(held, triangle, Source::Mesh, &mut numbers)?;
        }
        let parts = held.parts(self.joined.rims(), |t| !is_mesh(t));
        let closing: Vec<_> = parts.into_iter().filter(|(_, closes)| *closes).collect();
        let places: Vec<Vec<DVec3>> = closing.iter().map(|(part, _)| self.places(held, part)).collect();
        let through = seen_through(self.stations, 2.0 * self.voxel, &places, progress)?;
        for (((part, _), places), through) in closing.iter().zip(&places).zip(through) {
            if 2 * through > places.len() {
                continue;
            }
            let area: f64 = part.iter().map(|k| self.area(held, &held.triangles[*k])).sum();
            if area > self.fill.max_area {
                continue;
            }
            for k in part {
                self.held_triangle(held, &held.triangles[*k], Source::Coarser, &mut numbers)?;
            }
        }
        Ok(())
    }

    fn place(&self, vertex: &PatchVertex) -> DVec3 {
        self.joined.scale().to_survey(vertex.position)
    }

    fn area(&self, held: &Held, triangle: &[EdgeKey; 3]) -> f64 {
        let [a, b, c] = triangle.map(|key| self.place(&held.vertices[&key]));
        (b - a).cross(c - a).length() / 2.0
    }

    /// Places spread over a part.
    fn places(&self, held: &Held, part: &[usize]) -> Vec<DVec3> {
        let step = part.len().div_ceil(PLACES).max(1);
        let corners = part.iter().step_by(step).map(|k| held.triangles[*k]);
        corners.map(|t| t.map(|key| self.place(&held.vertices[&key])).into_iter().sum::<DVec3>() / 3.0).collect()
    }

    fn held_triangle(
        &mut self,
        held: &Held,
        triangle: &[EdgeKey; 3],
        source: Source,
        numbers: &mut BTreeMap<EdgeKey, u64>,
    ) -> Result<(), ScanError> {
        let mut corners = [0; 3];
        for (corner, key) in corners.iter_mut().zip(triangle) {
            *corner = if let Some(number) = held.numbers.get(key).or_else(|| numbers.get(key)) {
                *number
            } else {
                let number = self.held_vertex(&held.vertices[key], source)?;
                numbers.insert(*key, number);
                number
            };
        }
        self.joined.triangle(corners, source)
    }

    fn held_vertex(&mut self, vertex: &PatchVertex, source: Source) -> Result<u64, ScanError> {
        let position = self.place(vertex).clamp(self.bounds[0], self.bounds[1]);
        self.joined.vertex(&MergedVertex {
            vertex: MeshVertex {
                position,
                normal: vertex.normal,
                color: vertex.color,
                intensity: vertex.intensity.unwrap_or(f32::NAN),
                confidence: 0.0,
            },
            stations: 0,
            registration: None,
            source,
        })
    }
}
