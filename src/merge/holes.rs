//! Reports the holes of a merged surface: a sentence, and a list as GeoJSON.

use crate::new_file::NewFile;
use kilwa_pack::plural::counted;
use kilwa_scan::merge::{Borders, Cause, Filled, Hole, Source};
use serde_json::{Value, json};
use std::path::Path;

/// The area of each cause over all holes, square metres, in the order of [`Cause::ALL`].
fn areas(borders: &Borders) -> [f64; 4] {
    let mut sums = [0.0; 4];
    for (sum, k) in sums.iter_mut().zip(0..) {
        // The sum of nothing is -0.
        *sum = borders.holes.iter().map(|hole| hole.causes[k]).sum::<f64>() + 0.0;
    }
    sums
}

/// The holes in a sentence.
pub(crate) fn sentence(borders: &Borders) -> String {
    let edges = format!("outer edges {:.1} m", borders.outline_length);
    if borders.holes.is_empty() {
        return format!("no holes; {edges}");
    }
    let areas = areas(borders);
    let count = counted(borders.holes.len(), "hole", "holes");
    let mut text = format!("{count} with a total area of {:.2} m²", areas.iter().sum::<f64>());
    let causes = ["seen by no station", "seen through (openings)", "measured but dropped", "with no return"];
    let parts: Vec<String> = causes
        .iter()
        .zip(areas)
        .filter(|(_, area)| *area >= 0.005)
        .map(|(cause, area)| format!("{area:.2} m² {cause}"))
        .collect();
    if !parts.is_empty() {
        text = format!("{text}: {}", parts.join(", "));
    }
    format!("{text}; {edges}")
}

/// The same as JSON.
pub(crate) fn summary(borders: &Borders) -> Value {
    let [unseen, free, dropped, no_return] = areas(borders);
    json!({
        "count": borders.holes.len(),
        "unseen_m2": unseen,
        "free_m2": free,
        "dropped_m2": dropped,
        "no_return_m2": no_return,
        "outlines": borders.outlines,
        "outline_m": borders.outline_length,
    })
}

/// What was filled, in a sentence.
pub(crate) fn filled_sentence(filled: &Filled) -> String {
    let Filled { holes, area, mesh_area, unclosed, unclosed_area, islands, openings, .. } = filled;
    let Filled { larger, larger_area, folded, folded_area, closed, triangles, .. } = filled;
    let mut text = format!("filled: {}, {area:.2} m² in total", counted(*holes, "hole", "holes"));
    if *mesh_area > 0.0 {
        text = format!("{text}, {mesh_area:.2} m² added from the mesh");
    }
    if *islands > 0 {
        text = format!("{text}, joined to {} inside them", counted(*islands, "island", "islands"));
    }
    if *closed > 0 {
        text = format!("{text}; {} closed to make the surface watertight", counted(*closed, "loop", "loops"));
    }
    let mut left = Vec::new();
    if *openings > 0 {
        left.push(counted(*openings, "opening", "openings").to_string());
    }
    if *larger > 0 {
        left.push(format!(
            "{} larger than --fill-max-area ({larger_area:.2} m² in total)",
            counted(*larger, "hole", "holes")
        ));
    }
    if *unclosed > 0 {
        let count = counted(*unclosed, "hole", "holes");
        left.push(format!("{count} that coarser voxels or the mesh did not close ({unclosed_area:.2} m² in total)"));
    }
    if *folded > 0 {
        left.push(format!("{} with a folded rim ({folded_area:.2} m² in total)", counted(*folded, "hole", "holes")));
    }
    if !left.is_empty() {
        text = format!("{text}; left open: {}", left.join(", "));
    }
    format!("{text}; {}", counted(*triangles, "triangle added", "triangles added"))
}

/// The same as JSON.
pub(crate) fn filled_summary(filled: &Filled) -> Value {
    json!({
        "holes": filled.holes,
        "area_m2": filled.area,
        "mesh_m2": filled.mesh_area,
        "islands": filled.islands,
        "openings": filled.openings,
        "larger": filled.larger,
        "larger_m2": filled.larger_area,
        "unclosed": filled.unclosed,
        "unclosed_m2": filled.unclosed_area,
        "folded": filled.folded,
        "folded_m2": filled.folded_area,
        "closed": filled.closed,
        "triangles": filled.triangles,
    })
}

/// A hole as a feature: its rim as a polygon in coordinates of the survey, x, y, z.
fn feature(number: usize, hole: &Hole) -> Value {
    let ring: Vec<[f64; 3]> = hole.rim.iter().chain(hole.rim.first()).map(glam::DVec3::to_array).collect();
    let causes: serde_json::Map<String, Value> =
        Cause::ALL.iter().zip(hole.causes).map(|(cause, area)| (cause.word().to_owned(), area.into())).collect();
    json!({
        "type": "Feature",
        "id": number + 1,
        "geometry": { "type": "Polygon", "coordinates": [ring] },
        "properties": {
            "cause": hole.cause().word(),
            "area_m2": hole.area,
            "rim_m": hole.length,
            "center": hole.center.to_array(),
            "areas_m2": causes,
            "filled": hole.filled.map(Source::word),
        },
    })
}

/// Write the list.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(borders: &Borders, crs: Option<&str>, path: &Path, replace: bool) -> anyhow::Result<()> {
    let features: Vec<Value> = borders.holes.iter().enumerate().map(|(k, hole)| feature(k, hole)).collect();
    let list = json!({
        "type": "FeatureCollection",
        "name": "holes",
        // Coordinates are those of the survey, not WGS 84 as RFC 7946 prescribes. Readers ignore unknown members.
        "axes": "x, y, z in the survey, metres",
        "crs_of_survey": crs,
        "features": features,
    });
    NewFile::write(path, &serde_json::to_vec(&list)?, replace)
}
