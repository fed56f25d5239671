//! Files that sections, profiles and contours are written to: SVG and DXF to scale, CSV, JSON and GeoJSON.

use super::Subject;
use super::saved::write_whole;
use kilwa_measure::Drawing;
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Where a drawing goes.
#[derive(clap::Args)]
pub(crate) struct OutputArgs {
    /// The file to write; its ending says the format: .svg, .dxf, .csv, .json or .geojson.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Scale of the drawing on paper, for example 1:50.
    #[arg(long, default_value = "1:50", value_parser = scale)]
    scale: f64,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

fn scale(text: &str) -> Result<f64, String> {
    let number = text.strip_prefix("1:").unwrap_or(text).parse::<f64>();
    match number {
        Ok(n) if n.is_finite() && (0.001..=1e7).contains(&n) => Ok(n),
        _ => Err("a scale such as 1:50 is wanted".to_owned()),
    }
}

/// What a line is in each format.
pub(super) struct Lines {
    /// As a flat drawing.
    pub(super) drawing: Drawing,
    /// In world coordinates; closed lines repeat their first point.
    pub(super) world: Vec<Vec<[f64; 3]>>,
}

impl OutputArgs {
    /// No file.
    pub(super) fn none() -> Self {
        Self { output: None, scale: 50.0, force: false }
    }

    /// Say what would stop the writing, before the work is done.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        let Some(path) = &self.output else { return Ok(()) };
        Self::format(path)?;
        anyhow::ensure!(self.force || !path.exists(), "{} exists; --force replaces it", path.display());
        let folder = folder(path);
        anyhow::ensure!(folder.is_dir(), "there is no folder {}; make it first", folder.display());
        Ok(())
    }

    /// Write; the path, where one was asked for.
    pub(super) fn write(&self, s: &Subject, mut lines: Lines, title: &str) -> anyhow::Result<Option<&Path>> {
        let Some(path) = &self.output else { return Ok(None) };
        lines.drawing.scale = self.scale;
        title.clone_into(&mut lines.drawing.title);
        let metadata = s.pack.metadata();
        lines.drawing.notes = vec![
            format!("{} · pack {}", metadata.title, s.pack.identity()),
            format!("coordinates {}", metadata.crs.as_deref().unwrap_or("local")),
            match s.point.capture {
                Some(c) => format!("standard uncertainty of a point: capture {c} m, lattice {:.1e} m", s.point.lattice),
                None => format!("capture accuracy unknown, lattice {:.1e} m", s.point.lattice),
            },
        ];
        let nothing = || anyhow::anyhow!("nothing to draw");
        let text = match Self::format(path)? {
            "svg" => lines.drawing.to_svg().ok_or_else(nothing)?,
            "dxf" => lines.drawing.to_dxf().ok_or_else(nothing)?,
            "csv" => csv(&lines),
            "geojson" => geojson(s, &lines),
            _ => serde_json::to_string_pretty(&data(s, &lines))?,
        };
        write_whole(path, &text, self.force)?;
        Ok(Some(path))
    }

    fn format(path: &Path) -> anyhow::Result<&'static str> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let known = ["svg", "dxf", "csv", "json", "geojson"];
        known.into_iter().find(|k| Some(*k) == ending.as_deref()).ok_or_else(|| {
            anyhow::anyhow!("{}: the ending says the format, one of .svg, .dxf, .csv, .json, .geojson", path.display())
        })
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// One row per point, every digit of the doubles.
fn csv(lines: &Lines) -> String {
    let mut out = String::from("line,point,x,y,z,u,v\n");
    for (l, (world, flat)) in lines.world.iter().zip(&lines.drawing.lines).enumerate() {
        for (p, w) in world.iter().enumerate() {
            let [u, v] = flat.points[p % flat.points.len().max(1)];
            let _ = writeln!(out, "{l},{p},{:?},{:?},{:?},{u:?},{v:?}", w[0], w[1], w[2]);
        }
    }
    out
}

fn data(s: &Subject, lines: &Lines) -> serde_json::Value {
    let each: Vec<serde_json::Value> = lines
        .drawing
        .lines
        .iter()
        .zip(&lines.world)
        .map(|(flat, world)| json!({ "closed": flat.closed, "flat": flat.points, "world": world }))
        .collect();
    json!({
        "title": lines.drawing.title,
        "pack": s.pack.identity(),
        "crs": s.pack.metadata().crs,
        "unit": "m",
        "uncertainty": s.point,
        "lines": each,
    })
}

/// Coordinates are those of the model, with its reference system named as the 2008 edition of GeoJSON does (RFC 7946 knows only WGS 84).
fn geojson(s: &Subject, lines: &Lines) -> String {
    let features: Vec<serde_json::Value> = lines
        .drawing
        .lines
        .iter()
        .zip(&lines.world)
        .map(|(flat, world)| {
            json!({
                "type": "Feature",
                "properties": { "layer": lines.drawing.layer, "closed": flat.closed, "elevation": flat.elevation },
                "geometry": { "type": "LineString", "coordinates": world },
            })
        })
        .collect();
    let mut all = json!({ "type": "FeatureCollection", "features": features });
    if let Some(code) = s.pack.metadata().crs.as_deref().and_then(|c| c.strip_prefix("EPSG:")) {
        all["crs"] = json!({ "type": "name", "properties": { "name": format!("urn:ogc:def:crs:EPSG::{code}") } });
    }
    all.to_string()
}
