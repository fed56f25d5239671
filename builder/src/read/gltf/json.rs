//! JSON of a glTF into the types of `schema`, with messages that name the part and use words of people.
//!
//! JSON does not tell 1 from 1.0, and some exporters write whole numbers with a point: where only that is in the way, they are
//! taken for what they are.

use super::Context;
use crate::read::ReadError;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// All of `json` as a `T`.
///
/// # Errors
/// [`ReadError::Part`] with the path to what is wrong.
pub(super) fn deserialize<T: DeserializeOwned>(json: &[u8], context: &Context<'_>) -> Result<T, ReadError> {
    let mut source = serde_json::Deserializer::from_slice(json);
    let value = match serde_path_to_error::deserialize(&mut source) {
        Ok(value) => value,
        Err(e) => return with_whole_numbers(json).ok_or_else(|| refusal(&e, context)),
    };
    source.end().map_err(|e| context.part("JSON".to_owned(), plainly(&e.to_string()), "nothing behind its end"))?;
    Ok(value)
}

fn refusal(e: &serde_path_to_error::Error<serde_json::Error>, context: &Context<'_>) -> ReadError {
    let part = match e.path().to_string() {
        path if path == "." => "JSON".to_owned(),
        path => path,
    };
    let expected = "glTF 2.0; the file is damaged or its exporter is wrong: copy or export it again";
    context.part(part, plainly(&e.inner().to_string()), expected)
}

/// The same with every 1.0 written as 1; `None` where that does not help, or where there is none.
fn with_whole_numbers<T: DeserializeOwned>(json: &[u8]) -> Option<T> {
    let mut value: Value = serde_json::from_slice(json).ok()?;
    if !make_whole(&mut value) {
        return None;
    }
    serde_json::from_value(value).ok()
}

/// Whether there was a whole number with a point. No deeper than the parser goes, which ends at 128 levels.
fn make_whole(value: &mut Value) -> bool {
    match value {
        Value::Number(n) => {
            // Exact below 2^53.
            let whole = n.as_f64().filter(|x| n.is_f64() && x.fract() == 0.0 && (0.0..9e15).contains(x));
            if let Some(x) = whole {
                *n = (x as u64).into();
            }
            whole.is_some()
        }
        Value::Array(all) => all.iter_mut().map(make_whole).filter(|made| *made).count() > 0,
        Value::Object(all) => all.values_mut().map(make_whole).filter(|made| *made).count() > 0,
        _ => false,
    }
}

/// A message of the parser without the words of programmers.
fn plainly(message: &str) -> String {
    let mut words: Vec<&str> = Vec::new();
    let mut left = message.split(' ').peekable();
    while let Some(word) = left.next() {
        match word {
            "u8" | "u16" | "u32" | "u64" | "usize" => words.push("a whole number"),
            "f32" | "f64" => words.push("a number"),
            "struct" => {
                left.next();
                words.push("an object");
            }
            "map," => words.push("an object,"),
            "sequence" => words.push("list"),
            "ident" => words.push("one of the words true, false and null"),
            "EOF" => words.push("the end of the text"),
            other => words.push(other),
        }
    }
    words.join(" ")
}
