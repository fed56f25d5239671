//! The points that a command line means, and how far they are from the surface.

use super::sweep::FileLeaves;
use glam::DVec3;
use kilwa_measure::clip::Clip;
use kilwa_measure::{Failure, Leaves, Place, Refusal, Space, place};
use kilwa_pack::Metadata;
use kilwa_pack::plural::counted;

/// The part of the model's diagonal that a position may be away from the surface by default.
const SHARE_OF_DIAGONAL: f64 = 0.01;
/// The same in median edges: of a model of few triangles, positions are read off less exactly.
const MEDIAN_EDGES: f64 = 2.0;

/// What the numbers of a command line mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Given {
    /// Positions; the nearest points of the surface count.
    Near {
        /// How far from the surface they may be, metres.
        tolerance: f64,
    },
    /// Positions as they are.
    Exact,
    /// Rays.
    Rays,
}

/// How far a position may be from the surface if nothing else is said, metres.
pub(super) fn default_tolerance(m: &Metadata) -> f64 {
    let diagonal = (m.bounds_max - m.bounds_min).length();
    (SHARE_OF_DIAGONAL * diagonal).max(MEDIAN_EDGES * m.median_edge)
}

/// The places that numbers in world coordinates mean.
pub(super) async fn places(leaves: &FileLeaves, numbers: &[f64], given: Given) -> anyhow::Result<Vec<Place>> {
    let positions = positions(numbers)?;
    let mut places = Vec::with_capacity(positions.len());
    if given == Given::Rays {
        let (rays, rest) = positions.as_chunks::<2>();
        anyhow::ensure!(rest.is_empty(), "a ray is six numbers: its origin and its direction");
        for [origin, direction] in rays {
            places.push(place::cast(leaves, *origin, *direction, &Clip::default()).await?);
        }
        return Ok(places);
    }
    let space = Space::new(leaves.index().header().lattice);
    for (i, world) in positions.into_iter().enumerate() {
        anyhow::ensure!(world.is_finite(), "a position must be three finite numbers");
        let local = space.local_from_world(world);
        let nearest = place::nearest(leaves, local).await;
        places.push(if let Given::Near { tolerance } = given {
            let found = nearest?;
            let near = found.away <= tolerance;
            anyhow::ensure!(near, "{}", too_far(i + 1, world, found.away, tolerance, leaves.index().metadata()));
            found
        } else {
            let (away, registration) = match nearest {
                Ok(found) => (found.away, found.registration),
                // So far away that the distance overflows: it is used all the same.
                Err(Failure::Refused(Refusal::NotFinite)) => (f64::INFINITY, None),
                Err(why) => return Err(why.into()),
            };
            Place { world, local, away, normal: DVec3::ZERO, registration }
        });
    }
    Ok(places)
}

/// Why a position is refused, and what to do.
fn too_far(number: usize, at: DVec3, away: f64, tolerance: f64, m: &Metadata) -> String {
    let (low, high) = (m.bounds_min, m.bounds_max);
    let system = m.crs.as_deref().map_or_else(String::new, |crs| format!(" ({crs})"));
    format!(
        "position {number}, {} {} {}, is {} from the surface, more than the {} that are allowed. The model lies between \
         {:.3} {:.3} {:.3} and {:.3} {:.3} {:.3} m; give positions in its coordinates{system}, or allow more with \
         --tolerance METRES, or use them as they are with --exact",
        at.x,
        at.y,
        at.z,
        length(away),
        length(tolerance),
        low.x,
        low.y,
        low.z,
        high.x,
        high.y,
        high.z
    )
}

/// How far positions were from the surface: one number for each, in their order.
pub(super) fn distances(away: &[f64], given: Given) -> Option<String> {
    let all: Vec<String> = away.iter().copied().map(length).collect();
    let (last, before) = all.split_last()?;
    let list = if before.is_empty() { last.clone() } else { format!("{} and {last}", before.join(", ")) };
    let (one, many) = match given {
        Given::Rays => return None,
        Given::Near { .. } => ("the position given was", "the positions given were"),
        Given::Exact => ("the position is used as given:", "the positions are used as given:"),
    };
    Some(format!("{} {list} from the surface", if before.is_empty() { one } else { many }))
}

/// Metres to a tenth of a millimetre; whole kilometres do not need it.
fn length(metres: f64) -> String {
    if !metres.is_finite() {
        "an infinite distance".to_owned()
    } else if metres < 1000.0 {
        format!("{metres:.4} m")
    } else {
        format!("{metres:.0} m")
    }
}

/// Positions from a flat list of numbers.
pub(super) fn positions(numbers: &[f64]) -> anyhow::Result<Vec<DVec3>> {
    let (positions, rest) = numbers.as_chunks::<3>();
    anyhow::ensure!(
        rest.is_empty(),
        "positions are three numbers each, x y z; {} given",
        counted(numbers.len(), "number is", "numbers are")
    );
    Ok(positions.iter().copied().map(DVec3::from).collect())
}
