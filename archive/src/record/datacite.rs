//! `metadata/datacite.json`: the DataCite Metadata Schema 4 (kernel-4), in the form of its JSON schema and REST interface.
//!
//! Fields that DataCite requires and that have no value get its codes for unknown values: `:unkn` for creators, `:unav` for a publisher.

use super::Publication;
use crate::metadata::{Agent, AgentKind, Related};
use serde_json::{Map, Value, json};

/// Values of `contributorType`.
pub const CONTRIBUTORS: [&str; 22] = [
    "ContactPerson",
    "DataCollector",
    "DataCurator",
    "DataManager",
    "Distributor",
    "Editor",
    "HostingInstitution",
    "Producer",
    "ProjectLeader",
    "ProjectManager",
    "ProjectMember",
    "RegistrationAgency",
    "RegistrationAuthority",
    "RelatedPerson",
    "Researcher",
    "ResearchGroup",
    "RightsHolder",
    "Sponsor",
    "Supervisor",
    "WorkPackageLeader",
    "Translator",
    "Other",
];

pub(super) fn datacite(p: &Publication) -> Value {
    let m = &p.metadata;
    let mut creators: Vec<Value> = m.creators.iter().map(agent).collect();
    if creators.is_empty() {
        creators.push(json!({ "name": ":unkn" }));
    }
    let mut v = json!({
        "schemaVersion": "http://datacite.org/schema/kernel-4",
        "types": { "resourceTypeGeneral": "Dataset", "resourceType": "3D model" },
        "titles": titles(p),
        "creators": creators,
        "publisher": { "name": m.publisher.as_deref().unwrap_or(":unav") },
        "publicationYear": p.year(),
        "dates": dates(p),
        "language": m.language,
        "version": p.version.to_string(),
        "sizes": [format!("{} bytes", p.pack.bytes), p.figures.counted()],
        "formats": ["application/octet-stream"],
        "rightsList": [rights(p)],
        "alternateIdentifiers": [{ "alternateIdentifier": format!("urn:kilwa:{}", p.pack.identity), "alternateIdentifierType": "Kilwa pack" }],
    });
    let Some(map) = v.as_object_mut() else { return v };
    if let Some(doi) = m.identifier.as_deref().and_then(|i| i.strip_prefix("https://doi.org/")) {
        map.insert("doi".into(), doi.into());
    }
    if let Some(url) = p.url() {
        map.insert("url".into(), url.into());
    }
    list(map, "subjects", m.subjects.iter().map(|s| json!({ "subject": s })));
    list(map, "contributors", m.contributors.iter().map(contributor));
    let texts = [(&m.description, "Abstract"), (&m.capture.as_ref().and_then(|c| c.description.clone()), "Methods")]
        .map(|(text, kind)| {
            text.as_ref().map(|t| json!({ "description": t, "descriptionType": kind, "lang": m.language }))
        });
    list(map, "descriptions", texts.into_iter().flatten());
    list(map, "relatedIdentifiers", m.related.iter().filter_map(related));
    list(map, "geoLocations", geo(p).into_iter());
    list(
        map,
        "fundingReferences",
        m.funding.iter().map(|f| {
            let mut one = json!({ "funderName": f.funder });
            for (key, value) in [("awardNumber", &f.award), ("awardUri", &f.uri)] {
                if let Some(value) = value {
                    one[key] = json!(value);
                }
            }
            one
        }),
    );
    v
}

fn list(map: &mut Map<String, Value>, key: &str, values: impl Iterator<Item = Value>) {
    let values: Vec<Value> = values.collect();
    if !values.is_empty() {
        map.insert(key.into(), values.into());
    }
}

fn titles(p: &Publication) -> Vec<Value> {
    let main = json!({ "title": p.metadata.title, "lang": p.metadata.language });
    let other = p.metadata.alternative_titles.iter().map(|t| json!({ "title": t, "titleType": "AlternativeTitle" }));
    std::iter::once(main).chain(other).collect()
}

fn dates(p: &Publication) -> Vec<Value> {
    let mut dates = vec![json!({ "date": p.first_published, "dateType": "Issued" })];
    if p.version > 1 {
        dates.push(json!({ "date": p.published, "dateType": "Updated" }));
    }
    if let Some(date) = p.metadata.capture.as_ref().and_then(|c| c.date.as_ref()) {
        dates.push(json!({ "date": date, "dateType": "Collected" }));
    }
    dates
}

fn rights(p: &Publication) -> Value {
    let mut one = json!({ "rights": p.rights.label, "rightsUri": p.rights.uri });
    if let Some(spdx) = &p.rights.spdx {
        one["rightsIdentifier"] = json!(spdx);
        one["rightsIdentifierScheme"] = json!("SPDX");
        one["schemeUri"] = json!("https://spdx.org/licenses/");
    }
    one
}

fn agent(a: &Agent) -> Value {
    let kind = if a.kind == AgentKind::Person { "Personal" } else { "Organizational" };
    let mut one = json!({ "name": a.name, "nameType": kind });
    if let Some((family, given)) = a.parts() {
        one["familyName"] = json!(family);
        one["givenName"] = json!(given);
    }
    let ids = [(&a.orcid, "ORCID", "https://orcid.org"), (&a.ror, "ROR", "https://ror.org")];
    let ids: Vec<Value> = ids
        .iter()
        .filter_map(|(id, scheme, uri)| {
            id.as_ref().map(|id| json!({ "nameIdentifier": id, "nameIdentifierScheme": scheme, "schemeUri": uri }))
        })
        .collect();
    if !ids.is_empty() {
        one["nameIdentifiers"] = json!(ids);
    }
    if let Some(affiliation) = &a.affiliation {
        one["affiliation"] = json!([{ "name": affiliation }]);
    }
    one
}

fn contributor(a: &Agent) -> Value {
    let asked = a.role.as_deref().unwrap_or_default();
    let plain: String = asked.chars().filter(char::is_ascii_alphanumeric).collect();
    let kind = CONTRIBUTORS.iter().find(|k| k.eq_ignore_ascii_case(&plain)).unwrap_or(&"Other");
    let mut one = agent(a);
    one["contributorType"] = json!(kind);
    one
}

fn related(r: &Related) -> Option<Value> {
    let (kind, id) = if let Some(doi) = r.uri.strip_prefix("https://doi.org/") {
        ("DOI", doi)
    } else if r.uri.starts_with("http") {
        ("URL", r.uri.as_str())
    } else {
        let kind = match r.uri.split_once(':')?.0.to_ascii_lowercase().as_str() {
            "ark" => "ARK",
            "urn" => "URN",
            "hdl" => "Handle",
            _ => return None,
        };
        (kind, r.uri.as_str())
    };
    Some(json!({ "relatedIdentifier": id, "relatedIdentifierType": kind, "relationType": r.relation }))
}

fn geo(p: &Publication) -> Option<Value> {
    let mut one = Map::new();
    if let Some(place) = p.place() {
        one.insert("geoLocationPlace".into(), place.into());
    }
    if let Some([latitude, longitude]) = super::schema_org::point(&p.metadata) {
        one.insert("geoLocationPoint".into(), json!({ "pointLatitude": latitude, "pointLongitude": longitude }));
    }
    (!one.is_empty()).then_some(Value::Object(one))
}
