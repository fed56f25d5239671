//! Puts the stations of scan files into a survey.
//!
//! Stations are imported one after the other. A station's spool gets its name when it is complete, and then the station is entered in `survey.toml`, so
//! that an import that was killed has lost at most the station that it was reading: with [`Options::resume`], stations that are entered are recognised by the
//! hash of their file and their number in it, and left out.

use crate::ScanError;
use crate::free_space::free_space;
use crate::lock::Lock;
use crate::read::{self, Head, Picture, ReadOptions, Sink};
use crate::spool::{Header, Layout, SAMPLE_BYTES, Writer};
use crate::survey::edit::{Edit, clean_name};
use crate::survey::{PHOTOGRAPHS, Photograph, STATIONS, Source, Station, spool_of};
use kilwa_files::atomic::{Access, AtomicFile};
use kilwa_files::plain_file;
use kilwa_files::size::binary;
use kilwa_formats::Diagnostics;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::{Pose, Sample};
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// How files are imported.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// How they are read.
    pub read: ReadOptions,
    /// Leave out what is already in the survey.
    pub resume: bool,
}

/// Sees how far an import is, and can stop it.
pub trait Progress {
    /// So many of so many bytes are done; `stage` is `hashing` or `reading`.
    fn update(&self, stage: &'static str, done: u64, total: u64);

    /// Whether to stop.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// Shows nothing.
#[derive(Debug, Clone, Copy)]
pub struct Silent;

impl Progress for Silent {
    fn update(&self, _: &'static str, _: u64, _: u64) {}
}

/// A station that was imported.
#[derive(Debug, Clone)]
pub struct Imported {
    /// Its entry in the survey.
    pub station: Station,
    /// What its spool holds.
    pub header: Header,
}

/// What was done.
#[derive(Debug, Default)]
pub struct Report {
    /// Stations that were imported.
    pub stations: Vec<Imported>,
    /// Names of stations that were in the survey before.
    pub skipped: Vec<String>,
    /// Stations that have their position from [`ReadOptions::station`].
    pub positions_given: usize,
    /// Photographs that were taken out of the files.
    pub photographs: usize,
    /// What was repaired or dropped, by file.
    pub diagnostics: Vec<(PathBuf, Diagnostics)>,
}

/// Import `files` into the survey in `folder`, which is made where there is none.
///
/// # Errors
/// [`ScanError`]; stations before the one that failed stay in the survey.
pub fn import(
    folder: &Path,
    files: &[PathBuf],
    options: &Options,
    progress: &dyn Progress,
) -> Result<Report, ScanError> {
    // Before anything is made: a wrong file is better known now than in an hour.
    for file in files {
        read::check(file, &options.read)?;
    }
    fs::create_dir_all(folder).map_err(ScanError::write(folder))?;
    let _lock = Lock::take(folder)?;
    remove_unfinished(folder);
    let mut edit = Edit::open(folder)?;
    let mut report = Report::default();
    let sizes: Vec<u64> = files.iter().map(|file| fs::metadata(file).map_or(0, |about| about.len())).collect();
    // Hashing and reading.
    let total = 2 * sizes.iter().sum::<u64>();
    let mut before = 0;
    for (file, size) in files.iter().zip(sizes) {
        let source = source(file, before, total, progress)?;
        before += size;
        let mut into = Into {
            folder,
            file,
            source,
            options,
            progress,
            before,
            total,
            edit: &mut edit,
            report: &mut report,
            diagnostics: Diagnostics::default(),
            number: 0,
            pictures: 0,
            current: None,
        };
        let done = read::read(file, &options.read, &mut into);
        let diagnostics = std::mem::take(&mut into.diagnostics);
        report.diagnostics.push((file.clone(), diagnostics));
        done?;
        before += size;
    }
    Ok(report)
}

/// Name, length and hash of a file.
fn source(path: &Path, before: u64, total: u64, progress: &dyn Progress) -> Result<Source, ScanError> {
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let mut file = plain_file::open(path).map_err(cannot)?;
    let (mut hash, mut buffer, mut bytes) = (blake3::Hasher::new(), vec![0; 1 << 20], 0);
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    loop {
        if progress.is_stopped() {
            return Err(ScanError::Stopped);
        }
        let n = file.read(&mut buffer).map_err(cannot)?;
        if n == 0 {
            break;
        }
        hash.update(&buffer[..n]);
        bytes += n as u64;
        progress.update("hashing", before + bytes, total);
    }
    Ok(Source { file: name, bytes, blake3: hash.finalize().to_hex().to_string(), number: 0 })
}

/// Fail if `samples` of `file` need more than `free` bytes, the free space of the disk that holds `folder`.
fn check_room(file: &Path, samples: u64, folder: &Path, free: u64) -> Result<(), ScanError> {
    let needed = samples.saturating_mul(SAMPLE_BYTES as u64);
    if needed <= free {
        return Ok(());
    }
    Err(ScanError::Request(format!(
        "{}: its {samples} samples take {} in the survey, and the disk that holds {} has {} free; free some space, or use a survey on a larger disk",
        file.display(),
        binary(needed),
        folder.display(),
        binary(free)
    )))
}

/// Files that a command left that was killed. Nobody else writes here while the lock is held.
pub(crate) fn remove_unfinished(folder: &Path) {
    for folder in [folder.to_owned(), folder.join(STATIONS), folder.join(PHOTOGRAPHS)] {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let name = name.as_encoded_bytes();
            if name.starts_with(b".kilwa-") && name.ends_with(b".part") {
                // What cannot be removed only takes space.
                drop(fs::remove_file(entry.path()));
            }
        }
    }
}

/// A station that is being imported.
struct Current {
    name: String,
    path: PathBuf,
    writer: Writer,
    pose: Option<Pose>,
    instrument: Option<String>,
}

struct Into<'a> {
    folder: &'a Path,
    file: &'a Path,
    source: Source,
    options: &'a Options,
    progress: &'a dyn Progress,
    before: u64,
    total: u64,
    edit: &'a mut Edit,
    report: &'a mut Report,
    diagnostics: Diagnostics,
    number: u64,
    pictures: u64,
    current: Option<Current>,
}

impl Into<'_> {
    /// The station of the survey that is this scan of this file.
    fn known(&self, number: u64) -> Option<&Station> {
        let is = |s: &&Station| s.source.blake3 == self.source.blake3 && s.source.number == number;
        self.edit.survey().stations.iter().find(is)
    }

    fn stem(&self) -> String {
        self.file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    fn current(&mut self) -> Result<&mut Current, ScanError> {
        let message = || ScanError::Request("a sample came before its station".to_owned());
        self.current.as_mut().ok_or_else(message)
    }

    /// Report positions that are probably wrong: they would show much later.
    fn doubt(&mut self, head: &Head) {
        let number = self.number;
        let place = || format!("scan {number}");
        let has_other = |is: fn(&Station) -> bool| self.edit.survey().stations.iter().any(is);
        if head.pose == Some(Pose::IDENTITY) && has_other(|station| station.pose == Some(Pose::IDENTITY)) {
            let kind = "scans that are exactly at the origin, like another station: they are probably not registered";
            self.diagnostics.add(kind, place);
        }
        if head.is_position_given {
            if self.report.positions_given > 0 {
                let kind = "scans that share the position of --station with another scan: correct only for parts of one scan; otherwise import each file with its own --station";
                self.diagnostics.add(kind, place);
            }
            self.report.positions_given += 1;
        }
    }

    /// A folder in the survey.
    fn folder(&self, name: &str) -> Result<PathBuf, ScanError> {
        let folder = self.folder.join(name);
        fs::create_dir_all(&folder).map_err(ScanError::write(&folder))?;
        Ok(folder)
    }
}

impl Sink for Into<'_> {
    fn begin(&mut self, head: &Head) -> Result<bool, ScanError> {
        self.number += 1;
        self.edit.refresh()?;
        if let Some(known) = self.known(self.number) {
            if self.options.resume {
                let name = known.name.clone();
                self.report.skipped.push(name);
                return Ok(false);
            }
            return Err(ScanError::Request(format!(
                "{}: scan {} is already in the survey, as station {}; use --resume to skip it",
                self.file.display(),
                self.number,
                known.name
            )));
        }
        if let Some(samples) = head.samples {
            // If the system does not report its free space, the import goes ahead.
            check_room(self.file, samples, self.folder, free_space(self.folder))?;
        }
        if let Some(crs) = &head.crs
            && !self.edit.set_crs(crs)
        {
            self.diagnostics.add("coordinate reference systems that differ from that of the survey", || crs.clone());
        }
        self.doubt(head);
        let wanted = head.name.clone().filter(|name| !name.trim().is_empty()).unwrap_or_else(|| self.stem());
        let name = self.edit.free_name(&wanted);
        let path = self.folder(STATIONS)?.join(format!("{name}.scan"));
        let writer = Writer::create(&path).map_err(ScanError::write(&path))?;
        self.current = Some(Current { name, path, writer, pose: head.pose, instrument: head.instrument.clone() });
        Ok(true)
    }

    fn skip(&mut self) {
        self.number += 1;
    }

    #[inline]
    fn push(&mut self, sample: &Sample) -> Result<(), ScanError> {
        let current = self.current()?;
        current.writer.push(sample).map_err(|source| ScanError::Write { path: current.path.clone(), source })
    }

    #[inline]
    fn put(&mut self, cell: u64, sample: &Sample) -> Result<bool, ScanError> {
        let current = self.current()?;
        current.writer.put(cell, sample).map_err(|source| ScanError::Write { path: current.path.clone(), source })
    }

    fn end(&mut self, layout: Layout) -> Result<(), ScanError> {
        let Some(Current { name, path, writer, pose, instrument }) = self.current.take() else { return Ok(()) };
        if writer.statistics().measured == 0 {
            let number = self.number;
            self.diagnostics.add("scans without measured points left out", || format!("scan {number}"));
            return Ok(());
        }
        let write = |source| ScanError::Write { path: path.clone(), source };
        let (pending, header) = writer.finish(layout).map_err(write)?;
        // Someone may have edited the survey since the name was chosen.
        self.edit.refresh()?;
        if !self.edit.is_free(&name) {
            return Err(ScanError::Request(format!(
                "the name {name} was given to another station of the survey while {} was read; use --resume to continue",
                self.file.display()
            )));
        }
        // A file of this name that no station has is left from an import that was killed.
        pending.commit(true).map_err(|source| ScanError::Write { path: path.clone(), source })?;
        let station = Station {
            scan: spool_of(&name),
            name,
            pose,
            sigma: None,
            is_fixed: false,
            instrument,
            range_noise: None,
            beam: None,
            masks: Vec::new(),
            source: Source { number: self.number, ..self.source.clone() },
        };
        self.edit.add_station(station.clone());
        self.edit.save()?;
        self.report.stations.push(Imported { station, header });
        Ok(())
    }

    fn picture(
        &mut self,
        picture: &Picture,
        write: &mut dyn FnMut(&mut dyn Write) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        self.pictures += 1;
        let hash = self.source.blake3.get(..8).unwrap_or_default();
        let name = format!("{}-{hash}-{:03}.{}", clean_name(&self.stem()), self.pictures, picture.extension);
        let file = format!("{PHOTOGRAPHS}/{name}");
        if self.edit.survey().photographs.iter().any(|p| p.file == file) {
            return Ok(());
        }
        let path = self.folder(PHOTOGRAPHS)?.join(&name);
        let mut out = AtomicFile::create(&path, Access::Default).map_err(ScanError::write(&path))?;
        write(&mut out)?;
        out.commit(true).map_err(ScanError::write(&path))?;
        // A station may have been renamed by hand.
        self.edit.refresh()?;
        let station = picture.station.and_then(|number| self.known(number)).map(|s| s.name.clone());
        self.edit.add_photograph(Photograph { file, station, pose: picture.pose, camera: picture.camera.clone() });
        self.edit.save()?;
        self.report.photographs += 1;
        Ok(())
    }

    fn progress(&mut self, done: u64) -> Result<(), ScanError> {
        if self.progress.is_stopped() {
            return Err(ScanError::Stopped);
        }
        self.progress.update("reading", self.before + done, self.total);
        Ok(())
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_that_do_not_fit_are_refused_with_both_sizes() {
        let check = |samples, free| check_room(Path::new("a.laz"), samples, Path::new("survey"), free);
        check(1000, 20_000).unwrap();
        let message = check(4_000_000_000, 5 << 30).unwrap_err().to_string();
        assert!(message.contains("4000000000 samples take 75 GiB") && message.contains("5.0 GiB free"), "{message}");
        check(1000, 19_999).unwrap_err();
        check(u64::MAX, u64::MAX - 1).unwrap_err();
    }
}
