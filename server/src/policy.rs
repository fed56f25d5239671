//! What browsers may do with the pages: the Content-Security-Policy, who may frame them, and whose scripts may talk to an embedded viewer.
//!
//! Inputs come from the command line. Invariant: what reaches a header or the page is an origin (`https://host[:port]`) or one of the
//! few words allowed, never free text, so nothing can be injected into either.

use thiserror::Error;

/// The page sets styles from scripts (which the policy allows) and shows pictures that it made itself; workers are files of the page; wasm
/// needs `'wasm-unsafe-eval'`.
const BASE: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; \
    img-src 'self' data: blob:; object-src 'none'; base-uri 'self'; form-action 'self'";

/// A value that is not allowed in a policy.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("\"{given}\" is {what}; expected {wanted}, for example https://museum.example")]
pub struct PolicyError {
    given: String,
    what: &'static str,
    wanted: &'static str,
}

/// Who may frame the pages and talk to them, and where their packs may be.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Policy {
    ancestors: Vec<String>,
    talkers: Vec<String>,
    sources: Vec<String>,
}

impl Policy {
    /// Sites that may show the pages in a frame (when none is given, this one, and every site for what [`Policy::embed_header`] is for; `none`,
    /// `self`, `*` or origins), origins whose pages may
    /// talk to an embedded viewer (`*` for all), and other hosts that packs may come from.
    ///
    /// # Errors
    /// [`PolicyError`] names what is not an origin.
    pub fn new(ancestors: &[String], talkers: &[String], sources: &[String]) -> Result<Self, PolicyError> {
        let ancestors = ancestors.iter().map(|a| match a.trim_matches('\'') {
            "self" => Ok("'self'".to_owned()),
            "none" if ancestors.len() == 1 => Ok("'none'".to_owned()),
            "none" => Err(PolicyError {
                given: a.clone(),
                what: "given beside others",
                wanted: "either this alone, or a list of origins",
            }),
            "*" => Ok("*".to_owned()),
            other => origin(other, true),
        });
        let talkers = talkers.iter().map(|t| if t == "*" { Ok(t.clone()) } else { origin(t, false) });
        let sources = sources.iter().map(|s| origin(s, true));
        Ok(Self {
            ancestors: ancestors.collect::<Result<_, _>>()?,
            talkers: talkers.collect::<Result<_, _>>()?,
            sources: sources.collect::<Result<_, _>>()?,
        })
    }

    /// The header's value.
    pub(crate) fn header(&self) -> String {
        let ancestors = if self.ancestors.is_empty() { "'self'".to_owned() } else { self.ancestors.join(" ") };
        self.header_for(&ancestors)
    }

    /// The header's value of a public model's page that asks to be embedded (`?embed=1`): any site may frame it, where the operator named none.
    /// Such a page has no form, and a frame of another site gets no cookie of this one (`SameSite`).
    pub(crate) fn embed_header(&self) -> String {
        if self.ancestors.is_empty() { self.header_for("*") } else { self.header() }
    }

    /// Whether sites that the operator did not name may show a model in a frame.
    pub(crate) fn lets_any_site_embed(&self) -> bool {
        self.ancestors.is_empty() || self.ancestors.iter().any(|a| a == "*")
    }

    fn header_for(&self, ancestors: &str) -> String {
        let sources = match self.sources.as_slice() {
            [] => String::new(),
            some => format!("; connect-src 'self' {}", some.join(" ")),
        };
        format!("{BASE}{sources}; frame-ancestors {ancestors}")
    }

    /// `<meta name="kilwa-origins" …>` for the head of the viewer's page (www/embed.js), empty where only its own origin may talk to it.
    pub(crate) fn meta(&self) -> String {
        match self.talkers.as_slice() {
            [] => String::new(),
            some => format!("<meta name=\"kilwa-origins\" content=\"{}\">\n", some.join(" ")),
        }
    }
}

/// `http(s)://host[:port]` as browsers write it: lower case, no path, no last slash. A policy also takes `https://*.museum.example`.
fn origin(text: &str, star: bool) -> Result<String, PolicyError> {
    let refuse =
        |what| PolicyError { given: text.to_owned(), what, wanted: "an origin: scheme, host and, if unusual, port" };
    let lower = text.trim().trim_end_matches('/').to_ascii_lowercase();
    let host = lower.strip_prefix("https://").or_else(|| lower.strip_prefix("http://"));
    let host = host.ok_or_else(|| refuse("no origin"))?;
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !port.ends_with(']') => (name, Some(port)),
        _ => (host, None),
    };
    if port.is_some_and(|p| p.parse::<u16>().is_err()) {
        return Err(refuse("an origin with an impossible port"));
    }
    let name = if star { name.strip_prefix("*.").unwrap_or(name) } else { name };
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '.';
    let bracketed = name.strip_prefix('[').and_then(|n| n.strip_suffix(']'));
    let is_host =
        bracketed.map_or(!name.is_empty() && name.chars().all(plain), |n| n.parse::<std::net::Ipv6Addr>().is_ok());
    if !is_host {
        return Err(refuse("not just an origin"));
    }
    let usual = if lower.starts_with("https") { ":443" } else { ":80" };
    Ok(lower.strip_suffix(usual).unwrap_or(&lower).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn policy(ancestors: &[&str], talkers: &[&str], sources: &[&str]) -> Result<Policy, PolicyError> {
        let own = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        Policy::new(&own(ancestors), &own(talkers), &own(sources))
    }

    #[test]
    fn only_its_own_origin_may_frame_the_page_by_default() {
        assert!(Policy::default().header().ends_with("; frame-ancestors 'self'"));
        assert!(Policy::default().embed_header().ends_with("; frame-ancestors *"));
        assert_eq!(Policy::default().meta(), "");
        let p = policy(
            &["self", "https://Museum.example/", "https://*.blog.example"],
            &["https://museum.example:443"],
            &["https://cdn.example"],
        )
        .unwrap();
        assert!(p.header().contains("; connect-src 'self' https://cdn.example;"), "{}", p.header());
        assert!(p.header().ends_with("frame-ancestors 'self' https://museum.example https://*.blog.example"));
        assert_eq!(p.meta(), "<meta name=\"kilwa-origins\" content=\"https://museum.example\">\n");
        assert_eq!(p.embed_header(), p.header(), "who is named is who may");
        assert!(policy(&["none"], &["*"], &[]).unwrap().embed_header().ends_with("frame-ancestors 'none'"));
    }

    #[test]
    fn nothing_but_origins_gets_into_a_header_or_the_page() {
        for bad in [
            "museum.example",
            "https://",
            "https://a/b",
            "https://a; script-src *",
            "https://a\" onload=\"x",
            "https://a b",
            "javascript:alert(1)",
            "https://a:99999",
            "https://[zz]",
            "https://é.example",
        ] {
            let e = policy(&[bad], &[], &[]).unwrap_err().to_string();
            assert!(e.contains("https://museum.example"), "{e}");
            assert!(policy(&[], &[bad], &[]).is_err() && policy(&[], &[], &[bad]).is_err(), "{bad}");
        }
        assert!(policy(&["none", "self"], &[], &[]).is_err());
        assert!(policy(&[], &["https://*.museum.example"], &[]).is_err(), "the page compares whole origins");
        assert!(policy(&["http://[::1]:8080"], &[], &[]).is_ok());
    }
}
