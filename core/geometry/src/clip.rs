//! The clip: a plane and a box, in lattice units. Exact in f64; parts that are cut away entirely are neither loaded nor drawn.

use crate::Sphere;
use glam::DVec3;

/// A half-space: the side of a plane that stays. `normal · p <= offset` is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Unit normal, towards what is removed.
    pub normal: DVec3,
    /// `normal · p` on the plane.
    pub offset: f64,
}

impl HalfSpace {
    /// How far inside of what stays a point lies; negative where it is removed.
    pub fn depth(&self, point: DVec3) -> f64 {
        self.offset - self.normal.dot(point)
    }
}

/// A box of six half-spaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipBox {
    /// Its faces, opposite ones side by side.
    pub faces: [HalfSpace; 6],
    /// Take the inside away instead of the outside.
    pub remove_inside: bool,
}

impl ClipBox {
    /// How deep in the box a point lies; negative outside.
    fn depth(&self, point: DVec3) -> f64 {
        self.faces.iter().map(|f| f.depth(point)).fold(f64::INFINITY, f64::min)
    }
}

/// A clip: a plane, a box or both; everything that either of them removes is cut away.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clip {
    /// One plane.
    pub plane: Option<HalfSpace>,
    /// One box.
    pub bounds: Option<ClipBox>,
}

/// Steps that a ball must lie beyond a plane: the shaders cut by `f32` distances from a cell near the eye.
const SLACK: f64 = 1.0;
/// The same, of the distance from the origin of the lattice.
const RELATIVE_SLACK: f64 = 1e-6;

impl Clip {
    /// Whether anything is cut.
    pub fn is_on(&self) -> bool {
        self.plane.is_some() || self.bounds.is_some()
    }

    /// How far inside of what stays a point lies; negative where it is removed, infinite where nothing is cut.
    pub fn depth(&self, point: DVec3) -> f64 {
        let plane = self.plane.map_or(f64::INFINITY, |p| p.depth(point));
        let bounds =
            self.bounds.map_or(f64::INFINITY, |b| if b.remove_inside { -b.depth(point) } else { b.depth(point) });
        plane.min(bounds)
    }

    /// Whether a point stays.
    pub fn keeps(&self, point: DVec3) -> bool {
        self.depth(point) >= 0.0
    }

    /// Whether all of a ball is removed (never wrongly `true`; a ball across an edge of the box may be kept).
    pub fn removes(&self, ball: &Sphere) -> bool {
        if !self.is_on() {
            return false;
        }
        let far = ball.center.abs().max_element();
        let radius = ball.radius.max(0.0) * (1.0 + 1e-9) + SLACK + far * RELATIVE_SLACK;
        // Depth grows by at most the distance: what is deeper than the radius on the wrong side stays there all over the ball.
        self.depth(ball.center) < -radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::IVec3;

    fn unit_box(remove_inside: bool) -> ClipBox {
        let faces = std::array::from_fn(|k| {
            let mut normal = DVec3::ZERO;
            normal[k / 2] = if k % 2 == 0 { -1.0 } else { 1.0 };
            HalfSpace { normal, offset: 100.0 }
        });
        ClipBox { faces, remove_inside }
    }

    #[test]
    fn no_point_of_a_clipped_ball_remains() {
        // A grid of balls and of points in each.
        let plane = HalfSpace { normal: DVec3::new(0.6, 0.0, 0.8), offset: 30.0 };
        let clips = [
            Clip { plane: Some(plane), bounds: None },
            Clip { plane: None, bounds: Some(unit_box(false)) },
            Clip { plane: None, bounds: Some(unit_box(true)) },
            Clip { plane: Some(plane), bounds: Some(unit_box(false)) },
        ];
        for clip in clips {
            let (mut removed, mut kept) = (0, 0);
            for k in 0..20 * 20 * 20 {
                let center = IVec3::new(k % 20, k / 20 % 20, k / 400).as_dvec3() * 16.0 - 160.0;
                let ball = Sphere { center, radius: f64::from(k % 7) * 9.0 };
                if !clip.removes(&ball) {
                    kept += 1;
                    continue;
                }
                removed += 1;
                for d in 0..27 {
                    let way = IVec3::new(d % 3, d / 3 % 3, d / 9).as_dvec3() - 1.0;
                    let length = way.length().max(1.0);
                    let point = center + way / length * ball.radius;
                    assert!(!clip.keeps(point), "{point:?} of {ball:?} stays");
                }
            }
            assert!(removed > 100 && kept > 100, "{removed} removed, {kept} kept");
        }
    }

    #[test]
    fn without_a_clip_nothing_is_removed() {
        assert!(!Clip::default().removes(&Sphere { center: DVec3::splat(1e9), radius: 0.0 }));
    }
}
