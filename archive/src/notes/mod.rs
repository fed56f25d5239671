//! Published notes: what people wrote about places on the model, as W3C Web Annotations (`annotations.json` of a version).
//!
//! Inputs: files that the viewer page saves (docs/viewer.md, "Notes") and those of other programs: an `AnnotationPage`, an
//! `AnnotationCollection` with its page in it, one `Annotation`, a plain array. [`Notes::parse`] reads them strictly: everything that a
//! reader would have to guess, or that must not stand in a published file (markup, addresses that are not http or https), is refused with
//! the note and what to do. Annotations without a place on the model are counted and left out.
//!
//! [`Notes::to_bytes`] writes one form: the same notes are the same bytes, and what was written reads back as the same notes. Whoever takes
//! such a file from elsewhere can so see that it is in this form and holds nothing that was not looked at.
//!
//! Places are metres in the pack's reference system, z up. Allocation is bounded by the file's length, which is at most [`NOTES_MAX`], read and written.

mod place;
mod read;
mod write;

pub use place::scene_point;

use super::checksums::sha256;
use super::location::Location;
use glam::DVec3;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use thiserror::Error;

/// Longest file, bytes: the page reads no longer one.
pub const NOTES_MAX: u64 = 16_000_000;
/// Most annotations of a file, as in the page.
pub const MAX_ANNOTATIONS: usize = 5000;
/// Longest title, text, and address or id, in the units of JavaScript's strings (UTF-16), as in the page.
const LONGEST: [usize; 3] = [200, 20_000, 2000];
/// How far from the model's box a place may be, of the box's diagonal: a coarse level, on which a place may have been chosen, reaches beyond the finest one.
const MARGIN: f64 = 0.02;
/// How deep what an annotation says may be nested, in levels: what is deeper grows without measure when it is laid out in lines, or cannot be
/// read again.
const DEEPEST: usize = 32;
/// Digits of an identity that tell packs apart, as in links of the page.
const DIGITS: usize = 12;
/// Problems that are listed; of further ones only the number is.
const SHOWN_MAX: usize = 10;

/// Why notes are refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{}", listed(.0))]
pub struct NotesError(Vec<String>);

impl NotesError {
    fn one(what: impl Into<String>) -> Self {
        Self(vec![what.into()])
    }
}

fn listed(problems: &[String]) -> String {
    let mut list = problems.iter().take(SHOWN_MAX).cloned().collect::<Vec<_>>().join("\n  ");
    if problems.len() > SHOWN_MAX {
        let _ = write!(list, "\n  and {} more", problems.len() - SHOWN_MAX);
    }
    list
}

/// A text, in no named language or in several.
#[derive(Debug, Clone, PartialEq)]
pub enum Words {
    /// `"…"`.
    Plain(String),
    /// `{"sw": ["…"]}`, as IIIF has it.
    ByLanguage(BTreeMap<String, Vec<String>>),
}

impl Words {
    /// In this language if available, otherwise in English, otherwise in the first.
    pub fn in_language(&self, language: &str) -> String {
        match self {
            Self::Plain(text) => text.clone(),
            Self::ByLanguage(all) => {
                let chosen = all.get(language).or_else(|| all.get("en")).or_else(|| all.values().next());
                chosen.map(|list| list.join(" ")).unwrap_or_default()
            }
        }
    }

    /// Each text with its language, if stated.
    pub fn all(&self) -> Vec<(Option<&str>, &str)> {
        match self {
            Self::Plain(text) => vec![(None, text)],
            Self::ByLanguage(all) => {
                all.iter().flat_map(|(l, list)| list.iter().map(move |t| (Some(l.as_str()), t.as_str()))).collect()
            }
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Plain(text) => json!(text),
            Self::ByLanguage(all) => json!(all),
        }
    }
}

/// What a note says.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// Text, never markup.
    Text {
        /// What for: `describing`, `tagging` and so on.
        purpose: String,
        /// Its language, BCP 47.
        language: Option<String>,
        /// The text.
        words: Words,
    },
    /// An http or https address.
    Link {
        /// What for.
        purpose: String,
        /// The address.
        address: String,
    },
}

/// How a note is looked at.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct View {
    /// Azimuth, elevation (radians), distance, target x, y, z (metres), 1 where parallel, roll, opening angle: 7 to 9 numbers.
    pub camera: Option<Vec<f64>>,
    /// Shading, light, section.
    pub display: Option<Value>,
}

/// A note.
#[derive(Debug, Clone, PartialEq)]
pub struct Note {
    /// What it is called in links.
    pub id: String,
    /// Its title.
    pub label: Option<Words>,
    /// What it says.
    pub bodies: Vec<Body>,
    /// Where: metres in the pack's reference system, z up.
    pub place: DVec3,
    /// How it is looked at, where that was kept.
    pub view: Option<View>,
    /// Identity of the pack that it was made on, if stated.
    pub made_on: Option<String>,
    /// Other states of the target, as they were.
    states: Vec<Value>,
    /// What else the annotation says, as it was: motivation, creator, created and so on.
    rest: Map<String, Value>,
}

impl Note {
    /// Title in a language; empty if there is none.
    pub fn title(&self, language: &str) -> String {
        self.label.as_ref().map(|l| l.in_language(language)).unwrap_or_default()
    }

    /// Texts in a language, without tags.
    pub fn texts(&self, language: &str) -> Vec<String> {
        let text = |b: &Body| match b {
            Body::Text { purpose, words, .. } if purpose != "tagging" => Some(words.in_language(language)),
            _ => None,
        };
        self.bodies.iter().filter_map(text).collect()
    }

    /// Addresses that it leads to.
    pub fn links(&self) -> impl Iterator<Item = &str> {
        self.bodies.iter().filter_map(|b| match b {
            Body::Link { address, .. } => Some(address.as_str()),
            Body::Text { .. } => None,
        })
    }

    /// When it was made and changed, if stated as text.
    pub fn dates(&self) -> [Option<&str>; 2] {
        ["created", "modified"].map(|key| self.rest.get(key).and_then(Value::as_str))
    }

    /// The names of its authors, if stated.
    pub fn creators(&self) -> Vec<String> {
        let list = match self.rest.get("creator") {
            Some(Value::Array(list)) => list.as_slice(),
            Some(one) => std::slice::from_ref(one),
            None => &[],
        };
        let name = |one: &Value| one.as_str().or_else(|| one.get("name")?.as_str()).map(str::to_owned);
        list.iter().filter_map(name).collect()
    }

    /// A name made of what it says: the same note at the same place of the list has the same.
    fn derived_id(&self, number: usize) -> String {
        let content = json!([number, self.label.as_ref().map(Words::json), self.bodies_json(), self.place]);
        let sum = sha256(content.to_string().as_bytes());
        format!("urn:kilwa:note:{}", sum.get(..32).unwrap_or_default())
    }

    fn bodies_json(&self) -> Vec<Value> {
        let one = |body: &Body| match body {
            Body::Text { purpose, language, words } => {
                let mut v =
                    json!({ "type": "TextualBody", "purpose": purpose, "format": "text/plain", "value": words.json() });
                if let Some(language) = language {
                    v["language"] = json!(language);
                }
                v
            }
            Body::Link { purpose, address } => {
                json!({ "type": "SpecificResource", "purpose": purpose, "source": address })
            }
        };
        self.bodies.iter().map(one).collect()
    }
}

/// `@context` of Web Annotations.
const CONTEXT: &str = "http://www.w3.org/ns/anno.jsonld";
/// The state that names the pack, and the one that holds the view.
const PACK_STATE: &str = "urn:kilwa:pack";
const VIEW_STATE: &str = "urn:kilwa:view";

/// The notes of a version.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Notes {
    /// In their order.
    pub notes: Vec<Note>,
    /// Annotations of the file that name no place on the model, and were left out.
    pub left_out: usize,
}

impl Notes {
    /// Whether each note is on the model whose box this is, metres.
    ///
    /// # Errors
    /// Those that are not.
    pub fn within(&self, min: DVec3, max: DVec3) -> Result<(), NotesError> {
        let outside = |(number, note): (usize, &Note)| {
            (!place::is_near(note.place, min, max)).then(|| {
                let DVec3 { x, y, z } = note.place;
                format!(
                    "{}: {x} {y} {z} is outside of the model, which reaches from {} {} {} to {} {} {}; \
                     the note is of another model or in other coordinates: write it again on this one, or remove it from the file",
                    name_of(number, note), min.x, min.y, min.z, max.x, max.y, max.z
                )
            })
        };
        let all: Vec<String> = (1..).zip(&self.notes).filter_map(outside).collect();
        if all.is_empty() { Ok(()) } else { Err(NotesError(all)) }
    }

    /// Packs that notes were made on and that are none of `known`: identity and how many.
    pub fn strangers<'a>(&'a self, known: &[&str]) -> BTreeMap<&'a str, usize> {
        let mut all = BTreeMap::new();
        for made_on in self.notes.iter().filter_map(|n| n.made_on.as_deref()) {
            if !known.iter().any(|k| same_pack(k, made_on)) {
                *all.entry(made_on).or_default() += 1;
            }
        }
        all
    }

    /// Whether the place can be taken out of the notes: no text gives `location` away, and each says something without its links.
    ///
    /// # Errors
    /// Those of which it cannot, and why.
    pub fn check_words(&self, location: &Location) -> Result<(), NotesError> {
        let mut all = Vec::new();
        for (number, note) in (1..).zip(&self.notes) {
            if note.label.is_none() && note.bodies.iter().all(|b| matches!(b, Body::Link { .. })) {
                all.push(format!(
                    "note {number} contains only links, which are removed together with the location; give it a title or a text"
                ));
            }
            let labels = note.label.iter().flat_map(Words::all).filter_map(|(language, _)| language);
            let of_bodies = note.bodies.iter().flat_map(|b| match b {
                Body::Text { words, language, .. } => {
                    words.all().into_iter().filter_map(|(l, _)| l).chain(language.as_deref()).collect()
                }
                Body::Link { .. } => Vec::new(),
            });
            // What is called a language may be any letters and digits.
            if let Some(other) = labels.chain(of_bodies).find(|l| !place::is_registered_language(l)) {
                let name = name_of(number, note);
                all.push(format!(
                    "{name}: \"{other}\" is not a registered language and could be a coordinate; use a code such as en, sw or pt-BR, or leave it out"
                ));
                continue;
            }
            let texts = |words: &Words| -> Vec<String> { words.all().into_iter().map(|(_, t)| t.to_owned()).collect() };
            let labels = note.label.iter().flat_map(texts);
            let texts = note.bodies.iter().flat_map(|b| match b {
                Body::Text { words, .. } => texts(words),
                Body::Link { .. } => Vec::new(),
            });
            for text in labels.chain(texts).chain(note.creators()) {
                if let Some(finding) = location.find(&text) {
                    all.push(format!("{}: {finding}", name_of(number, note)));
                    break;
                }
            }
        }
        if all.is_empty() { Ok(()) } else { Err(NotesError(all)) }
    }
}

/// Whether two names are of one pack, compared by their first twelve digits as in the page.
pub fn same_pack(one: &str, other: &str) -> bool {
    matches!((one.get(..DIGITS), other.get(..DIGITS)), (Some(a), Some(b)) if a == b)
}

/// `note 3 ("The gate")`.
fn name_of(number: usize, note: &Note) -> String {
    let title: String = note.title("en").chars().take(40).collect();
    if title.is_empty() { format!("note {number}") } else { format!("note {number} (\"{title}\")") }
}

#[cfg(test)]
mod tests;
