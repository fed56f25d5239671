//! Decodes the triangles from CLERS codes of a front that grows over the surface, and finds the vertices that predict each vertex.
//!
//! The front is a set of loops of directed edges. Each code states what lies beyond the current edge: a new vertex, the vertex
//! of the previous or the next edge of the loop, a known vertex, or nothing; or it delays the edge.

use super::super::bytes::{Cursor, Fault};
use super::bits::Bits;
use super::tunstall::Entropy;
use std::collections::VecDeque;

const VERTEX: u8 = 0;
const LEFT: u8 = 1;
const RIGHT: u8 = 2;
const END: u8 = 3;
const BOUNDARY: u8 = 4;
const DELAY: u8 = 5;
const SPLIT: u8 = 6;

/// A generous upper limit of the codes per triangle: one for itself, and for each of its edges one for a boundary and one
/// for a delay.
const CODES_PER_FACE: usize = 16;

/// The decoded triangles.
#[derive(Debug)]
pub(super) struct Topology {
    pub(super) faces: Vec<[u32; 3]>,
    /// For each vertex, three earlier vertices a, b and c: it is predicted by a, or by a + b - c. Meaningless for the first vertex.
    pub(super) predictions: Vec<[u32; 3]>,
}

/// An edge of the front.
#[derive(Debug, Clone, Copy)]
struct Edge {
    from: u32,
    to: u32,
    /// The third vertex of its triangle.
    behind: u32,
    previous: usize,
    next: usize,
    removed: bool,
}

struct Decoder<'b> {
    codes: std::vec::IntoIter<u8>,
    bits: Bits<'b>,
    vertices: u32,
    /// Bits of a vertex index.
    width: usize,
    topology: Topology,
    front: Vec<Edge>,
    waiting: VecDeque<usize>,
    delayed: Vec<usize>,
    /// Offset of the codes in the file.
    at: u64,
}

impl Topology {
    /// Decode the triangles of the groups that end at `ends`, the last of which is the total number of triangles.
    pub(super) fn decode(from: &mut Cursor<'_>, entropy: Entropy, vertices: u32, ends: &[u32]) -> Result<Self, Fault> {
        let faces = ends.last().copied().unwrap_or(0) as usize;
        from.u32("the size of the front")?;
        let at = from.offset();
        let codes = entropy.symbols(from, CODES_PER_FACE * (faces + 1))?.into_iter();
        let bits = Bits::open(from)?;
        let width = vertices.checked_ilog2().unwrap_or(0) as usize + 1;
        let topology = Self { faces: Vec::new(), predictions: Vec::new() };
        let (front, waiting, delayed) = (Vec::new(), VecDeque::new(), Vec::new());
        let mut decoder = Decoder { codes, bits, vertices, width, topology, front, waiting, delayed, at };
        for &end in ends {
            decoder.group(end as usize)?;
        }
        let mut topology = decoder.topology;
        // Unused vertices.
        topology.predictions.resize(vertices as usize, [0; 3]);
        Ok(topology)
    }
}

impl Decoder<'_> {
    fn damaged(&self, found: impl Into<String>, expected: &str) -> Fault {
        let expected = format!("{expected}; the file is damaged: copy it again");
        Fault { at: self.at, found: found.into(), expected }
    }

    fn code(&mut self) -> Result<u8, Fault> {
        let none = self.damaged("the end of the triangle codes", "another code");
        self.codes.next().ok_or(none)
    }

    /// Decode triangles until there are `end`. Each group starts with an empty front.
    fn group(&mut self, end: usize) -> Result<(), Fault> {
        self.front.clear();
        self.waiting.clear();
        self.delayed.clear();
        let mut made = None;
        while self.topology.faces.len() < end {
            let next = made.take().or_else(|| self.waiting.pop_front()).or_else(|| self.delayed.pop());
            match next {
                None => self.first_face()?,
                Some(edge) if self.front[edge].removed => {}
                Some(edge) => made = self.decode_edge(edge)?,
            }
        }
        Ok(())
    }

    /// The next new vertex.
    fn new_vertex(&mut self, prediction: [u32; 3]) -> Result<u32, Fault> {
        let vertex = self.topology.predictions.len() as u32;
        if vertex >= self.vertices {
            let found = format!("more than {} vertices", self.vertices);
            return Err(self.damaged(found, "as many as in the header"));
        }
        self.topology.predictions.push(prediction);
        Ok(vertex)
    }

    /// A vertex that is already known.
    fn old_vertex(&mut self) -> Result<u32, Fault> {
        let vertex = self.bits.read(self.width)?;
        if vertex as usize >= self.topology.predictions.len() {
            return Err(self.damaged(format!("vertex {vertex}"), "a vertex that is already known"));
        }
        Ok(vertex)
    }

    /// Begin a new component.
    fn first_face(&mut self) -> Result<(), Fault> {
        let old = if self.code()? == SPLIT { self.bits.read(3)? } else { 0 };
        let mut near = self.topology.predictions.len().saturating_sub(1) as u32;
        let mut corners = [0; 3];
        for (k, corner) in corners.iter_mut().enumerate() {
            if old >> k & 1 == 1 {
                *corner = self.old_vertex()?;
            } else {
                *corner = self.new_vertex([near; 3])?;
                near = *corner;
            }
        }
        self.topology.faces.push(corners);
        let first = self.front.len();
        for k in 0..3 {
            let [from, to, behind] = [1, 2, 0].map(|i| corners[(k + i) % 3]);
            let (previous, next) = (first + (k + 2) % 3, first + (k + 1) % 3);
            self.waiting.push_back(first + k);
            self.front.push(Edge { from, to, behind, previous, next, removed: false });
        }
        Ok(())
    }

    /// Decode what lies beyond an edge; returns the edge to continue with, if the code creates one.
    fn decode_edge(&mut self, index: usize) -> Result<Option<usize>, Fault> {
        let code = self.code()?;
        let Edge { from, to, behind, previous, next, .. } = self.front[index];
        let new = self.front.len();
        let edge = |from, to, behind, previous, next| Edge { from, to, behind, previous, next, removed: false };
        let (opposite, made) = match code {
            BOUNDARY => return Ok(None),
            DELAY => {
                self.delayed.push(index);
                return Ok(None);
            }
            VERTEX | SPLIT => {
                let opposite = if code == SPLIT { self.old_vertex()? } else { self.new_vertex([to, from, behind])? };
                self.front[previous].next = new;
                self.front[next].previous = new + 1;
                self.front.push(edge(from, opposite, to, previous, new + 1));
                self.front.push(edge(opposite, to, from, new, next));
                self.waiting.push_back(new + 1);
                (opposite, Some(new))
            }
            LEFT => {
                let Edge { from: opposite, previous: before, .. } = self.front[previous];
                self.front[previous].removed = true;
                self.front[before].next = new;
                self.front[next].previous = new;
                self.front.push(edge(opposite, to, from, before, next));
                (opposite, Some(new))
            }
            RIGHT => {
                let Edge { to: opposite, next: after, .. } = self.front[next];
                self.front[next].removed = true;
                self.front[after].previous = new;
                self.front[previous].next = new;
                self.front.push(edge(from, opposite, to, previous, after));
                (opposite, Some(new))
            }
            END => {
                let Edge { from: opposite, previous: before, .. } = self.front[previous];
                let after = self.front[next].next;
                self.front[previous].removed = true;
                self.front[next].removed = true;
                self.front[before].next = after;
                self.front[after].previous = before;
                (opposite, None)
            }
            other => return Err(self.damaged(format!("triangle code {other}"), "one of 0 to 6")),
        };
        self.topology.faces.push([to, from, opposite]);
        Ok(made)
    }
}
