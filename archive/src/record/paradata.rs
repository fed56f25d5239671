//! `metadata/paradata.json`: what was captured, how, by which tools, and what was done since, with the hashes of what went in and came out.

use super::Publication;
use crate::layout::{ANNOTATIONS, COLOUR_REPORT, HOLES, TILESET};
use serde_json::{Value, json};

pub(super) fn paradata(p: &Publication) -> Value {
    let m = &p.metadata;
    let pack = &p.of_pack;
    let mut all = json!({
        "about": "What was captured, how, by which tools and with which decisions; hashes are SHA-256 unless named otherwise",
        "title": m.title,
        "capture": m.capture,
        "creators": m.creators,
        "contributors": m.contributors,
        "build": {
            "tool": pack.tool,
            "options": pack.options,
            "sources": pack.sources,
            "source_units": pack.source_units,
            "source_up": pack.source_up,
            "lattice_step_m": pack.lattice_step,
            "repairs": pack.repairs,
            "note": "The finest level is the source mesh with every vertex on a lattice of this step; repairs counts what was changed or left out",
        },
        "pack": {
            "file": p.pack_file(),
            "bytes": p.pack.bytes,
            "sha256": p.pack.sha256,
            "identity": p.pack.identity,
            "triangles": p.figures.triangles,
            "vertices": p.figures.vertices,
            "border_edges": pack.border_edges,
            "median_edge_m": pack.median_edge,
            "bounds_m": p.figures.bounds,
            "crs": p.figures.crs,
            "capture_accuracy_m": p.figures.accuracy,
        },
        "preview": p.preview.map(|v| json!({ "triangles": v.triangles, "error_m": v.error })),
        "notes": p.notes.as_ref().map(|n| json!({ "file": ANNOTATIONS, "sha256": n.sha256, "count": n.notes.notes.len() })),
        "holes": p.holes.as_ref().map(|n| json!({ "file": HOLES, "sha256": n.sha256, "count": n.count })),
        "tiles": p.tiles.as_ref().map(|t| json!({ "file": TILESET, "sha256": t.sha256, "count": t.tiles, "bytes": t.bytes,
            "compressed": t.is_compressed, "on_globe": t.is_on_globe, "geoid_offset_m": t.geoid_offset })),
        "publication": {
            "tool": p.tool,
            "version": p.version,
            "date": p.published,
            "note": p.note,
            "location_redacted": p.location_redacted,
        },
    });
    if let Some(colours) = &p.colours {
        // Each photograph with its pose, residual and share; those left out with the reason.
        let mut about = json!(colours.report);
        about["file"] = json!(COLOUR_REPORT);
        about["sha256"] = json!(colours.sha256);
        if let Some((included, rights)) = p.photographs() {
            about["included_photographs"] = json!({ "count": included.photographs, "masks": included.masks, "bytes": included.bytes, "smaller_copies": included.copies, "rights": rights });
        }
        all["colours"] = about;
    }
    if let Some([registration, instrument]) = pack.capture_parts() {
        all["pack"]["capture_registration_m"] = json!(registration);
        all["pack"]["capture_instrument_m"] = json!(instrument);
    }
    all
}
