//! The metadata that a person writes about a model: title, rights, people, place, capture (docs/metadata.md describes each field).
//!
//! Written as TOML ([`Metadata::parse`], strict: every mistake at once, each with line, field and what to do; [`template`] is where to
//! begin), kept in the object as JSON of the same names. Invariants of a [`Metadata`]: texts are trimmed, not empty, without control
//! characters but line breaks; addresses begin with http:// or https://; dates exist; rights are canonical ([`super::rights`]).

pub mod crs;
pub mod document;
mod fields;
mod lines;
pub mod plausible;
mod rewrite;
pub mod schema;
pub mod template;
mod withheld;

pub use kilwa_toml::{Problem, Problems};
pub use withheld::{plain_accuracy, plain_capture};

use serde::{Deserialize, Serialize};

/// The metadata of a model. Names are those of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// Title.
    pub title: String,
    /// Other titles, also in other languages.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub alternative_titles: Vec<String>,
    /// What it shows, one or more paragraphs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Language of these texts, BCP 47.
    pub language: String,
    /// Keywords.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub subjects: Vec<String>,
    /// Name in the address; without it, one from the title.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slug: Option<String>,
    /// Address where the object will be, ending with `/`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub url: Option<String>,
    /// DOI, ARK or another identifier that lasts, as an address or `doi:`, `ark:`, `hdl:`, `urn:`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identifier: Option<String>,
    /// Who publishes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub publisher: Option<String>,
    /// Day of publication, `YYYY-MM-DD`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<String>,
    /// Rights.
    pub rights: RightsField,
    /// Rights in the photographs that the model was coloured from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photographs: Option<PhotographsField>,
    /// Who made it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub creators: Vec<Agent>,
    /// Who helped.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub contributors: Vec<Agent>,
    /// Where the site is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<Place>,
    /// The site or thing itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<Heritage>,
    /// How it was captured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture: Option<Capture>,
    /// The mesh.
    pub model: Model,
    /// Who may see it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub access: Option<AccessField>,
    /// What belongs to it elsewhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub related: Vec<Related>,
    /// Who paid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub funding: Vec<Funding>,
}

/// Rights: a statement that machines understand, and words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RightsField {
    /// Canonical address of a statement of [`super::rights`].
    pub uri: String,
    /// Who holds the rights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
    /// Further words, for example how to give credit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statement: Option<String>,
}

/// Rights in the photographs that the model was coloured from: they need not be those in the model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotographsField {
    /// Canonical address of a statement of [`super::rights`].
    pub rights: String,
    /// Names of the photographers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub creators: Vec<String>,
    /// Who holds the rights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
    /// How to give credit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub credit: Option<String>,
}

/// A person or an organisation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Agent {
    /// `Family, Given` of a person, the name of an organisation.
    pub name: String,
    /// Which of the two.
    pub kind: AgentKind,
    /// ORCID as address.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orcid: Option<String>,
    /// ROR as address.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ror: Option<String>,
    /// Where they work.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub affiliation: Option<String>,
    /// What they did, for example "scanning".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<String>,
}

/// Kind of an [`Agent`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AgentKind {
    /// A person.
    Person,
    /// An organisation.
    Organisation,
}

/// Where the site is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Name, from small to large.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// ISO 3166-1, two letters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub country: Option<String>,
    /// Degrees north, WGS 84.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latitude: Option<f64>,
    /// Degrees east, WGS 84.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub longitude: Option<f64>,
    /// Address in a gazetteer: GeoNames, Wikidata, Getty TGN.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
}

/// The site or thing itself.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heritage {
    /// What it is: fort, mosque, rock art panel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// When it was made, in words or as a year.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// Period or culture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<String>,
    /// Materials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<String>,
    /// Inventory or register numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub identifiers: Vec<String>,
    /// Address of its entry in a register, Wikidata or the Getty AAT.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
}

/// How it was captured and what was done since: paradata.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// Date or span, `2009-07` or `2009-07-20/2009-08-03`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// Technique, for example "terrestrial laser scanning".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// Scanners, cameras, total stations.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub instruments: Vec<String>,
    /// Programs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub software: Vec<String>,
    /// Standard uncertainty of a point, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<f64>,
    /// Why and how, what was left out and guessed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Steps from the scan to the mesh, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<CaptureStep>,
}

/// One step from the scan to the mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaptureStep {
    /// What was done.
    pub what: String,
    /// With what.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool: Option<String>,
    /// By whom.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// When, a date or span.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
}

/// The mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Units of the mesh that was scanned, as `kilwa build --units` names them.
    pub units: String,
    /// Coordinate reference system, `EPSG:32737`; `local` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crs: Option<String>,
}

/// Who may see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AccessField {
    /// Who.
    pub state: super::AccessState,
    /// Last day of an embargo plus one: public from the beginning of this day in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
    /// Why, shown to whoever may not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Whom to ask: an address or e-mail address.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<String>,
}

/// Something elsewhere that belongs to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Related {
    /// How, a relation of DataCite such as `IsDescribedBy`.
    pub relation: String,
    /// Address.
    pub uri: String,
    /// What it is, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
}

/// Who paid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Funding {
    /// Name.
    pub funder: String,
    /// Number of the grant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub award: Option<String>,
    /// Address of the grant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
}

impl Metadata {
    /// Read a metadata file.
    ///
    /// # Errors
    /// [`Problems`]: every mistake of the file, in the order of its lines.
    pub fn parse(text: &str) -> Result<Self, Problems> {
        fields::parse(text)
    }

    /// Whether it keeps to everything that [`Metadata::parse`] asks for: for what was not read from a file of a person's.
    ///
    /// # Errors
    /// Every field that does not, with what to do.
    pub fn check(&self) -> Result<(), String> {
        let text = toml::to_string(self).map_err(|e| e.to_string())?;
        let failed =
            |p: Problems| p.0.iter().map(|p| format!("{}: {}", p.field, p.message)).collect::<Vec<_>>().join("; ");
        if Self::parse(&text).map_err(failed)? == *self {
            Ok(())
        } else {
            Err("a field is not in the form that kilwa writes".to_owned())
        }
    }

    /// The same without what reveals where on earth it is: latitude, longitude and the gazetteer's address of the place, the address of the
    /// site in a register, the reference system. Names of places in texts stay: who writes them decides.
    #[must_use]
    pub fn without_location(mut self) -> Self {
        if let Some(place) = &mut self.place {
            (place.latitude, place.longitude, place.uri) = (None, None, None);
        }
        if let Some(object) = &mut self.object {
            object.uri = None;
        }
        self.model.crs = None;
        self
    }

    /// Who may see it; without a word of it, everybody.
    pub fn access(&self) -> super::AccessState {
        self.access.as_ref().map_or(super::AccessState::Public, |a| a.state)
    }
}
