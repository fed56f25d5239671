//! Tables of a TOML file with the line of everything, read field by field: what was not asked for at the end is unknown.
//!
//! Reading never fails at once: mistakes are collected, and a field that is wrong counts as absent.

use crate::problem::{Problem, nearest};
use std::cell::RefCell;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Longest text of one line, bytes.
const LINE_MAX: usize = 1000;
/// Longest text of several lines, bytes.
const TEXT_MAX: usize = 50_000;
/// Most entries of a list, if the caller allows no more.
const LIST_MAX: usize = 1000;

/// The file, and what is wrong with it.
pub struct File<'a> {
    text: &'a str,
    examples: &'a [&'a str],
    list_max: usize,
    problems: RefCell<Vec<Problem>>,
}

impl<'a> File<'a> {
    /// The file with this text.
    pub fn new(text: &'a str) -> Self {
        Self { text, examples: &[], list_max: LIST_MAX, problems: RefCell::default() }
    }

    /// Texts that count as examples of a template that nobody replaced, besides those between < and >.
    #[must_use]
    pub fn with_examples(self, examples: &'a [&'a str]) -> Self {
        Self { examples, ..self }
    }

    /// The most entries that a list may have.
    #[must_use]
    pub fn with_list_max(self, list_max: usize) -> Self {
        Self { list_max, ..self }
    }

    /// The line of an offset in bytes; the first is 1.
    pub fn line(&self, at: usize) -> usize {
        self.text.bytes().take(at).filter(|b| *b == b'\n').count() + 1
    }

    /// Note what is wrong with a field that begins at this offset.
    pub fn problem(&self, at: usize, field: &str, message: impl Into<String>) {
        self.problems.borrow_mut().push(Problem::new(self.line(at), field, message));
    }

    /// The problems, by line.
    pub fn into_problems(self) -> Vec<Problem> {
        let mut problems = self.problems.into_inner();
        problems.sort_by_key(|p| p.line);
        // A value that is still an example counts as absent, but is not also reported as missing.
        let examples: Vec<(usize, String)> =
            problems.iter().filter(|p| p.is_example).map(|p| (p.line, p.field.clone())).collect();
        problems.retain(|p| p.is_example || !examples.contains(&(p.line, p.field.clone())));
        problems
    }
}

/// A value that was checked, and its place in the file.
pub struct Found<T> {
    /// Offset of its key in bytes.
    pub at: usize,
    /// The value.
    pub value: T,
}

/// One table.
pub struct Table<'a, 'i> {
    file: &'a File<'a>,
    name: String,
    at: usize,
    entries: &'a DeTable<'i>,
    known: RefCell<Vec<&'static str>>,
}

impl<'a, 'i> Table<'a, 'i> {
    /// The table `name` of a file, which begins at this offset.
    pub fn new(file: &'a File<'a>, name: &str, at: usize, table: &'a DeTable<'i>) -> Self {
        Self { file, name: name.to_owned(), at, entries: table, known: RefCell::default() }
    }

    /// The full name of a field.
    pub fn field(&self, key: &str) -> String {
        if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) }
    }

    /// Say what is wrong with a field.
    pub fn wrong(&self, key: &str, at: usize, message: impl Into<String>) {
        self.file.problem(at, &self.field(key), message);
    }

    /// Say that a field is wanted.
    pub fn missing(&self, key: &str, message: &str) {
        let at = self.entry(key).map_or(self.at, |(at, _)| at);
        self.wrong(key, at, message);
    }

    fn entry(&self, key: &str) -> Option<(usize, &'a Spanned<DeValue<'i>>)> {
        let (k, value) = self.entries.iter().find(|(k, _)| k.get_ref().as_ref() == key)?;
        Some((k.span().start, value))
    }

    fn get(&self, key: &'static str) -> Option<(usize, &'a Spanned<DeValue<'i>>)> {
        self.known.borrow_mut().push(key);
        self.entry(key)
    }

    /// A text of one line; one that is empty counts as absent.
    pub fn text(&self, key: &'static str) -> Option<Found<String>> {
        let (at, value) = self.get(key)?;
        self.as_text(key, at, value.get_ref(), false).map(|value| Found { at, value })
    }

    /// A text with line breaks.
    pub fn paragraphs(&self, key: &'static str) -> Option<String> {
        let (at, value) = self.get(key)?;
        self.as_text(key, at, value.get_ref(), true)
    }

    /// Whether the value is still an example of the template, which is then reported.
    fn is_example(&self, key: &str, at: usize, value: &DeValue<'_>) -> bool {
        let DeValue::String(text) = value else { return false };
        let text = text.trim();
        let is_example =
            text.len() > 2 && text.starts_with('<') && text.ends_with('>') || self.file.examples.contains(&text);
        if is_example {
            let message = format!(
                "{text} is still the example from the template; replace it, without < and >, or put a # at the start of the line"
            );
            let problem = Problem::new(self.file.line(at), self.field(key), message);
            self.file.problems.borrow_mut().push(Problem { is_example: true, ..problem });
        }
        is_example
    }

    fn as_text(&self, key: &str, at: usize, value: &DeValue<'_>, is_long: bool) -> Option<String> {
        if self.is_example(key, at, value) {
            return None;
        }
        let text = match value {
            DeValue::String(text) => text.trim().replace("\r\n", "\n"),
            // Dates may be written without quotation marks.
            DeValue::Datetime(date) => date.to_string(),
            other => {
                self.wrong(key, at, format!("expected a text in quotation marks, not {}", kind(other)));
                return None;
            }
        };
        let max = if is_long { TEXT_MAX } else { LINE_MAX };
        if text.len() > max {
            self.wrong(key, at, format!("it is {} bytes long; at most {max} are allowed", text.len()));
            return None;
        }
        if let Some(c) = text.chars().find(|c| c.is_control() && !(is_long && matches!(c, '\n' | '\t'))) {
            let what =
                if c == '\n' { "a line break".to_owned() } else { format!("the control character U+{:04X}", c as u32) };
            self.wrong(key, at, format!("it must not contain {what}"));
            return None;
        }
        Some(text).filter(|t| !t.is_empty())
    }

    /// A list of texts; one text counts as a list of one.
    pub fn texts(&self, key: &'static str) -> Vec<String> {
        let Some((at, value)) = self.get(key) else { return Vec::new() };
        let DeValue::Array(list) = value.get_ref() else {
            return self.as_text(key, at, value.get_ref(), false).into_iter().collect();
        };
        if list.len() > self.file.list_max {
            self.wrong(key, at, format!("{} entries; at most {} are allowed", list.len(), self.file.list_max));
            return Vec::new();
        }
        list.iter().filter_map(|v| self.as_text(key, v.span().start, v.get_ref(), false)).collect()
    }

    /// A finite number.
    pub fn number(&self, key: &'static str) -> Option<Found<f64>> {
        let (at, value) = self.get(key)?;
        if self.is_example(key, at, value.get_ref()) {
            return None;
        }
        self.as_number(key, at, value.get_ref()).map(|value| Found { at, value })
    }

    fn as_number(&self, key: &str, at: usize, value: &DeValue<'_>) -> Option<f64> {
        let number = match value {
            DeValue::Integer(n) => i64::from_str_radix(&n.as_str().replace('_', ""), n.radix()).ok().map(|n| n as f64),
            DeValue::Float(n) => n.as_str().replace('_', "").parse::<f64>().ok().filter(|n| n.is_finite()),
            other => {
                self.wrong(key, at, format!("expected a number without quotation marks, not {}", kind(other)));
                return None;
            }
        };
        if number.is_none() {
            self.wrong(key, at, "this number cannot be used");
        }
        number
    }

    /// A list of so many finite numbers.
    pub fn numbers<const N: usize>(&self, key: &'static str) -> Option<Found<[f64; N]>> {
        let (at, value) = self.get(key)?;
        let DeValue::Array(list) = value.get_ref() else {
            self.wrong(key, at, format!("expected a list of {N} numbers, not {}", kind(value.get_ref())));
            return None;
        };
        if list.len() != N {
            self.wrong(key, at, format!("expected a list of {N} numbers; it has {}", list.len()));
            return None;
        }
        let mut numbers = [0.0; N];
        for (number, value) in numbers.iter_mut().zip(list) {
            *number = self.as_number(key, value.span().start, value.get_ref())?;
        }
        Some(Found { at, value: numbers })
    }

    /// `true` or `false`.
    pub fn truth(&self, key: &'static str) -> Option<bool> {
        let (at, value) = self.get(key)?;
        if let DeValue::Boolean(is) = value.get_ref() {
            return Some(*is);
        }
        self.wrong(key, at, format!("expected true or false, not {}", kind(value.get_ref())));
        None
    }

    /// A whole number of 0 or more.
    pub fn count(&self, key: &'static str) -> Option<Found<u64>> {
        let found = self.number(key)?;
        if found.value < 0.0 || found.value.fract() != 0.0 || found.value > 2f64.powi(53) {
            self.wrong(key, found.at, "expected a whole number of 0 or more");
            return None;
        }
        Some(Found { at: found.at, value: found.value as u64 })
    }

    /// Whether a field is there, right or wrong.
    pub fn has(&self, key: &str) -> bool {
        self.entry(key).is_some()
    }

    /// Whether a field is there and is a table.
    pub fn is_table(&self, key: &str) -> bool {
        self.entry(key).is_some_and(|(_, value)| matches!(value.get_ref(), DeValue::Table(_)))
    }

    /// The line of a field; of the table where the field is not there.
    pub fn line(&self, key: &str) -> usize {
        self.file.line(self.entry(key).map_or(self.at, |(at, _)| at))
    }

    /// Where the table begins, an offset in bytes.
    pub fn at(&self) -> usize {
        self.at
    }

    /// One of several words.
    pub fn word<T: Copy>(&self, key: &'static str, words: &[(&'static str, T)]) -> Option<T> {
        let found = self.text(key)?;
        let known = words.iter().find(|(word, _)| *word == found.value);
        if known.is_none() {
            let all: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
            self.wrong(key, found.at, format!("\"{}\" is unknown; write one of {}", found.value, all.join(", ")));
        }
        known.map(|(_, value)| *value)
    }

    /// A table in this one.
    pub fn table(&self, key: &'static str) -> Option<Table<'a, 'i>> {
        let (at, value) = self.get(key)?;
        if let DeValue::Table(table) = value.get_ref() {
            return Some(Table::new(self.file, &self.field(key), at, table));
        }
        self.wrong(key, at, format!("write [{}] on a line of its own, and its fields below", self.field(key)));
        None
    }

    /// Tables of the same name, `[[creators]]`; one table counts as a list of one.
    pub fn tables(&self, key: &'static str) -> Vec<Table<'a, 'i>> {
        let Some((at, value)) = self.get(key) else { return Vec::new() };
        let name = self.field(key);
        let wanted = |at| self.wrong(key, at, format!("write [[{name}]] on a line of its own, and its fields below"));
        match value.get_ref() {
            DeValue::Table(table) => vec![Table::new(self.file, &name, at, table)],
            DeValue::Array(list) if list.len() > self.file.list_max => {
                self.wrong(key, at, format!("{} entries; at most {} are allowed", list.len(), self.file.list_max));
                Vec::new()
            }
            DeValue::Array(list) => {
                let table = |v: &'a Spanned<DeValue<'i>>| {
                    let DeValue::Table(table) = v.get_ref() else {
                        wanted(v.span().start);
                        return None;
                    };
                    Some(Table::new(self.file, &name, v.span().start, table))
                };
                list.iter().filter_map(table).collect()
            }
            _ => {
                wanted(at);
                Vec::new()
            }
        }
    }

    /// Everything was asked for: name what nobody knows.
    pub fn finish(self) {
        let known = self.known.borrow();
        for (key, _) in self.entries {
            let name = key.get_ref().as_ref();
            if known.contains(&name) {
                continue;
            }
            let hint = match nearest(name, known.iter().copied()) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None => format!("{} has {}", self.place(), known.join(", ")),
            };
            self.wrong(name, key.span().start, format!("there is no such field; {hint}"));
        }
    }

    fn place(&self) -> String {
        if self.name.is_empty() { "the file".to_owned() } else { format!("[{}]", self.name) }
    }
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}
