//! Saved measurements: one JSON document that reads back bit for bit, and exports to CSV, GeoJSON and DXF.
//!
//! A measurement holds what was measured (tool, points, planes), so that it can be measured again, and what came out. Points are kept
//! twice: `local`, exact (see [`crate::space`]), which counts, and `world`, for people and other programs. The document names the
//! pack by its identity, so that a reader notices that it is another one. `serde_json` with `float_roundtrip` reads every
//! double as it was written; JavaScript does so too.

use crate::drawing::short;
use crate::message::{Message, MessageValue, ToMessage};
use crate::plane::Plane;
use crate::quantity::Uncertainty;
use crate::space::Space;
use crate::unit::{self, Reading};
use glam::DVec3;
use kilwa_geometry::Lattice;
use kilwa_geometry::LengthUnit;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use thiserror::Error;

/// Version of the document that this program writes; it reads all up to it.
pub const VERSION: u32 = 1;
/// Longest document that is read, bytes.
pub const MAX_BYTES: usize = 64 << 20;

/// What a saved measurement was made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "each is the tool of the same name of the command line")]
pub enum ToolName {
    Coordinate,
    Distance,
    Perimeter,
    Along,
    Angle,
    PlaneAngle,
    Height,
    Area,
    Volume,
    CutFill,
    Circle,
    Section,
    Profile,
    Contours,
    Deviation,
}

impl ToolName {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coordinate => "coordinate",
            Self::Distance => "distance",
            Self::Perimeter => "perimeter",
            Self::Along => "along",
            Self::Angle => "angle",
            Self::PlaneAngle => "plane-angle",
            Self::Height => "height",
            Self::Area => "area",
            Self::Volume => "volume",
            Self::CutFill => "cut-fill",
            Self::Circle => "circle",
            Self::Section => "section",
            Self::Profile => "profile",
            Self::Contours => "contours",
            Self::Deviation => "deviation",
        }
    }

    /// Whether its points enclose something.
    pub(crate) fn is_closed(self) -> bool {
        matches!(self, Self::Perimeter | Self::Area | Self::CutFill | Self::Deviation)
    }
}

/// What was measured: enough to measure it again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// The tool.
    pub tool: ToolName,
    /// Points on the finest surface, local metres; these count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub local: Vec<DVec3>,
    /// The same in world coordinates, metres, as good as doubles hold them there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub world: Vec<DVec3>,
    /// Standard uncertainty of where each point was pointed at, metres, on each axis: the size of a pixel on the surface. 0 for points that were typed or
    /// snapped; nothing if all are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pointing: Vec<f64>,
    /// The plane, where the tool was given one, local metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<Plane>,
    /// How far a polygon counts the surface, where it was given, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
    /// From contour to contour, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<f64>,
}

impl Task {
    /// A task on points.
    pub fn on_points(tool: ToolName, local: Vec<DVec3>, space: &Space) -> Self {
        let world = local.iter().map(|p| space.world_from_local(*p)).collect();
        Self { tool, local, world, pointing: Vec::new(), plane: None, reach: None, interval: None }
    }

    /// The same task with points counted from the origin of the lattice `to` instead of that of `from`.
    #[must_use]
    pub fn on_lattice(&self, from: &Lattice, to: &Lattice) -> Self {
        let mut task = self.clone();
        if from.origin == to.origin {
            return task;
        }
        let shift = from.origin - to.origin;
        let moved = |p: DVec3| p + shift;
        task.local.iter_mut().for_each(|p| *p = moved(*p));
        if let Some(plane) = &mut task.plane {
            plane.point = moved(plane.point);
        }
        task
    }
}

/// One saved measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// What a person calls it.
    pub name: String,
    /// What was measured.
    #[serde(flatten)]
    pub task: Task,
    /// What came out; empty while it is provisional.
    pub readings: Vec<Reading>,
    /// Of one coordinate of one point.
    pub uncertainty: Uncertainty,
    /// Colour on the model, `#rrggbb`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<String>,
    /// Not shown on the model.
    #[serde(default)]
    pub hidden: bool,
    /// What a person wrote about it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// When it was measured, as the person wrote it: `2026-11-21`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
}

/// Which pack was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PackName {
    /// FORMAT section 7.
    pub identity: String,
    /// Its title.
    pub title: String,
    /// Its lattice: what `local` is counted from.
    pub lattice: Lattice,
    /// Its reference system, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crs: Option<String>,
}

/// A document of measurements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Document {
    /// Always `measurements`.
    pub kilwa: String,
    /// [`VERSION`].
    pub version: u32,
    /// Which pack.
    pub pack: PackName,
    /// The measurements, in the order of the table.
    pub measurements: Vec<Measurement>,
}

/// Why a document is not read.
#[derive(Debug, Error)]
pub enum DocumentError {
    /// Too long.
    #[error("the document of measurements has {bytes} bytes; at most {MAX_BYTES} are allowed")]
    TooLong {
        /// Its length.
        bytes: usize,
    },
    /// No JSON of this shape.
    #[error("it is not a document of measurements: {0}")]
    Json(#[from] serde_json::Error),
    /// Something else.
    #[error("it is not a document of measurements: \"kilwa\" is \"{0}\" instead of \"measurements\"")]
    Other(String),
    /// From the future.
    #[error("it is of version {0}; this program reads up to {VERSION}. Use a newer kilwa")]
    Newer(u32),
}

impl ToMessage for DocumentError {
    fn message(&self) -> Message {
        let count = |n: usize| MessageValue::Count(n as u64);
        match self {
            Self::TooLong { bytes } => {
                Message::new("document-too-long", [("bytes", count(*bytes)), ("most", count(MAX_BYTES))])
            }
            Self::Json(e) => Message::new("document-json", [("line", count(e.line())), ("column", count(e.column()))]),
            Self::Other(kind) => Message::new("document-other", [("kind", MessageValue::Word(kind.clone()))]),
            Self::Newer(version) => Message::new(
                "document-newer",
                [("version", MessageValue::Count((*version).into())), ("known", MessageValue::Count(VERSION.into()))],
            ),
        }
    }
}

/// What every document begins with, of whatever version.
#[derive(Deserialize)]
struct Kind {
    kilwa: String,
    version: u32,
}

impl Document {
    /// An empty document.
    pub fn new(pack: PackName) -> Self {
        Self { kilwa: "measurements".to_owned(), version: VERSION, pack, measurements: Vec::new() }
    }

    /// Read a document.
    ///
    /// # Errors
    /// [`DocumentError`].
    pub fn parse(bytes: &[u8]) -> Result<Self, DocumentError> {
        if bytes.len() > MAX_BYTES {
            return Err(DocumentError::TooLong { bytes: bytes.len() });
        }
        // Version first: a newer document may have another shape.
        let kind: Kind = kilwa_pack::json::from_slice(bytes)?;
        if kind.kilwa != "measurements" {
            return Err(DocumentError::Other(kind.kilwa));
        }
        if kind.version > VERSION {
            return Err(DocumentError::Newer(kind.version));
        }
        Ok(serde_json::from_slice(bytes)?)
    }

    /// As JSON, with a line feed at the end. The same document gives the same bytes.
    pub fn to_json(&self) -> String {
        // Only maps with keys that are no strings and failing writers can fail; there are none.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// One row per reading, stored units, every digit.
    pub fn to_csv(&self) -> String {
        let mut out = String::from("name,tool,reading,value,uncertainty,unit,points,note\n");
        for m in &self.measurements {
            let points: Vec<String> =
                m.task.world.iter().map(|p| format!("{:?} {:?} {:?}", p[0], p[1], p[2])).collect();
            for r in &m.readings {
                let (_, symbol) = unit::shown(r.quantity, r.dimension, LengthUnit::Metre);
                let symbol = if symbol == "°" { "rad".to_owned() } else { symbol };
                let cells = [m.name.as_str(), m.task.tool.name(), &r.name];
                let cells: Vec<String> = cells.into_iter().map(cell).collect();
                let (v, u) = (r.quantity.value, r.quantity.uncertainty);
                let (points, note) = (cell(&points.join("; ")), cell(&m.note));
                let _ = writeln!(out, "{},{v:?},{u:?},{symbol},{points},{note}", cells.join(","));
            }
        }
        out
    }

    /// Points, lines and polygons in the model's coordinates, the reference system named as the 2008 edition of GeoJSON does.
    pub fn to_geojson(&self) -> String {
        let features: Vec<serde_json::Value> = self.measurements.iter().filter_map(feature).collect();
        let mut all =
            serde_json::json!({ "type": "FeatureCollection", "features": features, "pack": self.pack.identity });
        if let Some(code) = self.pack.crs.as_deref().and_then(|c| c.strip_prefix("EPSG:")) {
            let name = format!("urn:ogc:def:crs:EPSG::{code}");
            all["crs"] = serde_json::json!({ "type": "name", "properties": { "name": name } });
        }
        all.to_string() + "\n"
    }
}

impl Measurement {
    /// One sentence that cites this measurement: what, how much with its uncertainty, of which model in which version, when and with what.
    pub fn citation(&self, pack: &PackName, tool: &str, unit: LengthUnit) -> String {
        let values: Vec<String> = self.readings.iter().map(|r| format!("{} {}", r.name, r.text(unit))).collect();
        let capture = match self.uncertainty.capture {
            Some(c) => format!("capture accuracy {} m", short(c, 6)),
            None => "capture accuracy unknown".to_owned(),
        };
        let date = self.date.as_deref().map_or(String::new(), |d| format!(" on {d}"));
        format!(
            "{} ({}): {}. Measured{date} on the finest surface of “{}” (pack {}) with {tool}; {capture}.",
            self.name,
            self.task.tool.name(),
            values.join(", "),
            pack.title,
            pack.identity
        )
    }
}

fn feature(m: &Measurement) -> Option<serde_json::Value> {
    let points = &m.task.world;
    let (first, rest) = points.split_first()?;
    let geometry = if rest.is_empty() {
        serde_json::json!({ "type": "Point", "coordinates": first })
    } else if m.task.tool.is_closed() && points.len() > 2 {
        let mut ring = points.clone();
        ring.push(*first);
        serde_json::json!({ "type": "Polygon", "coordinates": [ring] })
    } else {
        serde_json::json!({ "type": "LineString", "coordinates": points })
    };
    let properties = serde_json::json!({
        "name": m.name, "tool": m.task.tool.name(), "readings": m.readings, "note": m.note, "color": m.color,
    });
    Some(serde_json::json!({ "type": "Feature", "properties": properties, "geometry": geometry }))
}

/// A cell of CSV (RFC 4180). What a spreadsheet would take for a formula gets an apostrophe.
fn cell(text: &str) -> String {
    let text = if text.starts_with(['=', '+', '@']) { format!("'{text}") } else { text.to_owned() };
    if text.contains([',', '"', '\n', '\r', ';']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::Quantity;
    use crate::unit::Dimension;
    use proptest::prelude::*;

    fn document(values: &[f64]) -> Document {
        let lattice = Lattice { origin: DVec3::new(500_000.1, 4_649_776.2, 123.456), step_log2: -11 };
        let space = Space::new(lattice);
        let pack = PackName {
            identity: "0123456789abcdef0123456789abcdef".into(),
            title: "Gereza, \"west\"".into(),
            lattice,
            crs: Some("EPSG:32737".into()),
        };
        let mut d = Document::new(pack);
        let local: Vec<DVec3> = values.chunks_exact(3).map(|p| DVec3::from_slice(p)).collect();
        d.measurements.push(Measurement {
            name: "=gate, width".into(),
            task: Task::on_points(ToolName::Distance, local, &space),
            readings: vec![Reading {
                name: "straight".into(),
                dimension: Dimension::Length,
                quantity: Quantity { value: values[0], uncertainty: values[1] },
                resolution: None,
            }],
            uncertainty: Uncertainty::finest(space.step(), Some(0.002)),
            color: Some("#c08030".into()),
            hidden: true,
            note: "مسجد\nsecond line".into(),
            date: Some("2026-11-21".into()),
        });
        d
    }

    proptest! {
        #[test]
        fn a_document_round_trips_bit_for_bit(bits in prop::collection::vec(any::<u64>(), 6..30)) {
            let values: Vec<f64> = bits.iter().map(|b| f64::from_bits(*b)).map(|x| if x.is_finite() { x } else { 0.1 }).collect();
            let d = document(&values);
            let back = Document::parse(d.to_json().as_bytes()).unwrap();
            let of = |d: &Document| -> Vec<u64> {
                d.measurements[0].task.local.iter().chain(&d.measurements[0].task.world).flat_map(|p| p.to_array().map(f64::to_bits)).collect()
            };
            prop_assert_eq!(of(&back), of(&d));
            prop_assert_eq!(back.to_json(), d.to_json());
        }

        #[test]
        fn damaged_documents_are_read_or_refused_without_a_panic(cut in 0usize..1500, flip in 0usize..1500, bit in 0u8..8) {
            let mut bytes = document(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).to_json().into_bytes();
            if let Some(b) = bytes.get_mut(flip) { *b ^= 1 << bit; }
            bytes.truncate(cut.max(1));
            let _ = Document::parse(&bytes);
        }
    }

    #[test]
    fn pointing_is_kept_and_may_be_missing() {
        let mut d = document(&[1.5, 0.25, 3.0, 4.0, 5.0, 6.0]);
        assert!(!d.to_json().contains("pointing"), "as in documents of before");
        assert!(Document::parse(d.to_json().as_bytes()).unwrap().measurements[0].task.pointing.is_empty());
        d.measurements[0].task.pointing = vec![0.052, 0.0];
        d.measurements[0].uncertainty.pointing = 0.052;
        assert_eq!(Document::parse(d.to_json().as_bytes()).unwrap(), d);
    }

    #[test]
    fn input_that_is_no_document_is_refused_with_a_message() {
        let say = |text: &str| Document::parse(text.as_bytes()).unwrap_err().to_string();
        assert!(say("{}").contains("not a document of measurements"));
        assert!(say("{\"kilwa\":\"pack\",\"version\":1}").contains("\"pack\""));
        assert!(say("{\"kilwa\":\"measurements\",\"version\":2}").contains("newer kilwa"));
    }

    #[test]
    fn csv_cells_are_quoted_and_geojson_names_its_reference_system() {
        let d = document(&[1.5, 0.25, 3.0, 4.0, 5.0, 6.0]);
        let csv = d.to_csv();
        let row = csv.lines().nth(1).unwrap();
        assert!(row.starts_with("\"'=gate, width\",distance,straight,1.5,0.25,m,"), "{row}");
        let map: serde_json::Value = serde_json::from_str(&d.to_geojson()).unwrap();
        assert_eq!(map["crs"]["properties"]["name"], "urn:ogc:def:crs:EPSG::32737");
        assert_eq!(map["features"][0]["geometry"]["type"], "LineString");
        let cited = d.measurements[0].citation(&d.pack, "Kilwa 0.1.0", LengthUnit::Metre);
        assert!(cited.contains("Measured on 2026-11-21 on the finest surface"), "{cited}");
        assert!(cited.contains("straight 1.50 ± 0.25 m") && cited.contains("pack 0123456789abcdef"), "{cited}");
    }
}
