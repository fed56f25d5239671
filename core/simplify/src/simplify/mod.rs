//! Edge-collapse simplification of a fragment (that of a diamond, or a window of an extract), on the lattice, with the guarantees that the hierarchy rests
//! on:
//!
//! * a locked point (one that triangles outside of the fragment also use) neither moves nor changes its attributes, and every edge
//!   between two locked points is used by as many triangles afterwards as before: the neighbours are not affected;
//! * every edge used by one triangle inside the fragment either joins two locked points as before or carries the
//!   true-border bit;
//! * no triangle is doubled, none flips; a component vanishes only where a fragment of thousands of triangles cannot be
//!   simplified otherwise, and then whole;
//! * the result depends on the fragment's geometry alone, not on the order in which it was handed in.
//!
//! Points are lattice positions; a point may carry several *wedges* (the same place with other attributes). Topology is
//! that of the points, attributes ride on the wedges. Colours of merged wedges are averaged in linear light.

mod collapse;
mod prune;
mod quadric;
mod queue;
mod settle;
mod wedge;

use crate::precision::Precision;
use glam::DVec3;
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_geometry::{Aabb, LatticePoint, Mesh};
use quadric::Quadric;
use queue::{Queue, Waiting};
use rustc_hash::FxHashMap;
use std::collections::HashSet;
use std::hash::BuildHasher;
use wedge::Wedges;

const NONE: u32 = u32::MAX;

/// A point where more corners meet (the middle of a fan, the spine of a book of sheets) stays where it is: looking at all
/// its edges for each of them would take cubic time. What surrounds it is simplified all the same.
const HUB: u32 = 128;

/// Relative weight of a colour difference across a collapsed edge, against moving the surface by the edge's length.
const COLOR_WEIGHT: f64 = 2e-3;

/// See [`Simplified::coarse_of_fine`].
pub const PRUNED: u32 = NONE;

/// A simplified mesh and how it came from the fine one. *Points* are positions; those of the fine mesh are numbered in
/// order of first use by its vertices, those of the coarse one are numbered from 0 as well.
pub struct Simplified {
    /// The coarse mesh.
    pub mesh: Mesh,
    /// For each vertex of the fine mesh, its point in the fine mesh.
    pub fine_point: Vec<u32>,
    /// For each point of the fine mesh, the coarse point that it was merged into (every one has a triangle), or
    /// [`PRUNED`] where its component was left out.
    pub coarse_of_fine: Vec<u32>,
    /// Number of coarse points.
    pub points: usize,
    /// Whether a coarse point is locked.
    pub locked: Vec<bool>,
    /// For each coarse triangle, its coarse points.
    pub triangles: Vec<[u32; 3]>,
    /// For each coarse triangle, the fine triangle that became it.
    pub from: Vec<u32>,
}

/// What a point's edges say about it. Only meaningful for free points, all of whose triangles are inside.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Kind {
    /// Every edge is used twice.
    Manifold,
    /// Exactly two edges are used otherwise, both equally often: a border (once) or a non-manifold line.
    Crease,
    /// Anything else: it keeps its place unless merged with another such point.
    Complex,
}

struct Point {
    /// Position relative to the fragment's centre.
    local: DVec3,
    at: LatticePoint,
    quadric: Quadric,
    kind: Kind,
    locked: bool,
    /// Whether its place is one that simplification chose, which no vertex had.
    made: bool,
    /// First and last corner of the list of corners at this point.
    head: u32,
    tail: u32,
    /// Length of that list.
    corners: u32,
    /// When anything changed that a collapse's cost depends on, by [`Simplifier::changes`].
    changed: u32,
}

/// One neighbour of a point.
#[derive(Clone, Copy)]
struct Neighbour {
    point: u32,
    /// Triangles on the edge to it, inside the fragment.
    count: u32,
    /// Whether one of them carries the true-border bit there.
    border: bool,
}

/// A candidate collapse: everything else is checked when its turn comes.
#[derive(Clone, Copy)]
struct Collapse {
    keep: u32,
    remove: u32,
    target: LatticePoint,
    cost: f64,
}

/// What is known of the collapse of an edge.
#[derive(Clone, Copy, Default)]
struct Known {
    target: LatticePoint,
    cost: f64,
    /// [`Simplifier::changes`] at that time; 0 where nothing is known.
    at: u32,
}

struct Simplifier<'a> {
    source: &'a Mesh,
    center: LatticePoint,
    /// Where points may be made.
    limits: Aabb,
    points: Vec<Point>,
    /// For a point that was merged, one that it was merged into; for all others themselves.
    merged_into: Vec<u32>,
    /// The point of each vertex of the source.
    point_of_vertex: Vec<u32>,
    wedges: Wedges<'a>,
    /// Point and wedge per corner; corner `3 t + k` belongs to triangle `t`.
    point: Vec<u32>,
    wedge: Vec<u32>,
    borders: Vec<u8>,
    alive: Vec<bool>,
    /// Next corner in the list of the same point.
    next: Vec<u32>,
    occupied: FxHashMap<LatticePoint, u32>,
    /// Ends of all edges at the beginning, or when quadrics were begun anew.
    edges: Vec<[u32; 2]>,
    /// Edges by cost, cheapest first: the bits of the cost as `f32`, then the number of the edge. An edge stays in the
    /// queue with the cost it once had, which only grows; it is worked out again when its turn comes.
    queue: Queue,
    /// Where each edge's collapse would lead, and when that was worked out: it holds until an end changes.
    known: Vec<Known>,
    /// Counts the changes of points, from 1.
    changes: u32,
    /// Edges that wait for a change at one of their ends.
    waiting: Waiting,
    triangles: usize,
    /// Marks of points, valid where equal to `clock`.
    marks: Vec<u32>,
    clock: u32,
    scratch: ScratchBuffer,
}

/// Lists that are reused for every collapse.
#[derive(Default)]
struct ScratchBuffer {
    of_keep: Vec<Neighbour>,
    of_remove: Vec<Neighbour>,
    corners: Vec<u32>,
    joined: Vec<(u32, u32)>,
    shared: Vec<(u32, u32)>,
    borders: Vec<u32>,
}

/// What the simplified mesh is for.
#[derive(Debug, Clone, Copy)]
pub enum Purpose {
    /// A level of a pack. What is made is rounded to what the codec stores well: positions as [`settle`] describes, colours and
    /// normals to [`Precision::coarse`].
    Level(Precision),
    /// A mesh by itself, nothing of which is rounded but to the lattice and to this precision, by fading quadrics ([`RESTART`]).
    /// Points are made within the box only.
    Export(Precision, Aabb),
}

/// Quadrics add up the planes of all fine triangles, and on a rough surface most of what they remember is noise. Begun anew from
/// the triangles that are left ("memoryless" simplification: Lindstrom and Turk, "Fast and Memory Efficient Polygonal
/// Simplification", IEEE Visualization 1998), whenever these have become fewer by this factor, they leave it closer to the original, by a tenth to a fifth.
const RESTART: f64 = 1.5;
/// The weight that the old quadrics keep when new ones are begun. Without memory thin parts are lost: at half of the triangles of the
/// synthetic fort the largest error is then three times that of sums; with this it is as small, and the mean error smaller than both.
const MEMORY: f64 = 0.2;

/// Simplify towards `target` triangles, pruning small components where nothing else helps (see `prune`); returns fewer or as many triangles as given, never fewer than `target` minus
/// what the last collapse took, and the input itself where nothing can go.
pub fn simplify<S: BuildHasher>(
    mesh: &Mesh,
    locked: &HashSet<LatticePoint, S>,
    target: usize,
    purpose: Purpose,
) -> Simplified {
    let limits = match purpose {
        Purpose::Level(_) => Aabb { min: LatticePoint::ZERO, max: LatticePoint::splat(MAX_COORDINATE) },
        Purpose::Export(_, limits) => limits,
    };
    let mut s = Simplifier::new(mesh, locked, limits);
    s.seed();
    if let Purpose::Export(..) = purpose {
        s.run_in_rounds(target);
    } else {
        s.run(target);
    }
    if s.triangles > target {
        s.prune(target);
    }
    if let Purpose::Level(_) = purpose {
        s.settle();
    }
    s.finish(purpose)
}

fn key(cost: f64, edge: u32) -> u64 {
    // Costs are not negative, so their bits are in order.
    (u64::from((cost as f32).to_bits()) << 32) | u64::from(edge)
}

impl<'a> Simplifier<'a> {
    fn new<S: BuildHasher>(mesh: &'a Mesh, locked: &HashSet<LatticePoint, S>, limits: Aabb) -> Self {
        let center = {
            let b = mesh.bounds();
            ((b.min.as_i64vec3() + b.max.as_i64vec3()) / 2).as_ivec3()
        };
        let mut occupied: FxHashMap<LatticePoint, u32> = FxHashMap::default();
        occupied.reserve(mesh.vertex_count());
        let mut points: Vec<Point> = Vec::with_capacity(mesh.vertex_count());
        let point_of_vertex: Vec<u32> = mesh
            .positions
            .iter()
            .map(|&p| {
                let next = points.len() as u32;
                let found = *occupied.entry(p).or_insert(next);
                if found == next {
                    points.push(Point {
                        local: local(p, center),
                        at: p,
                        quadric: Quadric::default(),
                        kind: Kind::Complex,
                        locked: locked.contains(&p),
                        made: false,
                        head: NONE,
                        tail: NONE,
                        corners: 0,
                        changed: 0,
                    });
                }
                found
            })
            .collect();
        let wedge: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        let mut s = Self {
            source: mesh,
            center,
            limits,
            merged_into: (0..points.len() as u32).collect(),
            marks: vec![0; points.len()],
            points,
            wedges: Wedges::new(mesh),
            point: wedge.iter().map(|w| point_of_vertex[*w as usize]).collect(),
            point_of_vertex,
            borders: mesh.borders.clone(),
            alive: vec![true; mesh.triangle_count()],
            next: vec![NONE; wedge.len()],
            wedge,
            occupied,
            edges: Vec::with_capacity(mesh.triangle_count() * 3 / 2 + 64),
            queue: Queue::default(),
            known: Vec::new(),
            changes: 1,
            waiting: Waiting::default(),
            triangles: mesh.triangle_count(),
            clock: 0,
            scratch: ScratchBuffer::default(),
        };
        for c in 0..s.point.len() as u32 {
            s.link(s.point[c as usize], c);
        }
        s
    }

    fn link(&mut self, point: u32, corner: u32) {
        self.next[corner as usize] = NONE;
        let p = &mut self.points[point as usize];
        if p.head == NONE {
            p.head = corner;
        } else {
            self.next[p.tail as usize] = corner;
        }
        p.tail = corner;
        p.corners += 1;
    }

    /// Live corners at a point.
    fn corners_at(&self, point: u32) -> impl Iterator<Item = u32> + '_ {
        let mut c = self.points[point as usize].head;
        std::iter::from_fn(move || {
            while c != NONE {
                let here = c;
                c = self.next[c as usize];
                if self.alive[(here / 3) as usize] {
                    return Some(here);
                }
            }
            None
        })
    }

    /// The two other points of a corner's triangle, in order.
    fn others(&self, corner: u32) -> [u32; 2] {
        let first = corner - corner % 3;
        match corner - first {
            0 => [self.point[first as usize + 1], self.point[first as usize + 2]],
            1 => [self.point[first as usize + 2], self.point[first as usize]],
            _ => [self.point[first as usize], self.point[first as usize + 1]],
        }
    }

    /// Neighbours of a point with edge counts and border bits.
    fn neighbours(&self, point: u32, out: &mut Vec<Neighbour>) {
        out.clear();
        for c in self.corners_at(point) {
            let (t, k) = ((c / 3) as usize, c % 3);
            // The edge to the first starts at this corner; the edge from the second starts at the corner before it.
            let slots = [k, (k + 2) % 3];
            for (p, slot) in self.others(c).into_iter().zip(slots) {
                let border = self.borders[t] & (1 << slot) != 0;
                match out.iter_mut().find(|n| n.point == p) {
                    Some(n) => {
                        n.count += 1;
                        n.border |= border;
                    }
                    None => out.push(Neighbour { point: p, count: 1, border }),
                }
            }
        }
    }

    /// The point that represents one of the beginning.
    fn now(&mut self, mut point: u32) -> u32 {
        while self.merged_into[point as usize] != point {
            let up = self.merged_into[self.merged_into[point as usize] as usize];
            self.merged_into[point as usize] = up;
            point = up;
        }
        point
    }

    /// Quadrics, kinds and the queue, from the triangles that are left.
    fn seed(&mut self) {
        for p in &mut self.points {
            p.quadric = p.quadric.times(MEMORY);
        }
        for t in (0..self.alive.len()).filter(|t| self.alive[*t]) {
            let p: [u32; 3] = std::array::from_fn(|k| self.point[t * 3 + k]);
            let l = p.map(|p| self.points[p as usize].local);
            let q = Quadric::triangle(l);
            for k in 0..3 {
                self.points[p[k] as usize].quadric.add(&q);
                if self.borders[t] & (1 << k) != 0 {
                    let q = Quadric::border([l[k], l[(k + 1) % 3], l[(k + 2) % 3]]);
                    self.points[p[k] as usize].quadric.add(&q);
                    self.points[p[(k + 1) % 3] as usize].quadric.add(&q);
                }
            }
        }
        let mut near = std::mem::take(&mut self.scratch.of_keep);
        self.edges.clear();
        for p in 0..self.points.len() as u32 {
            if self.merged_into[p as usize] != p || self.points[p as usize].corners > HUB {
                continue;
            }
            self.neighbours(p, &mut near);
            self.points[p as usize].kind = kind(&near);
            // Each edge once; those to a hub cannot be collapsed anyway.
            self.edges.extend(near.iter().filter(|n| n.point > p).map(|n| [p, n.point]));
        }
        self.scratch.of_keep = near;
        self.known.clear();
        self.known.resize(self.edges.len(), Known::default());
        self.waiting.reset(self.points.len(), self.edges.len());
        let mut keys = Vec::with_capacity(self.edges.len());
        for e in 0..self.edges.len() as u32 {
            match self.candidate(e) {
                Some(c) => keys.push(key(c.cost, e)),
                None => self.refuse(e),
            }
        }
        self.queue = Queue::new(keys);
    }

    /// The same as [`run`](Self::run), with quadrics that are begun anew after each factor of [`RESTART`].
    fn run_in_rounds(&mut self, target: usize) {
        loop {
            let round = ((self.triangles as f64 / RESTART) as usize).max(target);
            self.run(round);
            // Stuck, or done.
            if self.triangles > round || round == target {
                return;
            }
            self.seed();
        }
    }

    /// Collapse edges, cheapest first, until `target` is reached or the queue is empty.
    fn run(&mut self, target: usize) {
        while self.triangles > target {
            let Some(top) = self.queue.pop() else { return };
            let edge = (top & u64::from(u32::MAX)) as u32;
            let Some(c) = self.candidate(edge) else {
                self.refuse(edge);
                continue;
            };
            let now = key(c.cost, edge);
            if now > top && self.queue.peek().is_some_and(|next| now > next) {
                self.queue.push(now);
            } else if self.collapse(&c) {
                self.ask_again(c.keep);
                self.ask_again(c.remove);
            } else {
                self.refuse(edge);
            }
        }
    }

    /// Put an edge aside until one of its ends changes: what is not allowed now may be then.
    fn refuse(&mut self, edge: u32) {
        let [a, b] = self.edges[edge as usize].map(|p| self.now(p));
        if a == b || (self.points[a as usize].locked && self.points[b as usize].locked) {
            return;
        }
        self.waiting.put(edge, [a, b]);
    }

    /// Put the edges that were refused at a point back into the queue. They are looked at again when their turn comes,
    /// and that is at once, for their cost is worked out then.
    fn ask_again(&mut self, point: u32) {
        let queue = &mut self.queue;
        self.waiting.take(point, |edge| queue.push(key(0.0, edge)));
    }

    /// The collapse of an edge and its cost, or `None` when it cannot be collapsed at all.
    fn candidate(&mut self, edge: u32) -> Option<Collapse> {
        let [a, b] = self.edges[edge as usize];
        let (a, b) = (self.now(a), self.now(b));
        let (pa, pb) = (&self.points[a as usize], &self.points[b as usize]);
        if a == b || (pa.locked && pb.locked) || pa.corners > HUB || pb.corners > HUB {
            return None;
        }
        let (keep, remove) = if pb.locked { (b, a) } else { (a, b) };
        let Known { target, cost, at } = self.known[edge as usize];
        if at > pa.changed && at > pb.changed {
            return Some(Collapse { keep, remove, target, cost });
        }
        // At a line of odd edges the triangles round the ends count too.
        let (pk, pr) = (&self.points[keep as usize], &self.points[remove as usize]);
        let by_ends = pr.kind == Kind::Manifold || (pk.kind == Kind::Manifold && !pk.locked);
        let mut quadric = pa.quadric;
        quadric.add(&pb.quadric);
        let target = self.target(keep, remove, &quadric)?;
        let cost = quadric.at(local(target, self.center)) + self.color_cost(a, b);
        if by_ends {
            self.known[edge as usize] = Known { target, cost, at: self.changes };
        }
        Some(Collapse { keep, remove, target, cost })
    }

    /// Note that something changed that the collapses of a point's edges depend on.
    fn note_change(&mut self, point: u32) {
        self.points[point as usize].changed = self.changes;
        self.changes += 1;
    }

    /// A weak preference for edges along which the colour does not change: squared length times squared difference.
    fn color_cost(&self, a: u32, b: u32) -> f64 {
        let (pa, pb) = (&self.points[a as usize], &self.points[b as usize]);
        let d = self.wedges.color_distance(self.wedge[pa.head as usize], self.wedge[pb.head as usize]);
        let e = pa.local - pb.local;
        let l2 = e.length_squared();
        COLOR_WEIGHT * d * l2 * l2
    }

    fn finish(mut self, purpose: Purpose) -> Simplified {
        let mut out = Mesh { scalars: vec![Vec::new(); self.source.scalars.len()], ..Mesh::default() };
        let mut index = vec![NONE; self.source.vertex_count()];
        let mut number = vec![NONE; self.points.len()];
        let mut locked = Vec::with_capacity(self.points.len() / 2);
        for (p, (n, point)) in (0u32..).zip(number.iter_mut().zip(&self.points)) {
            if self.merged_into[p as usize] == p && point.head != NONE {
                *n = locked.len() as u32;
                locked.push(point.locked);
            }
        }
        let (mut triangles, mut from) = (Vec::with_capacity(self.triangles), Vec::with_capacity(self.triangles));
        for t in (0..self.alive.len()).filter(|t| self.alive[*t]) {
            let mut tri = [0; 3];
            for (k, v) in tri.iter_mut().enumerate() {
                let w = self.wedge[t * 3 + k] as usize;
                if index[w] == NONE {
                    index[w] = out.positions.len() as u32;
                    out.positions.push(self.points[self.point[t * 3 + k] as usize].at);
                    self.wedges.emit(w, purpose, &mut out);
                }
                *v = index[w];
            }
            out.triangles.push(tri);
            out.borders.push(self.borders[t]);
            triangles.push(std::array::from_fn(|k| number[self.point[t * 3 + k] as usize]));
            from.push(t as u32);
        }
        let coarse_of_fine = (0..self.points.len() as u32).map(|p| number[self.now(p) as usize]).collect();
        Simplified {
            mesh: out,
            fine_point: self.point_of_vertex,
            coarse_of_fine,
            points: locked.len(),
            locked,
            triangles,
            from,
        }
    }
}

fn kind(neighbours: &[Neighbour]) -> Kind {
    let mut odd = neighbours.iter().filter(|n| n.count != 2);
    match (odd.next(), odd.next(), odd.next()) {
        (None, ..) => Kind::Manifold,
        (Some(a), Some(b), None) if a.count == b.count => Kind::Crease,
        _ => Kind::Complex,
    }
}

fn local(p: LatticePoint, center: LatticePoint) -> DVec3 {
    p.as_dvec3() - center.as_dvec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(n: u32) -> Mesh {
        let mut m = Mesh { scalars: vec![Vec::new()], ..Mesh::default() };
        for y in 0..=n {
            for x in 0..=n {
                m.positions.push(LatticePoint::new(x as i32 * 10, y as i32 * 10, 500));
                m.normals.push([0, 0]);
                m.colors.push([100, 150, 200]);
                m.scalars[0].push(if (x, y) == (n / 2, n / 2) { f32::NAN } else { 7.0 });
            }
        }
        let w = n + 1;
        for y in 0..n {
            for x in 0..n {
                let i = y * w + x;
                m.triangles.extend([[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]);
                let (left, right) = (u8::from(x == 0) << 2, u8::from(x == n - 1));
                let (bottom, top) = (u8::from(y == 0), u8::from(y == n - 1) << 1);
                m.borders.extend([left | bottom, right | top]);
            }
        }
        m
    }

    #[test]
    fn missing_values_do_not_spread_and_equal_values_and_colours_stay_equal() {
        let fine = sheet(16);
        let coarse = simplify(&fine, &Locked::default(), 8, Purpose::Level(Precision::default())).mesh;
        assert!(coarse.triangle_count() <= 16, "{}", coarse.triangle_count());
        assert!(coarse.scalars[0].iter().all(|s| (s - 7.0).abs() < 1e-4), "{:?}", coarse.scalars[0]);
        assert!(coarse.colors.iter().all(|c| *c == [100, 150, 200]));
    }

    #[test]
    fn triangles_that_name_a_point_twice_are_counted_once() {
        let mut fine = sheet(12);
        for v in 0..150u32 {
            fine.triangles.push([v, v, v + 1]);
            fine.borders.push(0);
        }
        for target in [0, 100, 300] {
            for purpose in [Purpose::Level(Precision::default()), Purpose::Export(Precision::default(), fine.bounds())]
            {
                let s = simplify(&fine, &Locked::default(), target, purpose);
                assert_eq!(s.mesh.triangle_count(), s.from.len());
                assert!(s.mesh.triangle_count() < fine.triangle_count());
            }
        }
    }

    #[test]
    fn a_fan_of_twenty_thousand_triangles_is_simplified_in_reasonable_time() {
        let n = 20_000u32;
        let mut m = Mesh {
            positions: vec![LatticePoint::splat(1_000_000)],
            normals: vec![[0, 0]; n as usize + 1],
            ..Mesh::default()
        };
        for i in 0..n {
            let angle = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
            let (x, y) = (900_000.0 * libm::cos(angle), 900_000.0 * libm::sin(angle));
            m.positions.push(LatticePoint::new(1_000_000 + x as i32, 1_000_000 + y as i32, 1_000_000));
            m.triangles.push([0, 1 + i, 1 + (i + 1) % n]);
            m.borders.push(2);
        }
        let coarse = simplify(&m, &Locked::default(), n as usize / 2, Purpose::Level(Precision::default())).mesh;
        assert_eq!(coarse.triangle_count(), n as usize / 2);
    }

    #[test]
    fn a_rough_sheet_keeps_its_extent_down_to_forty_triangles() {
        for seed in 0..20 {
            let mut fine = sheet(32);
            for (i, p) in fine.positions.iter_mut().enumerate() {
                p[2] += ((i as i32 + seed) * 7919).rem_euclid(9);
            }
            let coarse = simplify(&fine, &Locked::default(), 40, Purpose::Level(Precision::default())).mesh;
            assert!(coarse.triangle_count() <= 41, "{}", coarse.triangle_count());
            let b = coarse.bounds();
            assert!((0..2).all(|i| b.min[i] <= 10 && b.max[i] >= 310), "seed {seed}: {b:?}");
        }
    }

    /// A closed pillow: two sheets, one over the other, that share their rim.
    fn pillow(n: u32) -> Mesh {
        let mut m = sheet(n);
        let edge = n as i32 * 10;
        let is_rim = |p: &LatticePoint| p[0] == 0 || p[1] == 0 || p[0] == edge || p[1] == edge;
        let below: Vec<u32> = (0..m.vertex_count())
            .map(|v| {
                if is_rim(&m.positions[v]) {
                    return v as u32;
                }
                let new = m.push_vertex_of(&m.clone(), v);
                m.positions[new as usize][2] = 400;
                new
            })
            .collect();
        let turned: Vec<[u32; 3]> = m.triangles.iter().map(|t| t.map(|v| below[v as usize])).collect();
        m.triangles.extend(turned.iter().map(|[a, b, c]| [*a, *c, *b]));
        m.borders = vec![0; m.triangles.len()];
        m
    }

    #[test]
    fn vertices_with_three_triangles_do_not_block_simplification() {
        // A point in the middle of every triangle: no edge between other points can collapse before these are gone.
        let mut fine = pillow(16);
        for t in 0..fine.triangle_count() {
            let [a, b, c] = fine.triangles[t];
            let at = fine.corners(t);
            let middle = fine.push_vertex_of(&fine.clone(), a as usize);
            fine.positions[middle as usize] = (at[0] + at[1] + at[2]) / 3;
            fine.triangles[t] = [a, b, middle];
            fine.triangles.extend([[b, c, middle], [c, a, middle]]);
            fine.borders.extend([0, 0]);
        }
        let coarse = simplify(&fine, &Locked::default(), 64, Purpose::Level(Precision::default()));
        assert!(coarse.mesh.triangle_count() <= 64, "{} triangles are left", coarse.mesh.triangle_count());
    }

    #[test]
    fn every_fine_vertex_is_merged_into_a_vertex_with_a_triangle() {
        // A sheet with flaps: triangles that hang on by one edge, and two by one point.
        let mut fine = sheet(12);
        let n = fine.positions.len() as u32;
        for i in 0..40u32 {
            fine.positions.push(LatticePoint::new(i as i32 * 3, i as i32 * 2, 540));
            fine.normals.push([0, 0]);
            fine.colors.push([1, 2, 3]);
            fine.scalars[0].push(1.0);
            fine.triangles.push([i * 4, i * 4 + 1, n + i]);
            fine.borders.push(0b110);
        }
        for target in [300, 200, 100, 20] {
            let s = simplify(&fine, &Locked::default(), target, Purpose::Level(Precision::default()));
            let mut used = vec![false; s.points];
            s.triangles.iter().flatten().for_each(|p| used[*p as usize] = true);
            assert!(s.coarse_of_fine.iter().all(|p| used[*p as usize]), "{target}");
        }
    }

    #[test]
    fn locked_vertices_keep_position_and_edges() {
        let fine = sheet(12);
        let locked: Locked = fine.positions.iter().copied().filter(|p| p[0] == 60).collect();
        let coarse = simplify(&fine, &locked, 10, Purpose::Level(Precision::default())).mesh;
        for p in &locked {
            assert!(coarse.positions.contains(p));
        }
        let edges = |m: &Mesh| {
            let mut found: Vec<[[i32; 3]; 2]> = (0..m.triangle_count())
                .flat_map(|t| {
                    let c = m.corners(t).map(|p| p.to_array());
                    [0, 1, 2].map(|k| [c[k].min(c[(k + 1) % 3]), c[k].max(c[(k + 1) % 3])])
                })
                .filter(|e| e.iter().all(|p| locked.contains(&LatticePoint::from(*p))))
                .collect();
            found.sort_unstable();
            found
        };
        assert_eq!(edges(&fine), edges(&coarse));
        assert!(coarse.triangle_count() < fine.triangle_count() / 2);
    }

    type Locked = rustc_hash::FxHashSet<LatticePoint>;
}
