//! A set of triangles with a search tree: nearest points and rays.

use crate::pick::{Hit, Ray};
use kilwa_geometry::distance::{Vec3, closest_on_triangle, dot, ray_triangle, sub};

/// Triangles in a leaf of the tree.
const LEAF: usize = 4;

struct Node {
    min: Vec3,
    max: Vec3,
    /// Leaf: first item; inner: index of the right child (the left one follows the node).
    link: u32,
    /// Items in a leaf; 0 for an inner node.
    count: u32,
}

/// Triangles in any one unit, for example metres or lattice steps; answers come in the same.
pub struct Surface {
    triangles: Vec<[Vec3; 3]>,
    items: Vec<u32>,
    nodes: Vec<Node>,
}

impl Surface {
    /// Build the tree.
    pub fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let items = (0..triangles.len() as u32).collect();
        let mut s = Self { triangles, items, nodes: Vec::new() };
        if !s.triangles.is_empty() {
            let n = s.triangles.len();
            s.split(0, n);
        }
        s
    }

    /// The triangles, in the order given.
    pub fn triangles(&self) -> &[[Vec3; 3]] {
        &self.triangles
    }

    fn split(&mut self, start: usize, end: usize) {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &t in &self.items[start..end] {
            for p in &self.triangles[t as usize] {
                for i in 0..3 {
                    min[i] = min[i].min(p[i]);
                    max[i] = max[i].max(p[i]);
                }
            }
        }
        let node = self.nodes.len();
        self.nodes.push(Node { min, max, link: start as u32, count: (end - start) as u32 });
        if end - start <= LEAF {
            return;
        }
        let axis = (0..3).max_by(|&a, &b| (max[a] - min[a]).total_cmp(&(max[b] - min[b]))).unwrap_or(0);
        let mid = usize::midpoint(start, end);
        let triangles = &self.triangles;
        let centre = |t: u32| triangles[t as usize].iter().map(|p| p[axis]).sum::<f64>();
        self.items[start..end]
            .select_nth_unstable_by(mid - start, |a, b| centre(*a).total_cmp(&centre(*b)).then(a.cmp(b)));
        self.split(start, mid);
        self.nodes[node].link = self.nodes.len() as u32;
        self.nodes[node].count = 0;
        self.split(mid, end);
    }

    /// The point of the surface nearest to `p`, with the number of its triangle; `None` where there is no surface.
    /// Ties go to the smaller number.
    pub fn nearest(&self, p: Vec3) -> Option<(Vec3, u32)> {
        let mut best: Option<(f64, u32, Vec3)> = None;
        let lower =
            |n: &Node| (0..3).map(|i| (n.min[i] - p[i]).max(p[i] - n.max[i]).max(0.0)).map(|x| x * x).sum::<f64>();
        let mut stack = vec![(0u32, self.nodes.first().map(lower)?)];
        while let Some((n, d)) = stack.pop() {
            if best.is_some_and(|b| d > b.0) {
                continue;
            }
            let node = &self.nodes[n as usize];
            if node.count > 0 {
                for &t in &self.items[node.link as usize..(node.link + node.count) as usize] {
                    let q = closest_on_triangle(p, self.triangles[t as usize]);
                    let e = sub(p, q);
                    let d = dot(e, e);
                    if best.is_none_or(|b| d < b.0 || (d == b.0 && t < b.1)) {
                        best = Some((d, t, q));
                    }
                }
                continue;
            }
            let (l, r) = (n + 1, node.link);
            let (dl, dr) = (lower(&self.nodes[l as usize]), lower(&self.nodes[r as usize]));
            stack.extend(if dl <= dr { [(r, dr), (l, dl)] } else { [(l, dl), (r, dr)] });
        }
        best.map(|b| (b.2, b.1))
    }

    /// The first triangle that a ray meets, from either side. Ties go to the smaller number.
    pub fn cast(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut stack = Vec::with_capacity(64);
        if let Some(t) = self.nodes.first().and_then(|n| enters(n, ray)) {
            stack.push((0u32, t));
        }
        while let Some((n, near)) = stack.pop() {
            if best.as_ref().is_some_and(|b| near > b.t) {
                continue;
            }
            let node = &self.nodes[n as usize];
            if node.count > 0 {
                for &t in &self.items[node.link as usize..(node.link + node.count) as usize] {
                    let Some(at) = ray_triangle(ray.origin, ray.direction, self.triangles[t as usize]) else {
                        continue;
                    };
                    if best.as_ref().is_none_or(|b| at < b.t || (at == b.t && t < b.triangle)) {
                        best = Some(Hit { t: at, triangle: t, point: ray.at(at) });
                    }
                }
                continue;
            }
            let children = [n + 1, node.link].map(|c| enters(&self.nodes[c as usize], ray).map(|t| (c, t)));
            match children {
                [Some(a), Some(b)] if a.1 <= b.1 => stack.extend([b, a]),
                [a, b] => stack.extend(a.into_iter().chain(b)),
            }
        }
        best
    }
}

/// Where a ray enters a box, a little early against rounding.
fn enters(n: &Node, ray: &Ray) -> Option<f64> {
    let (mut near, mut far) = (0.0f64, f64::INFINITY);
    for i in 0..3 {
        if ray.direction[i] == 0.0 {
            if ray.origin[i] < n.min[i] || ray.origin[i] > n.max[i] {
                return None;
            }
            continue;
        }
        let a = (n.min[i] - ray.origin[i]) / ray.direction[i];
        let b = (n.max[i] - ray.origin[i]) / ray.direction[i];
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    let slack = 1e-12 * near.abs().max(1.0);
    (near <= far + slack).then_some(near - slack)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn soup(seed: u64, n: usize) -> Vec<[Vec3; 3]> {
        let mut s = seed;
        let mut random = || {
            s = s.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (s >> 40) as f64 / 65536.0
        };
        (0..n)
            .map(|_| {
                let base: Vec3 = [random(), random(), random()];
                [0, 1, 2].map(|_| base.map(|x| x + random() * 0.05))
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_tree_finds_what_looking_at_every_triangle_finds(seed in any::<u64>(), o in prop::array::uniform3(-10.0f64..266.0), d in prop::array::uniform3(-1.0f64..1.0)) {
            let s = Surface::new(soup(seed, 300));
            let ray = Ray { origin: o, direction: d };
            let slow = s.triangles().iter().enumerate()
                .filter_map(|(i, t)| ray_triangle(o, d, *t).map(|at| (at, i as u32)))
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            prop_assert_eq!(s.cast(&ray).map(|h| (h.t, h.triangle)), slow);
            let near = s.nearest(o).map(|(q, _)| dot(sub(q, o), sub(q, o)));
            let slow = s.triangles().iter().map(|t| { let e = sub(o, closest_on_triangle(o, *t)); dot(e, e) }).min_by(f64::total_cmp);
            prop_assert_eq!(near, slow);
        }
    }

    #[test]
    fn an_empty_surface_has_no_nearest_point_and_no_hit() {
        let s = Surface::new(Vec::new());
        assert!(s.nearest([0.0; 3]).is_none());
        assert!(s.cast(&Ray { origin: [0.0; 3], direction: [1.0, 0.0, 0.0] }).is_none());
    }
}
