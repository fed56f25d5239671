//! The surfaces of bricks, joined into one mesh: vertices on edges shared by several bricks are delivered once.

use super::accuracy;
use super::fill::Held;
use super::piles::morton;
use super::rims::{RimVertex, Rims};
use super::{BEST_SIGMA, MergedSurface, MergedVertex, Scale, Source};
use crate::ScanError;
use crate::mesh::MeshVertex;
use glam::IVec3;
use kilwa_scan_core::tsdf::{BRICK, EdgeKey, Patch, PatchVertex};
use std::collections::{BTreeMap, HashMap};

/// Joins patches that come along the Morton curve.
pub(super) struct Joined<'s> {
    sink: &'s mut dyn MergedSurface,
    scale: Scale,
    /// Vertices that later bricks may share.
    shared: HashMap<EdgeKey, u64>,
    /// The same, by the Morton code of the last such brick.
    until: BTreeMap<u64, Vec<EdgeKey>>,
    vertices: u64,
    triangles: u64,
    rims: Rims,
    accuracy: accuracy::Sum,
    held: Held,
    /// While holes are filled: the vertices that can begin an open edge.
    around: HashMap<u64, RimVertex>,
    /// How many vertices there were before.
    measured: u64,
    /// What closed an edge that was open in the measured surface.
    closed: HashMap<[u64; 2], Source>,
}

impl<'s> Joined<'s> {
    pub(super) fn new(sink: &'s mut dyn MergedSurface, scale: Scale) -> Self {
        Self {
            sink,
            scale,
            shared: HashMap::new(),
            until: BTreeMap::new(),
            vertices: 0,
            triangles: 0,
            rims: Rims::default(),
            accuracy: accuracy::Sum::default(),
            held: Held::default(),
            around: HashMap::new(),
            measured: 0,
            closed: HashMap::new(),
        }
    }

    /// Vertices and triangles so far.
    pub(super) fn counts(&self) -> [u64; 2] {
        [self.vertices, self.triangles]
    }

    pub(super) fn scale(&self) -> Scale {
        self.scale
    }

    /// The edges that have one triangle.
    pub(super) fn rims(&self) -> &Rims {
        &self.rims
    }

    /// The accuracy of the measured surface.
    pub(super) fn accuracy(&self) -> &accuracy::Sum {
        &self.accuracy
    }

    /// What was held back. From now on, vertices and triangles are added that do not belong to bricks.
    pub(super) fn begin_filling(&mut self) -> Held {
        let held = std::mem::take(&mut self.held);
        self.measured = self.vertices;
        self.around = self.rims.vertices();
        for (key, number) in &held.numbers {
            let vertex = merged(&held.vertices[key], self.scale);
            self.around.entry(*number).or_insert_with(|| rim_vertex(*number, &vertex));
        }
        held
    }

    /// Add a vertex to fill holes; returns its number.
    pub(super) fn vertex(&mut self, vertex: &MergedVertex) -> Result<u64, ScanError> {
        self.sink.vertex(vertex)?;
        self.around.insert(self.vertices, rim_vertex(self.vertices, vertex));
        self.vertices += 1;
        Ok(self.vertices - 1)
    }

    /// Add a triangle to fill holes.
    pub(super) fn triangle(&mut self, corners: [u64; 3], source: Source) -> Result<(), ScanError> {
        self.sink.triangle(corners)?;
        self.triangles += 1;
        let [a, b, c] = corners;
        for [p, q] in [[a, b], [b, c], [c, a]] {
            if self.rims.toggle([p, q], || self.around[&p]) && p.max(q) < self.measured {
                self.closed.insert([q, p], source);
            }
        }
        Ok(())
    }

    /// What closed an edge, which begins and ends at these vertices.
    pub(super) fn closed_by(&self, edge: [u64; 2]) -> Option<Source> {
        self.closed.get(&edge).copied()
    }

    pub(super) fn patch(&mut self, brick: IVec3, patch: &Patch) -> Result<(), ScanError> {
        let here = morton(brick);
        // Forget vertices that no later brick can share.
        while let Some(entry) = self.until.first_entry().filter(|entry| *entry.key() < here) {
            for key in entry.remove() {
                self.shared.remove(&key);
            }
        }
        let mut numbers = Vec::with_capacity(patch.measured);
        for vertex in &patch.vertices[..patch.measured] {
            let number = match self.shared.get(&vertex.key) {
                Some(number) => *number,
                None => self.deliver(vertex, here)?,
            };
            numbers.push(number);
        }
        for triangle in &patch.triangles {
            self.sink.triangle(triangle.map(|k| numbers[k as usize]))?;
        }
        self.triangles += patch.triangles.len() as u64;
        self.accuracy.add(patch);
        if !patch.filled.is_empty() {
            self.held.add(patch, &numbers, &self.shared);
        }
        let scale = self.scale;
        self.rims.add(patch, &numbers, |p| scale.to_survey(p));
        Ok(())
    }

    fn deliver(&mut self, vertex: &PatchVertex, here: u64) -> Result<u64, ScanError> {
        let number = self.vertices;
        let last = last_brick(&vertex.key);
        if last > here {
            self.shared.insert(vertex.key, number);
            self.until.entry(last).or_default().push(vertex.key);
        }
        self.held.delivered(&vertex.key, number);
        self.sink.vertex(&merged(vertex, self.scale))?;
        self.vertices += 1;
        Ok(number)
    }
}

/// A vertex of a patch in the survey.
pub(super) fn merged(vertex: &PatchVertex, scale: Scale) -> MergedVertex {
    MergedVertex {
        vertex: MeshVertex {
            position: scale.to_survey(vertex.position),
            normal: vertex.normal,
            color: vertex.color,
            intensity: vertex.intensity.unwrap_or(f32::NAN),
            confidence: (vertex.quality / (BEST_SIGMA * BEST_SIGMA)) as f32,
        },
        stations: vertex.stations,
        registration: vertex.variance.map(|variance| accuracy::kept(variance.pose)),
        source: Source::Scans,
    }
}

fn rim_vertex(number: u64, vertex: &MergedVertex) -> RimVertex {
    let MeshVertex { position, normal, color, intensity, .. } = vertex.vertex;
    RimVertex { number, position, normal, color, intensity }
}

/// The greatest Morton code of the bricks that have a cell at the edge of a vertex.
fn last_brick(key: &EdgeKey) -> u64 {
    let at = IVec3::from_array(key.at);
    if key.axis > 2 {
        return morton(at.div_euclid(IVec3::splat(BRICK)));
    }
    let mut others =
        [IVec3::X, IVec3::Y, IVec3::Z].into_iter().enumerate().filter(|(axis, _)| *axis != usize::from(key.axis));
    let (a, b) = (others.next().map_or(IVec3::ZERO, |o| o.1), others.next().map_or(IVec3::ZERO, |o| o.1));
    let cells = [at, at - a, at - b, at - a - b];
    cells.map(|cell| morton(cell.div_euclid(IVec3::splat(BRICK)))).into_iter().max().unwrap_or_default()
}
