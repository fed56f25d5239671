//! A survey (`kilwa scans import`) for people to look at: a plan and a list of its stations, and pictures of each.
//!
//! | URL | what |
//! |---|---|
//! | `/` | the plan and the list ([`plan`]) |
//! | `/plan.png` | the samples of all stations with a pose, seen from above |
//! | `/stations/<name>/` | a station: facts and a picture that zooms ([`station`]) |
//! | `/stations/<name>/<show>.png` | its picture: `range`, `intensity`, `colour`, `mask` |
//! | `/stations/<name>/<show>/<column>-<row>.png` | a tile of that picture with every cell of the grid |
//! | `/stations/<name>/at/<column>-<row>.json` | the sample of a cell ([`control`]) |
//! | `/control/` | marking the same places in two stations ([`control`]) |
//! | `/control/fit` | how well the marked pairs fit (POST) |
//!
//! Pictures are those of `kilwa scans view` ([`kilwa_scan::panorama`]), drawn when somebody asks for them and kept in memory ([`pictures`]). Invariants: a
//! name in an address is looked up among the stations of `survey.toml` and never becomes a path; the file's paths are opened only if they contain
//! no link; what a page shows follows the files, whose times are checked at every request. Failures: a station, a mask or a picture that
//! cannot be read is shown with the reason, and the others as usual; so is `registration.json` ([`registered`]).

mod control;
mod control_page;
mod pictures;
mod plan;
mod plan_page;
mod registered;
pub(crate) mod routes;
mod station;

use kilwa_files::plain_file;
use kilwa_scan::ScanError;
use kilwa_scan::mask::{self, MaskReader};
use kilwa_scan::spool::{Header, Reader};
use kilwa_scan::survey::{FILE, Mask, Station, Survey};
use pictures::Pictures;
use plan::Plan;
use registered::Cached;
use std::collections::HashMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A survey that is served.
#[derive(Debug)]
pub struct Surveyed {
    folder: PathBuf,
    read: Mutex<Read>,
    stations: Mutex<HashMap<String, Arc<Facts>>>,
    plan: Mutex<Option<Arc<Plan>>>,
    registration: Mutex<Cached>,
    pictures: Pictures,
}

/// `survey.toml` when it was last read.
#[derive(Debug)]
struct Read {
    /// Which state of the file that was.
    stamp: String,
    /// Its content, or its mistakes.
    survey: Result<Arc<Survey>, Arc<str>>,
}

/// What is known of a station without reading its samples.
#[derive(Debug)]
pub(crate) struct Facts {
    /// Differs where the scan, the masks or which of them are on differ.
    identity: String,
    /// Of the scan, or why it cannot be read.
    pub(crate) header: Result<Header, String>,
    /// Samples that the masks that are on mask together, or why they cannot be read.
    pub(crate) masked: Result<u64, String>,
    /// Samples of each mask.
    pub(crate) masks: Vec<Result<u64, String>>,
    /// What was found wrong when samples were read.
    fault: OnceLock<String>,
}

impl Facts {
    /// Why the station cannot be read, as far as that is known.
    pub(crate) fn trouble(&self) -> Option<&str> {
        self.header.as_ref().err().or_else(|| self.fault.get()).map(String::as_str)
    }
}

impl Surveyed {
    /// The survey in a folder.
    ///
    /// # Errors
    /// [`ScanError`] where `survey.toml` has mistakes or cannot be opened.
    pub fn open(folder: &Path) -> Result<Self, ScanError> {
        let stamp = stamp(&folder.join(FILE));
        let survey = Survey::open(folder)?;
        Ok(Self {
            folder: folder.to_owned(),
            read: Mutex::new(Read { stamp, survey: Ok(Arc::new(survey)) }),
            stations: Mutex::default(),
            plan: Mutex::default(),
            registration: Mutex::default(),
            pictures: Pictures::default(),
        })
    }

    /// How many stations there are.
    pub fn stations(&self) -> usize {
        self.survey().map_or(0, |survey| survey.stations.len())
    }

    /// How many pictures were drawn, those that are no longer kept included.
    pub fn drawn(&self) -> u64 {
        self.pictures.drawn()
    }

    /// The survey as its file is now, or the mistakes in it.
    pub(crate) fn survey(&self) -> Result<Arc<Survey>, Arc<str>> {
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let now = stamp(&self.folder.join(FILE));
        if read.stamp != now {
            let survey = Survey::open(&self.folder).map(Arc::new);
            *read = Read { stamp: now, survey: survey.map_err(|e| self.sentence(&e).into()) };
        }
        read.survey.clone()
    }

    /// What is known of a station as its files are now.
    pub(crate) fn facts(&self, station: &Station) -> Arc<Facts> {
        let identity = self.identity(station);
        let known = |stations: &HashMap<String, Arc<Facts>>| {
            stations.get(&station.name).filter(|facts| facts.identity == identity).cloned()
        };
        if let Some(facts) = known(&self.stations.lock().unwrap_or_else(PoisonError::into_inner)) {
            return facts;
        }
        // Not under the lock: counting what masks mask reads them.
        let facts = Arc::new(self.read_facts(station, identity.clone()));
        let mut stations = self.stations.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(facts) = known(&stations) {
            return facts;
        }
        stations.insert(station.name.clone(), Arc::clone(&facts));
        facts
    }

    fn read_facts(&self, station: &Station, identity: String) -> Facts {
        let count = |mask: &Mask| self.mask(mask).map(|mask| mask.header().masked);
        let sentence = |e: ScanError| self.sentence(&e);
        let header = self.reader(station, true).map(|reader| *reader.header()).map_err(sentence);
        let masked = match &header {
            Ok(_) if station.masks.iter().any(|mask| mask.is_on) => {
                self.reader(station, false).and_then(|mut reader| mask::count(&mut reader)).map_err(sentence)
            }
            _ => Ok(0),
        };
        let masks = station.masks.iter().map(|mask| count(mask).map_err(sentence)).collect();
        Facts { identity, header, masked, masks, fault: OnceLock::new() }
    }

    fn identity(&self, station: &Station) -> String {
        let mut hash = blake3::Hasher::new();
        let mut add = |file: &str, more: &str| {
            let found = plain_file::metadata_inside(&self.folder, &self.folder.join(file));
            let state = found.map_or_else(|e| e.to_string(), |metadata| plain_file::stamp(&metadata));
            for text in [file, more, &state] {
                hash.update(&(text.len() as u64).to_le_bytes());
                hash.update(text.as_bytes());
            }
        };
        add(&station.scan, "");
        for mask in &station.masks {
            add(&mask.file, &format!("{} {}", mask.name, mask.is_on));
        }
        hash.finalize().to_hex()[..32].to_owned()
    }

    /// The scan of a station with the masks that are on, or without any.
    pub(crate) fn reader(&self, station: &Station, unmasked: bool) -> Result<Reader, ScanError> {
        self.check_file(&station.scan)?;
        let mut masks = station.masks.iter().filter(|mask| mask.is_on && !unmasked);
        masks.try_for_each(|mask| self.check_file(&mask.file))?;
        mask::open(&self.folder, station, unmasked)
    }

    pub(crate) fn mask(&self, mask: &Mask) -> Result<MaskReader, ScanError> {
        self.check_file(&mask.file)?;
        MaskReader::open(&self.folder.join(&mask.file), &mask.name)
    }

    /// Refuse what is no file of the survey. What is missing is refused where it is opened.
    fn check_file(&self, file: &str) -> Result<(), ScanError> {
        match plain_file::metadata_inside(&self.folder, &self.folder.join(file)) {
            Err(e) if plain_file::is_other(&e) => Err(ScanError::Request(format!(
                "{file} is a link, in a linked folder, or not a regular file; links are not followed here: put the file itself there"
            ))),
            _ => Ok(()),
        }
    }

    /// An error for readers, who need not know where the folder is.
    pub(crate) fn sentence(&self, error: &ScanError) -> String {
        let mut text = error.to_string();
        let mut cause = error.source();
        while let Some(error) = cause {
            let more = error.to_string();
            if !text.contains(&more) {
                text = format!("{text}: {more}");
            }
            cause = error.source();
        }
        text.replace(&format!("{}/", self.folder.display()), "")
    }

    /// As [`Self::sentence`]; a scan that is damaged is remembered as such.
    pub(crate) fn fault(&self, facts: &Facts, error: &ScanError) -> String {
        let sentence = self.sentence(error);
        if matches!(error, ScanError::Spool { .. } | ScanError::Read(_)) {
            // The first is as good as a later one.
            let _ = facts.fault.set(sentence.clone());
        }
        sentence
    }
}

/// Which state of a file is there.
fn stamp(file: &Path) -> String {
    let metadata = std::fs::metadata(file);
    metadata.map_or_else(|e| e.to_string(), |metadata| plain_file::stamp(&metadata))
}
