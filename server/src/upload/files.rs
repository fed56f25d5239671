//! What a file of an upload must be, by its name: nothing that a browser would run, nothing that leads elsewhere.
//!
//! Pictures must begin as what they are called and say their sizes; they are served with their type and `nosniff`, so that what follows
//! cannot become a page. A preview must be glTF 2.0 that is whole in itself. Nothing here decodes pixels. Notes and lists of holes must be byte for byte what
//! `kilwa publish` writes, so they contain nothing that was not checked.

use super::wire::AnnouncedFile;
use super::wire::AnnouncedPreview;
use glam::DVec3;
use kilwa_archive::ColourReport;
use kilwa_archive::colour_report::{COLOUR_REPORT_MAX, IncludedFile, PHOTOGRAPH_MAX};
use kilwa_archive::holes::HOLES_MAX;
use kilwa_archive::layout::{
    ANNOTATIONS, COLOUR_REPORT, DRAWINGS, HOLES, POSTER, PREVIEW, PREVIEW_MAX, THUMBNAILS, is_photograph,
};
use kilwa_archive::location::Location;
use kilwa_archive::notes::NOTES_MAX;
use kilwa_archive::{Holes, Notes};
use kilwa_pack::metadata::SourceFile;
use kilwa_pack::plural::{counted, plural};
use serde_json::Value;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Largest picture, bytes.
const PICTURE_MAX: u64 = 64 << 20;
/// Largest text, bytes.
const TEXT_MAX: u64 = 4096;

/// World file of the plan.
const WORLD: &str = "drawings/plan.pgw";

/// Whether a version made by `kilwa publish` has a file of this name that it hands over.
pub(super) fn is_expected(path: &str) -> bool {
    let drawing = path.strip_prefix(DRAWINGS).and_then(|p| p.strip_prefix('/')).and_then(|p| p.strip_suffix(".png"));
    path == POSTER
        || path == PREVIEW
        || path == WORLD
        || path == ANNOTATIONS
        || path == HOLES
        || path == COLOUR_REPORT
        || is_photograph(path)
        || THUMBNAILS.iter().any(|(name, _)| path == *name)
        || drawing.is_some_and(|d| ["plan", "north", "east", "south", "west"].contains(&d))
}

/// Most bytes of such a file.
pub(super) fn max_bytes(path: &str) -> u64 {
    match path {
        PREVIEW => PREVIEW_MAX,
        WORLD => TEXT_MAX,
        ANNOTATIONS => NOTES_MAX,
        HOLES => HOLES_MAX,
        COLOUR_REPORT => COLOUR_REPORT_MAX,
        path if is_photograph(path) => PHOTOGRAPH_MAX,
        _ => PICTURE_MAX,
    }
}

/// Check the content of a file that is no pack.
///
/// # Errors
/// What is wrong with it; an [`io::Error`] of kind `InvalidData` where it is the content.
pub(super) fn check(path: &str, at: &Path) -> io::Result<()> {
    let wrong = |what: &str| Err(io::Error::new(io::ErrorKind::InvalidData, format!("{path} is {what}")));
    let mut file = File::open(at)?;
    if path == WORLD {
        let mut text = String::new();
        file.take(TEXT_MAX).read_to_string(&mut text)?;
        let numbers = text.lines().filter(|l| l.trim().parse::<f64>().is_ok_and(f64::is_finite)).count();
        return if numbers == 6 && text.lines().count() == 6 {
            Ok(())
        } else {
            wrong("not a world file of six numbers")
        };
    }
    if [ANNOTATIONS, HOLES, COLOUR_REPORT].contains(&path) {
        // With the pack, by [`check_notes`], [`check_holes`] and [`check_colours`].
        return Ok(());
    }
    if path == PREVIEW {
        let mut bytes = Vec::new();
        file.take(PREVIEW_MAX + 1).read_to_end(&mut bytes)?;
        return match glb_json(&bytes) {
            Ok(_) => Ok(()),
            Err(why) => wrong(&format!("not a self-contained binary glTF 2.0: {why}")),
        };
    }
    let mut head = [0; 8];
    file.read_exact(&mut head)?;
    let is_png = head == *b"\x89PNG\r\n\x1a\n";
    let is_jpeg = head.starts_with(&[0xff, 0xd8, 0xff]);
    match path.rsplit('.').next() {
        Some("png") if is_png => Ok(()),
        Some("jpg") if is_jpeg => Ok(()),
        _ => wrong("not a picture of the type that its name states"),
    }
}

/// Check that the triangles and the error of a preview are those that were announced, because pages and records repeat them.
///
/// # Errors
/// As [`check`].
pub(super) fn check_announced(at: &Path, announced: AnnouncedPreview) -> io::Result<()> {
    let wrong = |what: String| io::Error::new(io::ErrorKind::InvalidData, format!("{PREVIEW} {what}"));
    let mut bytes = Vec::new();
    File::open(at)?.take(PREVIEW_MAX + 1).read_to_end(&mut bytes)?;
    let value = glb_json(&bytes).map_err(|why| wrong(format!("cannot be read: {why}")))?;
    let index = value.pointer("/meshes/0/primitives/0/indices").and_then(Value::as_u64);
    let corners = index.and_then(|i| value.pointer(&format!("/accessors/{i}/count"))?.as_u64());
    let error = value.pointer("/extras/certified_error_m").and_then(Value::as_f64);
    if corners.is_some() && corners == announced.triangles.checked_mul(3) && error == Some(announced.error) {
        return Ok(());
    }
    let written = |n: Option<f64>| n.map_or("nothing".to_owned(), |n| n.to_string());
    Err(wrong(format!(
        "has {} with an error of {} m, but {} with an error of {} m {} announced; use the same version of kilwa on both sides",
        counted(corners.unwrap_or_default() / 3, "triangle", "triangles"),
        written(error),
        counted(announced.triangles, "triangle", "triangles"),
        announced.error,
        plural(announced.triangles, "was", "were")
    )))
}

/// What notes belong to.
pub(super) struct Noted<'a> {
    /// The box of the pack, metres.
    pub(super) bounds: [DVec3; 2],
    /// File name and identity of the pack.
    pub(super) pack: (&'a str, &'a str),
    /// Whether nothing in them may reveal the location.
    pub(super) location_redacted: bool,
}

/// Check the notes of a version.
///
/// # Errors
/// As [`check`].
pub(super) fn check_notes(at: &Path, noted: &Noted<'_>) -> io::Result<()> {
    let wrong = |what: String| io::Error::new(io::ErrorKind::InvalidData, format!("{ANNOTATIONS}: {what}"));
    let mut bytes = Vec::new();
    File::open(at)?.take(NOTES_MAX + 1).read_to_end(&mut bytes)?;
    let notes = Notes::parse(&bytes).map_err(|e| wrong(e.to_string()))?;
    if noted.location_redacted {
        notes.check_words(&Location::unknown()).map_err(|e| wrong(e.to_string()))?;
    }
    notes.within(noted.bounds[0], noted.bounds[1]).map_err(|e| wrong(e.to_string()))?;
    let notes = if noted.location_redacted { notes.without_place(DVec3::ZERO, &[]) } else { notes };
    let written = notes.to_bytes(noted.pack.0, noted.pack.1).map_err(|e| wrong(e.to_string()))?;
    if notes.left_out == 0 && written == bytes {
        return Ok(());
    }
    let hidden = if noted.location_redacted { ", or with something in them that may reveal the location" } else { "" };
    Err(wrong(format!(
        "the notes are not in the form in which kilwa publish writes them{hidden}; use the same version of kilwa on both sides"
    )))
}

/// Check the list of holes of a version whose pack has this box, metres; without its location, the list states no reference system.
///
/// # Errors
/// As [`check`].
pub(super) fn check_holes(at: &Path, [min, max]: [DVec3; 2], location_redacted: bool) -> io::Result<()> {
    let wrong = |what: String| io::Error::new(io::ErrorKind::InvalidData, format!("{HOLES}: {what}"));
    let mut bytes = Vec::new();
    File::open(at)?.take(HOLES_MAX + 1).read_to_end(&mut bytes)?;
    let holes = Holes::parse(&bytes).map_err(|e| wrong(e.to_string()))?;
    holes.within(min, max).map_err(|e| wrong(e.to_string()))?;
    let holes = if location_redacted { holes.without_place(DVec3::ZERO) } else { holes };
    if holes.to_bytes().is_ok_and(|written| written == bytes) {
        return Ok(());
    }
    let hidden = if location_redacted { ", or names a reference system" } else { "" };
    Err(wrong(format!(
        "the list is not in the form in which kilwa publish writes it{hidden}; use the same version of kilwa on both sides"
    )))
}

/// Check the colour report of a version with these files, whose pack has these sources: it names all photographs and masks, and nothing else.
///
/// # Errors
/// As [`check`].
pub(super) fn check_colours(at: &Path, sources: &[SourceFile], files: &[AnnouncedFile]) -> io::Result<()> {
    let wrong = |what: String| io::Error::new(io::ErrorKind::InvalidData, format!("{COLOUR_REPORT}: {what}"));
    let mut bytes = Vec::new();
    File::open(at)?.take(COLOUR_REPORT_MAX + 1).read_to_end(&mut bytes)?;
    let report = ColourReport::parse(&bytes).map_err(|e| wrong(e.to_string()))?;
    report.same_photographs(sources).map_err(|e| wrong(e.to_string()))?;
    if !report.to_bytes().is_ok_and(|written| written == bytes) {
        let what = "the report is not in the form in which kilwa publish writes it; use the same version of kilwa on both sides";
        return Err(wrong(what.to_owned()));
    }
    let sent = files.iter().filter(|file| is_photograph(&file.path));
    let mut sent: Vec<_> = sent.map(|f| IncludedFile { path: &f.path, bytes: f.bytes, sha256: &f.sha256 }).collect();
    let mut named = report.files();
    sent.sort_by_key(|file| file.path);
    named.sort_by_key(|file| file.path);
    if sent == named {
        return Ok(());
    }
    let other =
        sent.iter().find(|file| !named.contains(file)).or_else(|| named.iter().find(|file| !sent.contains(file)));
    let path = other.map_or("", |file| file.path);
    Err(wrong(format!("the photographs that were sent are not those that it names: {path}")))
}

/// The JSON of a binary glTF 2.0 that is whole in itself: header and chunks of the right lengths, a chunk of JSON and at most one of binary data,
/// no key twice, and nothing in it that leads elsewhere, extensions and extras included.
pub(super) fn glb_json(bytes: &[u8]) -> Result<Value, String> {
    const JSON: u32 = 0x4e4f_534a;
    const BIN: u32 = 0x004e_4942;
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    if bytes.get(..4) != Some(b"glTF") || word(4) != Some(2) || word(8) != u32::try_from(bytes.len()).ok() {
        return Err("its header is wrong".to_owned());
    }
    let chunk = |at: usize, kind: u32| {
        let length = word(at).filter(|_| word(at + 4) == Some(kind))?;
        bytes.get(at + 8..(at + 8).checked_add(length as usize)?)
    };
    let json = chunk(12, JSON).ok_or("its first chunk is not JSON")?;
    let end = 20 + json.len();
    let binary =
        if end < bytes.len() { chunk(end, BIN).ok_or("no binary chunk follows its JSON")?.len() + 8 } else { 0 };
    if end + binary != bytes.len() {
        return Err("something follows its chunks".to_owned());
    }
    let value: Value = kilwa_pack::json::from_slice(json).map_err(|e| e.to_string())?;
    if value.get("asset").is_none() {
        return Err("it has no \"asset\"".to_owned());
    }
    match address_in(&value, "") {
        Some(at) => Err(format!("{at} refers to another file or site; a preview must contain all of its data")),
        None => Ok(value),
    }
}

/// Where a value has an address: under a key that holds one in glTF or an extension of it, or a text that is one. No deeper than the parser goes.
fn address_in(value: &Value, at: &str) -> Option<String> {
    const KEYS: [&str; 4] = ["uri", "url", "href", "src"];
    match value {
        Value::Object(map) => map.iter().find_map(|(key, value)| {
            let below = format!("{at}/{key}");
            let is_key = KEYS.iter().any(|k| key.eq_ignore_ascii_case(k));
            if is_key || is_address(key) { Some(below) } else { address_in(value, &below) }
        }),
        Value::Array(list) => list.iter().enumerate().find_map(|(i, value)| address_in(value, &format!("{at}/{i}"))),
        Value::String(text) if is_address(text) => Some(at.to_owned()),
        _ => None,
    }
}

/// Whether a text holds an address of another file or site.
fn is_address(text: &str) -> bool {
    let lower = text.trim_start().to_ascii_lowercase();
    lower.contains("://")
        || ["//", "data:", "file:", "javascript:", "blob:", "\\\\"].iter().any(|start| lower.starts_with(start))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_a_version_are_expected() {
        for good in [
            "poster.jpg",
            "poster-600.jpg",
            "drawings/north.png",
            "drawings/plan.pgw",
            "preview.glb",
            "annotations.json",
            "holes.geojson",
        ] {
            assert!(is_expected(good), "{good}");
        }
        for bad in [
            "index.html",
            "manifest.json",
            "viewer/boot.js",
            "../poster.jpg",
            "drawings/../x.png",
            "drawings/x.png",
            "/poster.jpg",
            "metadata/dc.xml",
            "iiif/annotations.json",
            "checksums.sha256",
            "poster.jpg/",
            "drawings/plan.svg",
            "",
        ] {
            assert!(!is_expected(bad), "{bad}");
        }
    }

    #[test]
    fn an_html_page_is_refused_as_a_picture_and_a_preview_with_external_references_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("x");
        let checked = |path: &str, bytes: &[u8]| {
            std::fs::write(&at, bytes).unwrap();
            check(path, &at).map_err(|e| e.to_string())
        };
        assert!(checked("poster.jpg", b"<!doctype html><script>").unwrap_err().contains("not a picture"));
        assert!(checked("poster.jpg", b"\x89PNG\r\n\x1a\n").is_err(), "a PNG is no JPEG");
        assert!(checked("poster.jpg", b"\xff\xd8").is_err(), "too short");
        assert!(checked("drawings/plan.png", b"\x89PNG\r\n\x1a\n....").is_ok());
        assert!(checked("drawings/plan.pgw", b"1\n0\n0\n-1\n5.5\n6\n").is_ok());
        assert!(checked("drawings/plan.pgw", b"<script>").is_err());
        let glb = |json: &str| {
            let mut bytes = b"glTF".to_vec();
            for word in [2, 20 + json.len() as u32, json.len() as u32, 0x4e4f_534a] {
                bytes.extend_from_slice(&word.to_le_bytes());
            }
            bytes.extend_from_slice(json.as_bytes());
            bytes
        };
        assert!(checked("preview.glb", &glb("{\"asset\":{\"version\":\"2.0\"}}")).is_ok());
        let elsewhere = "{\"asset\":{},\"buffers\":[{\"uri\":\"http://x\"}]}";
        assert!(checked("preview.glb", &glb(elsewhere)).unwrap_err().contains("self-contained"));
        assert!(checked("preview.glb", &glb("{\"asset\":{}}")[..30]).is_err());
        // Addresses in extensions and extras, hidden by letters, and keys that two programs read differently.
        for json in [
            "{\"asset\":{},\"images\":[{\"uri\":\"x.png\"}]}",
            "{\"asset\":{},\"extensions\":{\"KHR_lights_image_based\":{\"lights\":[{\"URI\":\"x\"}]}}}",
            "{\"asset\":{},\"extensions\":{\"MPEG_media\":{\"media\":[{\"alternatives\":[{\"uri\":\"https://evil.example/v.mp4\"}]}]}}}",
            "{\"asset\":{},\"nodes\":[{\"extras\":{\"deep\":[[{\"link\":\"HTTPS://evil.example\"}]]}}]}",
            "{\"asset\":{\"extras\":{\"a\":\"//evil.example/x\"}}}",
            "{\"asset\":{\"copyright\":\"data:text/html,x\"}}",
            "{\"asset\":{},\"materials\":[{\"extensions\":{\"X\":{\"href\":\"a\"}}}]}",
            "{\"asset\":{},\"extensions\":{\"\\u0075ri\":\"a\"}}",
            "{\"asset\":{},\"extras\":{\"https://evil.example\":1}}",
        ] {
            assert!(
                checked("preview.glb", &glb(json)).unwrap_err().contains("refers to another file or site"),
                "{json}"
            );
        }
        let twice = "{\"asset\":{},\"buffers\":[],\"buffers\":[]}";
        assert!(checked("preview.glb", &glb(twice)).unwrap_err().contains("duplicate key"));
        let mut more = glb("{\"asset\":{}}");
        more.extend_from_slice(b"4 more bytes");
        let length = more.len() as u32;
        more[8..12].copy_from_slice(&length.to_le_bytes());
        assert!(checked("preview.glb", &more).is_err(), "no chunk of glTF");
        assert!(checked("preview.glb", &glb("{\"asset\":{},\"extras\":{\"crs\":\"EPSG:32737\"}}")).is_ok());
    }

    #[test]
    fn holes_are_accepted_only_in_the_form_kilwa_writes() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("x");
        let checked = |bytes: &[u8], location_redacted: bool| {
            std::fs::write(&at, bytes).unwrap();
            check_holes(&at, [DVec3::ZERO, DVec3::splat(9.0)], location_redacted).map_err(|e| e.to_string())
        };
        let rim = vec![DVec3::ONE, DVec3::new(2.0, 1.0, 1.0), DVec3::splat(2.0)];
        let hole = |rim: Vec<DVec3>| kilwa_archive::holes::Hole {
            cause: 0,
            area: 0.5,
            rim_length: 3.0,
            center: rim[0],
            areas: [0.5, 0.0, 0.0, 0.0],
            rim,
        };
        let holes = Holes { holes: vec![hole(rim)], crs: Some("EPSG:32737".to_owned()) };
        let written = holes.to_bytes().unwrap();
        assert_eq!(checked(&written, false), Ok(()));
        assert!(checked(&written, true).unwrap_err().contains("names a reference system"));
        assert_eq!(checked(&holes.clone().without_place(DVec3::ZERO).to_bytes().unwrap(), true), Ok(()));
        let more = String::from_utf8(written).unwrap().replacen("\"id\"", "\"note\":\"-8.957, 39.523\",\"id\"", 1);
        assert!(checked(more.as_bytes(), false).unwrap_err().contains("same version of kilwa"));
        let far = Holes { holes: vec![hole(vec![DVec3::splat(50.0); 3])], crs: None };
        assert!(checked(&far.to_bytes().unwrap(), false).unwrap_err().contains("outside of the model"));
        assert!(checked(b"<script>", false).unwrap_err().contains("kilwa merge"));
    }

    #[test]
    fn notes_are_accepted_only_in_the_form_kilwa_writes() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("x");
        let checked = |bytes: &[u8], location_redacted: bool| {
            std::fs::write(&at, bytes).unwrap();
            let noted = Noted {
                bounds: [DVec3::ZERO, DVec3::splat(9.0)],
                pack: ("pack.kilwa", "0123456789abcdef"),
                location_redacted,
            };
            check_notes(&at, &noted).map_err(|e| e.to_string())
        };
        let one = |x: f64, more: &str| {
            format!(
                "[{{\"label\":\"Gate\",\"body\":[\"https://example.org/\"],\"target\":{{\"selector\":{{\"type\":\"PointSelector\",\"x\":{x},\"y\":1,\"z\":1}}}}{more}}}]"
            )
        };
        let written = |notes: Notes| notes.to_bytes("pack.kilwa", "0123456789abcdef").unwrap();
        let notes = Notes::parse(one(1.0, "").as_bytes()).unwrap();
        assert!(checked(&written(notes.clone()), false).is_ok());
        assert!(checked(&written(notes.clone().without_place(DVec3::ZERO, &[])), true).is_ok());
        assert!(
            checked(&written(notes.clone()), true).unwrap_err().contains("may reveal the location"),
            "it has a link"
        );
        for bad in [
            one(1.0, "").into_bytes(),
            notes.to_bytes("https://evil.example/", "0123456789abcdef").unwrap(),
            b"<script>".to_vec(),
        ] {
            assert!(checked(&bad, false).is_err());
        }
        let far = Notes::parse(one(50.0, "").as_bytes()).unwrap();
        assert!(checked(&written(far), false).unwrap_err().contains("outside of the model"));
    }
}
