//! Puts a mesh where it belongs: an affine map between a reader and its sink, so that what is kept is in metres, z up.
//!
//! Input: a [`Placement`], a map of positions in f64. Positions go through the map; normals through its inverse transpose,
//! so that they stay at right angles to the surface and on its side; where the map mirrors, triangles are turned round,
//! so that their front stays in front. All else passes unchanged.

use super::ReadError;
use super::sink::{MeshSink, VertexBlock};
use crate::Diagnostics;
use crate::Up;
use glam::{DMat3, DVec3, Vec3};
use kilwa_geometry::LengthUnit;

/// An affine map of space that can be undone: `p` becomes `rows · (p, 1)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    rows: [[f64; 4]; 3],
}

impl Placement {
    /// Everything stays where it is.
    pub const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

    /// The map of a 4 × 4 matrix, given row by row, that is applied to columns.
    ///
    /// # Errors
    /// A sentence that says why it is no map that can be undone.
    pub fn from_matrix(m: [[f64; 4]; 4]) -> Result<Self, String> {
        if !m.iter().flatten().all(|v| v.is_finite()) {
            return Err("it has numbers that are not finite".to_owned());
        }
        let [a, b, c, last] = m;
        if [a[3], b[3], c[3]] == [0.0; 3] && last[..3] != [0.0; 3] {
            return Err("its last row is not 0 0 0 1, but its last column is: it is written column by column; write it row by row, with the translation at the ends of the rows".to_owned());
        }
        if last[..3] != [0.0; 3] || last[3] == 0.0 {
            return Err("its last row is not 0 0 0 1: a projection cannot place a mesh".to_owned());
        }
        let map = Self { rows: [a, b, c].map(|row| row.map(|v| v / last[3])) };
        let size: f64 = map.linear().iter().map(|r| r.length()).product();
        if map.determinant().abs() <= 1e-9 * size {
            return Err("it flattens space (its determinant is zero)".to_owned());
        }
        Ok(map)
    }

    /// Adds `offset`.
    pub fn translation(offset: DVec3) -> Self {
        let mut map = Self::IDENTITY;
        for (row, offset) in map.rows.iter_mut().zip(offset.to_array()) {
            row[3] = offset;
        }
        map
    }

    /// To metres, z up. y up: (x, y, z) becomes (x, -z, y).
    pub fn to_metres(units: LengthUnit, up: Up) -> Self {
        let s = units.metres();
        let rows = match up {
            Up::Z => [[s, 0.0, 0.0, 0.0], [0.0, s, 0.0, 0.0], [0.0, 0.0, s, 0.0]],
            Up::Y => [[s, 0.0, 0.0, 0.0], [0.0, 0.0, -s, 0.0], [0.0, s, 0.0, 0.0]],
        };
        Self { rows }
    }

    /// This map, and then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let column = |k: usize| [self.rows[0][k], self.rows[1][k], self.rows[2][k]];
        let rows = next.rows.map(|row| {
            std::array::from_fn(|k| {
                let [x, y, z] = column(k);
                row[0] * x + row[1] * y + row[2] * z + if k == 3 { row[3] } else { 0.0 }
            })
        });
        Self { rows }
    }

    /// Where `p` goes.
    #[inline]
    pub fn place(&self, p: [f64; 3]) -> [f64; 3] {
        self.rows.map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3])
    }

    /// Whether right hands become left hands.
    pub fn mirrors(&self) -> bool {
        self.determinant() < 0.0
    }

    /// The rows without their offsets.
    fn linear(&self) -> [DVec3; 3] {
        self.rows.map(|[x, y, z, _]| DVec3::new(x, y, z))
    }

    fn determinant(&self) -> f64 {
        let [a, b, c] = self.rows;
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    }

    /// The map of normals, up to their length: the inverse transpose, which is the matrix of cofactors over the
    /// determinant.
    fn of_normals(&self) -> DMat3 {
        let [a, b, c] = self.linear();
        let sign = if self.mirrors() { -1.0 } else { 1.0 };
        DMat3::from_cols(sign * b.cross(c), sign * c.cross(a), sign * a.cross(b)).transpose()
    }
}

/// A sink that places what it is given before it hands it on.
pub struct Placed<'s> {
    sink: &'s mut dyn MeshSink,
    placement: Placement,
    of_normals: DMat3,
    mirrors: bool,
    positions: Vec<[f64; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u64; 3]>,
}

impl<'s> Placed<'s> {
    /// Hands on to `sink`.
    pub fn new(sink: &'s mut dyn MeshSink, placement: Placement) -> Self {
        Self {
            sink,
            placement,
            of_normals: placement.of_normals(),
            mirrors: placement.mirrors(),
            positions: Vec::new(),
            normals: Vec::new(),
            triangles: Vec::new(),
        }
    }
}

/// A normal through the map, with length 1; one without a length stays so.
fn normal(map: &DMat3, n: [f32; 3]) -> [f32; 3] {
    let moved = *map * Vec3::from(n).as_dvec3();
    let length = moved.length();
    if length > 0.0 && length.is_finite() { (moved / length).as_vec3().into() } else { [0.0; 3] }
}

impl MeshSink for Placed<'_> {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        self.sink.channels(names)
    }

    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        if self.placement == Placement::IDENTITY {
            return self.sink.vertices(block);
        }
        self.positions.clear();
        self.positions.extend(block.positions.iter().map(|&p| self.placement.place(p)));
        self.normals.clear();
        self.normals.extend(block.normals.iter().map(|&n| normal(&self.of_normals, n)));
        self.sink.vertices(&VertexBlock { positions: &self.positions, normals: &self.normals, ..*block })
    }

    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        if !self.mirrors {
            return self.sink.triangles(triangles, colors);
        }
        self.triangles.clear();
        self.triangles.extend(triangles.iter().map(|&[a, b, c]| [a, c, b]));
        self.sink.triangles(&self.triangles, colors)
    }

    fn positions(&mut self, of: &[u64], into: &mut Vec<[f64; 3]>) -> Result<(), ReadError> {
        self.sink.positions(of, into)
    }

    fn vertex_count(&self) -> u64 {
        self.sink.vertex_count()
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        self.sink.diagnostics()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RawMesh;
    use crate::read::{MemorySink, read_into_from};
    use proptest::prelude::*;
    use std::io::Cursor;
    use std::path::Path;

    const TETRAHEDRON: &str = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 3\nvn -1 -1 -1\nf 1//1 3//1 2//1\nf 1//1 2//1 4//1\nf 1//1 4//1 3//1\nf 2//1 3//1 4//1\n";

    fn placed(placement: Placement) -> RawMesh {
        let mut sink = MemorySink::new(Path::new("a.obj"));
        let total = TETRAHEDRON.len() as u64;
        let mut filter = Placed::new(&mut sink, placement);
        read_into_from(&mut Cursor::new(TETRAHEDRON), total, Path::new("a.obj"), &mut filter, &mut |_, _| {}).unwrap();
        sink.into_mesh().unwrap()
    }

    /// Six times the volume, positive where triangles face outwards.
    fn volume(mesh: &RawMesh) -> f64 {
        let signed = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        mesh.triangles.iter().map(signed).sum()
    }

    fn matrix(rows: [[f64; 3]; 3], offset: [f64; 3]) -> [[f64; 4]; 4] {
        let row = |i: usize| [rows[i][0], rows[i][1], rows[i][2], offset[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    #[test]
    fn y_up_in_millimetres_becomes_z_up_in_metres() {
        let map = Placement::to_metres(LengthUnit::Millimetre, Up::Y);
        assert_eq!(map.place([1000.0, 2000.0, -3000.0]), [1.0, 3.0, 2.0]);
        assert!(!map.mirrors());
    }

    #[test]
    fn transforms_apply_in_the_order_given() {
        let shift = Placement::translation(DVec3::new(1.0, 2.0, 3.0));
        let scale = Placement::to_metres(LengthUnit::Kilometre, Up::Z);
        assert_eq!(shift.then(&scale).place([0.0; 3]), [1000.0, 2000.0, 3000.0]);
        assert_eq!(scale.then(&shift).place([1.0, 0.0, 0.0]), [1001.0, 2.0, 3.0]);
        assert_eq!(Placement::IDENTITY.then(&shift), shift);
    }

    #[test]
    fn large_offsets_lose_no_precision() {
        let utm = Placement::translation(DVec3::new(500_000.125, 9_000_000.5, 10.0));
        assert_eq!(utm.place([0.000_976_562_5, 0.0, 0.0]), [500_000.125_976_562_5, 9_000_000.5, 10.0]);
    }

    #[test]
    fn matrices_that_cannot_place_a_mesh_are_refused_with_the_reason() {
        let good = matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, 3.0]);
        assert!(Placement::from_matrix(good).is_ok());
        let transposed = std::array::from_fn(|i| std::array::from_fn(|j| good[j][i]));
        assert!(Placement::from_matrix(transposed).unwrap_err().contains("column by column"));
        let mut bad = good;
        bad[3][0] = 0.5;
        assert!(Placement::from_matrix(bad).unwrap_err().contains("projection"));
        let mut bad = good;
        bad[1][1] = f64::NAN;
        assert!(Placement::from_matrix(bad).unwrap_err().contains("not finite"));
        let flat = matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], [0.0; 3]);
        assert!(Placement::from_matrix(flat).unwrap_err().contains("flattens"));
    }

    proptest! {
        /// Whatever the map, mirrored or not: outside stays outside, volumes scale, normals stay with their side.
        #[test]
        fn transforms_keep_the_outside_of_a_surface_outside(m in proptest::array::uniform3(proptest::array::uniform3(-3.0f64..3.0))) {
            let Ok(map) = Placement::from_matrix(matrix(m, [5.0, -7.0, 11.0])) else { return Ok(()) };
            prop_assume!(map.determinant().abs() > 1e-3);
            let (before, after) = (placed(Placement::IDENTITY), placed(map));
            prop_assert!(volume(&before) > 0.0);
            let expected = volume(&before) * map.determinant().abs();
            prop_assert!((volume(&after) - expected).abs() <= 1e-9 * expected.max(100.0));
            // The side of a plane that a normal points to: n · d keeps its sign for every direction d.
            let n = after.normals[0].map(f64::from);
            for d in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -2.0, 3.0]] {
                let (p, q) = (map.place([0.0; 3]), map.place(d));
                let side: f64 = (0..3).map(|i| n[i] * (q[i] - p[i])).sum();
                let was: f64 = -(d[0] + d[1] + d[2]);
                prop_assert!(side.signum() == was.signum() || side.abs() < 1e-4, "{side} {was}");
            }
        }
    }
}
