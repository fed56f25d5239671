//! `kilwa extract`: give the mesh back from a pack, whole or coarser, as one crack-free PLY.
//!
//! Vertices that are equal in position and every attribute become one vertex again, so that patches join exactly; the
//! pack's lattice makes this equality of integers. The file is written under a temporary name and renamed when complete.

mod output;
mod ply;

use crate::info::{grouped, metres};
use crate::source::{FileSource, open_pack};
use crate::verify::progress_bar;
use anyhow::Context;
use kilwa_pack::cut::{Cut, coarse_triangles};
use kilwa_pack::{Chunk, PackError, Reader, Source};
use output::Output;
use ply::Welded;
use rayon::prelude::*;
use std::io::Write as _;
use std::path::PathBuf;

/// Give the mesh back from a pack, at full detail or coarser, as a PLY without cracks.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The pack.
    pack: PathBuf,
    /// The PLY to write.
    #[arg(short, long)]
    output: PathBuf,
    /// The coarsest surface whose certified error is at most this many metres.
    #[arg(long, value_name = "METRES", conflicts_with = "max_triangles", value_parser = error_limit)]
    max_error: Option<f64>,
    /// The best surface of at most this many triangles.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    max_triangles: Option<u64>,
    /// Write numbers as text instead of binary little-endian.
    #[arg(long)]
    ascii: bool,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Report as JSON.
    #[arg(long)]
    json: bool,
}

/// Chunks decoded at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;

fn error_limit(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x >= 0.0 => Ok(x),
        _ => Err("a length in metres is wanted, for example 0.01".to_owned()),
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    // What would stop the writing is said before the work is done.
    let output = Output::prepare(&args.output, args.force)?;
    let reader = open_pack(&args.pack)?;
    let of_pack = || args.pack.display().to_string();
    let cut = choose(&reader, args).with_context(of_pack)?;
    let mesh = weld(&reader, &cut).with_context(of_pack)?;
    let error = cut.error(reader.entries());
    if let Some(limit) = args.max_triangles.filter(|&limit| limit < mesh.triangle_count()) {
        eprintln!(
            "kilwa: the coarsest surface of this pack has {} triangles; {} were asked for",
            grouped(mesh.triangle_count()),
            grouped(limit)
        );
    }
    let comment = format!("certified error {error} m against the finest surface");
    let layout = ply::Layout::of(&reader, args.ascii);
    let bytes = output.write(|out| ply::write(out, &mesh, &reader, layout, &comment))?;
    if args.json {
        let report = serde_json::json!({
            "output": args.output.display().to_string(),
            "bytes": bytes,
            "triangles": mesh.triangle_count(),
            "vertices": mesh.vertex_count(),
            "max_error": error,
            "refined_chunks": cut.refined().count(),
            "coordinates": layout.coordinate_type(),
            "ascii": args.ascii,
        });
        writeln!(std::io::stdout(), "{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        let precision =
            if error == 0.0 { "the finest surface".to_owned() } else { format!("within {}", metres(f64::from(error))) };
        writeln!(
            std::io::stdout(),
            "{}: {} triangles, {} vertices, {precision}, {} bytes.",
            args.output.display(),
            grouped(mesh.triangle_count()),
            grouped(mesh.vertex_count()),
            grouped(bytes)
        )?;
    }
    Ok(())
}

fn choose(reader: &Reader<FileSource>, args: &Args) -> anyhow::Result<Cut> {
    let entries = reader.entries();
    if let Some(limit) = args.max_error {
        return Ok(Cut::for_error(entries, limit));
    }
    let Some(limit) = args.max_triangles else {
        return Ok(Cut::finest(entries));
    };
    // The directory says what a refinement adds; what it takes away stands in the patch tables of the chunks.
    let mut patches = Vec::new();
    for (i, e) in entries.iter().enumerate() {
        let bytes = reader
            .source()
            .read_at(e.offset, e.encoded_bytes as usize)
            .with_context(|| format!("cannot read chunk {i}"))?;
        if kilwa_pack::checksum(&bytes) != e.checksum {
            return Err(PackError::Checksum { what: format!("chunk {i}") }.into());
        }
        patches.extend(kilwa_pack::chunk::patch_table(&bytes)?);
    }
    Ok(Cut::for_triangles(entries, &coarse_triangles(entries.len(), &patches), limit))
}

/// All drawn patches of a cut as one mesh.
fn weld(reader: &Reader<FileSource>, cut: &Cut) -> anyhow::Result<Welded> {
    let refined: Vec<u32> = cut.refined().collect();
    let bar = progress_bar(refined.len() as u64, "extracting");
    let mut mesh = Welded::default();
    for batch in refined.chunks(BATCH) {
        let chunks: Vec<Result<Chunk, PackError>> = batch.par_iter().map(|&i| reader.chunk(i)).collect();
        for chunk in chunks {
            let chunk = chunk?;
            for patch in cut.drawn(&chunk.patches) {
                mesh.add(&chunk.mesh, patch)?;
            }
        }
        bar.inc(batch.len() as u64);
    }
    bar.finish_and_clear();
    Ok(mesh)
}
