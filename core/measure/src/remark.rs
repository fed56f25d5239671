//! What else is known of a measurement, in sentences.

use crate::message::{Message, MessageValue, ToMessage};
use crate::quantity::decimals;
use kilwa_pack::plural::{counted, plural};
use thiserror::Error;

/// One of them. `Display` is English.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Remark {
    /// How far from its plane a polygon counts the surface.
    #[error("included: the surface within {reach:.3} m of the polygon's plane")]
    Reach {
        /// Metres.
        reach: f64,
    },
    /// A volume below zero.
    #[error("the volume is negative: the surface is inside out")]
    InsideOut,
    /// Cut and fill of something that is not ground.
    #[error("the surface is a closed body without ground, so there is no fill")]
    Body,
    /// Of cut and fill.
    #[error("included: the surface within {reach:.3} m of the plane, which covers {:.1} % of the polygon", 100.0 * covered)]
    Covered {
        /// Metres.
        reach: f64,
        /// The share of the polygon.
        covered: f64,
    },
    /// Cut and fill of a surface with gaps.
    #[error("holes in the surface count as neither cut nor fill")]
    Holes,
    /// Of an area along the surface.
    #[error(
        "the area follows triangles with edges of {} on average; finer relief is not included",
        short(*spacing)
    )]
    Spacing {
        /// Metres.
        spacing: f64,
    },
    /// Of an area along a rough surface.
    #[error(
        "heights differ by about {} from one vertex to the next; if this is noise, it makes the area up to {:.1} % too large, which the uncertainty includes",
        short(*deviation),
        100.0 * share
    )]
    Rough {
        /// Standard deviation along the normal, metres.
        deviation: f64,
        /// What it adds to the area, as a share of it.
        share: f64,
    },
    /// Of a section.
    #[error(
        "{}, {open} {}, through {}",
        counted(*lines, "line", "lines"),
        plural(*lines, "open", "of them open"),
        counted(*triangles, "triangle", "triangles")
    )]
    Lines {
        /// Lines.
        lines: usize,
        /// Those that are not closed.
        open: usize,
        /// Triangles that were cut.
        triangles: u64,
    },
    /// Of contours.
    #[error("{} at {}", counted(*lines, "line", "lines"), counted(*heights, "height", "heights"))]
    Heights {
        /// Lines.
        lines: usize,
        /// Heights.
        heights: usize,
    },
}

impl ToMessage for Remark {
    fn message(&self) -> Message {
        let count = |n: usize| MessageValue::Count(n as u64);
        match *self {
            Self::Reach { reach } => Message::new("remark-reach", [("reach", MessageValue::Metres(reach))]),
            Self::InsideOut => Message::new("remark-inside-out", []),
            Self::Body => Message::new("remark-body", []),
            Self::Covered { reach, covered } => Message::new(
                "remark-covered",
                [("reach", MessageValue::Metres(reach)), ("share", MessageValue::Share(covered))],
            ),
            Self::Holes => Message::new("remark-holes", []),
            Self::Spacing { spacing } => Message::new("remark-spacing", [("spacing", MessageValue::Metres(spacing))]),
            Self::Rough { deviation, share } => Message::new(
                "remark-rough",
                [("deviation", MessageValue::Metres(deviation)), ("share", MessageValue::Share(share))],
            ),
            Self::Lines { lines, open, triangles } => Message::new(
                "remark-lines",
                [("lines", count(lines)), ("open", count(open)), ("triangles", MessageValue::Count(triangles))],
            ),
            Self::Heights { lines, heights } => {
                Message::new("remark-heights", [("lines", count(lines)), ("heights", count(heights))])
            }
        }
    }
}

/// A length with two significant digits: millimetres below a centimetre.
fn short(metres: f64) -> String {
    let (value, unit) = if metres < 0.01 { (metres * 1000.0, "mm") } else { (metres, "m") };
    let digits = decimals(value).min(6);
    format!("{value:.digits$} {unit}")
}
