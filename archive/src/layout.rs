//! Where things are in an object: names and paths, all relative, with `/`.
//!
//! Invariant: a [`Slug`] and a [`safe`] path can be joined to a folder without leaving it.

use std::fmt;
use std::path::Path;
use thiserror::Error;

/// Files of a version; one with more is neither published nor served. A model of 10^9 triangles has about 70,000 3D Tiles.
pub const FILES_MAX: usize = 200_000;
/// The landing page, in the root.
pub const PAGE: &str = "index.html";
/// The manifest, in the root.
pub const MANIFEST: &str = "manifest.json";
/// Files that are read whole (manifests, records, landing pages) are at most this long, bytes.
pub const SMALL_FILE_MAX: u64 = 16 << 20;
/// The list of checksums of a version folder.
pub const CHECKSUMS: &str = "checksums.sha256";
/// Picture for cards and links, 1200×630.
pub const POSTER: &str = "poster.jpg";
/// Smaller posters: name and width in pixels; each is as high as its width × 630 / 1200.
pub const THUMBNAILS: [(&str, u32); 2] = [("poster-600.jpg", 600), ("poster-300.jpg", 300)];
/// Folder of the drawings to scale, `drawings/plan.png` and so on.
pub const DRAWINGS: &str = "drawings";
/// A decimated model that opens in any program.
pub const PREVIEW: &str = "preview.glb";
/// Largest preview, bytes.
pub const PREVIEW_MAX: u64 = 5_000_000;
/// Notes on the model, where there are any: Web Annotations.
pub const ANNOTATIONS: &str = "annotations.json";
/// The same in the coordinates of the IIIF manifest's scene.
pub const IIIF_ANNOTATIONS: &str = "iiif/annotations.json";
/// The holes of the surface, where they were given: GeoJSON in coordinates of the pack.
pub const HOLES: &str = "holes.geojson";
/// Folder of the 3D Tiles, where there are any.
pub const TILES: &str = "tiles";
/// Their root.
pub const TILESET: &str = "tiles/tileset.json";
/// The colour report, if there is one: what `kilwa colour --report` wrote.
pub const COLOUR_REPORT: &str = "colour-report.json";
/// Folder of the photographs that the colours come from, with their masks, if the version includes them.
pub const PHOTOGRAPHS: &str = "photographs";
/// IIIF Presentation manifest.
pub const IIIF: &str = "iiif/manifest.json";
/// Dublin Core.
pub const DUBLIN_CORE: &str = "metadata/dc.xml";
/// DataCite 4.5, as its REST interface takes it.
pub const DATACITE: &str = "metadata/datacite.json";
/// Europeana Data Model, RDF/XML.
pub const EDM: &str = "metadata/edm.xml";
/// What was captured, how, by which tools.
pub const PARADATA: &str = "metadata/paradata.json";
/// The metadata that all of this was made of ([`super::Metadata`]).
pub const METADATA: &str = "metadata/metadata.json";
/// RO-Crate 1.1.
pub const CRATE: &str = "ro-crate-metadata.json";
/// Links to everything, RFC 9264.
pub const LINKSET: &str = "linkset.json";
/// oEmbed answer.
pub const OEMBED: &str = "oembed.json";
/// Citations for people, BibTeX and reference managers.
pub const CITATIONS: [&str; 3] = ["citation.txt", "citation.bib", "citation.ris"];
/// The licence.
pub const LICENCE: &str = "LICENSE.txt";
/// What this is, and how to get the mesh out without Kilwa.
pub const README: &str = "README.txt";
/// Folder of the viewer's files.
pub const VIEWER: &str = "viewer";
/// Names that are no object, in a folder of objects: of a static site, and first parts of addresses that `kilwa serve` answers itself.
pub const RESERVED: [&str; 20] = [
    "uploads",
    "sign-in",
    "sign-out",
    "assets",
    "viewer",
    "packs",
    "m",
    "index",
    "feed",
    "feeds",
    "healthz",
    "metrics",
    "models",
    "search",
    "map",
    "oai",
    "oembed",
    "collections",
    "sitemap",
    "login",
];

/// Longest slug.
const SLUG_MAX: usize = 64;

/// Why a name cannot be a slug.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "\"{0}\" cannot be the name in the address: use 1 to 64 of a-z, 0-9 and single hyphens between them, for example {1}"
)]
pub struct SlugError(String, String);

/// The name of an object in its address and on disk: 1 to 64 of `a-z`, `0-9` and single hyphens between them.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slug(String);

impl Slug {
    /// Check a name.
    ///
    /// # Errors
    /// [`SlugError`], which proposes one.
    pub fn new(text: &str) -> Result<Self, SlugError> {
        let proposed = Self::of_title(text);
        if proposed.0 == text && !RESERVED.contains(&text) && !is_version(text) {
            return Ok(proposed);
        }
        let other = if proposed.0 == text { format!("{text}-model") } else { proposed.0 };
        Err(SlugError(text.chars().take(100).collect(), other))
    }

    /// A slug from a title: letters without their accents, everything else a hyphen.
    pub fn of_title(title: &str) -> Self {
        let mut slug = String::new();
        for c in title.chars() {
            if c.is_ascii_alphanumeric() {
                slug.push(c.to_ascii_lowercase());
            } else if let Some(plain) = without_accent(c) {
                slug.push_str(plain);
            } else if !slug.is_empty() && !slug.ends_with('-') && !is_mark(c) {
                slug.push('-');
            }
        }
        slug.truncate(SLUG_MAX);
        let slug = slug.trim_end_matches('-');
        Self(if slug.is_empty() { "model".to_owned() } else { slug.to_owned() })
    }

    /// As text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Slug {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Apostrophes and combining accents vanish; they part no words.
fn is_mark(c: char) -> bool {
    matches!(c, '\'' | '’' | 'ʼ' | '\u{300}'..='\u{36f}')
}

fn without_accent(c: char) -> Option<&'static str> {
    Some(match c {
        'À'..='Å' | 'à'..='å' | 'Ā'..='ą' => "a",
        'Æ' | 'æ' => "ae",
        'Ç' | 'ç' | 'Ć'..='č' => "c",
        'Ď'..='đ' => "d",
        'È'..='Ë' | 'è'..='ë' | 'Ē'..='ě' => "e",
        'Ĝ'..='ģ' => "g",
        'Ĥ'..='ħ' => "h",
        'Ì'..='Ï' | 'ì'..='ï' | 'Ĩ'..='ı' => "i",
        'Ĺ'..='ł' => "l",
        'Ñ' | 'ñ' | 'Ń'..='ň' => "n",
        'Ò'..='Ö' | 'Ø' | 'ò'..='ö' | 'ø' | 'Ō'..='ő' => "o",
        'Œ' | 'œ' => "oe",
        'Ŕ'..='ř' => "r",
        'Ś'..='š' => "s",
        'ß' => "ss",
        'Ţ'..='ŧ' => "t",
        'Ù'..='Ü' | 'ù'..='ü' | 'Ũ'..='ų' => "u",
        'Ý' | 'ý' | 'ÿ' | 'Ŷ'..='Ÿ' => "y",
        'Ź'..='ž' => "z",
        _ => return None,
    })
}

/// Name of the folder of a version, `v1` and so on.
pub fn version_folder(number: u32) -> String {
    format!("v{number}")
}

/// The number of a version folder's name.
pub fn version_of(folder: &str) -> Option<u32> {
    let number = folder.strip_prefix('v')?.parse().ok()?;
    (number > 0 && version_folder(number) == folder).then_some(number)
}

fn is_version(text: &str) -> bool {
    version_of(text).is_some()
}

/// File name of a pack in its version folder, from its SHA-256 in hexadecimal.
pub fn pack_name(sha256: &str) -> String {
    format!("pack.{sha256}.kilwa")
}

/// Whether a path from a manifest or a list of checksums can be joined to a folder: relative, plain names, `/` between them, no dot first.
pub fn safe(path: &str) -> bool {
    let plain = |part: &str| {
        !part.is_empty() && !part.starts_with('.') && part.chars().all(|c| !c.is_control() && !"\\:*?\"<>|".contains(c))
    };
    path.len() <= 1000 && path.split('/').all(plain)
}

/// Whether a path in a version is one that a photograph or a mask can have.
pub fn is_photograph(path: &str) -> bool {
    let ending = path.rsplit_once('.').map(|(_, ending)| ending);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "./-_".contains(c);
    path.strip_prefix(PHOTOGRAPHS).is_some_and(|rest| rest.starts_with('/'))
        && safe(path)
        && path.chars().all(is_plain)
        && ending.is_some_and(|ending| ["jpg", "png"].contains(&ending))
}

/// Whether a folder is an object: it has a manifest.
pub fn is_object(folder: &Path) -> bool {
    folder.join(MANIFEST).is_file()
}

/// Whether a file, given by its path in an object or in a version of it, contains the geometry of the model: packs, other mesh formats, 3D Tiles
/// with the JSON that says where they are, and what only those may have who may have the model.
pub fn is_geometry(name: &str) -> bool {
    // Notes and holes contain positions on the model, and the colour report those of cameras.
    if name.rsplit('/').next().is_some_and(|name| [ANNOTATIONS, HOLES, COLOUR_REPORT].contains(&name)) {
        return true;
    }
    // Photographs show what the model shows.
    if name.rsplit('/').skip(1).any(|folder| [TILES, PHOTOGRAPHS].contains(&folder)) {
        return true;
    }
    let end = name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    ["kilwa", "glb", "gltf", "bin", "ply", "obj", "stl"].contains(&end.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_becomes_a_slug() {
        let of = |t: &str| Slug::of_title(t).to_string();
        assert_eq!(of("Gereza, Kilwa Kisiwani"), "gereza-kilwa-kisiwani");
        assert_eq!(of("  Château d’Œuf — Nº 3 "), "chateau-doeuf-n-3");
        assert_eq!(of("قلعة"), "model");
        assert!(of(&"x".repeat(500)).len() <= 64);
        for good in ["a", "fort-2", "x9"] {
            assert!(Slug::new(good).is_ok());
        }
        for bad in ["", "A", "a--b", "-a", "a-", "a/b", "..", "v1", "viewer", "a b", "ä"] {
            let message = Slug::new(bad).unwrap_err().to_string();
            assert!(message.contains("for example"), "{message}");
        }
    }

    #[test]
    fn no_path_leaves_its_folder() {
        for good in ["a", "a/b.c", "metadata/dc.xml", "viewer/i18n/en.json"] {
            assert!(safe(good), "{good}");
        }
        for bad in ["", "/", "/a", "a/", "a//b", "..", "a/../b", ".x", "a/.x", "c:\\x", "a\\b", "a\nb", "a:b"] {
            assert!(!safe(bad), "{bad}");
        }
        assert_eq!(version_of("v12"), Some(12));
        for bad in ["v0", "v01", "v", "1", "v1x", "v-1", "v+1"] {
            assert_eq!(version_of(bad), None, "{bad}");
        }
    }
}
