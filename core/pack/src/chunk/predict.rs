//! What a vertex is predicted from: the triangle that uses it first, and the one on the other side of the edge.
//! FORMAT section 5.5. (Touma and Gotsman, "Triangle mesh compression", 1998.)

use kilwa_geometry::{LatticePoint, Mesh, normal};

/// No such vertex.
const NONE: u32 = u32::MAX;
/// Slots of the edge memory; a power of two.
const EDGE_SLOTS: usize = 4096;

/// The vertices a vertex is predicted from; all have smaller numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Neighbours {
    /// A vertex of the same triangle; else the vertex before; none for vertex 0.
    pub(super) a: Option<u32>,
    /// The other vertex of the same triangle.
    pub(super) b: Option<u32>,
    /// The vertex opposite to the edge `a`–`b` in the latest triangle with that edge.
    pub(super) d: Option<u32>,
}

/// The neighbours of every vertex, from the triangles in storage order. All indices are below `vertices`.
pub(super) fn neighbours(triangles: &[[u32; 3]], vertices: usize) -> Vec<Neighbours> {
    let mut found: Vec<Neighbours> = Vec::with_capacity(vertices);
    let mut edges = vec![(NONE, NONE, NONE); EDGE_SLOTS];
    for &[p, q, r] in triangles {
        for (v, a, b) in [(p, q, r), (q, r, p), (r, p, q)] {
            while found.len() <= v as usize {
                let now = u32::try_from(found.len()).unwrap_or(NONE);
                found.push(if now == v { of_triangle(now, a, b, &edges) } else { before(now) });
            }
        }
        for (v, a, b) in [(p, q, r), (q, r, p), (r, p, q)] {
            let (low, high) = (a.min(b), a.max(b));
            if let Some(slot) = edges.get_mut(slot_of(low, high)) {
                *slot = (low, high, v);
            }
        }
    }
    while found.len() < vertices {
        found.push(before(u32::try_from(found.len()).unwrap_or(NONE)));
    }
    found
}

fn before(v: u32) -> Neighbours {
    Neighbours { a: v.checked_sub(1), b: None, d: None }
}

fn of_triangle(v: u32, a: u32, b: u32, edges: &[(u32, u32, u32)]) -> Neighbours {
    match (a < v, b < v) {
        (true, true) => {
            let (low, high) = (a.min(b), a.max(b));
            let known = edges.get(slot_of(low, high)).filter(|slot| (slot.0, slot.1) == (low, high));
            Neighbours { a: Some(a), b: Some(b), d: known.map(|slot| slot.2) }
        }
        (true, false) => Neighbours { a: Some(a), b: None, d: None },
        (false, true) => Neighbours { a: Some(b), b: None, d: None },
        (false, false) => before(v),
    }
}

/// Fibonacci hashing of an edge to its slot.
fn slot_of(low: u32, high: u32) -> usize {
    let mixed = low.wrapping_mul(0x9e37_79b1) ^ high.wrapping_mul(0x85eb_ca77);
    (mixed >> 20) as usize
}

impl Neighbours {
    /// Predict a position: the parallelogram where there is one, else the middle of the edge, else the one neighbour.
    pub(super) fn position(&self, known: &[LatticePoint]) -> LatticePoint {
        let at = |v: Option<u32>| v.and_then(|v| known.get(v as usize)).copied();
        let each = |f: &dyn Fn(usize) -> i32| [f(0), f(1), f(2)];
        let get = |p: &LatticePoint, k: usize| p.get(k).copied().unwrap_or(0);
        match (at(self.a), at(self.b), at(self.d)) {
            (Some(a), Some(b), Some(d)) => each(&|k| get(&a, k).wrapping_add(get(&b, k)).wrapping_sub(get(&d, k))),
            (Some(a), Some(b), None) => each(&|k| middle(get(&a, k), get(&b, k))),
            (Some(a), ..) => a,
            _ => [0; 3],
        }
    }

    /// Predict a colour: the mean of the edge, else the one neighbour, else black.
    pub(super) fn color(&self, known: &[[u8; 3]]) -> [i32; 3] {
        let at = |v: Option<u32>| v.and_then(|v| known.get(v as usize)).map(|c| c.map(i32::from));
        match (at(self.a), at(self.b)) {
            (Some([ar, ag, ab]), Some([br, bg, bb])) => [middle(ar, br), middle(ag, bg), middle(ab, bb)],
            (Some(a), None) => a,
            _ => [0; 3],
        }
    }

    /// Predict a scalar, as ordered bits: the first neighbour's.
    pub(super) fn scalar(&self, known: &[i32]) -> i32 {
        self.a.and_then(|v| known.get(v as usize)).copied().unwrap_or(0)
    }
}

/// The mean, rounded down.
fn middle(a: i32, b: i32) -> i32 {
    (a & b).wrapping_add((a ^ b) >> 1)
}

/// Predict all normals from the chunk's own triangles: the sum of the cross products at each vertex, in triangle order,
/// in `f64`, as octahedral coordinates. Chunk borders see only their own side.
pub(super) fn normals(mesh: &Mesh) -> Vec<normal::OctNormal> {
    let mut sums = vec![[0.0f64; 3]; mesh.positions.len()];
    let at = |v: u32| mesh.positions.get(v as usize).copied().unwrap_or_default().map(f64::from);
    for &[a, b, c] in &mesh.triangles {
        let (p, q, r) = (at(a), at(b), at(c));
        let [ux, uy, uz] = minus(q, p);
        let [vx, vy, vz] = minus(r, p);
        let [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
        for corner in [a, b, c] {
            if let Some([x, y, z]) = sums.get_mut(corner as usize) {
                *x += nx;
                *y += ny;
                *z += nz;
            }
        }
    }
    sums.into_iter().map(normal::encode).collect()
}

fn minus([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ax - bx, ay - by, az - bz]
}
