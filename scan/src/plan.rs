//! The layout shared by all plans of a survey: the area shown, the scale bar, and the placement of labels. Used by the server's survey page and by the
//! report of a registration.
//!
//! A drawing has its own units: its longer side is [`LONGER`] units, x points right and y down.

use glam::DVec2;
use std::collections::HashMap;

/// Units of the drawing along its longer side.
pub const LONGER: f64 = 720.0;
/// Margin as a fraction of the longer side, and the minimum extent of a plan in metres.
const MARGIN: f64 = 0.05;
const MIN_EXTENT: f64 = 4.0;
/// The shorter side is at least this part of the longer one.
const MIN_ASPECT: f64 = 0.4;
/// Text sizes in units: on a phone, where the drawing is small, and on larger screens. The same as in server/assets/survey.css.
const TEXTS: [f64; 2] = [28.0, 15.0];
/// Radius of a station with its outline, in units.
pub const DOT: f64 = 9.0;

/// The bounding rectangle of points, with a margin and an aspect ratio suitable for display.
pub fn around(points: &[DVec2]) -> Option<[DVec2; 2]> {
    let min = points.iter().copied().reduce(DVec2::min)?;
    let max = points.iter().copied().reduce(DVec2::max)?;
    let middle = (min + max) / 2.0;
    let span = max - min;
    let span = span + 2.0 * MARGIN * span.max_element();
    let longer = span.max_element();
    let min_span = if longer < MIN_EXTENT { MIN_EXTENT } else { longer * MIN_ASPECT };
    let half = span.max(DVec2::splat(min_span)) / 2.0;
    let is_sound = middle.is_finite() && half.is_finite();
    is_sound.then_some([middle - half, middle + half])
}

/// A name beside its mark.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// Units, as text.
    pub x: String,
    /// Units, as text.
    pub y: String,
    /// `text-anchor` of SVG.
    pub anchor: &'static str,
    /// Whether it has room on large screens only.
    pub is_for_large: bool,
}

/// A bar of a round length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleBar {
    /// Units.
    pub length: f64,
    /// What that is on the ground.
    pub metres: f64,
}

/// A number in a drawing, to a tenth of a unit: smaller differences cannot be seen.
pub fn text(number: f64) -> String {
    format!("{number:.1}")
}

/// The longest bar of 1, 2 or 5 times a power of ten metres that is at most a third of the drawing.
pub fn bar(metres: f64, scale: f64) -> ScaleBar {
    let longest = metres / 3.0;
    let power = 10_f64.powf(longest.log10().floor());
    let metres = [5.0, 2.0, 1.0].map(|k| k * power).into_iter().find(|length| *length <= longest).unwrap_or(power);
    ScaleBar { length: metres * scale, metres }
}

/// A rectangle: its smallest x and y, and its largest.
type Rectangle = [f64; 4];

fn overlap(a: Rectangle, b: Rectangle) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Cell size of the grid for finding rectangles, in units: about the height of a label.
const SQUARE: f64 = 16.0;

/// Areas where no label may be placed.
#[derive(Clone, Default)]
struct Taken {
    by_square: HashMap<[i32; 2], Vec<Rectangle>>,
}

impl Taken {
    fn squares([x0, y0, x1, y1]: Rectangle) -> impl Iterator<Item = [i32; 2]> {
        let [x0, y0, x1, y1] = [x0, y0, x1, y1].map(|v| (v / SQUARE).floor() as i32);
        (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| [x, y]))
    }

    fn add(&mut self, rectangle: Rectangle) {
        for square in Self::squares(rectangle) {
            self.by_square.entry(square).or_default().push(rectangle);
        }
    }

    /// Rectangles in the squares of `a`, those in several squares as often.
    fn near(&self, a: Rectangle) -> impl Iterator<Item = &Rectangle> {
        Self::squares(a).filter_map(|square| self.by_square.get(&square)).flatten()
    }

    fn meets(&self, a: Rectangle) -> bool {
        self.near(a).any(|b| overlap(a, *b))
    }
}

/// Places labels beside their marks so that they do not overlap each other, other marks, or the scale bar. Earlier marks take precedence.
pub fn labels(marks: &[(&str, [f64; 2])], [width, height]: [f64; 2], bar: f64) -> Vec<Option<Label>> {
    let mut taken = Taken::default();
    for (_, [x, y]) in marks {
        taken.add([x - DOT, y - DOT, x + DOT, y + DOT]);
    }
    taken.add([0.0, height - 52.0, bar + 40.0, height]);
    taken.add([width - 76.0, 0.0, width, 84.0]);
    let mut taken = [taken.clone(), taken];
    let place = |name: &str, [x, y]: [f64; 2], size: f64| {
        let (long, high) = (name.chars().count() as f64 * 0.68 * size, 1.1 * size);
        let gap = DOT + 4.0;
        let beside = |x0: f64, y: f64| [x0, y - high / 2.0, x0 + long, y + high / 2.0];
        let (above, below) = (y - gap - high / 2.0, y + gap + high / 2.0);
        [
            (beside(x + gap, y), [x + gap, y], "start"),
            (beside(x - gap - long, y), [x - gap, y], "end"),
            (beside(x - long / 2.0, above), [x, above], "middle"),
            (beside(x - long / 2.0, below), [x, below], "middle"),
        ]
    };
    let mut find = |name: &str, at: [f64; 2]| {
        for (k, size) in TEXTS.into_iter().enumerate() {
            for (own, [x, y], anchor) in place(name, at, size) {
                let is_inside = own[0] >= 0.0 && own[1] >= 0.0 && own[2] <= width && own[3] <= height;
                if is_inside && !taken[k].meets(own) {
                    taken[k].add(own);
                    if k == 0 {
                        // On a large screen the same name is smaller.
                        let small = place(name, at, TEXTS[1]);
                        if let Some((own, ..)) = small.into_iter().find(|(.., other)| *other == anchor) {
                            taken[1].add(own);
                        }
                    }
                    return Some(Label { x: text(x), y: text(y), anchor, is_for_large: k == 1 });
                }
            }
        }
        None
    };
    marks.iter().map(|(name, at)| find(name, *at)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plan_is_never_a_line_or_a_point() {
        let [min, max] = around(&[DVec2::new(500_000.0, 9_000_000.0)]).unwrap();
        assert!((max - min - MIN_EXTENT).abs().max_element() < 1e-6);
        let [min, max] = around(&[DVec2::ZERO, DVec2::new(100.0, 0.0)]).unwrap();
        assert!(((max - min).x - 110.0).abs() < 1e-9 && (max - min).y >= 110.0 * MIN_ASPECT - 1e-9);
        assert_eq!(around(&[]), None);
        assert_eq!(around(&[DVec2::NAN]), None);
    }

    #[test]
    fn the_scale_bar_is_round_and_at_most_a_third() {
        for metres in [0.7, 4.0, 31.0, 100.0, 2600.0] {
            let bar = bar(metres, 10.0);
            assert!(bar.metres <= metres / 3.0 && bar.metres > metres / 3.0 / 2.6, "{metres}: {}", bar.metres);
            let mantissa = bar.metres / 10_f64.powf(bar.metres.log10().floor());
            assert!([1.0, 2.0, 5.0, 10.0].iter().any(|round| (mantissa - round).abs() < 1e-9), "{}", bar.metres);
        }
    }

    #[test]
    fn labels_do_not_overlap_and_those_that_do_not_fit_are_omitted() {
        let marks: Vec<(String, [f64; 2])> = (0..60)
            .map(|k| (format!("station_{k:03}"), [60.0 + f64::from(k % 8) * 80.0, 60.0 + f64::from(k / 8) * 60.0]))
            .collect();
        let named: Vec<(&str, [f64; 2])> = marks.iter().map(|(name, at)| (name.as_str(), *at)).collect();
        let found = labels(&named, [720.0, 540.0], 100.0);
        // The boxes on a small screen, where texts are larger.
        let boxed = |((name, _), label): (&(&str, [f64; 2]), &Option<Label>)| -> Option<[f64; 4]> {
            let label = label.as_ref().filter(|label| !label.is_for_large)?;
            let [x, y]: [f64; 2] = [label.x.parse().unwrap(), label.y.parse().unwrap()];
            let (long, high) = (name.len() as f64 * 0.68 * TEXTS[0], 1.1 * TEXTS[0]);
            let left = match label.anchor {
                "start" => x,
                "end" => x - long,
                _ => x - long / 2.0,
            };
            Some([left, y - high / 2.0, left + long, y + high / 2.0])
        };
        let boxes: Vec<[f64; 4]> = named.iter().zip(&found).filter_map(boxed).collect();
        for (k, a) in boxes.iter().enumerate() {
            // Coordinates are rounded when they are written.
            let overlaps =
                |b: &&[f64; 4]| a[0] + 0.2 < b[2] && b[0] + 0.2 < a[2] && a[1] + 0.2 < b[3] && b[1] + 0.2 < a[3];
            assert_eq!(boxes[..k].iter().find(overlaps), None, "{a:?}");
        }
        let large: Vec<_> = found.iter().flatten().filter(|label| !label.is_for_large).collect();
        let count = found.iter().flatten().count();
        assert!(large.len() > 3 && count > large.len() + 5 && count < 60, "{} of {count}", large.len());
        assert!(labels(&[("a", [5.0, 5.0])], [10.0, 10.0], 1.0)[0].is_none());
    }

    /// The time of a plan with very many marks does not grow with the square of their number.
    #[test]
    fn a_label_is_compared_with_the_few_rectangles_near_it_and_meets_those_that_overlap_it() {
        let mut rng = fastrand::Rng::with_seed(8);
        let mut rectangle = |width: f64, height: f64| {
            let [x, y] = [rng.f64() * 14_400.0, rng.f64() * 10_800.0];
            [x, y, x + width, y + height]
        };
        let marks: Vec<Rectangle> = (0..100_000).map(|_| rectangle(2.0 * DOT, 2.0 * DOT)).collect();
        let mut taken = Taken::default();
        for mark in &marks {
            taken.add(*mark);
        }
        let (mut compared, mut met) = (0, 0);
        for _ in 0..200 {
            let label = rectangle(100.0, 16.5);
            compared += taken.near(label).count();
            let meets = taken.meets(label);
            assert_eq!(meets, marks.iter().any(|mark| overlap(label, *mark)), "{label:?}");
            met += usize::from(meets);
        }
        assert!(compared < 200 * 100, "{compared} comparisons");
        assert!((20..=199).contains(&met), "{met} of 200");
    }
}
