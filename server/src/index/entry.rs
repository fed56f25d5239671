//! What the catalogue knows of an object: from its manifest and the metadata of the version that is shown.

use super::search::Facet;
use kilwa_archive::manifest::{Access, RightsEntry};
use kilwa_archive::metadata::Place;
use kilwa_archive::{AccessState, Manifest, Metadata};
use serde::{Deserialize, Serialize};

/// How large a model is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SizeClass {
    /// Below a million triangles.
    Small,
    /// Below ten million.
    Medium,
    /// Below a hundred million.
    Large,
    /// More.
    Huge,
}

impl SizeClass {
    /// Of a number of triangles.
    pub fn of(triangles: u64) -> Self {
        match triangles {
            0..1_000_000 => Self::Small,
            1_000_000..10_000_000 => Self::Medium,
            10_000_000..100_000_000 => Self::Large,
            _ => Self::Huge,
        }
    }

    /// Its name in addresses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Small => "under-1m",
            Self::Medium => "1m-10m",
            Self::Large => "10m-100m",
            Self::Huge => "over-100m",
        }
    }
}

/// One object of the catalogue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Its name in the address.
    pub slug: String,
    /// Title.
    pub title: String,
    /// What it shows.
    pub description: Option<String>,
    /// Language of these texts, BCP 47.
    pub language: String,
    /// Where the site is.
    pub place: Option<Place>,
    /// Latitude and longitude, degrees of WGS 84, where that is public.
    pub at: Option<[f64; 2]>,
    /// What it is: fort, mosque, rock art panel.
    pub kind: Option<String>,
    /// Period or culture.
    pub period: Option<String>,
    /// Keywords.
    pub subjects: Vec<String>,
    /// Who made it.
    pub creators: Vec<String>,
    /// When it was captured.
    pub captured: Option<String>,
    /// Rights.
    pub rights: RightsEntry,
    /// How to cite it.
    pub citation: String,
    /// DOI or the like.
    pub identifier: Option<String>,
    /// Who may see it.
    pub access: Access,
    /// Number of the version that is shown.
    pub version: u32,
    /// First day of publication, and that of the version that is shown.
    pub published: [String; 2],
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Points, if the pack is made of points.
    #[serde(default)]
    pub points: Option<u64>,
    /// Bytes of the pack.
    pub pack_bytes: u64,
    /// Whether any version was published without its place.
    pub location_redacted: bool,
}

impl Entry {
    /// From an object's manifest and, where it could be read, the metadata of its current version.
    pub(super) fn of(manifest: &Manifest, metadata: Option<Metadata>) -> Self {
        let day = |v: Option<&kilwa_archive::Version>| v.map(|v| v.published.clone()).unwrap_or_default();
        let current = manifest.current();
        let (place, object) = metadata.map(|m| (m.place, m.object)).unwrap_or_default();
        let object = object.unwrap_or_default();
        let named = || manifest.place.clone().map(|name| Place { name: Some(name), ..Place::default() });
        Self {
            slug: manifest.slug.clone(),
            title: manifest.title.clone(),
            description: manifest.description.clone(),
            language: manifest.language.clone(),
            at: super::location::of(manifest, place.as_ref()),
            place: place.or_else(named),
            kind: object.kind,
            period: object.period,
            subjects: manifest.subjects.clone(),
            creators: manifest.creators.clone(),
            captured: manifest.captured.clone(),
            rights: manifest.rights.clone(),
            citation: manifest.citation.clone(),
            identifier: manifest.identifier.clone(),
            access: manifest.access.clone(),
            version: manifest.current,
            published: [day(manifest.versions.first()), day(current)],
            triangles: current.map_or(0, |v| v.figures.triangles),
            points: current.and_then(|v| v.figures.points),
            pack_bytes: current.map_or(0, |v| v.pack.bytes),
            location_redacted: manifest.versions.iter().any(|v| v.location_redacted),
        }
    }

    /// Whether lists show it: withdrawn objects keep a page, and are found by who has their address.
    pub(super) fn is_shown(&self) -> bool {
        self.access.state != AccessState::Withdrawn
    }

    /// The values that it is found by under each facet.
    pub(super) fn facets(&self) -> Vec<(Facet, String)> {
        let country = self.place.as_ref().and_then(|p| p.country.clone());
        let one = |facet, value: &Option<String>| value.clone().map(|v| (facet, v));
        let mut all: Vec<(Facet, String)> =
            [one(Facet::Country, &country), one(Facet::Kind, &self.kind), one(Facet::Period, &self.period)]
                .into_iter()
                .flatten()
                .collect();
        all.push((Facet::Licence, self.rights.short.clone()));
        all.push((Facet::Size, SizeClass::of(self.triangles).name().to_owned()));
        all.extend(self.subjects.iter().map(|s| (Facet::Subject, s.clone())));
        all
    }

    /// What is searched, in the order of the columns of `text`.
    pub(super) fn texts(&self) -> [String; 5] {
        let place = self.place.as_ref();
        let country = place.and_then(|p| p.country.as_deref());
        // Who searches writes the country's name, in whichever language.
        let names = country.map(crate::countries::names).unwrap_or_default();
        let join = |parts: &[Option<&str>]| parts.iter().flatten().copied().collect::<Vec<_>>().join(" \n");
        [
            self.title.clone(),
            join(&[place.and_then(|p| p.name.as_deref()), country, Some(&names.join(" \n"))]),
            join(&[self.kind.as_deref(), self.period.as_deref(), Some(&self.subjects.join(" \n"))]),
            join(&[Some(&self.creators.join(" \n")), self.rights.holder.as_deref(), self.identifier.as_deref()]),
            join(&[self.description.as_deref(), self.captured.as_deref(), Some(&self.slug)]),
        ]
    }
}
