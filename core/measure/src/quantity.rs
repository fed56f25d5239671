//! A value with its standard uncertainty, and as many digits as that allows.

use glam::DVec3;
use kilwa_pack::Index;

/// Where the uncertainty of one measured point comes from, in metres.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Uncertainty {
    /// Rounding to the lattice: half a step on each of three axes, as a standard deviation (step / sqrt 12 per axis).
    pub lattice: f64,
    /// Certified error of the level measured on; 0 on the finest surface.
    pub level: f64,
    /// Standard uncertainty of the capture, where known.
    pub capture: Option<f64>,
    /// The part of the capture uncertainty due to the registration of the stations, if known: that of the least certain point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<f64>,
    /// The part of the capture uncertainty due to the instruments, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instrument: Option<f64>,
    /// Of pointing: the largest of the points that were picked on a picture; 0 for points that were typed or snapped.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pointing: f64,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference; in wasm32 it is no smaller")]
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl Uncertainty {
    /// Of a point on the finest surface of a pack with this lattice spacing, per axis.
    pub fn finest(step: f64, capture: Option<f64>) -> Self {
        Self { lattice: step / libm::sqrt(12.0), capture, ..Self::default() }
    }

    /// Of a point on the finest surface of a pack, per axis.
    pub fn of_pack(index: &Index) -> Self {
        let metadata = index.metadata();
        let [registration, instrument] = metadata.capture_parts().map_or([None; 2], |parts| parts.map(Some));
        let finest = Self::finest(index.header().lattice.step(), metadata.capture_accuracy);
        Self { registration, instrument, ..finest }
    }

    /// What all points have in common, without pointing, in metres, per axis.
    pub fn combined(&self) -> f64 {
        let c = self.capture.unwrap_or(0.0);
        libm::sqrt(self.lattice * self.lattice + self.level * self.level + c * c)
    }

    /// Of each of `count` points, in metres, per axis: `pointing` is that of pointing, 0 where it has no number.
    pub fn of_points(&self, pointing: &[f64], count: usize) -> Vec<f64> {
        let common = self.combined();
        let of = |i: usize| match pointing.get(i).copied().unwrap_or(0.0) {
            0.0 => common,
            pointing => libm::sqrt(common * common + pointing * pointing),
        };
        (0..count).map(of).collect()
    }
}

/// Differences to either side that differ by no more than this share are those of a function that is smooth there.
const SMOOTH: f64 = 0.1;

/// The standard uncertainty of `f` at the given points, if each coordinate of a point has the independent standard uncertainty that `per_axis` gives
/// for it (JCGM 100:2008 "GUM", 5.1.2; the derivatives by central differences over one uncertainty, at least a
/// millionth of the extent). Where `f` has an extremum or bends sharply, as the angle of two planes does at 90 degrees, central differences are too small,
/// and the larger of the differences to either side counts. Where `f` has no value next to the points, that direction is left out.
pub fn propagate<const N: usize>(
    points: &[DVec3],
    per_axis: &[f64],
    f: impl Fn(&[DVec3]) -> Option<[f64; N]>,
) -> [f64; N] {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let least = 1e-6 * (high - low).max_element().max(0.0);
    let mut squares = [0.0; N];
    let Some(here) = f(points) else { return squares };
    let mut moved = points.to_vec();
    for (i, per_axis) in per_axis.iter().enumerate().take(points.len()) {
        let h = per_axis.max(least);
        if h <= 0.0 {
            continue;
        }
        for k in 0..3 {
            moved[i][k] = points[i][k] + h;
            let ahead = f(&moved);
            moved[i][k] = points[i][k] - h;
            let behind = f(&moved);
            moved[i][k] = points[i][k];
            if let (Some(a), Some(b)) = (ahead, behind) {
                for (j, sum) in squares.iter_mut().enumerate() {
                    let (fore, back) = (a[j] - here[j], here[j] - b[j]);
                    let larger = fore.abs().max(back.abs());
                    let is_smooth = (fore - back).abs() <= SMOOTH * larger;
                    let change = if is_smooth { 0.5 * (fore + back) } else { larger };
                    let part = change / h * per_axis;
                    *sum += part * part;
                }
            }
        }
    }
    squares.map(libm::sqrt)
}

/// A value with its standard uncertainty in the same unit.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Quantity {
    /// The value.
    pub value: f64,
    /// Its standard uncertainty.
    pub uncertainty: f64,
}

impl std::fmt::Display for Quantity {
    /// The uncertainty to two significant digits, the value to the same decimal; a value without uncertainty (one that was given)
    /// alone, to a millionth.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.uncertainty == 0.0 {
            return write!(f, "{:.6}", self.value);
        }
        let digits = decimals(self.uncertainty);
        write!(f, "{:.digits$} ± {:.digits$}", self.value, self.uncertainty)
    }
}

/// Decimals of a value, so that its uncertainty has two significant digits.
pub(crate) fn decimals(uncertainty: f64) -> usize {
    if uncertainty > 0.0 { (1.0 - libm::floor(libm::log10(uncertainty))).clamp(0.0, 12.0) as usize } else { 6 }
}

/// A distance between two points and its parts, all in metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Length {
    /// Straight.
    pub straight: Quantity,
    /// In plan.
    pub horizontal: Quantity,
    /// Upwards from the first to the second.
    pub vertical: Quantity,
}

impl Length {
    /// Between two points given in metres, each with the same uncertainty per axis.
    pub fn between(a: DVec3, b: DVec3, per_axis: &Uncertainty) -> Self {
        let d = b - a;
        // Two independent points: the difference along any one direction.
        let uncertainty = libm::sqrt(2.0) * per_axis.combined();
        let of = |value| Quantity { value, uncertainty };
        let plan = d.truncate().length();
        Self { straight: of(libm::sqrt(plan * plan + d.z * d.z)), horizontal: of(plan), vertical: of(d.z) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_a_kink_a_function_is_as_uncertain_as_beside_it() {
        let spread = |x: f64| propagate(&[DVec3::new(x, 0.0, 0.0)], &[0.01], |p| Some([p[0].x.abs()]))[0];
        for x in [0.0, 0.001, -0.004, 0.006, 1.0] {
            assert!((spread(x) - 0.01).abs() < 1e-12, "at {x}: {}", spread(x));
        }
        // At a smooth extremum the slope is zero; the change over one step counts.
        let [of_square] = propagate(&[DVec3::ZERO], &[0.01], |p| Some([p[0].x * p[0].x]));
        assert!((of_square - 1e-4).abs() < 1e-12, "{of_square}");
    }

    #[test]
    fn a_length_has_its_parts_and_digits_follow_from_the_uncertainty() {
        let u = Uncertainty::finest(0.001, Some(0.002));
        let l = Length::between(DVec3::ZERO, DVec3::new(3.0, 4.0, 12.0), &u);
        assert_eq!((l.straight.value, l.horizontal.value, l.vertical.value), (13.0, 5.0, 12.0));
        assert_eq!(l.straight.to_string(), "13.0000 ± 0.0029");
        let points = [DVec3::ZERO, DVec3::new(3.0, 4.0, 12.0)];
        let [again] =
            propagate(&points, &[u.combined(); 2], |p| Some([Length::between(p[0], p[1], &u).straight.value]));
        assert!((again - l.straight.uncertainty).abs() < 1e-9, "{again}");
        assert_eq!(Quantity { value: 1234.5678, uncertainty: 12.0 }.to_string(), "1235 ± 12");
    }
}
