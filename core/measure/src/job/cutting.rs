//! Sections, profiles, contours and distances along the surface: planes through the finest triangles.

use super::{Outcome, Subject};
use crate::drawing::world_lines;
use crate::leaves::finest;
use crate::lines::Lines;
use crate::profile::{contour_heights, legs, total_length};
use crate::refusal::Target;
use crate::saved::Task;
use crate::{
    Cutter, Dimension, Drawing, Failure, Leaves, Plane, PointTool, Read, Reading, Refusal, Remark, Section, path,
};
use glam::{DVec2, DVec3};
use serde_json::json;
use std::collections::BTreeMap;

/// Contours of more heights than these are a mistake in the interval.
const MAX_CONTOURS: usize = 10_000;

/// The section of one plane, and what was read for it.
async fn cut<L: Leaves>(s: &Subject<'_, L>, plane: Plane) -> Result<(Section, Read), Failure> {
    let space = s.space;
    let mut all = Cutter::new(space, plane);
    let box_test = all.clone();
    let read = s
        .leaves
        .sweep(
            |b| box_test.meets(b.min, b.max),
            || Cutter::new(space, plane),
            |part, chunk| finest(chunk).for_each(|t| part.add(t)),
            |part| all.join(part),
        )
        .await?;
    Ok((all.section()?, read))
}

pub(super) async fn section<L: Leaves>(s: &Subject<'_, L>, task: &Task, plane: Plane) -> Result<Outcome, Failure> {
    let (section, read) = cut(s, plane).await?;
    let u = std::f64::consts::SQRT_2 * s.point.combined();
    let mut report = Outcome::new(task.clone(), vec![Reading::new("length", Dimension::Length, section.length(), u)]);
    if let Some(area) = section.area() {
        let squares: f64 = section.polylines.iter().map(crate::Polyline::squares).sum();
        let spread = s.point.combined() * squares.sqrt();
        report.readings.push(Reading::new("area of the material", Dimension::Area, area, spread));
    }
    let open = section.polylines.iter().filter(|p| !p.closed).count();
    report.add("plane", s.plane_json(&plane));
    report.add("lines", json!(section.polylines.len()));
    report.add("open_lines", json!(open));
    report.add("triangles", json!(section.triangles));
    report.remark(Remark::Lines { lines: section.polylines.len(), open, triangles: section.triangles });
    report.has_read(read);
    let world = world_lines(&section, |p| s.space.world_from_local(p));
    report.lines = Some(Lines::new("Section", flat(s, &section, "SECTION"), world));
    Ok(report)
}

/// In the plane, counted from the world's origin, so that y of an upright section is the world's height.
fn flat<L: Leaves>(s: &Subject<'_, L>, section: &Section, layer: &str) -> Drawing {
    let origin = s.space.world_from_local(section.plane.point);
    let [u, v] = section.plane.axes();
    Drawing::of_section(section, DVec2::new(u.dot(origin), v.dot(origin)), layer)
}

/// Along a line given in local metres.
pub(super) async fn profile<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let legs = legs(&task.local)?;
    let (mut lines, mut world) = (Vec::new(), Vec::new());
    let mut read = Read::default();
    let height = s.space.world_from_local(DVec3::ZERO).z;
    for leg in &legs {
        let (section, more) = match cut(s, leg.plane()).await {
            Ok(found) => found,
            Err(Failure::Refused(Refusal::Misses { .. })) => continue,
            Err(e) => return Err(e),
        };
        read = read.and(more);
        for line in leg.straighten(&section) {
            let back = |p: &DVec2| {
                let along = p[0] - leg.start;
                let at = leg.from + leg.along * along;
                s.space.world_from_local(DVec3::new(at.x, at.y, p.y))
            };
            world.push(line.points.iter().map(back).collect());
            lines.push(line);
        }
    }
    if lines.is_empty() {
        let hint = "draw it across the model".to_owned();
        return Err(Refusal::Misses { what: Target::Profile, hint }.into());
    }
    let u = std::f64::consts::SQRT_2 * s.point.combined();
    let heights = lines.iter().flat_map(|l| &l.points).map(|p| p[1]);
    let low = heights.clone().fold(f64::INFINITY, f64::min);
    let high = heights.fold(f64::NEG_INFINITY, f64::max);
    let of = |name, value, u| Reading::new(name, Dimension::Length, value, u);
    let mut way = of("way in plan", legs.iter().map(|l| l.length).sum(), 0.0);
    // A line that was typed is exact; one between picked points is as uncertain as their distance in plan.
    if task.pointing.iter().any(|x| *x > 0.0)
        && let Some(horizontal) = s.on_points(task, PointTool::Distance)?.get(1)
    {
        way.quantity.uncertainty = horizontal.quantity.uncertainty;
        way.resolution = horizontal.resolution;
    }
    let mut report = Outcome::new(
        task.clone(),
        vec![
            way,
            of("length on the surface", total_length(&lines), u),
            of("lowest", low + height, s.point.combined()),
            of("highest", high + height, s.point.combined()),
        ],
    );
    report.add("lines", json!(lines.len()));
    report.has_read(read);
    report.lines = Some(Lines::new("Profile", Drawing::of_profile(&lines, height), world));
    Ok(report)
}

/// Lines of equal height.
pub(super) async fn contours<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let m = s.leaves.index().metadata();
    let (low, high, metres) = (m.bounds_min.z, m.bounds_max.z, task.interval.unwrap_or(0.0));
    let heights = contour_heights(low, high, metres, MAX_CONTOURS).map_err(|_| Refusal::Interval {
        metres,
        max: MAX_CONTOURS,
        low,
        high,
    })?;
    let base = s.space.world_from_local(DVec3::ZERO).z;
    let local: Vec<f64> = heights.iter().map(|h| h - base).collect();
    let space = s.space;
    let cutter = |i: usize| {
        Cutter::new(
            space,
            Plane { point: DVec3::new(0.0, 0.0, local.get(i).copied().unwrap_or(0.0)), normal: DVec3::Z },
        )
    };
    let mut all: BTreeMap<usize, Cutter> = BTreeMap::new();
    let step = s.space.step();
    let read = s
        .leaves
        .sweep(
            |_| true,
            BTreeMap::new,
            |part: &mut BTreeMap<usize, Cutter>, chunk| {
                for t in finest(chunk) {
                    let z = t.map(|p| f64::from(p[2]) * step);
                    let (low, high) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
                    let first = local.partition_point(|h| *h < low);
                    for i in (first..local.len()).take_while(|i| local[*i] <= high) {
                        part.entry(i).or_insert_with(|| cutter(i)).add(t);
                    }
                }
            },
            |part| {
                for (i, c) in part {
                    all.entry(i).or_insert_with(|| cutter(i)).join(c);
                }
            },
        )
        .await?;
    let mut sections = Vec::new();
    for (i, c) in all {
        match c.section() {
            Ok(section) => sections.push((heights[i], section)),
            Err(Refusal::Misses { .. }) => {}
            Err(e) => return Err(e.into()),
        }
    }
    if sections.is_empty() {
        let hint = format!("no multiple of {metres} m lies between {low} and {high} m");
        return Err(Refusal::Misses { what: Target::Contours, hint }.into());
    }
    let origin = s.space.world_from_local(DVec3::ZERO);
    let drawing = Drawing::of_contours(sections.iter().map(|(h, c)| (*h, c)), origin[0], origin[1]);
    let world = sections.iter().flat_map(|(_, c)| world_lines(c, |p| s.space.world_from_local(p))).collect();
    let length: f64 = sections.iter().map(|(_, c)| c.length()).sum();
    let u = std::f64::consts::SQRT_2 * s.point.combined();
    let mut report = Outcome::new(task.clone(), vec![Reading::new("length of all", Dimension::Length, length, u)]);
    report.add("heights", json!(sections.iter().map(|(h, _)| *h).collect::<Vec<f64>>()));
    report.add("lines", json!(drawing.lines.len()));
    report.remark(Remark::Heights { lines: drawing.lines.len(), heights: sections.len() });
    report.has_read(read);
    report.lines = Some(Lines::new("Contours", drawing, world));
    Ok(report)
}

/// The distance of points, and along the surface leg by leg.
pub(super) async fn along<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let mut report = Outcome::new(task.clone(), s.on_points(task, PointTool::Distance)?);
    let places = s.places(task).await?;
    let mut length = 0.0;
    for w in places.windows(2) {
        let (a, b) = (w[0], w[1]);
        let normal: DVec3 = a.normal + b.normal;
        let plane = path::tape_plane(a.local, b.local, normal)?;
        let (section, read) = cut(s, plane).await?;
        length += path::along(&section, a.local, b.local, 2.0 * s.space.step())?.length();
        report.has_read(read);
    }
    let ends = libm::sqrt((2 * places.len().saturating_sub(1)) as f64);
    let u = ends * s.per_axis(task).into_iter().fold(0.0, f64::max);
    let resolution = s.resolution(ends * s.point.combined());
    report.readings.push(Reading { resolution, ..Reading::new("along the surface", Dimension::Length, length, u) });
    Ok(report)
}
