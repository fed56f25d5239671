//! `kilwa scans export`.

use crate::new_file::{NewFile, check_output};
use crate::progress::Bar;
use anyhow::{Context, ensure};
use glam::DVec3;
use kilwa_builder::Progress as _;
use kilwa_formats::UNCOLOURED;
use kilwa_formats::extract::{About, Format, MeshWriter, Output, PlainVertex};
use kilwa_pack::plural::counted;
use kilwa_scan::ScanError;
use kilwa_scan::export::ptx;
use kilwa_scan::mask;
use kilwa_scan::mesh::{MeshVertex, Options, Surface, mesh};
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::{MeshDefaults, Station, Survey};
use kilwa_scan_core::Pose;
use serde_json::json;
use std::io::{BufWriter, Write as _};
use std::path::PathBuf;

/// Write a station as a mesh, or as PTX for other programs.
///
/// The mesh joins neighbouring cells of the scanner's grid. It is in survey coordinates; a station without a pose stays in scanner coordinates.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// The station; `kilwa scans list` shows their names.
    station: String,
    /// The file to write: .ply, .obj, .stl or .glb with --mesh, .ptx with --ptx.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write a mesh.
    #[arg(long, required_unless_present = "ptx", conflicts_with = "ptx")]
    mesh: bool,
    /// Write a PTX file with grid and pose.
    #[arg(long)]
    ptx: bool,
    /// Use every N-th row and column (default: the value in survey.toml, or 1).
    #[arg(long, value_name = "N", requires = "mesh", value_parser = clap::value_parser!(u32).range(1..=64))]
    subsample: Option<u32>,
    /// Longest edge in metres (default: no limit but that of --edge-factor).
    #[arg(long, value_name = "METRES", requires = "mesh", value_parser = positive)]
    max_edge: Option<f64>,
    /// Longest edge as a multiple of the point spacing expected from range, angular step and incidence angle (default: 3).
    #[arg(long, value_name = "FACTOR", requires = "mesh", value_parser = positive)]
    edge_factor: Option<f64>,
    /// Drop triangles whose incidence angle is larger than this, in degrees (default: 87).
    #[arg(long, value_name = "DEGREES", requires = "mesh", value_parser = angle)]
    grazing: Option<f64>,
    /// Keep only triangles whose centroid lies in this box, in survey coordinates (metres).
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", requires = "mesh", value_parser = crate::build::crop, allow_hyphen_values = true)]
    bounds: Option<[DVec3; 2]>,
    /// Also write masked samples.
    #[arg(long)]
    unmasked: bool,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|v: &f64| *v > 0.0 && v.is_finite())
        .ok_or_else(|| "expected a number greater than 0".to_owned())
}

pub(super) fn angle(text: &str) -> Result<f64, String> {
    let angle = text.parse().ok().filter(|v: &f64| *v > 0.0 && *v < 90.0);
    angle.ok_or_else(|| "expected an angle between 0 and 90 degrees".to_owned())
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::open(&args.survey)?;
    let station = survey.station(&args.station)?;
    let mut reader = mask::open(&args.survey, station, args.unmasked)?;
    if !args.unmasked {
        super::mask::warn_of_outdated(&survey, station);
    }
    if station.pose.is_none() {
        crate::terminal::say!(
            "kilwa: station {} has no pose in survey.toml; it is written in scanner coordinates",
            station.name
        );
    }
    let bar = Bar::new();
    let done = if args.ptx {
        export_ptx(args, station, &mut reader, &bar)
    } else {
        export_mesh(args, &survey, station, &mut reader, &bar)
    };
    bar.clear();
    done
}

fn export_ptx(args: &Args, station: &Station, reader: &mut Reader, bar: &Bar) -> anyhow::Result<()> {
    let is_ptx = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("ptx"));
    ensure!(is_ptx, "{}: the file extension of a PTX file must be .ptx", args.output.display());
    check_output(&args.output, args.force, [args.survey.join(&station.scan).as_path()])?;
    let cannot = |source| ScanError::Write { path: args.output.clone(), source };
    let mut file = NewFile::create(&args.output)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.file());
    let pose = station.pose.unwrap_or_default();
    ptx(reader, pose, &mut out, &cannot, &mut |done, total| {
        show(bar, "writing", done, total);
        Ok(())
    })?;
    out.flush().map_err(cannot)?;
    drop(out);
    file.commit(args.force)?;
    bar.clear();
    let masked = mask::count(reader)?;
    let (grid, points) = (reader.header().grid, reader.header().statistics.measured - masked);
    let mut out = crate::terminal::out();
    if args.json {
        let file = args.output.display().to_string();
        let json =
            json!({"file": file, "columns": grid.columns, "rows": grid.rows, "points": points, "masked": masked});
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
    } else {
        let points = counted(points, "point", "points");
        let masked = without(masked);
        writeln!(out, "{}: {} × {} cells, {points}{masked}", args.output.display(), grid.columns, grid.rows)?;
    }
    Ok(())
}

/// How many points are left out, if some are.
fn without(masked: u64) -> String {
    if masked == 0 { String::new() } else { format!(" ({masked} masked)") }
}

fn show(bar: &Bar, stage: &'static str, done: u64, total: u64) {
    bar.update(stage, done, total);
    bar.whole(done as f64 / total.max(1) as f64);
}

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

/// Hands a mesh on to a writer of mesh files.
struct File<'a, 'o> {
    writer: MeshWriter<'o>,
    has_intensity: bool,
    bar: &'a Bar,
}

impl Surface for File<'_, '_> {
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

fn export_mesh(args: &Args, survey: &Survey, station: &Station, reader: &mut Reader, bar: &Bar) -> anyhow::Result<()> {
    let format = Format::of(&args.output, false)?;
    let output = Output::prepare(&args.output, args.force)?;
    let (pose, options) = (station.pose.unwrap_or_default(), options(args, survey.mesh, station));
    let statistics = reader.header().statistics;
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
    let mut file = File { writer: MeshWriter::begin(format, &about, &output)?, has_intensity, bar };
    let report = mesh(reader, pose, &options, &mut file)?;
    let written = file.writer.finish().with_context(|| {
        let limits = report.dropped;
        format!(
            "no triangle of {} is within the limits ({} with long edges, {} at a grazing angle, {} outside the box); raise --max-edge, --edge-factor or --grazing, or enlarge --box",
            station.name, limits.long, limits.grazing, report.outside
        )
    })?;
    bar.clear();
    let masked = mask::count(reader)?;
    let points = statistics.measured - masked;
    let mut out = crate::terminal::out();
    if args.json {
        let json = json!({
            "file": args.output.display().to_string(),
            "bytes": written.bytes,
            "vertices": written.vertices,
            "triangles": written.triangles,
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
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}: {}, {} from {}{}; dropped: {} with long edges, {} at a grazing angle",
        args.output.display(),
        counted(written.triangles, "triangle", "triangles"),
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
