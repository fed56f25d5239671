//! Questions and answers of the page as JSON: doubles go through it unchanged, in both directions.

use glam::DVec3;
use kilwa_geometry::LengthUnit;
use kilwa_measure::clip::ClipState;
use kilwa_measure::job::{Subject, of_points, pack_name};
use kilwa_measure::leaves::Failure;
use kilwa_measure::saved::DocumentError;
use kilwa_measure::snap::{Snap, snap};
use kilwa_measure::{
    Document, Format, Leaves, Lines, Measurement, Message, Outcome, Reading, Refusal, Task, ToMessage, Uncertainty,
    place,
};
use kilwa_pack::Index;
use serde::Deserialize;
use serde_json::{Value, json};
use thiserror::Error;

/// What is named as the instrument.
pub const PROGRAM: &str = concat!("Kilwa ", env!("CARGO_PKG_VERSION"));

/// Why something is not written or read.
#[derive(Debug, Error)]
pub enum QuestionError {
    /// A document that is none.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// Not asked as it should be.
    #[error("that is not asked like that: {0}")]
    Asked(#[from] serde_json::Error),
    /// No unit.
    #[error("{0} is not a unit of length")]
    Unit(String),
    /// No format.
    #[error("{0} is not a file format")]
    Format(String),
    /// No scale.
    #[error("a scale such as 1:50 is wanted")]
    Scale,
    /// No lines.
    #[error("there is nothing to draw")]
    Nothing,
    /// A drawing of a whole document.
    #[error("a drawing is made of one section, profile or set of contours")]
    NoLines,
}

impl ToMessage for QuestionError {
    fn message(&self) -> Message {
        match self {
            Self::Document(e) => e.message(),
            Self::Asked(_) | Self::Unit(_) | Self::Format(_) => Message::new("asked-wrong", []),
            Self::Scale => Message::new("draw-scale", []),
            Self::Nothing => Message::new("draw-nothing", []),
            Self::NoLines => Message::new("draw-no-lines", []),
        }
    }
}

/// A final pick.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Pick {
    origin: DVec3,
    direction: DVec3,
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
    /// Readings and what belongs to them, or `refusal` with English text and `said`, the message for every language.
    ///
    /// # Errors
    /// What kept the chunks from being read.
    pub async fn answer<L: Leaves>(mut self, leaves: &L) -> Result<Value, Failure> {
        let s = Subject::new(leaves);
        self.task.world = self.task.local.iter().map(|p| s.space.world_from_local(*p)).collect();
        if let Some(level) = self.level.filter(|x| *x > 0.0) {
            let point = Uncertainty { level, ..s.uncertainty(&self.task) };
            return Ok(match of_points(&self.task, &s.space, &point) {
                Ok(readings) => self.outcome_json(&Outcome::new(self.task.clone(), readings), &point),
                Err(why) => refused(&why),
            });
        }
        match kilwa_measure::measure(leaves, &self.task).await {
            Ok(outcome) => Ok(self.outcome_json(&outcome, &outcome.uncertainty)),
            Err(Failure::Refused(why)) => Ok(refused(&why)),
            Err(e) => Err(e),
        }
    }

    fn outcome_json(&self, outcome: &Outcome, point: &Uncertainty) -> Value {
        let mut all = readings_json(&outcome.readings, point, self.unit);
        all["details"] = json!(outcome.details);
        all["remarks"] = outcome.remarks.iter().map(ToMessage::as_json).collect();
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

fn refused(why: &Refusal) -> Value {
    json!({ "refusal": why.to_string(), "said": why.as_json() })
}

fn readings_json(readings: &[Reading], point: &Uncertainty, unit: LengthUnit) -> Value {
    let printed: Vec<Value> = readings.iter().map(|r| json!({ "name": r.name, "text": r.text(unit) })).collect();
    let parts = json!([
        { "what": "lattice", "value": point.lattice },
        { "what": "level", "value": point.level },
        { "what": "capture", "value": point.capture },
        { "what": "pointing", "value": point.pointing },
    ]);
    json!({ "readings": readings, "printed": printed, "uncertainty": point, "parts": parts })
}

/// Saved readings in another unit: what is stored stays.
///
/// # Errors
/// [`QuestionError`] where they are none.
pub fn shown(readings: &str, unit: &str) -> Result<Value, QuestionError> {
    let readings: Vec<Reading> = serde_json::from_str(readings)?;
    let unit = length_unit(unit)?;
    Ok(readings.iter().map(|r| json!({ "name": r.name, "text": r.text(unit) })).collect())
}

fn length_unit(symbol: &str) -> Result<LengthUnit, QuestionError> {
    LengthUnit::parse(symbol).ok_or_else(|| QuestionError::Unit(symbol.to_owned()))
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
/// [`QuestionError`].
pub fn write(
    index: &Index,
    point: &Uncertainty,
    what: &str,
    format: &str,
    scale: f64,
) -> Result<String, QuestionError> {
    let kind = Format::from_ending(format).ok_or_else(|| QuestionError::Format(format.to_owned()))?;
    if let Ok(Drawn { title, layer, lines }) = serde_json::from_str(what) {
        if !(scale.is_finite() && (0.001..=1e7).contains(&scale)) {
            return Err(QuestionError::Scale);
        }
        let text = Lines { title, layer, lines }.write(kind, &pack_name(index), point, scale);
        return text.ok_or(QuestionError::Nothing);
    }
    let document = Document::parse(what.as_bytes())?;
    match kind {
        Format::Json => Ok(document.to_json()),
        Format::Csv => Ok(document.to_csv()),
        Format::GeoJson => Ok(document.to_geojson()),
        Format::Dxf => Ok(document.to_dxf()),
        Format::Svg => Err(QuestionError::NoLines),
    }
}

/// A document that was saved, `same` where it is of this very pack. Points of another version of the model are counted from this pack's origin.
///
/// # Errors
/// [`QuestionError`].
pub fn read(index: &Index, text: &str) -> Result<Value, QuestionError> {
    let mut document = Document::parse(text.as_bytes())?;
    let here = pack_name(index);
    let same = document.pack.identity == here.identity;
    for m in &mut document.measurements {
        m.task = m.task.on_lattice(&document.pack.lattice, &here.lattice);
    }
    document.pack.lattice.origin = here.lattice.origin;
    let mut value = serde_json::to_value(&document)?;
    value["same"] = json!(same);
    Ok(value)
}

/// One sentence that cites a measurement.
///
/// # Errors
/// [`QuestionError`] where it is none.
pub fn cite(index: &Index, measurement: &str, unit: &str) -> Result<String, QuestionError> {
    let measurement: Measurement = serde_json::from_str(measurement)?;
    Ok(measurement.citation(&pack_name(index), PROGRAM, length_unit(unit)?))
}
