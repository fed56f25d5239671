//! Simplifying a cut to a number of triangles while it streams by, with a certified error.
//!
//! Triangles are collected in a window behind the sweeping plane. When it is full it is simplified to its share of the
//! triangles that are asked for; points that later chunks may use (at the plane or beyond it) are locked. What is finished then is written, but for a
//! band before the plane, which goes into the next window: there the triangles at the plane, which were locked, are simplified with their new neighbours.
//! Points between the band and what was written are locked from then on. The same idea as Isenburg, Lindstrom, Gumhold and Snoeyink, "Large Mesh
//! Simplification using Processing Sequences", IEEE Visualization 2003. The error of a window is that of the cut plus that of the step, per triangle.

use super::choose::Reduction;
use kilwa_geometry::{LatticePoint, Mesh};
use kilwa_pack::{Reader, Source};
use kilwa_simplify::{Bound, Precision, Purpose, Welder, certify, simplify};
use std::collections::{HashMap, HashSet};

/// Triangles that are simplified at once, which take about 130 MB. Four times as many leave a surface that is closer to the original by one to two percent.
pub const WINDOW: usize = 1 << 17;
/// Of a simplified window the share, in percent, that is written at most; the rest is the band.
const WRITTEN: usize = 80;
/// Colours and normals as the pack has them.
const FULL: Precision = Precision { color_bits: 8, normal_bits: 16 };

/// A finished part of the surface.
pub(super) struct Piece {
    pub(super) mesh: Mesh,
    /// The finished triangles of `mesh`.
    pub(super) triangles: Vec<u32>,
    /// Their certified error in metres, against the finest surface.
    pub(super) error: f32,
    /// Vertices of this piece that lie before this place on the axis of the sweep do not come again.
    pub(super) rest_from: i32,
}

/// Simplifies triangles that come in the order of the sweep.
pub(super) struct Reducer {
    reduction: Reduction,
    axis: usize,
    /// Metres per lattice unit.
    step: f64,
    /// The diagonal of the lattice's cube, in lattice units: nothing is farther apart.
    widest: f32,
    /// Whether a box cuts the surface: its rim becomes a border.
    is_cut: bool,
    scalars: usize,
    window: Welder,
    /// One for each triangle of the window.
    bounds: Vec<Bound>,
    /// Points of the window that triangles which were written use.
    sealed: HashSet<LatticePoint>,
    /// Triangles of the cut that came.
    taken: u64,
    /// How many of these the written triangles stand for.
    spent: u64,
    /// Triangles that were written.
    written: u64,
    /// The window is full with so many triangles.
    room: usize,
}

impl Reducer {
    pub(super) fn new<S: Source>(reader: &Reader<S>, reduction: Reduction, axis: usize, is_cut: bool) -> Self {
        let header = reader.header();
        let scalars = usize::from(header.attributes.scalars);
        Self {
            reduction,
            axis,
            step: header.lattice.step(),
            widest: up(f64::from(1u32 << header.cube_log2.min(31)) * 1.732_050_9),
            is_cut,
            scalars,
            window: Welder::new(0, scalars),
            bounds: Vec::new(),
            sealed: HashSet::new(),
            taken: 0,
            spent: 0,
            written: 0,
            room: reduction.window,
        }
    }

    /// Triangles of a chunk whose certified error is this, in metres.
    pub(super) fn add(&mut self, mesh: &Mesh, triangles: impl Iterator<Item = usize>, error: f32) {
        let units = up(f64::from(error) / self.step).min(self.widest);
        let bound = Bound { out: units, back: units };
        let mut taken = 0;
        let sound = triangles.inspect(|_| taken += 1).filter(|t| {
            // Triangles without area, which only a damaged file has, would confuse the collapses.
            let [a, b, c] = mesh.corners(*t);
            a != b && b != c && c != a
        });
        self.push(mesh, sound.map(|t| (t, bound)));
        self.taken += taken;
    }

    fn push(&mut self, mesh: &Mesh, triangles: impl Iterator<Item = (usize, Bound)>) {
        let mut numbers: Vec<Option<u32>> = vec![None; mesh.vertex_count()];
        for (t, bound) in triangles {
            let corners = mesh.triangles[t].map(|v| {
                let window = &mut self.window;
                *numbers[v as usize].get_or_insert_with(|| window.vertex(mesh, v as usize))
            });
            self.window.mesh.triangles.push(corners);
            self.window.mesh.borders.push(mesh.borders[t]);
            self.bounds.push(bound);
        }
    }

    /// Simplify the window if it is full. No later chunk has a point before `plane` on the axis of the sweep.
    pub(super) fn reduce_if_full(&mut self, plane: i32) -> Option<Piece> {
        if self.bounds.len() < self.room {
            return None;
        }
        let closed = self.window.mesh.triangles.iter().filter(|t| {
            let place = |v: &u32| self.window.mesh.positions[*v as usize][self.axis];
            t.iter().all(|v| place(v) < plane)
        });
        if closed.count() * 2 < self.bounds.len() {
            // Most of it would be in the next window again.
            self.room = self.bounds.len() / 2 * 3;
            return None;
        }
        let piece = self.reduce(Some(plane));
        self.room = self.reduction.window.max(2 * self.bounds.len());
        Some(piece).filter(|piece| !piece.triangles.is_empty())
    }

    /// Simplify what is left.
    pub(super) fn finish(mut self) -> Piece {
        self.reduce(None)
    }

    fn reduce(&mut self, plane: Option<i32>) -> Piece {
        let mut fine = std::mem::replace(&mut self.window, Welder::new(0, self.scalars)).mesh;
        let bounds = std::mem::take(&mut self.bounds);
        let sealed = std::mem::take(&mut self.sealed);
        let axis = self.axis;
        let is_open = |p: &LatticePoint| plane.is_some_and(|plane| p[axis] >= plane);
        let is_locked = |p: &LatticePoint| is_open(p) || sealed.contains(p);
        let locked: HashSet<LatticePoint> = fine.positions.iter().filter(|p| is_locked(p)).copied().collect();
        if self.is_cut {
            mark_rim(&mut fine, &locked);
        }
        let open = (0..fine.triangle_count()).filter(|t| fine.corners(*t).iter().any(is_open)).count();
        let mut limits = fine.bounds();
        if let Some(plane) = plane {
            // A place beyond it may be that of a vertex which is still to come.
            limits.max[axis] = limits.max[axis].min(plane.saturating_sub(1));
        }
        let open = open as u64;
        let closed = self.taken.saturating_sub(self.spent).saturating_sub(open);
        let target = if plane.is_some() { self.share(closed).saturating_add(open) } else { self.left() };
        let target = usize::try_from(target).unwrap_or(usize::MAX);
        let coarse = simplify(&fine, &locked, target, Purpose::Export(FULL, limits));
        let bounds = certify(&fine, &bounds, &coarse);
        let coarse = coarse.mesh;
        let (finished, rest) = divide(&coarse, axis, plane);
        let largest = finished.iter().map(|t| bounds[*t as usize]).fold(0.0, |e: f32, b| e.max(b.out).max(b.back));
        let rest_from = rest.iter().flat_map(|t| coarse.corners(*t as usize)).map(|p| p[axis]).min();
        let rest_from = rest_from.or(plane).unwrap_or(i32::MAX).min(plane.unwrap_or(i32::MAX));
        self.seal(&coarse, &finished, &rest, &sealed);
        self.push(&coarse, rest.iter().map(|t| (*t as usize, bounds[*t as usize])));
        let finished_count = finished.len() as u64;
        let kept = (coarse.triangle_count() as u64).saturating_sub(open);
        self.spent += share_of(closed, finished_count, kept);
        self.written += finished_count;
        let error = metres_of(self.step, largest);
        Piece { mesh: coarse, triangles: finished, error, rest_from }
    }

    /// Triangles that may still be written.
    fn left(&self) -> u64 {
        self.reduction.to.saturating_sub(self.written)
    }

    /// How many of these so many triangles of the cut are simplified to: an equal part of what is left, so that a place that cannot be
    /// simplified takes triangles from all that comes and not from the next window alone.
    fn share(&self, triangles: u64) -> u64 {
        share_of(self.left(), triangles, self.reduction.from.saturating_sub(self.spent))
    }

    /// Lock the points that the rest has in common with what is written, now or before.
    fn seal(&mut self, mesh: &Mesh, finished: &[u32], rest: &[u32], sealed: &HashSet<LatticePoint>) {
        if rest.is_empty() {
            return;
        }
        let corners = |t: &u32| mesh.corners(*t as usize);
        let written: HashSet<LatticePoint> = finished.iter().flat_map(corners).collect();
        let is_shared = |p: &LatticePoint| written.contains(p) || sealed.contains(p);
        self.sealed = rest.iter().flat_map(corners).filter(is_shared).collect();
    }
}

/// The triangles that are finished, and the others: those near the plane.
fn divide(mesh: &Mesh, axis: usize, plane: Option<i32>) -> (Vec<u32>, Vec<u32>) {
    let all = 0..mesh.triangle_count() as u32;
    let Some(plane) = plane else { return (all.collect(), Vec::new()) };
    let last = |t: u32| mesh.corners(t as usize).map(|p| p[axis]).into_iter().max().unwrap_or(plane);
    let mut places: Vec<i32> = all.clone().map(last).collect();
    if places.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let nth = (places.len() * WRITTEN / 100).min(places.len() - 1);
    let before = (*places.select_nth_unstable(nth).1).min(plane);
    all.partition(|t| last(*t) < before)
}

/// Mark edges that one triangle uses as a border of the surface, where no later triangle can use them.
fn mark_rim(mesh: &mut Mesh, locked: &HashSet<LatticePoint>) {
    let mut uses: HashMap<[LatticePoint; 2], (u32, u8)> = HashMap::new();
    for t in 0..mesh.triangle_count() {
        let corners = mesh.corners(t);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let edge = if a.to_array() <= b.to_array() { [a, b] } else { [b, a] };
            let place = t as u32 * 3 + k as u32;
            uses.entry(edge).and_modify(|u| u.1 = u.1.saturating_add(1)).or_insert((place, 1));
        }
    }
    for ([a, b], (place, count)) in uses {
        if count == 1 && !(locked.contains(&a) && locked.contains(&b)) {
            mesh.borders[(place / 3) as usize] |= 1 << (place % 3);
        }
    }
}

/// `part` of `whole` things, if there are `amount` for the whole.
fn share_of(amount: u64, part: u64, whole: u64) -> u64 {
    let share = u128::from(amount) * u128::from(part.min(whole)) / u128::from(whole.max(1));
    u64::try_from(share).unwrap_or(amount)
}

/// An error in metres, rounded up.
fn metres_of(step: f64, units: f32) -> f32 {
    up(f64::from(units) * step)
}

/// The nearest `f32` that is no smaller.
fn up(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) < x { nearest.next_up() } else { nearest }
}
