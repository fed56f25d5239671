//! The triangles of a cut, chunk by chunk, and their vertices, each once, without holding the model.
//!
//! Chunks are taken in the order in which a plane sweeps along the longest side of the model: by the smallest coordinate
//! of their boxes. A vertex that lies before the plane cannot come again, because every later chunk begins behind it; so
//! what is known of it is forgotten. What stays in memory is what lies in the chunks that the plane cuts, and where the cut is
//! simplified further, a window of triangles behind the plane (`reduce`).

use super::ExtractError;
use super::Repaint;
use super::choose::{Chosen, stretches};
use super::format::Encoder;
use super::output::Scratch;
use super::reduce::{Piece, Reducer};
use super::region::Steps;
use kilwa_geometry::{LatticePoint, Mesh};
use kilwa_pack::{Chunk, Reader, Source};
use rayon::prelude::*;
use std::collections::HashMap;
use std::io::Write;

/// Chunks decoded at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 32;
/// Forgetting is worth while from so many vertices on.
const FORGET_FROM: usize = 1 << 16;

/// All that makes a vertex: position, colour, normal, bits of the scalars.
type Wedge = (LatticePoint, [u8; 3], [i16; 2], Box<[u32]>);

/// What was written.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub(super) vertices: u64,
    pub(super) triangles: u64,
    /// Certified error in metres, against the finest surface.
    pub(super) error: f32,
}

/// Where chunks come from.
pub(super) struct Chunks<'a, S> {
    pub(super) reader: &'a Reader<S>,
    /// Changes their vertices.
    pub(super) repaint: Option<&'a dyn Repaint>,
}

impl<S: Source> Chunks<'_, S> {
    fn get(&self, number: u32) -> Result<Chunk, ExtractError> {
        let mut chunk = self.reader.chunk(number)?;
        if let Some(repaint) = self.repaint {
            repaint.repaint(number, &mut chunk).map_err(ExtractError::Repaint)?;
        }
        Ok(chunk)
    }
}

/// Write the vertices and the triangles of the cut to the scratch files; `progress` is called with chunks done and chunks in all.
pub(super) fn stream<S: Source + Sync>(
    chunks: &Chunks<'_, S>,
    chosen: &Chosen,
    region: Option<&Steps>,
    encoder: &mut dyn Encoder,
    scratch: &mut Scratch,
    progress: &dyn Fn(u64, u64),
) -> Result<Counts, ExtractError> {
    let reader = chunks.reader;
    let axis = longest_side(reader);
    let order = in_order(reader, chosen, region, axis);
    progress(0, order.len() as u64);
    let mut done = 0;
    let counts = Counts { error: chosen.error, ..Counts::default() };
    let is_of_points = reader.header().is_of_points();
    let as_points = is_of_points && encoder.writes_points();
    let mut weld = Weld { axis, known: HashMap::new(), kept: 0, counts, bytes: Vec::new(), encoder, scratch };
    let mut reducer = chosen.reduction.map(|reduction| {
        weld.counts.error = 0.0;
        Reducer::new(reader, reduction, axis, region.is_some())
    });
    for batch in order.chunks(BATCH) {
        reader.source().expect(&stretches(reader, batch));
        let decoded: Vec<Result<Chunk, ExtractError>> = batch.par_iter().map(|&i| chunks.get(i)).collect();
        for (&index, chunk) in batch.iter().zip(decoded) {
            let chunk = chunk?;
            let bounds = &reader.entries()[index as usize].bounds;
            if chunk.mesh.positions.iter().any(|p| p.cmplt(bounds.min).any() || p.cmpgt(bounds.max).any()) {
                // What was forgotten would come again as another vertex: the surface would crack.
                return Err(ExtractError::Outside { chunk: index });
            }
            let plane = bounds.min[axis];
            // Of a square, its point tells: both of its triangles are inside, or none.
            let places =
                |t: usize| if is_of_points { [point_of(&chunk.mesh, 4 * (t / 2)); 3] } else { chunk.mesh.corners(t) };
            let inside = |t: &usize| region.is_none_or(|region| region.holds(places(*t)));
            match &mut reducer {
                None => weld.forget(plane),
                Some(reducer) => weld.write(reducer.reduce_if_full(plane))?,
            }
            for patch in chosen.cut.drawn(&chunk.patches) {
                let triangles = (patch.first as usize..(patch.first + patch.count) as usize).filter(inside);
                match &mut reducer {
                    None if as_points => weld.add_points(&chunk.mesh, triangles)?,
                    None => weld.add(&chunk.mesh, triangles)?,
                    Some(reducer) => {
                        let error = reader.entries().get(patch.diamond as usize).map_or(0.0, |e| e.error);
                        reducer.add(&chunk.mesh, triangles, error);
                    }
                }
            }
        }
        done += batch.len();
        progress(done as u64, order.len() as u64);
    }
    if let Some(reducer) = reducer {
        weld.write(Some(reducer.finish()))?;
    }
    Ok(weld.counts)
}

/// The axis along which the model is longest.
fn longest_side<S: Source>(reader: &Reader<S>) -> usize {
    let (min, max) = (reader.metadata().bounds_min, reader.metadata().bounds_max);
    let length = |k: &usize| max[*k] - min[*k];
    (0..3).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0)
}

/// The chunks that hold something to write, in the order of the sweep.
fn in_order<S: Source>(reader: &Reader<S>, chosen: &Chosen, region: Option<&Steps>, axis: usize) -> Vec<u32> {
    let entries = reader.entries();
    let bounds = |i: u32| &entries[i as usize].bounds;
    let wanted = |i: &u32| !bounds(*i).is_empty() && region.is_none_or(|region| region.meets(bounds(*i)));
    let mut chunks: Vec<u32> = chosen.cut.refined().filter(wanted).collect();
    chunks.sort_unstable_by_key(|&i| (bounds(i).min[axis], i));
    chunks
}

/// The point that a square stands for, by its first vertex.
fn point_of(squares: &Mesh, first: usize) -> LatticePoint {
    (squares.positions[first] + squares.positions[first + 2]) / 2
}

/// Gives equal vertices one number, and writes them and the triangles.
struct Weld<'a> {
    axis: usize,
    known: HashMap<Wedge, u32>,
    /// How many were kept when some were forgotten last.
    kept: usize,
    counts: Counts,
    bytes: Vec<u8>,
    encoder: &'a mut dyn Encoder,
    scratch: &'a mut Scratch,
}

impl Weld<'_> {
    /// Forget the vertices before `plane`, when there are twice as many as the last time.
    fn forget(&mut self, plane: i32) {
        if self.known.len() >= FORGET_FROM.max(2 * self.kept) {
            let axis = self.axis;
            self.known.retain(|wedge, _| wedge.0[axis] >= plane);
            self.kept = self.known.len();
        }
    }

    /// Write a finished part of a simplified surface.
    fn write(&mut self, piece: Option<Piece>) -> Result<(), ExtractError> {
        let Some(piece) = piece else { return Ok(()) };
        self.counts.error = self.counts.error.max(piece.error);
        self.add(&piece.mesh, piece.triangles.iter().map(|t| *t as usize))?;
        self.forget(piece.rest_from);
        Ok(())
    }

    /// Write triangles of a mesh, each after its vertices.
    fn add(&mut self, mesh: &Mesh, triangles: impl Iterator<Item = usize>) -> Result<(), ExtractError> {
        let mut numbers: Vec<Option<u32>> = vec![None; mesh.positions.len()];
        for t in triangles {
            let mut corners = [0; 3];
            if self.encoder.shares_vertices() {
                for (corner, v) in corners.iter_mut().zip(mesh.triangles[t]) {
                    let v = v as usize;
                    *corner = match numbers[v] {
                        Some(number) => number,
                        None => self.number(mesh, v)?,
                    };
                    numbers[v] = Some(*corner);
                }
            } else {
                self.counts.vertices += 3;
            }
            self.bytes.clear();
            self.encoder.triangle(&mut self.bytes, corners, mesh.corners(t));
            self.scratch.triangles.write_all(&self.bytes).map_err(ExtractError::Scratch)?;
            self.counts.triangles += 1;
        }
        Ok(())
    }

    /// Write the points that the squares of some triangles stand for, each once: by the first of its two triangles.
    fn add_points(&mut self, squares: &Mesh, triangles: impl Iterator<Item = usize>) -> Result<(), ExtractError> {
        let mut point = Mesh::default();
        for v in triangles.filter(|t| t % 2 == 0).map(|t| 2 * t) {
            let limit = self.encoder.max_vertices();
            if self.counts.vertices >= limit.into() {
                return Err(ExtractError::TooManyVertices { limit });
            }
            point.positions.clear();
            point.colors.clear();
            point.normals.clear();
            point.scalars.iter_mut().for_each(Vec::clear);
            point.push_vertex_of(squares, v);
            point.positions[0] = point_of(squares, v);
            self.bytes.clear();
            self.encoder.vertex(&mut self.bytes, &point, 0);
            self.scratch.vertices.write_all(&self.bytes).map_err(ExtractError::Scratch)?;
            self.counts.vertices += 1;
        }
        Ok(())
    }

    /// The number of a vertex, written where it is new.
    fn number(&mut self, mesh: &Mesh, v: usize) -> Result<u32, ExtractError> {
        let wedge = (
            mesh.positions[v],
            mesh.colors.get(v).copied().unwrap_or_default(),
            mesh.normals[v],
            mesh.scalars.iter().map(|s| s[v].to_bits()).collect(),
        );
        if let Some(&number) = self.known.get(&wedge) {
            return Ok(number);
        }
        let limit = self.encoder.max_vertices();
        let number = u32::try_from(self.counts.vertices).ok().filter(|n| *n < limit);
        let number = number.ok_or(ExtractError::TooManyVertices { limit })?;
        self.counts.vertices += 1;
        self.known.insert(wedge, number);
        self.bytes.clear();
        self.encoder.vertex(&mut self.bytes, mesh, v);
        self.scratch.vertices.write_all(&self.bytes).map_err(ExtractError::Scratch)?;
        Ok(number)
    }
}
