//! Lines that sections, profiles and contours give, and the files that they are written to: SVG and DXF to scale, CSV, JSON and
//! GeoJSON. Numbers in DXF, CSV, JSON and GeoJSON read back as the same doubles.

use crate::drawing::{Drawing, DrawnLine};
use crate::quantity::Uncertainty;
use crate::saved::PackName;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Whether the last point is joined to the first.
    pub closed: bool,
    /// In the drawing: x to the right, y up, metres. A closed line does not repeat its first point.
    pub flat: Vec<DVec2>,
    /// In world coordinates. A closed line repeats its first point.
    pub world: Vec<DVec3>,
    /// World height, metres, where it is a contour.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elevation: Option<f64>,
}

/// All lines of a measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lines {
    /// What they are called in drawings: `Section`.
    pub title: String,
    /// Their layer in drawings: `SECTION`.
    pub layer: String,
    /// The lines.
    pub lines: Vec<Line>,
}

/// A format of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "each is the format of the same ending")]
pub enum Format {
    Svg,
    Dxf,
    Csv,
    Json,
    GeoJson,
}

impl Format {
    /// By the ending of a file's name, without the point.
    pub fn from_ending(ending: &str) -> Option<Self> {
        Some(match ending.to_ascii_lowercase().as_str() {
            "svg" => Self::Svg,
            "dxf" => Self::Dxf,
            "csv" => Self::Csv,
            "json" => Self::Json,
            "geojson" => Self::GeoJson,
            _ => return None,
        })
    }
}

impl Lines {
    /// A drawing's lines and the same in world coordinates.
    pub fn new(title: &str, drawing: Drawing, world: Vec<Vec<DVec3>>) -> Self {
        let both = drawing.lines.into_iter().zip(world);
        let line =
            |(d, world): (DrawnLine, _)| Line { closed: d.closed, flat: d.points, world, elevation: d.elevation };
        Self { title: title.to_owned(), layer: drawing.layer, lines: both.map(line).collect() }
    }

    /// As a drawing at 1:`scale`.
    pub fn drawing(&self, pack: &PackName, point: &Uncertainty, scale: f64) -> Drawing {
        let line = |l: &Line| DrawnLine { points: l.flat.clone(), closed: l.closed, elevation: l.elevation };
        let notes = vec![
            format!("{} · pack {}", pack.title, pack.identity),
            format!("coordinates {}", pack.crs.as_deref().unwrap_or("local")),
            match point.capture {
                Some(c) => format!("standard uncertainty of a point: capture {c} m, lattice {:.1e} m", point.lattice),
                None => format!("capture accuracy unknown, lattice {:.1e} m", point.lattice),
            },
        ];
        let (title, layer) = (self.title.clone(), self.layer.clone());
        Drawing { title, notes, layer, lines: self.lines.iter().map(line).collect(), scale }
    }

    /// As the text of a file; `None` where there is nothing to draw. `scale` counts for drawings: 50 for 1:50.
    pub fn write(&self, format: Format, pack: &PackName, point: &Uncertainty, scale: f64) -> Option<String> {
        match format {
            Format::Svg => self.drawing(pack, point, scale).to_svg(),
            Format::Dxf => self.drawing(pack, point, scale).to_dxf(),
            Format::Csv => Some(self.csv()),
            Format::GeoJson => Some(self.geojson(pack)),
            Format::Json => serde_json::to_string_pretty(&self.data(pack, point)).ok(),
        }
    }

    /// One row per point, every digit of the doubles.
    fn csv(&self) -> String {
        let mut out = String::from("line,point,x,y,z,u,v\n");
        for (l, line) in self.lines.iter().enumerate() {
            for (p, w) in line.world.iter().enumerate() {
                let DVec2 { x: u, y: v } = line.flat.get(p % line.flat.len().max(1)).copied().unwrap_or_default();
                let _ = writeln!(out, "{l},{p},{:?},{:?},{:?},{u:?},{v:?}", w[0], w[1], w[2]);
            }
        }
        out
    }

    fn data(&self, pack: &PackName, point: &Uncertainty) -> Value {
        let each: Vec<Value> =
            (self.lines.iter()).map(|l| json!({ "closed": l.closed, "flat": l.flat, "world": l.world })).collect();
        json!({
            "title": self.title,
            "pack": pack.identity,
            "crs": pack.crs,
            "unit": "m",
            "uncertainty": point,
            "lines": each,
        })
    }

    /// Coordinates are those of the model, with its reference system named as the 2008 edition of GeoJSON does (RFC 7946 knows only WGS 84).
    fn geojson(&self, pack: &PackName) -> String {
        let feature = |l: &Line| {
            json!({
                "type": "Feature",
                "properties": { "layer": self.layer, "closed": l.closed, "elevation": l.elevation },
                "geometry": { "type": "LineString", "coordinates": l.world },
            })
        };
        let features: Vec<Value> = self.lines.iter().map(feature).collect();
        let mut all = json!({ "type": "FeatureCollection", "features": features });
        if let Some(code) = pack.crs.as_deref().and_then(|c| c.strip_prefix("EPSG:")) {
            all["crs"] = json!({ "type": "name", "properties": { "name": format!("urn:ogc:def:crs:EPSG::{code}") } });
        }
        all.to_string()
    }
}
