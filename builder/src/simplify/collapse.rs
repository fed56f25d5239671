//! One edge collapse: where the merged point goes, whether the collapse is allowed, and doing it.

use super::{Candidate, NONE, Neighbour, Simplifier, local};
use kilwa_geometry::LatticePoint;
use kilwa_geometry::distance::{Vec3, cross, dot, sub};
use kilwa_geometry::lattice::MAX_COORDINATE;

/// What a point's edges say about it. Only meaningful for free points, all of whose triangles are inside.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Every edge is used twice.
    Smooth,
    /// Exactly two edges are used otherwise, both equally often: a border (once) or a non-manifold line.
    Line,
    /// Anything else: it keeps its place against all but its like.
    Corner,
}

fn kind(neighbours: &[Neighbour]) -> Kind {
    let mut odd = neighbours.iter().filter(|n| n.count != 2);
    match (odd.next(), odd.next(), odd.next()) {
        (None, ..) => Kind::Smooth,
        (Some(a), Some(b), None) if a.count == b.count => Kind::Line,
        _ => Kind::Corner,
    }
}

impl Simplifier<'_> {
    /// Where the merged point of an edge would go, or `None` when the edge cannot be collapsed at all.
    /// `remove` is free; `keep` may be locked.
    pub(super) fn target(&self, keep: u32, remove: u32) -> Option<LatticePoint> {
        let (pk, pr) = (&self.points[keep as usize], &self.points[remove as usize]);
        let nr = self.neighbours(remove);
        let edge = nr.iter().find(|n| n.point == keep)?.count;
        let kr = kind(&nr);
        // A point on a line of odd edges leaves along the line only; what it drags with it, the quadrics weigh.
        let odd = edge != 2;
        if pk.locked {
            return (kr == Kind::Smooth || odd).then_some(pk.at);
        }
        match (kind(&self.neighbours(keep)), kr) {
            (Kind::Smooth, Kind::Smooth) => Some(self.best_position(keep, remove)),
            (_, Kind::Smooth) => Some(pk.at),
            (Kind::Smooth, _) => Some(pr.at),
            _ if !odd => None,
            (Kind::Line, Kind::Line) => Some(self.best_position(keep, remove)),
            (Kind::Corner, Kind::Line) => Some(pk.at),
            (Kind::Line, Kind::Corner) => Some(pr.at),
            (Kind::Corner, Kind::Corner) => {
                let mut q = pk.quadric;
                q.add(&pr.quadric);
                Some(if q.at(pk.local) <= q.at(pr.local) { pk.at } else { pr.at })
            }
        }
    }

    /// The lattice point near the quadric's minimum, or the best of both ends and the middle.
    fn best_position(&self, a: u32, b: u32) -> LatticePoint {
        let (pa, pb) = (&self.points[a as usize], &self.points[b as usize]);
        let mut q = pa.quadric;
        q.add(&pb.quadric);
        let mid: Vec3 = std::array::from_fn(|i| (pa.local[i] + pb.local[i]) * 0.5);
        let e = sub(pa.local, pb.local);
        let reach = dot(e, e);
        let near = |p: &Vec3| {
            let d = sub(*p, mid);
            dot(d, d) <= reach
        };
        if let Some(p) = q.minimum().filter(near).and_then(|p| self.round(p)) {
            return p;
        }
        let mut best = (f64::INFINITY, pa.at);
        for p in self.round(mid).into_iter().chain([pa.at, pb.at]) {
            let cost = q.at(local(p, self.center));
            if cost < best.0 {
                best = (cost, p);
            }
        }
        best.1
    }

    fn round(&self, p: Vec3) -> Option<LatticePoint> {
        let mut out = [0; 3];
        for i in 0..3 {
            let x = p[i].round() + f64::from(self.center[i]);
            if !(0.0..=f64::from(MAX_COORDINATE)).contains(&x) {
                return None;
            }
            out[i] = x as i32;
        }
        Some(out)
    }

    /// Collapse an edge where it is allowed.
    pub(super) fn collapse(&mut self, c: &Candidate) {
        let (keep, remove) = (c.keep, c.remove);
        // Neighbours may have changed what these points are since the edge was queued.
        let Some(target) = self.target(keep, remove) else { return };
        if target != c.target {
            return self.propose(keep, remove);
        }
        if self.occupied.get(&target).is_some_and(|p| *p != keep && *p != remove) {
            return;
        }
        let (nk, nr) = (self.neighbours(keep), self.neighbours(remove));
        let Some(new_borders) = self.check_edges(keep, remove, &nk, &nr) else { return };
        if !self.check_triangles(keep, remove, target) {
            return;
        }
        self.apply(keep, remove, target, &new_borders);
        for n in self.neighbours(keep) {
            self.propose(keep, n.point);
        }
    }

    /// The link condition with counts. Returns the neighbours whose edge to the merged point is a true border afterwards
    /// though its triangle may change, or `None` when the collapse is not allowed.
    fn check_edges(&self, keep: u32, remove: u32, nk: &[Neighbour], nr: &[Neighbour]) -> Option<Vec<u32>> {
        let keep_locked = self.points[keep as usize].locked;
        let mut shared: Vec<(u32, u32)> = Vec::with_capacity(4);
        for c in self.corners_at(remove) {
            let [_, p1, p2] = self.triangle_from(c);
            let apex = if p1 == keep {
                p2
            } else if p2 == keep {
                p1
            } else {
                continue;
            };
            match shared.iter_mut().find(|s| s.0 == apex) {
                Some(s) => s.1 += 1,
                None => shared.push((apex, 1)),
            }
        }
        let mut new_borders = Vec::new();
        for r in nr.iter().filter(|r| r.point != keep) {
            let Ok(i) = nk.binary_search_by_key(&r.point, |n| n.point) else {
                // A new edge between two locked points might already exist outside.
                if keep_locked && self.points[r.point as usize].locked {
                    return None;
                }
                continue;
            };
            let k = &nk[i];
            // A common neighbour without a triangle between: the collapse would glue two sheets.
            let triangles = shared.iter().find(|s| s.0 == r.point)?.1;
            let after = (k.count + r.count).checked_sub(2 * triangles)?;
            if keep_locked && self.points[r.point as usize].locked {
                if after != k.count {
                    return None;
                }
                // A border of the scan stays one, though another triangle may now lie along it.
                if after == 1 && k.border {
                    new_borders.push(r.point);
                }
            } else if after == 1 {
                if !(k.border || r.border) {
                    return None;
                }
                new_borders.push(r.point);
            } else if after > 2 && after > k.count.max(r.count) {
                return None;
            }
        }
        Some(new_borders)
    }

    /// No doubled, flipped, degenerate or all-locked new triangle, and something is left at the merged point.
    fn check_triangles(&self, keep: u32, remove: u32, target: LatticePoint) -> bool {
        let target_local = local(target, self.center);
        let keep_locked = self.points[keep as usize].locked;
        let mut kept: Vec<[u32; 2]> = Vec::with_capacity(8);
        let moves = target != self.points[keep as usize].at;
        for c in self.corners_at(keep) {
            let [_, p, q] = self.triangle_from(c);
            if p == remove || q == remove {
                continue;
            }
            kept.push([p.min(q), p.max(q)]);
            if moves && !self.keeps_shape(keep, p, q, target_local) {
                return false;
            }
        }
        let mut left = !kept.is_empty();
        for c in self.corners_at(remove) {
            let [_, p, q] = self.triangle_from(c);
            if p == keep || q == keep {
                continue;
            }
            left = true;
            if kept.contains(&[p.min(q), p.max(q)]) || !self.keeps_shape(remove, p, q, target_local) {
                return false;
            }
            if keep_locked && self.points[p as usize].locked && self.points[q as usize].locked {
                return false;
            }
        }
        left
    }

    /// Whether triangle `(from, p, q)` keeps its orientation and an area when `from` moves to `to`.
    fn keeps_shape(&self, from: u32, p: u32, q: u32, to: Vec3) -> bool {
        let (lp, lq) = (self.points[p as usize].local, self.points[q as usize].local);
        let e = sub(lq, lp);
        let before = cross(e, sub(self.points[from as usize].local, lp));
        let after = cross(e, sub(to, lp));
        let (b2, a2, d) = (dot(before, before), dot(after, after), dot(before, after));
        if a2 <= 0.0 {
            return false;
        }
        // Turned by less than about 75 degrees; a triangle without area has no orientation to keep.
        b2 <= 0.0 || (d > 0.0 && d * d > 0.0625 * a2 * b2)
    }

    fn apply(&mut self, keep: u32, remove: u32, target: LatticePoint, new_borders: &[u32]) {
        let keep_locked = self.points[keep as usize].locked;
        // Wedges joined by a vanishing triangle become one; the others move along as they are.
        let mut joined: Vec<(u32, u32)> = Vec::with_capacity(4);
        let corners: Vec<u32> = self.corners_at(remove).collect();
        for &c in &corners {
            let t = c / 3;
            let other = (0..3).map(|k| t * 3 + k).find(|&o| o != c && self.point_of(o) == keep);
            if let Some(o) = other {
                let (from, to) = (self.corners[c as usize], self.corners[o as usize]);
                if !joined.iter().any(|j| j.0 == from) {
                    joined.push((from, to));
                }
                self.alive[t as usize] = false;
                self.triangles -= 1;
            }
        }
        if !keep_locked {
            for &(from, to) in &joined {
                self.merge_wedge(from as usize, to as usize);
            }
        }
        for &c in &corners {
            if !self.alive[(c / 3) as usize] {
                continue;
            }
            let w = self.corners[c as usize];
            match joined.iter().find(|j| j.0 == w) {
                Some(j) => self.corners[c as usize] = j.1,
                None => self.wedges[w as usize].point = keep,
            }
        }
        // One list of live corners for the merged point.
        let all: Vec<u32> =
            self.corners_at(keep).chain(corners.iter().copied().filter(|c| self.alive[(c / 3) as usize])).collect();
        let quadric = self.points[remove as usize].quadric;
        let p = &mut self.points[remove as usize];
        p.alive = false;
        (p.head, p.tail) = (NONE, NONE);
        let gone = p.at;
        self.occupied.remove(&gone);
        let p = &mut self.points[keep as usize];
        let old = p.at;
        p.quadric.add(&quadric);
        p.at = target;
        p.local = local(target, self.center);
        p.version += 1;
        (p.head, p.tail, p.corners) = (NONE, NONE, 0);
        self.occupied.remove(&old);
        self.occupied.insert(target, keep);
        for c in all {
            self.link(keep, c);
        }
        for &x in new_borders {
            self.mark_border(keep, x);
        }
    }

    fn merge_wedge(&mut self, from: usize, to: usize) {
        let (weight, color, normal) = (self.wedges[from].weight, self.wedges[from].color, self.wedges[from].normal);
        let own = self.wedges[to].weight;
        for channel in &mut self.scalars {
            // Sums, like the colours; an unchanged wedge holds its value with weight 1. A value that is not there (NaN)
            // takes no part: the mean stays that of the others.
            let (f, t) = (channel[from], channel[to]);
            channel[to] = match (f.is_nan(), t.is_nan()) {
                (true, false) => t * ((own + weight) / own),
                (false, true) => f * ((own + weight) / weight),
                _ => f + t,
            };
        }
        let w = &mut self.wedges[to];
        w.weight += weight;
        w.changed = true;
        for i in 0..3 {
            w.color[i] += color[i];
            w.normal[i] += normal[i];
        }
    }

    /// Set the true-border bit on the one triangle left at the edge between two points.
    fn mark_border(&mut self, a: u32, b: u32) {
        let found = self.corners_at(a).find_map(|c| {
            let [_, p1, p2] = self.triangle_from(c);
            let k = c % 3;
            if p1 == b {
                Some((c / 3, k))
            } else if p2 == b {
                Some((c / 3, (k + 2) % 3))
            } else {
                None
            }
        });
        if let Some((t, slot)) = found {
            self.borders[t as usize] |= 1 << slot;
        }
    }
}
