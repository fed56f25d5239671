//! Registration of scenes whose true poses are known: what must be placed, what must be refused, and what must never happen.
//!
//! `KILWA_KEEP_SCENES=FOLDER` stores the survey of every registration in a subfolder of its own, together with the ground truth in the format of `kilwa synth scans`,
//! so that failures can be examined.

mod edited;
mod judge;
mod known;
mod real;
mod rooms;
mod runs;
mod scene;
mod traps;

use crate::support::Site;
use judge::Truth;
use kilwa_scan::import::Silent;
use kilwa_scan::read::ReadOptions;
use kilwa_scan::register::{Options, Registration, apply, register};
use kilwa_scan::survey::Survey;
use kilwa_scan::survey::edit::Edit;
use kilwa_scan_core::Pose;
use scene::{Scanner, Scene};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A survey of a scene, and the true poses of its stations.
struct Surveyed {
    site: Site,
    truth: Truth,
}

impl Surveyed {
    fn new() -> Self {
        Self { site: Site::new(), truth: Truth::default() }
    }

    /// Scans of a scene from these positions, imported with the identity as pose.
    fn of(scene: &Scene, stands: &[(&str, [f64; 3])], seed: u64) -> Self {
        let mut surveyed = Self::new();
        surveyed.add(&Scanner::default(), scene, stands, seed);
        surveyed
    }

    /// Add scans. The seed of a scan also depends on its name, so that the scan is the same in any order of the files.
    fn add(&mut self, scanner: &Scanner, scene: &Scene, stands: &[(&str, [f64; 3])], seed: u64) {
        let files: Vec<PathBuf> = stands.iter().map(|(name, at)| self.scan(scanner, scene, name, *at, seed)).collect();
        self.import(&files);
    }

    /// Write one scan to a file.
    fn scan(&mut self, scanner: &Scanner, scene: &Scene, name: &str, at: [f64; 3], seed: u64) -> PathBuf {
        let own = name.bytes().fold(seed, |seed, byte| seed.wrapping_mul(31).wrapping_add(u64::from(byte)));
        let (text, pose) = scanner.scan(scene, at, own);
        self.truth.0.push((name.to_owned(), pose));
        self.site.write(&format!("{name}.ptx"), text)
    }

    fn import(&self, files: &[PathBuf]) {
        self.site.import(files, ReadOptions::default()).unwrap();
    }

    fn folder(&self) -> PathBuf {
        self.site.survey()
    }

    fn survey(&self) -> Survey {
        Survey::open(&self.folder()).unwrap()
    }

    fn set_pose(&self, name: &str, pose: Option<Pose>) {
        let mut edit = Edit::open(&self.folder()).unwrap();
        edit.set_pose(name, pose).unwrap();
        edit.save().unwrap();
    }

    /// Set the standard deviations of a pose: metres, radians.
    fn set_sigma(&self, name: &str, sigma: [f64; 2]) {
        let mut edit = Edit::open(&self.folder()).unwrap();
        edit.set_sigma(name, sigma).unwrap();
        edit.save().unwrap();
    }

    /// Enter what was found into the survey.
    fn apply(&self, found: &Registration) {
        assert_eq!(apply(&self.folder(), &self.survey(), found).unwrap(), [""; 0]);
    }

    fn register(&self) -> Registration {
        self.register_with(&Options::default())
    }

    fn register_with(&self, options: &Options) -> Registration {
        self.keep();
        let started = Instant::now();
        let found = registered(&self.folder(), options);
        println!("{:.1} s\n{}", started.elapsed().as_secs_f64(), self.truth.table(&found));
        found
    }
}

impl Surveyed {
    /// Copy the survey and its ground truth to the folder given by `KILWA_KEEP_SCENES`.
    fn keep(&self) {
        let Some(folder) = std::env::var_os("KILWA_KEEP_SCENES").map(PathBuf::from) else { return };
        let test = std::thread::current().name().unwrap_or("test").rsplit("::").next().unwrap().to_owned();
        let free = (1..10_000).map(|k| folder.join(format!("{test}-{k}"))).find(|place| !place.exists()).unwrap();
        std::fs::create_dir_all(free.join("stations")).unwrap();
        std::fs::copy(self.folder().join("survey.toml"), free.join("survey.toml")).unwrap();
        for station in self.survey().stations {
            std::fs::copy(self.folder().join(&station.scan), free.join(&station.scan)).unwrap();
        }
        std::fs::write(free.join("poses.toml"), self.truth.to_toml()).unwrap();
    }
}

fn registered(folder: &Path, options: &Options) -> Registration {
    register(folder, &Survey::open(folder).unwrap(), options, &Silent).unwrap_or_else(|e| panic!("{e}"))
}

/// Names of the stations that were placed by common surface.
fn placed_by_surface(found: &Registration) -> Vec<&str> {
    let known = [kilwa_scan::register::Placement::Anchor, kilwa_scan::register::Placement::Fixed];
    found.stations.iter().filter(|s| !known.contains(&s.placement)).map(|s| s.name.as_str()).collect()
}
