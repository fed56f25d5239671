//! Changes to the text of a metadata file, one at a time: a value, another block, blocks in another order. Everything else stays as it is.
//!
//! Each function reads the text, finds the place in it and returns the changed text; `None` where the file is written in a way that does not
//! allow the change without losing something. A field or block that the template has as a comment is uncommented in place, below its
//! explanation.

use super::document::without_bom;
use super::lines;
use super::schema::{Field, Kind, Section};
use super::template::quoted;
use std::ops::Range;
use toml_edit::{Array, Document, Item, Table, TableLike, Value};

/// A table in a text.
pub(super) struct Spot<'d> {
    /// What is in it.
    pub(super) table: &'d dyn TableLike,
    form: Form,
}

/// How a table is written.
#[derive(Debug, Clone, PartialEq)]
enum Form {
    /// The top of the file.
    Root,
    /// Below a header, which is here.
    Header(Range<usize>),
    /// `{ … }`, which is here.
    Inline(Range<usize>),
    /// `rights.uri = …` in the table around it.
    Dotted(String),
    /// Only its blocks are there: `[[capture.steps]]` without `[capture]`.
    Implicit,
}

impl Spot<'_> {
    /// Where it begins, an offset in bytes.
    pub(super) fn start(&self) -> usize {
        match &self.form {
            Form::Header(at) | Form::Inline(at) => at.start,
            _ => 0,
        }
    }
}

/// The table of a section that is there once.
pub(super) fn single<'d>(root: &'d Table, path: &str) -> Option<Spot<'d>> {
    if path.is_empty() {
        return Some(Spot { table: root, form: Form::Root });
    }
    spot(root.get(path)?, path)
}

fn spot<'d>(item: &'d Item, path: &str) -> Option<Spot<'d>> {
    match item {
        Item::Table(table) => Some(Spot { table, form: form_of(table, path) }),
        Item::Value(Value::InlineTable(table)) => Some(Spot { table, form: Form::Inline(table.span()?) }),
        _ => None,
    }
}

fn form_of(table: &Table, path: &str) -> Form {
    match table.span() {
        _ if table.is_dotted() => Form::Dotted(path.to_owned()),
        Some(at) if !table.is_implicit() => Form::Header(at),
        _ => Form::Implicit,
    }
}

/// The item of a repeated section.
fn repeated<'d>(root: &'d Table, path: &str) -> Option<&'d Item> {
    match path.split_once('.') {
        None => root.get(path),
        Some((first, rest)) => root.get(first)?.as_table_like()?.get(rest),
    }
}

/// The blocks of a repeated section, in their order.
pub(super) fn blocks<'d>(root: &'d Table, path: &str) -> Vec<Spot<'d>> {
    match repeated(root, path) {
        Some(Item::ArrayOfTables(all)) => all.iter().map(|table| Spot { table, form: form_of(table, path) }).collect(),
        Some(Item::Value(Value::Array(list))) => list
            .iter()
            .filter_map(|value| {
                let table = value.as_inline_table()?;
                Some(Spot { table, form: Form::Inline(table.span()?) })
            })
            .collect(),
        Some(item) => spot(item, path).into_iter().collect(),
        None => Vec::new(),
    }
}

/// Whether the value of a field has a type that the check refuses: a number between quotation marks, a year without.
pub(super) fn is_mistyped(table: &dyn TableLike, field: &Field) -> bool {
    let Some(value) = table.get(field.key).and_then(Item::as_value) else { return false };
    let is_text = |value: &Value| value.is_str() || value.is_datetime();
    match (field.kind, value) {
        (Kind::Number, value) => value.is_str(),
        (Kind::List, Value::Array(list)) => !list.iter().all(is_text),
        (_, value) => !is_text(value),
    }
}

/// What separates lines: `\r\n` where the file has it.
pub(super) fn newline(text: &str) -> &'static str {
    if text.contains("\r\n") { "\r\n" } else { "\n" }
}

/// A text and where everything is in it.
struct Located<'t> {
    text: &'t str,
    doc: Document<&'t str>,
}

impl<'t> Located<'t> {
    fn new(text: &'t str) -> Option<Self> {
        Some(Self { text, doc: Document::parse(text).ok()? })
    }

    /// The end of the line of an offset, including its line break.
    fn line_end(&self, at: usize) -> usize {
        self.text[at..].find('\n').map_or(self.text.len(), |n| at + n + 1)
    }

    fn line_start(&self, at: usize) -> usize {
        self.text[..at].rfind('\n').map_or(0, |n| n + 1)
    }

    /// The lines from an offset, which begins one, up to another: where each begins, and what it says.
    fn lines(&self, range: Range<usize>) -> impl Iterator<Item = (usize, &'t str)> {
        let mut at = range.start;
        let text = self.text;
        text[range].split_inclusive('\n').map(move |line| {
            let here = at;
            at += line.len();
            (here, line.trim())
        })
    }

    /// Where the next header after an offset begins, or the end of the file.
    fn next_header(&self, after: usize) -> usize {
        let mut all = Vec::new();
        headers(self.doc.as_table(), &mut all);
        all.into_iter().filter(|at| *at >= after).map(|at| self.line_start(at)).min().unwrap_or(self.text.len())
    }

    /// Everything that is written as a value, which may look like lines of a file.
    fn values(&self) -> Vec<Range<usize>> {
        let mut all = Vec::new();
        values(self.doc.as_table(), &mut all);
        all
    }

    /// Lines that are comments, in a range.
    fn comments(&self, range: Range<usize>) -> Vec<(usize, &'t str)> {
        let values = self.values();
        let is_outside = |at: usize| values.iter().all(|v| !(v.start < at && at < v.end));
        let all = self.lines(range).filter(|(at, line)| line.starts_with('#') && is_outside(*at));
        all.map(|(at, line)| (at, line.trim_start_matches('#').trim())).collect()
    }
}

fn headers(table: &dyn TableLike, all: &mut Vec<usize>) {
    let mut add = |table: &Table| {
        if !table.is_implicit() && !table.is_dotted() {
            all.extend(table.span().map(|s| s.start));
        }
        headers(table, all);
    };
    for (_, item) in table.iter() {
        match item {
            Item::Table(table) => add(table),
            Item::ArrayOfTables(tables) => tables.iter().for_each(&mut add),
            _ => {}
        }
    }
}

fn values(table: &dyn TableLike, all: &mut Vec<Range<usize>>) {
    for (_, item) in table.iter() {
        match item {
            Item::Table(table) => values(table, all),
            Item::ArrayOfTables(tables) => tables.iter().for_each(|table| values(table, all)),
            Item::Value(value) => all.extend(value.span()),
            Item::None => {}
        }
    }
}

/// Everything that is written as a value in one table, without the blocks below it.
fn own_values(table: &dyn TableLike) -> Vec<Range<usize>> {
    let mut all = Vec::new();
    for (_, item) in table.iter() {
        match item {
            Item::Table(table) if table.is_dotted() => all.extend(own_values(table)),
            Item::Value(value) => all.extend(value.span()),
            _ => {}
        }
    }
    all
}

/// The text with something else in a place.
fn replaced(text: &str, range: Range<usize>, by: &str) -> String {
    format!("{}{by}{}", &text[..range.start], &text[range.end..])
}

/// Do something with a text without its byte order mark, which stays.
fn after_bom(text: &str, change: impl FnOnce(&str) -> Option<String>) -> Option<String> {
    let bare = without_bom(text);
    Some(format!("{}{}", &text[..text.len() - bare.len()], change(bare)?))
}

/// A field with another value, which is tidy; an empty one removes it. `block`: of a repeated section, which one.
pub(super) fn set(text: &str, section: &Section, block: Option<usize>, field: &Field, value: &str) -> Option<String> {
    after_bom(text, |text| set_in(text, section, block, field, value))
}

fn set_in(text: &str, section: &Section, block: Option<usize>, field: &Field, value: &str) -> Option<String> {
    let located = Located::new(text)?;
    let root = located.doc.as_table();
    let place = match block {
        Some(at) => Some(blocks(root, section.path).into_iter().nth(at)?),
        None => single(root, section.path),
    };
    match place {
        Some(Spot { form: Form::Implicit, .. }) | None => {
            if repeated(root, section.path).is_some_and(|item| !item.is_table()) {
                return None;
            }
            if value.is_empty() {
                return Some(text.to_owned());
            }
            let begun = begin(&located, section);
            set_in(&begun, section, block, field, value)
        }
        Some(spot) => match (spot.table.get(field.key), value) {
            (None, "") => Some(text.to_owned()),
            (Some(_), "") => clear(&located, &spot, field),
            (Some(item), _) => replace_value(text, item, field.kind, value),
            (None, _) => insert(&located, &spot, field, value),
        },
    }
}

fn replace_value(text: &str, item: &Item, kind: Kind, value: &str) -> Option<String> {
    let old = item.as_value()?;
    if let (Kind::List, Value::Array(list)) = (kind, old)
        && !list.is_empty()
    {
        return replace_list(text, list, value);
    }
    Some(replaced(text, old.span()?, &written(kind, value, newline(text))))
}

/// Only the entries that differ are written again, so that comments beside the others stay.
fn replace_list(text: &str, list: &Array, value: &str) -> Option<String> {
    let spans: Vec<Range<usize>> = list.iter().map(Value::span).collect::<Option<_>>()?;
    let old: Vec<Option<&str>> = list.iter().map(|v| v.as_str().map(str::trim)).collect();
    let new: Vec<&str> = value.lines().collect();
    let same = |(a, b): &(Option<&str>, &str)| *a == Some(*b);
    let head = old.iter().copied().zip(new.iter().copied()).take_while(same).count();
    let rest = old.len().min(new.len()) - head;
    let tail = old.iter().copied().rev().zip(new.iter().copied().rev()).take(rest).take_while(same).count();
    let end = old.len() - tail;
    let middle: Vec<String> = new[head..new.len() - tail].iter().map(|entry| quoted(entry)).collect();
    let (replacing, added) = middle.split_at(middle.len().min(end - head));
    let first_left = head + replacing.len();
    let mut changed = text.to_owned();
    // From the last to the first, so that the places of the others stay right.
    for at in (first_left..end).rev() {
        changed = without_entry(&changed, &spans, at);
    }
    if !added.is_empty() {
        changed = with_entries(&changed, list, &spans, first_left, added)?;
    }
    for (at, entry) in (head..first_left).zip(replacing).rev() {
        changed = replaced(&changed, spans[at].clone(), entry);
    }
    Some(changed)
}

/// A list without one entry; comments beside it stay.
fn without_entry(text: &str, spans: &[Range<usize>], at: usize) -> String {
    let Range { start, end } = spans[at].clone();
    let blank = |text: &str| text.len() - text.trim_start_matches([' ', '\t']).len();
    let comma = end + blank(&text[end..]);
    if !text[comma..].starts_with(',') {
        if text[comma..].starts_with('#') {
            return replaced(text, start..comma, "");
        }
        let before = at.checked_sub(1).map_or(start, |before| spans[before].end);
        let start = if text[before..start].contains('#') { start } else { before };
        return replaced(text, start..end, "");
    }
    let after = comma + 1 + blank(&text[comma + 1..]);
    let line = text[..start].rfind('\n').map_or(0, |n| n + 1);
    let rest = &text[after..];
    match text[line..start].trim().is_empty().then(|| rest.strip_prefix("\r\n").or(rest.strip_prefix('\n'))).flatten() {
        Some(next) => replaced(text, line..text.len() - next.len(), ""),
        None => replaced(text, start..after, ""),
    }
}

/// A list with more entries before the one at `at`, or at its end. Comments stay beside the entry before.
fn with_entries(text: &str, list: &Array, spans: &[Range<usize>], at: usize, added: &[String]) -> Option<String> {
    let end = newline(text);
    let next = spans.get(at).map(|span| span.start);
    let Some(before) = at.checked_sub(1).map(|before| spans[before].clone()) else {
        let next = next?;
        let gap = match spans.get(1) {
            Some(second) if text[spans[0].end..second.start].contains('\n') => format!(",{end}{}", indent(text, next)),
            _ => ", ".to_owned(),
        };
        return Some(replaced(text, next..next, &format!("{}{gap}", added.join(&gap))));
    };
    let between = &text[before.end..next.map_or_else(|| list.span().map(|s| s.end - 1), Some)?];
    let is_on_lines = between.contains('\n');
    let has_comma = between.trim_start().starts_with(',');
    if !is_on_lines || !has_comma && !between.contains('#') {
        let gap = if is_on_lines { format!(",{end}{}", indent(text, before.start)) } else { ", ".to_owned() };
        return Some(replaced(text, before.end..before.end, &format!("{gap}{}", added.join(&gap))));
    }
    // On lines of their own, behind a comment on the line of the entry before.
    let line = before.end + between.find('\n')? + 1;
    let indent = indent(text, before.start);
    let last = if next.is_some() || has_comma { "," } else { "" };
    let lines = format!("{indent}{}{last}{end}", added.join(&format!(",{end}{indent}")));
    let text = replaced(text, line..line, &lines);
    Some(if has_comma { text } else { replaced(&text, before.end..before.end, ",") })
}

/// What stands before a place in its line, if that is only space.
fn indent(text: &str, at: usize) -> &str {
    let before = &text[text[..at].rfind('\n').map_or(0, |n| n + 1)..at];
    if before.trim().is_empty() { before } else { "" }
}

/// Remove a field; one that is required stays, empty, so that whoever opens the file sees it.
fn clear(located: &Located<'_>, spot: &Spot<'_>, field: &Field) -> Option<String> {
    let text = located.text;
    let (key, item) = spot.table.get_key_value(field.key)?;
    let (key, value) = (key.span()?, item.as_value()?.span()?);
    if field.is_required {
        return Some(replaced(text, value, "\"\""));
    }
    if matches!(spot.form, Form::Inline(_)) {
        return clear_inline(text, spot, field);
    }
    let start = located.line_start(key.start);
    let end = located.line_end(value.end);
    let behind = text[value.end..end].trim();
    // A comment on the line stays.
    let by = if behind.is_empty() { String::new() } else { format!("{behind}{}", newline(text)) };
    Some(replaced(text, start..end, &by))
}

fn clear_inline(text: &str, spot: &Spot<'_>, field: &Field) -> Option<String> {
    let mut entries = Vec::new();
    for (key, _) in spot.table.iter() {
        let (name, item) = spot.table.get_key_value(key)?;
        entries.push((key, name.span()?.start..item.span()?.end));
    }
    let at = entries.iter().position(|(key, _)| *key == field.key)?;
    let here = entries[at].1.clone();
    let range = match (at.checked_sub(1).map(|before| &entries[before].1), entries.get(at + 1)) {
        (_, Some((_, next))) => here.start..next.start,
        (Some(before), None) => before.end..here.end,
        (None, None) => here,
    };
    Some(replaced(text, range, ""))
}

/// Add a field: in place of the comment that the template has for it, else behind the last one of its table.
fn insert(located: &Located<'_>, spot: &Spot<'_>, field: &Field, value: &str) -> Option<String> {
    let text = located.text;
    let end = newline(text);
    let value = written(field.kind, value, end);
    let own = own_values(spot.table);
    let last = own.iter().map(|v| v.end).max();
    let (key, begin) = match &spot.form {
        Form::Inline(at) => {
            let (before, after) = match last {
                Some(last) => (last, format!(", {} = {value}", field.key)),
                None => (at.start + 1, format!(" {} = {value} ", field.key)),
            };
            return Some(replaced(text, before..before, &after));
        }
        Form::Implicit => return None,
        Form::Dotted(path) => {
            let at = located.line_end(last?);
            let line = format!("{path}.{} = {value}{end}", field.key);
            return Some(replaced(text, at..at, &with_end(text, at, &line, end)));
        }
        Form::Root => (field.key, 0),
        Form::Header(at) => (field.key, located.line_end(at.end)),
    };
    let line = format!("{key} = {value}{end}");
    let region = begin..located.next_header(begin);
    let in_block =
        |comment: &&(usize, &str)| lines::header(comment.1).is_none_or(|name| lines::fields(&name).is_none());
    let comments = located.comments(region);
    if let Some((at, _)) = comments.iter().take_while(in_block).find(|(_, comment)| is_example(comment, key)) {
        return Some(replaced(text, *at..located.line_end(*at), &line));
    }
    let at = match last {
        Some(last) => located.line_end(last),
        None if spot.form == Form::Root => behind_first_comments(located),
        None => begin,
    };
    Some(replaced(text, at..at, &with_end(text, at, &line, end)))
}

/// A line that comes behind a last line without a line end.
fn with_end(text: &str, at: usize, line: &str, end: &str) -> String {
    if at == 0 || text[..at].ends_with('\n') { line.to_owned() } else { format!("{end}{line}") }
}

/// Whether a comment, without its `#`, is the template's example of a field.
fn is_example(comment: &str, key: &str) -> bool {
    let value = comment.strip_prefix(key).and_then(|rest| rest.trim_start().strip_prefix('='));
    value.map(str::trim).is_some_and(|v| (v.starts_with("\"<") || v.starts_with("[\"<")) && v.contains(">\""))
}

/// Behind the comments at the top of a file, if an empty line separates them from what follows.
fn behind_first_comments(located: &Located<'_>) -> usize {
    let mut lines = located.lines(0..located.text.len()).skip_while(|(_, line)| line.starts_with('#'));
    match lines.next() {
        Some((at, "")) => located.line_end(at),
        _ => 0,
    }
}

/// The text with the header of a section, which is not there: the template's comment, or at the end.
fn begin(located: &Located<'_>, section: &Section) -> String {
    let text = located.text;
    let header = if section.is_repeated { format!("[[{}]]", section.path) } else { format!("[{}]", section.path) };
    let values = located.values();
    let comments = located.comments(0..text.len());
    for (at, _) in comments.iter().filter(|(_, comment)| *comment == header) {
        let end = located.next_header(*at);
        // Fields behind it would become the section's.
        if values.iter().any(|v| *at < v.start && v.start < end) {
            continue;
        }
        return replaced(text, *at..located.line_end(*at), &format!("{header}{}", newline(text)));
    }
    let end = newline(text);
    let gap = match text {
        "" => String::new(),
        text if text.ends_with('\n') => end.to_owned(),
        _ => format!("{end}{end}"),
    };
    format!("{text}{gap}{header}{end}")
}

/// The text without the header of a section in which nothing is left.
pub(super) fn without_empty_header(text: &str, path: &str) -> String {
    let change = |text: &str| {
        let located = Located::new(text)?;
        let Form::Header(at) = single(located.doc.as_table(), path).filter(|s| s.table.is_empty())?.form else {
            return None;
        };
        // A comment on the line stays.
        let after = &text[at.end..located.line_end(at.end)];
        let by = if after.trim().is_empty() { "" } else { after.trim_start() };
        Some(replaced(text, located.line_start(at.start)..located.line_end(at.end), by))
    };
    after_bom(text, change).unwrap_or_else(|| text.to_owned())
}

/// A value as TOML.
fn written(kind: Kind, value: &str, end: &str) -> String {
    match kind {
        Kind::List => format!("[{}]", value.lines().map(quoted).collect::<Vec<_>>().join(", ")),
        Kind::Number => match value.parse::<f64>() {
            // As it was typed, if that is a number for TOML too.
            Ok(n) if n.is_finite() => {
                let is_toml = matches!(value.parse::<Value>(), Ok(Value::Float(_) | Value::Integer(_)));
                if is_toml { value.to_owned() } else { format!("{n:?}") }
            }
            _ => quoted(value),
        },
        Kind::Paragraphs if value.contains('\n') => {
            let (first, last) = value.rsplit_once('\n').unwrap_or(("", value));
            let mut text = first.split('\n').fold(String::new(), |text, line| text + &escaped(line) + end);
            // A quotation mark at the end would come together with those that end the text.
            let last = quoted(last);
            text += &last[1..last.len() - 1];
            format!("\"\"\"{end}{text}\"\"\"")
        }
        Kind::Line | Kind::Paragraphs | Kind::Choice(_) => quoted(value),
    }
}

/// A line of a text between three quotation marks.
fn escaped(line: &str) -> String {
    let one = quoted(line);
    // Quotation marks need no escape there, unless there are three.
    one[1..one.len() - 1].replace("\\\"", "\"").replace("\"\"\"", "\\\"\\\"\\\"")
}

/// The place of a block with the comments directly above it, its fields, and the comments directly below them.
fn extent(located: &Located<'_>, spot: &Spot<'_>) -> Option<[usize; 3]> {
    let Form::Header(header) = &spot.form else { return None };
    let begin = located.line_start(header.start);
    let mut above = begin;
    while above > 0 {
        let before = located.line_start(above - 1);
        if !located.text[before..above].trim_start().starts_with('#') || located.comments(before..above).is_empty() {
            break;
        }
        above = before;
    }
    let last = own_values(spot.table).iter().map(|v| v.end).max();
    Some([above, begin, comments_below(located, located.line_end(last.unwrap_or(header.end)))])
}

/// Where the comments directly below a block end. Those directly above a header, also one that is a comment, belong to that.
fn comments_below(located: &Located<'_>, end: usize) -> usize {
    let next = located.next_header(end);
    let mut after = end;
    for (at, line) in located.lines(end..next) {
        if !line.starts_with('#') {
            return after;
        }
        if lines::header(line.trim_start_matches('#').trim()).is_some() {
            return end;
        }
        after = located.line_end(at);
    }
    if next < located.text.len() { end } else { after }
}

/// Whether there are blocks below a block, which would get lost or come to another one if it were moved.
fn has_blocks_below(spot: &Spot<'_>) -> bool {
    let is_block = |item: &Item| item.is_array_of_tables() || item.as_table().is_some_and(|table| !table.is_dotted());
    spot.table.iter().any(|(_, item)| is_block(item))
}

/// The blocks of a section that are to be kept, in this order.
pub(super) fn arrange(text: &str, path: &str, order: &[usize]) -> Option<String> {
    after_bom(text, |text| {
        let located = Located::new(text)?;
        let all = blocks(located.doc.as_table(), path);
        if order.iter().any(|at| *at >= all.len()) {
            return None;
        }
        if let Some(Item::Value(Value::Array(list))) = repeated(located.doc.as_table(), path) {
            return arrange_list(text, list, order);
        }
        if all.iter().any(has_blocks_below) {
            return None;
        }
        let extents: Vec<[usize; 3]> = all.iter().map(|spot| extent(&located, spot)).collect::<Option<_>>()?;
        // A block that goes leaves the comments above it, which may be about all of them.
        let left = |at: usize| if order.contains(&at) { "" } else { &text[extents[at][0]..extents[at][1]] };
        let mut changed = text.to_owned();
        for (at, [above, _, end]) in extents.iter().enumerate().rev() {
            let block = order.get(at).map(|from| &text[extents[*from][0]..extents[*from][2]]).unwrap_or_default();
            let mut by = format!("{}{block}", left(at));
            if !by.is_empty() && !by.ends_with('\n') {
                by += newline(text);
            }
            let mut end = *end;
            if block.is_empty() && text[end..].starts_with(newline(text)) {
                end += newline(text).len();
            }
            changed = replaced(&changed, *above..end, &by);
        }
        Some(changed)
    })
}

fn arrange_list(text: &str, list: &Array, order: &[usize]) -> Option<String> {
    let spans: Vec<Range<usize>> = list.iter().map(Value::span).collect::<Option<_>>()?;
    let has_comment = spans.windows(2).any(|two| text[two[0].end..two[1].start].contains('#'));
    if has_comment {
        return None;
    }
    if order.is_empty() {
        return Some(replaced(text, list.span()?, "[]"));
    }
    let all = order.iter().map(|at| &text[spans[*at].clone()]).collect::<Vec<_>>().join(", ");
    Some(replaced(text, spans.first()?.start..spans.last()?.end, &all))
}

/// Another block, behind the others.
pub(super) fn append(text: &str, section: &Section, fields: &[(&Field, String)]) -> Option<String> {
    after_bom(text, |text| {
        let located = Located::new(text)?;
        let all = blocks(located.doc.as_table(), section.path);
        let end = newline(text);
        let each = |(f, value): &(&Field, String)| format!("{} = {}", f.key, written(f.kind, value, end));
        let written: Vec<String> = fields.iter().map(each).collect();
        match repeated(located.doc.as_table(), section.path) {
            None => {
                let mut begun = begin(&located, section);
                for (f, value) in fields {
                    begun = set_in(&begun, section, Some(0), f, value)?;
                }
                Some(begun)
            }
            Some(Item::Value(Value::Array(list))) => {
                let block = format!("{{ {} }}", written.join(", "));
                match list.iter().last() {
                    Some(last) => Some(replaced(text, last.span()?.end..last.span()?.end, &format!(", {block}"))),
                    None => Some(replaced(text, list.span()?, &format!("[{block}]"))),
                }
            }
            Some(Item::Table(_)) => {
                // One block was written as [creators]; with a second one it has to be [[creators]].
                let Form::Header(at) = &all.first()?.form else { return None };
                let header = format!("[[{}]]", section.path);
                append(&replaced(text, at.clone(), &header), section, fields)
            }
            Some(Item::ArrayOfTables(_)) => {
                if all.last().is_some_and(has_blocks_below) {
                    return None;
                }
                let [.., at] = extent(&located, all.last()?)?;
                let block = format!("{end}[[{}]]{end}{}{end}", section.path, written.join(end));
                Some(replaced(text, at..at, &with_end(text, at, &block, end)))
            }
            Some(_) => None,
        }
    })
}
