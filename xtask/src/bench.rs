//! `cargo xtask bench`: figures, never a gate.
//!
//! `bench codec` measures the chunk codec by part and level on packs of synthetic meshes, natively and in a worker of Chromium. `bench view` measures streaming and drawing (view.rs). `bench kernels` runs criterion on the crates that have benches. `bench build` makes synthetic meshes, builds their packs with
//! the release program and prints a table: time, triangles per CPU second, peak memory per input triangle, pack size. The
//! table is added to `docs/bench/DATE-build.md` with the machine it ran on, so that figures are never compared across machines unseen.

mod cluster;
mod codec;
mod colour;
mod gpu;
mod masks;
mod merge;
mod place;
mod points;
mod register;
mod scans;
mod stations;
mod view;

use crate::process::{cargo, command, compile_kilwa, on_path, output, root, run as run_command};
use anyhow::{Context, Result, bail};
use chrono::Timelike as _;
use std::fmt::Write as _;
use std::fs::{self, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Measure the kernels and the building of packs.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Criterion's benches of the core crates
    Kernels,
    /// Building packs of synthetic meshes: time, memory, size
    Build(Build),
    /// How far coarse forms are from the finest one: distances and colours
    Quality(Quality),
    /// Bytes by part and level, speed and vertex-cache use of the chunk codec, beside meshoptimizer's
    Codec(codec::Args),
    /// One build as tasks with one and two workers, compared with `kilwa build`; estimated costs of larger models
    Cluster(cluster::Args),
    /// Streaming and drawing: a recorded flight natively, the page in Chromium on three links
    View(view::Args),
    /// Frame times and GPU pass times: makes an archive for other machines, and measures this one
    Gpu(gpu::Args),
    /// Importing scans: points per CPU second, memory
    Scans(scans::Args),
    /// Building packs of points: CPU time, memory, size
    Points(points::Args),
    /// Masks of simulated scans against the truth: what they find, what they lose
    Masks(masks::Args),
    /// Colours from simulated photographs against the ground truth
    Colour(colour::Args),
    /// Meshes of simulated stations against the true surface: what is false, what is missing
    Stations(stations::Args),
    /// Merging simulated stations: time, memory, and how far the surface is from the true one, beside another program
    Merge(merge::Args),
    /// Registration of simulated surveys without poses: completeness, errors, realism of the covariances, and a comparison with other programs
    Register(register::Args),
    /// Run a program and write what it used to a file (used by `build`, in a process of its own)
    #[command(hide = true)]
    Measured { report: PathBuf, program: PathBuf, args: Vec<String> },
}

#[derive(clap::Args)]
struct Build {
    /// Triangles of each mesh
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    triangles: u64,
    /// Meshes to build
    #[arg(long, value_name = "NAME", default_values_t = ["wall".to_owned(), "fort".to_owned()])]
    mesh: Vec<String>,
    /// Threads of the builder; its own choice by default
    #[arg(long, value_name = "N")]
    threads: Option<u32>,
    /// Cargo profile of the program; figures of `dev` are for trying out only
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

#[derive(clap::Args)]
struct Quality {
    /// Triangles of each mesh
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    triangles: u64,
    /// Meshes to build
    #[arg(long, value_name = "NAME", default_values_t = ["wall".to_owned(), "fort".to_owned()])]
    mesh: Vec<String>,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

/// Crates with criterion benches.
const BENCHED: [&str; 1] = ["kilwa-pack"];

pub(crate) fn run(args: &Args) -> Result<()> {
    match &args.what {
        What::Kernels => kernels(),
        What::Build(build) => bench_build(build),
        What::Quality(quality) => bench_quality(quality),
        What::Codec(codec) => codec::run(codec),
        What::Cluster(cluster) => cluster::run(cluster),
        What::View(view) => view::run(view),
        What::Gpu(gpu) => gpu::run(gpu),
        What::Scans(scans) => scans::run(scans),
        What::Points(points) => points::run(points),
        What::Masks(masks) => masks::run(masks),
        What::Colour(colour) => colour::run(colour),
        What::Stations(stations) => stations::run(stations),
        What::Merge(merge) => merge::run(merge),
        What::Register(register) => register::run(register),
        What::Measured { report, program, args } => measured(report, program, args),
    }
}

fn kernels() -> Result<()> {
    let mut bench = cargo(&["bench", "--locked", "--benches"])?;
    for package in BENCHED {
        bench.args(["--package", package]);
    }
    run_command(&mut bench)
}

/// What one run of a program used.
struct Usage {
    wall_s: f64,
    cpu_s: f64,
    /// Largest resident set, bytes; counts mapped pages too.
    peak_bytes: u64,
    /// The exit status.
    status: i32,
}

fn bench_build(args: &Build) -> Result<()> {
    let kilwa = compile_kilwa(&args.profile)?;
    let root = root()?;
    let scratch = root.join("target/bench");
    let mut table = String::from(
        "| mesh | triangles | input MiB | wall s | CPU s | triangles / CPU s | triangles / wall s | peak MiB | peak bytes / triangle | scratch bytes / triangle | pack bytes / triangle |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for mesh in &args.mesh {
        let row = bench_mesh(args, mesh, &kilwa, &scratch)?;
        table.push_str(&row);
    }
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "build", &table, &args.profile) }
}

/// One row: makes the mesh, builds its pack, measures the build alone.
fn bench_mesh(args: &Build, mesh: &str, kilwa: &Path, scratch: &Path) -> Result<String> {
    if scratch.exists() {
        fs::remove_dir_all(scratch).with_context(|| format!("cannot empty {}", scratch.display()))?;
    }
    fs::create_dir_all(scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let (input, pack) = (scratch.join(format!("{mesh}.ply")), scratch.join(format!("{mesh}.kilwa")));
    let count = args.triangles.to_string();
    let program = kilwa.to_string_lossy().into_owned();
    run_command(command(&program, &["synth", mesh, "--triangles", &count, "-o"])?.arg(&input))?;
    let triangles = ply_faces(&input)?;
    let mut build =
        vec!["build".to_owned(), input.display().to_string(), "-o".into(), pack.display().to_string(), "--json".into()];
    if let Some(threads) = args.threads {
        build.extend(["--threads".into(), threads.to_string()]);
    }
    let usage = run_measured(kilwa, &build, &scratch.join("usage"))?;
    let report = fs::read_to_string(scratch.join("usage.json")).unwrap_or_default();
    let on_disk = number_of(&report, "\"scratch_peak_bytes\"");
    let (input_bytes, pack_bytes) = (fs::metadata(&input)?.len(), fs::metadata(&pack)?.len());
    let n = triangles as f64;
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    Ok(format!(
        "| {mesh} | {triangles} | {:.1} | {:.2} | {:.2} | {:.0} | {:.0} | {:.0} | {:.0} | {} | {:.2} |\n",
        mib(input_bytes),
        usage.wall_s,
        usage.cpu_s,
        n / usage.cpu_s,
        n / usage.wall_s,
        mib(usage.peak_bytes),
        usage.peak_bytes as f64 / n,
        on_disk.map_or_else(|| "?".to_owned(), |b| format!("{:.0}", b / n)),
        pack_bytes as f64 / n
    ))
}

fn bench_quality(args: &Quality) -> Result<()> {
    let kilwa = compile_kilwa("release")?;
    run_command(
        cargo(&["build", "--release", "--locked", "--package", "kilwa-builder", "--example", "deviation"])?.arg("-q"),
    )?;
    let root = root()?;
    let (scratch, deviation) = (root.join("target/bench"), root.join("target/release/examples/deviation"));
    fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let program = kilwa.to_string_lossy().into_owned();
    let mut table = String::from(
        "| mesh | asked | triangles | certified mm | rms mm | largest mm, fine to coarse | largest mm, coarse to fine | colour rms of 255 |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for mesh in &args.mesh {
        let file = |name: &str| scratch.join(format!("{mesh}-{name}")).display().to_string();
        let (input, pack, fine, coarse) = (file("in.ply"), file("q.kilwa"), file("fine.ply"), file("coarse.ply"));
        run_command(&mut command(
            &program,
            &["synth", mesh, "--triangles", &args.triangles.to_string(), "--force", "-o", &input],
        )?)?;
        run_command(&mut command(&program, &["build", &input, "--force", "-o", &pack])?)?;
        run_command(&mut command(&program, &["extract", &pack, "--force", "-o", &fine])?)?;
        let all = ply_faces(Path::new(&fine))?;
        for half in 1..=4 {
            let limit = (all >> half).to_string();
            let extract = ["extract", &pack, "--max-triangles", &limit, "--force", "--json", "-o", &coarse];
            let report = output(&mut command(&program, &extract)?)?;
            let certified = number_of(&report, "\"max_error\"");
            let line = output(command(&deviation.to_string_lossy(), &[])?.args([&fine, &coarse]))?;
            let figures: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
            let [triangles, rms, back, out, color] = figures[..] else { bail!("deviation printed {line:?}") };
            writeln!(
                table,
                "| {mesh} | 1/{} | {triangles} | {} | {:.3} | {:.2} | {:.2} | {color:.2} |",
                1 << half,
                certified.map_or_else(|| "?".to_owned(), |c| format!("{:.2}", c * 1e3)),
                rms * 1e3,
                back * 1e3,
                out * 1e3
            )?;
        }
    }
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "quality", &table, "release") }
}

/// The number after a key of a JSON text.
fn number_of(json: &str, key: &str) -> Option<f64> {
    let rest = json.split_once(key)?.1.trim_start().strip_prefix(':')?.trim_start();
    rest.split(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c))).next()?.parse().ok()
}

/// The number of faces that a PLY's header promises: what was really put in, as synth rounds.
fn ply_faces(file: &Path) -> Result<u64> {
    let mut head = vec![0; 4096];
    let length = fs::File::open(file)
        .and_then(|mut f| f.read(&mut head))
        .with_context(|| format!("cannot read {}", file.display()))?;
    let head = String::from_utf8_lossy(&head[..length]).into_owned();
    let faces = head.lines().find_map(|line| line.strip_prefix("element face ")).and_then(|n| n.trim().parse().ok());
    faces.filter(|n| *n > 0).with_context(|| format!("{} has no faces in its header", file.display()))
}

/// Runs the program below a process of its own, because the system keeps the peak memory over *all* children of a process.
fn run_measured(program: &Path, args: &[String], report: &Path) -> Result<Usage> {
    run_measured_accepting(&[0], program, args, report)
}

/// The same for a program whose exit status carries information.
fn run_measured_accepting(statuses: &[i32], program: &Path, args: &[String], report: &Path) -> Result<Usage> {
    let me = std::env::current_exe().context("cannot find this program")?;
    let mut wrapper = Command::new(me);
    wrapper.args(["bench", "measured"]).arg(report).arg(program).arg("--").args(args);
    run_command(&mut wrapper)?;
    let usage = usage(report)?;
    if !statuses.contains(&usage.status) {
        bail!("{} failed (exit status {})", program.display(), usage.status);
    }
    Ok(usage)
}

fn usage(report: &Path) -> Result<Usage> {
    let text = fs::read_to_string(report).with_context(|| format!("cannot read {}", report.display()))?;
    let mut words = text.split_whitespace();
    let mut next = || words.next().with_context(|| format!("{} is cut short: {text:?}", report.display()));
    Ok(Usage {
        wall_s: next()?.parse()?,
        cpu_s: next()?.parse()?,
        peak_bytes: next()?.parse()?,
        status: next()?.parse()?,
    })
}

#[cfg(unix)]
fn measured(report: &Path, program: &Path, args: &[String]) -> Result<()> {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeValLike;
    let started = Instant::now();
    let status = Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stdout(fs::File::create(report.with_extension("json"))?)
        .status()
        .with_context(|| format!("cannot start {}", program.display()))?;
    let wall_s = started.elapsed().as_secs_f64();
    let code = status.code().with_context(|| format!("{} failed ({status})", program.display()))?;
    let used = getrusage(UsageWho::RUSAGE_CHILDREN)?;
    let cpu_s = (used.user_time() + used.system_time()).num_microseconds() as f64 / 1e6;
    // Kilobytes on Linux, bytes on macOS.
    let unit = if cfg!(target_os = "macos") { 1 } else { 1024 };
    let peak_bytes = u64::try_from(used.max_rss())? * unit;
    fs::write(report, format!("{wall_s} {cpu_s} {peak_bytes} {code}\n"))
        .with_context(|| format!("cannot write {}", report.display()))
}

#[cfg(not(unix))]
fn measured(_report: &Path, _program: &Path, _args: &[String]) -> Result<()> {
    bail!(
        "CPU time and peak memory of a child are read with getrusage, which this system does not have; run this on Linux or macOS"
    )
}

/// Adds the table to today's file, with the commit and the machine. `what` is a bench, or `soak`, which is a test.
pub(crate) fn archive(root: &Path, what: &str, table: &str, profile: &str) -> Result<()> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).context("the clock stands before 1970")?.as_secs();
    let now = i64::try_from(now).ok().and_then(|now| chrono::DateTime::from_timestamp(now, 0));
    let now = now.context("the clock stands beyond every calendar")?;
    let day = now.date_naive();
    let folder = root.join("docs/bench");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let file = folder.join(format!("{day}-{what}.md"));
    let mut text = String::new();
    if !file.exists() {
        let task = if what == "soak" { "test" } else { "bench" };
        writeln!(text, "# {task} {what}, {day}\n\nWritten by `cargo xtask {task} {what}`.")?;
    }
    let commit =
        output(&mut command("git", &["describe", "--always", "--dirty"])?).unwrap_or_else(|_| "unknown".into());
    let compiler = output(&mut command("rustc", &["--version"])?)?;
    writeln!(
        text,
        "\n## {:02}:{:02} UTC, commit {commit}\n\n{}; {compiler}, profile {profile}.\n",
        now.hour(),
        now.minute(),
        machine()
    )?;
    text.push_str(table);
    let mut archive = OpenOptions::new()
        .create(true)
        .append(true)
        .open(&file)
        .with_context(|| format!("cannot open {}", file.display()))?;
    archive.write_all(text.as_bytes()).with_context(|| format!("cannot write {}", file.display()))?;
    println!("added to {}", file.display());
    Ok(())
}

/// Processor, number of threads, memory and system, as far as they can be read.
fn machine() -> String {
    let field = |file: &str, name: &str| {
        let text = fs::read_to_string(file).unwrap_or_default();
        text.lines().find_map(|line| line.strip_prefix(name)?.split_once(':').map(|(_, value)| value.trim().to_owned()))
    };
    let processor = field("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.into());
    let threads = std::thread::available_parallelism().map_or(0, std::num::NonZero::get);
    let memory = field("/proc/meminfo", "MemTotal").unwrap_or_else(|| "unknown".into());
    let system = on_path(&["uname"])
        .and_then(|_| output(&mut command("uname", &["-sr"]).ok()?).ok())
        .unwrap_or_else(|| std::env::consts::OS.into());
    format!("{processor}, {threads} threads available, memory {memory}, {system}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_found_only_by_its_key() {
        let json = "{\"a\": 1.5e-3, \"b\" : -2, \"c\": \"x\"}";
        assert_eq!(number_of(json, "\"a\""), Some(0.0015));
        assert_eq!(number_of(json, "\"b\""), Some(-2.0));
        assert_eq!((number_of(json, "\"c\""), number_of(json, "\"d\"")), (None, None));
    }

    #[cfg(unix)]
    #[test]
    fn a_measured_run_reports_its_own_use_and_exit_status_and_a_killed_one_is_an_error() {
        let report = std::env::temp_dir().join(format!("kilwa-usage-{}", std::process::id()));
        measured(&report, Path::new("sh"), &["-c".into(), "exit 0".into()]).unwrap();
        let used = usage(&report).unwrap();
        assert!(used.peak_bytes > 0, "peak memory of a shell is not zero");
        assert_eq!(used.status, 0);
        measured(&report, Path::new("sh"), &["-c".into(), "exit 3".into()]).unwrap();
        assert_eq!(usage(&report).unwrap().status, 3);
        measured(&report, Path::new("sh"), &["-c".into(), "kill -9 $$".into()]).unwrap_err();
        fs::remove_file(&report).unwrap();
        fs::remove_file(report.with_extension("json")).unwrap();
    }
}
