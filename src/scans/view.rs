//! `kilwa scans view`.

use crate::new_file::{NewFile, check_output};
use anyhow::ensure;
use clap::ValueEnum;
use kilwa_pack::plural::counted;
use kilwa_scan::mask::{self, MaskReader};
use kilwa_scan::panorama::{self, Show};
use kilwa_scan::survey::{Station, Survey};
use std::io::Write as _;
use std::path::PathBuf;

/// Draw a range, intensity or colour image of a station as a PNG.
///
/// A structured scan is drawn cell by cell, as the scanner saw it; an unstructured point cloud as an equirectangular panorama. Dark blue means no return.
/// Samples that are masked are left out, except with --unmasked and --show mask.
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
    #[arg(long, value_name = "PIXELS", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(16..=8192))]
    size: u32,
    /// Also show masked samples.
    #[arg(long)]
    unmasked: bool,
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
    /// Masked samples, with a colour for each mask, including masks that are off.
    Mask,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let is_png = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    ensure!(is_png, "{}: the file extension of the picture must be .png", args.output.display());
    let survey = Survey::open(&args.survey)?;
    let station = survey.station(&args.station)?;
    // The picture of masks shows what is below them.
    let is_whole = args.unmasked || matches!(args.show, ShowArg::Mask);
    let scan = args.survey.join(&station.scan);
    check_output(&args.output, args.force, [scan.as_path()])?;
    let mut reader = mask::open(&args.survey, station, is_whole)?;
    let show = match args.show {
        ShowArg::Range => Show::Range,
        ShowArg::Intensity => Show::Intensity,
        ShowArg::Colour => Show::Colour,
        ShowArg::Mask => Show::Mask,
    };
    let chosen = station.masks.iter().filter(|_| show == Show::Mask);
    let masks = chosen.map(|mask| MaskReader::open(&args.survey.join(&mask.file), &mask.name));
    let mut masks = masks.collect::<Result<Vec<_>, _>>()?;
    let picture = panorama::render(&mut reader, show, &mut masks, args.size)?;
    let mut bytes = Vec::new();
    picture.write_png(&mut bytes)?;
    NewFile::write(&args.output, &bytes, args.force)?;
    let mut out = crate::terminal::out();
    write!(out, "{}: {} × {} pixels", args.output.display(), picture.width, picture.height)?;
    match (picture.frame.scale, args.show) {
        (_, ShowArg::Mask) => {
            writeln!(out)?;
            legend(station, &masks, &mut out)?;
        }
        (Some([low, high]), ShowArg::Range) => writeln!(out, ", {low:.2} m (dark) to {high:.2} m (bright)")?,
        (Some([low, high]), _) => writeln!(out, ", {low} (dark) to {high} (bright)")?,
        (None, _) => writeln!(out)?,
    }
    Ok(())
}

/// Which colour is which mask; where several mask a sample, the first is shown.
fn legend(station: &Station, masks: &[MaskReader], out: &mut impl std::io::Write) -> anyhow::Result<()> {
    if masks.is_empty() {
        writeln!(out, "{} has no masks; make one with `kilwa scans mask`", station.name)?;
    }
    for (number, (mask, reader)) in station.masks.iter().zip(masks).enumerate() {
        let (color, [r, g, b]) = panorama::mask_color(number);
        let points = counted(reader.header().masked, "point", "points");
        let off = if mask.is_on { "" } else { " (off)" };
        writeln!(out, "{}: {color} (#{r:02x}{g:02x}{b:02x}), {points}{off}", mask.name)?;
    }
    Ok(())
}
