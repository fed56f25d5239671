//! Pictures of stations in parts, and of all stations from above.

use crate::support::{Site, ptx_header, seen_from};
use glam::DVec2;
use kilwa_scan::mask::{self, Recipe, Request, make};
use kilwa_scan::panorama::{Picture, Show, WIDTH_MAX, Window, pick, render, render_part};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::Survey;
use kilwa_scan::top_view::{TopView, extent};
use kilwa_scan_core::Pose;
use std::fmt::Write as _;

/// Two walls, at x = 4 and y = -3, as a cloud or as a grid of 90 × 30 cells.
fn walls(header: &str) -> String {
    let mut text = header.to_owned();
    for column in 0..90 {
        for row in 0..30 {
            let (along, up) = (f64::from(column % 45) * 0.1 - 2.0, f64::from(row) * 0.1 - 1.0);
            let [x, y] = if column < 45 { [4.0, along] } else { [along, -3.0] };
            writeln!(text, "{x:.3} {y:.3} {up:.3} 0.5 {column} {row} 9").unwrap();
        }
    }
    text
}

/// A survey with the stations `grid` and `cloud`, which saw the same walls.
fn both_forms() -> Site {
    let site = Site::new();
    let grid = site.write("grid.ptx", walls(&ptx_header(90, 30, [0.0; 3])));
    let cloud = site.write("cloud.xyz", walls(""));
    site.import(&[grid], ReadOptions::default()).unwrap();
    site.import(&[cloud], seen_from(0.0, 0.0, 0.0)).unwrap();
    site
}

/// A station, and its range picture with every cell.
fn picture(site: &Site, name: &str) -> (Reader, Picture) {
    let mut reader = Reader::open(&site.survey().join(format!("stations/{name}.scan"))).unwrap();
    let whole = render(&mut reader, Show::Range, &mut [], 4096).unwrap();
    (reader, whole)
}

#[test]
fn parts_of_a_picture_make_up_the_whole() {
    let site = both_forms();
    for name in ["grid", "cloud"] {
        let (mut reader, whole) = picture(&site, name);
        let [width, height] = whole.frame.size;
        assert_eq!((whole.width, whole.height), (width, height), "{name}");
        let mut pixels = vec![0; whole.pixels.len()];
        for (left, right) in [(0, 37), (37, width)] {
            for (top, bottom) in [(0, 11), (11, height)] {
                let part = Window { left, top, width: right - left, height: bottom - top };
                let picture = render_part(&mut reader, Show::Range, &mut [], &whole.frame, part).unwrap();
                for (row, line) in picture.pixels.chunks(3 * part.width as usize).enumerate() {
                    let at = 3 * ((top as usize + row) * width as usize + left as usize);
                    pixels[at..at + line.len()].copy_from_slice(line);
                }
            }
        }
        assert!(pixels == whole.pixels, "{name}");
        for (left, width) in [(width, 1), (0, width + 1), (u32::MAX, 2), (0, 0)] {
            let part = Window { left, top: 0, width, height: 1 };
            assert!(render_part(&mut reader, Show::Range, &mut [], &whole.frame, part).is_err(), "{name}: {part:?}");
        }
    }
}

#[test]
fn a_place_in_a_picture_is_the_sample_that_is_drawn_there() {
    let site = both_forms();
    for name in ["grid", "cloud"] {
        let (mut reader, whole) = picture(&site, name);
        let [width, height] = whole.frame.size;
        let mut measured = 0;
        for (column, row) in (0..width).flat_map(|column| (0..height).map(move |row| (column, row))) {
            let at = 3 * (row as usize * width as usize + column as usize);
            let is_drawn = whole.pixels[at..at + 3] != [12, 12, 16];
            let found = pick(&mut reader, &whole.frame, [column, row], 1).unwrap();
            assert_eq!(found.is_some(), is_drawn, "{name}: {column}, {row}");
            let Some(found) = found else { continue };
            measured += 1;
            assert_eq!(found.cell, [column, row], "{name}");
            let p = found.position;
            assert!((p.x - 4.0).abs() < 1e-4 || (p.y + 3.0).abs() < 1e-4, "{name}: {p}");
            if name == "grid" {
                assert!(
                    (found.spacing.unwrap() - 0.1).abs() < 1e-3,
                    "the points of the walls are 10 cm apart: {found:?}"
                );
            } else {
                // Left is where the azimuth is large, up is up.
                let [across, down] = [
                    0.5 - p.y.atan2(p.x) / std::f32::consts::TAU,
                    0.5 - (p.z / p.length()).asin() / std::f32::consts::PI,
                ];
                assert_eq!([across * width as f32, down * height as f32].map(|v| v as u32), [column, row], "{p}");
            }
        }
        assert!(measured > 700, "{name}: {measured}");
        for outside in [[width, 0], [0, height], [u32::MAX, u32::MAX]] {
            assert!(pick(&mut reader, &whole.frame, outside, 1).is_err(), "{name}: {outside:?}");
        }
    }
}

#[test]
fn near_a_place_without_a_sample_the_nearest_one_is_found() {
    let site = Site::new();
    let mut text = ptx_header(90, 30, [0.0; 3]);
    for column in 0..90 {
        for row in 0..30 {
            // One column of three is there.
            let range = if column % 3 == 0 { 5.0 } else { 0.0 };
            let (azimuth, up) = (f64::from(90 - column) * 0.01, f64::from(row) * 0.05);
            let [x, y, z] = [azimuth.cos(), azimuth.sin(), up].map(|v| v * range);
            writeln!(text, "{x:.4} {y:.4} {z:.4} 0.5 1 2 3").unwrap();
        }
    }
    let grid = site.write("grid.ptx", text);
    site.import(&[grid], ReadOptions::default()).unwrap();
    let (mut reader, Picture { frame, .. }) = picture(&site, "grid");
    let mut at = |column: u32, width: u32| pick(&mut reader, &frame, [column, 10], width).unwrap();
    assert!(at(30, 1).is_some() && at(31, 1).is_none() && at(31, 0).is_none());
    assert_eq!(at(31, 2).unwrap().cell, [30, 10]);
    assert_eq!(at(32, u32::MAX).unwrap().cell, [33, 10], "at most {WIDTH_MAX} cells");
    // Over the gaps, the spacing along the rows is that of adjacent cells: 5 m × 0.01. Along the columns it is 5 m × 0.05.
    assert!((at(30, 1).unwrap().spacing.unwrap() - 0.25).abs() < 1e-3, "{:?}", at(30, 1));

    let stations = vec!["grid".to_owned()];
    let request = Request { name: "all".to_owned(), recipe: Recipe::Intensity([0.6, 0.9]), stations };
    make(&site.survey(), &request, &kilwa_scan::import::Silent).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    let mut masked = mask::open(&site.survey(), survey.station("grid").unwrap(), false).unwrap();
    assert_eq!(pick(&mut masked, &frame, [30, 10], WIDTH_MAX).unwrap(), None, "what masks hide is not found");
}

#[test]
fn walls_are_where_they_are_from_above() {
    let site = Site::new();
    let grid = site.write("grid.ptx", walls(&ptx_header(90, 30, [0.0; 3])));
    site.import(&[grid], ReadOptions::default()).unwrap();
    let mut reader = Reader::open(&site.survey().join("stations/grid.scan")).unwrap();
    let [min, max] = extent(&mut reader, Pose::IDENTITY).unwrap().unwrap();
    assert!((min - DVec2::new(-2.0, -3.0)).abs().max_element() < 0.2, "{min}");
    assert!((max - DVec2::new(4.0, 2.4)).abs().max_element() < 0.2, "{max}");
    // A pixel for every metre.
    let mut view = TopView::new(DVec2::new(-5.0, -5.0), DVec2::new(5.0, 5.0), 10);
    assert_eq!(view.size(), [10, 10]);
    view.add(&mut reader, Pose::IDENTITY, 1).unwrap();
    let mut png_bytes = Vec::new();
    view.write_png(&mut png_bytes).unwrap();
    let mut decoder = png::Decoder::new(std::io::Cursor::new(&png_bytes)).read_info().unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    decoder.next_frame(&mut pixels).unwrap();
    // Rows from the top: y = 4.5 first.
    let is_dark = |x: usize, y: usize| pixels[2 * (y * 10 + x) + 1] > 0;
    let dark: Vec<_> = (0..10).flat_map(|y| (0..10).map(move |x| (x, y))).filter(|(x, y)| is_dark(*x, *y)).collect();
    // Columns of x = 4 and the row of y = -3, and nothing else.
    assert!(dark.iter().all(|(x, y)| *x == 9 || *y == 7), "{dark:?}");
    assert!(is_dark(9, 4) && is_dark(9, 6) && is_dark(3, 7) && is_dark(6, 7), "{dark:?}");
}
