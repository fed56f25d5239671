//! `ro-crate-metadata.json`: RO-Crate 1.1 of the version folder: the data set, each of its files with size and SHA-256, people, place, licence.

use super::links::TILES_SPECIFICATION;
use super::photographs::Photographs;
use super::schema_org::agent;
use super::{Publication, media_type};
use crate::layout::{ANNOTATIONS, CHECKSUMS, COLOUR_REPORT, CRATE, HOLES, IIIF_ANNOTATIONS, TILES, TILESET, VIEWER};
use serde_json::{Value, json};

/// The crate; `files` are all other files of the folder: path, bytes, SHA-256.
pub fn ro_crate(p: &Publication, files: &[(String, u64, String)]) -> Vec<u8> {
    let m = &p.metadata;
    let viewer = format!("{VIEWER}/");
    // Thousands of tiles are one data set with one file to begin at.
    let is_tile = |path: &str| path.strip_prefix(TILES).is_some_and(|rest| rest.starts_with('/')) && path != TILESET;
    let listed: Vec<&(String, u64, String)> = files
        .iter()
        .filter(|(path, ..)| !path.starts_with(&viewer) && path != CRATE && path != CHECKSUMS && !is_tile(path))
        .collect();
    let of_root = listed.iter().filter(|(path, ..)| path != TILESET);
    let mut parts: Vec<Value> = of_root.map(|(path, ..)| json!({ "@id": path })).collect();
    let has_viewer = files.iter().any(|(path, ..)| path.starts_with(&viewer));
    if has_viewer {
        parts.push(json!({ "@id": viewer }));
    }
    let tiles = format!("{TILES}/");
    if p.tiles.is_some() {
        parts.push(json!({ "@id": tiles }));
    }
    let mut graph = vec![json!({
        "@id": CRATE,
        "@type": "CreativeWork",
        "about": { "@id": "./" },
        "conformsTo": { "@id": "https://w3id.org/ro/crate/1.1" },
    })];
    let people: Vec<(Value, Value)> =
        m.creators.iter().chain(&m.contributors).enumerate().map(|(i, a)| entity(agent(a), i)).collect();
    let ids = |from: usize, n: usize| people.iter().skip(from).take(n).map(|(id, _)| id.clone()).collect::<Vec<_>>();
    let mut root = json!({
        "@id": "./",
        "@type": "Dataset",
        "name": m.title,
        "description": m.description.as_deref().unwrap_or(&m.title),
        "datePublished": p.published,
        "version": p.version.to_string(),
        "license": { "@id": p.rights.uri },
        "identifier": p.identifier(),
        "inLanguage": m.language,
        "hasPart": parts,
        "mainEntity": { "@id": p.pack_file() },
    });
    for (key, list) in
        [("creator", ids(0, m.creators.len())), ("contributor", ids(m.creators.len(), m.contributors.len()))]
    {
        if !list.is_empty() {
            root[key] = list.into();
        }
    }
    if !m.subjects.is_empty() {
        root["keywords"] = m.subjects.join(", ").into();
    }
    if let Some(publisher) = &m.publisher {
        root["publisher"] = json!({ "@id": "#publisher" });
        graph.push(json!({ "@id": "#publisher", "@type": "Organization", "name": publisher }));
    }
    if let Some(place) = place(p) {
        root["contentLocation"] = json!({ "@id": "#place" });
        graph.extend(place);
    }
    graph.push(json!({ "@id": p.rights.uri, "@type": "CreativeWork", "name": p.rights.label }));
    let photographs = Photographs::of(p);
    graph.extend(photographs.entities(&p.rights.uri));
    graph.extend(listed.iter().map(|(path, bytes, sha256)| {
        let mut one = json!({ "@id": path, "@type": "File", "name": path, "contentSize": bytes.to_string(),
            "encodingFormat": media_type(path), "sha256": sha256 });
        if path == p.pack_file() {
            one["@type"] = json!(["File", "3DModel"]);
            one["name"] = json!(format!("{} (all levels of detail)", m.title));
        }
        match path.as_str() {
            ANNOTATIONS => one["name"] = json!("Notes on the model (Web Annotations)"),
            TILESET => {
                one["name"] = json!("Root of the 3D Tiles");
                one["conformsTo"] = json!({ "@id": TILES_SPECIFICATION });
            }
            HOLES => one["name"] = json!("Holes of the surface (GeoJSON)"),
            COLOUR_REPORT => {
                one["name"] = json!("Colour report: photographs with their poses, residuals and shares");
            }
            IIIF_ANNOTATIONS => one["name"] = json!("Notes on the model, in the scene of the IIIF manifest"),
            _ => photographs.describe(path, &mut one),
        }
        one
    }));
    if has_viewer {
        graph.push(json!({ "@id": viewer, "@type": "Dataset", "name": "Viewer: the program that shows the model in a browser" }));
    }
    if let Some(t) = &p.tiles {
        graph.push(json!({ "@id": tiles, "@type": "Dataset", "name": "All levels of detail as OGC 3D Tiles 1.1",
            "description": format!("{} tiles, {} bytes; {CHECKSUMS} lists all files", t.tiles, t.bytes), "hasPart": [{ "@id": TILESET }] }));
        graph.push(json!({ "@id": TILES_SPECIFICATION, "@type": "CreativeWork", "name": "OGC 3D Tiles 1.1" }));
    }
    let mut seen = std::collections::BTreeSet::new();
    graph.extend(people.into_iter().filter(|(id, _)| seen.insert(id.to_string())).map(|(_, person)| person));
    graph.insert(1, root);
    super::json(&json!({ "@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph }))
}

/// A reference to a person and the person, who gets an id if there is none. An affiliation becomes text: entities must be flat.
fn entity(mut value: Value, number: usize) -> (Value, Value) {
    if value.get("@id").is_none() {
        value["@id"] = json!(format!("#agent-{}", number + 1));
    }
    if let Some(name) = value["affiliation"].get("name").cloned() {
        value["affiliation"] = name;
    }
    (json!({ "@id": value["@id"] }), value)
}

fn place(p: &Publication) -> Option<Vec<Value>> {
    let place = p.metadata.place.as_ref()?;
    let mut one =
        json!({ "@id": "#place", "@type": "Place", "name": p.place().unwrap_or_else(|| p.metadata.title.clone()) });
    if let Some(uri) = &place.uri {
        one["sameAs"] = json!(uri);
    }
    let Some([latitude, longitude]) = super::schema_org::point(&p.metadata) else { return Some(vec![one]) };
    one["geo"] = json!({ "@id": "#geo" });
    Some(vec![one, json!({ "@id": "#geo", "@type": "GeoCoordinates", "latitude": latitude, "longitude": longitude })])
}
