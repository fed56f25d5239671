//! The messages of client and server, as JSON, and which of them are valid.

use super::{Refusal, UploadLimits};
use kilwa_archive::checksums::is_sha256;
use kilwa_archive::date::{day_of, is_day};
use kilwa_archive::layout::{
    ANNOTATIONS, COLOUR_REPORT, DRAWINGS, HOLES, POSTER, PREVIEW, Slug, THUMBNAILS, is_photograph, pack_name,
};
use kilwa_archive::manifest::Optional;
use kilwa_archive::metadata::Metadata;
use kilwa_archive::record::Preview;
use kilwa_archive::rights::Rights;
use kilwa_pack::plural::counted;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The form of these messages.
pub const FORM: u32 = 1;
/// Longest note of a version, bytes.
const NOTE_MAX: usize = 5000;
/// Seconds by which the clocks of two computers may differ.
const SKEW: u64 = 86_400;

/// A version that somebody wants to publish.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intent {
    /// [`FORM`].
    pub kilwa_upload: u32,
    /// Name of the object.
    pub slug: String,
    /// Number of the version: the one after the last.
    pub version: u32,
    /// Day of publication.
    pub published: String,
    /// What is new.
    pub note: String,
    /// Whether the place was taken out.
    #[serde(default)]
    pub location_redacted: bool,
    /// Side of the grid cell, metres, to whose centre the model was moved, if that much of the location is public.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub location_cell: Option<f64>,
    /// Scalar channels that were kept although the place was taken out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub kept_channels: Vec<String>,
    /// Whether the publisher states that it is the same object, however different it looks.
    #[serde(default)]
    pub same_object: bool,
    /// What is known of the model.
    pub metadata: Metadata,
    /// What is known of the preview, where there is one.
    pub preview: Option<AnnouncedPreview>,
    /// The drawings: path in the version and words.
    pub drawings: Vec<Drawing>,
    /// The files: pack, pictures, preview, photographs, notes, holes, colour report.
    pub files: Vec<AnnouncedFile>,
}

/// The announced properties of the preview.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnnouncedPreview {
    /// Its triangles.
    pub triangles: u64,
    /// Its distance from the finest surface, metres.
    pub error: f64,
}

/// A drawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawing {
    /// `drawings/plan.png`.
    pub path: String,
    /// `Plan, 1:100`.
    pub words: String,
}

/// A file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnnouncedFile {
    /// Path in the version.
    pub path: String,
    /// Length.
    pub bytes: u64,
    /// SHA-256, lower-case hexadecimal.
    pub sha256: String,
}

/// Where an upload is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Files are lacking.
    Sending,
    /// Everything is there; it can be published.
    Ready,
    /// It is being verified.
    Verifying,
    /// It is published.
    Published,
    /// It was not published, with the reason.
    Refused,
}

/// How far an upload is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Where.
    pub state: State,
    /// The version that is meant, or was published.
    pub version: u32,
    /// Files that are not there, or not wholly.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lacks: Vec<Lacking>,
    /// Bytes that were verified, and sent on where the archive lies in a store.
    #[serde(default)]
    pub done: u64,
    /// Bytes that are to be.
    #[serde(default)]
    pub of: u64,
    /// It was there before, from an earlier upload.
    #[serde(default)]
    pub already: bool,
    /// Why it was refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Day on which what was sent lapses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
    /// Why it does not continue at the moment; it will by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waits: Option<String>,
}

impl Status {
    /// Nothing more to say.
    pub(super) fn new(state: State, version: u32) -> Self {
        Self {
            state,
            version,
            lacks: Vec::new(),
            done: 0,
            of: 0,
            already: false,
            error: None,
            until: None,
            waits: None,
        }
    }
}

/// What is lacking of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lacking {
    /// What it is called while it is sent: `/uploads/<slug>/<sha256>`.
    pub sha256: String,
    /// From where on.
    pub offset: u64,
    /// Its length.
    pub bytes: u64,
}

/// An intent that can be.
#[derive(Debug, Clone)]
pub(super) struct Meant {
    pub(super) slug: Slug,
    pub(super) rights: Rights,
    pub(super) pack: AnnouncedFile,
    pub(super) preview: Option<Preview>,
}

/// Drawings: their files and the words before the scale.
const VIEWS: [(&str, &str); 5] = [
    ("plan", "Plan"),
    ("north", "North elevation"),
    ("east", "East elevation"),
    ("south", "South elevation"),
    ("west", "West elevation"),
];

impl Intent {
    /// Check everything that can be checked without the files and without the object.
    pub(super) fn check(&self, limits: &UploadLimits, now: u64) -> Result<Meant, Refusal> {
        let wrong = |what: String| Err(Refusal::content(what));
        if self.kilwa_upload != FORM {
            return wrong(format!(
                "this server accepts uploads of format version {FORM}, not {}; use the same version of kilwa on both sides",
                self.kilwa_upload
            ));
        }
        let slug = Slug::new(&self.slug).map_err(|e| Refusal::content(format!("slug: {e}")))?;
        self.metadata.check().map_err(|e| Refusal::content(format!("metadata: {e}")))?;
        if let Some(named) = self.metadata.slug.as_deref().filter(|named| *named != self.slug) {
            return wrong(format!(
                "the version is announced for \"{}\", but the slug in its metadata is \"{named}\"; use the same name in both",
                self.slug
            ));
        }
        let rights = Rights::parse(&self.metadata.rights.uri).map_err(Refusal::content)?;
        if !is_day(&self.published) || self.published > day_of(now.saturating_add(SKEW)) {
            return wrong(format!(
                "published: {} is not a date up to today ({}, UTC); correct the date, or the clock",
                self.published,
                day_of(now)
            ));
        }
        let is_text = |c: char| c == '\n' || !c.is_control();
        if self.note.trim().is_empty() || self.note.len() > NOTE_MAX || !self.note.chars().all(is_text) {
            return wrong(format!("the version note is empty, longer than {NOTE_MAX} bytes, or not plain text"));
        }
        if self.location_redacted && self.metadata.clone().without_location() != self.metadata {
            return wrong("the location is to be removed, and the metadata still contain it".to_owned());
        }
        super::withheld::check_intent(self).map_err(Refusal::content)?;
        let pack = self.check_files(limits)?;
        self.check_drawings()?;
        self.check_photographs()?;
        let preview = self.preview()?;
        Ok(Meant { slug, rights, pack, preview })
    }

    /// Check that every file is one that a version may have; returns the pack.
    fn check_files(&self, limits: &UploadLimits) -> Result<AnnouncedFile, Refusal> {
        let (mut paths, mut pack, mut total) = (BTreeSet::new(), None, 0u64);
        for file in &self.files {
            if !is_sha256(&file.sha256) {
                return Err(Refusal::content(format!("{:?}: its SHA-256 is invalid", short(&file.path))));
            }
            let is_pack = file.path == pack_name(&file.sha256);
            if !is_pack && !super::files::is_expected(&file.path) {
                return Err(Refusal::content(format!(
                    "{:?} cannot be uploaded: only the pack, posters, drawings, preview, notes, holes, the colour report and its photographs can; the server makes everything else",
                    short(&file.path)
                )));
            }
            if !paths.insert(file.path.as_str()) {
                return Err(Refusal::content(format!("{} is there twice", file.path)));
            }
            let max = if is_pack { limits.version_bytes } else { super::files::max_bytes(&file.path) };
            if file.bytes == 0 || file.bytes > max {
                let status = axum::http::StatusCode::PAYLOAD_TOO_LARGE;
                let message = format!("{} has {} bytes; from 1 to {max} are allowed", file.path, file.bytes);
                return Err(Refusal::new(status, message));
            }
            total = total.saturating_add(file.bytes);
            if is_pack && pack.replace(file.clone()).is_some() {
                return Err(Refusal::content("there are two packs"));
            }
        }
        if total > limits.version_bytes {
            let status = axum::http::StatusCode::PAYLOAD_TOO_LARGE;
            let message = format!(
                "the version has {}; this server takes {}",
                counted(total, "byte", "bytes"),
                limits.version_bytes
            );
            return Err(Refusal::new(status, message));
        }
        let posters = [POSTER].into_iter().chain(THUMBNAILS.map(|(name, _)| name));
        if let Some(lacking) = posters.into_iter().find(|name| !paths.contains(name)) {
            return Err(Refusal::content(format!("{lacking} is missing")));
        }
        pack.ok_or_else(|| Refusal::content("the pack is missing; its name must be pack.<sha256>.kilwa"))
    }

    /// The files that not every version has.
    pub(super) fn optional(&self) -> Optional<'_> {
        let sum = |path| self.files.iter().find(|f| f.path == path).map(|f| f.sha256.as_str());
        Optional { notes: sum(ANNOTATIONS), holes: sum(HOLES), tiles: None, colour_report: sum(COLOUR_REPORT) }
    }

    fn has(&self, path: &str) -> bool {
        self.files.iter().any(|f| f.path == path)
    }

    fn check_drawings(&self) -> Result<(), Refusal> {
        let known = |d: &Drawing| {
            let (_, words) = VIEWS.iter().find(|(name, _)| d.path == format!("{DRAWINGS}/{name}.png"))?;
            let scale = d.words.strip_prefix(words)?.strip_prefix(", 1:")?;
            scale.parse::<f64>().ok().filter(|s| s.is_finite() && *s > 0.0 && scale.len() < 20)
        };
        let mut seen = BTreeSet::new();
        let is_right = |d: &Drawing| known(d).is_some() && self.has(&d.path) && seen.insert(d.path.clone());
        if self.drawings.iter().all(is_right) {
            Ok(())
        } else {
            Err(Refusal::content("the drawings are not those that kilwa publish makes"))
        }
    }

    /// Check what can be said about photographs without their report.
    fn check_photographs(&self) -> Result<(), Refusal> {
        let (has_report, has_photographs) =
            (self.has(COLOUR_REPORT), self.files.iter().any(|file| is_photograph(&file.path)));
        if has_photographs && !has_report {
            return Err(Refusal::content(format!("there are photographs, but no {COLOUR_REPORT} that names them")));
        }
        if has_photographs && self.metadata.photographs.is_none() {
            return Err(Refusal::content("metadata: photographs need a statement of rights; add [photographs]"));
        }
        if has_report && self.location_redacted {
            return Err(Refusal::content(
                "the location is to be withheld, and a colour report and photographs can reveal it; publish without them",
            ));
        }
        Ok(())
    }

    fn preview(&self) -> Result<Option<Preview>, Refusal> {
        let bytes = self.files.iter().find(|f| f.path == PREVIEW).map(|f| f.bytes);
        match (self.preview, bytes) {
            (None, None) => Ok(None),
            (Some(announced), Some(bytes)) if announced.error.is_finite() && announced.error >= 0.0 => {
                Ok(Some(Preview { bytes, triangles: announced.triangles, error: announced.error }))
            }
            _ => Err(Refusal::content(format!("{PREVIEW} and its announcement do not match"))),
        }
    }
}

/// What can be quoted.
fn short(text: &str) -> String {
    text.chars().take(100).collect()
}
