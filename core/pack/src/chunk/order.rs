//! The encoder's side of the connectivity: which triangles are not coded yet, and how the machine numbers the vertices.

use super::border::{NONE, Source};
use super::{Chunk, PatchRange};
use kilwa_geometry::Mesh;

/// A vertex with more corners than this has them sorted by their edges, so that finding one takes no walk over all.
const HUB: usize = 32;

/// The triangles of a chunk by their directed edges.
pub(super) struct Unused<'a> {
    mesh: &'a Mesh,
    /// Patch of every triangle.
    patch: Vec<u32>,
    used: Vec<bool>,
    /// Corners by vertex: three times the triangle plus the corner. Ascending, at a [`HUB`] by the vertex that follows first.
    corners: Vec<u32>,
    /// At the first corner of each directed edge of a hub, how many of its corners are known to be used. A used triangle
    /// stays used, so that no corner is looked at twice.
    passed: Vec<u32>,
    /// Where a vertex' corners begin; one more than there are vertices.
    begins: Vec<u32>,
    /// The machine's numbers of the vertices, and the reverse.
    number: Vec<u32>,
    order: Vec<u32>,
    /// Triangles in the order of the machine, as three times the triangle plus the corner that comes first there.
    taken: Vec<u32>,
    /// All triangles before this one are used.
    seeds: usize,
}

impl<'a> Unused<'a> {
    pub(super) fn new(chunk: &'a Chunk) -> Self {
        let mesh = &chunk.mesh;
        let (vertices, triangles) = (mesh.vertex_count(), mesh.triangle_count());
        let mut begins = vec![0u32; vertices + 1];
        for &v in mesh.triangles.as_flattened() {
            if let Some(n) = begins.get_mut(v as usize + 1) {
                *n += 1;
            }
        }
        let mut sum = 0;
        for n in &mut begins {
            sum += *n;
            *n = sum;
        }
        let mut next = begins.clone();
        let mut corners = vec![0; triangles * 3];
        for (corner, &v) in (0u32..).zip(mesh.triangles.as_flattened()) {
            if let Some(at) = next.get_mut(v as usize) {
                if let Some(slot) = corners.get_mut(*at as usize) {
                    *slot = corner;
                }
                *at += 1;
            }
        }
        let following = |corner: u32| following(mesh, corner, 1);
        for range in begins.windows(2) {
            let &[begin, end] = range else { continue };
            if let Some(hub) = corners.get_mut(begin as usize..end as usize).filter(|range| range.len() > HUB) {
                hub.sort_unstable_by_key(|&corner| (following(corner), corner));
            }
        }
        Self {
            mesh,
            patch: patch_of_triangles(&chunk.patches, triangles),
            used: vec![false; triangles],
            passed: vec![0; corners.len()],
            corners,
            begins,
            number: vec![NONE; vertices],
            order: Vec::with_capacity(vertices),
            taken: Vec::with_capacity(triangles),
            seeds: 0,
        }
    }

    /// The vertex at a corner.
    fn vertex(&self, corner: u32, turn: u32) -> u32 {
        following(self.mesh, corner, turn)
    }

    fn is_free(&self, corner: u32) -> bool {
        self.used.get(corner as usize / 3).is_some_and(|used| !used)
    }

    /// The first free corner at vertex `x` whose edge runs to `y`.
    fn free_corner(&mut self, x: u32, y: u32) -> Option<u32> {
        let begin = *self.begins.get(x as usize)? as usize;
        let here = self.corners.get(begin..*self.begins.get(x as usize + 1)? as usize)?;
        if here.len() <= HUB {
            return here.iter().copied().find(|&corner| self.vertex(corner, 1) == y && self.is_free(corner));
        }
        let first = here.partition_point(|&corner| self.vertex(corner, 1) < y);
        let edge = here.get(first..)?;
        let passed = *self.passed.get(begin + first)?;
        let used = |&&corner: &&u32| self.vertex(corner, 1) == y && !self.is_free(corner);
        let more = edge.get(passed as usize..)?.iter().take_while(used).count();
        let passed = passed + u32::try_from(more).ok()?;
        let found = edge.get(passed as usize).copied().filter(|&corner| self.vertex(corner, 1) == y);
        if let Some(slot) = self.passed.get_mut(begin + first) {
            *slot = passed;
        }
        found
    }

    fn number_of(&mut self, v: u32) -> u32 {
        let next = self.order.len();
        let Some(slot) = self.number.get_mut(v as usize) else { return NONE };
        if *slot == NONE {
            *slot = u32::try_from(next).unwrap_or(NONE);
            self.order.push(v);
        }
        *slot
    }

    fn take(&mut self, corner: u32) -> u32 {
        let triangle = corner as usize / 3;
        if let Some(used) = self.used.get_mut(triangle) {
            *used = true;
        }
        self.taken.push(corner);
        self.patch.get(triangle).copied().unwrap_or(0)
    }

    /// The mesh with vertices and corners as the machine placed them, triangles in its order; vertices that no triangle
    /// uses follow in their old order.
    pub(super) fn reordered(mut self) -> Mesh {
        for v in (0u32..).take(self.mesh.vertex_count()) {
            self.number_of(v);
        }
        let mesh = self.mesh;
        let mut out = Mesh::default();
        for &corner in &self.taken {
            let number = |turn| self.number.get(self.vertex(corner, turn) as usize).copied().unwrap_or(NONE);
            out.triangles.push([number(0), number(1), number(2)]);
            let bits = mesh.borders.get(corner as usize / 3).copied().unwrap_or(0);
            let turn = corner % 3;
            out.borders.push((bits >> turn | bits << (3 - turn)) & 7);
        }
        out.positions = gather(&mesh.positions, &self.order);
        out.colors = gather(&mesh.colors, &self.order);
        out.normals = gather(&mesh.normals, &self.order);
        out.scalars = mesh.scalars.iter().map(|s| gather(s, &self.order)).collect();
        out
    }
}

impl Source for Unused<'_> {
    fn across(&mut self, from: u32, to: u32) -> Option<(u32, u32)> {
        // The neighbour has the edge the other way round.
        let (x, y) = (*self.order.get(to as usize)?, *self.order.get(from as usize)?);
        let corner = self.free_corner(x, y)?;
        let third = self.vertex(corner, 2);
        let patch = self.take(corner);
        Some((self.number_of(third), patch))
    }

    fn seed(&mut self) -> Option<([u32; 3], u32)> {
        self.seeds += self.used.get(self.seeds..)?.iter().position(|used| !used)?;
        let corner = 3 * u32::try_from(self.seeds).ok()?;
        let patch = self.take(corner);
        let corners = [0, 1, 2].map(|turn| self.vertex(corner, turn));
        Some((corners.map(|v| self.number_of(v)), patch))
    }
}

/// The vertex so many corners after this one in its triangle.
fn following(mesh: &Mesh, corner: u32, turn: u32) -> u32 {
    let corner = corner - corner % 3 + (corner + turn) % 3;
    mesh.triangles.as_flattened().get(corner as usize).copied().unwrap_or(NONE)
}

fn patch_of_triangles(patches: &[PatchRange], triangles: usize) -> Vec<u32> {
    let runs = patches.iter().zip(0u32..).flat_map(|(p, i)| std::iter::repeat_n(i, p.count as usize));
    runs.take(triangles).collect()
}

fn gather<T: Copy>(from: &[T], order: &[u32]) -> Vec<T> {
    order.iter().filter_map(|&v| from.get(v as usize).copied()).collect()
}
