//! A message: read from Fluent's syntax, formatted here for the portal, or written as JSON for the page.
//!
//! In JSON a message is a text with the names of its values in braces; or, where its wording depends on a number, an object
//! with a text for each plural category, `{"$": "count", "one": "{count} view", "other": "{count} views"}`, in which `$` is
//! the name of the number; or a list of such texts and objects.
//!
//! Of Fluent that takes texts, values, string literals, and choices by the plural category of a number. [`parse`] refuses the rest.

use crate::Catalogue;
use fluent_syntax::ast::{Entry, Expression, InlineExpression, Pattern, PatternElement, VariantKey};
use icu_plurals::PluralCategory;
use serde_json::{Map, json};
use std::fmt::Write as _;

/// What is put into a message.
#[derive(Debug, Clone, Copy)]
pub enum Value<'v> {
    /// Text, as it is.
    Text(&'v str),
    /// A count, which is written as the language writes numbers and chooses among plural forms.
    Number(u64),
}

impl<'v> From<&'v str> for Value<'v> {
    fn from(text: &'v str) -> Self {
        Self::Text(text)
    }
}

impl<'v> From<&'v String> for Value<'v> {
    fn from(text: &'v String) -> Self {
        Self::Text(text)
    }
}

impl From<u64> for Value<'_> {
    fn from(n: u64) -> Self {
        Self::Number(n)
    }
}

impl From<usize> for Value<'_> {
    fn from(n: usize) -> Self {
        Self::Number(n as u64)
    }
}

/// A message. Texts next to each other are one.
#[derive(Debug, PartialEq)]
pub(crate) struct Message(Vec<Part>);

#[derive(Debug, PartialEq)]
enum Part {
    Text(String),
    /// By its name.
    Value(String),
    Choice {
        /// The name of the number.
        by: String,
        forms: Vec<(PluralCategory, Message)>,
    },
}

/// Keys and messages in the order of a file.
pub(crate) fn parse(text: &str) -> Result<Vec<(String, Message)>, String> {
    let resource = fluent_syntax::parser::parse(text).map_err(|(_, errors)| {
        let describe = |e: &fluent_syntax::parser::ParserError| {
            let line = text.get(..e.pos.start).unwrap_or_default().matches('\n').count() + 1;
            format!("line {line}: {e}")
        };
        errors.first().map(describe).unwrap_or_default()
    })?;
    let mut messages: Vec<(String, Message)> = Vec::new();
    for entry in &resource.body {
        let message = match entry {
            Entry::Message(message) => message,
            Entry::Term(term) => return Err(format!("-{}: terms are not supported", term.id.name)),
            _ => continue,
        };
        let key = message.id.name;
        let pattern = message.value.as_ref().filter(|_| message.attributes.is_empty());
        let pattern = pattern.ok_or_else(|| format!("{key}: attributes are not supported"))?;
        if messages.iter().any(|(other, _)| other == key) {
            return Err(format!("{key} is there twice"));
        }
        messages.push((key.to_owned(), Message::read(pattern).map_err(|what| format!("{key}: {what}"))?));
    }
    Ok(messages)
}

impl Message {
    fn read(pattern: &Pattern<&str>) -> Result<Self, String> {
        let mut parts = Vec::new();
        for element in &pattern.elements {
            match element {
                PatternElement::TextElement { value } => push_text(&mut parts, value)?,
                PatternElement::Placeable { expression: Expression::Inline(inline) } => match inline {
                    InlineExpression::StringLiteral { value } => push_text(&mut parts, value)?,
                    InlineExpression::VariableReference { id } => parts.push(Part::Value(id.name.to_owned())),
                    _ => return Err("only texts, values and plural forms are supported".to_owned()),
                },
                PatternElement::Placeable { expression: Expression::Select { selector, variants } } => {
                    let InlineExpression::VariableReference { id } = selector else {
                        return Err("forms are chosen by a number".to_owned());
                    };
                    let mut forms = Vec::new();
                    for variant in variants {
                        forms.push((category(&variant.key)?, Self::read(&variant.value)?));
                    }
                    if !forms.iter().any(|(category, _)| *category == PluralCategory::Other) {
                        return Err("the form other is missing".to_owned());
                    }
                    parts.push(Part::Choice { by: id.name.to_owned(), forms });
                }
            }
        }
        Ok(Self(parts))
    }

    /// The text of a message without values.
    pub(crate) fn text(&self) -> Option<&str> {
        match &*self.0 {
            [Part::Text(text)] => Some(text),
            _ => None,
        }
    }

    /// The message in words.
    pub(crate) fn format(&self, language: &Catalogue, values: &[(&str, Value<'_>)]) -> String {
        let value = |name: &str| values.iter().find(|(other, _)| *other == name).map(|(_, value)| *value);
        let mut text = String::new();
        for part in &self.0 {
            match part {
                Part::Text(words) => text.push_str(words),
                Part::Value(name) => match value(name) {
                    Some(Value::Text(words)) => text.push_str(words),
                    Some(Value::Number(n)) => text.push_str(&language.number(n)),
                    // Writing to a string cannot fail.
                    None => drop(write!(text, "{{{name}}}")),
                },
                Part::Choice { by, forms } => {
                    let category = match value(by) {
                        Some(Value::Number(n)) => language.category(n),
                        _ => PluralCategory::Other,
                    };
                    let form = |category| forms.iter().find(|(other, _)| *other == category);
                    let chosen = form(category).or_else(|| form(PluralCategory::Other));
                    text.extend(chosen.map(|(_, message)| message.format(language, values)));
                }
            }
        }
        text
    }

    /// The message as the page reads it.
    pub(crate) fn to_json(&self) -> serde_json::Value {
        let mut parts: Vec<serde_json::Value> = Vec::new();
        let mut text = String::new();
        for part in &self.0 {
            match part {
                Part::Text(words) => text.push_str(words),
                Part::Value(name) => drop(write!(text, "{{{name}}}")),
                Part::Choice { by, forms } => {
                    if !text.is_empty() {
                        parts.push(json!(std::mem::take(&mut text)));
                    }
                    let forms = forms.iter().map(|(category, form)| (name(*category).to_owned(), form.to_json()));
                    let by = std::iter::once(("$".to_owned(), json!(by)));
                    parts.push(by.chain(forms).collect::<Map<_, _>>().into());
                }
            }
        }
        if !text.is_empty() || parts.is_empty() {
            parts.push(json!(text));
        }
        // A list of one is what it lists.
        if parts.len() == 1 { parts.remove(0) } else { parts.into() }
    }
}

fn push_text(parts: &mut Vec<Part>, text: &str) -> Result<(), String> {
    if text.contains(['{', '}', '\\']) {
        return Err("braces and escapes in a text are not supported".to_owned());
    }
    if let Some(Part::Text(before)) = parts.last_mut() {
        before.push_str(text);
    } else {
        parts.push(Part::Text(text.to_owned()));
    }
    Ok(())
}

/// The names of the plural categories in CLDR.
const CATEGORIES: [(&str, PluralCategory); 6] = [
    ("zero", PluralCategory::Zero),
    ("one", PluralCategory::One),
    ("two", PluralCategory::Two),
    ("few", PluralCategory::Few),
    ("many", PluralCategory::Many),
    ("other", PluralCategory::Other),
];

fn category(key: &VariantKey<&str>) -> Result<PluralCategory, String> {
    let (VariantKey::Identifier { name } | VariantKey::NumberLiteral { value: name }) = *key;
    let found = CATEGORIES.iter().find(|(known, _)| *known == name).map(|(_, category)| *category);
    found.ok_or_else(|| format!("{name} is not a plural category"))
}

fn name(category: PluralCategory) -> &'static str {
    CATEGORIES.iter().find(|(_, other)| *other == category).map_or("other", |(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_become_texts_and_choices() {
        let text = "# A comment\n\nplain = A view\nwith = { $count } of { $all }\nblank = { \" \" }on\n\
            plural = Erased: { $count ->\n    [one] { $count } view\n   *[other] { $count } views\n }.\n";
        let messages = parse(text).unwrap();
        let found: Vec<_> = messages.iter().map(|(key, message)| (key.as_str(), message.to_json())).collect();
        let choice = json!({ "$": "count", "one": "{count} view", "other": "{count} views" });
        let plural = json!(["Erased: ", choice, "."]);
        assert_eq!(
            found,
            [
                ("plain", json!("A view")),
                ("with", json!("{count} of {all}")),
                ("blank", json!(" on")),
                ("plural", plural)
            ]
        );
        assert_eq!((messages[2].1.text(), messages[3].1.text()), (Some(" on"), None));
    }

    #[test]
    fn what_the_page_cannot_show_is_refused_with_its_place() {
        for (text, why) in [
            ("a = { b }", "a: only texts"),
            ("a = { NUMBER($n) }", "a: only texts"),
            ("-a = b", "-a: terms"),
            ("a = b\n    .c = d", "a: attributes"),
            ("a = { $n ->\n [0] none\n *[other] some\n }", "a: 0 is not a plural category"),
            ("a = { $n ->\n [many] some\n *[one] one\n }", "a: the form other is missing"),
            ("a = { \"{\" }", "a: braces"),
            ("a = b\na = c", "a is there twice"),
            ("a = b\nc = {", "line 2: "),
        ] {
            let found = parse(text).unwrap_err();
            assert!(found.starts_with(why), "{text}: {found}");
        }
    }
}
