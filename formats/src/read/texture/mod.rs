//! Pictures on meshes: decoded, and sampled at texture coordinates to give colours of vertices.
//!
//! Input: the bytes of a PNG, JPEG, WebP or TIFF. A picture of more texels than a limit, or that would take more memory than
//! is available, is refused before it is decoded (`decode_memory` estimates it); ancillary chunks of a PNG are never read;
//! pictures are kept up to a number of bytes and decoded again when they come back ([`Textures`]). Texels are taken as 8-bit
//! sRGB, whatever a colour profile says; opacity is not looked at.

mod decode_memory;
pub mod detail;

use crate::diagnostics::Pictures;
use glam::DVec2;
use image::{DynamicImage, ImageDecoder, ImageError, ImageReader, Limits};
pub(crate) use kilwa_geometry::color::{light_from_srgb, srgb_from_light};
use kilwa_pack::plural::counted;
use std::io::Cursor;

/// The most bytes that a decoded picture may take by default: 3 a texel, so that one of 16384 × 16384 fits.
pub const TEXTURE_BYTES: u64 = 1 << 30;

/// What lies beyond the edge of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The picture again.
    #[default]
    Repeat,
    /// The picture turned round.
    Mirror,
    /// The texels at its edge.
    Clamp,
}

/// Why a picture cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// It is missing, damaged, of another format or too large for any memory: the mesh is read without it.
    #[error("{0}")]
    Unreadable(String),
    /// There is too little memory for it: the mesh is refused, for with more memory it would be read.
    #[error("{0}")]
    Memory(String),
}

impl Refusal {
    /// A file of a picture that cannot be read; one that is larger than was asked for is a matter of memory.
    pub(super) fn of_file(file: &std::path::Path, e: &std::io::Error) -> Self {
        let kind = if e.kind() == std::io::ErrorKind::FileTooLarge { Self::Memory } else { Self::Unreadable };
        let way_out = if matches!(kind(String::new()), Self::Memory(_)) { "; give a larger --memory" } else { "" };
        kind(format!("{} cannot be read: {e}{way_out}", file.display()))
    }
}

/// A decoded picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texture {
    width: usize,
    height: usize,
    /// Red, green and blue of each texel, sRGB, rows from the top.
    texels: Vec<u8>,
}

fn too_little(memory: u64, need: &str) -> Refusal {
    Refusal::Memory(format!(
        "decoding it takes {need} of memory, but {} allowed; give a larger --memory (twice what it takes), or a smaller picture",
        counted(memory, "byte is", "bytes are")
    ))
}

impl Texture {
    /// Decode a picture that takes up to `max` bytes at 3 a texel, and up to `memory` bytes while it is decoded; `make_room` is
    /// called beforehand with the number of bytes that decoding takes.
    ///
    /// # Errors
    /// [`Refusal`]: it is damaged, of another format, or larger than that.
    pub fn decode(bytes: &[u8], max: u64, memory: u64, make_room: impl FnOnce(u64)) -> Result<Self, Refusal> {
        let damaged = |e: ImageError| match e {
            ImageError::Limits(_) => too_little(memory, "more bytes"),
            e => Refusal::Unreadable(format!("it cannot be decoded: {e}")),
        };
        let essential = decode_memory::without_extras(bytes);
        let limits = |bytes: u64| {
            let mut limits = Limits::default();
            limits.max_alloc = Some(bytes);
            limits
        };
        let mut reader =
            ImageReader::new(Cursor::new(&*essential)).with_guessed_format().map_err(|e| damaged(e.into()))?;
        let format = reader.format();
        // Not set here: what the header says is judged first.
        reader.no_limits();
        let mut decoder = reader.into_decoder().map_err(damaged)?;
        let (width, height) = decoder.dimensions();
        let texels = u64::from(width) * u64::from(height);
        if texels == 0 || texels > max / 3 {
            let why = format!(
                "it has {width} × {height} = {}; at most {} are read",
                counted(texels, "texel", "texels"),
                max / 3
            );
            return Err(Refusal::Unreadable(why));
        }
        let need = decode_memory::needed(format, bytes, texels, decoder.color_type());
        if need > memory {
            return Err(too_little(memory, &counted(need, "byte", "bytes").to_string()));
        }
        make_room(need);
        // A TIFF takes more where its strips are large: for that there is what is left.
        let apart = decode_memory::apart(bytes, texels, decoder.color_type());
        decoder.set_limits(limits(memory.saturating_sub(apart))).map_err(damaged)?;
        let picture = DynamicImage::from_decoder(decoder).map_err(damaged)?;
        let (width, height) = (width as usize, height as usize);
        let texels = match picture {
            DynamicImage::ImageRgba8(picture) => decode_memory::without_alpha(picture.into_raw()),
            picture => picture.into_rgb8().into_raw(),
        };
        if texels.len() != 3 * width * height {
            return Err(Refusal::Unreadable("its size differs from the size in its header".to_owned()));
        }
        Ok(Self { width, height, texels })
    }

    /// Texels across and down.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The colour at `uv`, sRGB: (0, 0) is the outer corner of the top left texel, (1, 1) that of the bottom right one.
    /// Bilinear in light, so that the mean of black and white is the grey that is half as bright. Not finite: as 0.
    pub fn sample(&self, uv: DVec2, wrap: [Wrap; 2]) -> [u8; 3] {
        let (x0, x1, fx) = neighbours(uv.x, self.width, wrap[0]);
        let (y0, y1, fy) = neighbours(uv.y, self.height, wrap[1]);
        let at = |x: usize, y: usize| &self.texels[3 * (y * self.width + x)..][..3];
        let corners = [(at(x0, y0), (1.0 - fx) * (1.0 - fy)), (at(x1, y0), fx * (1.0 - fy))];
        let more = [(at(x0, y1), (1.0 - fx) * fy), (at(x1, y1), fx * fy)];
        std::array::from_fn(|i| {
            let light = corners.iter().chain(&more).map(|(texel, weight)| light_from_srgb(texel[i]) * weight).sum();
            srgb_from_light(light)
        })
    }
}

/// The two texels between whose centres a coordinate lies, and how far it is towards the second.
fn neighbours(coordinate: f64, n: usize, wrap: Wrap) -> (usize, usize, f64) {
    let coordinate = if coordinate.is_finite() { coordinate } else { 0.0 };
    let turned = match wrap {
        Wrap::Repeat => coordinate - coordinate.floor(),
        Wrap::Clamp => coordinate.clamp(0.0, 1.0),
        Wrap::Mirror => {
            let twice = coordinate - 2.0 * (coordinate / 2.0).floor();
            if twice > 1.0 { 2.0 - twice } else { twice }
        }
    };
    let at = turned * n as f64 - 0.5;
    let first = at.floor();
    let inside = |i: f64| {
        let i = i as i64;
        let last = n as i64 - 1;
        let i = if wrap == Wrap::Repeat { i.rem_euclid(last + 1) } else { i.clamp(0, last) };
        i as usize
    };
    (inside(first), inside(first + 1.0), at - first)
}

/// The pictures of one input by number, decoded when they are asked for; those used longest ago leave first when they
/// take more than a limit together.
#[derive(Debug)]
pub struct Textures {
    /// Bytes that one may take.
    max: u64,
    /// Bytes that all together may take, beside the one in use.
    kept: u64,
    held: u64,
    /// Bytes that one may take while it is decoded, with those that are held.
    memory: u64,
    /// Why there was too little memory.
    short: Option<String>,
    clock: u64,
    entries: Vec<Entry>,
    /// Whether a picture is among `used`.
    counted: Vec<bool>,
    used: Pictures,
}

#[derive(Debug, Clone, Default)]
enum Entry {
    #[default]
    Out,
    In {
        texture: Texture,
        used: u64,
    },
    Refused,
}

impl Textures {
    /// For pictures of up to `max` bytes each and together, at 3 a texel.
    pub fn new(max: u64) -> Self {
        Self {
            max,
            kept: max,
            held: 0,
            memory: u64::MAX,
            short: None,
            clock: 0,
            entries: Vec::new(),
            counted: Vec::new(),
            used: Pictures::default(),
        }
    }

    /// The same, but together they take up to `kept` bytes, or as much as one.
    #[must_use]
    pub fn keeping(self, kept: u64) -> Self {
        Self { kept: kept.min(self.max), ..self }
    }

    /// The same, but decoding one takes at most so many bytes of memory, with those that are held.
    #[must_use]
    pub fn within(self, memory: u64) -> Self {
        Self { memory, ..self }
    }

    /// The most bytes that the file of one may have.
    pub fn file_bytes(&self) -> u64 {
        self.max.min(self.memory / 2)
    }

    /// The pictures that could be had, each once.
    pub fn used(&self) -> Pictures {
        self.used
    }

    /// Why the mesh cannot be read with this memory, where a picture was refused for it.
    pub fn short(&self) -> Option<&str> {
        self.short.as_deref()
    }

    /// Picture `number`; `load` gives its encoded bytes if it is missing. `None` where it could not be had: then
    /// `refused` was called once with the reason.
    pub fn get(
        &mut self,
        number: usize,
        load: impl FnOnce() -> Result<Vec<u8>, Refusal>,
        refused: impl FnOnce(String),
    ) -> Option<&Texture> {
        if number >= self.entries.len() {
            self.entries.resize(number + 1, Entry::Out);
            self.counted.resize(number + 1, false);
        }
        self.clock += 1;
        if matches!(self.entries[number], Entry::Out) {
            self.entries[number] = match self.loaded(load) {
                Ok(texture) => {
                    if !std::mem::replace(&mut self.counted[number], true) {
                        self.used.add(Pictures { count: 1, texels: texture.texels.len() as u64 / 3 });
                    }
                    self.make_room(texture.texels.len() as u64);
                    self.held += texture.texels.len() as u64;
                    Entry::In { texture, used: self.clock }
                }
                Err(reason) => {
                    if let Refusal::Memory(why) = &reason {
                        self.short.get_or_insert_with(|| why.clone());
                    }
                    refused(reason.to_string());
                    Entry::Refused
                }
            };
        }
        match &mut self.entries[number] {
            Entry::In { texture, used } => {
                *used = self.clock;
                Some(texture)
            }
            _ => None,
        }
    }

    fn loaded(&mut self, load: impl FnOnce() -> Result<Vec<u8>, Refusal>) -> Result<Texture, Refusal> {
        let bytes = load()?;
        let (max, memory) = (self.max, self.memory);
        Texture::decode(&bytes, max, memory, |need| self.leave(need, memory))
    }

    fn make_room(&mut self, bytes: u64) {
        self.leave(bytes, self.kept);
    }

    /// Drop those used longest ago, until `bytes` more are at most `max` together.
    fn leave(&mut self, bytes: u64, max: u64) {
        while self.held.saturating_add(bytes) > max {
            let age = |e: &Entry| if let Entry::In { used, .. } = e { Some(*used) } else { None };
            let oldest = (0..self.entries.len()).filter_map(|i| age(&self.entries[i]).map(|a| (a, i))).min();
            let Some((_, i)) = oldest else { return };
            if let Entry::In { texture, .. } = std::mem::take(&mut self.entries[i]) {
                self.held -= texture.texels.len() as u64;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageFormat, RgbImage};

    fn encoded(format: ImageFormat, width: u32, height: u32, color: impl Fn(u32, u32) -> [u8; 3]) -> Vec<u8> {
        let picture = RgbImage::from_fn(width, height, |x, y| image::Rgb(color(x, y)));
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    fn two_by_two() -> Texture {
        let colors = [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]];
        let bytes = encoded(ImageFormat::Png, 2, 2, |x, y| colors[y as usize][x as usize]);
        Texture::decode(&bytes, TEXTURE_BYTES, u64::MAX, |_| ()).unwrap()
    }

    #[test]
    fn images_of_every_format_are_decoded() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Tiff] {
            let texture =
                Texture::decode(&encoded(format, 16, 8, |_, _| [200, 100, 50]), TEXTURE_BYTES, u64::MAX, |_| ())
                    .unwrap();
            assert_eq!(texture.size(), [16, 8]);
            let color = texture.sample(DVec2::splat(0.5), [Wrap::Repeat; 2]);
            assert!(color.iter().zip([200u8, 100, 50]).all(|(a, b)| a.abs_diff(b) <= 4), "{format:?} {color:?}");
        }
    }

    #[test]
    fn the_centre_of_a_texel_has_its_colour_and_v_goes_down() {
        let t = two_by_two();
        let at = |u, v| t.sample(DVec2::new(u, v), [Wrap::Repeat; 2]);
        assert_eq!((at(0.25, 0.25), at(0.75, 0.25)), ([255, 0, 0], [0, 255, 0]));
        assert_eq!((at(0.25, 0.75), at(0.75, 0.75)), ([0, 0, 255], [255, 255, 255]));
    }

    #[test]
    fn interpolation_between_texels_is_in_linear_light() {
        let bytes = encoded(ImageFormat::Png, 2, 1, |x, _| if x == 0 { [0; 3] } else { [255; 3] });
        let t = Texture::decode(&bytes, TEXTURE_BYTES, u64::MAX, |_| ()).unwrap();
        assert_eq!(t.sample(DVec2::splat(0.5), [Wrap::Clamp; 2]), [188; 3]);
    }

    #[test]
    fn wrapping_repeats_mirrors_or_clamps() {
        let t = two_by_two();
        let at = |u, wrap| t.sample(DVec2::new(u, 0.25), [wrap; 2]);
        assert_eq!(at(1.25, Wrap::Repeat), [255, 0, 0]);
        assert_eq!(at(-0.25, Wrap::Repeat), [0, 255, 0]);
        assert_eq!(at(1.25, Wrap::Mirror), [0, 255, 0]);
        assert_eq!(at(-0.25, Wrap::Mirror), [255, 0, 0]);
        assert_eq!(at(7.0, Wrap::Clamp), [0, 255, 0]);
        assert_eq!(at(f64::NAN, Wrap::Clamp), [255, 0, 0]);
    }

    #[test]
    fn every_srgb_level_survives_conversion_to_linear_light_and_back() {
        for level in 0..=255 {
            assert_eq!(srgb_from_light(light_from_srgb(level)), level);
        }
    }

    #[test]
    fn an_image_that_is_too_large_or_damaged_is_refused_with_the_reason() {
        let bytes = encoded(ImageFormat::Png, 64, 32, |_, _| [1; 3]);
        let text = Texture::decode(&bytes, 3 * 2047, u64::MAX, |_| ()).unwrap_err().to_string();
        assert!(text.contains("64 × 32 = 2048 texels") && text.contains("at most 2047"), "{text}");
        assert!(
            Texture::decode(&bytes[..60], TEXTURE_BYTES, u64::MAX, |_| ())
                .unwrap_err()
                .to_string()
                .contains("cannot be decoded")
        );
        assert!(Texture::decode(b"nothing", TEXTURE_BYTES, u64::MAX, |_| ()).is_err());
    }

    #[test]
    fn images_are_evicted_when_memory_is_short_and_decoded_again_when_needed() {
        let bytes = encoded(ImageFormat::Png, 10, 10, |_, _| [7; 3]);
        let mut textures = Textures::new(700);
        let mut loads = 0;
        for number in [0, 1, 0, 2, 0, 1] {
            let load = || {
                loads += 1;
                Ok(bytes.clone())
            };
            assert!(textures.get(number, load, |_| ()).is_some());
            assert!(textures.held <= 700);
        }
        assert_eq!(loads, 4, "0, 1, 2, and 1 again, which was used longest ago");
        assert_eq!(textures.used(), Pictures { count: 3, texels: 300 });
        let mut one = Textures::new(700).keeping(1);
        for number in [0, 1, 0] {
            assert!(one.get(number, || Ok(bytes.clone()), |_| ()).is_some());
            assert_eq!(one.held, 300, "the one in use, and no other");
        }
        let mut reported = 0;
        for _ in 0..2 {
            assert!(textures.get(9, || Err(Refusal::Unreadable("gone".to_owned())), |_| reported += 1).is_none());
        }
        assert_eq!(reported, 1);
    }
}
