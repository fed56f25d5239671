//! HTML from the templates in `archive/templates` and `server/templates`. They are compiled into the program: a template
//! that names what does not exist stops the build.
//!
//! [`Escape`] escapes every value that a template writes, except where the template says `|safe`: for HTML that another
//! template made, and for the pieces of the viewer page ([`crate::frame`]).

use crate::record::xml::escape;
use askama::Template;
use askama::filters::Escaper;
use std::fmt;

/// Escapes as the records do, so that a value reads the same in a page and in a record.
#[derive(Debug, Clone, Copy)]
pub struct Escape;

impl Escaper for Escape {
    fn write_escaped_str<W: fmt::Write>(&self, mut dest: W, text: &str) -> fmt::Result {
        dest.write_str(&escape(text))
    }
}

/// The HTML of a template.
pub fn render(template: &impl Template) -> String {
    template.render().expect("values of templates are texts and numbers, and writing into memory does not fail")
}

/// An `iframe` that shows a model in the page of another site: what oEmbed hands out.
#[derive(Debug, Template)]
#[template(
    source = "<iframe src=\"{{ address }}\" width=\"{{ width }}\" height=\"{{ height }}\" title=\"{{ title }}\" style=\"border:0;max-width:100%\" allow=\"fullscreen; xr-spatial-tracking\" loading=\"lazy\"></iframe>",
    ext = "html"
)]
pub struct Embedded<'a> {
    /// Address of the page.
    pub address: &'a str,
    /// CSS pixels.
    pub width: u64,
    /// CSS pixels.
    pub height: u64,
    /// What it shows.
    pub title: &'a str,
}
