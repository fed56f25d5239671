//! Quadric error metric: Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", SIGGRAPH 1997,
//! area-weighted. Coordinates are local to the fragment, in lattice units, so that nothing cancels.

use kilwa_geometry::distance::{Vec3, cross, dot, sub};

/// A symmetric quadratic form `x'Ax + 2b'x + c`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    a: [f64; 6],
    b: Vec3,
    c: f64,
}

impl Quadric {
    /// `weight` times the squared distance to the plane through `p` with unit normal `n`.
    fn plane(p: Vec3, n: Vec3, weight: f64) -> Self {
        let d = -dot(n, p);
        let w = weight;
        Self {
            a: [n[0] * n[0] * w, n[0] * n[1] * w, n[0] * n[2] * w, n[1] * n[1] * w, n[1] * n[2] * w, n[2] * n[2] * w],
            b: n.map(|x| x * d * w),
            c: d * d * w,
        }
    }

    /// The plane of a triangle, weighted by its area, plus a weak pull to its centroid that keeps flat areas well shaped.
    pub(super) fn triangle([p, q, r]: [Vec3; 3]) -> Self {
        let n = cross(sub(q, p), sub(r, p));
        let len = dot(n, n).sqrt();
        if len <= 0.0 {
            return Self::default();
        }
        let area = len * 0.5;
        let mut out = Self::plane(p, n.map(|x| x / len), area);
        out.add(&Self::point(std::array::from_fn(|i| (p[i] + q[i] + r[i]) / 3.0), area * 1e-4));
        out
    }

    /// `weight` times the squared distance to a point.
    fn point(p: Vec3, weight: f64) -> Self {
        Self { a: [weight, 0.0, 0.0, weight, 0.0, weight], b: p.map(|x| -x * weight), c: dot(p, p) * weight }
    }

    /// Keeps a border edge `pq` of triangle `pqr` in place: the plane through the edge, perpendicular to the triangle.
    pub(super) fn border([p, q, r]: [Vec3; 3]) -> Self {
        let e = sub(q, p);
        let n = cross(e, cross(e, sub(r, p)));
        let len = dot(n, n).sqrt();
        if len <= 0.0 {
            return Self::default();
        }
        Self::plane(p, n.map(|x| x / len), dot(e, e))
    }

    pub(super) fn add(&mut self, o: &Self) {
        for i in 0..6 {
            self.a[i] += o.a[i];
        }
        for i in 0..3 {
            self.b[i] += o.b[i];
        }
        self.c += o.c;
    }

    /// Value at a point, never negative.
    pub(super) fn at(&self, p: Vec3) -> f64 {
        let a = &self.a;
        let v = a[0] * p[0] * p[0]
            + a[3] * p[1] * p[1]
            + a[5] * p[2] * p[2]
            + 2.0 * (a[1] * p[0] * p[1] + a[2] * p[0] * p[2] + a[4] * p[1] * p[2] + dot(self.b, p))
            + self.c;
        v.max(0.0)
    }

    /// The minimum, where the form is well enough conditioned to have one.
    pub(super) fn minimum(&self) -> Option<Vec3> {
        let [a, b, c, d, e, f] = self.a;
        let (m0, m1, m2) = (d * f - e * e, c * e - b * f, b * e - c * d);
        let det = a * m0 + b * m1 + c * m2;
        let trace = a + d + f;
        if det.abs() <= 1e-10 * trace * trace * trace {
            return None;
        }
        let (m3, m4, m5) = (a * f - c * c, b * c - a * e, a * d - b * b);
        let r = self.b;
        Some([
            -(m0 * r[0] + m1 * r[1] + m2 * r[2]) / det,
            -(m1 * r[0] + m3 * r[1] + m4 * r[2]) / det,
            -(m2 * r[0] + m4 * r[1] + m5 * r[2]) / det,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_of_three_planes_is_their_corner() {
        let mut q = Quadric::plane([3.0, 0.0, 0.0], [1.0, 0.0, 0.0], 2.0);
        q.add(&Quadric::plane([0.0, 5.0, 0.0], [0.0, 1.0, 0.0], 1.0));
        q.add(&Quadric::plane([0.0, 0.0, -7.0], [0.0, 0.0, 1.0], 4.0));
        let m = q.minimum().expect("well conditioned");
        assert!(dot(sub(m, [3.0, 5.0, -7.0]), sub(m, [3.0, 5.0, -7.0])) < 1e-18);
        assert!(q.at(m) < 1e-9);
    }
}
