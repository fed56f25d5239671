use super::*;
use crate::layout::pack_name;

/// A publication with everything in it, with characters that XML, TeX, HTML and JSON have to escape.
pub(crate) fn full() -> Publication {
    let toml = r#"
title = "Gereza <Kilwa> & \"fort\""
alternative_titles = ["Ngome"]
description = "First & last.\n\nSecond <b>paragraph</b>."
subjects = ["fort", "Swahili"]
url = "https://museum.example/gereza/"
identifier = "doi:10.1234/abc_d"
publisher = "Museum & Sons"
[rights]
uri = "CC BY 4.0"
holder = "Antiquities"
[[creators]]
name = "Rüther, Heinz {x}"
orcid = "0000-0002-1825-0097"
affiliation = "UCT"
[[creators]]
name = "Zamani Project"
kind = "organisation"
[[contributors]]
name = "Held, Christoph"
role = "Data Collector"
[place]
name = "Kilwa"
country = "TZ"
latitude = -8.9577
longitude = 39.5228
uri = "https://www.wikidata.org/wiki/Q1"
[object]
kind = "Fort"
materials = ["coral rag"]
identifiers = ["UNESCO 144"]
[capture]
date = "2009-07"
accuracy = 0.003
[[capture.steps]]
what = "Registration"
[model]
units = "m"
crs = "EPSG:32737"
[[related]]
relation = "IsDescribedBy"
uri = "10.1145/1015706.1015802"
[[funding]]
funder = "WMF"
award = "1"
"#;
    let metadata = Metadata::parse(toml).unwrap();
    let sha256 = "ab".repeat(32);
    Publication {
        rights: Rights::parse(&metadata.rights.uri).unwrap(),
        metadata,
        slug: Slug::new("gereza").unwrap(),
        version: 2,
        published: "2026-11-21".to_owned(),
        first_published: "2025-01-02".to_owned(),
        note: "Better".to_owned(),
        pack: PackEntry { url: format!("v2/{}", pack_name(&sha256)), bytes: 77, sha256, identity: "cd".repeat(16) },
        figures: Figures {
            bounds: [[512_000.0, 9_007_000.0, 0.0], [512_050.0, 9_007_060.0, 9.5]].map(glam::DVec3::from),
            crs: Some("EPSG:32737".to_owned()),
            units: "m".to_owned(),
            source_units: "m".to_owned(),
            triangles: 1_234_567,
            points: None,
            vertices: 600_000,
            spacing: 0.02,
            accuracy: Some(0.003),
        },
        of_pack: serde_json::from_value(serde_json::json!({
            "title": "t", "source_units": "m", "source_up": "z", "lattice_step": 0.001, "bounds_min": [0.0, 0.0, 0.0], "bounds_max": [1.0, 1.0, 1.0],
            "median_edge": 0.02, "triangles": 1_234_567, "vertices": 600_000, "border_edges": 4, "sources": [], "tool": "kilwa", "options": {}
        }))
        .unwrap(),
        location_redacted: false,
        preview: Some(Preview { bytes: 5, triangles: 9, error: 0.01 }),
        notes: None,
        holes: None,
        tiles: None,
        colours: None,
        tool: "kilwa 0".to_owned(),
    }
}

fn text(path: &str) -> String {
    let all = records(&full());
    let (_, bytes) = all.iter().find(|(p, _)| *p == path).unwrap();
    String::from_utf8(bytes.clone()).unwrap()
}

#[test]
fn the_same_publication_gives_the_same_bytes() {
    assert_eq!(records(&full()), records(&full()));
    assert_eq!(schema_org(&full()), schema_org(&full()));
}

#[test]
fn special_characters_of_xml_and_tex_are_escaped() {
    let dc = text(DUBLIN_CORE);
    assert!(dc.contains("Gereza &lt;Kilwa&gt; &amp; &quot;fort&quot;") && !dc.contains("<Kilwa>"), "{dc}");
    let bib = text(CITATIONS[1]);
    assert!(
        bib.contains("author = {Rüther, Heinz \\{x\\} and {Zamani Project}}") && bib.contains("Museum \\& Sons"),
        "{bib}"
    );
    assert!(bib.contains("doi = {10.1234/abc_d}"), "{bib}");
}

#[test]
fn a_citation_has_creators_year_title_version_publisher_and_doi() {
    let text = citation(&full());
    assert_eq!(
        text,
        "Rüther, H. {. and Zamani Project (2026): Gereza <Kilwa> & \"fort\" (version 2) [3D model]. Museum & Sons. https://doi.org/10.1234/abc_d"
    );
    let mut p = full();
    p.metadata.creators.clear();
    (p.metadata.identifier, p.metadata.url) = (None, None);
    assert!(citation(&p).starts_with("Gereza") && citation(&p).ends_with(&format!("urn:kilwa:{}", "cd".repeat(16))));
}

#[test]
fn addresses_are_absolute_if_the_site_is_known_and_relative_otherwise() {
    assert!(text(IIIF).contains("\"https://museum.example/gereza/v2/preview.glb\""));
    let mut p = full();
    p.metadata.url = None;
    let all = records(&p);
    let iiif =
        all.iter().find(|(path, _)| *path == IIIF).map(|(_, b)| String::from_utf8_lossy(b).into_owned()).unwrap();
    assert!(iiif.contains("\"../preview.glb\"") && !iiif.contains("museum.example"), "{iiif}");
    assert!(!all.iter().any(|(path, _)| *path == OEMBED), "oEmbed needs an address");
}

#[test]
fn the_edm_record_has_viewer_model_and_provider_and_warns_of_what_europeana_refuses() {
    let edm = text(EDM);
    for part in [
        "<edm:isShownBy rdf:resource=\"https://museum.example/gereza/v2/oembed.json\"/>",
        "<edm:hasView rdf:resource=\"https://museum.example/gereza/v2/preview.glb\"/>",
        "<dcterms:conformsTo rdf:resource=\"https://oembed.com/\"/>",
        "<edm:polygonCount>1234567</edm:polygonCount>",
        "<edm:vertexCount>600000</edm:vertexCount>",
        "modelType/3DMesh",
        "digitalCapture",
        "<edm:dataProvider>Museum &amp; Sons</edm:dataProvider>",
    ] {
        assert!(edm.contains(part), "{part} in {edm}");
    }
    let full = full();
    assert_eq!(europeana_lacks(&full.metadata, &full.rights), Vec::<String>::new());
    let minimal = Metadata::parse("title = \"Fort\"\n[rights]\nuri = \"UND\"\n[model]\nunits = \"m\"\n").unwrap();
    let rights = Rights::parse("UND").unwrap();
    let lacks = europeana_lacks(&minimal, &rights);
    for what in ["url:", "publisher:", "rights.uri: Europeana does not accept UND", "object.kind"] {
        assert!(lacks.iter().any(|l| l.starts_with(what)), "{what} in {lacks:?}");
    }
    // Without an address there is no viewer to embed, and no record mentions one.
    let mut p = full;
    (p.metadata.url, p.metadata.publisher, p.metadata.rights.holder) = (None, None, None);
    let edm = edm::edm(&p);
    assert!(edm.contains("<edm:isShownBy rdf:resource=\"../preview.glb\"/>") && !edm.contains("svcs:Service"), "{edm}");
    assert!(edm.contains("<edm:dataProvider>Zamani Project</edm:dataProvider>"), "an organisation that made it");
}

#[test]
fn every_record_names_the_rights_and_the_title() {
    for path in [DUBLIN_CORE, DATACITE, EDM, IIIF, LICENCE, README] {
        let text = text(path);
        assert!(text.contains("creativecommons.org/licenses/by/4.0/"), "{path}: {text}");
        assert!(text.contains("Gereza"), "{path}");
    }
    let crate_ = String::from_utf8(ro_crate(&full(), &[("a.txt".to_owned(), 1, "00".to_owned())])).unwrap();
    assert!(crate_.contains("a.txt") && crate_.contains("creativecommons.org"));
}

#[test]
fn records_name_the_media_type_of_every_kind_of_file() {
    let types = [
        ("drawings/plan.pgw", "text/plain"),
        ("drawings/plan.png", "image/png"),
        ("metadata/annotations.json", "application/ld+json"),
        ("metadata/datacite.json", "application/json"),
        ("bagit.txt", "text/plain"),
        ("v1/fort.kilwa", "application/octet-stream"),
        ("preview.glb", "model/gltf-binary"),
    ];
    for (path, wanted) in types {
        assert_eq!(media_type(path), wanted, "{path}");
    }
}
