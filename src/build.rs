//! `kilwa build`: read, build by way of scratch files, write under a temporary name, read back and check, rename.
//!
//! Ctrl-C stops cleanly and keeps the scratch files for `--resume`; an error removes them. Exit code 130 after Ctrl-C, 143 after SIGTERM.

mod finished;
mod need;
pub(crate) mod output;
pub(crate) mod report;
mod rights;
pub(crate) mod size;

use crate::inputs::{InputArgs, Inputs};
use crate::plausible::ReadAs;
use crate::progress::Bar;
use crate::signals;
use crate::stations::merged::Merging;
use crate::stations::points::StationPoints;
use anyhow::Context;
use finished::Finished;
use glam::DVec3;
use kilwa_archive::metadata::crs;
use kilwa_builder::build::machine;
use kilwa_builder::build::options::{COLOR_BITS, NORMAL_BITS};
use kilwa_builder::build::plan;
use kilwa_builder::build::work::Stop;
use kilwa_builder::points::build_points;
use kilwa_builder::scratch::Scratch;
use kilwa_builder::{BuildError, BuildOptions, BuildReport, Provenance, Run, StageTime, build};
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_files::size::binary;
use need::Need;
use output::{Output, beside};
use report::{Report, Spent};
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::Instant;

/// The inputs of a build, and every option that changes the bytes of the pack.
#[derive(Clone, clap::Args)]
pub(crate) struct Shaping {
    #[command(flatten)]
    pub(crate) input: InputArgs,
    /// Lattice spacing in metres, a power of two such as 0.0001220703125 (default: derived from the mesh).
    #[arg(long, value_name = "METRES")]
    step: Option<f64>,
    /// Keep only triangles whose centroid lies in this box, in metres and axes of the pack.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = crop, allow_hyphen_values = true)]
    crop: Option<[DVec3; 2]>,
    /// Drop triangles with a corner whose channel `confidence` or `quality` is below this.
    #[arg(long, value_name = "Q", allow_hyphen_values = true)]
    min_confidence: Option<f32>,
    /// Drop components of fewer triangles than this.
    #[arg(long, value_name = "N")]
    drop_islands_below: Option<u64>,
    /// Bits kept of each colour channel, 4 to 8; 8 is exact.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = bits(COLOR_BITS))]
    color_bits: u8,
    /// Bits of each of the two coordinates of a normal, 6 to 16; 10 is a tenth of a degree.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = bits(NORMAL_BITS))]
    normal_bits: u8,
    /// Coordinate reference system, stored with the model: an EPSG code such as EPSG:32737, well-known text, or local.
    #[arg(long)]
    crs: Option<String>,
    /// Standard uncertainty of the capture in metres, if known; stored with the model.
    #[arg(long, value_name = "METRES")]
    capture_accuracy: Option<f64>,
    /// Title of the model (default: the name of the first file).
    #[arg(long)]
    title: Option<String>,
}

/// Build a pack from meshes.
///
/// Reads PLY, OBJ, STL, glTF, Nexus, the finest level of 3D Tiles (`tileset.json`), and the mesh in a ZIP download from Sketchfab. The pack holds the finest surface exactly, on a lattice finer than the mesh, and
/// coarser forms of it, each with a certified error.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch of the command line")]
pub(crate) struct Args {
    #[command(flatten)]
    shaping: Shaping,
    /// The pack to write.
    #[arg(short, long, value_name = "NAME.kilwa")]
    output: PathBuf,
    /// Build a pack from the points of surveys instead of a surface, to show what was scanned before any surface exists.
    #[arg(long, conflicts_with_all = ["min_confidence", "drop_islands_below", "texture_detail", "resume", "color_bits"])]
    points: bool,
    /// Worker threads (default: one per core). The bytes do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = parse_threads)]
    threads: usize,
    /// Memory to use, for example 300M or 2.5GiB (default: a quarter of the machine's). The bytes do not depend on it.
    #[arg(long, value_name = "SIZE", value_parser = size::memory)]
    memory: Option<u64>,
    /// Folder for scratch files, preferably on a fast disk (default: beside the output).
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
    /// Resume a build that was stopped or killed, from its scratch files.
    #[arg(long)]
    resume: bool,
    /// Replace an existing output file.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    /// Print beforehand what will be used: memory, threads, disk space.
    #[arg(long)]
    verbose: bool,
    /// How the survey is merged: set by `kilwa merge`.
    #[arg(skip)]
    merging: Option<Box<Merging>>,
    /// What the metadata records instead of the input files: set by `kilwa colour`.
    #[arg(skip)]
    provenance: Option<Provenance>,
}

impl Args {
    /// What `kilwa merge` builds: the merged surface of one survey.
    pub(crate) fn of_merged(merging: Merging, output: PathBuf, common: Common) -> Self {
        let mut args = Self::of_one(merging.folder.clone(), output, common);
        args.shaping.input.unmasked = merging.options.unmasked;
        args.merging = Some(Box::new(merging));
        args
    }

    /// What `kilwa colour` builds: one mesh in metres, on a lattice with the given spacing; the metadata records `provenance` instead of its file.
    pub(crate) fn of_mesh(
        mesh: PathBuf,
        output: PathBuf,
        common: Common,
        step: Option<f64>,
        provenance: Option<Provenance>,
    ) -> Self {
        let mut args = Self::of_one(mesh, output, common);
        args.shaping.step = step;
        Self { provenance, ..args }
    }

    fn of_one(input: PathBuf, output: PathBuf, common: Common) -> Self {
        let Common { threads, memory, scratch, resume, title, crs, capture_accuracy, force, json } = common;
        let input = InputArgs {
            inputs: vec![input],
            units: None,
            up: None,
            origin: None,
            transform: None,
            texture_detail: None,
            allow_outside: false,
            unmasked: false,
            stores: None,
        };
        let shaping = Shaping {
            input,
            step: None,
            crop: None,
            min_confidence: None,
            drop_islands_below: None,
            color_bits: 8,
            normal_bits: 10,
            crs,
            capture_accuracy,
            title,
        };
        Self {
            shaping,
            output,
            points: false,
            threads,
            memory,
            scratch,
            resume,
            force,
            json,
            verbose: false,
            merging: None,
            provenance: None,
        }
    }
}

/// Build a pack for another command, which prints its own report; scratch files are removed.
///
/// # Errors
/// As for `kilwa build`; [`Interrupted`] if a stop is requested.
pub(crate) fn within(args: &Args, bar: &Bar, stop: &Stop) -> anyhow::Result<BuildReport> {
    let (inputs, options) = prepare(args)?;
    let read_as = args.shaping.read_as(&options);
    let complete = make(args, inputs, &options, bar, stop, Instant::now(), &read_as)?;
    complete.scratch.discard(|_| true)?;
    finished::remove(&args.output);
    Ok(complete.built)
}

/// Options shared with other commands that build.
pub(crate) struct Common {
    pub(crate) threads: usize,
    pub(crate) memory: Option<u64>,
    pub(crate) scratch: Option<PathBuf>,
    pub(crate) resume: bool,
    pub(crate) title: Option<String>,
    pub(crate) crs: Option<String>,
    pub(crate) capture_accuracy: Option<f64>,
    pub(crate) force: bool,
    pub(crate) json: bool,
}

/// The build was stopped by the user; what it leaves and how to continue.
#[derive(Debug)]
pub(crate) struct Interrupted(String);

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Interrupted {}

impl Interrupted {
    /// What was stopped, and what is left.
    pub(crate) fn new(what: &str) -> Self {
        Self(what.to_owned())
    }

    /// The exit code of the program.
    pub(crate) fn code() -> u8 {
        u8::try_from(128 + SIGNAL.load(Ordering::Relaxed)).unwrap_or(u8::MAX)
    }
}

/// So many bits as an option allows.
fn bits(range: RangeInclusive<u8>) -> clap::builder::RangedI64ValueParser<u8> {
    clap::value_parser!(u8).range(i64::from(*range.start())..=i64::from(*range.end()))
}

/// Six numbers: smallest and largest corner.
pub(crate) fn crop(text: &str) -> Result<[DVec3; 2], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse().map_err(|_| format!("{n:?} is not a number")))
        .collect::<Result<_, _>>()?;
    let [a, b, c, d, e, f] = numbers[..] else {
        return Err("expected six numbers, xmin,ymin,zmin,xmax,ymax,zmax, in metres".to_owned());
    };
    let bounds = [DVec3::new(a, b, c), DVec3::new(d, e, f)];
    match (0..3).find(|&k| bounds[0][k].partial_cmp(&bounds[1][k]).is_none_or(std::cmp::Ordering::is_ge)) {
        Some(k) => Err(format!("on the {} axis {} is not below {}", ["x", "y", "z"][k], bounds[0][k], bounds[1][k])),
        None => Ok(bounds),
    }
}

/// A pack that has its final name, and what is left to remove.
struct Complete {
    built: BuildReport,
    spent: Spent,
    scratch: Scratch,
    /// Dropped after the scratch files are gone.
    _parents: MadeFolders,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let begun = Instant::now();
    let (inputs, options) = prepare(args)?;
    let (bar, stop) = (Bar::new(), stop_on_signals()?);
    if args.resume && args.output.exists() {
        let finished = Finished::find(&args.output, &inputs, &options, &bar, &stop);
        bar.clear();
        if stop.asked() {
            return Err(Interrupted("stopped; nothing was changed".to_owned()).into());
        }
        // With --force, a pack that is damaged now is built again.
        if let Some(finished) = if args.force { finished.unwrap_or(None) } else { finished? } {
            return tidy(args, &finished);
        }
        if !args.force {
            return Err(exists(&args.output));
        }
    }
    let read_as = args.shaping.read_as(&options);
    let complete = make(args, inputs, &options, &bar, &stop, begun, &read_as)?;
    complete.scratch.discard(|_| true)?;
    finished::remove(&args.output);
    let report = Report::of(&complete.built, complete.spent, &read_as, args);
    print(args, &report)?;
    rights::say_what_downloads_state(&args.shaping.input.inputs, &args.output);
    Ok(())
}

/// The inputs and options of a build.
fn prepare(args: &Args) -> anyhow::Result<(Inputs, BuildOptions)> {
    refuse(args)?;
    let (mut inputs, options) = args.shaping.prepare(args.points)?;
    inputs.merging.clone_from(&args.merging);
    inputs.provenance.clone_from(&args.provenance);
    inputs.refuse_as_output(&args.output)?;
    refuse_name(&args.output)?;
    Ok((inputs, BuildOptions { threads: args.threads, ..options }))
}

impl Shaping {
    /// How the inputs are interpreted.
    fn read_as<'a>(&self, options: &'a BuildOptions) -> ReadAs<'a> {
        ReadAs { units: self.input.units, given_up: self.input.up, up: options.up, crs: options.crs.as_deref() }
    }

    /// Find the inputs, and turn the rest into options; `points` of surveys are wanted, or surfaces.
    ///
    /// # Errors
    /// What is wrong with an option or an input.
    pub(crate) fn prepare(&self, points: bool) -> anyhow::Result<(Inputs, BuildOptions)> {
        if self.capture_accuracy.is_some_and(|a| !(a > 0.0 && a.is_finite())) {
            anyhow::bail!("--capture-accuracy must be a length in metres, greater than zero");
        }
        let crs = reference_system(self.crs.as_deref())?;
        let inputs = Inputs::find(&self.input, points)?;
        if let Some(first) = inputs.passed_over.first() {
            let count = inputs.passed_over.len();
            crate::terminal::say!(
                "kilwa: skipped files that are not meshes ({count}), the first of them {}",
                first.display()
            );
        }
        let first_file = || inputs.files.first().map_or_else(String::new, |f| stem(&f.path));
        let options = BuildOptions {
            title: self.title.clone().unwrap_or_else(first_file),
            step: self.step,
            units: self.input.units.unwrap_or_default(),
            up: inputs.up(),
            crs,
            capture_accuracy: self.capture_accuracy,
            crop: self.crop,
            min_confidence: self.min_confidence,
            drop_islands_below: self.drop_islands_below,
            color_bits: self.color_bits,
            normal_bits: self.normal_bits,
            ..BuildOptions::default()
        };
        Ok((inputs, options))
    }
}

/// Build until the pack has its final name; the scratch files and the note remain.
fn make(
    args: &Args,
    mut inputs: Inputs,
    options: &BuildOptions,
    bar: &Bar,
    stop: &Stop,
    begun: Instant,
    read_as: &ReadAs<'_>,
) -> anyhow::Result<Complete> {
    let memory = args.memory.unwrap_or_else(machine::default_budget);
    // The state of the inputs before they are read.
    let plan = plan(&inputs, options)?;
    let folders = MadeFolders::for_file(&args.output);
    // Dropped after everything that is in them.
    let _folders = folders.with_context(|| format!("cannot write {}", args.output.display()))?;
    // Before any input is read: a folder that cannot be written to is better known now than in an hour.
    let mut output = Output::create(&args.output)?;
    finished::remove(&args.output);
    let scratch_folder = scratch_folder(args);
    let parents = MadeFolders::for_file(&scratch_folder);
    let parents = parents.with_context(|| format!("cannot make {}", folder_of(&scratch_folder).display()))?;
    let scratch = Scratch::open(&scratch_folder)?;
    let need = Need::of(inputs.files.iter().map(|f| f.path.as_path()), memory, args.shaping.input.allow_outside);
    let held = if args.resume { scratch.bytes() } else { discard_earlier(&scratch)? };
    if args.verbose {
        crate::terminal::say!(
            "kilwa: memory {}; scratch files about {} in {}; pack about {}",
            binary(memory),
            binary(need.scratch_bytes),
            scratch.folder().display(),
            binary(need.pack_bytes)
        );
    }
    let mut work = || -> anyhow::Result<(BuildReport, String)> {
        need.check(scratch.folder(), folder_of(&args.output), held)?;
        let run = Run { scratch: &scratch, memory, resume: args.resume, stop, progress: bar };
        let built = if args.points {
            build_points(&mut StationPoints(&inputs), options, &run, &mut output)
        } else {
            build(&mut inputs, options, &run, &mut output)
        };
        let mut built = built.map_err(|e| explained(e, &inputs, &args.output))?;
        let (clock, cpu) = (Instant::now(), machine::cpu_seconds());
        output.complete(built.pack.bytes)?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build()?;
        let identity = pool.install(|| output.check(bar, stop))?;
        let cpu_seconds = cpu.and_then(|before| Some(machine::cpu_seconds()? - before));
        built.stages.push(StageTime { stage: "check".into(), seconds: clock.elapsed().as_secs_f64(), cpu_seconds });
        Ok((built, identity))
    };
    let (built, identity) = match work() {
        Ok(done) => done,
        Err(error) => {
            bar.clear();
            drop(output);
            return Err(after_failure(error, scratch, stop, args.points));
        }
    };
    bar.clear();
    let threads = if args.threads == 0 { rayon::current_num_threads() } else { args.threads };
    let spent = Spent::of(&built, memory, threads, need, begun.elapsed().as_secs_f64());
    let report = serde_json::to_value(Report::of(&built, spent.clone(), read_as, args))?;
    // Only needed if the build is killed in the next moment.
    drop(Finished { plan, identity, bytes: built.pack.bytes, report }.write(&args.output));
    if let Err(error) = output.keep(args.force) {
        finished::remove(&args.output);
        return Err(error);
    }
    Ok(Complete { built, spent, scratch, _parents: parents })
}

/// Finish an earlier build that was killed after its pack had its final name.
fn tidy(args: &Args, finished: &Finished) -> anyhow::Result<()> {
    let folder = scratch_folder(args);
    if folder.exists() {
        Scratch::open(&folder)?.discard(|_| true)?;
    }
    finished::remove(&args.output);
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(&finished.report)?)?;
    } else {
        writeln!(
            out,
            "{}: complete. The build had written and checked the pack of {} bytes before it was stopped; nothing had to be built again",
            args.output.display(),
            finished.bytes
        )?;
    }
    Ok(())
}

/// Each thread takes memory of its own and a place in the system's tables, which thousands of them would fill for everybody.
pub(crate) fn parse_threads(text: &str) -> Result<usize, String> {
    const MAX: usize = 1024;
    let threads = text.parse().ok().filter(|n| *n <= MAX);
    threads.ok_or_else(|| format!("expected a number from 1 to {MAX}, or 0 for one per core"))
}

/// What is wrong with the arguments whatever the inputs are.
fn refuse(args: &Args) -> anyhow::Result<()> {
    // With --resume, what is there may be the pack of this very build.
    refuse_place(&args.output, args.force || args.resume)
}

/// Refuse what cannot become a pack.
pub(crate) fn refuse_output(output: &Path, force: bool) -> anyhow::Result<()> {
    refuse_place(output, force)?;
    refuse_name(output)
}

/// Refuse a place that no file can be written to.
fn refuse_place(output: &Path, replace: bool) -> anyhow::Result<()> {
    // A rename would put a file in the place of a device or a pipe (as root even of /dev/full).
    if output.exists() && !output.is_file() {
        anyhow::bail!("{} is a folder or a device; choose a file name", output.display());
    }
    if output.file_name().is_none() {
        anyhow::bail!("{} is not a file name", output.display());
    }
    if output.is_symlink() && !output.exists() {
        anyhow::bail!("{} is a link whose target does not exist; remove it, or choose another name", output.display());
    }
    if output.exists() && !replace {
        return Err(exists(output));
    }
    Ok(())
}

/// The reference system in the spelling that packs have. A code that Kilwa's list lacks may exist, so there is only a warning.
fn reference_system(given: Option<&str>) -> anyhow::Result<Option<String>> {
    let Some(given) = given else { return Ok(None) };
    let crs = crs::normalise(given).map_err(|why| anyhow::anyhow!("--crs: {why}"))?;
    if let Some(crs) = crs.as_deref().filter(|crs| !crs::is_listed(crs)) {
        crate::terminal::say!(
            "kilwa: warning: {crs} is not in the list of EPSG codes that Kilwa has; check it at https://epsg.org. It is stored as given"
        );
    }
    Ok(crs)
}

/// Refuse the name of another kind of file: what is called `a.ply` should be a PLY.
pub(crate) fn refuse_name(output: &Path) -> anyhow::Result<()> {
    let extension = output.extension().and_then(|e| e.to_str());
    if extension.is_some_and(|e| e.eq_ignore_ascii_case("kilwa")) {
        return Ok(());
    }
    let is_mesh = kilwa_formats::extract::Format::of(output, false).is_ok();
    let hint = if is_mesh { "; `kilwa extract` writes the mesh of a pack as PLY, OBJ, STL or GLB" } else { "" };
    let name = output.with_extension("kilwa");
    anyhow::bail!(
        "{}: `kilwa build` writes packs, whose names end in .kilwa; choose a name such as {}{hint}",
        output.display(),
        name.display()
    )
}

fn exists(output: &Path) -> anyhow::Error {
    anyhow::anyhow!("{} already exists; use --force to replace it, or choose another name", output.display())
}

/// The scratch folder of this output: `.NAME.kilwa.scratch`, beside it or in the folder that the user gave.
fn scratch_folder(args: &Args) -> PathBuf {
    let folder = beside(&args.output, ".scratch");
    match (&args.scratch, folder.file_name()) {
        (Some(given), Some(name)) => given.join(name),
        _ => folder,
    }
}

/// Files left by an earlier build are of no use without `--resume`. Returns the bytes that are left: none.
fn discard_earlier(scratch: &Scratch) -> anyhow::Result<u64> {
    let bytes = scratch.bytes();
    let files = scratch.files()?;
    if bytes > 0 {
        crate::terminal::say!(
            "kilwa: {} of scratch files of an earlier build discarded; --resume would have resumed it",
            binary(bytes)
        );
    }
    for (name, _) in files {
        scratch.remove(&name)?;
    }
    Ok(0)
}

/// The number of the signal that asked for a stop.
static SIGNAL: AtomicI32 = AtomicI32::new(signals::INTERRUPT);

/// The first signal asks for a clean stop, the second ends at once (scratch files stay good for `--resume`).
pub(crate) fn stop_on_signals() -> anyhow::Result<Stop> {
    let stop = Stop::default();
    let asked = stop.clone();
    signals::listen(move |number| {
        if asked.asked() {
            signals::end(number);
        }
        SIGNAL.store(number, Ordering::Relaxed);
        asked.ask();
    })
    .context("cannot listen for Ctrl-C")?;
    Ok(stop)
}

/// An error of the build, with what it is about where it does not say so itself.
fn explained(error: BuildError, inputs: &Inputs, output: &Path) -> anyhow::Error {
    match error {
        BuildError::Pack(kilwa_pack::PackError::Io { source, .. }) => {
            anyhow::Error::new(source).context(format!("cannot write {}", output.display()))
        }
        e @ (BuildError::Empty { .. }
        | BuildError::Step { .. }
        | BuildError::TooLarge { .. }
        | BuildError::TooSmall { .. }) => anyhow::Error::new(e).context(inputs.names()),
        e => e.into(),
    }
}

/// Keep the scratch files after a stop, and where another build's were in the way; remove them after any other failure.
fn after_failure(error: anyhow::Error, scratch: Scratch, stop: &Stop, points: bool) -> anyhow::Error {
    if stop.asked() && points {
        let left = scratch.discard(|_| true).err().map_or_else(String::new, |e| format!("; {e}"));
        return Interrupted(format!("stopped; nothing was kept{left}")).into();
    }
    if stop.asked() {
        let (bytes, folder) = (binary(scratch.bytes()), scratch.folder().display());
        return Interrupted(format!(
            "stopped; {bytes} of scratch files are kept in {folder}; run the same command with --resume to continue"
        ))
        .into();
    }
    let refused = matches!(error.downcast_ref::<BuildError>(), Some(BuildError::Resume { .. }));
    if !refused && let Err(e) = scratch.discard(|_| true) {
        return error.context(format!("{e}"));
    }
    error
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "untitled".to_owned(), |s| s.to_string_lossy().into_owned())
}

fn print(args: &Args, report: &Report<'_>) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(report)?)?;
    } else {
        report::print(&args.output, report, &mut out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    fn args(folder: &Path, more: &[&str]) -> Args {
        let (mesh, pack) = (folder.join("a.obj"), folder.join("a.kilwa"));
        let all = ["kilwa", mesh.to_str().unwrap(), "-o", pack.to_str().unwrap(), "--threads", "1", "--title", "a"];
        Cli::try_parse_from([&all[..], more].concat()).unwrap().args
    }

    /// A folder as a build leaves it if it is killed as soon as its pack has its final name.
    fn killed_after_the_rename(more: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.obj"), TRIANGLE).unwrap();
        let args = args(folder.path(), more);
        let (inputs, options) = prepare(&args).unwrap();
        let read_as = ReadAs { units: None, given_up: None, up: options.up, crs: None };
        drop(make(&args, inputs, &options, &Bar::new(), &Stop::default(), Instant::now(), &read_as).unwrap());
        assert!(folder.path().join(".a.kilwa.done").is_file());
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn modified(folder: &Path) -> std::time::SystemTime {
        folder.join("a.kilwa").metadata().unwrap().modified().unwrap()
    }

    #[test]
    fn a_build_that_was_killed_after_the_rename_is_finished_without_building_again() {
        for left in ["all", "empty", "none"] {
            for more in [&["--resume"][..], &["--resume", "--force"], &["--resume", "--json"]] {
                let folder = killed_after_the_rename(&[]);
                let (path, scratch) = (folder.path(), folder.path().join(".a.kilwa.scratch"));
                let (bytes, time) = (std::fs::read(path.join("a.kilwa")).unwrap(), modified(path));
                if left != "all" {
                    std::fs::remove_dir_all(&scratch).unwrap();
                }
                if left == "empty" {
                    std::fs::create_dir(&scratch).unwrap();
                }
                run(&args(path, more)).unwrap();
                assert_eq!(names(path), ["a.kilwa", "a.obj"], "{left}, {more:?}");
                assert!(std::fs::read(path.join("a.kilwa")).unwrap() == bytes && modified(path) == time, "{left}");
            }
        }
    }

    #[test]
    fn another_pack_or_build_is_not_mistaken_for_the_killed_one() {
        type Spoil<'a> = (&'a [&'a str], &'a dyn Fn(&Path));
        let spoils: [Spoil<'_>; 4] = [
            (&["--resume"], &|f| std::fs::write(f.join("a.kilwa"), "my thesis").unwrap()),
            (&["--resume"], &|f| std::fs::write(f.join(".a.kilwa.done"), "{}").unwrap()),
            (&["--resume"], &|f| std::fs::write(f.join("a.obj"), TRIANGLE.replace("1 0 0", "2 0 0")).unwrap()),
            (&["--resume", "--origin", "1,2,3"], &|_| ()),
        ];
        for (more, spoil) in spoils {
            let folder = killed_after_the_rename(&[]);
            spoil(folder.path());
            let before = std::fs::read(folder.path().join("a.kilwa")).unwrap();
            let refused = run(&args(folder.path(), more)).unwrap_err().to_string();
            assert!(refused.contains("already exists; use --force"), "{more:?}: {refused}");
            assert!(std::fs::read(folder.path().join("a.kilwa")).unwrap() == before, "{more:?}");
            assert!(folder.path().join(".a.kilwa.scratch/journal").is_file(), "{more:?}");
        }
    }

    #[test]
    fn only_scratch_folders_made_by_the_build_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a.obj"), TRIANGLE).unwrap();
        std::fs::create_dir(at("there")).unwrap();
        for (scratch, step) in [("new/deep", "0.125"), ("there/deep", "0.125"), ("there", "0.125"), ("new/deep", "3")] {
            let scratch = at(scratch);
            let built = run(&args(folder.path(), &["--force", "--step", step, "--scratch", scratch.to_str().unwrap()]));
            assert_eq!(built.is_ok(), step != "3", "{built:?}");
            assert!(!at("new").exists() && names(&at("there")).is_empty(), "{}", scratch.display());
        }
    }
}
