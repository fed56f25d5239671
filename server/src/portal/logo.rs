//! The institution's logo: which formats are accepted, and how they are served.
//!
//! Invariant: a picture is sent with the media type that its content shows, and with a policy under which it can run and load nothing, so
//! that an SVG that somebody opens by its address is as harmless as one in a page.

use crate::content::{ASK_AGAIN, condition};
use axum::body::{Body, Bytes};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};

/// Largest logo, bytes: every page has it.
pub(super) const LOGO_MAX: u64 = 300_000;
/// Nothing runs, nothing is loaded; an SVG may have styles and pictures inside itself.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox";

/// A format of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    Png,
    Svg,
    Jpeg,
    Webp,
}

impl Format {
    pub(crate) const ALL: [Self; 4] = [Self::Png, Self::Svg, Self::Jpeg, Self::Webp];

    /// The format of a file, detected from its content.
    fn of_content(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => Some(Self::Png),
            [0xff, 0xd8, 0xff, ..] => Some(Self::Jpeg),
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some(Self::Webp),
            _ => std::str::from_utf8(bytes).is_ok_and(is_svg).then_some(Self::Svg),
        }
    }

    /// Its address on this site.
    pub(crate) fn address(self) -> &'static str {
        match self {
            Self::Png => "/logo.png",
            Self::Svg => "/logo.svg",
            Self::Jpeg => "/logo.jpg",
            Self::Webp => "/logo.webp",
        }
    }

    fn content_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Svg => "image/svg+xml",
            Self::Jpeg => "image/jpeg",
            Self::Webp => "image/webp",
        }
    }
}

/// Whether the first element is `svg`; it may follow a declaration, comments and a document type.
fn is_svg(text: &str) -> bool {
    let mut rest = text.trim_start_matches('\u{feff}').trim_start();
    while let Some(after) = after_prologue(rest) {
        rest = after.trim_start();
    }
    rest.strip_prefix("<svg")
        .is_some_and(|after| after.starts_with(|c: char| c.is_whitespace() || c == '>' || c == '/'))
}

/// What follows the declaration, comment or document type that a text begins with.
fn after_prologue(text: &str) -> Option<&str> {
    let after = |begin, end| Some(text.strip_prefix(begin)?.split_once(end)?.1);
    after("<?", "?>").or_else(|| after("<!--", "-->")).or_else(|| {
        let rest = text.strip_prefix("<!DOCTYPE")?;
        // Adobe Illustrator declares entities between brackets.
        let end = rest.find(['[', '>'])?;
        let rest = if rest[end..].starts_with('[') { rest.split_once(']')?.1 } else { rest };
        Some(rest.split_once('>')?.1)
    })
}

/// A picture that is a logo.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Logo {
    pub(crate) format: Format,
    bytes: Bytes,
    etag: String,
}

impl Logo {
    /// Of a file's content.
    ///
    /// # Errors
    /// A message, if it is not a picture in one of these formats.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        let format = Format::of_content(bytes).ok_or("this is not a PNG, SVG, JPEG or WebP picture")?;
        let etag = format!("\"{}\"", &blake3::hash(bytes).to_hex()[..32]);
        Ok(Self { format, bytes: Bytes::copy_from_slice(bytes), etag })
    }

    /// The response with the logo.
    pub(crate) fn respond(&self, headers: &HeaderMap) -> Response {
        let fixed = [(ETAG, self.etag.as_str()), (CACHE_CONTROL, ASK_AGAIN), (CONTENT_SECURITY_POLICY, POLICY)];
        if let Some(status) = condition(&self.etag, headers) {
            return (status, fixed).into_response();
        }
        let kind = [(CONTENT_TYPE, self.format.content_type())];
        (StatusCode::OK, fixed, kind, Body::from(self.bytes.clone())).into_response()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_known_by_its_content() {
        let svg = "<?xml version=\"1.0\"?>\n<!-- <html> --><!DOCTYPE svg PUBLIC \"x\">\n<svg xmlns=\"\"/>";
        let illustrator = "<?xml version=\"1.0\"?>\n<!DOCTYPE svg PUBLIC \"-//W3C//DTD SVG 1.1//EN\" \"svg11.dtd\" [\n<!ENTITY ns \"http://x\">\n]>\n<svg xmlns=\"&ns;\"/>";
        for (bytes, format) in [
            (svg.as_bytes(), Format::Svg),
            (illustrator.as_bytes(), Format::Svg),
            ("\u{feff}<svg>".as_bytes(), Format::Svg),
            (b"\x89PNG\r\n\x1a\nrest", Format::Png),
            (b"\xff\xd8\xff\xe0", Format::Jpeg),
            (b"RIFF\0\0\0\0WEBPVP8 ", Format::Webp),
        ] {
            assert_eq!(Logo::read(bytes).unwrap().format, format);
        }
        for bad in [&b""[..], b"GIF89a", b"<html><svg>", b"\xff<svg>", b"%PDF", b"<svgx>", b"<!-- <svg>"] {
            assert!(Logo::read(bad).unwrap_err().contains("not a PNG, SVG, JPEG or WebP"), "{bad:?}");
        }
    }
}
