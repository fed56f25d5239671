//! Drawings to scale, as the page asks for them ([`kilwa_measure::sheet`]): the page draws and deflates band by band, here is what each part looks at
//! and what stands between the bands in the file.

use glam::DVec3;
use kilwa_measure::sheet::file::{Ending, Form, Writer};
use kilwa_measure::sheet::georeference::GeoReference;
use kilwa_measure::sheet::layout::{Layout, Title};
use kilwa_measure::sheet::paper::Paper;
use kilwa_measure::sheet::{Sheet, SheetError, View};
use kilwa_pack::Index;
use serde::Deserialize;
use serde_json::{Value, json};

/// Widest part of a drawing, pixels.
const WIDEST: u32 = 2048;

/// What the page asks for.
#[derive(Debug, Deserialize)]
struct Asked {
    view: String,
    scale: f64,
    dpi: u32,
    #[serde(default)]
    paper: Option<String>,
    #[serde(default)]
    bare: bool,
    title: String,
    /// `png`, `pdf` or `tif`; PNG is written by the page.
    format: String,
    /// Widest part that the graphics card draws, pixels.
    widest: u32,
}

/// A drawing that is being made.
#[derive(Debug)]
pub struct SheetFile {
    sheet: Sheet,
    size: [u32; 2],
    layout: Layout,
    /// Middle of the model's box, world metres.
    middle: DVec3,
    widest: u32,
    place: Option<GeoReference>,
    writer: Option<Writer>,
}

impl SheetFile {
    /// What is asked for, JSON.
    ///
    /// # Errors
    /// Where the paper is too small or something cannot be.
    pub fn new(index: &Index, asked: &str) -> Result<Self, SheetError> {
        let asked: Asked = serde_json::from_str(asked)?;
        let form = match asked.format.as_str() {
            "pdf" => Some(Form::Pdf),
            "tif" => Some(Form::Tiff),
            _ => None,
        };
        let view = View::from_name(&asked.view).ok_or(SheetError::Oblique)?;
        let paper = asked.paper.as_deref().map(Paper::parse).transpose()?;
        let m = index.metadata();
        let bounds = (m.bounds_min, m.bounds_max);
        let sheet = Sheet::new(view, bounds, (asked.scale, asked.dpi), paper.as_ref(), asked.bare)?;
        let size = sheet.pixels()?;
        let title = Title {
            name: asked.title,
            view,
            crs: m.crs.clone(),
            accuracy: m.capture_accuracy,
            identity: index.identity(),
            spacing: m.median_edge,
        };
        let layout = if asked.bare { Layout::default() } else { Layout::of(&sheet, &title) };
        let middle = DVec3::from([0, 1, 2].map(|k| f64::midpoint(m.bounds_min[k], m.bounds_max[k])));
        let place = GeoReference::of(&sheet, m.crs.as_deref());
        let writer = form.map(|f| Writer::new(f, &sheet, &layout, &title.name, place.clone())).transpose()?;
        let widest = asked.widest.clamp(64, WIDEST);
        Ok(Self { sheet, size, layout, middle, widest, place, writer })
    }

    /// `size` in pixels, `paper` in mm, `pixelsPerMm`, `metresPerPixel`, `marks` (mm from the upper left corner), how many `bands`, `world` (the text of the world
    /// file; null for elevations).
    pub fn description(&self) -> Value {
        json!({
            "size": self.size,
            "paper": self.sheet.paper,
            "pixelsPerMm": self.sheet.pixels_per_mm(),
            "metresPerPixel": self.sheet.metres_per_pixel(),
            "marks": self.layout.marks,
            "bands": self.size[1].div_ceil(Sheet::band_rows(self.size[0])),
            "world": self.place.as_ref().map(GeoReference::world_file),
        })
    }

    /// A band of the picture: `top`, `rows`, and `parts` (x, y, width, height in pixels, target, halfHeight in metres).
    pub fn band(&self, number: u32) -> Value {
        let rows = Sheet::band_rows(self.size[0]);
        let top = number.saturating_mul(rows).min(self.size[1]);
        let rows = rows.min(self.size[1] - top);
        let parts = self.sheet.parts(self.size, top, rows, self.widest).into_iter().map(|(at, size)| {
            let part = self.sheet.part(self.middle, at, size);
            json!({
                "x": at[0], "y": at[1], "width": size[0], "height": size[1],
                "target": part.target, "halfHeight": part.half_height,
            })
        });
        json!({ "top": top, "rows": rows, "parts": parts.collect::<Vec<Value>>() })
    }

    /// What stands in the file before the next band: so many rows, deflated to so many bytes.
    ///
    /// # Errors
    /// Where the file would be too long.
    pub fn strip(&mut self, rows: u32, length: u64) -> Result<Vec<u8>, SheetError> {
        self.writer.as_mut().map_or(Ok(Vec::new()), |w| w.strip(rows, length))
    }

    /// What follows the last band.
    ///
    /// # Errors
    /// As [`Self::strip`].
    pub fn end(&mut self) -> Result<Ending, SheetError> {
        self.writer.take().map_or(Ok(Ending { tail: Vec::new(), head: None }), Writer::end)
    }
}
