//! Sums over the surface: areas, volumes, deviation from a plane; of all of it or of what lies inside a polygon.

use super::{Outcome, Subject, sound};
use crate::leaves::finest;
use crate::place::Place;
use crate::refusal::Target;
use crate::saved::Task;
use crate::{
    Areas, CutFill, Deviation, Dimension, Enclosed, Failure, Leaves, Plane, PointTool, Read, Reading, Refusal, Region,
    Remark, Space,
};
use glam::DVec3;
use kilwa_geometry::Aabb;
use kilwa_pack::Chunk;
use serde_json::json;

/// The share of an area that roughness must add before a remark says so.
const NOTABLE: f64 = 0.001;

/// The whole surface.
pub(super) async fn area<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let space = s.space;
    let add = |sum: &mut Areas, chunk: &Chunk| sum.add_chunk(chunk, &space, None);
    let (sum, read) = sum_of(s, &|_| true, &Areas::default, &add, Areas::join).await?;
    let u = sum.spread().map(|x| x * s.point.combined());
    let mut report = Outcome::new(task.clone(), Vec::new());
    rough_surface(s, &mut report, &sum, 0.0);
    report.readings.push(Reading::new("plan", Dimension::Area, sum.plan(), u[1]));
    report.add("triangles", json!(sum.triangles()));
    report.has_read(read);
    Ok(report)
}

/// Report an area along the surface, at which spacing it holds, and how much of it may be noise. `outline` is the part of its uncertainty due to pointing.
fn rough_surface<L: Leaves>(s: &Subject<'_, L>, report: &mut Outcome, sum: &Areas, outline: f64) {
    let added = sum.added_by_roughness();
    let points = sum.spread()[0] * s.point.combined();
    let own = with_part(points, outline);
    // Digits follow from the points; the roughness does not grow with the spacing.
    let surface = with_parts(s, ("surface", Dimension::Area, sum.surface()), points, with_part(outline, added));
    report.readings.push(surface);
    report.add("spacing", json!(sum.spacing()));
    report.add("roughness", json!({ "deviation": sum.roughness(), "adds": added }));
    report.remark(Remark::Spacing { spacing: sum.spacing() });
    if added > own.max(NOTABLE * sum.surface()) {
        report.remark(Remark::Rough { deviation: sum.roughness(), share: added / sum.surface() });
    }
}

/// A polygon: in its plane, in plan, and the surface inside.
pub(super) async fn polygon_area<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let corners = &task.local;
    let mut report = Outcome::new(task.clone(), s.on_points(task, PointTool::PolygonArea)?);
    let places = s.places(task).await?;
    let fit = Plane::fit(corners)?;
    let wide = extent(corners);
    let reach = checked(task.reach)?.unwrap_or_else(|| (2.0 * fit.largest).max(0.05 * wide).max(10.0 * s.space.step()));
    let region = Region::new(facing(fit.plane, &places), corners, reach)?;
    let space = s.space;
    let add = |sum: &mut Areas, chunk: &Chunk| sum.add_chunk(chunk, &space, Some(&region));
    let (sum, read) = sum_of(s, &|b| meets(s, &region, b), &Areas::default, &add, Areas::join).await?;
    if sum.triangles() == 0 {
        let hint = format!("no surface lies within {reach} m of its plane: give a longer reach");
        return Err(Refusal::Misses { what: Target::Polygon, hint }.into());
    }
    rough_surface(s, &mut report, &sum, sum.surface() * outline(s, task)?);
    report.add("points", json!(places));
    report.add("reach", json!(reach));
    report.add("triangles", json!(sum.triangles()));
    report.remark(Remark::Reach { reach });
    report.has_read(read);
    Ok(report)
}

/// The volume of a closed surface.
pub(super) async fn volume<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let borders = s.leaves.index().metadata().border_edges;
    if borders > 0 {
        return Err(Refusal::Open { borders }.into());
    }
    let (low, high) = s.bounds();
    // glam's midpoint adds first, which overflows where this does not.
    let centre = DVec3::from([0, 1, 2].map(|k| f64::midpoint(low[k], high[k])));
    let add = each(s.space, Enclosed::add);
    let (sum, read) = sum_of(s, &|_| true, &|| Enclosed::new(centre), &add, Enclosed::join).await?;
    let volume = sum.volume(borders)?;
    let u = sum.spread() * s.point.combined();
    let mut report = Outcome::new(task.clone(), vec![Reading::new("volume", Dimension::Volume, volume, u)]);
    if volume < 0.0 {
        report.remark(Remark::InsideOut);
    }
    report.add("area", json!(sum.area()));
    report.has_read(read);
    Ok(report)
}

/// Cut and fill of the surface inside a polygon.
pub(super) async fn cut_fill<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let places = s.places(task).await?;
    let (region, fitted) = region(&places, task.plane, task.reach, |corners, _| extent(corners))?;
    let add = each(s.space, |v: &mut CutFill, t| v.add(t, &region));
    let (sum, read) = sum_of(s, &|b| meets(s, &region, b), &CutFill::default, &add, CutFill::join).await?;
    let v = sum.volumes(&region)?;
    let own = sum.spread(if fitted { places.len() } else { 0 }) * s.point.combined();
    let outline = (v.cut.abs() + v.fill.abs()) * outline(s, task)?;
    let of = |name, value| with_parts(s, (name, Dimension::Volume, value), own, outline);
    let mut report = if v.is_body() {
        let mut report = Outcome::new(task.clone(), vec![of("above the plane", v.cut), of("below the plane", -v.fill)]);
        report.remark(Remark::Body);
        report
    } else {
        Outcome::new(task.clone(), vec![of("cut", v.cut), of("fill", v.fill), of("net", v.net)])
    };
    let mut base = s.on_points(task, PointTool::PolygonArea)?.swap_remove(0);
    (base.name, base.quantity.value) = ("base".to_owned(), region.area());
    report.readings.push(base);
    report.add("points", json!(places));
    report.add("plane", s.plane_json(region.plane()));
    report.add("reach", json!(region.reach()));
    report.add("covered", json!(v.covered));
    report.remark(Remark::Covered { reach: region.reach(), covered: v.covered });
    if v.covered < 0.99 && !v.is_body() {
        report.remark(Remark::Holes);
    }
    report.has_read(read);
    Ok(report)
}

/// Distances of the surface from a plane.
pub(super) async fn deviation<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let places = s.places(task).await?;
    let from = task.plane.map(sound).transpose()?;
    let join = |sum: &mut (Deviation, Areas), part: &(Deviation, Areas)| {
        sum.0.join(&part.0);
        sum.1.join(&part.1);
    };
    let (figures, areas, plane, read) = if places.is_empty() {
        let plane = from.ok_or(Refusal::NoPlane { tool: "a deviation without a polygon" })?;
        let (low, high) = s.bounds();
        let range = extent(&[low, high]);
        let add = each(s.space, |sum: &mut (Deviation, Areas), t| {
            sum.0.add(t, &plane);
            sum.1.add(t);
        });
        let empty = || (Deviation::new(range), Areas::default());
        let ((sum, areas), read) = sum_of(s, &|_| true, &empty, &add, join).await?;
        (sum.figures()?, areas, plane, read)
    } else {
        let near = |corners: &[DVec3], largest: f64| (2.0 * largest).max(0.05 * extent(corners));
        let (region, _) = region(&places, from, task.reach, near)?;
        let range = region.reach();
        let add = each(s.space, |sum: &mut (Deviation, Areas), t| {
            sum.0.add_clipped(t, &region);
            sum.1.add_clipped(t, &region);
        });
        let empty = || (Deviation::new(range), Areas::default());
        let ((sum, areas), read) = sum_of(s, &|b| meets(s, &region, b), &empty, &add, join).await?;
        (sum.figures()?, areas, *region.plane(), read)
    };
    let u = s.point.combined();
    let of = |name, value| Reading::new(name, Dimension::Length, value, u);
    let mut report = Outcome::new(
        task.clone(),
        vec![
            of("mean", figures.mean),
            of("root mean square", figures.rms),
            of("standard deviation", figures.deviation),
            of("lowest", figures.lowest),
            of("highest", figures.highest),
        ],
    );
    let outline = if task.local.is_empty() { 0.0 } else { outline(s, task)? };
    let points = areas.spread()[0] * u;
    report.readings.push(with_parts(s, ("area", Dimension::Area, figures.area), points, figures.area * outline));
    report.add("plane", s.plane_json(&plane));
    report.add("histogram", json!({ "range": figures.range, "shares": figures.histogram }));
    report.has_read(read);
    Ok(report)
}

/// The sum over the finest surface of the chunks whose box passes `meets`, and the data read for it. Closures by reference: the module of the page has
/// one sweep for each kind of sum, not for each call.
async fn sum_of<L: Leaves, A: Send>(
    s: &Subject<'_, L>,
    meets: &dyn Fn(&Aabb) -> bool,
    empty: &(dyn Fn() -> A + Sync),
    add: &(dyn Fn(&mut A, &Chunk) + Sync),
    join: fn(&mut A, &A),
) -> Result<(A, Read), Failure> {
    let mut sum = empty();
    let read = s.leaves.sweep(meets, empty, add, |part| join(&mut sum, &part)).await?;
    Ok((sum, read))
}

/// Add every finest triangle of a chunk by itself, in metres from the local origin.
fn each<A>(space: Space, add: impl Fn(&mut A, [DVec3; 3]) + Sync) -> impl Fn(&mut A, &Chunk) + Sync {
    move |sum, chunk| finest(chunk).for_each(|t| add(sum, t.map(|p| space.local_from_lattice(p))))
}

/// The region round places: in the plane given, or in the one fitted to them (then `true`).
fn region(
    places: &[Place],
    plane: Option<Plane>,
    reach: Option<f64>,
    default_reach: impl Fn(&[DVec3], f64) -> f64,
) -> Result<(Region, bool), Refusal> {
    let corners: Vec<DVec3> = places.iter().map(|p| p.local).collect();
    let fitted = plane.is_none();
    let (plane, largest) = if let Some(plane) = plane {
        let plane = sound(plane)?;
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
    let towards: f64 = places.iter().map(|p| p.normal.dot(plane.normal)).sum();
    let normal = if towards < 0.0 { -plane.normal } else { plane.normal };
    Plane { point: plane.point, normal }
}

fn checked(reach: Option<f64>) -> Result<Option<f64>, Refusal> {
    match reach {
        Some(metres) if !(metres.is_finite() && metres > 0.0) => Err(Refusal::Reach { metres }),
        _ => Ok(reach),
    }
}

fn extent(points: &[DVec3]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    points.iter().map(|p| (*p - *first).length()).fold(0.0, f64::max)
}

/// The standard uncertainty of a polygon's area, as a share of it, because its corners were pointed at: pointing moves them along the surface.
fn outline<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<f64, Refusal> {
    if task.pointing.iter().all(|x| *x == 0.0) {
        return Ok(0.0);
    }
    let count = task.local.len();
    let pointing: Vec<f64> = (0..count).map(|i| task.pointing.get(i).copied().unwrap_or(0.0)).collect();
    let of_polygon = PointTool::PolygonArea.measure(&task.local, &s.space, &pointing)?;
    let fitted = of_polygon.first().map(|r| r.quantity);
    Ok(fitted.filter(|q| q.value > 0.0).map_or(0.0, |q| q.uncertainty / q.value))
}

/// An uncertainty with an independent part of another origin, which often is zero.
fn with_part(own: f64, part: f64) -> f64 {
    if part == 0.0 { own } else { libm::hypot(own, part) }
}

/// A reading whose uncertainty has, beside that of the points of the surface, a part that does not depend on them.
fn with_parts<L: Leaves>(s: &Subject<'_, L>, what: (&str, Dimension, f64), points: f64, part: f64) -> Reading {
    let (name, dimension, value) = what;
    let resolution = s.resolution(points).map(|points| with_part(points, part));
    Reading { resolution, ..Reading::new(name, dimension, value, with_part(points, part)) }
}

fn meets<L: Leaves>(s: &Subject<'_, L>, region: &Region, b: &Aabb) -> bool {
    region.meets(s.space.local_from_lattice(b.min), s.space.local_from_lattice(b.max))
}
