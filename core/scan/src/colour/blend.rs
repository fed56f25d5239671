//! Blends what several photographs show of a vertex into one colour.
//!
//! Two bands (Burt and Adelson, "A multiresolution spline with application to image mosaics", 1983): the surroundings are averaged over all photographs, so that
//! differences of tone vanish gradually; details come mostly from the photographs that show the vertex best, so that they stay sharp although poses are not exact.

use kilwa_geometry::color::encode_f32 as encode;
use std::array::from_fn;

/// A photograph that differs by twice this from the median shows something else (people, a shadow that moved) and is dropped; smaller differences lower its weight. In sRGB, 0 to 1.
const OUTLIER_DIFFERENCE: f32 = 0.12;
/// Its difference must also exceed this many times the median difference at the vertex.
const MEDIAN_FACTOR: f32 = 2.5;
/// Details brighten their surroundings by at most the first factor and darken them by at most the second: an inscription may be nearly black.
const CONTRAST: [f32; 2] = [6.0, 50.0];
/// Light below which ratios mean nothing.
const DARKEST: f32 = 1e-3;

/// What a photograph shows of a vertex, as linear light with its tone corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// How well it shows the vertex.
    pub weight: f32,
    /// At the vertex.
    pub full: [f32; 3],
    /// Around it.
    pub low: [f32; 3],
}

/// The colour of a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blended {
    /// Linear light.
    pub light: [f32; 3],
    /// Photographs that agree with it.
    pub photos: u16,
    /// Photographs that were left out because they show something else.
    pub dropped: u16,
}

/// The colour of a vertex; None without an observation. `agreement` receives how much each observation counts, from 0 to 1.
pub fn blend(observations: &[Observation], agreement: &mut Vec<f32>) -> Option<Blended> {
    agreement.clear();
    agreement.resize(observations.len(), 1.0);
    if observations.len() >= 3 {
        downweight_outliers(observations, agreement);
    }
    if agreement.iter().all(|agreement| *agreement == 0.0) {
        // No observation agrees with the median, so all of them count.
        agreement.fill(1.0);
    }
    let largest = observations.iter().zip(&*agreement).map(|(o, a)| o.weight * a).fold(0.0, f32::max);
    if largest <= 0.0 {
        return None;
    }
    let (mut low, mut sum) = ([0.0; 3], 0.0);
    let (mut detail, mut detail_sum) = ([0.0; 3], 0.0);
    for (observation, agreement) in observations.iter().zip(&*agreement) {
        // Averaging over many photographs removes noise and errors in tone, but also details.
        let sharp = observation.weight / largest * agreement;
        let weight = sharp.sqrt();
        for k in 0..3 {
            low[k] += weight * observation.low[k];
            let ratio = (observation.full[k] + DARKEST) / (observation.low[k] + DARKEST);
            detail[k] += sharp * ratio.clamp(1.0 / CONTRAST[1], CONTRAST[0]);
        }
        sum += weight;
        detail_sum += sharp;
    }
    let light = from_fn(|k| ((low[k] / sum + DARKEST) * (detail[k] / detail_sum) - DARKEST).max(0.0));
    let photos = agreement.iter().filter(|agreement| **agreement > 0.0).count();
    let counted = |n: usize| u16::try_from(n).unwrap_or(u16::MAX);
    Some(Blended { light, photos: counted(photos), dropped: counted(observations.len() - photos) })
}

/// Lower the agreement of observations that differ from the median, at the vertex or around it: next to a passer-by, the surroundings are wrong.
fn downweight_outliers(observations: &[Observation], agreement: &mut [f32]) {
    for band in [|o: &Observation| o.full, |o: &Observation| o.low] {
        let values: Vec<[f32; 3]> = observations.iter().map(|o| band(o).map(encode)).collect();
        let middle: [f32; 3] = from_fn(|k| weighted_median(values.iter().map(|v| v[k]).zip(observations)));
        let distance = |value: &[f32; 3]| (0..3).map(|k| (value[k] - middle[k]).abs()).fold(0.0, f32::max);
        let median_distance = weighted_median(values.iter().map(distance).zip(observations));
        let limit = OUTLIER_DIFFERENCE.max(MEDIAN_FACTOR * median_distance);
        for (agreement, value) in agreement.iter_mut().zip(&values) {
            // Tukey's biweight.
            let share = distance(value) / (2.0 * limit);
            *agreement *= if share < 1.0 { (1.0 - share * share) * (1.0 - share * share) } else { 0.0 };
        }
    }
}

/// The weighted median. Weights are limited to the median weight, so that one photograph cannot outvote two others.
fn weighted_median<'o>(values: impl Iterator<Item = (f32, &'o Observation)>) -> f32 {
    let mut values: Vec<(f32, f32)> = values.map(|(value, o)| (value, o.weight)).collect();
    values.sort_by(|a, b| a.1.total_cmp(&b.1));
    let most = values.get(values.len() / 2).map_or(0.0, |(_, weight)| *weight);
    for (_, weight) in &mut values {
        *weight = weight.min(most);
    }
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f32>();
    let mut sum = 0.0;
    for (value, weight) in &values {
        sum += weight;
        if sum >= half {
            return *value;
        }
    }
    values.last().map_or(0.0, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(weight: f32, light: f32) -> Observation {
        Observation { weight, full: [light; 3], low: [light; 3] }
    }

    fn light(observations: &[Observation]) -> (f32, u16, u16) {
        let blended = blend(observations, &mut Vec::new()).expect("a colour");
        (blended.light[1], blended.photos, blended.dropped)
    }

    #[test]
    fn a_passer_by_in_one_of_three_photographs_disappears_even_if_it_is_the_best_one() {
        let (value, photos, dropped) = light(&[seen(1.0, 0.20), seen(9.0, 0.02), seen(1.2, 0.21)]);
        assert!((value - 0.205).abs() < 0.01, "{value}");
        assert_eq!((photos, dropped), (2, 1));
    }

    #[test]
    fn two_photographs_that_differ_are_both_used() {
        let (value, photos, dropped) = light(&[seen(1.0, 0.2), seen(1.0, 0.1)]);
        assert!((value - 0.15).abs() < 0.01);
        assert_eq!((photos, dropped), (2, 0));
    }

    #[test]
    fn details_come_from_the_best_photograph_and_the_tone_from_all() {
        let best = Observation { weight: 4.0, full: [0.30; 3], low: [0.20; 3] };
        let blurred = Observation { weight: 1.0, full: [0.22; 3], low: [0.22; 3] };
        let (value, ..) = light(&[best, blurred]);
        // Tone (2 · 0.20 + 1 · 0.22) / 3 = 0.207, detail (4 · 1.5 + 1 · 1) / 5 = 1.4.
        assert!((value - 0.207 * 1.4).abs() < 0.005, "{value}");
    }

    #[test]
    fn a_dark_inscription_on_bright_stone_stays_dark() {
        let letter = Observation { weight: 1.0, full: [0.02; 3], low: [0.4; 3] };
        assert!((light(&[letter]).0 - 0.02).abs() < 1e-4);
    }

    #[test]
    fn no_observations_or_only_weightless_ones_give_no_colour() {
        assert!(blend(&[], &mut Vec::new()).is_none());
        assert!(blend(&[seen(0.0, 0.2)], &mut Vec::new()).is_none());
    }

    #[test]
    fn the_order_of_photographs_does_not_matter() {
        let mut random = fastrand::Rng::with_seed(2);
        for _ in 0..200 {
            let count = random.usize(1..8);
            let mut observations: Vec<Observation> =
                (0..count).map(|_| seen(random.f32(), random.f32() * 0.5)).collect();
            let (one, photos, dropped) = light(&observations);
            observations.reverse();
            let (other, ..) = light(&observations);
            assert!((one - other).abs() < 1e-5 && usize::from(photos + dropped) == count);
        }
    }
}
