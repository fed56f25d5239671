//! Mixed pixels: a beam that meets two surfaces one behind the other, whose ranges the scanner averages.
//!
//! Such a sample lies on neither surface, but its neighbours do. So each of the eight directions of the grid is tested for support of the
//! sample: how far in depth is it from its neighbour, or, if that is less, from the surface through the next two samples in that direction (the inverse
//! depths of a plane are linear in the angle)? A sample on a surface is supported by at least three directions, even at an edge or at
//! an oblique angle; the geometric mean of the second and third smallest distance measures how much support is missing. The smallest alone says little: with
//! eight directions, one fits by chance.
//!
//! The distance is compared with an allowance for relief between two rays, plus noise. The allowance is a share of the ray spacing. It is larger if the
//! depths beyond the neighbours vary strongly too, as on relief seen at an oblique angle; next to a mixed pixel they do not. It also grows in proportion
//! to the spacing if rays are far apart, because the deviation of a curved surface from a plane grows with the square of the distance, and a sample lost
//! there leaves a large hole. A sample can be a mixed pixel only if the depth jump around it is larger than incidence, noise and beam width explain.

use crate::sample::{Rays, Sample};
use crate::tessellate::Instrument;

/// How strict the test is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// 1 is the default; more masks more, less masks less.
    pub strictness: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { strictness: 1.0 }
    }
}

/// The allowance for relief between neighbouring rays: as a share of their spacing (`RELIEF`), as a share of the depth variation around (`AROUND`, see
/// [`STEPS`]), and the spacing above which it grows, in metres (`WIDE`). Tuned on two simulated surveys (docs/bench/2026-11-27-scans.md).
const RELIEF: f64 = 0.38;
const AROUND: f64 = 0.15;
const WIDE: f64 = 0.03;
/// Smallest jump around a mixed pixel, in terms of the spacing: a surface seen at 50° explains 2.4 from corner to corner of the neighbours.
const JUMP: f64 = 2.5;
/// Standard deviations of a range that noise explains, in a jump.
const SIGMAS: f64 = 3.0;
/// The depth variation around a sample is the `STEPS`-th smallest depth difference between a neighbour and the sample beyond it. If fewer than
/// this many directions have two samples, the sample is not judged.
const STEPS: usize = 5;

const DIRECTIONS: [(isize, isize); 8] = [(1, 0), (0, 1), (1, 1), (1, -1), (-1, 0), (0, -1), (-1, -1), (-1, 1)];

/// The test.
#[derive(Debug)]
pub struct Mixed {
    options: Options,
    instrument: Instrument,
    rays: Rays,
    depths: [Vec<f64>; 5],
}

impl Mixed {
    /// A test for an instrument.
    pub fn new(options: Options, instrument: Instrument, rays: Rays) -> Self {
        Self { options, instrument, rays, depths: Default::default() }
    }

    /// Call `mask` with the place of every mixed pixel in the middle one of five lines.
    pub fn line(&mut self, window: [Option<&[Sample]>; 5], mask: &mut dyn FnMut(usize)) {
        let rays = self.rays;
        for (depths, line) in self.depths.iter_mut().zip(window) {
            depths.clear();
            depths.extend(line.unwrap_or_default().iter().map(|sample| depth(sample, rays)));
        }
        for (at, sample) in window[2].unwrap_or_default().iter().enumerate() {
            if sample.is_measured() && self.is_mixed(sample, at, window) {
                mask(at);
            }
        }
    }

    fn is_mixed(&self, sample: &Sample, at: usize, window: [Option<&[Sample]>; 5]) -> bool {
        let own = self.depths[2][at];
        let (mut lack, mut steps) = ([f64::INFINITY; 3], [f64::INFINITY; STEPS]);
        let (mut nearest, mut farthest) = (own, own);
        for (lines, places) in DIRECTIONS {
            let Some(first) = self.depth(lines, places, at) else { continue };
            nearest = nearest.min(first);
            farthest = farthest.max(first);
            let mut distance = (first - own).abs();
            if let Some(second) = self.depth(2 * lines, 2 * places, at) {
                distance = distance.min(self.beyond(first, second).map_or(f64::INFINITY, |plane| (plane - own).abs()));
                insert(&mut steps, (second - first).abs());
            }
            insert(&mut lack, distance);
        }
        let around = steps[STEPS - 1];
        if !around.is_finite() {
            return false;
        }
        let spacing = self.spacing(sample, at, window);
        let [constant, growth] = self.instrument.range_noise;
        let sigma = constant + growth * own;
        let beam = self.instrument.beam[0] + self.instrument.beam[1] * own;
        let relief = RELIEF * libm::hypot(spacing, AROUND * around) * (spacing / WIDE).max(1.0);
        farthest - nearest > (JUMP * spacing).max(beam) + SIGMAS * sigma
            && (lack[1] * lack[2]).sqrt() * self.options.strictness > relief + sigma
    }

    /// The depth of a neighbour, if it was measured.
    fn depth(&self, lines: isize, places: isize, at: usize) -> Option<f64> {
        let depths = &self.depths[2_usize.wrapping_add_signed(lines)];
        depths.get(at.checked_add_signed(places)?).copied().filter(|depth| depth.is_finite())
    }

    /// Where the plane through two samples would be one ray farther.
    fn beyond(&self, first: f64, second: f64) -> Option<f64> {
        match self.rays {
            Rays::Central => Some(2.0 / first - 1.0 / second).filter(|inverse| *inverse > 0.0).map(f64::recip),
            Rays::Parallel(_) => Some(2.0 * first - second),
        }
    }

    /// How far the rays around a sample are from each other: the larger of both directions of the grid.
    fn spacing(&self, sample: &Sample, at: usize, window: [Option<&[Sample]>; 5]) -> f64 {
        let axes = [(1, 0), (-1, 0), (0, 1), (0, -1)];
        let neighbour = |(lines, places): (isize, isize)| {
            window[2_usize.wrapping_add_signed(lines)]?.get(at.checked_add_signed(places)?).filter(|s| s.is_measured())
        };
        // The ray of a neighbour at the depth of this sample.
        let own = depth(sample, self.rays);
        let of = |other: &Sample| {
            let depth = depth(other, self.rays);
            let scale = if self.rays == Rays::Central { own / own.min(depth) } else { 1.0 };
            self.rays.spacing(sample.position, other.position) * scale
        };
        axes.into_iter().filter_map(neighbour).map(of).fold(0.0, f64::max)
    }
}

/// The distance along the ray; infinite where nothing was measured.
fn depth(sample: &Sample, rays: Rays) -> f64 {
    match rays {
        _ if !sample.is_measured() => f64::INFINITY,
        Rays::Central => sample.position.as_dvec3().length(),
        Rays::Parallel(direction) => sample.position.as_dvec3().dot(direction),
    }
}

/// Keep the smallest values, sorted.
fn insert<const N: usize>(smallest: &mut [f64; N], value: f64) {
    let place = smallest.iter().position(|kept| value < *kept);
    if let Some(place) = place {
        smallest[place..].rotate_right(1);
        smallest[place] = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    const SIZE: usize = 40;
    const STEP: f64 = 0.004;

    fn direction(line: usize, place: usize) -> DVec3 {
        let (a, e) = ((line as f64 - 20.0) * STEP, (place as f64 - 20.0) * STEP);
        DVec3::new(libm::cos(e) * libm::cos(a), libm::cos(e) * libm::sin(a), libm::sin(e))
    }

    type Grid = Vec<Vec<Sample>>;

    fn scan(range: impl Fn(usize, usize) -> Option<f64>) -> Grid {
        let sample = |l, p| range(l, p).map_or(Sample::EMPTY, |r| Sample::measured((direction(l, p) * r).as_vec3()));
        (0..SIZE).map(|l| (0..SIZE).map(|p| sample(l, p)).collect()).collect()
    }

    fn masked(grid: &Grid) -> Vec<(usize, usize)> {
        let mut mixed = Mixed::new(Options::default(), Instrument::default(), Rays::Central);
        let mut out = Vec::new();
        for line in 0..SIZE {
            let at = |offset: isize| line.checked_add_signed(offset).and_then(|line| grid.get(line)).map(Vec::as_slice);
            mixed.line([at(-2), at(-1), at(0), at(1), at(2)], &mut |place| out.push((line, place)));
        }
        out
    }

    /// Those that are not at the border of the grid, where an edge or a bar goes on in one direction only.
    fn within(cells: &[(usize, usize)]) -> Vec<(usize, usize)> {
        let is_within = |k: usize| (1..SIZE - 1).contains(&k);
        cells.iter().copied().filter(|(line, place)| is_within(*line) && is_within(*place)).collect()
    }

    /// A wall at 8 m before another at 8 m + jump; the border runs at this angle, and along it beams meet both.
    fn edge(jump: f64, turn: f64, seed: u64, share: impl Fn(&mut fastrand::Rng) -> f64) -> (Grid, Vec<(usize, usize)>) {
        let mut rng = fastrand::Rng::with_seed(seed);
        let mut planted = Vec::new();
        let side =
            |l: usize, p: usize| (l as f64 - 20.0) * libm::cos(turn) + (p as f64 - 20.0) * libm::sin(turn) + 0.25;
        let mut shares = Vec::new();
        for (l, p) in (0..SIZE * SIZE).map(|k| (k / SIZE, k % SIZE)) {
            let side = side(l, p);
            let is_planted = side.abs() < 0.35 && rng.f64() < 0.5;
            if is_planted {
                planted.push((l, p));
            }
            shares.push(if is_planted { share(&mut rng) } else { f64::from(side > 0.0) });
        }
        let noise: Vec<f64> = (0..SIZE * SIZE).map(|_| (rng.f64() - 0.5) * 0.004).collect();
        let grid = scan(|l, p| {
            let x = direction(l, p).x;
            Some((8.0 + jump * shares[l * SIZE + p]) / x + noise[l * SIZE + p])
        });
        (grid, planted)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn samples_between_two_walls_are_masked_and_those_on_them_are_not(jump in 0.6..20.0, turn in 0.0..6.2, seed in 0_u64..1000) {
            let (grid, planted) = edge(jump, turn, seed, |rng| 0.2 + 0.6 * rng.f64());
            let masked = masked(&grid);
            let found = planted.iter().filter(|cell| masked.contains(cell)).count();
            prop_assert!(found * 10 >= planted.len() * 8, "{found} of {}", planted.len());
            let wrong = masked.iter().filter(|cell| !planted.contains(cell)).count();
            prop_assert!(wrong * 100 <= SIZE * SIZE, "{wrong} good samples");
        }

        #[test]
        fn a_plane_at_any_incidence_up_to_80_degrees_keeps_all_its_samples(tilt in 0.0..80.0, turn in 0.0..6.2, distance in 1.0..60.0) {
            let (sin, cos) = libm::sincos(f64::to_radians(tilt));
            let (s, c) = libm::sincos(turn);
            let normal = DVec3::new(cos, sin * c, sin * s);
            let grid = scan(|l, p| Some(distance * normal.x / normal.dot(direction(l, p))).filter(|r| *r > 0.0 && *r < 500.0));
            prop_assert_eq!(masked(&grid), vec![]);
        }
    }

    #[test]
    fn the_edge_of_a_wall_without_mixed_pixels_keeps_all_its_samples_and_so_does_a_thin_bar() {
        for turn in [0.0, 0.4, 1.0, 1.57] {
            let (sin, cos) = libm::sincos(turn);
            let is_behind = |l: usize, p: usize| (l as f64 - 19.7) * cos + (p as f64 - 19.7) * sin > 0.0;
            let grid = scan(|l, p| Some(if is_behind(l, p) { 11.0 } else { 8.0 } / direction(l, p).x));
            assert_eq!(within(&masked(&grid)), [], "{turn}");
        }
        let bar = scan(|l, _| Some(if l == 17 { 5.0 } else { 8.0 }));
        assert_eq!(within(&masked(&bar)), []);
    }

    #[test]
    fn samples_with_few_neighbours_are_not_judged() {
        let scattered = scan(|l, p| Some(8.0 + (l * 7 + p * 3) as f64).filter(|_| l % 2 == 0 && p % 2 == 0));
        assert_eq!(masked(&scattered), []);
    }
}
