//! Makes masks, station by station.
//!
//! The file of a mask gets its name when it is complete, and the masks of all stations are entered in `survey.toml` together at the end: a command that
//! is killed leaves the masks from before, and nothing of its own but files that the same command, given again, takes as they are. Names of files
//! hold a digest of everything that the mask depends on.

use super::manage::remove_files;
use super::{MaskReader, MaskWriter, Numbering, Recipe, digest_of_poses, list, through};
use crate::ScanError;
use crate::import::{Progress, remove_unfinished};
use crate::lock::Lock;
use crate::spool::Reader;
use crate::survey::edit::Edit;
use crate::survey::parse::is_mask_name;
use crate::survey::{Mask, STATIONS, Station, Survey};
use crate::turn::Turn;
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::mask::components::{Finder, Joining};
use kilwa_scan_core::mask::limits::{Grazing, is_beyond, is_inside};
use kilwa_scan_core::mask::mixed::Mixed;
use kilwa_scan_core::{Pose, Rays, Sample};
use std::collections::VecDeque;
use std::io::{self, BufReader, Read as _};
use std::path::{Path, PathBuf};

/// Changed where the same options give another mask than in an earlier version, so that its files are not taken for those of this one.
const METHOD: u32 = 1;
/// Cells read at a time where neighbours do not matter.
const BATCH: u64 = 65_536;
/// Pairs of neighbouring lines from which the angle between lines is taken, about.
const COMPARED_LINES: u32 = 64;

/// A mask that is to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The name of the mask.
    pub name: String,
    /// What it is made by.
    pub recipe: Recipe,
    /// The stations that get it; empty for all.
    pub stations: Vec<String>,
}

/// The mask of one station.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Made {
    /// The station.
    pub station: String,
    /// Points of the station.
    pub measured: u64,
    /// Those that are masked.
    pub masked: u64,
}

/// What was made.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// By station.
    pub stations: Vec<Made>,
    /// Stations that could not be witnesses, because they have no pose.
    pub without_pose: Vec<String>,
}

/// Make a mask and enter it in `survey.toml`, in place of masks of the same name.
///
/// # Errors
/// [`ScanError::Request`] for stations that cannot have it, and where another command is writing; [`ScanError::Spool`], [`ScanError::Read`],
/// [`ScanError::Write`]; [`ScanError::Stopped`]. The masks from before stay then.
pub fn make(folder: &Path, request: &Request, progress: &dyn Progress) -> Result<Report, ScanError> {
    make_within(folder, request, progress, through::MEMORY)
}

/// The same with so many bytes for range images.
pub(super) fn make_within(
    folder: &Path,
    request: &Request,
    progress: &dyn Progress,
    memory: usize,
) -> Result<Report, ScanError> {
    if !is_mask_name(&request.name) {
        let message =
            format!("{:?} is not a valid mask name; use up to 40 letters, digits, and _ - between them", request.name);
        return Err(ScanError::Request(message));
    }
    let survey = Survey::open(folder)?;
    let _lock = Lock::take(folder)?;
    remove_unfinished(folder);
    let stations = chosen(&survey, request)?;
    let witnesses = match &request.recipe {
        Recipe::SeenThrough { witnesses, .. } => {
            Some(through::Witnesses::new(folder, &survey, &stations, *witnesses, memory, progress)?)
        }
        _ => None,
    };
    let mut report = Report::default();
    if let Some(witnesses) = &witnesses {
        report.without_pose.clone_from(&witnesses.without_pose);
    }
    let mut masks = Vec::with_capacity(stations.len());
    let total = stations.len();
    for (number, station) in stations.iter().enumerate() {
        let reader = Reader::open(&folder.join(&station.scan))?;
        let poses = match &request.recipe {
            Recipe::SeenThrough { .. } => Some(digest_of_poses(&survey.stations)),
            recipe if recipe.needs_pose() => Some(digest_of_poses([*station])),
            _ => None,
        };
        let made = request.recipe.made();
        let digest = digest(request, &survey, &reader, poses.as_deref())?;
        let file = format!("{STATIONS}/{}.{}.{digest}.mask", station.name, request.name);
        let path = folder.join(&file);
        let measured = reader.header().statistics.measured;
        let mut making =
            Making { station, reader, path, progress, done: number as u64, stations: total as u64, parts: 1 };
        let masked = match making.known(&request.name) {
            Some(masked) => masked,
            None => making.make(&request.recipe, witnesses.as_ref())?,
        };
        report.stations.push(Made { station: station.name.clone(), measured, masked });
        masks.push((station.name.clone(), Mask { name: request.name.clone(), file, is_on: true, made, poses }));
    }
    // Opened again: a person may have edited the file in the meantime.
    let mut edit = Edit::open(folder)?;
    let mut before = Vec::new();
    for (station, mask) in masks {
        let own = edit.survey().station(&station)?.masks.iter().find(|own| own.name == mask.name);
        before.extend(own.filter(|own| own.file != mask.file).map(|own| own.file.clone()));
        edit.put_mask(&station, mask)?;
    }
    edit.save()?;
    remove_files(folder, edit.survey(), &before);
    Ok(report)
}

/// The stations that get the mask.
fn chosen<'a>(survey: &'a Survey, request: &Request) -> Result<Vec<&'a Station>, ScanError> {
    let stations: Vec<&Station> = if request.stations.is_empty() {
        survey.stations.iter().collect()
    } else {
        request.stations.iter().map(|name| survey.station(name)).collect::<Result<_, _>>()?
    };
    if stations.is_empty() {
        return Err(ScanError::Request("the survey has no stations yet; use `kilwa scans import`".to_owned()));
    }
    if let Recipe::Points { .. } = request.recipe
        && stations.len() > 1
    {
        let message = "a list of points belongs to one station; name it with --station";
        return Err(ScanError::Request(message.to_owned()));
    }
    if request.recipe.needs_pose()
        && let Some(station) = stations.iter().find(|station| station.pose.is_none())
    {
        return Err(ScanError::Request(format!(
            "station {} has no pose, which the mask {} needs; give it rotation and translation in survey.toml, or name the other stations with --station",
            station.name, request.name
        )));
    }
    Ok(stations)
}

/// A digest of everything that the mask of a station depends on.
fn digest(request: &Request, survey: &Survey, reader: &Reader, poses: Option<&str>) -> Result<String, ScanError> {
    let mut hash = blake3::Hasher::new();
    hash.update(&METHOD.to_le_bytes());
    hash.update(request.recipe.made().as_bytes());
    hash.update(&reader.header().digest());
    hash.update(poses.unwrap_or_default().as_bytes());
    match &request.recipe {
        Recipe::Points { list, .. } => {
            let cannot = |source| ReadError::Open { file: list.clone(), source };
            let mut file = plain_file::open(list).map_err(cannot)?;
            let mut buffer = vec![0; 1 << 16];
            loop {
                let n = file.read(&mut buffer).map_err(cannot)?;
                if n == 0 {
                    break;
                }
                hash.update(&buffer[..n]);
            }
        }
        Recipe::SeenThrough { .. } => {
            for station in &survey.stations {
                hash.update(station.source.blake3.as_bytes());
            }
        }
        // Noise and beam are options of the station.
        Recipe::Mixed(_) => {
            for station in &survey.stations {
                hash.update(format!("{:?}", station.measures_with()).as_bytes());
            }
        }
        _ => {}
    }
    Ok(hash.finalize().to_hex()[..12].to_owned())
}

/// The mask of one station, being made.
pub(super) struct Making<'a> {
    pub(super) station: &'a Station,
    pub(super) reader: Reader,
    path: PathBuf,
    progress: &'a dyn Progress,
    /// Stations before this one, and all.
    done: u64,
    stations: u64,
    /// Passes over the samples.
    pub(super) parts: u64,
}

impl Making<'_> {
    /// Samples that the file masks that is there already.
    fn known(&self, name: &str) -> Option<u64> {
        let mut mask = MaskReader::open(&self.path, name).ok()?;
        mask.check_scan(self.reader.header()).ok()?;
        // All of it: what was left by a command that was killed must be whole.
        let (cells, mut at) = (mask.header().cells, 0);
        while at < cells {
            let count = (1 << 20).min(cells - at);
            mask.cells(at, count as usize, &mut |_| {}).ok()?;
            at += count;
        }
        Some(mask.header().masked)
    }

    pub(super) fn cannot(&self) -> impl Fn(io::Error) -> ScanError + use<> {
        let path = self.path.clone();
        move |source| ScanError::Write { path: path.clone(), source }
    }

    fn make(&mut self, recipe: &Recipe, witnesses: Option<&through::Witnesses>) -> Result<u64, ScanError> {
        let header = *self.reader.header();
        if recipe.needs_grid() && !header.is_grid {
            return Err(ScanError::Request(format!(
                "station {} is an unstructured point cloud, so it has no neighbours in a grid, which --{} needs; choose the other stations with --station",
                self.station.name,
                recipe.kind()
            )));
        }
        if matches!(recipe, Recipe::Intensity(_)) && header.statistics.with_intensity == 0 {
            return Err(ScanError::Request(format!(
                "station {} has no intensity; name the other stations with --station",
                self.station.name
            )));
        }
        let mut writer = MaskWriter::create(&self.path, &header).map_err(self.cannot())?;
        let pose = self.station.pose.unwrap_or_default();
        match recipe {
            Recipe::Mixed(options) => {
                let mut mixed = Mixed::new(*options, self.station.measures_with(), header.rays);
                self.windows(|window, mask| mixed.line(window, mask), &mut writer)?;
            }
            Recipe::Grazing { limit } => {
                let mut grazing = Grazing::new(limit.to_radians());
                let line = |[_, left, here, right, _]: [Option<&[Sample]>; 5], mask: &mut dyn FnMut(usize)| {
                    grazing.line(left, here.unwrap_or_default(), right, header.rays, mask);
                };
                self.windows(line, &mut writer)?;
            }
            Recipe::Isolated { min } => self.isolated(*min, &mut writer)?,
            Recipe::Inside(bounds) => {
                self.each(|s| is_inside(*bounds, place(pose, s)), &mut writer)?;
            }
            Recipe::Outside(bounds) => {
                self.each(|s| !is_inside(*bounds, place(pose, s)), &mut writer)?;
            }
            Recipe::Intensity(limits) => self.each(|s| is_beyond(*limits, s.intensity), &mut writer)?,
            Recipe::Points { list, column, numbering } => {
                let numbering = numbering.unwrap_or_else(|| usual_numbering(self.station));
                self.listed(list, *column, numbering, &mut writer)?;
            }
            Recipe::SeenThrough { witnesses: needed, margin } => {
                if let Some(witnesses) = witnesses {
                    through::mask(self, witnesses, *needed, *margin, &mut writer)?;
                }
            }
        }
        let (pending, made) = writer.finish().map_err(self.cannot())?;
        // A file of this name that no station names is left from a command that was killed, or damaged.
        pending.commit(true).map_err(self.cannot())?;
        Ok(made.masked)
    }

    /// So many of so many cells are done in this part.
    pub(super) fn progress(&self, part: u64, done: u64, cells: u64) -> Result<(), ScanError> {
        if self.progress.is_stopped() {
            return Err(ScanError::Stopped);
        }
        let of_station = (part as f64 + done as f64 / cells.max(1) as f64) / self.parts as f64;
        let total = 1_000_000;
        let share = (self.done as f64 + of_station) / self.stations as f64;
        self.progress.update("masking", (share * total as f64) as u64, total);
        Ok(())
    }

    /// Mask samples by themselves.
    fn each(&mut self, is_masked: impl Fn(&Sample) -> bool, writer: &mut MaskWriter) -> Result<(), ScanError> {
        let (cells, mut at, mut batch) = (self.reader.header().grid.cells(), 0, Vec::new());
        let cannot = self.cannot();
        while at < cells {
            let count = BATCH.min(cells - at);
            self.reader.read(at, count as usize, &mut batch)?;
            for (cell, sample) in (at..).zip(&batch) {
                if sample.is_measured() && is_masked(sample) {
                    writer.mask(cell).map_err(&cannot)?;
                }
            }
            at += count;
            self.progress(0, at, cells)?;
        }
        Ok(())
    }

    /// Mask samples by the lines around them.
    fn windows(
        &mut self,
        mut test: impl FnMut([Option<&[Sample]>; 5], &mut dyn FnMut(usize)),
        writer: &mut MaskWriter,
    ) -> Result<(), ScanError> {
        let grid = self.reader.header().grid;
        let (lines, length) = (grid.lines(), u64::from(grid.line_length()));
        let cannot = self.cannot();
        let mut window: VecDeque<Option<Vec<Sample>>> = VecDeque::from(vec![None, None, None, None, None]);
        for next in 0..lines + 2 {
            let mut line = window.pop_front().flatten().unwrap_or_default();
            window.push_back(if next < lines {
                self.reader.line(next, &mut line)?;
                Some(line)
            } else {
                None
            });
            let Some(here) = next.checked_sub(2) else { continue };
            let mut places = Vec::new();
            let around = std::array::from_fn(|k| window[k].as_deref());
            test(around, &mut |at| places.push(at));
            places.sort_unstable();
            for at in places {
                writer.mask(u64::from(here) * length + at as u64).map_err(&cannot)?;
            }
            if here % 16 == 0 {
                self.progress(0, u64::from(here), u64::from(lines))?;
            }
        }
        Ok(())
    }

    /// Whether the last line is a neighbour of the first.
    pub(super) fn closes(&mut self) -> Result<bool, ScanError> {
        let (grid, rays) = (self.reader.header().grid, self.reader.header().rays);
        if grid.lines() < 3 {
            return Ok(false);
        }
        let mut turn = Turn::new(u64::from(grid.lines()));
        let (mut before, mut here) = (Vec::new(), Vec::new());
        let apart = (grid.lines() / COMPARED_LINES).max(1);
        for number in (1..grid.lines()).step_by(apart as usize) {
            self.reader.line(number - 1, &mut before)?;
            self.reader.line(number, &mut here)?;
            turn.add(&before, &here);
        }
        self.reader.line(0, &mut before)?;
        self.reader.line(grid.lines() - 1, &mut here)?;
        Ok(turn.closes(&here, &before, rays))
    }

    /// Mask small components.
    fn isolated(&mut self, min: u32, writer: &mut MaskWriter) -> Result<(), ScanError> {
        let header = *self.reader.header();
        let (lines, length) = (header.grid.lines(), u64::from(header.grid.line_length()));
        let cannot = self.cannot();
        self.parts = 2;
        let mut finder = Finder::new(joining(self.station, header.rays), header.rays);
        let mut line = Vec::new();
        for number in 0..lines {
            self.reader.line(number, &mut line)?;
            finder.line(&line, &|_| true, &|_| false);
            self.progress(0, u64::from(number), u64::from(lines))?;
        }
        if self.closes()? {
            finder.close();
        }
        let mut components = finder.finish();
        for number in 0..lines {
            self.reader.line(number, &mut line)?;
            let mut places = Vec::new();
            components.line(&line, &|_| true, &mut |at, size, _| {
                if size < min {
                    places.push(at);
                }
            });
            for at in places {
                writer.mask(u64::from(number) * length + at as u64).map_err(&cannot)?;
            }
            self.progress(1, u64::from(number), u64::from(lines))?;
        }
        Ok(())
    }

    /// Mask what a file lists.
    fn listed(
        &mut self,
        list: &Path,
        column: Option<usize>,
        numbering: Numbering,
        writer: &mut MaskWriter,
    ) -> Result<(), ScanError> {
        let header = *self.reader.header();
        let (count, what) = match numbering {
            Numbering::Cells => (header.grid.cells(), "cells"),
            Numbering::Points => (header.statistics.measured, "points"),
        };
        let mut is_listed = vec![0_u8; count.div_ceil(8) as usize];
        let file = plain_file::open(list).map_err(|source| ReadError::Open { file: list.to_owned(), source })?;
        let name = &self.station.name;
        list::read_list(list, &mut BufReader::new(file), column, &mut |index, line| {
            if index >= count {
                return Err(ScanError::malformed(
                    list,
                    kilwa_formats::read::Place::Line(line),
                    format!("index {index}"),
                    format!(
                        "an index below {count}, because station {name} has {count} {what}; --numbering cells|points sets what the indices count"
                    ),
                ));
            }
            is_listed[(index / 8) as usize] |= 1 << (index % 8);
            Ok(())
        })?;
        let is_listed =
            |index: u64| is_listed.get((index / 8) as usize).is_some_and(|byte| byte >> (index % 8) & 1 == 1);
        let (cells, mut at, mut points, mut batch) = (header.grid.cells(), 0, 0, Vec::new());
        let cannot = self.cannot();
        while at < cells {
            let n = BATCH.min(cells - at);
            self.reader.read(at, n as usize, &mut batch)?;
            for (cell, _) in (at..).zip(&batch).filter(|(_, sample)| sample.is_measured()) {
                let index = if numbering == Numbering::Cells { cell } else { points };
                points += 1;
                if is_listed(index) {
                    writer.mask(cell).map_err(&cannot)?;
                }
            }
            at += n;
            self.progress(0, at, cells)?;
        }
        Ok(())
    }
}

fn place(pose: Pose, sample: &Sample) -> glam::DVec3 {
    pose.apply(sample.position.as_dvec3())
}

/// Neighbours of one thing: as far apart as rays are on a surface seen at 84°, and the noise of both ranges.
pub(super) fn joining(station: &Station, rays: Rays) -> Joining {
    let noise = station.measures_with().range_noise[0];
    Joining { factor: 10.0, floor: if rays == Rays::Central { 4.0 * noise } else { 0.0 } }
}

/// Programs that read PTX keep the cells of its grid; those that read other formats know points only.
fn usual_numbering(station: &Station) -> Numbering {
    let is_ptx = Path::new(&station.source.file).extension().is_some_and(|end| end.eq_ignore_ascii_case("ptx"));
    if is_ptx { Numbering::Cells } else { Numbering::Points }
}
