//! Gains, offsets and vignettes of photographs, from what several of them show at the same places.
//!
//! A photograph p shows a place with light L as I = gₚ · v(r) · L + oₚ, in each channel: a gain (exposure and white balance), an offset (stray light), and the
//! vignette of its lens, v(r) = exp(a r² + b r⁴ + c r⁶), where r is 1 in the corners. All are found together by robust least squares of log I (Gauss-Newton,
//! Cauchy weights); the light of each place is eliminated (Schur complement). Gains that nothing determines stay at what the exposure settings say.
//! The model is that of Goldman and Chen, "Vignette and exposure calibration and compensation", ICCV 2005, with an offset and without a response curve.

use nalgebra::{DMatrix, DVector};
use std::array::from_fn;

/// Scale of the residuals that count fully, natural logarithms.
const SCALE: f64 = 0.06;
/// Noise of a photograph, linear light.
const NOISE: f64 = 0.004;
/// Residuals that come from the surface and not from noise, natural logarithms.
const SPREAD: f64 = 0.03;
/// How far from what is expected gains, offsets, and coefficients of vignettes are: standard deviations.
const GAIN: f64 = 0.7;
const OFFSET: f64 = 0.003;
const VIGNETTE: f64 = 0.4;
/// Light below this is not used, linear.
const DARKEST: f64 = 0.002;
/// Rounds of the solution, at most, and the change of a gain at which they end.
const ROUNDS: usize = 12;
const SETTLED: f64 = 1e-4;
/// Places that are used have at most so many photographs.
const PHOTOS_MAX: usize = 16;

/// What a photograph shows at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToneSample {
    /// The number of the photograph.
    pub photo: u32,
    /// The square of the distance from the centre of the picture; 1 in the corners.
    pub r2: f32,
    /// Linear light.
    pub light: [f32; 3],
    /// How much it counts.
    pub weight: f32,
}

/// The tone of a photograph in one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Channel {
    /// Natural logarithm.
    gain: f64,
    offset: f64,
}

/// How photographs show light.
#[derive(Debug, Clone, PartialEq)]
pub struct Tones {
    photos: Vec<[Channel; 3]>,
    /// The lens of each photograph.
    lenses: Vec<u32>,
    /// Coefficients of r², r⁴ and r⁶, per lens and channel.
    vignettes: Vec<[[f64; 3]; 3]>,
    /// Places at which two photographs or more were compared.
    pub places: usize,
}

/// Powers of r² that a vignette has.
fn powers(r2: f64) -> [f64; 3] {
    [r2, r2 * r2, r2 * r2 * r2]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Tones {
    /// Find them. `lenses` has the number of the lens of each photograph, from 0 without gaps. `expected` has the logarithms (natural) of the gains that exposure settings lead one to expect, relative to each other;
    /// 0 where nothing is known. `places` has what photographs show at each place.
    pub fn solve(lenses: &[u32], expected: &[f64], places: &[Vec<ToneSample>]) -> Self {
        let count = lenses.iter().max().map_or(0, |most| *most as usize + 1);
        let mut tones = Self {
            photos: expected.iter().map(|gain| [Channel { gain: *gain, offset: 0.0 }; 3]).collect(),
            lenses: lenses.to_vec(),
            vignettes: vec![[[0.0; 3]; 3]; count],
            places: places.iter().filter(|samples| samples.len() > 1).count(),
        };
        for channel in 0..3 {
            for _ in 0..ROUNDS {
                if tones.improve(channel, expected, places) < SETTLED {
                    break;
                }
            }
        }
        tones
    }

    /// The light of a place of which a photograph shows `light`.
    pub fn corrected(&self, photo: u32, r2: f32, light: [f32; 3]) -> [f32; 3] {
        from_fn(|k| self.light(k, photo, r2.into(), light[k].into()).max(0.0) as f32)
    }

    /// The gain of a photograph in each channel, as a factor.
    pub fn gain(&self, photo: u32) -> [f64; 3] {
        self.photos[photo as usize].map(|channel| libm::exp(channel.gain))
    }

    /// The offset of a photograph in each channel, linear light.
    pub fn offset(&self, photo: u32) -> [f64; 3] {
        self.photos[photo as usize].map(|channel| channel.offset)
    }

    /// The relative brightness of a lens at a distance from the centre, in the green channel.
    pub fn vignette(&self, lens: u32, r: f64) -> f64 {
        libm::exp(dot(self.vignettes[lens as usize][1], powers(r * r)))
    }

    fn light(&self, channel: usize, photo: u32, r2: f64, light: f64) -> f64 {
        let tone = self.photos[photo as usize][channel];
        (light - tone.offset) * libm::exp(-tone.gain - self.vignette_log(channel, photo, r2))
    }

    fn vignette_log(&self, channel: usize, photo: u32, r2: f64) -> f64 {
        let lens = self.lenses[photo as usize] as usize;
        dot(self.vignettes[lens][channel], powers(r2))
    }

    /// One round of Gauss-Newton in a channel; the largest change of a gain.
    fn improve(&mut self, channel: usize, expected: &[f64], places: &[Vec<ToneSample>]) -> f64 {
        let (photos, lenses) = (self.photos.len(), self.vignettes.len());
        let size = 2 * photos + 3 * lenses;
        let mut normal = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        let mut prior = |at: usize, sigma: f64, residual: f64| {
            normal[(at, at)] += 1.0 / (sigma * sigma);
            right[at] += residual / (sigma * sigma);
        };
        for (photo, expected) in expected.iter().enumerate() {
            let tone = self.photos[photo][channel];
            prior(photo, GAIN, expected - tone.gain);
            prior(photos + photo, OFFSET, -tone.offset);
        }
        for lens in 0..lenses {
            for k in 0..3 {
                prior(2 * photos + 3 * lens + k, VIGNETTE, -self.vignettes[lens][channel][k]);
            }
        }
        let mut rows = Vec::new();
        for samples in places {
            self.rows(channel, samples, &mut rows);
            add(&rows, &mut normal, &mut right);
        }
        let Some(solution) = normal.cholesky().map(|factor| factor.solve(&right)) else { return 0.0 };
        let mut largest = 0.0_f64;
        for (photo, tones) in self.photos.iter_mut().enumerate() {
            let tone = &mut tones[channel];
            tone.gain += solution[photo];
            tone.offset += solution[photos + photo];
            largest = largest.max(solution[photo].abs());
        }
        for (lens, vignette) in self.vignettes.iter_mut().enumerate() {
            for k in 0..3 {
                vignette[channel][k] += solution[2 * photos + 3 * lens + k];
            }
        }
        largest
    }

    /// The equations of the samples of a place.
    fn rows(&self, channel: usize, samples: &[ToneSample], rows: &mut Vec<Row>) {
        rows.clear();
        let usable = samples.iter().filter(|s| f64::from(s.light[channel]) > DARKEST).take(PHOTOS_MAX);
        let known = |s: &ToneSample| {
            let (r2, light) = (f64::from(s.r2), f64::from(s.light[channel]));
            let estimate = self.light(channel, s.photo, r2, light);
            (estimate > 0.0).then(|| (*s, libm::log(estimate)))
        };
        let mut seen: Vec<(ToneSample, f64)> = usable.filter_map(known).collect();
        if seen.len() < 2 {
            return;
        }
        seen.sort_by(|a, b| a.1.total_cmp(&b.1));
        // The median; of an even number, the mean of both in the middle.
        let middle = 0.5 * (seen[(seen.len() - 1) / 2].1 + seen[seen.len() / 2].1);
        let (photos, place) = (self.photos.len(), libm::exp(middle));
        for (sample, estimate) in seen {
            let (photo, r2, light) = (sample.photo as usize, f64::from(sample.r2), f64::from(sample.light[channel]));
            let tone = self.photos[photo][channel];
            let shown = place * libm::exp(tone.gain + self.vignette_log(channel, sample.photo, r2));
            let model = (shown + tone.offset).max(DARKEST);
            let residual = libm::log(light / model);
            let variance = SPREAD * SPREAD + (NOISE / light) * (NOISE / light);
            let far = (estimate - middle) / SCALE;
            let weight = f64::from(sample.weight) / variance / (1.0 + far * far);
            let share = shown / model;
            let lens = 2 * photos + 3 * self.lenses[photo] as usize;
            let [a, b, c] = powers(r2);
            let terms = [
                (photo, share),
                (photos + photo, 1.0 / model),
                (lens, share * a),
                (lens + 1, share * b),
                (lens + 2, share * c),
            ];
            rows.push(Row { terms, place: share, residual, weight });
        }
    }
}

/// An equation: derivatives with respect to the unknowns by their numbers, and with respect to the logarithm of the light of the place.
struct Row {
    terms: [(usize, f64); 5],
    place: f64,
    residual: f64,
    weight: f64,
}

/// Add the equations of a place, without the light of the place.
fn add(rows: &[Row], normal: &mut DMatrix<f64>, right: &mut DVector<f64>) {
    if rows.len() < 2 {
        return;
    }
    let sum = |of: &dyn Fn(&Row) -> f64| rows.iter().map(|row| row.weight * of(row)).sum::<f64>();
    let whole = sum(&|row| row.place * row.place);
    if whole <= 0.0 {
        return;
    }
    let residual = sum(&|row| row.place * row.residual) / whole;
    for row in rows {
        for (i, a) in row.terms {
            right[i] += row.weight * a * (row.residual - row.place * residual);
            for (j, b) in row.terms {
                normal[(i, j)] += row.weight * a * b;
            }
        }
    }
    for p in rows {
        for q in rows {
            let factor = p.weight * p.place * q.weight * q.place / whole;
            for (i, a) in p.terms {
                for (j, b) in q.terms {
                    normal[(i, j)] -= factor * a * b;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Photographs of two lenses with random exposures of places, every tenth sample wrong.
    fn simulated(photos: usize, wrong: f64) -> (Vec<u32>, Vec<[f64; 3]>, Vec<Vec<ToneSample>>) {
        let mut random = fastrand::Rng::with_seed(11);
        let gains: Vec<[f64; 3]> = (0..photos)
            .map(|_| {
                let exposure = libm::exp2(2.0 * random.f64() - 1.0);
                from_fn(|k| exposure * [1.0, 1.05, 0.95][k] * (1.0 + 0.04 * (random.f64() - 0.5)))
            })
            .collect();
        let lenses: Vec<u32> = (0..photos).map(|k| u32::from(k % 3 == 0)).collect();
        let mut places = Vec::new();
        for _ in 0..4000 {
            let light: [f64; 3] = from_fn(|_| 0.03 + 0.3 * random.f64() * random.f64());
            let first = random.usize(0..photos);
            let samples = (0..2 + random.usize(0..4)).map(|step| {
                let photo = (first + 7 * step * step) % photos;
                let r2 = random.f64();
                let vignette = 1.0 - [0.34, 0.2][lenses[photo] as usize] * r2;
                let error = if random.f64() < wrong { 0.3 + random.f64() } else { 1.0 + 0.01 * (random.f64() - 0.5) };
                let shown = from_fn(|k| (light[k] * gains[photo][k] * vignette * error) as f32);
                ToneSample { photo: photo as u32, r2: r2 as f32, light: shown, weight: 1.0 }
            });
            places.push(samples.collect());
        }
        (lenses, gains, places)
    }

    #[test]
    fn exposures_and_vignettes_are_found_although_a_tenth_of_the_samples_is_wrong() {
        let photos = 40;
        let (lenses, gains, places) = simulated(photos, 0.1);
        let tones = Tones::solve(&lenses, &vec![0.0; photos], &places);
        // One factor for all photographs remains undetermined.
        for channel in [0, 1, 2] {
            let ratio = |(photo, gain): (usize, &[f64; 3])| tones.gain(photo as u32)[channel] / gain[channel];
            let ratios: Vec<f64> = gains.iter().enumerate().map(ratio).collect();
            let mean = ratios.iter().map(|r| r.ln()).sum::<f64>() / photos as f64;
            for (photo, ratio) in ratios.iter().enumerate() {
                assert!((ratio.ln() - mean).abs() < 0.01, "photograph {photo}: {}", ratio.ln() - mean);
            }
        }
        assert!((tones.vignette(0, 1.0) - 0.66).abs() < 0.02 && (tones.vignette(1, 0.8) - 0.872).abs() < 0.02);
    }

    #[test]
    fn photographs_without_common_places_keep_the_expected_gain() {
        let place = |photo: u32| ToneSample { photo, r2: 0.1, light: [0.2; 3], weight: 1.0 };
        let tones = Tones::solve(&[0, 0, 0], &[0.5, -0.5, 0.25], &[vec![place(2)], vec![]]);
        for (photo, expected) in [(0, 0.5_f64), (1, -0.5), (2, 0.25)] {
            assert!((tones.gain(photo)[0].ln() - expected).abs() < 1e-9);
        }
        assert_eq!(tones.places, 0);
    }

    #[test]
    fn black_and_damaged_samples_are_left_out() {
        let place = |photo: u32, light: f32| ToneSample { photo, r2: 0.5, light: [light; 3], weight: 1.0 };
        let places = [vec![place(0, 0.0), place(1, 0.2)], vec![place(0, f32::NAN), place(1, 0.2)]];
        let tones = Tones::solve(&[0, 0], &[0.0, 0.0], &places);
        assert!(tones.gain(0)[0].is_finite() && tones.corrected(0, 0.5, [0.1; 3])[0].is_finite());
    }
}
