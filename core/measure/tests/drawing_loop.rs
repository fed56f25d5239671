//! The loop over a drawing with a fake host that only records its calls.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use kilwa_measure::sheet::draw::{Band, Drawing, Figures, Host, Rendered, Request};
use kilwa_measure::sheet::file::Format;
use kilwa_measure::sheet::layout::Mark;
use kilwa_measure::sheet::paper::Paper;
use kilwa_measure::sheet::{Part, SheetError, View};
use kilwa_pack::Metadata;
use std::io::Write;
use std::pin::pin;
use std::task::{Context, Poll, Waker};
use tiff::decoder::{Decoder, DecodingResult};

/// Every part has its own color; the first byte of a band shows that marks were painted.
#[derive(Default)]
struct Fake {
    parts: Vec<(Part, [u32; 2])>,
    bands: Vec<u32>,
    rows: Vec<u8>,
    file: Vec<u8>,
    progress: Vec<(u32, u32)>,
    ended: bool,
    /// Which part cannot be rendered.
    fails_at: Option<usize>,
}

#[derive(Debug, PartialEq)]
enum Failure {
    Sheet(SheetError),
    Render,
}

impl From<SheetError> for Failure {
    fn from(why: SheetError) -> Self {
        Self::Sheet(why)
    }
}

fn color(part: usize) -> [u8; 3] {
    [part as u8 + 1, 100, 200]
}

impl Host for Fake {
    type Error = Failure;

    async fn render(&mut self, part: &Part, size: [u32; 2]) -> Result<Rendered, Failure> {
        if self.fails_at == Some(self.parts.len()) {
            return Err(Failure::Render);
        }
        let [r, g, b] = color(self.parts.len());
        self.parts.push((*part, size));
        let figures = Figures {
            worst_error_metres: if self.parts.len() == 2 { 0.5 } else { f64::INFINITY },
            triangles: 10,
            target_reached: self.parts.len() != 3,
        };
        Ok(Rendered { pixels: [r, g, b, 255].repeat((size[0] * size[1]) as usize), figures })
    }

    fn paint(&mut self, band: &mut Band, marks: &[Mark], pixels_per_mm: f64) -> Result<(), Failure> {
        assert!(!marks.is_empty() && pixels_per_mm > 0.0);
        self.bands.push(band.top);
        band.rgb[0] = 0;
        Ok(())
    }

    async fn rows(&mut self, rgb: &[u8]) -> Result<(), Failure> {
        self.rows.extend(rgb);
        Ok(())
    }

    async fn deflate(&mut self, bytes: &[u8]) -> Result<Vec<u8>, Failure> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(bytes).expect("memory");
        Ok(encoder.finish().expect("memory"))
    }

    async fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.file.extend(bytes);
        Ok(())
    }

    async fn replace_head(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.file[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    async fn end(&mut self) -> Result<(), Failure> {
        self.ended = true;
        Ok(())
    }

    fn report_progress(&mut self, rows: u32, all: u32) {
        self.progress.push((rows, all));
    }
}

/// A host that never waits is done at once.
fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(done) => done,
        Poll::Pending => panic!("something waits"),
    }
}

/// A plan of a model of 6 m by 4 m at 1:10 and 100 dpi on paper of 700 mm by 500 mm: 2756 pixels by 1969, two bands.
fn drawing(format: Format, bare: bool) -> Drawing {
    let model: Metadata = serde_json::from_value(serde_json::json!({
        "title": "", "source_units": "m", "source_up": "z", "crs": "EPSG:32737", "lattice_step": 0.001,
        "bounds_min": [10.0, 20.0, 0.0], "bounds_max": [16.0, 24.0, 1.0], "median_edge": 0.01,
        "triangles": 1, "vertices": 3, "border_edges": 3, "sources": [], "tool": "", "options": {}, "repairs": {},
    }))
    .expect("a description");
    let paper = Some(Paper::Custom([700.0, 500.0]));
    let request = Request { view: View::Plan, scale: 10.0, dpi: 100, paper, bare, title: "Gereza".into(), format };
    Drawing::new(&model, "b3".into(), request).expect("it fits")
}

/// The picture that the parts make, on white.
fn expected(drawing: &Drawing, host: &Fake, is_painted: bool) -> Vec<u8> {
    let [width, height] = drawing.size;
    let [left, top, right, bottom] = drawing.sheet.window(drawing.size);
    let mut rgb = vec![255; (width * height * 3) as usize];
    // Parts are 1000 pixels wide, bands 1024 rows high.
    let across = (right - left).div_ceil(1000);
    for y in top..bottom {
        for x in left..right {
            let part = (y / 1024) * across + (x - left) / 1000;
            let at = ((y * width + x) * 3) as usize;
            rgb[at..at + 3].copy_from_slice(&color(part as usize));
        }
    }
    for top in &host.bands {
        assert!(is_painted);
        rgb[(top * width * 3) as usize] = 0;
    }
    rgb
}

#[test]
fn parts_fill_the_frame_and_rows_come_in_order() {
    let drawing = drawing(Format::Png, false);
    let mut host = Fake::default();
    let figures = now(drawing.draw(1000, &mut host)).expect("nothing fails");
    assert_eq!(drawing.size, [2756, 1969]);
    assert_eq!(host.bands, [0, 1024]);
    assert!(host.rows == expected(&drawing, &host, true), "other pixels");
    assert!(host.ended && host.file.is_empty());
    // Errors that are unknown do not count, triangles add up, and one coarse part is enough.
    let parts = host.parts.len();
    assert_eq!(parts, 6);
    assert_eq!(figures, Figures { worst_error_metres: 0.5, triangles: 60, target_reached: false });
    assert!(host.progress.windows(2).all(|p| p[0].0 <= p[1].0), "{:?}", host.progress);
    assert_eq!(host.progress.last(), Some(&(1969, 1969)));
    // The parts' middles, weighted with their areas, are the middle of the model.
    let area = |size: &[u32; 2]| f64::from(size[0]) * f64::from(size[1]);
    let all: f64 = host.parts.iter().map(|(_, size)| area(size)).sum();
    let middle = host.parts.iter().map(|(part, size)| part.target * (area(size) / all)).sum::<glam::DVec3>();
    assert!((middle - glam::DVec3::new(13.0, 22.0, 0.5)).length() < 0.02, "{middle}");
}

#[test]
fn a_tiff_is_the_same_picture_in_strips() {
    let drawing = drawing(Format::Tiff, true);
    let mut host = Fake::default();
    now(drawing.draw(1000, &mut host)).expect("nothing fails");
    let mut decoder = Decoder::new(std::io::Cursor::new(&host.file)).expect("a TIFF");
    assert_eq!(decoder.dimensions().expect("there"), (2756, 1969));
    let DecodingResult::U8(pixels) = decoder.read_image().expect("sound") else { panic!("bytes") };
    assert!(pixels == expected(&drawing, &host, false), "other pixels");
    assert!(host.ended && host.rows.is_empty());
}

#[test]
fn the_page_of_a_pdf_is_not_painted_and_a_failure_ends_the_drawing() {
    let drawing = drawing(Format::Pdf, false);
    let mut host = Fake::default();
    now(drawing.draw(1000, &mut host)).expect("nothing fails");
    assert!(host.bands.is_empty() && host.file.starts_with(b"%PDF-1.4") && host.file.ends_with(b"%%EOF\n"));
    let mut host = Fake { fails_at: Some(4), ..Fake::default() };
    assert_eq!(now(drawing.draw(1000, &mut host)), Err(Failure::Render));
    assert!(!host.ended && host.parts.len() == 4);
}
