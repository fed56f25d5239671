//! Quadric error metric: Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", SIGGRAPH 1997,
//! area-weighted. Coordinates are local to the fragment, in lattice units, so that nothing cancels.

use glam::DVec3;

/// A symmetric quadratic form `x'Ax + 2b'x + c`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    a: [f64; 6],
    b: DVec3,
    c: f64,
}

impl Quadric {
    /// The same form, this many times as large.
    pub(super) fn times(&self, w: f64) -> Self {
        Self { a: self.a.map(|x| x * w), b: self.b * w, c: self.c * w }
    }

    /// `weight` times the squared distance to the plane through `p` with unit normal `n`.
    fn plane(p: DVec3, n: DVec3, weight: f64) -> Self {
        let d = -n.dot(p);
        let w = weight;
        Self {
            a: [n.x * n.x * w, n.x * n.y * w, n.x * n.z * w, n.y * n.y * w, n.y * n.z * w, n.z * n.z * w],
            b: n * d * w,
            c: d * d * w,
        }
    }

    /// The plane of a triangle, weighted by its area, plus a weak pull to its centroid that keeps flat areas well shaped.
    pub(super) fn triangle([p, q, r]: [DVec3; 3]) -> Self {
        let n = (q - p).cross(r - p);
        let len = n.length();
        if len <= 0.0 {
            return Self::default();
        }
        let area = len * 0.5;
        let mut out = Self::plane(p, n / len, area);
        out.add(&Self::point((p + q + r) / 3.0, area * 1e-4));
        out
    }

    /// `weight` times the squared distance to a point.
    fn point(p: DVec3, weight: f64) -> Self {
        Self { a: [weight, 0.0, 0.0, weight, 0.0, weight], b: -p * weight, c: p.length_squared() * weight }
    }

    /// Keeps a border edge `pq` of triangle `pqr` in place: the plane through the edge, perpendicular to the triangle.
    pub(super) fn border([p, q, r]: [DVec3; 3]) -> Self {
        let e = q - p;
        let n = e.cross(e.cross(r - p));
        let len = n.length();
        if len <= 0.0 {
            return Self::default();
        }
        Self::plane(p, n / len, e.length_squared())
    }

    pub(super) fn add(&mut self, o: &Self) {
        for i in 0..6 {
            self.a[i] += o.a[i];
        }
        self.b += o.b;
        self.c += o.c;
    }

    /// Value at a point, never negative.
    pub(super) fn at(&self, p: DVec3) -> f64 {
        let a = &self.a;
        let v = a[0] * p.x * p.x
            + a[3] * p.y * p.y
            + a[5] * p.z * p.z
            + 2.0 * (a[1] * p.x * p.y + a[2] * p.x * p.z + a[4] * p.y * p.z + self.b.dot(p))
            + self.c;
        v.max(0.0)
    }

    /// The minimum, where the form is well enough conditioned to have one.
    pub(super) fn minimum(&self) -> Option<DVec3> {
        let [a, b, c, d, e, f] = self.a;
        let (m0, m1, m2) = (d * f - e * e, c * e - b * f, b * e - c * d);
        let det = a * m0 + b * m1 + c * m2;
        let trace = a + d + f;
        if det.abs() <= 1e-10 * trace * trace * trace {
            return None;
        }
        let (m3, m4, m5) = (a * f - c * c, b * c - a * e, a * d - b * b);
        let r = self.b;
        Some(DVec3::new(
            -(m0 * r.x + m1 * r.y + m2 * r.z) / det,
            -(m1 * r.x + m3 * r.y + m4 * r.z) / det,
            -(m2 * r.x + m4 * r.y + m5 * r.z) / det,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_of_three_planes_is_their_corner() {
        let mut q = Quadric::plane(DVec3::new(3.0, 0.0, 0.0), DVec3::X, 2.0);
        q.add(&Quadric::plane(DVec3::new(0.0, 5.0, 0.0), DVec3::Y, 1.0));
        q.add(&Quadric::plane(DVec3::new(0.0, 0.0, -7.0), DVec3::Z, 4.0));
        let m = q.minimum().expect("well conditioned");
        assert!((m - DVec3::new(3.0, 5.0, -7.0)).length_squared() < 1e-18);
        assert!(q.at(m) < 1e-9);
    }
}
