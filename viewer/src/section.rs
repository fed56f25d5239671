//! What is cut away: a plane and a box. Exact in f64 for streaming and picks; the shaders get the same half-spaces relative to their
//! cell.

use kilwa_geometry::distance::{Vec3, dot};

pub use kilwa_stream::clip::{Clip, ClipBox, HalfSpace};

/// The faces of a box round `center` of `size`, turned clockwise about the vertical by `turn` radians.
pub fn box_faces(center: Vec3, size: Vec3, turn: f64) -> [HalfSpace; 6] {
    let (s, c) = libm::sincos(turn);
    let axes = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]];
    std::array::from_fn(|k| {
        let sign = if k % 2 == 0 { -1.0 } else { 1.0 };
        let normal = axes[k / 2].map(|x| x * sign);
        HalfSpace { normal, offset: dot(normal, center) + size[k / 2] * 0.5 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_keeps_the_side_that_its_normal_points_away_from() {
        let clip = Clip { plane: Some(HalfSpace { normal: [0.0, 0.0, 1.0], offset: 2.0 }), bounds: None };
        assert!(clip.keeps([9.0, 9.0, 2.0]) && clip.keeps([0.0, 0.0, -5.0]) && !clip.keeps([0.0, 0.0, 2.1]));
        assert!(Clip::default().keeps([1e9; 3]) && !Clip::default().is_on());
    }

    #[test]
    fn a_turned_box_keeps_its_inside_or_its_outside() {
        // 10 long to the north, 2 wide; turned by 90 degrees it is long to the east.
        let faces = box_faces([100.0, 200.0, 5.0], [2.0, 10.0, 4.0], std::f64::consts::FRAC_PI_2);
        let keep = Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: false }) };
        let drop = Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: true }) };
        for (point, inside) in [
            ([100.0, 200.0, 5.0], true),
            ([104.9, 200.9, 6.9], true),
            ([105.1, 200.0, 5.0], false),
            ([100.0, 201.1, 5.0], false),
            ([100.0, 200.0, 7.1], false),
        ] {
            assert_eq!(keep.keeps(point), inside, "{point:?}");
            assert_eq!(drop.keeps(point), !inside, "{point:?}");
        }
    }

    #[test]
    fn plane_and_box_both_take_away() {
        let plane = Some(HalfSpace { normal: [1.0, 0.0, 0.0], offset: 0.0 });
        let faces = box_faces([0.0; 3], [2.0; 3], 0.0);
        let clip = Clip { plane, bounds: Some(ClipBox { faces, remove_inside: false }) };
        assert!(clip.keeps([-0.5, 0.0, 0.0]) && !clip.keeps([0.5, 0.0, 0.0]) && !clip.keeps([-1.5, 0.0, 0.0]));
    }
}
