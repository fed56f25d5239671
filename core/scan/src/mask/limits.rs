//! Limits that a sample meets or not: incidence, a box, intensity.

use crate::sample::{Rays, Sample};
use crate::tessellate::{self, Vertex};
use glam::DVec3;

/// Whether a point lies in a box, its border included.
pub fn is_inside([min, max]: [DVec3; 2], point: DVec3) -> bool {
    point.cmpge(min).all() && point.cmple(max).all()
}

/// Whether an intensity is below or above the limits. A sample without intensity (NaN) is not.
pub fn is_beyond([min, max]: [f32; 2], intensity: f32) -> bool {
    intensity < min || intensity > max
}

/// The samples of a line that are seen at more than `limit` (radians from the normal of the surface). `left` and `right` are the lines beside it.
/// The incidence is that of [`tessellate::vertices`]; where the neighbours do not show it, the sample is kept.
#[derive(Debug)]
pub struct Grazing {
    options: tessellate::Options,
    vertices: Vec<Option<Vertex>>,
}

impl Grazing {
    /// A test against `limit`, in radians from the normal.
    pub fn new(limit: f64) -> Self {
        let options = tessellate::Options { grazing: limit, ..tessellate::Options::default() };
        Self { options, vertices: Vec::new() }
    }

    /// Call `mask` with the place of every sample in the line that is beyond the limit.
    pub fn line(
        &mut self,
        left: Option<&[Sample]>,
        here: &[Sample],
        right: Option<&[Sample]>,
        rays: Rays,
        mask: &mut dyn FnMut(usize),
    ) {
        tessellate::vertices(left, here, right, rays, &self.options, &mut self.vertices);
        let least = libm::cos(self.options.grazing);
        for (at, vertex) in self.vertices.iter().enumerate() {
            if vertex.and_then(|v| v.cos_incidence).is_some_and(|cos| cos < least) {
                mask(at);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_holds_its_border_and_an_unknown_intensity_is_within_all_limits() {
        let bounds = [DVec3::ZERO, DVec3::ONE];
        assert!(is_inside(bounds, DVec3::ONE) && is_inside(bounds, DVec3::ZERO));
        assert!(!is_inside(bounds, DVec3::new(0.5, 1.000_001, 0.5)));
        assert!(is_beyond([0.1, 0.9], 0.05) && is_beyond([0.1, 0.9], 0.95) && !is_beyond([0.1, 0.9], 0.1));
        assert!(!is_beyond([0.1, 0.9], f32::NAN));
    }

    #[test]
    fn a_surface_is_masked_where_it_is_seen_at_more_than_the_limit() {
        // Planes at this incidence, ray by ray: columns 2 mrad apart.
        let line = |incidence: f64, column: i32| -> Vec<Sample> {
            let normal = DVec3::new(libm::cos(incidence), -libm::sin(incidence), 0.0);
            let sample = |row: i32| {
                let (a, e) = (f64::from(column) * 0.002, f64::from(row - 10) * 0.002);
                let d = DVec3::new(libm::cos(e) * libm::cos(a), libm::cos(e) * libm::sin(a), libm::sin(e));
                Sample::measured((d * (10.0 * normal.x / normal.dot(d))).as_vec3())
            };
            (0..20).map(sample).collect()
        };
        for (degrees, is_masked) in [(0.0, false), (60.0, false), (84.0, false), (87.0, true)] {
            let lines = [-1, 0, 1].map(|column| line(f64::to_radians(degrees), column));
            let mut masked = Vec::new();
            let mut test = Grazing::new(85f64.to_radians());
            test.line(Some(&lines[0]), &lines[1], Some(&lines[2]), Rays::Central, &mut |at| masked.push(at));
            assert_eq!(masked.len(), if is_masked { 20 } else { 0 }, "{degrees}°");
        }
    }
}
