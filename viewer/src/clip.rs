//! From lattice points to clip space: the integer cell near the eye, and the one matrix for everything.
//!
//! `clip = clip_from_cell × (f32(position − cell), 1)`. Depth is reversed: 1 at the near plane, 0 at the far one (or at
//! infinity), which spends the precision of floats evenly.

use crate::options::{Frustum, Tile};
use glam::{DMat4, DVec3, DVec4, Mat4, Vec4};
use kilwa_geometry::LatticePoint;
use kilwa_stream::{Projection, View};

/// What the vertex shaders need of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipTransform {
    /// Positions are counted from this lattice point.
    pub cell: LatticePoint,
    /// The matrix.
    pub clip_from_cell: Mat4,
    /// The eye from the cell, in lattice units, and 1; or for parallel projection the direction to the eye, and 0.
    pub eye_from_cell: Vec4,
}

/// Cells are kept where the difference to any lattice point fits an `i32`.
const CELL_RANGE: (f64, f64) = (-1_073_741_824.0, 2_147_483_647.0);

impl ClipTransform {
    /// The transform of a view, or of a tile of it.
    pub fn new(view: &View, tile: Option<Tile>) -> Self {
        let (low, high) = (DVec3::splat(CELL_RANGE.0), DVec3::splat(CELL_RANGE.1));
        let cell = view.anchor.round().clamp(low, high).as_ivec3();
        let offset = cell.as_dvec3() - view.eye;
        let rows = view_rows(view, offset);
        let clip = match view.projection {
            Projection::Perspective { tan_half_height } => {
                let (sx, sy) = (1.0 / (tan_half_height * view.aspect()), 1.0 / tan_half_height);
                // Reversed, infinite far: depth = near / distance along the axis.
                [rows[0] * sx, rows[1] * sy, DVec4::ZERO.with_w(view.near), rows[2]]
            }
            Projection::Orthographic { half_height } => {
                let (sx, sy) = (1.0 / (half_height * view.aspect()), 1.0 / half_height);
                let depth = 1.0 / (view.far - view.near);
                let mut z = rows[2] * -depth;
                z.w += view.far * depth;
                [rows[0] * sx, rows[1] * sy, z, DVec4::W]
            }
        };
        let clip = crop(clip, view, tile);
        let eye_from_cell = match view.projection {
            Projection::Perspective { .. } => (-offset).as_vec3().extend(1.0),
            Projection::Orthographic { .. } => (-view.forward).as_vec3().extend(0.0),
        };
        let [x, y, z, w] = clip;
        Self { cell, clip_from_cell: DMat4::from_cols(x, y, z, w).transpose().as_mat4(), eye_from_cell }
    }

    /// The transform of a perspective view whose picture has these edges instead of its own, or of a tile of it. The browser's program for WebGPU,
    /// which should be small, does not contain it: nothing there calls it.
    pub fn with_frustum(view: &View, tile: Option<Tile>, f: Frustum) -> Self {
        let Self { cell, eye_from_cell, .. } = Self::new(view, tile);
        let [right, up, forward] = view_rows(view, cell.as_dvec3() - view.eye);
        let across = (right * 2.0 - forward * (f.right + f.left)) / (f.right - f.left);
        let upward = (up * 2.0 - forward * (f.up + f.down)) / (f.up - f.down);
        let [x, y, z, w] = crop([across, upward, DVec4::ZERO.with_w(view.near), forward], view, tile);
        Self { cell, clip_from_cell: DMat4::from_cols(x, y, z, w).transpose().as_mat4(), eye_from_cell }
    }
}

/// Depth along the view axis, in lattice units, of a value of the depth buffer.
pub fn distance_from_depth(view: &View, depth: f32) -> f64 {
    match view.projection {
        Projection::Perspective { .. } => view.near / f64::from(depth),
        Projection::Orthographic { .. } => view.far - f64::from(depth) * (view.far - view.near),
    }
}

/// Rows that take a point counted from the cell to right, up and forward coordinates from the eye.
fn view_rows(view: &View, offset: DVec3) -> [DVec4; 3] {
    [view.right, view.up, view.forward].map(|axis| axis.extend(axis.dot(offset)))
}

/// Stretch a tile of the picture over the whole clip square; rows of a matrix.
fn crop(clip: [DVec4; 4], view: &View, tile: Option<Tile>) -> [DVec4; 4] {
    let Some(tile) = tile else { return clip };
    let mut out = clip;
    for axis in 0..2 {
        let full = f64::from(view.size[axis].max(1));
        let part = f64::from(tile.size[axis].max(1));
        let middle = (2.0 * f64::from(tile.offset[axis]) + part) / full - 1.0;
        let middle = if axis == 0 { middle } else { -middle };
        out[axis] = (clip[axis] - middle * clip[3]) * full / part;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> View {
        View {
            eye: DVec3::new(1000.5, -2000.25, 300.125),
            right: DVec3::X,
            up: DVec3::Z,
            forward: DVec3::Y,
            anchor: DVec3::new(1000.5, -2000.25, 300.125),
            projection: Projection::Perspective { tan_half_height: 0.5 },
            size: [400, 200],
            near: 10.0,
            far: 0.0,
            target_pixels: 1.0,
            clip: kilwa_stream::Clip::default(),
        }
    }

    fn apply(t: &ClipTransform, p: LatticePoint) -> DVec4 {
        t.clip_from_cell.as_dmat4() * (p - t.cell).as_dvec3().extend(1.0)
    }

    #[test]
    fn the_axis_projects_to_the_centre_and_depth_is_near_over_distance() {
        let t = ClipTransform::new(&view(), None);
        let DVec4 { x, y, z, w } = apply(&t, LatticePoint::new(1000, -1000, 300));
        assert!((x / w).abs() < 1e-3 && (y / w).abs() < 1e-3);
        assert!((distance_from_depth(&view(), (z / w) as f32) - 1000.25).abs() < 0.01);
    }

    #[test]
    fn a_tile_shows_exactly_its_part() {
        let view = view();
        let whole = ClipTransform::new(&view, None);
        let tile = Tile { offset: [100, 50], size: [50, 25] };
        let part = ClipTransform::new(&view, Some(tile));
        let p = LatticePoint::new(1011, -1950, 311);
        let (a, b) = (apply(&whole, p), apply(&part, p));
        let pixel = |c: DVec4, size: [f64; 2]| [(c.x / c.w + 1.0) * 0.5 * size[0], (1.0 - c.y / c.w) * 0.5 * size[1]];
        let (a, b) = (pixel(a, [400.0, 200.0]), pixel(b, [50.0, 25.0]));
        assert!((a[0] - 100.0 - b[0]).abs() < 1e-3 && (a[1] - 50.0 - b[1]).abs() < 1e-3, "{a:?} {b:?}");
    }

    #[test]
    fn a_frustum_has_its_own_edges_and_one_like_that_of_the_view_changes_nothing() {
        let view = view();
        let symmetric = Frustum { left: -1.0, right: 1.0, down: -0.5, up: 0.5 };
        let difference = ClipTransform::with_frustum(&view, None, symmetric).clip_from_cell
            - ClipTransform::new(&view, None).clip_from_cell;
        assert!(difference.to_cols_array().iter().all(|x| x.abs() < 1e-4), "{difference:?}");
        let f = Frustum { left: -1.2, right: 0.7, down: -0.9, up: 1.1 };
        let t = ClipTransform::with_frustum(&view, None, f);
        for (across, upward) in [(0.0, 0.0), (-1.2, -0.9), (0.7, 1.1), (0.3, -0.4)] {
            let p = view.eye + (view.forward + view.right * across + view.up * upward) * 40_000.0;
            let DVec4 { x, y, w, .. } = apply(&t, p.round().as_ivec3());
            let wanted = |v: f64, low: f64, high: f64| (2.0 * v - low - high) / (high - low);
            assert!((x / w - wanted(across, f.left, f.right)).abs() < 1e-4, "{across}: {}", x / w);
            assert!((y / w - wanted(upward, f.down, f.up)).abs() < 1e-4, "{upward}: {}", y / w);
        }
    }

    #[test]
    fn distant_cameras_keep_the_cell_in_range() {
        let mut v = view();
        v.eye = DVec3::new(1e12, -1e12, 0.0);
        v.anchor = v.eye;
        let t = ClipTransform::new(&v, None);
        for i in 0..3 {
            assert!(0i32.checked_sub(t.cell[i]).is_some());
            assert!(kilwa_geometry::lattice::MAX_COORDINATE.checked_sub(t.cell[i]).is_some());
        }
    }
}
