//! `cargo xtask demo`: from sources to a fort in the browser. Builds the page and the program, makes a synthetic fort, builds
//! and verifies its pack, publishes it as an archive object, serves that on this machine and prints the address. With `--scans`, a simulator
//! scans the fort first, and its pack is merged from the scans; with `--survey`, the fort is also photographed, the scans are registered first, and the pack gets
//! the colours of the photographs.
//!
//! Output: the folder `demo/` (ignored by git), with the objects in `demo/site`. What an earlier run made is kept while program and size are
//! the same. `--check` fetches the page and the head of the pack once over HTTP, then ends; CI uses it with a small fort.

mod survey;

use crate::process::{command, compile_kilwa, root, run as run_command};
use crate::{http, web};
use anyhow::{Context, Result, bail};
use std::fs;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};
use survey::Survey;

/// Make a fort, build its pack and show it in the browser.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Triangles of the fort
    #[arg(long, value_name = "N", default_value_t = 2_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    triangles: u64,
    /// Scan the fort from stations, mask what is not of the site, and merge the scans, instead of starting from a mesh
    #[arg(long, conflicts_with = "triangles")]
    scans: bool,
    /// Like --scans, but register scans with rough poses, and colour the surface from photographs
    #[arg(long, conflicts_with_all = ["triangles", "scans"])]
    survey: bool,
    /// Stations of --scans and --survey
    #[arg(long, value_name = "N", default_value_t = 12)]
    stations: u32,
    /// Cargo profile of the program; `dev` compiles faster and builds packs slower
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// First port to try
    #[arg(long, value_name = "PORT", default_value_t = 8080)]
    port: u16,
    /// Fetch the page and the head of the pack once, then end
    #[arg(long)]
    check: bool,
}

/// How long the server may take until it answers.
const START_WITHIN: Duration = Duration::from_secs(30);
/// How many ports after the first are tried.
const PORTS: u16 = 20;
/// First request of a viewer (FORMAT section 2: header, directory page 0 and the coarsest chunks lie in it).
const HEAD_BYTES: u64 = 128 << 10;
/// Metadata of the fort.
const METADATA: &str = include_str!("demo.toml");
/// What is added to it about photographs.
const PHOTOGRAPHS: &str = "\n[photographs]\nrights = \"CC0\"\ncredit = \"Simulated by kilwa synth photos\"\n";
/// Columns of a scan: a good half of a million samples.
const COLUMNS: u32 = 1200;

/// What the pack is made of.
#[derive(Clone, Copy)]
enum From {
    /// A mesh of so many triangles.
    Mesh { triangles: u64 },
    /// Scans that are merged.
    Scans { stations: u32, columns: u32 },
    /// Scans that are registered, merged and coloured from photographs.
    Survey(Survey),
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let mut times = Vec::new();
    timed(&mut times, "page", || web::run(&web::Args::default()))?;
    let kilwa = timed(&mut times, "compile", || compile_kilwa(&args.profile))?;
    let folder = root()?.join("demo");
    let from = match (args.survey, args.scans) {
        (true, _) => From::Survey(Survey {
            stations: args.stations,
            columns: COLUMNS,
            photographs: 24,
            panoramas: 4,
            size: [1000, 750],
            pose_error: 5,
        }),
        (false, true) => From::Scans { stations: args.stations, columns: COLUMNS },
        (false, false) => From::Mesh { triangles: args.triangles },
    };
    let pack = make_pack(&mut times, &kilwa, &folder, from)?;
    timed(&mut times, "verify", || run_kilwa(&kilwa, &["verify"], &[&pack]))?;
    let site = timed(&mut times, "publish", || publish(&kilwa, &folder, &pack, args.survey))?;

    let address = free_address(args.port)?;
    let served = Instant::now();
    let mut server = Server::start(&kilwa, &site, address)?;
    check(address, &site, &pack)?;
    times.push(("serve", served.elapsed()));

    println!("\nseconds  step");
    for (step, took) in &times {
        println!("{:>7.1}  {step}", took.as_secs_f64());
    }
    if args.check {
        println!("\nThe page and the head of the pack came over HTTP from http://{address}/");
        return Ok(());
    }
    if args.survey {
        println!("\nReports: {0}/report.html and {0}/registration.html", folder.display());
    }
    println!("\nThe fort is at  http://{address}/fort/  (Ctrl-C ends)");
    server.wait()
}

/// The demo that `--check` runs, with a program that is already compiled: a small fort from a mesh, and one from scans and photographs; leaves nothing behind.
///
/// # Errors
/// Any step fails.
pub(crate) fn check_small(kilwa: &Path, triangles: u64) -> Result<()> {
    let folder = root()?.join("target/demo-check");
    let survey = Survey { stations: 4, columns: 240, photographs: 6, panoramas: 1, size: [280, 210], pose_error: 0 };
    for from in [From::Mesh { triangles }, From::Survey(survey)] {
        let pack = make_pack(&mut Vec::new(), kilwa, &folder, from)?;
        run_kilwa(kilwa, &["verify"], &[&pack])?;
        let site = publish(kilwa, &folder, &pack, matches!(from, From::Survey(_)))?;
        let address = free_address(8080)?;
        let server = Server::start(kilwa, &site, address)?;
        check(address, &site, &pack)?;
        drop(server);
        fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    Ok(())
}

/// The fort's pack in `folder`, rebuilt unless the last run made the same with the same program.
fn make_pack(times: &mut Vec<(&'static str, Duration)>, kilwa: &Path, folder: &Path, from: From) -> Result<PathBuf> {
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let (mesh, pack, stamp) = (folder.join("fort.ply"), folder.join("fort.kilwa"), folder.join(".fort"));
    let (scans, survey) = (folder.join("scans"), folder.join("survey"));
    let program = fs::read(kilwa).with_context(|| format!("cargo left no {}", kilwa.display()))?;
    let size = match from {
        From::Mesh { triangles } => triangles.to_string(),
        From::Scans { stations, columns } => format!("{stations} scans of {columns}"),
        From::Survey(survey) => format!("{survey:?}"),
    };
    let key = format!("{size} {}", blake3::hash(&program).to_hex());
    if pack.is_file() && fs::read_to_string(&stamp).is_ok_and(|have| have == key) {
        println!("demo: {} of the last run is kept", pack.display());
        return Ok(pack);
    }
    // Files of an interrupted run are not a result.
    for file in [&stamp, &mesh, &pack] {
        remove(file)?;
    }
    for made in [&scans, &survey, &folder.join("site")] {
        remove_all(made)?;
    }
    match from {
        From::Mesh { triangles } => {
            let count = triangles.to_string();
            timed(times, "synth", || run_kilwa(kilwa, &["synth", "fort", "--triangles", &count, "-o"], &[&mesh]))?;
            timed(times, "build", || run_kilwa(kilwa, &["build", "-o"], &[&pack, &mesh]))?;
            // The mesh is the larger of the two files and the pack holds all of it.
            remove(&mesh)?;
        }
        From::Scans { stations, columns } => {
            let [stations, columns] = [stations, columns].map(|n| n.to_string());
            let synth = ["synth", "scans", "--stations", &stations, "--columns", &columns, "-o"];
            timed(times, "scan", || run_kilwa(kilwa, &synth, &[&scans]))?;
            timed(times, "import", || run_kilwa(kilwa, &["scans", "import", "-o"], &[&survey, &scans]))?;
            let mask = ["scans", "mask", "--mixed", "--seen-through"];
            timed(times, "mask", || run_kilwa(kilwa, &mask, &[&survey]))?;
            timed(times, "merge", || run_kilwa(kilwa, &["merge", "-o"], &[&pack, &survey]))?;
            // The survey has every sample of the scans.
            remove_all(&scans)?;
        }
        From::Survey(made) => survey::make(times, kilwa, folder, &pack, made)?,
    }
    fs::write(&stamp, key).with_context(|| format!("cannot write {}", stamp.display()))?;
    Ok(pack)
}

/// The archive object of the pack, in the folder that is served, with the photographs of a survey; kept where it is complete.
fn publish(kilwa: &Path, folder: &Path, pack: &Path, has_photographs: bool) -> Result<PathBuf> {
    let (site, metadata) = (folder.join("site"), folder.join("fort.toml"));
    // Replaced last when a version is published: without it there is no object.
    if site.join("fort/manifest.json").is_file() {
        println!("demo: {} of the last run is kept", site.join("fort").display());
        return Ok(site);
    }
    let rights = if has_photographs { PHOTOGRAPHS } else { "" };
    fs::write(&metadata, format!("{METADATA}{rights}"))
        .with_context(|| format!("cannot write {}", metadata.display()))?;
    let (report, photographs) = (survey::colour_report(folder), survey::photographs(folder));
    let mut args: Vec<&Path> = vec![pack, "--to".as_ref(), &site, "--metadata".as_ref(), &metadata];
    if has_photographs {
        args.extend(["--colour-report".as_ref(), &*report, "--photos".as_ref(), &photographs]);
    }
    run_kilwa(kilwa, &["publish"], &args)?;
    Ok(site)
}

fn remove(file: &Path) -> Result<()> {
    gone(fs::remove_file(file), file)
}

fn remove_all(folder: &Path) -> Result<()> {
    gone(fs::remove_dir_all(folder), folder)
}

/// A file that was not there is gone, too.
fn gone(removed: std::io::Result<()>, what: &Path) -> Result<()> {
    match removed {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", what.display()))
        }
        _ => Ok(()),
    }
}

fn run_kilwa(kilwa: &Path, args: &[&str], paths: &[&Path]) -> Result<()> {
    let mut command = command(&kilwa.to_string_lossy(), args)?;
    run_command(command.args(paths))
}

fn timed<T>(
    times: &mut Vec<(&'static str, Duration)>,
    step: &'static str,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    println!("\n== {step}");
    let started = Instant::now();
    let made = work()?;
    times.push((step, started.elapsed()));
    Ok(made)
}

/// The first address of this machine, from `port` on, that nobody listens at.
fn free_address(port: u16) -> Result<SocketAddr> {
    for port in port..=port.saturating_add(PORTS) {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        if TcpListener::bind(address).is_ok() {
            return Ok(address);
        }
        println!("demo: port {port} is taken");
    }
    bail!("ports {port} to {} are all taken; choose another with --port", port.saturating_add(PORTS))
}

/// Checks what a visitor's browser asks for first: the list, the object's page, its code, and the head of the pack by range.
fn check(address: SocketAddr, site: &Path, pack: &Path) -> Result<()> {
    for (path, expected) in [("/", &b"<html"[..]), ("/fort/", b"<canvas"), ("/viewer/viewer_bg.wasm", b"\0asm")] {
        let answer = http::get(address, path, None, 16 << 20)?;
        if answer.status != 200 || !answer.body.windows(expected.len()).any(|window| window == expected) {
            let expected = String::from_utf8_lossy(expected);
            bail!("http://{address}{path}: status {}, {} bytes without {expected:?}", answer.status, answer.body.len());
        }
    }
    let path = format!("/fort/v1/{}", published_pack(&site.join("fort/v1"))?);
    let head = http::get(address, &path, Some((0, HEAD_BYTES - 1)), 1 << 20)?;
    let on_disk = fs::read(pack).with_context(|| format!("cannot read {}", pack.display()))?;
    let expected = &on_disk[..on_disk.len().min(usize::try_from(HEAD_BYTES)?)];
    if head.status != 206 || head.body != expected {
        bail!(
            "http://{address}{path}: a range of {HEAD_BYTES} bytes is answered with status {} and {} bytes, not the head of {}",
            head.status,
            head.body.len(),
            pack.display()
        );
    }
    Ok(())
}

/// The name of the pack in a version's folder.
fn published_pack(version: &Path) -> Result<String> {
    let names = fs::read_dir(version).with_context(|| format!("cannot list {}", version.display()))?;
    let mut names = names.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let pack = names.find(|name| Path::new(name).extension().is_some_and(|e| e == "kilwa"));
    pack.with_context(|| format!("{} has no pack", version.display()))
}

/// `kilwa serve` as a child that never outlives this task.
struct Server(Child);

impl Server {
    fn start(kilwa: &Path, folder: &Path, address: SocketAddr) -> Result<Self> {
        let listen = address.to_string();
        let mut serve = command(&kilwa.to_string_lossy(), &["serve", "--listen", &listen])?;
        let child = serve
            .arg(folder)
            .stdin(Stdio::null())
            .spawn()
            .with_context(|| format!("cannot start {}", kilwa.display()))?;
        let mut server = Self(child);
        let started = Instant::now();
        while TcpStream::connect(address).is_err() {
            if let Some(status) = server.0.try_wait()? {
                bail!("`kilwa serve` ended before it listened at {address} ({status})");
            }
            if started.elapsed() > START_WITHIN {
                bail!("`kilwa serve` does not listen at {address} after {} s", START_WITHIN.as_secs());
            }
            sleep(Duration::from_millis(50));
        }
        Ok(server)
    }

    fn wait(&mut self) -> Result<()> {
        let status = self.0.wait()?;
        // Ctrl-C reaches the server too; it has no exit code then, or 0 when it shut down in order.
        if status.success() || status.code().is_none() {
            return Ok(());
        }
        bail!("`kilwa serve` failed ({status})")
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It may have ended already; nothing is left to do then.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_in_use_is_skipped() {
        let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = taken.local_addr().unwrap().port();
        let free = free_address(port).unwrap();
        assert_ne!(free.port(), port);
        assert!(free.ip().is_loopback());
    }
}
