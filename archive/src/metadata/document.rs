//! A metadata file as a form sees it: the values of all fields as texts, what is wrong with them, and the file with other values.
//!
//! A file is changed as text ([`rewrite`](super::rewrite)): what does not belong to a changed value stays byte for byte, comments and
//! unknown fields included. A result is read again before it is returned, and refused if it does not hold the wanted values.

use super::rewrite::{self, Spot};
use super::schema::{Field, Kind, SECTIONS, Section, section};
use super::{Metadata, Problem, lines};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;
use toml_edit::{TableLike, Value};

/// A file that is not TOML, with the line; [`Metadata::parse`] says more about it.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("line {line}: {message}")]
pub struct NotToml {
    /// From 1.
    pub line: usize,
    /// What is wrong.
    pub message: String,
}

/// Why values cannot be put into a file: a field is written in a way that cannot be changed without losing something. The name is empty if that
/// holds for the file as a whole.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0} is written in the file in a way that the form cannot change; change it with a text editor")]
pub struct Unwritable(pub String);

/// The values of all fields. A field without one is an empty text; a list has a line for each entry.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Values {
    /// By full name, for example `rights.uri`.
    pub fields: BTreeMap<String, String>,
    /// The blocks of repeated sections, by the names of these.
    pub blocks: BTreeMap<String, Vec<Block>>,
}

/// One block of a repeated section.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Which block of the file it was, from 0; a new one has none.
    #[serde(default)]
    pub from: Option<usize>,
    /// By name in the section, for example `orcid`.
    pub fields: BTreeMap<String, String>,
}

impl Block {
    fn is_empty(&self) -> bool {
        self.fields.values().all(|v| v.trim().is_empty())
    }
}

/// A mistake, where a form shows it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// `rights.uri`, `creators.1.orcid` (blocks count from 0); empty where no field of the form is meant.
    pub place: String,
    /// The full name of the field in the file, without a number.
    pub field: String,
    /// From 1.
    pub line: usize,
    /// What `kilwa metadata check` says of it.
    pub message: String,
    /// Whether the field is empty: a draft may be.
    pub is_missing: bool,
}

/// A metadata file, read for its values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Document {
    text: String,
    values: Values,
    /// Fields whose values have another type than they should (`creators.1.orcid`).
    mistyped: BTreeSet<String>,
}

impl Document {
    /// Read a file.
    ///
    /// # Errors
    /// [`NotToml`] with the line. Other mistakes are in [`Self::faults`].
    pub fn parse(text: &str) -> Result<Self, NotToml> {
        let doc = toml_edit::Document::parse(without_bom(text)).map_err(|e| NotToml {
            line: e.span().map_or(1, |s| line_of(without_bom(text), s.start)),
            message: e.message().to_owned(),
        })?;
        let (mut values, mut mistyped) = (Values::default(), BTreeSet::new());
        for section in &SECTIONS {
            if section.is_repeated {
                let blocks = rewrite::blocks(doc.as_table(), section.path);
                for (at, spot) in blocks.iter().enumerate() {
                    let wrong = section.fields.iter().filter(|f| rewrite::is_mistyped(spot.table, f));
                    mistyped.extend(wrong.map(|f| format!("{}.{at}.{}", section.path, f.key)));
                }
                let read = |(at, spot): (usize, &Spot<'_>)| Block {
                    from: Some(at),
                    fields: section.fields.iter().map(|f| (f.key.to_owned(), shown(spot.table, f))).collect(),
                };
                values.blocks.insert(section.path.to_owned(), blocks.iter().enumerate().map(read).collect());
            } else {
                let spot = rewrite::single(doc.as_table(), section.path);
                for f in section.fields {
                    let (name, table) = (section.name_of(f.key), spot.as_ref().map(|spot| spot.table));
                    if table.is_some_and(|table| rewrite::is_mistyped(table, f)) {
                        mistyped.insert(name.clone());
                    }
                    values.fields.insert(name, table.map(|table| shown(table, f)).unwrap_or_default());
                }
            }
        }
        Ok(Self { text: text.to_owned(), values, mistyped })
    }

    /// The file.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// What its fields hold.
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// The same file with other values. Fields that are not in `wanted` keep theirs. If the values are `wanted` already, the text stays the
    /// same, byte for byte, except that values of a wrong type are written as the form writes them, and an empty `[access]` or `[photographs]`
    /// is left out.
    ///
    /// # Errors
    /// [`Unwritable`] names the field.
    pub fn with(&self, wanted: &Values) -> Result<Self, Unwritable> {
        let mut text = self.text.clone();
        for section in SECTIONS.iter().filter(|s| !s.is_repeated) {
            for f in section.fields {
                let name = section.name_of(f.key);
                let (old, new) = (self.value(&name), wanted.fields.get(&name).map_or("", String::as_str));
                if wanted.fields.contains_key(&name) && needs_change(f, old, new, self.mistyped.contains(&name)) {
                    text = rewrite::set(&text, section, None, f, &tidy(f.kind, new)).ok_or(Unwritable(name))?;
                }
            }
            // The check refuses these two without a value.
            let is_refused_empty = matches!(section.path, "access" | "photographs");
            if is_refused_empty || !matches!(section.path, "" | "rights" | "model") && self.has_value_in(section) {
                text = rewrite::without_empty_header(&text, section.path);
            }
        }
        for (path, blocks) in &wanted.blocks {
            let Some(section) = section(path).filter(|s| s.is_repeated) else { continue };
            text = self.with_blocks(&text, section, blocks).ok_or_else(|| Unwritable(path.clone()))?;
        }
        let made = Self::parse(&text).map_err(|_| Unwritable(String::new()))?;
        match made.differs_from(self, wanted) {
            Some(name) => Err(Unwritable(name)),
            None => Ok(made),
        }
    }

    /// What is wrong with the file, by the code of `kilwa metadata check`: of each field of the form the first mistake.
    pub fn faults(&self) -> Vec<Fault> {
        let problems = Metadata::parse(&self.text).err().map(|p| p.0).unwrap_or_default();
        let strays = lines::strays(without_bom(&self.text));
        let mut faults: Vec<Fault> = Vec::new();
        for problem in &problems {
            let mut fault = self.fault(problem);
            if strays.contains(problem) {
                // Its field in the form is empty, and filling that in would not remove it.
                (fault.place, fault.is_missing) = (String::new(), false);
            }
            // An unusable value makes others wrong too: a latitude needs a longitude.
            if fault.place.is_empty() || faults.iter().all(|other| other.place != fault.place) {
                faults.push(fault);
            }
        }
        faults
    }

    fn fault(&self, problem: &Problem) -> Fault {
        // A section that is missing is missing for its one required field.
        let field = match problem.field.as_str() {
            "rights" => "rights.uri",
            "model" => "model.units",
            other => other,
        };
        let place = self.place_of(field, problem);
        let value = place.as_deref().and_then(|place| self.value_at(place)).unwrap_or_default();
        Fault {
            field: field.to_owned(),
            line: problem.line,
            message: problem.message.clone(),
            is_missing: place.is_some() && value.trim().is_empty(),
            place: place.unwrap_or_default(),
        }
    }

    /// Where a form shows a field that has a mistake.
    fn place_of(&self, field: &str, problem: &Problem) -> Option<String> {
        if self.values.fields.contains_key(field) {
            return Some(field.to_owned());
        }
        let (path, key) = field.rsplit_once('.')?;
        let section = section(path).filter(|s| s.is_repeated && s.fields.iter().any(|f| f.key == key))?;
        let text = without_bom(&self.text);
        let doc = toml_edit::Document::parse(text).ok()?;
        let blocks = rewrite::blocks(doc.as_table(), section.path);
        let lines: Vec<usize> = blocks.iter().map(|spot| line_of(text, spot.start())).collect();
        let last = lines.iter().rposition(|line| *line <= problem.line)?;
        // Several blocks can be on one line: `creators = [{ … }, { … }]`.
        let all: Vec<usize> = (0..=last).filter(|at| lines[*at] == lines[last]).collect();
        let place = |at: usize| format!("{path}.{at}.{key}");
        let is_named = |at: &&usize| {
            let value = self.value_at(&place(**at)).unwrap_or_default();
            !value.is_empty() && problem.message.contains(&format!("\"{value}\""))
        };
        let is_empty = |at: &&usize| self.value_at(&place(**at)).is_some_and(str::is_empty);
        let at = all.iter().find(is_named).or_else(|| all.iter().find(is_empty)).copied().unwrap_or(last);
        Some(place(at))
    }

    fn value(&self, name: &str) -> &str {
        self.values.fields.get(name).map_or("", String::as_str)
    }

    fn value_at(&self, place: &str) -> Option<&str> {
        if let Some(value) = self.values.fields.get(place) {
            return Some(value);
        }
        let (rest, key) = place.rsplit_once('.')?;
        let (path, at) = rest.rsplit_once('.')?;
        let block = self.values.blocks.get(path)?.get(at.parse::<usize>().ok()?)?;
        block.fields.get(key).map(String::as_str)
    }

    fn has_value_in(&self, section: &Section) -> bool {
        section.fields.iter().any(|f| !self.value(&section.name_of(f.key)).is_empty())
    }

    /// The text with these blocks of a section. `None` where it is written in a way that prevents it.
    fn with_blocks(&self, text: &str, section: &Section, wanted: &[Block]) -> Option<String> {
        let none = Vec::new();
        let before = self.values.blocks.get(section.path).unwrap_or(&none);
        // New blocks that were left empty are ignored.
        let wanted: Vec<&Block> = wanted.iter().filter(|b| b.from.is_some() || !b.is_empty()).collect();
        let mut text = text.to_owned();
        for block in &wanted {
            let Some(at) = block.from else { continue };
            let old = before.get(at)?;
            for f in section.fields {
                let (old, new) = (value_of(old, f), value_of(block, f));
                let is_mistyped = self.mistyped.contains(&format!("{}.{at}.{}", section.path, f.key));
                if needs_change(f, old, new, is_mistyped) {
                    text = rewrite::set(&text, section, Some(at), f, &tidy(f.kind, new))?;
                }
            }
        }
        let kept: Vec<usize> = wanted.iter().filter_map(|b| b.from).collect();
        let is_unchanged = kept.iter().copied().eq(0..before.len());
        if !is_unchanged {
            text = rewrite::arrange(&text, section.path, &kept)?;
        }
        let mut last = kept.len();
        for block in wanted.iter().filter(|b| b.from.is_none()) {
            let filled = section.fields.iter().map(|f| (f, tidy(f.kind, value_of(block, f))));
            text = rewrite::append(&text, section, &filled.filter(|(_, v)| !v.is_empty()).collect::<Vec<_>>())?;
            last += 1;
        }
        // New ones were put after the others; now everything goes where it belongs.
        let mut next = kept.len();
        let mut old = 0..kept.len();
        let order: Vec<usize> = wanted
            .iter()
            .filter_map(|b| {
                if b.from.is_some() {
                    return old.next();
                }
                next += 1;
                Some(next - 1)
            })
            .collect();
        if order.iter().copied().eq(0..last) { Some(text) } else { rewrite::arrange(&text, section.path, &order) }
    }

    /// The name of a field that does not hold what was wanted, compared with the file before.
    fn differs_from(&self, before: &Self, wanted: &Values) -> Option<String> {
        for section in &SECTIONS {
            for f in section.fields.iter().filter(|_| !section.is_repeated) {
                let name = section.name_of(f.key);
                let want = wanted.fields.get(&name).map_or(before.value(&name), String::as_str);
                if !is_same(f, self.value(&name), want) {
                    return Some(name);
                }
            }
            if section.is_repeated {
                let Some(want) = wanted.blocks.get(section.path).or(before.values.blocks.get(section.path)) else {
                    continue;
                };
                let want: Vec<&Block> = want.iter().filter(|b| b.from.is_some() || !b.is_empty()).collect();
                let have = self.values.blocks.get(section.path).map_or(&[][..], Vec::as_slice);
                let same = |(a, b): (&Block, &&Block)| {
                    section.fields.iter().all(|f| is_same(f, value_of(a, f), value_of(b, f)))
                };
                if have.len() != want.len() || !have.iter().zip(&want).all(same) {
                    return Some(section.path.to_owned());
                }
            }
        }
        None
    }
}

/// The line of an offset in bytes, from 1.
fn line_of(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|b| *b == b'\n').count() + 1
}

/// Windows editors put a byte order mark first.
pub(super) fn without_bom(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

fn value_of<'b>(block: &'b Block, field: &Field) -> &'b str {
    block.fields.get(field.key).map_or("", String::as_str)
}

/// A value as it would be written: no space around it, no empty entries in a list.
fn tidy(kind: Kind, value: &str) -> String {
    let value = value.replace("\r\n", "\n");
    match kind {
        Kind::List => value.lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join("\n"),
        _ => value.trim().to_owned(),
    }
}

fn is_same(field: &Field, a: &str, b: &str) -> bool {
    let (a, b) = (tidy(field.kind, a), tidy(field.kind, b));
    let number = |text: &str| text.parse::<f64>().ok();
    a == b || field.kind == Kind::Number && number(&a).is_some_and(|a| number(&b) == Some(a))
}

/// Whether a value has to be written: it is another one, or its type is wrong and can be put right.
fn needs_change(field: &Field, old: &str, new: &str, is_mistyped: bool) -> bool {
    let can_be_typed = match field.kind {
        Kind::Number => new.trim().parse::<f64>().is_ok(),
        _ => !new.trim().is_empty(),
    };
    !is_same(field, old, new) || is_mistyped && can_be_typed
}

/// What a form shows of a field.
fn shown(table: &dyn TableLike, field: &Field) -> String {
    let Some(item) = table.get(field.key) else { return String::new() };
    match item.as_value() {
        Some(Value::Array(list)) => {
            list.iter().filter_map(text_of).map(|t| tidy(Kind::Line, &t)).collect::<Vec<_>>().join("\n")
        }
        Some(value) => text_of(value).map(|text| text.replace("\r\n", "\n")).unwrap_or_default(),
        None => String::new(),
    }
}

fn text_of(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.value().clone()),
        Value::Integer(n) => Some(n.value().to_string()),
        Value::Float(n) => Some(n.value().to_string()),
        Value::Boolean(is) => Some(is.value().to_string()),
        Value::Datetime(date) => Some(date.value().to_string()),
        Value::Array(_) | Value::InlineTable(_) => None,
    }
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
