//! Text STL, word by word: any case, any spacing, several solids, names of any bytes.
//!
//! A facet ends at `endloop`, `endfacet`, or where the next facet, a solid or the end of the file begins. Normals are
//! read for the comparison with the corners only; what stands there may be anything. Numbers are read as doubles.

use super::super::{Place, ReadError};
use super::Bytes;
use super::facets::Facets;
use glam::DVec3;

/// Bytes of a word that are kept; longer words are cut and are no number and no keyword.
const WORD: usize = 256;

/// Deliver all facets.
pub(super) fn read(bytes: &mut Bytes<'_>, facets: &mut Facets<'_>) -> Result<(), ReadError> {
    let mut words = Words { bytes, line: 1, word: Vec::with_capacity(WORD), word_line: 1, again: false };
    let mut facet = Facet::default();
    let mut open_solids = 0u64;
    while words.next()? {
        let line = words.word_line;
        match words.keyword() {
            Some(Keyword::Solid) => {
                facet.end(facets)?;
                open_solids += 1;
                words.name()?;
            }
            Some(Keyword::EndSolid) => {
                facet.end(facets)?;
                open_solids = open_solids.saturating_sub(1);
                words.name()?;
            }
            Some(Keyword::Facet) => {
                facet.end(facets)?;
                facet = Facet { line, begun: true, ..Facet::default() };
            }
            Some(Keyword::Normal) => facet.normal = words.normal()?,
            Some(Keyword::Outer | Keyword::Loop) => {}
            Some(Keyword::Vertex) => {
                let corner = DVec3::new(words.number()?, words.number()?, words.number()?);
                if !facet.begun {
                    facet = Facet { line, begun: true, ..Facet::default() };
                }
                facet.corner(corner, facets)?;
            }
            Some(Keyword::EndLoop) => facet.closed = true,
            Some(Keyword::EndFacet) => {
                facet.ended = true;
                facet.end(facets)?;
            }
            None => {
                let expected = "a keyword of STL (solid, facet, outer loop, vertex, endloop, endfacet, endsolid); the file is damaged or not an STL: export it again";
                return Err(words.malformed(expected));
            }
        }
    }
    facet.end(facets)?;
    facets.diagnostics().add_many("solids without an end; the file may be truncated", open_solids);
    Ok(())
}

/// The words of the format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keyword {
    Solid,
    EndSolid,
    Facet,
    Normal,
    Outer,
    Loop,
    Vertex,
    EndLoop,
    EndFacet,
}

/// The frequent ones first.
const KEYWORDS: [(&[u8], Keyword); 9] = [
    (b"vertex", Keyword::Vertex),
    (b"facet", Keyword::Facet),
    (b"normal", Keyword::Normal),
    (b"outer", Keyword::Outer),
    (b"loop", Keyword::Loop),
    (b"endloop", Keyword::EndLoop),
    (b"endfacet", Keyword::EndFacet),
    (b"solid", Keyword::Solid),
    (b"endsolid", Keyword::EndSolid),
];

/// The facet in hand.
#[derive(Default)]
struct Facet {
    line: u64,
    begun: bool,
    /// Its loop has ended: another corner would begin another.
    closed: bool,
    ended: bool,
    normal: DVec3,
    corners: [DVec3; 3],
    count: usize,
}

impl Facet {
    /// A corner. Further ones than three make a fan with the first and the one before.
    fn corner(&mut self, corner: DVec3, facets: &mut Facets<'_>) -> Result<(), ReadError> {
        let line = self.line;
        if self.closed {
            facets.diagnostics().add("corners after the end of a loop left out", || format!("line {line}"));
            return Ok(());
        }
        if self.count >= 3 {
            if self.count == 3 {
                facets.diagnostics().add("facets of more than three corners cut as fans", || format!("line {line}"));
                facets.add(self.corners, None)?;
            }
            self.corners = [self.corners[0], self.corners[2], corner];
            facets.add(self.corners, None)?;
        } else {
            self.corners[self.count] = corner;
        }
        self.count += 1;
        Ok(())
    }

    /// The end of the facet, if one is in hand.
    fn end(&mut self, facets: &mut Facets<'_>) -> Result<(), ReadError> {
        let facet = std::mem::take(self);
        if !facet.begun {
            return Ok(());
        }
        let place = || format!("line {}", facet.line);
        if !facet.ended {
            facets.diagnostics().add("facets without endfacet", place);
        }
        match facet.count {
            3 => {
                facets.check_normal(facet.normal, &facet.corners, place);
                facets.add(facet.corners, None)?;
            }
            n if n < 3 => facets.diagnostics().add("facets of fewer than three corners dropped", place),
            _ => {}
        }
        Ok(())
    }
}

/// The words of the file.
struct Words<'w, 'a> {
    bytes: &'w mut Bytes<'a>,
    /// The line of the next byte.
    line: u64,
    word: Vec<u8>,
    word_line: u64,
    /// The word is to be given once more.
    again: bool,
}

impl Words<'_, '_> {
    /// Go to the next word; `false` at the end of the file.
    fn next(&mut self) -> Result<bool, ReadError> {
        if std::mem::take(&mut self.again) {
            return Ok(true);
        }
        self.word.clear();
        loop {
            let there = self.bytes.look()?;
            if there.is_empty() {
                return Ok(!self.word.is_empty());
            }
            let mut used = 0;
            let mut complete = false;
            for &byte in there {
                if is_space(byte) {
                    if !self.word.is_empty() {
                        complete = true;
                        break;
                    }
                    self.line += u64::from(byte == b'\n');
                } else {
                    if self.word.is_empty() {
                        self.word_line = self.line;
                    }
                    if self.word.len() < WORD {
                        self.word.push(byte);
                    }
                }
                used += 1;
            }
            self.bytes.take(used);
            if complete {
                return Ok(true);
            }
        }
    }

    /// What the word means.
    fn keyword(&self) -> Option<Keyword> {
        let word = self.word.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.word);
        KEYWORDS.iter().find(|(text, _)| word.eq_ignore_ascii_case(text)).map(|(_, keyword)| *keyword)
    }

    /// Pass over the name of a solid: the rest of the line, or up to `normal` after `facet` or `endsolid` on it (some
    /// files are one line).
    fn name(&mut self) -> Result<(), ReadError> {
        let line = self.word_line;
        let mut before = None;
        while self.next()? {
            let keyword = self.keyword();
            let facet = before == Some(Keyword::Facet) && keyword == Some(Keyword::Normal);
            if self.word_line != line || facet || keyword == Some(Keyword::EndSolid) {
                self.again = true;
                break;
            }
            before = keyword;
        }
        Ok(())
    }

    /// Three words after `normal`, whatever they are; not a number is no normal.
    fn normal(&mut self) -> Result<DVec3, ReadError> {
        let mut normal = [0.0; 3];
        for x in &mut normal {
            if !self.next()? {
                break;
            }
            if self.keyword().is_some() {
                self.again = true;
                return Ok(DVec3::ZERO);
            }
            *x = parse(&self.word).unwrap_or(f64::NAN);
        }
        Ok(normal.into())
    }

    /// A coordinate.
    fn number(&mut self) -> Result<f64, ReadError> {
        let expected = "three coordinates after vertex, with a decimal point";
        if !self.next()? {
            self.word.clear();
            self.word_line = self.line;
            return Err(self.malformed(expected));
        }
        parse(&self.word).ok_or_else(|| self.malformed(expected))
    }

    fn malformed(&self, expected: &str) -> ReadError {
        let shown = &self.word[..self.word.len().min(60)];
        let found =
            if shown.is_empty() { "the end of the file".to_owned() } else { format!("\"{}\"", shown.escape_ascii()) };
        let (file, place) = (self.bytes.path.to_owned(), Place::Line(self.word_line));
        ReadError::Malformed { file, place, found, expected: expected.to_owned() }
    }
}

/// White space of text files, with the zero bytes that some writers pad with.
fn is_space(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == 0 || byte == 0x0b
}

/// A number; the ways in which C libraries write "not a number" and "infinite" are numbers too, so that such a corner is
/// dropped and counted and not a reason to refuse the file.
fn parse(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    if let Ok(x) = text.parse() {
        return Some(x);
    }
    let bare = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    (bare.starts_with("nan") || bare.starts_with("1.#")).then_some(f64::NAN)
}
