//! What is wrong with a metadata file: line, field, what to do.

use std::fmt;
use thiserror::Error;

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// From 1; of the table where the mistake is that something is missing.
    pub line: usize,
    /// Which field, for example `rights.uri`; empty where the file is no TOML.
    pub field: String,
    /// What is wrong and what to do.
    pub message: String,
    /// Whether the field still has the example of the template; then it counts as absent.
    pub is_example: bool,
}

impl Problem {
    /// A mistake in `field`, at `line`.
    pub fn new(line: usize, field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { line, field: field.into(), message: message.into(), is_example: false }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.field.is_empty() {
            return write!(f, "line {}: {}", self.line, self.message);
        }
        write!(f, "line {}: {}: {}", self.line, self.field, self.message)
    }
}

/// All mistakes of a file.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub struct Problems(pub Vec<Problem>);

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.0.iter().enumerate() {
            write!(f, "{}{problem}", if i == 0 { "" } else { "\n  " })?;
        }
        Ok(())
    }
}

/// The known name that is most like the one given, if one is alike.
pub fn nearest<'a>(given: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    // No slip of the finger is as long, and comparing takes time by length.
    if given.len() > 100 {
        return None;
    }
    let lower = given.to_lowercase();
    let scored = known.map(|k| (strsim::damerau_levenshtein(&lower, &k.to_lowercase()), k));
    // Of equally near ones the first.
    let (distance, name) = scored.min_by_key(|(distance, _)| *distance)?;
    (distance <= 1 + given.chars().count().max(name.len()) / 4).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn a_typing_mistake_is_recognised_and_another_word_is_not() {
        let known = ["title", "description", "rights", "creators"];
        assert_eq!(nearest("titel", known.into_iter()), Some("title"));
        assert_eq!(nearest("Creator", known.into_iter()), Some("creators"));
        assert_eq!(nearest("elephants", known.into_iter()), None);
        assert_eq!(nearest("b5", ["b4", "b1", "b9"].into_iter()), Some("b4"));
    }
}
