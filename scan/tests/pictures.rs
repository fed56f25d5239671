//! Pictures of stations in parts, and of all stations from above.

use crate::support::{Site, ptx_header, seen_from};
use glam::DVec2;
use kilwa_scan::panorama::{Show, Window, render, render_part};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
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

#[test]
fn parts_of_a_picture_make_up_the_whole() {
    let site = Site::new();
    let grid = site.write("grid.ptx", walls(&ptx_header(90, 30, [0.0; 3])));
    let cloud = site.write("cloud.xyz", walls(""));
    site.import(&[grid], ReadOptions::default()).unwrap();
    site.import(&[cloud], seen_from(0.0, 0.0, 0.0)).unwrap();
    for name in ["grid", "cloud"] {
        let mut reader = Reader::open(&site.survey().join(format!("stations/{name}.scan"))).unwrap();
        let whole = render(&mut reader, Show::Range, &mut [], 4096).unwrap();
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
