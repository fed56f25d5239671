//! Marks painted onto bands of pixels.

use kilwa_measure::sheet::draw::Band;
use kilwa_measure::sheet::layout::{Anchor, Mark};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

/// Height of a capital, as a share of the font's height.
const CAPITAL: f64 = 0.66;
/// The base line from the top, as a share of the font's height.
const BASE: f64 = 0.78;
/// The sizes that the font comes in, pixels.
const SIZES: [(RasterHeight, f64); 4] = [
    (RasterHeight::Size16, 16.0),
    (RasterHeight::Size20, 20.0),
    (RasterHeight::Size24, 24.0),
    (RasterHeight::Size32, 32.0),
];

/// Paint marks onto a band; `scale` is pixels per millimetre.
pub(super) fn paint(band: &mut Band, marks: &[Mark], scale: f64) {
    let mut painter = Painter(band);
    for mark in marks {
        match mark {
            Mark::Box { at, size, grey } => painter.fill(*at, *size, *grey, scale),
            Mark::Triangle { corners, grey } => painter.triangle(*corners, *grey, scale),
            Mark::Text { at, height, anchor, words } => painter.text(*at, *height, *anchor, words, scale),
        }
    }
}

struct Painter<'a>(&'a mut Band);

impl Painter<'_> {
    /// Cover a pixel of the picture by `share` with a grey from 0 to 255; outside of the band nothing happens.
    fn blend(&mut self, x: i64, y: i64, grey: f64, share: f64) {
        let row = y - i64::from(self.0.top);
        if x < 0 || x >= i64::from(self.0.width) || row < 0 || row >= i64::from(self.0.rows) {
            return;
        }
        let at = (row as usize * self.0.width as usize + x as usize) * 3;
        for c in &mut self.0.rgb[at..at + 3] {
            *c = (f64::from(*c) * (1.0 - share) + grey * share).round() as u8;
        }
    }

    /// Edges fall on whole pixels, and a line is a pixel at least. The length is rounded, not both ends: a bar is as long as it
    /// says to half a pixel.
    fn fill(&mut self, at: [f64; 2], size: [f64; 2], grey: f64, scale: f64) {
        let low = at.map(|x| (x * scale).round() as i64);
        let high = [0, 1].map(|k| low[k] + (size[k] * scale).round() as i64);
        let (top, bottom) = (i64::from(self.0.top), i64::from(self.0.top) + i64::from(self.0.rows));
        for y in low[1].max(top)..high[1].max(low[1] + 1).min(bottom) {
            for x in low[0].max(0)..high[0].max(low[0] + 1).min(i64::from(self.0.width)) {
                self.blend(x, y, grey * 255.0, 1.0);
            }
        }
    }

    fn triangle(&mut self, corners: [[f64; 2]; 3], grey: f64, scale: f64) {
        let c = corners.map(|p| p.map(|x| x * scale));
        let of = |k: usize, pick: fn(f64, f64) -> f64| pick(pick(c[0][k], c[1][k]), c[2][k]);
        let turn =
            |a: [f64; 2], b: [f64; 2], p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let way = turn(c[0], c[1], c[2]).signum();
        let (top, bottom) = (f64::from(self.0.top), f64::from(self.0.top + self.0.rows));
        let rows = of(1, f64::min).floor().max(top) as i64..=of(1, f64::max).ceil().min(bottom) as i64;
        for y in rows {
            for x in of(0, f64::min).floor() as i64..=of(0, f64::max).ceil() as i64 {
                let p = [x as f64 + 0.5, y as f64 + 0.5];
                if (0..3).all(|i| turn(c[i], c[(i + 1) % 3], p) * way >= 0.0) {
                    self.blend(x, y, grey * 255.0, 1.0);
                }
            }
        }
    }

    fn text(&mut self, at: [f64; 2], height: f64, anchor: Anchor, words: &str, scale: f64) {
        let wanted = (height * scale / CAPITAL).max(1.0);
        // Of all sizes and their multiples the one nearest to what is wanted.
        let choices = SIZES.iter().flat_map(|&(size, pixels)| (1..=16).map(move |k| (size, pixels, k)));
        let off = |(_, pixels, k): &(RasterHeight, f64, i64)| (pixels * *k as f64 - wanted).abs();
        let Some((size, pixels, times)) = choices.min_by(|a, b| off(a).total_cmp(&off(b))) else { return };
        let advance = get_raster_width(FontWeight::Regular, size) as i64 * times;
        let length = advance * words.chars().count() as i64;
        let left = (at[0] * scale).round() as i64
            - match anchor {
                Anchor::Start => 0,
                Anchor::Middle => length / 2,
                Anchor::End => length,
            };
        let top = (at[1] * scale - BASE * pixels * times as f64).round() as i64;
        if top >= i64::from(self.0.top + self.0.rows) || top + (pixels as i64) * times <= i64::from(self.0.top) {
            return;
        }
        for (n, c) in words.chars().enumerate() {
            // Characters that the font lacks are shown as missing.
            let glyph = get_raster(c, FontWeight::Regular, size).or_else(|| get_raster('?', FontWeight::Regular, size));
            let Some(glyph) = glyph else { continue };
            for (y, row) in glyph.rows().enumerate() {
                for (x, &cover) in row.iter().enumerate().filter(|(_, cover)| **cover > 0) {
                    let corner = [left + n as i64 * advance + x as i64 * times, top + y as i64 * times];
                    for (i, j) in (0..times).flat_map(|i| (0..times).map(move |j| (i, j))) {
                        self.blend(corner[0] + i, corner[1] + j, 0.0, f64::from(cover) / 255.0);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_together_equal_a_single_picture() {
        let marks = [
            Mark::Box { at: [2.0, 3.0], size: [20.0, 1.0], grey: 0.0 },
            Mark::Triangle { corners: [[5.0, 5.0], [9.0, 12.0], [3.0, 11.0]], grey: 0.5 },
            Mark::Text { at: [25.0, 10.0], height: 3.0, anchor: Anchor::End, words: "Gereza 1:50 é".into() },
        ];
        let mut whole = Band::new(300, 0, 160);
        paint(&mut whole, &marks, 10.0);
        assert!(whole.rgb.contains(&0) && whole.rgb.contains(&128));
        let mut parts = Vec::new();
        for top in (0..160).step_by(7) {
            let mut band = Band::new(300, top, 7.min(160 - top));
            paint(&mut band, &marks, 10.0);
            parts.extend(band.rgb);
        }
        assert!(parts == whole.rgb);
    }

    #[test]
    fn a_scale_bar_is_exact_to_half_a_pixel() {
        for (scale, left) in [3.937, 5.906, 11.811, 23.622].into_iter().flat_map(|s| [(s, 3.3), (s, 3.35), (s, 16.0)]) {
            let mark = Mark::Box { at: [left, 2.0], size: [40.0, 2.0], grey: 0.0 };
            let mut band = Band::new(1400, 0, 120);
            paint(&mut band, &[mark], scale);
            let row = (3.0 * scale) as usize;
            let black = (0..1400).filter(|x| band.rgb[(row * 1400 + x) * 3] == 0).count();
            assert!((black as f64 - 40.0 * scale).abs() <= 0.5 + 1e-9, "{black} {}", 40.0 * scale);
        }
    }
}
