//! Profiles: what a wall of vertical planes along a drawn line cuts, straightened; and contours.

use crate::plane::Plane;
use crate::refusal::{Refusal, at_least};
use crate::section::{Polyline, Section};
use glam::{DVec2, DVec3};
use serde::Serialize;

/// One leg of a profile: the vertical plane through two points of the drawn line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// Where it starts; only x and y count.
    pub from: DVec3,
    /// Unit vector along it, level.
    pub along: DVec3,
    /// Its length in plan, metres.
    pub length: f64,
    /// How far along the whole line it starts, metres.
    pub start: f64,
}

impl Leg {
    /// The upright plane that holds it.
    pub fn plane(&self) -> Plane {
        Plane { point: self.from, normal: DVec3::new(self.along.y, -self.along.x, 0.0) }
    }

    /// The parts of a section of [`Leg::plane`] that lie between the ends of the leg, straightened: x is the way along the whole
    /// drawn line, y the height (local metres).
    pub fn straighten(&self, section: &Section) -> Vec<ProfileLine> {
        let flat = |p: DVec3| DVec2::new(self.along.dot(p - self.from), p.z);
        let mut lines = Vec::new();
        for polyline in &section.polylines {
            let mut points: Vec<DVec2> = polyline.points.iter().map(|p| flat(*p)).collect();
            if polyline.closed {
                points.extend(points.first().copied());
            }
            lines.extend(between(&points, self.length));
        }
        for p in lines.iter_mut().flatten() {
            p[0] += self.start;
        }
        lines.into_iter().map(|points| ProfileLine { points }).collect()
    }
}

/// One line of a straightened profile.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProfileLine {
    /// Way along the drawn line and height, metres.
    pub points: Vec<DVec2>,
}

/// The legs of a drawn line, in plan.
///
/// # Errors
/// [`Refusal::TooFew`]; [`Refusal::Coincident`] where two points that follow each other lie one above the other.
pub fn legs(points: &[DVec3]) -> Result<Vec<Leg>, Refusal> {
    at_least("a profile", 2, points)?;
    let mut start = 0.0;
    let mut legs = Vec::with_capacity(points.len() - 1);
    for w in points.windows(2) {
        let d = (w[1] - w[0]).truncate();
        let length = libm::hypot(d.x, d.y);
        if length == 0.0 {
            return Err(Refusal::Coincident { what: "a profile" });
        }
        legs.push(Leg { from: w[0], along: (d / length).extend(0.0), length, start });
        start += length;
    }
    Ok(legs)
}

/// The parts of a line with `0 ≤ x ≤ length`.
fn between(points: &[DVec2], length: f64) -> Vec<Vec<DVec2>> {
    let mut lines: Vec<Vec<DVec2>> = Vec::new();
    let mut current: Vec<DVec2> = Vec::new();
    for w in points.windows(2) {
        let (a, b) = (w[0], w[1]);
        let d = b[0] - a[0];
        let at = |x: f64| if d == 0.0 { 0.0 } else { (x - a[0]) / d };
        let (mut from, mut to) = (0.0f64, 1.0f64);
        if d == 0.0 && !(0.0..=length).contains(&a[0]) {
            to = -1.0;
        } else if d != 0.0 {
            from = from.max(at(0.0).min(at(length)));
            to = to.min(at(0.0).max(at(length)));
        }
        if from > to {
            lines.extend((current.len() > 1).then(|| std::mem::take(&mut current)));
            current.clear();
            continue;
        }
        let point = |t: f64| -> DVec2 {
            let p = a.lerp_monotonic(b, t);
            if t == 0.0 {
                a
            } else if t == 1.0 {
                b
            } else {
                p
            }
        };
        if from > 0.0 || current.is_empty() {
            lines.extend((current.len() > 1).then(|| std::mem::take(&mut current)));
            current = vec![point(from)];
        }
        current.push(point(to));
        if to < 1.0 {
            lines.push(std::mem::take(&mut current));
        }
    }
    lines.extend((current.len() > 1).then_some(current));
    lines
}

/// Heights of the contours between two heights: whole multiples of the interval, in world metres.
///
/// # Errors
/// [`Refusal::NotFinite`] for an interval that is not positive, or for one that would give more than `limit` contours.
pub fn contour_heights(low: f64, high: f64, interval: f64, limit: usize) -> Result<Vec<f64>, Refusal> {
    let is_sane = low.is_finite() && high.is_finite() && interval.is_finite() && interval > 0.0;
    let (first, last) = (libm::ceil(low / interval), libm::floor(high / interval));
    if !is_sane || last - first >= limit as f64 {
        return Err(Refusal::NotFinite);
    }
    let count = (last - first + 1.0).max(0.0) as usize;
    Ok((0..count).map(|i| (first + i as f64) * interval).collect())
}

/// The lines of a profile of one leg together with how long they are.
pub fn total_length(lines: &[ProfileLine]) -> f64 {
    let leg = |w: &[DVec2]| libm::hypot(w[1][0] - w[0][0], w[1][1] - w[0][1]);
    lines.iter().map(|l| l.points.windows(2).map(leg).sum::<f64>()).sum()
}

/// A section's line as a closed or open list of points, for drawing: the first repeated at the end where it is closed.
pub fn drawn(line: &Polyline) -> Vec<DVec3> {
    let mut points = line.points.clone();
    if line.closed {
        points.extend(line.points.first().copied());
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_keeps_what_lies_between_its_ends_and_continues_around_corners() {
        let legs = legs(&[DVec3::new(0.0, 0.0, 5.0), DVec3::new(2.0, 0.0, 9.0), DVec3::new(2.0, 3.0, 0.0)]).unwrap();
        assert_eq!((legs[0].length, legs[1].length, legs[1].start), (2.0, 3.0, 2.0));
        assert!(legs[1].plane().distance(DVec3::new(2.0, 77.0, -3.0)).abs() < 1e-12);
        let line = Polyline {
            points: vec![DVec3::new(-1.0, 0.0, 1.0), DVec3::new(1.0, 0.0, 2.0), DVec3::new(5.0, 0.0, 4.0)],
            closed: false,
        };
        let section = Section { plane: legs[0].plane(), polylines: vec![line], triangles: 2 };
        let flat = legs[0].straighten(&section);
        assert_eq!(flat.len(), 1);
        assert_eq!(flat[0].points, [DVec2::new(0.0, 1.5), DVec2::new(1.0, 2.0), DVec2::new(2.0, 2.5)]);
        let line = Polyline {
            points: vec![
                DVec3::new(2.0, -1.0, 0.0),
                DVec3::new(2.0, 1.0, 0.0),
                DVec3::new(2.0, 1.0, 7.0),
                DVec3::new(2.0, 9.0, 7.0),
            ],
            closed: false,
        };
        let section = Section { plane: legs[1].plane(), polylines: vec![line], triangles: 3 };
        assert_eq!(
            legs[1].straighten(&section)[0].points,
            [DVec2::new(2.0, 0.0), DVec2::new(3.0, 0.0), DVec2::new(3.0, 7.0), DVec2::new(5.0, 7.0)]
        );
    }

    #[test]
    fn a_line_that_leaves_and_returns_becomes_two() {
        let lines =
            between(&[DVec2::new(0.5, 0.0), DVec2::new(1.5, 1.0), DVec2::new(1.5, 2.0), DVec2::new(0.5, 3.0)], 1.0);
        assert_eq!(
            lines,
            [vec![DVec2::new(0.5, 0.0), DVec2::new(1.0, 0.5)], vec![DVec2::new(1.0, 2.5), DVec2::new(0.5, 3.0)]]
        );
        assert!(between(&[DVec2::new(2.0, 0.0), DVec2::new(3.0, 0.0)], 1.0).is_empty());
    }

    #[test]
    fn contours_are_multiples_of_the_interval_and_too_many_are_refused() {
        assert_eq!(contour_heights(0.9, 2.1, 0.5, 100).unwrap(), [1.0, 1.5, 2.0]);
        assert_eq!(contour_heights(-0.2, 0.2, 0.5, 100).unwrap(), [0.0]);
        assert!(contour_heights(0.1, 0.2, 0.5, 100).unwrap().is_empty());
        assert!(contour_heights(0.0, 1.0, 1e-9, 1000).is_err());
        assert!(contour_heights(0.0, 1.0, 0.0, 1000).is_err());
        assert!(legs(&[DVec3::ZERO, DVec3::Z]).is_err());
    }
}
