//! Node transforms in f64: affine maps, of the 4 by 4 matrices of glTF or of translation, rotation and scale.

use super::schema::Node;
use glam::{DAffine3, DMat3, DVec3, DVec4};

/// An affine transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Transform {
    parent_from_node: DAffine3,
}

impl Transform {
    pub(super) const IDENTITY: Self = Self { parent_from_node: DAffine3::IDENTITY };

    /// Of a node, in the coordinates of its parent: its matrix, or translation after rotation after scale.
    pub(super) fn of_node(node: &Node) -> Self {
        if let Some(m) = &node.matrix {
            let column = |i: usize| DVec3::from_slice(&m[4 * i..]);
            let matrix3 = DMat3::from_cols(column(0), column(1), column(2));
            return Self { parent_from_node: DAffine3 { matrix3, translation: column(3) } };
        }
        let DVec4 { x, y, z, w } = unit(node.rotation.as_deref().map_or(DVec4::W, |q| DVec4::from(*q)));
        let s = node.scale.as_deref().map_or(DVec3::ONE, |s| DVec3::from(*s));
        // Not DMat3::from_quat, which rounds differently.
        let matrix3 = DMat3::from_cols(
            s.x * DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)),
            s.y * DVec3::new(2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)),
            s.z * DVec3::new(2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)),
        );
        let translation = node.translation.as_deref().map_or(DVec3::ZERO, |t| DVec3::from(*t));
        Self { parent_from_node: DAffine3 { matrix3, translation } }
    }

    /// From any affine transform.
    pub(super) fn new(parent_from_node: DAffine3) -> Self {
        Self { parent_from_node }
    }

    /// Of a scene with y up whose positions are relative to a centre (`CESIUM_RTC`), which is given with z up.
    pub(super) fn relative_to_center(center: DVec3) -> Self {
        Self::new(DAffine3::from_translation(DVec3::new(center.x, center.z, -center.y)))
    }

    /// This transform after `inner`.
    pub(super) fn after(&self, inner: &Self) -> Self {
        Self { parent_from_node: self.parent_from_node * inner.parent_from_node }
    }

    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        self.parent_from_node.transform_point3(p)
    }

    /// A normal, turned as the surface is: by the inverse transposed, up to a positive factor.
    pub(super) fn normal(&self, n: DVec3) -> DVec3 {
        let [a, b, c] = self.columns();
        let sign = if self.mirrors() { -1.0 } else { 1.0 };
        DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b)) * n * sign
    }

    /// Whether it turns the inside out.
    pub(super) fn mirrors(&self) -> bool {
        let [a, b, c] = self.columns();
        a.cross(b).dot(c) < 0.0
    }

    /// Images of the axes.
    fn columns(&self) -> [DVec3; 3] {
        let DMat3 { x_axis, y_axis, z_axis } = self.parent_from_node.matrix3;
        [x_axis, y_axis, z_axis]
    }
}

/// A quaternion as a rotation has it; written numbers are rounded.
fn unit(q: DVec4) -> DVec4 {
    let length = q.length();
    if length > 0.0 && length.is_finite() { q / length } else { DVec4::W }
}
