//! One edge collapse: where the merged point goes, whether the collapse is allowed, and doing it.

use super::{Collapse, Kind, NONE, Point, Quadric, ScratchBuffer, Simplifier, kind, local};
use glam::DVec3;
use kilwa_geometry::{Aabb, LatticePoint};

impl Simplifier<'_> {
    /// Where the merged point of an edge would go, or `None` when the edge cannot be collapsed at all.
    /// `remove` is free; `keep` may be locked. `quadric` is the sum of theirs.
    pub(super) fn target(&self, keep: u32, remove: u32, quadric: &Quadric) -> Option<LatticePoint> {
        let (pk, pr) = (&self.points[keep as usize], &self.points[remove as usize]);
        // A point on a line of odd edges leaves along the line only; what it drags with it, the quadrics weigh.
        let odd = || self.triangles_on(keep, remove) != 2;
        if pk.locked {
            return (pr.kind == Kind::Manifold || odd()).then_some(pk.at);
        }
        match (pk.kind, pr.kind) {
            (Kind::Manifold, Kind::Manifold) => Some(self.best_position(keep, remove, quadric)),
            (_, Kind::Manifold) => Some(pk.at),
            (Kind::Manifold, _) => Some(pr.at),
            _ if !odd() => None,
            (Kind::Crease, Kind::Crease) => Some(self.best_position(keep, remove, quadric)),
            (Kind::Complex, Kind::Crease) => Some(pk.at),
            (Kind::Crease, Kind::Complex) => Some(pr.at),
            (Kind::Complex, Kind::Complex) => {
                Some(if quadric.at(pk.local) <= quadric.at(pr.local) { pk.at } else { pr.at })
            }
        }
    }

    /// Triangles on the edge between two points.
    fn triangles_on(&self, a: u32, b: u32) -> usize {
        self.corners_at(a).filter(|c| self.others(*c).contains(&b)).count()
    }

    /// The lattice point near the quadric's minimum, or the best of both ends and the middle.
    fn best_position(&self, a: u32, b: u32, quadric: &Quadric) -> LatticePoint {
        let (pa, pb) = (&self.points[a as usize], &self.points[b as usize]);
        let mid = (pa.local + pb.local) * 0.5;
        let reach = pa.local.distance_squared(pb.local);
        let near = |p: &DVec3| p.distance_squared(mid) <= reach;
        if let Some(p) = quadric.minimum().filter(near).and_then(|p| self.round(p)) {
            return p;
        }
        let mut best = (f64::INFINITY, pa.at);
        for p in self.round(mid).into_iter().chain([pa.at, pb.at]) {
            let cost = quadric.at(local(p, self.center));
            if cost < best.0 {
                best = (cost, p);
            }
        }
        best.1
    }

    /// The lattice point nearest to a place, where one may be made there.
    fn round(&self, p: DVec3) -> Option<LatticePoint> {
        let nearest = p.map(nearest) + self.center.as_dvec3();
        let Aabb { min, max } = self.limits;
        let valid = nearest.cmpge(min.as_dvec3()).all() && nearest.cmple(max.as_dvec3()).all();
        valid.then(|| nearest.as_ivec3())
    }

    /// Collapse an edge where it is allowed; whether it was.
    pub(super) fn collapse(&mut self, c: &Collapse) -> bool {
        let (keep, remove, target) = (c.keep, c.remove, c.target);
        if self.occupied.get(&target).is_some_and(|p| *p != keep && *p != remove) {
            return false;
        }
        let (pk, pr) = (&self.points[keep as usize], &self.points[remove as usize]);
        let simple = !pk.locked && pk.kind == Kind::Manifold && pr.kind == Kind::Manifold;
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.borders.clear();
        let allowed = if simple {
            self.check_smooth(keep, remove) && self.check_shapes(keep, remove, target)
        } else {
            self.check_edges(keep, remove, &mut scratch)
                && self.check_triangles(keep, remove)
                && self.check_shapes(keep, remove, target)
        };
        if allowed {
            self.apply(keep, remove, target, &mut scratch);
            if !simple {
                // A point that only had triangles on the edge has gone with them.
                for &(apex, _) in &scratch.shared {
                    if self.corners_at(apex).next().is_none() {
                        self.merged_into[apex as usize] = keep;
                    }
                }
                self.renew_kinds(keep, &mut scratch);
            }
        }
        self.scratch = scratch;
        allowed
    }

    /// The link condition where all edges of both points are used twice: just the two points opposite to the edge are
    /// neighbours of both, and no triangle joins them to both ends.
    fn check_smooth(&mut self, keep: u32, remove: u32) -> bool {
        self.clock += 1;
        let mut c = self.points[keep as usize].head;
        while c != NONE {
            if self.alive[(c / 3) as usize] {
                for p in self.others(c) {
                    self.marks[p as usize] = self.clock;
                }
            }
            c = self.next[c as usize];
        }
        let mut apexes = [NONE; 2];
        let mut found = 0;
        for c in self.corners_at(remove) {
            let [p, q] = self.others(c);
            if p == keep || q == keep {
                if found == 2 {
                    return false;
                }
                apexes[found] = if p == keep { q } else { p };
                found += 1;
            }
        }
        if found != 2 || apexes[0] == apexes[1] {
            return false;
        }
        self.corners_at(remove).all(|c| {
            let [p, q] = self.others(c);
            if p == keep || q == keep {
                return true;
            }
            let shared = |p: u32| self.marks[p as usize] == self.clock;
            let (sp, sq) = (shared(p), shared(q));
            let only_apexes = (!sp || apexes.contains(&p)) && (!sq || apexes.contains(&q));
            // A triangle at both apexes is the third of a point that has no more; it may stay unless it is there already.
            only_apexes && !(sp && sq && self.has_triangle(keep, p, q))
        })
    }

    /// Whether three points have a triangle, whichever way it faces.
    fn has_triangle(&self, a: u32, p: u32, q: u32) -> bool {
        self.corners_at(a).any(|c| {
            let [s, t] = self.others(c);
            (s, t) == (p, q) || (s, t) == (q, p)
        })
    }

    /// The link condition with counts. Puts the neighbours on `scratch.borders` whose edge to the merged point is a true
    /// border afterwards though its triangle may change. Whether the collapse is allowed.
    fn check_edges(&self, keep: u32, remove: u32, scratch: &mut ScratchBuffer) -> bool {
        self.neighbours(keep, &mut scratch.of_keep);
        self.neighbours(remove, &mut scratch.of_remove);
        let keep_locked = self.points[keep as usize].locked;
        scratch.shared.clear();
        for c in self.corners_at(remove) {
            let [p1, p2] = self.others(c);
            let apex = if p1 == keep {
                p2
            } else if p2 == keep {
                p1
            } else {
                continue;
            };
            match scratch.shared.iter_mut().find(|s| s.0 == apex) {
                Some(s) => s.1 += 1,
                None => scratch.shared.push((apex, 1)),
            }
        }
        if scratch.shared.is_empty() {
            return false;
        }
        for r in scratch.of_remove.iter().filter(|r| r.point != keep) {
            let Some(k) = scratch.of_keep.iter().find(|n| n.point == r.point) else {
                // A new edge between two locked points might already exist outside.
                if keep_locked && self.points[r.point as usize].locked {
                    return false;
                }
                continue;
            };
            // A common neighbour without a triangle between: the collapse would glue two sheets.
            let Some(triangles) = scratch.shared.iter().find(|s| s.0 == r.point).map(|s| s.1) else { return false };
            let Some(after) = (k.count + r.count).checked_sub(2 * triangles) else { return false };
            if keep_locked && self.points[r.point as usize].locked {
                if after != k.count {
                    return false;
                }
                // A border of the scan stays one, though another triangle may now lie along it.
                if after == 1 && k.border {
                    scratch.borders.push(r.point);
                }
            } else if after == 1 {
                if !(k.border || r.border) {
                    return false;
                }
                scratch.borders.push(r.point);
            } else if after > 2 && after > k.count.max(r.count) {
                return false;
            }
        }
        true
    }

    /// No doubled or all-locked new triangle.
    fn check_triangles(&self, keep: u32, remove: u32) -> bool {
        let keep_locked = self.points[keep as usize].locked;
        self.corners_at(remove).all(|c| {
            let [p, q] = self.others(c);
            if p == keep || q == keep {
                return true;
            }
            let locked = keep_locked && self.points[p as usize].locked && self.points[q as usize].locked;
            !locked && !self.has_triangle(keep, p, q)
        })
    }

    /// No flipped or degenerate triangle, and something is left at the merged point.
    fn check_shapes(&self, keep: u32, remove: u32, target: LatticePoint) -> bool {
        let to = local(target, self.center);
        let mut left = false;
        for (from, other) in [(keep, remove), (remove, keep)] {
            let moves = target != self.points[from as usize].at;
            for c in self.corners_at(from) {
                let [p, q] = self.others(c);
                if p == other || q == other {
                    continue;
                }
                left = true;
                if moves && !self.keeps_shape(from, p, q, to) {
                    return false;
                }
            }
        }
        left
    }

    /// Whether triangle `(from, p, q)` keeps its orientation and an area when `from` moves to `to`.
    pub(super) fn keeps_shape(&self, from: u32, p: u32, q: u32, to: DVec3) -> bool {
        let (lp, lq) = (self.points[p as usize].local, self.points[q as usize].local);
        let e = lq - lp;
        let before = e.cross(self.points[from as usize].local - lp);
        let after = e.cross(to - lp);
        let (b2, a2, d) = (before.length_squared(), after.length_squared(), before.dot(after));
        if a2 <= 0.0 {
            return false;
        }
        // Turned by less than about 75 degrees; a triangle without area has no orientation to keep.
        b2 <= 0.0 || (d > 0.0 && d * d > 0.0625 * a2 * b2)
    }

    fn apply(&mut self, keep: u32, remove: u32, target: LatticePoint, scratch: &mut ScratchBuffer) {
        // Wedges joined by a vanishing triangle become one; the others move along as they are.
        scratch.joined.clear();
        scratch.corners.clear();
        scratch.corners.extend(self.corners_at(keep));
        let own = scratch.corners.len();
        scratch.corners.extend(self.corners_at(remove));
        for &c in &scratch.corners[own..] {
            let t = c / 3;
            if let Some(o) = (t * 3..t * 3 + 3).find(|&o| self.point[o as usize] == keep) {
                let (from, to) = (self.wedge[c as usize], self.wedge[o as usize]);
                if !scratch.joined.iter().any(|j| j.0 == from) {
                    scratch.joined.push((from, to));
                }
                // A triangle that names a point twice, which a damaged file may have, comes twice.
                if std::mem::take(&mut self.alive[t as usize]) {
                    self.triangles -= 1;
                }
            }
        }
        if !self.points[keep as usize].locked {
            for &(from, to) in &scratch.joined {
                self.wedges.merge(from, to);
            }
        }
        self.merged_into[remove as usize] = keep;
        let Point { at: gone, made, .. } = self.points[remove as usize];
        let quadric = self.points[remove as usize].quadric;
        let p = &mut self.points[keep as usize];
        let old = p.at;
        p.quadric.add(&quadric);
        p.made = if target == old { p.made } else { target != gone || made };
        p.at = target;
        p.local = local(target, self.center);
        (p.head, p.tail, p.corners) = (NONE, NONE, 0);
        self.note_change(keep);
        if target != old {
            self.occupied.remove(&old);
        }
        if target != gone {
            self.occupied.remove(&gone);
        }
        if target != old {
            self.occupied.insert(target, keep);
        }
        // One list of live corners for the merged point.
        for (i, &c) in scratch.corners.iter().enumerate() {
            if !self.alive[(c / 3) as usize] {
                continue;
            }
            if i >= own {
                self.point[c as usize] = keep;
                if let Some(j) = scratch.joined.iter().find(|j| j.0 == self.wedge[c as usize]) {
                    self.wedge[c as usize] = j.1;
                }
            }
            self.link(keep, c);
        }
        for &x in &scratch.borders {
            self.mark_border(keep, x);
        }
    }

    /// Look again at what kind of point the merged one and its neighbours are.
    fn renew_kinds(&mut self, keep: u32, scratch: &mut ScratchBuffer) {
        self.neighbours(keep, &mut scratch.of_keep);
        self.points[keep as usize].kind = kind(&scratch.of_keep);
        for n in &scratch.of_keep {
            let p = &self.points[n.point as usize];
            if !p.locked && p.corners <= super::HUB {
                self.neighbours(n.point, &mut scratch.of_remove);
                let now = kind(&scratch.of_remove);
                if std::mem::replace(&mut self.points[n.point as usize].kind, now) != now {
                    self.note_change(n.point);
                }
            }
        }
    }

    /// Set the true-border bit on the one triangle left at the edge between two points.
    fn mark_border(&mut self, a: u32, b: u32) {
        let found = self.corners_at(a).find_map(|c| {
            let [p1, p2] = self.others(c);
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

/// The nearest whole number, halves away from zero, as [`f64::round`] gives it for what is below 2^62; that is a call where processors
/// cannot be relied on to have an instruction for it.
fn nearest(x: f64) -> f64 {
    let whole = x as i64 as f64;
    let rest = x - whole;
    whole + f64::from(i8::from(rest >= 0.5) - i8::from(rest <= -0.5))
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn the_nearest_whole_number_is_that_of_the_standard_library() {
        let mut random = fastrand::Rng::with_seed(2);
        let halves = (-2000..2000).map(|i| f64::from(i) / 4.0);
        let beside = halves.clone().flat_map(|x: f64| [x.next_down(), x.next_up()]);
        let large = (0..1000).map(|i| (random.f64() - 0.5) * f64::from(1u32 << (i % 32)));
        for x in halves.chain(beside).chain(large) {
            assert!(nearest(x) == x.round(), "{x}");
        }
    }
}
