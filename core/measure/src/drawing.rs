//! A flat drawing to scale: the lines of a section, a profile or contours, with overall dimensions and a scale bar.
//!
//! Coordinates are metres, x to the right, y up. [`Drawing::to_svg`] and [`Drawing::to_dxf`] write it.

use crate::profile::{ProfileLine, drawn};
use crate::section::Section;
use glam::{DVec2, DVec3};

/// One line of a drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnLine {
    /// Its points, metres.
    pub points: Vec<DVec2>,
    /// Whether the last point is joined to the first.
    pub closed: bool,
    /// Height, metres, where the line is a contour.
    pub elevation: Option<f64>,
}

/// A drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// What it shows, for the title block.
    pub title: String,
    /// Further lines of the title block: the pack's hash, the plane, the accuracy.
    pub notes: Vec<String>,
    /// Name of the layer that the lines are on: letters, digits, hyphens.
    pub layer: String,
    /// The lines.
    pub lines: Vec<DrawnLine>,
    /// 50 for 1:50.
    pub scale: f64,
}

impl Drawing {
    /// A section in the coordinates of its plane: level to the right, upright up, seen against the plane's normal; `origin` is
    /// added, so that for example in an upright plane y can be the world's height.
    pub fn of_section(section: &Section, origin: DVec2, layer: &str) -> Self {
        let flat = |p: &DVec3| section.plane.coordinates(*p) + origin;
        let lines = section
            .polylines
            .iter()
            .map(|l| DrawnLine { points: l.points.iter().map(flat).collect(), closed: l.closed, elevation: None })
            .collect();
        Self { title: String::new(), notes: Vec::new(), layer: layer.to_owned(), lines, scale: 50.0 }
    }

    /// A straightened profile: way to the right, height (plus `height`) up.
    pub fn of_profile(lines: &[ProfileLine], height: f64) -> Self {
        let line = |l: &ProfileLine| DrawnLine {
            points: l.points.iter().map(|p| DVec2::new(p.x, p.y + height)).collect(),
            closed: false,
            elevation: None,
        };
        let lines = lines.iter().map(line).collect();
        Self { title: String::new(), notes: Vec::new(), layer: "PROFILE".to_owned(), lines, scale: 50.0 }
    }

    /// Contours in plan, each a level section with its world height; `east` and `north` are added to x and y.
    pub fn of_contours<'a>(contours: impl IntoIterator<Item = (f64, &'a Section)>, east: f64, north: f64) -> Self {
        let mut lines = Vec::new();
        for (height, section) in contours {
            for l in &section.polylines {
                let points: Vec<DVec2> = l.points.iter().map(|p| p.truncate() + DVec2::new(east, north)).collect();
                lines.push(DrawnLine { points, closed: l.closed, elevation: Some(height) });
            }
        }
        Self { title: String::new(), notes: Vec::new(), layer: "CONTOURS".to_owned(), lines, scale: 100.0 }
    }

    /// Smallest and largest coordinates; `None` without a point.
    pub fn bounds(&self) -> Option<(DVec2, DVec2)> {
        let mut points = self.lines.iter().flat_map(|l| &l.points);
        let first = *points.next()?;
        Some(points.fold((first, first), |(low, high), p| (low.min(*p), high.max(*p))))
    }

    /// Length of the scale bar, metres: 1, 2 or 5 times a power of ten, at most 80 mm on paper, more than 30.
    pub fn scale_bar(&self) -> f64 {
        let max = 0.08 * self.scale;
        let power = libm::pow(10.0, libm::floor(libm::log10(max)));
        [5.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|x| *x <= max).unwrap_or(power)
    }
}

/// Lines of a section in world coordinates, for formats with three dimensions: the first point repeated where closed.
pub fn world_lines(section: &Section, world_from_local: impl Fn(DVec3) -> DVec3) -> Vec<Vec<DVec3>> {
    section.polylines.iter().map(|l| drawn(l).into_iter().map(&world_from_local).collect()).collect()
}

/// A number with `digits` decimals, without needless zeros.
pub(crate) fn short(x: f64, digits: usize) -> String {
    let text = format!("{x:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn square() -> Drawing {
        Drawing {
            title: "Gate <west> & tower".to_owned(),
            notes: vec!["pack 0123456789abcdef".to_owned()],
            layer: "SECTION".to_owned(),
            lines: vec![
                DrawnLine {
                    points: vec![
                        DVec2::new(100.0, 5.0),
                        DVec2::new(110.0, 5.0),
                        DVec2::new(110.0, 8.0),
                        DVec2::new(100.0, 8.0),
                    ],
                    closed: true,
                    elevation: None,
                },
                DrawnLine {
                    points: vec![DVec2::new(101.0, 6.0), DVec2::new(102.0, 6.5)],
                    closed: false,
                    elevation: Some(6.0),
                },
            ],
            scale: 50.0,
        }
    }

    #[test]
    fn a_scale_bar_has_a_round_length_and_fits_the_paper() {
        let mut d = square();
        for (scale, bar) in [(50.0, 2.0), (1.0, 0.05), (100.0, 5.0), (200.0, 10.0), (20.0, 1.0), (1000.0, 50.0)] {
            d.scale = scale;
            assert!((d.scale_bar() - bar).abs() < 1e-12, "1:{scale}: {}", d.scale_bar());
        }
        assert_eq!(d.bounds(), Some((DVec2::new(100.0, 5.0), DVec2::new(110.0, 8.0))));
        assert_eq!((short(2.50, 3), short(-0.0001, 2), short(10.0, 0)), ("2.5".into(), "0".into(), "10".into()));
    }
}
