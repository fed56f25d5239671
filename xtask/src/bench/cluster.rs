//! `cargo xtask bench cluster`: one build as tasks with one and two workers, compared with `kilwa build`; the costs of each stage; and estimated costs of
//! larger models.
//!
//! A worker is a thread that starts one `kilwa task` with one thread at a time, wave by wave. So it measures the division itself; the
//! overhead of Dask and Slurm is in docs/cluster.md.

mod costs;

use super::place::Place;
use super::{Usage, archive, run_measured};
use crate::process::{command, compile_kilwa, output, root, run as run_command};
use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Triangles of the mesh
    #[arg(long, value_name = "N", default_value_t = 10_000_000, value_parser = clap::value_parser!(u64).range(10_000..))]
    triangles: u64,
    /// Triangles per task
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    task_triangles: u64,
    /// Rounds; the table shows the median
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// Cargo profile of the program; figures of `dev` are for trying out only
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Print the tables without adding them to docs/bench
    #[arg(long)]
    dry: bool,
}

/// A finished program, and what kilwa itself measured of it.
struct Done {
    stage: String,
    /// Estimated by `kilwa plan`; 0 for tasks that are not divided.
    triangles: f64,
    used: Usage,
    /// Wall time that kilwa measures itself; the rest is the fixed cost of a task.
    seconds: f64,
    read: f64,
    written: f64,
}

/// The sums over the tasks of a stage.
#[derive(Default, Clone)]
struct Stage {
    tasks: u32,
    triangles: f64,
    wall_s: f64,
    cpu_s: f64,
    fixed_s: f64,
    peak_bytes: u64,
    read: f64,
    written: f64,
}

/// A build, on one machine or as tasks.
struct Built {
    wall_s: f64,
    cpu_s: f64,
    stages: BTreeMap<String, Stage>,
    left: costs::Left,
}

/// Run kilwa and measure it; what it printed is in `NAME.json`.
fn measured(place: &Place, name: &str, args: &[&str]) -> Result<(Usage, Value)> {
    let args: Vec<String> = args.iter().map(|&arg| arg.to_owned()).collect();
    let used = run_measured(&place.kilwa, &args, &place.at(name))?;
    let printed = fs::read_to_string(place.at(name).with_extension("json"))?;
    Ok((used, serde_json::from_str(&printed).with_context(|| format!("kilwa {} printed no JSON", args.join(" ")))?))
}

pub(super) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    let place = Place { folder: root.join("target/bench/cluster"), kilwa: compile_kilwa(&args.profile)? };
    drop(fs::remove_dir_all(&place.folder));
    fs::create_dir_all(&place.folder).with_context(|| format!("cannot create {}", place.folder.display()))?;
    let program = place.kilwa.to_string_lossy().into_owned();
    let made = ["synth", "wall", "--triangles", &args.triangles.to_string(), "-o", &place.text("wall.ply")];
    run_command(&mut command(&program, &made)?)?;
    let mut rounds = Vec::new();
    for _ in 0..args.rounds {
        // Alternating, so that other load on the machine affects all three.
        let plain = plain(&place)?;
        let one = divided(args, &place, 1)?;
        let two = divided(args, &place, 2)?;
        rounds.push([plain, one, two]);
    }
    let sha256 = sha256(&place, "plain.kilwa")?;
    let triangles = super::ply_faces(&place.at("wall.ply"))?;
    let table = tables(args, triangles, &sha256, &rounds)?;
    drop(fs::remove_dir_all(&place.folder));
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "cluster", &table, &args.profile) }
}

/// `kilwa build` with one thread.
fn plain(place: &Place) -> Result<Built> {
    let (mesh, pack) = (place.text("wall.ply"), place.text("plain.kilwa"));
    let (used, _) = measured(place, "plain", &["build", &mesh, "-o", &pack, "--force", "--threads", "1", "--json"])?;
    Ok(Built { wall_s: used.wall_s, cpu_s: used.cpu_s, stages: BTreeMap::new(), left: costs::Left::default() })
}

/// The same pack as tasks, with `workers` workers.
fn divided(args: &Args, place: &Place, workers: usize) -> Result<Built> {
    let (work, pack) = (place.text("work"), place.text("divided.kilwa"));
    drop(fs::remove_dir_all(&work));
    fs::create_dir_all(&work)?;
    let started = Instant::now();
    let mut done = Vec::new();
    let build = loop {
        let plan = plan(args, place, &work)?;
        let build = text(&plan, "build")?;
        if plan["complete"] == Value::Bool(true) {
            break build;
        }
        done.extend(wave(place, &plan, workers)?);
    };
    let mut left = left_in(&Path::new(&build).join("files"))?;
    let (used, printed) =
        measured(place, "assemble", &["assemble", &build, "-o", &pack, "--force", "--threads", "1", "--json"])?;
    let seconds = used.wall_s;
    let written = fs::metadata(&pack)?.len() as f64;
    done.push(Done { stage: "assemble".into(), triangles: 0.0, used, seconds, read: f64::NAN, written });
    let wall_s = started.elapsed().as_secs_f64();
    ensure!(
        same(Path::new(&pack), &place.at("plain.kilwa"))?,
        "the pack of {workers} workers differs from that of `kilwa build`"
    );
    left.chunks = number(&printed["pack"], "chunks")?;
    let cpu_s = done.iter().map(|d| d.used.cpu_s).sum();
    Ok(Built { wall_s, cpu_s, stages: stages(done), left })
}

/// The number of files that the tasks of a build exchanged, and the number of tetrahedra in the tree.
fn left_in(folder: &Path) -> Result<costs::Left> {
    let mut left = costs::Left::default();
    for file in fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        let file = file?;
        left.files += 1.0;
        // One byte for each tetrahedron.
        if file.path().extension().is_some_and(|extension| extension == "levels") {
            left.tetrahedra += file.metadata()?.len() as f64;
        }
    }
    Ok(left)
}

fn plan(args: &Args, place: &Place, work: &str) -> Result<Value> {
    let (mesh, portion) = (place.text("wall.ply"), args.task_triangles.to_string());
    let listed = ["plan", &mesh, "--work", work, "--task-triangles", &portion, "--json"];
    let printed = output(&mut command(&place.kilwa.to_string_lossy(), &listed)?)?;
    serde_json::from_str(&printed).context("kilwa plan printed no JSON")
}

/// The open tasks of the first wave, the largest first, each to the first worker that is free.
fn wave(place: &Place, plan: &Value, workers: usize) -> Result<Vec<Done>> {
    let tasks = plan["tasks"].as_array().context("kilwa plan lists no tasks")?;
    let open: Vec<&Value> = tasks.iter().filter(|task| task["done"] == Value::Bool(false)).collect();
    let first = open.iter().filter_map(|task| task["wave"].as_u64()).min();
    let mut open: Vec<&Value> = open.into_iter().filter(|task| task["wave"].as_u64() == first).collect();
    open.sort_by_key(|task| task["triangles"].as_u64());
    let (open, done) = (Mutex::new(open), Mutex::new(Vec::new()));
    let take = || open.lock().ok().and_then(|mut open| open.pop());
    let work = || -> Result<()> {
        while let Some(task) = take() {
            let one = one(place, task)?;
            if let Ok(mut done) = done.lock() {
                done.push(one);
            }
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let running: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        running.into_iter().try_for_each(|worker| match worker.join() {
            Ok(ended) => ended,
            Err(_) => bail!("a worker panicked"),
        })
    })?;
    done.into_inner().ok().context("a worker panicked")
}

/// One task.
fn one(place: &Place, task: &Value) -> Result<Done> {
    let (id, file) = (text(task, "id")?, text(task, "file")?);
    let (used, printed) = measured(place, &format!("task-{id}"), &["task", &file, "--threads", "1", "--json"])?;
    let manifest = &printed["manifest"];
    Ok(Done {
        stage: stage_of(&id).to_owned(),
        triangles: task["triangles"].as_f64().unwrap_or_default(),
        used,
        seconds: number(manifest, "seconds")?,
        read: number(manifest, "bytes_read")?,
        written: number(manifest, "bytes_written")?,
    })
}

/// The name of a task without its number; all levels are one stage.
fn stage_of(id: &str) -> &str {
    if id.starts_with("level-") { "levels" } else { id.rsplit_once('-').map_or(id, |(stage, _)| stage) }
}

fn stages(done: Vec<Done>) -> BTreeMap<String, Stage> {
    let mut stages = BTreeMap::<String, Stage>::new();
    for d in done {
        let stage = stages.entry(d.stage).or_default();
        stage.tasks += 1;
        stage.triangles += d.triangles;
        stage.wall_s += d.used.wall_s;
        stage.cpu_s += d.used.cpu_s;
        stage.fixed_s += d.used.wall_s - d.seconds;
        stage.peak_bytes = stage.peak_bytes.max(d.used.peak_bytes);
        stage.read += d.read;
        stage.written += d.written;
    }
    stages
}

fn tables(args: &Args, triangles: u64, sha256: &str, rounds: &[[Built; 3]]) -> Result<String> {
    let mut table = format!(
        "A wall of {triangles} triangles, `--task-triangles {}`, one thread for each program. All packs have the SHA-256 {sha256}.\n\n\
         | round | `build`: s | CPU s | one worker: s | CPU s | two workers: s | CPU s | speedup of two workers | one worker / `build` |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        args.task_triangles
    );
    let row = |of: &dyn Fn(usize) -> Result<(f64, f64)>| -> Result<[f64; 8]> {
        let [(plain, plain_cpu), (one, one_cpu), (two, two_cpu)] = [of(0)?, of(1)?, of(2)?];
        Ok([plain, plain_cpu, one, one_cpu, two, two_cpu, one / two, one / plain])
    };
    let mut rows = Vec::new();
    for (round, built) in (1..).zip(rounds) {
        let figures = row(&|way| Ok((built[way].wall_s, built[way].cpu_s)))?;
        rows.push((round.to_string(), figures));
    }
    let medians: [f64; 8] = std::array::from_fn(|column| median(rows.iter().map(|(_, figures)| figures[column])));
    rows.push(("median".to_owned(), medians));
    for (name, f) in rows {
        writeln!(
            table,
            "| {name} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.2} | {:.2} |",
            f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7]
        )?;
    }
    table.push_str(
        "\nThe stages with one worker: medians of the sums over their tasks. The fixed cost of a task is its wall time minus the time that kilwa measures itself. The memory is the peak of the largest task.\n\n\
         | stage | tasks | s | CPU s | fixed cost of a task, ms | peak MiB | read, bytes / triangle | written, bytes / triangle |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    let stages = medians_of(rounds)?;
    let n = triangles as f64;
    for (name, s) in &stages {
        let fixed =
            if name == "assemble" { "-".into() } else { format!("{:.0}", s.fixed_s / f64::from(s.tasks) * 1e3) };
        let read = if s.read.is_nan() { "-".into() } else { format!("{:.1}", s.read / n) };
        let mib = s.peak_bytes as f64 / f64::from(1 << 20);
        let written = s.written / n;
        writeln!(
            table,
            "| {name} | {} | {:.1} | {:.1} | {fixed} | {mib:.0} | {read} | {written:.1} |",
            s.tasks, s.wall_s, s.cpu_s
        )?;
    }
    let first = rounds.first().context("no round")?;
    let measured = costs::Measured::of(n, &stages, &first[1].left)?;
    table.push_str(&costs::table(&measured)?);
    Ok(table)
}

/// The stages of one worker, in the order in which they run.
fn medians_of(rounds: &[[Built; 3]]) -> Result<Vec<(String, Stage)>> {
    let names = ["ingest", "region", "tree", "leaves", "levels", "tail", "assemble"];
    let known = &rounds.first().context("no round")?[1].stages;
    if let Some(other) = known.keys().find(|name| !names.contains(&name.as_str())) {
        bail!("this program does not know the stage {other} of a build");
    }
    let ordered = names.into_iter().filter(|&name| known.contains_key(name));
    let of = |name: &str| {
        let all: Vec<&Stage> = rounds.iter().filter_map(|round| round[1].stages.get(name)).collect();
        let mid = |field: &dyn Fn(&Stage) -> f64| median(all.iter().map(|stage| field(stage)));
        let [first, ..] = all[..] else { return Stage::default() };
        Stage {
            wall_s: mid(&|s| s.wall_s),
            cpu_s: mid(&|s| s.cpu_s),
            fixed_s: mid(&|s| s.fixed_s),
            peak_bytes: all.iter().map(|s| s.peak_bytes).max().unwrap_or_default(),
            ..first.clone()
        }
    };
    Ok(ordered.map(|name| (name.to_owned(), of(name))).collect())
}

/// The middle one, or the mean of the two in the middle.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    if n == 0 { f64::NAN } else { f64::midpoint(sorted[(n - 1) / 2], sorted[n / 2]) }
}

fn same(a: &Path, b: &Path) -> Result<bool> {
    Ok(fs::metadata(a)?.len() == fs::metadata(b)?.len() && fs::read(a)? == fs::read(b)?)
}

fn sha256(place: &Place, pack: &str) -> Result<String> {
    let printed = output(&mut command(&place.kilwa.to_string_lossy(), &["verify", &place.text(pack), "--json"])?)?;
    text(&serde_json::from_str(&printed).context("kilwa verify printed no JSON")?, "sha256")
}

fn text(value: &Value, key: &str) -> Result<String> {
    Ok(value[key].as_str().with_context(|| format!("kilwa printed no {key}"))?.to_owned())
}

fn number(value: &Value, key: &str) -> Result<f64> {
    value[key].as_f64().with_context(|| format!("kilwa printed no {key}"))
}

#[cfg(test)]
mod tests {
    use super::{median, stage_of};

    #[test]
    fn a_stage_is_the_name_without_the_number() {
        let ids = ["ingest", "region-0000", "tree", "leaves-0003", "level-09-0001", "level-10-0000", "tail"];
        assert_eq!(ids.map(stage_of), ["ingest", "region", "tree", "leaves", "levels", "levels", "tail"]);
    }

    #[test]
    fn a_median_is_in_the_middle() {
        assert!((median([3.0, 1.0, 2.0].into_iter()) - 2.0).abs() < 1e-12);
        assert!((median([4.0, 1.0].into_iter()) - 2.5).abs() < 1e-12);
        assert!(median(std::iter::empty()).is_nan());
    }
}
