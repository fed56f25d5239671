//! Points on the finest surface: what is nearest to a position, and which way the surface faces there.

use crate::source::FileSource;
use kilwa_geometry::Aabb;
use kilwa_geometry::distance::{Vec3, cross, dot, sub};
use kilwa_measure::{Space, Surface};
use kilwa_pack::Reader;
use kilwa_pack::cut::Cut;
use serde::Serialize;

/// A point of the finest surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Place {
    /// World coordinates, metres.
    pub(super) world: Vec3,
    /// Local metres.
    #[serde(skip)]
    pub(super) local: Vec3,
    /// How far it is from the position given, metres.
    pub(super) away: f64,
    /// Unit normal of the triangle there; zero for one without area.
    pub(super) normal: Vec3,
}

/// The places of positions in world coordinates: nearest on the finest surface, or with `exact` the positions themselves.
pub(super) fn places(pack: &Reader<FileSource>, positions: &[Vec3], exact: bool) -> anyhow::Result<Vec<Place>> {
    let space = Space::new(pack.header().lattice);
    let one = |world: &Vec3| -> anyhow::Result<Place> {
        anyhow::ensure!(world.iter().all(|x| x.is_finite()), "a position must be three finite numbers");
        if exact {
            return Ok(Place { world: *world, local: space.local_from_world(*world), away: 0.0, normal: [0.0; 3] });
        }
        nearest(pack, &space, *world)
    };
    positions.iter().map(one).collect()
}

/// Positions from a flat list of numbers.
pub(super) fn positions(numbers: &[f64]) -> anyhow::Result<Vec<Vec3>> {
    let whole = numbers.chunks_exact(3);
    anyhow::ensure!(
        whole.remainder().is_empty(),
        "positions are three numbers each, x y z; {} numbers are given",
        numbers.len()
    );
    Ok(whole.map(|p| [p[0], p[1], p[2]]).collect())
}

/// Chunks are read nearest first and only while they can still hold a nearer point.
fn nearest(pack: &Reader<FileSource>, space: &Space, world: Vec3) -> anyhow::Result<Place> {
    let p = pack.header().lattice.steps_from_world(world);
    let mut order: Vec<(f64, u32)> =
        (0u32..).zip(pack.entries()).map(|(i, e)| (box_distance(p, &e.bounds), i)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let finest = Cut::finest(pack.entries());
    let mut best: Option<(f64, Vec3, Vec3)> = None;
    for (lower, i) in order {
        if best.is_some_and(|b| lower > b.0) {
            break;
        }
        let chunk = pack.chunk(i)?;
        let triangles: Vec<[Vec3; 3]> = finest
            .drawn(&chunk.patches)
            .flat_map(|r| r.first..r.first + r.count)
            .map(|t| chunk.mesh.corners(t as usize).map(|c| c.map(f64::from)))
            .collect();
        let surface = Surface::new(triangles);
        if let Some((q, t)) = surface.nearest(p) {
            let d = dot(sub(p, q), sub(p, q)).sqrt();
            if best.is_none_or(|b| d < b.0) {
                let normal = surface.triangles().get(t as usize).map_or([0.0; 3], |t| unit_normal(*t));
                best = Some((d, q, normal));
            }
        }
    }
    let (d, q, normal) = best.ok_or_else(|| anyhow::anyhow!("the pack has no surface"))?;
    let local = space.local_from_steps(q);
    Ok(Place { world: space.world_from_local(local), local, away: d * space.step(), normal })
}

fn unit_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    let n = cross(sub(b, a), sub(c, a));
    let size = dot(n, n).sqrt();
    if size > 0.0 { n.map(|x| x / size) } else { [0.0; 3] }
}

fn box_distance(p: Vec3, b: &Aabb) -> f64 {
    if b.is_empty() {
        return f64::INFINITY;
    }
    (0..3)
        .map(|i| (f64::from(b.min[i]) - p[i]).max(p[i] - f64::from(b.max[i])).max(0.0))
        .map(|x| x * x)
        .sum::<f64>()
        .sqrt()
}
