//! `manifest.json`: what an object is, small, replaced last; what `kilwa serve` and `kilwa verify` begin with.
//!
//! Read strictly: another major version, a version folder that is named twice or not in order, a path that leaves the folder, numbers that
//! are not finite are refused with the field. Its last property is a seal, the SHA-256 of the text without it: the manifest is the one file
//! that no list of checksums can hold. A reader may pass over it; `kilwa verify` does not. Lengths in metres in the pack's reference system, z up. URLs are relative to the manifest.

use super::checksums::{Checksum, is_sha256, sha256};
use super::date::is_day;
use super::layout::{ANNOTATIONS, COLOUR_REPORT, HOLES, PHOTOGRAPHS, Slug, TILESET, pack_name, safe, version_folder};
use super::rights::Rights;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The version of this form that is written, and the only one that is read.
pub const FORM: u32 = 1;
/// Largest manifest that is read, bytes.
pub const MANIFEST_MAX: u64 = 4 << 20;

/// Why a manifest is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ManifestError {
    /// No JSON of this form.
    #[error("it is not the manifest of an object: {0}")]
    Form(String),
    /// Written by a later program.
    #[error("its manifest has format version {0}; this program reads version {FORM}. Use a newer kilwa")]
    Newer(u64),
    /// Something in it cannot be.
    #[error("{field}: {why}")]
    Wrong {
        /// For example `versions[1].pack.url`.
        field: String,
        /// What is wrong.
        why: String,
    },
}

/// How a manifest ends without its seal, what stands before the seal's digits, and what after them.
const END: &[u8] = b"\n}\n";
const SEAL: &[u8] = b",\n  \"seal\": \"";
const AFTER: &[u8] = b"\"\n}\n";

/// Whether a manifest is as it was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seal {
    /// Its seal is that of its text.
    Whole,
    /// It was changed after it was written.
    Broken,
    /// It has none.
    None,
}

/// Check the seal of a manifest's text.
pub fn seal_of(bytes: &[u8]) -> Seal {
    match unsealed(bytes) {
        Some((text, seal)) if sha256(&text).as_bytes() == seal => Seal::Whole,
        Some(_) => Seal::Broken,
        // A seal that is not where it was written was moved or damaged.
        None if bytes.windows(6).any(|w| w == b"\"seal\"") => Seal::Broken,
        None => Seal::None,
    }
}

/// The text with its seal.
fn sealed(text: Vec<u8>) -> Vec<u8> {
    let Some(body) = text.strip_suffix(END) else { return text };
    [body, SEAL, sha256(&text).as_bytes(), AFTER].concat()
}

/// The text without its seal, and the seal's digits.
fn unsealed(bytes: &[u8]) -> Option<(Vec<u8>, &[u8])> {
    let (body, seal) = bytes.strip_suffix(AFTER)?.split_last_chunk::<64>()?;
    Some(([body.strip_suffix(SEAL)?, END].concat(), seal))
}

/// Who may see an object. An embargo ends by itself: compare [`Access::until`] with today in UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AccessState {
    /// Everybody.
    Public,
    /// Everybody, from a day on.
    Embargo,
    /// Who is allowed to.
    Restricted,
    /// Nobody any more; a tombstone is left.
    Withdrawn,
}

/// Who may see it, and why not everybody.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Access {
    /// Who.
    pub state: AccessState,
    /// First day that is public, of an embargo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
    /// Why.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Whom to ask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<String>,
    /// Day it was withdrawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub withdrawn: Option<String>,
}

/// Rights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RightsEntry {
    /// Canonical address of a known statement.
    pub uri: String,
    /// Its name.
    pub label: String,
    /// Its short name, for cards.
    pub short: String,
    /// Who holds the rights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
}

/// A file, relative to the manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Relative address.
    pub url: String,
    /// Length.
    pub bytes: u64,
    /// SHA-256.
    pub sha256: Checksum,
}

/// The photographs that a version includes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographsEntry {
    /// Relative address of their folder, `v1/photographs/`.
    pub url: String,
    /// How many files there are, masks included.
    pub files: u64,
    /// Bytes of all of them.
    pub bytes: u64,
    /// Canonical address of their statement of rights.
    pub rights: String,
}

/// The pack of a version.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackEntry {
    /// Relative address, `v1/pack.<sha256>.kilwa`.
    pub url: String,
    /// Length.
    pub bytes: u64,
    /// SHA-256.
    pub sha256: Checksum,
    /// What measurements and notes call it (docs/FORMAT.md section 7): 32 hexadecimal digits.
    pub identity: String,
}

/// Numbers of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figures {
    /// Smallest and largest corner, metres.
    pub bounds: [DVec3; 2],
    /// Reference system; without it, local.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crs: Option<String>,
    /// Units of the pack: always `m`.
    pub units: String,
    /// Units of the mesh that it was built from.
    pub source_units: String,
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Points, if the pack is made of points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// Vertices of the finest level.
    pub vertices: u64,
    /// Median edge of the finest level, metres.
    pub spacing: f64,
    /// Standard uncertainty of the capture, metres, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
}

impl Figures {
    /// What the model is made of, and how many: its points, else its triangles.
    pub fn parts(&self) -> (&'static str, u64) {
        self.points.map_or(("Triangles", self.triangles), |points| ("Points", points))
    }

    /// The same in words: `80 points`.
    pub fn counted(&self) -> String {
        let (what, count) = self.parts();
        format!("{count} {}", what.to_lowercase())
    }
}

/// One version. Its folder never changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Version {
    /// From 1, in order.
    pub version: u32,
    /// Its folder, `v1`.
    pub folder: String,
    /// Day of publication, UTC.
    pub published: String,
    /// What is new in it.
    pub note: String,
    /// The pack.
    pub pack: PackEntry,
    /// Its list of checksums: the hash of all hashes.
    pub checksums: FileEntry,
    /// Its notes, where it has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub annotations: Option<FileEntry>,
    /// The holes of its surface, where they were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holes: Option<FileEntry>,
    /// The root of its 3D Tiles, where it has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tiles: Option<FileEntry>,
    /// The colour report, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour_report: Option<FileEntry>,
    /// The photographs that the colours come from, if the version includes them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photographs: Option<PhotographsEntry>,
    /// Its numbers.
    pub figures: Figures,
    /// Whether reference system and place were removed or made coarse before publication.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub location_redacted: bool,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of this form: [`FORM`].
    pub kilwa: u32,
    /// Name in the address.
    pub slug: String,
    /// Title.
    pub title: String,
    /// What it shows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Language of the texts, BCP 47.
    pub language: String,
    /// Where the site is, for lists: name and country.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// When it was captured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub captured: Option<String>,
    /// Keywords.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub subjects: Vec<String>,
    /// Names of who made it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub creators: Vec<String>,
    /// Absolute address, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub url: Option<String>,
    /// DOI or the like.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identifier: Option<String>,
    /// Rights.
    pub rights: RightsEntry,
    /// How to cite the current version, one line of text.
    pub citation: String,
    /// Who may see it.
    pub access: Access,
    /// Number of the version that is shown.
    pub current: u32,
    /// All versions, from 1.
    pub versions: Vec<Version>,
    /// The landing page as it was written with this manifest.
    pub page: FileEntry,
    /// Who wrote it.
    pub tool: String,
}

impl Manifest {
    /// Read a manifest.
    ///
    /// # Errors
    /// [`ManifestError`] with the field.
    pub fn parse(bytes: &[u8]) -> Result<Self, ManifestError> {
        let unsealed = unsealed(bytes);
        let bytes = unsealed.as_ref().map_or(bytes, |(text, _)| text.as_slice());
        let value: serde_json::Value =
            kilwa_pack::json::from_slice(bytes).map_err(|e| ManifestError::Form(e.to_string()))?;
        match value.get("kilwa").and_then(serde_json::Value::as_u64) {
            Some(form) if form == u64::from(FORM) => {}
            Some(form) => return Err(ManifestError::Newer(form)),
            None => return Err(ManifestError::Form("it has no number \"kilwa\"".to_owned())),
        }
        // From the text again: its errors have a line.
        let manifest: Self = serde_json::from_slice(bytes).map_err(|e| ManifestError::Form(e.to_string()))?;
        manifest.check()?;
        Ok(manifest)
    }

    /// As it is written: indented, the same manifest the same bytes.
    ///
    /// # Errors
    /// [`ManifestError`] where it would not read back.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ManifestError> {
        self.check()?;
        let mut bytes = serde_json::to_vec_pretty(self).map_err(|e| ManifestError::Form(e.to_string()))?;
        bytes.push(b'\n');
        Ok(sealed(bytes))
    }

    /// The version that is shown.
    pub fn current(&self) -> Option<&Version> {
        self.versions.iter().find(|v| v.version == self.current)
    }

    fn check(&self) -> Result<(), ManifestError> {
        let wrong = |field: String, why: &str| Err(ManifestError::Wrong { field, why: why.to_owned() });
        if let Err(e) = Slug::new(&self.slug) {
            return wrong("slug".to_owned(), &e.to_string());
        }
        if self.title.trim().is_empty() {
            return wrong("title".to_owned(), "it is empty");
        }
        if self.versions.is_empty() {
            return wrong("versions".to_owned(), "there is none");
        }
        for (number, version) in (1..).zip(&self.versions) {
            version.check(number)?;
        }
        if self.current().is_none() {
            return wrong("current".to_owned(), "no version has this number");
        }
        let days = [("access.until", &self.access.until), ("access.withdrawn", &self.access.withdrawn)];
        for (field, day) in days {
            if day.as_deref().is_some_and(|d| !is_day(d)) {
                return wrong(field.to_owned(), "expected a date such as 2026-11-21");
            }
        }
        if self.access.state == AccessState::Embargo && self.access.until.is_none() {
            return wrong("access.until".to_owned(), "an embargo needs the first public day");
        }
        self.page.check("page", "")
    }
}

impl FileEntry {
    fn check(&self, field: &str, folder: &str) -> Result<(), ManifestError> {
        check_file(field, folder, &self.url, &self.sha256)
    }
}

fn check_file(field: &str, folder: &str, url: &str, sha256: &str) -> Result<(), ManifestError> {
    let wrong = |name: &str, why: String| Err(ManifestError::Wrong { field: format!("{field}.{name}"), why });
    if !safe(url) || !url.starts_with(folder) {
        return wrong(
            "url",
            format!("{url:?} is not a path in {}", if folder.is_empty() { "the object" } else { folder }),
        );
    }
    if !is_sha256(sha256) {
        return wrong("sha256", "expected 64 lower-case hexadecimal digits".to_owned());
    }
    Ok(())
}

/// The SHA-256 of files that not every version has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Optional<'a> {
    /// Its notes.
    pub notes: Option<&'a str>,
    /// Its list of holes.
    pub holes: Option<&'a str>,
    /// The root of its 3D Tiles.
    pub tiles: Option<&'a str>,
    /// The colour report, which names the photographs.
    pub colour_report: Option<&'a str>,
}

impl Version {
    /// The files that not every version has.
    pub fn optional(&self) -> Optional<'_> {
        fn sum(file: Option<&FileEntry>) -> Option<&str> {
            file.map(|file| file.sha256.as_str())
        }
        Optional {
            notes: sum(self.annotations.as_ref()),
            holes: sum(self.holes.as_ref()),
            tiles: sum(self.tiles.as_ref()),
            colour_report: sum(self.colour_report.as_ref()),
        }
    }

    fn check(&self, number: u32) -> Result<(), ManifestError> {
        let at = |name: &str| format!("versions[{}].{name}", number - 1);
        let wrong = |name: &str, why: &str| Err(ManifestError::Wrong { field: at(name), why: why.to_owned() });
        if self.version != number || self.folder != version_folder(number) {
            return wrong("version", "versions are numbered from 1 without gaps, in v1, v2 and so on");
        }
        if !is_day(&self.published) {
            return wrong("published", "expected a date such as 2026-11-21");
        }
        let folder = format!("{}/", self.folder);
        check_file(&at("pack"), &folder, &self.pack.url, &self.pack.sha256)?;
        if self.pack.url != format!("{folder}{}", pack_name(&self.pack.sha256)) {
            return wrong("pack.url", "the name of a pack must contain its SHA-256");
        }
        if self.pack.identity.len() != 32 || !self.pack.identity.bytes().all(|b| b.is_ascii_hexdigit()) {
            return wrong("pack.identity", "expected 32 hexadecimal digits");
        }
        self.checksums.check(&at("checksums"), &folder)?;
        if let Some(notes) = &self.annotations {
            notes.check(&at("annotations"), &folder)?;
            if notes.url != format!("{folder}{ANNOTATIONS}") {
                return wrong("annotations.url", "notes must be in annotations.json of the version");
            }
        }
        if let Some(holes) = &self.holes {
            holes.check(&at("holes"), &folder)?;
            if holes.url != format!("{folder}{HOLES}") {
                return wrong("holes.url", "holes must be in holes.geojson of the version");
            }
        }
        if let Some(tiles) = &self.tiles {
            tiles.check(&at("tiles"), &folder)?;
            if tiles.url != format!("{folder}{TILESET}") {
                return wrong("tiles.url", "3D Tiles must begin at tiles/tileset.json of the version");
            }
        }
        self.check_colours(&at, &folder)?;
        let [min, max] = self.figures.bounds;
        if !min.is_finite() || !max.is_finite() || min.cmpgt(max).any() {
            return wrong("figures.bounds", "expected the smallest and the largest corner");
        }
        Ok(())
    }

    fn check_colours(&self, at: &dyn Fn(&str) -> String, folder: &str) -> Result<(), ManifestError> {
        let wrong = |name: &str, why: &str| Err(ManifestError::Wrong { field: at(name), why: why.to_owned() });
        if let Some(report) = &self.colour_report {
            report.check(&at("colour_report"), folder)?;
            if report.url != format!("{folder}{COLOUR_REPORT}") {
                return wrong("colour_report.url", "the colour report must be in colour-report.json of the version");
            }
        }
        if let Some(photographs) = &self.photographs {
            if self.colour_report.is_none() {
                return wrong("photographs", "photographs need a colour report, which names them");
            }
            if photographs.url != format!("{folder}{PHOTOGRAPHS}/") {
                return wrong("photographs.url", "photographs must be in the folder photographs of the version");
            }
            if !Rights::parse(&photographs.rights).is_ok_and(|rights| rights.uri == photographs.rights) {
                return wrong("photographs.rights", "expected the address of a known statement of rights");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "manifest_tests.rs"]
pub(crate) mod tests;
