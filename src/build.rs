//! `kilwa build`: read, build, write under a temporary name, read back and check, rename.

use crate::info::metres;
use crate::progress::Bar;
use crate::source::open_pack;
use anyhow::Context;
use kilwa_builder::{BuildOptions, BuildReport, Progress, RawMesh, Units, Up, build_pack, read};
use kilwa_pack::metadata::SourceFile;
use sha2::{Digest, Sha256};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Turn a mesh into a pack.
///
/// Reads PLY (ascii or binary). The pack holds the finest surface exactly, on a lattice finer than the mesh, and
/// coarser forms of it, each with a certified error.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Mesh files; several are joined, and vertices that match are welded.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The pack to write.
    #[arg(short, long, value_name = "NAME.kilwa")]
    output: PathBuf,
    /// Worker threads; one per core where not given. The bytes do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
    /// Lattice step in metres, a power of two such as 0.0001220703125; derived from the mesh where not given.
    #[arg(long, value_name = "METRES")]
    step: Option<f64>,
    /// Units of the input: m, dm, cm, mm, km, ft, us-ft, in.
    #[arg(long, default_value = "m", value_parser = units)]
    units: Units,
    /// Axis that points up in the input: z or y.
    #[arg(long, default_value = "z", value_parser = up)]
    up: Up,
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

/// Every source is named in the metadata, with its hash, and the metadata must leave room for a picture in the head.
const MOST_INPUTS: usize = 500;

fn units(name: &str) -> Result<Units, String> {
    Units::parse(name).ok_or_else(|| "give m, dm, cm, mm, km, ft, us-ft or in".to_owned())
}

fn up(name: &str) -> Result<Up, String> {
    match name {
        "z" => Ok(Up::Z),
        "y" => Ok(Up::Y),
        _ => Err("give z or y".to_owned()),
    }
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
    let same = |input: &PathBuf| matches!((input.canonicalize(), args.output.canonicalize()), (Ok(a), Ok(b)) if a == b);
    if let Some(input) = args.inputs.iter().find(|input| same(input)) {
        anyhow::bail!("{} is an input; give another name for the pack", input.display());
    }
    if args.inputs.len() > MOST_INPUTS {
        anyhow::bail!("{} inputs; a pack names at most {MOST_INPUTS} source files: join them first", args.inputs.len());
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
    let mut raw: Option<RawMesh> = None;
    let mut sources = Vec::new();
    for input in &args.inputs {
        let mesh = read::read_mesh(input, &mut |done, total| bar.update("reading", done, total))?;
        sources.push(source_file(input, &bar)?);
        match &mut raw {
            None => raw = Some(mesh),
            Some(all) => all.append(mesh),
        }
    }
    let options = BuildOptions {
        title: args.title.clone().unwrap_or_else(|| stem(&args.inputs[0])),
        threads: args.threads,
        step: args.step,
        units: args.units,
        up: args.up,
        crs: args.crs.clone(),
        capture_accuracy: args.capture_accuracy,
        sources,
        ..BuildOptions::default()
    };
    let names = args.inputs.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
    let built = build_pack(raw.unwrap_or_default(), &options, &bar).with_context(|| names)?;
    let cannot = || format!("cannot write {}", args.output.display());
    temporary.write_all(&built.bytes).with_context(cannot)?;
    temporary.as_file().sync_all().with_context(cannot)?;
    check(temporary.path(), &bar).context("the pack that was just written does not read back; nothing was kept")?;
    bar.clear();
    readable_like_any_file(temporary.as_file()).with_context(cannot)?;
    // Without --force a file that appeared in the meantime is not replaced.
    let kept = if args.force { temporary.persist(&args.output) } else { temporary.persist_noclobber(&args.output) };
    kept.map_err(|e| e.error).with_context(cannot)?;
    report(args, &built.report)
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

fn source_file(path: &Path, bar: &Bar) -> anyhow::Result<SourceFile> {
    let cannot = || format!("cannot read {}", path.display());
    let mut file = std::fs::File::open(path).with_context(cannot)?;
    let total = file.metadata().with_context(cannot)?.len();
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    let mut bytes = 0;
    loop {
        let n = file.read(&mut buffer).with_context(cannot)?;
        if n == 0 {
            break;
        }
        hash.update(&buffer[..n]);
        bytes += n as u64;
        bar.update("hashing", bytes, total);
    }
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let mut sha256 = String::new();
    for b in hash.finalize() {
        // Writing to a string cannot fail.
        let _ = std::fmt::Write::write_fmt(&mut sha256, format_args!("{b:02x}"));
    }
    Ok(SourceFile { name, bytes, sha256 })
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
