//! Convex polygons in the plane of a triangle, and cutting them along lines.

use glam::DVec2;

/// Most corners a piece may have; one that would get more is not cut.
const MAX: usize = 12;

/// A point in the plane.
pub(super) type Point2 = DVec2;

/// A convex polygon, counter-clockwise.
#[derive(Clone, Copy)]
pub(super) struct Polygon {
    corners: [Point2; MAX],
    count: u8,
}

/// A directed line; its inside is on the left.
#[derive(Clone, Copy, Default)]
pub(super) struct Line {
    from: Point2,
    direction: Point2,
    /// Twice an area: of what is this near to the line.
    pub(super) tolerance: f64,
}

/// How a line cuts a polygon.
#[expect(clippy::large_enum_variant, reason = "it lives for a moment on the stack")]
pub(super) enum Cut {
    /// All of it is inside.
    Inside,
    /// All of it is outside.
    Outside,
    /// Inside and outside parts.
    Both(Polygon, Polygon),
    /// It has too many corners to be cut.
    Full,
}

impl Line {
    /// Through two points. What is within `eps` of the line counts as on it.
    pub(super) fn through(a: Point2, b: Point2, eps: f64) -> Self {
        let direction = b - a;
        Self { from: a, direction, tolerance: eps * direction.abs().element_sum() }
    }

    /// Twice the signed area between the line's two points and `p`.
    pub(super) fn side(&self, p: &Point2) -> f64 {
        self.direction.perp_dot(*p - self.from)
    }

    /// Whether a point is outside or on the line.
    pub(super) fn excludes(&self, p: &Point2) -> bool {
        self.side(p) <= self.tolerance
    }
}

impl Polygon {
    pub(super) fn triangle(corners: [Point2; 3]) -> Self {
        let mut all = [DVec2::ZERO; MAX];
        all[..3].copy_from_slice(&corners);
        Self { corners: all, count: 3 }
    }

    pub(super) fn corners(&self) -> &[Point2] {
        &self.corners[..usize::from(self.count)]
    }

    fn empty() -> Self {
        Self { corners: [DVec2::ZERO; MAX], count: 0 }
    }

    fn push(&mut self, p: Point2) {
        self.corners[usize::from(self.count)] = p;
        self.count += 1;
    }

    /// Divide along a line.
    pub(super) fn cut(&self, line: &Line) -> Cut {
        let n = usize::from(self.count);
        let mut sides = [0.0; MAX];
        let (mut inside, mut outside) = (false, false);
        for (s, p) in sides.iter_mut().zip(self.corners()) {
            *s = line.side(p);
            inside |= *s > line.tolerance;
            outside |= *s < -line.tolerance;
        }
        if !outside {
            return Cut::Inside;
        }
        if !inside {
            return Cut::Outside;
        }
        // Each part gets at most two corners more than it keeps.
        if n + 2 > MAX {
            return Cut::Full;
        }
        let (mut left, mut right) = (Self::empty(), Self::empty());
        for i in 0..n {
            let j = if i + 1 == n { 0 } else { i + 1 };
            let (si, sj, p, q) = (sides[i], sides[j], self.corners[i], self.corners[j]);
            // Corners on the line belong to both parts.
            if si >= -line.tolerance {
                left.push(p);
            }
            if si <= line.tolerance {
                right.push(p);
            }
            if (si > line.tolerance && sj < -line.tolerance) || (si < -line.tolerance && sj > line.tolerance) {
                let t = si / (si - sj);
                let m = p.lerp_monotonic(q, t);
                left.push(m);
                right.push(m);
            }
        }
        Cut::Both(left, right)
    }
}
