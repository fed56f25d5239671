//! Writes the result of a registration to a survey that may have been edited in the meantime.

use super::result::{Placed, Placement, Registration};
use crate::ScanError;
use crate::lock::Lock;
use crate::survey::edit::Edit;
use crate::survey::{Station, Survey};
use kilwa_scan_core::Pose;
use std::collections::BTreeMap;
use std::path::Path;

/// Writes the poses to `survey.toml` and the whole result to `registration.json`. `read` is the survey as it was when the run began: a run can take
/// an hour, and people may edit the file in the meantime. Stations are identified by their scans; those that have been removed since, or whose pose
/// has been changed,
/// are left unchanged and reported in the returned messages.
///
/// If a station was not placed, a pose from an earlier registration is replaced by the pose that preceded it (if any), because it may be in other
/// coordinates. The identity is removed if other stations have it as well, because it is then a placeholder.
///
/// # Errors
/// [`ScanError::Request`] if another command is writing to the survey; [`ScanError::Survey`], [`ScanError::Write`].
pub fn apply(folder: &Path, read: &Survey, found: &Registration) -> Result<Vec<String>, ScanError> {
    let _lock = Lock::take(folder)?;
    // With `--again`, a damaged one is replaced.
    let before = Registration::open(folder).ok().flatten();
    let mut edit = Edit::open(folder)?;
    let (names, left) = current_names(read, edit.survey());
    let found = found.renamed(&names);
    found.check()?;
    let stations = edit.survey().stations.clone();
    let is_shared = |s: &Station| stations.iter().filter(|other| other.pose == s.pose).count() > 1;
    // Standard deviations written by a registration are meaningless without it.
    for station in &stations {
        let is_kept = found.stations.iter().any(|p| p.name == station.name && p.placement != Placement::Fixed);
        if !is_kept && before.as_ref().is_some_and(|before| before.has_entered_sigma(station)) {
            edit.set_sigma(&station.name, [0.0; 2])?;
        }
    }
    for unplaced in &found.unplaced {
        let Some(station) = stations.iter().find(|s| s.name == unplaced.name) else { continue };
        let replaced =
            before.as_ref().and_then(|before| before.of(station)).filter(|p| p.placement != Placement::Fixed);
        let is_identity = station.pose == Some(Pose::IDENTITY) && is_shared(station);
        if let Some(replaced) = replaced.cloned() {
            edit.set_pose(&unplaced.name, replaced.stated.map(|stated| stated.pose()))?;
            edit.set_sigma(&unplaced.name, replaced.stated.and_then(|stated| stated.sigma).unwrap_or_default())?;
        } else if is_identity {
            edit.set_pose(&unplaced.name, None)?;
        }
    }
    for placed in found.stations.iter().filter(|placed| placed.placement != Placement::Fixed) {
        edit.set_pose(&placed.name, Some(placed.pose()))?;
        edit.set_sigma(&placed.name, placed.sigma())?;
    }
    // If only the first file is written, the poses count as edited by hand: this does no harm, and the next run completes the result.
    edit.save()?;
    found.save(folder)?;
    Ok(left)
}

/// The current names of stations by their former names, without the stations that are left unchanged; and messages about those.
fn current_names(read: &Survey, now: &Survey) -> (BTreeMap<String, String>, Vec<String>) {
    let (mut names, mut left) = (BTreeMap::new(), Vec::new());
    for station in &read.stations {
        let is_same =
            |s: &&Station| s.source.blake3 == station.source.blake3 && s.source.number == station.source.number;
        let mut same = now.stations.iter().filter(is_same);
        let own = same.clone().find(|s| s.name == station.name).or_else(|| same.next());
        match own {
            None => left.push(format!("station {} was removed from survey.toml during the run", station.name)),
            Some(own) if (own.pose, own.sigma, own.is_fixed) != (station.pose, station.sigma, station.is_fixed) => {
                left.push(format!(
                    "the pose of station {} was changed in survey.toml during the run and is kept",
                    own.name
                ));
            }
            Some(own) => drop(names.insert(station.name.clone(), own.name.clone())),
        }
    }
    (names, left)
}

impl Registration {
    /// The same with other names, without stations that have none.
    pub(super) fn renamed(&self, names: &BTreeMap<String, String>) -> Self {
        let of = |name: &String| names.get(name).cloned();
        let mut out = self.clone();
        out.stations = self
            .stations
            .iter()
            .filter_map(|placed| Some(Placed { name: of(&placed.name)?, ..placed.clone() }))
            .collect();
        out.unplaced.retain_mut(|unplaced| {
            unplaced.candidates.retain_mut(|candidate| {
                of(&candidate.matched_with).map(|name| candidate.matched_with = name).is_some()
            });
            of(&unplaced.name).map(|name| unplaced.name = name).is_some()
        });
        out.links.retain_mut(|link| {
            let [a, b] = &link.stations;
            of(a).zip(of(b)).map(|(a, b)| link.stations = [a, b]).is_some()
        });
        out.weakest_chain = self.weakest_chain.iter().map(of).collect::<Option<_>>().unwrap_or_default();
        out
    }
}
