//! `kilwa assemble`: write the pack of a build on many machines, check it, and remove what the machines exchanged.

use super::object::Object;
use super::place::Place;
use super::{Machine, open};
use crate::build::output::Output;
use crate::build::{self, Interrupted, stop_on_signals};
use crate::progress::Bar;
use crate::stores;
use anyhow::Context;
use kilwa_builder::BuildReport;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::scratch::Scratch;
use kilwa_builder::tasks::{self, SharedBuild};
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_pack::plural::counted;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Name of a pack in the scratch folder, before it is sent to a store.
const PACK: &str = "pack.kilwa";

/// Write the pack of a build whose tasks are all done.
///
/// The pack is read back and checked before it gets its name. Then the folder of the build is removed. A pack for a store
/// (`-o s3://…`) is first written to the scratch folder.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The folder of the build, or its address s3://…, as `kilwa plan` prints it.
    #[arg(value_name = "BUILD")]
    build: PathBuf,
    /// The pack to write: a file, or an object s3://bucket/NAME.kilwa.
    #[arg(short, long, value_name = "NAME.kilwa")]
    output: PathBuf,
    #[command(flatten)]
    machine: Machine,
    /// Replace an existing output file.
    #[arg(long)]
    force: bool,
    /// Keep the folder of the build.
    #[arg(long)]
    keep: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (bar, stop) = (Bar::new(), stop_on_signals()?);
    let place = Place::of(&args.build)?;
    let object = Object::of(&args.output, &stop)?;
    match &object {
        None => build::refuse_output(&args.output, args.force)?,
        Some(_) if args.force => {}
        Some(object) => object.refuse_existing()?,
    }
    let shared = open(&place, &stop)?;
    refuse_inside(args, &place)?;
    let written = match &object {
        None => to_file(args, shared, &bar, &stop),
        Some(object) => to_store(args, object, shared, &bar, &stop),
    };
    bar.clear();
    let made = match written {
        Err(_) if stop.asked() => {
            return Err(Interrupted::new("stopped; the tasks are kept: run the same command again").into());
        }
        other => other?,
    };
    print(args, &made)?;
    let removed = if args.keep { Ok(()) } else { place.store(&stop)?.remove_all() };
    if let Err(e) = removed {
        // The pack is in place all the same.
        crate::terminal::say!("kilwa: warning: {e}; the pack is complete, so remove {place} yourself");
    }
    Ok(())
}

/// The report for machines.
#[derive(Serialize)]
struct Made {
    #[serde(flatten)]
    built: BuildReport,
    /// SHA-256 of a pack in a store.
    #[serde(skip_serializing_if = "Option::is_none")]
    sha256: Option<String>,
}

/// Write the pack to a file of this machine.
fn to_file(args: &Args, shared: SharedBuild, bar: &Bar, stop: &Stop) -> anyhow::Result<Made> {
    let folders = MadeFolders::for_file(&args.output);
    // Dropped after the file that is in them.
    let _folders = folders.with_context(|| format!("cannot write {}", args.output.display()))?;
    let mut output = Output::create(&args.output)?;
    let scratch = args.machine.scratch()?;
    let built = write(args, shared, &mut output, &scratch, bar, stop)?;
    output.keep(args.force)?;
    Ok(Made { built, sha256: None })
}

/// Write the pack, read it back and check it; it has not its name yet.
fn write(
    args: &Args,
    shared: SharedBuild,
    output: &mut Output,
    scratch: &Scratch,
    bar: &Bar,
    stop: &Stop,
) -> anyhow::Result<BuildReport> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.machine.threads).build()?;
    let threads = pool.install(|| args.machine.threads());
    let work = Work { scratch, memory: args.machine.memory(), threads, stop, progress: bar };
    let report = pool.install(|| tasks::assemble(shared, &work, output))?;
    output.complete(report.pack.bytes)?;
    let checked = pool.install(|| output.check(bar, stop));
    checked.context("the pack that was just written cannot be read back; nothing was kept")?;
    Ok(report)
}

/// Write and check the pack in the scratch folder, then send it to a store.
fn to_store(args: &Args, object: &Object, shared: SharedBuild, bar: &Bar, stop: &Stop) -> anyhow::Result<Made> {
    let scratch = args.machine.scratch()?;
    let (local, key) = (scratch.path(PACK), shared.plan.key());
    let mut output = Output::create(&local)?;
    let built = write(args, shared, &mut output, &scratch, bar, stop)?;
    output.keep(true)?;
    let pack = object.send(&local, &key, built.triangles, args.force, bar)?;
    Ok(Made { built, sha256: Some(pack.sha256) })
}

/// The folder of the build is removed in the end, and the pack would be with it.
fn refuse_inside(args: &Args, place: &Place) -> anyhow::Result<()> {
    let is_inside = match (place, stores::address(&args.output)?) {
        (Place::Store(build), Some(output)) => build.contains(&output),
        (Place::Folder(build), None) => {
            let real = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path));
            let folder = folder_of(&args.output);
            let outer = folder.ancestors().find(|outer| outer.exists()).unwrap_or(folder);
            let outer = if outer.as_os_str().is_empty() { Path::new(".") } else { outer };
            real(outer)?.starts_with(real(build)?)
        }
        _ => false,
    };
    if is_inside {
        anyhow::bail!(
            "{} is in the folder of the build, which is removed when the pack is complete; choose another place",
            args.output.display()
        );
    }
    Ok(())
}

fn print(args: &Args, made: &Made) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(made)?)?;
        return Ok(());
    }
    let report = &made.built;
    let p = &report.pack;
    writeln!(out, "{}: {}", args.output.display(), counted(report.triangles, "triangle", "triangles"))?;
    writeln!(
        out,
        "  pack      {}, {:.2} per triangle; {} in {}",
        counted(p.bytes, "byte", "bytes"),
        p.bytes as f64 / report.triangles.max(1) as f64,
        counted(p.chunks, "chunk", "chunks"),
        counted(p.levels, "level", "levels")
    )?;
    let cpu: Option<f64> = report.stages.iter().map(|s| s.cpu_seconds).sum();
    if let Some(cpu) = cpu {
        writeln!(out, "  tasks     {cpu:.1} s of processor time")?;
    }
    Ok(())
}
