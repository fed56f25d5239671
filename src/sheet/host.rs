//! The host of the loop over a drawing ([`kilwa_measure::sheet::draw`]): renders parts with a session, paints marks in a bitmap font, writes a file.

use super::paint;
use anyhow::Context;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kilwa_archive::drawing;
use kilwa_measure::sheet::Part;
use kilwa_measure::sheet::draw::{Band, Figures, Host, Rendered};
use kilwa_measure::sheet::file::Format;
use kilwa_measure::sheet::layout::Mark;
use kilwa_pack::Source;
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{Camera, RenderOptions, StandardView};
use std::fs::File;
use std::io::{BufWriter, IsTerminal, Seek, SeekFrom, Write};

/// Widest part of a drawing, pixels.
pub(super) const WIDEST: u32 = 4096;

/// Draws with a session and writes a file.
pub(super) struct Native<'a, S> {
    pub(super) session: &'a mut Session<S>,
    /// The view of all parts.
    pub(super) view: StandardView,
    pub(super) options: RenderOptions,
    pub(super) pixel_error: f64,
    pub(super) output: Output,
    pub(super) bar: ProgressBar,
    pub(super) on_rows: Option<&'a dyn Fn(u32, u32)>,
}

/// The file that the picture is written to.
pub(super) enum Output {
    /// Row by row, with its resolution (chunk pHYs); `None` when it is complete.
    Png(Option<Box<png::StreamWriter<'static, BufWriter<File>>>>),
    /// The bytes that the loop writes, unchanged.
    Bytes(BufWriter<File>),
}

impl Output {
    pub(super) fn new(format: Format, file: File, size: [u32; 2], dpi: u32) -> anyhow::Result<Self> {
        let out = BufWriter::new(file);
        if format != Format::Png {
            return Ok(Self::Bytes(out));
        }
        let per_metre = (f64::from(dpi) / 0.0254).round() as u32;
        // Servers check drawings with the same encoder.
        let writer = drawing::begin(out, size, per_metre).and_then(png::Writer::into_stream_writer);
        Ok(Self::Png(Some(Box::new(writer.context("cannot write the PNG")?))))
    }

    fn write(&mut self, bytes: &[u8]) -> anyhow::Result<()> {
        match self {
            Self::Png(Some(out)) => out.write_all(bytes).context("cannot write the PNG"),
            Self::Png(None) => Ok(()),
            Self::Bytes(out) => out.write_all(bytes).context("cannot write the drawing"),
        }
    }
}

impl<S: Source> Host for Native<'_, S> {
    type Error = anyhow::Error;

    async fn render(&mut self, part: &Part, size: [u32; 2]) -> anyhow::Result<Rendered> {
        let camera = Camera::of_part(self.view, &self.session.bounds(), part);
        let view = self.session.view(&camera, size, self.pixel_error);
        let (image, stats) = self.session.render(&view, &self.options).context("cannot draw the model")?;
        let figures = Figures {
            worst_error_metres: stats.worst_error_metres,
            triangles: stats.triangles_drawn,
            target_reached: stats.target_reached,
        };
        Ok(Rendered { pixels: image.pixels, figures })
    }

    fn paint(&mut self, band: &mut Band, marks: &[Mark], pixels_per_mm: f64) -> anyhow::Result<()> {
        paint::paint(band, marks, pixels_per_mm);
        Ok(())
    }

    async fn rows(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        self.output.write(rgb)
    }

    async fn deflate(&mut self, bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        packed.write_all(bytes)?;
        Ok(packed.finish()?)
    }

    async fn write(&mut self, bytes: &[u8]) -> anyhow::Result<()> {
        self.output.write(bytes)
    }

    async fn replace_head(&mut self, bytes: &[u8]) -> anyhow::Result<()> {
        if let Output::Bytes(out) = &mut self.output {
            out.seek(SeekFrom::Start(0)).context("cannot write the drawing")?;
        }
        self.output.write(bytes)
    }

    async fn end(&mut self) -> anyhow::Result<()> {
        self.bar.finish_and_clear();
        match &mut self.output {
            Output::Png(out) => out.take().map_or(Ok(()), |out| out.finish()).context("cannot write the PNG"),
            Output::Bytes(out) => out.flush().context("cannot write the drawing"),
        }
    }

    fn report_progress(&mut self, rows: u32, all: u32) {
        self.bar.set_position(rows.into());
        if let Some(on_rows) = self.on_rows {
            on_rows(rows, all);
        }
    }
}

/// A progress bar for a drawing with this many rows; hidden if stderr is not a terminal.
pub(super) fn bar(rows: u32) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(u64::from(rows)), ProgressDrawTarget::stderr_with_hz(5));
    if let Ok(style) = ProgressStyle::with_template("drawing {wide_bar} {percent:>3} %  {eta} left") {
        bar.set_style(style);
    }
    bar
}
