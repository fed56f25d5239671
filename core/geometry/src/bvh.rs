//! A bounding-volume tree over triangles, split at the median of the longest axis: what distances, rays and certified
//! errors search. Holds numbers of triangles and boxes; the triangles stay with the caller. Deterministic.

use glam::DVec3;

/// Triangles in a leaf.
const LEAF: usize = 4;

/// A box of the tree.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// Squared distance from a point to the box; 0 inside.
    pub fn distance_squared(&self, p: DVec3) -> f64 {
        let outside = |i: usize| (self.min[i] - p[i]).max(p[i] - self.max[i]).max(0.0);
        let (x, y, z) = (outside(0), outside(1), outside(2));
        x * x + y * y + z * z
    }

    /// Where the ray `origin + t * direction`, `t >= 0`, enters the box, a little early against rounding.
    pub fn entry(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for i in 0..3 {
            if direction[i] == 0.0 {
                if origin[i] < self.min[i] || origin[i] > self.max[i] {
                    return None;
                }
                continue;
            }
            let a = (self.min[i] - origin[i]) / direction[i];
            let b = (self.max[i] - origin[i]) / direction[i];
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        let slack = 1e-12 * near.abs().max(1.0);
        (near <= far + slack).then_some(near - slack)
    }
}

struct Node {
    bounds: Bounds,
    /// Leaf: first item; inner: index of the right child (the left one follows the node).
    link: u32,
    /// Items in a leaf; 0 for an inner node.
    count: u32,
}

/// The tree.
pub struct Bvh {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

impl Bvh {
    /// Build over triangles given by their corners; fewer than 2^32.
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let centres: Vec<DVec3> = triangles.iter().map(|t| t[0] + t[1] + t[2]).collect();
        let mut tree = Self { nodes: Vec::new(), items: (0..triangles.len() as u32).collect() };
        if !triangles.is_empty() {
            tree.split(triangles, &centres, 0, triangles.len());
        }
        tree
    }

    fn split(&mut self, triangles: &[[DVec3; 3]], centres: &[DVec3], start: usize, end: usize) {
        let empty = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        let (mut bounds, mut middle) = (empty, empty);
        let grow = |b: &mut Bounds, p: &DVec3| {
            b.min = b.min.min(*p);
            b.max = b.max.max(*p);
        };
        for &t in &self.items[start..end] {
            triangles[t as usize].iter().for_each(|p| grow(&mut bounds, p));
            grow(&mut middle, &centres[t as usize]);
        }
        let node = self.nodes.len();
        self.nodes.push(Node { bounds, link: start as u32, count: (end - start) as u32 });
        if end - start <= LEAF {
            return;
        }
        let width = |i: usize| middle.max[i] - middle.min[i];
        let axis = (0..3).max_by(|&a, &b| width(a).total_cmp(&width(b))).unwrap_or(0);
        let mid = usize::midpoint(start, end);
        self.items[start..end].select_nth_unstable_by(mid - start, |a, b| {
            centres[*a as usize][axis].total_cmp(&centres[*b as usize][axis]).then(a.cmp(b))
        });
        self.split(triangles, centres, start, mid);
        self.nodes[node].link = self.nodes.len() as u32;
        self.nodes[node].count = 0;
        self.split(triangles, centres, mid, end);
    }

    /// Branch and bound. `lower` gives a box's smallest possible value, or `None` where nothing in it counts; boxes at
    /// or above `limit` are passed over, of two children the smaller is taken first. `visit` is called with the number of
    /// a triangle and the limit, and returns the limit from then on.
    pub fn search(
        &self,
        mut limit: f64,
        lower: impl Fn(&Bounds) -> Option<f64>,
        mut visit: impl FnMut(u32, f64) -> f64,
    ) {
        // Halving 2^32 items at the median is less than 40 levels deep, and each leaves one box behind.
        let mut stack = [(0u32, 0.0f64); 64];
        let Some(first) = self.nodes.first().and_then(|n| lower(&n.bounds)) else { return };
        stack[0] = (0, first);
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (n, at_least) = stack[depth];
            if at_least >= limit {
                continue;
            }
            let node = &self.nodes[n as usize];
            if node.count > 0 {
                for &t in &self.items[node.link as usize..(node.link + node.count) as usize] {
                    limit = visit(t, limit);
                }
                continue;
            }
            let (l, r) = (n + 1, node.link);
            let (dl, dr) = (lower(&self.nodes[l as usize].bounds), lower(&self.nodes[r as usize].bounds));
            let left_first = match (dl, dr) {
                (Some(a), Some(b)) => a <= b,
                (a, _) => a.is_some(),
            };
            let order = if left_first { [(r, dr), (l, dl)] } else { [(l, dl), (r, dr)] };
            for (child, d) in order {
                if let Some(d) = d.filter(|d| *d < limit) {
                    stack[depth] = (child, d);
                    depth += 1;
                }
            }
        }
    }
}
