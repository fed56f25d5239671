//! How intensity falls off with range and incidence, found from surface that several stations saw.
//!
//! The intensity of a return depends on the material, the range and the incidence, and on the instrument (Höfle and Pfeifer, "Correction of laser scanning intensity data", 2007;
//! Kaasalainen et al., "Analysis of incidence angle and distance effects on terrestrial laser scanner intensity", 2011). Near an instrument it does not follow the
//! radar equation, so the model is empirical: the logarithm of an intensity is that of the material at its place, plus a gain of the station, plus a function of the
//! logarithm of the range, plus a function of the cosine of the incidence; the functions are piecewise linear and shared by the stations of an instrument. Materials drop out, because only
//! differences between stations at the same place are used.

/// Ranges between which the function of the range is linear in the logarithm: 0.5 m to 256 m, a factor of two apart.
const RANGE_KNOTS: usize = 10;
const FIRST_RANGE_LOG2: f64 = -1.0;
/// Cosines between which the other function is linear.
const COS_KNOTS: [f64; 6] = [0.05, 0.15, 0.3, 0.5, 0.75, 1.0];
/// Coefficients of an instrument.
const SHAPE: usize = RANGE_KNOTS + COS_KNOTS.len();
/// Weight of the assumption that neighbouring coefficients are equal, in observations: it decides only where there are none.
const SMOOTHNESS: f64 = 0.01;
/// Residuals beyond this count less, in the logarithm.
const ROBUST: f64 = 0.15;
/// Rounds of weighting by residuals.
const ROUNDS: usize = 4;
/// An intensity is never changed by more than this factor.
const FACTOR_MAX: f64 = 16.0;
/// Maximum number of stations; the memory for the equations grows with its square.
pub const STATIONS_MAX: usize = 1000;
/// Minimum number of places that stations saw at ranges or cosines differing by at least [`APART`]; with fewer, the falloff is unknown.
const PLACES_MIN: usize = 50;
const APART: f64 = 1.3;

/// What a station saw of a place: means over its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// The number of the place; observations of a place are consecutive.
    pub place: u32,
    /// The number of the station.
    pub station: u16,
    /// Natural logarithm of the intensity.
    pub log_intensity: f64,
    /// The range, metres.
    pub range: f64,
    /// Cosine of the incidence.
    pub cosine: f64,
}

/// The falloff of all stations.
#[derive(Debug, Clone, PartialEq)]
pub struct Falloff {
    /// The gains of stations, then the coefficients of instruments.
    solution: Vec<f64>,
    instruments: Vec<usize>,
    /// The mean over all observations, which normalised intensities keep.
    level: f64,
}

/// The coefficients that an observation depends on, with their shares.
type Row = [(usize, f64); 5];

fn row(stations: usize, station: usize, instrument: usize, range: f64, cosine: f64) -> Row {
    let first = stations + instrument * SHAPE;
    let x = (libm::log2(range.max(1e-3)) - FIRST_RANGE_LOG2).clamp(0.0, (RANGE_KNOTS - 1) as f64);
    let k = (x as usize).min(RANGE_KNOTS - 2);
    let share = x - k as f64;
    let cosine = cosine.clamp(COS_KNOTS[0], 1.0);
    let c = COS_KNOTS[1..COS_KNOTS.len() - 1].iter().take_while(|knot| **knot <= cosine).count();
    let part = (cosine - COS_KNOTS[c]) / (COS_KNOTS[c + 1] - COS_KNOTS[c]);
    let at = first + RANGE_KNOTS + c;
    [(station, 1.0), (first + k, 1.0 - share), (first + k + 1, share), (at, 1.0 - part), (at + 1, part)]
}

fn value(row: &Row, solution: &[f64]) -> f64 {
    row.iter().map(|(k, share)| solution[*k] * share).sum()
}

impl Falloff {
    /// Fit it to observations; `instruments` has the number of the instrument of every station. `None` where too few places were seen by several stations.
    pub fn fit(observations: &[Observation], instruments: &[usize]) -> Option<Self> {
        let stations = instruments.len();
        let places: Vec<&[Observation]> =
            observations.chunk_by(|a, b| a.place == b.place).filter(|place| place.len() > 1).collect();
        let differs = |place: &&&[Observation]| {
            let spread = |of: fn(&Observation) -> f64| {
                let values = place.iter().map(of);
                values.clone().fold(0.0, f64::max) / values.fold(f64::INFINITY, f64::min)
            };
            spread(|o| o.range) >= APART || spread(|o| o.cosine) >= APART
        };
        if stations > STATIONS_MAX || places.iter().filter(differs).count() < PLACES_MIN {
            return None;
        }
        let size = stations + (instruments.iter().max()? + 1) * SHAPE;
        let mut falloff = Self { solution: vec![0.0; size], instruments: instruments.to_vec(), level: 0.0 };
        for round in 0..ROUNDS {
            falloff.solution = falloff.solve(&places, round > 0)?;
        }
        let all = places.iter().flat_map(|place| place.iter());
        let (sum, count) = all.fold((0.0, 0.0), |(sum, count), o| (sum + falloff.of(o), count + 1.0));
        falloff.level = sum / count;
        Some(falloff)
    }

    fn row(&self, o: &Observation) -> Row {
        let station = usize::from(o.station);
        row(self.instruments.len(), station, self.instruments[station], o.range, o.cosine)
    }

    fn of(&self, o: &Observation) -> f64 {
        value(&self.row(o), &self.solution)
    }

    /// One round of weighted least squares.
    fn solve(&self, places: &[&[Observation]], is_weighted: bool) -> Option<Vec<f64>> {
        let size = self.solution.len();
        let (mut matrix, mut right) = (vec![0.0; size * size], vec![0.0; size]);
        let (mut residuals, mut sums) = (Vec::new(), Vec::new());
        for place in places {
            residuals.clear();
            residuals.extend(place.iter().map(|o| o.log_intensity - self.of(o)));
            residuals.sort_unstable_by(f64::total_cmp);
            let material = residuals[residuals.len() / 2];
            // The mean over the place is subtracted from every row: it is the material.
            sums.clear();
            let (mut weights, mut mean) = (0.0, 0.0);
            for o in *place {
                let off = (o.log_intensity - self.of(o) - material) / ROBUST;
                let weight = if is_weighted { 1.0 / (1.0 + off * off) } else { 1.0 };
                let row = self.row(o);
                for (i, a) in row {
                    for (j, b) in row {
                        matrix[i * size + j] += weight * a * b;
                    }
                    right[i] += weight * a * o.log_intensity;
                    sums.push((i, weight * a));
                }
                weights += weight;
                mean += weight * o.log_intensity;
            }
            for (i, a) in &sums {
                for (j, b) in &sums {
                    matrix[i * size + j] -= a * b / weights;
                }
                right[*i] -= a * mean / weights;
            }
        }
        self.regularise(&mut matrix);
        cholesky(&mut matrix, &mut right).then_some(right)
    }

    /// Gains are near zero, neighbouring coefficients equal, and those of the first knots zero, where nothing else is known.
    fn regularise(&self, matrix: &mut [f64]) {
        let (size, stations) = (self.solution.len(), self.instruments.len());
        for k in 0..size {
            matrix[k * size + k] += 1e-6;
        }
        for first in (stations..size).step_by(SHAPE) {
            for k in (0..SHAPE - 1).filter(|k| *k != RANGE_KNOTS - 1) {
                let (a, b) = (first + k, first + k + 1);
                for (i, j, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                    matrix[i * size + j] += sign * SMOOTHNESS;
                }
            }
        }
    }

    /// What to multiply an intensity of a station with.
    pub fn factor(&self, station: usize, range: f64, cosine: f64) -> f64 {
        let row = row(self.instruments.len(), station, self.instruments[station], range, cosine);
        libm::exp(self.level - value(&row, &self.solution)).clamp(1.0 / FACTOR_MAX, FACTOR_MAX)
    }
}

/// Solve a symmetric positive definite system; `right` becomes the solution. Returns false if the matrix is not positive definite.
fn cholesky(matrix: &mut [f64], right: &mut [f64]) -> bool {
    let n = right.len();
    for j in 0..n {
        for i in j..n {
            let sum: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let rest = matrix[i * n + j] - sum;
            if i == j && (rest.is_nan() || rest <= 0.0) {
                return false;
            }
            matrix[i * n + j] = if i == j { rest.sqrt() } else { rest / matrix[j * n + j] };
        }
    }
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| matrix[i * n + k] * right[k]).sum();
        right[i] = (right[i] - sum) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| matrix[k * n + i] * right[k]).sum();
        right[i] = (right[i] - sum) / matrix[i * n + i];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two stations of different gains, materials that differ by a factor of ten, and a falloff that is not of the model.
    fn observations() -> Vec<Observation> {
        let random =
            |k: u32, salt: u32| f64::from((k * 2 + salt).wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24);
        let see = |place: u32, station: u16| {
            let (range, cosine) = (
                1.0 + 60.0 * random(place, 7 + 911 * u32::from(station)).powi(2),
                0.1 + 0.9 * random(place, 31 + 77 * u32::from(station)),
            );
            let albedo = 0.1 + 0.9 * random(place, 5000);
            let gain = [1.0, 3.0][usize::from(station)];
            let falloff = (0.25 + 0.75 * cosine) / (1.0 + (range / 30.0).powi(2));
            Observation { place, station, log_intensity: (gain * albedo * falloff).ln(), range, cosine }
        };
        (0..2000).flat_map(|place| [see(place, 0), see(place, 1)]).collect()
    }

    #[test]
    fn falloff_and_gains_are_found_without_knowing_the_materials() {
        let mut observations = observations();
        // Some places changed between the stations.
        for o in observations.iter_mut().step_by(40) {
            o.log_intensity += 1.5;
        }
        let falloff = Falloff::fit(&observations, &[0, 0]).unwrap();
        let mut off: Vec<f64> = Vec::new();
        for pair in observations.chunks(2) {
            let [a, b] = [0, 1].map(|k| pair[k].log_intensity + falloff.factor(k, pair[k].range, pair[k].cosine).ln());
            off.push((a - b).abs());
        }
        off.sort_by(f64::total_cmp);
        assert!(off[1000] < 0.03 && off[1800] < 0.08, "{} {}", off[1000], off[1800]);
    }

    #[test]
    fn constant_intensities_stay_unchanged_and_too_few_places_give_no_falloff() {
        let mut observations = observations();
        for o in &mut observations {
            o.log_intensity = 0.25_f64.ln();
        }
        let falloff = Falloff::fit(&observations, &[0, 1]).unwrap();
        assert!((falloff.factor(1, 20.0, 0.4) - 1.0).abs() < 1e-6);
        assert_eq!(Falloff::fit(&observations[..60], &[0, 1]), None);
    }
}
