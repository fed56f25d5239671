//! One of the two surfaces that are compared, and how its points correspond to those of the other.

use glam::DVec3;
use kilwa_geometry::{LatticePoint, Mesh};
use rustc_hash::FxHashMap;

pub(super) const NONE: u32 = u32::MAX;

/// Of the triangles round a point only so many are looked at (the middle of a fan, the spine of a book of sheets): looking
/// at all of them for each of them would take quadratic time. Fewer candidates give a looser bound, never a wrong one.
pub(super) const HUB: usize = 128;

pub(super) type Triangle = [DVec3; 3];

/// For each of some things a list of numbers, all in one array.
pub(super) struct Lists {
    start: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// `pairs` are (list, item); the items of a list keep their order.
    fn new(lists: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut start = vec![0u32; lists + 1];
        for (l, _) in pairs.clone() {
            start[l as usize + 1] += 1;
        }
        for i in 0..lists {
            start[i + 1] += start[i];
        }
        let mut at = start.clone();
        let mut items = vec![0; start[lists] as usize];
        for (l, item) in pairs {
            let slot = &mut at[l as usize];
            items[*slot as usize] = item;
            *slot += 1;
        }
        Self { start, items }
    }

    pub(super) fn of(&self, list: u32) -> &[u32] {
        &self.items[self.start[list as usize] as usize..self.start[list as usize + 1] as usize]
    }
}

/// A surface. Points are positions: two vertices at one place are one point.
pub(super) struct Surface {
    /// Position of each point, relative to a common origin.
    pub(super) points: Vec<DVec3>,
    /// The points of each triangle.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The triangles round each point.
    pub(super) fans: Lists,
    /// The other triangle on each edge, from corner k to the next; [`NONE`] if there is none, are several, or it is
    /// wound the other way.
    pub(super) neighbours: Vec<[u32; 3]>,
    /// Whether any point is a hub.
    pub(super) has_hubs: bool,
    /// The sum of the area vectors round each point.
    pub(super) normals: Vec<DVec3>,
    /// For each point, points of the other surface that it corresponds to.
    pub(super) others: Lists,
}

impl Surface {
    /// `point_of` gives the point of each vertex of the mesh; `others` pairs of a point and one of the other surface.
    pub(super) fn new(
        mesh: &Mesh,
        origin: LatticePoint,
        triangles: Vec<[u32; 3]>,
        count: usize,
        others: impl Iterator<Item = (u32, u32)> + Clone,
    ) -> Self {
        let mut points = vec![DVec3::ZERO; count];
        for (corners, vertices) in triangles.iter().zip(&mesh.triangles) {
            for k in 0..3 {
                let p = mesh.positions[vertices[k] as usize];
                points[corners[k] as usize] = (p - origin).as_dvec3();
            }
        }
        let mut normals = vec![DVec3::ZERO; count];
        for t in &triangles {
            let [a, b, c] = t.map(|p| points[p as usize]);
            let n = (b - a).cross(c - a);
            for p in t {
                normals[*p as usize] += n;
            }
        }
        let corners = triangles.iter().zip(0u32..).flat_map(|(t, i)| t.map(|p| (p, i)));
        let fans = Lists::new(count, corners);
        let neighbours = neighbours(&triangles, &fans);
        let has_hubs = (0..count as u32).any(|p| fans.of(p).len() > HUB);
        Self { points, triangles, fans, neighbours, has_hubs, normals, others: Lists::new(count, others) }
    }

    pub(super) fn triangle(&self, t: u32) -> Triangle {
        self.triangles[t as usize].map(|p| self.points[p as usize])
    }

    /// The triangles round a point, the first of them where it is a hub.
    pub(super) fn fan(&self, p: u32) -> &[u32] {
        let all = self.fans.of(p);
        &all[..all.len().min(HUB)]
    }

    /// Whether more triangles meet at a point than are looked at.
    pub(super) fn is_hub(&self, p: u32) -> bool {
        self.has_hubs && self.fans.of(p).len() > HUB
    }
}

/// The other triangle on each edge, where it is the only one and runs along the edge the other way: then, where both face
/// the viewer, they lie on its two sides.
fn neighbours(triangles: &[[u32; 3]], fans: &Lists) -> Vec<[u32; 3]> {
    let mut out = vec![[NONE; 3]; triangles.len()];
    let mut between_hubs = None;
    for (t, corners) in (0u32..).zip(triangles) {
        for k in 0..3 {
            // Found from the other side.
            if out[t as usize][k] != NONE {
                continue;
            }
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let (round, end) = if fans.of(a).len() <= fans.of(b).len() { (a, b) } else { (b, a) };
            let other = if fans.of(round).len() <= HUB {
                let mut others = fans.of(round).iter().filter(|o| **o != t && triangles[**o as usize].contains(&end));
                others.next().copied().filter(|_| others.next().is_none())
            } else {
                let edges = between_hubs.get_or_insert_with(|| edges_between_hubs(triangles, fans));
                match edges.get(&[a.min(b), a.max(b)]) {
                    Some(&Users { first, second, count: 2 }) => Some(if first == t { second } else { first }),
                    _ => None,
                }
            };
            if let Some(other) = other {
                let o = triangles[other as usize];
                if let Some(i) = (0..3).find(|i| o[*i] == b && o[(i + 1) % 3] == a) {
                    out[t as usize][k] = other;
                    out[other as usize][i] = t;
                }
            }
        }
    }
    out
}

/// The triangles on an edge: the first two, and how many.
#[derive(Clone, Copy)]
struct Users {
    first: u32,
    second: u32,
    count: u32,
}

/// The edges both of whose ends are hubs, by their smaller and larger end: walking either fan for each would take
/// quadratic time.
fn edges_between_hubs(triangles: &[[u32; 3]], fans: &Lists) -> FxHashMap<[u32; 2], Users> {
    let is_hub = |p: u32| fans.of(p).len() > HUB;
    let mut edges = FxHashMap::default();
    for (t, corners) in (0u32..).zip(triangles) {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if is_hub(a) && is_hub(b) {
                let users = edges.entry([a.min(b), a.max(b)]).or_insert(Users { first: t, second: NONE, count: 0 });
                users.count += 1;
                if users.count == 2 {
                    users.second = t;
                }
            }
        }
    }
    edges
}

/// A list of triangles without repetitions.
pub(super) struct Candidates {
    pub(super) list: Vec<u32>,
    seen: Vec<u32>,
    round: u32,
}

impl Candidates {
    pub(super) fn new(of: usize) -> Self {
        Self { list: Vec::new(), seen: vec![0; of], round: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.list.clear();
        self.round += 1;
    }

    /// Add a triangle; whether it is new.
    pub(super) fn add(&mut self, t: u32) -> bool {
        let new = self.seen[t as usize] != self.round;
        if new {
            self.seen[t as usize] = self.round;
            self.list.push(t);
        }
        new
    }

    /// Add the triangles of `of` round the points that correspond to the corners of a triangle of the other surface.
    pub(super) fn round(&mut self, corners: [u32; 3], other: &Surface, of: &Surface) {
        for p in corners {
            for q in other.others.of(p) {
                for t in of.fan(*q) {
                    self.add(*t);
                }
            }
        }
    }

    /// Add the triangles round all corners of those on the list that are no hubs.
    pub(super) fn grow(&mut self, of: &Surface) {
        for i in 0..self.list.len() {
            for p in of.triangles[self.list[i] as usize].into_iter().filter(|p| !of.is_hub(*p)) {
                for t in of.fans.of(p) {
                    self.add(*t);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the docs of [`neighbours`] say it, triangle by triangle.
    fn one_by_one(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let edge = |t: [u32; 3], k: usize| (t[k], t[(k + 1) % 3]);
        let of = |(t, corners): (usize, &[u32; 3])| {
            [0, 1, 2].map(|k| {
                let (a, b) = edge(*corners, k);
                let at_edge = |o: &usize| *o != t && triangles[*o].contains(&a) && triangles[*o].contains(&b);
                let others: Vec<usize> = (0..triangles.len()).filter(at_edge).collect();
                match others[..] {
                    [o] if (0..3).any(|i| edge(triangles[o], i) == (b, a)) => o as u32,
                    _ => NONE,
                }
            })
        };
        triangles.iter().enumerate().map(of).collect()
    }

    #[test]
    fn neighbours_are_found_at_vertices_of_very_high_degree() {
        let mut generator = fastrand::Rng::with_seed(3);
        let mut random = |n: u32| generator.u32(..n);
        for points in [4, 30, 2000] {
            // Two hubs, 0 and 1, and triangles at random.
            let mut triangles: Vec<[u32; 3]> = (0..400).map(|i| [i % 2, 2 + random(points), 2003 + i]).collect();
            triangles.extend([[0, 1, 2], [1, 0, 3]]);
            if points == 30 {
                triangles.push([0, 1, 4]);
            }
            triangles.extend((0..400).map(|_| [random(20), 20 + random(points), 3000 + random(9)]));
            let corners = triangles.iter().zip(0u32..).flat_map(|(t, i)| t.map(|p| (p, i)));
            let fans = Lists::new(3100, corners);
            assert!([0, 1].iter().all(|p| fans.of(*p).len() > HUB));
            assert_eq!(neighbours(&triangles, &fans), one_by_one(&triangles), "{points}");
        }
    }
}
