//! Texts on a sheet that a PDF's own Helvetica lacks, such as Arabic titles: lines that whoever has a font and shapes text has set in
//! it, and that font. Without them such texts are written with question marks.

use super::layout::{Layout, Mark};
use std::collections::{BTreeMap, BTreeSet};

/// Lines set in a font that goes into the file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Letters {
    /// The objects of the font, numbered from 1 in their order, each whole (`1 0 obj … endobj`, with a line's end); the first is the font.
    pub objects: Vec<Vec<u8>>,
    /// By text.
    pub lines: BTreeMap<String, Line>,
}

/// A line of text.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Line {
    /// Operators of a PDF that show it, for a font size of 1.
    pub operators: String,
    /// Its width for a font size of 1.
    pub width: f64,
}

/// The texts of a layout that Helvetica lacks: it has those of Latin 1.
pub fn needed(layout: &Layout) -> BTreeSet<&str> {
    let texts = layout.marks.iter().filter_map(|mark| match mark {
        Mark::Text { words, .. } => Some(words.as_str()),
        _ => None,
    });
    texts.filter(|words| !words.chars().all(is_plain)).collect()
}

/// Whether Helvetica has a character, in the encoding WinAnsi.
pub(super) fn is_plain(c: char) -> bool {
    (' '..='\u{ff}').contains(&c)
}
