//! JSON of a glTF into the types of `schema`, with messages that name the part and use words of people.
//!
//! JSON does not distinguish 1 from 1.0, and some exporters write whole numbers with a point: where only that is in the way, they are
//! taken for what they are.

use super::Context;
use crate::read::ReadError;
use kilwa_pack::visible::visible;
use memchr::memchr2;
use serde::de::DeserializeOwned;

/// All of `json` as a `T`.
///
/// # Errors
/// [`ReadError::Part`] with the path to what is wrong.
pub(super) fn deserialize<T: DeserializeOwned>(json: &[u8], context: &Context<'_>) -> Result<T, ReadError> {
    let mut source = serde_json::Deserializer::from_slice(json);
    let value = match serde_path_to_error::deserialize(&mut source) {
        Ok(value) => value,
        Err(e) => return Err(refusal(&e, context)),
    };
    source.end().map_err(|e| context.part("JSON".to_owned(), plainly(&e.to_string()), "nothing behind its end"))?;
    Ok(value)
}

fn refusal(e: &serde_path_to_error::Error<serde_json::Error>, context: &Context<'_>) -> ReadError {
    let part = match e.path().to_string() {
        path if path == "." => "JSON".to_owned(),
        path => path,
    };
    let expected = format!("{}; the file is damaged or its exporter is wrong: copy or export it again", context.format);
    context.part(visible(&part).into_owned(), plainly(&e.inner().to_string()), &expected)
}

/// The same with every 1.0 written as 1; `None` if there is none.
pub(super) fn with_whole_numbers(json: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(json.len());
    let (mut at, mut changed) = (0, false);
    while let Some(&b) = json.get(at) {
        let length = match b {
            b'"' => string_length(&json[at..]),
            b'-' | b'0'..=b'9' => json[at..].iter().take_while(|b| b"+-.eE0123456789".contains(b)).count(),
            _ => 1,
        };
        let token = &json[at..at + length];
        at += length;
        match whole(token).filter(|_| b.is_ascii_digit()) {
            Some(number) => {
                changed = true;
                out.extend_from_slice(number.to_string().as_bytes());
            }
            None => out.extend_from_slice(token),
        }
    }
    changed.then_some(out)
}

/// Bytes of the string that begins here, with its quotes.
pub(super) fn string_length(json: &[u8]) -> usize {
    let mut at = 1;
    while let Some(n) = memchr2(b'"', b'\\', json.get(at..).unwrap_or_default()) {
        at += n;
        if json[at] == b'"' {
            return at + 1;
        }
        at += 2;
    }
    json.len()
}

/// The number that a token with a point or an exponent represents, where that is whole. Exact below 2^53.
fn whole(token: &[u8]) -> Option<u64> {
    if !token.iter().any(|b| b".eE".contains(b)) {
        return None;
    }
    let x: f64 = std::str::from_utf8(token).ok()?.parse().ok()?;
    (x.fract() == 0.0 && (0.0..9e15).contains(&x)).then_some(x as u64)
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
    visible(&words.join(" ")).into_owned()
}
