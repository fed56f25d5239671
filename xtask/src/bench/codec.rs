//! `cargo xtask bench codec`: sizes and speed of the chunk codec, on packs of synthetic meshes.
//!
//! Natively by the example `codec` of `kilwa-pack` (bytes by part and level, speeds on one core, vertex-cache use, beside
//! meshoptimizer's codec); in a browser by `tests/browser/codec-bench.mjs`, with the module that the page decodes with. All of it runs
//! in profile `release` and `web`; only the packs may come from another build, whose bytes are the same.

use super::{archive, number_of};
use crate::process::{cargo, command, compile_kilwa, output, root, run as run_command};
use crate::{setup, web};
use anyhow::{Context, Result, bail};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Triangles of each mesh
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    triangles: u64,
    /// Meshes to build
    #[arg(long, value_name = "NAME", default_values_t = ["wall".to_owned(), "fort".to_owned()])]
    mesh: Vec<String>,
    /// Lattice spacing of the packs, metres
    #[arg(long, value_name = "METRES", default_value = "0.0001220703125")]
    step: String,
    /// Profile of the program that builds the packs; their bytes do not depend on it
    #[arg(long, value_name = "NAME", default_value = "release")]
    builder: String,
    /// Leave out Chromium
    #[arg(long)]
    no_browser: bool,
    /// Print the tables without adding them to docs/bench
    #[arg(long)]
    dry: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let kilwa = compile_kilwa(&args.builder)?;
    let example = ["build", "--release", "--locked", "--package", "kilwa-pack", "--example", "codec"];
    run_command(cargo(&example)?.arg("-q"))?;
    let root = root()?;
    let (scratch, codec) = (root.join("target/bench"), root.join("target/release/examples/codec"));
    fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let program = kilwa.to_string_lossy().into_owned();
    let mut packs = Vec::new();
    for mesh in &args.mesh {
        let file = |extension: &str| scratch.join(format!("{mesh}.{extension}")).display().to_string();
        let (input, pack, count) = (file("ply"), file("kilwa"), args.triangles.to_string());
        run_command(&mut command(&program, &["synth", mesh, "--triangles", &count, "--force", "-o", &input])?)?;
        run_command(&mut command(&program, &["build", &input, "--step", &args.step, "--force", "-o", &pack])?)?;
        packs.push(pack);
    }
    let mut tables = format!("Lattice spacing {} m.\n\n", args.step);
    writeln!(tables, "{}", output(command(&codec.to_string_lossy(), &[])?.args(&packs))?)?;
    if !args.no_browser {
        writeln!(tables, "\n{}", in_browser(&args.mesh, &packs, &scratch.join("decode"))?)?;
    }
    println!("\n{tables}");
    if args.dry { Ok(()) } else { archive(&root, "codec", &tables, "release") }
}

/// Speed in a worker of Chromium, as a sentence.
fn in_browser(meshes: &[String], packs: &[String], module: &Path) -> Result<String> {
    let chromium = setup::chromium()?;
    let tests = setup::npm_packages("tests/browser")?;
    web::decoder(module)?;
    let mut node = command("node", &["codec-bench.mjs"])?;
    let printed = output(node.arg(module).args(packs).current_dir(&tests).env("CHROMIUM", chromium))?;
    let text = |key: &str| {
        printed
            .split_once(&format!("\"{key}\":\""))
            .and_then(|(_, rest)| rest.split_once('"'))
            .map_or("a browser", |(value, _)| value)
            .to_owned()
    };
    let rounds = number_of(&printed, "\"rounds\"").unwrap_or(0.0);
    // One object for each pack, in their order.
    let results = printed.split_once("\"packs\"").map_or("", |(_, rest)| rest).split('}');
    let speeds = meshes.iter().zip(results).map(|(mesh, result)| {
        let (seconds, triangles) = (number_of(result, "\"seconds\""), number_of(result, "\"triangles\""));
        let (Some(seconds), Some(triangles)) = (seconds, triangles) else {
            bail!("unexpected output of the browser: {printed:?}")
        };
        Ok(format!("{mesh} {:.2}", triangles / seconds / 1e6))
    });
    let speeds = speeds.collect::<Result<Vec<_>>>()?.join(", ");
    Ok(format!(
        "In one worker of {}, checksum, decoding and the arrays for the GPU together, the fastest of {rounds} runs of each chunk: {speeds} \
         million triangles a second.",
        text("browser")
    ))
}
