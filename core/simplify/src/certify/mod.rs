//! The certified two-sided error of one simplification step, and its accumulation to a bound against the finest surface.
//!
//! The distance from a point of a triangle T to *one* triangle T' is convex over T, so the largest of the distances of
//! the corners of a convex piece of T to T' bounds it for the whole piece. T is covered with pieces (`overlay`), each
//! certified against the triangle that it lies over.
//!
//! Carried per triangle of a patch, in lattice units, both against the *finest* surface:
//! `out` – every point of this triangle is within `out` of the finest surface;
//! `back` – every point of the finest surface that is accounted to this triangle is within `back` of it.
//! Every point of the finest surface is accounted to some triangle of every level, so the largest `back` bounds the
//! other direction.
//!
//! Which triangles to compare with is known from the simplification ([`Simplified`]): a fine triangle's corners were
//! merged into points of the coarse surface, and the triangles round these are its candidates, and the other way round.

mod overlay;
mod polygon;
mod surface;
mod view;
mod walk;

use crate::simplify::{PRUNED, Simplified};
use kilwa_geometry::Mesh;
use kilwa_geometry::distance::{ABSOLUTE_SLACK, DISTANCE_SLACK, point_triangle_squared};
use overlay::Cover;
use surface::{Candidates, NONE, Surface};
use walk::Walker;

/// A piece whose bound is this close to what is surely there is tight enough.
const TIGHT: f64 = 1.25;
/// Pieces bounded by this share of the largest distance found so far do not decide anything.
const UNIMPORTANT: f64 = 0.9;

/// Bounds of one triangle against the finest surface, in lattice units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bound {
    /// From this triangle to the finest surface.
    pub out: f32,
    /// From the finest surface accounted to this triangle, to it.
    pub back: f32,
}

/// Bounds for every triangle of the coarse mesh, given those of `fine`, which it replaces.
pub fn certify(fine: &Mesh, fine_bounds: &[Bound], simplified: &Simplified) -> Vec<Bound> {
    let (f, c) = surfaces(fine, simplified);
    // Triangles that both share are exact and need no comparison.
    let mut twin_in_coarse = vec![NONE; f.triangles.len()];
    let mut twin_in_fine = vec![NONE; c.triangles.len()];
    for (i, &from) in simplified.from.iter().enumerate() {
        if c.triangle(i as u32) == f.triangle(from) {
            twin_in_coarse[from as usize] = i as u32;
            twin_in_fine[i] = from;
        }
    }
    let mut bounds = vec![Bound::default(); c.triangles.len()];
    let mut sure = vertices_away(&f, &c);
    // A fine triangle over each coarse one, from where to start in the other direction.
    let mut over = vec![NONE; c.triangles.len()];
    // From fine to coarse: what was accounted to a fine triangle is now accounted to the coarse ones that it lies over.
    let mut direction = Direction::new(&f, &c);
    for (i, carried) in fine_bounds.iter().map(|b| b.back).enumerate() {
        let twin = twin_in_coarse[i];
        if twin != NONE {
            let b = &mut bounds[twin as usize].back;
            *b = b.max(carried);
            continue;
        }
        sure = direction.cover(i as u32, NONE, sure, |to, d| {
            over[to as usize] = i as u32;
            let b = &mut bounds[to as usize].back;
            *b = b.max(add_up(d, carried));
        });
    }
    // From coarse to fine.
    let mut direction = Direction::new(&c, &f);
    for i in 0..c.triangles.len() {
        let twin = twin_in_fine[i];
        let out = &mut bounds[i].out;
        if twin != NONE {
            *out = fine_bounds[twin as usize].out;
            continue;
        }
        sure = direction.cover(i as u32, over[i], sure, |to, d| {
            *out = out.max(add_up(d, fine_bounds[to as usize].out));
        });
    }
    bounds
}

/// The fine and the coarse surface.
fn surfaces(fine: &Mesh, simplified: &Simplified) -> (Surface, Surface) {
    let origin = fine.bounds().min;
    let kept = |(c, _): &(&u32, u32)| **c != PRUNED;
    let pairs = simplified.coarse_of_fine.iter().zip(0u32..).filter(kept).map(|(c, f)| (*c, f));
    let triangles = fine.triangles.iter().map(|t| t.map(|v| simplified.fine_point[v as usize])).collect();
    let others = pairs.clone().map(|(c, f)| (f, c));
    let f = Surface::new(fine, origin, triangles, simplified.coarse_of_fine.len(), others);
    let c = Surface::new(&simplified.mesh, origin, simplified.triangles.clone(), simplified.points, pairs);
    (f, c)
}

/// Covers the triangles of one surface with pieces over the other's.
struct Direction<'a> {
    from: &'a Surface,
    to: &'a Surface,
    walker: Walker<'a>,
    cover: Cover<'a>,
    candidates: Candidates,
}

impl<'a> Direction<'a> {
    fn new(from: &'a Surface, to: &'a Surface) -> Self {
        let candidates = Candidates::new(to.triangles.len());
        Self { from, to, walker: Walker::new(from, to), cover: Cover::new(to), candidates }
    }

    /// Cover triangle `t` and report pairs of an opposite triangle and a distance. `start` is an opposite triangle to begin
    /// with, where one is known. `sure` is a distance that is there; returns it raised by what was found.
    fn cover(&mut self, t: u32, start: u32, sure: f64, mut report: impl FnMut(u32, f64)) -> f64 {
        let corners = self.from.triangles[t as usize];
        let triangle = self.from.triangle(t);
        let mut along = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
        let others = corners.into_iter().filter_map(|p| self.from.others.of(p).first());
        for p in others {
            along += self.to.normals[*p as usize];
        }
        let unimportant = sure * UNIMPORTANT;
        let (from, to) = (self.from, self.to);
        let mut order = corners;
        if to.has_hubs {
            // The walk is given up after a few triangles; those at a hub would be the wrong ones.
            order.sort_by_key(|p| from.others.of(*p).iter().any(|q| to.is_hub(*q)));
        }
        let fans = order.into_iter().flat_map(|p| from.others.of(p)).flat_map(|q| to.fan(*q)).copied();
        let starts = (start != NONE).then_some(start).into_iter().chain(fans);
        if self.walker.cover(&triangle, corners, along, starts, unimportant) {
            self.walker.pieces.iter().for_each(|(c, d)| report(*c, *d));
            if self.walker.far.is_empty() {
                return sure;
            }
            self.candidates.clear();
            for c in self.walker.visited() {
                self.candidates.add(*c);
            }
            self.candidates.round(corners, self.from, self.to);
            return sure.max(self.cover.parts(&self.walker.far, &mut self.candidates, unimportant, &mut report));
        }
        self.candidates.clear();
        self.candidates.round(corners, self.from, self.to);
        if self.candidates.list.is_empty() {
            // Nothing corresponds to it: its component was left out.
            let (to, d) = self.cover.anywhere(&triangle);
            report(to, d);
            return sure;
        }
        sure.max(self.cover.triangle(&triangle, along, &mut self.candidates, unimportant, &mut report))
    }
}

/// The largest distance of a point of the fine surface from the coarse one: a distance that is there, which tells how
/// much effort the rest is worth.
fn vertices_away(fine: &Surface, coarse: &Surface) -> f64 {
    let mut away: Vec<(f64, u32)> = Vec::new();
    // A sample is enough: a smaller distance only means more effort.
    for (p, i) in fine.points.iter().zip(0u32..).step_by(8) {
        let mut near = f64::MAX;
        for q in fine.others.of(i) {
            if coarse.points[*q as usize] == *p {
                near = 0.0;
                break;
            }
            for t in coarse.fan(*q) {
                near = near.min(point_triangle_squared(*p, coarse.triangle(*t)));
            }
        }
        if near > 0.0 && near < f64::MAX {
            away.push((near, i));
        }
    }
    // The worst ones again, among more candidates.
    away.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut candidates = Candidates::new(coarse.triangles.len());
    let mut sure = 0.0f64;
    for (at_most, i) in away {
        if at_most <= sure {
            break;
        }
        candidates.clear();
        for t in fine.fan(i) {
            candidates.round(fine.triangles[*t as usize], fine, coarse);
        }
        candidates.grow(coarse);
        let p = fine.points[i as usize];
        let near = candidates.list.iter().map(|t| point_triangle_squared(p, coarse.triangle(*t)));
        sure = sure.max(near.fold(f64::MAX, f64::min));
    }
    sure.sqrt()
}

/// `d + carried` rounded up to f32, with the slack of the distance computation.
fn add_up(d: f64, carried: f32) -> f32 {
    let sum = d * (1.0 + DISTANCE_SLACK) + ABSOLUTE_SLACK + f64::from(carried);
    let f = sum as f32;
    if f64::from(f) < sum { f.next_up() } else { f }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::precision::Precision;
    use crate::simplify::{Purpose, simplify};
    use kilwa_geometry::LatticePoint;
    use proptest::prelude::*;
    use std::collections::HashSet;

    /// A sheet of rough ground, with a fold where `fold` is set: there it comes back under itself.
    fn ground(seed: i32, rough: i32, fold: bool) -> Mesh {
        let mut m = Mesh::default();
        let n = 24;
        for y in 0..=n {
            for x in 0..=n {
                let z = 500 + (((x * 31 + y * 17 + seed) * 7919).rem_euclid(rough.max(1)));
                let back = if fold && x > n / 2 { 2 * (n / 2) - x } else { x };
                let z = if fold && x > n / 2 { z - 70 } else { z };
                m.positions.push(LatticePoint::new(back * 10 + 300, y * 10, z));
                m.normals.push([0, 0]);
            }
        }
        let w = n as u32 + 1;
        for y in 0..n as u32 {
            for x in 0..n as u32 {
                let i = y * w + x;
                m.triangles.extend([[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]);
                let (left, right) = (u8::from(x == 0) << 2, u8::from(x == n as u32 - 1));
                let (bottom, top) = (u8::from(y == 0), u8::from(y == n as u32 - 1) << 1);
                m.borders.extend([left | bottom, right | top]);
            }
        }
        m
    }

    fn sampled(from: &Mesh, to: &Mesh) -> f64 {
        let tri = |m: &Mesh, t| m.corners(t).map(glam::IVec3::as_dvec3);
        let mut worst = 0.0f64;
        for t in 0..from.triangle_count() {
            let [a, b, c] = tri(from, t);
            for i in 0..=5 {
                for j in 0..=(5 - i) {
                    let (u, v) = (f64::from(i) / 5.0, f64::from(j) / 5.0);
                    let p = a + (b - a) * u + (c - a) * v;
                    let all = (0..to.triangle_count()).map(|s| point_triangle_squared(p, tri(to, s)));
                    worst = worst.max(all.fold(f64::MAX, f64::min).sqrt());
                }
            }
        }
        worst
    }

    fn nothing() -> HashSet<LatticePoint> {
        HashSet::new()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20))]
        #[test]
        fn the_bound_holds_in_both_directions(
            seed in 0i32..1000, rough in 1i32..40, keep in 2usize..12, fold in any::<bool>(),
        ) {
            let fine = ground(seed, rough, fold);
            let simplified = simplify(&fine, &nothing(), fine.triangle_count() / keep, Purpose::Level(Precision::default()));
            let coarse = &simplified.mesh;
            let bounds = certify(&fine, &vec![Bound::default(); fine.triangle_count()], &simplified);
            let out = f64::from(bounds.iter().map(|b| b.out).fold(0.0, f32::max));
            let back = f64::from(bounds.iter().map(|b| b.back).fold(0.0, f32::max));
            // Each triangle by itself: the largest bound must not hide a wrong one.
            let (f, c) = surfaces(&fine, &simplified);
            let mut direction = Direction::new(&f, &c);
            let mut sure = vertices_away(&f, &c);
            for t in 0..fine.triangle_count() {
                let mut bound = 0.0f64;
                sure = direction.cover(t as u32, NONE, sure, |_, d| bound = bound.max(d));
                let one = Mesh { positions: fine.positions.clone(), triangles: vec![fine.triangles[t]], ..Mesh::default() };
                let there = sampled(&one, coarse);
                prop_assert!(there <= bound + 1e-9, "fine triangle {t}: {there} <= {bound}");
            }
            for (t, b) in bounds.iter().enumerate() {
                let one = Mesh { positions: coarse.positions.clone(), triangles: vec![coarse.triangles[t]], ..Mesh::default() };
                let there = sampled(&one, &fine);
                prop_assert!(there <= f64::from(b.out) + 1e-9, "triangle {t}: {there} <= {}", b.out);
            }
            let (so, sb) = (sampled(coarse, &fine), sampled(&fine, coarse));
            prop_assert!(so <= out && sb <= back, "{so} <= {out}, {sb} <= {back}");
        }
    }

    #[test]
    fn the_bound_is_tight() {
        let mut ratios = Vec::new();
        for case in 0..24 {
            let fine = ground(case * 41, 1 + case % 13 * 3, case % 2 == 1);
            let simplified = simplify(
                &fine,
                &nothing(),
                fine.triangle_count() / (2 + case as usize % 7),
                Purpose::Level(Precision::default()),
            );
            let bounds = certify(&fine, &vec![Bound::default(); fine.triangle_count()], &simplified);
            let bound = bounds.iter().map(|b| f64::from(b.out.max(b.back))).fold(0.0, f64::max);
            ratios.push(bound / sampled(&simplified.mesh, &fine).max(sampled(&fine, &simplified.mesh)).max(0.1));
        }
        ratios.sort_unstable_by(f64::total_cmp);
        assert!(ratios[12] <= 1.3, "{ratios:?}");
        // Where sheets lie close together the effort is steered by too large a distance.
        assert!(ratios[23] <= 2.5, "{ratios:?}");
    }

    #[test]
    fn an_unchanged_mesh_keeps_its_bound() {
        let m = ground(3, 20, false);
        let given = vec![Bound { out: 1.5, back: 2.5 }; m.triangle_count()];
        let simplified = simplify(&m, &nothing(), m.triangle_count(), Purpose::Level(Precision::default()));
        assert_eq!(certify(&m, &given, &simplified), given);
    }

    #[test]
    fn the_bound_holds_where_walls_meet_at_edges_and_where_triangles_have_no_area() {
        // A box with long thin triangles, one of them a needle without area on an edge.
        let mut m = Mesh::default();
        let n = 16;
        for x in 0..=n {
            for (y, z) in [(0, 0), (100, 0), (100, 100), (0, 100)] {
                m.positions.push(LatticePoint::new(x * 13 + (x * x) % 5, y, z));
                m.normals.push([0, 0]);
            }
        }
        for x in 0..n as u32 {
            for k in 0..4 {
                let (a, b) = (x * 4 + k, x * 4 + (k + 1) % 4);
                m.triangles.extend([[a, b, a + 4], [b, b + 4, a + 4]]);
                let (first, last) = (u8::from(x == 0), u8::from(x == n as u32 - 1) << 1);
                m.borders.extend([first, last]);
            }
        }
        m.triangles.push([0, 4, 8]);
        m.borders.push(4);
        let simplified = simplify(&m, &nothing(), 12, Purpose::Level(Precision::default()));
        let bounds = certify(&m, &vec![Bound::default(); m.triangle_count()], &simplified);
        let bound = f64::from(bounds.iter().map(|b| b.out.max(b.back)).fold(0.0, f32::max));
        assert!(sampled(&m, &simplified.mesh) <= bound && sampled(&simplified.mesh, &m) <= bound);
    }

    #[test]
    fn the_bound_includes_thousands_of_omitted_islands() {
        let mut m = Mesh::default();
        for i in 0..1500i32 {
            let at = LatticePoint::new((i * 7919) % 10_007, (i * 104_729) % 10_009, (i * 1299) % 5003);
            let first = m.positions.len() as u32;
            for d in [[0, 0, 0], [9 + i % 30, 0, 0], [0, 11, 0], [0, 0, 8]] {
                m.positions.push(at + LatticePoint::from(d));
                m.normals.push([0, 0]);
            }
            for t in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
                m.triangles.push(t.map(|v| first + v));
                m.borders.push(0);
            }
        }
        let simplified = simplify(&m, &nothing(), m.triangle_count() / 2, Purpose::Level(Precision::default()));
        assert!(simplified.mesh.triangle_count() <= m.triangle_count() / 2, "islands do not stay at full number");
        let bounds = certify(&m, &vec![Bound::default(); m.triangle_count()], &simplified);
        let back = f64::from(bounds.iter().map(|b| b.back).fold(0.0, f32::max));
        let out = f64::from(bounds.iter().map(|b| b.out).fold(0.0, f32::max));
        let there = sampled(&m, &simplified.mesh);
        assert!(there > 50.0 && there <= back && back <= there * 1.6, "{there} {back}");
        assert!(out < 0.1, "what is left has not moved: {out}");
    }
}
