//! Normals in octahedral encoding, stored directly or as differences from normals estimated from the triangles.
//!
//! The estimates are computed in single precision, as in the encoder, because the stored differences depend on its rounding.

use super::super::bytes::{Cursor, Fault};
use super::values::Coding;
use glam::Vec3;

/// What the stored values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Prediction {
    /// Differences from the vertex that predicts this one.
    Neighbour,
    /// Differences from the estimate.
    Estimate,
    /// Differences from the estimate, at the boundary only.
    Boundary,
}

/// The stored values of the normals.
pub(super) struct Stored {
    prediction: Prediction,
    values: Vec<i32>,
    coding: Coding,
    /// Half the side of the square.
    unit: i32,
    at: u64,
}

/// The mesh from which normals are estimated.
pub(super) struct Surface<'s> {
    /// Quantised positions, three integers for each vertex.
    pub(super) positions: &'s [i32],
    pub(super) faces: &'s [[u32; 3]],
    pub(super) predictions: &'s [[u32; 3]],
}

impl Stored {
    /// Read the values of up to `count` vertices.
    pub(super) fn read(from: &mut Cursor<'_>, coding: Coding, unit: f32, count: usize) -> Result<Self, Fault> {
        let at = from.offset();
        let coding = Coding { components: 2, strategy: 0, ..coding };
        let prediction = match from.u8("the prediction of normals")? {
            0 => Prediction::Neighbour,
            1 => Prediction::Estimate,
            2 => Prediction::Boundary,
            other => {
                let expected = "0, 1 or 2; the file is damaged: copy it again".to_owned();
                return Err(Fault { at, found: format!("normal prediction {other}"), expected });
            }
        };
        let values = coding.read_correlated(from, count)?;
        let stored = Self { prediction, values, coding, unit: unit as i32, at };
        if prediction != Prediction::Boundary && stored.values.len() != 2 * count {
            return Err(stored.too_few(count));
        }
        Ok(stored)
    }

    fn too_few(&self, count: usize) -> Fault {
        let expected = format!("{count}; the file is damaged: copy it again");
        Fault { at: self.at, found: format!("{} normals", self.values.len() / 2), expected }
    }

    /// The normals, of length 1; zero where there is none.
    pub(super) fn normals(mut self, surface: &Surface<'_>) -> Result<Vec<Vec3>, Fault> {
        let count = surface.predictions.len();
        if self.prediction == Prediction::Neighbour {
            self.coding.undo_prediction(&mut self.values, surface.predictions);
            return Ok(self.values.chunks_exact(2).map(|v| on_sphere([v[0], v[1]], self.unit)).collect());
        }
        let estimates = estimates(surface, count);
        let corrected = match self.prediction {
            Prediction::Boundary => at_boundary(surface.faces, count),
            _ => vec![true; count],
        };
        let needed = corrected.iter().filter(|c| **c).count();
        let mut differences = self.values.chunks_exact(2);
        let mut normals = Vec::with_capacity(count);
        for (estimate, corrected) in estimates.into_iter().zip(&corrected) {
            if *corrected {
                let Some(d) = differences.next() else { return Err(self.too_few(needed)) };
                let [x, y] = on_octahedron(estimate, self.unit);
                normals.push(on_sphere([x.wrapping_add(d[0]), y.wrapping_add(d[1])], self.unit));
            } else {
                normals.push(unit_or_zero(estimate));
            }
        }
        Ok(normals)
    }
}

/// For each vertex, the area-weighted sum of the normals of its triangles.
fn estimates(surface: &Surface<'_>, count: usize) -> Vec<Vec3> {
    let point = |v: u32| Vec3::from_array([0, 1, 2].map(|k| surface.positions[3 * v as usize + k] as f32));
    let mut sums = vec![Vec3::ZERO; count];
    for face in surface.faces {
        let [a, b, c] = face.map(point);
        let normal = (b - a).cross(c - a);
        for &v in face {
            sums[v as usize] += normal;
        }
    }
    sums
}

/// Whether a vertex lies on the boundary. Around an inner vertex each neighbour is named twice and cancels out.
fn at_boundary(faces: &[[u32; 3]], count: usize) -> Vec<bool> {
    let mut neighbours = vec![0u32; count];
    for &[a, b, c] in faces {
        neighbours[a as usize] ^= b ^ c;
        neighbours[b as usize] ^= c ^ a;
        neighbours[c as usize] ^= a ^ b;
    }
    neighbours.into_iter().map(|left| left != 0).collect()
}

/// The octahedral encoding of a direction.
fn on_octahedron(v: Vec3, unit: i32) -> [i32; 2] {
    let sum = v.x.abs() + v.y.abs() + v.z.abs();
    let (mut x, mut y) = (v.x / sum, v.y / sum);
    if v.z < 0.0 {
        let fold = |other: f32, sign: f32| if sign < 0.0 { other.abs() - 1.0 } else { 1.0 - other.abs() };
        (x, y) = (fold(y, v.x), fold(x, v.y));
    }
    // Rounds towards zero; NaN becomes zero.
    [x, y].map(|t| (t * unit as f32) as i32)
}

/// The direction of a point on the square.
fn on_sphere([x, y]: [i32; 2], unit: i32) -> Vec3 {
    let (x, y, unit) = (f64::from(x), f64::from(y), f64::from(unit));
    let z = unit - x.abs() - y.abs();
    let fold = |t: f64, other: f64| if t > 0.0 { unit - other.abs() } else { other.abs() - unit };
    let (x, y) = if z < 0.0 { (fold(x, y), fold(y, x)) } else { (x, y) };
    unit_or_zero(Vec3::new(x as f32, y as f32, z as f32))
}

fn unit_or_zero(v: Vec3) -> Vec3 {
    v.try_normalize().unwrap_or(Vec3::ZERO)
}
