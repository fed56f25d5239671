//! What a picture file states: its size, when it was taken, and its exposure. Pixels are not decoded.

use exif::{In, Tag, Value};
use kilwa_files::plain_file;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// What a picture file states about the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The format of its file.
    pub format: PictureFormat,
    /// Width and height, pixels, as they are stored: EXIF orientation is not applied, and calibrations do not apply it.
    pub size: [u32; 2],
    /// When it was taken, by the camera's clock, as in ISO 8601: `2024-05-17T14:03:22.50+03:00`. The fraction and the time zone may be missing.
    pub taken: Option<String>,
    /// Its exposure.
    pub exposure: Exposure,
}

/// Formats of pictures that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    /// JPEG.
    Jpeg,
    /// PNG.
    Png,
}

/// How much light a picture got, as far as EXIF states it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Exposure {
    /// Seconds.
    pub time: Option<f64>,
    /// Focal length over aperture.
    pub f_number: Option<f64>,
    /// ISO speed.
    pub iso: Option<f64>,
}

impl Exposure {
    /// Relative light for the same scene, in stops (powers of two): log2(time · iso / 100 / f_number²). None if something is unknown.
    pub fn stops(&self) -> Option<f64> {
        let (time, f, iso) = (self.time?, self.f_number?, self.iso?);
        let stops = libm::log2(time * iso / 100.0 / (f * f));
        stops.is_finite().then_some(stops)
    }
}

/// Read what a picture file states, or return why it cannot be read.
pub(super) fn read(path: &Path) -> Result<Picture, String> {
    let cannot = |e: io::Error| e.to_string();
    let mut file = BufReader::new(plain_file::open(path).map_err(cannot)?);
    let (format, size) = size(&mut file).map_err(cannot)?.ok_or("neither JPEG nor PNG")?;
    if size.contains(&0) {
        return Err("a size of 0 pixels".to_owned());
    }
    let mut picture = Picture { format, size, taken: None, exposure: Exposure::default() };
    if format == PictureFormat::Jpeg && file.seek(SeekFrom::Start(0)).is_ok() {
        add_exif(&mut picture, &mut file);
    }
    Ok(picture)
}

/// Whether a JPEG file states where it was taken. A file that cannot be read states nothing.
pub fn states_position(path: &Path) -> bool {
    let Ok(file) = plain_file::open(path) else { return false };
    let exif = exif::Reader::new().read_from_container(&mut BufReader::new(file));
    exif.is_ok_and(|exif| {
        [Tag::GPSLatitude, Tag::GPSLongitude].iter().any(|tag| exif.get_field(*tag, In::PRIMARY).is_some())
    })
}

/// Add time and exposure where the EXIF segment of a JPEG file (at most 64 KiB) states them. Damaged EXIF is ignored:
/// the picture is usable without it.
fn add_exif(picture: &mut Picture, file: &mut BufReader<File>) {
    let Ok(exif) = exif::Reader::new().read_from_container(file) else { return };
    let number = |tag| match exif.get_field(tag, In::PRIMARY).map(|field| &field.value) {
        Some(Value::Rational(values)) => values.first().map(exif::Rational::to_f64),
        Some(value) => value.get_uint(0).map(f64::from),
        None => None,
    };
    let positive = |value: Option<f64>| value.filter(|v| v.is_finite() && *v > 0.0);
    let text = |tag| match exif.get_field(tag, In::PRIMARY).map(|field| &field.value) {
        Some(Value::Ascii(lines)) => lines.first().and_then(|line| std::str::from_utf8(line).ok()).map(str::trim),
        _ => None,
    };
    picture.exposure = Exposure {
        time: positive(number(Tag::ExposureTime)),
        f_number: positive(number(Tag::FNumber)),
        iso: positive(number(Tag::PhotographicSensitivity)),
    };
    let taken = text(Tag::DateTimeOriginal).and_then(iso_8601);
    picture.taken = taken.map(|taken| {
        let fraction = text(Tag::SubSecTimeOriginal).filter(|t| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit()));
        let zone = text(Tag::OffsetTimeOriginal).filter(|zone| is_zone(zone));
        let fraction = fraction.map(|digits| format!(".{digits}")).unwrap_or_default();
        format!("{taken}{fraction}{}", zone.unwrap_or_default())
    });
}

/// `2024:05:17 14:03:22` as `2024-05-17T14:03:22`; None if it is no date.
fn iso_8601(text: &str) -> Option<String> {
    let form = b"dddd:dd:dd dd:dd:dd";
    let fits = text.len() == form.len()
        && text.bytes().zip(form).all(|(byte, form)| if *form == b'd' { byte.is_ascii_digit() } else { byte == *form });
    let is_set = fits && !text.starts_with("0000");
    is_set.then(|| format!("{}-{}-{}T{}", &text[..4], &text[5..7], &text[8..10], &text[11..]))
}

fn is_zone(zone: &str) -> bool {
    let bytes = zone.as_bytes();
    zone == "Z"
        || bytes.len() == 6
            && matches!(bytes[0], b'+' | b'-')
            && bytes[3] == b':'
            && [1, 2, 4, 5].iter().all(|at| bytes[*at].is_ascii_digit())
}

/// Maximum number of segments and fill bytes before the first frame of a JPEG file: colour profiles and previews take a
/// few hundred.
const SEGMENTS_MAX: u32 = 2000;

/// Format, width and height of a picture; None where the file is neither JPEG nor PNG.
pub(crate) fn size(file: &mut (impl Read + Seek)) -> io::Result<Option<(PictureFormat, [u32; 2])>> {
    let mut start = [0; 24];
    let mut filled = 0;
    while filled < start.len() {
        match file.read(&mut start[filled..])? {
            0 => return Ok(None),
            n => filled += n,
        }
    }
    if start.starts_with(b"\x89PNG\r\n\x1a\n") {
        let word = |at: usize| u32::from_be_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]]);
        return Ok(Some((PictureFormat::Png, [word(16), word(20)])));
    }
    if !start.starts_with(&[0xff, 0xd8, 0xff]) {
        return Ok(None);
    }
    // Segments of a JPEG file: a marker, then the length of what follows. The first frame (SOF) holds the size.
    let mut at = 2;
    for _ in 0..SEGMENTS_MAX {
        let mut head = [0; 9];
        file.seek(SeekFrom::Start(at))?;
        if file.read_exact(&mut head).is_err() || head[0] != 0xff {
            return Ok(None);
        }
        let is_frame = matches!(head[1], 0xc0..=0xcf) && !matches!(head[1], 0xc4 | 0xc8 | 0xcc);
        if is_frame {
            let half = |at: usize| u32::from(u16::from_be_bytes([head[at], head[at + 1]]));
            return Ok(Some((PictureFormat::Jpeg, [half(7), half(5)])));
        }
        // Fill bytes before a marker.
        at += if head[1] == 0xff { 1 } else { 2 + u64::from(u16::from_be_bytes([head[2], head[3]])) };
    }
    Ok(None)
}
