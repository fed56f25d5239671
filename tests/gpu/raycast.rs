//! A ray-caster in f64 on the CPU, over the same triangles as a frame: the oracle of the GPU tests.

use glam::DVec3;
use kilwa_geometry::distance::ray_triangle;
use kilwa_stream::{Projection, View};

/// A triangle with the index of its draw.
#[derive(Clone, Copy)]
pub(crate) struct Triangle {
    pub(crate) corners: [DVec3; 3],
    pub(crate) id: u32,
}

/// A bounding volume hierarchy: nodes in depth-first order.
pub(crate) struct Scene {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

struct Node {
    min: DVec3,
    max: DVec3,
    /// First triangle and count of a leaf; or the second child and 0 (the first child is the next node).
    first: usize,
    count: usize,
}

/// A hit: the draw, the triangle and the depth along the view axis, in lattice units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    pub(crate) id: u32,
    pub(crate) triangle: usize,
    pub(crate) depth: f64,
}

impl Scene {
    pub(crate) fn new(mut triangles: Vec<Triangle>) -> Self {
        let mut nodes = Vec::new();
        let count = triangles.len();
        if count > 0 {
            split(&mut triangles, 0, count, &mut nodes);
        }
        Self { triangles, nodes }
    }

    /// The ray through a point of the picture, in pixels from its top left corner.
    pub(crate) fn ray(view: &View, [px, py]: [f64; 2]) -> (DVec3, DVec3) {
        let x = (2.0 * px / f64::from(view.size[0]) - 1.0) * view.aspect();
        let y = 1.0 - 2.0 * py / f64::from(view.size[1]);
        match view.projection {
            Projection::Perspective { tan_half_height: t } => {
                (view.eye, view.forward + view.right * x * t + view.up * y * t)
            }
            Projection::Orthographic { half_height: h } => {
                (view.eye + view.right * x * h + view.up * y * h, view.forward)
            }
        }
    }

    /// The nearest hit beyond the near plane. The direction advances one step of depth per unit.
    pub(crate) fn cast(&self, view: &View, pixel: [f64; 2]) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.visit(view, pixel, |hit| {
            if best.is_none_or(|b| hit.depth < b.depth) {
                best = Some(hit);
            }
            best.map_or(f64::INFINITY, |b| b.depth)
        });
        best
    }

    /// All hits beyond the near plane, in no order.
    pub(crate) fn cast_all(&self, view: &View, pixel: [f64; 2]) -> Vec<Hit> {
        let mut all = Vec::new();
        self.visit(view, pixel, |hit| {
            all.push(hit);
            f64::INFINITY
        });
        all
    }

    /// Hits along a ray; `found` says how far to look from then on.
    fn visit(&self, view: &View, pixel: [f64; 2], mut found: impl FnMut(Hit) -> f64) {
        let (origin, direction) = Self::ray(view, pixel);
        let mut limit = f64::INFINITY;
        let mut stack = vec![0usize];
        while let Some(at) = stack.pop() {
            let Some(node) = self.nodes.get(at) else { continue };
            if !meets(node, origin, direction, limit) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.first, at + 1]);
                continue;
            }
            for k in node.first..node.first + node.count {
                let t = &self.triangles[k];
                let depth = ray_triangle(origin, direction, t.corners).filter(|d| *d >= view.near);
                if let Some(depth) = depth {
                    limit = found(Hit { id: t.id, triangle: k, depth });
                }
            }
        }
    }

    /// The triangles of draw `id` that are seen edge-on (thinner than `width` pixels) within `width` of the point. A ray
    /// misses them; a rasteriser that snaps their corners may not.
    pub(crate) fn edge_on(&self, view: &View, pixel: [f64; 2], id: u32, width: f64) -> Vec<usize> {
        let near = |t: &Triangle| {
            let at = t.corners.map(|p| Self::seen(view, p));
            let sides = [0, 1, 2].map(|k: usize| [at[(k + 1) % 3][0] - at[k][0], at[(k + 1) % 3][1] - at[k][1]]);
            let lengths = sides.map(|s| s[0].hypot(s[1]));
            let longest = lengths.iter().copied().fold(0.0, f64::max);
            let area = (sides[0][0] * sides[1][1] - sides[0][1] * sides[1][0]).abs();
            let away = |k: usize| {
                let to = [pixel[0] - at[k][0], pixel[1] - at[k][1]];
                let along = (to[0] * sides[k][0] + to[1] * sides[k][1]) / (lengths[k] * lengths[k]).max(1e-30);
                let along = along.clamp(0.0, 1.0);
                (to[0] - sides[k][0] * along).hypot(to[1] - sides[k][1] * along)
            };
            area <= width * longest && (0..3).any(|k| away(k) <= width)
        };
        (0..self.triangles.len()).filter(|t| self.triangles[*t].id == id && near(&self.triangles[*t])).collect()
    }

    /// Where a point is seen, in pixels; the inverse of [`Scene::ray`].
    fn seen(view: &View, p: DVec3) -> [f64; 2] {
        let DVec3 { x, y, z: depth } = view.in_view(p);
        let half = match view.projection {
            Projection::Perspective { tan_half_height: t } => t * depth,
            Projection::Orthographic { half_height: h } => h,
        };
        let [w, h] = view.size.map(f64::from);
        [(x / half / view.aspect() + 1.0) * w / 2.0, (1.0 - y / half) * h / 2.0]
    }

    /// Depth at which a ray meets the plane of a triangle.
    pub(crate) fn plane_depth(&self, view: &View, triangle: usize, pixel: [f64; 2]) -> f64 {
        let (origin, direction) = Self::ray(view, pixel);
        let [a, b, c] = self.triangles[triangle].corners;
        let n = (b - a).cross(c - a);
        n.dot(a - origin) / n.dot(direction)
    }
}

fn split(triangles: &mut [Triangle], first: usize, count: usize, nodes: &mut Vec<Node>) {
    let part = &mut triangles[first..first + count];
    let corners = part.iter().flat_map(|t| t.corners);
    let (min, max) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
    let at = nodes.len();
    nodes.push(Node { min, max, first, count });
    if count <= 4 {
        return;
    }
    let axis = (0..3).max_by(|&a, &b| (max[a] - min[a]).total_cmp(&(max[b] - min[b]))).unwrap_or(0);
    let middle = |t: &Triangle| t.corners.iter().map(|p| p[axis]).sum::<f64>();
    let half = count / 2;
    part.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    split(triangles, first, half, nodes);
    let second = nodes.len();
    split(triangles, first + half, count - half, nodes);
    nodes[at].first = second;
    nodes[at].count = 0;
}

fn meets(node: &Node, origin: DVec3, direction: DVec3, limit: f64) -> bool {
    let (mut near, mut far) = (0.0f64, limit);
    for i in 0..3 {
        let (a, b) = ((node.min[i] - origin[i]) / direction[i], (node.max[i] - origin[i]) / direction[i]);
        if direction[i] == 0.0 {
            if origin[i] < node.min[i] || origin[i] > node.max[i] {
                return false;
            }
            continue;
        }
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    near <= far * (1.0 + 1e-12) + 1e-9
}
