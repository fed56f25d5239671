//! Snapping: from a picked point to the vertex, crease or border of the finest surface that is nearest to it.
//!
//! A crease is an edge whose two triangles are bent by more than [`CREASE`]; a border is an edge of one triangle. Every triangle that
//! reaches into the sphere around the point is examined, whichever chunk it is in, so that an edge between two chunks is not taken for a border.

use crate::clip::Clip;
use crate::leaves::{Failure, Leaves};
use crate::place::box_distance;
use crate::points;
use crate::space::Space;
use glam::DVec3;
use kilwa_geometry::LatticePoint;
use kilwa_geometry::distance::point_triangle_squared;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Cosine of the angle between normals from which on an edge is a crease: 30 degrees.
pub const CREASE: f64 = 0.866_025_403_784_438_6;

/// What to snap to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Snap {
    /// Nothing: the point stays.
    #[default]
    None,
    /// Corners of triangles.
    Vertex,
    /// Edges where the surface is bent.
    Crease,
    /// Edges where the surface ends.
    Border,
}

/// The nearest of these within so many metres of a point (local metres); `None` if there is none. Of equals the one first in the order of
/// lattice points.
///
/// # Errors
/// The failure that kept the chunks from being read.
pub async fn snap<L: Leaves>(
    leaves: &L,
    local: DVec3,
    to: Snap,
    within: f64,
    clip: &Clip,
) -> Result<Option<DVec3>, Failure> {
    if to == Snap::None || within.is_nan() || within <= 0.0 {
        return Ok(None);
    }
    let space = Space::new(leaves.index().header().lattice);
    let (p, reach) = (space.steps_from_local(local), within / space.step());
    let near = leaves.wanted(|b| box_distance(p, b) <= reach);
    leaves.ahead(&near);
    let mut triangles = Vec::new();
    for i in near {
        let chunk = leaves.chunk(i).await?;
        triangles.extend(points::triangles(leaves.index(), &chunk).filter(|t| within_reach(p, t, reach)));
    }
    let mut best: Option<(f64, DVec3)> = None;
    let places = if points::is_of_points(leaves.index()) {
        triangles.iter().map(|t| points::center(*t)).collect()
    } else {
        candidates(&triangles, p, to)
    };
    for q in places {
        let d = (p - q).length_squared();
        if d <= reach * reach && clip.keeps(q) && best.is_none_or(|b| d < b.0) {
            best = Some((d, q));
        }
    }
    Ok(best.map(|b| space.local_from_steps(b.1)))
}

fn within_reach(p: DVec3, t: &[LatticePoint; 3], reach: f64) -> bool {
    point_triangle_squared(p, t.map(glam::IVec3::as_dvec3)) <= reach * reach
}

/// The points that count, in an order that does not depend on that of the triangles.
fn candidates(triangles: &[[LatticePoint; 3]], p: DVec3, to: Snap) -> Vec<DVec3> {
    if to == Snap::Vertex {
        let mut corners: Vec<LatticePoint> = triangles.iter().flatten().copied().collect();
        corners.sort_unstable_by_key(LatticePoint::to_array);
        corners.dedup();
        return corners.into_iter().map(glam::IVec3::as_dvec3).collect();
    }
    let mut edges: BTreeMap<[[i32; 3]; 2], Vec<Option<DVec3>>> = BTreeMap::new();
    for t in triangles {
        let [a, b, c] = t.map(glam::IVec3::as_dvec3);
        let normal = (b - a).cross(c - a).try_normalize();
        for i in 0..3 {
            let (a, b) = (t[i].to_array(), t[(i + 1) % 3].to_array());
            edges.entry([a.min(b), a.max(b)]).or_default().push(normal);
        }
    }
    let counts = |normals: &[Option<DVec3>]| match (to, normals) {
        (Snap::Border, [_]) => true,
        (Snap::Crease, [Some(m), Some(n)]) => m.dot(*n) < CREASE,
        _ => false,
    };
    let sharp = edges.iter().filter(|(_, normals)| counts(normals));
    sharp.map(|([a, b], _)| closest(p, LatticePoint::from(*a).as_dvec3(), LatticePoint::from(*b).as_dvec3())).collect()
}

/// The point of a stretch nearest to `p`.
fn closest(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let along = b - a;
    let square = along.length_squared();
    let t = if square > 0.0 { ((p - a).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 };
    a.lerp_monotonic(b, t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of a stair: a floor and a wall, sharing an edge at y = 100, x from 0 to 200.
    const STEP: [[LatticePoint; 3]; 4] = [
        [LatticePoint::new(0, 0, 0), LatticePoint::new(200, 0, 0), LatticePoint::new(200, 100, 0)],
        [LatticePoint::new(0, 0, 0), LatticePoint::new(200, 100, 0), LatticePoint::new(0, 100, 0)],
        [LatticePoint::new(0, 100, 0), LatticePoint::new(200, 100, 0), LatticePoint::new(200, 100, 100)],
        [LatticePoint::new(0, 100, 0), LatticePoint::new(200, 100, 100), LatticePoint::new(0, 100, 100)],
    ];

    #[test]
    fn creases_are_where_the_surface_is_bent_and_borders_where_it_ends() {
        let p = DVec3::new(50.0, 95.0, 0.0);
        assert_eq!(candidates(&STEP, p, Snap::Crease), [DVec3::new(50.0, 100.0, 0.0)]);
        let borders = candidates(&STEP, p, Snap::Border);
        assert_eq!(borders.len(), 6, "{borders:?}");
        assert!(borders.contains(&DVec3::new(0.0, 95.0, 0.0)) && !borders.contains(&DVec3::new(50.0, 100.0, 0.0)));
        assert_eq!(candidates(&STEP, p, Snap::Vertex).len(), 6);
        assert_eq!(candidates(&STEP[..2], p, Snap::Crease), Vec::<DVec3>::new(), "a flat diagonal is no crease");
    }

    #[test]
    fn a_triangle_outside_the_ball_is_ignored() {
        assert!(
            within_reach(DVec3::new(50.0, 95.0, 0.0), &STEP[2], 5.0)
                && !within_reach(DVec3::new(50.0, 94.0, 0.0), &STEP[2], 5.0)
        );
    }
}
