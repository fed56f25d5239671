//! How rough a surface is from one vertex to the next, and what that adds to its area.
//!
//! The noise of a scan makes every triangle a little steeper, and therefore the area too large: by twice the square of the noise over the spacing, on a
//! regular grid. Nobody can tell noise from grain of the same size by the mesh alone, so the area stays that of the triangles, and what the roughness
//! adds is part of its uncertainty.
//!
//! The standard deviation of the noise follows from neighbours. Let `h` be the height of a vertex above the mean of its ring of neighbours, along its normal. If
//! the heights of vertices err independently with variance `v`, then the heights `h` of two neighbours of valence `k` and `l` that share `m` neighbours have the
//! covariance `-v (1/k + 1/l - m/(k l))`, with `m = 2` inside a surface. The covariance is taken from the spreads of sums and differences of neighbours
//! (Gnanadesikan and Kettenring, 1972), each from medians, and vertices far from the median, those of creases, do not count. Where the surface is curved,
//! neighbours bend the same way and their products are positive, so that nothing counts as noise that is none.

use crate::leaves::finest_triangles;
use glam::{DVec3, IVec3};
use kilwa_geometry::LatticePoint;
use kilwa_pack::Chunk;

/// Heights farther from the median than so many robust standard deviations are those of creases.
const OUTLIER: f64 = 3.0;

/// Sums round one vertex.
#[derive(Debug, Clone, Copy, Default)]
struct Ring {
    /// Twice the sum of the neighbours, relative to the vertex.
    neighbours: [i64; 3],
    /// Triangles, as many as neighbours where the ring is closed.
    valence: u32,
    /// The sum of the edges opposite to the vertex, zero where they form a closed ring.
    opposite: [i64; 3],
    normal: DVec3,
}

impl Ring {
    fn add(&mut self, at: LatticePoint, next: LatticePoint, last: LatticePoint, normal: DVec3) {
        let wide = |p: IVec3| [p.x, p.y, p.z].map(i64::from);
        let (at, next, last) = (wide(at), wide(next), wide(last));
        for k in 0..3 {
            self.neighbours[k] += next[k] + last[k] - 2 * at[k];
            self.opposite[k] += last[k] - next[k];
        }
        self.valence += 1;
        self.normal += normal;
    }

    /// Height above the mean of the neighbours, lattice units; `None` unless neighbours are all round.
    fn height(&self) -> Option<f64> {
        let normal = self.normal.try_normalize()?;
        let is_closed = self.valence >= 3 && self.opposite == [0; 3];
        let mean = DVec3::from(self.neighbours.map(|x| x as f64)) / (2.0 * f64::from(self.valence));
        is_closed.then(|| -mean.dot(normal))
    }
}

/// The variance of the heights of vertices that differs from one to the next, in square lattice units, of the finest surface of a chunk; zero where it
/// cannot be told from curvature.
pub fn variance(chunk: &Chunk) -> f64 {
    let mesh = &chunk.mesh;
    let mut rings = vec![Ring::default(); mesh.positions.len()];
    let corners = |t: usize| mesh.triangles[t].map(|v| (v as usize, mesh.positions[v as usize]));
    for t in finest_triangles(chunk) {
        let [a, b, c] = corners(t);
        let [p, q, r] = [a, b, c].map(|(_, p)| p.as_dvec3());
        let normal = (q - p).cross(r - p);
        for (at, next, last) in [(a, b, c), (b, c, a), (c, a, b)] {
            rings[at.0].add(at.1, next.1, last.1, normal);
        }
    }
    let mut heights: Vec<Option<f64>> = rings.iter().map(Ring::height).collect();
    let mut all: Vec<f64> = heights.iter().flatten().copied().collect();
    let middle = median(&mut all);
    let limit = OUTLIER * deviation(&mut all);
    for height in &mut heights {
        *height = height.filter(|h| (h - middle).abs() <= limit);
    }
    // Every edge inside is there twice, once for each of its triangles.
    let (mut sums, mut differences, mut expected) = (Vec::new(), Vec::new(), 0.0);
    for t in finest_triangles(chunk) {
        let [a, b, c] = mesh.triangles[t].map(|v| v as usize);
        for (i, j) in [(a, b), (b, c), (c, a)] {
            if let (Some(x), Some(y)) = (heights[i], heights[j]) {
                sums.push(x + y);
                differences.push(x - y);
                let [k, l] = [i, j].map(|v| 1.0 / f64::from(rings[v].valence));
                expected += k + l - 2.0 * k * l;
            }
        }
    }
    if sums.is_empty() {
        return 0.0;
    }
    expected /= sums.len() as f64;
    let [plus, minus] = [sums, differences].map(|mut all| deviation(&mut all));
    ((minus * minus - plus * plus) / (4.0 * expected)).max(0.0)
}

/// The standard deviation of normally distributed values, from the median of their distances from the median: half of the values may be anything. They are
/// reordered and replaced by those distances.
fn deviation(values: &mut [f64]) -> f64 {
    let middle = median(values);
    for x in values.iter_mut() {
        *x = (*x - middle).abs();
    }
    1.4826 * median(values)
}

/// The middle value (Hoare's FIND, as in Wirth, Algorithms and Data Structures, 1976); zero of none. The library's selection is as fast, and larger in the page.
#[inline(never)]
fn median(values: &mut [f64]) -> f64 {
    let wanted = values.len() / 2;
    let (mut first, mut end) = (0, values.len());
    while first + 1 < end {
        let pivot = values[wanted];
        let (mut low, mut high) = (first, end);
        while low < high {
            while values[low] < pivot {
                low += 1;
            }
            while values[high - 1] > pivot {
                high -= 1;
            }
            if low < high {
                values.swap(low, high - 1);
                (low, high) = (low + 1, high - 1);
            }
        }
        if high <= wanted {
            first = low;
        }
        if low > wanted {
            end = high;
        }
    }
    values.get(wanted).copied().unwrap_or(0.0)
}

/// What independent errors of the corners' heights with this variance add to the area of a triangle, on average: half the area times the square of the
/// slope that they cause, and never more than the area. Everything in one unit and its square.
pub fn added_area([a, b, c]: [DVec3; 3], variance: f64) -> f64 {
    let area = (b - a).cross(c - a).length() * 0.5;
    if variance <= 0.0 || area <= 0.0 {
        return 0.0;
    }
    let squares: f64 = [a - b, b - c, c - a].iter().map(|d| d.length_squared()).sum();
    (variance * squares / (8.0 * area)).min(area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::Mesh;
    use kilwa_pack::{NO_DIAMOND, PatchRange};

    const SIDE: usize = 40;
    const SPACING: f64 = 1000.0;

    /// A grid of triangles over a square, with heights.
    fn grid(height: impl FnMut(f64, f64) -> f64) -> Chunk {
        let mut height = height;
        let mut mesh = Mesh::default();
        for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
            let at = DVec3::new(x as f64 * SPACING, y as f64 * SPACING, 0.0);
            mesh.positions.push((at + DVec3::Z * height(at.x, at.y)).round().as_ivec3());
        }
        for (y, x) in (1..SIDE).flat_map(|y| (1..SIDE).map(move |x| (y, x))) {
            let at = |y: usize, x: usize| (y * SIDE + x) as u32;
            let [a, b, c, d] = [at(y - 1, x - 1), at(y - 1, x), at(y, x), at(y, x - 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        let count = mesh.triangles.len() as u32;
        Chunk { mesh, patches: vec![PatchRange { diamond: NO_DIAMOND, first: 0, count }] }
    }

    /// Normally distributed, by the central limit.
    fn normal(random: &mut fastrand::Rng) -> f64 {
        (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
    }

    fn areas(chunk: &Chunk) -> (f64, f64) {
        let variance = variance(chunk);
        let (mut area, mut added) = (0.0, 0.0);
        for t in finest_triangles(chunk) {
            let corners = chunk.mesh.corners(t).map(IVec3::as_dvec3);
            area += (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() * 0.5;
            added += added_area(corners, variance);
        }
        (area, added)
    }

    #[test]
    fn the_median_is_the_middle_of_any_values() {
        let mut random = fastrand::Rng::with_seed(5);
        for count in (0..200).chain([1000, 1001]) {
            for distinct in [1, 2, 3, 1000] {
                let mut values: Vec<f64> = (0..count).map(|_| f64::from(random.i32(-distinct..distinct))).collect();
                let mut sorted = values.clone();
                sorted.sort_by(f64::total_cmp);
                assert_eq!(median(&mut values), sorted.get(count / 2).copied().unwrap_or(0.0) + 0.0, "{count}");
            }
        }
    }

    #[test]
    fn the_deviation_of_noise_is_found_on_flat_and_bent_surfaces() {
        let shapes: [fn(f64, f64) -> f64; 3] =
            [|_, _| 0.0, |x, y| 0.7 * x - 0.2 * y, |x, y| (x * x + y * y) / (160.0 * SPACING)];
        for (number, shape) in shapes.into_iter().enumerate() {
            for deviation in [20.0, 100.0, 250.0] {
                let mut random = fastrand::Rng::with_seed(7);
                // Along the vertical: across a slope less of it is along the normal.
                let slope = if number == 1 { libm::sqrt(1.0 + 0.49 + 0.04) } else { 1.0 };
                let chunk = grid(|x, y| shape(x, y) + slope * deviation * normal(&mut random));
                let found = libm::sqrt(variance(&chunk));
                assert!((found / deviation - 1.0).abs() < 0.15, "shape {number}, {deviation}: {found}");
            }
        }
    }

    #[test]
    fn what_noise_adds_to_an_area_is_found() {
        let flat = SPACING * SPACING * ((SIDE - 1) * (SIDE - 1)) as f64;
        for deviation in [20.0, 100.0, 250.0] {
            let mut random = fastrand::Rng::with_seed(3);
            let (area, added) = areas(&grid(|_, _| deviation * normal(&mut random)));
            let truly = area - flat;
            assert!((added / truly - 1.0).abs() < 0.2, "{deviation}: {added} instead of {truly}");
        }
    }

    #[test]
    fn relief_that_is_wider_than_the_spacing_counts_as_no_noise() {
        let wave = |x: f64, y: f64| 1500.0 * (libm::sin(x / (2.0 * SPACING)) + libm::cos(y / (3.0 * SPACING)));
        let crease = |x: f64, _: f64| (x - 20.0 * SPACING).abs();
        for chunk in [grid(wave), grid(crease), grid(|_, _| 0.0)] {
            let (area, added) = areas(&chunk);
            assert!(added < 1e-5 * area, "{added} of {area}");
        }
    }
}
