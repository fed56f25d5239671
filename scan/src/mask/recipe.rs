//! What a mask is made by, and its options.

use glam::DVec3;
use kilwa_scan_core::mask::mixed;
use std::fmt::Write as _;
use std::path::PathBuf;

/// How the indices of a list of points count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Numbering {
    /// Every cell of the grid, also those without a point, as in PTX files.
    Cells,
    /// Measured points only.
    Points,
}

/// Which samples a mask takes out.
#[derive(Debug, Clone, PartialEq)]
pub enum Recipe {
    /// Samples between two surfaces one behind the other.
    Mixed(mixed::Options),
    /// Connected components of fewer samples than this.
    Isolated {
        /// Components of so many samples stay.
        min: u32,
    },
    /// Samples seen at more than this angle from the normal of the surface, degrees.
    Grazing {
        /// Degrees.
        limit: f64,
    },
    /// Samples in a box of the survey, metres.
    Inside([DVec3; 2]),
    /// Samples that are not in a box of the survey, metres.
    Outside([DVec3; 2]),
    /// Samples whose intensity is below the first or above the second limit.
    Intensity([f32; 2]),
    /// Samples that a file lists by their index.
    Points {
        /// The list.
        list: PathBuf,
        /// The column of the index, from 1, where there are several.
        column: Option<usize>,
        /// How indices count; `None`: as the format of the scan suggests.
        numbering: Option<Numbering>,
    },
    /// Samples that rays of other stations pass through.
    SeenThrough {
        /// How many other stations must agree.
        witnesses: u8,
        /// How much farther their rays must go, metres.
        margin: f64,
    },
}

impl Recipe {
    /// The name that its mask gets where none is given.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Mixed(_) => "mixed",
            Self::Isolated { .. } => "isolated",
            Self::Grazing { .. } => "grazing",
            Self::Inside(_) => "inside",
            Self::Outside(_) => "outside",
            Self::Intensity(_) => "intensity",
            Self::Points { .. } => "points",
            Self::SeenThrough { .. } => "seen-through",
        }
    }

    /// Its options as on the command line.
    pub fn made(&self) -> String {
        let mut made = format!("--{}", self.kind());
        let numbers = |[a, b]: [DVec3; 2]| {
            let all = a.to_array().into_iter().chain(b.to_array());
            all.map(|v| v.to_string()).collect::<Vec<_>>().join(",")
        };
        // Writing to a string cannot fail.
        let _ = match self {
            Self::Mixed(options) => write!(made, "={}", options.strictness),
            Self::Isolated { min } => write!(made, "={min}"),
            Self::Grazing { limit } => write!(made, "={limit}"),
            Self::Inside(bounds) | Self::Outside(bounds) => write!(made, "={}", numbers(*bounds)),
            Self::Intensity([min, max]) => write!(made, "={min},{max}"),
            Self::Points { list, column, numbering } => {
                let name = list.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                let column = column.map_or_else(String::new, |column| format!(" --column {column}"));
                let numbering = match numbering {
                    None => "",
                    Some(Numbering::Cells) => " --numbering cells",
                    Some(Numbering::Points) => " --numbering points",
                };
                write!(made, "={name}{column}{numbering}")
            }
            Self::SeenThrough { witnesses, margin } => write!(made, " --witnesses {witnesses} --margin {margin}"),
        };
        made
    }

    /// Whether it looks at neighbours in the grid.
    pub(super) fn needs_grid(&self) -> bool {
        matches!(self, Self::Mixed(_) | Self::Isolated { .. } | Self::Grazing { .. } | Self::SeenThrough { .. })
    }

    /// Whether it needs the pose of the station.
    pub(super) fn needs_pose(&self) -> bool {
        matches!(self, Self::Inside(_) | Self::Outside(_) | Self::SeenThrough { .. })
    }
}
