//! Drawings to scale: `kilwa render --scale 1:50`. Plans and elevations as PNG, PDF or GeoTIFF of any size, in constant memory.
//!
//! The size of the sheet, its contents (picture, frame, grid, scale bar, north arrow, title block) and the loop that draws and writes it are in
//! `kilwa_measure::sheet`, which the page uses too. The native parts are here: `host` renders parts of the model and writes the file, `paint` paints the marks,
//! `letters` sets texts that Helvetica lacks. The file gets its name when it is complete.

mod host;
mod letters;
mod paint;

use crate::new_file::NewFile;
use anyhow::{Context, bail, ensure};
use host::{Native, Output};
use indicatif::ProgressBar;
use kilwa_measure::sheet::View;
use kilwa_measure::sheet::draw::{Drawing, Request};
use kilwa_measure::sheet::file::Format;
use kilwa_measure::sheet::georeference::GeoReference;
use kilwa_measure::sheet::paper::{self, Paper};
use kilwa_pack::Source;
use kilwa_pack::footer::{FOOTER_BYTES, Footer};
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{Bounds, RenderOptions, StandardView};
use serde::Serialize;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A drawing to scale.
#[derive(clap::Args)]
pub(crate) struct SheetArgs {
    /// A drawing to this scale, for example 1:50; the extension of the output chooses the format: .png, .pdf or .tif (GeoTIFF).
    #[arg(long, value_name = "1:N", value_parser = parse_scale, conflicts_with_all = ["size", "camera"])]
    scale: Option<f64>,
    /// Dots per inch of the drawing.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(25..=2400), requires = "scale")]
    dpi: u32,
    /// Paper: A0 to A4, WIDTHxHEIGHT in millimetres, or fit (as large as the drawing). Default: the smallest from A4 to A0 that fits.
    #[arg(long, value_parser = Paper::parse, requires = "scale")]
    paper: Option<Paper>,
    /// Title in the title block (default: the title of the pack).
    #[arg(long, requires = "scale")]
    title: Option<String>,
    /// Draw only the model: no frame, grid, scale bar or title block.
    #[arg(long, requires = "scale")]
    bare: bool,
}

impl SheetArgs {
    /// A drawing of a view that fills a sheet of A4 as well as a usual scale does, at 150 dpi; `None` where no scale is small enough.
    pub(crate) fn fitting(view: StandardView, bounds: &Bounds, title: &str) -> Option<Self> {
        const SCALES: [f64; 20] = [
            0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0, 200.0, 250.0, 500.0, 1000.0, 2000.0, 5000.0,
            10_000.0, 50_000.0, 100_000.0,
        ];
        let paper = Paper::parse("A4").ok()?;
        let size = drawing(view)?.extent(bounds.min, bounds.max).map(|(low, high)| (high - low) * 1000.0);
        let fits = |scale: &f64| paper::choose(Some(&paper), size.map(|mm| mm / scale), false, *scale).is_ok();
        let scale = SCALES.into_iter().find(fits)?;
        Some(Self { scale: Some(scale), dpi: 150, paper: Some(paper), title: Some(title.to_owned()), bare: false })
    }

    /// `1:50`.
    pub(crate) fn scale_text(&self) -> String {
        self.scale.map(|s| format!("1:{s}")).unwrap_or_default()
    }

    /// Whether a drawing is asked for.
    pub(crate) fn is_wanted(&self) -> bool {
        self.scale.is_some()
    }
}

fn parse_scale(text: &str) -> Result<f64, String> {
    let number = text.strip_prefix("1:").unwrap_or(text).parse::<f64>();
    match number {
        Ok(n) if n.is_finite() && (0.01..=1e6).contains(&n) => Ok(n),
        _ => Err("expected a scale such as 1:50".to_owned()),
    }
}

/// What is drawn and how, from the other options of `kilwa render`.
pub(crate) struct Subject<'a, S> {
    pub(crate) session: Session<S>,
    pub(crate) view: StandardView,
    pub(crate) options: RenderOptions,
    pub(crate) pixel_error: f64,
    pub(crate) output: &'a Path,
    /// Replace files that exist.
    pub(crate) replace: bool,
    /// What the pack is called: [`Footer::identity`].
    pub(crate) identity: String,
    /// Told how many rows of how many are drawn; without it there is a progress bar.
    pub(crate) on_rows: Option<&'a dyn Fn(u32, u32)>,
}

/// What `--json` prints.
#[derive(Serialize)]
pub(crate) struct Report {
    drawing: String,
    size: [u32; 2],
    paper_mm: [f64; 2],
    scale: f64,
    dpi: u32,
    metres_per_pixel: f64,
    /// World coordinates of the middle of the first pixel: along the drawing's x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    first_pixel: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    crs: Option<String>,
    worst_error_metres: f64,
    triangles: u64,
    target_reached: bool,
    files: Vec<String>,
}

/// The identity of a pack, from its last bytes.
pub(crate) fn identity<S: Source>(source: &S) -> anyhow::Result<String> {
    let at = source.len()?.saturating_sub(FOOTER_BYTES as u64);
    Ok(Footer::parse(&source.read_at(at, FOOTER_BYTES)?)?.identity())
}

/// Draw the sheet.
pub(crate) fn run<S: Source>(args: &SheetArgs, mut s: Subject<'_, S>) -> anyhow::Result<Report> {
    let scale = args.scale.context("a drawing needs --scale")?;
    let format = format_of(s.output)?;
    let metadata = s.session.metadata().clone();
    let view = drawing(s.view);
    let request = Request {
        view: view.context("an oblique view has no scale; choose --view plan, north, east, south or west")?,
        scale,
        dpi: args.dpi,
        paper: args.paper.clone(),
        bare: args.bare,
        title: args.title.clone().unwrap_or_else(|| metadata.title.clone()),
        format,
    };
    let mut drawing = Drawing::new(&metadata, s.identity.clone(), request)?;
    if format == Format::Pdf {
        drawing.layout.letters = letters::of(&drawing.layout)?;
    }
    let written = s.output;
    let mut out = NewFile::create(written)?;
    let mut host = Native {
        session: &mut s.session,
        view: s.view,
        options: s.options,
        pixel_error: s.pixel_error,
        output: Output::new(format, out.file().try_clone()?, drawing.size, args.dpi)?,
        bar: if s.on_rows.is_some() { ProgressBar::hidden() } else { host::bar(drawing.size[1]) },
        on_rows: s.on_rows,
    };
    let figures = pollster::block_on(drawing.draw(host::WIDEST, &mut host))?;
    // Its file is closed before it gets its name.
    drop(host);
    if format == Format::Png {
        ends_as_png(out.file()).context("cannot write the PNG")?;
    }
    let Drawing { sheet, size, georeference, .. } = drawing;
    let mut files = vec![written.display().to_string()];
    let world = georeference.as_ref().filter(|_| format == Format::Png).map(|g| (written.with_extension("pgw"), g));
    if let Some((path, g)) = &world {
        // First, because a picture without its world file cannot be told from one that has none.
        NewFile::write(path, g.world_file().as_bytes(), s.replace)?;
        files.push(path.display().to_string());
    }
    if let Err(e) = out.commit(s.replace) {
        // A world file that replaced another cannot be taken back; the picture that it belongs to is made by the next attempt.
        if let Some((path, _)) = world.filter(|_| !s.replace) {
            drop(std::fs::remove_file(path));
        }
        return Err(e);
    }
    Ok(Report {
        drawing: written.display().to_string(),
        size,
        paper_mm: sheet.paper,
        scale,
        dpi: args.dpi,
        metres_per_pixel: sheet.metres_per_pixel(),
        first_pixel: georeference.as_ref().map(GeoReference::first_pixel),
        crs: metadata.crs,
        worst_error_metres: figures.worst_error_metres,
        triangles: figures.triangles,
        target_reached: figures.target_reached,
        files,
    })
}

/// Whether a PNG has its last chunk: the encoder writes it when it is dropped, where an error is lost.
fn ends_as_png(file: &mut File) -> anyhow::Result<()> {
    let mut last = [0; 12];
    file.seek(SeekFrom::End(-12)).and_then(|_| file.read_exact(&mut last))?;
    ensure!(last == *b"\0\0\0\0IEND\xaeB`\x82", "its end is missing; is the disk full?");
    Ok(())
}

impl Report {
    /// The same for people.
    pub(crate) fn text(&self) -> String {
        format!(
            "{}: 1:{} at {} dpi, {:.0} x {:.0} mm, {} x {} pixels of {:.6} m, surface within {:.4} m",
            self.files.join(" and "),
            self.scale,
            self.dpi,
            self.paper_mm[0],
            self.paper_mm[1],
            self.size[0],
            self.size[1],
            self.metres_per_pixel,
            self.worst_error_metres
        )
    }

    /// Whether every part is as fine as asked for.
    pub(crate) fn is_complete(&self) -> bool {
        self.target_reached
    }
}

/// The format of a file, by the extension of its name.
fn format_of(path: &Path) -> anyhow::Result<Format> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref().and_then(Format::from_extension) {
        Some(format) => Ok(format),
        None => bail!("{}: the file extension of a drawing must be .png, .pdf or .tif", path.display()),
    }
}

/// The drawing that a view gives; `None` for an oblique one, which has no scale.
fn drawing(view: StandardView) -> Option<View> {
    StandardView::ALL.iter().find(|(v, _)| *v == view).and_then(|(_, name)| View::from_name(name))
}

/// The path of the world file beside a drawing; only plans as PNG have one.
pub(crate) fn world_file_of(output: &Path, view: StandardView) -> Option<PathBuf> {
    let is_png = format_of(output).is_ok_and(|format| format == Format::Png);
    (is_png && view == StandardView::Plan).then(|| output.with_extension("pgw"))
}
