//! `kilwa synth scans`.

use anyhow::{Result, ensure};
use clap::ValueEnum;
use kilwa_pack::plural::counted;
use kilwa_synth::UTM_CRS;
use kilwa_synth::scans::{self, Class, Extras, Poses, Returns, ScanFormat, ScanOptions};
use std::io::Write as _;
use std::path::PathBuf;

/// Simulated laser scans of the fort, from stations indoors and out, with the ground truth in separate files.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The folder to create: the scans, and the ground truth in its subfolder `truth`.
    #[arg(short, long = "output", value_name = "FOLDER")]
    output: PathBuf,
    /// Number of stations, up to 1,000; they are chosen so that the whole fort is seen.
    #[arg(long, value_name = "N", default_value_t = 12)]
    stations: u32,
    /// Columns per scan of the phase-shift instrument, from 16 to 40,000; the number of rows follows from it. 1,550 columns give a million samples.
    #[arg(long, value_name = "N", default_value_t = 1_550)]
    columns: u32,
    /// Seed of the fort and of everything random.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Format of the scans.
    #[arg(long, value_enum, value_name = "FORMAT", default_value = "ptx")]
    format: FormatArg,
    /// Poses in the scans: the true ones, none, or rough ones.
    #[arg(long, value_enum, value_name = "KIND", default_value = "true")]
    poses: PosesArg,
    /// Standard deviation of each coordinate of rough poses, in metres.
    #[arg(long, value_name = "M", default_value_t = 0.25)]
    rough_position: f64,
    /// Standard deviation of the heading of rough poses, in degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 2.0)]
    rough_heading: f64,
    /// With --poses rough: the first N stations keep their true poses, as if they had been surveyed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    surveyed: u32,
    /// Which return every instrument reports, instead of its own setting.
    #[arg(long, value_enum, value_name = "KIND")]
    returns: Option<ReturnsArg>,
    /// Multiply the noise of ranges, intensities and colours; 0 is none.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    noise: f64,
    /// Trace only every Nth column and row, and interpolate the samples between them where the surface is smooth: faster, but details between traced rays are lost.
    #[arg(long, value_name = "N", default_value_t = 1)]
    trace_every: u32,
    /// Leave out people, grass or scaffolding, separated by commas.
    #[arg(long, value_enum, value_name = "WHAT", value_delimiter = ',')]
    without: Vec<ExtraArg>,
    /// Also write the true surface as a mesh of about N triangles, truth/surface.ply.
    #[arg(long, value_name = "N", value_parser = super::count)]
    truth_mesh: Option<u64>,
    /// Use real-world coordinates (EPSG:32737, near 566000 E, 9010000 N) in poses and ground truth.
    #[arg(long)]
    utm: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum FormatArg {
    Ptx,
    E57,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PosesArg {
    True,
    None,
    Rough,
}

#[derive(Clone, Copy, ValueEnum)]
enum ReturnsArg {
    First,
    Strongest,
    Mean,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExtraArg {
    Walkers,
    Grass,
    Scaffolding,
}

impl Args {
    fn options(&self) -> ScanOptions {
        let with = |what| !self.without.contains(&what);
        ScanOptions {
            seed: self.seed,
            stations: self.stations,
            columns: self.columns,
            format: match self.format {
                FormatArg::Ptx => ScanFormat::Ptx,
                FormatArg::E57 => ScanFormat::E57,
            },
            poses: match self.poses {
                PosesArg::True => Poses::True,
                PosesArg::None => Poses::None,
                PosesArg::Rough => Poses::Rough { position: self.rough_position, heading: self.rough_heading },
            },
            surveyed: self.surveyed,
            trace_every: self.trace_every,
            utm: self.utm,
            extras: Extras {
                walkers: with(ExtraArg::Walkers),
                grass: with(ExtraArg::Grass),
                scaffolding: with(ExtraArg::Scaffolding),
            },
            noise: self.noise,
            returns: self.returns.map(|returns| match returns {
                ReturnsArg::First => Returns::First,
                ReturnsArg::Strongest => Returns::Strongest,
                ReturnsArg::Mean => Returns::Mean,
            }),
            truth_mesh: self.truth_mesh,
        }
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    ensure!(args.surveyed == 0 || args.poses == PosesArg::Rough, "--surveyed needs --poses rough");
    let options = args.options();
    let bar = super::progress_bar(0);
    let report = scans::write(&options, &args.output, &mut |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let report = report?;
    let mut out = crate::terminal::out();
    if args.json {
        let files: Vec<String> = report.files.iter().map(|f| f.display().to_string()).collect();
        let samples: serde_json::Map<String, serde_json::Value> =
            Class::ALL.iter().map(|class| (class.name().to_owned(), report.samples[*class as usize].into())).collect();
        let json = serde_json::json!({
            "files": files,
            "truth": report.truth.display().to_string(),
            "stations": report.files.len(),
            "indoors": report.indoors,
            "points": report.points(),
            "samples": samples,
            "bytes": report.bytes,
            "truth_triangles": report.truth_triangles,
            "seed": args.seed,
            "crs": args.utm.then_some(UTM_CRS),
        });
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}: {} ({} indoors), {}, {:.1} MB",
        args.output.display(),
        counted(report.files.len() as u64, "scan", "scans"),
        report.indoors,
        counted(report.points(), "point", "points"),
        report.bytes as f64 / 1e6
    )?;
    let all = report.samples.iter().sum::<u64>().max(1) as f64;
    let shares = Class::ALL.map(|class| {
        let share = 100.0 * report.samples[class as usize] as f64 / all;
        format!("{} {share:.2} %", class.name())
    });
    writeln!(out, "samples: {}", shares.join(", "))?;
    writeln!(out, "truth: {}", report.truth.display())?;
    if let Some(triangles) = report.truth_triangles {
        writeln!(out, "true surface: {}", counted(triangles, "triangle", "triangles"))?;
    }
    Ok(())
}
