//! `--dry-run`: every field that was given, and where it goes.

use super::notes;
use super::photographs::ColourFiles;
use super::plan::Plan;
use kilwa_files::size;
use kilwa_pack::plural::counted;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write as _;

/// Field (of a list: without its number), Dublin Core, DataCite, Europeana, schema.org. Fields that are not listed here are in metadata.json,
/// paradata.json and on the page.
const TABLE: [(&str, &str, &str, &str, &str); 47] = [
    ("title", "title", "titles", "dc:title", "name"),
    ("alternative_titles", "title", "titles (AlternativeTitle)", "dcterms:alternative", "alternateName"),
    ("description", "description", "descriptions (Abstract)", "dc:description", "description"),
    ("language", "language", "language", "dc:language", "inLanguage"),
    ("subjects", "subject", "subjects", "dc:subject", "keywords"),
    ("slug", "", "", "", ""),
    ("url", "identifier", "url", "edm:isShownAt", "url"),
    ("identifier", "identifier", "doi", "dc:identifier", "identifier"),
    ("publisher", "publisher", "publisher", "edm:dataProvider", "publisher"),
    ("published", "date", "dates (Issued)", "dcterms:issued", "datePublished"),
    ("rights.uri", "rights", "rightsList", "edm:rights", "license"),
    ("rights.holder", "rights", "", "", "copyrightHolder"),
    ("rights.statement", "rights", "", "", "creditText"),
    ("photographs.rights", "", "", "", ""),
    ("photographs.creators", "", "", "", ""),
    ("photographs.holder", "", "", "", ""),
    ("photographs.credit", "", "", "", ""),
    ("creators.name", "creator", "creators", "dc:creator", "creator"),
    ("creators.kind", "", "creators.nameType", "", "creator.@type"),
    ("creators.orcid", "", "creators.nameIdentifiers", "", "creator.@id"),
    ("creators.ror", "", "creators.nameIdentifiers", "", "creator.@id"),
    ("creators.affiliation", "", "creators.affiliation", "", "creator.affiliation"),
    ("contributors.name", "contributor", "contributors", "dc:contributor", "contributor"),
    ("contributors.kind", "", "contributors.nameType", "", "contributor.@type"),
    ("contributors.role", "", "contributors.contributorType", "", ""),
    ("place.name", "coverage", "geoLocations", "skos:prefLabel", "contentLocation"),
    ("place.country", "coverage", "geoLocations", "skos:prefLabel", "contentLocation"),
    ("place.latitude", "coverage", "geoLocations", "wgs84_pos:lat", "contentLocation.geo"),
    ("place.longitude", "coverage", "geoLocations", "wgs84_pos:long", "contentLocation.geo"),
    ("place.uri", "", "", "owl:sameAs", "contentLocation.sameAs"),
    ("object.kind", "subject", "", "dc:type", ""),
    ("object.date", "coverage", "", "dcterms:created", ""),
    ("object.period", "subject", "", "dcterms:temporal", ""),
    ("object.materials", "", "", "dcterms:medium", ""),
    ("object.identifiers", "source", "", "dc:identifier", ""),
    ("capture.date", "", "dates (Collected)", "", "temporalCoverage"),
    ("capture.description", "", "descriptions (Methods)", "", ""),
    ("model.units", "", "", "", ""),
    ("model.crs", "", "", "", ""),
    ("access.state", "", "", "", ""),
    ("access.until", "", "", "", ""),
    ("related.relation", "", "relatedIdentifiers", "", ""),
    ("related.uri", "relation", "relatedIdentifiers", "", ""),
    ("funding.funder", "", "fundingReferences", "", ""),
    ("funding.award", "", "fundingReferences", "", ""),
    ("funding.uri", "", "fundingReferences", "", ""),
    ("contributors.orcid", "", "contributors.nameIdentifiers", "", "contributor.@id"),
];

/// One field that was given.
struct Row {
    field: String,
    value: String,
    goes: [&'static str; 4],
}

fn rows(plan: &Plan) -> Vec<Row> {
    let mut rows = Vec::new();
    let value = serde_json::to_value(&plan.facts.metadata).unwrap_or_default();
    flatten(&value, "", "", &mut rows);
    if plan.facts.metadata.published.is_none() {
        rows.push(row("published".to_owned(), "published", plan.facts.published.clone()));
    }
    rows.sort_by_key(|r| {
        TABLE.iter().position(|t| r.field.starts_with(t.0.split('.').next().unwrap_or_default())).unwrap_or(99)
    });
    rows
}

fn row(field: String, known: &str, value: String) -> Row {
    let found = TABLE.iter().find(|t| t.0 == known);
    Row { field, value, goes: found.map_or([""; 4], |t| [t.1, t.2, t.3, t.4]) }
}

/// `known` is the name in the table, without numbers.
fn flatten(value: &Value, name: &str, known: &str, rows: &mut Vec<Row>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                let join = |base: &str| if base.is_empty() { key.clone() } else { format!("{base}.{key}") };
                flatten(value, &join(name), &join(known), rows);
            }
        }
        Value::Array(list) if list.iter().all(Value::is_string) => {
            let texts: Vec<&str> = list.iter().filter_map(Value::as_str).collect();
            rows.push(row(name.to_owned(), known, texts.join("; ")));
        }
        Value::Array(list) => {
            for (i, value) in list.iter().enumerate() {
                flatten(value, &format!("{name}[{}]", i + 1), known, rows);
            }
        }
        Value::String(text) => rows.push(row(name.to_owned(), known, text.clone())),
        other => rows.push(row(name.to_owned(), known, other.to_string())),
    }
}

/// Say it as was asked.
pub(super) fn print(args: &super::Args, plan: &Plan) -> anyhow::Result<()> {
    let text = if args.json { format!("{:#}", json(plan)) } else { text(plan) };
    Ok(writeln!(crate::terminal::out(), "{text}")?)
}

/// For people.
fn text(plan: &Plan) -> String {
    let rows = rows(plan);
    let short = |t: &str, max: usize| {
        let t = t.replace('\n', " ");
        if t.chars().count() > max { format!("{}…", t.chars().take(max - 1).collect::<String>()) } else { t }
    };
    let heads = ["field", "value", "Dublin Core", "DataCite", "Europeana", "schema.org"];
    let cells: Vec<[String; 6]> = rows
        .iter()
        .map(|r| {
            let [dc, datacite, edm, schema] = r.goes.map(|g| if g.is_empty() { "-".to_owned() } else { g.to_owned() });
            [r.field.clone(), short(&r.value, 44), dc, datacite, edm, schema]
        })
        .collect();
    let width = |k: usize| cells.iter().map(|c| c[k].chars().count()).chain([heads[k].len()]).max().unwrap_or(0);
    let widths: [usize; 6] = std::array::from_fn(width);
    let mut s = String::new();
    let mut line = |cells: [&str; 6]| {
        let padded: Vec<String> =
            cells.iter().zip(widths).map(|(c, w)| format!("{c}{}", " ".repeat(w - c.chars().count()))).collect();
        let _ = writeln!(s, "{}", padded.join("  ").trim_end());
    };
    line(heads);
    for c in &cells {
        line([0, 1, 2, 3, 4, 5].map(|k| c[k].as_str()));
    }
    let _ = write!(
        s,
        "\nAll of it also stands in metadata/metadata.json and on the page; capture and steps in metadata/paradata.json.\n\
         Would write {}, version {} of {}: {}\n  pack: {}, {}, {}\n  rights: {}",
        plan.at,
        plan.facts.version(),
        plan.facts.published,
        plan.facts.note,
        size::text(plan.given.pack_bytes),
        counted(plan.given.of_pack.triangles, "triangle", "triangles"),
        plan.facts.crs.as_deref().unwrap_or("local coordinates"),
        plan.facts.rights.label,
    );
    if let Some(notes) = &plan.given.notes {
        let _ = write!(s, "\n  notes: {}", notes.notes.len());
    }
    if let Some(holes) = &plan.given.holes {
        let _ = write!(s, "\n  holes: {}", holes.holes.len());
    }
    if let Some(colours) = &plan.given.colours {
        let _ = write!(s, "\n  colour report: {}", colours.report_in_words());
        if let Some(summary) = colours.summary() {
            let _ = write!(s, "\n  photographs: {summary}");
        }
    }
    for what in plan.channels_left_out().into_iter().chain(notes::left_out(plan)) {
        let _ = write!(s, "\n  left out: {what}");
    }
    if plan.given.place.is_some() {
        s.push_str("\n  place: removed; place names in texts stay as they are");
    }
    for warning in plan.warnings() {
        let _ = write!(s, "\n  is this meant? {warning}");
    }
    for advice in plan.advice() {
        let _ = write!(s, "\n  better with: {advice}");
    }
    s.push_str("\nNothing was written.");
    s
}

/// For programs.
fn json(plan: &Plan) -> Value {
    let fields: Vec<Value> = rows(plan)
        .into_iter()
        .map(|r| {
            let [dc, datacite, edm, schema] = r.goes;
            json!({ "field": r.field, "value": r.value, "dublin_core": dc, "datacite": datacite, "europeana": edm, "schema_org": schema })
        })
        .collect();
    let colours = ColourFiles::of(&plan.given);
    json!({ "object": plan.at, "colour_report": colours.colour_report, "photographs": colours.photographs, "masks": colours.masks,
        "photograph_bytes": colours.photograph_bytes, "photograph_copies": colours.photograph_copies, "photograph_copy_bytes": colours.photograph_copy_bytes, "version": plan.facts.version(), "published": plan.facts.published, "note": plan.facts.note,
        "fields": fields, "notes": plan.given.notes.as_ref().map_or(0, |n| n.notes.len()), "holes": plan.given.holes.as_ref().map_or(0, |n| n.holes.len()), "left_out": plan.channels_left_out().into_iter().chain(notes::left_out(plan)).collect::<Vec<_>>(), "warnings": plan.warnings(), "advice": plan.advice() })
}
