//! Replaces passwords in addresses (`https://user:password@host/`) with `***` wherever the program prints or keeps an address.
//!
//! The passwords are taken from the arguments and the environment. All printed text passes through `terminal`, which replaces them; text
//! written to files passes through [`shown`].

use std::borrow::Cow;
use std::sync::OnceLock;

/// Shown instead of a password.
const STARS: &str = "***";
/// A shorter user or password may occur in any other text: `:x@` in `mailto:x@a.example`.
const MIN_CHARS: usize = 3;

/// An address with its password replaced.
pub(crate) fn shown(address: &str) -> Cow<'_, str> {
    match with_password(address) {
        Some((before, password)) => {
            let after = address.get(before.len() + password.len()..).unwrap_or_default();
            Cow::Owned(format!("{before}{STARS}{after}"))
        }
        None => Cow::Borrowed(address),
    }
}

/// An address without user name and password.
pub(crate) fn without_user(address: &str) -> Cow<'_, str> {
    match user_of(address) {
        Some((start, user)) => {
            let after = address.get(start + user.len() + 1..).unwrap_or_default();
            Cow::Owned(format!("{}{after}", address.get(..start).unwrap_or_default()))
        }
        None => Cow::Borrowed(address),
    }
}

/// Any text, with the passwords from the arguments and the environment replaced.
pub(crate) fn hide(text: &str) -> Cow<'_, str> {
    hide_those(text, known())
}

/// Whether there are passwords in the arguments or the environment.
pub(crate) fn are_known() -> bool {
    !known().is_empty()
}

fn hide_those<'t>(text: &'t str, passwords: &[(String, String)]) -> Cow<'t, str> {
    let mut text = Cow::Borrowed(text);
    for (found, instead) in passwords {
        if text.contains(found.as_str()) {
            text = Cow::Owned(text.replace(found.as_str(), instead));
        }
    }
    text
}

/// `user:password@` of every address in the arguments and the environment, and what is printed instead.
fn known() -> &'static [(String, String)] {
    static KNOWN: OnceLock<Vec<(String, String)>> = OnceLock::new();
    KNOWN.get_or_init(|| {
        let environment = std::env::vars_os().map(|(_, value)| value);
        let texts = std::env::args_os().skip(1).chain(environment);
        texts.flat_map(|text| forms(&text.to_string_lossy())).collect()
    })
}

/// The forms in which the password of an address may be printed: as it is, as text in quotation marks, as JSON. If the user or the
/// password is empty or short, only with the slashes before them.
fn forms(address: &str) -> Vec<(String, String)> {
    let Some((before, password)) = with_password(address) else { return Vec::new() };
    let begin = before.split_once("://").map_or("", |(_, user)| user);
    let is_short = |text: &str| text.chars().count() < MIN_CHARS;
    // A path that is made from an address has one slash only.
    let slashes: &[&str] =
        if is_short(begin.trim_end_matches(':')) || is_short(password) { &["://", ":/"] } else { &[""] };
    let inside = |quoted: &str| quoted.trim_matches('"').to_owned();
    let all = slashes.iter().flat_map(|slashes| {
        let plain = format!("{slashes}{begin}{password}@");
        let quoted = inside(&format!("{plain:?}"));
        let json = serde_json::to_string(&plain).map_or_else(|_| plain.clone(), |json| inside(&json));
        [plain, quoted, json].map(|found| (found, format!("{slashes}{begin}{STARS}@")))
    });
    all.collect()
}

/// The part of an address before its password, and the password.
fn with_password(address: &str) -> Option<(&str, &str)> {
    let (start, user) = user_of(address)?;
    let colon = user.find(':')?;
    let (before, password) = (address.get(..=start + colon)?, user.get(colon + 1..)?);
    (!password.is_empty()).then_some((before, password))
}

/// The position of `user:password` in an address, and that text. An address ends at a space.
fn user_of(address: &str) -> Option<(usize, &str)> {
    let start = address.find("://")? + 3;
    let rest = address.get(start..)?.split(char::is_whitespace).next()?;
    let authority = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let user = authority.rfind('@').or_else(|| {
        // A password may contain a slash; a port does not.
        let (_, port) = authority.split_once(':').filter(|(host, _)| !host.starts_with('['))?;
        rest.rfind('@').filter(|_| !port.bytes().all(|b| b.is_ascii_digit()))
    })?;
    Some((start, rest.get(..user)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_password_is_replaced() {
        for (address, expected) in [
            ("https://me:secret@a.example/x", "https://me:***@a.example/x"),
            ("--to=https://me:secret@a.example", "--to=https://me:***@a.example"),
            ("https://:secret@a.example:8080/", "https://:***@a.example:8080/"),
            ("http://me:se:cr@et@a.example/@", "http://me:***@a.example/@"),
            ("http://me:sec/ret?@a.example/", "http://me:***@a.example/"),
            ("s3://key:secret@bucket/prefix", "s3://key:***@bucket/prefix"),
            ("https://me@a.example/", "https://me@a.example/"),
            ("https://a.example:8080/a:b@c", "https://a.example:8080/a:b@c"),
            ("https://[::1]:8080/a@c", "https://[::1]:8080/a@c"),
            ("https://me:@a.example/", "https://me:@a.example/"),
            ("C:\\folder\\a@b", "C:\\folder\\a@b"),
            ("https://a.example: write to me@a.example", "https://a.example: write to me@a.example"),
            ("see https://a.example:x/ or me@a.example", "see https://a.example:x/ or me@a.example"),
            ("see https://me:secret@a.example or me@a.example", "see https://me:***@a.example or me@a.example"),
        ] {
            assert_eq!(shown(address), expected);
            assert_eq!(shown(&shown(address)), expected, "a second time changes nothing");
        }
        assert_eq!(without_user("https://me:secret@a.example/x"), "https://a.example/x");
        assert_eq!(without_user("https://a.example/x@y"), "https://a.example/x@y");
    }

    #[test]
    fn a_password_is_replaced_in_every_form_of_text() {
        let address = "https://me:s\"e-c\u{e9}\\t@a.example/x";
        let passwords = forms(address);
        let json = serde_json::json!({ "file": address, "other": "https://b.example:80/c:d@e" });
        for text in [address.to_owned(), format!("{address:?}: refused"), json.to_string()] {
            let hidden = hide_those(&text, &passwords).into_owned();
            assert!(hidden.contains("https://me:***@a.example/x") && !hidden.contains("e-c"), "{hidden}");
            assert_eq!(hidden.contains("c:d@e"), text.contains("c:d@e"), "{hidden}");
        }
    }

    #[test]
    fn a_short_password_is_replaced_in_its_address_only() {
        for (address, text, expected) in [
            ("redis://:x@host", "max@museum.example, mailto:x@museum.example", None),
            ("redis://:x@host", "redis://:x@host refused", Some("redis://:***@host refused")),
            ("redis://:x@host", "redis:/:x@host/a", Some("redis:/:***@host/a")),
            ("redis://:secret@host", "mailto:secret@museum.example", None),
            ("redis://me:x@host", "name:x@museum.example", None),
            ("redis://me:x@host", "\"redis://me:x@host\"", Some("\"redis://me:***@host\"")),
            ("redis://user:secret@host", "user:secret@host", Some("user:***@host")),
            ("see https://a.example: write to curator@a.example", "write to curator@a.example", None),
        ] {
            assert_eq!(hide_those(text, &forms(address)), expected.unwrap_or(text), "{address}");
        }
    }
}
