//! The header: `ply`, `format`, then elements with their properties, `comment` and `obj_info` anywhere, `end_header`.
//!
//! Tolerated: LF, CRLF and CR line ends, blank lines, spaces before, between and after words. Refused with the line: all
//! else that the format does not allow. The header alone decides how much may be allocated, so its counts are compared
//! with the length of the file ([`Header::check_fits`]) before anything is.

use super::scalar::{NAMES, Order, Scalar};
use super::{Place, ReadError};
use crate::read::source::{Source, quote};
use kilwa_pack::plural::counted;

/// A header longer than this is no header (real ones are below 10 kB).
const MAX_HEADER: u64 = 1 << 20;
/// Properties of one element; its rows then always fit the read buffer.
const MAX_PROPERTIES: usize = 4096;
const MAX_ELEMENTS: usize = 1024;

/// How the rows are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary(Order),
}

/// The type of a property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    /// The header line that declares it.
    pub(super) line: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The smallest number of bytes that a row can take: every list empty; in text, a digit and a space a word.
    fn smallest_row(&self, encoding: Encoding) -> u64 {
        match encoding {
            Encoding::Ascii => 2 * self.properties.len() as u64,
            Encoding::Binary(_) => self.properties.iter().map(|p| p.kind.smallest() as u64).sum(),
        }
    }
}

impl Kind {
    fn smallest(self) -> usize {
        match self {
            Self::Scalar(s) | Self::List { count: s, .. } => s.size(),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// `obj_info num_cols` and `num_rows`, the size of a range grid.
    pub(super) grid_size: [Option<u64>; 2],
    /// Pictures named in comments (`TextureFile`), which this version does not read.
    pub(super) textures: Vec<String>,
    /// Lines of the header; the first line of the data is the next one.
    pub(super) lines: u64,
}

impl Header {
    /// Read the header; `source` is left at the first byte of the data.
    pub(super) fn read(source: &mut Source<'_>) -> Result<Self, ReadError> {
        let mut lines = Lines { ending: None, number: 0 };
        let mut encoding = None;
        let mut elements = Vec::new();
        let mut textures = Vec::new();
        let mut grid_size = [None; 2];
        lines.next(source)?; // "ply", which made this reader the right one
        loop {
            let line = lines.next(source)?;
            let place = Place::Line(lines.number);
            let bad = |expected: &str| Err(source.malformed(place, quote(line.trim_ascii()), expected));
            let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
            match (words.as_slice(), encoding.is_some()) {
                ([b"obj_info", b"num_cols", n], _) => grid_size[0] = parse_count(n),
                ([b"obj_info", b"num_rows", n], _) => grid_size[1] = parse_count(n),
                ([] | [b"obj_info", ..], _) => {}
                ([b"comment", rest @ ..], _) => textures.extend(texture(rest)),
                ([b"format", ..], true) => return bad("one format line only"),
                ([b"format", rest @ ..], false) => match format(rest) {
                    Some(e) => encoding = Some(e),
                    None => {
                        return bad(
                            "\"format ascii 1.0\", \"format binary_little_endian 1.0\" or \"format binary_big_endian 1.0\"",
                        );
                    }
                },
                (_, false) => return bad("the format line before anything but comments"),
                ([b"element", name, count], _) => match parse_count(count) {
                    Some(_) if elements.len() == MAX_ELEMENTS => return bad("no more than 1024 elements"),
                    Some(count) => {
                        elements.push(Element { name: text(name), count, line: lines.number, properties: Vec::new() });
                    }
                    None => return bad("\"element NAME COUNT\" with a whole number of rows below 2^64"),
                },
                ([b"element", ..], _) => return bad("\"element NAME COUNT\""),
                ([b"property", rest @ ..], _) => {
                    let Some(element) = elements.last_mut() else {
                        return bad("an element line before its properties");
                    };
                    match property(rest) {
                        Ok(_) if element.properties.len() == MAX_PROPERTIES => {
                            return bad("no more than 4096 properties of one element");
                        }
                        Ok(property) => element.properties.push(property),
                        Err(expected) => return bad(&expected),
                    }
                }
                ([b"end_header"], _) => break,
                _ => return bad("format, comment, obj_info, element, property or end_header"),
            }
        }
        let missing = || source.malformed(Place::Line(lines.number), "end_header", "a format line before it");
        Ok(Self { encoding: encoding.ok_or_else(missing)?, elements, grid_size, textures, lines: lines.number })
    }

    /// Refuse a file that is too short for what its header declares. `source` stands at the first byte of the data.
    pub(super) fn check_fits(&self, source: &Source<'_>) -> Result<(), ReadError> {
        // The last word of a text file needs no space after it.
        let slack = u64::from(self.encoding == Encoding::Ascii);
        let mut left = source.remaining() + slack;
        for element in &self.elements {
            let row = element.smallest_row(self.encoding);
            let holds = left.checked_div(row).unwrap_or(u64::MAX);
            if element.count > holds {
                return Err(source.malformed(
                    Place::Line(element.line),
                    format!("\"element {} {}\"", element.name, element.count),
                    format!(
                        "at most {}, because only {} and a row takes at least {row}; the file is truncated or its header is wrong: export or copy it again",
                        counted(holds, "row", "rows"),
                        counted(left - slack.min(left), "byte follows", "bytes follow"),
                    ),
                ));
            }
            left -= element.count.saturating_mul(row).min(left);
        }
        Ok(())
    }
}

/// How header lines end, decided by the first one. Only a file whose first line ends with a bare CR has CR lines: else a CR
/// before the LF is white space, and the data begin after the LF.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ending {
    Lf,
    Cr,
}

struct Lines {
    ending: Option<Ending>,
    number: u64,
}

impl Lines {
    /// The next line without its end. The last line of the file needs no end.
    fn next(&mut self, source: &mut Source<'_>) -> Result<Vec<u8>, ReadError> {
        let mut line = Vec::new();
        self.number += 1;
        loop {
            if !source.ensure(1)? {
                if line.is_empty() {
                    return Err(source.malformed(
                        Place::Line(self.number),
                        "the end of the file",
                        "end_header; the file is truncated",
                    ));
                }
                return Ok(line);
            }
            if source.offset() >= MAX_HEADER {
                let found = format!("no end_header in the first {MAX_HEADER} bytes");
                return Err(source.malformed(Place::Line(self.number), found, "a PLY header"));
            }
            let byte = source.take(1)[0];
            match (byte, self.ending) {
                (b'\n', None | Some(Ending::Lf)) => {
                    self.ending = Some(Ending::Lf);
                    return Ok(line);
                }
                (b'\r', Some(Ending::Cr)) => return Ok(line),
                (b'\r', None) if !(source.ensure(1)? && source.available().first() == Some(&b'\n')) => {
                    self.ending = Some(Ending::Cr);
                    return Ok(line);
                }
                _ => line.push(byte),
            }
        }
    }
}

fn format(words: &[&[u8]]) -> Option<Encoding> {
    match words {
        [b"ascii", b"1.0"] => Some(Encoding::Ascii),
        [b"binary_little_endian", b"1.0"] => Some(Encoding::Binary(Order::Little)),
        [b"binary_big_endian", b"1.0"] => Some(Encoding::Binary(Order::Big)),
        _ => None,
    }
}

/// A count is digits alone: no sign, no fraction.
fn parse_count(word: &[u8]) -> Option<u64> {
    if !word.iter().all(u8::is_ascii_digit) {
        return None;
    }
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The property that the words after `property` declare, or what was expected instead.
fn property(words: &[&[u8]]) -> Result<Property, String> {
    let scalar = |word: &[u8]| {
        Scalar::parse(word).ok_or_else(|| format!("one of the types {NAMES} in place of {}", quote(word)))
    };
    match words {
        [b"list", count, item, name] => {
            let (count, item) = (scalar(count)?, scalar(item)?);
            if !count.is_integer() {
                return Err("an integer type for the length of a list".to_owned());
            }
            Ok(Property { name: text(name), kind: Kind::List { count, item } })
        }
        [b"list", ..] => Err("\"property list TYPE TYPE NAME\"".to_owned()),
        [kind, name] => Ok(Property { name: text(name), kind: Kind::Scalar(scalar(kind)?) }),
        _ => Err("\"property TYPE NAME\" or \"property list TYPE TYPE NAME\"".to_owned()),
    }
}

/// `comment TextureFile NAME` names a picture (MeshLab, CloudCompare).
fn texture(words: &[&[u8]]) -> Option<String> {
    match words {
        [key, name @ ..] if key.eq_ignore_ascii_case(b"TextureFile") && !name.is_empty() => {
            Some(text(&name.join(&b' ')))
        }
        _ => None,
    }
}

/// A name for messages and channels: control characters are escaped, letters of any script are kept.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).escape_debug().to_string()
}
