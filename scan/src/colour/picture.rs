//! The pixels of a photograph: at full resolution, in a low-frequency band, and how sharp they are.

use image::{DynamicImage, ImageReader, Limits};
use kilwa_geometry::color::light_from_srgb_f32;
use std::io::Cursor;
use std::path::Path;

/// Pixels of the photograph per pixel of the low band, in each direction.
pub(super) const LOW: u32 = 16;
/// Pixels of the photograph per tile for which sharpness is measured, in each direction: four pixels of the low band.
const TILE: u32 = 4 * LOW;
/// The variance of differences between neighbouring pixels, as a share of that between means of two by two pixels at twice the distance: its value for a smooth gradient, and the excess over it
/// at which a tile is fully sharp.
const SMOOTH: f32 = 0.25;
const SHARP: f32 = 0.2;
/// Variance of luma that is taken for noise.
const NOISE: f32 = 1e-5;
/// A photograph has at most this many pixels.
const MAX_PIXELS: u64 = 1 << 30;

/// A decoded photograph. Pixels: (0, 0) is the corner of the first one.
#[derive(Debug, Clone)]
pub struct Photograph {
    size: [u32; 2],
    /// sRGB, rows from the top.
    pixels: Vec<[u8; 3]>,
    /// Means of linear light over squares of [`LOW`] pixels, without what is masked; rows from the top.
    /// The fourth number is the share of the pixels that are not masked, by which the others are multiplied.
    low: Vec<[f32; 4]>,
    low_size: [u32; 2],
    /// From 0 (blurred) to 1, per tile.
    sharpness: Vec<f32>,
    /// Whether a pixel may be used; empty if all may.
    usable: Vec<bool>,
}

/// What a photograph shows at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Linear light, 0 to 1.
    pub full: [f32; 3],
    /// The same, of the surroundings.
    pub low: [f32; 3],
    /// From 0 (blurred) to 1.
    pub sharpness: f32,
    /// Whether a channel is at the limit of its range, so that the true value is beyond it.
    pub is_clipped: bool,
}

impl Photograph {
    /// Read a JPEG or PNG file, and its mask (a PNG file: black parts are not used; if it has transparency, only that counts, and transparent parts are not used).
    ///
    /// # Errors
    /// Why it cannot be used, in words.
    pub fn read(path: &Path, size: [u32; 2], mask: Option<&Path>) -> Result<Self, String> {
        let picture = decode(path, size)?.into_rgb8();
        let pixels = picture.pixels().map(|pixel| pixel.0).collect();
        let usable = mask.map(|mask| usable(mask, size)).transpose()?.unwrap_or_default();
        Ok(Self::new(size, pixels, usable))
    }

    /// A photograph of pixels (sRGB, rows from the top), of which only those are used where `usable` is true; all if it is empty.
    ///
    /// # Panics
    /// If their number does not match the size.
    pub fn new(size: [u32; 2], pixels: Vec<[u8; 3]>, usable: Vec<bool>) -> Self {
        let count = size[0] as usize * size[1] as usize;
        assert!(pixels.len() == count && (usable.is_empty() || usable.len() == count), "pixels of {size:?}");
        let low_size = size.map(|side| side.div_ceil(LOW));
        let mut photograph = Self { size, pixels, low: Vec::new(), low_size, sharpness: Vec::new(), usable };
        photograph.low = photograph.means();
        photograph.sharpness = photograph.sharpnesses();
        photograph
    }

    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The luma of pixels averaged over squares of `side` by `side` pixels, 0 to 1, and the width and height in squares;
    /// incomplete squares at the right and lower edges are left out.
    pub fn luma(&self, side: u32) -> (Vec<f32>, [u32; 2]) {
        let side = side.clamp(1, self.size[0].min(self.size[1]));
        let [columns, rows] = self.size.map(|pixels| pixels / side);
        let mean = |column: u32, row: u32| {
            let places = (0..side * side).map(|k| self.index(column * side + k % side, row * side + k / side));
            let value = |at: usize| if self.is_usable(at) { luma(self.pixels[at]) } else { f32::NAN };
            places.map(value).sum::<f32>() / (side * side) as f32
        };
        let values = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        (values.map(|(column, row)| mean(column, row)).collect(), [columns, rows])
    }

    fn is_usable(&self, at: usize) -> bool {
        self.usable.get(at).copied().unwrap_or(true)
    }

    fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.size[0] as usize + x as usize
    }

    fn means(&self) -> Vec<[f32; 4]> {
        let [columns, rows] = self.low_size;
        let mut sums = vec![([0.0_f32; 3], 0.0_f32); columns as usize * rows as usize];
        for y in 0..self.size[1] {
            for x in 0..self.size[0] {
                let at = self.index(x, y);
                if self.is_usable(at) {
                    let (sum, count) = &mut sums[((y / LOW) * columns + x / LOW) as usize];
                    for (sum, level) in sum.iter_mut().zip(self.pixels[at]) {
                        *sum += light_from_srgb_f32(level);
                    }
                    *count += 1.0;
                }
            }
        }
        let full = (LOW * LOW) as f32;
        sums.into_iter().map(|([r, g, b], count)| [r, g, b, count].map(|sum| sum / full)).collect()
    }

    /// The sharpness of each tile: the contrast of neighbouring pixels, compared with that of means of two by two pixels.
    fn sharpnesses(&self) -> Vec<f32> {
        let [columns, rows] = self.size.map(|side| side.div_ceil(TILE));
        let tile = |k: u32| {
            let (left, top) = ((k % columns) * TILE, (k / columns) * TILE);
            let (right, bottom) = ((left + TILE).min(self.size[0]), (top + TILE).min(self.size[1]));
            let (mut fine, mut coarse, mut count) = (0.0_f32, 0.0_f32, 0.0_f32);
            for y in (top..bottom.saturating_sub(3)).step_by(4) {
                for x in (left..right.saturating_sub(3)).step_by(4) {
                    let at = |i: u32, j: u32| luma(self.pixels[self.index(x + i, y + j)]);
                    let square = |i: u32, j: u32| 0.25 * (at(i, j) + at(i + 1, j) + at(i, j + 1) + at(i + 1, j + 1));
                    fine += (at(1, 1) - at(2, 1)).powi(2) + (at(1, 1) - at(1, 2)).powi(2);
                    let [a, b, c] = [square(0, 0), square(2, 0), square(0, 2)];
                    coarse += (a - b).powi(2) + (a - c).powi(2);
                    count += 1.0;
                }
            }
            if count == 0.0 {
                return 1.0;
            }
            let (fine, coarse) = ((fine / count - NOISE).max(0.0), (coarse / count - 0.25 * NOISE).max(0.0));
            // Without contrast, blur cannot be detected, and does no harm.
            if coarse < NOISE { 1.0 } else { ((fine / coarse - SMOOTH) / SHARP).clamp(0.1, 1.0) }
        };
        (0..columns * rows).map(tile).collect()
    }

    /// What is shown at a place, interpolated between pixels. None outside, and where it is masked.
    pub fn shown(&self, x: f64, y: f64) -> Option<Shown> {
        let [width, height] = self.size.map(f64::from);
        if !(x >= 0.0 && x < width && y >= 0.0 && y < height) {
            return None;
        }
        if !self.is_usable(self.index(x as u32, y as u32)) {
            return None;
        }
        let mut is_clipped = false;
        let full = bilinear(self.size, x, y, |at| {
            let pixel = self.pixels[at];
            is_clipped |= pixel.iter().any(|level| *level >= 253);
            pixel.map(light_from_srgb_f32)
        });
        let scale = f64::from(LOW);
        let [r, g, b, used] = bilinear(self.low_size, x / scale, y / scale, |at| self.low[at]);
        let low = [r, g, b].map(|sum| sum / used.max(1e-6));
        let (tiles, tile) = (self.size.map(|side| side.div_ceil(TILE)), f64::from(TILE));
        let [sharpness] = bilinear(tiles, x / tile, y / tile, |at| [self.sharpness[at]]);
        Some(Shown { full, low, sharpness, is_clipped })
    }
}

/// Interpolate between the centres of four pixels of a picture.
fn bilinear<const N: usize>(
    [width, height]: [u32; 2],
    x: f64,
    y: f64,
    mut at: impl FnMut(usize) -> [f32; N],
) -> [f32; N] {
    let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
    let (u, v) = ((x - 0.5 - left) as f32, (y - 0.5 - top) as f32);
    let column = |k: f64| k.clamp(0.0, f64::from(width - 1)) as usize;
    let row = |k: f64| k.clamp(0.0, f64::from(height - 1)) as usize * width as usize;
    let mut sum = [0.0; N];
    for (dx, dy, weight) in
        [(0.0, 0.0, (1.0 - u) * (1.0 - v)), (1.0, 0.0, u * (1.0 - v)), (0.0, 1.0, (1.0 - u) * v), (1.0, 1.0, u * v)]
    {
        if weight > 0.0 {
            let value = at(row(top + dy) + column(left + dx));
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += weight * value;
            }
        }
    }
    sum
}

/// Luma of an sRGB pixel (BT.709), 0 to 1.
fn luma([r, g, b]: [u8; 3]) -> f32 {
    (0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b)) / 255.0
}

/// Decode a picture, and check its size.
fn decode(path: &Path, size: [u32; 2]) -> Result<DynamicImage, String> {
    let [width, height] = size;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!(
            "{width} × {height} pixels are more than Kilwa decodes; scale the photograph and its calibration down"
        ));
    }
    // No picture of this size is longer, so a huge file is not read whole.
    let longest = u64::from(width) * u64::from(height) * 16 + (64 << 20);
    let bytes = kilwa_files::plain_file::read_at(path, longest).map_err(|e| e.to_string())?;
    if is_cut_off(&bytes) {
        return Err("the file is cut off: its end is missing; copy it again".to_owned());
    }
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let mut reader = reader.map_err(|e| e.to_string())?;
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(width), Some(height));
    limits.max_alloc = Some(longest);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| e.to_string())?;
    if [picture.width(), picture.height()] != size {
        return Err(format!("{} × {} pixels, not {width} × {height}", picture.width(), picture.height()));
    }
    Ok(picture)
}

/// Whether a JPEG file has no end after its last scan: decoders fill the rest with grey. Neither marker can occur within the data of a scan (ITU-T T.81, B.1.1.5).
fn is_cut_off(bytes: &[u8]) -> bool {
    let last = |marker: u8| memchr::memmem::rfind(bytes, &[0xff, marker]);
    bytes.starts_with(&[0xff, 0xd8]) && last(0xda) >= last(0xd9)
}

/// Which pixels a mask allows.
fn usable(path: &Path, size: [u32; 2]) -> Result<Vec<bool>, String> {
    let mask = decode(path, size).map_err(|why| format!("its mask {}: {why}", path.display()))?;
    if mask.color().has_alpha() {
        let alpha: Vec<bool> = mask.to_luma_alpha8().pixels().map(|pixel| pixel.0[1] >= 128).collect();
        // Some programs save black and white with an alpha channel that is opaque everywhere.
        if !alpha.iter().all(|is_opaque| *is_opaque) {
            return Ok(alpha);
        }
    }
    Ok(mask.into_luma8().pixels().map(|pixel| pixel.0[0] >= 128).collect())
}
