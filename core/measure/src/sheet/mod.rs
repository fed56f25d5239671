//! Drawings to scale, for `kilwa render --scale` and the page: the size of the sheet (`paper`), its contents in
//! millimetres (`layout`), the view of each part of the picture, its place in the world (`georeference`), the files around the picture (`file`,
//! `pdf`, `tiff`), and the loop that makes it all (`draw`).
//!
//! One pixel is exactly `25.4 mm / dpi × scale`; the picture's middle is that of the model's box. It is drawn part by part, so that memory does
//! not grow with the sheet.

pub mod draw;
pub mod file;
pub mod georeference;
pub mod layout;
pub mod letters;
pub mod paper;
mod pdf;
mod tiff;

use crate::message::{Message, MessageValue, ToMessage};
use glam::DVec3;
use layout::Frame;
use paper::Paper;
use thiserror::Error;

/// Which way a drawing looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// From above, north upwards.
    Plan,
    /// From the north.
    North,
    /// From the east.
    East,
    /// From the south.
    South,
    /// From the west.
    West,
}

impl View {
    /// By its name on the command line and in the page.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "plan" => Self::Plan,
            "north" => Self::North,
            "east" => Self::East,
            "south" => Self::South,
            "west" => Self::West,
            _ => return None,
        })
    }

    /// Which way its right and up point in the world.
    pub fn axes(self) -> [DVec3; 2] {
        let up = DVec3::Z;
        match self {
            Self::Plan => [DVec3::X, DVec3::Y],
            Self::South => [DVec3::X, up],
            Self::North => [DVec3::NEG_X, up],
            Self::East => [DVec3::Y, up],
            Self::West => [DVec3::NEG_Y, up],
        }
    }

    /// Smallest and largest coordinates of a box (its smallest and largest corner, metres) along the drawing's axes.
    pub fn extent(self, low: DVec3, high: DVec3) -> [(f64, f64); 2] {
        self.axes().map(|axis| {
            let (a, b) = (axis.dot(low), axis.dot(high));
            (a.min(b), a.max(b))
        })
    }
}

/// What a part of the picture looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// The point in its middle, world metres, in the middle of the box's depth.
    pub target: DVec3,
    /// Half of what it shows upwards, metres.
    pub half_height: f64,
}

/// Why there is no sheet.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SheetError {
    /// The paper is too small.
    #[error(
        "at 1:{scale} the model is {width:.0} x {height:.0} mm, more than the paper holds; {}use --paper fit",
        fits.map(|s| format!("1:{s} would fit, or ")).unwrap_or_default()
    )]
    TooLarge {
        /// The scale asked for.
        scale: f64,
        /// Of the drawing, mm.
        width: f64,
        /// Of the drawing, mm.
        height: f64,
        /// The usual scale that would fit.
        fits: Option<f64>,
    },
    /// Offsets of the form do not reach so far.
    #[error("the drawing is too large for this file format; choose fewer dots per inch, or another format")]
    TooLong,
    /// More pixels than anybody draws.
    #[error("{width:.0} x {height:.0} pixels are too many; choose a smaller scale, fewer dpi or other paper")]
    TooFine {
        /// Pixels.
        width: f64,
        /// Pixels.
        height: f64,
    },
    /// No scale.
    #[error("expected a scale such as 1:50, from 1:0.01 to 1:1000000")]
    Scale,
    /// Dots that nobody prints.
    #[error("from {} to {} dots per inch are possible", DPI.0, DPI.1)]
    Dots,
    /// A view without a scale.
    #[error("an oblique view has no scale; choose plan, north, east, south or west")]
    Oblique,
    /// No paper.
    #[error("A0, A1, A2, A3, A4, fit, or millimetres such as 900x600")]
    NoPaper,
    /// Not asked as it should be.
    #[error("the settings of the drawing are invalid: {0}")]
    Asked(String),
}

impl From<serde_json::Error> for SheetError {
    fn from(e: serde_json::Error) -> Self {
        Self::Asked(e.to_string())
    }
}

impl ToMessage for SheetError {
    fn message(&self) -> Message {
        let number = |name, value: f64| (name, MessageValue::Number(value));
        let count = |name, value: f64| (name, MessageValue::Count(value.round() as u64));
        match *self {
            Self::TooLarge { scale, width, height, fits: Some(fits) } => Message::new(
                "sheet-too-large-fits",
                [number("scale", scale), count("width", width), count("height", height), number("fits", fits)],
            ),
            Self::TooLarge { scale, width, height, fits: None } => Message::new(
                "sheet-too-large",
                [number("scale", scale), count("width", width), count("height", height)],
            ),
            Self::TooLong => Message::new("sheet-too-long", []),
            Self::TooFine { width, height } => {
                Message::new("sheet-too-fine", [count("width", width), count("height", height)])
            }
            Self::Scale => Message::new("sheet-no-scale", []),
            Self::Dots => Message::new(
                "sheet-dots",
                [("low", MessageValue::Count(DPI.0.into())), ("high", MessageValue::Count(DPI.1.into()))],
            ),
            Self::Oblique => Message::new("sheet-oblique", []),
            Self::NoPaper => Message::new("sheet-no-paper", []),
            Self::Asked(_) => Message::new("asked-wrong", []),
        }
    }
}

/// Least and most dots per inch.
pub const DPI: (u32, u32) = (25, 2400);
/// Least and most of the `n` of a scale of 1:n.
pub const SCALE: (f64, f64) = (0.01, 1e6);

/// Most rows of a band.
const BAND_ROWS: u32 = 1024;
/// Bytes of a band at most, as far as a row is less; four a pixel.
const BAND_BYTES: u32 = 64 << 20;

/// Pixels of a drawing at most: 2^36 are a sheet of 22 m at 300 dpi.
const MAX_PIXELS: u64 = 1 << 36;

/// Paper, scale and what lies in its middle.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Which drawing.
    pub view: View,
    /// Width and height, mm.
    pub paper: [f64; 2],
    /// Where the picture is.
    pub frame: Frame,
    /// 50 for 1:50.
    pub scale: f64,
    /// Dots per inch.
    pub dpi: u32,
    /// World coordinates (along the drawing's axes) of the middle of the frame.
    pub middle: [f64; 2],
}

impl Sheet {
    /// The sheet of a view of all of the model, whose box has these corners; without paper the smallest from A4 to A0 that holds it. `bare`: nothing but the model.
    ///
    /// # Errors
    /// [`SheetError`].
    pub fn new(
        view: View,
        (low, high): (DVec3, DVec3),
        (scale, dpi): (f64, u32),
        paper: Option<&Paper>,
        bare: bool,
    ) -> Result<Self, SheetError> {
        if !(SCALE.0..=SCALE.1).contains(&scale) {
            return Err(SheetError::Scale);
        }
        if !(DPI.0..=DPI.1).contains(&dpi) {
            return Err(SheetError::Dots);
        }
        let extent = view.extent(low, high);
        let content = extent.map(|(low, high)| (high - low) * 1000.0 / scale);
        let (paper, frame) = paper::choose(paper, content, bare, scale)?;
        let middle = extent.map(|(low, high)| f64::midpoint(low, high));
        Ok(Self { view, paper, frame, scale, dpi, middle })
    }

    /// What a pixel shows.
    pub fn metres_per_pixel(&self) -> f64 {
        0.0254 / f64::from(self.dpi) * self.scale
    }

    /// Pixels in a millimetre of paper.
    pub fn pixels_per_mm(&self) -> f64 {
        f64::from(self.dpi) / 25.4
    }

    /// Its width and height in pixels.
    ///
    /// # Errors
    /// [`SheetError::TooFine`].
    pub fn pixels(&self) -> Result<[u32; 2], SheetError> {
        let [width, height] = self.paper.map(|mm| (mm * self.pixels_per_mm()).round().max(1.0));
        if width > 1e6 || height > 1e6 || width * height > MAX_PIXELS as f64 {
            return Err(SheetError::TooFine { width, height });
        }
        Ok([width as u32, height as u32])
    }

    /// Rows that are drawn and written at a time in a picture so many pixels wide, so that memory does not grow with it.
    pub fn band_rows(width: u32) -> u32 {
        (BAND_BYTES / 4 / width.max(1)).clamp(1, BAND_ROWS)
    }

    /// The parts of the picture in some rows of it, so wide at most: left upper pixel and size, where the frame is.
    pub fn parts(&self, size: [u32; 2], top: u32, rows: u32, widest: u32) -> Vec<([u32; 2], [u32; 2])> {
        let [left, upper, right, lower] = self.window(size);
        let (from, to) = (top.max(upper), (top + rows).min(lower));
        let across = (left..right).step_by(widest.max(1) as usize).filter(|_| from < to);
        across.map(|x| ([x, from], [widest.min(right - x), to - from])).collect()
    }

    /// Left, top, right, bottom of the frame in whole pixels of a picture of this size.
    pub fn window(&self, size: [u32; 2]) -> [u32; 4] {
        let (f, scale) = (self.frame, self.pixels_per_mm());
        let pixel = |mm: f64, max: u32| ((mm * scale).round().max(0.0) as u32).min(max);
        let [width, height] = size;
        [pixel(f.left, width), pixel(f.top, height), pixel(f.left + f.width, width), pixel(f.top + f.height, height)]
    }

    /// World coordinates of the sheet's upper left corner.
    pub fn corner(&self) -> [f64; 2] {
        let per_mm = self.scale / 1000.0;
        let centre = self.frame.middle();
        [self.middle[0] - centre[0] * per_mm, self.middle[1] + centre[1] * per_mm]
    }

    /// What a part of the picture looks at: its left upper pixel and its size; `middle` is that of the model's box.
    pub fn part(&self, middle: DVec3, at: [u32; 2], size: [u32; 2]) -> Part {
        let (pixel, corner) = (self.metres_per_pixel(), self.corner());
        let centre = [
            corner[0] + (f64::from(at[0]) + f64::from(size[0]) * 0.5) * pixel,
            corner[1] - (f64::from(at[1]) + f64::from(size[1]) * 0.5) * pixel,
        ];
        let axes = self.view.axes();
        let shift = [centre[0] - axes[0].dot(middle), centre[1] - axes[1].dot(middle)];
        let target = middle + axes[0] * shift[0] + axes[1] * shift[1];
        Part { target, half_height: f64::from(size[1]) * pixel * 0.5 }
    }
}
