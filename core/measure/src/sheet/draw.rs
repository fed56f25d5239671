//! The loop that makes a drawing: bands of rows from the top, each assembled from parts that are rendered one by one, with the marks of the
//! sheet painted on it. `kilwa render --scale` and the page both run it, each with its own [`Host`]. Memory does not grow with the sheet: only one
//! band exists at a time.

use super::file::{Ending, Format, Writer};
use super::georeference::GeoReference;
use super::layout::{Layout, Mark, Title};
use super::paper::Paper;
use super::{Part, Sheet, SheetError, View};
use glam::DVec3;
use kilwa_pack::Metadata;
use std::future::Future;

/// The drawing that is requested.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Plan or elevation.
    pub view: View,
    /// Denominator of the scale: 50 for 1:50.
    pub scale: f64,
    /// Dots per inch.
    pub dpi: u32,
    /// `None`: the smallest from A4 to A0 that holds the drawing.
    pub paper: Option<Paper>,
    /// Whether to draw only the model, without the marks.
    pub bare: bool,
    /// Title of the model, for the title block.
    pub title: String,
    /// Format of the file.
    pub format: Format,
}

/// A part of the picture as it was rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Four sRGB bytes a pixel (red, green, blue, alpha), rows from the top, of the size that was asked for.
    pub pixels: Vec<u8>,
    /// Figures of this part.
    pub figures: Figures,
}

/// Figures of the surface that was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Largest certified distance from the finest surface, metres; not finite where it is unknown.
    pub worst_error_metres: f64,
    /// Triangles drawn in all parts; a triangle in two parts counts twice.
    pub triangles: u64,
    /// Whether everything is as fine as requested.
    pub target_reached: bool,
}

impl Figures {
    const NONE: Self = Self { worst_error_metres: 0.0, triangles: 0, target_reached: true };

    fn add(&mut self, more: &Self) {
        self.triangles += more.triangles;
        self.target_reached &= more.target_reached;
        if more.worst_error_metres.is_finite() {
            self.worst_error_metres = self.worst_error_metres.max(more.worst_error_metres);
        }
    }
}

/// Some rows of the picture, three sRGB bytes a pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Band {
    /// Pixels of a row.
    pub width: u32,
    /// Row of the picture that the band begins with.
    pub top: u32,
    /// Number of rows.
    pub rows: u32,
    /// `width * rows * 3` bytes.
    pub rgb: Vec<u8>,
}

impl Band {
    /// White.
    pub fn new(width: u32, top: u32, rows: u32) -> Self {
        Self { width, top, rows, rgb: vec![255; width as usize * rows as usize * 3] }
    }

    /// Copy four-byte pixels into the band: `at` is their upper left pixel in the picture, `size` their width and height. They must lie inside the band.
    fn put(&mut self, at: [u32; 2], size: [u32; 2], pixels: &[u8]) {
        for (row, pixels) in pixels.chunks_exact(size[0] as usize * 4).take(size[1] as usize).enumerate() {
            let line = (at[1] - self.top) as usize + row;
            let start = (line * self.width as usize + at[0] as usize) * 3;
            let to = &mut self.rgb[start..start + size[0] as usize * 3];
            for (to, from) in to.chunks_exact_mut(3).zip(pixels.chunks_exact(4)) {
                to.copy_from_slice(&from[..3]);
            }
        }
    }
}

/// The services that a drawing needs from the program that makes it. An error in any method ends the drawing and leaves the file incomplete.
pub trait Host {
    /// The reason why a drawing failed.
    type Error: From<SheetError>;

    /// Render a part of the picture: the model on white, `size` pixels wide and high.
    fn render(&mut self, part: &Part, size: [u32; 2]) -> impl Future<Output = Result<Rendered, Self::Error>>;

    /// Paint marks onto a band that has `pixels_per_mm` pixels to the millimetre.
    ///
    /// # Errors
    /// If the marks cannot be painted.
    fn paint(&mut self, band: &mut Band, marks: &[Mark], pixels_per_mm: f64) -> Result<(), Self::Error>;

    /// Write the next rows of a PNG, three sRGB bytes a pixel. The host encodes PNG files itself.
    fn rows(&mut self, rgb: &[u8]) -> impl Future<Output = Result<(), Self::Error>>;

    /// Compress these bytes into a zlib stream.
    fn deflate(&mut self, bytes: &[u8]) -> impl Future<Output = Result<Vec<u8>, Self::Error>>;

    /// Append to the file.
    fn write(&mut self, bytes: &[u8]) -> impl Future<Output = Result<(), Self::Error>>;

    /// Replace the first bytes of the file, after everything has been appended.
    fn replace_head(&mut self, bytes: &[u8]) -> impl Future<Output = Result<(), Self::Error>>;

    /// Finish the file: everything has been written.
    fn end(&mut self) -> impl Future<Output = Result<(), Self::Error>>;

    /// Report that `rows` of `all` rows are done.
    fn report_progress(&mut self, rows: u32, all: u32);
}

/// A drawing of a model, checked and ready to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// Paper and scale.
    pub sheet: Sheet,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Everything on the sheet besides the model.
    pub layout: Layout,
    /// The place of a plan in the world, if it is known.
    pub georeference: Option<GeoReference>,
    title: String,
    format: Format,
    /// Middle of the model's box, world metres.
    middle: DVec3,
}

impl Drawing {
    /// A drawing of a model with this metadata and identity ([`kilwa_pack::footer::Footer::identity`]).
    ///
    /// # Errors
    /// If the paper is too small, or the picture would have too many pixels.
    pub fn new(model: &Metadata, identity: String, request: Request) -> Result<Self, SheetError> {
        let Request { view, scale, dpi, paper, bare, title, format } = request;
        let bounds: (DVec3, DVec3) = (model.bounds_min, model.bounds_max);
        let sheet = Sheet::new(view, bounds, (scale, dpi), paper.as_ref(), bare)?;
        let size = sheet.pixels()?;
        let title = Title {
            name: title,
            view,
            crs: model.crs.clone(),
            accuracy: model.capture_accuracy,
            identity,
            spacing: model.median_edge,
        };
        let layout = if bare { Layout::default() } else { Layout::of(&sheet, &title) };
        let georeference = GeoReference::of(&sheet, model.crs.as_deref());
        let middle = (bounds.0 + bounds.1) * 0.5;
        Ok(Self { sheet, size, layout, georeference, title: title.name, format, middle })
    }

    /// Draw and write the sheet, in parts at most `widest` pixels wide.
    ///
    /// # Errors
    /// Errors of the host, and [`SheetError::TooLong`].
    pub async fn draw<H: Host>(&self, widest: u32, host: &mut H) -> Result<Figures, H::Error> {
        let [width, height] = self.size;
        let georeference = self.georeference.clone();
        let mut writer = Writer::new(self.format, &self.sheet, &self.layout, &self.title, georeference)?;
        let mut figures = Figures::NONE;
        let rows = Sheet::band_rows(width);
        for top in (0..height).step_by(rows as usize) {
            let mut band = Band::new(width, top, rows.min(height - top));
            figures.add(&self.render(&mut band, widest, host).await?);
            // In a PDF, lines and letters are vectors and text, so they are not painted.
            if self.format != Format::Pdf && !self.layout.marks.is_empty() {
                host.paint(&mut band, &self.layout.marks, self.sheet.pixels_per_mm())?;
            }
            if let Some(writer) = &mut writer {
                let packed = host.deflate(&band.rgb).await?;
                host.write(&writer.strip(band.rows, packed.len() as u64)?).await?;
                host.write(&packed).await?;
            } else {
                host.rows(&band.rgb).await?;
            }
            host.report_progress(top + band.rows, height);
        }
        if let Some(writer) = writer {
            let Ending { tail, head } = writer.end()?;
            host.write(&tail).await?;
            if let Some(head) = head {
                host.replace_head(&head).await?;
            }
        }
        host.end().await?;
        Ok(figures)
    }

    /// Render all parts of a band.
    async fn render<H: Host>(&self, band: &mut Band, widest: u32, host: &mut H) -> Result<Figures, H::Error> {
        let mut figures = Figures::NONE;
        let parts = self.sheet.parts(self.size, band.top, band.rows, widest);
        let count = parts.len() as u32;
        for ((at, size), number) in parts.into_iter().zip(1..) {
            let Rendered { pixels, figures: more } = host.render(&self.sheet.part(self.middle, at, size), size).await?;
            band.put(at, size, &pixels);
            figures.add(&more);
            host.report_progress(band.top + band.rows * number / count, self.size[1]);
        }
        Ok(figures)
    }
}
