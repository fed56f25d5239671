//! What a pixel shows, computed from the decoded chunks: the nearest drawn triangle that a ray meets.
//!
//! Exact for what is on screen (the drawn cut, not the finest level), in f64, in lattice units. No GPU and no waiting, so a wheel
//! event can zoom towards the surface in the very frame that it belongs to.

use crate::filled::is_hidden;
use crate::section::Clip;
use glam::{DVec3, IVec3};
use kilwa_geometry::Aabb;
use kilwa_geometry::distance::ray_triangle;
use kilwa_measure::Ray;
use kilwa_measure::interval::{Provisional, provisional, stretch};
use kilwa_pack::GpuChunk;
use kilwa_pack::vertex_layout::VERTEX_BYTES;
use kilwa_stream::DrawPatch;

/// A point of the drawn surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The place, in lattice units.
    pub point: DVec3,
    /// Certified error of the patch that was hit, metres: 0 where it is the finest.
    pub error: f32,
    /// Multiples of the ray's direction to the place.
    pub along: f64,
}

/// Which part of the cut a ray may meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// What is in the picture.
    Seen,
    /// Also what lies outside the picture: the ground under one's feet.
    Whole,
}

/// The nearest surface of the drawn cut along `origin + t * direction`, `t >= 0`, from either side, of what `clip`
/// leaves. `chunk` gives the decoded
/// form and the box of a chunk; patches whose chunk it does not give are passed over, and with `Scope::Seen` those
/// outside the picture.
pub fn nearest<'a>(
    origin: DVec3,
    direction: DVec3,
    patches: &[DrawPatch],
    scope: Scope,
    clip: &Clip,
    chunk: impl Fn(u32) -> Option<(&'a GpuChunk, Aabb)>,
) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    let mut current: Option<(u32, Option<&GpuChunk>)> = None;
    for patch in patches.iter().filter(|p| p.visible || scope == Scope::Whole) {
        let mesh = match current {
            Some((index, mesh)) if index == patch.chunk => mesh,
            _ => {
                let limit = best.map_or(f64::INFINITY, |b| b.along);
                let mesh = chunk(patch.chunk).filter(|(_, b)| meets(origin, direction, b, limit)).map(|(m, _)| m);
                current = Some((patch.chunk, mesh));
                mesh
            }
        };
        let Some(mesh) = mesh else { continue };
        let from = patch.first as usize * 3;
        let triangles = mesh.indices.get(from..from + patch.count as usize * 3).unwrap_or_default();
        for t in triangles.chunks_exact(3) {
            let Some(corners) = corners(mesh, t) else { continue };
            let Some(along) = ray_triangle(origin, direction, corners) else { continue };
            let point = origin + direction * along;
            if best.is_none_or(|b| along < b.along) && clip.keeps(point) {
                best = Some(Hit { point, error: patch.error, along });
            }
        }
    }
    best
}

/// Where along a ray the pick on the finest surface can lie, from the drawn cut of what `clip` leaves: see [`kilwa_measure::interval`]. A
/// finest triangle that the ray meets ends the search: nothing behind it counts. `step` is the lattice spacing in metres.
pub fn interval<'a>(
    ray: &Ray,
    patches: &[DrawPatch],
    clip: &Clip,
    step: f64,
    chunk: impl Fn(u32) -> Option<(&'a GpuChunk, Aabb)>,
) -> Provisional {
    let mut stretches = Vec::new();
    let mut first = f64::INFINITY;
    for patch in patches {
        let Some((mesh, bounds)) = chunk(patch.chunk) else { continue };
        let error = f64::from(patch.error) / step;
        let reach = error.ceil().clamp(0.0, 1e9) as i32;
        let reach = IVec3::splat(reach);
        let grown = Aabb { min: bounds.min.saturating_sub(reach), max: bounds.max.saturating_add(reach) };
        if bounds.is_empty() || !meets(ray.origin, ray.direction, &grown, first) {
            continue;
        }
        let from = patch.first as usize * 3;
        let triangles = mesh.indices.get(from..from + patch.count as usize * 3).unwrap_or_default();
        for t in triangles.chunks_exact(3).filter_map(|t| corners(mesh, t)) {
            stretches.extend(stretch(ray, t, error));
            if error == 0.0
                && let Some(at) = ray_triangle(ray.origin, ray.direction, t)
                && clip.keeps(ray.at(at))
            {
                first = first.min(at);
            }
        }
    }
    let kept = kilwa_measure::clip::stretches(clip, ray);
    let within = |(from, to): (f64, f64)| {
        kept.iter().map(move |(a, b)| (from.max(*a), to.min(*b).min(first))).filter(|(from, to)| from <= to)
    };
    provisional(stretches.into_iter().flat_map(within))
}

fn corners(mesh: &GpuChunk, triangle: &[u32]) -> Option<[DVec3; 3]> {
    if is_hidden(triangle) {
        return None;
    }
    let corner = |v: u32| {
        let at = v as usize * VERTEX_BYTES;
        let bytes = mesh.vertices.get(at..at + 12)?;
        let x = |i: usize| f64::from(i32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]));
        Some(DVec3::new(x(0), x(4), x(8)))
    };
    Some([corner(triangle[0])?, corner(triangle[1])?, corner(triangle[2])?])
}

/// Whether the ray meets the box before `limit`: slabs.
fn meets(origin: DVec3, direction: DVec3, bounds: &Aabb, limit: f64) -> bool {
    if bounds.is_empty() {
        return false;
    }
    let (mut from, mut to) = (0.0f64, limit);
    for i in 0..3 {
        let (low, high) = (f64::from(bounds.min[i]) - 0.5, f64::from(bounds.max[i]) + 0.5);
        if direction[i] == 0.0 {
            if origin[i] < low || origin[i] > high {
                return false;
            }
            continue;
        }
        let (a, b) = ((low - origin[i]) / direction[i], (high - origin[i]) / direction[i]);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    from <= to
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::HalfSpace;
    use kilwa_pack::{Chunk, NO_DIAMOND, PatchRange, interleave};

    fn squares() -> GpuChunk {
        // Two squares across the y axis, at y = 10 and y = 20.
        let mut chunk = Chunk::default();
        for y in [10, 20] {
            chunk.mesh.positions.extend([[0, y, 0], [8, y, 0], [8, y, 8], [0, y, 8]].map(IVec3::from_array));
        }
        chunk.mesh.triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        chunk.patches = vec![PatchRange { first: 0, count: 4, diamond: NO_DIAMOND }];
        interleave(&chunk)
    }

    #[test]
    fn the_interval_contains_the_pick_and_ends_at_the_first_finest_triangle() {
        let mesh = squares();
        let bounds = Aabb { min: IVec3::new(0, 10, 0), max: IVec3::new(8, 20, 8) };
        let ray = Ray { origin: DVec3::new(4.0, 0.0, 5.0), direction: DVec3::new(0.0, 2.0, 0.0) };
        let find = |errors: [f32; 2], clip: &Clip| {
            let patches = [
                DrawPatch { error: errors[0], ..patch(0, 2, true) },
                DrawPatch { error: errors[1], ..patch(2, 2, true) },
            ];
            interval(&ray, &patches, clip, 0.5, |_| Some((&mesh, bounds)))
        };
        // 0.5 m are one step and so half a multiple of the direction.
        let Provisional::Several(all) = find([0.5, 0.5], &Clip::default()) else { panic!("two surfaces") };
        assert!((all[0].0 - 4.5).abs() < 1e-6 && (all[0].1 - 5.5).abs() < 1e-6 && all.len() == 2, "{all:?}");
        let Provisional::Between { from, to } = find([0.0, 0.5], &Clip::default()) else { panic!("one surface") };
        assert!(from <= 5.0 && to >= 5.0 && to - from < 1e-6, "{from} {to}");
        let cut = Clip { plane: Some(HalfSpace { normal: DVec3::new(0.0, -1.0, 0.0), offset: -15.0 }), bounds: None };
        let Provisional::Between { from, to } = find([0.0, 0.5], &cut) else { panic!("one surface stays") };
        assert!(from < 10.0 && to > 10.0 && from > 9.0, "{from} {to}");
    }

    fn patch(first: u32, count: u32, visible: bool) -> DrawPatch {
        DrawPatch { chunk: 7, patch: 0, first, count, diamond: NO_DIAMOND, level: 0, error: 0.5, visible }
    }

    #[test]
    fn the_nearest_drawn_triangle_is_hit_and_hidden_patches_are_not() {
        let mesh = squares();
        let bounds = Aabb { min: IVec3::new(0, 10, 0), max: IVec3::new(8, 20, 8) };
        let find = |patches: &[DrawPatch], origin| {
            nearest(origin, DVec3::Y, patches, Scope::Seen, &Clip::default(), |c| (c == 7).then_some((&mesh, bounds)))
        };
        let all = [patch(0, 2, true), patch(2, 2, true)];
        let hit = find(&all, DVec3::new(4.0, 0.0, 5.0)).unwrap();
        assert_eq!((hit.point, hit.error), (DVec3::new(4.0, 10.0, 5.0), 0.5));
        assert_eq!(find(&all[1..], DVec3::new(4.0, 0.0, 5.0)).unwrap().point[1], 20.0);
        assert_eq!(find(&[patch(0, 2, false), patch(2, 2, true)], DVec3::new(4.0, 0.0, 5.0)).unwrap().point[1], 20.0);
        let behind = [patch(0, 2, false), patch(2, 2, false)];
        let whole = nearest(DVec3::new(4.0, 0.0, 5.0), DVec3::Y, &behind, Scope::Whole, &Clip::default(), |_| {
            Some((&mesh, bounds))
        })
        .unwrap();
        assert_eq!(whole.point[1], 10.0, "what is outside the picture is met where it is asked for");
        assert_eq!(find(&all, DVec3::new(4.0, 15.0, 5.0)).unwrap().point[1], 20.0);
        assert!(find(&all, DVec3::new(9.5, 0.0, 5.0)).is_none());
        assert!(find(&all, DVec3::new(4.0, 25.0, 5.0)).is_none());
        let half = HalfSpace { normal: DVec3::new(0.0, -1.0, 0.0), offset: -15.0 };
        let cut = Clip { plane: Some(half), bounds: None };
        let behind =
            nearest(DVec3::new(4.0, 0.0, 5.0), DVec3::Y, &all, Scope::Seen, &cut, |_| Some((&mesh, bounds))).unwrap();
        assert_eq!(behind.point[1], 20.0, "what is cut away is not hit");
        assert!(
            find(&[patch(2, 9, true)], DVec3::new(4.0, 0.0, 5.0)).is_none(),
            "a patch beyond the chunk is passed over"
        );
    }
}
