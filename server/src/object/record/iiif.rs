//! `iiif/manifest.json`: IIIF Presentation 4 (draft): a Manifest with one Scene that the preview is painted into.
//!
//! A Scene is right-handed with y up, as glTF is; `spatialScale` says that one unit is a metre. The preview stands at zero: where the model
//! lies on earth is in the other records. A viewer of IIIF takes the model of the painting annotation, and shows poster, rights and metadata.

use super::Publication;
use crate::object::layout::{CRATE, DATACITE, IIIF, POSTER, PREVIEW};
use serde_json::{Value, json};

pub(super) fn iiif(p: &Publication) -> Value {
    let m = &p.metadata;
    let lang = m.language.as_str();
    let text = |t: &str| json!({ lang: [t] });
    let id = p.file(IIIF, 1);
    let id = if p.url().is_some() { id } else { "manifest.json".to_owned() };
    let part = |name: &str| format!("{id}#{name}");
    let mut v = json!({
        "@context": "http://iiif.io/api/presentation/4/context.json",
        "id": id,
        "type": "Manifest",
        "label": text(&m.title),
        "rights": p.rights.uri.replacen("https://creativecommons", "http://creativecommons", 1),
        "metadata": pairs(p),
        "thumbnail": [{ "id": p.file(POSTER, 1), "type": "Image", "format": "image/jpeg", "width": 1200, "height": 630 }],
        "homepage": [{ "id": p.page(1), "type": "Text", "format": "text/html", "label": text(&m.title) }],
        "seeAlso": [
            { "id": p.file(DATACITE, 1), "type": "Dataset", "format": "application/json", "profile": "http://datacite.org/schema/kernel-4" },
            { "id": p.file(CRATE, 1), "type": "Dataset", "format": "application/ld+json", "profile": "https://w3id.org/ro/crate/1.1" },
        ],
        "rendering": [{ "id": p.file(p.pack_file(), 1), "type": "Model", "format": "application/octet-stream",
            "label": { "en": ["All levels of detail (Kilwa pack)"] } }],
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
        "id": part("scene"),
        "type": "Scene",
        "label": text(&m.title),
        "spatialScale": { "id": part("metre"), "type": "Quantity", "quantityValue": 1.0, "unit": "m" },
        "items": [],
    });
    if p.preview.is_some() {
        scene["items"] = json!([{ "id": part("page"), "type": "AnnotationPage", "items": [{
            "id": part("painting"),
            "type": "Annotation",
            "motivation": ["painting"],
            "body": { "id": p.file(PREVIEW, 1), "type": "Model", "format": "model/gltf-binary", "label": text(&m.title) },
            "target": { "type": "SpecificResource", "id": part("target"), "source": { "id": part("scene"), "type": "Scene" },
                "selector": { "type": "PointSelector", "x": 0.0, "y": 0.0, "z": 0.0 } },
        }] }]);
    }
    v["items"] = json!([scene]);
    v
}

fn pairs(p: &Publication) -> Vec<Value> {
    let m = &p.metadata;
    let [x, y, z] = p.size();
    let names =
        |list: &[crate::object::metadata::Agent]| list.iter().map(|a| a.name.clone()).collect::<Vec<_>>().join("; ");
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
        ("Triangles", Some(p.figures.triangles.to_string())),
        ("Version", Some(format!("{}, {}", p.version, p.published))),
        ("Rights", Some(p.rights.label.clone())),
    ];
    let pair = |(label, value): (&str, Option<String>)| {
        value.map(|v| json!({ "label": { "en": [label] }, "value": { "none": [v] } }))
    };
    all.into_iter().filter_map(pair).collect()
}
