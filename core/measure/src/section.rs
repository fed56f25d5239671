//! Sections: where a plane cuts the surface, as polylines.
//!
//! Input: triangles on the lattice, in any order, from any number of chunks. A corner counts as above the plane where its
//! distance is not negative, so that a plane through corners or along edges needs no special case (Edelsbrunner and Mücke,
//! "Simulation of simplicity", 1990, in its simplest form). Crossing points are known by the edge that they lie on, and
//! edges by their two lattice points, so that polylines join exactly, also from chunk to chunk. Invariants: every cut
//! triangle gives one piece; a closed surface gives closed polylines. The result does not depend on the order of triangles.

use crate::plane::Plane;
use crate::refusal::{Refusal, Target};
use crate::space::Space;
use glam::{DVec2, DVec3};
use kilwa_geometry::LatticePoint;
use std::collections::BTreeMap;

/// An edge of the surface: its ends, the smaller first.
type Edge = [[i32; 3]; 2];

/// Pieces of a section, not joined yet.
#[derive(Debug, Clone)]
pub struct Cutter {
    space: Space,
    plane: Plane,
    pieces: Vec<[Edge; 2]>,
}

/// One line of a section.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyline {
    /// Its points, local metres; a closed line does not repeat the first. Seen against the plane's normal, the material is on the left.
    pub points: Vec<DVec3>,
    /// Whether the last point is joined to the first.
    pub closed: bool,
}

impl Polyline {
    /// Its length, metres.
    pub fn length(&self) -> f64 {
        let open: f64 = self.points.windows(2).map(|w| (w[1] - w[0]).length()).sum();
        match (self.closed, self.points.first(), self.points.last()) {
            (true, Some(first), Some(last)) => open + (*first - *last).length(),
            _ => open,
        }
    }
}

impl Polyline {
    /// Sum over all points of the squared rate at which the area inside changes when the point moves at random: a point
    /// between neighbours that are `d` apart changes it by `d / 2` for each unit. Times the variance of a coordinate it is that of the area.
    pub fn squares(&self) -> f64 {
        let n = self.points.len();
        let apart = |i: usize| (self.points[(i + 1) % n] - self.points[(i + n - 1) % n]).length() * 0.5;
        (0..n).map(|i| apart(i) * apart(i)).sum()
    }
}

/// A joined section.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// The plane.
    pub plane: Plane,
    /// Its lines, longest first.
    pub polylines: Vec<Polyline>,
    /// Triangles cut.
    pub triangles: u64,
}

impl Section {
    /// Sum of all lengths, metres.
    pub fn length(&self) -> f64 {
        self.polylines.iter().map(Polyline::length).sum()
    }

    /// Area of the material in the section where every line is closed, square metres: outlines less their holes.
    pub fn area(&self) -> Option<f64> {
        if self.polylines.iter().any(|p| !p.closed) {
            return None;
        }
        let flat = |p: &Polyline| -> Vec<DVec2> { p.points.iter().map(|q| self.plane.coordinates(*q)).collect() };
        Some(self.polylines.iter().map(|p| crate::polygon::signed_area(&flat(p))).sum())
    }
}

impl Cutter {
    /// Nothing cut yet.
    pub fn new(space: Space, plane: Plane) -> Self {
        Self { space, plane, pieces: Vec::new() }
    }

    /// Whether the plane may cut something inside a box of the lattice; never wrongly `false`.
    pub fn meets(&self, low: LatticePoint, high: LatticePoint) -> bool {
        let (low, high) = (self.space.local_from_lattice(low), self.space.local_from_lattice(high));
        let n = self.plane.normal;
        let ahead = n.cmpge(DVec3::ZERO);
        let (far, near) = (DVec3::select(ahead, high, low), DVec3::select(ahead, low, high));
        let slack = self.space.step();
        self.plane.distance(far) >= -slack && self.plane.distance(near) <= slack
    }

    /// Cut one triangle, its corners counter-clockwise seen from outside.
    pub fn add(&mut self, corners: [LatticePoint; 3]) {
        let above = corners.map(|p| self.distance(p) >= 0.0);
        if above[0] == above[1] && above[1] == above[2] {
            return;
        }
        // Going round the triangle the plane is crossed once downwards and once upwards: the same edge is crossed the other way in
        // the neighbour, so that pieces follow each other from "downwards" to "upwards".
        let mut ends: [Option<Edge>; 2] = [None, None];
        for i in 0..3 {
            let j = (i + 1) % 3;
            if above[i] != above[j] {
                let (a, b) = (corners[i].to_array(), corners[j].to_array());
                let edge = if a <= b { [a, b] } else { [b, a] };
                ends[usize::from(!above[i])] = Some(edge);
            }
        }
        if let [Some(downwards), Some(upwards)] = ends {
            self.pieces.push([downwards, upwards]);
        }
    }

    /// Take the pieces of another cutter of the same plane.
    pub fn join(&mut self, other: Self) {
        self.pieces.extend(other.pieces);
    }

    fn distance(&self, p: LatticePoint) -> f64 {
        self.plane.distance(self.space.local_from_lattice(p))
    }

    fn crossing(&self, edge: Edge) -> DVec3 {
        let [a, b] = edge.map(LatticePoint::from);
        let (da, db) = (self.distance(a), self.distance(b));
        self.space.local_from_lattice(a).lerp_monotonic(self.space.local_from_lattice(b), da / (da - db))
    }

    /// Join the pieces.
    ///
    /// # Errors
    /// [`Refusal::Misses`] where nothing was cut.
    pub fn section(mut self) -> Result<Section, Refusal> {
        if self.pieces.is_empty() {
            let hint = "move it to where the model is".to_owned();
            return Err(Refusal::Misses { what: Target::Plane, hint });
        }
        self.pieces.sort_unstable();
        let triangles = self.pieces.len() as u64;
        let chains = chains(&self.pieces);
        let mut polylines: Vec<Polyline> = chains.iter().map(|(edges, closed)| self.polyline(edges, *closed)).collect();
        // Where the plane runs through corners, pieces of no length remain.
        polylines.retain(|p| p.points.len() > 1);
        polylines.sort_by(|a, b| b.length().total_cmp(&a.length()));
        Ok(Section { plane: self.plane, polylines, triangles })
    }

    fn polyline(&self, edges: &[Edge], closed: bool) -> Polyline {
        let mut points: Vec<DVec3> = edges.iter().map(|e| self.crossing(*e)).collect();
        points.dedup();
        while closed && points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        Polyline { points, closed }
    }
}

/// Follow the pieces: lines with ends first, then closed ones, each from its smallest edge.
fn chains(pieces: &[[Edge; 2]]) -> Vec<(Vec<Edge>, bool)> {
    // How many pieces leave an edge, and which; arrivals make an edge the inside of a line.
    let mut leaving: BTreeMap<Edge, Vec<usize>> = BTreeMap::new();
    let mut balance: BTreeMap<Edge, i64> = BTreeMap::new();
    for (i, [from, to]) in pieces.iter().enumerate().rev() {
        leaving.entry(*from).or_default().push(i);
        *balance.entry(*from).or_default() += 1;
        *balance.entry(*to).or_default() -= 1;
    }
    let starts: Vec<(Edge, i64)> = balance.into_iter().filter(|(_, b)| *b > 0).collect();
    let mut follow = |start: Edge| -> Option<Vec<Edge>> {
        let mut line = vec![start];
        let mut at = start;
        while let Some(piece) = leaving.get_mut(&at).and_then(Vec::pop) {
            at = pieces[piece][1];
            line.push(at);
        }
        (line.len() > 1).then_some(line)
    };
    let mut found = Vec::new();
    for (start, count) in starts {
        for _ in 0..count {
            found.extend(follow(start).map(|line| (line, false)));
        }
    }
    for [start, _] in pieces {
        while let Some(mut line) = follow(*start) {
            line.pop();
            found.push((line, true));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::Lattice;
    use proptest::prelude::*;

    fn space() -> Space {
        Space::new(Lattice { origin: DVec3::ZERO, step_log2: -10 })
    }

    /// A box with its sides divided, outside counter-clockwise.
    fn block(low: LatticePoint, size: i32, parts: i32) -> Vec<[LatticePoint; 3]> {
        let mut triangles = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (far, i, j) in (0..2).flat_map(|f| (0..parts).flat_map(move |i| (0..parts).map(move |j| (f, i, j)))) {
                let at = |a: i32, b: i32| {
                    let mut p = low;
                    p[axis] += far * size;
                    p[u] += (i + a) * size / parts;
                    p[v] += (j + b) * size / parts;
                    p
                };
                let (a, b, c, d) = (at(0, 0), at(1, 0), at(1, 1), at(0, 1));
                let both = if far == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                triangles.extend(both);
            }
        }
        triangles
    }

    fn cut(plane: Plane, triangles: &[[LatticePoint; 3]]) -> Result<Section, Refusal> {
        let mut cutter = Cutter::new(space(), plane);
        for t in triangles {
            cutter.add(*t);
        }
        cutter.section()
    }

    #[test]
    fn a_block_is_cut_to_one_closed_square_with_its_area_also_exactly_through_its_corners() {
        let triangles = block(LatticePoint::new(1024, 1024, 1024), 1024, 8);
        for z in [1.5, 1.3, 1.0 + 1.0 / 8.0, 1.0 + 1e-9] {
            let plane = Plane::new(DVec3::new(0.0, 0.0, z), DVec3::Z).unwrap();
            let s = cut(plane, &triangles).unwrap();
            assert_eq!(s.polylines.len(), 1, "{z}");
            assert!(s.polylines[0].closed);
            assert!((s.length() - 4.0).abs() < 1e-9 && (s.area().unwrap() - 1.0).abs() < 1e-9, "{z}: {:?}", s.area());
        }
        let above = Plane::new(DVec3::new(0.0, 0.0, 9.0), DVec3::Z).unwrap();
        assert!(matches!(cut(above, &triangles), Err(Refusal::Misses { .. })));
    }

    #[test]
    fn a_block_in_a_block_turned_inside_out_is_a_hole() {
        let mut triangles = block(LatticePoint::new(0, 0, 0), 4096, 4);
        triangles.extend(block(LatticePoint::new(1024, 1024, 1024), 2048, 4).iter().map(|[a, b, c]| [*a, *c, *b]));
        let plane = Plane::new(DVec3::new(2.0, 2.0, 2.0), DVec3::new(0.3, -0.2, 0.9)).unwrap();
        let s = cut(plane, &triangles).unwrap();
        assert_eq!(s.polylines.len(), 2);
        let outer = cut(plane, &block(LatticePoint::new(0, 0, 0), 4096, 4)).unwrap().area().unwrap();
        assert!(outer > 0.0 && s.area().unwrap() < outer);
        let level = Plane::new(DVec3::new(0.0, 0.0, 2.0), DVec3::Z).unwrap();
        assert!((cut(level, &triangles).unwrap().area().unwrap() - 12.0).abs() < 1e-9);
    }

    #[test]
    fn the_section_of_an_open_sheet_is_an_open_line() {
        let sheet = [[[0, 0, 0], [1024, 0, 0], [1024, 1024, 0]], [[0, 0, 0], [1024, 1024, 0], [0, 1024, 0]]]
            .map(|t| t.map(LatticePoint::from_array));
        let plane = Plane::new(DVec3::new(0.25, 0.0, 0.0), DVec3::X).unwrap();
        let s = cut(plane, &sheet).unwrap();
        assert_eq!((s.polylines.len(), s.polylines[0].closed, s.area()), (1, false, None));
        assert!((s.length() - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_section_of_a_closed_surface_is_closed_for_any_order_of_its_triangles(
            at in prop::array::uniform3(0.3f64..0.7).prop_map(DVec3::from),
            n in prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from), seed in any::<u64>(), on in prop::bool::ANY,
        ) {
            prop_assume!(n.length() > 0.1);
            let mut triangles = block(LatticePoint::new(0, 0, 0), 1024, 8);
            // Through lattice points half of the time.
            let at = if on { (at * 8.0).round() / 8.0 } else { at };
            let plane = Plane::new(at, if on { n.round() } else { n });
            let Ok(plane) = plane else { return Ok(()) };
            let Ok(first) = cut(plane, &triangles) else { return Ok(()) };
            prop_assert!(first.polylines.iter().all(|p| p.closed));
            fastrand::Rng::with_seed(seed).shuffle(&mut triangles);
            prop_assert_eq!(cut(plane, &triangles).unwrap(), first);
        }
    }
}
