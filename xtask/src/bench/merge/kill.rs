//! `cargo xtask bench merge --kill N`: kills a merge into a pack at random moments, resumes it each time, and checks that the pack is identical to that of an uninterrupted merge.

use super::{Args, Place, simulate};
use crate::bench::archive;
use crate::process::{command, compile_kilwa, root};
use anyhow::{Context, Result, ensure};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Stages that a kill can interrupt, distinguished by the scratch files that exist at that moment.
const STAGES: [&str; 3] = ["merging", "reading the merged surface", "simplifying levels and assembling"];

/// A linear congruential generator (Knuth, MMIX): the moments can be repeated from the seed.
struct Random(u64);

impl Random {
    /// From 0 to 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

pub(super) fn run(args: &Args, kills: u32) -> Result<()> {
    let root = root()?;
    let folder = root.join(format!("target/bench/merge-kill-{}-{}-{}", args.stations, args.columns, args.seed));
    let place = Place { folder, kilwa: compile_kilwa(&args.profile)? };
    if !(args.again && place.at("survey").is_dir()) {
        simulate(args, &place)?;
    }
    let out = place.at("out");
    drop(fs::remove_dir_all(&out));
    fs::create_dir_all(&out).with_context(|| format!("cannot create {}", out.display()))?;
    let (first, pack) = (out.join("first.kilwa"), out.join("killed.kilwa"));
    let begun = Instant::now();
    let done = merge(args, &place, &first)?.status()?;
    ensure!(done.success(), "the uninterrupted merge failed");
    let took = begun.elapsed();
    let wanted = fs::read(&first)?;
    let mut random = Random(args.seed);
    let (mut done, mut finished) = (0, 0);
    let mut by_stage = [0_u32; STAGES.len()];
    while done < kills {
        let mut child = merge(args, &place, &pack)?.stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
        // The random moment is the point of this benchmark, so it does not wait for a particular state.
        std::thread::sleep(took.mul_f64(random.next()));
        if let Some(status) = child.try_wait()? {
            ensure!(status.success(), "a resumed merge failed after {done} kills");
            check(&out, &pack, &wanted)?;
            fs::remove_file(&pack)?;
            finished += 1;
            continue;
        }
        child.kill()?;
        child.wait()?;
        done += 1;
        by_stage[stage(&out)] += 1;
        if pack.exists() {
            // It was killed after it had renamed the pack.
            ensure!(fs::read(&pack)? == wanted, "kill {done}: an incomplete pack has the final name");
            fs::remove_file(&pack)?;
        }
    }
    let status = merge(args, &place, &pack)?.status()?;
    ensure!(status.success(), "the last merge failed");
    check(&out, &pack, &wanted)?;
    let table = table(args, kills, finished, took, &by_stage, &wanted);
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "merge-kill", &table, &args.profile) }
}

fn merge(args: &Args, place: &Place, pack: &Path) -> Result<Command> {
    let (voxel, threads) = (args.voxel.to_string(), args.threads.to_string());
    let program = place.kilwa.to_string_lossy().into_owned();
    let mut merge = command(&program, &["merge", "--voxel", &voxel, "--threads", &threads, "--resume", "-o"])?;
    merge.arg(pack).arg(place.at("survey")).stdin(Stdio::null());
    Ok(merge)
}

/// Fail unless the pack has the wanted bytes, and nothing else is left in the folder.
fn check(out: &Path, pack: &Path, wanted: &[u8]) -> Result<()> {
    ensure!(fs::read(pack)? == wanted, "{} differs from the uninterrupted pack", pack.display());
    let mut names: Vec<_> = fs::read_dir(out)?.map(|entry| Ok(entry?.file_name())).collect::<Result<_>>()?;
    names.sort();
    ensure!(names == ["first.kilwa", "killed.kilwa"], "files are left over: {names:?}");
    Ok(())
}

/// The stage that a killed merge was in, as an index of [`STAGES`].
fn stage(out: &Path) -> usize {
    let names = |folder: &Path| -> Vec<String> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
    };
    let scratch = names(&out.join(".killed.kilwa.scratch"));
    if scratch.iter().any(|name| name.starts_with("level-")) {
        2
    } else {
        usize::from(scratch.iter().any(|name| name.starts_with("leaves")))
    }
}

fn table(args: &Args, kills: u32, finished: u32, took: Duration, by_stage: &[u32], bytes: &[u8]) -> String {
    let mut text = format!(
        "{kills} kills (SIGKILL) of `kilwa merge --resume` into a pack, at random moments during the {:.1} s that an uninterrupted merge takes (seed {}); {} stations of {} columns, voxel {} m, {} threads. {finished} merges finished before they could be killed, and the last one after all kills. Every pack was identical to that of the uninterrupted merge ({} bytes, BLAKE3 {}), and no other file was left behind.\n\n| killed while | kills |\n|---|---:|\n",
        took.as_secs_f64(),
        args.seed,
        args.stations,
        args.columns,
        args.voxel,
        args.threads,
        bytes.len(),
        blake3::hash(bytes).to_hex(),
    );
    for (name, count) in STAGES.iter().zip(by_stage) {
        writeln!(text, "| {name} | {count} |").unwrap_or(());
    }
    text
}
