//! Lengths of paths: from point to point, and along the surface.

use crate::plane::Plane;
use crate::refusal::{Refusal, at_least};
use crate::section::{Polyline, Section};
use glam::DVec3;
use serde::Serialize;

/// A path from point to point, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PathLength {
    /// Sum of the straight legs.
    pub straight: f64,
    /// Sum of the legs in plan.
    pub horizontal: f64,
    /// Upwards from the first point to the last (0 for a closed path).
    pub vertical: f64,
    /// From the first point to the last, straight.
    pub ends: f64,
}

/// The length of a path; `closed` adds the leg from the last point to the first.
///
/// # Errors
/// [`Refusal::TooFew`] below two points.
pub fn length(points: &[DVec3], closed: bool) -> Result<PathLength, Refusal> {
    at_least("a length", 2, points)?;
    let (first, last) = (points[0], points[points.len() - 1]);
    let mut legs: Vec<DVec3> = points.windows(2).map(|w| w[1] - w[0]).collect();
    if closed {
        legs.push(first - last);
    }
    let over = |d: &DVec3| d.truncate().length();
    Ok(PathLength {
        straight: legs.iter().map(|d| d.length()).sum(),
        horizontal: legs.iter().map(over).sum(),
        vertical: if closed { 0.0 } else { last[2] - first[2] },
        ends: if closed { 0.0 } else { (last - first).length() },
    })
}

/// The plane along which the distance on the surface between two points is taken: through both, and upright to the surface
/// there (`normal` is the mean of the surface's normals at the two points), like a tape laid straight on it.
///
/// # Errors
/// [`Refusal::Coincident`] where the points are the same or one lies behind the other as seen along the normal.
pub fn tape_plane(a: DVec3, b: DVec3, normal: DVec3) -> Result<Plane, Refusal> {
    at_least("a distance along the surface", 2, &[a, b])?;
    let same = Refusal::Coincident { what: "a distance along the surface" };
    let along = (b - a).try_normalize().ok_or(same.clone())?;
    let across = along.cross(normal);
    if across.length() < 1e-6 * normal.length() {
        return Err(same);
    }
    Plane::new(a, across)
}

/// The stretch of a section from the point of it nearest to `a` to the one nearest to `b`: the shorter way round where the
/// line is closed. Both have to lie within `tolerance` metres of the same line.
///
/// # Errors
/// [`Refusal::Gap`] where no line joins them.
pub fn along(section: &Section, a: DVec3, b: DVec3, tolerance: f64) -> Result<Polyline, Refusal> {
    let joined = section.polylines.iter().filter_map(|line| {
        let (from, to) = (nearest(line, a)?, nearest(line, b)?);
        (from.away <= tolerance && to.away <= tolerance).then(|| stretch(line, &from, &to))
    });
    joined.min_by(|p, q| p.length().total_cmp(&q.length())).ok_or(Refusal::Gap)
}

/// A place on a line.
struct Place {
    leg: usize,
    point: DVec3,
    /// Share of the leg.
    share: f64,
    away: f64,
}

fn legs(line: &Polyline) -> usize {
    if line.closed { line.points.len() } else { line.points.len().saturating_sub(1) }
}

fn nearest(line: &Polyline, p: DVec3) -> Option<Place> {
    let at = |i: usize| line.points[i % line.points.len()];
    let places = (0..legs(line)).map(|leg| {
        let (a, d) = (at(leg), at(leg + 1) - at(leg));
        let square = d.length_squared();
        let share = if square > 0.0 { ((p - a).dot(d) / square).clamp(0.0, 1.0) } else { 0.0 };
        let point = a + d * share;
        Place { leg, point, share, away: (p - point).length() }
    });
    places.min_by(|p, q| p.away.total_cmp(&q.away))
}

fn stretch(line: &Polyline, from: &Place, to: &Place) -> Polyline {
    let n = line.points.len();
    let ahead = (to.leg, to.share) >= (from.leg, from.share);
    let walk = |start: &Place, end: &Place, wraps: bool| {
        let mut points = vec![start.point];
        let last = if wraps { end.leg + n } else { end.leg };
        points.extend((start.leg + 1..=last).map(|i| line.points[i % n]));
        points.push(end.point);
        points.dedup();
        Polyline { points, closed: false }
    };
    let direct = if ahead { walk(from, to, false) } else { walk(to, from, false) };
    if !line.closed {
        return direct;
    }
    let round = if ahead { walk(to, from, true) } else { walk(from, to, true) };
    if round.length() < direct.length() { round } else { direct }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(points: Vec<DVec3>, closed: bool) -> Section {
        let plane = Plane::new(DVec3::ZERO, DVec3::Y).unwrap();
        Section { plane, polylines: vec![Polyline { points, closed }], triangles: 4 }
    }

    #[test]
    fn a_path_has_a_length_for_each_segment() {
        let l = length(&[DVec3::ZERO, DVec3::new(3.0, 4.0, 0.0), DVec3::new(3.0, 4.0, 12.0)], false).unwrap();
        assert_eq!((l.straight, l.horizontal, l.vertical, l.ends), (17.0, 5.0, 12.0, 13.0));
        let l = length(&[DVec3::ZERO, DVec3::new(3.0, 4.0, 0.0), DVec3::new(3.0, 4.0, 12.0)], true).unwrap();
        assert_eq!((l.straight, l.horizontal, l.vertical), (30.0, 10.0, 0.0));
        assert!(length(&[DVec3::ZERO], false).is_err());
    }

    #[test]
    fn a_surface_path_over_a_step_is_longer_than_straight_and_round_a_ring_takes_the_shorter_way() {
        let step = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 0.0, 1.0), DVec3::new(2.0, 0.0, 1.0)];
        let s = section(step, false);
        for (a, b) in [
            (DVec3::new(0.5, 0.0, 0.0), DVec3::new(1.5, 0.0, 1.0)),
            (DVec3::new(1.5, 0.0, 1.0), DVec3::new(0.5, 0.0, 0.0)),
        ] {
            assert!((along(&s, a, b, 1e-6).unwrap().length() - 2.0).abs() < 1e-12);
        }
        assert_eq!(along(&s, DVec3::new(0.5, 0.0, 0.0), DVec3::new(9.0, 0.0, 1.0), 1e-3), Err(Refusal::Gap));
        let ring = section(vec![DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(4.0, 0.0, 1.0), DVec3::Z], true);
        let (a, b) = (DVec3::X, DVec3::new(1.0, 0.0, 1.0));
        for (a, b) in [(a, b), (b, a)] {
            assert!((along(&ring, a, b, 1e-6).unwrap().length() - 3.0).abs() < 1e-12);
        }
        assert!((along(&ring, DVec3::X, DVec3::new(2.0, 0.0, 0.0), 1e-6).unwrap().length() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_tape_plane_holds_both_points_and_stands_on_the_surface() {
        let (a, b, n) = (DVec3::new(1.0, 0.0, 2.0), DVec3::new(4.0, 0.0, 6.0), DVec3::new(0.0, -1.0, 0.0));
        let plane = tape_plane(a, b, n).unwrap();
        assert!(plane.distance(b).abs() < 1e-12 && plane.normal.dot(n).abs() < 1e-12);
        assert!(tape_plane(a, a, n).is_err());
        assert!(tape_plane(a, DVec3::new(1.0, -5.0, 2.0), n).is_err());
    }
}
