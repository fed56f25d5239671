//! How well a patch of the expected picture explains the photograph at each shift.
//!
//! The photograph is regressed on what the model shows in the patch (brightness, intensity, normals, depth, borders): the light, which is unknown, becomes the coefficients.
//! With n independent pixels and an explained share R² the logarithm of the likelihood, maximised over coefficients and noise, is −n/2 · log(1 − R²).
//! It is a measure of mutual information: that of jointly Gaussian variables is −1/2 · log(1 − R²) (Cover and Thomas, "Elements of information theory", 2006, section 8.5; Viola and Wells,
//! "Alignment by maximization of mutual information", 1997, use the general form).

use super::Grey;
use super::predict::Prediction;

/// Side of a patch, pixels.
pub(super) const SIDE: usize = 32;
/// Pixels summed together.
const LANES: usize = 8;
/// Pixels of a patch per independent one: details have a correlation length of about two pixels.
const PER_INDEPENDENT: f32 = 12.0;
/// A patch is used where at least this share of it shows a surface.
const SURFACE: f32 = 0.3;
/// Noise that is assumed in every patch, as a share of the contrast of the whole picture: what has less contrast says little.
const NOISE: f32 = 0.1;

type Row = [f32; SIDE];

/// Vectors that span what the model shows in a patch: orthonormal, and orthogonal to constants.
struct Basis {
    vectors: Vec<Vec<Row>>,
}

/// The log-likelihood of each shift of a patch, less its median.
#[derive(Debug, Clone)]
pub(super) struct Map {
    /// The centre of the patch in the expected picture, pixels.
    pub(super) center: [f32; 2],
    /// Largest shift in each direction, pixels.
    pub(super) radius: usize,
    /// Rows of shifts from (-radius, -radius); NaN where the shifted patch would leave the picture.
    pub(super) gain: Vec<f32>,
    /// The median that was subtracted.
    base: f32,
}

impl Basis {
    fn new(prediction: &Prediction, [left, top]: [usize; 2]) -> Self {
        let mut vectors: Vec<Vec<Row>> = Vec::new();
        for (picture, least) in &prediction.channels {
            let mut rows: Vec<Row> = (0..SIDE)
                .map(|y| {
                    let mut row = [0.0; SIDE];
                    row.copy_from_slice(picture.row(left, top + y, SIDE));
                    row
                })
                .collect();
            let mean = rows.iter().flatten().sum::<f32>() / (SIDE * SIDE) as f32;
            rows.iter_mut().flatten().for_each(|v| *v -= mean);
            // Twice, because once is not exact to rounding (Gram and Schmidt).
            for _ in 0..2 {
                for other in &vectors {
                    let share = dot(&rows, other);
                    for (row, other) in rows.iter_mut().zip(other) {
                        row.iter_mut().zip(other).for_each(|(v, o)| *v -= share * o);
                    }
                }
            }
            let length = dot(&rows, &rows).sqrt();
            if length > least * SIDE as f32 {
                rows.iter_mut().flatten().for_each(|v| *v /= length);
                vectors.push(rows);
            }
        }
        Self { vectors }
    }
}

fn dot(a: &[Row], b: &[Row]) -> f32 {
    let mut lanes = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        add_products(&mut lanes, a, b);
    }
    lanes.iter().sum()
}

/// Always adds in the same order, so that sums do not depend on the processor.
fn add_products(lanes: &mut [f32; LANES], a: &[f32], b: &[f32]) {
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for k in 0..LANES {
            lanes[k] += a[k] * b[k];
        }
    }
}

/// Maps of patches on a grid: all that show enough surface with something to recognise. `photograph`: details of the photograph, as large as the prediction.
pub(super) fn maps(photograph: &Grey, prediction: &Prediction, radius: usize, spacing: usize) -> Vec<Map> {
    let [width, height] = photograph.size().map(|side| side as usize);
    let square: f64 = photograph.values().iter().map(|v| f64::from(*v) * f64::from(*v)).sum();
    let contrast = (square / photograph.values().len() as f64) as f32;
    let noise = NOISE * NOISE * contrast * (SIDE * SIDE) as f32;
    let starts = |side: usize| -> Vec<usize> {
        // Evenly spaced, from border to border.
        let Some(room) = side.checked_sub(SIDE) else { return Vec::new() };
        let count = room / spacing.max(1) + 1;
        let step = |k: usize| if count > 1 { k * room / (count - 1) } else { room / 2 };
        (0..count).map(step).collect()
    };
    let mut out = Vec::new();
    for top in starts(height) {
        for left in starts(width) {
            let rows = (0..SIDE).map(|y| prediction.surface.row(left, top + y, SIDE));
            let surface = rows.flatten().sum::<f32>() / (SIDE * SIDE) as f32;
            if surface < SURFACE {
                continue;
            }
            let basis = Basis::new(prediction, [left, top]);
            if !basis.vectors.is_empty() {
                out.push(basis.map(photograph, [left, top], radius, noise));
            }
        }
    }
    out
}

impl Basis {
    fn map(&self, photograph: &Grey, [left, top]: [usize; 2], radius: usize, noise: f32) -> Map {
        let [width, height] = photograph.size().map(|side| side as usize);
        let mut gain = Vec::with_capacity((2 * radius + 1) * (2 * radius + 1));
        let mut valid = Vec::new();
        for dy in 0..=2 * radius {
            for dx in 0..=2 * radius {
                let inside = (left + dx).checked_sub(radius).zip((top + dy).checked_sub(radius));
                let value = inside
                    .filter(|(x, y)| x + SIDE <= width && y + SIDE <= height)
                    .map(|at| self.likelihood(photograph, at, noise));
                valid.extend(value);
                gain.push(value.unwrap_or(f32::NAN));
            }
        }
        valid.sort_unstable_by(f32::total_cmp);
        let median = valid.get(valid.len() / 2).copied().unwrap_or(0.0);
        for value in &mut gain {
            *value -= median;
        }
        let half = SIDE as f32 * 0.5;
        Map { center: [left as f32 + half, top as f32 + half], radius, gain, base: median }
    }

    /// The log-likelihood that the photograph shows the patch at a place (left, top).
    fn likelihood(&self, photograph: &Grey, (left, top): (usize, usize), noise: f32) -> f32 {
        const ONE: Row = [1.0; SIDE];
        let mut sums = [[0.0_f32; LANES]; 2];
        let mut products = [[0.0_f32; LANES]; 12];
        for y in 0..SIDE {
            let row = photograph.row(left, top + y, SIDE);
            add_products(&mut sums[0], row, &ONE);
            add_products(&mut sums[1], row, row);
            for (lanes, vector) in products.iter_mut().zip(&self.vectors) {
                add_products(lanes, row, &vector[y]);
            }
        }
        let total = |lanes: &[f32; LANES]| lanes.iter().sum::<f32>();
        let [sum, square] = [total(&sums[0]), total(&sums[1])];
        let n = (SIDE * SIDE) as f32;
        let variance = square - sum * sum / n;
        let products = products[..self.vectors.len().min(12)].iter().map(total);
        let explained: f32 = products.map(|product| product * product).sum();
        let share = (explained / (variance.max(0.0) + noise)).clamp(0.0, 0.999);
        -0.5 * n / PER_INDEPENDENT * libm::log1pf(-share)
    }
}

impl Map {
    /// The gain at a shift, interpolated; None beyond the radius and where the patch would leave the picture.
    pub(super) fn at(&self, shift: [f64; 2]) -> Option<f32> {
        let side = 2 * self.radius + 1;
        let [x, y] = shift.map(|s| s + self.radius as f64);
        if !(x >= 0.0 && y >= 0.0 && x <= (side - 1) as f64 && y <= (side - 1) as f64) {
            return None;
        }
        let (i, j) = ((x as usize).min(side.saturating_sub(2)), (y as usize).min(side.saturating_sub(2)));
        let (u, v) = ((x - i as f64) as f32, (y - j as f64) as f32);
        let at = |i: usize, j: usize| self.gain[j * side + i];
        let above = (1.0 - u) * at(i, j) + u * at(i + 1, j);
        let below = (1.0 - u) * at(i, j + 1) + u * at(i + 1, j + 1);
        let gain = (1.0 - v) * above + v * below;
        (!gain.is_nan()).then_some(gain)
    }

    /// The largest gain.
    pub(super) fn max(&self) -> f32 {
        self.gain.iter().copied().fold(0.0, f32::max)
    }

    /// The largest gain within a pixel of a shift (in both directions). None beyond the radius.
    pub(super) fn near(&self, shift: [f64; 2]) -> Option<f32> {
        let (side, r) = (2 * self.radius as i64 + 1, self.radius as i64);
        let [x, y] = shift.map(|s| s.round() as i64 + r);
        let around = (y - 1..=y + 1).flat_map(|j| (x - 1..=x + 1).map(move |i| (i, j)));
        let inside = around.filter(|(i, j)| (0..side).contains(i) && (0..side).contains(j));
        inside.map(|(i, j)| self.gain[(j * side + i) as usize]).filter(|gain| !gain.is_nan()).reduce(f32::max)
    }

    /// The share of all shifts that have, within a pixel, a gain at most `nats` below the largest: how many shifts agree with the patch.
    pub(super) fn share_within(&self, nats: f32) -> f64 {
        let (side, r, least) = (2 * self.radius + 1, self.radius as f64, self.max() - nats);
        let shifts = (0..side * side).map(|k| [(k % side) as f64 - r, (k / side) as f64 - r]);
        let (mut agree, mut all) = (0, 0);
        for gain in shifts.filter_map(|shift| self.near(shift)) {
            all += 1;
            agree += u32::from(gain >= least);
        }
        f64::from(agree) / f64::from(all.max(1))
    }

    /// The shift of the largest gain among those within `reach` of a place, with a fraction of a pixel from the parabolas through its neighbours, and the second derivatives
    /// of the gain there (xx, xy, yy; negative definite at a distinct peak). None if it is at the border of the map or of the picture, or not larger than around it.
    pub(super) fn peak_near(&self, near: [f64; 2], reach: f64) -> Option<Peak> {
        let (side, r) = (2 * self.radius + 1, self.radius as f64);
        let mut best: Option<(f32, usize, usize)> = None;
        for j in 0..side {
            for i in 0..side {
                let (dx, dy) = (i as f64 - r - near[0], j as f64 - r - near[1]);
                let gain = self.gain[j * side + i];
                let is_near = dx * dx + dy * dy <= reach * reach && !gain.is_nan();
                if is_near && best.is_none_or(|(most, _, _)| gain > most) {
                    best = Some((gain, i, j));
                }
            }
        }
        let (gain, i, j) = best?;
        if i == 0 || j == 0 || i + 1 == side || j + 1 == side {
            return None;
        }
        let mut around = (0..9).map(|k| self.gain[(j + k / 3 - 1) * side + i + k % 3 - 1]);
        if !around.all(|other| other <= gain) {
            return None;
        }
        // The explained share is rounder at its peak than its logarithm.
        let n = f64::from((SIDE * SIDE) as f32 / PER_INDEPENDENT);
        let at = |dx: usize, dy: usize| {
            let likelihood = f64::from(self.gain[(j + dy - 1) * side + i + dx - 1] + self.base);
            1.0 - libm::exp(-2.0 * likelihood / n)
        };
        let (gx, gy) = (0.5 * (at(2, 1) - at(0, 1)), 0.5 * (at(1, 2) - at(1, 0)));
        let xx = at(2, 1) + at(0, 1) - 2.0 * at(1, 1);
        let yy = at(1, 2) + at(1, 0) - 2.0 * at(1, 1);
        let xy = 0.25 * (at(2, 2) + at(0, 0) - at(2, 0) - at(0, 2));
        let determinant = xx * yy - xy * xy;
        if xx >= 0.0 || determinant <= 1e-9 {
            return None;
        }
        let dx = (-(yy * gx - xy * gy) / determinant).clamp(-1.0, 1.0);
        let dy = (-(xx * gy - xy * gx) / determinant).clamp(-1.0, 1.0);
        let curvature = [xx, xy, yy].map(|second| 0.5 * n * second);
        Some(Peak { shift: [i as f64 - r + dx, j as f64 - r + dy], curvature })
    }
}

/// The best shift of a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Peak {
    /// Pixels.
    pub(super) shift: [f64; 2],
    /// Second derivatives of the gain with respect to x and x, x and y, y and y.
    pub(super) curvature: [f64; 3],
}
