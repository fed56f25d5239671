//! What a measurement prints: readings with their uncertainty, for people or as JSON with every digit.

use super::Subject;
use super::place::distances;
use kilwa_measure::{Leaves, Outcome, Uncertainty};
use kilwa_pack::plural::{counted, plural};
use serde_json::{Value, json};
use std::io::Write;

/// Print it.
pub(super) fn print(mut outcome: Outcome, s: &Subject, as_json: bool) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let index = s.leaves.index();
    if as_json {
        if let Some(read) = outcome.read {
            outcome.add("read", json!(read));
        }
        outcome.add("tool", json!(outcome.task.tool));
        outcome.add("readings", json!(outcome.readings));
        outcome.add("uncertainty", json!(outcome.uncertainty));
        outcome.add("pack", json!({ "title": index.metadata().title, "identity": index.identity() }));
        let printed: Vec<Value> =
            outcome.printed(s.unit).iter().map(|(name, text)| json!({ "name": name, "text": text })).collect();
        outcome.add("printed", json!(printed));
        writeln!(out, "{}", crate::terminal::json_text(&Value::Object(outcome.details))?)?;
        return Ok(());
    }
    let width = outcome.readings.iter().map(|r| r.name.chars().count()).max().unwrap_or(0);
    for (name, text) in outcome.printed(s.unit) {
        writeln!(out, "{name:width$} {text}")?;
    }
    for words in &outcome.remarks {
        writeln!(out, "{words}")?;
    }
    if let Some(words) = distances(&away(&outcome), s.given) {
        writeln!(out, "{words}")?;
    }
    if let Some(path) = outcome.details.get("output").and_then(Value::as_str) {
        writeln!(out, "written to {path}")?;
    }
    if let Some(read) = outcome.read {
        let share = 100.0 * read.bytes as f64 / read.of_bytes.max(1) as f64;
        let bytes = crate::info::grouped(read.bytes);
        writeln!(
            out,
            "read {} of {}, {bytes} {} ({share:.1} % of the pack)",
            read.chunks,
            counted(read.of_chunks, "chunk", "chunks"),
            plural(read.bytes, "byte", "bytes")
        )?;
    }
    writeln!(out, "standard uncertainty of a coordinate: {}", parts(&outcome.uncertainty))?;
    Ok(())
}

/// How far each position that was given is from the surface, metres. JSON has no infinity, but null.
fn away(outcome: &Outcome) -> Vec<f64> {
    let points = outcome.details.get("points").and_then(Value::as_array);
    points.into_iter().flatten().map(|p| p["away"].as_f64().unwrap_or(f64::INFINITY)).collect()
}

/// What the uncertainty of a coordinate is made of.
fn parts(u: &Uncertainty) -> String {
    let lattice = format!("lattice {:.3e} m", u.lattice);
    let pointing = (u.pointing > 0.0).then(|| format!("pointing {} m", u.pointing));
    let capture = u.capture.map(|c| match u.registration.zip(u.instrument) {
        Some((registration, instrument)) => {
            let [all, registration, instrument] = [c, registration, instrument].map(millimetres);
            format!("capture {all} (registration {registration}, instrument {instrument})")
        }
        None => format!("capture {c} m"),
    });
    match (capture, pointing) {
        (Some(capture), None) => format!("{lattice} and {capture}"),
        (Some(capture), Some(pointing)) => format!("{lattice}, {pointing} and {capture}"),
        (None, None) => format!("{lattice}, grid only; survey accuracy unknown"),
        (None, Some(pointing)) => format!("{lattice} and {pointing}, grid and pointing only; survey accuracy unknown"),
    }
}

/// With two significant digits.
fn millimetres(metres: f64) -> String {
    let mm = metres * 1e3;
    let digits = if mm > 0.0 { (1.0 - mm.log10().floor()).clamp(0.0, 12.0) as usize } else { 0 };
    format!("{mm:.digits$} mm")
}
