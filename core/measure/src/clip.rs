//! The clip: a plane and a box. Exact in f64 for picks; the shaders get the same half-spaces relative to their cell.
//!
//! Points and half-spaces are in one unit, in practice lattice units. [`ClipState`] is what people and links say, in world metres.

use crate::pick::Ray;
use glam::DVec3;
use kilwa_geometry::Lattice;
pub use kilwa_geometry::clip::{Clip, ClipBox, HalfSpace};
use serde::{Deserialize, Serialize};

/// A plane in world metres. The normal need not have length 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldPlane {
    /// Its normal.
    pub normal: DVec3,
    /// A point on it, metres.
    pub point: DVec3,
}

/// A box in world metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct WorldBox {
    /// Its middle.
    pub center: DVec3,
    /// Width, depth and height.
    pub size: DVec3,
    /// Degrees that it is turned, clockwise seen from above.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn: f64,
    /// Remove the inside instead of the outside.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub remove_inside: bool,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands references")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// The part of a display that says what is cut away; other fields are passed over.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct ClipState {
    /// Cuts away the side that its normal points to.
    pub clip_plane: Option<WorldPlane>,
    /// Cuts away what lies outside (or inside).
    pub clip_box: Option<WorldBox>,
}

impl ClipState {
    /// In lattice units.
    pub fn in_steps(&self, lattice: &Lattice) -> Clip {
        let step = lattice.step();
        let bounds = self.clip_box.map(|b| ClipBox {
            faces: box_faces(lattice.steps_from_world(b.center), b.size / step, b.turn.to_radians()),
            remove_inside: b.remove_inside,
        });
        Clip { plane: self.clip_plane.map(|p| half_space(&p, lattice)), bounds }
    }
}

/// The half-space in lattice units that a plane's normal points away from.
pub fn half_space(plane: &WorldPlane, lattice: &Lattice) -> HalfSpace {
    let length = plane.normal.length();
    let normal = plane.normal / length;
    HalfSpace { normal, offset: normal.dot(lattice.steps_from_world(plane.point)) }
}

/// The stretches of a ray (parameters) that stay, in order, each a little long against rounding.
pub fn stretches(clip: &Clip, ray: &Ray) -> Vec<(f64, f64)> {
    let within = |faces: &[HalfSpace], slack: f64| {
        faces.iter().fold((f64::NEG_INFINITY, f64::INFINITY), |(from, to): (f64, f64), face| {
            let (depth, rate) = (face.depth(ray.origin) + slack, face.normal.dot(ray.direction));
            match rate {
                0.0 if depth >= 0.0 => (from, to),
                0.0 => (f64::INFINITY, f64::NEG_INFINITY),
                _ if rate > 0.0 => (from, to.min(depth / rate)),
                _ => (from.max(depth / rate), to),
            }
        })
    };
    let plane = within(clip.plane.as_slice(), 1e-6);
    let parts = match clip.bounds {
        None => vec![plane],
        Some(b) if !b.remove_inside => {
            let inside = within(&b.faces, 1e-6);
            vec![(plane.0.max(inside.0), plane.1.min(inside.1))]
        }
        Some(b) => {
            let (from, to) = within(&b.faces, -1e-6);
            if from > to { vec![plane] } else { vec![(plane.0, plane.1.min(from)), (plane.0.max(to), plane.1)] }
        }
    };
    parts.into_iter().map(|(from, to)| (from.max(0.0), to)).filter(|(from, to)| from <= to).collect()
}

/// The faces of a box round `center` of `size`, turned clockwise about the vertical by `turn` radians.
pub fn box_faces(center: DVec3, size: DVec3, turn: f64) -> [HalfSpace; 6] {
    let (s, c) = libm::sincos(turn);
    let axes = [DVec3::new(c, -s, 0.0), DVec3::new(s, c, 0.0), DVec3::Z];
    std::array::from_fn(|k| {
        let sign = if k % 2 == 0 { -1.0 } else { 1.0 };
        let normal = axes[k / 2] * sign;
        HalfSpace { normal, offset: normal.dot(center) + size[k / 2] * 0.5 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_keeps_the_side_that_its_normal_points_away_from() {
        let clip = Clip { plane: Some(HalfSpace { normal: DVec3::Z, offset: 2.0 }), bounds: None };
        assert!(
            clip.keeps(DVec3::new(9.0, 9.0, 2.0))
                && clip.keeps(DVec3::new(0.0, 0.0, -5.0))
                && !clip.keeps(DVec3::new(0.0, 0.0, 2.1))
        );
        assert!(Clip::default().keeps(DVec3::splat(1e9)) && !Clip::default().is_on());
    }

    #[test]
    fn a_turned_box_keeps_its_inside_or_its_outside() {
        // 10 long to the north, 2 wide; turned by 90 degrees it is long to the east.
        let faces = box_faces(DVec3::new(100.0, 200.0, 5.0), DVec3::new(2.0, 10.0, 4.0), std::f64::consts::FRAC_PI_2);
        let keep = Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: false }) };
        let drop = Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: true }) };
        for (point, inside) in [
            (DVec3::new(100.0, 200.0, 5.0), true),
            (DVec3::new(104.9, 200.9, 6.9), true),
            (DVec3::new(105.1, 200.0, 5.0), false),
            (DVec3::new(100.0, 201.1, 5.0), false),
            (DVec3::new(100.0, 200.0, 7.1), false),
        ] {
            assert_eq!(keep.keeps(point), inside, "{point:?}");
            assert_eq!(drop.keeps(point), !inside, "{point:?}");
        }
    }

    #[test]
    fn the_intervals_of_a_ray_contain_exactly_its_unclipped_points() {
        let faces = box_faces(DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 6.0, 2.0), 0.4);
        let plane = Some(HalfSpace { normal: DVec3::new(0.6, 0.0, 0.8), offset: 4.0 });
        let mut generator = fastrand::Rng::with_seed(1);
        let mut random = || generator.f64() * 2.0 - 1.0;
        for (remove_inside, plane) in [(false, None), (true, None), (false, plane), (true, plane)] {
            let clip = Clip { plane, bounds: Some(ClipBox { faces, remove_inside }) };
            for _ in 0..200 {
                let mut point = || DVec3::from_array(std::array::from_fn(|_| random() * 8.0));
                let ray = Ray { origin: point(), direction: point() };
                let parts = stretches(&clip, &ray);
                for t in (0..400).map(|i| f64::from(i) * 0.01) {
                    let depth = clip.depth(ray.at(t));
                    let inside = parts.iter().any(|(from, to)| *from <= t && t <= *to);
                    assert!(inside || depth < 0.0, "{t} stays, {parts:?}");
                    assert!(!inside || depth > -1e-4, "{t} is cut away, {parts:?}");
                }
            }
        }
    }

    #[test]
    fn plane_and_box_are_both_applied() {
        let plane = Some(HalfSpace { normal: DVec3::X, offset: 0.0 });
        let faces = box_faces(DVec3::ZERO, DVec3::splat(2.0), 0.0);
        let clip = Clip { plane, bounds: Some(ClipBox { faces, remove_inside: false }) };
        assert!(
            clip.keeps(DVec3::new(-0.5, 0.0, 0.0))
                && !clip.keeps(DVec3::new(0.5, 0.0, 0.0))
                && !clip.keeps(DVec3::new(-1.5, 0.0, 0.0))
        );
    }
}
