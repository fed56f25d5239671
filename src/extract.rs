//! `kilwa extract`: extract the mesh from a pack, whole or coarser, as one crack-free PLY, OBJ, STL or GLB; or its hierarchy as 3D Tiles (`tiles`).

mod tiles;

use crate::info::{grouped, metres};
use crate::new_file::refuse_inputs;
use crate::source::open_pack;
use crate::verify::progress_bar;
use glam::DVec3;
use kilwa_formats::extract::{ExtractError, Extraction, Format, Output, Region, Request, WINDOW, extract};
use kilwa_pack::Metadata;
use kilwa_pack::plural::plural;
use std::io::Write as _;
use std::path::PathBuf;

/// Extract the mesh from a pack, at full detail or coarser, as PLY, OBJ, STL or GLB, without cracks; or all levels of detail as 3D Tiles.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The pack.
    pack: PathBuf,
    /// The file to write; its extension determines the format: .ply, .obj, .stl or .glb. With --to, a folder that does not exist yet.
    #[arg(short, long)]
    output: PathBuf,
    /// Write a folder with all levels of detail for other viewers: 3D Tiles 1.1.
    #[arg(long, value_name = "FORMAT", conflicts_with_all = ["max_error", "max_triangles", "region", "ascii", "force"])]
    to: Option<To>,
    #[command(flatten)]
    tiles: tiles::TilesArgs,
    /// The coarsest surface whose certified error is at most this many metres.
    #[arg(long, value_name = "METRES", conflicts_with = "max_triangles", value_parser = error_limit)]
    max_error: Option<f64>,
    /// A surface of this many triangles, or a few less: a finer one, simplified, with a certified error.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    max_triangles: Option<u64>,
    /// Only the triangles whose centroid lies in this box, whole; world coordinates in metres.
    #[arg(long = "box", value_name = "XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX", allow_hyphen_values = true)]
    region: Option<Region>,
    /// PLY: write numbers as text instead of binary little-endian.
    #[arg(long)]
    ascii: bool,
    /// GLB: compress with EXT_meshopt_compression, which three.js, Babylon.js and CesiumJS read.
    #[arg(long, conflicts_with = "to")]
    compress: bool,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// What is written as a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum To {
    /// 3D Tiles 1.1.
    Tiles,
}

fn error_limit(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x >= 0.0 => Ok(x),
        _ => Err("expected a length in metres, for example 0.01".to_owned()),
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if args.to == Some(To::Tiles) {
        return tiles::run(args);
    }
    // An output that cannot be written is reported before the work is done.
    let format = Format::of(&args.output, args.ascii)?;
    let format = if args.compress { format.compressed()? } else { format };
    refuse_inputs(&args.output, [args.pack.as_path()])?;
    let output = Output::prepare(&args.output, args.force)?;
    let reader = open_pack(&args.pack)?;
    let request = Request {
        format,
        max_error: args.max_error,
        max_triangles: args.max_triangles,
        region: args.region,
        window: WINDOW,
    };
    let bar = progress_bar(0, "extracting");
    let progress = |done, all| {
        bar.set_length(all);
        bar.set_position(done);
    };
    let extracted = extract(&reader, &request, &output, &progress);
    bar.finish_and_clear();
    let written = extracted.map_err(|e| match e {
        ExtractError::Empty => {
            anyhow::anyhow!("{}: {}", args.pack.display(), nothing_there(reader.metadata(), args.region.as_ref()))
        }
        e if e.is_of_output() => e.into(),
        e => anyhow::Error::new(e).context(args.pack.display().to_string()),
    })?;
    report_excess(args.max_triangles, &written);
    let report = Report { args, format, written: &written };
    if args.json { report.json() } else { report.text() }
}

fn nothing_there(metadata: &Metadata, region: Option<&Region>) -> String {
    let (min, max) = (metadata.bounds_min, metadata.bounds_max);
    let spans = format!("it spans {} {} {} to {} {} {} m", min[0], min[1], min[2], max[0], max[1], max[2]);
    match region {
        Some(region) => format!("no triangle has its centroid in the box {region}; {spans}"),
        None => "it contains no triangles".to_owned(),
    }
}

/// The promise of `--max-triangles` is at most N; where the surface does not allow it, say so.
fn report_excess(limit: Option<u64>, written: &Extraction) {
    let found = written.triangles;
    let Some(limit) = limit.filter(|limit| found > *limit) else { return };
    crate::terminal::say!(
        "kilwa: {} {} instead of {}: the surface cannot be simplified further without closing holes",
        grouped(found),
        plural(found, "triangle", "triangles"),
        grouped(limit)
    );
}

/// What was written.
struct Report<'a> {
    args: &'a Args,
    format: Format,
    written: &'a Extraction,
}

impl Report<'_> {
    fn json(&self) -> anyhow::Result<()> {
        let report = serde_json::json!({
            "output": self.args.output.display().to_string(),
            "format": self.format.name(),
            "bytes": self.written.bytes,
            "triangles": self.written.triangles,
            "vertices": self.written.vertices,
            "max_error": self.written.error,
            "refined_chunks": self.written.refined_chunks,
            "coordinates": self.written.coordinates,
            "offset": self.written.offset,
            "left_out": self.written.left_out,
            "ascii": self.args.ascii,
            "compressed": self.args.compress,
        });
        writeln!(crate::terminal::out(), "{}", crate::terminal::json_text(&report)?)?;
        Ok(())
    }

    fn text(&self) -> anyhow::Result<()> {
        let error = self.written.error;
        let precision =
            if error == 0.0 { "the finest surface".to_owned() } else { format!("within {}", metres(f64::from(error))) };
        let mut out = crate::terminal::out();
        writeln!(
            out,
            "{}: {} {}, {} {}, {precision}, {} {}.",
            self.args.output.display(),
            grouped(self.written.triangles),
            plural(self.written.triangles, "triangle", "triangles"),
            grouped(self.written.vertices),
            plural(self.written.vertices, "vertex", "vertices"),
            grouped(self.written.bytes),
            plural(self.written.bytes, "byte", "bytes")
        )?;
        let left_out = &self.written.left_out;
        if !left_out.is_empty() {
            writeln!(out, "  {} cannot store {}; they were left out.", self.format.title(), left_out.join(", "))?;
        }
        if let Some(DVec3 { x, y, z }) = self.written.offset {
            writeln!(
                out,
                "  Coordinates are relative to {x} {y} {z}, because its numbers are not precise enough for world coordinates."
            )?;
        }
        Ok(())
    }
}
