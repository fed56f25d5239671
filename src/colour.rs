//! `kilwa colour`: vertex colours from photographs.

mod frame;
mod photos;
mod report;

use crate::build::{self, Interrupted};
use crate::inputs::{source_file, summarised};
use crate::merge::resolved;
use crate::new_file::{PrivateFolder, check_output, private_folder_in, refuse_inputs};
use crate::progress::Bar;
use crate::resources::Resources;
use crate::source::{FileSource, open_pack};
use anyhow::{Context as _, ensure};
use kilwa_builder::build::work::Stop;
use kilwa_builder::{Capture, Progress as _, Provenance};
use kilwa_files::made_folders::MadeFolders;
use kilwa_formats::extract::{Extraction, Format, Output, Repaint, extract_repainted};
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_pack::metadata::{Metadata, SourceFile};
use kilwa_pack::{Chunk, Reader};
use kilwa_scan::ScanError;
use kilwa_scan::colour::align::{Aligned, Start};
use kilwa_scan::colour::{Colouring, Input, Model, Options, Report, colour};
use kilwa_scan::survey;
use photos::Photographs;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Colour a model from photographs with known cameras and poses.
///
/// Vertices that no photograph sees keep their colour, matched in tone to the photographs. The channel `photos` states how many photographs each colour is based on.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model: a pack, or a mesh in metres (PLY, OBJ, STL, glTF, Nexus). A survey before it supplies photographs (if --photos is not given) and the poses of panoramas.
    #[arg(value_name = "[SURVEY] MODEL", required = true, num_args = 1..=2)]
    inputs: Vec<PathBuf>,
    /// The folder of the photographs (default: the photographs of the survey).
    #[arg(long, value_name = "DIR")]
    photos: Option<PathBuf>,
    /// The file with the poses, if the folder contains several such files or the file is elsewhere; for COLMAP, the model's folder or one of its files.
    #[arg(long, value_name = "FILE", requires = "photos")]
    poses: Option<PathBuf>,
    #[command(flatten)]
    frame: frame::KnownFrame,
    /// The file to write: a pack (.kilwa) or a mesh (.ply, .obj, .glb).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    resources: Resources,
    /// Refine the pose of each photograph against the model, from up to a twentieth of its longer side, and leave out photographs that do not fit.
    #[arg(long)]
    refine: bool,
    /// Folder for pictures of the photographs that do not fit, with the edges of the model drawn over them.
    #[arg(long, value_name = "DIR", requires = "refine")]
    overlays: Option<PathBuf>,
    /// Split triangles until no edge spans more than this many pixels of any photograph that sees it; the surface stays the same.
    ///
    /// Without it, a detail of the photographs that is smaller than the triangles is lost.
    #[arg(long, value_name = "PIXELS", value_parser = crate::inputs::texels)]
    texture_detail: Option<f64>,
    /// Also write the report as a JSON file, to be kept with the model: it lists each photograph with its pose, its share of the colours and its tone.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// The model as a pack.
struct ModelPack {
    path: PathBuf,
    /// The mesh that it was built from, if the pack is temporary.
    mesh: Option<PathBuf>,
    /// What the pack that was given states about itself.
    metadata: Metadata,
}

impl Args {
    /// The survey, if there is one, and the model.
    fn survey_and_model(&self) -> anyhow::Result<(Option<&Path>, &Path)> {
        match self.inputs.as_slice() {
            [model] => {
                ensure!(
                    !model.join(survey::FILE).is_file(),
                    "{} is a survey; after it, give the model to be coloured",
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
            threads: self.resources.threads,
            memory: self.resources.memory,
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
    let start = args.frame.start()?;
    let read = photographs.inputs.iter().map(|input| input.path.as_path());
    let read: Vec<&Path> = read.chain([path]).chain(args.frame.files()).collect();
    refuse_inputs(&args.output, read.iter().copied())?;
    if let Some(report) = &args.report {
        ensure!(
            resolved(report)? != resolved(&args.output)?,
            "{} is already the name of the output; choose another name for the report",
            report.display()
        );
        check_output(report, args.force, read)?;
    }
    let output = Output::prepare(&args.output, args.force)?;
    let (bar, stop) = (Bar::new(), build::stop_on_signals()?);
    let folder = args.resources.scratch_for(&args.output);
    let made = MadeFolders::all_of(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let scratch = private_folder_in(&folder, ".kilwa-colour-");
    let scratch = scratch.with_context(|| format!("cannot make a scratch folder in {}", folder.display()))?;
    let done = work(args, path, (photographs, start), format, &output, &scratch, (&bar, &stop));
    bar.clear();
    let done =
        if done.is_err() && stop.asked() { Err(Interrupted::new("stopped; nothing was written").into()) } else { done };
    drop((scratch, made));
    done.and_then(|done| report::print(args, &done, begun.elapsed().as_secs_f64()))
}

/// The files of a photograph, as they were read.
struct PhotoFiles {
    photograph: SourceFile,
    mask: Option<SourceFile>,
}

impl PhotoFiles {
    /// Those of all inputs; None for a photograph that was left out because its file cannot be read.
    fn of(photographs: &Photographs, report: &Report, (bar, stop): (&Bar, &Stop)) -> anyhow::Result<Vec<Option<Self>>> {
        let read = |input: &Input| -> anyhow::Result<Self> {
            let mask = input.mask.as_deref().map(|mask| source_file(mask, bar, stop)).transpose()?;
            Ok(Self { photograph: source_file(&input.path, bar, stop)?, mask })
        };
        let pairs = photographs.inputs.iter().zip(&report.photos);
        pairs
            .map(|(input, photo)| match read(input) {
                Err(_) if photo.left_out.is_some() && !stop.asked() => Ok(None),
                files => files.map(Some),
            })
            .collect()
    }
}

/// What was written.
struct Done {
    photographs: Photographs,
    /// The files of each photograph that has a file, a camera and a pose.
    files: Vec<Option<PhotoFiles>>,
    /// How the frame of the reconstruction was found, if it is not that of the model.
    aligned: Option<Aligned>,
    /// Points of the reconstruction near the model and all of them, if the poses seem to be in other coordinates.
    doubt: Option<[usize; 2]>,
    report: Report,
    triangles: u64,
    vertices: u64,
    bytes: u64,
    /// What the format of the mesh cannot store.
    left_out: Vec<String>,
}

fn work(
    args: &Args,
    path: &Path,
    (mut photographs, start): (Photographs, Option<Start>),
    format: Format,
    output: &Output,
    scratch: &PrivateFolder,
    (bar, stop): (&Bar, &Stop),
) -> anyhow::Result<Done> {
    let model = as_pack(args, path, scratch.path(), bar, stop)?;
    let reader = open_pack(&model.path)?;
    ensure!(
        !reader.header().is_of_points(),
        "{} contains points without a surface, so it is unknown which of them a photograph sees; colour the merged mesh instead (`kilwa merge`)",
        path.display()
    );
    let _overlays = args.overlays.as_deref().map(MadeFolders::all_of).transpose()?;
    let options = Options {
        memory: args.resources.memory(),
        threads: args.resources.threads(),
        scratch: scratch.path().to_owned(),
        refine: args.refine,
        overlays: args.overlays.clone(),
        texture_detail: args.texture_detail,
    };
    let (mut aligned, mut doubt) = (None, None);
    bar.update("placing the photographs", 0, 1);
    let model_in_memory = Model::new(&reader, options.memory / 2);
    if let Some(start) = start {
        let (placed, found) = photographs.placed(&start, &model_in_memory)?;
        (photographs, aligned) = (placed, Some(found));
    } else {
        doubt = photographs.doubt(&model_in_memory)?;
    }
    drop(model_in_memory);
    let progress = BarProgress { bar, stop };
    let (colouring, report) = colour(&reader, &photographs.inputs, &options, &progress)?;
    let files = PhotoFiles::of(&photographs, &report, (bar, stop))?;
    let coloured = Coloured { args, reader: &reader, colouring, report, files, bar, stop };
    let (written, bytes) = if args.is_pack() {
        coloured.write_pack(&model, scratch.path())?
    } else {
        let written = coloured.write_mesh(format, output)?;
        let bytes = written.bytes;
        (written, bytes)
    };
    let Coloured { report, files, .. } = coloured;
    let Extraction { triangles, vertices, left_out, .. } = written;
    Ok(Done { photographs, files, aligned, doubt, report, triangles, vertices, bytes, left_out })
}

/// A model with its new colours.
struct Coloured<'a> {
    args: &'a Args,
    reader: &'a Reader<FileSource>,
    colouring: Colouring,
    report: Report,
    files: Vec<Option<PhotoFiles>>,
    bar: &'a Bar,
    stop: &'a Stop,
}

impl Repaint for Coloured<'_> {
    fn scalars(&self) -> Vec<String> {
        self.colouring.scalars()
    }

    fn repaint(&self, number: u32, chunk: &mut Chunk) -> Result<(), Box<dyn Error + Send + Sync>> {
        if self.stop.asked() {
            return Err(Box::new(ScanError::Stopped));
        }
        self.colouring.repaint(number, chunk)
    }
}

impl Coloured<'_> {
    fn write_mesh(&self, format: Format, output: &Output) -> anyhow::Result<Extraction> {
        let progress = |done, all| self.bar.update("writing", done, all);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.args.resources.threads()).build()?;
        Ok(extract_repainted(self.reader, format, self, output, &pool, &progress)?)
    }

    /// Build a pack of the coloured surface, on the lattice of the model; also returns the size of the pack in bytes.
    fn write_pack(&self, model: &ModelPack, scratch: &Path) -> anyhow::Result<(Extraction, u64)> {
        let mesh = scratch.join("coloured.ply");
        let surface = self.write_mesh(Format::of(&mesh, false)?, &Output::prepare(&mesh, false)?)?;
        let metadata = &model.metadata;
        let mut sources = match &model.mesh {
            Some(mesh) => vec![source_file(mesh, self.bar, self.stop)?],
            None => metadata.sources.clone(),
        };
        for (files, photo) in self.files.iter().zip(&self.report.photos) {
            // The model may have been coloured from it before.
            if let Some(files) = files.as_ref().filter(|files| photo.seen > 0 && !sources.contains(&files.photograph)) {
                sources.push(files.photograph.clone());
            }
        }
        let mut common = self.args.common(scratch, Some(metadata.title.clone()), metadata.crs.clone());
        let parts = metadata.capture_registration.zip(metadata.capture_instrument);
        let capture = metadata.capture_accuracy.zip(parts).map(|(accuracy, (registration, instrument))| Capture {
            accuracy,
            registration,
            instrument,
        });
        if capture.is_none() {
            common.capture_accuracy = metadata.capture_accuracy;
        }
        let provenance = Provenance { sources: summarised(sources), capture };
        // As much finer as the edges that were split most, but no finer than the lattice on which they were split.
        let halvings = self.report.split.map_or(0, |split| split.halvings);
        let step = metadata.lattice_step / f64::from(halvings).exp2();
        let step = Some(step.max(self.reader.header().lattice.step()));
        let building = build::Args::of_mesh(mesh, self.args.output.clone(), common, step, Some(provenance));
        Ok((surface, build::within(&building, self.bar, self.stop)?.pack.bytes))
    }
}

/// The model as a pack: itself, or a temporary one.
fn as_pack(args: &Args, path: &Path, scratch: &Path, bar: &Bar, stop: &Stop) -> anyhow::Result<ModelPack> {
    ensure!(path.exists(), "{} does not exist", path.display());
    ensure!(path.is_file(), "{} is not a file; give one mesh or pack", path.display());
    let build = |mesh: &Path, pack: PathBuf, common: build::Common, step: Option<f64>| -> anyhow::Result<PathBuf> {
        let building = build::Args::of_mesh(mesh.to_owned(), pack.clone(), common, step, None);
        build::within(&building, bar, stop)?;
        Ok(pack)
    };
    let is_mesh = !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("kilwa"));
    let pack = if is_mesh {
        build(path, scratch.join("model.kilwa"), args.common(scratch, None, None), None)?
    } else {
        path.to_owned()
    };
    let reader = open_pack(&pack)?;
    let metadata = reader.metadata().clone();
    let model = ModelPack { path: pack, mesh: is_mesh.then(|| path.to_owned()), metadata };
    if args.texture_detail.is_none() || reader.header().is_of_points() {
        return Ok(model);
    }
    // The lattice is about sixteen times as fine as the edges, which is too coarse for the parts of edges.
    let step = finer_step(&model.metadata);
    let common = args.common(scratch, Some(model.metadata.title.clone()), model.metadata.crs.clone());
    let mesh = if is_mesh { path.to_owned() } else { scratch.join("model.ply") };
    if !is_mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(args.resources.threads()).build()?;
        let progress = |done, all| bar.update("reading the model", done, all);
        let output = Output::prepare(&mesh, false)?;
        extract_repainted(&reader, Format::of(&mesh, false)?, &Unchanged { stop }, &output, &pool, &progress)?;
    }
    let finer = build(&mesh, scratch.join("finer.kilwa"), common, Some(step))?;
    drop(reader);
    let not_needed = if is_mesh { &model.path } else { &mesh };
    std::fs::remove_file(not_needed).with_context(|| format!("cannot remove {}", not_needed.display()))?;
    Ok(ModelPack { path: finer, ..model })
}

/// Leaves a model as it is; a signal stops the work.
struct Unchanged<'a> {
    stop: &'a Stop,
}

impl Repaint for Unchanged<'_> {
    fn scalars(&self) -> Vec<String> {
        Vec::new()
    }

    fn repaint(&self, _: u32, _: &mut Chunk) -> Result<(), Box<dyn Error + Send + Sync>> {
        if self.stop.asked() { Err(Box::new(ScanError::Stopped)) } else { Ok(()) }
    }
}

/// The spacing of a lattice that is sixteen times as fine as that of a pack, or less if the model is too large for it.
fn finer_step(metadata: &Metadata) -> f64 {
    let extent = (0..3).map(|k| metadata.bounds_max[k] - metadata.bounds_min[k]).fold(0.0, f64::max);
    let fits = |step: &f64| 1.1 * extent / step < f64::from(MAX_COORDINATE);
    [16.0, 8.0, 4.0, 2.0]
        .into_iter()
        .map(|times| metadata.lattice_step / times)
        .find(fits)
        .unwrap_or(metadata.lattice_step)
}

/// Shows progress on a bar; a signal stops the work.
struct BarProgress<'a> {
    bar: &'a Bar,
    stop: &'a Stop,
}

impl kilwa_scan::import::Progress for BarProgress<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.bar.update(stage, done, total);
    }

    fn is_stopped(&self) -> bool {
        self.stop.asked()
    }
}
