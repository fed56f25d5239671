//! Title, author, licence, credit and source of a download, as its `license.txt` and the extras of its glTF state them.
//!
//! Nothing is guessed: a value is filled in where all statements agree, with a comment that says where it comes from. Where they contradict each
//! other, the field stays open, all statements become comments, and a message says so.

use anyhow::bail;
use kilwa_archive::metadata::template::{Known, Remarked};
use kilwa_archive::rights::Rights;
use kilwa_formats::read::archive::{Credits, Named, Statement, credits};
use kilwa_pack::visible::visible;
use std::path::Path;

/// Fill in what the download at `path` states.
///
/// # Errors
/// If it is no archive that can be read, or states nothing.
pub(super) fn fill(known: &mut Known, path: &Path) -> anyhow::Result<()> {
    let found = credits(path)?;
    if found.statements.is_empty() {
        let why = if found.notes.is_empty() {
            "it has no license.txt, and no glTF with the extras that Sketchfab writes".to_owned()
        } else {
            found.notes.join("; ")
        };
        bail!("{} does not state its rights: {why}; leave out --download and fill them in by hand", path.display());
    }
    for message in filled(known, &found, &file_name(path)) {
        crate::terminal::say!("kilwa: {}: {}", path.display(), visible(&message));
    }
    Ok(())
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// Fill in the values; what a person has to know about them.
fn filled(known: &mut Known, found: &Credits, file: &str) -> Vec<String> {
    let mut all = Download { known, found, file, messages: found.notes.clone() };
    if let Some(title) = all.agreed(Remarked::Title, "title", |s| s.title.clone(), Clone::clone) {
        all.known.title = Some(title);
    }
    all.author();
    all.rights();
    if let Some(source) = all.agreed(Remarked::Source, "source", |s| s.source.clone(), Clone::clone) {
        if source.starts_with("https://") || source.starts_with("http://") {
            all.known.source = Some(source);
        } else {
            all.remark(Remarked::Source, format!("Not a web address: \"{source}\""));
        }
    }
    all.messages
}

/// What is filled in, and from what.
struct Download<'a> {
    known: &'a mut Known,
    found: &'a Credits,
    /// The name of the download.
    file: &'a str,
    messages: Vec<String>,
}

impl Download<'_> {
    fn remark(&mut self, field: Remarked, text: String) {
        self.known.remarks.push((field, text));
    }

    /// The value that all statements agree on, with a comment on where it comes from. Values agree if they have the same `meaning`.
    fn agreed<T: Texts, M: PartialEq>(
        &mut self,
        field: Remarked,
        what: &str,
        value: impl Fn(&Statement) -> Option<T>,
        meaning: impl Fn(&T) -> M,
    ) -> Option<T> {
        let stated: Vec<(&str, T)> = self
            .found
            .statements
            .iter()
            .filter_map(|(place, statement)| Some((place.as_str(), value(statement)?)))
            .collect();
        let (_, first) = stated.first()?;
        if stated.iter().all(|(_, other)| meaning(other) == meaning(first)) {
            let places: Vec<&str> = stated.iter().map(|(place, _)| *place).collect();
            self.remark(field, format!("From {} in {}.", places.join(" and "), self.file));
            return stated.into_iter().next().map(|(_, value)| value);
        }
        let lines: Vec<String> =
            stated.iter().map(|(place, value)| format!("{place} states \"{}\"", value.text())).collect();
        self.messages
            .push(format!("contradictory statements about the {what}; the field is left empty: {}", lines.join("; ")));
        self.remark(field, format!("{} contradicts itself about the {what}:", self.file));
        for line in lines {
            self.remark(field, line);
        }
        None
    }

    fn author(&mut self) {
        let Some(author) = self.agreed(Remarked::Creators, "author", |s| s.author.clone(), Clone::clone) else {
            return;
        };
        if let Some(address) = &author.address {
            self.remark(Remarked::Creators, format!("The author's page: {address}"));
        }
        let how = "It is the name of an account: write a person as \"Family, Given\"; an organisation needs kind = \"organisation\".";
        self.remark(Remarked::Creators, how.to_owned());
        self.known.creators.push((author.name, false));
    }

    /// The licence; how to give credit. A licence that is not in the list stays as a statement.
    fn rights(&mut self) {
        let meaning = |license: &Named| (uri(license), uri(license).is_none().then(|| license.text()));
        let license = self.agreed(Remarked::Rights, "licence", |s| s.license.clone(), meaning);
        let credit = self.agreed(Remarked::Credit, "credit", |s| s.credit.clone(), Clone::clone);
        let requirements = self.agreed(Remarked::Credit, "requirements", |s| s.requirements.clone(), Clone::clone);
        self.known.credit.clone_from(&credit);
        let Some(license) = license else { return };
        if let Some(uri) = uri(&license) {
            self.known.rights = Some(uri);
            return;
        }
        let text = license.text();
        self.remark(
            Remarked::Rights,
            format!("The licence \"{text}\" is not a known licence, so rights.uri is left empty; to publish the model you need the permission of the rights holder."),
        );
        self.messages.push(format!(
            "the licence \"{text}\" is not a known licence or rights statement and is kept in rights.statement; to publish the model you need the permission of the rights holder"
        ));
        let lines = [Some(format!("Licence: {text}")), requirements, credit];
        self.known.credit = Some(lines.into_iter().flatten().collect::<Vec<_>>().join("\n"));
    }
}

/// The canonical address of a licence: of its address, else of its name. `None` if neither is known, or they are two licences.
fn uri(license: &Named) -> Option<String> {
    let of = |text: &str| Rights::parse(text).ok().map(|rights| rights.uri);
    match (license.address.as_deref().and_then(of), of(&license.name)) {
        (Some(a), Some(b)) if a != b => None,
        (by_address, by_name) => by_address.or(by_name),
    }
}

/// A value in words.
trait Texts {
    fn text(&self) -> String;
}

impl Texts for String {
    fn text(&self) -> String {
        self.clone()
    }
}

impl Texts for Named {
    fn text(&self) -> String {
        match &self.address {
            Some(address) => format!("{} ({address})", self.name),
            None => self.name.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_archive::Metadata;
    use kilwa_archive::metadata::template::write;

    const BY: &str = "http://creativecommons.org/licenses/by/4.0/";

    fn named(name: &str, address: &str) -> Named {
        Named { name: name.to_owned(), address: Some(address.to_owned()).filter(|a| !a.is_empty()) }
    }

    fn statement() -> Statement {
        Statement {
            title: Some("Fort".to_owned()),
            source: Some("https://sketchfab.com/3d-models/fort-0123".to_owned()),
            author: Some(named("amina", "https://sketchfab.com/amina")),
            license: Some(named("CC-BY-4.0", BY)),
            requirements: Some("Author must be credited.".to_owned()),
            credit: Some("This work is based on \"Fort\" by amina".to_owned()),
        }
    }

    fn of(statements: Vec<Statement>) -> (Known, Vec<String>) {
        let places = ["license.txt", "asset.extras of scene.gltf"].map(str::to_owned);
        let found = Credits { statements: places.into_iter().zip(statements).collect(), notes: Vec::new() };
        let mut known = Known { units: Some("m".to_owned()), ..Known::default() };
        let messages = filled(&mut known, &found, "fort.zip");
        (known, messages)
    }

    #[test]
    fn what_a_download_states_becomes_a_file_that_can_be_used() {
        let extras = Statement { credit: None, requirements: None, ..statement() };
        let (known, messages) = of(vec![statement(), extras]);
        assert_eq!(messages, Vec::<String>::new());
        let text = write(&known);
        let m = Metadata::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!((m.title.as_str(), m.rights.uri.as_str()), ("Fort", "https://creativecommons.org/licenses/by/4.0/"));
        assert_eq!(m.rights.statement.as_deref(), Some("This work is based on \"Fort\" by amina"));
        assert_eq!((m.creators[0].name.as_str(), m.rights.holder), ("amina", None));
        assert_eq!(m.related[0].uri, "https://sketchfab.com/3d-models/fort-0123");
        let both = "# From license.txt and asset.extras of scene.gltf in fort.zip.\n";
        assert_eq!(text.matches(both).count(), 4, "{text}");
        assert!(
            text.contains("# From license.txt in fort.zip.\n") && text.contains("# The author's page: https://"),
            "{text}"
        );
    }

    #[test]
    fn contradictions_are_reported_and_left_open() {
        let other = Statement {
            title: Some("Castle".to_owned()),
            license: Some(named("CC-BY-NC-4.0", "http://creativecommons.org/licenses/by-nc/4.0/")),
            ..statement()
        };
        let (known, messages) = of(vec![statement(), other]);
        assert_eq!((known.title.clone(), known.rights.clone(), known.creators.len()), (None, None, 1));
        assert!(messages[0].contains("title") && messages[0].contains("\"Castle\""), "{messages:?}");
        assert!(messages[1].contains("licence") && messages[1].contains("CC-BY-NC-4.0"), "{messages:?}");
        let text = write(&known);
        assert!(text.contains("# asset.extras of scene.gltf states \"Castle\"\n"), "{text}");
        let fields: Vec<String> = Metadata::parse(&text).unwrap_err().0.into_iter().map(|p| p.field).collect();
        assert_eq!(fields, ["title", "rights.uri"]);
        // The same licence in other words is no contradiction, two in one line are.
        let short = Statement { license: Some(named("CC BY 4.0", "")), ..statement() };
        assert!(of(vec![statement(), short]).1.is_empty());
        assert_eq!(uri(&named("CC-BY-4.0", "http://creativecommons.org/licenses/by-nd/4.0/")), None);
    }

    #[test]
    fn a_licence_that_is_not_in_the_list_stays_as_a_statement_with_a_message() {
        for (name, address) in
            [("Editorial", ""), ("SKETCHFAB Standard", "https://sketchfab.com/licenses"), ("Free Standard", "")]
        {
            let (known, messages) = of(vec![Statement { license: Some(named(name, address)), ..statement() }]);
            assert_eq!(known.rights, None, "{name}");
            assert!(
                messages[0].contains(name) && messages[0].contains("permission of the rights holder"),
                "{messages:?}"
            );
            let text = known.credit.clone().unwrap();
            assert!(
                text.contains(name) && text.contains("Author must be credited") && text.contains("This work"),
                "{text}"
            );
            let fields: Vec<String> =
                Metadata::parse(&write(&known)).unwrap_err().0.into_iter().map(|p| p.field).collect();
            assert_eq!(fields, ["rights.uri"]);
        }
    }
}
