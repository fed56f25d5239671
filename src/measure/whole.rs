//! Sums over the surface: areas, volumes, deviation from a plane; of all of it or of what lies inside a polygon.

use super::Subject;
use super::place::Place;
use super::report::Report;
use super::sweep::sweep;
use kilwa_geometry::distance::{Vec3, dot, sub};
use kilwa_geometry::{Aabb, LatticePoint};
use kilwa_measure::{
    Areas, CutFill, Deviation, Dimension, Enclosed, Plane, PointTool, Reading, Refusal, Region, Task, ToolName,
};
use serde_json::json;

/// The whole surface.
pub(super) fn area(s: &Subject) -> anyhow::Result<Report> {
    let mut sum = Areas::default();
    let space = s.space;
    let read = sweep(
        &s.pack,
        |_| true,
        Areas::default,
        |a, t| a.add(t.map(|p| space.local_from_lattice(p))),
        |part| sum.join(&part),
    )?;
    let u = sum.spread().map(|x| x * s.point.combined());
    let readings = vec![
        Reading::new("surface", Dimension::Area, sum.surface(), u[0]),
        Reading::new("plan", Dimension::Area, sum.plan(), u[1]),
    ];
    let mut report = Report::new(Task::on_points(ToolName::Area, Vec::new(), &s.space), readings);
    report.add("triangles", json!(sum.triangles()));
    report.read(&read);
    Ok(report)
}

/// A polygon: in its plane, in plan, and the surface inside.
pub(super) fn polygon_area(s: &Subject, places: &[Place], reach: Option<f64>) -> anyhow::Result<Report> {
    let corners: Vec<Vec3> = places.iter().map(|p| p.local).collect();
    let task = Task { reach, ..Task::on_points(ToolName::Area, corners.clone(), &s.space) };
    let mut report = Report::new(task, PointTool::PolygonArea.measure(&corners, &s.space, &s.point)?);
    let fit = Plane::fit(&corners)?;
    let wide = extent(&corners);
    let reach = checked(reach)?.unwrap_or_else(|| (2.0 * fit.largest).max(0.05 * wide).max(10.0 * s.space.step()));
    let region = Region::new(facing(fit.plane, places), &corners, reach)?;
    let mut sum = Areas::default();
    let read = sweep(
        &s.pack,
        |b| meets(s, &region, b),
        Areas::default,
        |a, t| a.add_clipped(t.map(|p| s.space.local_from_lattice(p)), &region),
        |part| sum.join(&part),
    )?;
    if sum.triangles() == 0 {
        let hint = format!("no surface lies within {reach} m of its plane; see --reach");
        return Err(Refusal::Misses { what: "the polygon", hint }.into());
    }
    let u = sum.spread()[0] * s.point.combined();
    report.reading(Reading::new("surface", Dimension::Area, sum.surface(), u));
    report.add("points", json!(places));
    report.add("reach", json!(reach));
    report.add("triangles", json!(sum.triangles()));
    report.remark(format!("the surface counts within {reach:.3} m of the polygon's plane"));
    report.read(&read);
    Ok(report)
}

/// The volume of a closed surface.
pub(super) fn volume(s: &Subject) -> anyhow::Result<Report> {
    let borders = s.pack.metadata().border_edges;
    if borders > 0 {
        return Err(Refusal::Open { borders }.into());
    }
    let (low, high) = s.bounds();
    let centre: Vec3 = std::array::from_fn(|i| f64::midpoint(low[i], high[i]));
    let mut sum = Enclosed::new(centre);
    let read = sweep(
        &s.pack,
        |_| true,
        || Enclosed::new(centre),
        |v, t| v.add(t.map(|p| s.space.local_from_lattice(p))),
        |part| sum.join(&part),
    )?;
    let volume = sum.volume(borders)?;
    let u = sum.spread() * s.point.combined();
    let mut report = Report::new(
        Task::on_points(ToolName::Volume, Vec::new(), &s.space),
        vec![Reading::new("volume", Dimension::Volume, volume, u)],
    );
    if volume < 0.0 {
        report.remark("the volume is negative: the surface is inside out".to_owned());
    }
    report.add("area", json!(sum.area()));
    report.read(&read);
    Ok(report)
}

/// Cut and fill of the surface inside a polygon.
pub(super) fn cut_fill(
    s: &Subject,
    places: &[Place],
    against: Option<Plane>,
    reach: Option<f64>,
) -> anyhow::Result<Report> {
    let corners: Vec<Vec3> = places.iter().map(|p| p.local).collect();
    let task = Task { reach, plane: against, ..Task::on_points(ToolName::CutFill, corners.clone(), &s.space) };
    let (region, fitted) = region(places, against, reach, |corners, _| extent(corners))?;
    let mut sum = CutFill::default();
    let read = sweep(
        &s.pack,
        |b| meets(s, &region, b),
        CutFill::default,
        |v, t| v.add(t.map(|p| s.space.local_from_lattice(p)), &region),
        |part| sum.join(&part),
    )?;
    let v = sum.volumes(&region)?;
    let u = sum.spread(if fitted { places.len() } else { 0 }) * s.point.combined();
    let of = |name, value| Reading::new(name, Dimension::Volume, value, u);
    let mut report = if v.is_body() {
        let mut report = Report::new(task, vec![of("above the plane", v.cut), of("below the plane", -v.fill)]);
        report.remark("a closed body without ground: nothing is to be filled".to_owned());
        report
    } else {
        Report::new(task, vec![of("cut", v.cut), of("fill", v.fill), of("net", v.net)])
    };
    let of_base = PointTool::PolygonArea.measure(&corners, &s.space, &s.point)?;
    let base = of_base.first().map_or(0.0, |r| r.quantity.uncertainty);
    report.reading(Reading::new("base", Dimension::Area, region.area(), base));
    report.add("points", json!(places));
    report.add("plane", plane_json(s, region.plane()));
    report.add("reach", json!(region.reach()));
    report.add("covered", json!(v.covered));
    report.remark(format!(
        "the surface counts within {:.3} m of the plane and covers {:.1} % of the polygon",
        region.reach(),
        100.0 * v.covered
    ));
    if v.covered < 0.99 && !v.is_body() {
        report.remark("where it has holes nothing is cut or filled".to_owned());
    }
    report.read(&read);
    Ok(report)
}

/// Distances of the surface from a plane.
pub(super) fn deviation(
    s: &Subject,
    places: &[Place],
    from: Option<Plane>,
    reach: Option<f64>,
) -> anyhow::Result<Report> {
    let corners: Vec<Vec3> = places.iter().map(|p| p.local).collect();
    let task = Task { reach, plane: from, ..Task::on_points(ToolName::Deviation, corners, &s.space) };
    let mut areas = Areas::default();
    let (figures, plane, read) = if places.is_empty() {
        let plane =
            from.ok_or_else(|| anyhow::anyhow!("from which plane? Give --plane, --x, --y or --z, or a polygon"))?;
        anyhow::ensure!(reach.is_none(), "--reach belongs to a polygon; give its corners");
        let (low, high) = s.bounds();
        let range = extent(&[low, high]);
        let mut sum = Deviation::new(range);
        let add = |d: &mut (Deviation, Areas), t: [LatticePoint; 3]| {
            let triangle = t.map(|p| s.space.local_from_lattice(p));
            d.0.add(triangle, &plane);
            d.1.add(triangle);
        };
        let empty = || (Deviation::new(range), Areas::default());
        let read = sweep(
            &s.pack,
            |_| true,
            empty,
            add,
            |(d, a)| {
                sum.join(&d);
                areas.join(&a);
            },
        )?;
        (sum.figures()?, plane, read)
    } else {
        let near = |corners: &[Vec3], largest: f64| (2.0 * largest).max(0.05 * extent(corners));
        let (region, _) = region(places, from, reach, near)?;
        let range = region.reach();
        let mut sum = Deviation::new(range);
        let add = |d: &mut (Deviation, Areas), t: [LatticePoint; 3]| {
            let triangle = t.map(|p| s.space.local_from_lattice(p));
            d.0.add_clipped(triangle, &region);
            d.1.add_clipped(triangle, &region);
        };
        let empty = || (Deviation::new(range), Areas::default());
        let read = sweep(
            &s.pack,
            |b| meets(s, &region, b),
            empty,
            add,
            |(d, a)| {
                sum.join(&d);
                areas.join(&a);
            },
        )?;
        (sum.figures()?, *region.plane(), read)
    };
    let u = s.point.combined();
    let of = |name, value| Reading::new(name, Dimension::Length, value, u);
    let mut report = Report::new(
        task,
        vec![
            of("mean", figures.mean),
            of("root mean square", figures.rms),
            of("standard deviation", figures.deviation),
            of("lowest", figures.lowest),
            of("highest", figures.highest),
        ],
    );
    report.reading(Reading::new("area", Dimension::Area, figures.area, areas.spread()[0] * u));
    report.add("plane", plane_json(s, &plane));
    report.add("histogram", json!({ "range": figures.range, "shares": figures.histogram }));
    report.read(&read);
    Ok(report)
}

/// The region round places: in the plane given, or in the one fitted to them (then `true`).
fn region(
    places: &[Place],
    plane: Option<Plane>,
    reach: Option<f64>,
    default_reach: impl Fn(&[Vec3], f64) -> f64,
) -> anyhow::Result<(Region, bool)> {
    let corners: Vec<Vec3> = places.iter().map(|p| p.local).collect();
    let fitted = plane.is_none();
    let (plane, largest) = if let Some(plane) = plane {
        (plane, corners.iter().map(|p| plane.distance(*p).abs()).fold(0.0, f64::max))
    } else {
        let fit = Plane::fit(&corners)?;
        (facing(fit.plane, places), fit.largest)
    };
    let reach = checked(reach)?.unwrap_or_else(|| default_reach(&corners, largest));
    Ok((Region::new(plane, &corners, reach)?, fitted))
}

/// The plane with its normal towards the side that the surface faces at the places.
fn facing(plane: Plane, places: &[Place]) -> Plane {
    let towards: f64 = places.iter().map(|p| dot(p.normal, plane.normal)).sum();
    let normal = if towards < 0.0 { plane.normal.map(|x| -x) } else { plane.normal };
    Plane { point: plane.point, normal }
}

fn checked(reach: Option<f64>) -> anyhow::Result<Option<f64>> {
    anyhow::ensure!(reach.is_none_or(|r| r.is_finite() && r > 0.0), "--reach must be a positive length in metres");
    Ok(reach)
}

fn extent(points: &[Vec3]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    points.iter().map(|p| dot(sub(*p, *first), sub(*p, *first)).sqrt()).fold(0.0, f64::max)
}

fn meets(s: &Subject, region: &Region, b: &Aabb) -> bool {
    region.meets(s.space.local_from_lattice(b.min), s.space.local_from_lattice(b.max))
}

/// A plane in world coordinates.
pub(super) fn plane_json(s: &Subject, plane: &Plane) -> serde_json::Value {
    json!({ "point": s.space.world_from_local(plane.point), "normal": plane.normal })
}
