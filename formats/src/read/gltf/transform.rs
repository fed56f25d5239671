//! Node transforms: 4 by 4 matrices in f64, column by column as glTF has them.

use super::schema::Node;

/// An affine transform: three columns and a translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Transform {
    /// Images of the axes.
    columns: [[f64; 3]; 3],
    translation: [f64; 3],
}

impl Transform {
    pub(super) const IDENTITY: Self =
        Self { columns: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3] };

    /// Of a node, in the coordinates of its parent: its matrix, or translation after rotation after scale.
    pub(super) fn of_node(node: &Node) -> Self {
        if let Some(m) = &node.matrix {
            let column = |i: usize| [m[4 * i], m[4 * i + 1], m[4 * i + 2]];
            return Self { columns: [column(0), column(1), column(2)], translation: column(3) };
        }
        let [x, y, z, w] = unit(node.rotation.as_deref().copied().unwrap_or([0.0, 0.0, 0.0, 1.0]));
        let s = node.scale.as_deref().copied().unwrap_or([1.0; 3]);
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let columns = std::array::from_fn(|i| rotation[i].map(|v| v * s[i]));
        Self { columns, translation: node.translation.as_deref().copied().unwrap_or_default() }
    }

    /// This transform after `inner`.
    pub(super) fn after(&self, inner: &Self) -> Self {
        Self { columns: inner.columns.map(|c| self.direction(c)), translation: self.point(inner.translation) }
    }

    pub(super) fn point(&self, p: [f64; 3]) -> [f64; 3] {
        let d = self.direction(p);
        std::array::from_fn(|k| d[k] + self.translation[k])
    }

    fn direction(&self, d: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = &self.columns;
        std::array::from_fn(|k| a[k] * d[0] + b[k] * d[1] + c[k] * d[2])
    }

    /// A normal, turned as the surface is: by the inverse transposed, up to a positive factor.
    pub(super) fn normal(&self, n: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = self.columns;
        let sign = if self.mirrors() { -1.0 } else { 1.0 };
        let cofactors = Self { columns: [cross(b, c), cross(c, a), cross(a, b)], translation: [0.0; 3] };
        cofactors.direction(n).map(|v| v * sign)
    }

    /// Whether it turns the inside out.
    pub(super) fn mirrors(&self) -> bool {
        let [a, b, c] = self.columns;
        let n = cross(a, b);
        n[0] * c[0] + n[1] * c[1] + n[2] * c[2] < 0.0
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A quaternion as a rotation has it; written numbers are rounded.
fn unit(q: [f64; 4]) -> [f64; 4] {
    let length = libm::sqrt(q.iter().map(|x| x * x).sum());
    if length > 0.0 && length.is_finite() { q.map(|x| x / length) } else { [0.0, 0.0, 0.0, 1.0] }
}
