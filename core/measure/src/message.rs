//! Messages as data: every refusal and remark has a stable code and its values, so that it can be shown in the
//! reader's language. `Display` is the English text, which the command line prints.
//!
//! The page's texts are `i18n/*/page.ftl`: the code `refuse-few` is the key `refuseFew`, and the names of values are in braces there
//! (`viewer/measure/tests/messages.rs` compares them).

use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt::Display;

/// A value in a message.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MessageValue {
    /// How many.
    Count(u64),
    /// A length in metres.
    Metres(f64),
    /// A share of 1.
    Share(f64),
    /// A number without a unit.
    Number(f64),
    /// A word of the input.
    Word(String),
}

/// A message without its text.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Which message: lower-case words joined by `-`. Stable across versions.
    pub code: &'static str,
    /// By name.
    pub values: Vec<(&'static str, MessageValue)>,
}

impl Message {
    /// A message with values.
    pub fn new<const N: usize>(code: &'static str, values: [(&'static str, MessageValue); N]) -> Self {
        Self { code, values: values.into() }
    }
}

/// Can be shown as a message in every language.
pub trait ToMessage: Display {
    /// The message without its text.
    fn message(&self) -> Message;

    /// `code`, `values` and `english`.
    fn as_json(&self) -> Value {
        let Message { code, values: named } = self.message();
        let mut values = Map::new();
        for (name, value) in named {
            values.insert(name.to_owned(), json!(value));
        }
        json!({ "code": code, "values": values, "english": self.to_string() })
    }
}
