//! From what is known of a version to the version: `kilwa publish` and the server that takes uploads make the same bytes of the same facts.
//!
//! A version is made of a pack, pictures and a preview, which are handed over as files of a [`Draft`], and of [`Facts`]. Everything else
//! (records, viewer, RO-Crate, checksums, landing page, manifest) is made here, so that whoever hands over facts and files decides about
//! text and pictures, and about no byte that a browser runs. [`agree`] and [`further`] are the rules that both keep to.

use super::draft::{Draft, DraftError};
use super::layout::Slug;
use super::layout::{
    ANNOTATIONS, COLOUR_REPORT, CRATE, HOLES, MANIFEST, METADATA, PHOTOGRAPHS, TILESET, VIEWER, pack_name,
    version_folder,
};
use super::lock::Lock;
use super::manifest::{
    Access, AccessState, FORM, Figures, FileEntry, Manifest, Optional, PackEntry, PhotographsEntry, RightsEntry,
    Version,
};
use super::metadata::{Metadata, crs};
use super::page::{self, Surroundings};
use super::record::{Preview, Publication, citation, records, ro_crate};
use super::rights::Rights;
use crate::layout::SMALL_FILE_MAX;
use crate::viewer::Page;
use glam::{DVec3, Vec3Swizzles};
use kilwa_files::plain_file;
use std::path::{Path, PathBuf};

/// What is known of a version beside its files.
#[derive(Debug, Clone)]
pub struct Facts {
    /// As it will be published: without the place if requested.
    pub metadata: Metadata,
    /// Its statement of rights.
    pub rights: Rights,
    /// Name in the address.
    pub slug: Slug,
    /// What is published already.
    pub before: Option<Manifest>,
    /// Day of publication.
    pub published: String,
    /// What is new.
    pub note: String,
    /// Whether the place was taken out.
    pub location_redacted: bool,
    /// Reference system; without it, local.
    pub crs: Option<String>,
    /// Standard uncertainty of the capture, metres.
    pub accuracy: Option<f64>,
    /// Program and version that publishes.
    pub tool: String,
}

impl Facts {
    /// Number of the version: the next.
    pub fn version(&self) -> u32 {
        next_version(self.before.as_ref())
    }

    /// Where a pack of this content is in the object.
    pub fn pack_entry(&self, bytes: u64, sha256: String, identity: String) -> PackEntry {
        let url = format!("{}/{}", version_folder(self.version()), pack_name(&sha256));
        PackEntry { url, bytes, sha256, identity }
    }

    /// All that its records say. `of_pack` is what the published pack says of itself.
    pub fn publication(&self, pack: PackEntry, of_pack: kilwa_pack::Metadata, preview: Option<Preview>) -> Publication {
        let first = self.before.as_ref().and_then(|m| m.versions.first());
        Publication {
            metadata: self.metadata.clone(),
            rights: self.rights.clone(),
            slug: self.slug.clone(),
            version: self.version(),
            published: self.published.clone(),
            first_published: first.map_or_else(|| self.published.clone(), |v| v.published.clone()),
            note: self.note.clone(),
            pack,
            figures: Figures {
                bounds: [of_pack.bounds_min, of_pack.bounds_max],
                crs: self.crs.clone(),
                units: "m".to_owned(),
                source_units: of_pack.source_units.clone(),
                triangles: of_pack.triangles,
                points: of_pack.is_of_points().then_some(of_pack.vertices),
                vertices: of_pack.vertices,
                spacing: of_pack.median_edge,
                accuracy: self.accuracy,
            },
            of_pack,
            location_redacted: self.location_redacted,
            preview,
            notes: None,
            holes: None,
            tiles: None,
            colours: None,
            tool: self.tool.clone(),
        }
    }

    fn manifest(&self, p: &Publication, checksums: FileEntry, page: FileEntry) -> Manifest {
        let m = &p.metadata;
        let mut versions = self.before.as_ref().map(|b| b.versions.clone()).unwrap_or_default();
        let entry = |path: &str, bytes: u64, sha256: &str| FileEntry {
            url: format!("{}/{path}", version_folder(p.version)),
            bytes,
            sha256: sha256.to_owned(),
        };
        versions.push(Version {
            version: p.version,
            folder: version_folder(p.version),
            published: p.published.clone(),
            note: p.note.clone(),
            pack: p.pack.clone(),
            checksums,
            annotations: p.notes.as_ref().map(|n| entry(ANNOTATIONS, n.bytes, &n.sha256)),
            holes: p.holes.as_ref().map(|n| entry(HOLES, n.bytes, &n.sha256)),
            tiles: p.tiles.as_ref().map(|t| entry(TILESET, t.root_bytes, &t.sha256)),
            colour_report: p.colours.as_ref().map(|c| entry(COLOUR_REPORT, c.bytes, &c.sha256)),
            photographs: p.photographs().map(|(included, rights)| PhotographsEntry {
                url: format!("{}/{PHOTOGRAPHS}/", version_folder(p.version)),
                files: included.files(),
                bytes: included.all_bytes(),
                rights: rights.rights.clone(),
            }),
            figures: p.figures.clone(),
            location_redacted: p.location_redacted,
        });
        let access = m.access.as_ref();
        Manifest {
            kilwa: FORM,
            slug: p.slug.to_string(),
            title: m.title.clone(),
            description: m.description.clone(),
            language: m.language.clone(),
            place: p.place(),
            captured: m.capture.as_ref().and_then(|c| c.date.clone()),
            subjects: m.subjects.clone(),
            creators: m.creators.iter().map(|a| a.name.clone()).collect(),
            url: m.url.clone(),
            identifier: m.identifier.clone(),
            rights: RightsEntry {
                uri: p.rights.uri.clone(),
                label: p.rights.label.clone(),
                short: p.rights.short.clone(),
                holder: m.rights.holder.clone(),
            },
            citation: citation(p),
            access: Access {
                state: access.map_or(AccessState::Public, |a| a.state),
                until: access.and_then(|a| a.until.clone()),
                reason: access.and_then(|a| a.reason.clone()),
                contact: access.and_then(|a| a.contact.clone()),
                withdrawn: None,
            },
            current: p.version,
            versions,
            page,
            tool: p.tool.clone(),
        }
    }
}

/// The number of the version after those of a manifest.
pub fn next_version(before: Option<&Manifest>) -> u32 {
    before.map_or(1, |m| m.versions.len() as u32 + 1)
}

/// What was published.
#[derive(Debug)]
pub struct Completed {
    /// The object's folder.
    pub object: PathBuf,
    /// Files of the version.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
}

/// Write the viewer, which is the same whatever the version says.
///
/// # Errors
/// [`DraftError`].
pub fn write_viewer(draft: &mut Draft<'_>, viewer: &Page) -> Result<(), DraftError> {
    for (name, bytes) in viewer.files().filter(|(name, _)| !name.starts_with("examples/")) {
        draft.write(&format!("{VIEWER}/{name}"), bytes)?;
    }
    Ok(())
}

/// What the landing page of a version shows beside its records.
#[derive(Debug)]
pub struct Landing<'a> {
    /// The viewer that it is made from.
    pub viewer: &'a Page,
    /// Its drawings: path and words.
    pub drawings: Vec<(String, String)>,
    /// Address of a catalogue, relative to the object.
    pub list: Option<String>,
}

/// Write everything beside pack, pictures, preview and viewer, which the draft holds already, and give the version its name. `lock` is that of the
/// folder of objects, under which the facts were decided.
///
/// # Errors
/// [`DraftError`]; the object is as it was before, but for [`DraftError::Unfinished`].
pub fn complete(
    mut draft: Draft<'_>,
    lock: &Lock,
    facts: &Facts,
    publication: &Publication,
    landing: Landing<'_>,
) -> Result<Completed, DraftError> {
    for (path, bytes) in records(publication) {
        draft.write(path, &bytes)?;
    }
    let crate_ = ro_crate(publication, draft.files());
    draft.write(CRATE, &crate_)?;
    let (files, bytes) = (draft.files().len() + 1, draft.files().iter().map(|(_, bytes, _)| bytes).sum());
    let earlier = facts.before.as_ref().map(|m| m.versions.clone()).unwrap_or_default();
    let around = Surroundings { earlier, drawings: landing.drawings, list: landing.list };
    let html = page::landing(landing.viewer.frame()?, publication, &around);
    let manifest = |checksums, page| facts.manifest(publication, checksums, page);
    let object = draft.finish(lock, publication.version, html.as_bytes(), manifest)?;
    Ok(Completed { object, files, bytes })
}

/// Whether the last version of an object in a folder has this very pack and metadata, and these other files.
pub fn is_published(
    object: &Path,
    before: &Manifest,
    pack_sha256: &str,
    metadata: &Metadata,
    optional: Optional<'_>,
) -> bool {
    let is_last = |v: &&Version| v.pack.sha256 == pack_sha256 && v.optional() == optional;
    let Some(last) = before.versions.last().filter(is_last) else { return false };
    has_metadata(object, last, metadata)
}

/// Whether a version of the object in this folder was published with this metadata.
pub fn has_metadata(object: &Path, version: &Version, metadata: &Metadata) -> bool {
    let written = plain_file::read_at(&object.join(&version.folder).join(METADATA), SMALL_FILE_MAX);
    written.is_ok_and(|bytes| is_metadata(&bytes, metadata))
}

/// Whether a file `metadata/metadata.json` says the same as `metadata`.
pub fn is_metadata(bytes: &[u8], metadata: &Metadata) -> bool {
    kilwa_pack::json::from_slice::<Metadata>(bytes).is_ok_and(|written| written == *metadata)
}

/// The manifest of an object's folder; `None` where there is no such folder.
///
/// # Errors
/// What is wrong with it, for people.
pub fn existing(object: &Path) -> Result<Option<Manifest>, String> {
    if !object.exists() {
        return Ok(None);
    }
    let path = object.join(MANIFEST);
    let bytes = plain_file::read_at(&path, SMALL_FILE_MAX).map_err(|e| {
        format!("{} already exists and is not an object of kilwa ({e}); choose another name with slug = \"…\" in the metadata, or move it away", object.display())
    })?;
    Manifest::parse(&bytes).map(Some).map_err(|e| format!("{}: {e}", path.display()))
}

/// Whether pack and metadata say the same; the reference system, normalised.
///
/// # Errors
/// What differs, and what to do.
pub fn agree(m: &Metadata, pack: &kilwa_pack::Metadata) -> Result<Option<String>, String> {
    if m.model.units != pack.source_units {
        return Err(format!(
            "model.units is \"{}\", and the pack was built from a mesh in \"{}\"; correct model.units, or build the pack again with --units {}",
            m.model.units, pack.source_units, m.model.units
        ));
    }
    let in_pack = match &pack.crs {
        Some(text) => crs::normalise(text).map_err(|message| {
            format!("the pack's reference system; build it again with the right --crs, or without: {message}")
        })?,
        None => None,
    };
    let given = match m.model.crs.as_deref() {
        None => in_pack.clone(),
        Some("local") => None,
        Some(other) => Some(other.to_owned()),
    };
    if given != in_pack {
        let name = |c: &Option<String>| c.clone().unwrap_or_else(|| "local coordinates".to_owned());
        return Err(format!(
            "model.crs says {}, and the pack {}; correct model.crs, or build the pack again with the right --crs",
            name(&given),
            name(&in_pack)
        ));
    }
    if let Some(text) = &in_pack {
        crs::holds(text, pack.bounds_min, pack.bounds_max)?;
    }
    let accuracy = m.capture.as_ref().and_then(|c| c.accuracy);
    if let (Some(given), Some(built)) = (accuracy, pack.capture_accuracy)
        && given != built
    {
        return Err(format!("capture.accuracy is {given} m, and the pack says {built} m; correct one of them"));
    }
    Ok(in_pack)
}

/// A version that is to follow those of a manifest.
#[derive(Debug, Clone, Copy)]
pub struct Following<'a> {
    /// Where the object is, for messages: `site/gereza`.
    pub at: &'a str,
    /// What is written of it.
    pub metadata: &'a Metadata,
    /// What the pack says of itself, and its identity; before its place was taken out.
    pub pack: &'a kilwa_pack::Metadata,
    /// What the pack is called.
    pub identity: &'a str,
    /// Whether its place is taken out.
    pub redacted: bool,
    /// The publisher states that it is the same object.
    pub same_object: bool,
    /// The publisher states that it may be opened to more people, with its earlier versions.
    pub open_access: bool,
    /// The day it is, for embargoes.
    pub today: &'a str,
    /// What is new in it.
    pub note: Option<&'a str>,
    /// Day of publication.
    pub published: &'a str,
}

/// Checks of a further version; its note.
///
/// # Errors
/// Why it cannot follow, and what to do.
pub fn further(m: &Manifest, v: &Following<'_>) -> Result<String, String> {
    let (at, slug) = (v.at, &m.slug);
    if m.access.state == AccessState::Withdrawn {
        let day = m.access.withdrawn.as_ref().map(|d| format!(" on {d}")).unwrap_or_default();
        return Err(format!("{at} was withdrawn{day}; publish under another name"));
    }
    let access = v.metadata.access.as_ref();
    let (was, is) = (
        closedness(m.access.state, m.access.until.as_deref(), v.today),
        closedness(v.metadata.access(), access.and_then(|a| a.until.as_deref()), v.today),
    );
    if is < was && !v.open_access {
        return Err(format!(
            "{at} is {}, and this version would be {}; that opens its earlier versions too. Write the same [access] in the metadata; \
             if it is to be opened, the person who administers the folder or store does so there: kilwa publish --to DIR --open-access",
            access_text(was),
            access_text(is)
        ));
    }
    let doubts = if v.same_object { Vec::new() } else { doubts(m, v) };
    if !doubts.is_empty() {
        return Err(format!(
            "{at} is \"{}\", which seems to be another model: {}. Give this one another name with slug = \"…\" in the metadata; \
             if it is a new version of that one, say so with --same-object",
            m.title,
            doubts.join("; ")
        ));
    }
    let open = m.versions.iter().find(|v| !v.location_redacted);
    if let Some(open) = open.filter(|_| v.redacted) {
        return Err(format!(
            "version {} of {at} reveals the location, and versions are never changed; withdraw it first \
             (kilwa publish --withdraw {slug} --to DIR --keep FOLDER --reason …) and publish under another name",
            open.version
        ));
    }
    let hidden = m.versions.iter().find(|v| v.location_redacted);
    if let Some(hidden) = hidden.filter(|_| !v.redacted) {
        return Err(format!(
            "version {} of {at} was published without its location, which this version would reveal; \
             give --redact-location again, or publish under another name",
            hidden.version
        ));
    }
    let next = next_version(Some(m));
    let note = v.note.map(str::trim).filter(|n| !n.is_empty()).ok_or_else(|| {
        format!("{at} is published already; to add version {next}, say what is new in it: --version-note \"…\"")
    })?;
    if let Some(last) = m.versions.last().filter(|last| last.published.as_str() > v.published) {
        return Err(format!(
            "version {} was published on {}, after {}; correct --date, SOURCE_DATE_EPOCH or the clock",
            version_folder(last.version),
            last.published,
            v.published
        ));
    }
    Ok(note.to_owned())
}

/// How closed something is on a day: greater is more closed; an embargo that has ended is public.
fn closedness<'a>(state: AccessState, until: Option<&'a str>, today: &str) -> (u8, &'a str) {
    match (state, until) {
        (AccessState::Withdrawn, _) => (3, ""),
        (AccessState::Restricted, _) => (2, ""),
        (AccessState::Embargo, Some(day)) if day <= today => (0, ""),
        (AccessState::Embargo, day) => (1, day.unwrap_or("9999-12-31")),
        (AccessState::Public, _) => (0, ""),
    }
}

fn access_text((rank, until): (u8, &str)) -> String {
    match rank {
        0 => "public".to_owned(),
        1 => format!("under embargo until {until}"),
        2 => "restricted".to_owned(),
        _ => "withdrawn".to_owned(),
    }
}

/// What speaks for another model than the object's.
fn doubts(m: &Manifest, v: &Following<'_>) -> Vec<String> {
    let (new, mut all) = (v.metadata, Vec::new());
    match (&new.identifier, &m.identifier) {
        (Some(new), Some(old)) if new != old => {
            all.push(format!("its identifier is {old}, and that of the new version is {new}"));
        }
        (Some(new), Some(old)) if new == old => {}
        _ if new.title != m.title => all.push(format!("this one is \"{}\"", new.title)),
        _ => {}
    }
    // The very same model, with better text.
    if m.versions.iter().any(|old| old.pack.identity == v.identity) {
        return all;
    }
    if let Some(old) = m.current().filter(|old| !old.location_redacted && !v.redacted) {
        all.extend(elsewhere(old, v.pack));
    }
    all
}

/// How much larger or smaller a further version may be.
const GROWTH: f64 = 8.0;

/// Whether two boxes can be of one object.
fn elsewhere(old: &Version, new: &kilwa_pack::Metadata) -> Option<String> {
    let crs_of = |text: &Option<String>| text.as_deref().and_then(|t| crs::normalise(t).ok().flatten());
    let (old_crs, new_crs) = (crs_of(&old.figures.crs), crs_of(&new.crs));
    let [old_min, old_max] = old.figures.bounds;
    let (before, now) = (old_max.distance(old_min), new.bounds_max.distance(new.bounds_min));
    if now > before * GROWTH || before > now * GROWTH {
        return Some(format!(
            "the last version is {} across, the new one {}",
            crate::numbers::length(before),
            crate::numbers::length(now)
        ));
    }
    if old_crs.is_some() && old_crs == new_crs {
        let apart = (new.bounds_min - old_max).max(old_min - new.bounds_max).max(DVec3::ZERO);
        let distance = apart.xy().length();
        if distance > 0.0 {
            return Some(format!("the new version is {} away from the last one", crate::numbers::length(distance)));
        }
    }
    None
}
