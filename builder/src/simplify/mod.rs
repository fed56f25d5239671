//! Edge-collapse simplification of one diamond's fragment, on the lattice, with the guarantees that the hierarchy rests
//! on (design/hierarchy.md, construction steps 4 to 6):
//!
//! * a locked point (one that another diamond also uses) neither moves nor changes its attributes, and every edge
//!   between two locked points is used by as many triangles afterwards as before: the neighbours cannot tell;
//! * every edge used by one triangle inside the fragment either joins two locked points as before or carries the
//!   true-border bit;
//! * no component vanishes, no triangle is doubled, none flips;
//! * the result depends on the fragment's geometry alone, not on the order in which it was handed in.
//!
//! Points are lattice positions; a point may carry several *wedges* (the same place with other attributes). Topology is
//! that of the points, attributes ride on the wedges. Colours of merged wedges are averaged in linear light.

mod collapse;
mod quadric;

use kilwa_geometry::distance::Vec3;
use kilwa_geometry::{LatticePoint, Mesh, normal};
use quadric::Quadric;
use rustc_hash::FxHashMap;
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashSet};
use std::hash::BuildHasher;

const NONE: u32 = u32::MAX;

/// A point where more corners meet (the middle of a fan, the spine of a book of sheets) stays where it is: looking at all
/// its edges for each of them would take cubic time. What surrounds it is simplified all the same.
const HUB: u32 = 128;

/// Relative weight of a colour difference across a collapsed edge, against moving the surface by the edge's length.
const COLOR_WEIGHT: f64 = 2e-3;

struct Point {
    at: LatticePoint,
    /// Position relative to the fragment's centre.
    local: Vec3,
    quadric: Quadric,
    locked: bool,
    alive: bool,
    version: u32,
    /// First and last corner of the list of corners at this point.
    head: u32,
    tail: u32,
    /// Length of that list, dead corners included.
    corners: u32,
}

/// Sums of what a wedge stands for.
struct Wedge {
    point: u32,
    source: u32,
    weight: f32,
    /// Linear light.
    color: [f32; 3],
    normal: [f32; 3],
    changed: bool,
}

/// One neighbour of a point.
#[derive(Clone, Copy)]
struct Neighbour {
    point: u32,
    /// Triangles on the edge to it, inside the fragment.
    count: u32,
    /// Whether one of them carries the true-border bit there.
    border: bool,
}

/// An edge waiting to be collapsed, cheapest first; ties by point number, which follows the canonical point order.
struct Candidate {
    cost: f64,
    keep: u32,
    remove: u32,
    versions: [u32; 2],
    target: LatticePoint,
}

impl PartialEq for Candidate {
    fn eq(&self, o: &Self) -> bool {
        self.cmp(o) == Ordering::Equal
    }
}
impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        Some(self.cmp(o))
    }
}
impl Ord for Candidate {
    /// Reversed: the heap's greatest is the cheapest.
    fn cmp(&self, o: &Self) -> Ordering {
        o.cost.total_cmp(&self.cost).then_with(|| (o.keep, o.remove).cmp(&(self.keep, self.remove)))
    }
}

struct Simplifier<'a> {
    source: &'a Mesh,
    center: LatticePoint,
    points: Vec<Point>,
    wedges: Vec<Wedge>,
    scalars: Vec<Vec<f32>>,
    /// Wedge per corner; corner `3 t + k` belongs to triangle `t`.
    corners: Vec<u32>,
    borders: Vec<u8>,
    alive: Vec<bool>,
    /// Next corner in the list of the same point.
    next: Vec<u32>,
    occupied: FxHashMap<LatticePoint, u32>,
    heap: BinaryHeap<Candidate>,
    triangles: usize,
}

/// Simplify towards `target` triangles; returns fewer or as many triangles as given, never fewer than `target` minus
/// what the last collapse took, and the input itself (reordered) where nothing can go.
pub fn simplify<S: BuildHasher>(mesh: &Mesh, locked: &HashSet<LatticePoint, S>, target: usize) -> Mesh {
    let mut s = Simplifier::new(mesh, locked);
    s.seed();
    while s.triangles > target {
        let Some(c) = s.heap.pop() else { break };
        let fresh = [c.keep, c.remove].iter().zip(c.versions).all(|(p, v)| {
            let p = &s.points[*p as usize];
            p.alive && p.version == v
        });
        if fresh {
            s.collapse(&c);
        }
    }
    s.finish()
}

impl<'a> Simplifier<'a> {
    fn new<S: BuildHasher>(mesh: &'a Mesh, locked: &HashSet<LatticePoint, S>) -> Self {
        let center = {
            let b = mesh.bounds();
            std::array::from_fn(|i| i32::midpoint(b.min[i], b.max[i]))
        };
        // Points in lattice order, so that numbers (and ties) follow geometry.
        let mut at: Vec<LatticePoint> = mesh.positions.clone();
        at.sort_unstable();
        at.dedup();
        let occupied: FxHashMap<LatticePoint, u32> = at.iter().enumerate().map(|(i, p)| (*p, i as u32)).collect();
        let points = at
            .iter()
            .map(|&p| Point {
                at: p,
                local: local(p, center),
                quadric: Quadric::default(),
                locked: locked.contains(&p),
                alive: true,
                version: 0,
                head: NONE,
                tail: NONE,
                corners: 0,
            })
            .collect();
        let wedges = (0..mesh.vertex_count())
            .map(|v| Wedge {
                point: occupied[&mesh.positions[v]],
                source: v as u32,
                weight: 1.0,
                color: mesh.colors.get(v).map_or([0.0; 3], |c| c.map(linear)),
                normal: normal::decode(mesh.normals[v]).map(|x| x as f32),
                changed: false,
            })
            .collect();
        let mut s = Self {
            source: mesh,
            center,
            points,
            wedges,
            scalars: mesh.scalars.clone(),
            corners: mesh.triangles.iter().flatten().copied().collect(),
            borders: mesh.borders.clone(),
            alive: vec![true; mesh.triangle_count()],
            next: vec![NONE; mesh.triangle_count() * 3],
            occupied,
            heap: BinaryHeap::new(),
            triangles: mesh.triangle_count(),
        };
        for c in 0..s.corners.len() as u32 {
            let p = s.point_of(c);
            s.link(p, c);
        }
        s
    }

    fn point_of(&self, corner: u32) -> u32 {
        self.wedges[self.corners[corner as usize] as usize].point
    }

    fn link(&mut self, point: u32, corner: u32) {
        self.next[corner as usize] = NONE;
        let p = &mut self.points[point as usize];
        if p.head == NONE {
            p.head = corner;
        } else {
            self.next[p.tail as usize] = corner;
        }
        p.tail = corner;
        p.corners += 1;
    }

    /// Live corners at a point.
    fn corners_at(&self, point: u32) -> impl Iterator<Item = u32> + '_ {
        let mut c = self.points[point as usize].head;
        std::iter::from_fn(move || {
            while c != NONE {
                let here = c;
                c = self.next[c as usize];
                if self.alive[(here / 3) as usize] {
                    return Some(here);
                }
            }
            None
        })
    }

    /// The points of a triangle, starting at a corner.
    fn triangle_from(&self, corner: u32) -> [u32; 3] {
        let (t, k) = (corner / 3, corner % 3);
        [0, 1, 2].map(|i| self.point_of(t * 3 + (k + i) % 3))
    }

    /// Neighbours of a point with edge counts and border bits, sorted by point.
    fn neighbours(&self, point: u32) -> Vec<Neighbour> {
        let mut out: Vec<Neighbour> = Vec::with_capacity(8);
        for c in self.corners_at(point) {
            let [_, p1, p2] = self.triangle_from(c);
            let (t, k) = ((c / 3) as usize, c % 3);
            // The edge to p1 starts at this corner; the edge from p2 starts at the corner before it.
            for (p, slot) in [(p1, k), (p2, (k + 2) % 3)] {
                let border = self.borders[t] & (1 << slot) != 0;
                match out.iter_mut().find(|n| n.point == p) {
                    Some(n) => {
                        n.count += 1;
                        n.border |= border;
                    }
                    None => out.push(Neighbour { point: p, count: 1, border }),
                }
            }
        }
        out.sort_unstable_by_key(|n| n.point);
        out
    }

    /// Quadrics and the first candidates.
    fn seed(&mut self) {
        let mut edges: Vec<(u32, u32)> = Vec::with_capacity(self.corners.len());
        for t in 0..self.alive.len() as u32 {
            let p = [0, 1, 2].map(|k| self.point_of(t * 3 + k));
            let l = p.map(|p| self.points[p as usize].local);
            let q = Quadric::triangle(l);
            for k in 0..3 {
                self.points[p[k] as usize].quadric.add(&q);
                let (a, b) = (p[k], p[(k + 1) % 3]);
                edges.push((a.min(b), a.max(b)));
                if self.borders[t as usize] & (1 << k) != 0 {
                    let q = Quadric::border([l[k], l[(k + 1) % 3], l[(k + 2) % 3]]);
                    self.points[a as usize].quadric.add(&q);
                    self.points[b as usize].quadric.add(&q);
                }
            }
        }
        edges.sort_unstable();
        edges.dedup();
        for (a, b) in edges {
            self.propose(a, b);
        }
    }

    /// Put an edge into the queue where a collapse is thinkable; everything else is checked when its turn comes.
    fn propose(&mut self, a: u32, b: u32) {
        let (pa, pb) = (&self.points[a as usize], &self.points[b as usize]);
        if pa.corners > HUB || pb.corners > HUB {
            return;
        }
        let (keep, remove) = match (pa.locked, pb.locked) {
            (true, true) => return,
            (false, true) => (b, a),
            _ => (a, b),
        };
        let Some(target) = self.target(keep, remove) else { return };
        let mut q = self.points[a as usize].quadric;
        q.add(&self.points[b as usize].quadric);
        let cost = q.at(local(target, self.center)) + self.color_cost(a, b);
        let versions = [keep, remove].map(|p| self.points[p as usize].version);
        self.heap.push(Candidate { cost, keep, remove, versions, target });
    }

    /// A weak preference for edges along which the colour does not change: squared length times squared difference.
    fn color_cost(&self, a: u32, b: u32) -> f64 {
        let color = |p: u32| {
            let w = &self.wedges[self.corners[self.points[p as usize].head as usize] as usize];
            w.color.map(|c| f64::from(c / w.weight))
        };
        let (ca, cb) = (color(a), color(b));
        let d: f64 = (0..3).map(|i| (ca[i] - cb[i]).powi(2)).sum();
        let e: Vec3 = std::array::from_fn(|i| self.points[a as usize].local[i] - self.points[b as usize].local[i]);
        let l2: f64 = e.iter().map(|x| x * x).sum();
        COLOR_WEIGHT * d * l2 * l2
    }

    fn finish(self) -> Mesh {
        let mut out = Mesh { scalars: vec![Vec::new(); self.scalars.len()], ..Mesh::default() };
        let mut index = vec![NONE; self.wedges.len()];
        for t in 0..self.alive.len() {
            if !self.alive[t] {
                continue;
            }
            let tri = [0, 1, 2].map(|k| {
                let w = self.corners[t * 3 + k] as usize;
                if index[w] == NONE {
                    index[w] = self.emit(w, &mut out);
                }
                index[w]
            });
            out.triangles.push(tri);
            out.borders.push(self.borders[t]);
        }
        out
    }

    fn emit(&self, w: usize, out: &mut Mesh) -> u32 {
        let wedge = &self.wedges[w];
        let v = wedge.source as usize;
        let index = out.positions.len() as u32;
        out.positions.push(self.points[wedge.point as usize].at);
        if let Some(c) = self.source.colors.get(v) {
            out.colors.push(if wedge.changed { wedge.color.map(|x| srgb(x / wedge.weight)) } else { *c });
        }
        out.normals.push(if wedge.changed {
            normal::quantize(normal::encode(wedge.normal.map(f64::from)), crate::prepare::NORMAL_BITS)
        } else {
            self.source.normals[v]
        });
        for (to, from) in out.scalars.iter_mut().zip(&self.scalars) {
            to.push(if wedge.changed { from[w] / wedge.weight } else { from[w] });
        }
        index
    }
}

fn local(p: LatticePoint, center: LatticePoint) -> Vec3 {
    std::array::from_fn(|i| f64::from(p[i]) - f64::from(center[i]))
}

/// sRGB to linear light (IEC 61966-2-1).
pub(crate) fn linear(c: u8) -> f32 {
    let x = f32::from(c) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { libm::powf((x + 0.055) / 1.055, 2.4) }
}

/// Linear light to sRGB.
pub(crate) fn srgb(x: f32) -> u8 {
    let x = x.clamp(0.0, 1.0);
    let y = if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * libm::powf(x, 1.0 / 2.4) - 0.055 };
    (y * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(n: u32) -> Mesh {
        let mut m = Mesh { scalars: vec![Vec::new()], ..Mesh::default() };
        for y in 0..=n {
            for x in 0..=n {
                m.positions.push([x as i32 * 10, y as i32 * 10, 500]);
                m.normals.push([0, 0]);
                m.colors.push([100, 150, 200]);
                m.scalars[0].push(if (x, y) == (n / 2, n / 2) { f32::NAN } else { 7.0 });
            }
        }
        let w = n + 1;
        for y in 0..n {
            for x in 0..n {
                let i = y * w + x;
                m.triangles.extend([[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]);
                let (left, right) = (u8::from(x == 0) << 2, u8::from(x == n - 1));
                let (bottom, top) = (u8::from(y == 0), u8::from(y == n - 1) << 1);
                m.borders.extend([left | bottom, right | top]);
            }
        }
        m
    }

    #[test]
    fn a_missing_value_does_not_spread_and_equal_values_and_colours_stay_equal() {
        let fine = sheet(16);
        let coarse = simplify(&fine, &Locked::default(), 8);
        assert!(coarse.triangle_count() <= 16, "{}", coarse.triangle_count());
        assert!(coarse.scalars[0].iter().all(|s| (s - 7.0).abs() < 1e-4), "{:?}", coarse.scalars[0]);
        assert!(coarse.colors.iter().all(|c| *c == [100, 150, 200]));
    }

    #[test]
    fn a_fan_of_twenty_thousand_triangles_is_simplified_in_reasonable_time() {
        let n = 20_000u32;
        let mut m = Mesh { positions: vec![[1_000_000; 3]], normals: vec![[0, 0]; n as usize + 1], ..Mesh::default() };
        for i in 0..n {
            let angle = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
            let (x, y) = (900_000.0 * libm::cos(angle), 900_000.0 * libm::sin(angle));
            m.positions.push([1_000_000 + x as i32, 1_000_000 + y as i32, 1_000_000]);
            m.triangles.push([0, 1 + i, 1 + (i + 1) % n]);
            m.borders.push(2);
        }
        let coarse = simplify(&m, &Locked::default(), n as usize / 2);
        assert_eq!(coarse.triangle_count(), n as usize / 2);
    }

    #[test]
    fn locked_points_keep_their_place_and_their_edges() {
        let fine = sheet(12);
        let locked: Locked = fine.positions.iter().copied().filter(|p| p[0] == 60).collect();
        let coarse = simplify(&fine, &locked, 10);
        for p in &locked {
            assert!(coarse.positions.contains(p));
        }
        let edges = |m: &Mesh| {
            let mut found: Vec<[LatticePoint; 2]> = (0..m.triangle_count())
                .flat_map(|t| {
                    let c = m.corners(t);
                    [0, 1, 2].map(|k| [c[k].min(c[(k + 1) % 3]), c[k].max(c[(k + 1) % 3])])
                })
                .filter(|e| e.iter().all(|p| locked.contains(p)))
                .collect();
            found.sort_unstable();
            found
        };
        assert_eq!(edges(&fine), edges(&coarse));
        assert!(coarse.triangle_count() < fine.triangle_count() / 2);
    }

    type Locked = rustc_hash::FxHashSet<LatticePoint>;
}
