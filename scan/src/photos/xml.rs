//! XML files of other programs, by `roxmltree`: elements with their lines.

use super::text::quoted;
use crate::ScanError;
use kilwa_files::plain_file;
use kilwa_formats::read::{Place, ReadError};
use roxmltree::{Document, Node, ParsingOptions};
use std::path::Path;

/// Largest file, bytes; Metashape writes about a kilobyte for a photograph.
const FILE_MAX: u64 = 256 << 20;
/// Elements and texts of a file, and its attributes, at most: Metashape writes about twenty of each for a photograph.
const NODES_MAX: u32 = 4 << 20;

/// A file and its text.
pub(super) struct Xml<'a> {
    path: &'a Path,
    text: String,
}

impl<'a> Xml<'a> {
    pub(super) fn open(path: &'a Path) -> Result<Self, ScanError> {
        let cannot = |source| ReadError::Open { file: path.to_owned(), source };
        let bytes = plain_file::read_at(path, FILE_MAX).map_err(cannot)?;
        let text = String::from_utf8(bytes).map_err(|e| {
            let valid = e.utf8_error().valid_up_to() as u64;
            ScanError::malformed(path, Place::Byte(valid), "bytes that are not UTF-8", "XML in UTF-8")
        })?;
        let xml = Self { path, text };
        xml.check()?;
        Ok(xml)
    }

    /// Refuse a text whose document would be much larger than the file: `roxmltree` reserves memory for every `<` and `=`, and expands entities
    /// as often as they are referred to.
    fn check(&self) -> Result<(), ScanError> {
        if let Some(at) = self.text.find("<!ENTITY") {
            let line = self.text[..at].matches('\n').count() as u64 + 1;
            let expected = "a file without entity declarations";
            return Err(ScanError::malformed(self.path, Place::Line(line), "an <!ENTITY declaration", expected));
        }
        for sign in ['<', '='] {
            if let Some((at, _)) = self.text.match_indices(sign).nth(NODES_MAX as usize) {
                let found = format!("more than {NODES_MAX} \"{sign}\" characters");
                return Err(ScanError::malformed(
                    self.path,
                    Place::Byte(at as u64),
                    found,
                    "fewer photographs; export them in parts",
                ));
            }
        }
        Ok(())
    }

    pub(super) fn parse(&self) -> Result<Document<'_>, ScanError> {
        let options = ParsingOptions { allow_dtd: true, nodes_limit: NODES_MAX, ..ParsingOptions::default() };
        Document::parse_with_options(&self.text, options).map_err(|e| {
            let line = u64::from(e.pos().row);
            ScanError::malformed(self.path, Place::Line(line), format!("malformed XML ({e})"), "a complete XML file")
        })
    }

    /// The error for an element.
    pub(super) fn wrong(&self, node: Node<'_, '_>, found: impl Into<String>, expected: impl Into<String>) -> ScanError {
        let row = node.document().text_pos_at(node.range().start).row;
        ScanError::malformed(self.path, Place::Line(u64::from(row)), found, expected)
    }

    /// Exactly `N` numbers in the text of an element.
    pub(super) fn numbers<const N: usize>(&self, node: Node<'_, '_>) -> Result<[f64; N], ScanError> {
        self.parse_numbers(node, node.tag_name().name(), node.text().unwrap_or_default())
    }

    /// Exactly `N` numbers in an attribute, which must be there.
    pub(super) fn attribute<const N: usize>(&self, node: Node<'_, '_>, name: &str) -> Result<[f64; N], ScanError> {
        let text = node.attribute(name).ok_or_else(|| {
            self.wrong(node, format!("an element {} without {name}", node.tag_name().name()), format!("{N} numbers"))
        })?;
        self.parse_numbers(node, name, text)
    }

    pub(super) fn parse_numbers<const N: usize>(
        &self,
        node: Node<'_, '_>,
        name: &str,
        text: &str,
    ) -> Result<[f64; N], ScanError> {
        super::text::numbers(text).ok_or_else(|| {
            let expected = if N == 1 { "a number".to_owned() } else { format!("{N} numbers") };
            self.wrong(node, format!("{} as {name}", quoted(text.trim())), expected)
        })
    }

    /// The number in a child element, if it is there.
    pub(super) fn child_number(&self, node: Node<'_, '_>, name: &str) -> Result<Option<f64>, ScanError> {
        child(node, name).map(|child| self.numbers::<1>(child).map(|[value]| value)).transpose()
    }
}

/// The first child element of this name.
pub(super) fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// A picture size: whole numbers from 1 on.
pub(super) fn size(numbers: [f64; 2]) -> Option<[u32; 2]> {
    let is_size = |n: f64| n >= 1.0 && n <= f64::from(1 << 20) && n.fract() == 0.0;
    numbers.iter().all(|n| is_size(*n)).then(|| numbers.map(|n| n as u32))
}
