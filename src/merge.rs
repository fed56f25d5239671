//! `kilwa merge`: the stations of a survey become one surface.

pub(crate) mod accuracy;
pub(crate) mod channels;
pub(crate) mod holes;

use crate::build;
use crate::new_file::{check_output, refuse_inputs};
use crate::progress::Bar;
use crate::resources::Resources;
use crate::stations::merged::Merging;
use anyhow::{Context as _, ensure};
use channels::Channels;
use glam::DVec3;
use kilwa_builder::Progress as _;
use kilwa_builder::build::machine;
use kilwa_files::size::binary;
use kilwa_formats::UNCOLOURED;
use kilwa_formats::extract::{About, Format, MeshWriter, Output, PlainVertex, Written};
use kilwa_pack::plural::counted;
use kilwa_scan::ScanError;
use kilwa_scan::merge::{Begin, Fill, Intensity, Light, MergedSurface, MergedVertex, Options, Report, merge};
use kilwa_scan::register;
use kilwa_scan::survey::{self, Survey};
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// Merge the registered stations of a survey into one surface.
///
/// Every vertex has colour and intensity (if the scans have them), a confidence, the number of stations that saw it, and the uncertainty due to their poses (if it is known and varies).
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// The pack (.kilwa) or mesh (.ply, .obj, .stl, .glb) to write.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Voxel size in metres (default: the point spacing of the most densely sampled 30 % of the surface).
    #[arg(long, value_name = "METRES", value_parser = crate::scans::export::positive)]
    voxel: Option<f64>,
    /// Merge only what lies in this box, in survey coordinates (metres).
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = crate::build::crop, allow_hyphen_values = true)]
    bounds: Option<[DVec3; 2]>,
    /// Also write the holes as GeoJSON: rim, position, area and cause.
    #[arg(long, value_name = "FILE")]
    holes: Option<PathBuf>,
    /// Fill holes. coarser: narrow gaps, from the scans at larger voxels. diffuse: with a smooth surface that continues the rim. Give the option twice to use both. Openings that scanners saw
    /// through stay open. The channels `filled` and `source` mark what was added.
    #[arg(long, value_enum, value_name = "HOW")]
    fill: Vec<Filling>,
    /// Use this mesh (in survey coordinates, for example from photographs) where no scan covers the surface.
    #[arg(long, value_name = "MESH")]
    fill_mesh: Option<PathBuf>,
    /// With --fill, fill only holes of at most this area, square metres.
    #[arg(long, value_name = "AREA", default_value_t = Fill::MAX_AREA, requires = "fill", value_parser = crate::scans::export::positive)]
    fill_max_area: f64,
    /// Close all holes, openings and outer edges, so that the surface encloses a volume.
    #[arg(long)]
    watertight: bool,
    /// Intensities of the surface: normalised for range, incidence and station where overlapping scans allow it, or as recorded.
    #[arg(long, value_enum, value_name = "WHICH", default_value_t = IntensityArg::Normalised)]
    intensity: IntensityArg,
    /// Also use masked samples.
    #[arg(long)]
    unmasked: bool,
    #[command(flatten)]
    resources: Resources,
    /// Continue an interrupted merge into a pack.
    #[arg(long)]
    resume: bool,
    /// Title of the model (default: that of the survey, or the name of its folder).
    #[arg(long)]
    title: Option<String>,
    /// Standard uncertainty of the capture in metres, stored with a pack (default: computed from the uncertainties of the poses and the range noise, if these are known).
    #[arg(long, value_name = "METRES")]
    capture_accuracy: Option<f64>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// How holes are filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Filling {
    Coarser,
    Diffuse,
}

/// Which intensities the surface gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum IntensityArg {
    Normalised,
    Raw,
}

impl From<IntensityArg> for Intensity {
    fn from(which: IntensityArg) -> Self {
        match which {
            IntensityArg::Normalised => Self::Normalised,
            IntensityArg::Raw => Self::Raw,
        }
    }
}

/// What was done to the intensities, in a sentence; `None` if there are none.
pub(crate) fn intensities(light: Light) -> Option<String> {
    Some(match light {
        Light::None => return None,
        Light::Normalised { observations } => format!(
            "intensities normalised for range, incidence and station, from {}",
            counted(observations, "observation in overlaps", "observations in overlaps")
        ),
        Light::Raw => "intensities as in the scans".to_owned(),
        Light::Unknown => "intensities as in the scans: too few places were seen by several stations at different ranges or angles to normalise them".to_owned(),
        Light::Negative => "intensities as in the scans: more than one in a thousand is negative, as on a logarithmic scale, so they cannot be normalised".to_owned(),
    })
}

impl Args {
    /// Whether a pack is written, as by a build, which also handles signals itself.
    pub(crate) fn is_pack(&self) -> bool {
        self.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("kilwa"))
    }

    fn options(&self) -> Options {
        Options {
            voxel: self.voxel,
            memory: self.resources.memory(),
            threads: self.resources.threads(),
            scratch: self.resources.scratch_for(&self.output),
            unmasked: self.unmasked,
            bounds: self.bounds,
            fill: Fill {
                coarser: self.fill.contains(&Filling::Coarser),
                mesh: self.fill_mesh.clone(),
                diffuse: self.fill.contains(&Filling::Diffuse),
                max_area: self.fill_max_area,
                watertight: self.watertight,
            },
            intensity: self.intensity.into(),
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::open(&args.survey)?;
    let mut inputs = files_of(&args.survey, &survey);
    inputs.extend(args.fill_mesh.clone());
    refuse_inputs(&args.output, inputs.iter().map(PathBuf::as_path))?;
    if let Some(list) = &args.holes {
        ensure!(
            resolved(list)? != resolved(&args.output)?,
            "{} is already the name of the output; choose another name for the list of holes",
            list.display()
        );
        check_output(list, args.force, inputs.iter().map(PathBuf::as_path))?;
    }
    if args.is_pack() {
        return into_pack(args, &survey);
    }
    ensure!(
        !args.resume,
        "--resume works only for packs (.kilwa); run the command again without it to merge into a mesh"
    );
    ensure!(
        args.capture_accuracy.is_none(),
        "--capture-accuracy is stored only in packs, and {} is a mesh; leave it out, or write a .kilwa file",
        args.output.display()
    );
    into_mesh(args, &survey)
}

/// A path with all links and `..` of its folder followed; the file need not exist.
pub(crate) fn resolved(path: &Path) -> anyhow::Result<PathBuf> {
    let folder = kilwa_files::atomic::folder_of(path);
    // A folder that does not exist will be made.
    let folder = folder.canonicalize().or_else(|_| std::path::absolute(folder))?;
    Ok(path.file_name().map_or(folder.clone(), |name| folder.join(name)))
}

/// All files of a survey.
fn files_of(folder: &Path, survey: &Survey) -> Vec<PathBuf> {
    let own = survey.stations.iter().flat_map(|station| {
        std::iter::once(station.scan.as_str()).chain(station.masks.iter().map(|mask| mask.file.as_str()))
    });
    let photographs = survey.photographs.iter().map(|photograph| photograph.file.as_str());
    [survey::FILE, register::FILE].into_iter().chain(own).chain(photographs).map(|name| folder.join(name)).collect()
}

/// The merged surface goes to the first stage of a build.
fn into_pack(args: &Args, survey: &Survey) -> anyhow::Result<()> {
    let merging = Merging {
        folder: args.survey.clone(),
        survey: survey.clone(),
        options: args.options(),
        report: Arc::default(),
    };
    let report = Arc::clone(&merging.report);
    let common = build::Common {
        threads: args.resources.threads,
        memory: args.resources.memory,
        scratch: args.resources.scratch.clone(),
        resume: args.resume,
        title: Some(title(args, survey)),
        crs: survey.crs.clone(),
        capture_accuracy: args.capture_accuracy,
        force: args.force,
        json: args.json,
    };
    build::run(&build::Args::of_merged(merging, args.output.clone(), common))?;
    let Some(list) = &args.holes else { return Ok(()) };
    let made = report.lock().unwrap_or_else(PoisonError::into_inner).take();
    let report = if let Some(report) = made {
        report
    } else {
        crate::terminal::say!("kilwa: the merge was already complete; it is repeated to make the list of holes");
        let options_of = |station: &_| crate::stations::options(survey.mesh, station);
        let bar = Bar::new();
        let report = merge(&args.survey, survey, &args.options(), &options_of, &mut Nothing, &Shown(&bar));
        bar.clear();
        report?
    };
    holes::write(&report.borders, survey.crs.as_deref(), list, args.force)
}

/// Discards the surface.
struct Nothing;

impl MergedSurface for Nothing {
    fn begin(&mut self, _: &Begin) -> Result<(), ScanError> {
        Ok(())
    }

    fn vertex(&mut self, _: &MergedVertex) -> Result<(), ScanError> {
        Ok(())
    }

    fn triangle(&mut self, _: [u64; 3]) -> Result<(), ScanError> {
        Ok(())
    }
}

fn title(args: &Args, survey: &Survey) -> String {
    let name = || {
        // The name of `.` is that of the folder.
        let folder = args.survey.canonicalize().unwrap_or_else(|_| args.survey.clone());
        folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    };
    args.title.clone().or_else(|| survey.title.clone()).unwrap_or_else(name)
}

fn into_mesh(args: &Args, survey: &Survey) -> anyhow::Result<()> {
    let begun = Instant::now();
    if !args.unmasked {
        survey.stations.iter().for_each(|station| crate::scans::mask::warn_of_outdated(survey, station));
    }
    crate::stations::warn_of_same_poses(&args.survey, survey);
    let format = Format::of(&args.output, false)?;
    let output = Output::prepare(&args.output, args.force)?;
    let bar = Bar::new();
    let mut file = File {
        survey,
        title: title(args, survey),
        format,
        output: &output,
        writer: None,
        channels: Channels::default(),
    };
    let options_of = |station: &_| crate::stations::options(survey.mesh, station);
    let report = merge(&args.survey, survey, &args.options(), &options_of, &mut file, &Shown(&bar));
    let written = report.map_err(anyhow::Error::from).and_then(|report| {
        let writer = file.writer.take();
        bar.update("writing", 0, 1);
        Ok((report, writer.map(MeshWriter::finish).transpose()?))
    });
    bar.clear();
    let (report, written) = written?;
    let written = written.context("the merge ended without a surface")?;
    if let Some(list) = &args.holes {
        holes::write(&report.borders, survey.crs.as_deref(), list, args.force)?;
    }
    print(args, &report, &written, begun.elapsed().as_secs_f64())
}

/// The part of the progress bar that each stage of a merge fills.
const SHARES: [(&str, f64, f64); 6] = [
    ("measuring point spacing", 0.0, 0.12),
    ("measuring intensities", 0.12, 0.22),
    ("reading stations", 0.22, 0.5),
    ("merging", 0.5, 0.97),
    ("analysing holes", 0.97, 0.98),
    ("filling holes", 0.98, 1.0),
];

/// The share of a merge that is done, 0 to 1, at this point of a stage.
pub(crate) fn share(stage: &str, done: u64, total: u64) -> Option<f64> {
    let (_, from, to) = SHARES.iter().find(|share| share.0 == stage)?;
    Some(from + (to - from) * (done as f64 / total.max(1) as f64).min(1.0))
}

/// Progress of a merge on a bar.
struct Shown<'b>(&'b Bar);

impl kilwa_scan::import::Progress for Shown<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.0.update(stage, done, total);
        if let Some(share) = share(stage, done, total) {
            self.0.whole(share);
        }
    }
}

/// A mesh file, written as the surface is delivered.
struct File<'o> {
    survey: &'o Survey,
    title: String,
    format: Format,
    output: &'o Output,
    writer: Option<MeshWriter<'o>>,
    channels: Channels,
}

fn request(e: kilwa_formats::extract::ExtractError) -> ScanError {
    ScanError::Request(format!("{:#}", anyhow::Error::from(e)))
}

impl MergedSurface for File<'_> {
    fn begin(&mut self, begin: &Begin) -> Result<(), ScanError> {
        self.channels = Channels::of(begin);
        let about = About {
            title: self.title.clone(),
            note: format!(
                "{} merged, voxel size {} m",
                counted(self.survey.stations.len(), "station", "stations"),
                begin.voxel
            ),
            crs: self.survey.crs.clone(),
            colors: begin.attributes[0],
            scalars: self.channels.names(),
            bounds: begin.bounds,
        };
        self.writer = Some(MeshWriter::begin(self.format, &about, self.output).map_err(request)?);
        Ok(())
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let scalars = &self.channels.values(vertex)[..self.channels.count()];
        let vertex = &vertex.vertex;
        let color = vertex.color.unwrap_or(UNCOLOURED);
        let plain = PlainVertex { position: vertex.position, normal: vertex.normal, color, scalars };
        writer.vertex(&plain).map(drop).map_err(request)
    }

    fn triangle(&mut self, corners: [u64; 3]) -> Result<(), ScanError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        // The writer refuses vertices beyond that.
        writer.triangle(corners.map(|k| k as u32)).map_err(request)
    }
}

/// The figures of a merge for machines.
pub(crate) fn figures(report: &Report) -> Value {
    json!({
        "voxel": report.voxel,
        "stations": report.stations,
        "station_triangles": report.station_triangles,
        "pieces": report.pieces,
        "scratch_estimated_bytes": report.scratch_estimated,
        "scratch_bytes": report.scratch_bytes,
        "intensity": match report.light {
            Light::None => Value::Null,
            Light::Normalised { .. } => "normalised".into(),
            Light::Raw | Light::Unknown | Light::Negative => "raw".into(),
        },
        "capture": accuracy::figures(&report.accuracy),
        "holes": holes::summary(&report.borders),
        "filled": report.filled.as_ref().map(holes::filled_summary),
    })
}

fn print(args: &Args, report: &Report, written: &Written, seconds: f64) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let cpu = machine::cpu_seconds();
    if args.json {
        let mut json = figures(report);
        let more = json!({
            "file": args.output.display().to_string(),
            "bytes": written.bytes,
            "vertices": written.vertices,
            "triangles": written.triangles,
            "voxel": report.voxel,
            "stations": report.stations,
            "station_triangles": report.station_triangles,
            "pieces": report.pieces,
            "scratch_bytes": report.scratch_bytes,
            "holes": holes::summary(&report.borders),
            "seconds": seconds,
            "cpu_seconds": cpu,
            "peak_memory": machine::peak_memory(),
        });
        if let (Some(json), Value::Object(more)) = (json.as_object_mut(), more) {
            json.extend(more);
        }
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}: {}, {}; merged from {} ({}) with voxels of {} m; {} of scratch space, {seconds:.1} s",
        args.output.display(),
        counted(written.triangles, "triangle", "triangles"),
        counted(written.vertices, "vertex", "vertices"),
        counted(report.stations, "station", "stations"),
        counted(report.station_triangles, "triangle", "triangles"),
        report.voxel,
        binary(report.scratch_bytes),
    )?;
    writeln!(out, "  {}", holes::sentence(&report.borders))?;
    if let Some(filled) = &report.filled {
        writeln!(out, "  {}", holes::filled_sentence(filled))?;
    }
    let sentences = [intensities(report.light), accuracy::sentence(&report.accuracy)];
    for sentence in sentences.into_iter().flatten() {
        writeln!(out, "  {sentence}")?;
    }
    Ok(())
}
