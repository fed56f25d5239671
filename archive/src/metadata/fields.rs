//! From a TOML file to [`Metadata`]: which fields there are, what each may hold, which are needed.

use super::lines::{strays, syntax};
use super::{
    AccessField, Agent, AgentKind, Capture, CaptureStep, Funding, Heritage, Metadata, Model, PhotographsField, Place,
    Problem, Problems, Related, RightsField, crs,
};
use crate::AccessState;
use crate::date::{is_date_or_span, is_day, iso};
use crate::layout::Slug;
use crate::rights::{self, Rights};
use kilwa_geometry::LengthUnit;
use kilwa_toml::{File, Found, Table, nearest};
use toml::de::DeTable;

/// Largest metadata file, bytes.
pub(super) const FILE_MAX: usize = 1 << 20;

/// Examples of templates that earlier versions wrote, where nobody can mean them.
const EXAMPLES: [&str; 5] = [
    "Family, Given",
    "Museum of …",
    "A fort of coral rag on the shore …",
    "https://www.wikidata.org/wiki/Q…",
    "doi:10.1234/abcd",
];

/// DataCite 4.5, relationType: the schema that what is written is checked with.
pub(super) const RELATIONS: [&str; 36] = [
    "IsCitedBy",
    "Cites",
    "IsSupplementTo",
    "IsSupplementedBy",
    "IsContinuedBy",
    "Continues",
    "IsDescribedBy",
    "Describes",
    "HasMetadata",
    "IsMetadataFor",
    "HasVersion",
    "IsVersionOf",
    "IsNewVersionOf",
    "IsPreviousVersionOf",
    "IsPartOf",
    "HasPart",
    "IsPublishedIn",
    "IsReferencedBy",
    "References",
    "IsDocumentedBy",
    "Documents",
    "IsCompiledBy",
    "Compiles",
    "IsVariantFormOf",
    "IsOriginalFormOf",
    "IsIdenticalTo",
    "IsReviewedBy",
    "Reviews",
    "IsDerivedFrom",
    "IsSourceOf",
    "IsRequiredBy",
    "Requires",
    "IsObsoletedBy",
    "Obsoletes",
    "IsCollectedBy",
    "Collects",
];

pub(super) fn parse(text: &str) -> Result<Metadata, Problems> {
    let alone = |message: String, line| Problems(vec![Problem::new(line, "", message)]);
    if text.len() > FILE_MAX {
        return Err(alone(format!("the file has {} bytes; at most {FILE_MAX} are allowed", text.len()), 1));
    }
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let file = File::new(text).with_examples(&EXAMPLES);
    let strays = strays(text);
    let root = DeTable::parse(text).map_err(|e| {
        let line = e.span().map_or(1, |s| file.line(s.start));
        // A field below a block that is a comment may be the second of its name.
        let stray = strays.iter().find(|p| p.line == line).cloned();
        stray.map_or_else(|| alone(syntax(e.message(), text, line), line), |p| Problems(vec![p]))
    })?;
    let metadata = metadata(Table::new(&file, "", 0, root.get_ref()));
    let mut problems = file.into_problems();
    // Problems of the position of a field explain problems of the field.
    problems.retain(|p| strays.iter().all(|s| s.line != p.line));
    problems.extend(strays);
    problems.sort_by_key(|p| p.line);
    match (metadata, problems) {
        (Some(metadata), problems) if problems.is_empty() => Ok(metadata),
        (_, problems) => Err(Problems(problems)),
    }
}

fn metadata(t: Table<'_, '_>) -> Option<Metadata> {
    let title = t.text("title").map(|f| f.value);
    if title.as_ref().is_none_or(|title| !title.chars().any(char::is_alphanumeric)) {
        t.missing("title", "every model needs a title; write title = \"…\" at the top of the file");
    }
    let slug = t.text("slug").and_then(|f| {
        let slug = Slug::new(&f.value).map_err(|e| t.wrong("slug", f.at, e.to_string())).ok()?;
        Some(slug.as_str().to_owned())
    });
    let url = t.text("url").and_then(|f| {
        let address = address(&t, "url", f)?;
        Some(if address.ends_with('/') { address } else { format!("{address}/") })
    });
    let partial = (
        t.texts("alternative_titles"),
        t.paragraphs("description"),
        t.text("language").and_then(|f| language(&t, f)).unwrap_or_else(|| "en".to_owned()),
        t.texts("subjects"),
        t.text("identifier").and_then(|f| identifier(&t, "identifier", &f)),
        t.text("publisher").map(|f| f.value),
        checked(&t, "published", is_day, "expected a date such as 2026-11-21"),
    );
    let rights = rights_field(&t);
    let photographs = t.table("photographs").and_then(photographs);
    let creators = agents(&t, "creators");
    let contributors = agents(&t, "contributors");
    let (place, object, capture) =
        (t.table("place").map(place), t.table("object").map(heritage), t.table("capture").map(capture));
    let model = model(&t);
    let access = t.table("access").and_then(access);
    let (related, funding) = (related(&t), funding(&t));
    t.finish();
    let (alternative_titles, description, language, subjects, identifier, publisher, published) = partial;
    Some(Metadata {
        title: title?,
        alternative_titles,
        description,
        language,
        subjects,
        slug,
        url,
        identifier,
        publisher,
        published,
        rights: rights?,
        photographs,
        creators,
        contributors,
        place,
        object,
        capture,
        model: model?,
        access,
        related,
        funding,
    })
}

fn rights_field(t: &Table<'_, '_>) -> Option<RightsField> {
    let wanted = format!("every model needs a statement of rights; write {}", rights::CHOICES);
    let Some(table) = t.table("rights") else {
        t.missing("rights", &format!("add a line [rights] and below it uri = \"…\": {wanted}"));
        return None;
    };
    let given = table.text("uri");
    if given.is_none() {
        table.missing("uri", &wanted);
    }
    let uri = given.and_then(|f| Rights::parse(&f.value).map_err(|message| table.wrong("uri", f.at, message)).ok());
    let (holder, statement) = (table.text("holder").map(|f| f.value), table.paragraphs("statement"));
    table.finish();
    Some(RightsField { uri: uri?.uri, holder, statement })
}

fn photographs(t: Table<'_, '_>) -> Option<PhotographsField> {
    let given = t.text("rights");
    if given.is_none() {
        t.missing("rights", &format!("photographs need a statement of rights of their own; write {}", rights::CHOICES));
    }
    let known = given.and_then(|f| Rights::parse(&f.value).map_err(|message| t.wrong("rights", f.at, message)).ok());
    let (creators, holder, credit) = (t.texts("creators"), t.text("holder").map(|f| f.value), t.paragraphs("credit"));
    t.finish();
    Some(PhotographsField { rights: known?.uri, creators, holder, credit })
}

fn model(t: &Table<'_, '_>) -> Option<Model> {
    let wanted = format!("the units of the mesh that was scanned are needed: one of {}", LengthUnit::symbols());
    let Some(table) = t.table("model") else {
        t.missing("model", &format!("add a line [model] and below it units = \"m\"; {wanted}"));
        return None;
    };
    let units = match table.text("units") {
        Some(f) if LengthUnit::parse(&f.value).is_some_and(|unit| unit.symbol() == f.value) => Some(f.value),
        Some(f) => {
            table.wrong("units", f.at, format!("\"{}\" is not a unit; {wanted}", f.value));
            None
        }
        None => {
            table.missing("units", &wanted);
            None
        }
    };
    let crs = table.text("crs").and_then(|f| match crs::normalise(&f.value) {
        Ok(None) => Some("local".to_owned()),
        Ok(crs) => crs,
        Err(message) => {
            table.wrong("crs", f.at, message);
            None
        }
    });
    table.finish();
    Some(Model { units: units?, crs })
}

fn agents(t: &Table<'_, '_>, key: &'static str) -> Vec<Agent> {
    let agent = |table: Table<'_, '_>| {
        let name = table.text("name").map(|f| f.value);
        if name.is_none() {
            table.missing("name", "a name is missing; write \"Family, Given\" for a person");
        }
        let kind = table.text("kind").map_or(AgentKind::Person, |f| match f.value.as_str() {
            "person" => AgentKind::Person,
            "organisation" | "organization" => AgentKind::Organisation,
            other => {
                table.wrong("kind", f.at, format!("\"{other}\" is neither \"person\" nor \"organisation\""));
                AgentKind::Person
            }
        });
        let orcid = table.text("orcid").and_then(|f| orcid(&table, &f));
        let ror = table.text("ror").and_then(|f| address(&table, "ror", f));
        let (affiliation, role) = (table.text("affiliation").map(|f| f.value), table.text("role").map(|f| f.value));
        table.finish();
        Some(Agent { name: name?, kind, orcid, ror, affiliation, role })
    };
    t.tables(key).into_iter().filter_map(agent).collect()
}

fn place(t: Table<'_, '_>) -> Place {
    let name = t.text("name").map(|f| f.value);
    let country = t.text("country").and_then(|f| {
        let is_code = f.value.len() == 2 && f.value.bytes().all(|b| b.is_ascii_alphabetic());
        if !is_code {
            t.wrong(
                "country",
                f.at,
                "expected two letters of ISO 3166-1, for example TZ; write the name in place.name",
            );
        }
        is_code.then(|| f.value.to_uppercase())
    });
    let degrees = |key: &'static str, max: f64| {
        let f = t.number(key)?;
        let is_right = f.value.abs() <= max;
        if !is_right {
            t.wrong(key, f.at, format!("expected degrees from -{max} to {max}"));
        }
        is_right.then_some(f.value)
    };
    let (latitude, longitude) = (degrees("latitude", 90.0), degrees("longitude", 180.0));
    for (here, key, other) in [(latitude, "longitude", longitude), (longitude, "latitude", latitude)] {
        if here.is_some() && other.is_none() {
            t.missing(key, "give both latitude and longitude, or neither");
        }
    }
    let uri = t.text("uri").and_then(|f| address(&t, "uri", f));
    t.finish();
    Place { name, country, latitude, longitude, uri }
}

fn heritage(t: Table<'_, '_>) -> Heritage {
    let heritage = Heritage {
        kind: t.text("kind").map(|f| f.value),
        date: t.text("date").map(|f| f.value),
        period: t.text("period").map(|f| f.value),
        materials: t.texts("materials"),
        identifiers: t.texts("identifiers"),
        uri: t.text("uri").and_then(|f| address(&t, "uri", f)),
    };
    t.finish();
    heritage
}

fn capture(t: Table<'_, '_>) -> Capture {
    let step = |table: Table<'_, '_>| {
        let what = table.text("what").map(|f| f.value);
        if what.is_none() {
            table.missing("what", "say what was done in this step");
        }
        let (tool, by) = (table.text("tool").map(|f| f.value), table.text("by").map(|f| f.value));
        let date = checked(&table, "date", is_date_or_span, DATES);
        table.finish();
        Some(CaptureStep { what: what?, tool, by, date })
    };
    let accuracy = t.number("accuracy").and_then(|f| {
        let is_right = f.value > 0.0 && f.value <= 1000.0;
        if !is_right {
            t.wrong("accuracy", f.at, "expected metres, more than 0, for example 0.003");
        }
        is_right.then_some(f.value)
    });
    let capture = Capture {
        date: checked(&t, "date", is_date_or_span, DATES),
        method: t.text("method").map(|f| f.value),
        instruments: t.texts("instruments"),
        software: t.texts("software"),
        accuracy,
        description: t.paragraphs("description"),
        steps: t.tables("steps").into_iter().filter_map(step).collect(),
    };
    t.finish();
    capture
}

fn access(t: Table<'_, '_>) -> Option<AccessField> {
    const STATES: &str = "\"public\", \"embargo\" or \"restricted\"";
    let given = t.text("state");
    if given.is_none() {
        t.missing("state", &format!("write {STATES}"));
    }
    let state = given.and_then(|f| match f.value.as_str() {
        "public" => Some(AccessState::Public),
        "embargo" => Some(AccessState::Embargo),
        "restricted" => Some(AccessState::Restricted),
        "withdrawn" => {
            t.wrong(
                "state",
                f.at,
                "withdraw a model with `kilwa publish --withdraw NAME --to DIR --keep FOLDER --reason …`",
            );
            None
        }
        other => {
            t.wrong("state", f.at, format!("\"{other}\" is none of {STATES}"));
            None
        }
    });
    let until = checked(&t, "until", is_day, "expected the first public day, for example 2027-06-01");
    match (state, &until) {
        (Some(AccessState::Embargo), None) => {
            t.missing("until", "an embargo needs the first public day, for example until = \"2027-06-01\"");
        }
        (Some(AccessState::Public | AccessState::Restricted), Some(_)) => {
            t.missing("until", "only an embargo has an end; write state = \"embargo\" or remove this line");
        }
        _ => {}
    }
    let (reason, contact) = (t.paragraphs("reason"), t.text("contact").map(|f| f.value));
    t.finish();
    Some(AccessField { state: state?, until, reason, contact })
}

fn related(t: &Table<'_, '_>) -> Vec<Related> {
    let one = |table: Table<'_, '_>| {
        let relation = match table.text("relation") {
            Some(f) => {
                let known = RELATIONS.iter().find(|r| r.eq_ignore_ascii_case(&f.value));
                if known.is_none() {
                    let near = nearest(&f.value, RELATIONS.into_iter());
                    let near = near.map_or_else(
                        || "IsDescribedBy, IsDerivedFrom, IsPartOf, IsDocumentedBy are some".to_owned(),
                        |n| format!("did you mean {n}?"),
                    );
                    table.wrong("relation", f.at, format!("\"{}\" is not a DataCite relation; {near}", f.value));
                }
                known.map(|r| (*r).to_owned())
            }
            None => Some("References".to_owned()),
        };
        let uri = table.text("uri");
        if uri.is_none() {
            table.missing("uri", "the address of the related item is missing");
        }
        let uri = uri.and_then(|f| identifier(&table, "uri", &f));
        let title = table.text("title").map(|f| f.value);
        table.finish();
        Some(Related { relation: relation?, uri: uri?, title })
    };
    t.tables("related").into_iter().filter_map(one).collect()
}

fn funding(t: &Table<'_, '_>) -> Vec<Funding> {
    let one = |table: Table<'_, '_>| {
        let funder = table.text("funder").map(|f| f.value);
        if funder.is_none() {
            table.missing("funder", "the name of the funder is missing");
        }
        let (award, uri) =
            (table.text("award").map(|f| f.value), table.text("uri").and_then(|f| address(&table, "uri", f)));
        table.finish();
        Some(Funding { funder: funder?, award, uri })
    };
    t.tables("funding").into_iter().filter_map(one).collect()
}

const DATES: &str = "expected a year, month or day, or a span of two: 2009, 2009-07, 2009-07-20/2009-08-03";

fn checked(t: &Table<'_, '_>, key: &'static str, is_right: fn(&str) -> bool, wanted: &str) -> Option<String> {
    let f = t.text(key)?;
    let right = is_right(&f.value);
    if !right {
        let meant = iso(&f.value).map_or_else(String::new, |meant| format!("; {meant}"));
        t.wrong(key, f.at, format!("\"{}\": {wanted}{meant}", f.value));
    }
    right.then_some(f.value)
}

fn language(t: &Table<'_, '_>, f: Found<String>) -> Option<String> {
    let mut parts = f.value.split('-');
    let is_first =
        parts.next().is_some_and(|p| (2..=3).contains(&p.len()) && p.bytes().all(|b| b.is_ascii_alphabetic()));
    let is_right =
        is_first && parts.all(|p| (1..=8).contains(&p.len()) && p.bytes().all(|b| b.is_ascii_alphanumeric()));
    if !is_right {
        t.wrong("language", f.at, "expected a code such as en, fr, sw or pt-BR");
    }
    is_right.then_some(f.value)
}

/// An address of the web.
fn address(t: &Table<'_, '_>, key: &str, f: Found<String>) -> Option<String> {
    let right = is_address(&f.value);
    if !right {
        t.wrong(
            key,
            f.at,
            format!("\"{}\" is not an address; an address begins with https:// and has no spaces", f.value),
        );
    }
    right.then_some(f.value)
}

fn is_address(text: &str) -> bool {
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let plain = |c: char| !c.is_whitespace() && !c.is_control() && !"\"<>\\^`{|}".contains(c);
    rest.is_some_and(|r| {
        r.chars().all(plain) && r.split(['/', '?', '#', ':']).next().is_some_and(|host| !host.is_empty())
    })
}

/// An address, or an identifier with a scheme of its own; DOIs as `https://doi.org/…`.
fn identifier(t: &Table<'_, '_>, key: &str, f: &Found<String>) -> Option<String> {
    let text = f.value.trim();
    let lower = text.to_lowercase();
    let doi = ["doi:", "https://doi.org/", "http://doi.org/", "http://dx.doi.org/", "https://dx.doi.org/"]
        .iter()
        .find_map(|p| lower.starts_with(p).then(|| &text[p.len()..]))
        .or_else(|| Some(text).filter(|x| x.starts_with("10.")));
    let no_spaces = text.chars().all(|c| !c.is_whitespace() && !"\"<>\\".contains(c));
    if let Some(doi) = doi.filter(|_| no_spaces) {
        let is_doi = doi.split_once('/').is_some_and(|(prefix, rest)| {
            prefix
                .strip_prefix("10.")
                .is_some_and(|p| p.len() >= 4 && p.bytes().all(|b| b.is_ascii_digit() || b == b'.'))
                && !rest.is_empty()
        });
        if is_doi {
            return Some(format!("https://doi.org/{doi}"));
        }
    } else if no_spaces
        && (is_address(text) || ["ark:", "urn:", "hdl:"].iter().any(|p| lower.starts_with(p) && text.len() > p.len()))
    {
        return Some(text.to_owned());
    }
    t.wrong(
        key,
        f.at,
        format!(
            "\"{text}\" is not an identifier; write a DOI (doi:10.1234/abc), ARK, URN, handle (hdl:) or an address"
        ),
    );
    None
}

/// An ORCID, as address, its check digit (ISO 7064) right.
fn orcid(t: &Table<'_, '_>, f: &Found<String>) -> Option<String> {
    let text = f.value.to_uppercase();
    let id = text.rsplit('/').next().unwrap_or_default();
    let digits: Vec<u32> =
        id.chars().filter(|c| *c != '-').filter_map(|c| if c == 'X' { Some(10) } else { c.to_digit(10) }).collect();
    let has_form =
        id.len() == 19 && id.split('-').count() == 4 && id.split('-').all(|p| p.len() == 4) && digits.len() == 16;
    let sum = digits.iter().take(15).fold(0, |sum, d| (sum + d) * 2 % 11);
    if has_form && digits.last() == Some(&((12 - sum) % 11)) {
        return Some(format!("https://orcid.org/{id}"));
    }
    t.wrong(
        "orcid",
        f.at,
        format!(
            "\"{}\" is not an ORCID (the check digit does not match); an ORCID looks like 0000-0002-1825-0097",
            f.value
        ),
    );
    None
}

#[cfg(test)]
#[path = "fields_tests.rs"]
mod tests;
