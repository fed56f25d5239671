//! A region that somebody drew: a polygon in a plane, carried along the plane's normal, so far in front of it and behind.
//!
//! Triangles are cut exactly at its walls, so that areas and volumes do not depend on how the surface is triangulated.

use crate::plane::Plane;
use crate::polygon::{signed_area, triangulate};
use crate::refusal::{Refusal, at_least};
use glam::{DVec2, DVec3};

/// The prism of a polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    plane: Plane,
    axes: [DVec3; 2],
    outline: Vec<DVec2>,
    pieces: Vec<[DVec2; 3]>,
    reach: f64,
}

impl Region {
    /// The region round `points` (projected to the plane, in order), `reach` metres to both sides of the plane.
    ///
    /// # Errors
    /// [`Refusal`] where the polygon is degenerate.
    pub fn new(plane: Plane, points: &[DVec3], reach: f64) -> Result<Self, Refusal> {
        at_least("an area", 3, points)?;
        let outline: Vec<DVec2> = points.iter().map(|p| plane.coordinates(*p)).collect();
        let pieces = triangulate(&outline)?;
        Ok(Self { axes: plane.axes(), plane, outline, pieces, reach })
    }

    /// The plane that it was drawn in.
    pub fn plane(&self) -> &Plane {
        &self.plane
    }

    /// How far it reaches to both sides of the plane, metres.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Area of the polygon in its plane, square metres.
    pub fn area(&self) -> f64 {
        signed_area(&self.outline).abs()
    }

    /// Whether a box (smallest and largest corner) may contain a part of it; never wrongly `false`.
    pub fn meets(&self, low: DVec3, high: DVec3) -> bool {
        let spread = |axis: DVec3| {
            let d = |x: f64, from: f64, to: f64| if x >= 0.0 { (x * from, x * to) } else { (x * to, x * from) };
            (0..3).fold((0.0, 0.0), |(a, b), i| {
                let (from, to) = d(axis[i], low[i] - self.plane.point[i], high[i] - self.plane.point[i]);
                (a + from, b + to)
            })
        };
        let slack = 1e-9 * ((high - low).abs() + (low - self.plane.point).abs()).element_sum();
        let apart = |(from, to): (f64, f64), low: f64, high: f64| to + slack < low || from - slack > high;
        let extent = |k: usize| {
            self.outline.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[k]), b.max(p[k])))
        };
        let (width, height) = (extent(0), extent(1));
        !apart(spread(self.axes[0]), width.0, width.1)
            && !apart(spread(self.axes[1]), height.0, height.1)
            && !apart(spread(self.plane.normal), -self.reach, self.reach)
    }

    /// The parts of a triangle inside: convex polygons with the triangle's orientation, handed to `each` as points with
    /// their coordinates in the plane and their signed distance from it.
    pub fn clip(&self, triangle: [DVec3; 3], mut each: impl FnMut(&[DVec3])) {
        // As coordinates of the plane everything is a cut at x, y or z.
        let local = triangle.map(|p| {
            let d = p - self.plane.point;
            DVec3::new(self.axes[0].dot(d), self.axes[1].dot(d), self.plane.normal.dot(d))
        });
        if local.iter().all(|p| p[2] > self.reach) || local.iter().all(|p| p[2] < -self.reach) {
            return;
        }
        let span =
            |k: usize| local.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[k]), b.max(p[k])));
        let (x, y) = (span(0), span(1));
        let mut part = Vec::with_capacity(10);
        let mut next = Vec::with_capacity(10);
        for piece in &self.pieces {
            let beside =
                |k: usize, (from, to): (f64, f64)| piece.iter().all(|p| p[k] < from) || piece.iter().all(|p| p[k] > to);
            if beside(0, x) || beside(1, y) {
                continue;
            }
            part.clear();
            part.extend_from_slice(&local);
            for (i, a) in piece.iter().enumerate() {
                let b = piece[(i + 1) % 3];
                let inside = |p: &DVec3| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
                cut(&mut part, &mut next, inside);
            }
            cut(&mut part, &mut next, |p| self.reach - p[2]);
            cut(&mut part, &mut next, |p| p[2] + self.reach);
            if part.len() >= 3 {
                each(&part);
            }
        }
    }
}

/// Keep what is not negative (Sutherland and Hodgman, 1974).
pub(crate) fn cut(part: &mut Vec<DVec3>, scratch: &mut Vec<DVec3>, inside: impl Fn(&DVec3) -> f64) {
    scratch.clear();
    for i in 0..part.len() {
        let (p, q) = (part[i], part[(i + 1) % part.len()]);
        let (a, b) = (inside(&p), inside(&q));
        if a >= 0.0 {
            scratch.push(p);
        }
        if (a >= 0.0) != (b >= 0.0) {
            scratch.push(p.lerp_monotonic(q, a / (a - b)));
        }
    }
    std::mem::swap(part, scratch);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(points: &[DVec3]) -> f64 {
        (1..points.len() - 1)
            .map(|i| {
                let n = (points[i] - points[0]).cross(points[i + 1] - points[0]);
                n.length() * 0.5
            })
            .sum()
    }

    proptest! {
        #[test]
        fn a_sheet_inside_a_region_has_the_regions_area_whatever_its_triangles(
            radii in prop::collection::vec(0.2f64..1.0, 4..9), tilt in prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from), split in 0.1f64..0.9,
        ) {
            prop_assume!(tilt.length_squared() > 0.1);
            let plane = Plane::new(DVec3::new(10.0, 20.0, 30.0), tilt).unwrap();
            let [u, v] = plane.axes();
            let at = |x: f64, y: f64| -> DVec3 { plane.point + u * x + v * y };
            let n = radii.len() as f64;
            let points: Vec<DVec3> = radii.iter().enumerate().map(|(i, r)| {
                let a = i as f64 * std::f64::consts::TAU / n;
                at(r * a.cos(), r * a.sin())
            }).collect();
            let region = Region::new(plane, &points, 0.5).unwrap();
            // A square of side 4 round it, cut into four triangles at an arbitrary point.
            let (s, m) = (2.0, at(split, 0.3 - split));
            let corners = [at(-s, -s), at(s, -s), at(s, s), at(-s, s)];
            let mut sum = 0.0;
            for i in 0..4 {
                region.clip([corners[i], corners[(i + 1) % 4], m], |p| sum += area(p));
            }
            prop_assert!((sum - region.area()).abs() < 1e-9, "{sum} {}", region.area());
            let low: DVec3 = corners.iter().copied().fold(DVec3::MAX, DVec3::min);
            let high: DVec3 = corners.iter().copied().fold(DVec3::MIN, DVec3::max);
            prop_assert!(region.meets(low, high));
        }
    }

    #[test]
    fn geometry_outside_the_region_is_left_out_and_boxes_that_miss_it_are_skipped() {
        let plane = Plane::new(DVec3::ZERO, DVec3::Z).unwrap();
        let square = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
        let region = Region::new(plane, &square, 0.5).unwrap();
        let mut parts = 0;
        region.clip([DVec3::new(0.0, 0.0, 0.6), DVec3::new(1.0, 0.0, 0.6), DVec3::new(0.0, 1.0, 0.6)], |_| parts += 1);
        assert_eq!(parts, 0);
        assert!(!region.meets(DVec3::new(0.0, 0.0, 0.6), DVec3::new(1.0, 1.0, 2.0)));
        assert!(!region.meets(DVec3::new(1.1, 0.0, 0.0), DVec3::new(2.0, 1.0, 0.1)));
        assert!(region.meets(DVec3::new(0.9, 0.9, -9.0), DVec3::new(5.0, 5.0, 9.0)));
    }
}
