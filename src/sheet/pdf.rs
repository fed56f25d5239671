//! PDF 1.4: one page of the paper's size; the picture as deflated strips, written as they come; lines and letters as such, in Helvetica,
//! so that they are sharp and can be selected and searched. Source: ISO 32000-1.

use super::Next;
use anyhow::Context;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use kilwa_measure::sheet::Sheet;
use kilwa_measure::sheet::layout::Layout;
use kilwa_measure::sheet::pdf::{POINTS, operators};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};

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
    content.push_str(&operators(layout, page[1]));
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
