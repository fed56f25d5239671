//! The content of a tile: a glTF, alone or in a b3dm (OGC 22-025r4, annex "Batched 3D Model"; deprecated in 1.1 but written by most
//! programs), or several tiles in a cmpt; any of them may be gzipped.

use super::super::companions::Companions;
use super::super::gltf::{Detailing, TilePlacement, deliver_placed, is_gltf};
use super::super::{Bytes, Input, MeshSink, OnProgress, Place, ReadError, ReadOptions};
use super::is_tileset;
use super::tree::Leaf;
use flate2::read::GzDecoder;
use glam::{DAffine3, DVec3};
use kilwa_pack::plural::counted;
use serde::Deserialize;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes of the header of a b3dm.
pub(super) const B3DM_HEADER: u64 = 28;
/// Bytes of the header of a cmpt.
pub(super) const CMPT_HEADER: u64 = 16;
/// Maximum nesting of composites.
pub(super) const MAX_COMPOSITES: usize = 8;
/// Bytes of the JSON of a feature table; a few dozen are usual.
const MAX_FEATURES: u64 = 1 << 20;
const COPY: &str = "the file is truncated or damaged: copy or export it again";

/// Whether a file is gzipped, by its first bytes.
pub(super) fn is_gzip(start: &[u8]) -> bool {
    start.starts_with(b"\x1f\x8b")
}

/// Uncompressed; at most `max` bytes, which is what memory allows.
///
/// # Errors
/// [`ReadError`] where it is damaged or too large.
pub(super) fn gunzip(source: impl Read, path: &Path, max: u64) -> Result<Vec<u8>, ReadError> {
    let mut bytes = Vec::new();
    GzDecoder::new(source).take(max + 1).read_to_end(&mut bytes).map_err(|e| ReadError::Malformed {
        file: path.to_owned(),
        place: Place::Byte(0),
        found: format!("a gzip stream that cannot be decompressed ({e})"),
        expected: format!("a valid one; {COPY}"),
    })?;
    if bytes.len() as u64 > max {
        let what = format!("its uncompressed size is over the limit of {} MiB; give a larger --memory", max >> 20);
        return Err(ReadError::TooLarge { file: path.to_owned(), what });
    }
    Ok(bytes)
}

/// A part of a file, read as a file of its own.
struct Window<'a> {
    source: &'a mut dyn Bytes,
    start: u64,
    length: u64,
    at: u64,
}

impl Read for Window<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let left = self.length.saturating_sub(self.at);
        let n = into.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        self.source.seek(SeekFrom::Start(self.start + self.at))?;
        let read = self.source.read(&mut into[..n])?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Window<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.length.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or_else(|| std::io::Error::from(std::io::ErrorKind::InvalidInput))?;
        Ok(self.at)
    }
}

/// Delivers the contents of tiles.
pub(super) struct Delivery<'a> {
    pub(super) companions: &'a Companions<'a>,
    pub(super) options: &'a ReadOptions,
    pub(super) detailing: Option<Detailing<'a>>,
    pub(super) sink: &'a mut dyn MeshSink,
    /// Number of tiles whose origin, taken as geocentric, is near the surface of the earth.
    pub(super) geocentric: u64,
}

impl Delivery<'_> {
    /// Deliver one file; returns its number of triangles.
    pub(super) fn leaf(&mut self, leaf: &Leaf, progress: &mut OnProgress<'_>) -> Result<u64, ReadError> {
        let (mut file, bytes) =
            self.companions.open(&leaf.path).map_err(|source| ReadError::Open { file: leaf.path.clone(), source })?;
        let start = piece(&mut file, 0, bytes.min(2), &leaf.path)?;
        if !is_gzip(&start) {
            return self.content(leaf, &mut file, bytes, progress);
        }
        let cannot = |source| ReadError::Io { file: leaf.path.clone(), offset: 0, source };
        file.seek(SeekFrom::Start(0)).map_err(cannot)?;
        let bytes = gunzip(file, &leaf.path, self.options.document)?;
        let length = bytes.len() as u64;
        self.content(leaf, &mut Cursor::new(bytes), length, progress)
    }

    /// Deliver one file of so many bytes, uncompressed.
    fn content(
        &mut self,
        leaf: &Leaf,
        source: &mut dyn Bytes,
        bytes: u64,
        progress: &mut OnProgress<'_>,
    ) -> Result<u64, ReadError> {
        let mut content = Content { leaf, source, progress, delivery: self, is_geocentric: false };
        let triangles = content.read(0, bytes, 0)?;
        let is_geocentric = content.is_geocentric;
        self.geocentric += u64::from(is_geocentric);
        Ok(triangles)
    }
}

/// The file being read.
struct Content<'c, 'd, 'p> {
    leaf: &'c Leaf,
    source: &'c mut dyn Bytes,
    progress: &'c mut OnProgress<'p>,
    delivery: &'c mut Delivery<'d>,
    /// Whether any of its meshes stands near the surface of the earth, if it is in geocentric coordinates.
    is_geocentric: bool,
}

impl Content<'_, '_, '_> {
    /// Deliver the content of `length` bytes that begins at byte `at`.
    fn read(&mut self, at: u64, length: u64, composites: usize) -> Result<u64, ReadError> {
        let start = self.piece(at, length.min(super::super::SNIFFED))?;
        match start.get(..4).unwrap_or_default() {
            b"b3dm" => self.batched(at, length),
            b"cmpt" => self.composite(at, length, composites),
            b"pnts" => Err(self.refused("a tile of points (pnts)")),
            b"i3dm" => Err(self.refused("a tile of instances (i3dm)")),
            b"vctr" => Err(self.refused("a tile of vector data (vctr)")),
            b"subt" => Err(self.refused("a subtree of implicit tiling")),
            _ if is_tileset(&start, length) => Err(self.refused("a tileset with the file extension of a mesh")),
            _ if is_gltf(&start, length) => self.gltf(at, length, DVec3::ZERO),
            _ => {
                let found = format!("{} of an unknown format", counted(length, "byte", "bytes"));
                Err(self.malformed(at, found, &format!("a tile in b3dm or glTF; {COPY}")))
            }
        }
    }

    fn refused(&self, what: &str) -> ReadError {
        let needs = format!("is {what}, which is not read");
        let way_out = "Export the tileset again with only b3dm or glTF meshes, or give the mesh that it was made from";
        ReadError::Needs { file: self.leaf.path.clone(), needs, way_out }
    }

    fn malformed(&self, at: u64, found: String, expected: &str) -> ReadError {
        let (file, place) = (self.leaf.path.clone(), Place::Byte(at));
        ReadError::Malformed { file, place, found, expected: expected.to_owned() }
    }

    fn piece(&mut self, at: u64, length: u64) -> Result<Vec<u8>, ReadError> {
        piece(self.source, at, length, &self.leaf.path)
    }

    /// The `N` words of a header; the third, the total length, is checked.
    fn header<const N: usize>(&mut self, at: u64, length: u64, what: &str) -> Result<[u32; N], ReadError> {
        let bytes = self.piece(at, length.min(4 * N as u64))?;
        if bytes.len() < 4 * N {
            let found = format!("{} for a {what}", counted(length, "byte", "bytes"));
            return Err(self.malformed(at, found, &format!("a header of {} bytes; {COPY}", 4 * N)));
        }
        let word = |i: usize| bytes[4 * i..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b));
        let words: [u32; N] = std::array::from_fn(word);
        if words[1] != 1 {
            let needs = format!("has a {what} of version {}; only version 1 is supported", words[1]);
            let way_out = "Export the tileset again as 3D Tiles 1.0 or 1.1";
            return Err(ReadError::Needs { file: self.leaf.path.clone(), needs, way_out });
        }
        let whole = u64::from(words[2]);
        if whole > length || whole < bytes.len() as u64 {
            let found = counted(length, "byte", "bytes").to_string();
            return Err(self.malformed(at, found, &format!("{whole}, as in the header of the {what}; {COPY}")));
        }
        Ok(words)
    }

    /// A b3dm: header, feature table and batch table, each with a JSON and a binary part, and a GLB.
    fn batched(&mut self, at: u64, length: u64) -> Result<u64, ReadError> {
        let [_, _, whole, json, binary, batch_json, batch_binary] = self.header::<7>(at, length, "b3dm")?;
        let [json, binary] = [json, binary].map(u64::from);
        let tables = json + binary + u64::from(batch_json) + u64::from(batch_binary);
        let room = u64::from(whole) - B3DM_HEADER;
        if tables > room {
            let found = format!("tables of {}", counted(tables, "byte", "bytes"));
            let expected = format!("at most {room}, the rest of the b3dm; {COPY}");
            return Err(self.malformed(at + 12, found, &expected));
        }
        let center = self.center(at + B3DM_HEADER, json, binary)?;
        let first = at + B3DM_HEADER + tables;
        let start = self.piece(first, (room - tables).min(12))?;
        if !start.starts_with(b"glTF") {
            let expected = "a GLB after the tables of a b3dm; drafts of b3dm are not read: export the tileset again";
            return Err(self.malformed(first, "something else".to_owned(), expected));
        }
        // Padding to a multiple of 8 bytes may follow the GLB.
        let own = start.get(8..12).and_then(|b| b.first_chunk()).map_or(u64::MAX, |b| u32::from_le_bytes(*b).into());
        let rest = room - tables;
        self.gltf(first, if own <= rest && rest - own < 8 { own } else { rest }, center)
    }

    /// `RTC_CENTER` of the feature table.
    fn center(&mut self, at: u64, json: u64, binary: u64) -> Result<DVec3, ReadError> {
        #[derive(Deserialize, Default)]
        struct Features {
            #[serde(rename = "RTC_CENTER")]
            center: Option<Center>,
        }
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Center {
            Here([f64; 3]),
            Binary {
                #[serde(rename = "byteOffset")]
                offset: u64,
            },
        }
        if json > MAX_FEATURES {
            let found = format!("a feature table of {json} bytes");
            return Err(self.malformed(at, found, &format!("at most {MAX_FEATURES}; {COPY}")));
        }
        let text = self.piece(at, json)?;
        let end = text.iter().rposition(|b| *b != 0 && !b.is_ascii_whitespace()).map_or(0, |last| last + 1);
        if end == 0 {
            return Ok(DVec3::ZERO);
        }
        let features: Features = serde_json::from_slice(&text[..end]).map_err(|e| {
            let found =
                format!("a feature table that cannot be read ({})", kilwa_pack::visible::visible(&e.to_string()));
            self.malformed(at, found, &format!("JSON in which RTC_CENTER, if present, is three numbers; {COPY}"))
        })?;
        let center = match features.center {
            None => DVec3::ZERO,
            Some(Center::Here(center)) => center.into(),
            Some(Center::Binary { offset }) => {
                if offset.checked_add(12).is_none_or(|end| end > binary) {
                    let found = format!("RTC_CENTER at byte {offset} of a binary part of {binary} bytes");
                    return Err(self.malformed(at, found, &format!("12 bytes inside it; {COPY}")));
                }
                let bytes = self.piece(at + json + offset, 12)?;
                let word = |i: usize| {
                    bytes.get(4 * i..).and_then(<[u8]>::first_chunk).map_or(f32::NAN, |b| f32::from_le_bytes(*b))
                };
                DVec3::from_array([0, 1, 2].map(|i| f64::from(word(i))))
            }
        };
        if center.is_finite() {
            return Ok(center);
        }
        Err(self.malformed(at, "RTC_CENTER that is not finite".to_owned(), &format!("three finite numbers; {COPY}")))
    }

    /// A cmpt: header, and tiles one after another.
    fn composite(&mut self, at: u64, length: u64, composites: usize) -> Result<u64, ReadError> {
        if composites == MAX_COMPOSITES {
            let found = format!("more than {MAX_COMPOSITES} nested composites");
            return Err(self.malformed(at, found, "fewer; export the tileset again"));
        }
        let [_, _, whole, tiles] = self.header::<4>(at, length, "cmpt")?;
        let end = at + u64::from(whole);
        let (mut triangles, mut inner) = (0, at + CMPT_HEADER);
        for number in 0..tiles {
            let bytes = self.piece(inner, (end - inner).min(12))?;
            let own = bytes.get(8..12).and_then(|b| b.first_chunk()).map_or(0, |b| u64::from(u32::from_le_bytes(*b)));
            if own < 12 || own > end - inner {
                let found = format!("tile {number} of {tiles} with {own} bytes");
                return Err(self.malformed(
                    inner,
                    found,
                    &format!("12 to {}, the rest of the composite; {COPY}", end - inner),
                ));
            }
            triangles += self.read(inner, own, composites + 1)?;
            inner += own;
        }
        Ok(triangles)
    }

    /// A glTF, rotated and moved to the position of the tile.
    fn gltf(&mut self, at: u64, length: u64, center: DVec3) -> Result<u64, ReadError> {
        /// How far from the centre of the earth its surface can be, with mountains and trenches, metres.
        const SURFACE: std::ops::Range<f64> = 6_330_000.0..6_400_000.0;
        let Delivery { companions, options, detailing, sink, .. } = &mut *self.delivery;
        let root_from_tile = self.leaf.root_from_tile * DAffine3::from_translation(center);
        let tile_from_scene = self.leaf.up.tile_from_gltf();
        let mut window = Window { source: &mut *self.source, start: at, length, at: 0 };
        let progress = &mut *self.progress;
        let input = Input {
            path: &self.leaf.path,
            total: length,
            source: &mut window,
            progress: &mut |done, total| progress(done, total),
            options,
            archive: None,
        };
        let companions = Companions::of(&self.leaf.path, options, None).within(companions);
        let standing = TilePlacement { root_from_tile, tile_from_scene, companions };
        let stood = deliver_placed(input, &mut **sink, *detailing, &standing)?;
        self.is_geocentric |= stood.origins.iter().any(|origin| SURFACE.contains(&origin.length()));
        Ok(stood.triangles)
    }
}

/// Up to `length` bytes of the file, fewer at its end.
pub(super) fn piece(source: &mut dyn Bytes, at: u64, length: u64, path: &Path) -> Result<Vec<u8>, ReadError> {
    let cannot = |source| ReadError::Io { file: path.to_owned(), offset: at, source };
    source.seek(SeekFrom::Start(at)).map_err(cannot)?;
    let mut bytes = Vec::new();
    source.take(length).read_to_end(&mut bytes).map_err(cannot)?;
    Ok(bytes)
}
