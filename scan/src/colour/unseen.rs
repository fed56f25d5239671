//! The colours of scans, in the tone of the photographs: what vertices get that no photograph sees.
//!
//! Where both are known their ratio is averaged over cells of space, on a pyramid of grids. A vertex without photographs takes the ratio of its
//! surroundings: of the finest cells that have enough vertices, blended into coarser ones, so that there is no step where photographs end.

use glam::{DVec3, IVec3};
use std::collections::HashMap;

/// Edge of the finest cells, metres; each further level has twice the edge.
const FINEST: f64 = 0.5;
const LEVELS: usize = 8;
/// So many vertices make a cell count as much as the coarser level.
const ENOUGH: f64 = 30.0;
/// Added to light before ratios are formed.
const DARKEST: f64 = 2e-3;

/// Sums of logarithms of ratios, and their number.
type Sums = HashMap<IVec3, ([f64; 3], f64)>;

/// Ratios between photographs and scans.
#[derive(Debug, Default)]
pub(super) struct Ratios {
    levels: [Sums; LEVELS],
    whole: ([f64; 3], f64),
}

/// A number of vertices of a cell.
pub(super) type Observed = HashMap<IVec3, ([f64; 3], f64)>;

/// Add a vertex to the cells of a chunk.
pub(super) fn observe(cells: &mut Observed, place: DVec3, photographs: [f32; 3], scan: [f32; 3]) {
    let (sum, count) = cells.entry(cell(place, 0)).or_default();
    for k in 0..3 {
        sum[k] += libm::log((f64::from(photographs[k]) + DARKEST) / (f64::from(scan[k]) + DARKEST));
    }
    *count += 1.0;
}

fn cell(place: DVec3, level: usize) -> IVec3 {
    (place / (FINEST * (1u32 << level) as f64)).floor().as_ivec3()
}

impl Ratios {
    /// Add the cells of a chunk. The order of chunks must always be the same, because sums are rounded.
    pub(super) fn add(&mut self, cells: Observed) {
        let mut cells: Vec<_> = cells.into_iter().collect();
        cells.sort_unstable_by_key(|(at, _)| at.to_array());
        for (at, (sum, count)) in cells {
            for (level, sums) in self.levels.iter_mut().enumerate() {
                merge(sums.entry(at >> level as i32).or_default(), sum, count);
            }
            merge(&mut self.whole, sum, count);
        }
    }

    /// Light of a scan in the tone of the photographs.
    pub(super) fn matched(&self, place: DVec3, scan: [f32; 3]) -> [f32; 3] {
        let (sum, count) = self.whole;
        if count == 0.0 {
            return scan;
        }
        let mut ratio = sum.map(|sum| sum / count);
        for level in (0..LEVELS).rev() {
            let (sum, count) = self.around(place, level);
            let weight = count / (count + ENOUGH);
            if count > 0.0 {
                for k in 0..3 {
                    ratio[k] += weight * (sum[k] / count - ratio[k]);
                }
            }
        }
        std::array::from_fn(|k| ((f64::from(scan[k]) + DARKEST) * libm::exp(ratio[k]) - DARKEST).clamp(0.0, 1.0) as f32)
    }

    /// Interpolated between the centres of eight cells.
    fn around(&self, place: DVec3, level: usize) -> ([f64; 3], f64) {
        let at = place / (FINEST * (1u32 << level) as f64) - 0.5;
        let (first, share) = (at.floor(), at - at.floor());
        let mut total = ([0.0; 3], 0.0);
        for corner in 0..8 {
            let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let along = |k: usize| if step[k] == 1 { share[k] } else { 1.0 - share[k] };
            let weight = along(0) * along(1) * along(2);
            if let Some((sum, count)) = self.levels[level].get(&(first.as_ivec3() + step)) {
                merge(&mut total, sum.map(|sum| weight * sum), weight * count);
            }
        }
        total
    }
}

fn merge((sum, count): &mut ([f64; 3], f64), added: [f64; 3], of: f64) {
    for (sum, added) in sum.iter_mut().zip(added) {
        *sum += added;
    }
    *count += of;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_beside_photographs_gets_their_tone_and_far_ones_the_usual_tone() {
        let mut ratios = Ratios::default();
        let mut cells = Observed::default();
        // Left of x = 10 photographs are twice as bright as the scan, right of x = 60 four times.
        for k in 0..4000 {
            let (x, y) = (f64::from(k % 100) * 0.1, f64::from(k / 100) * 0.1);
            observe(&mut cells, DVec3::new(x, y, 0.0), [0.4; 3], [0.2; 3]);
            observe(&mut cells, DVec3::new(60.0 + x, y, 0.0), [0.4; 3], [0.1; 3]);
        }
        ratios.add(cells);
        let matched = |x: f64| ratios.matched(DVec3::new(x, 2.0, 0.0), [0.1; 3])[1];
        assert!((matched(10.1) - 0.2).abs() < 0.01, "{}", matched(10.1));
        assert!((matched(59.9) - 0.4).abs() < 0.02, "{}", matched(59.9));
        assert!(matched(35.0) > 0.21 && matched(35.0) < 0.39, "{}", matched(35.0));
        // No step anywhere.
        for k in 0..600 {
            let x = f64::from(k) * 0.1;
            assert!((matched(x) - matched(x + 0.1)).abs() < 0.02, "{x}");
        }
    }

    #[test]
    fn without_photographs_colours_stay_as_they_are() {
        assert_eq!(Ratios::default().matched(DVec3::ZERO, [0.1, 0.2, 0.3]), [0.1, 0.2, 0.3]);
    }
}
