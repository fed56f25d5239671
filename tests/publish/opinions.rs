//! Independent validators of an object: bagit, rocrate, DataCite's JSON schema, rdflib, expat, citation parsers. From PyPI, pinned
//! in tests/trust/requirements.txt; `cargo xtask test` puts them in the tools' folder and names it in `KILWA_PYTHON`.

use super::{Bench, FULL, MINIMAL, json_of, other_pack, pack};
use crate::support::text;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The JSON that a Python program prints, or `None` where the packages are not there.
fn python(program: &str, folder: &Path) -> Option<Value> {
    let Some(packages) = std::env::var_os("KILWA_PYTHON") else {
        println!(
            "skipped: opinions of bagit, rocrate, datacite, rdflib, rispy and bibtexparser: KILWA_PYTHON is not set (cargo xtask test sets it)"
        );
        return None;
    };
    let output =
        Command::new("python3").env("PYTHONPATH", packages).args(["-c", program]).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(output.stdout.trim_ascii().rsplit(|b| *b == b'\n').next().unwrap()).unwrap())
}

const PROGRAM: &str = r#"
import sys, json, os, logging
logging.disable(logging.CRITICAL)
site = sys.argv[1]
[slug] = [d for d in os.listdir(site) if os.path.isfile(f"{site}/{d}/manifest.json")]
v = f"{site}/{slug}/v1"
out = {}
import bagit
bag = bagit.Bag(f"{site}/{slug}.bag")
out["bag"] = bag.is_valid()
out["bag_info"] = dict(bag.info)
from rocrate.rocrate import ROCrate
crate = ROCrate(v)
out["crate"] = {"name": crate.name, "license": crate.license if isinstance(crate.license, str) else crate.license.id,
    "missing": [e.id for e in crate.data_entities if not os.path.exists(f"{v}/{e.id}")],
    "files": len(crate.data_entities), "people": [p.get("name") for p in crate.contextual_entities if p.type == "Person"]}
import datacite.schema45 as schema
d = json.load(open(f"{v}/metadata/datacite.json"))
out["datacite"] = [f"{list(e.path)}: {e.message}" for e in schema.validator.iter_errors(d)]
import rdflib
g = rdflib.Graph().parse(f"{v}/metadata/edm.xml", format="xml")
EDM, ORE = rdflib.Namespace("http://www.europeana.eu/schemas/edm/"), rdflib.Namespace("http://www.openarchives.org/ore/terms/")
RDF = rdflib.RDF
def one(kind):
    [s] = g.subjects(RDF.type, kind); return s
cho, aggregation = one(EDM.ProvidedCHO), one(ORE.Aggregation)
needed = [EDM.aggregatedCHO, EDM.dataProvider, EDM.isShownAt, EDM.provider, EDM.rights, EDM.object]
import re
DC, DCT = rdflib.DC, rdflib.DCTERMS
linked = [str(o) for p in [EDM.isShownBy, EDM.hasView, EDM.object] for o in g.objects(aggregation, p)]
described = {str(s) for s in g.subjects(RDF.type, EDM.WebResource)}
SVCS = rdflib.Namespace("http://rdfs.org/sioc/services#")
services = list(g.subjects(RDF.type, SVCS.Service))
# What Europeana's schema and its rules ask for; elements of a class in its order.
ORDER = {
    "WebResource": "dc:creator dc:description dc:format dc:rights dc:source dc:type dc:title dc:language dcterms:conformsTo dcterms:created dcterms:extent dcterms:hasPart dcterms:isFormatOf dcterms:isPartOf dcterms:issued dcterms:temporal edm:isNextInSequence edm:rights owl:sameAs edm:pointCount edm:polygonCount edm:vertexCount rdfs:seeAlso dcterms:isReferencedBy edm:preview svcs:has_service edm:type schema:digitalSourceType edm:intendedUsage",
    "Aggregation": "edm:aggregatedCHO edm:dataProvider edm:hasView edm:isShownAt edm:isShownBy edm:object edm:provider dc:rights edm:rights edm:ugc",
    "Place": "wgs84_pos:lat wgs84_pos:long wgs84_pos:alt skos:prefLabel skos:altLabel skos:note dcterms:hasPart dcterms:isPartOf owl:sameAs",
    "Service": "dcterms:conformsTo doap:implements rdfs:label",
}
NAMES = {"dc": "http://purl.org/dc/elements/1.1/", "dcterms": "http://purl.org/dc/terms/", "edm": "http://www.europeana.eu/schemas/edm/",
    "owl": "http://www.w3.org/2002/07/owl#", "rdfs": "http://www.w3.org/2000/01/rdf-schema#", "svcs": "http://rdfs.org/sioc/services#",
    "schema": "https://schema.org/", "skos": "http://www.w3.org/2004/02/skos/core#", "wgs84_pos": "http://www.w3.org/2003/01/geo/wgs84_pos#", "doap": "http://usefulinc.com/ns/doap#"}
import xml.etree.ElementTree as ET
out_of_order = []
for one in ET.parse(f"{v}/metadata/edm.xml").getroot():
    kind = one.tag.split("}")[1]
    tags = [c.tag for c in one]
    if kind == "ProvidedCHO":
        if tags.count(tags[-1]) != 1 or not tags[-1].endswith("}type") or "europeana" not in tags[-1]: out_of_order.append(kind)
        continue
    order = ["{%s}%s" % (NAMES[n.split(":")[0]], n.split(":")[1]) for n in ORDER[kind].split()]
    places = [order.index(t) if t in order else -1 for t in tags]
    if -1 in places or places != sorted(places): out_of_order.append([kind, tags])
RIGHTS = r"http://(creativecommons\.org/(licenses/(by|by-sa|by-nd|by-nc|by-nc-sa|by-nc-nd)/[0-9.]+/([a-z]+/)?|publicdomain/(zero|mark)/1\.0/)|rightsstatements\.org/vocab/(NoC-NC|NoC-OKLR|InC|InC-EDU|InC-OW-EU|CNE)/1\.0/)"
out["edm_rules"] = {
    "order": out_of_order,
    "rights": [str(o) for o in g.objects(None, EDM.rights) if not re.fullmatch(RIGHTS, str(o))],
    "title": bool(g.value(cho, DC.title)), "what": any((cho, p, None) in g for p in [DC.subject, DC.type, DCT.temporal, DCT.spatial]),
    "language": bool(g.value(cho, DC.language)), "shown": (aggregation, EDM.isShownAt, None) in g,
    "undescribed": [l for l in linked if l not in described],
    "viewer": [[str(g.value(s, DCT.conformsTo)), len(list(g.objects(w, DCT.isFormatOf))), str(g.value(w, EDM.type))] for s in services for w in g.subjects(SVCS.has_service, s)],
    "loose": [str(o) for o in g.objects(None, DCT.isFormatOf) if str(o) not in described]}
out["edm"] = {"missing": [str(p) for p in needed if (aggregation, p, None) not in g], "cho": (aggregation, EDM.aggregatedCHO, cho) in g,
    "type": str(g.value(cho, EDM.type)), "title": str(g.value(cho, rdflib.DC.title)), "rights": str(g.value(aggregation, EDM.rights)),
    "resources": len(list(g.subjects(RDF.type, EDM.WebResource)))}
import xml.etree.ElementTree as ET
DC = "{http://purl.org/dc/elements/1.1/}"
root = ET.parse(f"{v}/metadata/dc.xml").getroot()
known = {"title", "creator", "subject", "description", "publisher", "contributor", "date", "type", "format", "identifier", "source", "language", "relation", "coverage", "rights"}
out["dc"] = {"root": root.tag, "strange": [e.tag for e in root if e.tag.replace(DC, "") not in known or len(e)], "title": root.find(DC + "title").text,
    "creators": [e.text for e in root.findall(DC + "creator")]}
ATOM = "{http://www.w3.org/2005/Atom}"
feed = ET.parse(f"{site}/feed.xml").getroot()
out["feed"] = [feed.tag] + [e.find(ATOM + "title").text for e in feed.findall(ATOM + "entry")] + [n for n in ["id", "title", "updated"] if feed.find(ATOM + n) is None]
import rispy, bibtexparser
out["ris"] = rispy.load(open(f"{v}/citation.ris", encoding="utf-8"))
library = bibtexparser.parse_file(f"{v}/citation.bib")
out["bib"] = {"failed": len(library.failed_blocks), "entries": [{k: f.value for k, f in e.fields_dict.items()} | {"type": e.entry_type} for e in library.entries]}
from PIL import Image
def picture(path):
    with Image.open(path) as i:
        i.load(); return [i.format, *i.size]
out["pictures"] = [picture(f"{v}/{p}") for p in ["poster.jpg", "poster-600.jpg", "poster-300.jpg", "drawings/plan.png", "drawings/west.png"]]
import html.parser
class Page(html.parser.HTMLParser):
    def __init__(self):
        super().__init__(); self.ld = False; self.data = ""; self.links = []
    def handle_starttag(self, tag, attrs):
        a = dict(attrs); self.ld = tag == "script" and a.get("type") == "application/ld+json"
        if tag == "link": self.links.append(a.get("rel"))
    def handle_data(self, data):
        if self.ld: self.data += data
    def handle_endtag(self, tag): self.ld = False
page = Page(); page.feed(open(f"{site}/{slug}/index.html", encoding="utf-8").read())
out["page"] = {"ld": json.loads(page.data), "links": page.links}
print(json.dumps(out))
"#;

#[test]
fn independent_validators_accept_every_record() {
    let bench = Bench::new();
    bench.published(&pack(), FULL, &["--bag", "--site"]);
    let Some(report) = python(PROGRAM, &bench.path("site")) else { return };
    let title = "Gereza & fort, \"Kilwa\"";
    assert_eq!((&report["bag"], &report["bag_info"]["Bagging-Date"]), (&true.into(), &"2026-11-21".into()));
    let crate_ = &report["crate"];
    assert_eq!((&crate_["name"], crate_["missing"].as_array().unwrap().len()), (&title.into(), 0), "{crate_}");
    assert_eq!(crate_["license"], "https://creativecommons.org/licenses/by/4.0/");
    assert_eq!(crate_["people"], serde_json::json!(["Heinz Rüther", "Christoph Held"]));
    assert_eq!(report["datacite"], serde_json::json!([]));
    let edm = &report["edm"];
    assert_eq!(
        (&edm["missing"], &edm["cho"], &edm["type"], &edm["resources"]),
        (&serde_json::json!([]), &true.into(), &"3D".into(), &5.into())
    );
    let expected = serde_json::json!({ "order": [], "rights": [], "title": true, "what": true, "language": true, "shown": true, "undescribed": [],
        "viewer": [["https://oembed.com/", 2, "3D"]], "loose": [] });
    assert_eq!(report["edm_rules"], expected);
    assert_eq!((&edm["title"], &edm["rights"]), (&title.into(), &"http://creativecommons.org/licenses/by/4.0/".into()));
    let dc = &report["dc"];
    assert_eq!(dc["root"], "{http://www.openarchives.org/OAI/2.0/oai_dc/}dc");
    assert_eq!(
        (&dc["strange"], &dc["title"], &dc["creators"]),
        (&serde_json::json!([]), &title.into(), &serde_json::json!(["Rüther, Heinz", "Zamani Project"]))
    );
    assert_eq!(report["feed"], serde_json::json!(["{http://www.w3.org/2005/Atom}feed", title]));
    let ris = &report["ris"][0];
    assert_eq!(
        (&ris["title"], &ris["authors"], &ris["doi"]),
        (&title.into(), &serde_json::json!(["Rüther, Heinz", "Zamani Project"]), &"10.1234/abc_d".into())
    );
    let bib = &report["bib"];
    assert_eq!(
        (&bib["failed"], &bib["entries"][0]["year"], &bib["entries"][0]["doi"]),
        (&0.into(), &"2026".into(), &"10.1234/abc_d".into())
    );
    assert_eq!(
        report["pictures"],
        serde_json::json!([
            ["JPEG", 1200, 630],
            ["JPEG", 600, 315],
            ["JPEG", 300, 158],
            ["PNG", 1240, 1754],
            ["PNG", 1754, 1240]
        ])
    );
    assert_eq!((&report["page"]["ld"]["@type"], &report["page"]["ld"]["name"]), (&"3DModel".into(), &title.into()));
}

#[test]
fn the_khronos_validator_accepts_the_preview() {
    let validator = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser/node_modules/gltf-validator/index.js");
    if !validator.is_file() {
        println!("skipped: {} is not here (cargo xtask test installs it)", validator.display());
        return;
    }
    let bench = Bench::new();
    let preview = bench.published(&other_pack(), MINIMAL, &[]).join("v1/preview.glb");
    let script = "const v = require(process.argv[1]); const fs = require('fs');
        v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2]))).then(r => console.log(JSON.stringify(r.issues)));";
    let output = Command::new("node").args(["-e", script, text(&validator), text(&preview)]).output().unwrap();
    let issues: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_eq!((&issues["numErrors"], &issues["numWarnings"]), (&0.into(), &0.into()), "{issues:#}");
}

#[test]
fn minimal_metadata_gives_valid_records() {
    let bench = Bench::new();
    let object = bench.published(&other_pack(), MINIMAL, &["--bag", "--site"]);
    assert!(!object.join("v1/oembed.json").exists(), "oEmbed needs an address");
    assert_eq!(json_of(&object.join("v1/metadata/datacite.json"))["creators"][0]["name"], ":unkn");
    let report = bench.publish(&other_pack(), MINIMAL, &["--dry-run", "--version-note", "x"]);
    let advice = String::from_utf8(report.stdout).unwrap();
    for lacking in ["url: Europeana refuses", "publisher: Europeana refuses", "object.kind, object.period"] {
        assert!(advice.contains(&format!("better with: {lacking}")), "{lacking} in {advice}");
    }
    let Some(report) = python(PROGRAM, &bench.path("site")) else { return };
    assert_eq!((&report["bag"], &report["datacite"]), (&true.into(), &serde_json::json!([])));
    let rules = &report["edm_rules"];
    assert_eq!(
        (&rules["order"], &rules["what"], &rules["undescribed"]),
        (&serde_json::json!([]), &true.into(), &serde_json::json!([]))
    );
    assert_eq!(
        (&report["crate"]["missing"], &report["edm"]["missing"], &report["bib"]["failed"]),
        (&serde_json::json!([]), &serde_json::json!([]), &0.into())
    );
}

#[test]
fn independent_validators_detect_later_changes() {
    let bench = Bench::new();
    let object = bench.published(&other_pack(), MINIMAL, &["--bag"]);
    // The bag shares its files: what changes there changes here, and bagit sees it.
    let readme = bench.path("site/fort.bag/data/v1/README.txt");
    let old = std::fs::read(&readme).unwrap();
    std::fs::remove_file(&readme).unwrap();
    std::fs::write(&readme, [&old[1..], b"x"].concat()).unwrap();
    assert_eq!(
        std::fs::read(object.join("v1/README.txt")).unwrap(),
        old,
        "removing a file of the bag leaves the object's"
    );
    let program = "import sys, json, bagit, logging\nlogging.disable(logging.CRITICAL)\nprint(json.dumps(bagit.Bag(sys.argv[1] + '/fort.bag').is_valid()))";
    let Some(report) = python(program, &bench.path("site")) else { return };
    assert_eq!(report, false, "{}", text(&readme));
}
