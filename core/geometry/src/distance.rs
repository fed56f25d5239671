//! Exact-enough distances in `f64`: point to triangle, and the ray–triangle intersection that picks rest on.
//!
//! Coordinates are lattice units below 2^31, so every difference of them is exact; a distance is right to a few units in
//! the last place of the coordinates. Callers that need a *bound* add [`DISTANCE_SLACK`] and [`ABSOLUTE_SLACK`].

/// Relative rounding slack of [`point_triangle_squared`]'s square root, generous by orders of magnitude.
pub const DISTANCE_SLACK: f64 = 1e-9;

/// Absolute slack of a distance, in lattice units: a hundred times what was seen at coordinates of 2^28.
pub const ABSOLUTE_SLACK: f64 = 1e-6;

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
    let n = cross(ab, ac);
    // So thin that the areas are rounding noise: the nearest point of an edge, which is on the triangle in any case.
    let thin = dot(n, n) <= 1e-12 * dot(ab, ab) * dot(ac, ac);
    if thin || !(v >= 0.0 && w >= 0.0 && v + w <= 1.0) {
        let far = |q: &Vec3| {
            let e = sub(p, *q);
            dot(e, e)
        };
        let edges = [on_segment(p, a, ab), on_segment(p, a, ac), on_segment(p, b, sub(c, b))];
        return edges.into_iter().min_by(|x, y| far(x).total_cmp(&far(y))).unwrap_or(a);
    }
    [a[0] + ab[0] * v + ac[0] * w, a[1] + ab[1] * v + ac[1] * w, a[2] + ab[2] * v + ac[2] * w]
}

/// The point of the segment from `s` along `d` nearest to `p`.
fn on_segment(p: Vec3, s: Vec3, d: Vec3) -> Vec3 {
    let l = dot(d, d);
    along(s, d, if l > 0.0 { (dot(sub(p, s), d) / l).clamp(0.0, 1.0) } else { 0.0 })
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
        fn the_closest_point_of_a_triangle_without_area_is_on_it(
            p in prop::array::uniform3(-100.0f64..100.0), a in point(), d in point(), s in -9i32..9, size in 0u32..20,
        ) {
            let scale = f64::from(1u32 << size);
            let (a, d, p) = (a.map(|x| x * scale), d.map(|x| x * scale), p.map(|x| x * scale));
            let end = |t: f64| -> Vec3 { std::array::from_fn(|i| a[i] + d[i] * t) };
            let (b, c) = (end(1.0), end(f64::from(s)));
            let found = point_triangle_squared(p, [a, b, c]).sqrt();
            let segments = [(a, b), (b, c), (c, a)].map(|(u, v)| {
                let q = on_segment(p, u, sub(v, u));
                dot(sub(p, q), sub(p, q)).sqrt()
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
