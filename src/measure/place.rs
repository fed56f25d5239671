//! Points on the finest surface: what is nearest to a position, and which way the surface faces there.

use crate::source::FileSource;
use kilwa_geometry::Aabb;
use kilwa_geometry::distance::{Vec3, cross, dot, sub};
use kilwa_measure::{Picker, Ray, Refusal, Space, Surface};
use kilwa_pack::cut::Cut;
use kilwa_pack::{NO_DIAMOND, Reader};
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

/// What the numbers of a command line mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Given {
    /// Positions, of which the nearest points of the surface count.
    Near,
    /// Positions as they are.
    Exact,
    /// Rays.
    Rays,
}

/// The places of positions in world coordinates: nearest on the finest surface, or with `exact` the positions themselves.
pub(super) fn places(pack: &Reader<FileSource>, positions: &[Vec3], exact: bool) -> anyhow::Result<Vec<Place>> {
    let space = Space::new(pack.header().lattice);
    let one = |world: &Vec3| -> anyhow::Result<Place> {
        anyhow::ensure!(world.iter().all(|x| x.is_finite()), "a position must be three finite numbers");
        if exact {
            return Ok(Place { world: *world, local: space.local_from_world(*world), away: 0.0, normal: [0.0; 3] });
        }
        nearest(pack, &space, pack.header().lattice.steps_from_world(*world))
    };
    positions.iter().map(one).collect()
}

/// The places where rays (origin and direction, world coordinates) meet the finest surface first.
pub(super) fn along_rays(pack: &Reader<FileSource>, rays: &[Vec3]) -> anyhow::Result<Vec<Place>> {
    let space = Space::new(pack.header().lattice);
    let (pairs, rest) = rays.as_chunks::<2>();
    anyhow::ensure!(rest.is_empty(), "a ray is six numbers: its origin and its direction");
    pairs.iter().map(|[origin, direction]| cast(pack, &space, *origin, *direction)).collect()
}

fn cast(pack: &Reader<FileSource>, space: &Space, origin: Vec3, direction: Vec3) -> anyhow::Result<Place> {
    let is_sane = origin.iter().chain(&direction).all(|x| x.is_finite()) && direction != [0.0; 3];
    anyhow::ensure!(is_sane, "a ray needs a finite origin and a direction that is not zero");
    let ray = Ray { origin: space.steps_from_local(space.local_from_world(origin)), direction };
    let mut picker = Picker::new(ray, Vec::new());
    for (enters, i) in picker.order((0u32..).zip(pack.entries().iter().map(|e| &e.bounds))) {
        if !picker.wants(enters) {
            break;
        }
        let chunk = pack.chunk(i)?;
        for patch in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
            for t in patch.first..patch.first + patch.count {
                picker.add(chunk.mesh.corners(t as usize));
            }
        }
    }
    let picked = picker.picked().ok_or(Refusal::Misses {
        what: "the ray",
        hint: "check its origin and direction, which are world coordinates".to_owned(),
    })?;
    let local = space.local_from_steps(picked.point);
    let normal = unit_normal(picked.corners.map(|c| c.map(f64::from)));
    Ok(Place { world: space.world_from_local(local), local, away: 0.0, normal })
}

/// A point in local metres as it is, with the direction that the surface nearest to it faces.
pub(super) fn facing_at(pack: &Reader<FileSource>, space: &Space, local: Vec3) -> anyhow::Result<Place> {
    let world = space.world_from_local(local);
    let found = nearest(pack, space, space.steps_from_local(local))?;
    Ok(Place { world, local, away: 0.0, normal: found.normal })
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

/// The point of the surface nearest to `p` (lattice steps). Chunks are read nearest first and only while they can still hold a nearer point.
fn nearest(pack: &Reader<FileSource>, space: &Space, p: Vec3) -> anyhow::Result<Place> {
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
