//! Geometry written a second time, plainly, on the triangles that a pack was built from.

pub(crate) type P = [f64; 3];

pub(crate) fn sub(a: P, b: P) -> P {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn dot(a: P, b: P) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: P, b: P) -> P {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: P) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn area([a, b, c]: [P; 3]) -> f64 {
    length(cross(sub(b, a), sub(c, a))) * 0.5
}

pub(crate) fn perimeter([a, b, c]: [P; 3]) -> f64 {
    length(sub(b, a)) + length(sub(c, b)) + length(sub(a, c))
}

/// Six times the volume of the tetrahedron of a triangle and the origin.
pub(crate) fn six_volume([a, b, c]: [P; 3]) -> f64 {
    dot(a, cross(b, c))
}

/// Where a plane cuts a triangle.
pub(crate) fn cut(t: [P; 3], at: P, normal: P) -> Option<[P; 2]> {
    let d = t.map(|p| dot(normal, sub(p, at)));
    let mut ends = Vec::new();
    for i in 0..3 {
        let j = (i + 1) % 3;
        if (d[i] >= 0.0) != (d[j] >= 0.0) {
            let share = d[i] / (d[i] - d[j]);
            ends.push([0, 1, 2].map(|k| t[i][k] + (t[j][k] - t[i][k]) * share));
        }
    }
    let both: Result<[P; 2], _> = ends.try_into();
    both.ok()
}

/// Distance from a point to a segment.
pub(crate) fn to_segment(p: P, [a, b]: [P; 2]) -> f64 {
    let d = sub(b, a);
    let square = dot(d, d);
    let t = if square > 0.0 { (dot(sub(p, a), d) / square).clamp(0.0, 1.0) } else { 0.0 };
    length(sub(p, [0, 1, 2].map(|k| a[k] + d[k] * t)))
}

/// A random number from `low` to `high`.
pub(crate) fn between(random: &mut fastrand::Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * random.f64()
}
