//! Exact-enough distances in `f64`: point to triangle, and the ray–triangle intersection that picks rest on.
//!
//! Coordinates are lattice steps below 2^31, so every difference is exact and the relative error of a distance is a few
//! units in the last place; callers that need a *bound* add [`DISTANCE_SLACK`].

/// Relative rounding slack of [`point_triangle_squared`]'s square root, generous by orders of magnitude.
pub const DISTANCE_SLACK: f64 = 1e-9;

/// A point or vector in `f64`.
pub type Vec3 = [f64; 3];

/// `a - b`.
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Dot product.
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The point of triangle `abc` nearest to `p` (Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
/// Degenerate triangles (segments and points) give the nearest point of what they are.
pub fn closest_on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return along(a, ab, d1 / (d1 - d3));
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return along(a, ac, d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return along(b, sub(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let denominator = va + vb + vc;
    let (v, w) = (vb / denominator, vc / denominator);
    [a[0] + ab[0] * v + ac[0] * w, a[1] + ab[1] * v + ac[1] * w, a[2] + ab[2] * v + ac[2] * w]
}

fn along(a: Vec3, d: Vec3, t: f64) -> Vec3 {
    [a[0] + d[0] * t, a[1] + d[1] * t, a[2] + d[2] * t]
}

/// Squared distance from a point to a triangle.
pub fn point_triangle_squared(p: Vec3, triangle: [Vec3; 3]) -> f64 {
    let d = sub(p, closest_on_triangle(p, triangle));
    dot(d, d)
}

/// Where the ray `origin + t * direction` meets a triangle, `t >= 0`: Möller and Trumbore, 1997, both sides.
pub fn ray_triangle(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<f64> {
    let (e1, e2) = (sub(b, a), sub(c, a));
    let p = cross(direction, e2);
    let det = dot(e1, p);
    if det == 0.0 {
        return None;
    }
    let s = sub(origin, a);
    let u = dot(s, p) / det;
    let q = cross(s, e1);
    let v = dot(direction, q) / det;
    let t = dot(e2, q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        (-100i32..100, -100i32..100, -100i32..100).prop_map(|(x, y, z)| [f64::from(x), f64::from(y), f64::from(z)])
    }

    proptest! {
        #[test]
        fn the_closest_point_beats_a_dense_sampling_of_the_triangle(p in point(), a in point(), b in point(), c in point()) {
            let d = point_triangle_squared(p, [a, b, c]).sqrt();
            let mut best = f64::MAX;
            for i in 0..=40 {
                for j in 0..=(40 - i) {
                    let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    let q: Vec3 = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * u + (c[k] - a[k]) * v);
                    let e = sub(p, q);
                    best = best.min(dot(e, e).sqrt());
                }
            }
            prop_assert!(d <= best + 1e-6);
            // The sampling is at most one cell off.
            let cell = dot(sub(b, a), sub(b, a)).sqrt().max(dot(sub(c, a), sub(c, a)).sqrt()) / 20.0;
            prop_assert!(best <= d + cell + 1e-6);
        }
    }
}
