//! PDF 1.4: one page of the paper's size; the picture as deflated strips, which go to the file as they come; lines and letters as
//! such, in Helvetica, so that they are sharp and can be selected and searched. The font is named `F` in the page's resources; `G` is the font of
//! [`Letters`], whose objects begin the file.
//! Source: ISO 32000-1.

use super::file::Ending;
use super::layout::{Anchor, Layout, Mark};
use super::letters::{Letters, is_plain};
use super::{Sheet, SheetError};
use std::fmt::Write as _;

/// Points of PDF in a millimetre.
const POINTS: f64 = 72.0 / 25.4;
/// Offsets in a PDF have ten digits.
const LONGEST: u64 = 10_000_000_000;
const STREAM_END: &str = "\nendstream\nendobj\n";
/// Height of Helvetica's capitals for a size of 1.
const CAPITAL: f64 = 0.718;
/// Widths of Helvetica's signs from space to tilde, thousandths of the size (Adobe's font metrics).
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833,
    722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556,
    556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334,
    260, 334, 584,
];

/// All marks, on a page of this height in points.
fn operators(layout: &Layout, height: f64) -> String {
    let mut out = String::new();
    for mark in &layout.marks {
        draw(&mut out, mark, height, &layout.letters);
    }
    out
}

/// One mark; PDF counts up from the lower edge.
fn draw(out: &mut String, mark: &Mark, height: f64, letters: &Letters) {
    let at = |p: &[f64; 2]| [p[0] * POINTS, height - p[1] * POINTS];
    match mark {
        Mark::Box { at: corner, size, grey } => {
            let [x, y] = at(corner);
            let [w, h] = size.map(|mm| mm * POINTS);
            let _ = writeln!(out, "{grey} g {x:.4} {:.4} {w:.4} {h:.4} re f", y - h);
        }
        Mark::Triangle { corners, grey } => {
            let [a, b, c] = corners.map(|p| at(&p));
            let _ = writeln!(
                out,
                "{grey} g {:.4} {:.4} m {:.4} {:.4} l {:.4} {:.4} l h f",
                a[0], a[1], b[0], b[1], c[0], c[1]
            );
        }
        Mark::Text { at: base, height: capital, anchor, words } => {
            let size = capital * POINTS / CAPITAL;
            let [x, y] = at(base);
            let left = |width: f64| match anchor {
                Anchor::Start => x,
                Anchor::Middle => x - width * 0.5,
                Anchor::End => x - width,
            };
            if let Some(line) = letters.lines.get(words) {
                let left = left(line.width * size);
                let _ =
                    writeln!(out, "0 g BT /G 1 Tf {size:.4} 0 0 {size:.4} {left:.4} {y:.4} Tm\n{}\nET", line.operators);
                return;
            }
            // Other scripts still stand in the document's title and in the pack.
            let bytes: Vec<u8> = words.chars().map(|c| if is_plain(c) { c as u8 } else { b'?' }).collect();
            let wide = |b: &u8| f64::from(WIDTHS.get(usize::from(*b).wrapping_sub(32)).copied().unwrap_or(556));
            let width = bytes.iter().map(wide).sum::<f64>() * size / 1000.0;
            let left = left(width);
            let hex: String = bytes.iter().fold(String::new(), |mut hex, b| {
                let _ = write!(hex, "{b:02X}");
                hex
            });
            let _ = writeln!(out, "0 g BT /F {size:.4} Tf {left:.4} {y:.4} Td <{hex}> Tj ET");
        }
    }
}

/// What is known of a file whose strips are being written: objects and where they begin.
#[derive(Debug, Clone)]
pub(super) struct Pdf {
    /// Width and height of the page, points.
    page: [f64; 2],
    /// Points of a pixel.
    dot: f64,
    /// Pixels of a row.
    width: u32,
    /// The title in UTF-16 as hexadecimal digits.
    title: String,
    /// What the file begins with.
    head: Vec<u8>,
    /// Whether that is followed by a font, the first object.
    has_letters: bool,
    /// The marks as operators.
    marks: String,
    /// Operators that place the strips.
    content: String,
    /// The strips by name, for the page's resources.
    images: String,
    /// Rows so far.
    row: u32,
    /// Bytes so far.
    at: u64,
    /// Offset of each object, by number from 1.
    offsets: Vec<u64>,
}

impl Pdf {
    pub(super) fn new(sheet: &Sheet, width: u32, layout: &Layout, title: &str) -> Self {
        let page = sheet.paper.map(|mm| mm * POINTS);
        // A title in UTF-16 holds every script.
        let title = title.encode_utf16().fold("FEFF".to_owned(), |mut hex, unit| {
            let _ = write!(hex, "{unit:04X}");
            hex
        });
        let dot = 72.0 / f64::from(sheet.dpi);
        let marks = operators(layout, page[1]);
        // Bytes above 127 show programs that copy files that this is not text.
        let (mut head, mut offsets) = (b"%PDF-1.4\n%\xE2\xE3\xCF\xD3\n".to_vec(), Vec::new());
        for object in &layout.letters.objects {
            offsets.push(head.len() as u64);
            head.extend(object);
        }
        let (content, images) = (String::new(), String::new());
        let has_letters = !offsets.is_empty();
        Self { page, dot, width, title, head, has_letters, marks, content, images, row: 0, at: 0, offsets }
    }

    /// What stands before a new object: the file's head, or the end of the strip before.
    fn before(&self) -> Vec<u8> {
        if self.at == 0 { self.head.clone() } else { STREAM_END.as_bytes().to_vec() }
    }

    /// What stands before the next strip.
    pub(super) fn strip(&mut self, rows: u32, length: u64) -> Vec<u8> {
        let mut out = self.before();
        self.offsets.push(self.at + out.len() as u64);
        let number = self.offsets.len();
        out.extend(
            format!(
                "{number} 0 obj\n<< /Type /XObject /Subtype /Image /Width {} /Height {rows} /ColorSpace /DeviceRGB \
                 /BitsPerComponent 8 /Filter /FlateDecode /Length {length} >>\nstream\n",
                self.width
            )
            .bytes(),
        );
        let name = self.row;
        let _ = write!(self.images, "/B{name} {number} 0 R ");
        let bottom = self.page[1] - f64::from(self.row + rows) * self.dot;
        let (w, h) = (f64::from(self.width) * self.dot, f64::from(rows) * self.dot);
        let _ = writeln!(self.content, "q {w:.5} 0 0 {h:.5} 0 {bottom:.5} cm /B{name} Do Q");
        self.row += rows;
        self.at += out.len() as u64 + length;
        out
    }

    /// Everything but the strips.
    pub(super) fn end(mut self) -> Result<Ending, SheetError> {
        let mut out = self.before();
        let mut object = |out: &mut Vec<u8>, body: &str| {
            self.offsets.push(self.at + out.len() as u64);
            let number = self.offsets.len();
            out.extend(format!("{number} 0 obj\n{body}\nendobj\n").bytes());
            number
        };
        let content = format!("{}{}", self.content, self.marks);
        let content = object(&mut out, &format!("<< /Length {} >>\nstream\n{content}\nendstream", content.len()));
        let font =
            object(&mut out, "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>");
        let parent = font + 2;
        let letters = if self.has_letters { " /G 1 0 R" } else { "" };
        let page = format!(
            "<< /Type /Page /Parent {parent} 0 R /MediaBox [0 0 {:.4} {:.4}] /Contents {content} 0 R /Resources << /Font << /F \
             {font} 0 R{letters} >> /XObject << {}>> >> >>",
            self.page[0], self.page[1], self.images
        );
        let one = object(&mut out, &page);
        let pages = object(&mut out, &format!("<< /Type /Pages /Kids [{one} 0 R] /Count 1 >>"));
        let catalog = object(&mut out, &format!("<< /Type /Catalog /Pages {pages} 0 R >>"));
        let producer = concat!("Kilwa ", env!("CARGO_PKG_VERSION"));
        let info = object(&mut out, &format!("<< /Title <{}> /Producer ({producer}) >>", self.title));
        let table = self.at + out.len() as u64;
        if table >= LONGEST {
            return Err(SheetError::TooLong);
        }
        let size = self.offsets.len() + 1;
        let mut end = format!("xref\n0 {size}\n0000000000 65535 f \n");
        for offset in &self.offsets {
            let _ = writeln!(end, "{offset:010} 00000 n ");
        }
        let _ = write!(
            end,
            "trailer\n<< /Size {size} /Root {catalog} 0 R /Info {info} 0 R >>\nstartxref\n{table}\n%%EOF\n"
        );
        out.extend(end.bytes());
        Ok(Ending { tail: out, head: None })
    }
}
