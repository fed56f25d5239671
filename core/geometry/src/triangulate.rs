//! Triangulates polygons with all their surface: a fan would cover ground outside a concave one.
//!
//! Input: corners in order around the polygon, at finite positions; it need not be planar. Output: n - 2 triangles over
//! the same corners, turning the way the polygon turns. Quads are split along the diagonal that lies inside, the shorter
//! where both do. Others are cut ear by ear in the plane in which the polygon is largest (G. H. Meisters, "Polygons have
//! ears", 1975; only reflex corners can lie in an ear). A polygon that crosses itself has no triangulation: it gets its
//! n - 2 triangles all the same, and the caller is informed.

use glam::{DVec2, DVec3, Vec3Swizzles};

/// How well a polygon could be cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The triangles cover the polygon once.
    Covered,
    /// The polygon crosses or folds over itself; some triangles may lie outside or overlap.
    Crossing,
}

/// How often all ears of one polygon may be looked for again, which only polygons that cross themselves need.
const SEARCHES: usize = 2;

/// Lists reused from polygon to polygon.
#[derive(Debug, Default)]
pub struct Triangulator {
    points: Vec<DVec2>,
    next: Vec<usize>,
    previous: Vec<usize>,
    cut: Vec<bool>,
    convex: Vec<bool>,
    ear: Vec<bool>,
    reflex: Vec<usize>,
}

impl Triangulator {
    /// Cut the polygon whose three or more corners are at these places, in order, and hand its triangles to `out` as
    /// numbers of corners.
    pub fn polygon(&mut self, corners: &[DVec3], mut out: impl FnMut([usize; 3])) -> Outcome {
        self.project(corners);
        if let Some(first) = self.quad_diagonal(corners) {
            let halves = if first { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
            halves.into_iter().for_each(out);
            return Outcome::Covered;
        }
        self.start(corners.len());
        let mut outcome = Outcome::Covered;
        let mut searches = 0;
        let mut at = 0;
        for _ in 3..corners.len() {
            let mut found = self.find(at, |t, i| t.ear[i]);
            if found.is_none() && searches < SEARCHES {
                searches += 1;
                self.find_ears();
                found = self.find(at, |t, i| t.ear[i]);
            }
            let ear = found.unwrap_or_else(|| {
                // Corners in line with their neighbours enclose nothing: cutting them loses and adds no ground.
                let flat = self.find(at, |t, i| t.turn(i) == 0.0);
                if flat.is_none() {
                    outcome = Outcome::Crossing;
                }
                flat.or_else(|| self.find(at, |t, i| t.convex[i])).unwrap_or(at)
            });
            out([self.previous[ear], ear, self.next[ear]]);
            at = self.remove(ear);
        }
        // What is left of a polygon that does not cross itself turns as the whole did.
        if self.turn(at) < 0.0 {
            outcome = Outcome::Crossing;
        }
        out([self.previous[at], at, self.next[at]]);
        outcome
    }

    /// Project to the axis plane in which the polygon is largest, turning anticlockwise there, relative to its first
    /// corner (real-world coordinates are large).
    fn project(&mut self, corners: &[DVec3]) {
        let origin = corners[0];
        let mut normal = DVec3::ZERO; // Newell's
        for (i, corner) in corners.iter().enumerate() {
            let (a, b) = (corner - origin, corners[(i + 1) % corners.len()] - origin);
            normal += (a - b).yzx() * (a + b).zxy();
        }
        let size = |axis: usize| normal[axis].abs();
        let axis = (0..3).fold(2, |best, axis| if size(axis) > size(best) { axis } else { best });
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (u, v) = if normal[axis] < 0.0 { (v, u) } else { (u, v) };
        self.points.clear();
        self.points.extend(corners.iter().map(|c| {
            let p = c - origin;
            DVec2::new(p[u], p[v])
        }));
    }

    /// For a quad: whether it is split from its first corner, or from its second; `None` if no diagonal lies inside or
    /// it is no quad.
    fn quad_diagonal(&self, corners: &[DVec3]) -> Option<bool> {
        let (&[a, b, c, d], &[pa, pb, pc, pd]) = (corners, self.points.as_slice()) else { return None };
        let first = cross(pa, pb, pc) > 0.0 && cross(pa, pc, pd) > 0.0;
        let second = cross(pb, pc, pd) > 0.0 && cross(pb, pd, pa) > 0.0;
        match (first, second) {
            (true, true) => Some(a.distance_squared(c) <= b.distance_squared(d)),
            (true, false) => Some(true),
            (false, true) => Some(false),
            (false, false) => None,
        }
    }

    fn start(&mut self, n: usize) {
        self.next.clear();
        self.next.extend((0..n).map(|i| (i + 1) % n));
        self.previous.clear();
        self.previous.extend((0..n).map(|i| (i + n - 1) % n));
        self.cut.clear();
        self.cut.resize(n, false);
        self.convex.clear();
        self.convex.resize(n, false);
        self.ear.clear();
        self.ear.resize(n, false);
        self.find_ears();
    }

    fn find_ears(&mut self) {
        self.reflex.clear();
        for i in (0..self.points.len()).filter(|&i| !self.cut[i]) {
            self.convex[i] = self.turn(i) > 0.0;
            if !self.convex[i] {
                self.reflex.push(i);
            }
        }
        for i in (0..self.points.len()).filter(|&i| !self.cut[i]) {
            self.ear[i] = self.is_ear(i);
        }
    }

    /// Twice the area of the triangle that corner `i` makes with its neighbours; positive where it is convex.
    fn turn(&self, i: usize) -> f64 {
        cross(self.points[self.previous[i]], self.points[i], self.points[self.next[i]])
    }

    fn is_ear(&self, i: usize) -> bool {
        if !self.convex[i] {
            return false;
        }
        let [a, b, c] = [self.previous[i], i, self.next[i]].map(|k| self.points[k]);
        // A polygon with a hole is given with a bridge, whose ends come twice: points on a corner do not block.
        let blocks = |&k: &usize| {
            let p = self.points[k];
            !self.cut[k]
                && !self.convex[k]
                && (p != a && p != b && p != c)
                && (cross(a, b, p) >= 0.0 && cross(b, c, p) >= 0.0 && cross(c, a, p) >= 0.0)
        };
        !self.reflex.iter().any(blocks)
    }

    /// The first corner from `at` on, around the polygon, for which `test` holds.
    fn find(&self, at: usize, test: impl Fn(&Self, usize) -> bool) -> Option<usize> {
        let mut i = at;
        loop {
            if test(self, i) {
                return Some(i);
            }
            i = self.next[i];
            if i == at {
                return None;
            }
        }
    }

    /// Cut corner `i` off; the corner from which to look on, which is not its neighbour, so that no fan arises.
    fn remove(&mut self, i: usize) -> usize {
        let (before, after) = (self.previous[i], self.next[i]);
        self.next[before] = after;
        self.previous[after] = before;
        self.cut[i] = true;
        self.ear[i] = false;
        for k in [before, after] {
            let was_convex = self.convex[k];
            self.convex[k] = self.turn(k) > 0.0;
            if was_convex && !self.convex[k] {
                self.reflex.push(k);
            }
        }
        for k in [before, after] {
            self.ear[k] = self.is_ear(k);
        }
        self.next[after]
    }
}

/// Twice the signed area of a triangle, positive where it turns anticlockwise.
fn cross(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cut(polygon: &[DVec3]) -> (Vec<[u32; 3]>, Outcome) {
        let mut triangles = Vec::new();
        let outcome = Triangulator::default().polygon(polygon, |t| triangles.push(t.map(|i| i as u32)));
        (triangles, outcome)
    }

    fn area(polygon: &[DVec3], corners: &[u32]) -> f64 {
        let n = corners.len();
        let p = |i: usize| polygon[corners[i % n] as usize];
        (0..n).map(|i| p(i).truncate().perp_dot(p(i + 1).truncate())).sum::<f64>() / 2.0
    }

    /// Whether all triangles turn as the polygon does and their areas add up to its own: then they cover it once.
    fn covers(polygon: &[DVec3]) -> bool {
        let (triangles, outcome) = cut(polygon);
        let all: Vec<u32> = (0..polygon.len() as u32).collect();
        let areas: Vec<f64> = triangles.iter().map(|t| area(polygon, t)).collect();
        let whole = area(polygon, &all);
        outcome == Outcome::Covered
            && triangles.len() == polygon.len() - 2
            && areas.iter().all(|a| a * whole.signum() >= 0.0)
            && (areas.iter().sum::<f64>() - whole).abs() <= 1e-9 * whole.abs()
    }

    fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
        points.iter().map(|&p| DVec2::from(p).extend(0.0)).collect()
    }

    #[test]
    fn a_concave_quad_is_split_along_the_inner_diagonal() {
        for turn in 0..4 {
            let mut dart = flat(&[[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]]);
            dart.rotate_left(turn);
            assert!(covers(&dart), "turned {turn}");
        }
    }

    #[test]
    fn a_convex_quad_is_split_along_the_shorter_diagonal() {
        let (triangles, _) = cut(&flat(&[[0.0, 0.0], [4.0, -1.0], [5.0, 2.0], [1.0, 3.0]]));
        assert_eq!(triangles, [[0, 1, 3], [1, 2, 3]]);
    }

    #[test]
    fn a_comb_is_covered_once_in_either_winding_and_orientation() {
        let mut comb = vec![[0.0, 0.0], [20.0, 0.0]];
        for tooth in (0..10).rev() {
            let x = 2.0 * f64::from(tooth);
            comb.extend([[x + 1.5, 5.0], [x + 1.0, 1.0], [x + 0.5, 5.0]]);
        }
        assert!(covers(&flat(&comb)));
        comb.reverse();
        assert!(covers(&flat(&comb)));
        let standing: Vec<DVec3> = comb.iter().map(|p| DVec3::new(500_000.0, 9_000_000.0 + p[0], p[1])).collect();
        assert_eq!(cut(&standing).1, Outcome::Covered);
    }

    #[test]
    fn a_square_with_a_bridged_square_hole_keeps_its_hole() {
        let ring = flat(&[
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [3.0, 3.0],
            [3.0, 1.0],
            [1.0, 1.0],
        ]);
        assert!(covers(&ring));
    }

    #[test]
    fn collinear_corners_are_kept() {
        let square = flat(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 2.0], [0.0, 2.0], [0.0, 1.0]]);
        assert!(covers(&square));
        let (triangles, _) = cut(&square);
        assert!((0..7).all(|i| triangles.iter().flatten().any(|&c| c == i)));
    }

    #[test]
    fn a_bow_tie_is_triangulated_and_reported() {
        let (triangles, outcome) = cut(&flat(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.1]]));
        assert_eq!((triangles.len(), outcome), (2, Outcome::Crossing));
    }

    #[test]
    fn triangulating_ten_thousand_crossing_corners_ends() {
        let wild: Vec<DVec3> = (0..10_000u32)
            .map(|i| DVec3::new(f64::from(i * 7919 % 10_007), f64::from(i * 104_729 % 10_009), 0.0))
            .collect();
        assert_eq!(cut(&wild).0.len(), 9_998);
    }

    #[test]
    fn overflowing_coordinates_cause_no_panic() {
        assert_eq!(cut(&flat(&[[-1e308, 0.0], [1e308, 0.0], [1e308, 1e308], [0.0, 1.0], [-1e308, 1e308]])).0.len(), 3);
    }

    proptest! {
        #[test]
        fn star_shaped_polygons_are_covered_once(radii in proptest::collection::vec(0.05f64..1.0, 4..60)) {
            let n = radii.len() as f64;
            let star: Vec<DVec3> = radii.iter().enumerate().map(|(i, r)| {
                let angle = i as f64 / n * std::f64::consts::TAU;
                DVec3::new(r * angle.cos(), r * angle.sin(), 0.0)
            }).collect();
            prop_assert!(covers(&star));
        }
    }
}
