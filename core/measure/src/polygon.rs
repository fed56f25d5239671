//! Simple polygons in a plane: area, whether their sides cross, and a division into triangles.

use crate::refusal::Refusal;
use glam::DVec2;

/// Twice the signed area of a triangle: positive counter-clockwise.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Signed area: positive where the points go round counter-clockwise. Exact in the sense of the shoelace formula, counted from
/// the first point.
pub fn signed_area(points: &[DVec2]) -> f64 {
    let Some((&first, rest)) = points.split_first() else { return 0.0 };
    rest.windows(2).map(|w| turn(first, w[0], w[1])).sum::<f64>() * 0.5
}

/// Whether two sides that are not neighbours touch, or a side has no length.
pub fn is_simple(points: &[DVec2]) -> bool {
    let n = points.len();
    let side = |i: usize| (points[i], points[(i + 1) % n]);
    for i in 0..n {
        let (a, b) = side(i);
        if a == b {
            return false;
        }
        for j in i + 1..n {
            let (c, d) = side(j);
            let neighbours = j == i + 1 || (i == 0 && j == n - 1);
            if neighbours {
                // Folded back onto itself.
                let (tip, from, to) = if j == i + 1 { (b, a, d) } else { (a, b, c) };
                let forward = (from[0] - tip[0]) * (to[0] - tip[0]) + (from[1] - tip[1]) * (to[1] - tip[1]);
                if n > 2 && turn(from, tip, to) == 0.0 && forward > 0.0 {
                    return false;
                }
            } else if touch(a, b, c, d) {
                return false;
            }
        }
    }
    n >= 3
}

fn touch(a: DVec2, b: DVec2, c: DVec2, d: DVec2) -> bool {
    let (s, t) = (turn(a, b, c), turn(a, b, d));
    let (u, v) = (turn(c, d, a), turn(c, d, b));
    if ((s > 0.0) != (t > 0.0)) && ((u > 0.0) != (v > 0.0)) && s != 0.0 && t != 0.0 && u != 0.0 && v != 0.0 {
        return true;
    }
    let within = |p: DVec2, q: DVec2, r: DVec2| (0..2).all(|k| r[k] >= p[k].min(q[k]) && r[k] <= p[k].max(q[k]));
    (s == 0.0 && within(a, b, c))
        || (t == 0.0 && within(a, b, d))
        || (u == 0.0 && within(c, d, a))
        || (v == 0.0 && within(c, d, b))
}

/// A simple polygon as counter-clockwise triangles that tile it: ears are cut off (Meisters, "Polygons have ears", 1975).
///
/// Not the faster [`kilwa_geometry::Triangulator`], which chooses other ears: the sum over other triangles differs in the last digits, and a
/// measurement that was saved must come out the same when it is repeated.
///
/// # Errors
/// [`Refusal::TooFew`], [`Refusal::Crossing`], and [`Refusal::Collinear`] where it encloses nothing.
pub fn triangulate(points: &[DVec2]) -> Result<Vec<[DVec2; 3]>, Refusal> {
    if points.len() < 3 {
        return Err(Refusal::TooFew { tool: "an area", needed: 3, given: points.len() });
    }
    let area = signed_area(points);
    let reach =
        points.iter().flat_map(|p| [p[0] - points[0][0], p[1] - points[0][1]]).fold(0.0, |m: f64, x| m.max(x.abs()));
    if area.abs() <= 1e-12 * reach * reach && is_on_a_line(points, reach) {
        return Err(Refusal::Collinear { what: "an area" });
    }
    if !is_simple(points) {
        return Err(Refusal::Crossing);
    }
    let mut ring: Vec<DVec2> = points.to_vec();
    if area < 0.0 {
        ring.reverse();
    }
    let mut triangles = Vec::with_capacity(ring.len());
    while ring.len() > 3 {
        let n = ring.len();
        let corner = |i: usize| [ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]];
        let ear = (0..n).find(|&i| is_ear(&ring, i)).or_else(|| {
            // Rounding can hide every ear; the flattest corner loses least.
            (0..n).min_by(|&i, &j| size(corner(i)).total_cmp(&size(corner(j))))
        });
        let Some(ear) = ear else { break };
        let triangle = corner(ear);
        if turn(triangle[0], triangle[1], triangle[2]) > 0.0 {
            triangles.push(triangle);
        }
        ring.remove(ear);
    }
    if let [a, b, c] = ring[..]
        && turn(a, b, c) > 0.0
    {
        triangles.push([a, b, c]);
    }
    Ok(triangles)
}

fn size([a, b, c]: [DVec2; 3]) -> f64 {
    turn(a, b, c).abs()
}

fn is_on_a_line(points: &[DVec2], reach: f64) -> bool {
    let far = points.iter().copied().max_by(|a, b| {
        let d = |p: &DVec2| (p[0] - points[0][0]).abs() + (p[1] - points[0][1]).abs();
        d(a).total_cmp(&d(b))
    });
    far.is_none_or(|far| points.iter().all(|&p| turn(points[0], far, p).abs() <= 1e-9 * reach * reach))
}

fn is_ear(ring: &[DVec2], i: usize) -> bool {
    let n = ring.len();
    let (before, after) = ((i + n - 1) % n, (i + 1) % n);
    let [a, b, c] = [ring[before], ring[i], ring[after]];
    if turn(a, b, c) <= 0.0 {
        return turn(a, b, c) == 0.0;
    }
    let inside = |p: DVec2| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
    (0..n).filter(|&k| k != before && k != i && k != after).all(|k| !inside(ring[k]) || [a, b, c].contains(&ring[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_triangle_a_square_and_a_star_have_their_areas_and_a_bow_is_refused() {
        assert_eq!(signed_area(&[DVec2::new(0.0, 0.0), DVec2::new(2.0, 0.0), DVec2::new(0.0, 2.0)]), 2.0);
        assert_eq!(signed_area(&[DVec2::new(0.0, 0.0), DVec2::new(0.0, 2.0), DVec2::new(2.0, 0.0)]), -2.0);
        let bow = [DVec2::new(0.0, 0.0), DVec2::new(1.0, 1.0), DVec2::new(1.0, 0.0), DVec2::new(0.0, 1.0)];
        assert_eq!(triangulate(&bow), Err(Refusal::Crossing));
        assert!(matches!(
            triangulate(&[DVec2::new(0.0, 0.0), DVec2::new(1.0, 1.0), DVec2::new(2.0, 2.0)]),
            Err(Refusal::Collinear { .. })
        ));
        assert!(matches!(triangulate(&[DVec2::new(0.0, 0.0), DVec2::new(1.0, 1.0)]), Err(Refusal::TooFew { .. })));
        let fold = [DVec2::new(0.0, 0.0), DVec2::new(2.0, 0.0), DVec2::new(1.0, 0.0), DVec2::new(1.0, 1.0)];
        assert_eq!(triangulate(&fold), Err(Refusal::Crossing));
    }

    proptest! {
        #[test]
        fn the_triangles_of_a_star_shaped_polygon_add_up_to_its_area(
            radii in prop::collection::vec(0.1f64..10.0, 3..30), reverse in prop::bool::ANY, shift in -1e6f64..1e6,
        ) {
            let n = radii.len() as f64;
            let mut points: Vec<DVec2> = radii.iter().enumerate().map(|(i, r)| {
                let a = i as f64 * std::f64::consts::TAU / n;
                DVec2::new(shift + r * a.cos(), r * a.sin() - shift)
            }).collect();
            if reverse { points.reverse(); }
            prop_assume!(is_simple(&points));
            let sum: f64 = triangulate(&points).unwrap().iter().map(|t| signed_area(t)).sum();
            let area = signed_area(&points).abs();
            prop_assert!((sum - area).abs() <= 1e-8 * area.max(1.0), "{sum} {area}");
        }
    }
}
