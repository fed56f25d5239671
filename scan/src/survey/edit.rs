//! Changing `survey.toml` and keeping all else as people wrote it.

use super::parse::{VERSION, is_name};
use super::{Camera, FILE, FILE_MAX, Mask, Photograph, Station, Survey, is_same_file, spool_of, text};
use crate::ScanError;
use kilwa_files::atomic::{self, Access};
use kilwa_scan_core::Pose;
use std::path::{Path, PathBuf};
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value, value};

const BEGINNING: &str = "# A survey, made by `kilwa scans import`. You may edit this file; see docs/scans.md.
# Lengths are in metres. A pose transforms scanner coordinates to survey coordinates: rotation is a unit quaternion (w, x, y, z).
";

/// A survey that is changed; nothing is written before [`Edit::save`].
///
/// People may edit the file while an import runs, which can take hours: what they write is read again and kept.
#[derive(Debug)]
pub struct Edit {
    folder: PathBuf,
    path: PathBuf,
    /// The file as it was last read or written; `None` where there was none.
    known: Option<String>,
    document: DocumentMut,
    survey: Survey,
    /// Changes since then.
    pending: Vec<Change>,
}

/// A change that can be made again in a file that was edited meanwhile.
#[derive(Debug, Clone)]
enum Change {
    Crs(String),
    Station(Box<Station>),
    Photograph(Photograph),
}

impl Change {
    fn make(&self, document: &mut DocumentMut, survey: &mut Survey) {
        match self {
            Self::Crs(_) if survey.crs.is_some() => {}
            Self::Crs(crs) => {
                document["crs"] = value(crs);
                survey.crs = Some(crs.clone());
            }
            Self::Station(station) => {
                append(document, "station", station_table(station));
                survey.stations.push(station.as_ref().clone());
            }
            Self::Photograph(photograph) => {
                append(document, "photograph", photograph_table(photograph));
                survey.photographs.push(photograph.clone());
            }
        }
    }
}

impl Edit {
    /// Open the survey in `folder`, or begin one where there is none.
    ///
    /// # Errors
    /// As [`Survey::open`].
    pub fn open(folder: &Path) -> Result<Self, ScanError> {
        let path = folder.join(FILE);
        let known = if path.exists() { Some(text(folder)?.1) } else { None };
        let (document, survey) = parsed(&path, &known.clone().unwrap_or_else(beginning))?;
        Ok(Self { folder: folder.to_owned(), path, known, document, survey, pending: Vec::new() })
    }

    /// Read the file again where someone has edited it since it was last read or written, and keep the changes that are not saved yet.
    ///
    /// # Errors
    /// As [`Survey::open`]; [`ScanError::Request`] where there are changes that cannot be made again.
    pub fn refresh(&mut self) -> Result<(), ScanError> {
        let now = if self.known.is_some() || self.path.exists() { Some(text(&self.folder)?.1) } else { None };
        if now == self.known {
            return Ok(());
        }
        let remade = |from: Option<&String>| {
            let (mut document, mut survey) = parsed(&self.path, &from.cloned().unwrap_or_else(beginning))?;
            self.pending.iter().for_each(|change| change.make(&mut document, &mut survey));
            Ok::<_, ScanError>((document, survey))
        };
        if remade(self.known.as_ref())?.0.to_string() != self.document.to_string() {
            let message = format!("{} was edited while this command ran; run the command again", self.path.display());
            return Err(ScanError::Request(message));
        }
        (self.document, self.survey) = remade(now.as_ref())?;
        self.known = now;
        Ok(())
    }

    /// What it holds now.
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// Set the coordinate reference system if it has none. `false` if it has another one.
    pub fn set_crs(&mut self, crs: &str) -> bool {
        if self.survey.crs.is_none() {
            self.change(Change::Crs(crs.to_owned()));
        }
        self.survey.crs.as_deref() == Some(crs)
    }

    /// Append a station.
    pub fn add_station(&mut self, station: Station) {
        self.change(Change::Station(Box::new(station)));
    }

    /// Append a photograph.
    pub fn add_photograph(&mut self, photograph: Photograph) {
        self.change(Change::Photograph(photograph));
    }

    fn change(&mut self, change: Change) {
        change.make(&mut self.document, &mut self.survey);
        self.pending.push(change);
    }

    /// Set or clear the pose of a station.
    ///
    /// # Errors
    /// As [`Survey::station`].
    pub fn set_pose(&mut self, name: &str, pose: Option<Pose>) -> Result<(), ScanError> {
        self.survey.station(name)?;
        let place = self.survey.stations.iter().position(|s| s.name == name);
        let table = place.and_then(|k| listed(&mut self.document, "station", k));
        if let Some((place, table)) = place.zip(table) {
            put_pose(table, pose);
            self.survey.stations[place].pose = pose;
        }
        Ok(())
    }

    /// Set the standard deviations of the pose of a station: metres, radians. If either is not positive, both are removed.
    ///
    /// # Errors
    /// As [`Survey::station`].
    pub fn set_sigma(&mut self, name: &str, sigma: [f64; 2]) -> Result<(), ScanError> {
        self.survey.station(name)?;
        let place = self.survey.stations.iter().position(|s| s.name == name);
        let table = place.and_then(|k| listed(&mut self.document, "station", k));
        let Some((place, table)) = place.zip(table) else { return Ok(()) };
        if sigma.iter().all(|v| *v > 0.0) {
            table.insert("translation_sigma", value(sigma[0]));
            table.insert("rotation_sigma", value(sigma[1].to_degrees()));
            self.survey.stations[place].sigma = Some(sigma);
        } else {
            table.remove("translation_sigma");
            table.remove("rotation_sigma");
            self.survey.stations[place].sigma = None;
        }
        Ok(())
    }

    /// Give a station a mask, in place of the one of that name if it has one.
    ///
    /// # Errors
    /// As [`Survey::station`]; [`ScanError::Request`] where masks are written otherwise than as `[[station.mask]]`.
    pub fn put_mask(&mut self, station: &str, mask: Mask) -> Result<(), ScanError> {
        let (own, tables) = self.masks(station)?;
        let place = own.iter().position(|other| other.name == mask.name);
        let mut new = Table::new();
        let table = match place {
            Some(place) => tables.get_mut(place).unwrap_or(&mut new),
            None => &mut new,
        };
        table["name"] = value(&mask.name);
        table["file"] = value(&mask.file);
        table["on"] = value(mask.is_on);
        table["made"] = value(&mask.made);
        match &mask.poses {
            Some(poses) => table["poses"] = value(poses),
            None => drop(table.remove("poses")),
        }
        if let Some(place) = place {
            own[place] = mask;
        } else {
            tables.push(new);
            own.push(mask);
        }
        Ok(())
    }

    /// Take a mask from a station, if it has it; its file stays. `None` if it has no mask of this name.
    ///
    /// # Errors
    /// As [`Self::put_mask`].
    pub fn remove_mask(&mut self, station: &str, name: &str) -> Result<Option<Mask>, ScanError> {
        let (own, tables) = self.masks(station)?;
        let Some(place) = own.iter().position(|mask| mask.name == name) else { return Ok(None) };
        tables.remove(place);
        let removed = own.remove(place);
        if own.is_empty() {
            let at = self.survey.stations.iter().position(|s| s.name == station);
            if let Some(table) = at.and_then(|at| listed(&mut self.document, "station", at)) {
                table.remove("mask");
            }
        }
        Ok(Some(removed))
    }

    /// Turn a mask of a station on or off. `false` if it has no mask of this name.
    ///
    /// # Errors
    /// As [`Self::put_mask`].
    pub fn switch_mask(&mut self, station: &str, name: &str, is_on: bool) -> Result<bool, ScanError> {
        let (own, tables) = self.masks(station)?;
        let Some(place) = own.iter().position(|mask| mask.name == name) else { return Ok(false) };
        if let Some(table) = tables.get_mut(place) {
            table["on"] = value(is_on);
        }
        own[place].is_on = is_on;
        Ok(true)
    }

    /// The masks of a station, and their tables, in the same order.
    fn masks(&mut self, name: &str) -> Result<(&mut Vec<Mask>, &mut ArrayOfTables), ScanError> {
        self.survey.station(name)?;
        let place = self.survey.stations.iter().position(|s| s.name == name);
        let table = place.and_then(|k| listed(&mut self.document, "station", k));
        let tables = table.and_then(|table| {
            let entry = table.entry("mask").or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
            entry.as_array_of_tables_mut()
        });
        place.and_then(|k| self.survey.stations.get_mut(k)).map(|s| &mut s.masks).zip(tables).ok_or_else(|| {
            let message = format!(
                "{}: the masks of station {name} are a list in brackets; write each as a table of its own, [[station.mask]]",
                self.path.display()
            );
            ScanError::Request(message)
        })
    }

    /// Whether a new station can have this name: no other one has it, and none has the file that it would get.
    pub fn is_free(&self, name: &str) -> bool {
        let is_same_name = |other: &str| other.to_lowercase() == name.to_lowercase();
        let spool = spool_of(name);
        !self.survey.stations.iter().any(|s| is_same_name(&s.name) || is_same_file(&s.scan, &spool))
    }

    /// A name for a new station that is free ([`Self::is_free`]), made of what a file calls it.
    pub fn free_name(&self, wanted: &str) -> String {
        let clean = clean_name(wanted);
        let numbered = (2..).map(|k| format!("{clean}-{k}"));
        std::iter::once(clean.clone()).chain(numbered).find(|name| self.is_free(name)).unwrap_or(clean)
    }

    /// Write the file, with what people wrote into it meanwhile.
    ///
    /// # Errors
    /// [`ScanError::Write`]; as [`Self::refresh`]; [`ScanError::Request`] where it would be too long.
    pub fn save(&mut self) -> Result<(), ScanError> {
        self.refresh()?;
        let text = self.document.to_string();
        // What the program wrote, it must be able to read.
        if text.len() as u64 > FILE_MAX {
            let message =
                format!("{} would have more than {FILE_MAX} bytes; begin another survey", self.path.display());
            return Err(ScanError::Request(message));
        }
        let written =
            Survey::parse(&text).map_err(|problems| ScanError::Survey { file: self.path.clone(), problems })?;
        if !has_same_entries(&written, &self.survey) {
            let message = format!(
                "{}: an entry cannot be added; write stations as [[station]] and photographs as [[photograph]]",
                self.path.display()
            );
            return Err(ScanError::Request(message));
        }
        let before = std::fs::metadata(&self.path).ok();
        let access = before.as_ref().map_or(Access::Default, Access::Like);
        let is_there = self.known.is_some();
        atomic::write(&self.path, text.as_bytes(), access, is_there).map_err(ScanError::write(&self.path))?;
        self.known = Some(text);
        self.pending.clear();
        Ok(())
    }
}

fn beginning() -> String {
    format!("{BEGINNING}version = {VERSION}\n")
}

/// The text of the file as a document that can be changed and as a survey.
fn parsed(path: &Path, text: &str) -> Result<(DocumentMut, Survey), ScanError> {
    let survey = Survey::parse(text).map_err(|problems| ScanError::Survey { file: path.to_owned(), problems })?;
    let document = text.parse::<DocumentMut>();
    let document = document.map_err(|e| ScanError::Request(format!("{}: {e}", path.display())))?;
    Ok((document, survey))
}

/// Whether two surveys have the same stations and photographs.
fn has_same_entries(a: &Survey, b: &Survey) -> bool {
    let stations = |survey: &Survey| -> Vec<_> {
        let entry = |s: &Station| (s.name.clone(), s.scan.clone(), s.source.blake3.clone(), s.source.number);
        survey.stations.iter().map(entry).collect()
    };
    let photographs = |survey: &Survey| -> Vec<_> { survey.photographs.iter().map(|p| p.file.clone()).collect() };
    stations(a) == stations(b) && photographs(a) == photographs(b)
}

/// Append a table to a list, in whatever form a person wrote the list: `[[key]]`, one `[key]`, or inline tables in brackets.
fn append(document: &mut DocumentMut, key: &str, table: Table) {
    let list = document.entry(key).or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
    match list {
        Item::ArrayOfTables(list) => list.push(table),
        Item::Value(Value::Array(list)) if !list.is_empty() => list.push(table.into_inline_table()),
        other => {
            let mut list = ArrayOfTables::new();
            if let Ok(mut only) = std::mem::take(other).into_table() {
                only.set_dotted(false);
                only.set_implicit(false);
                list.push(only);
            }
            list.push(table);
            *other = Item::ArrayOfTables(list);
        }
    }
}

/// An entry of a list, in whatever form a person wrote the list.
fn listed<'d>(document: &'d mut DocumentMut, key: &str, place: usize) -> Option<&'d mut dyn TableLike> {
    match document.get_mut(key)? {
        Item::ArrayOfTables(list) => list.get_mut(place).map(|table| table as &mut dyn TableLike),
        Item::Value(Value::Array(list)) => {
            let table = list.get_mut(place).and_then(Value::as_inline_table_mut);
            table.map(|table| table as &mut dyn TableLike)
        }
        only => only.as_table_like_mut().filter(|_| place == 0),
    }
}

fn station_table(station: &Station) -> Table {
    let mut table = Table::new();
    table["name"] = value(&station.name);
    table["scan"] = value(&station.scan);
    put_pose(&mut table, station.pose);
    if let Some(instrument) = &station.instrument {
        table["instrument"] = value(instrument);
    }
    let mut source = Table::new();
    source["file"] = value(&station.source.file);
    source["bytes"] = value(i64::try_from(station.source.bytes).unwrap_or(i64::MAX));
    source["blake3"] = value(&station.source.blake3);
    source["number"] = value(i64::try_from(station.source.number).unwrap_or(i64::MAX));
    table["source"] = Item::Table(source);
    table
}

fn photograph_table(photograph: &Photograph) -> Table {
    let mut table = Table::new();
    table["file"] = value(&photograph.file);
    if let Some(station) = &photograph.station {
        table["station"] = value(station);
    }
    put_pose(&mut table, photograph.pose);
    if let Some(camera) = &photograph.camera {
        table["camera"] = value(camera_table(camera));
    }
    table
}

/// A name that files can have, made of any text.
pub fn clean_name(wanted: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let clean: String = wanted.trim().chars().map(plain).take(60).collect();
    // At most 60 characters of at most 4 bytes would be more than a name may have.
    let clean = clean.trim_matches(['.', '_']).chars().take(if clean.is_ascii() { 60 } else { 25 }).collect::<String>();
    let clean = clean.trim_matches(['.', '_']).to_owned();
    if is_name(&clean) { clean } else { "station".to_owned() }
}

fn numbers(values: &[f64]) -> Value {
    values.iter().copied().collect::<Array>().into()
}

fn put_pose(table: &mut dyn TableLike, pose: Option<Pose>) {
    let Some(Pose { rotation: q, translation }) = pose else {
        table.remove("rotation");
        table.remove("translation");
        return;
    };
    // A quaternion and its negative are the same rotation.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    table.insert("rotation", Item::Value(numbers(&[q.w, q.x, q.y, q.z].map(|v| v * sign + 0.0))));
    table.insert("translation", Item::Value(numbers(&translation.to_array())));
}

fn camera_table(camera: &Camera) -> InlineTable {
    let mut table = InlineTable::new();
    let size_of = |size: [u32; 2]| Value::from(size.iter().map(|n| i64::from(*n)).collect::<Array>());
    match camera {
        Camera::Pinhole { size, focal, center } => {
            table.insert("kind", "pinhole".into());
            table.insert("size", size_of(*size));
            table.insert("focal", numbers(focal));
            table.insert("center", numbers(center));
        }
        Camera::Spherical { size, pixel } => {
            table.insert("kind", "spherical".into());
            table.insert("size", size_of(*size));
            table.insert("pixel", numbers(pixel));
        }
        Camera::Cylindrical { size, radius, center, pixel } => {
            table.insert("kind", "cylindrical".into());
            table.insert("size", size_of(*size));
            table.insert("radius", (*radius).into());
            table.insert("center", (*center).into());
            table.insert("pixel", numbers(pixel));
        }
    }
    table
}
