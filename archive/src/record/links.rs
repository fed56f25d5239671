//! `linkset.json` (RFC 9264, with the relations of FAIR Signposting) and `oembed.json` (oEmbed 1.0, `rich`).

use super::{Publication, media_type};
use crate::html::{Embedded, render};
use crate::layout::{
    ANNOTATIONS, CITATIONS, COLOUR_REPORT, CRATE, DATACITE, DUBLIN_CORE, EDM, HOLES, IIIF, OEMBED, POSTER, PREVIEW,
    TILESET,
};
use serde_json::{Value, json};

/// What says how 3D Tiles are to be read.
pub(super) const TILES_SPECIFICATION: &str = "https://docs.ogc.org/cs/22-025r4/22-025r4.html";

/// Size of the frame that others embed, CSS pixels.
const FRAME: [u64; 2] = [960, 540];

pub(super) fn linkset(p: &Publication) -> Value {
    let described = [
        (DUBLIN_CORE, "http://www.openarchives.org/OAI/2.0/oai_dc/"),
        (DATACITE, "http://datacite.org/schema/kernel-4"),
        (EDM, "http://www.europeana.eu/schemas/edm/"),
        (IIIF, "http://iiif.io/api/presentation/4/context.json"),
        (CRATE, "https://w3id.org/ro/crate/1.1"),
    ];
    let link = |path: &str| json!({ "href": p.file(path, 0), "type": media_type(path) });
    let mut describedby: Vec<Value> = described
        .iter()
        .map(|(path, profile)| json!({ "href": p.file(path, 0), "type": media_type(path), "profile": [profile] }))
        .collect();
    describedby.extend(CITATIONS[1..].iter().map(|path| link(path)));
    let mut items = vec![link(p.pack_file())];
    if p.preview.is_some() {
        items.push(link(PREVIEW));
    }
    if p.notes.is_some() {
        items.push(json!({ "href": p.file(ANNOTATIONS, 0), "type": media_type(ANNOTATIONS), "profile": ["http://www.w3.org/ns/anno.jsonld"] }));
    }
    if p.holes.is_some() {
        items.push(link(HOLES));
    }
    if p.colours.is_some() {
        items.push(link(COLOUR_REPORT));
    }
    if p.tiles.is_some() {
        items
            .push(json!({ "href": p.file(TILESET, 0), "type": media_type(TILESET), "profile": [TILES_SPECIFICATION] }));
    }
    let authors: Vec<Value> = p
        .metadata
        .creators
        .iter()
        .filter_map(|a| a.orcid.as_ref().or(a.ror.as_ref()))
        .map(|id| json!({ "href": id }))
        .collect();
    let mut one = json!({
        "anchor": p.page(0),
        "type": [{ "href": "https://schema.org/3DModel" }, { "href": "https://schema.org/AboutPage" }],
        "license": [{ "href": p.rights.uri }],
        "describedby": describedby,
        "item": items,
        "icon": [link(POSTER)],
    });
    if let Some(id) = p.metadata.identifier.as_ref().filter(|i| i.starts_with("http")) {
        one["cite-as"] = json!([{ "href": id }]);
    } else if let Some(url) = p.url() {
        one["cite-as"] = json!([{ "href": url }]);
    }
    if !authors.is_empty() {
        one["author"] = authors.into();
    }
    if p.url().is_some() {
        one["alternate"] = json!([{ "href": p.file(OEMBED, 0), "type": "application/json+oembed" }]);
    }
    json!({ "linkset": [one] })
}

/// The oEmbed record, which a page that embeds the object asks for; only where the address is known.
pub(super) fn oembed(p: &Publication) -> Option<Value> {
    let url = p.url()?;
    let m = &p.metadata;
    let host = url.splitn(4, '/').take(3).collect::<Vec<_>>().join("/");
    let [width, height] = FRAME;
    let html = render(&Embedded { address: &format!("{url}?embed=1"), width, height, title: &m.title });
    let authors = m.creators.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join("; ");
    let mut v = json!({
        "version": "1.0",
        "type": "rich",
        "title": m.title,
        "provider_name": m.publisher.as_deref().unwrap_or(&host),
        "provider_url": format!("{host}/"),
        "html": html,
        "width": width,
        "height": height,
        "thumbnail_url": p.file(POSTER, 0),
        "thumbnail_width": 1200,
        "thumbnail_height": 630,
    });
    if !authors.is_empty() {
        v["author_name"] = authors.into();
    }
    Some(v)
}
