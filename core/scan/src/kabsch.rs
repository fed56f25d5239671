//! The rotation that best takes one set of points to another.

use glam::{DMat3, DQuat};
use nalgebra::Matrix3;

/// Points define a rotation if their spread in a second direction is at least this share of their spread in the first.
const SPREAD: f64 = 0.02;

/// A rotation, and how strongly the points determine it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BestRotation {
    /// Takes the second points to the first.
    pub rotation: DQuat,
    /// The trace of `product` after the rotation: by the variance of the second points, the best scale.
    pub trace: f64,
}

/// The rotation R that minimises the sum of |a - R b|² over pairs of points relative to their means, `product` being the sum of a bᵀ (Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976;
/// without reflections: Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991). None if `product` is not finite.
pub fn best_rotation(product: &Matrix3<f64>) -> Option<BestRotation> {
    let svd = product.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    let sign = (u * v).determinant().signum();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let mut flip = Matrix3::identity();
    flip[(order[2], order[2])] = sign;
    let r = u * flip * v;
    let rotation = DMat3::from_cols_array(&[r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]]);
    let rotation = DQuat::from_mat3(&rotation).normalize();
    let trace = (0..3).map(|k| svd.singular_values[k] * flip[(k, k)]).sum();
    rotation.is_finite().then_some(BestRotation { rotation, trace })
}

/// Whether points lie so close to a line that they do not determine a rotation, `spread` being the sum of b bᵀ relative to their mean.
pub fn is_line(spread: &Matrix3<f64>) -> bool {
    let mut sizes: Vec<f64> = spread.symmetric_eigenvalues().iter().copied().collect();
    sizes.sort_by(f64::total_cmp);
    sizes[1] <= SPREAD * SPREAD * sizes[2]
}
