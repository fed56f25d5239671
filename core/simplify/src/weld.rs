//! Joining meshes: vertices that are equal in position and in every attribute become one.

use kilwa_geometry::Mesh;

const NONE: u32 = u32::MAX;

/// Joins vertices of several meshes into one mesh. Vertices are in order of first use.
pub struct Welder {
    /// What was joined so far.
    pub mesh: Mesh,
    /// Open addressing by position and all attributes; a power of two, at most half full.
    table: Vec<u32>,
}

impl Welder {
    /// For about so many vertices with so many scalar channels.
    pub fn new(vertices: usize, scalars: usize) -> Self {
        let size = (vertices * 2 + 16).next_power_of_two();
        Self { mesh: Mesh { scalars: vec![Vec::new(); scalars], ..Mesh::default() }, table: vec![NONE; size] }
    }

    /// The number of a vertex of `from` in the joined mesh.
    pub fn vertex(&mut self, from: &Mesh, v: usize) -> u32 {
        if (self.mesh.vertex_count() + 1) * 2 > self.table.len() {
            self.grow();
        }
        let mask = self.table.len() - 1;
        let mut slot = hash(from, v) & mask;
        loop {
            let found = self.table[slot];
            if found == NONE {
                let next = self.mesh.push_vertex_of(from, v);
                self.table[slot] = next;
                return next;
            }
            if same(&self.mesh, found as usize, from, v) {
                return found;
            }
            slot = (slot + 1) & mask;
        }
    }

    fn grow(&mut self) {
        let size = self.table.len() * 2;
        self.table = vec![NONE; size];
        for v in 0..self.mesh.vertex_count() as u32 {
            let mut slot = hash(&self.mesh, v as usize) & (size - 1);
            while self.table[slot] != NONE {
                slot = (slot + 1) & (size - 1);
            }
            self.table[slot] = v;
        }
    }
}

/// Of all that [`same`] compares: any number of vertices may lie at one place and differ in their attributes.
fn hash(mesh: &Mesh, v: usize) -> usize {
    // Multiplicative hashing (Knuth, TAOCP 6.4) by three odd constants; the high bits are the good ones.
    let p = mesh.positions[v];
    let h = (u64::from(p.x as u32).wrapping_mul(0x9e37_79b9_7f4a_7c15))
        ^ (u64::from(p.y as u32).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)).rotate_left(21)
        ^ (u64::from(p.z as u32).wrapping_mul(0x1656_67b1_9e37_79f9)).rotate_left(42);
    let mix = |h: u64, word: u32| (h.rotate_left(23) ^ u64::from(word)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let color = mesh.colors.get(v).map(|&[r, g, b]| u32::from_le_bytes([r, g, b, 0]));
    let normal = mesh.normals.get(v).map(|[x, y]| u32::from(x.cast_unsigned()) << 16 | u32::from(y.cast_unsigned()));
    let scalars = mesh.scalars.iter().map(|s| s[v].to_bits());
    let h = color.into_iter().chain(normal).chain(scalars).fold(h, mix);
    (h.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize
}

/// Equality bit for bit: a scalar that is not a number equals itself.
fn same(a: &Mesh, i: usize, b: &Mesh, j: usize) -> bool {
    a.positions[i] == b.positions[j]
        && a.colors.get(i) == b.colors.get(j)
        && a.normals.get(i) == b.normals.get(j)
        && a.scalars.iter().zip(&b.scalars).all(|(s, t)| s[i].to_bits() == t[j].to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::IVec3;

    #[test]
    fn equal_vertices_are_welded_and_wedges_stay_separate() {
        let mut m = Mesh { scalars: vec![Vec::new()], ..Mesh::default() };
        for i in 0..2000 {
            m.positions.push(IVec3::new(i % 100, 7, 7));
            m.colors.push([(i % 200 / 100) as u8, 0, 0]);
            m.normals.push([0, 0]);
            m.scalars[0].push(if i % 3 == 0 { f32::NAN } else { 1.0 });
        }
        let mut w = Welder::new(1, 1);
        let numbers: Vec<u32> = (0..2000).map(|v| w.vertex(&m, v)).collect();
        // 100 places, 2 colours, 2 scalars.
        assert_eq!(w.mesh.vertex_count(), 400);
        for (v, n) in numbers.iter().enumerate() {
            assert!(same(&w.mesh, *n as usize, &m, v));
        }
    }
}
