//! `kilwa scans view`.

use crate::new_file::{NewFile, check_output};
use anyhow::ensure;
use clap::ValueEnum;
use kilwa_scan::panorama::{self, Show};
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::Survey;
use std::io::Write as _;
use std::path::PathBuf;

/// Draw a range, intensity or colour image of a station as a PNG.
///
/// A structured scan is drawn cell by cell, as the scanner saw it; an unstructured point cloud as an equirectangular panorama. Dark blue means no return.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// The station; `kilwa scans list` shows their names.
    station: String,
    /// The PNG to write.
    #[arg(short, long, value_name = "FILE.png")]
    output: PathBuf,
    /// What to show.
    #[arg(long, value_enum, default_value = "range")]
    show: ShowArg,
    /// Largest width or height in pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(16..=16384))]
    size: u32,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum ShowArg {
    /// Distance from the scanner.
    Range,
    /// Intensity of the return.
    Intensity,
    /// Colour.
    Colour,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let is_png = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    ensure!(is_png, "{}: the file extension of the picture must be .png", args.output.display());
    let survey = Survey::open(&args.survey)?;
    let station = survey.station(&args.station)?;
    let scan = args.survey.join(&station.scan);
    check_output(&args.output, args.force, [scan.as_path()])?;
    let mut reader = Reader::open(&scan)?;
    let show = match args.show {
        ShowArg::Range => Show::Range,
        ShowArg::Intensity => Show::Intensity,
        ShowArg::Colour => Show::Colour,
    };
    let picture = panorama::render(&mut reader, show, args.size)?;
    let mut bytes = Vec::new();
    picture.write_png(&mut bytes)?;
    NewFile::write(&args.output, &bytes, args.force)?;
    let mut out = crate::terminal::out();
    write!(out, "{}: {} × {} pixels", args.output.display(), picture.width, picture.height)?;
    match (picture.scale, args.show) {
        (Some([low, high]), ShowArg::Range) => writeln!(out, ", {low:.2} m (dark) to {high:.2} m (bright)")?,
        (Some([low, high]), _) => writeln!(out, ", {low} (dark) to {high} (bright)")?,
        (None, _) => writeln!(out)?,
    }
    Ok(())
}
