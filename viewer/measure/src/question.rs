//! What the page asks and what it is told, as JSON: doubles go through it unchanged, in both directions.

use kilwa_geometry::distance::Vec3;
use kilwa_measure::clip::ClipState;
use kilwa_measure::job::{Subject, of_points, pack_name};
use kilwa_measure::leaves::Failure;
use kilwa_measure::snap::{Snap, snap};
use kilwa_measure::{
    Document, Format, Leaves, LengthUnit, Lines, Measurement, Outcome, Reading, Refusal, Task, Uncertainty, place,
};
use kilwa_pack::Index;
use serde::Deserialize;
use serde_json::{Value, json};

/// What is named as the instrument.
pub const PROGRAM: &str = concat!("Kilwa ", env!("CARGO_PKG_VERSION"));

/// A final pick.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Pick {
    origin: Vec3,
    direction: Vec3,
    /// The state of the display; only what it cuts away counts.
    #[serde(default)]
    clip: ClipState,
    #[serde(default)]
    snap: Snap,
    /// How far to snap, metres; usually ten edges of the surface.
    #[serde(default)]
    within: Option<f64>,
}

/// A measurement.
#[derive(Debug, Deserialize)]
pub struct Question {
    task: Task,
    #[serde(default)]
    unit: LengthUnit,
    /// How far the points may still be from the finest surface, metres: the answer is provisional then.
    #[serde(default)]
    level: Option<f64>,
}

/// What the pack is: as `kilwa measure` names it.
pub fn pack(index: &Index) -> Value {
    let m = index.metadata();
    json!({
        "identity": index.identity(),
        "title": m.title,
        "crs": m.crs,
        "lattice": index.header().lattice,
        "step": index.header().lattice.step(),
        "capture": m.capture_accuracy,
        "bytes": index.header().file_bytes,
        "triangles": m.triangles,
        "borders": m.border_edges,
        "program": PROGRAM,
    })
}

impl Pick {
    /// The point of the finest surface, or null where the ray meets nothing.
    ///
    /// # Errors
    /// What kept the chunks from being read.
    pub async fn answer<L: Leaves>(&self, leaves: &L) -> Result<Value, Failure> {
        let clip = self.clip.in_steps(&leaves.index().header().lattice);
        let found = match place::cast(leaves, self.origin, self.direction, &clip).await {
            Ok(found) => found,
            Err(Failure::Refused(Refusal::Misses { .. })) => return Ok(Value::Null),
            Err(e) => return Err(e),
        };
        let within = self.within.unwrap_or(10.0 * leaves.index().metadata().median_edge);
        let snapped = snap(leaves, found.local, self.snap, within, &clip).await?;
        let s = Subject::new(leaves);
        let local = snapped.unwrap_or(found.local);
        Ok(json!({
            "local": local,
            "world": s.space.world_from_local(local),
            "normal": found.normal,
            "ray": { "origin": self.origin, "direction": self.direction },
            "snapped": snapped.map(|_| self.snap),
        }))
    }
}

impl Question {
    /// Readings and what belongs to them, or `refusal` with a sentence.
    ///
    /// # Errors
    /// What kept the chunks from being read.
    pub async fn answer<L: Leaves>(mut self, leaves: &L) -> Result<Value, Failure> {
        let s = Subject::new(leaves);
        self.task.world = self.task.local.iter().map(|p| s.space.world_from_local(*p)).collect();
        if let Some(level) = self.level.filter(|x| *x > 0.0) {
            let point = Uncertainty { level, ..s.point };
            return Ok(match of_points(&self.task, &s.space, &point) {
                Ok(readings) => self.told(&Outcome::new(self.task.clone(), readings), &point),
                Err(why) => json!({ "refusal": why.to_string() }),
            });
        }
        match kilwa_measure::measure(leaves, &self.task).await {
            Ok(outcome) => Ok(self.told(&outcome, &s.point)),
            Err(Failure::Refused(why)) => Ok(json!({ "refusal": why.to_string() })),
            Err(e) => Err(e),
        }
    }

    fn told(&self, outcome: &Outcome, point: &Uncertainty) -> Value {
        let mut all = told(&outcome.readings, point, self.unit);
        all["details"] = json!(outcome.details);
        all["remarks"] = json!(outcome.remarks);
        all["task"] = json!(outcome.task);
        if let Some(lines) = &outcome.lines {
            all["lines"] = json!(lines.lines);
            all["title"] = json!(lines.title);
            all["layer"] = json!(lines.layer);
        }
        if let Some(read) = outcome.read {
            all["read"] = json!(read);
        }
        all["provisional"] = json!(point.level > 0.0);
        all
    }
}

fn told(readings: &[Reading], point: &Uncertainty, unit: LengthUnit) -> Value {
    let printed: Vec<Value> = readings.iter().map(|r| json!({ "name": r.name, "text": r.text(unit) })).collect();
    let parts = json!([
        { "what": "lattice", "value": point.lattice },
        { "what": "level", "value": point.level },
        { "what": "capture", "value": point.capture },
    ]);
    json!({ "readings": readings, "printed": printed, "uncertainty": point, "parts": parts })
}

/// Saved readings in another unit: what is stored stays.
///
/// # Errors
/// A sentence where they are none.
pub fn shown(readings: &str, unit: &str) -> Result<Value, String> {
    let readings: Vec<Reading> = serde_json::from_str(readings).map_err(|e| e.to_string())?;
    let unit = length_unit(unit)?;
    Ok(readings.iter().map(|r| json!({ "name": r.name, "text": r.text(unit) })).collect())
}

fn length_unit(symbol: &str) -> Result<LengthUnit, String> {
    LengthUnit::from_symbol(symbol).ok_or_else(|| format!("{symbol} is no unit of length"))
}

/// The lines of an answer.
#[derive(Debug, Deserialize)]
struct Drawn {
    title: String,
    layer: String,
    lines: Vec<kilwa_measure::Line>,
}

/// A document of measurements, or an answer with lines, as the text of a file.
///
/// # Errors
/// A sentence.
pub fn write(index: &Index, point: &Uncertainty, what: &str, format: &str, scale: f64) -> Result<String, String> {
    let kind = Format::from_ending(format).ok_or_else(|| format!("{format} is no format of files"))?;
    if let Ok(Drawn { title, layer, lines }) = serde_json::from_str(what) {
        if !(scale.is_finite() && (0.001..=1e7).contains(&scale)) {
            return Err("a scale such as 1:50 is wanted".to_owned());
        }
        let text = Lines { title, layer, lines }.write(kind, &pack_name(index), point, scale);
        return text.ok_or_else(|| "there is nothing to draw".to_owned());
    }
    let document = Document::parse(what.as_bytes()).map_err(|e| e.to_string())?;
    match kind {
        Format::Json => Ok(document.to_json()),
        Format::Csv => Ok(document.to_csv()),
        Format::GeoJson => Ok(document.to_geojson()),
        Format::Dxf => Ok(document.to_dxf()),
        Format::Svg => Err("a drawing is made of one section, profile or set of contours".to_owned()),
    }
}

/// A document that was saved, `same` where it is of this very pack. Points of another version of the model are counted from this pack's origin.
///
/// # Errors
/// A sentence.
pub fn read(index: &Index, text: &str) -> Result<Value, String> {
    let mut document = Document::parse(text.as_bytes()).map_err(|e| e.to_string())?;
    let here = pack_name(index);
    let same = document.pack.identity == here.identity;
    for m in &mut document.measurements {
        m.task = m.task.on_lattice(&document.pack.lattice, &here.lattice);
    }
    document.pack.lattice.origin = here.lattice.origin;
    let mut value = serde_json::to_value(&document).map_err(|e| e.to_string())?;
    value["same"] = json!(same);
    Ok(value)
}

/// One sentence that cites a measurement.
///
/// # Errors
/// A sentence where it is none.
pub fn cite(index: &Index, measurement: &str, unit: &str) -> Result<String, String> {
    let measurement: Measurement = serde_json::from_str(measurement).map_err(|e| e.to_string())?;
    Ok(measurement.citation(&pack_name(index), PROGRAM, length_unit(unit)?))
}
