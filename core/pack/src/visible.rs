//! Text from files as people may see it.
//!
//! A name in a mesh or a pack may hold anything: sequences that move the cursor of a terminal, change its title or its
//! colours, or turn the direction of text so that it reads as something else. Such characters are shown by their numbers.

use std::borrow::Cow;

/// Whether a character does something to a terminal other than showing a letter: controls (C0, delete, C1), line and
/// paragraph separators, and those that embed, override, isolate or mark a text direction.
pub fn is_control(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// `text` in one line, without anything that acts on a terminal: such characters are written as `\u{1b}`, `\n` and `\t` by their
/// names.
pub fn visible(text: &str) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match c {
            '\n' | '\t' | '\r' => out.extend(c.escape_default()),
            c if is_control(c) => out.extend(c.escape_unicode()),
            c => out.push(c),
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_by_number_and_letters_of_any_script_are_kept() {
        assert_eq!(
            visible("a\u{1b}]0;x\u{7}b\nc\u{202e}\u{9b}\u{7f}\u{200f}"),
            "a\\u{1b}]0;x\\u{7}b\\nc\\u{202e}\\u{9b}\\u{7f}\\u{200f}"
        );
        for text in ["Kilwa Kisiwani", "ملوى", "מגדל", "é ñ 石", ""] {
            assert!(matches!(visible(text), Cow::Borrowed(t) if t == text));
        }
    }

    #[test]
    fn no_character_keeps_an_effect_on_a_terminal() {
        for c in (0..=0x0010_ffff).filter_map(char::from_u32) {
            let text = c.to_string();
            assert!(!visible(&text).contains(is_control), "{c:?}");
        }
    }
}
