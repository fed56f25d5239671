//! Statements of rights that machines understand: RightsStatements.org, Creative Commons licences and its two public domain tools.
//!
//! [`Rights::parse`] takes an address in any of the spellings that are about (http or https, with or without the last slash, `/deed.fr`,
//! `/legalcode`) or a short name (`CC BY 4.0`, `InC`) and gives the canonical address; what is in no list is refused with the nearest name.

use kilwa_toml::nearest;
use std::fmt;

/// A known statement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rights {
    /// Canonical address.
    pub uri: String,
    /// Name for people, in English.
    pub label: String,
    /// Short name, for example `CC BY 4.0`.
    pub short: String,
    /// Identifier of the SPDX list, where there is one.
    pub spdx: Option<String>,
}

/// The twelve statements of RightsStatements.org, version 1.0: code and name.
const STATEMENTS: [(&str, &str); 12] = [
    ("InC", "In Copyright"),
    ("InC-OW-EU", "In Copyright - EU Orphan Work"),
    ("InC-EDU", "In Copyright - Educational Use Permitted"),
    ("InC-NC", "In Copyright - Non-Commercial Use Permitted"),
    ("InC-RUU", "In Copyright - Rights-holder(s) Unlocatable or Unidentifiable"),
    ("NoC-CR", "No Copyright - Contractual Restrictions"),
    ("NoC-NC", "No Copyright - Non-Commercial Use Only"),
    ("NoC-OKLR", "No Copyright - Other Known Legal Restrictions"),
    ("NoC-US", "No Copyright - United States"),
    ("CNE", "Copyright Not Evaluated"),
    ("UND", "Copyright Undetermined"),
    ("NKC", "No Known Copyright"),
];
/// Creative Commons licences: code and name.
const LICENCES: [(&str, &str); 6] = [
    ("by", "Attribution"),
    ("by-sa", "Attribution-ShareAlike"),
    ("by-nc", "Attribution-NonCommercial"),
    ("by-nc-sa", "Attribution-NonCommercial-ShareAlike"),
    ("by-nd", "Attribution-NoDerivatives"),
    ("by-nc-nd", "Attribution-NonCommercial-NoDerivatives"),
];
const VERSIONS: [&str; 5] = ["4.0", "3.0", "2.5", "2.0", "1.0"];
/// Last version that was adapted to jurisdictions (`/by/3.0/de/`).
const PORTED: [&str; 4] = ["3.0", "2.5", "2.0", "1.0"];

/// The values that can be given, for messages.
pub const CHOICES: &str = "\"CC BY 4.0\", \"CC BY-SA 4.0\", \"CC BY-NC 4.0\", \"CC0\" or \"Public Domain Mark\" (creativecommons.org), \
    \"InC\", \"NoC-US\", \"UND\" … (rightsstatements.org), or the address of one of them";

impl Rights {
    /// The statement that an address or short name represents.
    ///
    /// # Errors
    /// A sentence that says what is wanted, with the nearest known name.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let lower = text.to_lowercase();
        let address = lower.strip_prefix("https://").or_else(|| lower.strip_prefix("http://"));
        let found = match address.map(|a| a.strip_prefix("www.").unwrap_or(a)) {
            Some(address) => of_address(address),
            None => of_name(&lower),
        };
        found.ok_or_else(|| {
            let known = Self::all();
            let near = match address {
                Some(_) => nearest(&lower.replacen("http://", "https://", 1), known.iter().map(|r| r.uri.as_str())),
                None => nearest(text, known.iter().map(|r| r.short.as_str())),
            };
            let near = near.map(|n| format!(" did you mean {n}?")).unwrap_or_default();
            format!("\"{text}\" is not a known licence or rights statement;{near} write {CHOICES}")
        })
    }

    /// Every statement, without adaptations to jurisdictions.
    pub fn all() -> Vec<Self> {
        let licences = LICENCES.iter().flat_map(|(code, _)| VERSIONS.iter().filter_map(|v| licence(code, v, None)));
        let statements = STATEMENTS.iter().filter_map(|(code, _)| statement(&code.to_lowercase()));
        licences.chain([zero(), mark()]).chain(statements).collect()
    }

    /// Whether it is a licence or a public domain tool of Creative Commons.
    pub fn is_creative_commons(&self) -> bool {
        self.uri.starts_with("https://creativecommons.org/")
    }
}

impl fmt::Display for Rights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.uri)
    }
}

fn of_address(address: &str) -> Option<Rights> {
    let address = address.split(['?', '#']).next()?.trim_end_matches('/');
    let mut parts = address.split('/');
    let (host, kind) = (parts.next()?, parts.next()?);
    let rest: Vec<&str> = parts.collect();
    let is_deed = |part: &str| {
        part == "deed" || part == "legalcode" || part.starts_with("deed.") || part.starts_with("legalcode.")
    };
    match (host, kind, rest.as_slice()) {
        ("creativecommons.org", "licenses", [code, version]) => licence(code, version, None),
        ("creativecommons.org", "licenses", [code, version, deed]) if is_deed(deed) => licence(code, version, None),
        ("creativecommons.org", "licenses", [code, version, place] | [code, version, place, _]) => {
            licence(code, version, Some(place))
        }
        ("creativecommons.org", "publicdomain", ["zero", "1.0", ..]) => Some(zero()),
        ("creativecommons.org", "publicdomain", ["mark", "1.0", ..]) => Some(mark()),
        ("rightsstatements.org", "vocab" | "page", [code, "1.0", ..]) => statement(code),
        _ => None,
    }
}

fn of_name(name: &str) -> Option<Rights> {
    let words = name.replace([' ', '_', '/'], "-");
    match words.as_str() {
        "cc0" | "cc0-1.0" | "cc-zero" => return Some(zero()),
        "pdm" | "public-domain" | "public-domain-mark" | "public-domain-mark-1.0" | "cc-pdm-1.0" | "cc-pdm" => {
            return Some(mark());
        }
        _ => {}
    }
    if let Some(rest) = words.strip_prefix("cc-") {
        let (code, version) = rest.rsplit_once('-')?;
        return licence(code, version, None);
    }
    statement(&words).or_else(|| {
        STATEMENTS
            .iter()
            .find(|(_, label)| label.to_lowercase() == name)
            .and_then(|(c, _)| statement(&c.to_lowercase()))
    })
}

fn licence(code: &str, version: &str, place: Option<&str>) -> Option<Rights> {
    let (code, name) = LICENCES.iter().find(|(c, _)| *c == code)?;
    let version = VERSIONS.iter().find(|v| **v == version)?;
    let upper = code.to_uppercase();
    let Some(place) = place else {
        return Some(Rights {
            uri: format!("https://creativecommons.org/licenses/{code}/{version}/"),
            label: format!("Creative Commons {name} {version}"),
            short: format!("CC {upper} {version}"),
            spdx: Some(format!("CC-{upper}-{version}")),
        });
    };
    let is_place =
        (2..=3).contains(&place.len()) && place.bytes().all(|b| b.is_ascii_lowercase()) || place == "scotland";
    (is_place && PORTED.contains(version)).then(|| Rights {
        uri: format!("https://creativecommons.org/licenses/{code}/{version}/{place}/"),
        label: format!("Creative Commons {name} {version} ({})", place.to_uppercase()),
        short: format!("CC {upper} {version} {}", place.to_uppercase()),
        spdx: None,
    })
}

fn zero() -> Rights {
    Rights {
        uri: "https://creativecommons.org/publicdomain/zero/1.0/".to_owned(),
        label: "CC0 1.0 Universal (Public Domain Dedication)".to_owned(),
        short: "CC0 1.0".to_owned(),
        spdx: Some("CC0-1.0".to_owned()),
    }
}

fn mark() -> Rights {
    Rights {
        uri: "https://creativecommons.org/publicdomain/mark/1.0/".to_owned(),
        label: "Public Domain Mark 1.0".to_owned(),
        short: "Public Domain Mark 1.0".to_owned(),
        spdx: None,
    }
}

fn statement(code: &str) -> Option<Rights> {
    let (code, label) = STATEMENTS.iter().find(|(c, _)| c.eq_ignore_ascii_case(code))?;
    Some(Rights {
        // Its addresses as identifiers begin with http, by its own rule.
        uri: format!("http://rightsstatements.org/vocab/{code}/1.0/"),
        label: (*label).to_owned(),
        short: (*code).to_owned(),
        spdx: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_spelling_of_a_rights_statement_becomes_its_canonical_address() {
        for (given, uri) in [
            ("CC BY 4.0", "https://creativecommons.org/licenses/by/4.0/"),
            ("cc-by-nc-sa-4.0", "https://creativecommons.org/licenses/by-nc-sa/4.0/"),
            ("http://creativecommons.org/licenses/by/4.0", "https://creativecommons.org/licenses/by/4.0/"),
            (
                "https://www.creativecommons.org/licenses/by-sa/4.0/deed.fr",
                "https://creativecommons.org/licenses/by-sa/4.0/",
            ),
            ("https://creativecommons.org/licenses/by/4.0/legalcode", "https://creativecommons.org/licenses/by/4.0/"),
            ("https://creativecommons.org/licenses/by/3.0/de/", "https://creativecommons.org/licenses/by/3.0/de/"),
            ("CC0", "https://creativecommons.org/publicdomain/zero/1.0/"),
            (
                "https://creativecommons.org/publicdomain/mark/1.0/deed.en",
                "https://creativecommons.org/publicdomain/mark/1.0/",
            ),
            ("InC", "http://rightsstatements.org/vocab/InC/1.0/"),
            ("In Copyright", "http://rightsstatements.org/vocab/InC/1.0/"),
            (
                "https://rightsstatements.org/page/InC-EDU/1.0/?language=en",
                "http://rightsstatements.org/vocab/InC-EDU/1.0/",
            ),
        ] {
            assert_eq!(Rights::parse(given).unwrap().uri, uri, "{given}");
        }
        for known in Rights::all() {
            assert_eq!(Rights::parse(&known.uri).as_ref(), Ok(&known));
            assert_eq!(Rights::parse(&known.short).as_ref(), Ok(&known));
        }
    }

    #[test]
    fn an_unknown_rights_statement_is_refused_with_the_nearest_known_one() {
        for (given, near) in [
            ("CC BY 5.0", Some("CC BY 4.0")),
            ("CC-BY 4", Some("CC BY 4.0")),
            ("https://creativecommons.org/licenses/bye/4.0/", Some("licenses/by/4.0/")),
            ("https://creativecommons.org/licenses/by/4.0/de/", None),
            ("MIT", None),
            ("all rights reserved", None),
            ("https://example.org/licence", None),
        ] {
            let message = Rights::parse(given).unwrap_err();
            assert!(near.is_none_or(|n| message.contains(n)) && message.contains("rightsstatements.org"), "{message}");
        }
    }
}
