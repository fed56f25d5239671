//! What else is known of a measurement, in sentences.

use crate::message::{Message, MessageValue, ToMessage};
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
