//! Whether a scan goes round: its last line is then a neighbour of its first.

use kilwa_scan_core::{Rays, Sample};
use std::f64::consts::{PI, TAU};

/// Samples of a line whose azimuths are compared, about.
const COMPARED: usize = 256;
/// Pairs of samples from which an angle is taken.
const MIN_PAIRS: usize = 4;

/// Compares neighbouring lines of a scan: all of them, or some.
#[derive(Debug)]
pub(crate) struct Turn {
    lines: u64,
    /// The azimuth from a line to the next, radians, of pairs that have samples side by side.
    steps: Vec<f64>,
}

impl Turn {
    /// Of a scan of so many lines.
    pub(crate) fn new(lines: u64) -> Self {
        Self { lines, steps: Vec::new() }
    }

    /// A line, and the one before it.
    pub(crate) fn add(&mut self, before: &[Sample], here: &[Sample]) {
        self.steps.extend(azimuth(before, here, here.len().div_ceil(COMPARED)));
    }

    /// Whether `first` follows `last` as every other line follows the one before it: the lines go round a whole turn, and what is left of it is
    /// about one step.
    pub(crate) fn closes(&self, last: &[Sample], first: &[Sample], rays: Rays) -> bool {
        if rays != Rays::Central || self.lines < 3 {
            return false;
        }
        let mut steps = self.steps.clone();
        let Some(step) = median(&mut steps) else { return false };
        let covered = step.abs() * (self.lines - 1) as f64;
        covered >= TAU - 2.0 * step.abs() && azimuth(last, first, 1).is_some_and(|gap| gap.abs() < 1.5 * step.abs())
    }
}

/// The median angle about the vertical from the samples of a line to those beside them, radians, from -π to π; of every so many pairs.
fn azimuth(from: &[Sample], to: &[Sample], every: usize) -> Option<f64> {
    let turn = |sample: &Sample| f64::from(sample.position.y).atan2(f64::from(sample.position.x));
    let pairs = from.iter().zip(to).step_by(every.max(1)).filter(|(a, b)| a.is_measured() && b.is_measured());
    let mut angles: Vec<f64> = pairs.map(|(a, b)| (turn(b) - turn(a) + PI).rem_euclid(TAU) - PI).collect();
    if angles.len() < MIN_PAIRS { None } else { median(&mut angles) }
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Lines of 40 samples on a wall around the scanner, from the first azimuth on.
    fn closes(lines: usize, step: f64, rays: Rays) -> bool {
        let line = |k: usize| -> Vec<Sample> {
            let (sin, cos) = (k as f64 * step).sin_cos();
            (0..40).map(|row| Sample::measured(Vec3::new(cos as f32, sin as f32, row as f32 * 0.05))).collect()
        };
        let all: Vec<_> = (0..lines).map(line).collect();
        let mut turn = Turn::new(lines as u64);
        for pair in all.windows(2) {
            turn.add(&pair[0], &pair[1]);
        }
        turn.closes(&all[lines - 1], &all[0], rays)
    }

    #[test]
    fn only_a_whole_turn_closes() {
        for lines in [3, 16, 60, 1000] {
            for direction in [1.0, -1.0] {
                let step = direction * TAU / lines as f64;
                assert!(closes(lines, step, Rays::Central), "{lines}");
                assert!(!closes(lines, step, Rays::Parallel(glam::DVec3::Z)));
                assert!(lines < 10 || !closes(lines, step * 0.9, Rays::Central), "{lines}: nine tenths of a turn");
            }
        }
        // Narrow scans: 100 columns over 2°, 16 over 30°.
        assert!(!closes(100, 2_f64.to_radians() / 100.0, Rays::Central));
        assert!(!closes(16, 30_f64.to_radians() / 16.0, Rays::Central));
        // Lines that are rows have no azimuth between them.
        assert!(!closes(50, 0.0, Rays::Central));
    }
}
