//! `kilwa assemble`: write the pack of a build on many machines, check it, and remove what the machines exchanged.

use super::assembled::{self, Assembled};
use super::object::{Object, Pack};
use super::place::Place;
use super::{Machine, open};
use crate::build::output::Output;
use crate::build::{self, Interrupted, stop_on_signals};
use crate::progress::Bar;
use crate::stores;
use anyhow::Context;
use kilwa_archive::checksums::sha256_of;
use kilwa_builder::BuildReport;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::scratch::Scratch;
use kilwa_builder::tasks::{self, SharedBuild};
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_pack::plural::counted;
use serde::Serialize;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Name of a pack in the scratch folder, before it is uploaded to a store.
const PACK: &str = "pack.kilwa";

/// Write the pack of a build whose tasks are all done.
///
/// The pack is written under a temporary name, read back, checked and renamed. Then the folder of the build is removed. A pack for a
/// store (`-o s3://…`) is first written to the scratch folder, then uploaded.
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
    /// Replace an existing output.
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
    if object.is_none() {
        // Whether an existing output is the pack of this build is checked below.
        build::refuse_output(&args.output, true)?;
    }
    refuse_inside(args, &place)?;
    if let Some(found) = found(args, &place, object.as_ref(), &stop)? {
        return print_found(args, &found);
    }
    match &object {
        None => build::refuse_output(&args.output, args.force)?,
        Some(_) if args.force => {}
        Some(object) => object.refuse_existing()?,
    }
    let shared = open(&place, &stop)?;
    let written = match &object {
        None => to_file(args, &place, shared, &bar, &stop),
        Some(object) => to_store(args, object, &place, shared, &bar, &stop),
    };
    bar.clear();
    let made = match written {
        Err(_) if stop.asked() => {
            return Err(Interrupted::new("stopped; the tasks are kept: run the same command again").into());
        }
        other => other?,
    };
    print(args, &made)?;
    remove(args, &place, &stop)
}

/// Remove the build; its pack is in place.
fn remove(args: &Args, place: &Place, stop: &Stop) -> anyhow::Result<()> {
    let removed = if args.keep { Ok(()) } else { place.store(stop)?.remove_all() };
    if let Err(e) = removed {
        // The pack is in place all the same.
        crate::terminal::say!("kilwa: warning: {e}; the pack is complete, so remove {place} yourself");
    }
    Ok(())
}

/// The pack, if an earlier run of the same command put it in place and was then killed; the rest of the build is removed.
fn found(args: &Args, place: &Place, object: Option<&Object>, stop: &Stop) -> anyhow::Result<Option<Pack>> {
    let store = place.store(stop)?;
    let pack = if assembled::exists(&*store)? {
        let shared = open(place, stop)?;
        // A build that was kept on purpose was not left over by a killed run.
        let noted = Assembled::of(&*store)?.filter(|noted| noted.kept == args.keep);
        match object {
            None => noted.map_or(Ok(None), |noted| the_output(args, &noted))?,
            Some(object) => match object.finished(&shared.plan.key())? {
                Some(pack) if noted.as_ref().is_some_and(|noted| noted.is(&pack)) => Some(pack),
                // The record was removed together with the results of the tasks.
                Some(pack) if noted.is_none() && !args.force && assembled::is_being_removed(&shared)? => Some(pack),
                _ => None,
            },
        }
    } else {
        // The plan has been removed too, although some uploads may remain; the name of the folder contains the key of the build.
        place.key().zip(object).map_or(Ok(None), |(key, object)| object.finished(&key))?
    };
    if pack.is_some() {
        remove(args, place, stop)?;
    }
    Ok(pack)
}

/// The output, if it is the pack in the record of the build.
fn the_output(args: &Args, noted: &Assembled) -> anyhow::Result<Option<Pack>> {
    if !std::fs::metadata(&args.output).is_ok_and(|about| about.len() == noted.pack.bytes) {
        return Ok(None);
    }
    let cannot = || format!("cannot read {}", args.output.display());
    let (bytes, sha256) = sha256_of(File::open(&args.output).with_context(cannot)?).with_context(cannot)?;
    let pack = Pack { bytes, sha256, triangles: noted.pack.triangles };
    Ok(noted.is(&pack).then_some(pack))
}

/// The report for machines.
#[derive(Serialize)]
struct Made {
    #[serde(flatten)]
    built: BuildReport,
    /// SHA-256 of the pack.
    sha256: String,
}

/// The JSON report if an earlier run had put the pack in place.
#[derive(Serialize)]
struct Found<'a> {
    already_done: bool,
    triangles: u64,
    sha256: &'a str,
    pack: FoundPack,
}

#[derive(Serialize)]
struct FoundPack {
    bytes: u64,
}

/// Write the pack to a file of this machine.
fn to_file(args: &Args, place: &Place, shared: SharedBuild, bar: &Bar, stop: &Stop) -> anyhow::Result<Made> {
    let folders = MadeFolders::for_file(&args.output);
    // Dropped after the file inside them.
    let _folders = folders.with_context(|| format!("cannot write {}", args.output.display()))?;
    let mut output = Output::create(&args.output)?;
    let scratch = args.machine.scratch()?;
    let (built, pack) = write(args, place, shared, &mut output, &scratch, bar, stop)?;
    output.keep(args.force)?;
    Ok(Made { built, sha256: pack.sha256 })
}

/// Write the pack under a temporary name, read it back, check it, and record it in the build.
fn write(
    args: &Args,
    place: &Place,
    shared: SharedBuild,
    output: &mut Output,
    scratch: &Scratch,
    bar: &Bar,
    stop: &Stop,
) -> anyhow::Result<(BuildReport, Pack)> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.machine.threads).build()?;
    let threads = pool.install(|| args.machine.threads());
    let work = Work { scratch, memory: args.machine.memory(), threads, stop, progress: bar };
    let (report, decoded) = pool.install(|| tasks::assemble(shared, &work, output))?;
    output.complete(report.pack.bytes)?;
    pool.install(|| output.check_decoded(decoded, bar, stop))?;
    let pack = Pack { bytes: report.pack.bytes, sha256: output.sha256()?, triangles: report.triangles };
    Assembled { pack: pack.clone(), kept: args.keep }.note(&*place.store(stop)?)?;
    Ok((report, pack))
}

/// Write and check the pack in the scratch folder, then upload it to a store.
fn to_store(
    args: &Args,
    object: &Object,
    place: &Place,
    shared: SharedBuild,
    bar: &Bar,
    stop: &Stop,
) -> anyhow::Result<Made> {
    let scratch = args.machine.scratch()?;
    let (local, key) = (scratch.path(PACK), shared.plan.key());
    let mut output = Output::create(&local)?;
    let (built, pack) = write(args, place, shared, &mut output, &scratch, bar, stop)?;
    output.keep(true)?;
    object.send(&local, &key, &pack, args.force, bar)?;
    Ok(Made { built, sha256: pack.sha256 })
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

fn print_found(args: &Args, pack: &Pack) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        let found = FoundPack { bytes: pack.bytes };
        let found = Found { already_done: true, triangles: pack.triangles, sha256: &pack.sha256, pack: found };
        writeln!(out, "{}", crate::terminal::json_text(&found)?)?;
    } else {
        writeln!(out, "{}: complete already; nothing was left to do", args.output.display())?;
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
