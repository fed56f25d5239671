//! How far a surface is from a plane: bulging walls, uneven floors.

use crate::plane::Plane;
use crate::refusal::{Refusal, Target};
use crate::region::Region;
use crate::sum::Sum;
use glam::DVec3;
use serde::Serialize;

/// Bins of the histogram.
const BINS: usize = 41;

/// Signed distances from a plane, weighted by surface area, summed up triangle by triangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Deviation {
    area: Sum,
    first: Sum,
    second: Sum,
    low: f64,
    high: f64,
    range: f64,
    bins: [Sum; BINS],
}

/// The figures, metres.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviationFigures {
    /// Mean signed distance; positive on the side that the plane's normal points to.
    pub mean: f64,
    /// Root mean square distance from the plane.
    pub rms: f64,
    /// Standard deviation about the mean.
    pub deviation: f64,
    /// Smallest signed distance.
    pub lowest: f64,
    /// Largest signed distance.
    pub highest: f64,
    /// Area that counts, square metres.
    pub area: f64,
    /// Shares of the area in equal bins from `-range` to `range`; what lies beyond is in the outermost.
    pub histogram: Vec<f64>,
    /// Where the histogram ends, metres.
    pub range: f64,
}

impl Deviation {
    /// Nothing summed yet; the histogram reaches `range` metres to both sides.
    pub fn new(range: f64) -> Self {
        let zero = Sum::default();
        let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { area: zero, first: zero, second: zero, low, high, range, bins: [zero; BINS] }
    }

    /// Add one triangle.
    pub fn add(&mut self, triangle: [DVec3; 3], plane: &Plane) {
        let n = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
        self.add_part(n.length() * 0.5, triangle.map(|p| plane.distance(p)).into());
    }

    /// Add the part of a triangle inside a region, whose plane is the one that distances are taken from.
    pub fn add_clipped(&mut self, triangle: [DVec3; 3], region: &Region) {
        region.clip(triangle, |part| {
            for w in part[1..].windows(2) {
                let n = (w[0] - part[0]).cross(w[1] - part[0]);
                self.add_part(n.length() * 0.5, DVec3::new(part[0].z, w[0].z, w[1].z));
            }
        });
    }

    /// Distances at the corners. Integrals of a linear function and of its square over a triangle are exact.
    fn add_part(&mut self, area: f64, d: DVec3) {
        let sum = d.element_sum();
        let squares = d.length_squared();
        self.area.add(area);
        self.first.add(area * sum / 3.0);
        self.second.add(area * (sum * sum + squares) / 12.0);
        self.low = self.low.min(d.min_element());
        self.high = self.high.max(d.max_element());
        let place = (sum / 3.0 / self.range + 1.0) * 0.5 * BINS as f64;
        let bin = if place.is_nan() { BINS / 2 } else { place.clamp(0.0, (BINS - 1) as f64) as usize };
        self.bins[bin].add(area);
    }

    /// Add another sum.
    pub fn join(&mut self, o: &Self) {
        self.area.join(&o.area);
        self.first.join(&o.first);
        self.second.join(&o.second);
        (self.low, self.high) = (self.low.min(o.low), self.high.max(o.high));
        self.bins.iter_mut().zip(&o.bins).for_each(|(a, b)| a.join(b));
    }

    /// The figures.
    ///
    /// # Errors
    /// [`Refusal::Misses`] where nothing was added.
    pub fn figures(&self) -> Result<DeviationFigures, Refusal> {
        let area = self.area.value();
        if area <= 0.0 {
            let hint = "draw it over the surface, or let it reach farther".to_owned();
            return Err(Refusal::Misses { what: Target::Region, hint });
        }
        let (mean, square) = (self.first.value() / area, self.second.value() / area);
        Ok(DeviationFigures {
            mean,
            rms: libm::sqrt(square.max(0.0)),
            deviation: libm::sqrt((square - mean * mean).max(0.0)),
            lowest: self.low,
            highest: self.high,
            area,
            histogram: self.bins.iter().map(|b| b.value() / area).collect(),
            range: self.range,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deviation_of_a_tilted_square_is_that_of_a_uniform_distribution() {
        let floor = Plane::new(DVec3::ZERO, DVec3::Z).unwrap();
        let (a, b, c, d) = (
            DVec3::new(0.0, 0.0, -1.0),
            DVec3::new(2.0, 0.0, 1.0),
            DVec3::new(2.0, 1.0, 1.0),
            DVec3::new(0.0, 1.0, -1.0),
        );
        let mut sum = Deviation::new(1.0);
        sum.add([a, b, c], &floor);
        sum.add([a, c, d], &floor);
        let f = sum.figures().unwrap();
        assert!(f.mean.abs() < 1e-12 && (f.rms - (1.0f64 / 3.0).sqrt()).abs() < 1e-12, "{f:?}");
        assert_eq!((f.lowest, f.highest), (-1.0, 1.0));
        assert!((f.histogram.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(Deviation::new(1.0).figures().is_err());
    }
}
