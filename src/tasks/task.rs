//! `kilwa task`: do one task of a build on many machines.

use super::place::Place;
use super::{Machine, open};
use crate::build::{Interrupted, stop_on_signals};
use crate::inputs::remote;
use crate::progress::Bar;
use crate::stores;
use anyhow::{Context, bail};
use clap::Parser;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::tasks::{self, Outcome, SharedBuild, Task, TaskFile};
use kilwa_builder::{BuildError, BuildOptions, Inputs};
use kilwa_files::plain_file;
use kilwa_files::size::binary;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// A task file is a few hundred bytes long.
const MAX_TASK_FILE_BYTES: u64 = 1 << 16;

/// Run one task of a build that `kilwa plan` has divided.
///
/// A finished task does not run again. A task may be started twice, and killed at any moment. Exit code 0: it is done.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The file of the task, or its address s3://…, as `kilwa plan` lists it.
    #[arg(value_name = "TASK.json")]
    file: PathBuf,
    #[command(flatten)]
    machine: Machine,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let stop = stop_on_signals()?;
    let given = read(args, &stop)?;
    let build = open(&Place::of(given.build.as_ref())?, &stop)?;
    if build.plan.key() != given.key {
        bail!("{}: the folder {} now holds another build; run `kilwa plan` again", args.file.display(), given.build);
    }
    let bar = Bar::new();
    let scratch = args.machine.scratch()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.machine.threads).build()?;
    let threads = pool.install(|| args.machine.threads());
    let work = Work { scratch: &scratch, memory: args.machine.memory(), threads, stop: &stop, progress: &bar };
    let done = pool.install(|| {
        let mut inputs = || prepared(&build, scratch.folder(), &stop);
        tasks::run(&build, given.task, &work, &mut inputs)
    });
    bar.clear();
    let id = given.task.id();
    match done {
        Ok(done) => print(args, &id, &done),
        Err(_) if stop.asked() => Err(Interrupted::new(&format!("{id} was stopped; nothing was kept")).into()),
        Err(error) => {
            // Users do not know the folder that meshes were downloaded to.
            let words = error.to_string();
            let better = remote::in_words(&words, scratch.folder());
            let error = if better == words { error.into() } else { anyhow::anyhow!(better) };
            Err(error.context(format!("the task {id}{}", near(&build, given.task))))
        }
    }
}

fn read(args: &Args, stop: &Stop) -> anyhow::Result<TaskFile> {
    let cannot = || format!("cannot read {}", args.file.display());
    let mut text = String::new();
    if let Some(address) = stores::address(&args.file)? {
        let objects = stores::objects(&address.bucket, stop)?;
        let found = objects.read_all(&address.path, MAX_TASK_FILE_BYTES).with_context(cannot)?;
        let found = found.with_context(|| format!("{address} is not in the store; run `kilwa plan` again"))?;
        text = String::from_utf8_lossy(&found).into_owned();
    } else {
        plain_file::open(&args.file)
            .with_context(cannot)?
            .take(MAX_TASK_FILE_BYTES)
            .read_to_string(&mut text)
            .with_context(cannot)?;
    }
    let task: TaskFile = serde_json::from_str(&text).with_context(|| {
        format!("{} is not a task: give one of the files that `kilwa plan` lists", args.file.display())
    })?;
    let tool = kilwa_builder::build::tool();
    if task.tool != tool {
        bail!("the build was planned by {}, and this is {tool}: install the same version on every machine", task.tool);
    }
    Ok(task)
}

/// The inputs and options, from the arguments that the build was planned with.
fn prepared(build: &SharedBuild, scratch: &Path, stop: &Stop) -> Result<(Box<dyn Inputs>, BuildOptions), BuildError> {
    let refused = |why: String| BuildError::Inputs { why };
    let folder = &build.plan.working_folder;
    if !folder.is_empty() {
        std::env::set_current_dir(folder)
            .map_err(|e| refused(format!("the folder {folder} cannot be used here: {e}")))?;
    }
    let words = std::iter::once("kilwa".to_owned()).chain(build.plan.arguments.iter().cloned());
    let cli = crate::Cli::try_parse_from(words).map_err(|e| refused(format!("the plan cannot be read: {e}")))?;
    let crate::Verb::Plan(args) = cli.verb else {
        return Err(refused("the plan was not made by `kilwa plan`".to_owned()));
    };
    let shaping = super::plan::shaping(&args, scratch, stop);
    let (inputs, options) = shaping.prepare(false).map_err(|e| refused(format!("{e:#}")))?;
    Ok((Box::new(inputs), options))
}

/// Where on the model a task is, for a message.
fn near(build: &SharedBuild, task: Task) -> String {
    let tasks = build.tasks().unwrap_or_default();
    let near = tasks.into_iter().find(|t| t.task == task).and_then(|t| t.near);
    near.map_or_else(String::new, |p| format!(" (near {:.2}, {:.2}, {:.2} m)", p.x, p.y, p.z))
}

fn print(args: &Args, id: &str, done: &Outcome) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let m = &done.manifest;
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(done)?)?;
    } else if done.already_done {
        writeln!(out, "{id}: already done")?;
    } else {
        writeln!(
            out,
            "{id}: done in {:.1} s; {} read, {} written",
            m.seconds,
            binary(m.bytes_read),
            binary(m.bytes_written)
        )?;
    }
    Ok(())
}
