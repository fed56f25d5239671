//! TIFF in strips, deflated; plans as GeoTIFF (OGC 19-008r4): where the upper left corner is, how large a pixel, which reference system.

use super::Next;
use super::picture::ROWS;
use anyhow::Context;
use flate2::Compression as Level;
use flate2::write::ZlibEncoder;
use std::fs::File;
use std::io::{BufWriter, Write};
use tiff::encoder::{Rational, TiffEncoder, TiffKind};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, ResolutionUnit, Tag};

/// Where a plan is in the world.
pub(super) struct GeoReference {
    pub(super) metres_per_pixel: f64,
    /// World coordinates of the upper left corner.
    pub(super) corner: [f64; 2],
    /// EPSG code of a projected system, where known.
    pub(super) epsg: Option<u16>,
}

impl GeoReference {
    /// World coordinates of the middle of the first pixel.
    pub(super) fn first_pixel(&self) -> [f64; 2] {
        [self.corner[0] + self.metres_per_pixel * 0.5, self.corner[1] - self.metres_per_pixel * 0.5]
    }

    /// The GeoKeyDirectory: version 1.1.1, raster pixels are areas; the model type is projected where the system is known.
    fn keys(&self) -> Vec<u16> {
        let mut keys = vec![[1024, 0, 1, if self.epsg.is_some() { 1 } else { 32767 }], [1025, 0, 1, 1]];
        keys.extend(self.epsg.map(|code| [3072, 0, 1, code]));
        let mut all = vec![1, 1, 1, keys.len() as u16];
        all.extend(keys.iter().flatten());
        all
    }
}

pub(super) fn write(
    file: &mut File,
    size: [u32; 2],
    dpi: u32,
    place: Option<&GeoReference>,
    next: Next<'_>,
) -> anyhow::Result<()> {
    let file = BufWriter::new(file);
    // Offsets of classic TIFF end at 4 GiB; deflate cannot make more than a little of less.
    if u64::from(size[0]) * u64::from(size[1]) * 3 < 3_900_000_000 {
        strips(TiffEncoder::new(file).context("cannot write the TIFF")?, size, dpi, place, next)
    } else {
        strips(TiffEncoder::new_big(file).context("cannot write the TIFF")?, size, dpi, place, next)
    }
}

fn strips<K: TiffKind>(
    encoder: TiffEncoder<BufWriter<&mut File>, K>,
    size: [u32; 2],
    dpi: u32,
    place: Option<&GeoReference>,
    next: Next<'_>,
) -> anyhow::Result<()> {
    let failed = "cannot write the TIFF";
    let mut encoder = encoder;
    let mut image = encoder.image_directory().context(failed)?;
    // The crate's own images deflate only what is in memory as a whole.
    let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
    while let Some(rows) = next()? {
        let mut packed = ZlibEncoder::new(Vec::new(), Level::default());
        packed.write_all(&rows)?;
        let packed = packed.finish()?;
        offsets.push(K::convert_offset(image.write_data(&packed[..]).context(failed)?).context(failed)?);
        lengths.push(packed.len() as u32);
    }
    image.write_tag(Tag::ImageWidth, size[0]).context(failed)?;
    image.write_tag(Tag::ImageLength, size[1]).context(failed)?;
    image.write_tag(Tag::BitsPerSample, &[8u16, 8, 8][..]).context(failed)?;
    image.write_tag(Tag::Compression, CompressionMethod::Deflate.to_u16()).context(failed)?;
    image.write_tag(Tag::PhotometricInterpretation, PhotometricInterpretation::RGB.to_u16()).context(failed)?;
    image.write_tag(Tag::StripOffsets, K::convert_slice(&offsets)).context(failed)?;
    image.write_tag(Tag::SamplesPerPixel, 3u16).context(failed)?;
    image.write_tag(Tag::RowsPerStrip, ROWS).context(failed)?;
    image.write_tag(Tag::StripByteCounts, &lengths[..]).context(failed)?;
    image.write_tag(Tag::XResolution, Rational { n: dpi, d: 1 }).context(failed)?;
    image.write_tag(Tag::YResolution, Rational { n: dpi, d: 1 }).context(failed)?;
    image.write_tag(Tag::PlanarConfiguration, 1u16).context(failed)?;
    image.write_tag(Tag::ResolutionUnit, ResolutionUnit::Inch.to_u16()).context(failed)?;
    if let Some(place) = place {
        let pixel = place.metres_per_pixel;
        let tie = [0.0, 0.0, 0.0, place.corner[0], place.corner[1], 0.0];
        image.write_tag(Tag::ModelPixelScaleTag, &[pixel, pixel, 0.0][..]).context(failed)?;
        image.write_tag(Tag::ModelTiepointTag, &tie[..]).context(failed)?;
        image.write_tag(Tag::GeoKeyDirectoryTag, &place.keys()[..]).context(failed)?;
    }
    image.finish().context(failed)?;
    Ok(())
}
