//! The photographs of a version in its RO-Crate: each file with its licence, its makers and the holder of its rights.

use super::Publication;
use crate::metadata::PhotographsField;
use crate::rights::Rights;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The photographs that the version includes: whose they are, and what each file is.
#[derive(Default)]
pub(super) struct Photographs<'a> {
    /// Files of photographs, masks and smaller copies: what precedes the name of the photograph, and that name.
    names: BTreeMap<&'a str, (&'static str, &'a str)>,
    rights: Option<&'a PhotographsField>,
}

impl<'a> Photographs<'a> {
    pub(super) fn of(p: &'a Publication) -> Self {
        let (Some((_, rights)), Some(colours)) = (p.photographs(), &p.colours) else { return Self::default() };
        let mut names = BTreeMap::new();
        for photo in &colours.report.photographs {
            let own = [("Mask of ", &photo.mask_path), ("", &photo.path)];
            let own = own.into_iter().filter_map(|(what, path)| Some((what, path.as_deref()?)));
            let copies = photo.copies().map(|copy| ("Smaller copy of ", copy.path.as_str()));
            for (what, path) in own.chain(copies) {
                names.entry(path).or_insert((what, photo.name.as_str()));
            }
        }
        Self { names, rights: Some(rights) }
    }

    /// The statement of rights, unless it is that of the model, and the photographers and the holder of the rights.
    pub(super) fn entities(&self, of_model: &str) -> Vec<Value> {
        let Some(rights) = self.rights else { return Vec::new() };
        let mut all = Vec::new();
        if let Some(statement) = Rights::parse(&rights.rights).ok().filter(|statement| statement.uri != of_model) {
            all.push(json!({ "@id": statement.uri, "@type": "CreativeWork", "name": statement.label }));
        }
        let people = rights.creators.iter().zip(1..);
        all.extend(people.map(|(name, n)| json!({ "@id": photographer(n), "@type": "Person", "name": name })));
        let holder = rights.holder.iter();
        all.extend(holder.map(|name| json!({ "@id": HOLDER, "@type": "Organization", "name": name })));
        all
    }

    pub(super) fn describe(&self, path: &str, one: &mut Value) {
        let (Some(rights), Some((what, name))) = (self.rights, self.names.get(path)) else { return };
        one["name"] = json!(format!("{what}{name}"));
        one["license"] = json!({ "@id": rights.rights });
        if !rights.creators.is_empty() {
            let ids = (1..=rights.creators.len()).map(|n| json!({ "@id": photographer(n) }));
            one["creator"] = ids.collect();
        }
        if rights.holder.is_some() {
            one["copyrightHolder"] = json!({ "@id": HOLDER });
        }
        if let Some(credit) = &rights.credit {
            one["creditText"] = json!(credit);
        }
    }
}

/// Who has the rights in the photographs.
const HOLDER: &str = "#rights-holder-of-the-photographs";

fn photographer(number: usize) -> String {
    format!("#photographer-{number}")
}
