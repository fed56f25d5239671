//! Texts on a drawing that Helvetica's encoding lacks, such as Arabic titles: shaped, and set in DejaVu Sans, of which the
//! PDF gets the glyphs that it uses.
//!
//! The font's objects are `pdf-writer`'s; [`kilwa_measure::sheet::file`] puts them into the file. Characters that the font
//! lacks too are shown as its empty box. Sources: ISO 32000-1, 9.7 (composite fonts), 14.9.4 (`ActualText`).

use flate2::Compression;
use flate2::write::ZlibEncoder;
use kilwa_measure::sheet::layout::Layout;
use kilwa_measure::sheet::letters::{Letters, Line, needed};
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Chunk, Content, Filter, Finish as _, Name, Rect, Ref, Str, TextStr};
use rustybuzz::{Direction, Face, UnicodeBuffer};
use std::collections::BTreeMap;
use std::io::{self, Write as _};
use subsetter::GlyphRemapper;
use unicode_bidi::BidiInfo;

/// Of the font, with the tag that marks a subset.
const NAME: Name<'static> = Name(b"KILWAA+DejaVuSans");
/// The font's objects, in their order in the file.
const FONT: Ref = Ref::new(1);
const CID_FONT: Ref = Ref::new(2);
const DESCRIPTOR: Ref = Ref::new(3);
const PROGRAM: Ref = Ref::new(4);
const TO_UNICODE: Ref = Ref::new(5);
const SYSTEM: SystemInfo<'static> = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };

/// A glyph where it stands, from left to right; lengths in thousandths of the size.
struct Placed {
    /// Number in the embedded font.
    glyph: u16,
    /// From the left end of the line, and above its base line.
    at: [f64; 2],
    /// Which the font states for it.
    width: f64,
}

/// Glyphs that are used so far.
struct Used<'f> {
    face: Face<'f>,
    /// To their numbers in the embedded font.
    numbers: GlyphRemapper,
    widths: BTreeMap<u16, f64>,
    /// What each represents.
    texts: BTreeMap<u16, String>,
}

/// The texts of a layout that need another font, and the font; nothing if there are none.
///
/// # Errors
/// When the font cannot be read, which a test excludes.
pub(super) fn of(layout: &Layout) -> io::Result<Letters> {
    let needed = needed(layout);
    if needed.is_empty() {
        return Ok(Letters::default());
    }
    let font = dejavu::sans::regular();
    let face = Face::from_slice(font, 0).ok_or_else(|| io::Error::other("DejaVu Sans is no font"))?;
    let mut used = Used { face, numbers: GlyphRemapper::new(), widths: BTreeMap::new(), texts: BTreeMap::new() };
    let lines = needed.into_iter().map(|text| (text.to_owned(), used.line(text))).collect();
    let objects = used.objects(font)?;
    Ok(Letters { objects, lines })
}

impl Used<'_> {
    fn thousandths(&self, units: i32) -> f64 {
        f64::from(units) * 1000.0 / f64::from(self.face.units_per_em())
    }

    /// A line of text as operators of a PDF for a size of 1, with what it says for whoever copies or searches it.
    fn line(&mut self, text: &str) -> Line {
        let (glyphs, width) = self.placed(text);
        let mut content = Content::new();
        content.begin_marked_content_with_properties(Name(b"Span")).properties().actual_text(TextStr(text));
        // Those at one height are one operator.
        let (mut pen, mut rise) = (0.0, 0.0);
        for glyphs in glyphs.chunk_by(|a, b| a.at[1] == b.at[1]) {
            if glyphs[0].at[1] != rise {
                rise = glyphs[0].at[1];
                content.set_rise((rise / 1000.0) as f32);
            }
            let mut shown = content.show_positioned();
            let mut items = shown.items();
            for glyph in glyphs {
                if (glyph.at[0] - pen).abs() > 0.01 {
                    items.adjust((pen - glyph.at[0]) as f32);
                }
                items.show(Str(&glyph.glyph.to_be_bytes()));
                pen = glyph.at[0] + glyph.width;
            }
        }
        if rise != 0.0 {
            content.set_rise(0.0);
        }
        content.end_marked_content();
        Line { operators: String::from_utf8_lossy(&content.finish()).into_owned(), width: width / 1000.0 }
    }

    /// The glyphs of a text, and the width of all of them.
    fn placed(&mut self, text: &str) -> (Vec<Placed>, f64) {
        let bidi = BidiInfo::new(text, None);
        let mut all = Vec::new();
        let mut pen = 0;
        for paragraph in &bidi.paragraphs {
            let (levels, runs) = bidi.visual_runs(paragraph, paragraph.range.clone());
            for run in runs {
                let is_rtl = levels[run.start].is_rtl();
                let mut buffer = UnicodeBuffer::new();
                buffer.push_str(&text[run.clone()]);
                buffer.set_direction(if is_rtl { Direction::RightToLeft } else { Direction::LeftToRight });
                buffer.guess_segment_properties();
                let shaped = rustybuzz::shape(&self.face, &[], buffer);
                let glyphs: Vec<(u16, usize)> =
                    shaped.glyph_infos().iter().map(|g| (g.glyph_id as u16, run.start + g.cluster as usize)).collect();
                self.note(&glyphs, text, run.end);
                for ((glyph, _), place) in glyphs.iter().zip(shaped.glyph_positions()) {
                    let width = self.face.glyph_hor_advance(rustybuzz::ttf_parser::GlyphId(*glyph)).unwrap_or_default();
                    let number = self.numbers.remap(*glyph);
                    let width = self.thousandths(width.into());
                    self.widths.insert(number, width);
                    let at = [self.thousandths(pen + place.x_offset), self.thousandths(place.y_offset)];
                    all.push(Placed { glyph: number, at, width });
                    pen += place.x_advance;
                }
            }
        }
        (all, self.thousandths(pen))
    }

    /// Keep what each glyph represents: the characters from its cluster to the next one; of several glyphs of a cluster the first.
    fn note(&mut self, glyphs: &[(u16, usize)], text: &str, end: usize) {
        let mut starts: Vec<usize> = glyphs.iter().map(|(_, at)| *at).collect();
        starts.sort_unstable();
        starts.dedup();
        for (glyph, at) in glyphs {
            let next = starts.iter().find(|start| *start > at).copied().unwrap_or(end);
            let number = self.numbers.remap(*glyph);
            self.texts.entry(number).or_insert_with(|| text[*at..next].to_owned());
        }
    }

    /// The font as objects.
    fn objects(&self, font: &[u8]) -> io::Result<Vec<Vec<u8>>> {
        let subset = subsetter::subset(font, 0, &self.numbers).map_err(io::Error::other)?;
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
        packed.write_all(&subset)?;
        let packed = packed.finish()?;
        let mut cmap = UnicodeCmap::<u16>::new(Name(b"Adobe-Identity-UCS"), SYSTEM);
        for (glyph, text) in &self.texts {
            cmap.pair_with_multiple(*glyph, text.chars());
        }
        let cmap = cmap.finish();
        let mut chunks: [Chunk; 5] = std::array::from_fn(|_| Chunk::new());
        let [one, two, three, four, five] = &mut chunks;
        let mut font = one.type0_font(FONT);
        font.base_font(NAME).encoding_predefined(Name(b"Identity-H")).descendant_font(CID_FONT).to_unicode(TO_UNICODE);
        font.finish();
        let mut cid = two.cid_font(CID_FONT);
        cid.subtype(CidFontType::Type2).base_font(NAME).system_info(SYSTEM).font_descriptor(DESCRIPTOR);
        cid.cid_to_gid_map_predefined(Name(b"Identity"));
        let mut widths = cid.widths();
        for (glyph, width) in &self.widths {
            widths.same(*glyph, *glyph, *width as f32);
        }
        widths.finish();
        cid.finish();
        let face = &self.face;
        let metric = |units: i16| self.thousandths(units.into()) as f32;
        let b = face.global_bounding_box();
        let mut descriptor = three.font_descriptor(DESCRIPTOR);
        descriptor.name(NAME).flags(FontFlags::SYMBOLIC).italic_angle(0.0).stem_v(80.0);
        descriptor.bbox(Rect::new(metric(b.x_min), metric(b.y_min), metric(b.x_max), metric(b.y_max)));
        descriptor.ascent(metric(face.ascender())).descent(metric(face.descender()));
        descriptor.cap_height(metric(face.capital_height().unwrap_or(face.ascender()))).font_file2(PROGRAM);
        descriptor.finish();
        let length = i32::try_from(subset.len()).map_err(io::Error::other)?;
        four.stream(PROGRAM, &packed).filter(Filter::FlateDecode).pair(Name(b"Length1"), length);
        five.stream(TO_UNICODE, &cmap);
        Ok(chunks.iter().map(|chunk| chunk.as_bytes().to_vec()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_measure::sheet::layout::{Anchor, Mark};

    fn layout(texts: &[&str]) -> Layout {
        let text =
            |words: &&str| Mark::Text { at: [0.0; 2], height: 3.0, anchor: Anchor::End, words: (*words).to_owned() };
        Layout { marks: texts.iter().map(text).collect(), letters: Letters::default() }
    }

    /// The letters of the text of a line, in the order in which they stand.
    fn glyphs(letters: &Letters, text: &str) -> usize {
        letters.lines[text].operators.matches("TJ").count()
    }

    #[test]
    fn latin_titles_need_no_font_and_arabic_ones_are_joined_from_right_to_left() {
        assert_eq!(of(&layout(&["Gereza (çé)", "Plan, 1:100"])).unwrap(), Letters::default());
        let title = "قلعة كلوة (Kilwa) 1505";
        let letters = of(&layout(&[title, "ب", "بب", "Plan"])).unwrap();
        assert_eq!(letters.lines.len(), 3);
        for (n, object) in letters.objects.iter().enumerate() {
            let text = String::from_utf8_lossy(object);
            assert!(text.starts_with(&format!("{} 0 obj", n + 1)) && text.ends_with("endobj\n\n"), "{text}");
        }
        assert!(letters.objects.iter().map(Vec::len).sum::<usize>() < 20_000, "only the glyphs that are used");
        assert!(glyphs(&letters, title) >= 1 && letters.lines[title].width > 5.0);
        // Joined letters are narrower than the same ones apart.
        let width = |text: &str| letters.lines[text].width;
        assert!(width("بب") < 2.0 * width("ب"), "{} {}", width("بب"), width("ب"));
        // The text itself, for whoever copies it.
        assert!(letters.lines["ب"].operators.contains("/ActualText"), "{}", letters.lines["ب"].operators);
    }
}
