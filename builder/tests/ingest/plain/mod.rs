//! The finest surface and the tree by a simple construction in memory, to compare the out-of-core ingest with: every
//! edge length sorted, vertices welded in hash maps, tetrahedra split one after the other. Step derived, metres, z up.

use glam::{DVec3, I64Vec3};
use kilwa_formats::RawMesh;
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::{DiamondKey, Lattice, LatticePoint, Mesh, Tetra, normal, tetra};
use std::collections::{HashMap, HashSet};
use std::ops::Range;

const NORMAL_BITS: u32 = 10;

pub(crate) struct Plain {
    pub(crate) lattice: Lattice,
    pub(crate) cube_log2: u32,
    pub(crate) mesh: Mesh,
    pub(crate) points: u64,
    pub(crate) border_edges: u64,
    pub(crate) non_manifold_edges: u64,
    pub(crate) median_edge: f64,
    pub(crate) collapsed: u64,
    pub(crate) welded: u64,
}

pub(crate) fn plain(raw: &RawMesh) -> Plain {
    let mut lengths: Vec<f64> = raw
        .triangles
        .iter()
        .flat_map(|t| {
            let [a, b, c] = t.map(|v| raw.positions[v as usize]);
            [(a, b), (b, c), (c, a)].map(|(p, q)| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt())
        })
        .filter(|l| *l > 0.0)
        .collect();
    lengths.sort_by(f64::total_cmp);
    let percentile = |p: f64| lengths[((lengths.len() - 1) as f64 * p) as usize];
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in raw.triangles.iter().flatten().map(|v| raw.positions[*v as usize]) {
        for i in 0..3 {
            min[i] = min[i].min(p[i]);
            max[i] = max[i].max(p[i]);
        }
    }
    let extent = (0..3).map(|i| max[i] - min[i]).fold(0.0, f64::max);
    let magnitude = (0..3).map(|i| min[i].abs().max(max[i].abs())).fold(0.0, f64::max);
    let coarsest = (extent * 1.1 / f64::from(MAX_COORDINATE)).log2().ceil() as i32;
    let finest = ((magnitude * f64::EPSILON).log2().floor() as i32).max(-60);
    let step_log2 = ((percentile(0.01) / 16.0).log2().floor() as i32).max(coarsest).max(finest);
    let step = 2f64.powi(step_log2);
    let cube_log2 = ((extent / step * 1.05 + 4.0).log2().ceil() as u32).clamp(2, 30);
    let half = f64::from(1u32 << (cube_log2 - 1));
    let origin = (((DVec3::from(min) + DVec3::from(max)) * 0.5 / step).round() - half) * step;
    let mut out = Plain {
        lattice: Lattice { origin, step_log2 },
        cube_log2,
        mesh: Mesh::default(),
        points: 0,
        border_edges: 0,
        non_manifold_edges: 0,
        median_edge: percentile(0.5),
        collapsed: 0,
        welded: 0,
    };
    out.weld(raw);
    out.finish(raw.normals.is_empty());
    out
}

type WedgeKey = (LatticePoint, [u8; 3], [i16; 2], Vec<u32>);

impl Plain {
    fn weld(&mut self, raw: &RawMesh) {
        let mesh = &mut self.mesh;
        mesh.scalars = vec![Vec::new(); raw.scalars.len()];
        let mut index: HashMap<WedgeKey, u32> = HashMap::new();
        let mut used: HashSet<u32> = HashSet::new();
        for t in &raw.triangles {
            let at = t.map(|v| self.lattice.snap(raw.positions[v as usize]).expect("inside"));
            used.extend(t);
            if at[0] == at[1] || at[1] == at[2] || at[2] == at[0] {
                self.collapsed += 1;
                continue;
            }
            let corners = t.map(|v| {
                let i = v as usize;
                let position = self.lattice.snap(raw.positions[i]).expect("inside");
                let color = raw.colors.get(i).copied().unwrap_or_default();
                let given = raw.normals.get(i).map(|n| n.as_dvec3());
                let normal = given.map_or([0, 0], |n| normal::quantize(normal::encode(n), NORMAL_BITS));
                let scalars: Vec<u32> = raw.scalars.iter().map(|(_, s)| s[i].to_bits()).collect();
                let next = mesh.positions.len() as u32;
                let w = *index.entry((position, color, normal, scalars)).or_insert(next);
                if w == next {
                    mesh.positions.push(position);
                    if !raw.colors.is_empty() {
                        mesh.colors.push(color);
                    }
                    mesh.normals.push(normal);
                    for (to, (_, from)) in mesh.scalars.iter_mut().zip(&raw.scalars) {
                        to.push(from[i]);
                    }
                }
                w
            });
            mesh.triangles.push(corners);
        }
        self.welded = (used.len() - mesh.positions.len()) as u64;
    }

    fn finish(&mut self, make_normals: bool) {
        let mesh = &mut self.mesh;
        self.points = mesh.positions.iter().collect::<HashSet<_>>().len() as u64;
        mesh.borders = vec![0; mesh.triangles.len()];
        let mut edges: HashMap<[[i32; 3]; 2], Vec<(usize, usize)>> = HashMap::new();
        let mut sums: HashMap<LatticePoint, [i128; 3]> = HashMap::new();
        for t in 0..mesh.triangles.len() {
            let c = mesh.corners(t);
            for k in 0..3 {
                let (a, b) = (c[k].to_array(), c[(k + 1) % 3].to_array());
                edges.entry([a.min(b), a.max(b)]).or_default().push((t, k));
            }
            let p = c.map(|p| p.to_array().map(i128::from));
            let u: [i128; 3] = std::array::from_fn(|i| p[1][i] - p[0][i]);
            let v: [i128; 3] = std::array::from_fn(|i| p[2][i] - p[0][i]);
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            for p in c {
                let s = sums.entry(p).or_default();
                (0..3).for_each(|i| s[i] += n[i]);
            }
        }
        for uses in edges.values() {
            if let [(t, k)] = uses.as_slice() {
                mesh.borders[*t] |= 1 << k;
                self.border_edges += 1;
            }
            self.non_manifold_edges += u64::from(uses.len() > 2);
        }
        if make_normals {
            mesh.normals = mesh
                .positions
                .iter()
                .map(|p| normal::quantize(normal::encode(sums[p].map(|x| x as f64).into()), NORMAL_BITS))
                .collect();
        }
    }
}

/// A tetrahedron of the tree.
pub(crate) struct TetraNode {
    /// Geometry.
    pub(crate) tetra: Tetra,
    /// Indices of its quarters, once split.
    pub(crate) children: Option<[u32; 4]>,
    /// Its triangles: a range of [`Partition::order`]; kept for leaves, stale once split.
    pub(crate) range: Range<usize>,
}

/// A diamond, split or not.
pub(crate) struct DiamondNode {
    /// Name.
    pub(crate) key: DiamondKey,
    /// Its tetrahedra, in order of creation.
    pub(crate) tetrahedra: Vec<u32>,
    /// Whether its tetrahedra are split.
    pub(crate) split: bool,
}

/// The conforming tree.
pub(crate) struct Partition {
    cube_log2: u32,
    /// All tetrahedra; the first six are the roots.
    pub(crate) tetrahedra: Vec<TetraNode>,
    /// All diamonds.
    pub(crate) diamonds: Vec<DiamondNode>,
    /// Diamond index by name.
    pub(crate) by_key: HashMap<DiamondKey, u32>,
    /// Triangle numbers, grouped by leaf.
    pub(crate) order: Vec<u32>,
    /// Leaves that hold more than they should because space cannot separate their triangles.
    pub(crate) overfull_leaves: u64,
}

struct Splitter<'a> {
    tree: Partition,
    sums: Vec<I64Vec3>,
    extents: &'a dyn Fn(u32) -> i64,
    leaf_triangles: usize,
    scratch: Vec<u32>,
    /// Diamonds that remain to be examined.
    queue: Vec<u32>,
}

/// Partition a mesh whose coordinates lie inside the cube `0..=2^cube_log2`.
pub(crate) fn partition(mesh: &Mesh, cube_log2: u32, leaf_triangles: usize) -> Partition {
    let sums: Vec<I64Vec3> = (0..mesh.triangle_count()).map(|t| corner_sum(mesh.corners(t))).collect();
    let extents = |t: u32| {
        let c = mesh.corners(t as usize);
        (0..3)
            .map(|i| {
                i64::from(c.iter().map(|p| p[i]).max().unwrap_or(0))
                    - i64::from(c.iter().map(|p| p[i]).min().unwrap_or(0))
            })
            .max()
            .unwrap_or(0)
    };
    let tree = Partition {
        cube_log2,
        tetrahedra: Vec::new(),
        diamonds: Vec::new(),
        by_key: HashMap::new(),
        order: Vec::with_capacity(sums.len()),
        overfull_leaves: 0,
    };
    let mut s = Splitter { tree, sums, extents: &extents, leaf_triangles, scratch: Vec::new(), queue: Vec::new() };
    s.roots();
    while let Some(d) = s.queue.pop() {
        if !s.tree.diamonds[d as usize].split && s.wants_split(d) {
            let key = s.tree.diamonds[d as usize].key;
            s.split(key);
        }
    }
    let mut tree = s.tree;
    tree.overfull_leaves =
        tree.leaves().filter(|t| tree.tetrahedra[*t as usize].range.len() > leaf_triangles).count() as u64;
    tree
}

impl Partition {
    pub(crate) fn leaves(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.tetrahedra.len() as u32).filter(|t| self.tetrahedra[*t as usize].children.is_none())
    }
}

impl Splitter<'_> {
    fn roots(&mut self) {
        let roots = Tetra::roots(self.tree.cube_log2);
        let mut groups: [Vec<u32>; 6] = Default::default();
        for (t, sum) in self.sums.iter().enumerate() {
            groups[root_of(*sum)].push(t as u32);
        }
        for (tetra, group) in roots.into_iter().zip(groups) {
            let start = self.tree.order.len();
            self.tree.order.extend(group);
            let end = self.tree.order.len();
            self.add(tetra, start..end);
        }
    }

    fn add(&mut self, tetra: Tetra, range: Range<usize>) -> u32 {
        let key = DiamondKey::of(&tetra);
        let next = self.tree.diamonds.len() as u32;
        let diamond = *self.tree.by_key.entry(key).or_insert(next);
        if diamond == next {
            self.tree.diamonds.push(DiamondNode { key, tetrahedra: Vec::new(), split: false });
        }
        let index = self.tree.tetrahedra.len() as u32;
        if range.len() > self.leaf_triangles {
            self.queue.push(diamond);
        }
        self.tree.diamonds[diamond as usize].tetrahedra.push(index);
        self.tree.tetrahedra.push(TetraNode { tetra, children: None, range });
        index
    }

    /// Whether splitting helps: some tetrahedron is overfull, there is room for smaller ones, and its triangles are not
    /// all much larger than itself (a fan round one vertex, coincident triangles), which space cannot separate.
    fn wants_split(&self, diamond: u32) -> bool {
        let d = &self.tree.diamonds[diamond as usize];
        if d.key.level + 2 > tetra::max_level(self.tree.cube_log2) {
            return false;
        }
        d.tetrahedra.iter().any(|t| {
            let node = &self.tree.tetrahedra[*t as usize];
            if node.range.len() <= self.leaf_triangles {
                return false;
            }
            let edge = (0..3).map(|i| i64::from(node.tetra.v[0][i] - node.tetra.v[3][i]).abs()).max().unwrap_or(0);
            let triangles = &self.tree.order[node.range.clone()];
            // No more different positions than fit a leaf: its triangles coincide, and no plane separates them.
            let mut places = HashSet::new();
            for t in triangles.iter().filter(|t| (self.extents)(**t) <= 2 * edge) {
                places.insert(self.sums[*t as usize]);
                if places.len() > self.leaf_triangles {
                    break;
                }
            }
            places.len() > self.leaf_triangles
        })
    }

    /// Split a diamond, its parents first.
    fn split(&mut self, key: DiamondKey) {
        for parent in key.grandparents(self.tree.cube_log2) {
            let done = self.tree.by_key.get(&parent).is_some_and(|d| self.tree.diamonds[*d as usize].split);
            if !done {
                self.split(parent);
            }
        }
        let d = self.tree.by_key[&key];
        self.tree.diamonds[d as usize].split = true;
        for t in self.tree.diamonds[d as usize].tetrahedra.clone() {
            let node = &self.tree.tetrahedra[t as usize];
            let (tetra, range) = (node.tetra, node.range.clone());
            let [left, right] = tetra.children();
            let middle = self.part(&tetra, range.clone());
            let (first, last) = (self.part(&left, range.start..middle), self.part(&right, middle..range.end));
            let mut ranges = [range.start..first, first..middle, middle..last, last..range.end].into_iter();
            let children = tetra.quarters().map(|q| self.add(q, ranges.next().unwrap()));
            self.tree.tetrahedra[t as usize].children = Some(children);
        }
    }

    /// A stable partition in place, child 0 first; where child 1 begins.
    fn part(&mut self, tetra: &Tetra, range: Range<usize>) -> usize {
        let plane = tetra.split_plane();
        self.scratch.clear();
        let mut write = range.start;
        for read in range.clone() {
            let triangle = self.tree.order[read];
            if plane.child_of_sum(self.sums[triangle as usize]) == 0 {
                self.tree.order[write] = triangle;
                write += 1;
            } else {
                self.scratch.push(triangle);
            }
        }
        self.tree.order[write..range.end].copy_from_slice(&self.scratch);
        write
    }
}

/// Which root tetrahedron holds the point `sum / 3`: the one that walks its axes in falling order of the coordinates.
fn root_of(sum: I64Vec3) -> usize {
    let mut axes = [0, 1, 2];
    axes.sort_by_key(|&a| std::cmp::Reverse(sum[a]));
    match axes {
        [0, 1, 2] => 0,
        [0, 2, 1] => 1,
        [1, 0, 2] => 2,
        [1, 2, 0] => 3,
        [2, 0, 1] => 4,
        _ => 5,
    }
}
