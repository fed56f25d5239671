//! Volumes: of a closed surface, and cut and fill of a drawn region against a plane.

use crate::refusal::{Refusal, Target};
use crate::region::{Region, cut};
use crate::sum::Sum;
use glam::DVec3;
use serde::Serialize;

/// The volume that a closed surface encloses, summed up triangle by triangle (divergence theorem).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Enclosed {
    centre: DVec3,
    six_fold: Sum,
    /// The vector sum of all triangle areas, which vanishes where the surface is closed and agrees on its outside.
    flux: [Sum; 3],
    area: Sum,
    squares: Sum,
    triangles: u64,
}

impl Enclosed {
    /// Volumes are counted from `centre`, which should lie in the middle of the surface.
    pub fn new(centre: DVec3) -> Self {
        let zero = Sum::default();
        Self { centre, six_fold: zero, flux: [zero; 3], area: zero, squares: zero, triangles: 0 }
    }

    /// Add one triangle, counter-clockwise seen from outside.
    pub fn add(&mut self, triangle: [DVec3; 3]) {
        let [a, b, c] = triangle.map(|p| p - self.centre);
        let n = (b - a).cross(c - a);
        self.six_fold.add(a.dot(b.cross(c)));
        for (sum, x) in self.flux.iter_mut().zip((n * 0.5).to_array()) {
            sum.add(x);
        }
        self.area.add(n.length() * 0.5);
        self.squares.add(n.length_squared() * 0.25);
        self.triangles += 1;
    }

    /// Add another sum with the same centre.
    pub fn join(&mut self, other: &Self) {
        self.six_fold.join(&other.six_fold);
        self.area.join(&other.area);
        self.squares.join(&other.squares);
        for (sum, x) in self.flux.iter_mut().zip(&other.flux) {
            sum.join(x);
        }
        self.triangles += other.triangles;
    }

    /// Surface area.
    pub fn area(&self) -> f64 {
        self.area.value()
    }

    /// The factor by which the standard uncertainty of a coordinate is multiplied to give that of the volume: the errors of points are independent, and each
    /// has six triangles round it (a point moves a third of their area vectors; there are half as many points as triangles).
    pub fn spread(&self) -> f64 {
        libm::sqrt(2.0 * self.squares.value())
    }

    /// The volume; `borders` is the number of edges that only one triangle uses. Negative where the triangles are
    /// seen clockwise from outside (the surface is inside out).
    ///
    /// # Errors
    /// [`Refusal::Open`], [`Refusal::Inconsistent`].
    pub fn volume(&self, borders: u64) -> Result<f64, Refusal> {
        if borders > 0 {
            return Err(Refusal::Open { borders });
        }
        let flux = DVec3::from(self.flux.map(|s| s.value()));
        if flux.length() > 1e-9 * self.area.value() {
            return Err(Refusal::Inconsistent);
        }
        Ok(self.six_fold.value() / 6.0)
    }
}

/// The volumes that would have to be removed and filled in to make a region flat.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CutFill {
    above: Sum,
    below: Sum,
    covered: Sum,
    squares: Sum,
    triangles: u64,
}

/// The figures of [`CutFill`], in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CutFillVolume {
    /// Between the plane and the surface where it lies on the side that the plane's normal points to, cubic metres.
    pub cut: f64,
    /// Between the plane and the surface where it lies on the other side, cubic metres.
    pub fill: f64,
    /// `cut − fill`.
    pub net: f64,
    /// Share of the polygon that the surface covers, seen along the normal, what faces away taken off: below 1 there are
    /// holes, above it lies over itself, and near 0 it is a closed body without ground.
    pub covered: f64,
}

impl CutFillVolume {
    /// A closed body has nothing to fill: `cut` is what of it lies above the plane, and `−fill` what lies below.
    pub fn is_body(&self) -> bool {
        self.covered.abs() < 1e-3
    }
}

impl CutFill {
    /// Add the part of a triangle inside the region. What faces the side that the normal points to counts as top of the
    /// material, what faces away as its underside, so that overhangs come out right.
    pub fn add(&mut self, triangle: [DVec3; 3], region: &Region) {
        let (mut side, mut scratch) = (Vec::with_capacity(12), Vec::with_capacity(12));
        let mut met = false;
        region.clip(triangle, |part| {
            met = true;
            let seen = prism(part, |_| 1.0);
            self.covered.add(seen);
            self.squares.add(seen * seen);
            for (sum, sign) in [(&mut self.above, 1.0), (&mut self.below, -1.0)] {
                side.clear();
                side.extend_from_slice(part);
                cut(&mut side, &mut scratch, |p| sign * p[2]);
                sum.add(prism(&side, |p| sign * p[2]));
            }
        });
        self.triangles += u64::from(met);
    }

    /// Add another sum.
    pub fn join(&mut self, other: &Self) {
        self.above.join(&other.above);
        self.below.join(&other.below);
        self.covered.join(&other.covered);
        self.squares.join(&other.squares);
        self.triangles += other.triangles;
    }

    /// The factor by which the standard uncertainty of a coordinate is multiplied to give that of the volumes, for a plane fitted to `corners`
    /// points of the same uncertainty (0: a plane that is given): as [`Enclosed::spread`], and the plane's own.
    pub fn spread(&self, corners: usize) -> f64 {
        let area = self.covered.value();
        let plane = if corners > 0 { area * area / corners as f64 } else { 0.0 };
        libm::sqrt(2.0 * self.squares.value() + plane)
    }

    /// The volumes.
    ///
    /// # Errors
    /// [`Refusal::Misses`] where the region holds no surface.
    pub fn volumes(&self, region: &Region) -> Result<CutFillVolume, Refusal> {
        if self.triangles == 0 {
            let hint = format!("it reaches {} m on either side of its plane", region.reach());
            return Err(Refusal::Misses { what: Target::Region, hint });
        }
        let (cut, fill) = (self.above.value(), self.below.value());
        Ok(CutFillVolume { cut, fill, net: cut - fill, covered: self.covered.value() / region.area() })
    }
}

/// Integral of a linear function over a convex polygon seen along the third axis; signed by its orientation.
fn prism(part: &[DVec3], height: impl Fn(&DVec3) -> f64) -> f64 {
    let Some(a) = part.first() else { return 0.0 };
    let mut sum = 0.0;
    for w in part[1..].windows(2) {
        let (b, c) = (&w[0], &w[1]);
        let area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) * 0.5;
        sum += area * (height(a) + height(b) + height(c)) / 3.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::Plane;
    use glam::IVec3;

    fn cube(at: DVec3, side: f64) -> Vec<[DVec3; 3]> {
        let corner = |i: i32| at + side * IVec3::new(i & 1, i >> 1 & 1, i >> 2 & 1).as_dvec3();
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
            .iter()
            .flat_map(|&[a, b, c, d]| [[corner(a), corner(b), corner(c)], [corner(a), corner(c), corner(d)]])
            .collect()
    }

    #[test]
    fn a_cube_far_from_the_origin_has_its_volume_and_an_open_one_is_refused() {
        let at = DVec3::new(500_000.0, 4_649_776.0, 123.456);
        let mut v = Enclosed::new(at);
        for t in cube(at, 1.0) {
            v.add(t);
        }
        assert!((v.volume(0).unwrap() - 1.0).abs() < 1e-9 && (v.area() - 6.0).abs() < 1e-9);
        assert_eq!(v.volume(3), Err(Refusal::Open { borders: 3 }));
        let mut flipped = Enclosed::new(at);
        for (i, [a, b, c]) in cube(at, 1.0).into_iter().enumerate() {
            flipped.add(if i == 0 { [a, c, b] } else { [a, b, c] });
        }
        assert_eq!(flipped.volume(0), Err(Refusal::Inconsistent));
    }

    #[test]
    fn cut_and_fill_of_a_wedge_are_its_halves_and_an_overhang_counts_only_its_material() {
        let floor = Plane::new(DVec3::ZERO, DVec3::Z).unwrap();
        let square = [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), DVec3::new(2.0, 1.0, 0.0), DVec3::Y];
        let region = Region::new(floor, &square, 10.0).unwrap();
        // A plane that rises from -1 at x = 0 to +1 at x = 2: above and below are 0.5 each.
        let (a, b, c, d) = (
            DVec3::new(0.0, 0.0, -1.0),
            DVec3::new(2.0, 0.0, 1.0),
            DVec3::new(2.0, 1.0, 1.0),
            DVec3::new(0.0, 1.0, -1.0),
        );
        let mut sum = CutFill::default();
        sum.add([a, b, c], &region);
        sum.add([a, c, d], &region);
        let v = sum.volumes(&region).unwrap();
        assert!(
            (v.cut - 0.5).abs() < 1e-12 && (v.fill - 0.5).abs() < 1e-12 && (v.covered - 1.0).abs() < 1e-12,
            "{v:?}"
        );
        // A cube floating 1 m above: 0.5³ of material, no ground.
        let mut sum = CutFill::default();
        for t in cube(DVec3::new(0.5, 0.25, 1.0), 0.5) {
            sum.add(t, &region);
        }
        let v = sum.volumes(&region).unwrap();
        assert!((v.cut - 0.125).abs() < 1e-12 && v.fill == 0.0 && v.covered.abs() < 1e-12, "{v:?}");
        assert!(CutFill::default().volumes(&region).is_err());
    }
}
