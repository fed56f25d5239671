//! From the text of `survey.toml` to [`Survey`].

use super::{Camera, Control, LIST_MAX, Mask, MeshDefaults, Photograph, Source, Station, Survey};
use glam::{DQuat, DVec3};
use kilwa_scan_core::Pose;
use kilwa_toml::{File, Found, Problem, Problems, Table};
use std::collections::BTreeSet;
use std::path::{Component, Path};
use toml::de::DeTable;

/// The version of the file that this program reads and writes.
pub(super) const VERSION: u64 = 1;

impl Survey {
    /// Read the text of a `survey.toml`.
    ///
    /// # Errors
    /// [`Problems`]: every mistake, in the order of lines.
    pub fn parse(text: &str) -> Result<Self, Problems> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let file = File::new(text).with_list_max(LIST_MAX);
        let root = DeTable::parse(text).map_err(|e| {
            let line = e.span().map_or(1, |span| file.line(span.start));
            Problems(vec![Problem::new(line, "", e.message().trim().replace('\n', ", "))])
        })?;
        let survey = survey(Table::new(&file, "", 0, root.get_ref()));
        let problems = file.into_problems();
        if problems.is_empty() { Ok(survey) } else { Err(Problems(problems)) }
    }
}

fn survey(t: Table<'_, '_>) -> Survey {
    match t.count("version") {
        Some(found) if found.value != VERSION => {
            t.wrong("version", found.at, format!("this version of Kilwa reads surveys of version {VERSION}"));
        }
        Some(_) => {}
        None => t.missing("version", "write version = 1 at the top of the file"),
    }
    let (title, crs) = (value(t.text("title")), value(t.text("crs")));
    let mut names = BTreeSet::new();
    let stations = t.tables("station").into_iter().filter_map(|table| station(table, &mut names)).collect();
    let controls = t.tables("control").into_iter().filter_map(|table| control(table, &names)).collect();
    let photographs = t.tables("photograph").into_iter().filter_map(|table| photograph(table, &names)).collect();
    let mesh = t.table("options").map(options).unwrap_or_default();
    t.finish();
    Survey { title, crs, stations, controls, photographs, mesh }
}

fn value<T>(found: Option<Found<T>>) -> Option<T> {
    found.map(|found| found.value)
}

/// A field that must be there.
fn needed<T>(t: &Table<'_, '_>, key: &'static str, found: Option<Found<T>>, is_there: bool) -> Option<T> {
    if found.is_none() && !is_there {
        t.missing(key, "it is missing");
    }
    value(found)
}

fn station(t: Table<'_, '_>, names: &mut BTreeSet<String>) -> Option<Station> {
    let name = t.text("name");
    let is_there = t.has("name");
    if let Some(found) = &name {
        if !is_name(&found.value) {
            let message = "a name has only letters, digits, and . _ - between them, because files are named after it";
            t.wrong("name", found.at, message);
        }
        if !names.insert(found.value.clone()) {
            t.wrong("name", found.at, format!("there is another station {}; names must differ", found.value));
        }
    }
    let name = needed(&t, "name", name, is_there);
    let scan = t.text("scan").and_then(|found| {
        if is_inside(&found.value) {
            return Some(found);
        }
        t.wrong("scan", found.at, "expected a file inside the folder of the survey, without ..");
        None
    });
    let has_scan = t.has("scan");
    let scan = needed(&t, "scan", scan, has_scan);
    let pose = pose(&t);
    let sigma = positive(&t, "translation_sigma").zip(positive(&t, "rotation_sigma"));
    if t.has("translation_sigma") != t.has("rotation_sigma") {
        t.missing("translation_sigma", "give translation_sigma (metres) and rotation_sigma (degrees) together");
    }
    let is_fixed = t.truth("fixed").unwrap_or(false);
    if is_fixed && pose.is_none() && !t.has("rotation") && !t.has("translation") {
        t.missing("fixed", "a fixed station needs rotation and translation");
    }
    let instrument = value(t.text("instrument"));
    let (range_noise, beam) = (pair(&t, "range_noise"), pair(&t, "beam"));
    let mut masks = BTreeSet::new();
    let masks = t.tables("mask").into_iter().filter_map(|table| mask(table, &mut masks)).collect();
    let source = t.table("source").and_then(source);
    if source.is_none() && !t.has("source") {
        t.missing("source", "[station.source] is missing");
    }
    t.finish();
    Some(Station {
        name: name?,
        scan: scan?,
        pose,
        sigma: sigma.map(|(metres, degrees)| [metres, degrees.to_radians()]),
        is_fixed,
        instrument,
        range_noise,
        beam,
        masks,
        source: source?,
    })
}

fn mask(t: Table<'_, '_>, names: &mut BTreeSet<String>) -> Option<Mask> {
    let name = t.text("name");
    if let Some(found) = &name {
        if !is_mask_name(&found.value) {
            let message = "the name of a mask has up to 40 letters, digits, and _ - between them";
            t.wrong("name", found.at, message);
        }
        if !names.insert(found.value.clone()) {
            let message = format!("the station has another mask {}; names must differ", found.value);
            t.wrong("name", found.at, message);
        }
    }
    let file = t.text("file").and_then(|found| {
        if is_inside(&found.value) {
            return Some(found);
        }
        t.wrong("file", found.at, "expected a file inside the folder of the survey, without ..");
        None
    });
    let (has_name, has_file) = (t.has("name"), t.has("file"));
    let name = needed(&t, "name", name, has_name);
    let file = needed(&t, "file", file, has_file);
    let is_on = t.truth("on").unwrap_or(true);
    let made = value(t.text("made")).unwrap_or_default();
    let poses = value(t.text("poses"));
    t.finish();
    Some(Mask { name: name?, file: file?, is_on, made, poses })
}

/// Whether a mask can have this name.
pub(crate) fn is_mask_name(name: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
    (1..=40).contains(&name.len()) && name.chars().all(is_plain) && !name.starts_with('-')
}

fn source(t: Table<'_, '_>) -> Option<Source> {
    let (has_file, has_bytes, has_hash, has_number) = (t.has("file"), t.has("bytes"), t.has("blake3"), t.has("number"));
    let file = needed(&t, "file", t.text("file"), has_file);
    let bytes = needed(&t, "bytes", t.count("bytes"), has_bytes);
    let hash = needed(&t, "blake3", t.text("blake3"), has_hash);
    let number = needed(&t, "number", t.count("number"), has_number);
    t.finish();
    Some(Source { file: file?, bytes: bytes?, blake3: hash?, number: number? })
}

/// Rotation and translation; both or neither.
fn pose(t: &Table<'_, '_>) -> Option<Pose> {
    let (rotation, translation) = (t.numbers::<4>("rotation"), t.numbers::<3>("translation"));
    if t.has("rotation") != t.has("translation") {
        t.missing(
            "translation",
            "a pose has rotation (a quaternion: w, x, y, z) and translation (metres); give both or neither",
        );
        return None;
    }
    let (rotation, translation) = (rotation?, translation?);
    let [w, x, y, z] = rotation.value;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    if (quaternion.length() - 1.0).abs() > Pose::TOLERANCE {
        let message = format!("the length of this quaternion (w, x, y, z) is {:.6}; it must be 1", quaternion.length());
        t.wrong("rotation", rotation.at, message);
        return None;
    }
    Some(Pose { rotation: quaternion.normalize(), translation: DVec3::from_array(translation.value) })
}

fn control(t: Table<'_, '_>, stations: &BTreeSet<String>) -> Option<Control> {
    let (has_name, has_at) = (t.has("name"), t.has("at"));
    let name = needed(&t, "name", t.text("name"), has_name);
    let at = needed(&t, "at", t.numbers::<3>("at"), has_at);
    let station = known_station(&t, stations);
    let sigma = positive(&t, "sigma");
    t.finish();
    Some(Control { name: name?, station, at: DVec3::from_array(at?), sigma })
}

fn known_station(t: &Table<'_, '_>, stations: &BTreeSet<String>) -> Option<String> {
    let found = t.text("station")?;
    if !stations.contains(&found.value) {
        let near = kilwa_toml::nearest(&found.value, stations.iter().map(String::as_str));
        let hint = near.map_or_else(String::new, |near| format!("; did you mean {near}?"));
        t.wrong("station", found.at, format!("there is no station {}{hint}", found.value));
    }
    Some(found.value)
}

fn photograph(t: Table<'_, '_>, stations: &BTreeSet<String>) -> Option<Photograph> {
    let has_file = t.has("file");
    let file = needed(&t, "file", t.text("file"), has_file);
    let (station, pose) = (known_station(&t, stations), pose(&t));
    let camera = t.table("camera").and_then(camera);
    t.finish();
    Some(Photograph { file: file?, station, pose, camera })
}

#[derive(Clone, Copy)]
enum CameraKind {
    Pinhole,
    Spherical,
    Cylindrical,
}

fn camera(t: Table<'_, '_>) -> Option<Camera> {
    const KINDS: [(&str, CameraKind); 3] = [
        ("pinhole", CameraKind::Pinhole),
        ("spherical", CameraKind::Spherical),
        ("cylindrical", CameraKind::Cylindrical),
    ];
    let kind = t.word("kind", &KINDS);
    if kind.is_none() && !t.has("kind") {
        t.missing("kind", "write pinhole, spherical or cylindrical");
    }
    let has = |key| t.has(key);
    let has_size = has("size");
    let size = needed(&t, "size", t.numbers::<2>("size"), has_size).map(|size| size.map(|v| v as u32));
    let camera = match kind? {
        CameraKind::Pinhole => {
            let (has_focal, has_center) = (has("focal"), has("center"));
            let focal = needed(&t, "focal", t.numbers("focal"), has_focal);
            let center = needed(&t, "center", t.numbers("center"), has_center);
            Some(Camera::Pinhole { size: size?, focal: focal?, center: center? })
        }
        CameraKind::Spherical => {
            let has_pixel = has("pixel");
            Some(Camera::Spherical { size: size?, pixel: needed(&t, "pixel", t.numbers("pixel"), has_pixel)? })
        }
        CameraKind::Cylindrical => {
            let (has_radius, has_center, has_pixel) = (has("radius"), has("center"), has("pixel"));
            let radius = needed(&t, "radius", t.number("radius"), has_radius);
            let center = needed(&t, "center", t.number("center"), has_center);
            let pixel = needed(&t, "pixel", t.numbers("pixel"), has_pixel);
            Some(Camera::Cylindrical { size: size?, radius: radius?, center: center?, pixel: pixel? })
        }
    };
    if camera.as_ref().is_some_and(|camera| !camera.is_sound()) {
        t.missing("kind", "sizes, focal lengths and angles must be positive");
    }
    t.finish();
    camera
}

fn options(t: Table<'_, '_>) -> MeshDefaults {
    let mesh = t.table("mesh").map(|m| {
        let subsample = m.count("subsample");
        if let Some(found) = subsample.as_ref().filter(|found| !(1..=64).contains(&found.value)) {
            m.wrong("subsample", found.at, "expected a number from 1 to 64");
        }
        let grazing = m.number("grazing");
        if let Some(found) = grazing.as_ref().filter(|found| !(found.value > 0.0 && found.value < 90.0)) {
            m.wrong("grazing", found.at, "expected an angle between 0 and 90 degrees");
        }
        let (edge_factor, max_edge) = (positive(&m, "edge_factor"), positive(&m, "max_edge"));
        m.finish();
        MeshDefaults { subsample: value(subsample).map(|n| n as u32), edge_factor, max_edge, grazing: value(grazing) }
    });
    t.finish();
    mesh.unwrap_or_default()
}

fn positive(t: &Table<'_, '_>, key: &'static str) -> Option<f64> {
    let found = t.number(key)?;
    if found.value <= 0.0 {
        t.wrong(key, found.at, "it must be greater than 0");
        return None;
    }
    Some(found.value)
}

/// Two numbers of 0 or more, not both 0.
fn pair(t: &Table<'_, '_>, key: &'static str) -> Option<[f64; 2]> {
    let found = t.numbers::<2>(key)?;
    if found.value.iter().any(|v| *v < 0.0) || found.value == [0.0; 2] {
        t.wrong(key, found.at, "expected two numbers of 0 or more, one of them greater than 0");
        return None;
    }
    Some(found.value)
}

/// Whether files can be named after it everywhere.
pub(super) fn is_name(name: &str) -> bool {
    let is_plain = |c: char| c.is_alphanumeric() || "._-".contains(c);
    !name.is_empty()
        && name.len() <= 100
        && name.chars().all(is_plain)
        && !name.starts_with('.')
        && !name.ends_with('.')
}

/// Whether a path stays in the folder of the survey.
fn is_inside(path: &str) -> bool {
    Path::new(path).components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}
