//! Drawings to scale for the page: a host for the loop over a drawing ([`kilwa_measure::sheet::draw`]), implemented in JavaScript (`www/measure/drawing.js`).

use crate::thrown;
use js_sys::{Array, Uint8Array};
use kilwa_measure::sheet::draw::{Band, Drawing, Figures, Host, Rendered, Request};
use kilwa_measure::sheet::file::Format;
use kilwa_measure::sheet::georeference::GeoReference;
use kilwa_measure::sheet::layout::Mark;
use kilwa_measure::sheet::paper::Paper;
use kilwa_measure::sheet::{Part, SheetError, View};
use kilwa_pack::Index;
use serde::Deserialize;
use serde_json::json;
use wasm_bindgen::prelude::{JsCast, JsValue, wasm_bindgen};

/// Widest part of a drawing, pixels.
const WIDEST: u32 = 2048;

#[wasm_bindgen]
extern "C" {
    /// The JavaScript side of a drawing. An exception ends the drawing.
    pub type SheetHost;

    /// `open` begins a file: its `size` in pixels, `pixelsPerMm`, and the `marks` to be painted (mm from the upper left corner), JSON. `rows` are the next rows
    /// of a PNG, `write` and `head` append to other files and replace their first bytes. `deflate` returns an `ArrayBuffer`.
    #[wasm_bindgen(method, catch)]
    async fn act(this: &SheetHost, action: &str, bytes: &[u8]) -> Result<JsValue, JsValue>;

    /// Render a part of the picture, given its middle, half of its height in metres, and its size in pixels. Returns its pixels (a `Uint8Array`), whether
    /// it is as fine as they are, its error in metres, and its number of triangles.
    #[wasm_bindgen(method, catch)]
    async fn part(
        this: &SheetHost,
        x: f64,
        y: f64,
        z: f64,
        half_height: f64,
        width: u32,
        height: u32,
    ) -> Result<JsValue, JsValue>;

    /// Paint the marks onto rows of the picture from `top`, in place.
    #[wasm_bindgen(method, catch)]
    fn paint(this: &SheetHost, rgb: &mut [u8], top: u32) -> Result<(), JsValue>;

    #[wasm_bindgen(method)]
    fn progress(this: &SheetHost, rows: u32, all: u32);
}

/// A JavaScript exception.
pub(crate) struct Thrown(pub(crate) JsValue);

impl From<SheetError> for Thrown {
    fn from(why: SheetError) -> Self {
        Self(thrown(&why))
    }
}

impl From<serde_json::Error> for Thrown {
    fn from(why: serde_json::Error) -> Self {
        SheetError::from(why).into()
    }
}

impl From<JsValue> for Thrown {
    fn from(why: JsValue) -> Self {
        Self(why)
    }
}

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
    /// `png`, `pdf` or `tif`.
    format: String,
    /// Widest part that the graphics card draws, pixels.
    widest: u32,
}

impl Asked {
    fn request(self) -> Result<Request, SheetError> {
        Ok(Request {
            view: View::from_name(&self.view).ok_or(SheetError::Oblique)?,
            scale: self.scale,
            dpi: self.dpi,
            paper: self.paper.as_deref().map(Paper::parse).transpose()?,
            bare: self.bare,
            title: self.title,
            format: Format::from_extension(&self.format).ok_or(SheetError::Asked(self.format))?,
        })
    }
}

/// Draw the sheet requested in JSON; returns JSON: `paper` in mm, `world` (the text of the world file; null for elevations), and `isFull`, whether all of it is
/// as fine as its pixels.
pub(crate) async fn draw(index: &Index, asked: &str, host: SheetHost) -> Result<String, Thrown> {
    let asked: Asked = serde_json::from_str(asked)?;
    let widest = asked.widest.clamp(64, WIDEST);
    let drawing = Drawing::new(index.metadata(), index.identity(), asked.request()?)?;
    let sheet = &drawing.sheet;
    let opened = json!({ "size": drawing.size, "pixelsPerMm": sheet.pixels_per_mm(), "marks": drawing.layout.marks });
    let mut page = Page(host);
    page.act("open", opened.to_string().as_bytes()).await?;
    let figures = drawing.draw(widest, &mut page).await?;
    let world = drawing.georeference.as_ref().map(GeoReference::world_file);
    Ok(json!({ "paper": sheet.paper, "world": world, "isFull": figures.target_reached }).to_string())
}

/// The host of a drawing, implemented in JavaScript.
struct Page(SheetHost);

impl Page {
    async fn act(&self, action: &str, bytes: &[u8]) -> Result<(), Thrown> {
        self.0.act(action, bytes).await?;
        Ok(())
    }
}

impl Host for Page {
    type Error = Thrown;

    async fn render(&mut self, part: &Part, size: [u32; 2]) -> Result<Rendered, Thrown> {
        let [x, y, z] = part.target.to_array();
        let rendered = self.0.part(x, y, z, part.half_height, size[0], size[1]).await?;
        let rendered: Array = rendered.dyn_into()?;
        let figures = Figures {
            target_reached: rendered.get(1).as_bool().unwrap_or(false),
            worst_error_metres: rendered.get(2).as_f64().unwrap_or(f64::NAN),
            triangles: rendered.get(3).as_f64().unwrap_or(0.0) as u64,
        };
        Ok(Rendered { pixels: Uint8Array::new(&rendered.get(0)).to_vec(), figures })
    }

    /// JavaScript has had the marks since the action `open`.
    fn paint(&mut self, band: &mut Band, _marks: &[Mark], _pixels_per_mm: f64) -> Result<(), Thrown> {
        Ok(self.0.paint(&mut band.rgb, band.top)?)
    }

    fn rows(&mut self, rgb: &[u8]) -> impl Future<Output = Result<(), Thrown>> {
        self.act("rows", rgb)
    }

    async fn deflate(&mut self, bytes: &[u8]) -> Result<Vec<u8>, Thrown> {
        Ok(Uint8Array::new(&self.0.act("deflate", bytes).await?).to_vec())
    }

    fn write(&mut self, bytes: &[u8]) -> impl Future<Output = Result<(), Thrown>> {
        self.act("write", bytes)
    }

    fn replace_head(&mut self, bytes: &[u8]) -> impl Future<Output = Result<(), Thrown>> {
        self.act("head", bytes)
    }

    /// The page finishes the file when it receives the answer of [`draw`].
    async fn end(&mut self) -> Result<(), Thrown> {
        Ok(())
    }

    fn report_progress(&mut self, rows: u32, all: u32) {
        self.0.progress(rows, all);
    }
}
