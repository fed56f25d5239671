//! `metadata/edm.xml`: the Europeana Data Model as RDF/XML: the site (ProvidedCHO), its model, poster and page (WebResource), and the Aggregation of them.
//!
//! Ids are the object's address where it is known, `urn:kilwa:` and the pack's identity else; an aggregator needs the address.

use super::xml::Xml;
use super::{Publication, media_type};
use crate::object::layout::{POSTER, PREVIEW};
use crate::object::metadata::Heritage;

pub(super) fn edm(p: &Publication) -> String {
    let m = &p.metadata;
    let base = p.url().map_or_else(|| format!("urn:kilwa:{}", p.pack.identity), str::to_owned);
    let (cho, aggregation, place) = (format!("{base}#cho"), format!("{base}#aggregation"), format!("{base}#place"));
    let mut x = Xml::new(
        "rdf:RDF",
        &[
            ("xmlns:rdf", "http://www.w3.org/1999/02/22-rdf-syntax-ns#"),
            ("xmlns:dc", "http://purl.org/dc/elements/1.1/"),
            ("xmlns:dcterms", "http://purl.org/dc/terms/"),
            ("xmlns:edm", "http://www.europeana.eu/schemas/edm/"),
            ("xmlns:ore", "http://www.openarchives.org/ore/terms/"),
            ("xmlns:skos", "http://www.w3.org/2004/02/skos/core#"),
            ("xmlns:wgs84_pos", "http://www.w3.org/2003/01/geo/wgs84_pos#"),
            ("xmlns:svcs", "http://rdfs.org/sioc/services#"),
        ],
    );
    let language = [("xml:lang", m.language.as_str())];
    x.begin("edm:ProvidedCHO", &[("rdf:about", &cho)]);
    x.text("dc:title", &language, &m.title);
    for title in &m.alternative_titles {
        x.text("dcterms:alternative", &[], title);
    }
    let none = Heritage::default();
    let object = m.object.as_ref().unwrap_or(&none);
    x.maybe("dc:description", &language, m.description.as_deref());
    for agent in &m.creators {
        x.text("dc:creator", &[], &agent.name);
    }
    for agent in &m.contributors {
        x.text("dc:contributor", &[], &agent.name);
    }
    for identifier in std::iter::once(&p.identifier()).chain(&object.identifiers) {
        x.text("dc:identifier", &[], identifier);
    }
    x.text("dc:language", &[], &m.language);
    for subject in &m.subjects {
        x.text("dc:subject", &language, subject);
    }
    x.text("dc:type", &language, object.kind.as_deref().unwrap_or("3D model"));
    for material in &object.materials {
        x.text("dcterms:medium", &language, material);
    }
    x.maybe("dcterms:created", &[], object.date.as_deref());
    x.maybe("dcterms:temporal", &language, object.period.as_deref());
    if m.place.is_some() {
        x.empty("dcterms:spatial", &[("rdf:resource", &place)]);
    }
    x.text("edm:type", &[], "3D");
    x.end();
    resources(&mut x, p);
    if let Some(at) = &m.place {
        x.begin("edm:Place", &[("rdf:about", &place)]);
        if let (Some(latitude), Some(longitude)) = (at.latitude, at.longitude) {
            x.text("wgs84_pos:lat", &[], &latitude.to_string());
            x.text("wgs84_pos:long", &[], &longitude.to_string());
        }
        x.maybe("skos:prefLabel", &language, p.place().as_deref());
        if let Some(uri) = &at.uri {
            x.empty("skos:exactMatch", &[("rdf:resource", uri)]);
        }
        x.end();
    }
    x.begin("ore:Aggregation", &[("rdf:about", &aggregation)]);
    x.empty("edm:aggregatedCHO", &[("rdf:resource", &cho)]);
    let provider = m.publisher.as_deref().or(m.rights.holder.as_deref()).unwrap_or("unknown");
    x.text("edm:dataProvider", &[], provider);
    x.empty("edm:isShownAt", &[("rdf:resource", &p.page(1))]);
    if p.preview.is_some() {
        x.empty("edm:isShownBy", &[("rdf:resource", &p.file(PREVIEW, 1))]);
    }
    x.empty("edm:object", &[("rdf:resource", &p.file(POSTER, 1))]);
    x.text("edm:provider", &[], provider);
    x.empty(
        "edm:rights",
        &[("rdf:resource", &p.rights.uri.replacen("https://creativecommons", "http://creativecommons", 1))],
    );
    x.finish()
}

/// The files: the pack, and the preview and the poster that show it.
fn resources(x: &mut Xml, p: &Publication) {
    let rights = p.rights.uri.replacen("https://creativecommons", "http://creativecommons", 1);
    let pack = p.pack_file();
    let preview = p.preview.map(|v| (PREVIEW, v.bytes, Some(v.triangles)));
    let files = [Some((pack, p.pack.bytes, Some(p.figures.triangles))), preview, Some((POSTER, 0, None))];
    for (path, bytes, triangles) in files.into_iter().flatten() {
        x.begin("edm:WebResource", &[("rdf:about", &p.file(path, 1))]);
        x.text("dc:format", &[], media_type(path));
        x.text("dc:type", &[("xml:lang", "en")], if triangles.is_some() { "3D model" } else { "Image" });
        if bytes > 0 {
            x.text("dcterms:extent", &[], &format!("{bytes} bytes"));
        }
        if let Some(triangles) = triangles {
            x.text("dcterms:extent", &[("xml:lang", "en")], &format!("{triangles} triangles"));
        }
        x.text("dcterms:issued", &[], &p.published);
        x.empty("edm:rights", &[("rdf:resource", &rights)]);
        x.end();
    }
}
