//! `iiif/manifest.json`: IIIF Presentation 4 (draft of 21 May 2026): a Manifest with one Scene that the preview is painted into.
//!
//! A Scene is right-handed with y up, as glTF is; `spatialScale` says that one unit is a metre. The preview stands at zero: where the model
//! lies on earth is in the other records. A viewer of IIIF takes the model of the painting annotation, and shows poster, rights and metadata.
//!
//! The draft wants an address without a fragment for a Scene, an array of selectors, and one object as body, target and source. What is only part of
//! a record has the record's address with a fragment. tests/browser/iiif.test.mjs reads both records with another implementation.
//!
//! `iiif/annotations.json`: the notes as commenting annotations of the scene, in its coordinates: the pack has z up and stands at its place. A page of its own,
//! that the scene names: who may not have the model may not have the places on it either, and the manifest is for everybody.

use super::Publication;
use crate::layout::{CRATE, DATACITE, IIIF, IIIF_ANNOTATIONS, POSTER, PREVIEW};
use crate::notes::{Body, Note, scene_point};
use glam::DVec3;
use serde_json::{Value, json};

/// Behind the model: the middle of the poster's background.
const BACKGROUND: &str = "#E6E2D9";

pub(super) fn iiif(p: &Publication) -> Value {
    let m = &p.metadata;
    let lang = m.language.as_str();
    let text = |t: &str| json!({ lang: [t] });
    let id = address(p, IIIF);
    let part = |name: &str| format!("{id}#{name}");
    let thumbnail =
        json!([{ "id": p.file(POSTER, 1), "type": "Image", "format": "image/jpeg", "width": 1200, "height": 630 }]);
    let mut v = json!({
        "@context": "http://iiif.io/api/presentation/4/context.json",
        "id": id,
        "type": "Manifest",
        "label": text(&m.title),
        "rights": p.rights.uri.replacen("https://creativecommons", "http://creativecommons", 1),
        "metadata": pairs(p),
        "thumbnail": thumbnail,
        "homepage": [{ "id": p.page(1), "type": "Text", "format": "text/html", "label": text(&m.title) }],
        "seeAlso": [
            { "id": p.file(DATACITE, 1), "type": "Dataset", "format": "application/json", "profile": "http://datacite.org/schema/kernel-4" },
            { "id": p.file(CRATE, 1), "type": "Dataset", "format": "application/ld+json", "profile": "https://w3id.org/ro/crate/1.1" },
        ],
        "rendering": [{ "id": p.file(p.pack_file(), 1), "type": "Model", "format": "application/octet-stream",
            "fileSize": p.pack.bytes, "label": { "en": ["All levels of detail (Kilwa pack)"] } }],
    });
    if let Some(description) = &m.description {
        v["summary"] = text(description);
    }
    let credit = m.rights.statement.as_ref().or(m.rights.holder.as_ref());
    if let Some(credit) = credit {
        v["requiredStatement"] = json!({ "label": { "en": ["Rights"] }, "value": text(credit) });
    }
    if let Some(publisher) = &m.publisher {
        v["provider"] = json!([{ "id": part("provider"), "type": "Agent", "label": text(publisher) }]);
    }
    let mut scene = json!({
        "id": scene_id(p),
        "type": "Scene",
        "label": text(&m.title),
        "thumbnail": thumbnail,
        "backgroundColor": BACKGROUND,
        "spatialScale": { "id": part("metre"), "type": "Quantity", "quantityValue": 1.0, "unit": "m" },
    });
    if p.preview.is_some() {
        // The whole Scene as target: the origin of the model is that of the Scene.
        scene["items"] = json!([{ "id": part("page"), "type": "AnnotationPage", "items": [{
            "id": part("painting"),
            "type": "Annotation",
            "motivation": ["painting"],
            "body": { "id": p.file(PREVIEW, 1), "type": "Model", "format": "model/gltf-binary", "label": text(&m.title) },
            "target": { "id": scene_id(p), "type": "Scene" },
        }] }]);
    }
    if p.notes.is_some() {
        scene["annotations"] =
            json!([{ "id": address(p, IIIF_ANNOTATIONS), "type": "AnnotationPage", "label": { "en": ["Notes"] } }]);
    }
    v["items"] = json!([scene]);
    v
}

/// Of a file beside the manifest.
fn address(p: &Publication, path: &str) -> String {
    match p.url() {
        Some(_) => p.file(path, 1),
        None => path.rsplit('/').next().unwrap_or(path).to_owned(),
    }
}

/// Of the scene: an address that leads to the manifest, which contains it.
fn scene_id(p: &Publication) -> String {
    format!("{}?scene", address(p, IIIF))
}

/// The notes in the scene.
pub(super) fn annotations(p: &Publication) -> Option<Value> {
    let published = p.notes.as_ref()?;
    let id = address(p, IIIF_ANNOTATIONS);
    let scene = json!({ "id": scene_id(p), "type": "Scene" });
    let one = |(number, note): (usize, &Note)| {
        let part = |name: &str| format!("{id}#{name}-{number}");
        let DVec3 { x, y, z } = scene_point(note.place, published.origin);
        let mut v = json!({
            "id": part("note"),
            "type": "Annotation",
            "motivation": ["commenting"],
            "target": { "type": "SpecificResource", "id": part("target"), "source": scene,
                "selector": [{ "type": "PointSelector", "x": x, "y": y, "z": z }] },
        });
        let mut all = bodies(p, note, &part("link"));
        match all.len() {
            0 => {}
            1 => v["body"] = all.remove(0),
            _ => v["body"] = json!({ "type": "Independents", "items": all }),
        }
        if let Some(label) = &note.label {
            v["label"] = by_language(label.all(), &p.metadata.language);
        }
        for (key, day) in ["created", "modified"].into_iter().zip(note.dates()) {
            if let Some(day) = day {
                v[key] = json!(day);
            }
        }
        v
    };
    let items: Vec<Value> = (1..).zip(&published.notes.notes).map(one).collect();
    Some(json!({
        "@context": "http://iiif.io/api/presentation/4/context.json",
        "id": id,
        "type": "AnnotationPage",
        "label": { "en": ["Notes"] },
        "items": items,
    }))
}

/// Texts of no named language are in that of the metadata.
fn by_language(texts: Vec<(Option<&str>, &str)>, language: &str) -> Value {
    let mut all = json!({});
    for (named, text) in texts {
        let list = &mut all[named.unwrap_or(language)];
        match list.as_array_mut() {
            Some(list) => list.push(text.into()),
            None => *list = json!([text]),
        }
    }
    all
}

/// What a note says; the title where it says nothing else. `link` is the address of a link in it, but for its number.
fn bodies(p: &Publication, note: &Note, link: &str) -> Vec<Value> {
    let text = |named: Option<&str>, text: &str| {
        let language = named.unwrap_or(&p.metadata.language);
        json!({ "type": "TextualBody", "format": "text/plain", "language": language, "value": text })
    };
    let mut all = Vec::new();
    for body in &note.bodies {
        match body {
            Body::Text { language, words, .. } => {
                all.extend(words.all().into_iter().map(|(named, t)| text(named.or(language.as_deref()), t)));
            }
            Body::Link { address, .. } => {
                // What it leads to is not known; most are pages.
                let source = json!({ "id": address, "type": "Text" });
                let id = format!("{link}-{}", all.len() + 1);
                all.push(json!({ "id": id, "type": "SpecificResource", "purpose": "linking", "source": source }));
            }
        }
    }
    let titles = note.label.iter().flat_map(|l| l.all());
    if all.is_empty() {
        all.extend(titles.map(|(named, t)| text(named, t)));
    }
    all
}

fn pairs(p: &Publication) -> Vec<Value> {
    let m = &p.metadata;
    let DVec3 { x, y, z } = p.size();
    let names = |list: &[crate::metadata::Agent]| list.iter().map(|a| a.name.clone()).collect::<Vec<_>>().join("; ");
    let object = m.object.as_ref();
    let capture = m.capture.as_ref();
    let all = [
        ("Creator", Some(names(&m.creators)).filter(|n| !n.is_empty())),
        ("Publisher", m.publisher.clone()),
        ("Place", p.place()),
        ("Kind", object.and_then(|o| o.kind.clone())),
        ("Date", object.and_then(|o| o.date.clone())),
        ("Period", object.and_then(|o| o.period.clone())),
        ("Captured", capture.and_then(|c| c.date.clone())),
        ("Method", capture.and_then(|c| c.method.clone())),
        ("Size", Some(format!("{x:.2} × {y:.2} × {z:.2} m"))),
        (p.figures.parts().0, Some(p.figures.parts().1.to_string())),
        ("Version", Some(format!("{}, {}", p.version, p.published))),
        ("Rights", Some(p.rights.label.clone())),
    ];
    let pair = |(label, value): (&str, Option<String>)| {
        value.map(|v| json!({ "label": { "en": [label] }, "value": { "none": [v] } }))
    };
    all.into_iter().filter_map(pair).collect()
}
