//! Provisional picks: how far along a ray the finest surface can lie, when only a coarse form of it is there.
//!
//! Every point of the finest surface lies within ε of the coarse form, ε certified. So the point of the finest surface that a
//! ray meets lies where the ray is within ε of a coarse triangle: on the stretches of the ray inside the triangles grown by
//! ε. ε bounds a distance, not a displacement along the ray: at grazing angles a stretch is long, at silhouettes there are several.

use crate::pick::Ray;
use glam::DVec3;

/// The stretch of a ray (parameters, `t ≥ 0`) within `error` of a triangle. It is one, because the triangle grown by `error`
/// is convex; computed as the hull of the stretches in its prism, its three cylinders and its three balls. Slightly wide against rounding.
pub fn stretch(ray: &Ray, [a, b, c]: [DVec3; 3], error: f64) -> Option<(f64, f64)> {
    let reach = error * (1.0 + 1e-9) + 1e-9;
    // Most triangles are nowhere near: a ball round the whole says so at once.
    let centre: DVec3 = (a + b + c) / 3.0;
    let far = |p: DVec3| (p - centre).length();
    ball(ray, centre, (far(a).max(far(b)).max(far(c)) + reach) * (1.0 + 1e-9))?;
    let mut hull: Option<(f64, f64)> = None;
    let mut grow = |part: Option<(f64, f64)>| {
        if let Some((from, to)) = part {
            hull = Some(hull.map_or((from, to), |(x, y)| (x.min(from), y.max(to))));
        }
    };
    for corner in [a, b, c] {
        grow(ball(ray, corner, reach));
    }
    for (p, q) in [(a, b), (b, c), (c, a)] {
        grow(cylinder(ray, p, q, reach));
    }
    grow(prism(ray, [a, b, c], reach));
    let (from, to) = hull?;
    (to >= 0.0).then_some((from.max(0.0), to))
}

/// Where `|o + t d|² ≤ r²`.
fn quadratic(dd: f64, od: f64, oo: f64, r: f64) -> Option<(f64, f64)> {
    let c = oo - r * r;
    if dd <= 0.0 {
        return (c <= 0.0).then_some((f64::NEG_INFINITY, f64::INFINITY));
    }
    let root = od * od - dd * c;
    (root >= 0.0).then(|| ((-od - libm::sqrt(root)) / dd, (-od + libm::sqrt(root)) / dd))
}

fn ball(ray: &Ray, centre: DVec3, r: f64) -> Option<(f64, f64)> {
    let (o, d) = (ray.origin - centre, ray.direction);
    quadratic(d.length_squared(), o.dot(d), o.length_squared(), r)
}

fn cylinder(ray: &Ray, p: DVec3, q: DVec3, r: f64) -> Option<(f64, f64)> {
    let axis = q - p;
    let square = axis.length_squared();
    if square == 0.0 {
        return None;
    }
    let (o, d) = (ray.origin - p, ray.direction);
    let (oa, da) = (o.dot(axis), d.dot(axis));
    let across = |x: f64, y: f64, xy: f64| xy - x * y / square;
    let round =
        quadratic(across(da, da, d.length_squared()), across(oa, da, o.dot(d)), across(oa, oa, o.length_squared()), r)?;
    meet(round, slab(oa, da, 0.0, square)?)
}

fn prism(ray: &Ray, [a, b, c]: [DVec3; 3], r: f64) -> Option<(f64, f64)> {
    let n = (b - a).cross(c - a);
    let size = n.length();
    if size == 0.0 {
        return None;
    }
    let o = ray.origin - a;
    let mut part = slab(o.dot(n), ray.direction.dot(n), -r * size, r * size)?;
    for (p, q) in [(a, b), (b, c), (c, a)] {
        let inward = n.cross(q - p);
        part = meet(part, slab((ray.origin - p).dot(inward), ray.direction.dot(inward), 0.0, f64::INFINITY)?)?;
    }
    Some(part)
}

/// Where `low ≤ o + t d ≤ high`.
fn slab(o: f64, d: f64, low: f64, high: f64) -> Option<(f64, f64)> {
    if d == 0.0 {
        return (low <= o && o <= high).then_some((f64::NEG_INFINITY, f64::INFINITY));
    }
    let (x, y) = ((low - o) / d, (high - o) / d);
    Some((x.min(y), x.max(y)))
}

fn meet(a: (f64, f64), b: (f64, f64)) -> Option<(f64, f64)> {
    let both = (a.0.max(b.0), a.1.min(b.1));
    (both.0 <= both.1).then_some(both)
}

/// What a coarse form says of the pick.
#[derive(Debug, Clone, PartialEq)]
pub enum Provisional {
    /// The ray passes no surface within the error: the finest surface is not met either.
    Nothing,
    /// One stretch: the pick lies on it, or the ray passes the finest surface there without meeting it.
    Between {
        /// Where it begins, parameter along the ray.
        from: f64,
        /// Where it ends.
        to: f64,
    },
    /// Several stretches: no number before it is final. In order along the ray.
    Several(Vec<(f64, f64)>),
}

/// Join the stretches of all coarse triangles near the ray.
pub fn provisional(stretches: impl IntoIterator<Item = (f64, f64)>) -> Provisional {
    let mut all: Vec<(f64, f64)> = stretches.into_iter().collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut joined: Vec<(f64, f64)> = Vec::new();
    for (from, to) in all {
        match joined.last_mut() {
            Some(last) if from <= last.1 => last.1 = last.1.max(to),
            _ => joined.push((from, to)),
        }
    }
    match joined[..] {
        [] => Provisional::Nothing,
        [(from, to)] => Provisional::Between { from, to },
        _ => Provisional::Several(joined),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::distance::point_triangle_squared;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_interval_is_exactly_where_the_ray_is_within_the_error(
            t in prop::array::uniform3(prop::array::uniform3(-10.0f64..10.0).prop_map(DVec3::from)),
            o in prop::array::uniform3(-20.0f64..20.0).prop_map(DVec3::from),
            d in prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from), e in 0.01f64..5.0,
        ) {
            prop_assume!(d.length_squared() > 0.01);
            let ray = Ray { origin: o, direction: d };
            let found = stretch(&ray, t, e);
            for i in 0..2000 {
                let at = f64::from(i) * 0.05;
                let away = point_triangle_squared(ray.at(at), t).sqrt();
                let inside = found.is_some_and(|(from, to)| from <= at && at <= to);
                if away <= e { prop_assert!(inside, "{at}: {away} <= {e}, {found:?}"); }
                if inside { prop_assert!(away <= e * (1.0 + 1e-6) + 1e-6, "{at}: {away} > {e}, {found:?}"); }
            }
        }
    }

    #[test]
    fn overlapping_intervals_are_merged_and_separate_ones_give_no_number() {
        assert_eq!(provisional([]), Provisional::Nothing);
        assert_eq!(provisional([(2.0, 4.0), (1.0, 3.0)]), Provisional::Between { from: 1.0, to: 4.0 });
        assert_eq!(provisional([(5.0, 6.0), (1.0, 3.0)]), Provisional::Several(vec![(1.0, 3.0), (5.0, 6.0)]));
    }
}
