//! Rays and what they meet: the final pick, on the finest surface, the same at every zoom.
//!
//! A [`Picker`] is given the existing chunks, requests those that the ray can meet, nearest first, and is handed their
//! triangles. Everything in lattice units and `f64`. Where triangles are met at the very same place (along a shared edge), the one whose
//! corners come first in the order of lattice points counts, so that the answer does not depend on chunks or their order.

use crate::clip::Clip;
use crate::plane::Plane;
use glam::DVec3;
use kilwa_geometry::bvh::Bounds;
use kilwa_geometry::distance::ray_triangle;
use kilwa_geometry::{Aabb, LatticePoint};

/// A half line: `origin + t * direction`, `t >= 0`. The direction need not be of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

impl Ray {
    /// The point at parameter `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// Where it enters a box of the lattice, a little early against rounding; `None` where it does not.
    pub fn enters(&self, b: &Aabb) -> Option<f64> {
        if b.is_empty() {
            return None;
        }
        // A box without thickness is met too.
        let grown = Bounds { min: b.min.as_dvec3() - 0.5, max: b.max.as_dvec3() + 0.5 };
        grown.entry(self.origin, self.direction)
    }
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Parameter along the ray.
    pub t: f64,
    /// Number of the triangle.
    pub triangle: u32,
    /// The point.
    pub point: DVec3,
}

/// What a final pick found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// Parameter along the ray.
    pub t: f64,
    /// The point, lattice units.
    pub point: DVec3,
    /// The corners of the triangle, in its own order.
    pub corners: [LatticePoint; 3],
}

/// Finds the first triangle along a ray that is not clipped away.
#[derive(Debug, Clone, PartialEq)]
pub struct Picker {
    ray: Ray,
    clips: Vec<Plane>,
    clip: Clip,
    best: Option<Picked>,
}

impl Picker {
    /// Along `ray`; only what lies on the side of every plane of `clips` that its normal points to, or on it, counts. Lattice units.
    pub fn new(ray: Ray, clips: Vec<Plane>) -> Self {
        Self { ray, clips, clip: Clip::default(), best: None }
    }

    /// Along `ray`; only what `clip` leaves counts. Lattice units.
    pub fn clipped(ray: Ray, clip: Clip) -> Self {
        Self { ray, clips: Vec::new(), clip, best: None }
    }

    /// The boxes that the ray enters, with where it does, nearest first.
    pub fn order<'a>(&self, boxes: impl IntoIterator<Item = (u32, &'a Aabb)>) -> Vec<(f64, u32)> {
        let mut order: Vec<(f64, u32)> =
            boxes.into_iter().filter_map(|(i, b)| Some((self.ray.enters(b)?, i))).collect();
        nearest_first(&mut order);
        order
    }

    /// Whether a box that the ray enters at `t` can still hold what is looked for.
    pub fn wants(&self, t: f64) -> bool {
        self.best.is_none_or(|b| t <= b.t)
    }

    /// Look at one triangle of the finest surface.
    pub fn add(&mut self, corners: [LatticePoint; 3]) {
        let Some(t) = ray_triangle(self.ray.origin, self.ray.direction, corners.map(glam::IVec3::as_dvec3)) else {
            return;
        };
        let first = |c: [LatticePoint; 3]| {
            let mut c = c.map(|p| p.to_array());
            c.sort_unstable();
            c
        };
        let better = self.best.is_none_or(|b| t < b.t || (t == b.t && first(corners) < first(b.corners)));
        let point = self.ray.at(t);
        if better && self.clip.keeps(point) && self.clips.iter().all(|c| c.distance(point) >= 0.0) {
            self.best = Some(Picked { t, point, corners });
        }
    }

    /// What was found.
    pub fn picked(&self) -> Option<&Picked> {
        self.best.as_ref()
    }
}

/// Sorts chunks by distance, then by number. A separate function, because the page's module has no room for a second sort.
pub(crate) fn nearest_first(order: &mut [(f64, u32)]) {
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_pass_through_clipped_triangles_in_any_order() {
        let near = [[0, 0, 10], [100, 0, 10], [0, 100, 10]].map(LatticePoint::from_array);
        let far = [[0, 0, 20], [100, 0, 20], [0, 100, 20]].map(LatticePoint::from_array);
        let twin = [[0, 0, 20], [100, 0, 20], [100, -100, 20]].map(LatticePoint::from_array);
        let ray = Ray { origin: DVec3::new(25.0, 0.0, 0.0), direction: DVec3::Z };
        let pick = |clips: Vec<Plane>, triangles: &[[LatticePoint; 3]]| {
            let mut p = Picker::new(ray, clips);
            for t in triangles {
                p.add(*t);
            }
            p.picked().copied()
        };
        assert_eq!(pick(vec![], &[far, near]).unwrap().t, 10.0);
        let beyond = Plane::new(DVec3::new(0.0, 0.0, 15.0), DVec3::Z).unwrap();
        assert_eq!(pick(vec![beyond], &[near, far, twin]), pick(vec![beyond], &[twin, far, near]));
        assert_eq!(pick(vec![beyond], &[near, far]).unwrap().t, 20.0);
        let below = Plane::new(DVec3::new(0.0, 0.0, 5.0), DVec3::new(0.0, 0.0, -1.0)).unwrap();
        assert_eq!(pick(vec![below], &[near, far]), None);
    }

    #[test]
    fn boxes_are_visited_in_the_order_the_ray_meets_them() {
        let b = |z: i32| Aabb { min: LatticePoint::new(0, 0, z), max: LatticePoint::new(10, 10, z + 5) };
        let (far, near, aside) =
            (b(50), b(20), Aabb { min: LatticePoint::new(90, 0, 0), max: LatticePoint::new(99, 9, 9) });
        let ray = Ray { origin: DVec3::new(5.0, 5.0, 0.0), direction: DVec3::new(0.0, 0.0, 2.0) };
        let picker = Picker::new(ray, Vec::new());
        let order = picker.order([(7, &far), (8, &near), (9, &aside), (10, &Aabb::EMPTY)]);
        assert_eq!(order.iter().map(|o| o.1).collect::<Vec<_>>(), [8, 7]);
        assert!(picker.wants(1e9));
    }
}
