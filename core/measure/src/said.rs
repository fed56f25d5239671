//! Sentences as data: what is refused or remarked has a stable code and the values in it, so that whoever shows it can say it in the
//! reader's language. `Display` is the English of it, which the command line prints.
//!
//! The page's texts are `i18n/*/page.ftl`: the code `refuse-few` is the key `refuseFew`, and a value's name stands in braces there
//! (`viewer/measure/tests/said.rs` compares them).

use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Display;

/// A value in a sentence.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Worth {
    /// How many.
    Count(u64),
    /// A length in metres.
    Metres(f64),
    /// A share of 1.
    Share(f64),
    /// A number without a unit.
    Number(f64),
    /// A word that somebody gave.
    Word(String),
}

/// A sentence without its words.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Said {
    /// Which sentence: lower-case words joined by `-`. It does not change from version to version.
    pub code: &'static str,
    /// By name.
    pub values: BTreeMap<&'static str, Worth>,
}

impl Said {
    /// A sentence with values.
    pub fn new<const N: usize>(code: &'static str, values: [(&'static str, Worth); N]) -> Self {
        Self { code, values: values.into() }
    }
}

/// What can be said in every language.
pub trait Say: Display {
    /// The sentence without its words.
    fn said(&self) -> Said;

    /// `code`, `values` and `english`.
    fn as_json(&self) -> Value {
        let Said { code, values } = self.said();
        json!({ "code": code, "values": values, "english": self.to_string() })
    }
}
