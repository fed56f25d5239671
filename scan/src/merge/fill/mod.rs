//! Filling the holes of a merged surface, on request. The surface that was measured is not changed: new triangles are added after it, and each has a vertex
//! that says what it rests on.

mod backed;
mod close;
mod collar;
mod held;
mod membrane;

#[cfg(test)]
mod tests;

use super::cut::Station;
use super::holes::{self, Borders, Cause};
use super::join::Joined;
use super::rims::RimVertex;
use super::{MergedVertex, Source};
use crate::ScanError;
use crate::mesh::MeshVertex;
use collar::Collar;
use glam::DVec3;
pub(super) use held::Held;
use kilwa_scan_core::tsdf::MARGIN;
use membrane::{Membrane, Nearest, membrane};
use std::path::PathBuf;

/// The minimum distance of two vertices, in voxels.
const NEAREST: f64 = 1.0 / 256.0;

/// What is filled.
#[derive(Debug, Clone, PartialEq)]
pub struct Fill {
    /// Close narrow gaps with the scans at voxels 2, 4 and 8 times as large.
    pub coarser: bool,
    /// A mesh, in coordinates of the survey, which is used where there are no scans.
    pub mesh: Option<PathBuf>,
    /// Close holes by diffusing positions, colours and intensities from their rims.
    pub diffuse: bool,
    /// Only holes up to this area, square metres.
    pub max_area: f64,
    /// Close everything, whatever its cause and area.
    pub watertight: bool,
}

impl Fill {
    /// The default of `max_area`, square metres.
    pub const MAX_AREA: f64 = 1.0;

    /// Levels of coarser voxels.
    const LEVELS: u32 = 3;

    /// Whether anything is filled.
    pub fn is_any(&self) -> bool {
        self.diffuse || self.watertight || self.is_backed()
    }

    /// Whether the field has a backing. A mesh needs coarser voxels, too, to know where scans have measured the surface already.
    pub(super) fn is_backed(&self) -> bool {
        self.coarser || self.mesh.is_some()
    }

    /// How many levels of coarser voxels there are.
    pub(super) fn levels(&self) -> u32 {
        if self.is_backed() { Self::LEVELS } else { 0 }
    }

    /// How far around a tile pieces matter, voxels.
    pub(super) fn margin(&self) -> i32 {
        MARGIN << self.levels()
    }
}

impl Default for Fill {
    fn default() -> Self {
        Self { coarser: false, mesh: None, diffuse: false, max_area: Self::MAX_AREA, watertight: false }
    }
}

/// What was filled. Areas are those of the holes, square metres.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Filled {
    /// Holes that were filled.
    pub holes: usize,
    /// Their area.
    pub area: f64,
    /// Area of the surface that was added from the mesh.
    pub mesh_area: f64,
    /// Holes left open because coarser voxels or the mesh did not close them, and no membrane was asked for.
    pub unclosed: usize,
    /// Their area.
    pub unclosed_area: f64,
    /// Islands of surface inside filled holes that were joined to the filling.
    pub islands: usize,
    /// Openings, which were left open.
    pub openings: usize,
    /// Holes left open because they are larger than the limit.
    pub larger: usize,
    /// Their area.
    pub larger_area: f64,
    /// Holes left open because their rims are folded: the projected rim crosses itself.
    pub folded: usize,
    /// Their area.
    pub folded_area: f64,
    /// Loops, of holes and outer edges, closed without regard to shape, to make the surface watertight.
    pub closed: usize,
    /// Triangles added.
    pub triangles: u64,
}

/// Fills the holes of a surface.
pub(super) struct Filler<'a, 'j, 's> {
    pub(super) fill: &'a Fill,
    /// Metres.
    pub(super) voxel: f64,
    /// A box that holds everything, metres.
    pub(super) bounds: [DVec3; 2],
    pub(super) stations: &'a [Station<'a>],
    pub(super) joined: &'j mut Joined<'s>,
}

impl Filler<'_, '_, '_> {
    /// Fill the holes among `loops`; each that was filled is marked in `borders`.
    pub(super) fn run(
        &mut self,
        loops: &[Vec<RimVertex>],
        borders: &mut Borders,
        progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
    ) -> Result<Filled, ScanError> {
        let mut filled = Filled::default();
        let before = self.joined.counts()[1];
        let held = self.joined.begin_filling();
        if self.fill.is_backed() {
            self.backed(&held, &mut filled, progress)?;
            drop(held);
            // What is left may be parts of holes.
            let loops = self.joined.rims().loops();
            let left = holes::borders(&loops, self.stations, 2.0 * self.voxel, progress)?;
            self.fill_holes(&loops, &left, &mut filled, progress)?;
        } else {
            self.fill_holes(loops, borders, &mut filled, progress)?;
        }
        if self.fill.watertight {
            filled.closed = self.close()?;
            (filled.folded, filled.folded_area) = (0, 0.0);
        }
        for hole in &mut borders.holes {
            hole.filled = self.closed_by(&loops[hole.rim_number]);
            filled.holes += usize::from(hole.filled.is_some());
            filled.area += hole.filled.map_or(0.0, |_| hole.area);
        }
        filled.triangles = self.joined.counts()[1] - before;
        Ok(filled)
    }

    /// Fill the holes of the present surface by membranes, if that was asked for, and count those that stay open.
    fn fill_holes(
        &mut self,
        loops: &[Vec<RimVertex>],
        borders: &Borders,
        filled: &mut Filled,
        progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let mut is_open = vec![true; loops.len()];
        let islands = Islands::new(loops, borders);
        let Fill { diffuse, watertight, max_area, .. } = *self.fill;
        for (number, hole) in borders.holes.iter().enumerate() {
            progress(number as u64, borders.holes.len() as u64)?;
            if hole.cause() == Cause::Free && !watertight {
                filled.openings += 1;
                continue;
            }
            if hole.area > max_area && !watertight {
                filled.larger += 1;
                filled.larger_area += hole.area;
                continue;
            }
            if !diffuse && !watertight {
                filled.unclosed += 1;
                filled.unclosed_area += hole.area;
                continue;
            }
            let own = &loops[hole.rim_number];
            let inside = islands.inside(own, self.voxel, &is_open);
            let mut rims = vec![own.as_slice()];
            rims.extend(inside.iter().map(|k| loops[*k].as_slice()));
            let Some(joined) = self.diffuse(&rims, Source::Diffused)? else {
                filled.folded += 1;
                filled.folded_area += hole.area;
                continue;
            };
            inside[..joined].iter().for_each(|k| is_open[*k] = false);
            filled.islands += joined;
        }
        Ok(())
    }

    /// What closed all edges of a loop.
    fn closed_by(&self, rim: &[RimVertex]) -> Option<Source> {
        sides(rim).map(|side| self.joined.closed_by(side)).reduce(|a, b| Some(a?.max(b?))).flatten()
    }

    /// Close the first loop, with the others as islands; returns the number of islands that were joined, or `None` if it cannot be closed.
    fn diffuse(&mut self, rims: &[&[RimVertex]], source: Source) -> Result<Option<usize>, ScanError> {
        for passes in collar::passes(rims[0].len()) {
            // Islands can be in the way.
            for rims in [rims, &rims[..1]].into_iter().take(rims.len()) {
                let collars: Vec<Collar> = rims.iter().map(|rim| Collar::new(rim, passes)).collect();
                let inner: Vec<&[RimVertex]> = collars.iter().map(|collar| collar.inner.as_slice()).collect();
                // What comes from the measured surface is as it is; a collar must not have vertices in one place.
                let nearest = Nearest { distance: self.voxel * NEAREST, checks_rims: passes > 0 };
                let Some(made) = membrane(&inner, self.voxel, nearest) else { continue };
                if passes == 0 {
                    self.add(rims, &made, source)?;
                } else {
                    let inner = self.collars(rims, collars, source)?;
                    let inner: Vec<&[RimVertex]> = inner.iter().map(Vec::as_slice).collect();
                    self.add(&inner, &made, source)?;
                }
                return Ok(Some(rims.len() - 1));
            }
        }
        Ok(None)
    }

    /// Add a membrane to the surface.
    fn add(&mut self, rims: &[&[RimVertex]], made: &Membrane, source: Source) -> Result<(), ScanError> {
        let mut numbers: Vec<u64> = rims.iter().flat_map(|rim| rim.iter().map(|vertex| vertex.number)).collect();
        for vertex in &made.vertices {
            numbers.push(self.vertex(vertex, source)?);
        }
        for triangle in &made.triangles {
            self.joined.triangle(triangle.map(|k| numbers[k as usize]), source)?;
        }
        Ok(())
    }

    fn vertex(&mut self, vertex: &membrane::Vertex, source: Source) -> Result<u64, ScanError> {
        self.joined.vertex(&MergedVertex {
            vertex: MeshVertex {
                position: vertex.position.clamp(self.bounds[0], self.bounds[1]),
                normal: vertex.normal,
                color: vertex.color,
                intensity: vertex.intensity,
                confidence: 0.0,
            },
            stations: 0,
            registration: None,
            source,
        })
    }
}

/// The loops around parts of the surface, to be found by place.
struct Islands<'l> {
    loops: &'l [Vec<RimVertex>],
    /// Number of the loop, and its box, sorted by the least x.
    boxes: Vec<(usize, [DVec3; 2])>,
}

impl<'l> Islands<'l> {
    fn new(loops: &'l [Vec<RimVertex>], borders: &Borders) -> Self {
        let mut is_hole = vec![false; loops.len()];
        borders.holes.iter().for_each(|hole| is_hole[hole.rim_number] = true);
        let mut boxes: Vec<_> = (0..loops.len()).filter(|k| !is_hole[*k]).map(|k| (k, box_of(&loops[k]))).collect();
        boxes.sort_by(|a, b| a.1[0].x.total_cmp(&b.1[0].x).then(a.0.cmp(&b.0)));
        Self { loops, boxes }
    }

    /// The islands in the box of a rim whose surface lies near that of the rim.
    fn inside(&self, rim: &[RimVertex], voxel: f64, is_open: &[bool]) -> Vec<usize> {
        let [low, high] = box_of(rim);
        let plane = membrane::plane(rim);
        let Some(normal) = plane else { return Vec::new() };
        let height = |vertex: &RimVertex| vertex.position.dot(normal);
        let range = |rim: &[RimVertex]| {
            rim.iter().map(height).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], h| [a.min(h), b.max(h)])
        };
        let [least, greatest] = range(rim);
        let from = self.boxes.partition_point(|(_, bounds)| bounds[0].x < low.x);
        let candidates = self.boxes[from..].iter().take_while(|(_, bounds)| bounds[0].x <= high.x);
        candidates
            .filter(|(k, bounds)| {
                let island = &self.loops[*k];
                let [bottom, top] = range(island);
                let faces: f64 = island.iter().map(|vertex| vertex.normal.dot(normal)).sum();
                is_open[*k]
                    && bounds[0].cmpge(low).all()
                    && bounds[1].cmple(high).all()
                    && bottom > least - 2.0 * voxel
                    && top < greatest + 2.0 * voxel
                    && faces > 0.5 * island.len() as f64
                    && membrane::surrounds(rim, normal, island[0].position)
            })
            .map(|(k, _)| *k)
            .collect()
    }
}

fn sides(rim: &[RimVertex]) -> impl Iterator<Item = [u64; 2]> {
    rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| [a.number, b.number])
}

fn box_of(rim: &[RimVertex]) -> [DVec3; 2] {
    rim.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], vertex| {
        [low.min(vertex.position), high.max(vertex.position)]
    })
}
