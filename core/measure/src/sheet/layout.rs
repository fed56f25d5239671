//! What stands on a sheet beside the model, in millimetres from the upper left corner of the paper.

use super::Sheet;
use super::View;
use super::letters::Letters;
use super::paper::{LABELS, MARGIN, STRIP};
use serde::Serialize;

/// Where the picture is on the paper, mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Frame {
    /// From the left edge of the paper.
    pub left: f64,
    /// From its upper edge.
    pub top: f64,
    /// Its width.
    pub width: f64,
    /// Its height.
    pub height: f64,
}

impl Frame {
    /// Its middle.
    pub fn middle(&self) -> [f64; 2] {
        [self.left + self.width * 0.5, self.top + self.height * 0.5]
    }
}

/// Where a text's point is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Anchor {
    /// At its beginning.
    Start,
    /// In its middle.
    Middle,
    /// At its end.
    End,
}

/// One thing on the sheet. Grey is 0 black to 1 white.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "is", rename_all = "lowercase")]
#[expect(missing_docs, reason = "each field is named in the sentence above it")]
pub enum Mark {
    /// A filled rectangle: left, top, width, height.
    Box { at: [f64; 2], size: [f64; 2], grey: f64 },
    /// A filled triangle.
    Triangle { corners: [[f64; 2]; 3], grey: f64 },
    /// A line of text: its base line, height of its capitals.
    Text { at: [f64; 2], height: f64, anchor: Anchor, words: String },
}

/// All of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Layout {
    /// In the order in which they are painted.
    pub marks: Vec<Mark>,
    /// Texts that a PDF shows in a font of its own.
    #[serde(skip)]
    pub letters: Letters,
}

/// What the title block says.
#[derive(Debug, Clone, PartialEq)]
pub struct Title {
    /// Of the model.
    pub name: String,
    /// Which drawing it is.
    pub view: View,
    /// Reference system.
    pub crs: Option<String>,
    /// Of the capture, metres.
    pub accuracy: Option<f64>,
    /// Of the pack.
    pub identity: String,
    /// Median edge of the surface, metres.
    pub spacing: f64,
}

/// Thickness of lines, mm.
const LINE: f64 = 0.25;

impl Layout {
    /// Of a sheet with this title.
    pub fn of(sheet: &Sheet, title: &Title) -> Self {
        let mut layout = Self::default();
        layout.frame(&sheet.frame);
        layout.grid(sheet, title.view);
        let top = sheet.frame.top + sheet.frame.height;
        layout.scale_bar(sheet, [MARGIN + 6.0, top + 9.0]);
        if title.view == View::Plan {
            layout.north([MARGIN + 96.0, top + 5.0]);
        }
        layout.title(sheet, title, top);
        layout
    }

    fn rule(&mut self, from: [f64; 2], to: [f64; 2], grey: f64) {
        let low = [from[0].min(to[0]) - LINE * 0.5, from[1].min(to[1]) - LINE * 0.5];
        let size = [(to[0] - from[0]).abs() + LINE, (to[1] - from[1]).abs() + LINE];
        self.marks.push(Mark::Box { at: low, size, grey });
    }

    fn text(&mut self, at: [f64; 2], height: f64, anchor: Anchor, words: impl Into<String>) {
        self.marks.push(Mark::Text { at, height, anchor, words: words.into() });
    }

    fn frame(&mut self, f: &Frame) {
        let (right, bottom) = (f.left + f.width, f.top + f.height + STRIP);
        let (left, top, middle) = (f.left, f.top, f.top + f.height);
        for (a, b) in [
            ([left, top], [right, top]),
            ([left, bottom], [right, bottom]),
            ([left, top], [left, bottom]),
            ([right, top], [right, bottom]),
            ([left, middle], [right, middle]),
        ] {
            self.rule(a, b, 0.0);
        }
    }

    /// Ticks with coordinates along the frame, and crosses where grid lines meet.
    fn grid(&mut self, sheet: &Sheet, view: View) {
        let f = &sheet.frame;
        let interval = round_length(0.04 * sheet.scale);
        let per_metre = 1000.0 / sheet.scale;
        let middle = f.middle();
        let low = [sheet.middle[0] - f.width * 0.5 / per_metre, sheet.middle[1] - f.height * 0.5 / per_metre];
        let high = [sheet.middle[0] * 2.0 - low[0], sheet.middle[1] * 2.0 - low[1]];
        let at = |k: usize, v: f64| {
            let d = (v - sheet.middle[k]) * per_metre;
            if k == 0 { middle[0] + d } else { middle[1] - d }
        };
        let ticks = |k: usize| {
            let first = (low[k] / interval).ceil() as i64;
            let last = (high[k] / interval).floor() as i64;
            (first..=last).map(|i| i as f64 * interval).collect::<Vec<f64>>()
        };
        let (xs, ys) = (ticks(0), ticks(1));
        let inside = |k: usize, v: f64| {
            let (from, size) = if k == 0 { (f.left, f.width) } else { (f.top, f.height) };
            at(k, v) > from + LABELS && at(k, v) < from + size - LABELS
        };
        // To the east x grows to the right; from the north and the west it grows to the left.
        let sign = if matches!(view, View::North | View::West) { -1.0 } else { 1.0 };
        let digits = (-libm::log10(interval).floor()).max(0.0) as usize;
        for &x in xs.iter().filter(|x| inside(0, **x)) {
            let label = format!("{:.digits$}", sign * x + 0.0);
            for (edge, inner, base) in [(f.top, 2.0, 5.5), (f.top + f.height, -2.0, -3.0)] {
                self.rule([at(0, x), edge], [at(0, x), edge + inner], 0.0);
                self.text([at(0, x), edge + base], 1.8, Anchor::Middle, label.clone());
            }
        }
        for &y in ys.iter().filter(|y| inside(1, **y)) {
            let label = format!("{:.digits$}", y + 0.0);
            for (edge, inner, anchor) in [(f.left, 2.0, Anchor::Start), (f.left + f.width, -2.0, Anchor::End)] {
                self.rule([edge, at(1, y)], [edge + inner, at(1, y)], 0.0);
                self.text([edge + inner * 1.4, at(1, y) + 0.9], 1.8, anchor, label.clone());
            }
            for &x in xs.iter().filter(|x| inside(0, **x)) {
                self.rule([at(0, x) - 1.5, at(1, y)], [at(0, x) + 1.5, at(1, y)], 0.35);
                self.rule([at(0, x), at(1, y) - 1.5], [at(0, x), at(1, y) + 1.5], 0.35);
            }
        }
    }

    /// Alternating black and white, four parts.
    fn scale_bar(&mut self, sheet: &Sheet, at: [f64; 2]) {
        let metres = round_length(0.08 * sheet.scale);
        let width = metres * 1000.0 / sheet.scale;
        self.marks.push(Mark::Box { at, size: [width, 3.0], grey: 0.0 });
        for k in [1.0, 3.0] {
            let inner = [at[0] + width * k / 4.0 + LINE * 0.5, at[1] + LINE];
            self.marks.push(Mark::Box { at: inner, size: [width / 4.0 - LINE, 3.0 - 2.0 * LINE], grey: 1.0 });
        }
        for k in [0.0, 2.0, 4.0] {
            let words = short(metres * k / 4.0) + if k == 4.0 { " m" } else { "" };
            self.text([at[0] + width * k / 4.0, at[1] - 1.2], 2.0, Anchor::Middle, words);
        }
        self.text([at[0], at[1] + 8.0], 2.5, Anchor::Start, format!("1:{}", short(sheet.scale)));
        let dots = format!("{} dpi, a pixel is {} m", sheet.dpi, short(sheet.metres_per_pixel()));
        self.text([at[0], at[1] + 12.5], 1.8, Anchor::Start, dots);
    }

    fn north(&mut self, at: [f64; 2]) {
        let tip = [at[0], at[1]];
        self.marks
            .push(Mark::Triangle { corners: [tip, [at[0] - 3.5, at[1] + 13.0], [at[0], at[1] + 10.0]], grey: 0.0 });
        self.marks
            .push(Mark::Triangle { corners: [tip, [at[0] + 3.5, at[1] + 13.0], [at[0], at[1] + 10.0]], grey: 0.6 });
        self.text([at[0], at[1] + 18.0], 2.5, Anchor::Middle, "N");
    }

    fn title(&mut self, sheet: &Sheet, title: &Title, top: f64) {
        let right = sheet.frame.left + sheet.frame.width - 4.0;
        let view = match title.view {
            View::Plan => "Plan",
            View::North => "North elevation",
            View::East => "East elevation",
            View::South => "South elevation",
            View::West => "West elevation",
        };
        self.text([right, top + 8.0], 3.0, Anchor::End, &*title.name);
        let axes = match title.view {
            View::Plan => "x east, y north",
            View::North | View::South => "x east, z up",
            _ => "y north, z up",
        };
        let crs = title.crs.as_deref().unwrap_or("local coordinates");
        self.text([right, top + 13.5], 2.2, Anchor::End, format!("{view}, {axes}, metres, {crs}"));
        let accuracy = title.accuracy.map_or("unknown".to_owned(), |a| format!("{} m", short(a)));
        let capture = format!("capture accuracy {accuracy}, points every {} m", short(title.spacing));
        self.text([right, top + 18.5], 1.8, Anchor::End, capture);
        self.text([right, top + 23.0], 1.8, Anchor::End, format!("pack {}", title.identity));
        self.text([right, top + 27.0], 1.8, Anchor::End, concat!("drawn with Kilwa ", env!("CARGO_PKG_VERSION")));
    }
}

/// The largest 1, 2 or 5 times a power of ten that is at most `most`.
fn round_length(max: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(max)));
    [5.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|x| *x <= max * (1.0 + 1e-9)).unwrap_or(power)
}

/// Up to six significant digits, no needless zeros.
fn short(x: f64) -> String {
    let digits = (5.0 - libm::floor(libm::log10(x.abs().max(1e-12)))).clamp(0.0, 9.0) as usize;
    let text = format!("{x:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
