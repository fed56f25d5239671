//! PDF 1.4: one page of the paper's size; the picture as deflated strips, written as they come; lines and letters as such, in Helvetica,
//! so that they are sharp and can be selected and searched. Source: ISO 32000-1.

use super::layout::{Anchor, Layout, Mark};
use super::{Next, Sheet};
use anyhow::Context;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};

/// Points of PDF in a millimetre.
const POINTS: f64 = 72.0 / 25.4;
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

/// Writes objects and remembers where they begin.
struct Objects<W: Write> {
    out: W,
    at: u64,
    /// Offset of each object, by number from 1.
    offsets: Vec<u64>,
}

impl<W: Write> Objects<W> {
    fn bytes(&mut self, bytes: &[u8]) -> anyhow::Result<()> {
        self.out.write_all(bytes).context("cannot write the PDF")?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// A new object; its number.
    fn object(&mut self, body: &[u8]) -> anyhow::Result<usize> {
        self.offsets.push(self.at);
        let number = self.offsets.len();
        self.bytes(format!("{number} 0 obj\n").as_bytes())?;
        self.bytes(body)?;
        self.bytes(b"\nendobj\n")?;
        Ok(number)
    }

    /// A deflated stream with further entries of its dictionary.
    fn stream(&mut self, entries: &str, content: &[u8]) -> anyhow::Result<usize> {
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        packed.write_all(content)?;
        let packed = packed.finish()?;
        let mut body = format!("<< {entries} /Filter /FlateDecode /Length {} >>\nstream\n", packed.len()).into_bytes();
        body.extend(packed);
        body.extend(b"\nendstream");
        self.object(&body)
    }
}

pub(super) fn write(
    file: &mut File,
    sheet: &Sheet,
    size: [u32; 2],
    layout: &Layout,
    title: &str,
    next: Next<'_>,
) -> anyhow::Result<()> {
    let mut pdf = Objects { out: BufWriter::new(file), at: 0, offsets: Vec::new() };
    // Bytes above 127 tell programs that copy files that this is no text.
    pdf.bytes(b"%PDF-1.4\n%\xE2\xE3\xCF\xD3\n")?;
    let page = sheet.paper.map(|mm| mm * POINTS);
    let dot = 72.0 / f64::from(sheet.dpi);
    let (mut content, mut images, mut row) = (String::new(), String::new(), 0u32);
    while let Some(rows) = next()? {
        let count = (rows.len() / (size[0] as usize * 3)) as u32;
        let entries = format!(
            "/Type /XObject /Subtype /Image /Width {} /Height {count} /ColorSpace /DeviceRGB /BitsPerComponent 8",
            size[0]
        );
        let number = pdf.stream(&entries, &rows)?;
        let _ = write!(images, "/B{row} {number} 0 R ");
        let bottom = page[1] - f64::from(row + count) * dot;
        let (w, h) = (f64::from(size[0]) * dot, f64::from(count) * dot);
        let _ = writeln!(content, "q {w:.5} 0 0 {h:.5} 0 {bottom:.5} cm /B{row} Do Q");
        row += count;
    }
    for mark in &layout.marks {
        draw(&mut content, mark, page[1]);
    }
    let content = pdf.stream("", content.as_bytes())?;
    let font = pdf.object(b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>")?;
    let parent = pdf.offsets.len() + 2;
    let one = pdf.object(
        format!(
            "<< /Type /Page /Parent {parent} 0 R /MediaBox [0 0 {:.4} {:.4}] /Contents {content} 0 R \
             /Resources << /Font << /F {font} 0 R >> /XObject << {images}>> >> >>",
            page[0], page[1]
        )
        .as_bytes(),
    )?;
    let pages = pdf.object(format!("<< /Type /Pages /Kids [{one} 0 R] /Count 1 >>").as_bytes())?;
    let catalog = pdf.object(format!("<< /Type /Catalog /Pages {pages} 0 R >>").as_bytes())?;
    // A title in UTF-16 holds every script.
    let units: String = title.encode_utf16().fold("FEFF".to_owned(), |mut hex, unit| {
        let _ = write!(hex, "{unit:04X}");
        hex
    });
    let producer = concat!("Kilwa ", env!("CARGO_PKG_VERSION"));
    let info = pdf.object(format!("<< /Title <{units}> /Producer ({producer}) >>").as_bytes())?;
    let table = pdf.at;
    let mut tail = format!("xref\n0 {}\n0000000000 65535 f \n", pdf.offsets.len() + 1);
    for offset in &pdf.offsets {
        let _ = writeln!(tail, "{offset:010} 00000 n ");
    }
    let size = pdf.offsets.len() + 1;
    let _ =
        write!(tail, "trailer\n<< /Size {size} /Root {catalog} 0 R /Info {info} 0 R >>\nstartxref\n{table}\n%%EOF\n");
    anyhow::ensure!(table < 10_000_000_000, "the drawing is too large for a PDF; choose fewer dpi, or a TIFF");
    pdf.bytes(tail.as_bytes())?;
    pdf.out.flush().context("cannot write the PDF")
}

/// One mark; PDF counts up from the lower edge.
fn draw(out: &mut String, mark: &Mark, height: f64) {
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
            // WinAnsi has what Latin 1 has; other scripts stand in the document's title and in the pack.
            let bytes: Vec<u8> =
                words.chars().map(|c| if (' '..='\u{ff}').contains(&c) { c as u8 } else { b'?' }).collect();
            let wide = |b: &u8| f64::from(WIDTHS.get(usize::from(*b).wrapping_sub(32)).copied().unwrap_or(556));
            let width = bytes.iter().map(wide).sum::<f64>() * size / 1000.0;
            let left = match anchor {
                Anchor::Start => x,
                Anchor::Middle => x - width * 0.5,
                Anchor::End => x - width,
            };
            let hex: String = bytes.iter().fold(String::new(), |mut hex, b| {
                let _ = write!(hex, "{b:02X}");
                hex
            });
            let _ = writeln!(out, "0 g BT /F {size:.4} Tf {left:.4} {y:.4} Td <{hex}> Tj ET");
        }
    }
}
