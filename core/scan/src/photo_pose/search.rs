//! The change of a camera under which the patches agree best.

use super::motion::{Change, Directions, PARAMETERS, dot};
use super::patch::Map;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Gains beyond this grow only as their logarithm, so that no single patch decides.
const GAIN_SOFT_LIMIT: f32 = 6.0;
/// Candidates that are improved.
const STARTS: usize = 12;
/// Rolls that are tried, in steps that shift the border of the picture by this many pixels.
const ROLLS: i32 = 2;
const ROLL_STEP: f64 = 2.5;
/// Candidates are at least this far apart, and others than the best one are rivals if they are at least this far from it, pixels.
const APART: f64 = 2.5;
const MIN_RIVAL_DISTANCE: f64 = 3.0;
/// Shifts of a patch that differ by more than this lead to different places, pixels.
const PLACE: f64 = 2.0;
/// The smallest step of the search, pixels.
const FINEST: f64 = 0.04;
/// Steps of the final least squares.
const ROUNDS: usize = 8;
/// How far a patch's best shift may be from the others' for it to take part in the least squares, pixels.
const NEAR: f64 = 2.5;
/// Scales of the robust weight of the least squares, pixels, first and last.
const SCALES: [f64; 2] = [3.0, 1.0];

/// A patch with its derivatives, pixels of the map.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    /// The map.
    pub(super) map: Map,
    /// Derivatives of its place.
    pub(super) rows: [Change; 2],
}

/// Patches and the directions of change among which the best change is sought.
pub(super) struct Search<'a> {
    sights: &'a [Sight],
    directions: Directions,
    /// Shifts of each patch in each direction.
    shifts: Vec<Vec<[f64; 2]>>,
    /// Expected size of the change in each direction, pixels.
    expected: f64,
}

/// The best change.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// The change.
    pub(super) change: Change,
    /// The covariance of the change.
    pub(super) covariance: DMatrix<f64>,
    /// The mean gain of the best change that shifts what is seen to another place, as a share of that of the best one.
    pub(super) rival: f64,
}

impl<'a> Search<'a> {
    /// `expected`: the standard deviation of the shifts that are to be corrected, pixels of the maps.
    pub(super) fn new(sights: &'a [Sight], expected: f64) -> Self {
        let rows: Vec<[Change; 2]> = sights.iter().map(|sight| sight.rows).collect();
        let directions = Directions::new(&rows);
        let shift = |sight: &Sight| {
            let along = |direction: &Change| [dot(&sight.rows[0], direction), dot(&sight.rows[1], direction)];
            directions.changes.iter().map(along).collect()
        };
        let shifts = sights.iter().map(shift).collect();
        Self { sights, directions, shifts, expected }
    }

    /// The gain of amounts in each direction, with the prior.
    fn gain(&self, amounts: &[f64]) -> f64 {
        let mut sum = 0.0;
        for (sight, shifts) in self.sights.iter().zip(&self.shifts) {
            let (mut x, mut y) = (0.0, 0.0);
            for ([dx, dy], amount) in shifts.iter().zip(amounts) {
                x += dx * amount;
                y += dy * amount;
            }
            sum += f64::from(sight.map.at([x, y]).map_or(0.0, softened));
        }
        let prior: f64 = amounts.iter().map(|a| a * a).sum();
        sum - 0.5 * prior / (self.expected * self.expected)
    }

    /// The gain of other amounts as a share of that of the best ones, over the patches that both leave inside the picture and their maps and shift to different places; None if these are fewer than half.
    fn share(&self, best: &[f64], other: &[f64]) -> Option<f64> {
        let (mut of_best, mut of_other, mut count) = (0.0, 0.0, 0);
        for (sight, shifts) in self.sights.iter().zip(&self.shifts) {
            let place = |amounts: &[f64]| {
                let along = |axis: usize| shifts.iter().zip(amounts).map(|(shift, a)| shift[axis] * a).sum::<f64>();
                [along(0), along(1)]
            };
            let (here, there) = (place(best), place(other));
            if square(&here, &there) > PLACE * PLACE
                && let (Some(a), Some(b)) = (sight.map.at(here), sight.map.at(there))
            {
                of_best += f64::from(softened(a));
                of_other += f64::from(softened(b));
                count += 1;
            }
        }
        (2 * count >= self.sights.len()).then(|| of_other / f64::max(of_best, 1e-9))
    }

    /// Common shifts of the whole picture in steps of a pixel, with some rolls: the best ones.
    fn starts(&self, radius: i32) -> Vec<Vec<f64>> {
        let rows: Vec<[Change; 2]> = self.sights.iter().map(|sight| sight.rows).collect();
        let per_turn = |axis: usize| {
            let square: f64 = rows.iter().flatten().map(|row| row[axis] * row[axis]).sum();
            (square / rows.len().max(1) as f64).sqrt().max(1e-9)
        };
        let one = |axis: usize, pixels: f64| {
            let mut change = [0.0; PARAMETERS];
            change[axis] = pixels / per_turn(axis);
            self.directions.amounts(&change, &rows)
        };
        let [pitch, yaw, roll] = [one(0, 1.0), one(1, 1.0), one(2, ROLL_STEP)];
        let mut all = Vec::new();
        for turn in -ROLLS..=ROLLS {
            for y in -radius..=radius {
                for x in -radius..=radius {
                    let amounts: Vec<f64> = (0..self.directions.changes.len())
                        .map(|k| f64::from(y) * pitch[k] + f64::from(x) * yaw[k] + f64::from(turn) * roll[k])
                        .collect();
                    all.push((self.gain(&amounts), amounts));
                }
            }
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut out: Vec<Vec<f64>> = vec![vec![0.0; self.directions.changes.len()]];
        for (_, amounts) in all {
            let far = |other: &Vec<f64>| square(other, &amounts) > APART * APART;
            if out.iter().all(far) {
                out.push(amounts);
            }
            if out.len() >= STARTS {
                break;
            }
        }
        out
    }

    /// Improve amounts step by step along the directions until no step helps.
    fn climb(&self, mut amounts: Vec<f64>, mut step: f64) -> (f64, Vec<f64>) {
        let mut best = self.gain(&amounts);
        while step > FINEST {
            let mut improved = false;
            for k in 0..amounts.len() {
                for sign in [1.0, -1.0] {
                    let before = amounts[k];
                    amounts[k] = before + sign * step;
                    let gain = self.gain(&amounts);
                    if gain > best {
                        best = gain;
                        improved = true;
                        break;
                    }
                    amounts[k] = before;
                }
            }
            if !improved {
                step *= 0.5;
            }
        }
        (best, amounts)
    }

    /// The best change: candidates within `radius` pixels (0: only no change), each improved, and the best one fitted to the best shifts of the patches.
    /// None without directions.
    pub(super) fn best(&self, radius: i32) -> Option<Found> {
        if self.directions.changes.is_empty() {
            return None;
        }
        let climbed: Vec<_> = self.starts(radius).into_iter().map(|start| self.climb(start, 2.0)).collect();
        let (_, amounts) = climbed.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let others =
            climbed.iter().filter(|(_, other)| square(other, amounts) > MIN_RIVAL_DISTANCE * MIN_RIVAL_DISTANCE);
        let rival = others.filter_map(|(_, other)| self.share(amounts, other)).fold(0.0, f64::max);
        let (amounts, covariance) = self.fitted(amounts);
        let count = self.directions.changes.len();
        let basis = DMatrix::from_fn(PARAMETERS, count, |i, k| self.directions.changes[k][i]);
        let covariance = &basis * covariance * basis.transpose();
        Some(Found { change: self.directions.change(&amounts), covariance, rival })
    }

    /// Least squares of the distances from the patches' own best shifts, weighted with the sharpness of their peaks, robust against patches that disagree
    /// (weights of Geman and McClure), with the prior; and the covariance of the amounts.
    fn fitted(&self, start: &[f64]) -> (Vec<f64>, DMatrix<f64>) {
        let count = start.len();
        let prior = 1.0 / (self.expected * self.expected);
        let mut amounts = DVector::from_column_slice(start);
        let mut covariance = DMatrix::identity(count, count) * (self.expected * self.expected);
        let place = |shifts: &[[f64; 2]], amounts: &DVector<f64>| {
            let along = |axis: usize| shifts.iter().zip(amounts.iter()).map(|(s, a)| s[axis] * a).sum::<f64>();
            [along(0), along(1)]
        };
        for round in 0..ROUNDS {
            // Patches whose best shifts are far from the others' lose their weight step by step.
            let share = (2.0 * round as f64 / ROUNDS as f64).min(1.0);
            let scale = SCALES[0] + share * (SCALES[1] - SCALES[0]);
            let peak = |(sight, shifts): (&Sight, &Vec<[f64; 2]>)| sight.map.peak_near(place(shifts, &amounts), NEAR);
            let peaks: Vec<_> = self.sights.iter().zip(&self.shifts).map(peak).collect();
            let mut information = DMatrix::identity(count, count) * prior;
            let mut gradient = &amounts * -prior;
            for (peak, shifts) in peaks.iter().zip(&self.shifts) {
                let Some(peak) = peak else { continue };
                let [x, y] = place(shifts, &amounts);
                let (ex, ey) = (peak.shift[0] - x, peak.shift[1] - y);
                let t = (ex * ex + ey * ey) / (scale * scale);
                let weight = 1.0 / ((1.0 + t) * (1.0 + t));
                let [xx, xy, yy] = peak.curvature.map(|c| -c * weight);
                let [gx, gy] = [xx * ex + xy * ey, xy * ex + yy * ey];
                for (i, a) in shifts.iter().enumerate() {
                    gradient[i] += a[0] * gx + a[1] * gy;
                    for (j, b) in shifts.iter().enumerate() {
                        information[(i, j)] += a[0] * (xx * b[0] + xy * b[1]) + a[1] * (xy * b[0] + yy * b[1]);
                    }
                }
            }
            let Some(factors) = Cholesky::new(information) else { break };
            let step = factors.solve(&gradient);
            amounts += &step;
            covariance = factors.inverse();
        }
        (amounts.as_slice().to_vec(), covariance)
    }
}

/// What a gain counts for.
fn softened(gain: f32) -> f32 {
    GAIN_SOFT_LIMIT * libm::log1pf(gain.max(0.0) / GAIN_SOFT_LIMIT)
}

/// The square of the distance between two sets of amounts.
fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}
