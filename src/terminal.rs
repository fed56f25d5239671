//! What the program prints. Every byte for standard output and standard error goes through here.
//!
//! Names, titles and messages come out of files and from servers that anybody may have made; printed as they are, they could
//! move the cursor of a terminal, change its title, hide lines or turn text round. So everything that acts on a terminal
//! is shown by its number ([`kilwa_pack::visible`]), whether or not there is a terminal: logs are looked at in one, too.
//! Line ends and tabs stay, because the program writes them itself; where a name must not make lines of its own, it goes
//! through [`visible`](kilwa_pack::visible::visible) first. JSON is escaped as JSON is. Passwords in addresses are replaced
//! ([`crate::secrets`]).

use crate::secrets::hide;
use kilwa_pack::visible::is_control;
use serde::Serialize;
use std::fmt::{self, Write as _};
use std::io::{self, Stderr, StdoutLock, Write};

/// Standard output.
pub(crate) fn out() -> Escaping<StdoutLock<'static>> {
    Escaping::new(io::stdout().lock(), Form::Text)
}

/// Standard error.
pub(crate) fn err() -> Escaping<Stderr> {
    Escaping::new(io::stderr(), Form::Text)
}

/// Standard error for lines of JSON.
pub(crate) fn err_json() -> Escaping<Stderr> {
    Escaping::new(io::stderr(), Form::Json)
}

/// Print a line on standard error. If that is closed, nobody can read it.
pub(crate) fn line_to_err(line: fmt::Arguments<'_>) {
    drop(err().write_all(format!("{line}\n").as_bytes()));
}

/// Prints a line on standard error, as `eprintln!` does.
macro_rules! say {
    ($($arg:tt)*) => { $crate::terminal::line_to_err(format_args!($($arg)*)) };
}
pub(crate) use say;

/// A value as JSON on several lines, in which everything that acts on a terminal is escaped.
///
/// # Errors
/// Where it cannot be written as JSON.
pub(crate) fn json_text(value: &impl Serialize) -> serde_json::Result<String> {
    let text = serde_json::to_string_pretty(value)?;
    let mut out = String::with_capacity(text.len());
    hide(&text).chars().for_each(|c| escape(c, Form::Json, &mut out));
    Ok(out)
}

/// A value as JSON on one line, escaped in the same way.
///
/// # Errors
/// If it cannot be written as JSON.
pub(crate) fn json_line(value: &impl Serialize) -> serde_json::Result<String> {
    let text = serde_json::to_string(value)?;
    let mut out = String::with_capacity(text.len());
    hide(&text).chars().for_each(|c| escape(c, Form::Json, &mut out));
    Ok(out)
}

/// How a character that acts on a terminal is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    /// `\u{1b}`.
    Text,
    /// `\u001b`, as in a string of JSON, the only place where such characters occur.
    Json,
}

fn escape(c: char, form: Form, out: &mut String) {
    match c {
        '\n' | '\t' => out.push(c),
        c if !is_control(c) => out.push(c),
        // None of them lies above U+FFFF. Writing to a string cannot fail.
        c if form == Form::Json => drop(write!(out, "\\u{:04x}", u32::from(c))),
        c => out.extend(c.escape_unicode()),
    }
}

/// Hands text on with everything that acts on a terminal escaped. Bytes that are no UTF-8 are shown by their numbers.
pub(crate) struct Escaping<W: Write> {
    to: W,
    form: Form,
    /// The beginning of a character whose rest is still to come.
    begun: Vec<u8>,
}

impl<W: Write> Escaping<W> {
    fn new(to: W, form: Form) -> Self {
        Self { to, form, begun: Vec::new() }
    }
}

impl<W: Write> Write for Escaping<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut all = std::mem::take(&mut self.begun);
        all.extend_from_slice(bytes);
        let mut out = String::with_capacity(all.len());
        for chunk in all.utf8_chunks() {
            hide(chunk.valid()).chars().for_each(|c| escape(c, self.form, &mut out));
            let invalid = chunk.invalid();
            let is_last = invalid.as_ptr_range().end == all.as_ptr_range().end;
            if is_last && is_begun(invalid) {
                self.begun = invalid.to_vec();
            } else {
                for b in invalid {
                    let _ = write!(out, "\\x{b:02x}");
                }
            }
        }
        self.to.write_all(out.as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// Whether bytes that are no UTF-8 would be with some more.
fn is_begun(bytes: &[u8]) -> bool {
    !bytes.is_empty() && std::str::from_utf8(bytes).is_err_and(|e| e.valid_up_to() == 0 && e.error_len().is_none())
}

impl<W: Write> Drop for Escaping<W> {
    fn drop(&mut self) {
        for b in std::mem::take(&mut self.begun) {
            drop(write!(self.to, "\\x{b:02x}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(form: Form, pieces: &[&[u8]]) -> String {
        let mut to = Vec::new();
        let mut escaping = Escaping::new(&mut to, form);
        for piece in pieces {
            escaping.write_all(piece).unwrap();
        }
        drop(escaping);
        String::from_utf8(to).unwrap()
    }

    #[test]
    fn line_feeds_tabs_and_letters_pass_and_control_characters_are_escaped() {
        let text = "Kilwa\tملوى\n\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}\u{2066}\u{7f}\r\u{8}";
        let shown = "Kilwa\tملوى\n\\u{1b}]0;owned\\u{7}\\u{9b}2J\\u{202e}\\u{2066}\\u{7f}\\u{d}\\u{8}";
        assert_eq!(through(Form::Text, &[text.as_bytes()]), shown);
    }

    #[test]
    fn the_result_does_not_depend_on_how_the_text_is_split() {
        let text = "a\u{1b}é石\u{202e}𝕂\u{85}z".as_bytes();
        let whole = through(Form::Text, &[text]);
        for i in 0..=text.len() {
            for j in i..=text.len() {
                assert_eq!(through(Form::Text, &[&text[..i], &text[i..j], &text[j..]]), whole, "{i} {j}");
            }
        }
    }

    #[test]
    fn bytes_that_are_not_utf8_are_shown_as_numbers() {
        assert_eq!(through(Form::Text, &[b"a\x9b\xff", b"b\xe2\x80"]), "a\\x9b\\xffb\\xe2\\x80");
        assert_eq!(through(Form::Text, &[b"\xe2\x80", b"\x41"]), "\\xe2\\x80A");
    }

    #[test]
    fn escaping_does_not_change_the_meaning_of_json() {
        let value = serde_json::json!({ "a\u{9b}": "\u{1b}\u{202e}\n\"\u{7f}\u{2028}é" });
        let text = json_text(&value).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
        assert!(text.chars().all(|c| c == '\n' || !is_control(c)), "{text}");
        assert_eq!(through(Form::Text, &[text.as_bytes()]), text, "and passes as text");
        let line = json_line(&value).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&line).unwrap(), value);
        assert_eq!(through(Form::Text, &[line.as_bytes()]), line, "and passes as text");
        let line = serde_json::to_string(&value).unwrap();
        let escaped = through(Form::Json, &[line.as_bytes()]);
        assert_eq!(serde_json::from_str::<serde_json::Value>(&escaped).unwrap(), value);
    }

    /// Whatever is printed by another way would not be escaped.
    #[test]
    fn nothing_prints_except_through_the_terminal_module() {
        let mut open = vec![std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/src"))];
        let others = ["println!(", "print!(", "::stdout()", "::stderr()", "to_string_pretty(", "to_writer"];
        let allowed = |line: &str| line.contains("stderr().is_terminal()") || line.contains("Term::stderr()");
        let mut files = 0;
        while let Some(path) = open.pop() {
            if path.is_dir() {
                open.extend(std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
            } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("src/terminal.rs") {
                files += 1;
                let text = std::fs::read_to_string(&path).unwrap();
                for (number, line) in (1..).zip(text.lines()) {
                    let found = others.iter().find(|other| line.contains(**other)).filter(|_| !allowed(line));
                    assert!(found.is_none(), "{}:{number}: {line}: print by way of `terminal`", path.display());
                }
            }
        }
        assert!(files > 50);
    }
}
