//! Writing XML with [`quick_xml`]: elements with attributes and text, one to a line.

use quick_xml::events::attributes::Attribute;
use quick_xml::events::{BytesDecl, BytesEnd, BytesStart, BytesText, Event};
use quick_xml::{Reader, Writer};

/// A document that grows, or a part of one.
pub struct Xml {
    writer: Writer<Vec<u8>>,
    open: Vec<String>,
}

impl Xml {
    /// A document that begins with its root element; elements are indented by two spaces.
    pub fn new(root: &str, attributes: &[(&str, &str)]) -> Self {
        let mut xml = Self { writer: Writer::new_with_indent(Vec::new(), b' ', 2), open: Vec::new() };
        xml.declare();
        xml.begin(root, attributes);
        xml
    }

    /// Elements without indentation, as part of a document or, after [`Xml::declare`], as one.
    pub fn flat() -> Self {
        Self { writer: Writer::new_with_indent(Vec::new(), b' ', 0), open: Vec::new() }
    }

    /// The declaration that a document begins with.
    pub fn declare(&mut self) {
        self.write(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)));
    }

    /// Begin an element that holds others.
    pub fn begin(&mut self, name: &str, attributes: &[(&str, &str)]) {
        self.write(Event::Start(start(name, attributes)));
        self.open.push(name.to_owned());
    }

    /// End the one begun last.
    pub fn end(&mut self) {
        if let Some(name) = self.open.pop() {
            self.write(Event::End(BytesEnd::new(name)));
        }
    }

    /// An element with text.
    pub fn text(&mut self, name: &str, attributes: &[(&str, &str)], text: &str) {
        self.write(Event::Start(start(name, attributes)));
        self.write(Event::Text(BytesText::from_escaped(escape(text))));
        self.write(Event::End(BytesEnd::new(name)));
    }

    /// An element with text, where there is one.
    pub fn maybe(&mut self, name: &str, attributes: &[(&str, &str)], text: Option<&str>) {
        if let Some(text) = text {
            self.text(name, attributes, text);
        }
    }

    /// An element without content.
    pub fn empty(&mut self, name: &str, attributes: &[(&str, &str)]) {
        self.write(Event::Empty(start(name, attributes)));
    }

    /// XML that was written elsewhere, without a declaration, on lines of its own.
    pub fn insert(&mut self, xml: &str) {
        let into = self.writer.get_mut();
        into.push(b'\n');
        into.extend_from_slice(xml.as_bytes());
    }

    /// Bytes of what was written and not yet taken.
    pub fn written(&self) -> usize {
        self.writer.get_ref().len()
    }

    /// The text written since the last call, for documents that are sent piece by piece.
    pub fn take(&mut self) -> String {
        text(std::mem::take(self.writer.get_mut()))
    }

    /// The document, or what is left of it behind [`Xml::take`].
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.end();
        }
        let mut xml = self.writer.into_inner();
        xml.push(b'\n');
        text(xml)
    }

    fn write(&mut self, event: Event<'_>) {
        // Writing into memory does not fail.
        let _ = self.writer.write_event(event);
    }
}

/// A document without the declaration that it begins with, for putting it into another one.
pub fn without_declaration(xml: &str) -> &str {
    let mut reader = Reader::from_str(xml);
    let is_declared = matches!(reader.read_event(), Ok(Event::Decl(_)));
    let end = usize::try_from(reader.buffer_position()).unwrap_or_default();
    xml.get(end..).filter(|_| is_declared).unwrap_or(xml)
}

/// All that was written came from texts.
fn text(xml: Vec<u8>) -> String {
    String::from_utf8(xml).unwrap_or_default()
}

fn start<'a>(name: &'a str, attributes: &[(&str, &str)]) -> BytesStart<'a> {
    let mut start = BytesStart::new(name);
    for (key, value) in attributes {
        start.push_attribute(Attribute::from((key.as_bytes(), escape(value).as_bytes())));
    }
    start
}

/// Text for XML and HTML; characters that XML cannot hold are replaced, which the library does not do.
///
/// An apostrophe is `&#39;`, as in every record that was archived so far; the library writes `&apos;`.
pub fn escape(text: &str) -> String {
    let held: String = text.chars().map(|c| if is_held(c) { c } else { '\u{fffd}' }).collect();
    quick_xml::escape::escape(held).replace("&apos;", "&#39;")
}

/// Whether XML 1.0 can hold a character and gives it back as it was: a carriage return would be read as a line's end.
fn is_held(c: char) -> bool {
    !matches!(c, '\u{0}'..='\u{8}' | '\u{b}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_element_has_its_line() {
        let mut x = Xml::new("a", &[("x", "1<2"), ("y", "\"it's\"")]);
        x.text("b", &[], "<&>\u{1}\r\t\n");
        x.begin("c", &[]);
        x.empty("d", &[("e", "")]);
        x.text("f", &[], "");
        let first = x.take();
        x.end();
        x.begin("g", &[]);
        let all = first + &x.finish();
        let expected = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<a x=\"1&lt;2\" y=\"&quot;it&#39;s&quot;\">\n  \
                        <b>&lt;&amp;&gt;\u{fffd}\u{fffd}\t\n</b>\n  <c>\n    <d e=\"\"/>\n    <f></f>\n  </c>\n  <g>\n  </g>\n</a>\n";
        assert_eq!(all, expected);
    }

    #[test]
    fn parts_are_put_into_a_document_without_indentation() {
        let mut part = Xml::flat();
        part.text("set", &[], "a");
        part.empty("token", &[]);
        let mut x = Xml::flat();
        x.declare();
        x.begin("all", &[]);
        x.begin("list", &[]);
        x.insert(part.finish().trim_end());
        x.end();
        let expected =
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<all>\n<list>\n<set>a</set>\n<token/>\n</list>\n</all>\n";
        assert_eq!(x.finish(), expected);
        assert_eq!(without_declaration(expected), &expected[38..]);
        for whole in ["", "<dc/>", "<?xml", "<?xml version=\"1.0\"", "<?other?><dc/>", "é"] {
            assert_eq!(without_declaration(whole), whole);
        }
    }
}
