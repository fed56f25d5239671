//! `/oai`: the Open Archives Initiative Protocol for Metadata Harvesting, version 2.0, with the format `oai_dc`.
//!
//! Records are the `metadata/dc.xml` that publishing wrote; an item's identifier is `oai:HOST:SLUG`, its datestamp the day of its current
//! version; what was withdrawn is a deleted record. Sets are the collections. Lists have pages of 100, fewer where records are long; a resumption token is the state itself (no state is kept
//! here), so it lasts. Errors of the protocol are answered 200 with their code, as it wants.

use super::collections::Collection;
use super::pairs;
use crate::index::Entry;
use kilwa_archive::AccessState;
use kilwa_archive::date::is_day;
use kilwa_archive::record::xml::{Xml, without_declaration};
use std::collections::BTreeMap;

/// Records of one page.
pub(crate) const PAGE: u32 = 100;
/// A page ends behind the record with which it is longer than this, bytes.
const PAGE_BYTES: usize = 128 * 1024;
/// Longest `dc.xml` that is passed on, bytes; an object with a longer one gets a minimal record.
pub(crate) const RECORD_MAX: u64 = 128 * 1024;

/// What the protocol asks of the archive.
pub(crate) trait Source {
    /// Objects by slug, after one, at most so many.
    fn after(&self, slug: &str, limit: u32) -> Result<Vec<Entry>, String>;
    /// One object.
    fn entry(&self, slug: &str) -> Result<Option<Entry>, String>;
    /// Its `dc.xml`, while it is public at all.
    fn dublin_core(&self, slug: &str) -> Option<String>;
    /// Address of its page.
    fn page(&self, slug: &str) -> String;
    /// The collections, which are the sets.
    fn sets(&self) -> &[Collection];
}

/// Where and when the question was asked.
pub(crate) struct Asked<'a> {
    /// The address of this interface.
    pub(crate) url: String,
    /// Host of the site, for identifiers.
    pub(crate) host: String,
    /// Name of the institution, if known.
    pub(crate) name: Option<&'a str>,
    /// Now, `YYYY-MM-DDThh:mm:ssZ`.
    pub(crate) now: String,
    /// Whom to write to.
    pub(crate) contact: &'a str,
}

/// An error of the protocol: its code and a sentence.
type Problem = (&'static str, String);

/// Answer a query; an error is one of the archive, not of the protocol.
pub(crate) fn answer(source: &dyn Source, asked: &Asked<'_>, query: &str) -> Result<String, String> {
    let mut arguments = BTreeMap::new();
    let mut repeated = false;
    for (name, value) in pairs(query) {
        repeated |= arguments.insert(name, value).is_some();
    }
    let get = |name: &str| arguments.get(name).map(String::as_str);
    let verb = get("verb").unwrap_or_default();
    let allowed: &[&str] = match verb {
        "Identify" => &[],
        "ListMetadataFormats" => &["identifier"],
        "ListSets" => &["resumptionToken"],
        "GetRecord" => &["identifier", "metadataPrefix"],
        "ListIdentifiers" | "ListRecords" => &["from", "until", "set", "metadataPrefix", "resumptionToken"],
        _ => {
            return Ok(failed(
                asked,
                &arguments,
                &("badVerb", "the verb is missing, or none of OAI-PMH 2.0".to_owned()),
            ));
        }
    };
    let unknown = arguments.keys().find(|name| *name != "verb" && !allowed.contains(&name.as_str()));
    if repeated || unknown.is_some() {
        let why = unknown
            .map_or_else(|| "an argument is repeated".to_owned(), |name| format!("{verb} has no argument {name}"));
        return Ok(failed(asked, &arguments, &("badArgument", why)));
    }
    let body = match verb {
        "Identify" => Ok(identify(source, asked)?),
        "ListMetadataFormats" => formats(source, asked, get("identifier"))?,
        "ListSets" => sets(source, get("resumptionToken")),
        "GetRecord" => one(source, asked, get("identifier"), get("metadataPrefix"))?,
        _ => list(source, asked, &arguments, verb == "ListRecords")?,
    };
    Ok(match body {
        Ok(body) => envelope(asked, &arguments, |x| {
            x.begin(verb, &[]);
            x.insert(body.finish().trim_end());
            x.end();
        }),
        Err(problem) => failed(asked, &arguments, &problem),
    })
}

fn envelope(asked: &Asked<'_>, arguments: &BTreeMap<String, String>, body: impl FnOnce(&mut Xml)) -> String {
    let mut x = Xml::flat();
    x.declare();
    let schema = "http://www.openarchives.org/OAI/2.0/ http://www.openarchives.org/OAI/2.0/OAI-PMH.xsd";
    x.begin(
        "OAI-PMH",
        &[
            ("xmlns", "http://www.openarchives.org/OAI/2.0/"),
            ("xmlns:xsi", "http://www.w3.org/2001/XMLSchema-instance"),
            ("xsi:schemaLocation", schema),
        ],
    );
    x.text("responseDate", &[], &asked.now);
    let attributes: Vec<(&str, &str)> = arguments.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
    x.text("request", &attributes, &asked.url);
    body(&mut x);
    x.finish()
}

fn failed(asked: &Asked<'_>, arguments: &BTreeMap<String, String>, (code, why): &Problem) -> String {
    // With these two errors the request is given without its arguments.
    let none = BTreeMap::new();
    let arguments = if matches!(*code, "badVerb" | "badArgument") { &none } else { arguments };
    envelope(asked, arguments, |x| x.text("error", &[("code", code)], why))
}

fn identify(source: &dyn Source, asked: &Asked<'_>) -> Result<Xml, String> {
    // The first of all datestamps; walking all is cheap beside being asked once in a while.
    let (mut earliest, mut slug) = (String::from("9999-12-31"), String::new());
    loop {
        let page = source.after(&slug, PAGE)?;
        let Some(last) = page.last() else { break };
        slug.clone_from(&last.slug);
        for entry in &page {
            earliest = earliest.min(entry.published[0].clone());
        }
    }
    if earliest == "9999-12-31" {
        earliest = asked.now.chars().take(10).collect();
    }
    let mut x = Xml::flat();
    let name = asked.name.map_or_else(|| format!("Kilwa at {}", asked.host), str::to_owned);
    x.text("repositoryName", &[], &name);
    x.text("baseURL", &[], &asked.url);
    x.text("protocolVersion", &[], "2.0");
    x.text("adminEmail", &[], asked.contact);
    x.text("earliestDatestamp", &[], &earliest);
    x.text("deletedRecord", &[], "persistent");
    x.text("granularity", &[], "YYYY-MM-DD");
    Ok(x)
}

fn sets(source: &dyn Source, token: Option<&str>) -> Result<Xml, Problem> {
    let all = source.sets();
    // The token is the last set of the page before.
    let first = match token {
        None => 0,
        Some(last) => {
            let at = all.iter().position(|set| set.slug == last);
            at.ok_or(("badResumptionToken", "unknown resumption token".to_owned()))? + 1
        }
    };
    if all.is_empty() {
        return Err(("noSetHierarchy", "this archive has no sets".to_owned()));
    }
    let page = all.get(first..).unwrap_or_default();
    let mut x = Xml::flat();
    for set in page.iter().take(PAGE as usize) {
        x.begin("set", &[]);
        x.text("setSpec", &[], &set.slug);
        x.text("setName", &[], &set.title);
        x.end();
    }
    match page.get(PAGE as usize - 1).filter(|_| page.len() > PAGE as usize) {
        Some(last) => x.text("resumptionToken", &[], &last.slug),
        None if token.is_some() => x.empty("resumptionToken", &[]),
        None => {}
    }
    Ok(x)
}

fn slug_of<'i>(asked: &Asked<'_>, identifier: &'i str) -> Option<&'i str> {
    identifier.strip_prefix("oai:")?.strip_prefix(asked.host.as_str())?.strip_prefix(':')
}

fn found(source: &dyn Source, asked: &Asked<'_>, identifier: &str) -> Result<Result<Entry, Problem>, String> {
    let entry = match slug_of(asked, identifier) {
        Some(slug) => source.entry(slug)?,
        None => None,
    };
    Ok(entry.ok_or_else(|| ("idDoesNotExist", format!("there is no item {identifier} in this archive"))))
}

fn formats(source: &dyn Source, asked: &Asked<'_>, identifier: Option<&str>) -> Result<Result<Xml, Problem>, String> {
    if let Some(identifier) = identifier
        && let Err(problem) = found(source, asked, identifier)?
    {
        return Ok(Err(problem));
    }
    let mut x = Xml::flat();
    x.begin("metadataFormat", &[]);
    x.text("metadataPrefix", &[], "oai_dc");
    x.text("schema", &[], "http://www.openarchives.org/OAI/2.0/oai_dc.xsd");
    x.text("metadataNamespace", &[], "http://www.openarchives.org/OAI/2.0/oai_dc/");
    x.end();
    Ok(Ok(x))
}

fn is_known_format(prefix: Option<&str>) -> Result<(), Problem> {
    match prefix {
        Some("oai_dc") => Ok(()),
        Some(other) => Err(("cannotDisseminateFormat", format!("records are in oai_dc, not in {other}"))),
        None => Err(("badArgument", "metadataPrefix is missing".to_owned())),
    }
}

fn one(
    source: &dyn Source,
    asked: &Asked<'_>,
    identifier: Option<&str>,
    prefix: Option<&str>,
) -> Result<Result<Xml, Problem>, String> {
    let Some(identifier) = identifier else { return Ok(Err(("badArgument", "identifier is missing".to_owned()))) };
    if let Err(problem) = is_known_format(prefix) {
        return Ok(Err(problem));
    }
    Ok(found(source, asked, identifier)?.map(|entry| {
        let mut x = Xml::flat();
        record(&mut x, source, asked, &entry);
        x
    }))
}

fn header(x: &mut Xml, source: &dyn Source, asked: &Asked<'_>, entry: &Entry) {
    let is_deleted = entry.access.state == AccessState::Withdrawn;
    x.begin("header", if is_deleted { &[("status", "deleted")] } else { &[] });
    x.text("identifier", &[], &format!("oai:{}:{}", asked.host, entry.slug));
    x.text("datestamp", &[], stamp(entry));
    for set in source.sets().iter().filter(|set| set.members.contains(&entry.slug)) {
        x.text("setSpec", &[], &set.slug);
    }
    x.end();
}

/// The day it last changed: of its withdrawal, or of its current version.
fn stamp(entry: &Entry) -> &str {
    entry.access.withdrawn.as_deref().unwrap_or(&entry.published[1])
}

fn record(x: &mut Xml, source: &dyn Source, asked: &Asked<'_>, entry: &Entry) {
    x.begin("record", &[]);
    header(x, source, asked, entry);
    if entry.access.state != AccessState::Withdrawn {
        let dc = source.dublin_core(&entry.slug).unwrap_or_else(|| minimal_record(source, entry));
        x.begin("metadata", &[]);
        // The declaration comes once, at the beginning of the answer.
        x.insert(without_declaration(dc.trim_start_matches('\u{feff}')).trim());
        x.end();
    }
    x.end();
}

/// A record from what the index knows, for an object whose own cannot be read.
fn minimal_record(source: &dyn Source, entry: &Entry) -> String {
    let mut x = Xml::flat();
    let namespaces = [
        ("xmlns:oai_dc", "http://www.openarchives.org/OAI/2.0/oai_dc/"),
        ("xmlns:dc", "http://purl.org/dc/elements/1.1/"),
    ];
    x.begin("oai_dc:dc", &namespaces);
    x.text("dc:title", &[], &entry.title);
    x.text("dc:identifier", &[], &source.page(&entry.slug));
    x.text("dc:rights", &[], &entry.rights.uri);
    x.finish()
}

/// What a list is of, also as its resumption token: `from,until,set,slug`.
struct Selection {
    from: String,
    until: String,
    /// Slug of a collection, empty for all.
    set: String,
    after: String,
}

impl Selection {
    fn of(arguments: &BTreeMap<String, String>, sets: &[Collection]) -> Result<Self, Problem> {
        let get = |name: &str| arguments.get(name).map(String::as_str);
        if let Some(token) = get("resumptionToken") {
            let parts: Vec<&str> = token.split(',').collect();
            return match parts[..] {
                [from, until, set, after]
                    if arguments.len() == 2
                        && [from, until].iter().all(|d| d.is_empty() || is_day(d))
                        && (set.is_empty() || sets.iter().any(|s| s.slug == set)) =>
                {
                    let [from, until, set, after] = [from, until, set, after].map(str::to_owned);
                    Ok(Self { from, until, set, after })
                }
                _ => Err(("badResumptionToken", "unknown resumption token".to_owned())),
            };
        }
        is_known_format(get("metadataPrefix"))?;
        let set = get("set").unwrap_or_default().to_owned();
        if !set.is_empty() && sets.is_empty() {
            return Err(("noSetHierarchy", "this archive has no sets".to_owned()));
        }
        if !set.is_empty() && !sets.iter().any(|s| s.slug == set) {
            return Err(("noRecordsMatch", format!("there is no set {set}; ListSets lists all sets")));
        }
        let day = |name: &str| match get(name) {
            None => Ok(String::new()),
            Some(day) if is_day(day) => Ok(day.to_owned()),
            Some(other) => Err(("badArgument", format!("{name} must be a date such as 2026-11-21, not {other}"))),
        };
        let (from, until) = (day("from")?, day("until")?);
        if !from.is_empty() && !until.is_empty() && from > until {
            return Err(("badArgument", "from is after until".to_owned()));
        }
        Ok(Self { from, until, set, after: String::new() })
    }

    fn has(&self, entry: &Entry, sets: &[Collection]) -> bool {
        let day = stamp(entry);
        if !self.set.is_empty() && !sets.iter().any(|s| s.slug == self.set && s.members.contains(&entry.slug)) {
            return false;
        }
        (self.from.is_empty() || *self.from <= *day) && (self.until.is_empty() || *day <= *self.until)
    }
}

fn list(
    source: &dyn Source,
    asked: &Asked<'_>,
    arguments: &BTreeMap<String, String>,
    whole: bool,
) -> Result<Result<Xml, Problem>, String> {
    let selection = match Selection::of(arguments, source.sets()) {
        Ok(selection) => selection,
        Err(problem) => return Ok(Err(problem)),
    };
    let (mut entries, mut after) = (Vec::new(), selection.after.clone());
    // One more than a page, to know whether there is another.
    while entries.len() <= PAGE as usize {
        let page = source.after(&after, PAGE)?;
        let Some(last) = page.last() else { break };
        after.clone_from(&last.slug);
        entries.extend(page.into_iter().filter(|entry| selection.has(entry, source.sets())));
    }
    if entries.is_empty() {
        return Ok(Err(("noRecordsMatch", "there are no records from these dates".to_owned())));
    }
    let mut x = Xml::flat();
    let mut last = "";
    let mut count = 0;
    for entry in entries.iter().take(PAGE as usize) {
        if whole {
            record(&mut x, source, asked, entry);
        } else {
            header(&mut x, source, asked, entry);
        }
        (last, count) = (entry.slug.as_str(), count + 1);
        if x.written() > PAGE_BYTES {
            break;
        }
    }
    if entries.len() > count {
        let Selection { from, until, set, .. } = &selection;
        x.text("resumptionToken", &[], &format!("{from},{until},{set},{last}"));
    } else if !selection.after.is_empty() {
        x.empty("resumptionToken", &[]);
    }
    Ok(Ok(x))
}
