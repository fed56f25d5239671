//! Covering a triangle with convex pieces, each within a known distance of one triangle of the other surface.
//!
//! A piece is what lies over one opposite triangle, seen along the normal of the triangle that is covered. The distance
//! from a point of the piece to that opposite triangle is convex, so the largest of the distances of the piece's corners
//! bounds all of it. What no opposite triangle lies over (folds, rims, steep places) is divided and compared with all
//! candidates. Every point of the triangle is in some piece, whatever the candidates are: a bad choice of candidates
//! gives a loose bound, never a wrong one.

use super::polygon::{Cut, Polygon};
use super::surface::{Candidates, Surface, Triangle};
use super::view::{Frame, ON_LINE, Seen};
use glam::DVec3;
use kilwa_geometry::bvh::{Bounds, Bvh};
use kilwa_geometry::distance::point_triangle_squared;

/// Halvings after which a piece that is still loose is compared with everything.
const TRUSTED: u32 = 3;
/// It is where its bound exceeds the limit this many times.
const LOOSE: f64 = 1.2;
/// Triangles of the other surface that a search of all of it compares with at most. Where thousands lie at one place no tree
/// can tell them apart; what is found by then is as good, and a bound all the same.
const MAX_COMPARED: u32 = 256;
/// Halvings of what no triangle lies over, after which a loose bound is accepted (it is a bound all the same).
const MAX_HALVINGS: u32 = 12;

/// Covers triangles with pieces over the triangles of one surface.
pub(super) struct Cover<'a> {
    to: &'a Surface,
    open: Vec<Polygon>,
    next: Vec<Polygon>,
    pieces: Vec<(Triangle, u32)>,
    opposite: Vec<Opposite>,
    /// The other surface, searched as a whole; made where it is needed.
    whole: Option<Whole>,
}

/// An opposite triangle and the box round it.
struct Opposite {
    number: u32,
    triangle: Triangle,
    low: DVec3,
    high: DVec3,
}

impl Opposite {
    fn new(number: u32, triangle: Triangle) -> Self {
        let [a, b, c] = triangle;
        Self { number, triangle, low: a.min(b).min(c), high: a.max(b).max(c) }
    }

    /// Squared distance to the box.
    fn box_squared(&self, p: &DVec3) -> f64 {
        (self.low - *p).max(*p - self.high).max(DVec3::ZERO).length_squared()
    }
}

struct Whole {
    triangles: Vec<Triangle>,
    tree: Bvh,
}

impl<'a> Cover<'a> {
    pub(super) fn new(to: &'a Surface) -> Self {
        Self { to, open: Vec::new(), next: Vec::new(), pieces: Vec::new(), opposite: Vec::new(), whole: None }
    }

    /// Cover `t` with pieces over the triangles `candidates` of `to` (at least one), as seen along `direction`, and report
    /// for each the candidate and a distance that no point of the piece exceeds. What is not within `unimportant` of the
    /// triangle that it lies over is compared with these and the triangles round them, and divided until the bound is
    /// tight or no more than `unimportant`. Returns a distance that is there.
    pub(super) fn triangle(
        &mut self,
        t: &Triangle,
        direction: DVec3,
        candidates: &mut Candidates,
        unimportant: f64,
        report: &mut impl FnMut(u32, f64),
    ) -> f64 {
        if self.look(t, direction, &candidates.list, unimportant, report) {
            return 0.0;
        }
        self.search(candidates, unimportant, report)
    }

    /// Cover some triangles with pieces, not looking along a direction but for the nearest candidates; see
    /// [`Self::triangle`].
    pub(super) fn parts(
        &mut self,
        parts: &[Triangle],
        candidates: &mut Candidates,
        unimportant: f64,
        report: &mut impl FnMut(u32, f64),
    ) -> f64 {
        self.pieces.clear();
        self.pieces.extend(parts.iter().map(|p| (*p, 0)));
        self.search(candidates, unimportant, report)
    }

    /// Cover what can be seen along `direction` within `limit`; the rest is put on the list of pieces. Whether that is empty.
    fn look(
        &mut self,
        t: &Triangle,
        direction: DVec3,
        candidates: &[u32],
        limit: f64,
        report: &mut impl FnMut(u32, f64),
    ) -> bool {
        self.pieces.clear();
        let view = Frame::along(direction, t[0]).and_then(|f| Seen::of(t.map(|p| f.inside(p))).map(|s| (f, s)));
        let Some((frame, own)) = view else {
            self.pieces.push((*t, 0));
            return false;
        };
        self.open.clear();
        self.open.push(Polygon::triangle(own.flat));
        for &c in candidates {
            let triangle = self.to.triangle(c);
            let Some(seen) = Seen::of(triangle.map(|p| frame.inside(p))) else { continue };
            let apart = |a: &Seen, b: &Seen| a.edges.iter().any(|e| b.flat.iter().all(|p| e.excludes(p)));
            if apart(&own, &seen) || apart(&seen, &own) {
                continue;
            }
            self.take(&seen, &own, &frame, (c, &triangle), limit, report);
            if self.open.is_empty() {
                return true;
            }
        }
        for p in self.open.drain(..) {
            let corners = p.corners();
            let first = own.lift(&corners[0], &frame);
            for k in 1..corners.len().saturating_sub(1) {
                self.pieces.push(([first, own.lift(&corners[k], &frame), own.lift(&corners[k + 1], &frame)], 0));
            }
        }
        false
    }

    /// Take from the open polygons what lies over one opposite triangle.
    fn take(
        &mut self,
        seen: &Seen,
        own: &Seen,
        frame: &Frame,
        (c, opposite): (u32, &Triangle),
        limit: f64,
        report: &mut impl FnMut(u32, f64),
    ) {
        self.next.clear();
        for p in self.open.drain(..) {
            let before = self.next.len();
            let mut inside = p;
            let mut whole = true;
            for line in &seen.edges {
                match inside.cut(line) {
                    Cut::Inside => {}
                    Cut::Both(left, right) => {
                        inside = left;
                        self.next.push(right);
                    }
                    Cut::Outside | Cut::Full => {
                        whole = false;
                        break;
                    }
                }
            }
            let distance = if whole { between(&inside, seen, own, frame, opposite) } else { f64::INFINITY };
            if distance <= limit {
                report(c, distance);
            } else {
                self.next.truncate(before);
                self.next.push(p);
            }
        }
        std::mem::swap(&mut self.open, &mut self.next);
    }

    /// Of all triangles of the other surface the one that makes the largest distance of a corner of `t` to it smallest, or
    /// nearly so, and that distance.
    pub(super) fn anywhere(&mut self, t: &Triangle) -> (u32, f64) {
        let to = self.to;
        let whole = self.whole.get_or_insert_with(|| {
            let triangles: Vec<Triangle> = (0..to.triangles.len() as u32).map(|t| to.triangle(t)).collect();
            Whole { tree: Bvh::new(&triangles), triangles }
        });
        let (mut best, mut compared) = ((f64::INFINITY, 0), 0);
        let lower = |b: &Bounds| Some(t.iter().map(|p| b.distance_squared(*p)).fold(0.0, f64::max));
        whole.tree.search(f64::INFINITY, lower, |c, _| {
            let d = t.iter().map(|p| point_triangle_squared(*p, whole.triangles[c as usize])).fold(0.0, f64::max);
            if d < best.0 {
                best = (d, c);
            }
            compared += 1;
            // Nothing is below a limit of zero.
            if compared < MAX_COMPARED { best.0 } else { 0.0 }
        });
        (best.1, best.0.sqrt())
    }

    /// Certify the pieces on the list with the best candidate for each, dividing where that is loose. The triangles round
    /// the candidates are added when these do not suffice. Returns the largest distance found to be there.
    fn search(&mut self, candidates: &mut Candidates, unimportant: f64, report: &mut impl FnMut(u32, f64)) -> f64 {
        self.opposite.clear();
        self.opposite.extend(candidates.list.iter().map(|c| Opposite::new(*c, self.to.triangle(*c))));
        let mut grown = false;
        let mut sure = 0.0f64;
        while let Some((piece, depth)) = self.pieces.pop() {
            let (mut lower, mut best) = nearest(&piece, &mut self.opposite);
            if best.0 > unimportant * unimportant && !grown {
                grown = true;
                let before = candidates.list.len();
                candidates.grow(self.to);
                let new = candidates.list[before..].iter();
                self.opposite.extend(new.map(|c| Opposite::new(*c, self.to.triangle(*c))));
                (lower, best) = nearest(&piece, &mut self.opposite);
            }
            let (mut lower, mut bound) = (lower.sqrt(), best.0.sqrt());
            // The candidates may not be what is nearest: before they decide the bound, everything is asked.
            if depth >= TRUSTED && bound > unimportant * LOOSE && bound > lower * super::TIGHT + ON_LINE {
                let (c, d) = self.anywhere(&piece);
                if d < bound {
                    (bound, best.1) = (d, c);
                }
                lower = piece.iter().map(|p| self.anywhere(&[*p; 3]).1).fold(0.0, f64::max);
            }
            if grown {
                sure = sure.max(lower);
            }
            if bound <= unimportant || bound <= lower * super::TIGHT + ON_LINE || depth >= MAX_HALVINGS {
                report(best.1, bound);
                continue;
            }
            let near = self.to.triangle(best.1);
            divide(&piece, &near, &mut |part| self.pieces.push((part, depth + 1)));
        }
        sure
    }
}

/// The largest of the corners' distances to their nearest candidates; and the candidate whose largest distance from a
/// corner is smallest, with that distance. All squared.
fn nearest(piece: &Triangle, candidates: &mut [Opposite]) -> (f64, (f64, u32)) {
    let mut best = (f64::INFINITY, 0);
    let mut there = [f64::INFINITY; 3];
    for (i, c) in candidates.iter().enumerate() {
        let lower = [0, 1, 2].map(|k: usize| c.box_squared(&piece[k]));
        // A corner's distance to the box decides nothing where it is no smaller than what is known.
        if (lower[0] >= best.0 || lower[1] >= best.0 || lower[2] >= best.0) && (0..3).all(|k| lower[k] >= there[k]) {
            continue;
        }
        let d = piece.map(|p| point_triangle_squared(p, c.triangle));
        let worst = d[0].max(d[1]).max(d[2]);
        if worst < best.0 {
            best = (worst, i);
        }
        for k in 0..3 {
            there[k] = there[k].min(d[k]);
        }
    }
    let number = candidates.get(best.1).map_or(u32::MAX, |c| c.number);
    // The next piece lies beside this one: what was nearest comes first, and rules the rest out.
    if best.1 < candidates.len() {
        candidates.swap(0, best.1);
    }
    (there[0].max(there[1]).max(there[2]), (best.0, number))
}

/// A cut must leave at least this share of the longest edge on both sides.
const WORTH_CUTTING: f64 = 0.05;

/// Divide a piece: along the side of `near` that it sticks out over, so that one part lies over `near` alone (there the
/// bound is exact, being the distance to a plane); where no side divides it well, across its longest edge.
fn divide(piece: &Triangle, near: &Triangle, part: &mut impl FnMut(Triangle)) {
    let length = |k: usize| piece[k].distance_squared(piece[(k + 1) % 3]);
    let longest = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    let n = (near[1] - near[0]).cross(near[2] - near[0]);
    let enough = length(longest).sqrt() * WORTH_CUTTING;
    let mut best: Option<([f64; 3], f64)> = None;
    for k in 0..3 {
        // Pointing out of the triangle across this side.
        let out = (near[(k + 1) % 3] - near[k]).cross(n);
        let len = out.length();
        if len <= 0.0 {
            continue;
        }
        let s = piece.map(|p| (p - near[k]).dot(out) / len);
        let (low, high) = (s.iter().copied().fold(f64::MAX, f64::min), s.iter().copied().fold(f64::MIN, f64::max));
        if low < -enough && high > enough && best.is_none_or(|b| high > b.1) {
            best = Some((s, high));
        }
    }
    let between = |i: usize, j: usize, t: f64| piece[i].lerp_monotonic(piece[j], t);
    let Some((s, _)) = best else {
        let (i, j, k) = (longest, (longest + 1) % 3, (longest + 2) % 3);
        let m = between(i, j, 0.5);
        part([piece[i], m, piece[k]]);
        part([m, piece[j], piece[k]]);
        return;
    };
    // The corner that is alone on its side.
    let outside = s.map(|x| x > 0.0);
    let alone = (0..3).find(|&k| outside[k] != outside[(k + 1) % 3] && outside[k] != outside[(k + 2) % 3]).unwrap_or(0);
    let (q, r) = ((alone + 1) % 3, (alone + 2) % 3);
    let a = between(alone, q, s[alone] / (s[alone] - s[q]));
    let b = between(alone, r, s[alone] / (s[alone] - s[r]));
    part([piece[alone], a, b]);
    part([a, piece[q], piece[r]]);
    part([a, piece[r], b]);
}

/// Largest distance of a piece of `own` to the triangle that it lies over.
fn between(piece: &Polygon, seen: &Seen, own: &Seen, frame: &Frame, opposite: &Triangle) -> f64 {
    let highest = seen.height_over(own, piece.corners());
    if !seen.is_steep() {
        return highest;
    }
    let exact = piece.corners().iter().map(|p| point_triangle_squared(own.lift(p, frame), *opposite));
    exact.fold(0.0, f64::max).sqrt().min(highest)
}
