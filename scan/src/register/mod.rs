//! Registration: stations find their places by themselves.
//!
//! Every station becomes a set of small planes ([`view`]). Each pair of stations is laid over each other in all ways that a levelled scanner allows, and
//! joined if exactly one is right ([`group`], [`assemble`]); then groups of stations, which have more surface in common. All poses are
//! adjusted together, with their covariances ([`settle`]). What does not fit in exactly one place is not placed, and the result says why.

mod assemble;
mod grade;
mod group;
mod result;
mod settle;
mod view;

pub use grade::Grades;
pub use result::{Candidate, FILE, Link, Placed, Placement, Registration, Unplaced};

use crate::ScanError;
use crate::import::Progress;
use crate::survey::{Station, Survey};
use assemble::{Assembled, Known, assemble};
use group::Group;
use kilwa_scan_core::Pose;
use rayon::prelude::*;
use settle::settle;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use view::View;

/// What to do.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Also place stations anew that are registered already.
    pub again: bool,
    /// Do not even use the poses that scans came with as guesses.
    pub ignore_poses: bool,
    /// Stations whose poses stay, besides those that are fixed in `survey.toml`.
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

/// The stations in an order that does not depend on that of the files, and what is known of them.
struct Work<'a> {
    folder: &'a Path,
    survey: &'a Survey,
    stations: Vec<&'a Station>,
    is_fixed: Vec<bool>,
    guesses: Vec<Option<Pose>>,
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
            let station = survey.station(name)?;
            if station.pose.is_none() {
                return Err(ScanError::Request(format!(
                    "station {name} has no pose, so it cannot stay where it is; add rotation and translation to it in survey.toml"
                )));
            }
        }
        let mut stations: Vec<&Station> = survey.stations.iter().collect();
        stations.sort_by(|a, b| {
            let key = |s: &Station| (s.source.blake3.clone(), s.source.number);
            key(a).cmp(&key(b)).then(a.name.cmp(&b.name))
        });
        let before = if options.again { None } else { Registration::open(folder)? };
        let is_known = |s: &Station| before.as_ref().is_some_and(|before| before.of(s).is_some());
        let is_fixed = stations.iter().map(|s| s.is_fixed || options.fixed.contains(&s.name) || is_known(s)).collect();
        // Scans that were never registered often state the same pose.
        let is_alone = |s: &Station| stations.iter().filter(|other| other.pose == s.pose).count() == 1;
        let guess = |s: &&Station| s.pose.filter(|_| !options.ignore_poses && is_alone(s));
        let guesses = stations.iter().map(guess).collect();
        Ok(Self { folder, survey, is_fixed, guesses, stations })
    }

    fn run(&self, progress: &(dyn Progress + Sync)) -> Result<Registration, ScanError> {
        let (views, edge) = self.views(progress)?;
        let fixed = (0..views.len()).filter(|k| self.is_fixed[*k]);
        let fixed: Vec<(usize, Pose)> = fixed.filter_map(|k| Some((k, self.stations[k].pose?))).collect();
        let known = Known { fixed, guesses: &self.guesses };
        let mut assembled = assemble(&views, edge, &known, progress)?;
        let main = self.main_group(&assembled, &known);
        let group = assembled.groups.remove(main);
        self.result(&views, edge, &group, &assembled)
    }

    /// What every station saw.
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
        let edge = view::edge(spacings.into_iter().flatten().collect());
        let views = self.stations.par_iter().map(|station| {
            step()?;
            View::load(self.folder, station, edge)
        });
        Ok((views.collect::<Result<_, _>>()?, edge))
    }

    /// The group that becomes the survey: the one with the fixed stations, or the largest.
    fn main_group(&self, assembled: &Assembled, known: &Known<'_>) -> usize {
        let Some((first, _)) = known.fixed.first() else { return 0 };
        assembled.groups.iter().position(|group| group.pose_of(*first).is_some()).unwrap_or(0)
    }

    fn result(&self, views: &[View], edge: f64, group: &Group, rest: &Assembled) -> Result<Registration, ScanError> {
        let mut out = Registration::empty();
        if group.members.len() > 1 {
            self.place(views, edge, group, &mut out)?;
        }
        for group in &rest.groups {
            for (number, _) in &group.members {
                out.unplaced.push(Unplaced {
                    name: self.stations[*number].name.clone(),
                    reason: String::new(),
                    candidates: Vec::new(),
                    remedy: String::new(),
                });
            }
        }
        let order = |name: &str| self.survey.stations.iter().position(|s| s.name == name);
        out.stations.sort_by_key(|placed| order(&placed.name));
        out.unplaced.sort_by_key(|unplaced| order(&unplaced.name));
        Ok(out)
    }

    fn place(&self, views: &[View], edge: f64, group: &Group, out: &mut Registration) -> Result<(), ScanError> {
        let is_fixed: Vec<bool> = group.members.iter().map(|(k, _)| self.is_fixed[*k]).collect();
        let has_fixed = is_fixed.contains(&true);
        let mut group = group.clone();
        if let Some(first) = is_fixed.iter().position(|fixed| *fixed) {
            group.move_to(first, self.stations[group.members[first].0].pose.unwrap_or_default());
        }
        let settled = settle(views, &group, &is_fixed, &|_| Vec::new(), edge);
        let mut settled = settled.ok_or_else(|| {
            let message = "the poses cannot be adjusted: the stations have too little surface in common";
            ScanError::Request(message.to_owned())
        })?;
        let anchor = settled.is_fixed.iter().position(|fixed| *fixed).unwrap_or(0);
        if !has_fixed {
            settled.move_to(anchor, self.guesses[group.members[anchor].0].unwrap_or_default());
        }
        let name = |k: usize| self.stations[group.members[k].0].name.clone();
        for (k, (pose, covariance)) in settled.poses.iter().zip(&settled.covariances).enumerate() {
            let q = pose.rotation;
            out.stations.push(Placed {
                name: name(k),
                placement: if k == anchor && !has_fixed { Placement::Anchor } else if settled.is_fixed[k] { Placement::Fixed } else { Placement::Surface },
                rotation: [q.w, q.x, q.y, q.z],
                translation: pose.translation.to_array(),
                covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
            });
        }
        for ((a, b), link) in &settled.links {
            out.links.push(Link {
                stations: [name(*a), name(*b)],
                overlap: 0.0,
                samples: link.matched as u64,
                residual: link.residual(),
                contradicted: 0.0,
                sigma: None,
            });
        }
        Ok(())
    }
}

#[doc(hidden)]
pub fn trial(folder: &Path, survey: &Survey, truth: &dyn Fn(&str) -> Pose) -> Registration {
    let work = Work::new(folder, survey, &Options::default()).unwrap();
    let (views, edge) = work.views(&crate::import::Silent).unwrap();
    let mut group = Group::single(0, &views[0]);
    group.members[0].1 = truth(&work.stations[0].name);
    for k in 1..views.len() {
        let other = Group::single(k, &views[k]);
        group = group.joined(&other, truth(&work.stations[k].name), &views);
    }
    let mut out = Registration::empty();
    let t = std::time::Instant::now();
    work.place(&views, edge, &group, &mut out).unwrap();
    eprintln!("settled in {:.1} s", t.elapsed().as_secs_f64());
    out
}
