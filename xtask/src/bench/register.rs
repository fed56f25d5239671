//! `cargo xtask bench register`: simulated surveys without poses, registered by `kilwa register` and compared with the true poses; with `--peers`, also by other programs.
//!
//! The ground truth is read by separate code (`register/judge.rs`), which also evaluates the other programs: `xtask/peers/register_peers.py` writes their results in the same format.

mod judge;

use super::{Usage, archive, run_measured, run_measured_accepting};
use crate::process::{command, compile_kilwa, root, run as run_command};
use anyhow::{Context, Result, ensure};
use judge::{Found, Truth};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Number of surveys, each with its own seed; published figures use 20
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// The seed of the first survey
    #[arg(long, value_name = "S", default_value_t = 1)]
    first: u64,
    /// Number of stations per survey
    #[arg(long, value_name = "N", default_value_t = 30)]
    stations: u32,
    /// Number of columns per scan of the dense instrument
    #[arg(long, value_name = "N", default_value_t = 800)]
    columns: u32,
    /// Trace only every Nth column and row of the scans, and interpolate between them: for large surveys
    #[arg(long, value_name = "N", default_value_t = 1)]
    trace_every: u32,
    /// Threads of `kilwa register`; all cores by default
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: u32,
    /// Also run open3d and small_gicp from perturbed true poses, and KISS-Matcher on pairs
    #[arg(long, requires = "python")]
    peers: bool,
    /// A Python interpreter with the packages of xtask/peers/requirements.txt
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// Standard deviation of the perturbation of the initial poses of other programs along each axis, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.05)]
    off: f64,
    /// Standard deviation of their rotation about each axis, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.5)]
    turned: f64,
    /// Cargo profile of the program; figures with `dev` are only for testing
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Reuse the surveys of an earlier run with the same options
    #[arg(long)]
    again: bool,
    /// Print the tables without adding them to docs/bench
    #[arg(long)]
    dry: bool,
}

/// Programs that start from perturbed true poses.
const PEERS: [&str; 2] = ["open3d", "small_gicp"];
const HEAD: &str = "| survey | program | placed | refused | wrong | median mm | worst mm | median ° | worst ° | CPU s | wall s | peak MiB |\n\
                    |---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n";

/// A survey and its truth.
struct Survey {
    seed: u64,
    folder: PathBuf,
    truth: Truth,
}

/// What one program found in all surveys.
#[derive(Default)]
struct Results(Vec<(u64, Found, Usage)>);

pub(super) fn run(args: &Args) -> Result<()> {
    let (root, kilwa) = (root()?, compile_kilwa(&args.profile)?);
    let mut own = Results::default();
    let mut peers: Vec<(&str, Results)> = PEERS.iter().map(|name| (*name, Results::default())).collect();
    let mut pairs = Pairs::default();
    for seed in args.first..args.first + args.seeds {
        let survey = survey(args, &root, &kilwa, seed)?;
        own.0.push(registered(args, &kilwa, &survey)?);
        println!("{}", own.row(own.0.len() - 1, "kilwa"));
        for (name, results) in peers.iter_mut().filter(|_| args.peers) {
            results.0.push(peer(args, &root, name, &survey)?);
            println!("{}", results.row(results.0.len() - 1, name));
        }
        if args.peers {
            pairs.add(args, &root, &survey)?;
        }
    }
    let mut text = format!(
        "{} surveys of {} stations, {} columns per scan of the dense instrument ({}), without poses; seeds {} to {}; \
         {} threads (0: all cores). Errors are relative to the anchor; wrong: more than 5 cm or 0.5°.\n\n",
        args.seeds,
        args.stations,
        args.columns,
        if args.trace_every > 1 {
            format!("one in {} columns and rows traced", args.trace_every)
        } else {
            "all traced".to_owned()
        },
        args.first,
        args.first + args.seeds - 1,
        args.threads
    );
    text.push_str(&table(&own, &peers));
    text.push_str(&own.covariances());
    text.push_str(&own.refused());
    if args.peers {
        writeln!(
            text,
            "\nOther programs start from the true poses, perturbed with standard deviations of {} m along and {}° about each axis.\n{}",
            args.off,
            args.turned,
            pairs.table()
        )?;
    }
    println!("\n{text}");
    if args.dry { Ok(()) } else { archive(&root, "register", &text, &args.profile) }
}

/// Simulates and imports a survey; its scans are removed to save space.
fn survey(args: &Args, root: &Path, kilwa: &Path, seed: u64) -> Result<Survey> {
    let folder =
        root.join(format!("target/bench/register-{}-{}-{}-{seed}", args.stations, args.columns, args.trace_every));
    let (scans, survey) = (folder.join("scans"), folder.join("survey"));
    let truth = scans.join("truth/poses.toml");
    if !(args.again && survey.join("survey.toml").is_file() && truth.is_file()) {
        drop(fs::remove_dir_all(&folder));
        fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let program = kilwa.to_string_lossy();
        let [stations, columns, every, seed] =
            [u64::from(args.stations), u64::from(args.columns), u64::from(args.trace_every), seed]
                .map(|n| n.to_string());
        let synth = ["synth", "scans", "--stations", &stations, "--columns", &columns, "--seed", &seed];
        let mut synth = command(&program, &synth)?;
        run_command(synth.args(["--trace-every", &every, "--format", "e57", "--poses", "none", "-o"]).arg(&scans))?;
        run_command(command(&program, &["scans", "import", "-o"])?.arg(&survey).arg(&scans))?;
        for entry in fs::read_dir(&scans)?.collect::<Result<Vec<_>, _>>()? {
            if entry.path().extension().is_some_and(|end| end == "e57") {
                fs::remove_file(entry.path())?;
            }
        }
    }
    let text = fs::read_to_string(&truth).with_context(|| format!("cannot read {}", truth.display()))?;
    Ok(Survey { seed, folder, truth: Truth::parse(&text)? })
}

/// The result of `kilwa register`; the survey is not changed, so that it can be reused.
fn registered(args: &Args, kilwa: &Path, survey: &Survey) -> Result<(u64, Found, Usage)> {
    let (folder, threads) = (survey.folder.join("survey").display().to_string(), args.threads.to_string());
    let mut register = vec!["register", &folder, "--dry-run", "--json"];
    if args.threads > 0 {
        register.extend(["--threads", &threads]);
    }
    let register: Vec<String> = register.into_iter().map(str::to_owned).collect();
    // Status 1: stations were refused. If anything else failed, there is no JSON.
    let used = run_measured_accepting(&[0, 1], kilwa, &register, &survey.folder.join("kilwa"))?;
    judged(survey, &survey.folder.join("kilwa.json"), used)
}

fn judged(survey: &Survey, file: &Path, used: Usage) -> Result<(u64, Found, Usage)> {
    let found =
        survey.truth.judge(&json(file)?).with_context(|| format!("{} has an unexpected format", file.display()))?;
    Ok((survey.seed, found, used))
}

fn json(file: &Path) -> Result<Value> {
    let text = fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is not valid JSON", file.display()))
}

/// Runs a program of `register_peers.py`, whose result is `NAME.out.json`.
fn script(args: &Args, root: &Path, name: &str, survey: &Survey) -> Result<(PathBuf, Usage)> {
    let out = survey.folder.join(format!("{name}.out.json"));
    let text = |path: &Path| path.display().to_string();
    let call = [
        text(&root.join("xtask/peers/register_peers.py")),
        name.to_owned(),
        text(&survey.folder.join("survey")),
        text(&survey.folder.join("scans/truth/poses.toml")),
        text(&out),
        "--sigma".to_owned(),
        args.off.to_string(),
        args.turned.to_string(),
        "--seed".to_owned(),
        survey.seed.to_string(),
    ];
    let python = args.python.as_deref().context("--peers needs --python")?;
    let used = run_measured(python, &call, &survey.folder.join(name))?;
    Ok((out, used))
}

fn peer(args: &Args, root: &Path, name: &str, survey: &Survey) -> Result<(u64, Found, Usage)> {
    let (out, used) = script(args, root, name, survey)?;
    judged(survey, &out, used)
}

/// All surveys by all programs, and the sums.
fn table(own: &Results, peers: &[(&str, Results)]) -> String {
    let mut text = HEAD.to_owned();
    for k in 0..own.0.len() {
        text.push_str(&own.row(k, "kilwa"));
        for (name, results) in peers.iter().filter(|(_, results)| k < results.0.len()) {
            text.push_str(&results.row(k, name));
        }
    }
    text.push_str(&own.sums("**kilwa**"));
    for (name, results) in peers.iter().filter(|(_, results)| !results.0.is_empty()) {
        text.push_str(&results.sums(name));
    }
    text
}

impl Results {
    fn row(&self, k: usize, program: &str) -> String {
        let (seed, found, used) = &self.0[k];
        line(&seed.to_string(), program, &[found], &[used])
    }

    /// All surveys together: medians and maxima of all stations, sums of times, the largest memory.
    fn sums(&self, program: &str) -> String {
        let found: Vec<&Found> = self.0.iter().map(|(_, found, _)| found).collect();
        let used: Vec<&Usage> = self.0.iter().map(|(_, _, used)| used).collect();
        line("all", program, &found, &used)
    }

    /// How many of the true errors lie in the 95 % regions of the covariances.
    fn covariances(&self) -> String {
        let errors: Vec<_> = self.0.iter().flat_map(|(_, found, _)| &found.errors).collect();
        let count = |part: &[usize]| {
            let judged: Vec<f64> = errors.iter().filter_map(|error| error.mahalanobis(part)).collect();
            let limit = judge::CHI_SQUARE_95[part.len() - 1];
            (judged.iter().filter(|m| **m <= limit).count(), judged.len())
        };
        let mut aligned: Vec<[f64; 2]> = self.0.iter().flat_map(|(_, found, _)| &found.aligned).copied().collect();
        let mut of = |part: usize| {
            aligned.sort_unstable_by(|a, b| a[part].total_cmp(&b[part]));
            let at = |k: usize| aligned.get(k).map_or(f64::NAN, |error| error[part]);
            [at(aligned.len() / 2), at(aligned.len().saturating_sub(1))]
        };
        let ([mm, worst_mm], [degrees, worst_degrees]) = (of(0), of(1));
        let mut text = format!(
            "\nErrors of all stations after the best rigid alignment of each survey (kilwa): median {mm:.2} mm and {degrees:.4}°, worst {worst_mm:.2} mm and {worst_degrees:.4}°.\n"
        );
        text.push_str(
            "\nTrue errors inside the 95 % region of the covariance (chi-square with the degrees of freedom of the part; kilwa):\n\n\
             | part | poses | inside | % |\n|---|---:|---:|---:|\n",
        );
        let parts: [(&str, &[usize]); 9] = [
            ("pose", &[0, 1, 2, 3, 4, 5]),
            ("rotation", &[0, 1, 2]),
            ("translation", &[3, 4, 5]),
            ("rotation about x", &[0]),
            ("rotation about y", &[1]),
            ("rotation about z", &[2]),
            ("translation along x", &[3]),
            ("translation along y", &[4]),
            ("translation along z", &[5]),
        ];
        for (name, part) in parts {
            let (inside, judged) = count(part);
            let percent = 100.0 * inside as f64 / judged.max(1) as f64;
            writeln!(text, "| {name} | {judged} | {inside} | {percent:.1} |").unwrap_or(());
        }
        text
    }

    /// Stations that were refused, with the reasons, and stations that were placed wrongly.
    fn refused(&self) -> String {
        let mut text = String::new();
        for (seed, found, _) in &self.0 {
            for error in found.errors.iter().filter(|error| error.is_wrong()) {
                writeln!(
                    text,
                    "* survey {seed}: **{} is wrong** by {:.1} mm and {:.3}°",
                    error.name,
                    error.millimetres(),
                    error.degrees()
                )
                .unwrap_or(());
            }
            for (name, reason) in &found.refused {
                writeln!(text, "* survey {seed}: {name} was refused: {reason}").unwrap_or(());
            }
        }
        if text.is_empty() { text } else { format!("\n{text}") }
    }
}

/// One row of the table; anchors count as placed, but have no errors.
fn line(survey: &str, program: &str, found: &[&Found], used: &[&Usage]) -> String {
    let errors: Vec<_> = found.iter().flat_map(|found| &found.errors).collect();
    let sorted = |value: &dyn Fn(&judge::Error) -> f64| {
        let mut all: Vec<f64> = errors.iter().map(|error| value(error)).collect();
        all.sort_unstable_by(f64::total_cmp);
        let at = |k: usize| all.get(k).copied().unwrap_or(f64::NAN);
        [at(all.len() / 2), at(all.len().saturating_sub(1))]
    };
    let ([mm, worst_mm], [degrees, worst_degrees]) =
        (sorted(&judge::Error::millimetres), sorted(&judge::Error::degrees));
    let sum = |value: &dyn Fn(&Usage) -> f64| used.iter().map(|used| value(used)).sum::<f64>();
    let peak = used.iter().map(|used| used.peak_bytes).max().unwrap_or(0);
    format!(
        "| {survey} | {program} | {} of {} | {} | {} | {mm:.2} | {worst_mm:.2} | {degrees:.4} | {worst_degrees:.4} | {:.1} | {:.1} | {:.0} |\n",
        found.iter().map(|found| found.placed).sum::<usize>(),
        found.iter().map(|found| found.stations).sum::<usize>(),
        found.iter().map(|found| found.refused.len()).sum::<usize>(),
        errors.iter().filter(|error| error.is_wrong()).count(),
        sum(&|used| used.cpu_s),
        sum(&|used| used.wall_s),
        peak as f64 / f64::from(1 << 20)
    )
}

/// Results of KISS-Matcher for pairs, by overlap.
#[derive(Default)]
struct Pairs {
    /// For each of [`SHARES`]: all pairs, accepted pairs, accepted pairs that are correct, and all correct pairs.
    counts: [[u32; 4]; SHARES.len()],
    cpu_s: f64,
}

/// Lower limits of the overlap classes.
const SHARES: [f64; 3] = [0.1, 0.2, 0.4];

impl Pairs {
    fn add(&mut self, args: &Args, root: &Path, survey: &Survey) -> Result<()> {
        let (out, used) = script(args, root, "kiss", survey)?;
        self.cpu_s += used.cpu_s;
        let found = json(&out)?;
        let pairs = found["pairs"].as_array().context("there are no pairs")?;
        for pair in pairs {
            let overlap = pair["overlap"].as_f64().context("a pair has no overlap")?;
            let (is_found, is_right) = (pair["found"] == true, pair["right"] == true);
            let Some(range) = SHARES.iter().rposition(|share| overlap >= *share) else { continue };
            let counts = &mut self.counts[range];
            counts[0] += 1;
            counts[1] += u32::from(is_found);
            counts[2] += u32::from(is_found && is_right);
            counts[3] += u32::from(is_right);
        }
        ensure!(!pairs.is_empty(), "no pair of survey {} overlaps", survey.seed);
        Ok(())
    }

    fn table(&self) -> String {
        let mut text = String::from(
            "\nPairs by KISS-Matcher, without initial poses (right: within 0.5 m and 5°; accepted: five inliers or more):\n\n\
             | overlap from | pairs | right | accepted | accepted, but wrong |\n|---|---:|---:|---:|---:|\n",
        );
        for (share, [pairs, found, both, right]) in SHARES.iter().zip(self.counts) {
            writeln!(text, "| {:.0} % | {pairs} | {right} | {found} | {} |", share * 100.0, found - both).unwrap_or(());
        }
        writeln!(text, "\n{:.1} CPU s for all pairs.", self.cpu_s).unwrap_or(());
        text
    }
}
