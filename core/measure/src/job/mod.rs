//! One measurement as a whole: from a [`Task`] to readings, on the finest surface of a pack. The page and `kilwa measure` call [`measure`] and
//! differ only in where the chunks come from ([`Leaves`]), so that they print the same digits.
//!
//! `whole` sums over the surface, `cutting` cuts it with planes. Nothing is kept of the surface: memory is that of the sums, or of the lines.

mod cutting;
mod whole;

use crate::lines::Lines;
use crate::place::{Place, facing_at, registration_channel};
use crate::plane::Plane;
use crate::quantity::Uncertainty;
use crate::refusal::Refusal;
use crate::remark::Remark;
use crate::saved::{PackName, Task, ToolName};
use crate::space::Space;
use crate::tools::PointTool;
use crate::unit::Reading;
use crate::{Failure, Leaves, Read};
use glam::DVec3;
use kilwa_geometry::LengthUnit;
use kilwa_pack::Index;
use serde_json::{Map, Value, json};

/// What a measurement gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// What was measured.
    pub task: Task,
    /// The values.
    pub readings: Vec<Reading>,
    /// What else is known, by name, for machines.
    pub details: Map<String, Value>,
    /// What else is known, in sentences.
    pub remarks: Vec<Remark>,
    /// Lines that were cut.
    pub lines: Option<Lines>,
    /// What was read for it; points alone need nothing.
    pub read: Option<Read>,
    /// Contributions to the uncertainty of the points; those of pointing and of registration are the largest of any point.
    pub uncertainty: Uncertainty,
}

impl Outcome {
    /// Readings alone.
    pub fn new(task: Task, readings: Vec<Reading>) -> Self {
        let (details, remarks) = (Map::new(), Vec::new());
        Self { task, readings, details, remarks, lines: None, read: None, uncertainty: Uncertainty::default() }
    }

    /// A further value.
    pub fn add(&mut self, name: &str, value: Value) {
        self.details.insert(name.to_owned(), value);
    }

    /// A further sentence.
    pub fn remark(&mut self, remark: Remark) {
        self.remarks.push(remark);
    }

    fn has_read(&mut self, read: Read) {
        self.read = Some(self.read.map_or(read, |before| before.and(read)));
    }

    /// The readings as they are printed: name, and value with uncertainty and unit.
    pub fn printed(&self, unit: LengthUnit) -> Vec<(&str, String)> {
        self.readings.iter().map(|r| (r.name.as_str(), r.text(unit))).collect()
    }
}

/// A surface with what every tool needs to know of it.
#[derive(Debug, Clone)]
pub struct Subject<'a, L> {
    /// The surface.
    pub leaves: &'a L,
    /// Its space.
    pub space: Space,
    /// Uncertainty of one coordinate of one point.
    pub point: Uncertainty,
    /// The part due to registration for each point of a task, metres; empty if it is the same for all points.
    registration: Vec<f64>,
}

impl<'a, L: Leaves> Subject<'a, L> {
    /// The finest surface of a pack.
    pub fn new(leaves: &'a L) -> Self {
        let index = leaves.index();
        let space = Space::new(index.header().lattice);
        Self { leaves, space, point: Uncertainty::of_pack(index), registration: Vec::new() }
    }

    /// Looks up the uncertainty due to registration at the points of a task, if the pack stores it for each vertex. Sums over the surface use the largest value.
    async fn locate(&mut self, task: &Task) -> Result<(), Failure> {
        let Some((mean, instrument)) = self.point.registration.zip(self.point.instrument) else { return Ok(()) };
        // A profile is drawn in plan: its points are not on the surface.
        if registration_channel(self.leaves.index()).is_none() || task.tool == ToolName::Profile {
            return Ok(());
        }
        let places = match self.places(task).await {
            Ok(places) => places,
            // The tool itself reports the error for these points.
            Err(Failure::Refused(_)) => return Ok(()),
            Err(e) => return Err(e),
        };
        self.registration = places.iter().map(|place| place.registration.unwrap_or(mean)).collect();
        if let Some(largest) = self.registration.iter().copied().reduce(f64::max) {
            self.point.capture = Some(libm::hypot(largest, instrument));
            self.point.registration = Some(largest);
        }
        Ok(())
    }

    /// The uncertainty of each point of a task, metres, on each axis.
    fn per_axis(&self, task: &Task) -> Vec<f64> {
        let count = task.local.len();
        if self.registration.is_empty() {
            return self.point.of_points(&task.pointing, count);
        }
        let with_pointing =
            |(i, registration): (usize, &f64)| libm::hypot(*registration, task.pointing.get(i).copied().unwrap_or(0.0));
        let own: Vec<f64> = self.registration.iter().enumerate().map(with_pointing).collect();
        Uncertainty { capture: self.point.instrument, ..self.point }.of_points(&own, count)
    }

    /// Where the uncertainty of the points of a task comes from: that of pointing is the largest of them.
    pub fn uncertainty(&self, task: &Task) -> Uncertainty {
        Uncertainty { pointing: task.pointing.iter().copied().fold(0.0, f64::max), ..self.point }
    }

    /// The uncertainty of a reading if every coordinate, instead of [`Uncertainty::combined`], were as uncertain as the spacing of the mesh; `None` where
    /// the accuracy of the capture is known. `own` is the reading's uncertainty without pointing, in its unit.
    fn resolution(&self, own: f64) -> Option<f64> {
        let supported = own * (self.leaves.index().metadata().median_edge / self.point.combined());
        (self.point.capture.is_none() && supported > 0.0 && supported.is_finite()).then_some(supported)
    }

    /// What a tool finds on the points of a task, and what the spacing of the mesh supports of it, which does not depend on pointing.
    fn on_points(&self, task: &Task, tool: PointTool) -> Result<Vec<Reading>, Refusal> {
        let mut readings = tool.measure(&task.local, &self.space, &self.per_axis(task))?;
        // The scatter of the points round a circle does not grow with the spacing.
        let is_circle = tool == PointTool::Circle;
        if self.point.capture.is_none() && (is_circle || !task.pointing.is_empty()) {
            let each = if is_circle { self.leaves.index().metadata().median_edge } else { self.point.combined() };
            let without = tool.measure(&task.local, &self.space, &vec![each; task.local.len()])?;
            for (reading, without) in readings.iter_mut().zip(without) {
                let own = without.quantity.uncertainty;
                reading.resolution = if is_circle { Some(own).filter(|u| *u > 0.0) } else { self.resolution(own) };
            }
        }
        Ok(readings)
    }

    /// The whole model's box, local metres.
    fn bounds(&self) -> (DVec3, DVec3) {
        let m = self.leaves.index().metadata();
        (self.space.local_from_world(m.bounds_min), self.space.local_from_world(m.bounds_max))
    }

    /// A plane in world coordinates.
    fn plane_json(&self, plane: &Plane) -> Value {
        json!({ "point": self.space.world_from_local(plane.point), "normal": plane.normal })
    }

    /// The points of a task with the way that the surface faces there; the points stay.
    async fn places(&self, task: &Task) -> Result<Vec<Place>, Failure> {
        let mut places = Vec::with_capacity(task.local.len());
        for p in &task.local {
            places.push(facing_at(self.leaves, *p).await?);
        }
        Ok(places)
    }
}

/// What a pack is called in a document of measurements.
pub fn pack_name(index: &Index) -> PackName {
    PackName {
        identity: index.identity(),
        title: index.metadata().title.clone(),
        lattice: index.header().lattice,
        crs: index.metadata().crs.clone(),
    }
}

/// Measure.
///
/// # Errors
/// A [`Refusal`] where there is no meaningful number, or what kept chunks from being read.
pub async fn measure<L: Leaves>(leaves: &L, task: &Task) -> Result<Outcome, Failure> {
    let mut subject = Subject::new(leaves);
    let is_length = |x: &f64| *x >= 0.0 && x.is_finite();
    if !task.pointing.iter().all(is_length) {
        return Err(Refusal::NotFinite.into());
    }
    subject.locate(task).await?;
    let mut outcome = measured(&subject, task).await?;
    finite(&outcome.readings)?;
    // Tools whose readings contain pointing have stated it themselves.
    for Reading { quantity, resolution, .. } in &mut outcome.readings {
        *resolution = resolution.or_else(|| subject.resolution(quantity.uncertainty));
    }
    outcome.uncertainty = subject.uncertainty(task);
    Ok(outcome)
}

/// Refuse results whose value or uncertainty overflowed: JSON has no infinity and no NaN, so a document with one could not be read again.
fn finite(readings: &[Reading]) -> Result<(), Refusal> {
    let is_finite = |r: &Reading| r.quantity.value.is_finite() && r.quantity.uncertainty.is_finite();
    if readings.iter().all(is_finite) { Ok(()) } else { Err(Refusal::NotFinite) }
}

async fn measured<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    #[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
    if crate::points::is_of_points(s.leaves.index()) {
        return of_pack_of_points(s, task);
    }
    match task.tool {
        ToolName::Along => cutting::along(s, task).await,
        ToolName::Area if task.local.is_empty() => whole::area(s, task).await,
        ToolName::Area => whole::polygon_area(s, task).await,
        ToolName::Volume => whole::volume(s, task).await,
        ToolName::CutFill => whole::cut_fill(s, task).await,
        ToolName::Deviation => whole::deviation(s, task).await,
        ToolName::Section => {
            let plane = task.plane.ok_or(Refusal::NoPlane { tool: "a section" })?;
            cutting::section(s, task, sound(plane)?).await
        }
        ToolName::Profile => cutting::profile(s, task).await,
        ToolName::Contours => cutting::contours(s, task).await,
        _ => Ok(Outcome::new(task.clone(), s.on_points(task, point_tool(task)?)?)),
    }
}

/// Measure in a pack of points: only what needs no surface between them.
#[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
fn of_pack_of_points<L: Leaves>(s: &Subject<'_, L>, task: &Task) -> Result<Outcome, Failure> {
    let tool = match point_tool(task) {
        Ok(tool) if task.tool != ToolName::Along => tool,
        _ => return Err(Refusal::OfPoints.into()),
    };
    let readings = s.on_points(task, tool)?;
    Ok(Outcome::new(task.clone(), readings))
}

/// The readings of a tool that needs points only, also of points that are known no better than `point` says.
///
/// # Errors
/// [`Refusal`], also for a tool that needs the surface.
pub fn of_points(task: &Task, space: &Space, point: &Uncertainty) -> Result<Vec<Reading>, Refusal> {
    let readings = point_tool(task)?.measure(&task.local, space, &point.of_points(&task.pointing, task.local.len()))?;
    finite(&readings)?;
    Ok(readings)
}

/// What a tool finds on its points alone.
///
/// # Errors
/// [`Refusal::Waits`] for a tool that needs the surface.
fn point_tool(task: &Task) -> Result<PointTool, Refusal> {
    Ok(match task.tool {
        ToolName::Coordinate => PointTool::Coordinate,
        ToolName::Distance | ToolName::Along => PointTool::Distance,
        ToolName::Perimeter => PointTool::Perimeter,
        ToolName::Angle => PointTool::Angle,
        ToolName::PlaneAngle => PointTool::PlaneAngle,
        ToolName::Height => PointTool::Height,
        ToolName::Circle => PointTool::Circle,
        ToolName::Area if !task.local.is_empty() => PointTool::PolygonArea,
        _ => return Err(Refusal::Waits),
    })
}

/// A plane that a person or a file gave: its normal of unit length.
fn sound(plane: Plane) -> Result<Plane, Refusal> {
    let unit = (plane.normal.length() - 1.0).abs() < 1e-12;
    crate::refusal::finite(&[plane.point, plane.normal])?;
    if unit { Ok(plane) } else { Plane::new(plane.point, plane.normal) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::Lattice;

    #[test]
    fn an_uncertainty_that_overflows_is_refused() {
        let coordinate = |step_log2| {
            let space = Space::new(Lattice { origin: DVec3::ZERO, step_log2 });
            let task = Task::on_points(ToolName::Coordinate, vec![DVec3::splat(space.step())], &space);
            of_points(&task, &space, &Uncertainty::finest(space.step(), None))
        };
        assert!(coordinate(-13).is_ok());
        // The square of the lattice spacing overflows a double.
        assert_eq!(coordinate(900).unwrap_err(), Refusal::NotFinite);
    }
}
