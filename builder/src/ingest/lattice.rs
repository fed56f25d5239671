//! The lattice, chosen after the edges have been measured: positions are first cut to a *provisional* lattice of 31 bits
//! over the extent, whose step is at most half of the final one, and rounded from there.
//!
//! With `floor(p)` on the provisional lattice and a final step of m = 2^k, k ≥ 1, provisional steps,
//! `floor((floor(p) + m/2) / m)` is exactly `p` rounded half up to the final lattice, as [`Lattice::snap`] does: what
//! `floor` drops is below one step and cannot carry. All of it is exact in f64 and in integers, because steps are powers
//! of two and positions are divided by the step before the origin is subtracted.

use crate::build::options::BuildError;
use glam::{DVec3, I64Vec3};
use kilwa_geometry::Lattice;
use kilwa_geometry::lattice::MAX_COORDINATE;

/// The part of the 1st-percentile edge that a step is at most.
const STEP_PER_EDGE: f64 = 1.0 / 16.0;
/// Models wider than this many metres are refused: a light second, and errors still fit `f32`.
const WIDEST: f64 = 3e8;

/// A box in metres: smallest and largest coordinates.
pub(super) type Box3 = [DVec3; 2];

/// Size of the largest side.
fn extent_of(b: &Box3) -> f64 {
    (b[1] - b[0]).max_element().clamp(0.0, f64::MAX)
}

fn magnitude_of(b: &Box3) -> f64 {
    b[0].abs().max(b[1].abs()).max_element()
}

/// The coarsest step that must do: the cube holds the extent plus padding in 30 bits.
fn coarsest(b: &Box3) -> i32 {
    let log = libm::log2(extent_of(b) / f64::from(MAX_COORDINATE) * 1.1).ceil().max(-1000.0) as i32;
    // Sides beyond the largest double are twice as long at most.
    if extent_of(b) >= f64::MAX { log + 1 } else { log }
}

/// Binary logarithm of the finest lattice spacing that is chosen automatically, about 1e-18 m.
const FINEST: i32 = -60;

/// Finer than the doubles of the source can tell apart is no use (and f64 world coordinates must stay exact).
pub(super) fn finest(b: &Box3) -> i32 {
    (libm::log2(magnitude_of(b) * f64::EPSILON).floor().max(f64::from(FINEST)) as i32).max(FINEST)
}

/// The lattice that positions are cut to before the step is known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Provisional {
    pub(super) step_log2: i32,
    /// In steps; whole numbers.
    pub(super) origin: DVec3,
}

impl Provisional {
    /// For a model in this box and the step that the user asks for, if any.
    pub(super) fn of(b: &Box3, given: Option<f64>) -> Self {
        let mut step_log2 = coarsest(b).max(finest(b)) - 1;
        if let Some(step) = given.filter(|s| *s > 0.0 && s.is_finite()) {
            // A given step may be finer than the doubles of the source; 31 bits hold the extent all the same.
            step_log2 = step_log2.min((libm::log2(step).floor() as i32).max(coarsest(b)) - 1);
        }
        let inverse = libm::scalbn(1.0, -step_log2);
        Self { step_log2, origin: (b[0] * inverse).floor() }
    }

    pub(super) fn step(&self) -> f64 {
        libm::scalbn(1.0, self.step_log2)
    }

    /// Metres to steps, before the origin is subtracted.
    pub(super) fn per_metre(&self) -> f64 {
        libm::scalbn(1.0, -self.step_log2)
    }

    /// The cell of a position, `None` where it is not finite or outside. `per_metre` is [`Provisional::per_metre`].
    pub(super) fn cell(&self, p: DVec3, per_metre: f64) -> Option<[u32; 3]> {
        // A difference of whole numbers below 2^33 is exact.
        let steps = ((p * per_metre).floor() - self.origin).to_array();
        let valid = steps.iter().all(|x| (0.0..4_294_967_295.0).contains(x));
        valid.then(|| steps.map(|x| x as u32))
    }

    /// Metres of a cell's lower corner.
    pub(super) fn metres(&self, cell: DVec3) -> DVec3 {
        (self.origin + cell) * self.step()
    }
}

/// From the provisional to the final lattice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rounding {
    shift: u32,
    add: [u64; 3],
    base: I64Vec3,
}

impl Rounding {
    /// The final step must be larger than the provisional one.
    pub(super) fn between(provisional: &Provisional, lattice: &Lattice) -> Self {
        let shift = (lattice.step_log2 - provisional.step_log2) as u32;
        let m = libm::scalbn(1.0, shift as i32);
        let per_metre = libm::scalbn(1.0, -lattice.step_log2);
        let whole = (provisional.origin / m).floor();
        let rest = provisional.origin - whole * m;
        Self {
            shift,
            add: rest.to_array().map(|x| x as u64 + (m * 0.5) as u64),
            base: (whole - lattice.origin * per_metre).as_i64vec3(),
        }
    }

    /// Whether two cells are near enough to have the same final lattice point.
    pub(super) fn may_join(&self, p: [u32; 3], q: [u32; 3]) -> bool {
        (0..3).all(|i| u64::from(p[i].abs_diff(q[i])) < 1 << self.shift)
    }

    /// The final lattice point of a cell.
    pub(super) fn point(&self, cell: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|i| (((u64::from(cell[i]) + self.add[i]) >> self.shift) as i64 + self.base[i]) as u32)
    }
}

/// Classes of a factor of two of the squared length.
const CLASSES: u32 = 256;
/// Squares of differences of 32-bit numbers lie below 2^66, of 4096 parts of 30-bit ones below 2^86.
const OCTAVES: u32 = 88;

/// How many edges of each length there are: 512 classes to a factor of two; powers of two begin
/// one, so that the class shows on which side of a power a length is.
#[derive(Debug, Clone)]
pub(super) struct Lengths {
    counts: Vec<u64>,
    /// Edges shorter than the provisional lattice shows.
    pub(super) none: u64,
    pub(super) total: u64,
}

impl Default for Lengths {
    fn default() -> Self {
        Self { counts: vec![0; (CLASSES * OCTAVES) as usize], none: 0, total: 0 }
    }
}

impl Lengths {
    /// The non-empty classes, as pairs of class and count.
    pub(super) fn sparse(&self) -> Vec<(u32, u64)> {
        (0u32..).zip(&self.counts).filter(|(_, n)| **n > 0).map(|(class, n)| (class, *n)).collect()
    }

    /// Add the result of [`Lengths::sparse`]; classes that do not exist are ignored.
    pub(super) fn add_sparse(&mut self, classes: &[(u32, u64)]) {
        for (class, n) in classes {
            if let Some(count) = self.counts.get_mut(*class as usize) {
                *count += n;
                self.total += n;
            }
        }
    }

    /// Count an edge between cells.
    pub(super) fn add(&mut self, a: &[u32], b: &[u32]) {
        let square = (0..3).map(|i| (f64::from(a[i]) - f64::from(b[i])).powi(2)).sum::<f64>();
        if square == 0.0 {
            self.none += 1;
        } else {
            self.add_square(square);
        }
    }

    /// Count a length by its square, which counts as 1 where it is less.
    pub(super) fn add_square(&mut self, square: f64) {
        // The upper 8 bits of the mantissa and the exponent: a logarithm in 256 parts.
        let class = (square.max(1.0).to_bits() >> 44) - (1023 << 8);
        self.counts[(class as usize).min((CLASSES * OCTAVES - 1) as usize)] += 1;
        self.total += 1;
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self.none += other.none;
        self.total += other.total;
    }

    /// How many edges are shorter than a length in steps of the provisional lattice; up to 1/365 longer ones may be among them.
    pub(super) fn below(&self, length: f64) -> u64 {
        let class = ((length * length).max(1.0).to_bits() >> 44) - (1023 << 8);
        self.none + self.counts.iter().take(class as usize + 1).sum::<u64>()
    }

    /// The length, in steps of the provisional lattice, that a share of the edges is shorter than; 0 without edges.
    /// Never above the exact percentile and at most 1/730 below it.
    pub(super) fn percentile(&self, share: f64) -> f64 {
        let mut left = (self.total.saturating_sub(1) as f64 * share) as u64;
        for (class, &n) in self.counts.iter().enumerate() {
            if left < n {
                return f64::from_bits((class as u64 + (1023 << 8)) << 44).sqrt();
            }
            left -= n;
        }
        0.0
    }
}

/// What the step is chosen from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    /// Round the vertices of the triangles, metres.
    pub(super) bounds: Box3,
    /// 1st percentile and median of the edge lengths, metres.
    pub(super) first: f64,
    pub(super) median: f64,
}

/// The lattice and the logarithm of the side of the root cube, which is centred on the model and padded so that the
/// model never touches its hull.
///
/// # Errors
/// [`BuildError::TooLarge`], [`BuildError::TooSmall`], [`BuildError::Empty`], [`BuildError::Step`], each with what to do.
pub(super) fn choose(m: &Measured, given: Option<f64>) -> Result<(Lattice, u32), BuildError> {
    let [min, max] = m.bounds;
    let extent = extent_of(&m.bounds);
    if extent > WIDEST {
        let magnitude = magnitude_of(&m.bounds);
        let why =
            format!("it is {extent:e} m wide, with coordinates up to {magnitude:e} m; check --units and the export");
        return Err(BuildError::TooLarge { why });
    }
    if extent <= 0.0 {
        let why = "all vertices of the triangles are at the same place; check the export".to_owned();
        return Err(BuildError::Empty { why });
    }
    let (coarsest, finest) = (coarsest(&m.bounds), finest(&m.bounds));
    if given.is_none() && extent < libm::scalbn(1.0, finest) {
        let magnitude = magnitude_of(&m.bounds);
        let why = format!(
            "it is {extent:e} m wide, with coordinates up to {magnitude:e} m, and the finest lattice spacing possible there is {:e} m; check \
             --units, or scale it with --transform",
            libm::scalbn(1.0, finest)
        );
        return Err(BuildError::TooSmall { why });
    }
    if given.is_none() && libm::scalbn(1.0, coarsest) > m.median {
        let why = format!(
            "it is {extent:e} m wide, but half of its edges are shorter than {:e} m, and a lattice has 2^30 steps: a \
             vertex is astray, between {:?} and {:?} m; remove it, or give --step",
            // If it is 0, it is too small for a number.
            m.median.max(f64::MIN_POSITIVE.sqrt()),
            min.to_array(),
            max.to_array()
        );
        return Err(BuildError::TooLarge { why });
    }
    let derived = || (libm::log2(m.first * STEP_PER_EDGE).floor() as i32).max(coarsest).max(finest);
    let step_log2 = given.map_or_else(|| Ok(derived()), |step| given_step(step, extent, coarsest))?;
    let step = libm::scalbn(1.0, step_log2);
    let cube_log2 = (libm::log2(extent / step * 1.05 + 4.0).ceil() as u32).clamp(2, 30);
    let half = f64::from(1u32 << (cube_log2 - 1));
    // A multiple of the step, so that world coordinates of lattice points are exact in f64 wherever 53 bits allow.
    let origin = (((min + max) * 0.5 / step).round() - half) * step;
    Ok((Lattice { origin, step_log2 }, cube_log2))
}

/// The logarithm of a step that the user asked for.
fn given_step(step: f64, extent: f64, coarsest: i32) -> Result<i32, BuildError> {
    if !(step > 0.0 && step.is_finite()) {
        return Err(BuildError::Step { step, why: "it must be greater than zero".to_owned() });
    }
    let log = libm::log2(step);
    if log.fract() != 0.0 {
        let why = format!("it must be a power of two of a metre; the next smaller one is {}", 2f64.powf(log.floor()));
        return Err(BuildError::Step { step, why });
    }
    if step > 4.0 * extent {
        let why = format!("the whole model is only {extent:e} m wide; give a much smaller one, or check --units");
        return Err(BuildError::Step { step, why });
    }
    if (log as i32) < coarsest {
        let why = format!(
            "the model is {extent:e} m wide and a lattice has 2^30 steps; use {} m or more",
            libm::scalbn(1.0, coarsest)
        );
        return Err(BuildError::Step { step, why });
    }
    Ok(log as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_spacing_wider_than_the_model_is_refused() {
        let measured = Measured { bounds: [DVec3::ZERO, DVec3::ONE], first: 0.1, median: 0.5 };
        for log2 in [3, 32, 40, 63, 64, 100, 1023] {
            let refused = choose(&measured, Some(libm::scalbn(1.0, log2)));
            assert!(matches!(refused, Err(BuildError::Step { .. })), "2^{log2}: {refused:?}");
        }
        for log2 in [-20, -3, 0, 2] {
            let given = Some(libm::scalbn(1.0, log2));
            let (lattice, _) = choose(&measured, given).expect("lattice");
            Rounding::between(&Provisional::of(&measured.bounds, given), &lattice);
        }
    }

    #[test]
    fn rounding_through_the_provisional_lattice_equals_direct_snapping_ties_included() {
        let mut random = fastrand::Rng::with_seed(1);
        for (offset, size) in [
            (DVec3::ZERO, 7.3),
            (DVec3::new(512_345.678, 4_649_776.25, -31.0), 220.0),
            (DVec3::new(-3.0, 1e-3, 0.5), 1e-4),
        ] {
            let bounds = [offset, offset + size];
            let provisional = Provisional::of(&bounds, None);
            for first in [size * 1e-5, size * 1e-2] {
                let (lattice, cube) = choose(&Measured { bounds, first, median: size }, None).expect("lattice");
                let rounding = Rounding::between(&provisional, &lattice);
                let step = lattice.step();
                for i in 0..3000 {
                    let p = offset.map(|offset| {
                        let p = offset + size * random.f64();
                        // A third of them exactly halfway between two lattice points.
                        if i % 3 == 0 { ((p / step).floor() + 0.5) * step } else { p }
                    });
                    let Some(cell) = provisional.cell(p, provisional.per_metre()) else { continue };
                    let point = rounding.point(cell);
                    assert_eq!(lattice.snap(p), Some(point.map(|x| x as i32).into()), "{p:?} {lattice:?}");
                    assert!(point.iter().all(|x| *x > 0 && *x < 1 << cube));
                }
            }
        }
    }

    #[test]
    fn percentiles_of_the_histogram_match_the_sorted_list_within_one_bin() {
        let mut random = fastrand::Rng::with_seed(5);
        let (mut lengths, mut sorted) = (Lengths::default(), Vec::new());
        for _ in 0..5000 {
            let p: [u32; 3] = std::array::from_fn(|_| (random.f64().powi(4) * 1e6) as u32 + 1);
            lengths.add(&[0; 3], &p);
            sorted.push(p.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt());
        }
        sorted.sort_by(f64::total_cmp);
        for share in [0.0, 0.01, 0.5, 0.99, 1.0] {
            let exact = sorted[(4999.0 * share) as usize];
            let found = lengths.percentile(share);
            assert!(found <= exact * (1.0 + 1e-12) && found > exact * (1.0 - 1.0 / 500.0), "{share}: {found} {exact}");
        }
        assert_eq!(Lengths::default().percentile(0.5), 0.0);
    }
}
