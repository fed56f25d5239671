//! Masks turned on and off, and removed.

use crate::ScanError;
use crate::lock::Lock;
use crate::survey::Survey;
use crate::survey::edit::Edit;
use std::fs;
use std::path::Path;

/// The stations of these names, or all, that have the mask.
fn holders(survey: &Survey, name: &str, stations: &[String]) -> Result<Vec<String>, ScanError> {
    for station in stations {
        survey.station(station)?;
    }
    let is_chosen = |station: &str| stations.is_empty() || stations.iter().any(|chosen| chosen == station);
    let all = survey.stations.iter().filter(|station| is_chosen(&station.name));
    let holders: Vec<String> =
        all.filter(|s| s.masks.iter().any(|mask| mask.name == name)).map(|s| s.name.clone()).collect();
    if !holders.is_empty() {
        return Ok(holders);
    }
    let known = survey.stations.iter().flat_map(|s| &s.masks).map(|mask| mask.name.as_str());
    let hint = match kilwa_toml::nearest(name, known) {
        Some(near) if near != name => format!("did you mean {near}?"),
        _ => "`kilwa scans mask SURVEY --list` shows the masks".to_owned(),
    };
    let which = if stations.is_empty() { "no station" } else { "none of these stations" };
    Err(ScanError::Request(format!("{which} has a mask {name}; {hint}")))
}

/// Turn a mask on or off at these stations, or at all that have it; their names.
///
/// # Errors
/// [`ScanError::Request`] where no station has it or another command is writing; [`ScanError::Survey`], [`ScanError::Write`].
pub fn switch(folder: &Path, name: &str, stations: &[String], is_on: bool) -> Result<Vec<String>, ScanError> {
    Survey::open(folder)?;
    let _lock = Lock::take(folder)?;
    let mut edit = Edit::open(folder)?;
    let holders = holders(edit.survey(), name, stations)?;
    for station in &holders {
        edit.switch_mask(station, name, is_on)?;
    }
    edit.save()?;
    Ok(holders)
}

/// Remove a mask, with its files, from these stations, or from all that have it; their names.
///
/// # Errors
/// As [`switch`].
pub fn remove(folder: &Path, name: &str, stations: &[String]) -> Result<Vec<String>, ScanError> {
    Survey::open(folder)?;
    let _lock = Lock::take(folder)?;
    let mut edit = Edit::open(folder)?;
    let holders = holders(edit.survey(), name, stations)?;
    let mut files = Vec::new();
    for station in &holders {
        files.extend(edit.remove_mask(station, name)?.map(|mask| mask.file));
    }
    edit.save()?;
    remove_files(folder, edit.survey(), &files);
    Ok(holders)
}

/// Remove files of masks that the survey does not name any more.
pub(super) fn remove_files(folder: &Path, survey: &Survey, files: &[String]) {
    for file in files {
        if survey.stations.iter().flat_map(|s| &s.masks).all(|mask| mask.file != *file) {
            // What cannot be removed only takes space.
            drop(fs::remove_file(folder.join(file)));
        }
    }
}
