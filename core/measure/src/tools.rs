//! The tools that need points only: one function for the page and for the command line, so that both print the same digits.
//!
//! Points are local metres ([`crate::space`]), picked on the finest surface. Failures are [`Refusal`]s, sentences for people.

use crate::angle;
use crate::area::PolygonArea;
use crate::circle::Circle;
use crate::path;
use crate::plane::Plane;
use crate::polygon::signed_area;
use crate::quantity::propagate;
use crate::refusal::{Refusal, at_least};
use crate::space::Space;
use crate::unit::{Dimension, Reading};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A tool on points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PointTool {
    /// Where a point is: x, y, z in world coordinates.
    Coordinate,
    /// From the first point to the last by way of the others.
    Distance,
    /// The same, back to the first.
    Perimeter,
    /// At the second of three points.
    Angle,
    /// Between the plane of the first half of the points and that of the second half.
    PlaneAngle,
    /// Of the last point above the plane fitted to all others.
    Height,
    /// Of the polygon through the points.
    PolygonArea,
    /// The circle fitted to the points.
    Circle,
}

impl PointTool {
    /// What the points give. `per_axis` is the standard uncertainty of each point, metres, on each axis ([`crate::Uncertainty::of_points`]).
    ///
    /// # Errors
    /// [`Refusal`] where they mean nothing.
    pub fn measure(self, points: &[DVec3], space: &Space, per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
        match self {
            Self::Coordinate => coordinate(points, space, per_axis),
            Self::Distance => distance(points, false, per_axis),
            Self::Perimeter => distance(points, true, per_axis),
            Self::Angle => corner(points, per_axis),
            Self::PlaneAngle => planes(points, per_axis),
            Self::Height => height(points, per_axis),
            Self::PolygonArea => polygon(points, per_axis),
            Self::Circle => circle(points, per_axis),
        }
    }
}

/// That of the least certain point.
fn largest(per_axis: &[f64]) -> f64 {
    per_axis.iter().copied().fold(0.0, f64::max)
}

/// Readings from values and their uncertainties, propagated from the points.
fn readings<const N: usize>(
    names: [(&str, Dimension); N],
    points: &[DVec3],
    per_axis: &[f64],
    f: impl Fn(&[DVec3]) -> Result<[f64; N], Refusal>,
) -> Result<Vec<Reading>, Refusal> {
    let values = f(points)?;
    let spread = propagate(points, per_axis, |p| f(p).ok());
    let each = names.into_iter().zip(values.into_iter().zip(spread));
    Ok(each.map(|((name, dimension), (value, u))| Reading::new(name, dimension, value, u)).collect())
}

fn coordinate(points: &[DVec3], space: &Space, per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    at_least("a coordinate", 1, points)?;
    let world = space.world_from_local(points[0]);
    let each = ["x", "y", "z"].into_iter().zip(world.to_array());
    Ok(each.map(|(name, x)| Reading::new(name, Dimension::Length, x, largest(per_axis))).collect())
}

fn distance(points: &[DVec3], closed: bool, per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    use Dimension::Length;
    if closed {
        let names = [("perimeter", Length), ("horizontal", Length)];
        return readings(names, points, per_axis, |p| path::length(p, true).map(|l| [l.straight, l.horizontal]));
    }
    let names = [("straight", Length), ("horizontal", Length), ("vertical", Length)];
    let mut all =
        readings(names, points, per_axis, |p| path::length(p, false).map(|l| [l.straight, l.horizontal, l.vertical]))?;
    if points.len() > 2 {
        all.extend(readings([("ends", Length)], points, per_axis, |p| path::length(p, false).map(|l| [l.ends]))?);
    }
    // At a distance of nothing no direction is special: it is as uncertain as a difference along one.
    for r in all.iter_mut().filter(|r| r.quantity.value == 0.0) {
        r.quantity.uncertainty = std::f64::consts::SQRT_2 * largest(per_axis);
    }
    Ok(all)
}

fn corner(points: &[DVec3], per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    at_least("an angle", 3, points)?;
    readings([("angle", Dimension::Angle)], &points[..3], per_axis, |p| Ok([angle::at_corner([p[0], p[1], p[2]])?]))
}

fn planes(points: &[DVec3], per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    at_least("an angle between planes", 6, points)?;
    let half = points.len() / 2;
    let names = [("angle", Dimension::Angle), ("first slope", Dimension::Angle), ("second slope", Dimension::Angle)];
    readings(names, points, per_axis, |p| {
        let (a, b) = (Plane::fit(&p[..half])?.plane, Plane::fit(&p[half..])?.plane);
        Ok([angle::between_planes(&a, &b), angle::slope(&a), angle::slope(&b)])
    })
}

fn height(points: &[DVec3], per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    at_least("a height above a plane", 4, points)?;
    let above = |p: &[DVec3]| {
        let (last, rest) = p.split_last().ok_or(Refusal::NotFinite)?;
        let plane = Plane::fit(rest)?.plane;
        Ok::<_, Refusal>((plane.distance(*last), plane.normal))
    };
    // The normal of an upright plane has no clear sign: the smallest change of a point may reverse it.
    let (_, towards) = above(points)?;
    readings([("height", Dimension::Length)], points, per_axis, |p| {
        let (height, normal) = above(p)?;
        Ok([if normal.dot(towards) < 0.0 { -height } else { height }])
    })
}

fn polygon(points: &[DVec3], per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    use Dimension::{Area, Length};
    let names = [("fitted plane", Area), ("plan", Area), ("perimeter", Length)];
    // The sign of the plan area lets it vary through zero: an upright polygon has none, and is uncertain all the same.
    let signed = |p: &[DVec3]| signed_area(&p.iter().map(|q| (*q - p[0]).truncate()).collect::<Vec<_>>());
    let mut all =
        readings(names, points, per_axis, |p| PolygonArea::of(p).map(|a| [a.fitted, signed(p), a.perimeter]))?;
    all[1].quantity.value = all[1].quantity.value.abs();
    let fit = Plane::fit(points)?;
    all.push(Reading::new("out of plane", Length, fit.largest, largest(per_axis)));
    Ok(all)
}

fn circle(points: &[DVec3], per_axis: &[f64]) -> Result<Vec<Reading>, Refusal> {
    let c = Circle::fit(points)?;
    // The scatter of the points is used if it is larger than the known uncertainty of each point.
    let free = points.len().saturating_sub(3);
    let scatter = if free > 0 { c.rms * libm::sqrt(points.len() as f64 / free as f64) } else { 0.0 };
    let u = c.spread * largest(per_axis).max(scatter);
    let residual = libm::sqrt(c.rms * c.rms + c.plane.rms * c.plane.rms);
    let length = |name, value, u| Reading::new(name, Dimension::Length, value, u);
    let turn = std::f64::consts::TAU;
    Ok(vec![
        length("radius", c.radius, u),
        length("diameter", 2.0 * c.radius, 2.0 * u),
        length("circumference", turn * c.radius, turn * u),
        length("residual", residual, largest(per_axis)),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Uncertainty;
    use kilwa_geometry::Lattice;
    use kilwa_geometry::LengthUnit;

    fn space() -> Space {
        Space::new(Lattice { origin: DVec3::new(500_000.0, 4_649_776.0, 123.0), step_log2: -10 })
    }

    fn read(tool: PointTool, points: &[DVec3]) -> Vec<String> {
        read_picked(tool, points, &[])
    }

    fn read_picked(tool: PointTool, points: &[DVec3], pointing: &[f64]) -> Vec<String> {
        let u = Uncertainty::finest(space().step(), Some(0.002)).of_points(pointing, points.len());
        let all = tool.measure(points, &space(), &u).unwrap();
        all.iter().map(|r| format!("{} {}", r.name, r.text(LengthUnit::Metre))).collect()
    }

    #[test]
    fn every_tool_reports_values_with_uncertainty() {
        let wall = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(4.0, 0.0, 3.0), DVec3::new(0.0, 0.0, 3.0)];
        assert_eq!(read(PointTool::Coordinate, &wall[1..2])[0], "x 500004.0000 ± 0.0020 m");
        assert_eq!(read(PointTool::Distance, &[wall[0], wall[2]])[0], "straight 5.0000 ± 0.0029 m");
        assert_eq!(read(PointTool::Distance, &wall[..3])[3], "ends 5.0000 ± 0.0029 m");
        assert_eq!(read(PointTool::Perimeter, &wall)[0], "perimeter 14.0000 ± 0.0057 m");
        assert_eq!(read(PointTool::PolygonArea, &wall)[0], "fitted plane 12.000 ± 0.010 m²");
        let plan = &PointTool::PolygonArea
            .measure(&wall, &space(), &Uncertainty::finest(0.001, Some(0.002)).of_points(&[], 4))
            .unwrap()[1];
        assert!(plan.quantity.value < 1e-12 && plan.quantity.uncertainty > 0.002, "{plan:?}");
        assert_eq!(read(PointTool::Angle, &wall[..3])[0].split(' ').nth(1), Some("90.000"));
        let u = Uncertainty::finest(space().step(), None).of_points(&[], 2);
        let none = PointTool::Distance.measure(&[wall[0], wall[0]], &space(), &u).unwrap();
        assert!(none[0].quantity.value == 0.0 && none[0].quantity.uncertainty > 0.0);
        let up = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.3, 0.3, 2.5)];
        assert!(read(PointTool::Height, &up)[0].starts_with("height 2.500"));
        // Above an upright plane it is no less certain than above a level one.
        let niche = |y: f64| {
            PointTool::Height.measure(&[wall[0], wall[1], wall[2], DVec3::new(3.0, y, 1.0)], &space(), &[0.002; 4])
        };
        for y in [0.25, -0.25] {
            let depth = &niche(y).unwrap()[0].quantity;
            assert!(
                (depth.value.abs() - 0.25).abs() < 1e-12 && (0.002..0.004).contains(&depth.uncertainty),
                "{depth:?}"
            );
        }
        let turned: Vec<DVec3> = wall[..3].iter().chain(&up[..3]).copied().collect();
        // The angle of two planes has a kink at 90°, where it is no more certain than beside it; so has a slope at 0°.
        let planes = read(PointTool::PlaneAngle, &turned);
        // The level triangle is 1 m wide and the upright one 3 m high: the square root of two times 2 mm over each is 0.17°.
        assert_eq!(planes[0], "angle 90.00 ± 0.17 °");
        assert!(planes[2].starts_with("second slope 0.00 ± 0."), "{planes:?}");
        let ring = [DVec3::X, DVec3::Y, DVec3::new(-1.0, 0.0, 0.0), DVec3::new(0.0, -1.0, 0.0)];
        assert!(read(PointTool::Circle, &ring)[1].starts_with("diameter 2.000"));
    }

    #[test]
    fn a_picked_point_is_as_uncertain_as_its_pixel_is_wide() {
        let (a, b) = (DVec3::ZERO, DVec3::new(3.0, 0.0, 4.0));
        assert_eq!(read(PointTool::Distance, &[a, b])[0], "straight 5.0000 ± 0.0029 m");
        assert_eq!(read_picked(PointTool::Distance, &[a, b], &[0.052, 0.0])[0], "straight 5.000 ± 0.052 m");
        assert_eq!(read_picked(PointTool::Distance, &[a, b], &[0.052, 0.052])[0], "straight 5.000 ± 0.074 m");
        assert_eq!(read_picked(PointTool::Coordinate, &[b], &[0.052])[2], "z 127.000 ± 0.052 m");
        assert_eq!(read_picked(PointTool::Distance, &[a, a], &[0.0, 0.052])[0], "straight 0.000 ± 0.074 m");
    }

    #[test]
    fn degenerate_points_are_refused_with_a_message() {
        let u = Uncertainty::finest(space().step(), None).of_points(&[], 4);
        let line = [DVec3::ZERO, DVec3::new(1.0, 1.0, 1.0), DVec3::new(2.0, 2.0, 2.0), DVec3::new(3.0, 3.0, 3.0)];
        let say = |tool: PointTool, points: &[DVec3]| tool.measure(points, &space(), &u).unwrap_err().to_string();
        assert!(say(PointTool::Circle, &line).contains("lie on one line"));
        assert!(say(PointTool::PolygonArea, &line).contains("lie on one line"));
        assert!(say(PointTool::Distance, &line[..1]).contains("at least 2 points; 1 is given"));
        assert!(say(PointTool::Angle, &[line[0], line[0], line[1]]).contains("same place"));
        assert!(say(PointTool::Coordinate, &[DVec3::new(f64::NAN, 0.0, 0.0)]).contains("finite"));
        let bow = [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::X, DVec3::Y];
        assert!(say(PointTool::PolygonArea, &bow).contains("cross"));
    }
}
