//! schema.org JSON-LD for the landing page: what search engines read.

use super::Publication;
use crate::layout::{POSTER, PREVIEW, TILESET, version_folder};
use crate::metadata::{Agent, AgentKind, Metadata};
use serde_json::{Value, json};

/// Latitude and longitude of the place.
pub(super) fn point(m: &Metadata) -> Option<[f64; 2]> {
    let place = m.place.as_ref()?;
    Some([place.latitude?, place.longitude?])
}

/// A person or an organisation.
pub(super) fn agent(a: &Agent) -> Value {
    let kind = if a.kind == AgentKind::Person { "Person" } else { "Organization" };
    let mut one = json!({ "@type": kind, "name": a.name });
    if let Some((family, given)) = a.parts() {
        one["name"] = json!(format!("{given} {family}"));
        one["familyName"] = json!(family);
        one["givenName"] = json!(given);
    }
    if let Some(id) = a.orcid.as_ref().or(a.ror.as_ref()) {
        one["@id"] = json!(id);
    }
    if let Some(affiliation) = &a.affiliation {
        one["affiliation"] = json!({ "@type": "Organization", "name": affiliation });
    }
    one
}

/// The model, for the landing page in the root: addresses relative to it where none is known.
pub fn schema_org(p: &Publication) -> Value {
    let m = &p.metadata;
    let file = |path: &str| format!("{}{}/{path}", p.url().unwrap_or_default(), version_folder(p.version));
    let mut v = json!({
        "@context": "https://schema.org",
        "@type": "3DModel",
        "name": m.title,
        "identifier": p.identifier(),
        "inLanguage": m.language,
        "license": p.rights.uri,
        "datePublished": p.first_published,
        "dateModified": p.published,
        "version": p.version.to_string(),
        "isAccessibleForFree": true,
        "image": file(POSTER),
        "thumbnailUrl": file(POSTER),
        "encoding": [{ "@type": "MediaObject", "contentUrl": file(p.pack_file()), "encodingFormat": "application/octet-stream",
            "contentSize": p.pack.bytes.to_string(), "sha256": p.pack.sha256 }],
    });
    if let (Some(_), Some(list)) = (p.preview, v["encoding"].as_array_mut()) {
        list.push(
            json!({ "@type": "MediaObject", "contentUrl": file(PREVIEW), "encodingFormat": "model/gltf-binary" }),
        );
    }
    if let (Some(_), Some(list)) = (&p.tiles, v["encoding"].as_array_mut()) {
        list.push(json!({ "@type": "MediaObject", "name": "3D Tiles 1.1", "contentUrl": file(TILESET), "encodingFormat": "application/json" }));
    }
    let set = |v: &mut Value, key: &str, value: Option<Value>| {
        if let Some(value) = value {
            v[key] = value;
        }
    };
    set(&mut v, "url", p.url().map(Into::into));
    set(&mut v, "alternateName", (!m.alternative_titles.is_empty()).then(|| json!(m.alternative_titles)));
    set(&mut v, "description", m.description.clone().map(Value::from));
    set(&mut v, "keywords", (!m.subjects.is_empty()).then(|| json!(m.subjects)));
    set(&mut v, "creator", (!m.creators.is_empty()).then(|| m.creators.iter().map(agent).collect()));
    set(&mut v, "contributor", (!m.contributors.is_empty()).then(|| m.contributors.iter().map(agent).collect()));
    set(&mut v, "publisher", m.publisher.as_ref().map(|n| json!({ "@type": "Organization", "name": n })));
    set(&mut v, "copyrightHolder", m.rights.holder.as_ref().map(|n| json!({ "@type": "Organization", "name": n })));
    set(&mut v, "creditText", m.rights.statement.clone().map(Value::from));
    set(&mut v, "temporalCoverage", m.capture.as_ref().and_then(|c| c.date.clone()).map(Value::from));
    set(&mut v, "contentLocation", location(p));
    v
}

fn location(p: &Publication) -> Option<Value> {
    let place = p.metadata.place.as_ref()?;
    let mut one = json!({ "@type": "Place", "name": p.place().unwrap_or_else(|| p.metadata.title.clone()) });
    if let Some([latitude, longitude]) = point(&p.metadata) {
        one["geo"] = json!({ "@type": "GeoCoordinates", "latitude": latitude, "longitude": longitude });
    }
    if let Some(uri) = &place.uri {
        one["sameAs"] = json!(uri);
    }
    Some(one)
}
