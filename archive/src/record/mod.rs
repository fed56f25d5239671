//! The records of a version: one file per standard, all from the same [`Publication`].
//!
//! Deterministic: the same publication gives the same bytes; no clock, no random numbers, lists in the order of the metadata. Addresses are
//! absolute where the metadata says where the object will be (`url`), relative to the file else.

mod citation;
mod datacite;
mod dublin_core;
mod edm;
mod iiif;
mod links;
mod paradata;
mod photographs;
mod ro_crate;
mod schema_org;
mod text;
pub mod xml;

pub use citation::citation;
pub use datacite::CONTRIBUTORS;
pub use edm::europeana_lacks;
pub use ro_crate::ro_crate;
pub use schema_org::schema_org;

use super::checksums::{Checksum, sha256};
use super::colour_report::{COLOUR_REPORT_MAX, ColourReport, Photograph};
use super::holes::{HOLES_MAX, Holes};
use super::layout::{
    ANNOTATIONS, CITATIONS, COLOUR_REPORT, DATACITE, DUBLIN_CORE, EDM, HOLES, IIIF, IIIF_ANNOTATIONS, LICENCE, LINKSET,
    METADATA, OEMBED, PARADATA, PREVIEW, PREVIEW_MAX, README, Slug, version_folder,
};
use super::manifest::{Figures, PackEntry};
use super::metadata::{Agent, AgentKind, Metadata, PhotographsField};
use super::notes::{NOTES_MAX, Notes};
use super::rights::Rights;
use super::viewer::content_type;
use glam::DVec3;
use kilwa_files::plain_file;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// One version about to be published: all that its records say.
#[derive(Debug, Clone)]
pub struct Publication {
    /// What a person wrote, without its place where that is not to be published.
    pub metadata: Metadata,
    /// Its statement of rights.
    pub rights: Rights,
    /// Name in the address.
    pub slug: Slug,
    /// Number of the version, from 1.
    pub version: u32,
    /// Day of publication.
    pub published: String,
    /// Day of the first version.
    pub first_published: String,
    /// What is new in it.
    pub note: String,
    /// The pack.
    pub pack: PackEntry,
    /// Its numbers.
    pub figures: Figures,
    /// What the pack says of itself.
    pub of_pack: kilwa_pack::Metadata,
    /// Whether reference system and place were removed or made coarse.
    pub location_redacted: bool,
    /// Largest distance of `preview.glb` from the finest surface in metres, and its triangles; where there is one.
    pub preview: Option<Preview>,
    /// What people wrote about places on it, where anybody did.
    pub notes: Option<PublishedNotes>,
    /// The list of the holes of its surface, where one was given.
    pub holes: Option<PublishedHoles>,
    /// The 3D Tiles of it, where they were made.
    pub tiles: Option<PublishedTiles>,
    /// The colour report, if there is one.
    pub colours: Option<PublishedColours>,
    /// Program and version that publishes.
    pub tool: String,
}

/// What is known of `preview.glb`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preview {
    /// Length of the file.
    pub bytes: u64,
    /// Its triangles.
    pub triangles: u64,
    /// Certified distance from the finest surface, metres.
    pub error: f64,
}

/// The notes of a version, as its file has them.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedNotes {
    /// What stands in it.
    pub notes: Notes,
    /// Its length.
    pub bytes: u64,
    /// Its SHA-256.
    pub sha256: Checksum,
    /// Which place of the pack is zero in `preview.glb`, metres.
    pub origin: DVec3,
}

/// The list of holes of a version, as its file has it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PublishedHoles {
    /// How many there are.
    pub count: usize,
    /// Length of the file.
    pub bytes: u64,
    /// Its SHA-256.
    pub sha256: Checksum,
}

/// The colour report of a version, as its file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedColours {
    /// What it says.
    pub report: ColourReport,
    /// Length of the file.
    pub bytes: u64,
    /// Its SHA-256.
    pub sha256: Checksum,
    /// The photographs that the version includes, if it does.
    pub included: Option<Included>,
}

/// Photographs, masks and smaller copies that a version includes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Included {
    /// How many photographs.
    pub photographs: u64,
    /// How many masks, which photographs can share.
    pub masks: u64,
    /// Bytes of photographs and masks.
    pub bytes: u64,
    /// How many smaller copies of photographs.
    pub copies: u64,
    /// Bytes of the smaller copies.
    pub copy_bytes: u64,
}

impl Included {
    /// Those of a report; None if it names no files of the version.
    pub fn of(report: &ColourReport) -> Option<Self> {
        let photographs: BTreeSet<&str> = report.photographs.iter().filter_map(|photo| photo.path.as_deref()).collect();
        let copies: BTreeSet<&str> =
            report.photographs.iter().flat_map(Photograph::copies).map(|copy| copy.path.as_str()).collect();
        let mut included = Self::default();
        for file in report.files() {
            if copies.contains(file.path) {
                included.copies += 1;
                included.copy_bytes += file.bytes;
                continue;
            }
            let count = if photographs.contains(file.path) { &mut included.photographs } else { &mut included.masks };
            *count += 1;
            included.bytes += file.bytes;
        }
        (included != Self::default()).then_some(included)
    }

    /// How many files there are.
    pub fn files(&self) -> u64 {
        self.photographs + self.masks + self.copies
    }

    /// Bytes of all files.
    pub fn all_bytes(&self) -> u64 {
        self.bytes + self.copy_bytes
    }
}

/// The 3D Tiles of a version.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedTiles {
    /// Length of the root, `tiles/tileset.json`.
    pub root_bytes: u64,
    /// Its SHA-256.
    pub sha256: Checksum,
    /// How many tiles there are.
    pub tiles: u64,
    /// Bytes of all files.
    pub bytes: u64,
    /// Whether they need `EXT_meshopt_compression`.
    pub is_compressed: bool,
    /// Whether they are placed on the globe; if not, they have the coordinates of the pack.
    pub is_on_globe: bool,
    /// Height of the geoid above the ellipsoid that was added to all heights, metres.
    pub geoid_offset: Option<f64>,
}

/// Which place of the pack is zero in a preview that `kilwa publish` made.
fn origin_of(glb: &[u8]) -> Option<DVec3> {
    let word = |at: usize| Some(u32::from_le_bytes(glb.get(at..at + 4)?.try_into().ok()?));
    let json = glb.get(20..20usize.checked_add(word(12)? as usize)?)?;
    let value: Value = kilwa_pack::json::from_slice(json).ok()?;
    let place: DVec3 = serde_json::from_value(value.pointer("/extras/world_from_local_m")?.clone()).ok()?;
    place.is_finite().then_some(place)
}

impl Publication {
    /// With the notes that lie in the version's folder, where any do. They were checked before.
    ///
    /// # Errors
    /// When they or the preview cannot be read.
    pub fn with_notes(mut self, folder: &Path) -> io::Result<Self> {
        let bytes = match plain_file::read_at(&folder.join(ANNOTATIONS), NOTES_MAX) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(self),
            bytes => bytes?,
        };
        let notes = Notes::parse(&bytes).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
        let origin = match self.preview {
            Some(_) => origin_of(&plain_file::read_at(&folder.join(PREVIEW), PREVIEW_MAX)?),
            None => None,
        };
        let [min, max] = self.figures.bounds;
        let origin = origin.unwrap_or_else(|| [0, 1, 2].map(|k| f64::midpoint(min[k], max[k])).into());
        self.notes = Some(PublishedNotes { notes, bytes: bytes.len() as u64, sha256: sha256(&bytes), origin });
        Ok(self)
    }

    /// With the list of holes in the version's folder, if there is one. It was checked before.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn with_holes(mut self, folder: &Path) -> io::Result<Self> {
        let bytes = match plain_file::read_at(&folder.join(HOLES), HOLES_MAX) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(self),
            bytes => bytes?,
        };
        let holes = Holes::parse(&bytes).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
        self.holes =
            Some(PublishedHoles { count: holes.holes.len(), bytes: bytes.len() as u64, sha256: sha256(&bytes) });
        Ok(self)
    }

    /// With the colour report in the version's folder, if there is one. It was checked before.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn with_colours(mut self, folder: &Path) -> io::Result<Self> {
        let bytes = match plain_file::read_at(&folder.join(COLOUR_REPORT), COLOUR_REPORT_MAX) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(self),
            bytes => bytes?,
        };
        let report = ColourReport::parse(&bytes).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
        let included = Included::of(&report);
        self.colours = Some(PublishedColours { report, bytes: bytes.len() as u64, sha256: sha256(&bytes), included });
        Ok(self)
    }

    /// The photographs that the version includes, with their rights.
    pub fn photographs(&self) -> Option<(Included, &PhotographsField)> {
        self.colours.as_ref()?.included.zip(self.metadata.photographs.as_ref())
    }

    /// Absolute address of the object, ending with `/`.
    pub fn url(&self) -> Option<&str> {
        self.metadata.url.as_deref()
    }

    /// Address of a file of this version, for a record that lies `depth` folders below the version's.
    fn file(&self, path: &str, depth: usize) -> String {
        match self.url() {
            Some(url) => format!("{url}{}/{path}", version_folder(self.version)),
            None => format!("{}{path}", "../".repeat(depth)),
        }
    }

    /// Address of the object, for a record that lies `depth` folders below the version's.
    fn page(&self, depth: usize) -> String {
        self.url().map_or_else(|| "../".repeat(depth + 1), str::to_owned)
    }

    /// The identifier that lasts longest: DOI and the like, else the address, else the pack's identity.
    fn identifier(&self) -> String {
        let m = &self.metadata;
        let known = m.identifier.clone().or_else(|| m.url.clone());
        known.unwrap_or_else(|| format!("urn:kilwa:{}", self.pack.identity))
    }

    /// Year of publication.
    fn year(&self) -> &str {
        self.published.get(..4).unwrap_or_default()
    }

    /// File name of the pack.
    fn pack_file(&self) -> &str {
        self.pack.url.rsplit('/').next().unwrap_or_default()
    }

    /// Name and country of the place.
    pub fn place(&self) -> Option<String> {
        let place = self.metadata.place.as_ref()?;
        let parts: Vec<&str> = [place.name.as_deref(), place.country.as_deref()].into_iter().flatten().collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    }

    /// Width, depth and height, metres.
    pub fn size(&self) -> DVec3 {
        let [min, max] = self.figures.bounds;
        max - min
    }
}

impl Agent {
    /// Family name and given names of a person written `Family, Given`.
    pub fn parts(&self) -> Option<(&str, &str)> {
        if self.kind != AgentKind::Person {
            return None;
        }
        self.name.split_once(',').map(|(family, given)| (family.trim(), given.trim()))
    }
}

/// All records but RO-Crate (which lists every file) and the list of checksums: path in the version folder, content.
pub fn records(p: &Publication) -> Vec<(&'static str, Vec<u8>)> {
    let mut all = vec![
        (DUBLIN_CORE, dublin_core::dublin_core(p).into_bytes()),
        (DATACITE, json(&datacite::datacite(p))),
        (EDM, edm::edm(p).into_bytes()),
        (PARADATA, json(&paradata::paradata(p))),
        (METADATA, json(&serde_json::to_value(&p.metadata).unwrap_or_default())),
        (IIIF, json(&iiif::iiif(p))),
        (LINKSET, json(&links::linkset(p))),
        (CITATIONS[0], format!("{}\n", citation(p)).into_bytes()),
        (CITATIONS[1], citation::bibtex(p).into_bytes()),
        (CITATIONS[2], citation::ris(p).into_bytes()),
        (LICENCE, text::licence(p).into_bytes()),
        (README, text::readme(p).into_bytes()),
    ];
    all.extend(links::oembed(p).map(|value| (OEMBED, json(&value))));
    all.extend(iiif::annotations(p).map(|value| (IIIF_ANNOTATIONS, json(&value))));
    all
}

/// Indented, with a line break at the end; keys sorted.
fn json(value: &Value) -> Vec<u8> {
    let mut text = format!("{value:#}");
    text.push('\n');
    text.into_bytes()
}

/// Media type of a file, by its name: the type that the server sends, without the character set. JSON-LD and link sets are exceptions, because
/// programs that read the records look for their types.
pub fn media_type(path: &str) -> &'static str {
    if path.ends_with(IIIF) || path.ends_with(ANNOTATIONS) {
        return "application/ld+json";
    }
    if path.ends_with(LINKSET) {
        return "application/linkset+json";
    }
    let served = content_type(path);
    served.split_once(';').map_or(served, |(kind, _)| kind)
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
