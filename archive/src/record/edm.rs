//! `metadata/edm.xml`: the Europeana Data Model as RDF/XML, with its profile for 3D content: the site (ProvidedCHO), the page, the viewer, the model's
//! files and the poster (WebResource), and the Aggregation of them.
//!
//! Elements are in the order of Europeana's schema (EDM-COMMON-MAIN, CONTEXTS and ORE of europeana/metis-schema, 2026), which its validation
//! asks for. The viewer is what the object is shown by (its oEmbed answer, which the profile asks for); the preview, which browsers can load, is a view
//! of it; the pack is for downloading: the viewer says that it is a form of both. Ids are the object's address where it is known, `urn:kilwa:`
//! and the pack's identity else; an aggregator needs the address. [`europeana_lacks`] says what it would refuse.

use super::xml::Xml;
use super::{Publication, media_type};
use crate::layout::{OEMBED, PARADATA, POSTER, PREVIEW};
use crate::metadata::{AgentKind, Heritage, Metadata};
use crate::rights::Rights;

/// A mesh, in Europeana's vocabulary of models.
const MESH: &str = "http://data.europeana.eu/vocabulary/modelType/3DMesh";
/// "Captured from reality" in IPTC's vocabulary; the profile takes three of its terms.
const CAPTURED: &str = "https://cv.iptc.org/newscodes/digitalsourcetype/digitalCapture";
/// Statements of RightsStatements.org that Europeana takes.
const STATEMENTS: [&str; 6] = ["NoC-NC", "NoC-OKLR", "InC", "InC-EDU", "InC-OW-EU", "CNE"];

/// Who provides the object, as far as is known: the publisher, who holds the rights, or an organisation that made it.
fn provider(m: &Metadata) -> Option<&str> {
    let organisation = m.creators.iter().find(|a| a.kind != AgentKind::Person).map(|a| a.name.as_str());
    m.publisher.as_deref().or(m.rights.holder.as_deref()).or(organisation)
}

/// Why an aggregator for Europeana would refuse the record, each with what to write.
pub fn europeana_lacks(m: &Metadata, rights: &Rights) -> Vec<String> {
    let mut all = Vec::new();
    let mut lacks = |missing: bool, text: &str| {
        if missing {
            all.push(text.to_owned());
        }
    };
    lacks(m.url.is_none(), "url: Europeana refuses a record without the addresses of its page, viewer and pictures");
    lacks(provider(m).is_none(), "publisher: Europeana refuses a record without a provider");
    let code = rights.uri.strip_prefix("http://rightsstatements.org/vocab/").and_then(|rest| rest.split('/').next());
    if let Some(code) = code.filter(|code| !STATEMENTS.contains(code)) {
        all.push(format!(
            "rights.uri: Europeana does not accept {code}; it accepts Creative Commons, CC0, the Public Domain Mark, {}",
            STATEMENTS.join(", ")
        ));
    }
    if !says_what(m) {
        all.push(
            "object.kind, object.period, subjects or place: Europeana requires one of them; without it, the record says \"3D model\""
                .to_owned(),
        );
    }
    all
}

/// Whether one of what Europeana asks for is there: a subject, a type, a place or a time.
fn says_what(m: &Metadata) -> bool {
    let object = m.object.as_ref();
    let of_object = object.is_some_and(|o| o.kind.is_some() || o.period.is_some());
    of_object || !m.subjects.is_empty() || m.place.is_some()
}

/// As Europeana writes it.
fn rights_of(p: &Publication) -> String {
    p.rights.uri.replacen("https://creativecommons", "http://creativecommons", 1)
}

pub(super) fn edm(p: &Publication) -> String {
    let m = &p.metadata;
    let base = p.url().map_or_else(|| format!("urn:kilwa:{}", p.pack.identity), str::to_owned);
    let (cho, aggregation, place) = (format!("{base}#cho"), format!("{base}#aggregation"), format!("{base}#place"));
    let mut x = Xml::new(
        "rdf:RDF",
        &[
            ("xmlns:rdf", "http://www.w3.org/1999/02/22-rdf-syntax-ns#"),
            ("xmlns:rdfs", "http://www.w3.org/2000/01/rdf-schema#"),
            ("xmlns:dc", "http://purl.org/dc/elements/1.1/"),
            ("xmlns:dcterms", "http://purl.org/dc/terms/"),
            ("xmlns:edm", "http://www.europeana.eu/schemas/edm/"),
            ("xmlns:ore", "http://www.openarchives.org/ore/terms/"),
            ("xmlns:owl", "http://www.w3.org/2002/07/owl#"),
            ("xmlns:schema", "https://schema.org/"),
            ("xmlns:skos", "http://www.w3.org/2004/02/skos/core#"),
            ("xmlns:svcs", "http://rdfs.org/sioc/services#"),
            ("xmlns:wgs84_pos", "http://www.w3.org/2003/01/geo/wgs84_pos#"),
        ],
    );
    provided(&mut x, p, &cho, &place);
    resources(&mut x, p);
    if let Some(at) = &m.place {
        x.begin("edm:Place", &[("rdf:about", &place)]);
        if let (Some(latitude), Some(longitude)) = (at.latitude, at.longitude) {
            x.text("wgs84_pos:lat", &[], &latitude.to_string());
            x.text("wgs84_pos:long", &[], &longitude.to_string());
        }
        x.maybe("skos:prefLabel", &[("xml:lang", m.language.as_str())], p.place().as_deref());
        if let Some(uri) = &at.uri {
            x.empty("owl:sameAs", &[("rdf:resource", uri)]);
        }
        x.end();
    }
    aggregate(&mut x, p, &aggregation, &cho);
    if p.url().is_some() {
        x.begin("svcs:Service", &[("rdf:about", &service(p))]);
        x.empty("dcterms:conformsTo", &[("rdf:resource", "https://oembed.com/")]);
        x.text("rdfs:label", &[("xml:lang", "en")], "Kilwa viewer");
        x.end();
    }
    x.finish()
}

/// The service that gives the viewer.
fn service(p: &Publication) -> String {
    format!("{}#service", p.file(OEMBED, 1))
}

/// The site.
fn provided(x: &mut Xml, p: &Publication, cho: &str, place: &str) {
    let m = &p.metadata;
    let language = [("xml:lang", m.language.as_str())];
    let none = Heritage::default();
    let object = m.object.as_ref().unwrap_or(&none);
    x.begin("edm:ProvidedCHO", &[("rdf:about", cho)]);
    x.text("dc:title", &language, &m.title);
    for title in &m.alternative_titles {
        x.text("dcterms:alternative", &[], title);
    }
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
    match object.kind.as_deref() {
        Some(kind) => x.text("dc:type", &language, kind),
        None if says_what(m) => {}
        None => x.text("dc:type", &[("xml:lang", "en")], "3D model"),
    }
    for material in &object.materials {
        x.text("dcterms:medium", &language, material);
    }
    x.maybe("dcterms:created", &[], object.date.as_deref());
    x.maybe("dcterms:temporal", &language, object.period.as_deref());
    if m.place.is_some() {
        x.empty("dcterms:spatial", &[("rdf:resource", place)]);
    }
    x.text("edm:type", &[], "3D");
    x.end();
}

fn aggregate(x: &mut Xml, p: &Publication, aggregation: &str, cho: &str) {
    let provider = provider(&p.metadata).unwrap_or("unknown");
    let preview = p.preview.map(|_| p.file(PREVIEW, 1));
    let viewer = p.url().map(|_| p.file(OEMBED, 1));
    x.begin("ore:Aggregation", &[("rdf:about", aggregation)]);
    x.empty("edm:aggregatedCHO", &[("rdf:resource", cho)]);
    x.text("edm:dataProvider", &[], provider);
    if let Some(view) = preview.as_ref().filter(|_| viewer.is_some()) {
        x.empty("edm:hasView", &[("rdf:resource", view)]);
    }
    x.empty("edm:isShownAt", &[("rdf:resource", &p.page(1))]);
    if let Some(by) = viewer.or(preview) {
        x.empty("edm:isShownBy", &[("rdf:resource", &by)]);
    }
    x.empty("edm:object", &[("rdf:resource", &p.file(POSTER, 1))]);
    x.text("edm:provider", &[], provider);
    x.empty("edm:rights", &[("rdf:resource", &rights_of(p))]);
    x.end();
}

/// The files: viewer, pack, preview, poster, and the account of how it was made.
fn resources(x: &mut Xml, p: &Publication) {
    let rights = rights_of(p);
    let (pack, paradata) = (p.file(p.pack_file(), 1), p.file(PARADATA, 1));
    // The metadata say how it was captured where they have a block about it.
    let captured = p.metadata.capture.is_some();
    let end = |x: &mut Xml, is_3d: bool| {
        if is_3d {
            x.text("edm:type", &[], "3D");
            if captured {
                x.empty("schema:digitalSourceType", &[("rdf:resource", CAPTURED)]);
            }
        }
        x.end();
    };
    if p.url().is_some() {
        x.begin("edm:WebResource", &[("rdf:about", &p.file(OEMBED, 1))]);
        x.text("dc:format", &[], "application/json+oembed");
        x.empty("dcterms:isFormatOf", &[("rdf:resource", &pack)]);
        if p.preview.is_some() {
            x.empty("dcterms:isFormatOf", &[("rdf:resource", &p.file(PREVIEW, 1))]);
        }
        x.text("dcterms:issued", &[], &p.published);
        x.empty("edm:rights", &[("rdf:resource", &rights)]);
        x.empty("svcs:has_service", &[("rdf:resource", &service(p))]);
        end(x, true);
    }
    // Points have no polygons.
    let polygons = if p.figures.points.is_some() { None } else { Some(p.figures.triangles) };
    let of_pack = (p.pack_file(), p.pack.bytes, polygons, Some(p.figures.vertices));
    let preview = p.preview.map(|v| (PREVIEW, v.bytes, Some(v.triangles), None));
    for (path, bytes, triangles, vertices) in [Some(of_pack), preview].into_iter().flatten() {
        let what = match p.preview {
            Some(v) if path == PREVIEW && v.error > 0.0 => {
                format!("A coarser form for any 3D program, within {:.4} m", v.error)
            }
            _ if p.figures.points.is_some() => "All levels of detail, to the last point of the survey".to_owned(),
            _ => "All levels of detail, to the last triangle of the survey".to_owned(),
        };
        x.begin("edm:WebResource", &[("rdf:about", &p.file(path, 1))]);
        x.text("dc:description", &[("xml:lang", "en")], &what);
        x.text("dc:format", &[], media_type(path));
        x.maybe("dc:rights", &[], p.metadata.rights.holder.as_deref());
        x.empty("dc:type", &[("rdf:resource", MESH)]);
        x.text("dcterms:extent", &[], &format!("{bytes} bytes"));
        x.text("dcterms:issued", &[], &p.published);
        x.empty("edm:rights", &[("rdf:resource", &rights)]);
        if let Some(triangles) = triangles {
            x.text("edm:polygonCount", &[], &triangles.to_string());
        }
        if let Some(vertices) = vertices {
            x.text("edm:vertexCount", &[], &vertices.to_string());
        }
        x.empty("rdfs:seeAlso", &[("rdf:resource", &paradata)]);
        end(x, true);
    }
    x.begin("edm:WebResource", &[("rdf:about", &p.file(POSTER, 1))]);
    x.text("dc:format", &[], media_type(POSTER));
    x.text("dcterms:issued", &[], &p.published);
    x.empty("edm:rights", &[("rdf:resource", &rights)]);
    end(x, false);
    x.begin("edm:WebResource", &[("rdf:about", &paradata)]);
    x.text("dc:description", &[("xml:lang", "en")], "How it was captured and made");
    x.text("dc:format", &[], media_type(PARADATA));
    end(x, false);
}
