//! How to cite it: a line for people, BibTeX, RIS.

use super::Publication;
use crate::metadata::{Agent, AgentKind};
use std::fmt::Write as _;

/// One line: makers, year, title, version, publisher, identifier (after DataCite's recommended form).
pub fn citation(p: &Publication) -> String {
    let m = &p.metadata;
    let makers = m.creators.iter().map(short_name).collect::<Vec<_>>();
    let what = format!("{} (version {}) [3D model]", m.title, p.version);
    let mut text = if makers.is_empty() {
        format!("{what} ({})", p.year())
    } else {
        format!("{} ({}): {what}", listed(&makers), p.year())
    };
    if let Some(publisher) = &m.publisher {
        let _ = write!(text, ". {publisher}");
    }
    let _ = write!(text, ". {}", p.identifier());
    text
}

/// `Rüther, H.` of `Rüther, Heinz`.
fn short_name(agent: &Agent) -> String {
    let Some((family, given)) = agent.parts() else { return agent.name.clone() };
    let initials: Vec<String> =
        given.split_whitespace().filter_map(|n| n.chars().next()).map(|c| format!("{c}.")).collect();
    format!("{family}, {}", initials.join(" "))
}

fn listed(names: &[String]) -> String {
    match names {
        [one] => one.clone(),
        [first, last] => format!("{first} and {last}"),
        [first, .., last] if names.len() <= 6 => {
            let middle = names.get(1..names.len() - 1).unwrap_or_default();
            format!("{first}; {} and {last}", middle.join("; "))
        }
        [first, ..] => format!("{first} et al."),
        [] => String::new(),
    }
}

/// BibTeX. `@misc` and `howpublished`: what the oldest styles know.
pub(super) fn bibtex(p: &Publication) -> String {
    let m = &p.metadata;
    let name = |a: &Agent| {
        // Braces keep the name of an organisation in one piece.
        if a.kind == AgentKind::Person { tex(&a.name) } else { format!("{{{}}}", tex(&a.name)) }
    };
    let mut fields = vec![("title", format!("{{{}}}", tex(&m.title)))];
    if !m.creators.is_empty() {
        fields.push(("author", m.creators.iter().map(name).collect::<Vec<_>>().join(" and ")));
    }
    fields.push(("year", p.year().to_owned()));
    fields.push(("month", p.published.get(5..7).unwrap_or_default().trim_start_matches('0').to_owned()));
    fields.extend(m.publisher.as_ref().map(|x| ("publisher", tex(x))));
    fields.push(("howpublished", "3D model".to_owned()));
    fields.push(("version", p.version.to_string()));
    if let Some(doi) = m.identifier.as_ref().and_then(|i| i.strip_prefix("https://doi.org/")) {
        fields.push(("doi", doi.to_owned()));
    }
    let address = m.url.clone().or_else(|| m.identifier.clone());
    fields.extend(address.map(|u| ("url", u)));
    fields.push(("note", format!("Kilwa pack {}", p.pack.identity)));
    let mut text = format!("@misc{{{}-{}-v{},\n", p.slug, p.year(), p.version);
    for (key, value) in fields {
        let _ = writeln!(text, "  {key} = {{{value}}},");
    }
    text.push_str("}\n");
    text
}

/// Characters that TeX takes for its own.
fn tex(text: &str) -> String {
    let mut s = String::new();
    for c in text.chars() {
        match c {
            '\\' => s.push_str("\\textbackslash{}"),
            '{' | '}' | '&' | '%' | '$' | '#' | '_' => s.extend(['\\', c]),
            '~' => s.push_str("\\textasciitilde{}"),
            '^' => s.push_str("\\textasciicircum{}"),
            '\n' => s.push(' '),
            c => s.push(c),
        }
    }
    s
}

/// RIS, for Zotero, EndNote, Mendeley.
pub(super) fn ris(p: &Publication) -> String {
    let m = &p.metadata;
    let mut s = String::new();
    let mut tag = |name: &str, value: &str| {
        let _ = write!(s, "{name}  - {}\r\n", value.replace('\n', " "));
    };
    tag("TY", "DATA");
    tag("TI", &m.title);
    for a in &m.creators {
        tag("AU", &a.name);
    }
    for a in &m.contributors {
        tag("A2", &a.name);
    }
    tag("PY", p.year());
    tag("DA", &p.published.replace('-', "/"));
    if let Some(publisher) = &m.publisher {
        tag("PB", publisher);
    }
    if let Some(doi) = m.identifier.as_ref().and_then(|i| i.strip_prefix("https://doi.org/")) {
        tag("DO", doi);
    }
    if let Some(url) = m.url.as_ref().or(m.identifier.as_ref()) {
        tag("UR", url);
    }
    tag("ET", &p.version.to_string());
    tag("LA", &m.language);
    for subject in &m.subjects {
        tag("KW", subject);
    }
    if let Some(text) = &m.description {
        tag("AB", text);
    }
    tag("M3", "3D model");
    tag("N1", &format!("Kilwa pack {}", p.pack.identity));
    tag("ER", "");
    s
}
