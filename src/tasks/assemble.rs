//! `kilwa assemble`: write the pack of a build on many machines, check it, and remove what the machines exchanged.

use super::{Machine, open};
use crate::build::output::Output;
use crate::build::{self, Interrupted, stop_on_signals};
use crate::progress::Bar;
use anyhow::Context;
use kilwa_builder::BuildReport;
use kilwa_builder::build::work::Work;
use kilwa_builder::tasks::{self, SharedFolder, Store};
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_pack::plural::counted;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Write the pack of a build whose tasks are all done.
///
/// The pack is read back and checked before it gets its name. Then the folder of the build is removed.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The folder of the build, as `kilwa plan` prints it.
    #[arg(value_name = "BUILD")]
    build: PathBuf,
    /// The pack to write.
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
    build::refuse_output(&args.output, args.force)?;
    let shared = open(&args.build)?;
    refuse_inside(args)?;
    let (bar, stop) = (Bar::new(), stop_on_signals()?);
    let folders = MadeFolders::for_file(&args.output);
    // Dropped after the file that is in them.
    let _folders = folders.with_context(|| format!("cannot write {}", args.output.display()))?;
    let mut output = Output::create(&args.output)?;
    let scratch = args.machine.scratch()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.machine.threads).build()?;
    let threads = pool.install(|| args.machine.threads());
    let work = Work { scratch: &scratch, memory: args.machine.memory(), threads, stop: &stop, progress: &bar };
    let write = || -> anyhow::Result<BuildReport> {
        let report = pool.install(|| tasks::assemble(shared, &work, &mut output))?;
        output.complete(report.pack.bytes)?;
        let checked = pool.install(|| output.check(&bar, &stop));
        checked.context("the pack that was just written cannot be read back; nothing was kept")?;
        Ok(report)
    };
    let written = write();
    bar.clear();
    let report = match written {
        Err(_) if stop.asked() => {
            return Err(Interrupted::new("stopped; the tasks are kept: run the same command again").into());
        }
        other => other?,
    };
    output.keep(args.force)?;
    print(args, &report)?;
    let removed = if args.keep { Ok(()) } else { SharedFolder::new(&args.build).remove_all() };
    if let Err(e) = removed {
        // The pack is in place all the same.
        crate::terminal::say!("kilwa: warning: {e}; the pack is complete, so remove {} yourself", args.build.display());
    }
    Ok(())
}

/// The folder of the build is removed in the end, and the pack would be with it.
fn refuse_inside(args: &Args) -> anyhow::Result<()> {
    let real = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path));
    let folder = folder_of(&args.output);
    let outer = folder.ancestors().find(|outer| outer.exists()).unwrap_or(folder);
    let outer = if outer.as_os_str().is_empty() { Path::new(".") } else { outer };
    if real(outer)?.starts_with(real(&args.build)?) {
        anyhow::bail!(
            "{} is in the folder of the build, which is removed when the pack is complete; choose another place",
            args.output.display()
        );
    }
    Ok(())
}

fn print(args: &Args, report: &BuildReport) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(report)?)?;
        return Ok(());
    }
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
