//! The box of `--box`: which triangles lie in it, by their centroids.

use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::{Aabb, Lattice, LatticePoint, Sphere};
use std::fmt;
use std::str::FromStr;

/// A closed box in world coordinates, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    min: [f64; 3],
    max: [f64; 3],
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
        let (min, max) = ([a, b, c], [d, e, f]);
        if let Some(k) = (0..3).find(|&k| min[k] > max[k]) {
            let axis = ["x", "y", "z"][k];
            return Err(format!("{axis} runs from {} to {}: the smaller one comes first", min[k], max[k]));
        }
        Ok(Self { min, max })
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([a, b, c], [d, e, g]) = (self.min, self.max);
        write!(f, "{a},{b},{c},{d},{e},{g}")
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
    min: [f64; 3],
    max: [f64; 3],
}

impl Steps {
    /// Whether the centroid of a triangle lies in the box; a centroid on its side does.
    pub(super) fn holds(&self, corners: [LatticePoint; 3]) -> bool {
        let sum = corner_sum(corners);
        (0..3).all(|k| {
            let centroid = sum[k] as f64 / 3.0;
            self.min[k] <= centroid && centroid <= self.max[k]
        })
    }

    /// Whether a triangle of a chunk with this box can lie in it.
    pub(super) fn meets(&self, bounds: &Aabb) -> bool {
        (0..3).all(|k| self.min[k] <= f64::from(bounds.max[k]) && f64::from(bounds.min[k]) <= self.max[k])
    }

    /// Whether it has a point in common with a ball.
    pub(super) fn meets_ball(&self, ball: &Sphere) -> bool {
        let apart = (0..3).map(|k| {
            let nearest = ball.center[k].clamp(self.min[k], self.max[k]);
            (ball.center[k] - nearest) * (ball.center[k] - nearest)
        });
        ball.radius >= 0.0 && apart.sum::<f64>() <= ball.radius * ball.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_numbers_make_a_box_and_other_input_is_refused_with_the_reason() {
        assert_eq!("-1,0,0,1,2.5,1e2".parse::<Region>().unwrap().max, [1.0, 2.5, 100.0]);
        for text in ["", "1,2,3", "1,2,3,4,5,six", "0,0,0,1,1,nan", "0,0,0,1,1,1,1"] {
            assert!(text.parse::<Region>().unwrap_err().contains("six numbers"), "{text}");
        }
        assert!("0,5,0,1,1,1".parse::<Region>().unwrap_err().contains("y runs from 5 to 1"));
    }

    #[test]
    fn a_triangle_is_inside_a_box_if_its_centroid_is() {
        let region = Steps { min: [0.0; 3], max: [4.0, 4.0, 0.0] };
        assert!(region.holds([[0, 0, 0], [9, 0, 0], [3, 9, 0]]), "its centroid is 4 3 0");
        assert!(!region.holds([[0, 0, 0], [9, 0, 0], [4, 9, 0]]));
    }
}
