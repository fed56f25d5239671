//! Surveys of tests.

use glam::DVec3;
use kilwa_scan::ScanError;
use kilwa_scan::import::{Options, Report, Silent, import};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
use kilwa_scan_core::Sample;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A folder with files and a survey.
pub(crate) struct Site(pub(crate) tempfile::TempDir);

impl Site {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    pub(crate) fn survey(&self) -> PathBuf {
        self.path("survey")
    }

    pub(crate) fn import(&self, files: &[PathBuf], read: ReadOptions) -> Result<Report, ScanError> {
        import(&self.survey(), files, &Options { read, resume: false }, &Silent)
    }

    /// All samples of a station.
    pub(crate) fn samples(&self, station: &str) -> Vec<Sample> {
        samples(&self.survey().join(format!("stations/{station}.scan")))
    }
}

pub(crate) fn samples(path: &Path) -> Vec<Sample> {
    let mut reader = Reader::open(path).unwrap();
    let (cells, mut out) = (reader.header().grid.cells(), Vec::new());
    reader.read(0, cells as usize, &mut out).unwrap();
    out
}

/// Options of a cloud whose scanner was here.
pub(crate) fn seen_from(x: f64, y: f64, z: f64) -> ReadOptions {
    ReadOptions { station: Some(DVec3::new(x, y, z)), ..ReadOptions::default() }
}

/// A folder beside the project that holds real files, if it is there.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found = ["../../shared", "../../../shared"].map(|up| here.join(up).join(name)).into_iter().find(|p| p.is_dir());
    if found.is_none() {
        eprintln!("skipped: {name} is not there");
    }
    found
}

/// The header of a PTX scan at this place.
pub(crate) fn ptx_header(columns: u32, rows: u32, at: [f64; 3]) -> String {
    let [x, y, z] = at;
    format!("{columns}\n{rows}\n{x} {y} {z}\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} {y} {z} 1\n")
}

/// A file of three scans of more than a mebibyte each, so that progress is reported within each.
pub(crate) fn three_scans(site: &Site) -> PathBuf {
    let mut text = String::new();
    for scan in 1..=3 {
        text += &ptx_header(200, 300, [f64::from(scan), 0.0, 0.0]);
        for k in 0..60_000 {
            writeln!(text, "{scan}.{k:06} {k}.25 -0.5 0.125", k = k % 5000).unwrap();
        }
    }
    site.write("three.ptx", text)
}
