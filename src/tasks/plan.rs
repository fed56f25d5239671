//! `kilwa plan`: begin a build on many machines, or see how far it is; list its tasks, and write a file for each.

use super::assembled::Assembled;
use super::object::{Object, Pack};
use super::place::{BUILD_FOLDER, Place};
use crate::build::{Shaping, refuse_output};
use crate::inputs::remote::Allowed;
use crate::synth::count;
use anyhow::Context;
use kilwa_builder::build::plan as plan_of;
use kilwa_builder::build::work::Stop;
use kilwa_builder::tasks::{SharedBuild, SharedPlan, TASK_TRIANGLES, TaskEntry, TaskFile};
use kilwa_pack::plural::counted;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Divide a build into tasks for many machines, or see which of its tasks are done.
///
/// At first, only the task `ingest` is listed: run it, then run the same command again to list the others. `kilwa task`
/// runs a task, and `kilwa assemble` writes the pack, with the same bytes as `kilwa build`. The folder and the inputs may be in
/// an S3-compatible store, s3://bucket/…, whose keys come from the environment (AWS_…).
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    pub(super) shaping: Shaping,
    /// Folder that all machines see at this path, or s3://bucket/folder; the build makes a folder of its own in it.
    #[arg(long, value_name = "DIR")]
    work: PathBuf,
    /// Triangles per task, for example 10M: a smaller number gives more, shorter tasks.
    #[arg(long, value_name = "N", default_value_t = TASK_TRIANGLES, value_parser = count)]
    task_triangles: u64,
    /// The pack that `kilwa assemble` will write: an existing one is refused now, unless it is in a store and this same build made it.
    #[arg(short, long, value_name = "NAME.kilwa")]
    output: Option<PathBuf>,
    /// Do not refuse an existing output.
    #[arg(long, requires = "output")]
    force: bool,
    /// Print the list of tasks as JSON.
    #[arg(long)]
    json: bool,
}

/// The report for machines.
#[derive(Serialize)]
struct Report<'a> {
    /// The folder of the build.
    build: String,
    key: String,
    tool: &'a str,
    tasks: Vec<TaskEntryFile>,
    /// Whether all tasks are known and done.
    complete: bool,
    /// The pack, if it is already in the store.
    #[serde(skip_serializing_if = "Option::is_none")]
    pack: Option<Pack>,
}

#[derive(Serialize)]
struct TaskEntryFile {
    #[serde(flatten)]
    listed: TaskEntry,
    /// The file to give to `kilwa task`.
    file: String,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let stop = Stop::default();
    let (inputs, options) = shaping(args, &std::env::temp_dir(), &stop).prepare(false)?;
    let work = Place::made(&args.work)?;
    let plan = SharedPlan {
        plan: plan_of(&inputs, &options)?,
        reading: format!(
            "allow-outside {}, unmasked {}",
            args.shaping.input.allow_outside, args.shaping.input.unmasked
        ),
        task_triangles: args.task_triangles,
        arguments: arguments()?,
        working_folder: working_folder(args)?,
    };
    let key = plan.key();
    let place = work.join(&format!("{BUILD_FOLDER}{key}"));
    if let Some((pack, kept)) = finished(args, &key, &place, &stop)? {
        if !kept {
            // The build was killed after its pack was uploaded.
            place.store(&stop)?.remove_all()?;
        }
        let tool = &plan.plan.tool;
        let report = Report { build: place.text()?, key, tool, tasks: Vec::new(), complete: true, pack: Some(pack) };
        return print(args, &report);
    }
    let build = SharedBuild::begin(place.store(&stop)?, plan)?;
    place.refuse_unfit(build.store())?;
    let tasks = write_tasks(&build, &place, &key)?;
    let complete = tasks.len() > 1 && tasks.iter().all(|t| t.listed.done);
    let report = Report { build: place.text()?, key, tool: &build.plan.plan.tool, tasks, complete, pack: None };
    print(args, &report)
}

/// The pack of this build, if it is in place, and whether the build was kept. Any other file or object there is refused.
///
/// With `--force`, only a pack made by the existing build counts, because files that meshes refer to may have changed since an earlier build.
fn finished(args: &Args, key: &str, place: &Place, stop: &Stop) -> anyhow::Result<Option<(Pack, bool)>> {
    let Some(output) = &args.output else { return Ok(None) };
    let Some(object) = Object::of(output, stop)? else {
        refuse_output(output, args.force)?;
        return Ok(None);
    };
    let Some(pack) = object.finished(key)? else {
        if !args.force {
            object.refuse_existing()?;
        }
        return Ok(None);
    };
    let noted = Assembled::of(&*place.store(stop)?)?.filter(|noted| noted.is(&pack));
    let kept = noted.as_ref().is_some_and(|noted| noted.kept);
    Ok((noted.is_some() || !args.force).then_some((pack, kept)))
}

/// The inputs, which may be in stores, and the options; `scratch` is an existing folder.
pub(super) fn shaping(args: &Args, scratch: &Path, stop: &Stop) -> Shaping {
    let mut shaping = args.shaping.clone();
    shaping.input.stores = Some(Allowed { scratch: scratch.to_owned(), stop: stop.clone() });
    shaping
}

/// The folder that relative paths start from; empty if there are none, so that other machines need not have it.
fn working_folder(args: &Args) -> anyhow::Result<String> {
    let input = &args.shaping.input;
    let matrix = input.transform.iter().filter(|file| file.as_os_str() != "auto");
    let is_elsewhere = |path: &PathBuf| path.is_absolute() || path.to_str().is_some_and(kilwa_store::is_address);
    if input.inputs.iter().chain(matrix).all(is_elsewhere) {
        return Ok(String::new());
    }
    utf8(&std::env::current_dir().context("the current folder is unknown")?)
}

/// The program's arguments; the task that reads the inputs parses them again.
fn arguments() -> anyhow::Result<Vec<String>> {
    let text = |a: std::ffi::OsString| {
        a.into_string().map_err(|a| anyhow::anyhow!("the argument {} is not UTF-8 text", a.display()))
    };
    std::env::args_os().skip(1).map(text).collect()
}

fn utf8(path: &Path) -> anyhow::Result<String> {
    let text = path.to_str().with_context(|| format!("the name {} is not UTF-8 text", path.display()))?;
    Ok(text.to_owned())
}

/// Write the files of all tasks that are known.
fn write_tasks(build: &SharedBuild, place: &Place, key: &str) -> anyhow::Result<Vec<TaskEntryFile>> {
    let written = build.store().list("tasks")?;
    let mut tasks = Vec::new();
    for listed in build.tasks()? {
        let name = format!("tasks/{}.json", listed.id);
        let tool = build.plan.plan.tool.clone();
        let file = TaskFile { build: place.text()?, key: key.to_owned(), tool, task: listed.task };
        let text = crate::terminal::json_text(&file)?;
        let there = if written.contains(&name) { build.store().read_all(&name)? } else { None };
        if there.as_deref() != Some(text.as_bytes()) {
            // A file that is damaged, or that names the place the folder was moved from, is replaced.
            if there.is_some() {
                build.store().remove(&name)?;
            }
            build.store().create_new(&name, text.as_bytes())?;
        }
        tasks.push(TaskEntryFile { file: place.join(&name).text()?, listed });
    }
    Ok(tasks)
}

fn print(args: &Args, report: &Report<'_>) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(report)?)?;
        return Ok(());
    }
    if report.pack.is_some() {
        let output = args.output.as_deref().unwrap_or(Path::new("the pack")).display();
        writeln!(out, "{output} is complete; there is nothing left to do")?;
        return Ok(());
    }
    let open: Vec<&TaskEntryFile> = report.tasks.iter().filter(|t| !t.listed.done).collect();
    let (all, done) = (report.tasks.len(), report.tasks.len() - open.len());
    writeln!(out, "{}: {done} of {} done", report.build, counted(all, "task", "tasks"))?;
    let Some(wave) = open.iter().map(|t| t.listed.wave).min() else {
        let next = if report.complete { "assemble the pack" } else { "run the same command again" };
        writeln!(out, "next: {next}")?;
        if report.complete {
            writeln!(out, "  kilwa assemble {} -o NAME.kilwa", report.build)?;
        }
        return Ok(());
    };
    let now: Vec<&&TaskEntryFile> = open.iter().filter(|t| t.listed.wave == wave).collect();
    writeln!(
        out,
        "next: {}, in any order and on any machine; then run the same command again",
        counted(now.len(), "task", "tasks")
    )?;
    for task in now {
        writeln!(out, "  kilwa task {}", task.file)?;
    }
    Ok(())
}
