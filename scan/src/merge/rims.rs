//! The rims of a merged surface: edges that have one triangle, joined into loops.

use glam::DVec3;
use kilwa_scan_core::tsdf::Patch;
use std::collections::{BTreeMap, HashMap};

/// The vertex at which an edge of a rim begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RimVertex {
    /// Its number in the mesh.
    pub(super) number: u64,
    /// Metres, in the survey.
    pub(super) position: DVec3,
    pub(super) normal: DVec3,
    pub(super) color: Option<[u8; 3]>,
    /// NaN where there is none.
    pub(super) intensity: f32,
}

/// Collects the edges that have one triangle so far, directed as in their triangle.
#[derive(Debug, Default)]
pub(super) struct Rims {
    open: HashMap<[u64; 2], RimVertex>,
}

impl Rims {
    /// Add the triangles of a patch; `numbers` are those of its vertices in the mesh, `place` takes positions to the survey.
    pub(super) fn add(&mut self, patch: &Patch, numbers: &[u64], place: impl Fn(DVec3) -> DVec3) {
        let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let mut edges: Vec<[u32; 2]> = patch.triangles.iter().flat_map(sides).collect();
        // Both directions of an edge come next to each other.
        edges.sort_unstable_by_key(|[p, q]| (*p.min(q), *p.max(q)));
        let mut rest = edges.as_slice();
        while let [[p, q], more @ ..] = rest {
            if let [[r, s], after @ ..] = more
                && r == q
                && s == p
            {
                rest = after;
                continue;
            }
            rest = more;
            let [a, b] = [*p, *q].map(|k| numbers[k as usize]);
            self.toggle([a, b], || {
                let vertex = &patch.vertices[*p as usize];
                RimVertex {
                    number: a,
                    position: place(vertex.position),
                    normal: vertex.normal,
                    color: vertex.color,
                    intensity: vertex.intensity.unwrap_or(f32::NAN),
                }
            });
        }
    }

    /// Whether an edge has a triangle on its left only.
    pub(super) fn is_open(&self, edge: [u64; 2]) -> bool {
        self.open.contains_key(&edge)
    }

    /// Add an edge of a triangle; `begin` is the vertex where it begins. Returns whether that closed an open edge.
    pub(super) fn toggle(&mut self, [a, b]: [u64; 2], begin: impl FnOnce() -> RimVertex) -> bool {
        let closes = self.open.remove(&[b, a]).is_some();
        if !closes {
            self.open.insert([a, b], begin());
        }
        closes
    }

    /// The vertices of open edges, by their numbers.
    pub(super) fn vertices(&self) -> HashMap<u64, RimVertex> {
        self.open.iter().map(|([a, _], vertex)| (*a, *vertex)).collect()
    }

    /// The loops, each along its edges with the surface on its left, in the order of their smallest vertices.
    pub(super) fn loops(&self) -> Vec<Vec<RimVertex>> {
        let mut next: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        let mut vertices: HashMap<u64, RimVertex> = HashMap::new();
        for ([p, q], vertex) in &self.open {
            next.entry(*p).or_default().push(*q);
            vertices.insert(*p, *vertex);
        }
        for to in next.values_mut() {
            to.sort_unstable_by(|a, b| b.cmp(a));
        }
        let mut loops = Vec::new();
        while let Some((start, _)) = next.first_key_value() {
            let mut path = vec![*start];
            let mut places = HashMap::from([(*start, 0)]);
            while let Some(at) = path.last().copied() {
                let Some(to) = next.get_mut(&at) else { break };
                let step = to.pop();
                if to.is_empty() {
                    next.remove(&at);
                }
                let Some(step) = step else { break };
                // A vertex where two loops touch: the edges walked since the last visit form a loop of their own.
                if let Some(from) = places.get(&step).copied() {
                    let own: Vec<u64> = path.drain(from..).collect();
                    for k in &own {
                        places.remove(k);
                    }
                    loops.push(own);
                }
                // A loop that is closed ends the walk, unless it was only part of it.
                if path.is_empty() && !next.contains_key(&step) {
                    break;
                }
                places.insert(step, path.len());
                path.push(step);
            }
        }
        loops.sort_unstable_by_key(|own| own.iter().min().copied());
        let known = |own: Vec<u64>| own.iter().filter_map(|k| vertices.get(k).copied()).collect();
        loops.into_iter().map(known).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_scan_core::tsdf::{EdgeKey, PatchVertex};

    /// A square grid of cells in the plane z = 0, without some of its cells.
    fn patch(size: u32, without: &[(u32, u32)]) -> (Patch, Vec<u64>) {
        let mut patch = Patch::default();
        let side = size + 1;
        for k in 0..side * side {
            patch.vertices.push(PatchVertex {
                key: EdgeKey { at: [0; 3], axis: 0 },
                position: DVec3::new(f64::from(k % side), f64::from(k / side), 0.0),
                normal: DVec3::Z,
                color: None,
                intensity: None,
                quality: 1.0,
                stations: 1,
                variance: None,
                backing: None,
            });
        }
        for (x, y) in (0..size * size).map(|k| (k % size, k / size)).filter(|cell| !without.contains(cell)) {
            let a = y * side + x;
            patch.triangles.extend([[a, a + 1, a + side + 1], [a, a + side + 1, a + side]]);
        }
        let numbers = (0..u64::from(side * side)).collect();
        (patch, numbers)
    }

    fn lengths(size: u32, without: &[(u32, u32)]) -> Vec<usize> {
        let (patch, numbers) = patch(size, without);
        let mut rims = Rims::default();
        // In two parts, as from two bricks.
        let half = patch.triangles.len() / 2;
        for triangles in [&patch.triangles[..half], &patch.triangles[half..]] {
            rims.add(&Patch { triangles: triangles.to_vec(), ..patch.clone() }, &numbers, |p| p);
        }
        rims.loops().iter().map(Vec::len).collect()
    }

    #[test]
    fn rims_are_found_whole_also_across_patches_and_where_they_touch() {
        assert_eq!(lengths(6, &[]), [24]);
        assert_eq!(lengths(6, &[(2, 2)]), [24, 4]);
        assert_eq!(lengths(6, &[(2, 2), (3, 2), (2, 3), (3, 3)]), [24, 8]);
        // Two holes that touch at a corner are two loops.
        assert_eq!(lengths(6, &[(2, 2), (3, 3)]), [24, 4, 4]);
        assert_eq!(lengths(1, &[(0, 0)]), [0; 0]);
    }
}
