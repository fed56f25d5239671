//! Changing `survey.toml` and keeping all else as people wrote it.

use super::parse::{VERSION, is_name};
use super::{Camera, FILE, Mask, Photograph, Station, Survey, text};
use crate::ScanError;
use kilwa_files::atomic::{self, Access};
use kilwa_scan_core::Pose;
use std::path::{Path, PathBuf};
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value, value};

const BEGINNING: &str = "# A survey, made by `kilwa scans import`. You may edit this file; see docs/scans.md.
# Lengths are metres. A pose takes points of a station to the survey: rotation is a unit quaternion (w, x, y, z).
";

/// A survey that is changed; nothing is written before [`Edit::save`].
#[derive(Debug)]
pub struct Edit {
    path: PathBuf,
    document: DocumentMut,
    survey: Survey,
    is_new: bool,
}

impl Edit {
    /// Open the survey in `folder`, or begin one where there is none.
    ///
    /// # Errors
    /// As [`Survey::open`].
    pub fn open(folder: &Path) -> Result<Self, ScanError> {
        let path = folder.join(FILE);
        let is_new = !path.exists();
        let text = if is_new { format!("{BEGINNING}version = {VERSION}\n") } else { text(folder)?.1 };
        let survey = Survey::parse(&text).map_err(|problems| ScanError::Survey { file: path.clone(), problems })?;
        let document = text.parse::<DocumentMut>();
        let document = document.map_err(|e| ScanError::Request(format!("{}: {e}", path.display())))?;
        Ok(Self { path, document, survey, is_new })
    }

    /// What it holds now.
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// Set the coordinate reference system if it has none. `false` if it has another one.
    pub fn set_crs(&mut self, crs: &str) -> bool {
        match &self.survey.crs {
            None => {
                self.document["crs"] = value(crs);
                self.survey.crs = Some(crs.to_owned());
                true
            }
            Some(own) => own == crs,
        }
    }

    /// Append a station.
    pub fn add_station(&mut self, station: Station) {
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
        self.append("station", table);
        self.survey.stations.push(station);
    }

    /// Append a photograph.
    pub fn add_photograph(&mut self, photograph: Photograph) {
        let mut table = Table::new();
        table["file"] = value(&photograph.file);
        if let Some(station) = &photograph.station {
            table["station"] = value(station);
        }
        put_pose(&mut table, photograph.pose);
        if let Some(camera) = &photograph.camera {
            table["camera"] = value(camera_table(camera));
        }
        self.append("photograph", table);
        self.survey.photographs.push(photograph);
    }

    /// Set or clear the pose of a station.
    ///
    /// # Errors
    /// As [`Survey::station`].
    pub fn set_pose(&mut self, name: &str, pose: Option<Pose>) -> Result<(), ScanError> {
        self.survey.station(name)?;
        let place = self.survey.stations.iter().position(|s| s.name == name);
        let tables = self.document.get_mut("station").and_then(Item::as_array_of_tables_mut);
        if let Some((place, table)) = place.zip(place.and_then(|k| tables?.get_mut(k))) {
            put_pose(table, pose);
            self.survey.stations[place].pose = pose;
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
            let stations = self.document.get_mut("station").and_then(Item::as_array_of_tables_mut);
            if let Some(table) = at.and_then(|at| stations?.get_mut(at)) {
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
        let stations = self.document.get_mut("station").and_then(Item::as_array_of_tables_mut);
        let table = place.and_then(|k| stations?.get_mut(k));
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

    fn append(&mut self, key: &str, table: Table) {
        let list = self.document.entry(key).or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
        if let Some(list) = list.as_array_of_tables_mut() {
            list.push(table);
        }
    }

    /// A name for a new station that no other has, made of what a file calls it.
    pub fn free_name(&self, wanted: &str) -> String {
        let clean = clean_name(wanted);
        let is_free = |name: &str| self.survey.stations.iter().all(|s| !s.name.eq_ignore_ascii_case(name));
        let numbered = (2..).map(|k| format!("{clean}-{k}"));
        std::iter::once(clean.clone()).chain(numbered).find(|name| is_free(name)).unwrap_or(clean)
    }

    /// Write the file.
    ///
    /// # Errors
    /// [`ScanError::Write`].
    pub fn save(&mut self) -> Result<(), ScanError> {
        let text = self.document.to_string();
        // What the program wrote, it must be able to read.
        Survey::parse(&text).map_err(|problems| ScanError::Survey { file: self.path.clone(), problems })?;
        let before = std::fs::metadata(&self.path).ok();
        let access = before.as_ref().map_or(Access::Default, Access::Like);
        atomic::write(&self.path, text.as_bytes(), access, !self.is_new).map_err(ScanError::write(&self.path))?;
        self.is_new = false;
        Ok(())
    }
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

fn put_pose(table: &mut Table, pose: Option<Pose>) {
    let Some(Pose { rotation: q, translation }) = pose else {
        table.remove("rotation");
        table.remove("translation");
        return;
    };
    // A quaternion and its negative are the same rotation.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    table["rotation"] = Item::Value(numbers(&[q.w, q.x, q.y, q.z].map(|v| v * sign + 0.0)));
    table["translation"] = Item::Value(numbers(&translation.to_array()));
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
