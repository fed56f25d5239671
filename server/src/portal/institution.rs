//! The institution that runs the archive, as described in `site.toml`.
//!
//! ```toml
//! name = "National Museum of Kilwa"
//! logo = "logo.svg"
//! accent = "#1d5a7a"
//! featured = ["gereza", "husuni-kubwa"]
//! imprint = "https://museum.example/imprint"
//! contact = "archive@museum.example"
//!
//! [introduction]
//! en = """One or more paragraphs."""
//! sw = """Aya moja au zaidi."""
//! ```
//!
//! Texts are in one language, that of `language`, or in several. Invariants: every mistake is reported, with its line; a colour with too little contrast is
//! adjusted, and a remark reports it; nothing here is markup.

use super::color::{Accent, Rgb, Theme};
use super::language::Language;
use kilwa_toml::{File, Found, Problem, Problems, Table};
use std::collections::BTreeSet;
use toml::de::DeTable;

/// Longest texts, characters.
const NAME_MAX: usize = 200;
const INTRODUCTION_MAX: usize = 8000;
/// These are at the foot of every page.
const NOTICE_MAX: usize = 3000;
/// Models that are shown first.
pub(super) const FEATURED_MAX: usize = 12;

/// The institution.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Institution {
    /// `None` where there is no `site.toml`.
    pub(crate) name: Option<Texts>,
    /// Name of the file beside `site.toml`, and the line that names it.
    pub(crate) logo: Option<(String, usize)>,
    pub(crate) introduction: Option<Texts>,
    pub(crate) imprint: Option<Texts>,
    pub(crate) contact: Option<Texts>,
    pub(crate) accent: Option<Accent>,
    /// Slugs of objects, in order.
    pub(crate) featured: Vec<String>,
    /// The line of `featured`.
    pub(crate) featured_line: usize,
    /// What was adjusted, for the log.
    pub(crate) remarks: Vec<String>,
}

/// A text in one or more languages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Texts {
    /// BCP 47 codes and texts; never empty. The first is for readers whose language is missing.
    texts: Vec<(String, String)>,
}

impl Texts {
    /// The text for a reader, and its language.
    pub(crate) fn for_reader(&self, language: &Language) -> (&str, &str) {
        let is_own = |code: &str| code.split('-').next().is_some_and(|c| c.eq_ignore_ascii_case(language.code));
        let found = self.texts.iter().find(|(code, _)| is_own(code)).or_else(|| self.texts.first());
        found.map_or(("en", ""), |(code, text)| (code.as_str(), text.as_str()))
    }
}

/// The target of the link, if an imprint or a contact is a single web or mail address and not a text.
pub(crate) fn link(text: &str) -> Option<String> {
    if text.contains(char::is_whitespace) {
        return None;
    }
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    if rest.is_some_and(|rest| !rest.is_empty()) {
        return Some(text.to_owned());
    }
    let (user, host) = text.split_once('@')?;
    let is_host = host.contains('.') && host.bytes().all(|b| b.is_ascii_alphanumeric() || b"-.".contains(&b));
    let is_user = !user.is_empty() && user.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._+".contains(&b));
    (is_host && is_user).then(|| format!("mailto:{text}"))
}

impl Institution {
    /// Read the text of a `site.toml`.
    ///
    /// # Errors
    /// [`Problems`]: every mistake, in the order of lines.
    pub(crate) fn parse(text: &str) -> Result<Self, Problems> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let file = File::new(text);
        let root = DeTable::parse(text).map_err(|e| {
            let line = e.span().map_or(1, |span| file.line(span.start));
            Problems(vec![Problem::new(line, "", e.message().trim().replace('\n', ", "))])
        })?;
        let institution = institution(Table::new(&file, "", 0, root.get_ref()));
        let problems = file.into_problems();
        if problems.is_empty() { Ok(institution) } else { Err(Problems(problems)) }
    }
}

fn institution(t: Table<'_, '_>) -> Institution {
    let language = t.text("language").and_then(|found| language(&t, found)).unwrap_or_else(|| "en".to_owned());
    let name = texts(&t, "name", &language, NAME_MAX);
    if name.is_none() && !t.has("name") {
        t.missing("name", "it is missing; write name = \"…\", the name of the institution, at the top of the file");
    } else if name.is_none() && !t.is_table("name") {
        t.missing("name", "the name of the institution cannot be empty");
    }
    let introduction = texts(&t, "introduction", &language, INTRODUCTION_MAX);
    let imprint = texts(&t, "imprint", &language, NOTICE_MAX);
    let contact = texts(&t, "contact", &language, NOTICE_MAX);
    let logo = t.text("logo").and_then(|found| {
        let is_plain = !found.value.starts_with('.') && !found.value.contains(['/', '\\']);
        if !is_plain {
            let message = "expected the name of a file beside site.toml, without folders, for example \"logo.svg\"";
            t.wrong("logo", found.at, message);
        }
        is_plain.then(|| (found.value, t.line("logo")))
    });
    let mut remarks = Vec::new();
    let accent = accent(&t, &mut remarks);
    let featured = featured(&t);
    let featured_line = t.line("featured");
    t.finish();
    Institution { name, logo, introduction, imprint, contact, accent, featured, featured_line, remarks }
}

fn language(t: &Table<'_, '_>, found: Found<String>) -> Option<String> {
    let is_code = |c: &str| (1..=8).contains(&c.len()) && c.bytes().all(|b| b.is_ascii_alphanumeric());
    if found.value.split('-').all(is_code) {
        return Some(found.value);
    }
    t.wrong(
        "language",
        found.at,
        format!("\"{}\" is not a language code; write one such as en, fr or pt-BR", found.value),
    );
    None
}

/// A text in the file's language, or a table with a text for each of several languages.
fn texts(t: &Table<'_, '_>, key: &'static str, language: &str, max: usize) -> Option<Texts> {
    let checked = |t: &Table<'_, '_>, key: &'static str| {
        // A name has one line.
        let text = if max == NAME_MAX { t.text(key).map(|found| found.value) } else { t.paragraphs(key) }?;
        let length = text.chars().count();
        if length > max {
            t.missing(key, &format!("it is {length} characters long; at most {max} are allowed"));
        }
        Some(text)
    };
    if !t.is_table(key) {
        let text = checked(t, key)?;
        return Some(Texts { texts: vec![(language.to_owned(), text)] });
    }
    let table = t.table(key)?;
    let codes = Language::all().iter().map(|l| l.code);
    let mut texts: Vec<_> = codes.filter_map(|code| Some((code.to_owned(), checked(&table, code)?))).collect();
    let is_empty = texts.is_empty() && !Language::all().iter().any(|l| table.has(l.code));
    // The file's own language first, then English: readers of other languages get the first that exists.
    let own = language.split('-').next().unwrap_or(language);
    texts.sort_by_key(|(code, _)| (!code.eq_ignore_ascii_case(own), code != "en"));
    table.finish();
    if is_empty {
        t.missing(key, &format!("write a text for at least one language, for example en = \"…\" below [{key}]"));
    }
    (!texts.is_empty()).then_some(Texts { texts })
}

/// One colour for both themes, or a table with one for each.
fn accent(t: &Table<'_, '_>, remarks: &mut Vec<String>) -> Option<Accent> {
    let color = |t: &Table<'_, '_>, key: &'static str| {
        let found = t.text(key)?;
        let color = Rgb::parse(&found.value);
        if color.is_none() {
            t.wrong(
                key,
                found.at,
                format!("\"{}\" is not a colour; write it as #rrggbb, for example \"#1d5a7a\"", found.value),
            );
        }
        color
    };
    let mut adjusted = |field: &str, line: usize, color: Rgb, theme: Theme| {
        let shown = color.adjusted(theme);
        if shown != color {
            remarks.push(format!(
                "line {line}: {field}: the contrast of {color} is {:.1} to 1 in the {} theme, too low to read; {shown} is shown instead (WCAG AA requires 4.5 to 1)",
                color.contrast_in(theme),
                theme.name()
            ));
        }
        shown
    };
    if !t.is_table("accent") {
        let color = color(t, "accent")?;
        // No colour has enough contrast in both themes. If it suits one, adjusting it for the other needs no remark.
        if color.suits(Theme::Dark) {
            return Some(Accent { light: color.adjusted(Theme::Light), dark: color });
        }
        let light = adjusted("accent", t.line("accent"), color, Theme::Light);
        return Some(Accent { light, dark: color.adjusted(Theme::Dark) });
    }
    let table = t.table("accent")?;
    let [light, dark] = [("light", Theme::Light), ("dark", Theme::Dark)]
        .map(|(key, theme)| Some(adjusted(&table.field(key), table.line(key), color(&table, key)?, theme)));
    let is_empty = !table.has("light") && !table.has("dark");
    table.finish();
    if is_empty {
        t.missing("accent", "write light = \"#rrggbb\" and dark = \"#rrggbb\" below [accent]");
    }
    Some(Accent {
        light: light.or_else(|| Some(dark?.adjusted(Theme::Light)))?,
        dark: dark.or_else(|| Some(light?.adjusted(Theme::Dark)))?,
    })
}

fn featured(t: &Table<'_, '_>) -> Vec<String> {
    let featured = t.texts("featured");
    let mut named = BTreeSet::new();
    if let Some(twice) = featured.iter().find(|slug| !named.insert(slug.as_str())) {
        t.missing("featured", &format!("it names {twice} twice"));
    }
    if featured.len() > FEATURED_MAX {
        t.missing("featured", &format!("it names {} models; at most {FEATURED_MAX} are allowed", featured.len()));
    }
    featured
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(code: &str) -> &'static Language {
        Language::choose(Some(code), "")
    }

    #[test]
    fn texts_are_in_the_readers_language_or_else_in_that_of_the_file() {
        let plain = Institution::parse("name = \"Museu\"\nlanguage = \"pt-BR\"\n").unwrap();
        assert_eq!(plain.name.unwrap().for_reader(of("sw")), ("pt-BR", "Museu"));
        let text = "language = \"sw\"\n[name]\nen = \"Museum\"\nsw = \"Makumbusho\"\n[introduction]\nfr = \"Bonjour\"\nen = \"\"\"A\n\nB\"\"\"\n";
        let several = Institution::parse(text).unwrap();
        let name = several.name.unwrap();
        assert_eq!(
            [of("en"), of("ar"), of("sw")].map(|l| name.for_reader(l).1),
            ["Museum", "Makumbusho", "Makumbusho"]
        );
        assert_eq!(several.introduction.unwrap().for_reader(of("ar")), ("en", "A\n\nB"));
        let regional = "name = \"M\"\nlanguage = \"pt-BR\"\n[introduction]\nen = \"Hello\"\npt = \"Oi\"\n";
        let regional = Institution::parse(regional).unwrap().introduction.unwrap();
        assert_eq!(regional.for_reader(of("fr")), ("pt", "Oi"));
    }

    #[test]
    fn every_mistake_is_reported_with_its_line_at_once() {
        let text = "nmae = \"Museum\"\nlogo = \"../logo.svg\"\naccent = \"blue\"\nfeatured = [\"a\", \"b\", \"a\"]\nlanguage = \"<x>!\"\ncontact = 5\n\n[introduction]\nen = \"x\"\nde = \"y\"\n";
        let problems = Institution::parse(text).unwrap_err().to_string();
        for wanted in [
            "line 1: name: it is missing",
            "line 1: nmae: there is no such field; did you mean \"name\"?",
            "line 2: logo: expected the name of a file beside site.toml",
            "line 3: accent: \"blue\" is not a colour",
            "line 4: featured: it names a twice",
            "line 5: language: ",
            "line 6: contact: expected a text",
            "line 10: introduction.de: there is no such field",
        ] {
            assert!(problems.contains(wanted), "{wanted}\n{problems}");
        }
        for (text, wanted) in [
            ("name = \"\"\n", "line 1: name: the name of the institution cannot be empty"),
            ("name = \"M", "line 1: "),
            ("name = \"M\"\n[accent]\n", "line 2: accent: write light"),
            ("name = \"M\"\n[imprint]\n", "line 2: imprint: write a text for at least one language"),
            (
                "name = \"M\"\n[accent]\nlight = \"#123\"\ndrak = \"#123\"\n",
                "accent.drak: there is no such field; did you mean \"dark\"",
            ),
            (&format!("name = \"{}\"\n", "é".repeat(201)), "it is 201 characters long; at most 200 are allowed"),
            (
                &format!("name = \"M\"\nfeatured = {:?}\n", (0..13).map(|n| n.to_string()).collect::<Vec<_>>()),
                "it names 13 models; at most 12",
            ),
        ] {
            let problems = Institution::parse(text).unwrap_err().to_string();
            assert!(problems.contains(wanted), "{wanted}\n{problems}");
        }
    }

    #[test]
    fn a_color_that_cannot_be_read_is_adjusted_with_a_remark() {
        let read = |text: &str| Institution::parse(&format!("name = \"M\"\n{text}")).unwrap();
        for text in
            ["accent = \"#1d5a7a\"\n", "accent = \"#ffcc00\"\n", "[accent]\nlight = \"#1d5a7a\"\ndark = \"#ffcc00\"\n"]
        {
            let read = read(text);
            assert_eq!(read.remarks, [""; 0], "{text}");
            let accent = read.accent.unwrap();
            assert!(accent.light.suits(Theme::Light) && accent.dark.suits(Theme::Dark), "{text}");
        }
        let middle = read("accent = \"#888\"\n");
        assert_eq!(middle.remarks.len(), 1);
        assert!(middle.remarks[0].starts_with("line 2: accent: the contrast of #888888 is "), "{:?}", middle.remarks);
        let both = read("[accent]\nlight = \"#ffcc00\"\ndark = \"#1d5a7a\"\n").remarks;
        assert!(
            both[0].starts_with("line 3: accent.light: the contrast of #ffcc00 is 1.")
                && both[0].contains("in the light theme"),
            "{both:?}"
        );
        assert!(both[1].starts_with("line 4: accent.dark: ") && both[1].contains("in the dark theme"), "{both:?}");
    }

    #[test]
    fn an_imprint_is_a_link_or_a_text_and_never_a_script() {
        assert_eq!(link("https://museum.example/imprint").as_deref(), Some("https://museum.example/imprint"));
        assert_eq!(link("archive@museum.example").as_deref(), Some("mailto:archive@museum.example"));
        for text in [
            "Museum\nStreet 1",
            "javascript:alert(1)",
            "https://",
            "https://a b",
            "@",
            "a@b",
            "data:text/html,x",
            "a?b@c.d",
        ] {
            assert_eq!(link(text), None, "{text}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_parsed_or_refused(text in ".{0,200}") {
            drop(Institution::parse(&text));
            drop(Institution::parse(&format!("name = \"M\"\n{text}")));
        }
    }
}
