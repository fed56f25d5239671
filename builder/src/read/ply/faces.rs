//! Collects triangles from faces and strips.
//!
//! Input: corners that are all below the number of vertices. Polygons that come before the vertices wait for them,
//! because cutting needs positions. What is dropped is counted in the findings under the number of its face.

use super::ReadError;
use super::plan::Plan;
use super::scalar::Scalar;
use super::triangulate::{Outcome, Triangulator};
use crate::raw::Findings;
use std::path::Path;

pub(super) const TOO_FEW: &str = "faces of fewer than three corners dropped";
pub(super) const TWICE: &str = "triangles that name a vertex twice dropped";
pub(super) const NOT_FINITE: &str = "triangles dropped because a corner has no finite position";
pub(super) const JOINTS: &str = "empty triangles that join strips dropped";
pub(super) const TRIANGULATED: &str = "polygons triangulated";
const REPEATED: &str = "corners of polygons that repeat the one before dropped";
const CROSSING: &str = "polygons that cross themselves, triangulated as far as they can be";

/// Colours of triangles as the file has them.
pub(super) struct FaceColors {
    pub(super) raw: Vec<[f32; 3]>,
    pub(super) kind: Scalar,
}

pub(super) struct Faces {
    vertices: u64,
    triangles: Vec<[u32; 3]>,
    /// A colour per triangle, where the faces have the colours of the mesh.
    colors: Option<FaceColors>,
    /// Whether polygons must wait for the vertices.
    early: bool,
    /// Polygons that wait: number, colour, number of corners; and all their corners.
    waiting: Vec<(u64, [f32; 3], usize)>,
    waiting_corners: Vec<u32>,
    triangulator: Triangulator,
    /// Corners of the polygon in hand.
    scratch: Vec<u32>,
}

impl Faces {
    /// Room for the declared faces as far as `remaining` bytes can hold them.
    pub(super) fn new(plan: &Plan, path: &Path, remaining: u64) -> Result<Self, ReadError> {
        let expected = plan.faces.min(remaining / plan.triangle_bytes);
        let mut triangles = Vec::new();
        let reserved = usize::try_from(expected).ok().and_then(|n| triangles.try_reserve_exact(n).ok());
        reserved.ok_or_else(|| ReadError::TooLarge {
            file: path.to_owned(),
            what: format!("no memory for {expected} triangles: split the file into blocks"),
        })?;
        Ok(Self {
            vertices: plan.vertices,
            triangles,
            colors: plan.face_colors.map(|kind| FaceColors { raw: Vec::new(), kind }),
            early: true,
            waiting: Vec::new(),
            waiting_corners: Vec::new(),
            triangulator: Triangulator::default(),
            scratch: Vec::new(),
        })
    }

    /// How many vertices the file has; indices are below.
    pub(super) fn vertices(&self) -> u64 {
        self.vertices
    }

    /// One face as the file has it.
    #[inline]
    pub(super) fn face(
        &mut self,
        corners: &[u32],
        color: [f32; 3],
        number: u64,
        positions: &[[f64; 3]],
        findings: &mut Findings,
    ) {
        match *corners {
            [a, b, c] => self.triangle([a, b, c], color, number, findings),
            [] | [_] | [_, _] => findings.add(TOO_FEW, || format!("face {number}")),
            _ if self.early => {
                self.waiting.push((number, color, corners.len()));
                self.waiting_corners.extend(corners);
            }
            _ => self.polygon(corners, color, number, positions, findings),
        }
    }

    /// Cut the polygons that had to wait.
    pub(super) fn vertices_are_read(&mut self, positions: &[[f64; 3]], findings: &mut Findings) {
        self.early = false;
        let corners = std::mem::take(&mut self.waiting_corners);
        let mut rest = corners.as_slice();
        for (number, color, n) in std::mem::take(&mut self.waiting) {
            let (these, others) = rest.split_at(n);
            rest = others;
            self.polygon(these, color, number, positions, findings);
        }
    }

    /// Begin a triangle strip.
    pub(super) fn strip(&mut self) -> Strip<'_> {
        Strip { faces: self, last: [0; 2], held: 0, odd: false }
    }

    /// All triangles, and a colour for each where the faces have the colours.
    pub(super) fn into_triangles(self) -> (Vec<[u32; 3]>, Option<FaceColors>) {
        (self.triangles, self.colors)
    }

    #[inline]
    fn triangle(&mut self, corners: [u32; 3], color: [f32; 3], number: u64, findings: &mut Findings) {
        if is_degenerate(corners) {
            findings.add(TWICE, || format!("face {number}"));
            return;
        }
        self.triangles.push(corners);
        if let Some(colors) = &mut self.colors {
            colors.raw.push(color);
        }
    }

    fn polygon(
        &mut self,
        corners: &[u32],
        color: [f32; 3],
        number: u64,
        positions: &[[f64; 3]],
        findings: &mut Findings,
    ) {
        let place = || format!("face {number}");
        let mut ring = std::mem::take(&mut self.scratch);
        ring.clear();
        ring.extend(corners);
        ring.dedup();
        while ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
        if ring.len() < corners.len() {
            findings.add(REPEATED, place);
            findings.add_many(REPEATED, (corners.len() - ring.len()) as u64 - 1);
        }
        if ring.len() < 3 {
            findings.add(TOO_FEW, place);
        } else if ring.iter().any(|&c| !positions[c as usize].iter().all(|v| v.is_finite())) {
            findings.add(NOT_FINITE, place);
            findings.add_many(NOT_FINITE, ring.len() as u64 - 3);
        } else {
            findings.add(TRIANGULATED, place);
            let mut triangulator = std::mem::take(&mut self.triangulator);
            let outcome =
                triangulator.polygon(&ring, positions, |corners| self.triangle(corners, color, number, findings));
            if outcome == Outcome::Crossing {
                findings.add(CROSSING, place);
            }
            self.triangulator = triangulator;
        }
        self.scratch = ring;
    }
}

/// A strip in the making: each corner after the second makes a triangle with the two before it, every other one turned
/// round. The empty triangles by which stripifiers move without a restart are dropped and counted.
pub(super) struct Strip<'f> {
    faces: &'f mut Faces,
    last: [u32; 2],
    held: u8,
    odd: bool,
}

impl Strip<'_> {
    #[inline]
    pub(super) fn corner(&mut self, corner: u32, findings: &mut Findings) {
        let [a, b] = self.last;
        self.last = [b, corner];
        if self.held < 2 {
            self.held += 1;
            return;
        }
        let corners = if self.odd { [b, a, corner] } else { [a, b, corner] };
        self.odd = !self.odd;
        if is_degenerate(corners) {
            findings.add_many(JOINTS, 1);
        } else {
            self.faces.triangles.push(corners);
        }
    }

    pub(super) fn restart(&mut self) {
        self.held = 0;
        self.odd = false;
    }
}

fn is_degenerate([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}
