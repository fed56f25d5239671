//! Exact-enough distances in `f64`: point to triangle, and the ray–triangle intersection that picks rest on.
//!
//! Coordinates are lattice units below 2^31, so every difference of them is exact; a distance is right to a few units in
//! the last place of the coordinates. Callers that need a *bound* add [`DISTANCE_SLACK`] and [`ABSOLUTE_SLACK`].

use glam::DVec3;

/// Relative rounding slack of [`point_triangle_squared`]'s square root, generous by orders of magnitude.
pub const DISTANCE_SLACK: f64 = 1e-9;

/// Absolute slack of a distance, in lattice units: a hundred times what was seen at coordinates of 2^28.
pub const ABSOLUTE_SLACK: f64 = 1e-6;

/// The point of triangle `abc` nearest to `p` (Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
/// Degenerate triangles (segments and points) give the nearest point of what they are.
pub fn closest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return along(a, ab, d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return along(a, ac, d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return along(b, c - b, (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let denominator = va + vb + vc;
    let (v, w) = (vb / denominator, vc / denominator);
    let n = ab.cross(ac);
    // So thin that the areas are rounding noise: the nearest point of an edge, which is on the triangle in any case.
    let thin = n.length_squared() <= 1e-12 * ab.length_squared() * ac.length_squared();
    if thin || !(v >= 0.0 && w >= 0.0 && v + w <= 1.0) {
        let far = |q: &DVec3| p.distance_squared(*q);
        let edges = [on_segment(p, a, ab), on_segment(p, a, ac), on_segment(p, b, c - b)];
        return edges.into_iter().min_by(|x, y| far(x).total_cmp(&far(y))).unwrap_or(a);
    }
    a + ab * v + ac * w
}

/// The point of the segment from `s` along `d` nearest to `p`.
fn on_segment(p: DVec3, s: DVec3, d: DVec3) -> DVec3 {
    let l = d.length_squared();
    along(s, d, if l > 0.0 { ((p - s).dot(d) / l).clamp(0.0, 1.0) } else { 0.0 })
}

fn along(a: DVec3, d: DVec3, t: f64) -> DVec3 {
    a + d * t
}

/// Squared distance from a point to a triangle.
pub fn point_triangle_squared(p: DVec3, triangle: [DVec3; 3]) -> f64 {
    p.distance_squared(closest_on_triangle(p, triangle))
}

/// Where the ray `origin + t * direction` meets a triangle, `t >= 0`: Möller and Trumbore, 1997, both sides.
pub fn ray_triangle(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    if det == 0.0 {
        return None;
    }
    let s = origin - a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::IVec3;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        (-100i32..100, -100i32..100, -100i32..100).prop_map(|(x, y, z)| IVec3::new(x, y, z).as_dvec3())
    }

    proptest! {
        #[test]
        fn the_closest_point_of_a_triangle_without_area_is_on_it(
            p in prop::array::uniform3(-100.0f64..100.0), a in point(), d in point(), s in -9i32..9, size in 0u32..20,
        ) {
            let scale = f64::from(1u32 << size);
            let (a, d, p) = (a * scale, d * scale, DVec3::from(p) * scale);
            let end = |t: f64| -> DVec3 { a + d * t };
            let (b, c) = (end(1.0), end(f64::from(s)));
            let found = point_triangle_squared(p, [a, b, c]).sqrt();
            let segments = [(a, b), (b, c), (c, a)].map(|(u, v)| {
                let q = on_segment(p, u, v - u);
                p.distance(q)
            });
            let right = segments.into_iter().fold(f64::MAX, f64::min);
            prop_assert!((found - right).abs() <= 1e-9 * scale * 1000.0, "{found} {right}");
        }

        #[test]
        fn the_closest_point_is_at_least_as_close_as_any_of_a_dense_sampling(p in point(), a in point(), b in point(), c in point()) {
            let d = point_triangle_squared(p, [a, b, c]).sqrt();
            let mut best = f64::MAX;
            for i in 0..=40 {
                for j in 0..=(40 - i) {
                    let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    let q: DVec3 = a + (b - a) * u + (c - a) * v;
                    let e = p - q;
                    best = best.min(e.length());
                }
            }
            prop_assert!(d <= best + 1e-6);
            // The sampling is at most one cell off.
            let cell = (b - a).length().max((c - a).length()) / 20.0;
            prop_assert!(best <= d + cell + 1e-6);
        }
    }
}
