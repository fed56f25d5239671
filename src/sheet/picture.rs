//! The picture, band by band: each tile of a band is a picture of its own, of the part of the model that it shows, so that memory does
//! not grow with the sheet.

use super::paint::Band;
use anyhow::Context;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kilwa_measure::sheet::Sheet;
use kilwa_measure::sheet::layout::Layout;
use kilwa_pack::Source;
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{RenderOptions, StandardView};
use std::io::IsTerminal;

/// Widest tile, pixels.
const TILE: u32 = 4096;

/// What the tiles reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Figures {
    pub(super) worst_error_metres: f64,
    /// Of all tiles; a triangle on two tiles counts twice.
    pub(super) triangles: u64,
    pub(super) target_reached: bool,
}

/// Makes the bands of a sheet from the top.
pub(super) struct Bands<'a, S> {
    pub(super) session: &'a mut Session<S>,
    pub(super) sheet: &'a Sheet,
    /// The view of all its parts.
    pub(super) view: StandardView,
    pub(super) size: [u32; 2],
    pub(super) options: RenderOptions,
    pub(super) pixel_error: f64,
    pub(super) layout: &'a Layout,
    figures: Figures,
    top: u32,
    bar: ProgressBar,
}

impl<'a, S: Source> Bands<'a, S> {
    pub(super) fn new(
        session: &'a mut Session<S>,
        (sheet, view): (&'a Sheet, StandardView),
        size: [u32; 2],
        (options, pixel_error): (RenderOptions, f64),
        layout: &'a Layout,
    ) -> Self {
        let figures = Figures { worst_error_metres: 0.0, triangles: 0, target_reached: true };
        let bar = bar(size[1]);
        Self { session, sheet, view, size, options, pixel_error, layout, figures, top: 0, bar }
    }

    pub(super) fn figures(&self) -> Figures {
        self.figures
    }

    /// The next rows, three sRGB bytes a pixel; `None` after the last.
    pub(super) fn next(&mut self) -> anyhow::Result<Option<Vec<u8>>> {
        let [width, height] = self.size;
        if self.top >= height {
            self.bar.finish_and_clear();
            return Ok(None);
        }
        let mut band = Band::new(width, self.top, Sheet::band_rows(width).min(height - self.top));
        for (at, size) in self.sheet.parts(self.size, band.top, band.rows, TILE) {
            self.tile(&mut band, at, size)?;
        }
        band.paint(self.layout, self.sheet.pixels_per_mm());
        self.top += band.rows;
        self.bar.inc(u64::from(band.rows));
        Ok(Some(band.rgb))
    }

    fn tile(&mut self, band: &mut Band, at: [u32; 2], size: [u32; 2]) -> anyhow::Result<()> {
        let bounds = self.session.bounds();
        let part = self.sheet.part(bounds.center(), at, size);
        let camera = kilwa_viewer::sheet::camera(self.view, &bounds, &part);
        let view = self.session.view(&camera, size, self.pixel_error);
        let (image, stats) = self.session.render(&view, &self.options).context("cannot draw the model")?;
        self.figures.triangles += stats.triangles_drawn;
        self.figures.target_reached &= stats.target_reached;
        if stats.worst_error_metres.is_finite() {
            self.figures.worst_error_metres = self.figures.worst_error_metres.max(stats.worst_error_metres);
        }
        for (row, pixels) in image.pixels.chunks_exact(size[0] as usize * 4).enumerate() {
            let line = (at[1] - band.top) as usize + row;
            let start = (line * band.width as usize + at[0] as usize) * 3;
            let to = &mut band.rgb[start..start + size[0] as usize * 3];
            for (to, from) in to.chunks_exact_mut(3).zip(pixels.chunks_exact(4)) {
                to.copy_from_slice(&from[..3]);
            }
        }
        Ok(())
    }
}

fn bar(rows: u32) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(u64::from(rows)), ProgressDrawTarget::stderr_with_hz(5));
    if let Ok(style) = ProgressStyle::with_template("drawing {wide_bar} {percent:>3} %  {eta} left") {
        bar.set_style(style);
    }
    bar
}
