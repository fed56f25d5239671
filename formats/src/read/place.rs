//! Puts a mesh where it belongs: an affine map between a reader and its sink, so that what is kept is in metres, z up.
//!
//! Input: a [`Placement`], a map of positions in f64. Positions go through the map; normals through its inverse transpose,
//! so that they stay at right angles to the surface and on its side; where the map mirrors, triangles are turned round,
//! so that their front stays in front. All else passes unchanged.

use super::ReadError;
use super::sink::{MeshSink, VertexBlock, VertexSink};
use crate::Diagnostics;
use crate::Up;
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use kilwa_geometry::LengthUnit;

/// An invertible affine map of space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    target_from_source: DAffine3,
}

impl Placement {
    /// Everything stays where it is.
    pub const IDENTITY: Self = Self { target_from_source: DAffine3::IDENTITY };

    /// The map of a 4 × 4 matrix that is applied to columns.
    ///
    /// # Errors
    /// A sentence that says why it is no map that can be undone.
    pub fn from_matrix(m: DMat4) -> Result<Self, String> {
        if !m.is_finite() {
            return Err("it has numbers that are not finite".to_owned());
        }
        let (translation, last) = (m.w_axis.truncate(), m.row(3));
        let projects = last.truncate() != DVec3::ZERO;
        if translation == DVec3::ZERO && projects {
            return Err("its last row is not 0 0 0 1, but its last column is: it is written column by column; write it row by row, with the translation at the ends of the rows".to_owned());
        }
        if projects || last.w == 0.0 {
            return Err("its last row is not 0 0 0 1: a projection cannot place a mesh".to_owned());
        }
        let linear = DMat3::from_mat4(m);
        let map = Self {
            target_from_source: DAffine3 {
                matrix3: DMat3::from_cols(linear.x_axis / last.w, linear.y_axis / last.w, linear.z_axis / last.w),
                translation: translation / last.w,
            },
        };
        let size: f64 = map.rows().iter().map(|r| r.length()).product();
        if map.determinant().abs() <= 1e-9 * size {
            return Err("it flattens space (its determinant is zero)".to_owned());
        }
        Ok(map)
    }

    /// Adds `offset`.
    pub fn translation(offset: DVec3) -> Self {
        Self { target_from_source: DAffine3::from_translation(offset) }
    }

    /// To metres, z up. y up: (x, y, z) becomes (x, -z, y).
    pub fn to_metres(units: LengthUnit, up: Up) -> Self {
        let s = units.metres();
        let matrix = match up {
            Up::Z => DMat3::from_diagonal(DVec3::splat(s)),
            Up::Y => DMat3::from_cols(DVec3::new(s, 0.0, 0.0), DVec3::new(0.0, 0.0, s), DVec3::new(0.0, -s, 0.0)),
        };
        Self { target_from_source: DAffine3::from_mat3(matrix) }
    }

    /// This map, and then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let mut both = next.target_from_source * self.target_from_source;
        // Adding zero turns negative zeros into positive ones: coordinates of 0 come out without a sign.
        both.matrix3 += DMat3::ZERO;
        Self { target_from_source: both }
    }

    /// Where `p` goes.
    #[inline]
    pub fn place(&self, p: DVec3) -> DVec3 {
        self.target_from_source.transform_point3(p)
    }

    /// The normal of a surface after the transformation, from its `normal` before; of any length.
    pub fn turn(&self, normal: DVec3) -> DVec3 {
        self.of_normals() * normal
    }

    /// The factor by which lengths grow, on average over all directions.
    pub fn scale(&self) -> f64 {
        self.determinant().abs().cbrt()
    }

    /// Whether right hands become left hands.
    pub fn mirrors(&self) -> bool {
        self.determinant() < 0.0
    }

    /// The rows of the matrix.
    fn rows(&self) -> [DVec3; 3] {
        [0, 1, 2].map(|i| self.target_from_source.matrix3.row(i))
    }

    /// By rows: computing it by columns rounds differently, and near the limit other matrices would be refused.
    fn determinant(&self) -> f64 {
        let [a, b, c] = self.rows();
        a.dot(b.cross(c))
    }

    /// The map of normals, up to their length: the inverse transpose, which is the matrix of cofactors over the
    /// determinant.
    fn of_normals(&self) -> DMat3 {
        let [a, b, c] = self.rows();
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
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
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
fn normal(map: &DMat3, n: Vec3) -> Vec3 {
    let moved = *map * n.as_dvec3();
    let length = moved.length();
    if length > 0.0 && length.is_finite() { (moved / length).as_vec3() } else { Vec3::ZERO }
}

impl VertexSink for Placed<'_> {
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

    fn vertex_count(&self) -> u64 {
        self.sink.vertex_count()
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        self.sink.diagnostics()
    }
}

impl MeshSink for Placed<'_> {
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        if !self.mirrors {
            return self.sink.triangles(triangles, colors);
        }
        self.triangles.clear();
        self.triangles.extend(triangles.iter().map(|&[a, b, c]| [a, c, b]));
        self.sink.triangles(&self.triangles, colors)
    }

    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError> {
        self.sink.positions(of, into)
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
            a.dot(b.cross(c))
        };
        mesh.triangles.iter().map(signed).sum()
    }

    fn matrix(rows: [[f64; 3]; 3], offset: DVec3) -> DMat4 {
        DAffine3 { matrix3: DMat3::from_cols_array_2d(&rows).transpose(), translation: offset }.into()
    }

    #[test]
    fn y_up_in_millimetres_becomes_z_up_in_metres() {
        let map = Placement::to_metres(LengthUnit::Millimetre, Up::Y);
        assert_eq!(map.place(DVec3::new(1000.0, 2000.0, -3000.0)), DVec3::new(1.0, 3.0, 2.0));
        assert!(!map.mirrors());
    }

    #[test]
    fn transforms_apply_in_the_order_given() {
        let shift = Placement::translation(DVec3::new(1.0, 2.0, 3.0));
        let scale = Placement::to_metres(LengthUnit::Kilometre, Up::Z);
        assert_eq!(shift.then(&scale).place(DVec3::ZERO), DVec3::new(1000.0, 2000.0, 3000.0));
        assert_eq!(scale.then(&shift).place(DVec3::X), DVec3::new(1001.0, 2.0, 3.0));
        assert_eq!(Placement::IDENTITY.then(&shift), shift);
    }

    #[test]
    fn large_offsets_lose_no_precision() {
        let utm = Placement::translation(DVec3::new(500_000.125, 9_000_000.5, 10.0));
        assert_eq!(utm.place(DVec3::X * 0.000_976_562_5), DVec3::new(500_000.125_976_562_5, 9_000_000.5, 10.0));
    }

    #[test]
    fn matrices_that_cannot_place_a_mesh_are_refused_with_the_reason() {
        let good = matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], DVec3::new(1.0, 2.0, 3.0));
        assert!(Placement::from_matrix(good).is_ok());
        assert!(Placement::from_matrix(good.transpose()).unwrap_err().contains("column by column"));
        let mut bad = good;
        bad.x_axis.w = 0.5;
        assert!(Placement::from_matrix(bad).unwrap_err().contains("projection"));
        let mut bad = good;
        bad.y_axis.y = f64::NAN;
        assert!(Placement::from_matrix(bad).unwrap_err().contains("not finite"));
        let flat = matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], DVec3::ZERO);
        assert!(Placement::from_matrix(flat).unwrap_err().contains("flattens"));
    }

    proptest! {
        /// The bytes of packs depend on this order.
        #[test]
        fn each_coordinate_is_the_sum_of_its_row_from_left_to_right(
            m in proptest::array::uniform3(proptest::array::uniform3(-3.0f64..3.0)),
            offset in proptest::array::uniform3(-1e7f64..1e7),
            p in proptest::array::uniform3(-1e3f64..1e3),
        ) {
            let Ok(map) = Placement::from_matrix(matrix(m, offset.into())) else { return Ok(()) };
            let row = |r: [f64; 3], [x, y, z]: [f64; 3]| r[0] * x + r[1] * y + r[2] * z;
            let once = [0, 1, 2].map(|i| row(m[i], p) + offset[i]);
            prop_assert_eq!(map.place(p.into()).to_array().map(f64::to_bits), once.map(f64::to_bits));
            let column = |k: usize| [0, 1, 2].map(|i| m[i][k]);
            let twice = [0, 1, 2].map(|i| {
                row([0, 1, 2].map(|k| row(m[i], column(k))), p) + (row(m[i], offset) + offset[i])
            });
            prop_assert_eq!(map.then(&map).place(p.into()).to_array().map(f64::to_bits), twice.map(f64::to_bits));
        }

        /// Whatever the map, mirrored or not: outside stays outside, volumes scale, normals stay with their side.
        #[test]
        fn transforms_keep_the_outside_of_a_surface_outside(m in proptest::array::uniform3(proptest::array::uniform3(-3.0f64..3.0))) {
            let Ok(map) = Placement::from_matrix(matrix(m, DVec3::new(5.0, -7.0, 11.0))) else { return Ok(()) };
            prop_assume!(map.determinant().abs() > 1e-3);
            let (before, after) = (placed(Placement::IDENTITY), placed(map));
            prop_assert!(volume(&before) > 0.0);
            let expected = volume(&before) * map.determinant().abs();
            prop_assert!((volume(&after) - expected).abs() <= 1e-9 * expected.max(100.0));
            // The side of a plane that a normal points to: n · d keeps its sign for every direction d.
            let n = after.normals[0].as_dvec3();
            for d in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, -2.0, 3.0)] {
                let side = n.dot(map.place(d) - map.place(DVec3::ZERO));
                let was = -d.element_sum();
                prop_assert!(side.signum() == was.signum() || side.abs() < 1e-4, "{side} {was}");
            }
        }
    }
}
