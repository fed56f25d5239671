//! A drawing as a file, for whoever deflates and writes: what stands before each strip of the picture and what follows the last. The strips
//! themselves (zlib streams of whole rows, three sRGB bytes a pixel) never come here, so that nothing grows with the sheet.

use super::georeference::GeoReference;
use super::layout::Layout;
use super::pdf::Pdf;
use super::tiff::Tiff;
use super::{Sheet, SheetError};

/// Formats of drawings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A picture without a georeference; the host writes it.
    Png,
    /// One page of the paper's size, lines and letters as such.
    Pdf,
    /// A picture; of a plan a GeoTIFF.
    Tiff,
}

impl Format {
    /// The format with this file extension, which is given without the dot and in lower case.
    pub fn from_extension(extension: &str) -> Option<Self> {
        Some(match extension {
            "png" => Self::Png,
            "pdf" => Self::Pdf,
            "tif" | "tiff" => Self::Tiff,
            _ => return None,
        })
    }
}

/// What ends a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ending {
    /// What follows the last strip.
    pub tail: Vec<u8>,
    /// What replaces the first bytes of the file, where it says something that only the end knows.
    pub head: Option<Vec<u8>>,
}

/// A file that is being written.
#[derive(Debug, Clone)]
pub struct Writer(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Pdf(Pdf),
    Tiff(Tiff),
}

impl Writer {
    /// A writer for this sheet. `layout` and `title` are for a PDF; in other formats they are part of the picture. `None` for a PNG, which is
    /// not made of strips.
    ///
    /// # Errors
    /// [`SheetError::TooFine`].
    pub fn new(
        format: Format,
        sheet: &Sheet,
        layout: &Layout,
        title: &str,
        place: Option<GeoReference>,
    ) -> Result<Option<Self>, SheetError> {
        let size = sheet.pixels()?;
        Ok(match format {
            Format::Png => None,
            Format::Pdf => Some(Self(Kind::Pdf(Pdf::new(sheet, size[0], layout, title)))),
            Format::Tiff => Some(Self(Kind::Tiff(Tiff::new(size, sheet.dpi, Sheet::band_rows(size[0]), place)))),
        })
    }

    /// What stands before the next strip: so many rows, deflated to so many bytes. Every strip but the last has [`Sheet::band_rows`].
    ///
    /// # Errors
    /// [`SheetError::TooLong`].
    pub fn strip(&mut self, rows: u32, length: u64) -> Result<Vec<u8>, SheetError> {
        match &mut self.0 {
            Kind::Pdf(pdf) => Ok(pdf.strip(rows, length)),
            Kind::Tiff(tiff) => tiff.strip(length),
        }
    }

    /// What follows the last strip.
    ///
    /// # Errors
    /// [`SheetError::TooLong`].
    pub fn end(self) -> Result<Ending, SheetError> {
        match self.0 {
            Kind::Pdf(pdf) => pdf.end(),
            Kind::Tiff(tiff) => tiff.end(),
        }
    }
}
