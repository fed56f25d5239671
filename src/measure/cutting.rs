//! Sections, profiles, contours and distances along the surface: planes through the finest triangles.

use super::Subject;
use super::output::{Lines, OutputArgs};
use super::place::Place;
use super::report::Report;
use super::sweep::{Read, sweep};
use super::whole::plane_json;
use kilwa_geometry::distance::{Vec3, dot};
use kilwa_measure::drawing::world_lines;
use kilwa_measure::profile::{contour_heights, legs, total_length};
use kilwa_measure::{Cutter, Dimension, Drawing, Plane, Reading, Refusal, Section, Task, ToolName, path};
use serde_json::json;
use std::collections::BTreeMap;

/// Contours of more heights than these are a mistake in the interval.
const MAX_CONTOURS: usize = 10_000;

/// The section of one plane, and what was read for it.
fn cut(s: &Subject, plane: Plane) -> anyhow::Result<(Section, Read)> {
    let mut all = Cutter::new(s.space, plane);
    let box_test = all.clone();
    let read = sweep(
        &s.pack,
        |b| box_test.meets(b.min, b.max),
        || Cutter::new(s.space, plane),
        Cutter::add,
        |part| all.join(part),
    )?;
    Ok((all.section()?, read))
}

pub(super) fn section(s: &Subject, plane: Plane, output: &OutputArgs) -> anyhow::Result<Report> {
    let task = |tool, points| Task::on_points(tool, points, &s.space);
    output.check()?;
    let (section, read) = cut(s, plane)?;
    let u = std::f64::consts::SQRT_2 * s.point.combined();
    let mut report = Report::new(
        Task { plane: Some(plane), ..task(ToolName::Section, Vec::new()) },
        vec![Reading::new("length", Dimension::Length, section.length(), u)],
    );
    if let Some(area) = section.area() {
        let squares: f64 = section.polylines.iter().map(kilwa_measure::Polyline::squares).sum();
        let spread = s.point.combined() * squares.sqrt();
        report.reading(Reading::new("area of the material", Dimension::Area, area, spread));
    }
    let open = section.polylines.iter().filter(|p| !p.closed).count();
    report.add("plane", plane_json(s, &plane));
    report.add("lines", json!(section.polylines.len()));
    report.add("open_lines", json!(open));
    report.add("triangles", json!(section.triangles));
    report.remark(format!(
        "{} lines, {open} of them open, through {} triangles",
        section.polylines.len(),
        section.triangles
    ));
    report.read(&read);
    let lines =
        Lines { drawing: flat(s, &section, "SECTION"), world: world_lines(&section, |p| s.space.world_from_local(p)) };
    written(output, s, lines, "Section", &mut report)?;
    Ok(report)
}

/// In the plane, counted from the world's origin, so that y of an upright section is the world's height.
fn flat(s: &Subject, section: &Section, layer: &str) -> Drawing {
    let origin = s.space.world_from_local(section.plane.point);
    let [u, v] = section.plane.axes();
    Drawing::of_section(section, [dot(u, origin), dot(v, origin)], layer)
}

fn written(output: &OutputArgs, s: &Subject, lines: Lines, title: &str, report: &mut Report) -> anyhow::Result<()> {
    if let Some(path) = output.write(s, lines, title)? {
        report.add("output", json!(path.display().to_string()));
        report.remark(format!("written to {}", path.display()));
    }
    Ok(())
}

/// Along a line given in local metres.
pub(super) fn profile(s: &Subject, local: &[Vec3], output: &OutputArgs) -> anyhow::Result<Report> {
    let task = |tool, points| Task::on_points(tool, points, &s.space);
    output.check()?;
    let legs = legs(local)?;
    let (mut lines, mut world) = (Vec::new(), Vec::new());
    let mut read = Read::default();
    let height = s.space.world_from_local([0.0; 3])[2];
    for leg in &legs {
        let (section, more) = match cut(s, leg.plane()) {
            Ok(found) => found,
            Err(e) if matches!(e.downcast_ref(), Some(Refusal::Misses { .. })) => continue,
            Err(e) => return Err(e),
        };
        read = Read { chunks: read.chunks + more.chunks, bytes: read.bytes + more.bytes, ..more };
        for line in leg.straighten(&section) {
            let back = |p: &[f64; 2]| {
                let along = p[0] - leg.start;
                let at = [leg.from[0] + leg.along[0] * along, leg.from[1] + leg.along[1] * along, p[1]];
                s.space.world_from_local(at)
            };
            world.push(line.points.iter().map(back).collect());
            lines.push(line);
        }
    }
    if lines.is_empty() {
        let hint = "draw it across the model".to_owned();
        return Err(Refusal::Misses { what: "the line of the profile", hint }.into());
    }
    let u = std::f64::consts::SQRT_2 * s.point.combined();
    let way: f64 = legs.iter().map(|l| l.length).sum();
    let heights = lines.iter().flat_map(|l| &l.points).map(|p| p[1]);
    let low = heights.clone().fold(f64::INFINITY, f64::min);
    let high = heights.fold(f64::NEG_INFINITY, f64::max);
    let of = |name, value, u| Reading::new(name, Dimension::Length, value, u);
    let mut report = Report::new(
        task(ToolName::Profile, local.to_vec()),
        vec![
            of("way in plan", way, 0.0),
            of("length on the surface", total_length(&lines), u),
            of("lowest", low + height, s.point.combined()),
            of("highest", high + height, s.point.combined()),
        ],
    );
    report.add("lines", json!(lines.len()));
    report.read(&read);
    let drawing = Drawing::of_profile(&lines, height);
    written(output, s, Lines { drawing, world }, "Profile", &mut report)?;
    Ok(report)
}

pub(super) fn contours(s: &Subject, interval: f64, output: &OutputArgs) -> anyhow::Result<Report> {
    let task = |tool, points| Task::on_points(tool, points, &s.space);
    output.check()?;
    let m = s.pack.metadata();
    let heights = contour_heights(m.bounds_min[2], m.bounds_max[2], interval, MAX_CONTOURS).map_err(|_| {
        anyhow::anyhow!(
            "an interval of {interval} m is not possible: it must be positive and give at most {MAX_CONTOURS} contours \
             between {} and {} m",
            m.bounds_min[2],
            m.bounds_max[2]
        )
    })?;
    let base = s.space.world_from_local([0.0; 3])[2];
    let local: Vec<f64> = heights.iter().map(|h| h - base).collect();
    let cutter = |i: usize| {
        Cutter::new(s.space, Plane { point: [0.0, 0.0, local.get(i).copied().unwrap_or(0.0)], normal: [0.0, 0.0, 1.0] })
    };
    let mut all: BTreeMap<usize, Cutter> = BTreeMap::new();
    let step = s.space.step();
    let read = sweep(
        &s.pack,
        |_| true,
        BTreeMap::new,
        |part: &mut BTreeMap<usize, Cutter>, t| {
            let z = t.map(|p| f64::from(p[2]) * step);
            let (low, high) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
            let first = local.partition_point(|h| *h < low);
            for i in (first..local.len()).take_while(|i| local[*i] <= high) {
                part.entry(i).or_insert_with(|| cutter(i)).add(t);
            }
        },
        |part| {
            for (i, c) in part {
                all.entry(i).or_insert_with(|| cutter(i)).join(c);
            }
        },
    )?;
    let mut sections = Vec::new();
    for (i, c) in all {
        match c.section() {
            Ok(section) => sections.push((heights[i], section)),
            Err(Refusal::Misses { .. }) => {}
            Err(e) => return Err(e.into()),
        }
    }
    if sections.is_empty() {
        let hint = format!("no multiple of {interval} m lies between {} and {} m", m.bounds_min[2], m.bounds_max[2]);
        return Err(Refusal::Misses { what: "the contours", hint }.into());
    }
    let origin = s.space.world_from_local([0.0; 3]);
    let drawing = Drawing::of_contours(sections.iter().map(|(h, c)| (*h, c)), origin[0], origin[1]);
    let world = sections.iter().flat_map(|(_, c)| world_lines(c, |p| s.space.world_from_local(p))).collect();
    let length: f64 = sections.iter().map(|(_, c)| c.length()).sum();
    let u = std::f64::consts::SQRT_2 * s.point.combined();
    let mut report = Report::new(
        Task { interval: Some(interval), ..task(ToolName::Contours, Vec::new()) },
        vec![Reading::new("length of all", Dimension::Length, length, u)],
    );
    report.add("heights", json!(sections.iter().map(|(h, _)| *h).collect::<Vec<f64>>()));
    report.add("lines", json!(drawing.lines.len()));
    report.remark(format!("{} lines at {} heights", drawing.lines.len(), sections.len()));
    report.read(&read);
    written(output, s, Lines { drawing, world }, "Contours", &mut report)?;
    Ok(report)
}

/// The distance along the surface, leg by leg, added to a report.
pub(super) fn along(s: &Subject, places: &[Place], report: &mut Report) -> anyhow::Result<()> {
    let mut length = 0.0;
    for w in places.windows(2) {
        let (a, b) = (w[0], w[1]);
        let normal: Vec3 = std::array::from_fn(|i| a.normal[i] + b.normal[i]);
        let plane = path::tape_plane(a.local, b.local, normal)?;
        let (section, read) = cut(s, plane)?;
        length += path::along(&section, a.local, b.local, 2.0 * s.space.step())?.length();
        report.read(&read);
    }
    let u = ((2 * places.len().saturating_sub(1)) as f64).sqrt() * s.point.combined();
    report.reading(Reading::new("along the surface", Dimension::Length, length, u));
    Ok(())
}
