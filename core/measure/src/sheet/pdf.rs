//! The marks of a sheet as operators of PDF: lines and letters as such, in Helvetica, so that they are sharp and can be selected and
//! searched. The font is named `F` in the page's resources. Source: ISO 32000-1.

use super::layout::{Anchor, Layout, Mark};
use std::fmt::Write as _;

/// Points of PDF in a millimetre.
pub const POINTS: f64 = 72.0 / 25.4;
/// Height of Helvetica's capitals for a size of 1.
const CAPITAL: f64 = 0.718;
/// Widths of Helvetica's signs from space to tilde, thousandths of the size (Adobe's font metrics).
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833,
    722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556,
    556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334,
    260, 334, 584,
];

/// All marks, on a page of this height in points.
pub fn operators(layout: &Layout, height: f64) -> String {
    let mut out = String::new();
    for mark in &layout.marks {
        draw(&mut out, mark, height);
    }
    out
}

/// One mark; PDF counts up from the lower edge.
fn draw(out: &mut String, mark: &Mark, height: f64) {
    let at = |p: &[f64; 2]| [p[0] * POINTS, height - p[1] * POINTS];
    match mark {
        Mark::Box { at: corner, size, grey } => {
            let [x, y] = at(corner);
            let [w, h] = size.map(|mm| mm * POINTS);
            let _ = writeln!(out, "{grey} g {x:.4} {:.4} {w:.4} {h:.4} re f", y - h);
        }
        Mark::Triangle { corners, grey } => {
            let [a, b, c] = corners.map(|p| at(&p));
            let _ = writeln!(
                out,
                "{grey} g {:.4} {:.4} m {:.4} {:.4} l {:.4} {:.4} l h f",
                a[0], a[1], b[0], b[1], c[0], c[1]
            );
        }
        Mark::Text { at: base, height: capital, anchor, words } => {
            let size = capital * POINTS / CAPITAL;
            let [x, y] = at(base);
            // WinAnsi has what Latin 1 has; other scripts stand in the document's title and in the pack.
            let bytes: Vec<u8> =
                words.chars().map(|c| if (' '..='\u{ff}').contains(&c) { c as u8 } else { b'?' }).collect();
            let wide = |b: &u8| f64::from(WIDTHS.get(usize::from(*b).wrapping_sub(32)).copied().unwrap_or(556));
            let width = bytes.iter().map(wide).sum::<f64>() * size / 1000.0;
            let left = match anchor {
                Anchor::Start => x,
                Anchor::Middle => x - width * 0.5,
                Anchor::End => x - width,
            };
            let hex: String = bytes.iter().fold(String::new(), |mut hex, b| {
                let _ = write!(hex, "{b:02X}");
                hex
            });
            let _ = writeln!(out, "0 g BT /F {size:.4} Tf {left:.4} {y:.4} Td <{hex}> Tj ET");
        }
    }
}
