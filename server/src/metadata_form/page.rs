//! The page of the form: `server/templates/metadata-form.html`, filled with the fields of [`schema`], their texts and values.

use super::Shown;
use crate::countries;
use crate::portal::frame::Choice;
use crate::portal::language::Language;
use askama::Template;
use kilwa_archive::html::render;
use kilwa_archive::metadata::document::Fault;
use kilwa_archive::metadata::schema::{self, Choices, Field, Kind, Section};
use kilwa_archive::record::CONTRIBUTORS;
use kilwa_archive::rights::Rights;
use kilwa_messages::{Catalogue, Value};
use serde_json::json;

/// The fields without which there is no model; they come first, whatever section they belong to.
const NEEDED: [(&str, &str); 3] = [("", "title"), ("rights", "uri"), ("model", "units")];

/// Keys of fields that are read from left to right in every language: addresses, days, numbers, codes.
const CODES: [&str; 15] = [
    "language",
    "published",
    "identifier",
    "url",
    "slug",
    "crs",
    "orcid",
    "ror",
    "latitude",
    "longitude",
    "uri",
    "accuracy",
    "until",
    "contact",
    "units",
];

/// The texts of the form in one language.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texts {
    pub(super) language: &'static Language,
    own: &'static Catalogue,
}

impl Texts {
    /// The language of a code, else the first that a browser names, else English.
    pub(super) fn choose(code: Option<&str>, accepted: &str) -> Self {
        let language = Language::choose(code, accepted);
        let all = kilwa_messages::metadata();
        let own = all.iter().find(|own| own.code() == language.code).unwrap_or(&all[0]);
        Self { language, own }
    }

    /// A message without values, or the key if there is none.
    pub(super) fn t<'k>(&self, key: &'k str) -> &'k str {
        self.own.text(key).unwrap_or(key)
    }

    /// A message with its values; those that are not given stay as `{name}`, for the page's script.
    pub(super) fn with(&self, key: &str, values: &[(&str, Value<'_>)]) -> String {
        self.own.format(key, values).unwrap_or_else(|| key.to_owned())
    }

    /// What to do about a mistake in a field, by its full name.
    pub(super) fn advice(&self, field: &str) -> &str {
        let own = format!("e-{}", message_name(field));
        let key = match field {
            "capture.date" | "capture.steps.date" => "e-date",
            "creators.orcid" | "contributors.orcid" => "e-orcid",
            "url" | "creators.ror" | "contributors.ror" | "place.uri" | "object.uri" | "funding.uri" => "e-address",
            _ => own.as_str(),
        };
        self.own.text(key).unwrap_or_else(|| self.own.text("e-other").unwrap_or_default())
    }

    /// A mistake as the page's script shows it.
    pub(super) fn fault(&self, fault: &Fault) -> serde_json::Value {
        let (path, key) = fault.field.rsplit_once('.').unwrap_or(("", &fault.field));
        let in_line = [("n", fault.line.into()), ("field", Value::from(&fault.field))];
        let is_shown = !fault.place.is_empty();
        let label = match schema::section(path).filter(|_| is_shown) {
            Some(_) => self.t(&format!("f-{}", message_name(&fault.field))).to_owned(),
            None => self.with("inLine", &in_line),
        };
        json!({
            "place": fault.place, "key": key, "line": fault.line, "label": label, "isMissing": fault.is_missing,
            "advice": if is_shown { self.advice(&fault.field) } else { "" },
            // Of an empty field the check says how to write it in the file.
            "check": if fault.is_missing { "" } else { fault.message.as_str() },
        })
    }
}

/// The part of a message's key that stands for a field: those of creators and contributors are the same.
fn message_name(field: &str) -> String {
    field.replacen("creators.", "agent.", 1).replacen("contributors.", "agent.", 1).replace('.', "-")
}

#[derive(Debug)]
struct Entry {
    value: String,
    text: String,
    is_chosen: bool,
}

/// Entries of a list under one heading; an empty heading is none.
#[derive(Debug)]
struct Group {
    heading: &'static str,
    entries: Vec<Entry>,
    /// Whether the texts are English in every language.
    is_english: bool,
}

#[derive(Debug)]
struct Input {
    /// `rights.uri`, `creators.0.name`.
    id: String,
    key: &'static str,
    label: String,
    help: String,
    example: &'static str,
    kind: &'static str,
    is_required: bool,
    /// Whether its texts are read from left to right in every language: addresses, dates, numbers.
    is_code: bool,
    value: String,
    groups: Vec<Group>,
    list: Option<&'static str>,
}

#[derive(Debug)]
struct Row {
    from: String,
    id: String,
    title: String,
    inputs: Vec<Input>,
}

#[derive(Debug)]
struct Part {
    id: String,
    /// The name in messages.
    name: String,
    path: &'static str,
    heading: String,
    description: String,
    inputs: Vec<Input>,
    /// Of a repeated section: its rows, and one to make more of.
    rows: Option<(Vec<Row>, Row)>,
    add: String,
    row_title: String,
}

#[derive(Template)]
#[template(path = "metadata-form.html")]
struct FormPage<'p> {
    t: Texts,
    file: &'p str,
    hash: &'p str,
    languages: Vec<Choice>,
    parts: Vec<Part>,
    roles: Vec<String>,
    is_new: bool,
    is_filled: bool,
    is_read_only: bool,
    messages: String,
}

/// The page.
pub(super) fn page(shown: &Shown, t: Texts) -> String {
    let language = |l: &'static Language| Choice {
        address: format!("?lang={}", l.code),
        code: l.code,
        name: l.t("name"),
        is_current: l.code == t.language.code,
    };
    let keys = [
        "moved",
        "removed",
        "saving",
        "unsaved",
        "unchanged",
        "wrongTitle",
        "foundTitle",
        "draftTitle",
        "saved",
        "savedDraft",
        "savedCopy",
        "conflictText",
        "conflictCopy",
        "cannotSave",
        "unwritable",
        "unreachable",
        "checkSays",
        "doneNothing",
        "doneWritten",
        "up",
        "down",
        "remove",
    ];
    let messages: serde_json::Map<_, _> = keys.iter().map(|key| ((*key).to_owned(), json!(t.with(key, &[])))).collect();
    render(&FormPage {
        t,
        file: &shown.seen.name,
        hash: &shown.seen.hash,
        languages: Language::all().iter().map(language).collect(),
        parts: parts(shown, t),
        roles: CONTRIBUTORS.iter().map(|role| spaced(role)).collect(),
        is_new: shown.seen.is_new(),
        is_filled: shown.is_filled,
        is_read_only: shown.is_read_only,
        messages: serde_json::Value::Object(messages).to_string(),
    })
}

/// `ContactPerson` as people write it.
fn spaced(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !text.is_empty() {
            text.push(' ');
        }
        text.push(c);
    }
    text
}

fn parts(shown: &Shown, t: Texts) -> Vec<Part> {
    let value = |name: &str| shown.values.fields.get(name).cloned().unwrap_or_default();
    let is_needed = |path: &str, key: &str| NEEDED.contains(&(path, key));
    let of = |section: &'static Section, f: &'static Field| {
        let name = section.name_of(f.key);
        input(t, section, f, name.clone(), value(&name))
    };
    let all = schema::SECTIONS.iter().flat_map(|s| s.fields.iter().map(move |f| (s, f)));
    let needed = Part {
        id: "part-needed".to_owned(),
        name: "needed".to_owned(),
        path: "",
        heading: t.t("needed").to_owned(),
        description: String::new(),
        inputs: all.filter(|(s, f)| is_needed(s.path, f.key)).map(|(s, f)| of(s, f)).collect(),
        rows: None,
        add: String::new(),
        row_title: String::new(),
    };
    let part = |section: &'static Section| {
        let name = if section.path.is_empty() { "top".to_owned() } else { section.path.replace('.', "-") };
        let fields = section.fields.iter().filter(|f| !section.is_repeated && !is_needed(section.path, f.key));
        let text = |kind: &str| t.own.text(&format!("{kind}-{name}")).unwrap_or_default().to_owned();
        Part {
            id: format!("part-{name}"),
            path: section.path,
            heading: text("s"),
            description: text("d"),
            inputs: fields.map(|f| of(section, f)).collect(),
            rows: section.is_repeated.then(|| rows(shown, t, section, &name)),
            add: text("add"),
            row_title: t.with(&format!("row-{name}"), &[]),
            name,
        }
    };
    std::iter::once(needed).chain(schema::SECTIONS.iter().map(part)).collect()
}

fn rows(shown: &Shown, t: Texts, section: &'static Section, name: &str) -> (Vec<Row>, Row) {
    let none = Vec::new();
    let blocks = shown.values.blocks.get(section.path).unwrap_or(&none);
    let row = |id: String, from: String, title: String, value: &dyn Fn(&str) -> String| {
        let one = |f: &'static Field| input(t, section, f, format!("{}.{id}.{}", section.path, f.key), value(f.key));
        Row { from, title, inputs: section.fields.iter().map(one).collect(), id: format!("{}.{id}", section.path) }
    };
    let title = format!("row-{name}");
    let filled = blocks.iter().enumerate().map(|(at, block)| {
        let value = |key: &str| block.fields.get(key).cloned().unwrap_or_default();
        let from = block.from.map(|from| from.to_string()).unwrap_or_default();
        row(at.to_string(), from, t.with(&title, &[("n", (at + 1).into())]), &value)
    });
    (filled.collect(), row("new".to_owned(), String::new(), t.with(&title, &[]), &|_| String::new()))
}

fn input(t: Texts, section: &'static Section, f: &'static Field, id: String, value: String) -> Input {
    let name = message_name(&section.name_of(f.key));
    Input {
        key: f.key,
        label: t.t(&format!("f-{name}")).to_owned(),
        help: t.t(&format!("h-{name}")).to_owned(),
        example: f.example,
        kind: match f.kind {
            // A field of one line would drop the line breaks of the file.
            Kind::Line if value.contains('\n') => "paragraphs",
            Kind::Line => "line",
            Kind::Number => "number",
            Kind::Paragraphs => "paragraphs",
            Kind::List => "list",
            Kind::Choice(_) => "choice",
        },
        is_required: f.is_required,
        is_code: CODES.contains(&f.key) || section.path.starts_with("capture") && f.key == "date",
        groups: match f.kind {
            Kind::Choice(choices) => groups(t, choices, &value),
            _ => Vec::new(),
        },
        list: (f.key == "role").then_some("roles"),
        id,
        value,
    }
}

/// The entries of a list, with the value of the file, however it is written.
fn groups(t: Texts, choices: Choices, value: &str) -> Vec<Group> {
    let mut groups = match choices {
        Choices::Rights => rights(t, value),
        Choices::Countries => {
            let mut all: Vec<_> = countries::all(t.language.code).collect();
            all.sort_by_key(|(_, name)| sort_key(name));
            let chosen = value.to_uppercase();
            let entry = |(code, name): (&str, &str)| Entry {
                is_chosen: code == chosen,
                value: if code == chosen { value.to_owned() } else { code.to_owned() },
                text: format!("{name} ({code})"),
            };
            vec![Group { heading: "", entries: all.into_iter().map(entry).collect(), is_english: false }]
        }
        _ => {
            let entry = |one: String| Entry {
                is_chosen: one == value,
                text: t.own.text(&format!("c-{one}")).map_or_else(|| one.clone(), ToOwned::to_owned),
                value: one,
            };
            let entries = choices.values().into_iter().map(entry).collect();
            vec![Group { heading: "", entries, is_english: choices == Choices::Relations }]
        }
    };
    let is_known = groups.iter().flat_map(|g| &g.entries).any(|e| e.is_chosen);
    if !value.is_empty() && !is_known {
        // Whatever the file says stays as long as nobody chooses something else.
        let entry = Entry { value: value.to_owned(), text: value.to_owned(), is_chosen: true };
        groups.insert(0, Group { heading: "", entries: vec![entry], is_english: false });
    }
    groups
}

/// Ignores accents.
fn sort_key(name: &str) -> String {
    let plain = |c: char| match c {
        'Å' | 'À' | 'Á' | 'Â' => 'A',
        'É' | 'È' | 'Ê' => 'E',
        'Î' | 'Í' => 'I',
        'Ó' | 'Ô' => 'O',
        'Ú' => 'U',
        'Ç' => 'C',
        c => c,
    };
    name.chars().map(plain).collect()
}

fn rights(t: Texts, value: &str) -> Vec<Group> {
    let chosen = Rights::parse(value).ok();
    let mut groups: Vec<Group> = ["rightsCurrent", "rightsDomain", "rightsStatements", "rightsOlder"]
        .map(|key| Group { heading: t.t(key), entries: Vec::new(), is_english: true })
        .into();
    for one in Rights::all() {
        let at = match one.uri.as_str() {
            uri if uri.contains("/publicdomain/") => 1,
            _ if !one.is_creative_commons() => 2,
            uri if uri.ends_with("/4.0/") => 0,
            _ => 3,
        };
        let is_chosen = chosen.as_ref().is_some_and(|chosen| chosen.uri == one.uri);
        let text = if one.label == one.short { one.short.clone() } else { format!("{} – {}", one.short, one.label) };
        let value = if is_chosen { value.to_owned() } else { one.short };
        groups[at].entries.push(Entry { value, text, is_chosen });
    }
    groups
}
