//! `kilwa build`: read, build, write under a temporary name, read back and check, rename.

use crate::info::metres;
use crate::inputs::{InputArgs, Inputs};
use crate::progress::Bar;
use crate::source::open_pack;
use anyhow::Context;
use kilwa_builder::scratch::Scratch;
use kilwa_builder::work::Stop;
use kilwa_builder::{BuildOptions, BuildReport, Progress, Run, build, machine};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Turn a mesh into a pack.
///
/// Reads PLY, OBJ, STL and glTF. The pack holds the finest surface exactly, on a lattice finer than the mesh, and
/// coarser forms of it, each with a certified error.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// The pack to write.
    #[arg(short, long, value_name = "NAME.kilwa")]
    output: PathBuf,
    /// Worker threads; one per core where not given. The bytes do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
    /// Lattice step in metres, a power of two such as 0.0001220703125; derived from the mesh where not given.
    #[arg(long, value_name = "METRES")]
    step: Option<f64>,
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
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    // A rename would put a file in the place of a device or a pipe (as root even of /dev/full).
    if args.output.exists() && !args.output.is_file() {
        anyhow::bail!("{} is a folder or a device; give the name of a file", args.output.display());
    }
    if args.output.exists() && !args.force {
        anyhow::bail!("{} exists; give --force to replace it, or another name", args.output.display());
    }
    if args.capture_accuracy.is_some_and(|a| !(a > 0.0 && a.is_finite())) {
        anyhow::bail!("--capture-accuracy must be a length in metres above zero");
    }
    let mut inputs = Inputs::find(&args.input)?;
    if !inputs.passed_over.is_empty() {
        let names: Vec<String> = inputs.passed_over.iter().take(5).map(|p| p.display().to_string()).collect();
        eprintln!(
            "kilwa: {} files are no meshes and were passed over, the first of them {}",
            inputs.passed_over.len(),
            names.join(", ")
        );
    }
    let same = |input: &Path| matches!((input.canonicalize(), args.output.canonicalize()), (Ok(a), Ok(b)) if a == b);
    if let Some(input) = inputs.files.iter().find(|input| same(&input.path)) {
        anyhow::bail!("{} is an input; give another name for the pack", input.path.display());
    }
    let bar = Bar::new();
    // Before any input is read: a folder that cannot be written to is better known now than in an hour.
    let folder = match args.output.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let mut temporary = tempfile::Builder::new().prefix(".kilwa-build-").tempfile_in(folder).with_context(|| {
        format!("cannot write {}: no file can be made in {}", args.output.display(), folder.display())
    })?;
    let options = BuildOptions {
        title: args.title.clone().unwrap_or_else(|| inputs.files.first().map_or_else(String::new, |f| stem(&f.path))),
        threads: args.threads,
        step: args.step,
        crs: args.crs.clone(),
        capture_accuracy: args.capture_accuracy,
        units: args.input.units,
        up: inputs.up(),
        ..BuildOptions::default()
    };
    let (scratch, stop) = (Scratch::temporary()?, Stop::default());
    let memory = machine::default_budget();
    let run = Run { scratch: &scratch, memory, resume: false, stop: &stop, progress: &bar };
    let names = inputs.names();
    let built = build(&mut inputs, &options, &run, temporary.as_file_mut()).with_context(|| names)?;
    let cannot = || format!("cannot write {}", args.output.display());
    temporary.as_file().sync_all().with_context(cannot)?;
    check(temporary.path(), &bar).context("the pack that was just written does not read back; nothing was kept")?;
    bar.clear();
    readable_like_any_file(temporary.as_file()).with_context(cannot)?;
    // Without --force a file that appeared in the meantime is not replaced.
    let kept = if args.force { temporary.persist(&args.output) } else { temporary.persist_noclobber(&args.output) };
    kept.map_err(|e| e.error).with_context(cannot)?;
    report(args, &built)
}

/// Temporary files are private; the finished pack is as readable as any new file.
#[cfg(unix)]
fn readable_like_any_file(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn readable_like_any_file(_file: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

/// Read every chunk back.
fn check(path: &Path, bar: &Bar) -> anyhow::Result<()> {
    let pack = open_pack(path)?;
    let total = pack.entries().len() as u32;
    kilwa_pack::verify::directory(pack.entries())?;
    let mut totals = kilwa_pack::verify::Totals::default();
    for i in 0..total {
        totals = totals.plus(kilwa_pack::verify::chunk(i, &pack.chunk(i)?, pack.entries())?);
        bar.update("checking", u64::from(i) + 1, u64::from(total));
    }
    totals.agree(pack.header(), pack.metadata())?;
    Ok(())
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "untitled".to_owned(), |s| s.to_string_lossy().into_owned())
}

/// A certified bound, rounded up: what is printed is a bound too.
fn bound(metres: f64) -> String {
    if metres >= 1.0 {
        format!("{:.3} m", (metres * 1e3).ceil() / 1e3)
    } else {
        format!("{:.3} mm", (metres * 1e6).ceil() / 1e3)
    }
}

fn report(args: &Args, r: &BuildReport) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    if args.json {
        serde_json::to_writer_pretty(&mut out, r)?;
        writeln!(out)?;
        return Ok(());
    }
    let p = &r.pack;
    writeln!(out, "{}: {} triangles, {} vertices", args.output.display(), r.triangles, r.vertices)?;
    writeln!(out, "  size      {:.3} × {:.3} × {:.3} m", r.extent[0], r.extent[1], r.extent[2])?;
    writeln!(out, "  lattice   steps of {}; median edge {}", metres(r.step), metres(r.median_edge))?;
    writeln!(
        out,
        "  borders   {} edges; {} edges used by more than two triangles",
        r.border_edges, r.non_manifold_edges
    )?;
    writeln!(
        out,
        "  pack      {} bytes, {:.2} per triangle; {} chunks in {} levels; coarsest form {} triangles, within {}",
        p.bytes,
        p.bytes as f64 / r.triangles as f64,
        p.chunks,
        p.levels,
        p.root_triangles,
        bound(p.root_error)
    )?;
    for (kind, f) in &r.findings {
        let places = if f.places.is_empty() { String::new() } else { format!(" (first: {})", f.places.join("; ")) };
        writeln!(out, "  {:>9} {kind}{places}", f.count)?;
    }
    if r.overfull_leaves > 0 {
        writeln!(out, "  {:>9} places too dense to divide further, kept whole", r.overfull_leaves)?;
    }
    if r.stuck_diamonds > 0 {
        writeln!(
            out,
            "  {:>9} places that could not be simplified and keep their {} triangles at coarser levels",
            r.stuck_diamonds, r.stuck_triangles
        )?;
    }
    Ok(())
}
