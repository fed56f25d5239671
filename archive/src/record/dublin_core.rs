//! `metadata/dc.xml`: the fifteen elements of Dublin Core, as OAI-PMH carries them (oai_dc).

use super::Publication;
use super::xml::Xml;

pub(super) fn dublin_core(p: &Publication) -> String {
    let m = &p.metadata;
    let mut x = Xml::new(
        "oai_dc:dc",
        &[
            ("xmlns:oai_dc", "http://www.openarchives.org/OAI/2.0/oai_dc/"),
            ("xmlns:dc", "http://purl.org/dc/elements/1.1/"),
            ("xmlns:xsi", "http://www.w3.org/2001/XMLSchema-instance"),
            (
                "xsi:schemaLocation",
                "http://www.openarchives.org/OAI/2.0/oai_dc/ http://www.openarchives.org/OAI/2.0/oai_dc.xsd",
            ),
        ],
    );
    let language = [("xml:lang", m.language.as_str())];
    x.text("dc:title", &language, &m.title);
    for title in &m.alternative_titles {
        x.text("dc:title", &[], title);
    }
    for agent in &m.creators {
        x.text("dc:creator", &[], &agent.name);
    }
    let heritage = m.object.iter().flat_map(|o| [o.kind.as_ref(), o.period.as_ref()]).flatten();
    for subject in m.subjects.iter().chain(heritage) {
        x.text("dc:subject", &language, subject);
    }
    x.maybe("dc:description", &language, m.description.as_deref());
    x.maybe("dc:publisher", &[], m.publisher.as_deref());
    for agent in &m.contributors {
        x.text("dc:contributor", &[], &agent.name);
    }
    x.text("dc:date", &[], &p.published);
    x.text("dc:type", &[], "Dataset");
    x.text("dc:type", &[], "3D model");
    x.text("dc:format", &[], "application/octet-stream");
    x.text("dc:format", &[], &p.figures.counted());
    x.text("dc:identifier", &[], &p.identifier());
    if let Some(url) = p.url().filter(|u| *u != p.identifier()) {
        x.text("dc:identifier", &[], url);
    }
    x.text("dc:identifier", &[], &format!("urn:kilwa:{}", p.pack.identity));
    for identifier in m.object.iter().flat_map(|o| &o.identifiers) {
        x.text("dc:source", &[], identifier);
    }
    x.text("dc:language", &[], &m.language);
    for related in &m.related {
        x.text("dc:relation", &[], &related.uri);
    }
    x.maybe("dc:coverage", &language, p.place().as_deref());
    if let Some([latitude, longitude]) = super::schema_org::point(m) {
        x.text("dc:coverage", &[], &format!("{latitude}, {longitude}"));
    }
    x.maybe("dc:coverage", &[], m.object.as_ref().and_then(|o| o.date.as_deref()));
    x.text("dc:rights", &[], &m.rights.uri);
    x.maybe("dc:rights", &[], m.rights.holder.as_deref());
    x.maybe("dc:rights", &language, m.rights.statement.as_deref());
    x.finish()
}
