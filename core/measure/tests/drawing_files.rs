//! Files of drawings, read by another reader (the crate `tiff`) or by the rules of their format, for any size and any strips.

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use glam::DVec3;
use kilwa_measure::sheet::file::{Format, Writer};
use kilwa_measure::sheet::georeference::GeoReference;
use kilwa_measure::sheet::layout::{Anchor, Layout, Mark};
use kilwa_measure::sheet::letters::{Line, needed};
use kilwa_measure::sheet::paper::Paper;
use kilwa_measure::sheet::{Sheet, View};
use proptest::prelude::*;
use std::io::{Read, Write};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

const CORNERS: (DVec3, DVec3) = (DVec3::new(500_000.0, 4_649_776.0, 100.0), DVec3::new(500_007.0, 4_649_779.0, 103.0));

/// A plan of this size on paper, mm.
fn plan(paper: [f64; 2], dpi: u32) -> Sheet {
    Sheet::new(View::Plan, CORNERS, (1000.0, dpi), Some(&Paper::Custom(paper)), true).expect("a sheet")
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}

/// A drawing file and its pixels.
fn file(sheet: &Sheet, format: Format, place: Option<GeoReference>) -> (Vec<u8>, Vec<u8>) {
    file_with(sheet, format, &Layout::default(), place)
}

fn file_with(sheet: &Sheet, format: Format, layout: &Layout, place: Option<GeoReference>) -> (Vec<u8>, Vec<u8>) {
    let [width, height] = sheet.pixels().expect("not too fine");
    let mut writer = Writer::new(format, sheet, layout, "Gereza (çé)", place).expect("not too fine").expect("strips");
    let (mut out, mut pixels) = (Vec::new(), Vec::new());
    let rows = Sheet::band_rows(width);
    for top in (0..height).step_by(rows as usize) {
        let count = rows.min(height - top);
        let band: Vec<u8> =
            (0..width * count * 3).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8 ^ top as u8).collect();
        let strip = packed(&band);
        out.extend(writer.strip(count, strip.len() as u64).expect("short"));
        out.extend(strip);
        pixels.extend(band);
    }
    let ending = writer.end().expect("short");
    out.extend(ending.tail);
    if let Some(head) = ending.head {
        out[..head.len()].copy_from_slice(&head);
    }
    (out, pixels)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_tiff_holds_the_given_rows_and_georeference(width in 20.0..60.0f64, height in 20.0..300.0f64, dpi in 25u32..150) {
        let sheet = plan([width, height], dpi);
        let place = GeoReference::of(&sheet, Some("EPSG:32737")).expect("a plan");
        let (bytes, pixels) = file(&sheet, Format::Tiff, Some(place.clone()));
        let mut decoder = Decoder::new(std::io::Cursor::new(bytes)).expect("a TIFF");
        let size = sheet.pixels().expect("not too fine");
        prop_assert_eq!(decoder.dimensions().expect("there"), (size[0], size[1]));
        let DecodingResult::U8(read) = decoder.read_image().expect("sound") else { panic!("bytes") };
        prop_assert_eq!(read, pixels);
        let pixel = 0.0254 / f64::from(dpi) * 1000.0;
        prop_assert_eq!(decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).expect("there"), vec![pixel, pixel, 0.0]);
        let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).expect("there");
        // The middle of the paper is the middle of the model.
        let middle = [500_003.5, 4_649_777.5];
        prop_assert!((tie[3] + width / 2.0 - middle[0]).abs() < 1e-8 && (tie[4] - height / 2.0 - middle[1]).abs() < 1e-8);
        prop_assert_eq!(decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).expect("there")[15], 32737);
        // The world file says the same of the first pixel's middle.
        let world: Vec<f64> = place.world_file().lines().map(|l| l.parse().expect("a number")).collect();
        prop_assert_eq!(&world[..4], &[pixel, 0.0, 0.0, -pixel]);
        prop_assert_eq!([world[4], world[5]], [tie[3] + pixel * 0.5, tie[4] - pixel * 0.5]);
    }

    #[test]
    fn the_cross_reference_table_of_a_pdf_is_exact_and_its_strips_hold_the_rows(width in 20.0..60.0f64, height in 20.0..300.0f64) {
        let sheet = plan([width, height], 60);
        let (bytes, pixels) = file(&sheet, Format::Pdf, None);
        has_objects_where_its_table_says(&bytes);
        let mut read = Vec::new();
        let mut rest = &bytes[..];
        while let Some(at) = find(rest, b"/FlateDecode /Length ") {
            let stream = at + find(&rest[at..], b"stream\n").expect("a stream") + 7;
            ZlibDecoder::new(&rest[stream..]).read_to_end(&mut read).expect("deflated");
            rest = &rest[stream..];
        }
        prop_assert_eq!(read, pixels);
    }
}

fn has_objects_where_its_table_says(bytes: &[u8]) {
    let end = bytes.len().saturating_sub(40);
    let last: String = bytes[end..].iter().map(|b| char::from(*b)).collect();
    let table = last.split("startxref\n").nth(1).and_then(|t| t.lines().next()).expect("there");
    let table = &bytes[table.parse::<usize>().expect("a number")..];
    let table = std::str::from_utf8(table).expect("a table is text");
    let offsets = table.lines().filter(|l| l.ends_with(" n ")).map(|l| l[..10].parse::<usize>().expect("digits"));
    for (n, at) in offsets.enumerate() {
        let begin = format!("{} 0 obj\n", n + 1);
        assert!(bytes[at..].starts_with(begin.as_bytes()), "object {}", n + 1);
    }
}

#[test]
fn a_pdf_shows_letters_of_other_scripts_in_the_font_that_it_begins_with() {
    let sheet = plan([40.0, 30.0], 60);
    let text = |words: &str| Mark::Text { at: [20.0, 10.0], height: 3.0, anchor: Anchor::End, words: words.to_owned() };
    let mut layout = Layout { marks: vec![text("Plan"), text("قلعة")], ..Layout::default() };
    let shown = |layout: &Layout| {
        let (bytes, _) = file_with(&sheet, Format::Pdf, layout, None);
        has_objects_where_its_table_says(&bytes);
        bytes.iter().map(|b| char::from(*b)).collect::<String>()
    };
    assert_eq!(needed(&layout).into_iter().collect::<Vec<_>>(), ["قلعة"]);
    let without = shown(&layout);
    assert!(without.contains("<3F3F3F3F> Tj") && !without.contains("/G"), "question marks without a font");
    let line = Line { operators: "[<00010002>] TJ".to_owned(), width: 2.0 };
    layout.letters.lines.insert("قلعة".to_owned(), line);
    layout.letters.objects = [1, 2].map(|n| format!("{n} 0 obj\n<<>>\nendobj\n").into_bytes()).to_vec();
    let with = shown(&layout);
    assert!(with.contains("/G 1 0 R") && with.contains("<506C616E> Tj") && !with.contains("<3F"));
    // The end of the line is where the text is anchored: 20 mm, less two sizes.
    let size = 3.0 * 72.0 / 25.4 / 0.718;
    let left = 20.0 * 72.0 / 25.4 - 2.0 * size;
    assert!(with.contains(&format!("/G 1 Tf {size:.4} 0 0 {size:.4} {left:.4} ")), "{left}");
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|w| w == what)
}

#[test]
fn a_picture_too_large_for_classic_offsets_is_a_bigtiff_with_small_strips() {
    let sheet = plan([6_000.0, 1_000.0], 400);
    let size = sheet.pixels().expect("not too fine");
    assert!(u64::from(size[0]) * u64::from(size[1]) * 3 > 3_900_000_000);
    let rows = Sheet::band_rows(size[0]);
    assert!(u64::from(rows) * u64::from(size[0]) * 4 <= 64 << 20);
    let mut writer =
        Writer::new(Format::Tiff, &sheet, &Layout::default(), "", None).expect("not too fine").expect("strips");
    // Strips that are as long as those of a photograph, without their bytes: offsets beyond 32 bits.
    let strips = size[1].div_ceil(rows);
    let head = writer.strip(rows, 400_000_000).expect("short");
    let mut at = head.len() as u64 + 400_000_000;
    for _ in 1..strips {
        at += writer.strip(rows, 400_000_000).expect("short").len() as u64 + 400_000_000;
    }
    let ending = writer.end().expect("short");
    let head = ending.head.expect("where the directory is");
    assert_eq!(&head[..4], b"II\x2b\0");
    let directory = u64::from_le_bytes(head[8..16].try_into().expect("eight"));
    assert!(directory > 1 << 33 && directory >= at && directory - at < ending.tail.len() as u64);
    let entries = &ending.tail[(directory - at) as usize..];
    assert_eq!(u64::from_le_bytes(entries[..8].try_into().expect("eight")), 13);
    assert_eq!(entries.len(), 8 + 13 * 20 + 8);
}

#[test]
fn all_bands_cover_the_frame_once_and_their_size_does_not_grow_with_the_sheet() {
    for (paper, dpi, widest) in [([300.0, 200.0], 100, 256), ([2_000.0, 60.0], 600, 2048), ([20.0, 20.0], 25, 64)] {
        let sheet =
            Sheet::new(View::South, CORNERS, (1000.0, dpi), Some(&Paper::Custom(paper)), true).expect("a sheet");
        let size = sheet.pixels().expect("not too fine");
        let rows = Sheet::band_rows(size[0]);
        let mut covered = 0;
        for top in (0..size[1]).step_by(rows as usize) {
            let parts = sheet.parts(size, top, rows.min(size[1] - top), widest);
            for (i, (at, part)) in parts.iter().enumerate() {
                assert!(part[0] <= widest && at[0] + part[0] <= size[0] && at[1] + part[1] <= size[1]);
                assert!(i == 0 || parts[i - 1].0[0] + parts[i - 1].1[0] == at[0]);
                covered += u64::from(part[0]) * u64::from(part[1]);
            }
        }
        assert_eq!(covered, u64::from(size[0]) * u64::from(size[1]));
    }
}
