//! `cargo xtask bench view`: streaming and drawing, natively and in Chromium, on a wall of synthetic masonry.
//!
//! Steps: the wall and its pack (or one that is given); a recorded flight drawn without a window, on whatever adapter there is;
//! the two views of the peers over simulated links; the page in Chromium over emulated links; on request a long flight with
//! failures. The tables are printed and added to `docs/bench/DATE-view.md`. Fails where a step does; nothing here is a gate.

use super::archive;
use crate::process::{cargo, command, compile_kilwa, kilwa, output, root, run as run_command};
use crate::setup;
use anyhow::{Context, Result};
use std::fs;
use std::path::PathBuf;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// A pack to measure; a wall of --triangles is made otherwise
    #[arg(long, value_name = "FILE")]
    pack: Option<PathBuf>,
    /// Triangles of the wall
    #[arg(long, value_name = "N", default_value_t = 4_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    triangles: u64,
    /// Pixels of the native flight; software renderers want few
    #[arg(long, value_name = "WxH", default_value = "3840x2160")]
    size: String,
    /// Frames of the native flight
    #[arg(long, value_name = "N", default_value_t = 600)]
    frames: u32,
    /// After the loads, fly about in Chromium for so many minutes with 5 % of the requests refused
    #[arg(long, value_name = "MINUTES", default_value_t = 0)]
    soak: u32,
    /// One load of each kind instead of three
    #[arg(long)]
    quick: bool,
    /// Cargo profile of the programs; figures of `dev` are for trying out only
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Print the tables without adding them to docs/bench
    #[arg(long)]
    dry: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    let (width, height) = args.size.split_once('x').context("--size is a width and a height such as 3840x2160")?;
    let program = compile_kilwa(&args.profile)?;
    let pack = match &args.pack {
        Some(pack) => pack.canonicalize().with_context(|| format!("cannot read {}", pack.display()))?,
        None => wall(args)?,
    };
    let pack = pack.display().to_string();
    let flight = |rest: &[&str]| {
        let example = ["run", "-q", "--locked", "--package", "kilwa-viewer", "--example", "flight"];
        output(cargo(&example)?.args(["--profile", &args.profile, "--"]).args(rest))
    };
    let native = flight(&["render", &pack, width, height, &args.frames.to_string()])?;
    println!("\n{native}\n");
    let links = flight(&["sim", &pack])?;
    println!("\n{links}\n");

    let tests = setup::npm_packages("tests/browser")?;
    let mut node = command("node", &["bench-view.mjs", &pack])?;
    node.current_dir(&tests).env("KILWA", program).env("CHROMIUM", setup::chromium()?);
    if args.quick {
        node.arg("--quick");
    }
    if args.soak > 0 {
        node.args(["--soak", &args.soak.to_string()]);
    }
    let page = output(&mut node)?;
    println!("\n{page}\n");
    let text = format!(
        "Pack: {}, {} bytes.\n\n### A recorded flight, drawn natively\n\n{native}\n\n### Simulated links\n\n{links}\n\n### The page\n\n{page}\n",
        pack.rsplit('/').next().unwrap_or_default(),
        fs::metadata(&pack)?.len()
    );
    if args.dry { Ok(()) } else { archive(&root, "view", &text, &args.profile) }
}

/// The wall of the peers' figures, made once per number of triangles.
fn wall(args: &Args) -> Result<PathBuf> {
    let folder = root()?.join("target/bench");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let file = |extension: &str| folder.join(format!("wall-{}.{extension}", args.triangles)).display().to_string();
    let (input, pack) = (file("ply"), file("kilwa"));
    let program = kilwa(&args.profile)?.display().to_string();
    let count = args.triangles.to_string();
    run_command(&mut command(&program, &["synth", "wall", "--triangles", &count, "--force", "-o", &input])?)?;
    run_command(&mut command(&program, &["build", &input, "--force", "-o", &pack])?)?;
    Ok(pack.into())
}
