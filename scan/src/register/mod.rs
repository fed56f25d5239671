//! Registration: finding the poses of the stations of a survey.
//!
//! Each station is reduced to small planes ([`view`]). For each pair of stations, all relative poses that levelled scanners allow are compared, and the pair is
//! joined if exactly one pose fits ([`group`], [`assemble`]). Groups of stations, which have more surface in common, are then joined in the same way. All poses are
//! adjusted together, with their covariances ([`settle`]), and checked again ([`place`]). A station whose pose is not unique is not placed, and the result gives the reason ([`report`]).

mod align;
mod ambiguous;
mod apply;
mod assemble;
mod control;
mod doubt;
mod grade;
mod group;
mod known;
mod pairs;
mod place;
mod report;
mod residuals;
mod result;
mod seen_through;
mod settle;
mod view;

pub use apply::apply;
pub use control::{Alignment, MIN_POINTS, PointPair, align_points, common_points};
pub use grade::Grades;
pub use residuals::{Residual, residuals, write_residuals};
pub use result::{Candidate, FILE, KnownSigma, Link, Placed, Placement, Registration, Stated, Unplaced};

use crate::ScanError;
use crate::import::Progress;
use crate::survey::{Station, Survey};
use assemble::{Assembled, assemble};
use control::Controls;
use group::Group;
use kilwa_scan_core::Pose;
use known::{Guess, Known};
use report::Report;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
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
    in_threads(options.threads, || Work::new(folder, survey, options)?.run(progress))
}

/// Runs work on this number of threads; 0 means one per core.
fn in_threads<T: Send>(threads: usize, work: impl FnOnce() -> Result<T, ScanError> + Send) -> Result<T, ScanError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| ScanError::Request(format!("cannot start threads: {e}")))?.install(work)
}

/// The stations, in an order that does not depend on the order of the files, and what is known about them.
struct Work<'a> {
    folder: &'a Path,
    survey: &'a Survey,
    options: &'a Options,
    stations: Vec<&'a Station>,
    /// Stations whose poses the user asked to keep.
    is_fixed: Vec<bool>,
    /// Stations that keep their poses: these, and those that are already registered and are not to be registered again.
    keeps_pose: Vec<bool>,
    /// Poses that do not come from an earlier registration.
    stated: Vec<Option<Stated>>,
    controls: Controls,
    /// The previous result, for stations that keep their poses.
    before: Option<Registration>,
}

impl<'a> Work<'a> {
    fn new(folder: &'a Path, survey: &'a Survey, options: &'a Options) -> Result<Self, ScanError> {
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
                    "station {name} has no pose that could be kept; add rotation and translation to it in survey.toml"
                )));
            }
        }
        let mut stations: Vec<&Station> = survey.stations.iter().collect();
        stations.sort_by(|a, b| {
            let hashes = a.source.blake3.cmp(&b.source.blake3);
            hashes.then(a.source.number.cmp(&b.source.number)).then(a.name.cmp(&b.name))
        });
        let before = match Registration::open(folder) {
            // Everything in it is determined again.
            Err(ScanError::Request(_)) if options.again => None,
            other => other?,
        };
        let is_fixed: Vec<bool> =
            stations.iter().map(|s| s.pose.is_some() && (s.is_fixed || options.fixed.contains(&s.name))).collect();
        let is_registered = |s: &Station| before.as_ref().is_some_and(|before| before.of(s).is_some());
        let keeps_pose = stations.iter().zip(&is_fixed).map(|(s, fixed)| *fixed || !options.again && is_registered(s));
        let keeps_pose = keeps_pose.collect();
        let stated = stations.iter().map(|s| Registration::stated(before.as_ref(), s)).collect();
        let controls = Controls::new(survey, &stations);
        Ok(Self { folder, survey, options, stations, is_fixed, keeps_pose, stated, controls, before })
    }

    fn run(&self, progress: &(dyn Progress + Sync)) -> Result<Registration, ScanError> {
        if let Some(same) = self.nothing_to_do() {
            return Ok(same);
        }
        let mut known = self.known()?;
        let (views, edge) = view::load_all(self.folder, &self.stations, progress)?;
        known.edge = edge;
        self.check_known(&views, edge, &known)?;
        let mut assembled = assemble(&views, edge, &known, progress)?;
        let main = self.main_group(&assembled);
        let group = assembled.groups.remove(main);
        self.result(&views, edge, group, &assembled, &known, progress)
    }

    /// The previous result, if no station is to be registered.
    fn nothing_to_do(&self) -> Option<Registration> {
        let before = self.before.as_ref().filter(|_| !self.options.again)?;
        let is_covered =
            self.keeps_pose.iter().zip(&self.stations).all(|(keeps_pose, s)| *keeps_pose && before.of(s).is_some());
        // Without stations that were removed since.
        is_covered.then(|| before.with_current_names(self.survey))
    }

    fn name(&self, station: Option<usize>) -> String {
        station.map_or_else(|| "the survey".to_owned(), |k| format!("station {}", self.stations[k].name))
    }

    /// The known pose of a station, with its standard deviations (metres, radians).
    fn prior(&self, k: usize) -> Option<(Pose, [f64; 2])> {
        let stated = self.stated[k].filter(|_| !self.keeps_pose[k] && !self.options.ignore_poses)?;
        Some((stated.pose(), stated.sigma?))
    }

    /// An approximate pose of a station that is to be registered.
    fn guess(&self, k: usize) -> Option<Guess> {
        if let Some((pose, sigma)) = self.prior(k) {
            return Some(Guess { pose, reach: Some(sigma.map(|v| SURE * v)) });
        }
        // Scans that were never registered often state the same pose.
        let own = self.stations[k].pose;
        let is_alone = self.stations.iter().filter(|other| other.pose == own).count() == 1;
        own.filter(|_| !self.options.ignore_poses && is_alone).map(|pose| Guess { pose, reach: None })
    }

    fn known(&self) -> Result<Known, ScanError> {
        let name = |k| self.name(k);
        let mut fixed: BTreeMap<usize, Pose> = BTreeMap::new();
        for (k, station) in self.stations.iter().enumerate() {
            let controlled = self.controls.pose(None, Some(k), &name)?;
            if let Some(pose) = station.pose.filter(|_| self.keeps_pose[k]).or(controlled) {
                fixed.insert(k, pose);
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
        let exact = |pose: &Pose| Guess { pose: *pose, reach: Some([0.0; 2]) };
        let guesses = (0..self.stations.len()).map(|k| fixed.get(&k).map(exact).or_else(|| self.guess(k)));
        Ok(Known { guesses: guesses.collect(), fixed: fixed.into_iter().collect(), controlled, edge: 0.0 })
    }

    fn result(
        &self,
        views: &[View],
        edge: f64,
        group: Group,
        rest: &Assembled,
        known: &Known,
        progress: &(dyn Progress + Sync),
    ) -> Result<Registration, ScanError> {
        let mut out = Registration::empty();
        let mut report = Report {
            views,
            edge,
            stations: &self.stations,
            pairs: &rest.pairs,
            poses: BTreeMap::new(),
            dropped: BTreeMap::new(),
        };
        let members: BTreeSet<usize> = group.members.iter().map(|(k, _)| *k).collect();
        self.place(group, known, &mut report, &mut out, progress)?;
        let left = members.into_iter().filter(|k| !report.poses.contains_key(k));
        let left: Vec<Group> = left.map(|k| Group::single(k, &views[k])).collect();
        for group in rest.groups.iter().chain(&left) {
            report.unplaced(group, &mut out);
        }
        let order = |name: &str| self.survey.stations.iter().position(|s| s.name == name);
        out.stations.sort_by_key(|placed| order(&placed.name));
        out.unplaced.sort_by_key(|unplaced| order(&unplaced.name));
        Ok(out)
    }

    /// The group that becomes the registered survey: the one that contains the stations that keep their poses, or otherwise the largest.
    fn main_group(&self, assembled: &Assembled) -> usize {
        let has_kept = |group: &Group| group.members.iter().any(|(k, _)| self.keeps_pose[*k]);
        assembled.groups.iter().position(has_kept).unwrap_or(0)
    }
}
