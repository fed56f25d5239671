//! What every reader yields: an indexed mesh as the file has it, before anything is snapped or welded.

use crate::Diagnostics;
use glam::{DVec3, Vec3};

/// An indexed triangle mesh in source units and axes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RawMesh {
    /// Positions, finite, in the file's own units and axes.
    pub positions: Vec<DVec3>,
    /// sRGB colours, one per vertex, or empty where the file has none.
    pub colors: Vec<[u8; 3]>,
    /// Normals as given (not normalised), one per vertex, or empty.
    pub normals: Vec<Vec3>,
    /// Further scalar channels: name and one value per vertex.
    pub scalars: Vec<(String, Vec<f32>)>,
    /// Vertex indices, all below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
    /// What was found and done while reading.
    pub diagnostics: Diagnostics,
}

/// The grey of a vertex whose file has no colours, where others have.
pub const UNCOLOURED: [u8; 3] = [200, 196, 188];

impl RawMesh {
    /// Join another mesh to this one. Where only one of them has colours or scalars, the vertices of the other get a
    /// neutral grey or 0, counted; where only one has normals, the given normals are dropped and recomputed, counted.
    pub fn append(&mut self, mut other: Self) {
        let (mine, theirs) = (self.positions.len(), other.positions.len());
        if self.colors.is_empty() != other.colors.is_empty() {
            let n = if self.colors.is_empty() { mine } else { theirs };
            self.diagnostics.add_many("vertices without colour beside coloured ones, shown grey", n as u64);
            self.colors.resize(mine, UNCOLOURED);
            other.colors.resize(theirs, UNCOLOURED);
        }
        self.colors.append(&mut other.colors);
        if self.normals.is_empty() == other.normals.is_empty() {
            self.normals.append(&mut other.normals);
        } else {
            let n = self.normals.len() + other.normals.len();
            self.diagnostics.add_many("normals dropped and computed anew, because other files have none", n as u64);
            self.normals.clear();
        }
        for (name, values) in &mut self.scalars {
            if let Some((_, more)) = other.scalars.iter_mut().find(|s| s.0 == *name) {
                values.append(more);
            } else {
                self.diagnostics.add_many("vertices without a scalar that other files have, set to 0", theirs as u64);
                values.resize(mine + theirs, 0.0);
            }
        }
        for (name, values) in other.scalars {
            if !self.scalars.iter().any(|s| s.0 == name) {
                self.diagnostics.add_many("vertices without a scalar that other files have, set to 0", mine as u64);
                let mut all = vec![0.0; mine];
                all.extend(values);
                self.scalars.push((name, all));
            }
        }
        let base = mine as u32;
        self.positions.append(&mut other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + base)));
        self.diagnostics.merge(other.diagnostics);
    }
}
