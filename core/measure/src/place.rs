//! Points of the finest surface: where a ray meets it first, what is nearest to a position, and which way the surface faces there.

use crate::clip::Clip;
use crate::leaves::{Failure, Leaves, finest, finest_triangles};
use crate::pick::{Picker, Ray, nearest_first};
use crate::points;
use crate::refusal::{Refusal, Target};
use crate::space::Space;
use crate::surface::Surface;
use glam::DVec3;
use kilwa_geometry::Aabb;
use kilwa_pack::metadata::REGISTRATION;
use kilwa_pack::{Chunk, Index};
use serde::Serialize;

/// Chunks that are fetched before it is known whether they are needed.
const AHEAD: usize = 4;

/// A point of the finest surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Place {
    /// World coordinates, metres.
    pub world: DVec3,
    /// Local metres.
    #[serde(skip)]
    pub local: DVec3,
    /// How far it is from the position given, metres.
    pub away: f64,
    /// Unit normal of the triangle there; zero for one without area.
    pub normal: DVec3,
    /// Standard uncertainty of a coordinate due to the registration of the stations, metres, if the pack stores it for each vertex. Set only for the
    /// place nearest to a position.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub registration: Option<f64>,
}

/// Where a ray (world coordinates) meets the finest surface first, of what `clip` (lattice units) leaves.
///
/// # Errors
/// [`Refusal::NoRay`], [`Refusal::Misses`], or what kept the chunks from being read.
pub async fn cast<L: Leaves>(leaves: &L, origin: DVec3, direction: DVec3, clip: &Clip) -> Result<Place, Failure> {
    let space = Space::new(leaves.index().header().lattice);
    if !origin.is_finite() || !direction.is_finite() || direction == DVec3::ZERO {
        return Err(Refusal::NoRay.into());
    }
    let ray = Ray { origin: space.steps_from_local(space.local_from_world(origin)), direction };
    let mut picker = Picker::clipped(ray, *clip);
    let entries = (0u32..).zip(leaves.index().entries()).filter(|(i, _)| leaves.may_hold_leaves(*i));
    let order = picker.order(entries.map(|(i, e)| (i, &e.bounds)));
    for (at, (enters, i)) in order.iter().enumerate() {
        if !picker.wants(*enters) {
            break;
        }
        let next = order.iter().skip(at).take(AHEAD).filter(|o| picker.wants(o.0));
        leaves.ahead(&next.map(|o| o.1).collect::<Vec<u32>>());
        points::triangles(leaves.index(), &leaves.chunk(*i).await?).for_each(|t| picker.add(t));
    }
    let picked = picker.picked().ok_or_else(|| Refusal::Misses {
        what: Target::Ray,
        hint: "check its origin and direction, which are world coordinates".to_owned(),
    })?;
    let is_of_points = points::is_of_points(leaves.index());
    let local = space.local_from_steps(if is_of_points { points::center(picked.corners) } else { picked.point });
    let normal = unit_normal(picked.corners.map(glam::IVec3::as_dvec3));
    let world = space.world_from_local(local);
    crate::refusal::finite(&[world])?;
    Ok(Place { world, local, away: 0.0, normal, registration: None })
}

/// A point in local metres as it is, with the direction that the surface nearest to it faces.
///
/// # Errors
/// As for [`nearest`].
pub async fn facing_at<L: Leaves>(leaves: &L, local: DVec3) -> Result<Place, Failure> {
    let found = nearest(leaves, local).await?;
    let world = Space::new(leaves.index().header().lattice).world_from_local(local);
    Ok(Place { world, local, away: 0.0, ..found })
}

/// The point of the surface nearest to a position in local metres. Chunks are read nearest first and only while they can still hold a nearer
/// point.
///
/// # Errors
/// A [`Refusal`] where the position is not finite or the pack has no surface, or what kept the chunks from being read.
pub async fn nearest<L: Leaves>(leaves: &L, local: DVec3) -> Result<Place, Failure> {
    crate::refusal::finite(&[local])?;
    let space = Space::new(leaves.index().header().lattice);
    let p = space.steps_from_local(local);
    crate::refusal::finite(&[p])?;
    let entries = (0u32..).zip(leaves.index().entries()).filter(|(i, _)| leaves.may_hold_leaves(*i));
    let mut order: Vec<(f64, u32)> = entries.map(|(i, e)| (box_distance(p, &e.bounds), i)).collect();
    nearest_first(&mut order);
    let channel = registration_channel(leaves.index());
    let mut best: Option<(f64, DVec3, DVec3, Option<f64>)> = None;
    for (at, &(lower, i)) in order.iter().enumerate() {
        if best.is_some_and(|b| lower > b.0) {
            break;
        }
        let likely = order.iter().skip(at).take(AHEAD).filter(|o| o.0 <= best.map_or(lower, |b| b.0));
        leaves.ahead(&likely.map(|o| o.1).collect::<Vec<u32>>());
        let chunk = leaves.chunk(i).await?;
        let found = if points::is_of_points(leaves.index()) {
            points::nearest(&chunk, p).map(|(q, t)| (q, unit_normal(t), None))
        } else {
            let surface = Surface::new(finest(&chunk).map(|t| t.map(glam::IVec3::as_dvec3)).collect());
            let normal = |t: u32| surface.triangles().get(t as usize).map_or(DVec3::ZERO, |t| unit_normal(*t));
            surface.nearest(p).map(|(q, t)| (q, normal(t), channel.and_then(|channel| scalar(&chunk, channel, t, q))))
        };
        if let Some((q, normal, registration)) = found {
            let d = (p - q).length();
            if best.is_none_or(|b| d < b.0) {
                best = Some((d, q, normal, registration));
            }
        }
    }
    let (d, q, normal, registration) = best.ok_or_else(|| match leaves.index().metadata().triangles {
        0 => Refusal::Misses { what: Target::Position, hint: "the pack contains no triangles".to_owned() },
        // So far away that the square of the distance overflows.
        _ => Refusal::NotFinite,
    })?;
    let local = space.local_from_steps(q);
    let (world, away) = (space.world_from_local(local), d * space.step());
    crate::refusal::finite(&[world, DVec3::splat(away)])?;
    Ok(Place { world, local, away, normal, registration })
}

/// The scalar channel that contains the uncertainty due to registration.
pub(crate) fn registration_channel(index: &Index) -> Option<usize> {
    index.metadata().scalars.iter().position(|channel| channel.name == REGISTRATION)
}

/// A scalar at a point of one of the finest triangles of a chunk, interpolated with barycentric weights.
fn scalar(chunk: &Chunk, channel: usize, triangle: u32, q: DVec3) -> Option<f64> {
    let triangle = finest_triangles(chunk).nth(triangle as usize)?;
    let [a, b, c] = chunk.mesh.corners(triangle).map(|p| p.as_dvec3() - q);
    let shares = [b.cross(c), c.cross(a), a.cross(b)].map(DVec3::length);
    let (mut sum, mut whole) = (0.0, 0.0);
    for (v, share) in chunk.mesh.triangles.get(triangle)?.iter().zip(shares) {
        sum += f64::from(*chunk.mesh.scalars.get(channel)?.get(*v as usize)?) * share;
        whole += share;
    }
    (sum >= 0.0 && whole > 0.0).then(|| sum / whole)
}

fn unit_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    let n = (b - a).cross(c - a);
    let size = n.length();
    if size > 0.0 { n / size } else { DVec3::ZERO }
}

/// From a point to a box, lattice units.
pub(crate) fn box_distance(p: DVec3, b: &Aabb) -> f64 {
    if b.is_empty() {
        return f64::INFINITY;
    }
    let outside = (b.min.as_dvec3() - p).max(p - b.max.as_dvec3());
    outside.max(DVec3::ZERO).length()
}
