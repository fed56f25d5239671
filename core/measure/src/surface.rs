//! A set of triangles with a search tree: nearest points and rays.

use crate::pick::{Hit, Ray};
use glam::DVec3;
use kilwa_geometry::Bvh;
use kilwa_geometry::distance::{closest_on_triangle, ray_triangle};

/// Triangles in any one unit, for example metres or lattice units; answers come in the same.
pub struct Surface {
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
}

impl Surface {
    /// Build the tree.
    pub fn new(triangles: Vec<[DVec3; 3]>) -> Self {
        let tree = Bvh::new(&triangles);
        Self { triangles, tree }
    }

    /// The triangles, in the order given.
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// The point of the surface nearest to `p`, with the number of its triangle; `None` where there is no surface.
    /// Ties go to the smaller number.
    pub fn nearest(&self, p: DVec3) -> Option<(DVec3, u32)> {
        let mut best: Option<(f64, u32, DVec3)> = None;
        let visit = |t: u32, limit: f64| {
            let q = closest_on_triangle(p, self.triangles[t as usize]);
            let d = (p - q).length_squared();
            if best.is_none_or(|b| d < b.0 || (d == b.0 && t < b.1)) {
                best = Some((d, t, q));
                // Equals are still looked at.
                return d.next_up();
            }
            limit
        };
        self.tree.search(f64::INFINITY, |b| Some(b.distance_squared(p)), visit);
        best.map(|b| (b.2, b.1))
    }

    /// The first triangle that a ray meets, from either side. Ties go to the smaller number.
    pub fn cast(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let visit = |t: u32, limit: f64| {
            let Some(at) = ray_triangle(ray.origin, ray.direction, self.triangles[t as usize]) else { return limit };
            if best.is_none_or(|b| at < b.t || (at == b.t && t < b.triangle)) {
                best = Some(Hit { t: at, triangle: t, point: ray.at(at) });
                return at.next_up();
            }
            limit
        };
        self.tree.search(f64::INFINITY, |b| b.entry(ray.origin, ray.direction), visit);
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn soup(seed: u64, n: usize) -> Vec<[DVec3; 3]> {
        let mut generator = fastrand::Rng::with_seed(seed);
        let mut random = || generator.f64() * 256.0;
        (0..n)
            .map(|_| {
                let base = DVec3::new(random(), random(), random());
                [0, 1, 2].map(|_| base + DVec3::new(random(), random(), random()) * 0.05)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_tree_agrees_with_testing_every_triangle(seed in any::<u64>(),
            o in prop::array::uniform3(-10.0f64..266.0).prop_map(DVec3::from),
            d in prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from),
        ) {
            let s = Surface::new(soup(seed, 300));
            let ray = Ray { origin: o, direction: d };
            let slow = s.triangles().iter().enumerate()
                .filter_map(|(i, t)| ray_triangle(o, d, *t).map(|at| (at, i as u32)))
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            prop_assert_eq!(s.cast(&ray).map(|h| (h.t, h.triangle)), slow);
            let near = s.nearest(o).map(|(q, _)| q.distance_squared(o));
            let slow = s.triangles().iter().map(|t| o.distance_squared(closest_on_triangle(o, *t))).min_by(f64::total_cmp);
            prop_assert_eq!(near, slow);
        }
    }

    #[test]
    fn an_empty_surface_has_no_nearest_point_and_no_hit() {
        let s = Surface::new(Vec::new());
        assert!(s.nearest(DVec3::ZERO).is_none());
        assert!(s.cast(&Ray { origin: DVec3::ZERO, direction: DVec3::X }).is_none());
    }
}
