//! The mesh of a station, in one file or divided into several.

use super::{Args, show, without};
use crate::progress::Bar;
use anyhow::{Context, bail, ensure};
use glam::DVec3;
use kilwa_files::atomic::Pending;
use kilwa_files::output;
use kilwa_formats::UNCOLOURED;
use kilwa_formats::extract::{About, Format, MeshWriter, Output, PlainVertex, Written};
use kilwa_pack::plural::counted;
use kilwa_scan::ScanError;
use kilwa_scan::mask;
use kilwa_scan::mesh::{MeshVertex, Options, Report, Surface, mesh};
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::{MeshDefaults, Station, Survey};
use kilwa_scan_core::Pose;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The options of the command line, then those of the survey, then the defaults.
fn options(args: &Args, defaults: MeshDefaults, station: &Station) -> Options {
    let given = MeshDefaults {
        subsample: args.subsample.or(defaults.subsample),
        edge_factor: args.edge_factor.or(defaults.edge_factor),
        max_edge: args.max_edge.or(defaults.max_edge),
        grazing: args.grazing.or(defaults.grazing),
    };
    Options { bounds: args.bounds, ..crate::stations::options(given, station) }
}

/// Hands a mesh on to a writer of mesh files, and begins the next file where one is full.
struct Files<'o> {
    format: Format,
    about: About,
    output: &'o Output,
    writer: MeshWriter<'o>,
    /// Most triangles of a file, and the names of files; `None` for one file.
    split: Option<(u64, Names)>,
    /// Files that are complete and have no name yet.
    done: Vec<(PathBuf, Written, Pending)>,
    has_intensity: bool,
    bar: &'o Bar,
}

impl Files<'_> {
    /// Complete the file that is being written.
    fn complete(&mut self) -> Result<(), ScanError> {
        let Some((_, names)) = &self.split else { return Ok(()) };
        let path = names.of(self.done.len());
        let next = MeshWriter::begin(self.format, &self.about, self.output).map_err(request)?;
        let (written, pending) = std::mem::replace(&mut self.writer, next).finish_as(&path).map_err(request)?;
        self.done.push((path, written, pending));
        Ok(())
    }
}

impl Surface for Files<'_> {
    fn part(&mut self) -> Result<u32, ScanError> {
        if self.split.as_ref().is_some_and(|(limit, _)| self.writer.triangles() >= *limit) {
            self.complete()?;
        }
        Ok(self.done.len() as u32)
    }

    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        let intensity = if vertex.intensity.is_nan() { 0.0 } else { vertex.intensity };
        let scalars = [vertex.confidence, intensity];
        let (position, normal, color) = (vertex.position, vertex.normal, vertex.color.unwrap_or(UNCOLOURED));
        let scalars = &scalars[..if self.has_intensity { 2 } else { 1 }];
        self.writer.vertex(&PlainVertex { position, normal, color, scalars }).map_err(request)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        self.writer.triangle(corners).map_err(request)
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), ScanError> {
        show(self.bar, "meshing", done, total);
        Ok(())
    }
}

fn request(e: kilwa_formats::extract::ExtractError) -> ScanError {
    ScanError::Request(format!("{:#}", anyhow::Error::from(e)))
}

/// The names of the files of a divided mesh: `tower.ply` becomes `tower-001.ply`, `tower-002.ply` and so on.
struct Names {
    path: PathBuf,
    digits: usize,
}

impl Names {
    /// For a mesh of at most so many triangles.
    fn new(path: &Path, triangles: u64, limit: u64) -> Self {
        let digits = (triangles / limit + 1).to_string().len().max(3);
        Self { path: path.to_owned(), digits }
    }

    fn of(&self, number: usize) -> PathBuf {
        let mut name = self.stem();
        name.push(format!("{:0digits$}.", number + 1, digits = self.digits));
        name.push(self.path.extension().unwrap_or_default());
        self.path.with_file_name(name)
    }

    fn stem(&self) -> OsString {
        let mut stem = self.path.file_stem().unwrap_or_default().to_owned();
        stem.push("-");
        stem
    }

    /// Files that are there and have such a name, with any number of digits: of an earlier division, they would be taken for a part of this one.
    fn present(&self) -> Vec<PathBuf> {
        let stem = self.stem();
        let is = |path: &PathBuf| {
            let name = path.file_stem().unwrap_or_default().as_encoded_bytes();
            let number = name.strip_prefix(stem.as_encoded_bytes()).unwrap_or_default();
            !number.is_empty() && number.iter().all(u8::is_ascii_digit) && path.extension() == self.path.extension()
        };
        let entries = std::fs::read_dir(kilwa_files::atomic::folder_of(&self.path)).into_iter().flatten().flatten();
        let mut found: Vec<PathBuf> =
            entries.map(|entry| self.path.with_file_name(entry.file_name())).filter(is).collect();
        found.sort();
        found
    }

    /// Refuse what cannot be written, or is there and must not be replaced.
    fn check(&self, force: bool) -> anyhow::Result<()> {
        if let Some(first) = self.present().first().filter(|_| !force) {
            bail!(
                "{} already exists and would be taken for a part of this mesh; use --force to replace it, or choose another name",
                first.display()
            );
        }
        Ok(output::check(&self.of(0), true)?)
    }
}

pub(super) fn export(
    args: &Args,
    survey: &Survey,
    station: &Station,
    reader: &mut Reader,
    bar: &Bar,
) -> anyhow::Result<()> {
    let format = Format::of(&args.output, false)?;
    let statistics = reader.header().statistics;
    let split = args.split.map(|limit| {
        let triangles = 2 * reader.header().grid.cells();
        (u64::from(limit), Names::new(&args.output, triangles, u64::from(limit)))
    });
    // The files of a divided mesh are checked by their own names.
    let output = Output::prepare(&args.output, args.force || split.is_some())?;
    if let Some((_, names)) = &split {
        ensure!(!output::is_special(&args.output), "{}: --split needs the name of a file", args.output.display());
        names.check(args.force)?;
    }
    let (pose, options) = (station.pose.unwrap_or_default(), options(args, survey.mesh, station));
    let has_intensity = statistics.with_intensity > 0;
    let mut scalars = vec!["confidence".to_owned()];
    scalars.extend(has_intensity.then(|| "intensity".to_owned()));
    let about = About {
        title: station.name.clone(),
        note: format!("station {} of {}", station.name, station.source.file),
        crs: survey.crs.clone().filter(|_| station.pose.is_some()),
        colors: statistics.colored > 0,
        scalars,
        bounds: bounds(statistics.bounds, pose),
    };
    let writer = MeshWriter::begin(format, &about, &output)?;
    let mut files = Files { format, about, output: &output, writer, split, done: Vec::new(), has_intensity, bar };
    let report = mesh(reader, pose, &options, &mut files)?;
    let written = finish(args, files).with_context(|| {
        let limits = report.dropped;
        format!(
            "no triangle of {} is within the limits ({} with long edges, {} at a grazing angle, {} outside the box); raise --max-edge, --edge-factor or --grazing, or enlarge --box",
            station.name, limits.long, limits.grazing, report.outside
        )
    })?;
    bar.clear();
    let masked = mask::count(reader)?;
    print(args, &report, &written, [statistics.measured - masked, masked])
}

/// Complete the files and name them, when all are complete.
fn finish(args: &Args, mut files: Files<'_>) -> anyhow::Result<Vec<(PathBuf, Written)>> {
    if files.split.is_none() {
        return Ok(vec![(args.output.clone(), files.writer.finish()?)]);
    }
    // What comes last may be empty where the file before it was just full.
    if files.writer.triangles() > 0 || files.done.is_empty() {
        files.complete()?;
    }
    let mut written = Vec::with_capacity(files.done.len());
    for (path, about, pending) in files.done {
        let named = pending.commit(args.force);
        named.with_context(|| format!("cannot write {}", path.display()))?;
        written.push((path, about));
    }
    let left = files.split.map(|(_, names)| names.present()).unwrap_or_default();
    for path in left.iter().filter(|path| written.iter().all(|(own, _)| own != *path)) {
        crate::terminal::say!("kilwa: {} is left from before and is not part of this mesh; remove it", path.display());
    }
    Ok(written)
}

fn print(
    args: &Args,
    report: &Report,
    written: &[(PathBuf, Written)],
    [points, masked]: [u64; 2],
) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let sum = |of: fn(&Written) -> u64| written.iter().map(|(_, about)| of(about)).sum::<u64>();
    let triangles = sum(|about| about.triangles);
    if args.json {
        let mut json = json!({
            "file": args.output.display().to_string(),
            "bytes": sum(|about| about.bytes),
            "vertices": sum(|about| about.vertices),
            "triangles": triangles,
            "dropped": {
                "long": report.dropped.long,
                "grazing": report.dropped.grazing,
                "degenerate": report.dropped.degenerate,
                "outside": report.outside,
            },
            "closed": report.is_closed,
            "points": points,
            "masked": masked,
        });
        if args.split.is_some() {
            let part = |(path, about): &(PathBuf, Written)| {
                json!({
                    "file": path.display().to_string(),
                    "bytes": about.bytes,
                    "vertices": about.vertices,
                    "triangles": about.triangles,
                })
            };
            json["files"] = written.iter().map(part).collect::<Vec<Value>>().into();
        }
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    let shown = match written {
        [(first, _), .., (last, _)] => format!("{} to {} ({} files)", first.display(), last.display(), written.len()),
        _ => written.first().map(|(path, _)| path.display().to_string()).unwrap_or_default(),
    };
    writeln!(
        out,
        "{shown}: {}, {} from {}{}; dropped: {} with long edges, {} at a grazing angle",
        counted(triangles, "triangle", "triangles"),
        counted(report.vertices, "vertex", "vertices"),
        counted(points, "point", "points"),
        without(masked),
        report.dropped.long,
        report.dropped.grazing
    )?;
    Ok(())
}

/// A box of the survey that holds a box of the station.
fn bounds([min, max]: [glam::Vec3; 2], pose: Pose) -> [DVec3; 2] {
    let (min, max) = (min.as_dvec3(), max.as_dvec3());
    let corners = (0..8).map(|k| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { min[axis] } else { max[axis] };
        pose.apply(DVec3::new(pick(0), pick(1), pick(2)))
    });
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}
