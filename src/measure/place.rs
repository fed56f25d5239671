//! The points that a command line means.

use super::sweep::FileLeaves;
use glam::DVec3;
use kilwa_measure::clip::Clip;
use kilwa_measure::{Leaves, Place, Space, place};
use kilwa_pack::plural::counted;

/// What the numbers of a command line mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Given {
    /// Positions; the nearest points of the surface count.
    Near,
    /// Positions as they are.
    Exact,
    /// Rays.
    Rays,
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
    for world in positions {
        anyhow::ensure!(world.is_finite(), "a position must be three finite numbers");
        let local = space.local_from_world(world);
        places.push(match given {
            Given::Exact => Place { world, local, away: 0.0, normal: DVec3::ZERO },
            _ => place::nearest(leaves, local).await?,
        });
    }
    Ok(places)
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
