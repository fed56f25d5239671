//! Whether a version that is said to be published without its location is: the server does not know the true one, and takes nobody's word for it.
//!
//! A pack that `kilwa publish --redact-location` writes stands with its middle at zero, or in the middle of the cell that was announced, on height
//! zero, and names neither reference system nor source files. Channels must be announced and hold no coordinates. No text states
//! coordinates. Pictures carry pixels only; preview and world file stand where the pack does.

use super::files::glb_json;
use super::wire::Intent;
use crate::object::layout::PREVIEW;
use crate::object::location::{Location, channels};
use kilwa_pack::{Metadata, Reader, Source};
use serde_json::Value;
use std::io;
use std::path::Path;

/// Largest cell, metres: as `kilwa publish` takes it.
const CELL_MAX: f64 = 1e7;
/// Lattice steps by which a middle may be off: it is rounded to whole ones.
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
        return Err(format!("location_cell: {cell} m is no side of a cell; up to {CELL_MAX} are possible"));
    }
    let unknown = unknown(intent);
    if let Some((field, finding)) = intent.metadata.giving_away(&unknown) {
        return Err(format!("metadata: {field}: {finding}"));
    }
    let texts = [("the note of the version", &intent.note)].into_iter();
    let names = intent.kept_channels.iter().map(|name| ("the name of a channel", name));
    match texts.chain(names).find_map(|(what, text)| Some((what, unknown.find(text)?))) {
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
    let surveyed = channels::survey(reader).map_err(|e| format!("the pack: {e}"))?;
    let told = surveyed.iter().find_map(|c| Some((&c.name, c.gives_away(&Location::unknown())?)));
    match told {
        Some((name, why)) => Err(claimed(&format!("its scalar channel {name:?} {why}"))),
        None => Ok(()),
    }
}

/// The middle of all that the directory lists is where `kilwa publish` puts it.
fn check_place<S: Source>(intent: &Intent, reader: &Reader<S>) -> Result<(), String> {
    let (lattice, metadata) = (reader.header().lattice, reader.metadata());
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for bounds in reader.entries().iter().map(|e| &e.bounds).filter(|b| !b.is_empty()) {
        for k in 0..3 {
            min[k] = min[k].min(f64::from(bounds.min[k]));
            max[k] = max[k].max(f64::from(bounds.max[k]));
        }
    }
    if min[0] > max[0] {
        return Err("the pack holds no triangle".to_owned());
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
        return Err(claimed(&format!("the middle of its pack is at {at} m, and not at {should}")));
    }
    let reach = (0..3).map(|k| high[k] - low[k]).fold(tolerance, f64::max);
    let corners = (0..3)
        .all(|k| (metadata.bounds_min[k] - low[k]).abs() <= reach && (metadata.bounds_max[k] - high[k]).abs() <= reach);
    if corners { Ok(()) } else { Err(claimed("the metadata of its pack tell another place than its lattice")) }
}

/// What was found although the location is said to be withheld.
fn claimed(what: &str) -> String {
    format!(
        "the version is said to be without its location (--redact-location), and {what}; publish it with this version of kilwa, which takes the location out"
    )
}

/// What can be seen in a file that is no pack.
///
/// # Errors
/// An [`io::Error`] of kind `InvalidData` where it gives the location away.
pub(super) fn check_file(path: &str, at: &Path, of_pack: &Metadata) -> io::Result<()> {
    let is_picture = |ending: &str| Path::new(path).extension().is_some_and(|e| e == ending);
    let found = if path == PREVIEW {
        check_preview(&std::fs::read(at)?, of_pack)
    } else if is_picture("jpg") {
        plain_jpeg(&std::fs::read(at)?)
    } else if is_picture("png") {
        plain_png(&std::fs::read(at)?)
    } else if is_picture("pgw") {
        check_world(&std::fs::read_to_string(at)?, of_pack)
    } else {
        Ok(())
    };
    found.map_err(|what| io::Error::new(io::ErrorKind::InvalidData, claimed(&format!("{path} {what}"))))
}

/// Length of the diagonal of the pack's box.
fn diagonal(of_pack: &Metadata) -> f64 {
    (0..3).map(|k| (of_pack.bounds_max[k] - of_pack.bounds_min[k]).powi(2)).sum::<f64>().sqrt()
}

/// Whether a coordinate is at or around the pack.
fn is_around(of_pack: &Metadata, axis: usize, value: f64) -> bool {
    let reach = diagonal(of_pack) * REACH;
    value >= of_pack.bounds_min[axis] - reach && value <= of_pack.bounds_max[axis] + reach
}

fn check_world(text: &str, of_pack: &Metadata) -> Result<(), String> {
    let numbers: Vec<f64> = text.lines().filter_map(|l| l.trim().parse().ok()).collect();
    match numbers.get(4..6) {
        Some([x, y]) if is_around(of_pack, 0, *x) && is_around(of_pack, 1, *y) => Ok(()),
        _ => Err("places the plan somewhere else than the pack".to_owned()),
    }
}

fn check_preview(bytes: &[u8], of_pack: &Metadata) -> Result<(), String> {
    let value = glb_json(bytes)?;
    if let Some((field, finding)) = Location::unknown().find_in_json(&value, &|at| at == "extras.crs") {
        return Err(format!("has {field}: {finding}"));
    }
    let crs = value.pointer("/extras/crs").and_then(Value::as_str);
    if crs.is_some() && crs != of_pack.crs.as_deref() {
        return Err("names a reference system that the pack does not".to_owned());
    }
    let numbers = |v: &Value| -> Vec<f64> { v.as_array().into_iter().flatten().filter_map(Value::as_f64).collect() };
    let place = value.pointer("/extras/world_from_local_m").map(numbers).unwrap_or_default();
    if place.iter().enumerate().any(|(k, v)| k > 2 || !is_around(of_pack, k, *v)) {
        return Err("tells a place outside of the pack".to_owned());
    }
    // The preview stands at zero: nothing in it is larger than the model.
    let most = diagonal(of_pack) * REACH;
    let of = |list: &str, keys: &[&str]| -> Vec<f64> {
        let all = value.get(list).and_then(Value::as_array).into_iter().flatten();
        all.flat_map(|one| keys.iter().filter_map(|k| one.get(k)).flat_map(numbers).collect::<Vec<_>>()).collect()
    };
    let placed = of("nodes", &["translation", "matrix"]).into_iter().chain(of("accessors", &["min", "max"]));
    if placed.chain(positions(&value, bytes)).any(|v| v.abs() > most.max(1.0)) {
        return Err("has coordinates larger than the model".to_owned());
    }
    Ok(())
}

/// Coordinates of all vertices that are stored as floats.
fn positions<'a>(value: &'a Value, bytes: &'a [u8]) -> impl Iterator<Item = f64> + 'a {
    let number = |v: Option<&Value>| v.and_then(Value::as_u64).and_then(|n| usize::try_from(n).ok());
    let json = bytes.get(12..16).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes) as usize;
    let binary = bytes.get(28usize.saturating_add(json)..).unwrap_or_default();
    let primitives = value.get("meshes").and_then(Value::as_array).into_iter().flatten();
    let primitives = primitives.filter_map(|m| m.get("primitives")?.as_array()).flatten();
    let accessors =
        primitives.filter_map(move |p| value.get("accessors")?.get(number(p.pointer("/attributes/POSITION"))?));
    accessors.flat_map(move |accessor| {
        let view = number(accessor.get("bufferView")).and_then(|k| value.get("bufferViews")?.get(k));
        let part = |key: &str| number(view.and_then(|v| v.get(key)));
        let is_float = accessor.get("componentType").and_then(Value::as_u64) == Some(5126);
        let count = number(accessor.get("count")).filter(|_| is_float && view.is_some()).unwrap_or(0);
        let start = part("byteOffset").unwrap_or(0).saturating_add(number(accessor.get("byteOffset")).unwrap_or(0));
        let stride = part("byteStride").unwrap_or(12).max(1);
        let vertex = move |i: usize| binary.get(start.checked_add(i.checked_mul(stride)?)?..)?.get(..12);
        (0..count)
            .map_while(vertex)
            .flat_map(|v| v.chunks_exact(4))
            .filter_map(|b| Some(f64::from(f32::from_le_bytes(b.try_into().ok()?))))
    })
}

/// A JPEG of segments that hold pixels, and the JFIF header; nothing behind its end.
fn plain_jpeg(bytes: &[u8]) -> Result<(), String> {
    let damaged = || "is no JPEG that can be read".to_owned();
    let mut at = 2;
    loop {
        let (Some(0xff), Some(&marker)) = (bytes.get(at), bytes.get(at + 1)) else { return Err(damaged()) };
        if marker == 0xd9 {
            return if at + 2 == bytes.len() {
                Ok(())
            } else {
                Err("has something behind the end of the picture".to_owned())
            };
        }
        // JFIF, tables, frames and scans.
        if !matches!(marker, 0xe0 | 0xdb | 0xc4 | 0xdd | 0xc0..=0xc2 | 0xda) {
            return Err(format!("has metadata beside its pixels (segment {marker:02X})"));
        }
        let length =
            bytes.get(at + 2..at + 4).and_then(|b| b.try_into().ok()).map(u16::from_be_bytes).ok_or_else(damaged)?;
        if marker == 0xe0 && length != 16 {
            return Err("has metadata beside its pixels (segment E0)".to_owned());
        }
        at += 2 + usize::from(length);
        if marker == 0xda {
            // Entropy-coded data goes on to the next marker that is neither a stuffed zero nor a restart.
            let is_marker = |two: &[u8]| {
                two.first() == Some(&0xff) && two.get(1).is_some_and(|m| *m != 0 && !(0xd0..=0xd7).contains(m))
            };
            at += bytes.get(at..).and_then(|rest| rest.windows(2).position(is_marker)).ok_or_else(damaged)?;
        }
    }
}

/// A PNG of chunks that say how its pixels are to be shown.
fn plain_png(bytes: &[u8]) -> Result<(), String> {
    const CHUNKS: [&[u8; 4]; 10] =
        [b"IHDR", b"PLTE", b"IDAT", b"IEND", b"pHYs", b"sRGB", b"gAMA", b"cHRM", b"sBIT", b"tRNS"];
    let mut at = 8;
    while at < bytes.len() {
        let length = bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
        let (Some(length), Some(kind)) = (length, bytes.get(at + 4..at + 8)) else {
            return Err("is no PNG that can be read".to_owned());
        };
        if !CHUNKS.iter().any(|c| c.as_slice() == kind) {
            return Err(format!(
                "has metadata beside its pixels (chunk {})",
                String::from_utf8_lossy(kind).escape_default()
            ));
        }
        at = at.saturating_add(12).saturating_add(length as usize);
        if kind == b"IEND" {
            break;
        }
    }
    if at == bytes.len() { Ok(()) } else { Err("has something behind the end of the picture".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        for (kind, data) in chunks {
            bytes.extend_from_slice(&(data.len() as u32).to_be_bytes());
            bytes.extend_from_slice(*kind);
            bytes.extend_from_slice(data);
            bytes.extend_from_slice(&[0; 4]);
        }
        bytes
    }

    fn jpeg(segments: &[(u8, &[u8])]) -> Vec<u8> {
        let mut bytes = vec![0xff, 0xd8];
        for (marker, data) in segments {
            bytes.extend_from_slice(&[0xff, *marker]);
            bytes.extend_from_slice(&(data.len() as u16 + 2).to_be_bytes());
            bytes.extend_from_slice(data);
        }
        bytes.extend_from_slice(&[0xff, 0xda, 0, 2, 1, 2, 0xff, 0, 3, 0xff, 0xd0, 4, 0xff, 0xd9]);
        bytes
    }

    #[test]
    fn pictures_with_metadata_are_refused() {
        let jfif: (u8, &[u8]) = (0xe0, b"JFIF\0\x01\x01\0\0\x01\0\x01\0\0");
        assert_eq!(plain_jpeg(&jpeg(&[jfif, (0xdb, &[0; 65])])), Ok(()));
        for segment in [
            (0xe1, &b"Exif\0\0GPS"[..]),
            (0xe2, b"ICC_PROFILE"),
            (0xed, b"Photoshop"),
            (0xfe, b"-8.9577"),
            (0xe0, b"JFXX\0"),
        ] {
            assert!(plain_jpeg(&jpeg(&[jfif, segment])).unwrap_err().contains("metadata beside"), "{:x}", segment.0);
        }
        let mut behind = jpeg(&[jfif]);
        behind.extend_from_slice(b"565977");
        assert!(plain_jpeg(&behind).unwrap_err().contains("behind the end"));
        assert!(plain_jpeg(&jpeg(&[jfif])[..12]).is_err());

        let sound: [(&[u8; 4], &[u8]); 4] = [(b"IHDR", &[0; 13]), (b"pHYs", &[0; 9]), (b"IDAT", b"x"), (b"IEND", b"")];
        assert_eq!(plain_png(&png(&sound)), Ok(()));
        for kind in [b"tEXt", b"zTXt", b"iTXt", b"eXIf", b"tIME", b"prVt"] {
            let with = [&sound[..1], &[(kind, &b"565977"[..])], &sound[1..]].concat();
            assert!(plain_png(&png(&with)).unwrap_err().contains("metadata beside"), "{kind:?}");
        }
        let mut behind = png(&sound);
        behind.push(0);
        assert!(plain_png(&behind).is_err() && plain_png(&png(&sound)[..30]).is_err());
    }
}
