//! `kilwa colour`: vertex colours from photographs.

mod photos;
mod report;

use crate::build::{self, Interrupted, size};
use crate::inputs::{source_file, summarised};
use crate::new_file::{PrivateFolder, private_folder_in, refuse_inputs};
use crate::progress::Bar;
use crate::source::{FileSource, open_pack};
use anyhow::{Context as _, ensure};
use kilwa_builder::build::machine;
use kilwa_builder::build::work::Stop;
use kilwa_builder::{Capture, Progress as _, Provenance};
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_formats::extract::{Extraction, Format, Output, extract_repainted};
use kilwa_pack::Reader;
use kilwa_scan::ScanError;
use kilwa_scan::colour::{Colouring, Options, Report, colour};
use kilwa_scan::survey;
use photos::Photographs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Colour a model from photographs with known cameras and poses.
///
/// Vertices that no photograph sees keep their colour, matched in tone. The channel `photos` states how many photographs each colour rests on.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model: a pack, or a mesh in metres (PLY, OBJ, STL, glTF). A survey before it supplies photographs (if --photos is not given) and the poses of panoramas.
    #[arg(value_name = "[SURVEY] MODEL", required = true, num_args = 1..=2)]
    inputs: Vec<PathBuf>,
    /// The folder of the photographs (default: the photographs of the survey).
    #[arg(long, value_name = "DIR")]
    photos: Option<PathBuf>,
    /// The file with the poses, if the folder contains several or it is elsewhere; for COLMAP, the model's folder or one of its files.
    #[arg(long, value_name = "FILE", requires = "photos")]
    poses: Option<PathBuf>,
    /// The file to write: a pack (.kilwa) or a mesh (.ply, .obj, .glb).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Worker threads (default: one per core). The result does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = build::parse_threads)]
    threads: usize,
    /// Memory to use, for example 300M or 2.5GiB (default: a quarter of the machine's). The result does not depend on it.
    #[arg(long, value_name = "SIZE", value_parser = size::memory)]
    memory: Option<u64>,
    /// Folder for scratch files, preferably on a fast disk (default: the folder of the output).
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// The model as a pack.
struct Model {
    path: PathBuf,
    /// What it was made of, if the pack is only a temporary one.
    mesh: Option<PathBuf>,
}

impl Args {
    fn threads(&self) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        if self.threads == 0 { cores() } else { self.threads }
    }

    fn memory(&self) -> u64 {
        self.memory.unwrap_or_else(machine::default_budget)
    }

    /// The survey, if there is one, and the model.
    fn survey_and_model(&self) -> anyhow::Result<(Option<&Path>, &Path)> {
        match self.inputs.as_slice() {
            [model] => {
                ensure!(
                    !model.join(survey::FILE).is_file(),
                    "{} is a survey; name the model to be coloured after it",
                    model.display()
                );
                Ok((None, model))
            }
            [folder, model] => {
                ensure!(
                    folder.join(survey::FILE).is_file(),
                    "{} is not a survey, because it contains no {}; give one model, with a survey before it if there is one",
                    folder.display(),
                    survey::FILE
                );
                Ok((Some(folder), model))
            }
            _ => anyhow::bail!("give a model, with a survey before it if there is one"),
        }
    }

    fn is_pack(&self) -> bool {
        self.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("kilwa"))
    }

    fn common(&self, folder: &Path, title: Option<String>, crs: Option<String>) -> build::Common {
        build::Common {
            threads: self.threads,
            memory: self.memory,
            scratch: Some(folder.to_owned()),
            resume: false,
            title,
            crs,
            capture_accuracy: None,
            force: self.force,
            json: self.json,
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let begun = Instant::now();
    let (survey, path) = args.survey_and_model()?;
    let format =
        if args.is_pack() { Format::of(Path::new("coloured.ply"), false)? } else { Format::of(&args.output, false)? };
    ensure!(format.has_colors(), "{} cannot store colours; write a pack, PLY, OBJ or GLB", format.title());
    let photographs = Photographs::find(args.photos.as_deref(), args.poses.as_deref(), survey)?;
    let read = photographs.inputs.iter().map(|input| input.path.as_path());
    refuse_inputs(&args.output, read.chain([path]))?;
    let output = Output::prepare(&args.output, args.force)?;
    let (bar, stop) = (Bar::new(), build::stop_on_signals()?);
    let folder = args.scratch.clone().unwrap_or_else(|| folder_of(&args.output).to_owned());
    let made = MadeFolders::all_of(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let scratch = private_folder_in(&folder, ".kilwa-colour-");
    let scratch = scratch.with_context(|| format!("cannot make a scratch folder in {}", folder.display()))?;
    let done = work(args, path, &photographs, format, &output, &scratch, (&bar, &stop));
    bar.clear();
    let done = if stop.asked() { Err(Interrupted::new("stopped; nothing was written").into()) } else { done };
    drop((scratch, made));
    done.and_then(|done| report::print(args, &photographs, &done, begun.elapsed().as_secs_f64()))
}

/// What was written.
struct Done {
    report: Report,
    triangles: u64,
    vertices: u64,
    bytes: u64,
}

fn work(
    args: &Args,
    path: &Path,
    photographs: &Photographs,
    format: Format,
    output: &Output,
    scratch: &PrivateFolder,
    (bar, stop): (&Bar, &Stop),
) -> anyhow::Result<Done> {
    let model = as_pack(args, path, scratch.path(), bar, stop)?;
    let reader = open_pack(&model.path)?;
    ensure!(
        !reader.header().is_of_points(),
        "{} contains points without a surface, so what hides them from a photograph is unknown; colour the merged mesh instead (`kilwa merge`)",
        path.display()
    );
    let options = Options { memory: args.memory(), threads: args.threads(), scratch: scratch.path().to_owned() };
    let coloured = colour(&reader, &photographs.inputs, &options, &Shown { bar, stop });
    let (colouring, report) = coloured.map_err(|e| match e {
        ScanError::Stopped => Interrupted::new("stopped; nothing was written").into(),
        e => anyhow::Error::new(e),
    })?;
    if args.is_pack() {
        let (surface, bytes) = into_pack(args, &model, &reader, &colouring, photographs, scratch.path(), (bar, stop))?;
        return Ok(Done { report, triangles: surface.triangles, vertices: surface.vertices, bytes });
    }
    let written = into_mesh(&reader, format, &colouring, output, bar)?;
    Ok(Done { report, triangles: written.triangles, vertices: written.vertices, bytes: written.bytes })
}

fn into_mesh(
    reader: &Reader<FileSource>,
    format: Format,
    colouring: &Colouring,
    output: &Output,
    bar: &Bar,
) -> anyhow::Result<Extraction> {
    let progress = |done, all| bar.update("writing", done, all);
    Ok(extract_repainted(reader, format, colouring, output, &progress)?)
}

/// The model as a pack: itself, or a temporary one.
fn as_pack(args: &Args, path: &Path, scratch: &Path, bar: &Bar, stop: &Stop) -> anyhow::Result<Model> {
    ensure!(path.exists(), "{} does not exist", path.display());
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("kilwa")) {
        return Ok(Model { path: path.to_owned(), mesh: None });
    }
    let pack = scratch.join("model.kilwa");
    let building = build::Args::of_mesh(path.to_owned(), pack.clone(), args.common(scratch, None, None), None, None);
    build::within(&building, bar, stop)?;
    Ok(Model { path: pack, mesh: Some(path.to_owned()) })
}

/// Build a pack of the coloured surface, on the lattice that it has already; also returns the bytes of the pack.
fn into_pack(
    args: &Args,
    model: &Model,
    reader: &Reader<FileSource>,
    colouring: &Colouring,
    photographs: &Photographs,
    scratch: &Path,
    (bar, stop): (&Bar, &Stop),
) -> anyhow::Result<(Extraction, u64)> {
    let mesh = scratch.join("coloured.ply");
    let output = Output::prepare(&mesh, false)?;
    let surface = into_mesh(reader, Format::of(&mesh, false)?, colouring, &output, bar)?;
    let metadata = reader.metadata();
    let mut sources = match &model.mesh {
        Some(mesh) => vec![source_file(mesh, bar, stop)?],
        None => metadata.sources.clone(),
    };
    for input in &photographs.inputs {
        sources.push(source_file(&input.path, bar, stop)?);
    }
    let capture = metadata.capture_accuracy.map(|accuracy| Capture {
        accuracy,
        registration: metadata.capture_registration.unwrap_or(0.0),
        instrument: metadata.capture_instrument.unwrap_or(0.0),
    });
    let provenance = Provenance { sources: summarised(sources), capture };
    let common = args.common(scratch, Some(metadata.title.clone()), metadata.crs.clone());
    let step = Some(metadata.lattice_step);
    let building = build::Args::of_mesh(mesh, args.output.clone(), common, step, Some(provenance));
    Ok((surface, build::within(&building, bar, stop)?.pack.bytes))
}

/// Progress on a bar; what stops is a signal.
struct Shown<'a> {
    bar: &'a Bar,
    stop: &'a Stop,
}

impl kilwa_scan::import::Progress for Shown<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.bar.update(stage, done, total);
    }

    fn is_stopped(&self) -> bool {
        self.stop.asked()
    }
}
