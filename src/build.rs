//! `kilwa build`: read, build by way of scratch files, write under a temporary name, read back and check, rename.
//!
//! Ctrl-C stops cleanly and keeps the scratch files for `--resume`; an error removes them. Exit code 130 after Ctrl-C, 143 after SIGTERM.

mod need;
mod output;
pub(crate) mod report;
mod size;

use crate::inputs::{InputArgs, Inputs};
use crate::progress::Bar;
use crate::signals;
use anyhow::Context;
use kilwa_builder::build::machine;
use kilwa_builder::build::options::{COLOR_BITS, NORMAL_BITS};
use kilwa_builder::build::work::Stop;
use kilwa_builder::scratch::Scratch;
use kilwa_builder::{BuildError, BuildOptions, BuildReport, Run, StageTime, build};
use need::Need;
use output::{Output, beside, folder_of};
use report::{Report, Spent};
use size::human;
use std::io::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::Instant;

/// Turn a mesh into a pack.
///
/// Reads PLY, OBJ, STL and glTF. The pack holds the finest surface exactly, on a lattice finer than the mesh, and
/// coarser forms of it, each with a certified error.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "every one is a switch of the command line")]
pub(crate) struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// The pack to write.
    #[arg(short, long, value_name = "NAME.kilwa")]
    output: PathBuf,
    /// Worker threads; one per core where not given. The bytes do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = parse_threads)]
    threads: usize,
    /// Memory to hold, for example 300M or 2.5GiB; a quarter of the machine's where not given. The bytes do not depend on it.
    #[arg(long, value_name = "SIZE", value_parser = size::memory)]
    memory: Option<u64>,
    /// Folder for scratch files, best on a fast disk; beside the output where not given.
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
    /// Go on with a build that was stopped or killed, from its scratch files.
    #[arg(long)]
    resume: bool,
    /// Lattice step in metres, a power of two such as 0.0001220703125; derived from the mesh where not given.
    #[arg(long, value_name = "METRES")]
    step: Option<f64>,
    /// Keep only triangles whose centroid lies in this box, in metres and axes of the pack.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = crop, allow_hyphen_values = true)]
    crop: Option<[[f64; 3]; 2]>,
    /// Drop triangles with a corner whose channel `confidence` or `quality` is below this.
    #[arg(long, value_name = "Q", allow_hyphen_values = true)]
    min_confidence: Option<f32>,
    /// Drop components of fewer triangles than this.
    #[arg(long, value_name = "N")]
    drop_islands_below: Option<u64>,
    /// Bits that each channel of a colour keeps, 4 to 8; 8 is exact.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = bits(COLOR_BITS))]
    color_bits: u8,
    /// Bits that each of the two coordinates of a normal keeps, 6 to 16; 10 is a tenth of a degree.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = bits(NORMAL_BITS))]
    normal_bits: u8,
    /// Coordinate reference system, for example EPSG:32737; stored with the model.
    #[arg(long)]
    crs: Option<String>,
    /// Standard uncertainty of the capture in metres, where known; stored with the model.
    #[arg(long, value_name = "METRES")]
    capture_accuracy: Option<f64>,
    /// Title of the model; the name of the first file where not given.
    #[arg(long)]
    title: Option<String>,
    /// Replace the output where it exists.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    /// Say beforehand what will be used: memory, threads, room on disks.
    #[arg(long)]
    verbose: bool,
}

/// The build was stopped by the user; what it leaves and how to go on.
#[derive(Debug)]
pub(crate) struct Interrupted(String);

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Interrupted {}

impl Interrupted {
    /// What the program ends with.
    pub(crate) fn code() -> u8 {
        u8::try_from(128 + SIGNAL.load(Ordering::Relaxed)).unwrap_or(u8::MAX)
    }
}

/// So many bits as an option allows.
fn bits(range: RangeInclusive<u8>) -> clap::builder::RangedI64ValueParser<u8> {
    clap::value_parser!(u8).range(i64::from(*range.start())..=i64::from(*range.end()))
}

/// Six numbers: smallest and largest corner.
fn crop(text: &str) -> Result<[[f64; 3]; 2], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse().map_err(|_| format!("{n:?} is no number")))
        .collect::<Result<_, _>>()?;
    let [a, b, c, d, e, f] = numbers[..] else {
        return Err("give six numbers: xmin,ymin,zmin,xmax,ymax,zmax in metres".to_owned());
    };
    let bounds = [[a, b, c], [d, e, f]];
    match (0..3).find(|&k| bounds[0][k].partial_cmp(&bounds[1][k]).is_none_or(std::cmp::Ordering::is_ge)) {
        Some(k) => Err(format!("on the {} axis {} is not below {}", ["x", "y", "z"][k], bounds[0][k], bounds[1][k])),
        None => Ok(bounds),
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let begun = Instant::now();
    refuse(args)?;
    let mut inputs = Inputs::find(&args.input)?;
    if let Some(first) = inputs.passed_over.first() {
        let count = inputs.passed_over.len();
        crate::terminal::say!(
            "kilwa: skipped files that are not meshes ({count}), the first of them {}",
            first.display()
        );
    }
    inputs.refuse_as_output(&args.output)?;
    let options = BuildOptions {
        title: args.title.clone().unwrap_or_else(|| inputs.files.first().map_or_else(String::new, |f| stem(&f.path))),
        threads: args.threads,
        step: args.step,
        units: args.input.units,
        up: inputs.up(),
        crs: args.crs.clone(),
        capture_accuracy: args.capture_accuracy,
        crop: args.crop,
        min_confidence: args.min_confidence,
        drop_islands_below: args.drop_islands_below,
        color_bits: args.color_bits,
        normal_bits: args.normal_bits,
        ..BuildOptions::default()
    };
    let memory = args.memory.unwrap_or_else(machine::default_budget);
    let bar = Bar::new();
    let stop = stop_on_signals()?;
    // Before any input is read: a folder that cannot be written to is better known now than in an hour.
    let mut output = Output::create(&args.output)?;
    let scratch = open_scratch(args)?;
    let need = Need::of(inputs.files.iter().map(|f| f.path.as_path()), memory);
    let held = if args.resume { scratch.bytes() } else { discard_earlier(&scratch)? };
    if args.verbose {
        crate::terminal::say!(
            "kilwa: memory {}; scratch files about {} in {}; pack about {}",
            human(memory),
            human(need.scratch_bytes),
            scratch.folder().display(),
            human(need.pack_bytes)
        );
    }
    let mut work = || -> anyhow::Result<BuildReport> {
        need.check(scratch.folder(), folder_of(&args.output), held)?;
        let run = Run { scratch: &scratch, memory, resume: args.resume, stop: &stop, progress: &bar };
        let built = build(&mut inputs, &options, &run, &mut output);
        let mut built = built.map_err(|e| explained(e, &inputs, &args.output))?;
        let (clock, cpu) = (Instant::now(), machine::cpu_seconds());
        output.complete(built.pack.bytes)?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build()?;
        let checked = pool.install(|| output.check(&bar, &stop));
        checked.context("the pack that was just written does not read back; nothing was kept")?;
        let cpu_seconds = cpu.and_then(|before| Some(machine::cpu_seconds()? - before));
        built.stages.push(StageTime { stage: "check".into(), seconds: clock.elapsed().as_secs_f64(), cpu_seconds });
        Ok(built)
    };
    let built = match work() {
        Ok(built) => built,
        Err(error) => {
            bar.clear();
            drop(output);
            return Err(after_failure(error, scratch, &stop));
        }
    };
    bar.clear();
    output.keep(args.force)?;
    scratch.discard(|_| true)?;
    let threads = if args.threads == 0 { rayon::current_num_threads() } else { args.threads };
    let run = Spent::of(&built, memory, threads, need, begun.elapsed().as_secs_f64());
    print(args, &Report { build: &built, run })
}

/// Each thread takes memory of its own and a place in the system's tables, which thousands of them would fill for everybody.
fn parse_threads(text: &str) -> Result<usize, String> {
    const MAX: usize = 1024;
    let threads = text.parse().ok().filter(|n| *n <= MAX);
    threads.ok_or_else(|| format!("expected a number from 1 to {MAX}, or 0 for one per core"))
}

/// What is wrong with the arguments whatever the inputs are.
fn refuse(args: &Args) -> anyhow::Result<()> {
    // A rename would put a file in the place of a device or a pipe (as root even of /dev/full).
    if args.output.exists() && !args.output.is_file() {
        anyhow::bail!("{} is a folder or a device; give the name of a file", args.output.display());
    }
    if args.output.file_name().is_none() {
        anyhow::bail!("{} is no name of a file", args.output.display());
    }
    if args.output.is_symlink() && !args.output.exists() {
        anyhow::bail!(
            "{} is a link whose target does not exist; remove it, or give another name",
            args.output.display()
        );
    }
    if args.output.exists() && !args.force {
        anyhow::bail!("{} exists; give --force to replace it, or another name", args.output.display());
    }
    if args.capture_accuracy.is_some_and(|a| !(a > 0.0 && a.is_finite())) {
        anyhow::bail!("--capture-accuracy must be a length in metres above zero");
    }
    Ok(())
}

/// The scratch folder of this output: `.NAME.kilwa.scratch`, beside it or in the folder that the user gave.
fn open_scratch(args: &Args) -> anyhow::Result<Scratch> {
    let mut folder = beside(&args.output, ".scratch");
    if let (Some(given), Some(name)) = (&args.scratch, folder.file_name()) {
        folder = given.join(name);
    }
    Ok(Scratch::open(&folder)?)
}

/// What an earlier build left is of no use without `--resume`. Returns the bytes that are left: none.
fn discard_earlier(scratch: &Scratch) -> anyhow::Result<u64> {
    let bytes = scratch.bytes();
    let files = scratch.files()?;
    if bytes > 0 {
        crate::terminal::say!(
            "kilwa: {} of scratch files of an earlier build discarded; --resume would have gone on with it",
            human(bytes)
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
fn stop_on_signals() -> anyhow::Result<Stop> {
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
        e @ (BuildError::Empty { .. } | BuildError::Step { .. } | BuildError::TooLarge { .. }) => {
            anyhow::Error::new(e).context(inputs.names())
        }
        e => e.into(),
    }
}

/// Keep the scratch files after a stop, and where another build's were in the way; remove them after any other failure.
fn after_failure(error: anyhow::Error, scratch: Scratch, stop: &Stop) -> anyhow::Error {
    if stop.asked() {
        let (bytes, folder) = (human(scratch.bytes()), scratch.folder().display());
        return Interrupted(format!(
            "stopped; {bytes} of scratch files are kept in {folder}: the same command with --resume goes on from there"
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
