//! Why there is no number: sentences for people.

use crate::message::{Message, MessageValue, ToMessage};
use glam::DVec3;
use kilwa_pack::plural::counted;
use thiserror::Error;

/// The part of a question that meets no surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A section plane.
    Plane,
    /// The outline of an area.
    Polygon,
    /// The region of a volume or a deviation.
    Region,
    /// The line of a profile.
    Profile,
    /// Contours in a range of heights.
    Contours,
    /// A ray.
    Ray,
    /// A position.
    Position,
}

impl std::fmt::Display for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Plane => "the plane",
            Self::Polygon => "the polygon",
            Self::Region => "the region",
            Self::Profile => "the line of the profile",
            Self::Contours => "the contours",
            Self::Ray => "the ray",
            Self::Position => "the position",
        })
    }
}

/// The reason that a tool gives instead of a number without meaning.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refusal {
    /// Not enough points.
    #[error("{tool} needs at least {}; {} given", counted(*needed, "point", "points"), counted(*given, "is", "are"))]
    TooFew {
        /// The tool.
        tool: &'static str,
        /// Points needed.
        needed: usize,
        /// Points given.
        given: usize,
    },
    /// Points that do not span what is asked for.
    #[error("the points lie on one line and do not determine {what}; add a point off that line")]
    Collinear {
        /// What they should fix.
        what: &'static str,
    },
    /// Two points that have to differ are the same.
    #[error("two of the points are at the same place; {what} needs different points")]
    Coincident {
        /// What needs them.
        what: &'static str,
    },
    /// A polygon whose sides cross.
    #[error("the sides of the polygon cross each other; move a point so that it encloses one area")]
    Crossing,
    /// A volume of something that encloses none.
    #[error(
        "the surface is not closed ({}), so that it encloses no volume; draw a region and measure \
         cut and fill against a plane instead",
        counted(*borders, "border edge", "border edges")
    )]
    Open {
        /// Edges that only one triangle uses.
        borders: u64,
    },
    /// A closed surface whose triangles do not agree on what is outside.
    #[error(
        "the triangles of the surface do not agree on which side is outside, so the enclosed volume is not defined"
    )]
    Inconsistent,
    /// Nothing there.
    #[error("{what} meets no surface; {hint}")]
    Misses {
        /// What.
        what: Target,
        /// What to do.
        hint: String,
    },
    /// Two points that no path joins.
    #[error(
        "between the two points the surface has a gap along the plane through them; measure the straight distance, or \
         set points on the way"
    )]
    Gap,
    /// A coordinate or the result is not finite.
    #[error("a coordinate or the result is not a finite number; give coordinates near the model")]
    NotFinite,
    /// Not a ray.
    #[error("a ray needs a finite origin and a direction that is not zero")]
    NoRay,
    /// A tool that needs a plane and got none.
    #[error("{tool} needs a plane; choose one")]
    NoPlane {
        /// The tool.
        tool: &'static str,
    },
    /// A tool that needs a surface, and a pack of points.
    #[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
    #[error(
        "this model is made of points, without a surface; measure coordinates, distances, angles, heights, circles or polygons"
    )]
    OfPoints,
    /// Only points are known, and the tool needs the surface.
    #[error("no value is available until the finest surface has been loaded")]
    Waits,
    /// How far a polygon counts the surface.
    #[error("the reach must be a positive length in metres; {metres} is given")]
    Reach {
        /// What was given.
        metres: f64,
    },
    /// Contours that are none or too many.
    #[error(
        "an interval of {metres} m is not possible: it must be positive and give at most {max} contours between {low} \
         and {high} m"
    )]
    Interval {
        /// What was given.
        metres: f64,
        /// Most contours.
        max: usize,
        /// The lowest point, world height.
        low: f64,
        /// The highest.
        high: f64,
    },
}

impl ToMessage for Refusal {
    fn message(&self) -> Message {
        let metres = |name, value: f64| (name, MessageValue::Metres(value));
        match *self {
            Self::TooFew { needed, given, .. } => Message::new(
                "refuse-few",
                [("needed", MessageValue::Count(needed as u64)), ("given", MessageValue::Count(given as u64))],
            ),
            Self::Collinear { .. } => Message::new("refuse-collinear", []),
            Self::Coincident { .. } => Message::new("refuse-same", []),
            Self::Crossing => Message::new("refuse-cross", []),
            Self::Open { borders } => Message::new("refuse-open", [("borders", MessageValue::Count(borders))]),
            Self::Inconsistent => Message::new("refuse-inside", []),
            Self::Misses { what: Target::Polygon | Target::Region, .. } => Message::new("refuse-misses-region", []),
            Self::Misses { what: Target::Contours, .. } => Message::new("refuse-misses-heights", []),
            Self::Misses { .. } => Message::new("refuse-misses", []),
            Self::Gap => Message::new("refuse-gap", []),
            Self::NotFinite => Message::new("refuse-not-finite", []),
            Self::NoRay => Message::new("refuse-no-ray", []),
            Self::NoPlane { .. } => Message::new("refuse-no-plane", []),
            #[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
            Self::OfPoints => Message::new("refuse-points", []),
            Self::Waits => Message::new("refuse-waits", []),
            Self::Reach { .. } => Message::new("refuse-reach", []),
            Self::Interval { metres: interval, max, low, high } => Message::new(
                "refuse-interval",
                [
                    metres("interval", interval),
                    ("most", MessageValue::Count(max as u64)),
                    metres("low", low),
                    metres("high", high),
                ],
            ),
        }
    }
}

/// All coordinates finite.
pub(crate) fn finite(points: &[DVec3]) -> Result<(), Refusal> {
    if points.iter().all(|p| p.is_finite()) { Ok(()) } else { Err(Refusal::NotFinite) }
}

/// At least so many points, all finite.
pub(crate) fn at_least(tool: &'static str, needed: usize, points: &[DVec3]) -> Result<(), Refusal> {
    finite(points)?;
    if points.len() < needed { Err(Refusal::TooFew { tool, needed, given: points.len() }) } else { Ok(()) }
}
