//! `kilwa plan`: begin a build on many machines, or see how far it is; list its tasks, and write a file for each.

use crate::build::Shaping;
use crate::synth::count;
use anyhow::Context;
use kilwa_builder::build::plan as plan_of;
use kilwa_builder::tasks::{SharedBuild, SharedFolder, SharedPlan, TASK_TRIANGLES, TaskEntry, TaskFile};
use kilwa_pack::plural::counted;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Divide a build into tasks for many machines, or see which of its tasks are done.
///
/// At first, only the task `ingest` is listed: run it, then run the same command again to list the others. `kilwa task`
/// runs a task, and `kilwa assemble` writes the pack, with the same bytes as `kilwa build`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    pub(super) shaping: Shaping,
    /// Folder that all machines see at this path; the build makes a folder of its own in it.
    #[arg(long, value_name = "DIR")]
    work: PathBuf,
    /// Triangles per task, for example 10M: a smaller number gives more, shorter tasks.
    #[arg(long, value_name = "N", default_value_t = TASK_TRIANGLES, value_parser = count)]
    task_triangles: u64,
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
}

#[derive(Serialize)]
struct TaskEntryFile {
    #[serde(flatten)]
    listed: TaskEntry,
    /// The file to give to `kilwa task`.
    file: String,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (inputs, options) = args.shaping.prepare(false)?;
    let folder = std::env::current_dir().context("the current folder is unknown")?;
    std::fs::create_dir_all(&args.work).with_context(|| format!("cannot make the folder {}", args.work.display()))?;
    let work = std::path::absolute(&args.work).with_context(|| format!("cannot use {}", args.work.display()))?;
    let plan = SharedPlan {
        plan: plan_of(&inputs, &options)?,
        reading: format!(
            "allow-outside {}, unmasked {}",
            args.shaping.input.allow_outside, args.shaping.input.unmasked
        ),
        task_triangles: args.task_triangles,
        arguments: arguments()?,
        working_folder: utf8(&folder)?,
    };
    let key = plan.key();
    let place = work.join(format!("kilwa-build-{key}"));
    let build = SharedBuild::begin(Box::new(SharedFolder::new(&place)), plan)?;
    let tasks = write_tasks(&build, &place, &key)?;
    let complete = tasks.len() > 1 && tasks.iter().all(|t| t.listed.done);
    let report = Report { build: utf8(&place)?, key, tool: &build.plan.plan.tool, tasks, complete };
    print(args, &report)
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
fn write_tasks(build: &SharedBuild, place: &Path, key: &str) -> anyhow::Result<Vec<TaskEntryFile>> {
    let written = build.store().list("tasks")?;
    let mut tasks = Vec::new();
    for listed in build.tasks()? {
        let name = format!("tasks/{}.json", listed.id);
        let tool = build.plan.plan.tool.clone();
        let file = TaskFile { build: utf8(place)?, key: key.to_owned(), tool, task: listed.task };
        let text = crate::terminal::json_text(&file)?;
        // One that is damaged, or that names the place from which the folder was moved, is replaced.
        if written.contains(&name) && build.store().read_all(&name)?.is_some_and(|there| there != text.as_bytes()) {
            build.store().remove(&name)?;
        }
        build.store().create_new(&name, text.as_bytes())?;
        tasks.push(TaskEntryFile { file: utf8(&place.join(name))?, listed });
    }
    Ok(tasks)
}

fn print(args: &Args, report: &Report<'_>) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(report)?)?;
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
