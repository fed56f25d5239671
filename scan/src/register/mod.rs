//! Registration: finding the poses of the stations of a survey.
//!
//! Each station is reduced to small planes ([`view`]). For each pair of stations, all relative poses that levelled scanners allow are compared, and the pair is
//! joined if exactly one pose fits ([`group`], [`assemble`]). Groups of stations, which have more surface in common, are then joined in the same way. All poses are
//! adjusted together, with their covariances ([`settle`]). A station whose pose is not unique is not placed, and the result gives the reason ([`report`]).

mod assemble;
mod control;
mod group;
mod report;
mod result;
mod settle;
mod view;

pub use result::{Candidate, FILE, Link, Placed, Placement, Registration, Unplaced};

use crate::ScanError;
use crate::import::Progress;
use crate::lock::Lock;
use crate::survey::edit::Edit;
use crate::survey::{Station, Survey};
use assemble::{Assembled, Guess, Known, assemble};
use control::Controls;
use group::Group;
use kilwa_scan_core::Pose;
use rayon::prelude::*;
use report::Report;
use settle::{Given, settle};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use view::View;

/// A known pose is assumed to be within this many standard deviations of the truth.
const SURE: f64 = 4.0;

/// Options of [`register`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Also register stations that are already registered.
    pub again: bool,
    /// Ignore the poses stored with the scans, even as initial estimates.
    pub ignore_poses: bool,
    /// Stations that keep their poses, in addition to those marked as fixed in `survey.toml`.
    pub fixed: Vec<String>,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
}

/// Find the poses of the stations of a survey; writes nothing.
///
/// # Errors
/// [`ScanError::Request`] for surveys that cannot be registered; [`ScanError::Spool`], [`ScanError::Mask`], [`ScanError::Read`] for damaged files; [`ScanError::Stopped`].
pub fn register(
    folder: &Path,
    survey: &Survey,
    options: &Options,
    progress: &(dyn Progress + Sync),
) -> Result<Registration, ScanError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
    let pool = pool.map_err(|e| ScanError::Request(format!("cannot start threads: {e}")))?;
    pool.install(|| Work::new(folder, survey, options)?.run(progress))
}

/// Write the poses to `survey.toml` and the whole result to `registration.json`. An unplaced station loses its pose if other stations have the same one, because such a pose is a placeholder.
///
/// # Errors
/// [`ScanError::Request`] if another command is writing to the survey, or if a station is gone; [`ScanError::Survey`], [`ScanError::Write`].
pub fn apply(folder: &Path, found: &Registration) -> Result<(), ScanError> {
    let _lock = Lock::take(folder)?;
    let mut edit = Edit::open(folder)?;
    for unplaced in &found.unplaced {
        let own = edit.survey().station(&unplaced.name)?.pose;
        if own.is_some() && edit.survey().stations.iter().filter(|s| s.pose == own).count() > 1 {
            edit.set_pose(&unplaced.name, None)?;
        }
    }
    for placed in found.stations.iter().filter(|placed| placed.placement != Placement::Fixed) {
        edit.set_pose(&placed.name, Some(placed.pose()))?;
        edit.set_sigma(&placed.name, placed.sigma())?;
    }
    // One file without the other does no harm: an entry of `registration.json` counts only if its pose equals the one in `survey.toml`.
    found.save(folder)?;
    edit.save()
}

/// The stations, in an order that does not depend on the order of the files, and what is known about them.
struct Work<'a> {
    folder: &'a Path,
    survey: &'a Survey,
    stations: Vec<&'a Station>,
    is_fixed: Vec<bool>,
    guesses: Vec<Option<Guess>>,
    controls: Controls,
    /// The previous result, for stations that keep their poses.
    before: Option<Registration>,
}

impl<'a> Work<'a> {
    fn new(folder: &'a Path, survey: &'a Survey, options: &Options) -> Result<Self, ScanError> {
        if survey.stations.len() < 2 {
            let what = if survey.stations.is_empty() { "no stations" } else { "one station" };
            return Err(ScanError::Request(format!(
                "the survey {} has {what}; registration needs two or more: import more scans with `kilwa scans import`",
                folder.display()
            )));
        }
        for name in &options.fixed {
            if survey.station(name)?.pose.is_none() {
                return Err(ScanError::Request(format!(
                    "station {name} has no pose, so it cannot be fixed; add rotation and translation to it in survey.toml"
                )));
            }
        }
        let mut stations: Vec<&Station> = survey.stations.iter().collect();
        stations.sort_by(|a, b| {
            let hashes = a.source.blake3.cmp(&b.source.blake3);
            hashes.then(a.source.number.cmp(&b.source.number)).then(a.name.cmp(&b.name))
        });
        let registered = Registration::open(folder)?;
        let is_registered = |s: &Station| registered.as_ref().is_some_and(|before| before.of(s).is_some());
        let stays = |s: &&Station| {
            s.pose.is_some() && (s.is_fixed || options.fixed.contains(&s.name) || !options.again && is_registered(s))
        };
        let is_fixed = stations.iter().map(stays).collect();
        // Scans that were never registered often have the same placeholder pose.
        let is_alone = |s: &Station| stations.iter().filter(|other| other.pose == s.pose).count() == 1;
        let guess = |s: &&Station| {
            let pose = s.pose.filter(|_| !options.ignore_poses && is_alone(s))?;
            let sigma = s.sigma.filter(|_| !is_registered(s));
            Some(Guess { pose, reach: sigma.map(|sigma| sigma.map(|v| SURE * v)) })
        };
        let guesses = stations.iter().map(guess).collect();
        let controls = Controls::new(survey, &stations);
        Ok(Self { folder, survey, is_fixed, guesses, controls, stations, before: registered })
    }

    fn run(&self, progress: &(dyn Progress + Sync)) -> Result<Registration, ScanError> {
        let known = self.known()?;
        if known.fixed.len() == self.stations.len()
            && let Some(before) = &self.before
            && self.stations.iter().all(|s| before.of(s).is_some())
        {
            return Ok(before.clone());
        }
        let (views, edge) = self.views(progress)?;
        let mut assembled = assemble(&views, edge, &known, progress)?;
        let main = main_group(&assembled, &known);
        let group = assembled.groups.remove(main);
        progress.update("adjusting all poses", 0, 1);
        self.result(&views, edge, &group, &assembled)
    }

    fn known(&self) -> Result<Known<'_>, ScanError> {
        let name = |k: Option<usize>| {
            k.map_or_else(|| "the survey".to_owned(), |k| format!("station {}", self.stations[k].name))
        };
        let mut located: BTreeMap<usize, Pose> = BTreeMap::new();
        for (k, station) in self.stations.iter().enumerate() {
            let controlled = self.controls.pose(None, Some(k), &name)?;
            if let Some(pose) = station.pose.filter(|_| self.is_fixed[k]).or(controlled) {
                located.insert(k, pose);
            }
        }
        let mut controlled = BTreeMap::new();
        for b in 0..self.stations.len() {
            for a in 0..b {
                if let Some(pose) = self.controls.pose(Some(a), Some(b), &name)? {
                    controlled.insert((a, b), pose);
                }
            }
        }
        Ok(Known { fixed: located.into_iter().collect(), guesses: &self.guesses, controlled })
    }

    /// The views of all stations, and the edge of the smallest voxels, metres.
    fn views(&self, progress: &(dyn Progress + Sync)) -> Result<(Vec<View>, f64), ScanError> {
        let (done, total) = (AtomicU64::new(0), 2 * self.stations.len() as u64);
        let step = || {
            progress.update("reading stations", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            if progress.is_stopped() { Err(ScanError::Stopped) } else { Ok(()) }
        };
        let spacings = self.stations.par_iter().map(|station| {
            step()?;
            view::spacing(self.folder, station)
        });
        let spacings: Vec<Option<f64>> = spacings.collect::<Result<_, _>>()?;
        let edge = view::edge(spacings.iter().copied().flatten().collect());
        let views = self.stations.par_iter().zip(&spacings).map(|(station, spacing)| {
            step()?;
            View::load(self.folder, station, edge, spacing.unwrap_or(edge))
        });
        Ok((views.collect::<Result<_, _>>()?, edge))
    }

    fn result(&self, views: &[View], edge: f64, group: &Group, rest: &Assembled) -> Result<Registration, ScanError> {
        let mut out = Registration::empty();
        let mut report = Report { views, edge, stations: &self.stations, pairs: &rest.pairs, poses: BTreeMap::new() };
        if group.members.len() > 1 || group.members.iter().any(|(k, _)| self.is_fixed[*k]) {
            self.place(group, &mut report, &mut out)?;
        }
        let unplaced = rest.groups.iter().chain((report.poses.is_empty()).then_some(group));
        for group in unplaced {
            report.unplaced(group, &mut out);
        }
        let order = |name: &str| self.survey.stations.iter().position(|s| s.name == name);
        out.stations.sort_by_key(|placed| order(&placed.name));
        out.unplaced.sort_by_key(|unplaced| order(&unplaced.name));
        Ok(out)
    }

    /// What is known about the members of a group, by their indices in it.
    fn given(&self, group: &Group) -> Given {
        let is_fixed = group.members.iter().map(|(k, _)| self.is_fixed[*k]).collect();
        let of_member = |k: usize| group.members.iter().position(|(own, _)| *own == k);
        let prior = |(member, (k, _)): (usize, &(usize, Pose))| {
            let Guess { pose, reach } = self.guesses[*k].filter(|_| !self.is_fixed[*k])?;
            Some((member, pose, reach?.map(|v| v / SURE)))
        };
        let priors = group.members.iter().enumerate().filter_map(prior).collect();
        let mut controls = self.controls.clone();
        for sightings in controls.points.values_mut() {
            sightings.retain_mut(|sighting| {
                let member = sighting.station.map(of_member);
                sighting.station = member.flatten();
                member.is_none_or(|member| member.is_some())
            });
        }
        controls.points.retain(|_, all| all.len() > 1);
        Given { is_fixed, priors, controls }
    }

    fn place(&self, group: &Group, report: &mut Report<'_>, out: &mut Registration) -> Result<(), ScanError> {
        let given = self.given(group);
        let mut group = group.clone();
        let name = |_: Option<usize>| String::new();
        let located = |k: usize| -> Option<Pose> {
            let number = group.members[k].0;
            let stays = self.stations[number].pose.filter(|_| self.is_fixed[number]);
            let controlled = || self.controls.pose(None, Some(number), &name).ok().flatten();
            stays
                .or_else(controlled)
                .or_else(|| given.priors.iter().find(|(own, ..)| *own == k).map(|(_, pose, _)| *pose))
        };
        let first = (0..group.members.len()).find_map(|k| Some((k, located(k)?)));
        if let Some((k, pose)) = first {
            group.move_to(k, pose);
        }
        // Fixed poses must stay bit-identical.
        for (number, pose) in group.members.iter_mut().filter(|(number, _)| self.is_fixed[*number]) {
            *pose = self.stations[*number].pose.unwrap_or(*pose);
        }
        let settled = settle(report.views, &group, &given, report.edge);
        let mut settled = settled.ok_or_else(|| {
            let message = "the poses cannot be adjusted: the stations have too little surface in common";
            ScanError::Request(message.to_owned())
        })?;
        let anchor = settled.is_fixed.iter().position(|fixed| *fixed).filter(|_| first.is_none());
        if let Some(anchor) = anchor {
            let guess = self.guesses[group.members[anchor].0];
            settled.move_to(anchor, guess.map_or(Pose::IDENTITY, |guess| guess.pose));
        }
        let of_controls = |k: usize| {
            given.controls.points.values().filter(|all| all.iter().any(|s| s.station == Some(k))).count()
                >= control::MIN_POINTS
        };
        for (k, (pose, covariance)) in settled.poses.iter().zip(&settled.covariances).enumerate() {
            let number = group.members[k].0;
            let placement = match () {
                () if anchor == Some(k) => Placement::Anchor,
                () if settled.is_fixed[k] => Placement::Fixed,
                () if of_controls(k) => Placement::Control,
                () => Placement::Surface,
            };
            report.poses.insert(number, *pose);
            let station = self.stations[number];
            let known = self.before.as_ref().and_then(|before| before.of(station)).filter(|_| settled.is_fixed[k]);
            let q = pose.rotation;
            out.stations.push(known.cloned().unwrap_or_else(|| Placed {
                name: station.name.clone(),
                placement,
                rotation: [q.w, q.x, q.y, q.z],
                translation: pose.translation.to_array(),
                covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
            }));
        }
        report.links(&group, &settled, out);
        Ok(())
    }
}

/// The group that becomes the registered survey: the one that contains the fixed stations, or otherwise the largest.
fn main_group(assembled: &Assembled, known: &Known<'_>) -> usize {
    let Some((first, _)) = known.fixed.first() else { return 0 };
    assembled.groups.iter().position(|group| group.pose_of(*first).is_some()).unwrap_or(0)
}
