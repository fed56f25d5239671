//! The built viewer page as a frame: cut once at its places, for templates that put a model's facts between the pieces.
//!
//! A page without one of the places is refused: by the build script where it is built into the program, and when the
//! program begins where `--www` gives another one ([`crate::viewer::PageError::Places`]).

use crate::places::cut;

/// The pieces of the page, named by what comes behind each. They are HTML.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// Up to the beginning of the head.
    pub to_head: &'a str,
    /// From there up to the address that the page's own files are relative to.
    pub to_base: &'a str,
    /// From there up to the title.
    pub to_title: &'a str,
    /// Up to the end of the head.
    pub to_head_end: &'a str,
    /// Up to the address of the pack, an attribute.
    pub to_pack: &'a str,
    /// Up to the address of the list of models, an attribute.
    pub to_list: &'a str,
    /// Up to the title in the page.
    pub to_heading: &'a str,
    /// Up to the picture that is shown until the model is there.
    pub to_poster: &'a str,
    /// Up to the texts about the model.
    pub to_about: &'a str,
    /// Up to the technical facts.
    pub to_facts: &'a str,
    /// Up to the end of the body.
    pub to_end: &'a str,
    /// The rest.
    pub end: &'a str,
}

impl<'a> Frame<'a> {
    /// Cut the viewer page at its places.
    ///
    /// # Errors
    /// A sentence about the place that is missing.
    pub fn of(html: &'a str) -> Result<Self, String> {
        let [
            to_head,
            to_base,
            to_title,
            to_head_end,
            to_pack,
            to_list,
            to_heading,
            to_poster,
            to_about,
            to_facts,
            to_end,
            end,
        ] = cut(html)?;
        Ok(Self {
            to_head,
            to_base,
            to_title,
            to_head_end,
            to_pack,
            to_list,
            to_heading,
            to_poster,
            to_about,
            to_facts,
            to_end,
            end,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::PLACES;

    #[test]
    fn the_page_of_this_repository_has_every_place_and_a_missing_one_is_named() {
        let html = include_str!("../../www/index.html");
        let frame = Frame::of(html).unwrap();
        assert!(frame.to_head.starts_with("<!doctype html>") && frame.end.trim() == "</html>");
        for (place, what) in PLACES {
            let why = Frame::of(&html.replace(place, "")).unwrap_err();
            assert!(why.contains(place) && why.contains(what), "{why}");
            let why = Frame::of(&html.replace(place, &place.repeat(2))).unwrap_err();
            assert!(why.contains("2 times"), "{why}");
        }
    }
}
