//! The photographs of a version in its RO-Crate: each file with its licence, its makers and the holder of its rights.

use super::Publication;
use crate::metadata::PhotographsField;
use crate::rights::Rights;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The photographs that the version includes: whose they are, and what each file is.
#[derive(Default)]
pub(super) struct Photographs<'a> {
    /// Files of photographs (`true`) and masks, with the name of the photograph.
    names: BTreeMap<&'a str, (&'a str, bool)>,
    rights: Option<&'a PhotographsField>,
}

impl<'a> Photographs<'a> {
    pub(super) fn of(p: &'a Publication) -> Self {
        let (Some((_, rights)), Some(colours)) = (p.photographs(), &p.colours) else { return Self::default() };
        let mut names = BTreeMap::new();
        for photo in &colours.report.photographs {
            for (path, is_photograph) in [(&photo.mask_path, false), (&photo.path, true)] {
                if let Some(path) = path {
                    names.entry(path.as_str()).or_insert((photo.name.as_str(), is_photograph));
                }
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
        let (Some(rights), Some((name, is_photograph))) = (self.rights, self.names.get(path)) else { return };
        if *is_photograph {
            one["name"] = json!(name);
        } else {
            one["name"] = json!(format!("Mask of {name}"));
        }
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
