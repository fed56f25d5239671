//! `kilwa synth`.

mod photos;
mod scans;

use anyhow::Result;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use kilwa_pack::plural::counted;
use kilwa_synth::{self as synth, Phantom, SiteKind, SynthOptions, UTM_CRS};
use std::io::Write as _;
use std::path::PathBuf;

/// Make a synthetic site: a mesh for trials, tests and benchmarks, or simulated laser scans or photographs.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    site: Site,
}

#[derive(clap::Subcommand)]
enum Site {
    /// A ruined stone fort by the sea, about 50 m across, as a mesh.
    Fort(Mesh),
    /// A brick wall of 10 m by 5 m that faces south, as a mesh.
    Wall(Mesh),
    /// A closed solid of known size, as a mesh: see --shape.
    Phantom {
        /// Which phantom.
        #[arg(long, value_enum, value_name = "SHAPE", default_value = "cube")]
        shape: ShapeArg,
        /// Noise: move every vertex, by a normally distributed distance of this standard deviation on each axis, in metres.
        #[arg(long, value_name = "METRES", default_value_t = 0.0, value_parser = noise)]
        noise: f64,
        #[command(flatten)]
        mesh: Mesh,
    },
    Scans(scans::Args),
    Photos(photos::Args),
}

#[derive(clap::Args)]
struct Mesh {
    /// Number of triangles, for example 2000000, 2M or 300k; the result is within 2 % of it.
    #[arg(long, value_name = "N", value_parser = count)]
    triangles: u64,
    /// The PLY file to write.
    #[arg(short, long = "output", value_name = "FILE")]
    output: PathBuf,
    /// Seed of everything random: another seed makes another site of the same kind.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Write B separate files NAME_000.ply, NAME_001.ply … whose border vertices match bit for bit.
    #[arg(long, value_name = "B")]
    blocks: Option<u32>,
    /// Use real-world coordinates (EPSG:32737, near 566000 E, 9010000 N), in doubles.
    #[arg(long)]
    utm: bool,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum ShapeArg {
    Cube,
    Ramp,
    Cylinder,
    Sphere,
    SteppedWall,
    BentWall,
}

impl ShapeArg {
    fn phantom(self) -> Phantom {
        match self {
            Self::Cube => Phantom::Cube,
            Self::Ramp => Phantom::Ramp,
            Self::Cylinder => Phantom::Cylinder,
            Self::Sphere => Phantom::Sphere,
            Self::SteppedWall => Phantom::SteppedWall,
            Self::BentWall => Phantom::BentWall,
        }
    }
}

/// A bar with the time left.
fn progress_bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} %  {eta} left") {
        bar.set_style(style);
    }
    bar.set_message("synth");
    bar
}

/// A count with an optional suffix k, M or G and optional digit separators.
pub(crate) fn count(text: &str) -> Result<u64, String> {
    let plain = text.replace(['_', ','], "");
    let (digits, unit) = match plain.char_indices().last() {
        Some((at, 'k' | 'K')) => (&plain[..at], 1_000),
        Some((at, 'm' | 'M')) => (&plain[..at], 1_000_000),
        Some((at, 'g' | 'G')) => (&plain[..at], 1_000_000_000),
        _ => (plain.as_str(), 1),
    };
    let number = digits.parse::<u64>().ok().and_then(|n| n.checked_mul(unit));
    number.ok_or_else(|| format!("`{text}` is not a number of triangles: write for example 2000000, 2M or 300k"))
}

/// A standard deviation in metres.
fn noise(text: &str) -> Result<f64, String> {
    let metres = text.parse::<f64>().ok().filter(|x| (0.0..=1.0).contains(x));
    metres.ok_or_else(|| format!("`{text}` is no standard deviation in metres: write for example 0.001, and at most 1"))
}

pub(crate) fn run(args: &Args) -> Result<()> {
    match &args.site {
        Site::Fort(mesh) => write_mesh(SiteKind::Fort, mesh, 0.0),
        Site::Wall(mesh) => write_mesh(SiteKind::Wall, mesh, 0.0),
        Site::Phantom { shape, noise, mesh } => write_mesh(SiteKind::Phantom(shape.phantom()), mesh, *noise),
        Site::Scans(args) => scans::run(args),
        Site::Photos(args) => photos::run(args),
    }
}

fn write_mesh(kind: SiteKind, args: &Mesh, noise: f64) -> Result<()> {
    let options = SynthOptions {
        triangles: args.triangles,
        seed: args.seed,
        blocks: args.blocks,
        utm: args.utm,
        noise,
        force: args.force,
    };
    let bar = progress_bar(args.triangles);
    let report = synth::write(kind, &options, &args.output, &mut |done, expected| {
        bar.set_length(expected.max(done));
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let report = report?;
    let mut out = crate::terminal::out();
    if args.json {
        let files: Vec<String> = report.files.iter().map(|f| f.display().to_string()).collect();
        let json = serde_json::json!({
            "files": files,
            "vertices": report.vertices,
            "triangles": report.triangles,
            "asked_triangles": args.triangles,
            "bytes": report.bytes,
            "spacing_m": report.spacing,
            "seed": args.seed,
            "crs": args.utm.then_some(UTM_CRS),
        });
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    let off = (report.triangles as f64 / args.triangles as f64 - 1.0) * 100.0;
    match report.files.as_slice() {
        [one] => write!(out, "{}: ", one.display())?,
        many => write!(out, "{} files beside {}: ", many.len(), args.output.display())?,
    }
    writeln!(
        out,
        "{} ({off:+.1} % from the requested number), {} about {:.1} mm apart, {:.1} MB",
        counted(report.triangles, "triangle", "triangles"),
        counted(report.vertices, "vertex", "vertices"),
        report.spacing * 1000.0,
        report.bytes as f64 / 1e6
    )?;
    Ok(())
}
