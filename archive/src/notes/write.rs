//! Writing notes as one page of Web Annotations.
//!
//! What an annotation says that is kept as it was may be most of its file, and grows when it is laid out in lines: it is written by reference, and
//! writing ends where the longest file does. So no more is held than the notes themselves and one file. Keys are in the order of the alphabet.

use super::{CONTEXT, NOTES_MAX, Note, Notes, NotesError, PACK_STATE, VIEW_STATE};
use serde::ser::SerializeMap as _;
use serde::{Serialize, Serializer};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{self, Write};

impl Notes {
    /// As they are published, beside the pack `pack_file` of this identity. Addresses are relative, so that the file is the same in every version and copy.
    ///
    /// # Errors
    /// When that is longer than [`NOTES_MAX`].
    pub fn to_bytes(&self, pack_file: &str, identity: &str) -> Result<Vec<u8>, NotesError> {
        let mut written = Bounded::default();
        let page = Page { notes: &self.notes, pack_file, identity };
        let paged = serde_json::to_writer_pretty(&mut written, &page).map_err(io::Error::from);
        let ended = paged.and_then(|()| written.write_all(b"\n"));
        ended.map_err(|e| NotesError::one(format!("when published, the notes would be {e}; remove some")))?;
        Ok(written.0)
    }
}

/// A file that gets no longer than [`NOTES_MAX`].
#[derive(Default)]
pub(super) struct Bounded(pub(super) Vec<u8>);

impl Write for Bounded {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if (self.0.len() + bytes.len()) as u64 > NOTES_MAX {
            return Err(io::Error::other(format!("longer than {NOTES_MAX} bytes, the maximum")));
        }
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The page, whose notes become JSON one after the other.
pub(super) struct Page<'a> {
    pub(super) notes: &'a [Note],
    pub(super) pack_file: &'a str,
    pub(super) identity: &'a str,
}

impl Serialize for Page<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut page = to.serialize_map(Some(3))?;
        page.serialize_entry("@context", CONTEXT)?;
        page.serialize_entry("items", &Items(self))?;
        page.serialize_entry("type", "AnnotationPage")?;
        page.end()
    }
}

/// The notes of a page.
struct Items<'a>(&'a Page<'a>);

impl Serialize for Items<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(self.0.notes.iter().map(|note| note.json(self.0.pack_file, self.0.identity)))
    }
}

/// JSON of parts that are made, and of parts that are kept as they are and not copied.
#[derive(Serialize)]
#[serde(untagged)]
enum Part<'a> {
    Made(Value),
    Kept(&'a Value),
    List(Vec<Part<'a>>),
    Map(BTreeMap<&'a str, Part<'a>>),
}

impl Note {
    fn json(&self, pack_file: &str, identity: &str) -> Part<'_> {
        let mut all: BTreeMap<&str, Part<'_>> = self.rest.iter().map(|(k, v)| (k.as_str(), Part::Kept(v))).collect();
        all.insert("id", Part::Made(json!(self.id)));
        all.insert("type", Part::Made(json!("Annotation")));
        if let Some(label) = &self.label {
            all.insert("label", Part::Made(label.json()));
        }
        all.insert("body", Part::Made(self.bodies_json().into()));
        let [x, y, z] = self.place.to_array();
        let made_on = self.made_on.as_deref().unwrap_or(identity);
        let mut states = vec![Part::Made(json!({ "type": PACK_STATE, "identity": made_on }))];
        if let Some(view) = &self.view {
            let mut state = BTreeMap::from([("type", Part::Made(json!(VIEW_STATE)))]);
            if let Some(camera) = &view.camera {
                state.insert("camera", Part::Made(json!(camera)));
            }
            if let Some(display) = &view.display {
                state.insert("display", Part::Kept(display));
            }
            states.push(Part::Map(state));
        }
        states.extend(self.states.iter().map(Part::Kept));
        let target = BTreeMap::from([
            ("type", Part::Made(json!("SpecificResource"))),
            ("source", Part::Made(json!(pack_file))),
            ("state", Part::List(states)),
            ("selector", Part::Made(json!({ "type": "PointSelector", "x": x, "y": y, "z": z }))),
        ]);
        all.insert("target", Part::Map(target));
        Part::Map(all)
    }
}
