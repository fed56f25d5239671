//! Faces of files that have polygons: triangles are handed on in blocks, polygons are cut, what cannot be kept is counted.
//!
//! Input: corners as vertex numbers; the vertices of polygons must have been delivered, because cutting needs positions,
//! which the sink is asked for a block at a time. Nothing here grows with the mesh. What is dropped is counted under the
//! number of its face or line.

use super::ReadError;
use super::sink::{MeshSink, NOT_FINITE, TWICE};
use crate::Diagnostics;
use glam::DVec3;
use kilwa_geometry::triangulate::{Outcome, Triangulator};

pub(super) const TOO_FEW: &str = "faces of fewer than three corners dropped";
pub(super) const JOINTS: &str = "empty triangles that join strips dropped";
pub(super) const TRIANGULATED: &str = "polygons triangulated";
pub(super) const REPEATED: &str = "corners of polygons that repeat the one before dropped";
pub(super) const CROSSING: &str = "polygons that cross themselves, triangulated as far as they can be";

/// Corners of a polygon: beyond this, triangulating could take for ever, and a scan has none such.
pub(super) const MAX_CORNERS: usize = 10_000;

/// Triangles handed on at a time.
const BLOCK: usize = 8192;
/// Corners of polygons that wait at a time.
const WAITING: usize = 1 << 16;

/// The colour of a face, where it has one of its own.
pub(super) type FaceColor = Option<[u8; 3]>;

/// Collects the faces of one input.
pub(super) struct Faces {
    /// What numbers of faces count: "face" or "line".
    noun: &'static str,
    triangles: Vec<[u64; 3]>,
    /// Empty, or the colour of each triangle.
    colors: Vec<[u8; 3]>,
    /// Polygons that wait for their positions: number, colour, number of corners; and all their corners.
    waiting: Vec<(u64, FaceColor, usize)>,
    corners: Vec<u64>,
    positions: Vec<DVec3>,
    triangulator: Triangulator,
    delivered: u64,
}

impl Faces {
    pub(super) fn new(noun: &'static str) -> Self {
        Self {
            noun,
            triangles: Vec::with_capacity(BLOCK),
            colors: Vec::new(),
            waiting: Vec::new(),
            corners: Vec::new(),
            positions: Vec::new(),
            triangulator: Triangulator::default(),
            delivered: 0,
        }
    }

    /// One face as the file has it. [`flush_if_full`](Self::flush_if_full) is to be called after it.
    #[inline]
    pub(super) fn face(&mut self, corners: &[u64], color: FaceColor, number: u64, diagnostics: &mut Diagnostics) {
        match *corners {
            [a, b, c] => self.triangle([a, b, c], color, number, diagnostics),
            [] | [_] | [_, _] => diagnostics.add(TOO_FEW, || format!("{} {number}", self.noun)),
            _ => {
                let before = self.corners.len();
                for &corner in corners {
                    if self.corners[before..].last() != Some(&corner) {
                        self.corners.push(corner);
                    }
                }
                while self.corners.len() > before + 1 && self.corners.last() == self.corners.get(before) {
                    self.corners.pop();
                }
                let left = self.corners.len() - before;
                if left < corners.len() {
                    diagnostics.add(REPEATED, || format!("{} {number}", self.noun));
                    diagnostics.add_many(REPEATED, (corners.len() - left) as u64 - 1);
                }
                if left < 3 {
                    diagnostics.add(TOO_FEW, || format!("{} {number}", self.noun));
                    self.corners.truncate(before);
                } else {
                    self.waiting.push((number, color, left));
                }
            }
        }
    }

    /// Begin a triangle strip.
    pub(super) fn strip(&mut self) -> Strip<'_> {
        Strip { faces: self, last: [0; 2], held: 0, odd: false }
    }

    /// Where whole blocks of triangles go that are known to be sound, and how many there is room for.
    pub(super) fn sound_triangles(&mut self) -> (&mut Vec<[u64; 3]>, usize) {
        let room = if self.colors.is_empty() { BLOCK.saturating_sub(self.triangles.len()) } else { 0 };
        (&mut self.triangles, room)
    }

    /// Hand on what is collected where that is much. All vertices read so far must have been delivered.
    #[inline]
    pub(super) fn flush_if_full(
        &mut self,
        sink: &mut dyn MeshSink,
        diagnostics: &mut Diagnostics,
    ) -> Result<(), ReadError> {
        if self.is_full() { self.flush(sink, diagnostics) } else { Ok(()) }
    }

    /// Whether much is collected.
    #[inline]
    pub(super) fn is_full(&self) -> bool {
        self.triangles.len() >= BLOCK || self.corners.len() >= WAITING
    }

    /// Hand on all that is collected. All vertices read so far must have been delivered.
    pub(super) fn flush(&mut self, sink: &mut dyn MeshSink, diagnostics: &mut Diagnostics) -> Result<(), ReadError> {
        self.hand_on(sink)?;
        if self.waiting.is_empty() {
            return Ok(());
        }
        self.positions.clear();
        sink.positions(&self.corners, &mut self.positions)?;
        let corners = std::mem::take(&mut self.corners);
        let positions = std::mem::take(&mut self.positions);
        let mut at = 0;
        for (number, color, n) in std::mem::take(&mut self.waiting) {
            self.polygon(&corners[at..at + n], &positions[at..at + n], color, number, diagnostics);
            at += n;
            if self.triangles.len() >= BLOCK {
                self.hand_on(sink)?;
            }
        }
        (self.corners, self.positions) = (corners, positions);
        self.corners.clear();
        self.hand_on(sink)
    }

    /// Triangles handed on so far.
    pub(super) fn delivered(&self) -> u64 {
        self.delivered
    }

    fn hand_on(&mut self, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
        if !self.triangles.is_empty() {
            sink.triangles(&self.triangles, &self.colors)?;
            self.delivered += self.triangles.len() as u64;
            self.triangles.clear();
            self.colors.clear();
        }
        Ok(())
    }

    #[inline]
    fn triangle(&mut self, corners: [u64; 3], color: FaceColor, number: u64, diagnostics: &mut Diagnostics) {
        if is_degenerate(corners) {
            diagnostics.add(TWICE, || format!("{} {number}", self.noun));
            return;
        }
        self.triangles.push(corners);
        self.colors.extend(color);
    }

    fn polygon(
        &mut self,
        corners: &[u64],
        positions: &[DVec3],
        color: FaceColor,
        number: u64,
        diagnostics: &mut Diagnostics,
    ) {
        let noun = self.noun;
        let place = || format!("{noun} {number}");
        if !positions.iter().all(|p| p.is_finite()) {
            diagnostics.add(NOT_FINITE, place);
            diagnostics.add_many(NOT_FINITE, corners.len() as u64 - 3);
            return;
        }
        diagnostics.add(TRIANGULATED, place);
        let mut triangulator = std::mem::take(&mut self.triangulator);
        let outcome =
            triangulator.polygon(positions, |t| self.triangle(t.map(|i| corners[i]), color, number, diagnostics));
        if outcome == Outcome::Crossing {
            diagnostics.add(CROSSING, place);
        }
        self.triangulator = triangulator;
    }
}

/// A strip in the making: each corner after the second makes a triangle with the two before it, every other one turned
/// round. The empty triangles by which stripifiers move without a restart are dropped and counted.
pub(super) struct Strip<'f> {
    faces: &'f mut Faces,
    last: [u64; 2],
    held: u8,
    odd: bool,
}

impl Strip<'_> {
    /// The next corner.
    #[inline]
    pub(super) fn corner(
        &mut self,
        corner: u64,
        sink: &mut dyn MeshSink,
        diagnostics: &mut Diagnostics,
    ) -> Result<(), ReadError> {
        let [a, b] = self.last;
        self.last = [b, corner];
        if self.held < 2 {
            self.held += 1;
            return Ok(());
        }
        let corners = if self.odd { [b, a, corner] } else { [a, b, corner] };
        self.odd = !self.odd;
        if is_degenerate(corners) {
            diagnostics.add_many(JOINTS, 1);
            Ok(())
        } else {
            self.faces.triangles.push(corners);
            self.faces.flush_if_full(sink, diagnostics)
        }
    }

    /// What comes is a new strip.
    pub(super) fn restart(&mut self) {
        self.held = 0;
        self.odd = false;
    }
}

fn is_degenerate([a, b, c]: [u64; 3]) -> bool {
    a == b || b == c || c == a
}
