//! The box of `--box`: which triangles lie in it, by their centroids.

use glam::DVec3;
use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::{Aabb, Lattice, LatticePoint, Sphere};
use std::fmt;
use std::str::FromStr;

/// A closed box in world coordinates, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    min: DVec3,
    max: DVec3,
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = || "expected six numbers, xmin,ymin,zmin,xmax,ymax,zmax, in metres".to_owned();
        let numbers: Vec<f64> =
            text.split(',').map(|n| n.trim().parse()).collect::<Result<_, _>>().map_err(|_| wanted())?;
        let &[a, b, c, d, e, f] = &numbers[..] else { return Err(wanted()) };
        if !numbers.iter().all(|n| n.is_finite()) {
            return Err(wanted());
        }
        let (min, max) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
        if let Some(k) = (0..3).find(|&k| min[k] > max[k]) {
            let axis = ["x", "y", "z"][k];
            return Err(format!("{axis} runs from {} to {}: the smaller one comes first", min[k], max[k]));
        }
        Ok(Self { min, max })
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (min, max) = (self.min, self.max);
        write!(f, "{},{},{},{},{},{}", min.x, min.y, min.z, max.x, max.y, max.z)
    }
}

impl Region {
    /// The box in the steps of a lattice.
    pub(super) fn on(&self, lattice: &Lattice) -> Steps {
        Steps { min: lattice.steps_from_world(self.min), max: lattice.steps_from_world(self.max) }
    }
}

/// A box in lattice units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps {
    min: DVec3,
    max: DVec3,
}

impl Steps {
    /// Whether the centroid of a triangle lies in the box; a centroid on its side does.
    pub(super) fn holds(&self, corners: [LatticePoint; 3]) -> bool {
        let centroid = corner_sum(corners).as_dvec3() / 3.0;
        self.min.cmple(centroid).all() && centroid.cmple(self.max).all()
    }

    /// Whether a triangle of a chunk with this box can lie in it.
    pub(super) fn meets(&self, bounds: &Aabb) -> bool {
        self.min.cmple(bounds.max.as_dvec3()).all() && bounds.min.as_dvec3().cmple(self.max).all()
    }

    /// Whether it has a point in common with a ball.
    pub(super) fn meets_ball(&self, ball: &Sphere) -> bool {
        let nearest = ball.center.clamp(self.min, self.max);
        ball.radius >= 0.0 && ball.center.distance_squared(nearest) <= ball.radius * ball.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_numbers_make_a_box_and_other_input_is_refused_with_the_reason() {
        assert_eq!("-1,0,0,1,2.5,1e2".parse::<Region>().unwrap().max, DVec3::new(1.0, 2.5, 100.0));
        for text in ["", "1,2,3", "1,2,3,4,5,six", "0,0,0,1,1,nan", "0,0,0,1,1,1,1"] {
            assert!(text.parse::<Region>().unwrap_err().contains("six numbers"), "{text}");
        }
        assert!("0,5,0,1,1,1".parse::<Region>().unwrap_err().contains("y runs from 5 to 1"));
    }

    #[test]
    fn a_triangle_is_inside_a_box_if_its_centroid_is() {
        let region = Steps { min: DVec3::ZERO, max: DVec3::new(4.0, 4.0, 0.0) };
        assert!(region.holds([[0, 0, 0], [9, 0, 0], [3, 9, 0]].map(LatticePoint::from_array)), "its centroid is 4 3 0");
        assert!(!region.holds([[0, 0, 0], [9, 0, 0], [4, 9, 0]].map(LatticePoint::from_array)));
    }
}
