//! Checks that a version announced as having no location really has none; the server does not know the true one.
//!
//! A pack that `kilwa publish --redact-location` writes stands with its middle at zero, or in the middle of the cell that was announced, on height
//! zero, and names neither reference system nor source files. Channels must be announced and hold no coordinates. No text states
//! coordinates. The pack is, byte for byte, what this program would write, and its numbers are plausible ([`written`]). Pictures,
//! preview and world file are what `kilwa publish` writes ([`plain`]), and are placed where the pack is.

use super::wire::Intent;
use super::{plain, written};
use glam::DVec3;
use kilwa_archive::layout::PREVIEW;
use kilwa_archive::location::{Location, channels};
use kilwa_archive::metadata::plain_accuracy;
use kilwa_pack::{Metadata, Reader, Source};
use std::io;
use std::path::Path;

/// Largest cell, metres: as `kilwa publish` takes it.
const CELL_MAX: f64 = 1e7;
/// Lattice units by which a middle may be off: it is rounded to whole ones.
const ROUNDING: f64 = 1.5;
/// How far from the model preview and world file may reach, in diagonals of its box.
const REACH: f64 = 4.0;

/// What can be seen without the files.
///
/// # Errors
/// What gives the location away, and what to do.
pub(super) fn check_intent(intent: &Intent) -> Result<(), String> {
    if !intent.location_redacted {
        return if intent.location_cell.is_none() && intent.kept_channels.is_empty() {
            Ok(())
        } else {
            Err("location_cell and kept_channels are for versions without their location".to_owned())
        };
    }
    if let Some(cell) = intent.location_cell.filter(|c| !(c.is_finite() && *c > 0.0 && *c <= CELL_MAX)) {
        return Err(format!("location_cell: {cell} m is not a valid cell size; at most {CELL_MAX} m is allowed"));
    }
    let unknown = unknown(intent);
    if let Some((field, finding)) = intent.metadata.giving_away(&unknown) {
        return Err(format!("metadata: {field}: {finding}"));
    }
    let slug = [("slug", &intent.slug)].into_iter();
    let mut names = slug.chain(intent.kept_channels.iter().map(|name| ("the name of a channel", name)));
    if let Some(Err(what)) = intent.metadata.capture.as_ref().and_then(|c| c.accuracy).map(plain_accuracy) {
        return Err(format!("metadata: capture.accuracy {what}"));
    }
    let note = || Some(("the note of the version", unknown.find(&intent.note)?));
    match note().or_else(|| names.find_map(|(what, name)| Some((what, unknown.find_in_name(name)?)))) {
        Some((what, finding)) => Err(format!("{what}: {finding}")),
        None => Ok(()),
    }
}

/// What texts are searched for: whichever place; a cell comes with its reference system.
fn unknown(intent: &Intent) -> Location {
    let unknown = Location::unknown();
    if intent.location_cell.is_some() { unknown.with_known_system() } else { unknown }
}

/// What can be seen in the pack, whose chunks were verified.
///
/// # Errors
/// As [`check_intent`].
pub(super) fn check_pack<S: Source + Sync>(intent: &Intent, reader: &Reader<S>) -> Result<(), String> {
    let metadata = reader.metadata();
    check_place(intent, reader)?;
    if !metadata.sources.is_empty() {
        return Err(claimed("its pack names source files, which are often named after the place"));
    }
    let mut value = serde_json::to_value(metadata).map_err(|e| e.to_string())?;
    if let Some(map) = value.as_object_mut() {
        map.remove("crs");
    }
    if let Some((field, finding)) = unknown(intent).find_in_json(&value, &|_| false) {
        return Err(claimed(&format!("{field} of its pack: {finding}")));
    }
    if let Some(other) = metadata.scalars.iter().find(|s| !intent.kept_channels.contains(&s.name)) {
        return Err(claimed(&format!(
            "its pack has the scalar channel {:?}, which was not announced as kept",
            other.name
        )));
    }
    written::check(reader).map_err(|what| claimed(&what))?;
    let surveyed = channels::survey(reader).map_err(|e| format!("the pack: {e}"))?;
    let revealing = surveyed.iter().find_map(|c| Some((&c.name, c.gives_away(&Location::unknown())?)));
    match revealing {
        Some((name, why)) => Err(claimed(&format!("its scalar channel {name:?} {why}"))),
        None => Ok(()),
    }
}

/// The middle of all that the directory lists is where `kilwa publish` puts it.
fn check_place<S: Source>(intent: &Intent, reader: &Reader<S>) -> Result<(), String> {
    let (lattice, metadata) = (reader.header().lattice, reader.metadata());
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for bounds in reader.entries().iter().map(|e| &e.bounds).filter(|b| !b.is_empty()) {
        (min, max) = (min.min(bounds.min.as_dvec3()), max.max(bounds.max.as_dvec3()));
    }
    if min.x > max.x {
        return Err("the pack contains no triangles".to_owned());
    }
    let (low, high, tolerance) =
        (lattice.world_from_steps(min), lattice.world_from_steps(max), lattice.step() * ROUNDING);
    let middle = [0, 1].map(|k| f64::midpoint(low[k], high[k]));
    let wanted = match intent.location_cell {
        None => [0.0; 2],
        Some(cell) => {
            let widest = (0..2).map(|k| high[k] - low[k]).fold(0.0, f64::max);
            if cell <= widest {
                return Err(claimed(&format!("a cell of {cell} m does not hide a model {widest:.0} m wide")));
            }
            middle.map(|v| ((v / cell).floor() + 0.5) * cell)
        }
    };
    if intent.location_cell.is_none() && metadata.crs.is_some() {
        return Err(claimed("its pack names a reference system"));
    }
    if (0..2).any(|k| (middle[k] - wanted[k]).abs() > tolerance) || low[2].abs() > tolerance {
        let at = format!("{:.3} {:.3}, on height {:.3}", middle[0], middle[1], low[2]);
        let should = format!("{} {}, on height 0", wanted[0], wanted[1]);
        return Err(claimed(&format!("the middle of its pack is at {at} m, not at {should}")));
    }
    let reach = (0..3).map(|k| high[k] - low[k]).fold(tolerance, f64::max);
    let corners = (0..3)
        .all(|k| (metadata.bounds_min[k] - low[k]).abs() <= reach && (metadata.bounds_max[k] - high[k]).abs() <= reach);
    if corners { Ok(()) } else { Err(claimed("the metadata of its pack give a different position from its lattice")) }
}

/// What was found although the location is announced as withheld.
fn claimed(what: &str) -> String {
    format!(
        "the version is announced as having no location (--redact-location), but {what}; publish it with this version of kilwa, which removes the location"
    )
}

/// What can be seen in a file that is no pack.
///
/// # Errors
/// An [`io::Error`] of kind `InvalidData` where it gives the location away.
pub(super) fn check_file(path: &str, at: &Path, of_pack: &Metadata) -> io::Result<()> {
    let is_picture = |ending: &str| Path::new(path).extension().is_some_and(|e| e == ending);
    let found = if path == PREVIEW {
        plain::check_preview(&std::fs::read(at)?, of_pack)
    } else if is_picture("jpg") {
        plain::check_jpeg(path, &std::fs::read(at)?)
    } else if is_picture("png") {
        plain::check_png(&std::fs::read(at)?)
    } else if is_picture("pgw") {
        check_world(&std::fs::read_to_string(at)?, of_pack)
    } else {
        Ok(())
    };
    found.map_err(|what| io::Error::new(io::ErrorKind::InvalidData, claimed(&format!("{path} {what}"))))
}

/// Length of the diagonal of the pack's box.
fn diagonal(of_pack: &Metadata) -> f64 {
    of_pack.bounds_max.distance(of_pack.bounds_min)
}

/// Whether a coordinate is at or around the pack.
fn is_around(of_pack: &Metadata, axis: usize, value: f64) -> bool {
    let reach = diagonal(of_pack) * REACH;
    value >= of_pack.bounds_min[axis] - reach && value <= of_pack.bounds_max[axis] + reach
}

fn check_world(text: &str, of_pack: &Metadata) -> Result<(), String> {
    let numbers: Vec<f64> = text.lines().filter_map(|l| l.trim().parse().ok()).collect();
    let [scale, 0.0, 0.0, down, x, y] = numbers[..] else {
        return Err("is not a world file of a plan".to_owned());
    };
    let written: String = numbers.iter().flat_map(|n| [format!("{n:?}"), "\n".to_owned()]).collect();
    if text != written || scale <= 0.0 || scale > diagonal(of_pack).max(1.0) || down != -scale {
        return Err("is not in the form in which kilwa publish writes it".to_owned());
    }
    if is_around(of_pack, 0, x) && is_around(of_pack, 1, y) {
        Ok(())
    } else {
        Err("places the plan somewhere else than the pack".to_owned())
    }
}
