//! The voxel that the data support: the spacing of the densest part of the surface.

use super::Station;
use crate::ScanError;
use crate::points::points;
use glam::{DVec3, IVec3};
use std::collections::HashMap;

/// Edge of the cells in which spacings are compared, metres.
const CELL: f64 = 0.25;
/// This share of the surface is sampled as densely as the voxel, or more so. Most of the surface of a survey is ground far from every scanner; a voxel for four
/// fifths of it would lose the detail that is near (docs/decisions/0075).
const SHARE: f64 = 0.3;

/// Spacings of all stations in each cell.
#[derive(Debug, Default)]
pub(super) struct Spacings {
    /// The finest mean spacing of any station, and the largest surface that any station saw.
    cells: HashMap<IVec3, [f64; 2]>,
}

impl Spacings {
    /// Add a station.
    pub(super) fn add(
        &mut self,
        station: &Station<'_>,
        bounds: Option<[DVec3; 2]>,
        progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let thinned = f64::from(station.options.subsample.max(1));
        let mut own: HashMap<IVec3, (f64, u64)> = HashMap::new();
        points(&mut station.open()?, station.pose, &station.options.tessellate, &mut |points, done, total| {
            let [low, high] = bounds.unwrap_or([DVec3::NEG_INFINITY, DVec3::INFINITY]);
            let is_in = |p: DVec3| p.cmpge(low).all() && p.cmple(high).all();
            for point in points.iter().filter(|p| p.spacing > 0.0 && is_in(p.position)) {
                let sum = own.entry((point.position / CELL).floor().as_ivec3()).or_default();
                sum.0 += (point.spacing * thinned).powi(2);
                sum.1 += 1;
            }
            progress(done, total)
        })?;
        for (cell, (area, count)) in own {
            let best = self.cells.entry(cell).or_insert([f64::INFINITY, 0.0]);
            *best = [best[0].min((area / count as f64).sqrt()), best[1].max(area)];
        }
        Ok(())
    }

    /// The voxel, metres, rounded up to two digits; `None` if there are no points.
    pub(super) fn voxel(self) -> Option<f64> {
        let mut cells: Vec<[f64; 2]> = self.cells.into_values().collect();
        cells.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let wanted = SHARE * cells.iter().map(|[_, area]| area).sum::<f64>();
        let mut sum = 0.0;
        let found = cells.iter().find(|[_, area]| {
            sum += area;
            sum >= wanted
        });
        found.map(|[spacing, _]| rounded(*spacing))
    }
}

/// Rounded up to two digits.
fn rounded(length: f64) -> f64 {
    let exponent = length.log10().floor() as i32 - 1;
    let digits = (length / 10f64.powi(exponent) - 1e-9).ceil();
    // Divided where that is exact.
    if exponent < 0 { digits / 10f64.powi(-exponent) } else { digits * 10f64.powi(exponent) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_rounded_up_to_two_digits() {
        for (length, wanted) in [(0.012_34, 0.013), (0.02, 0.02), (0.000_561, 0.000_57), (0.0999, 0.1), (3.0, 3.0)] {
            assert_eq!(rounded(length), wanted);
        }
    }

    #[test]
    fn the_voxel_is_a_spacing_that_three_tenths_of_the_surface_have() {
        let cell = |k| IVec3::new(k, 0, 0);
        let cells = HashMap::from([(cell(0), [0.01, 2.0]), (cell(1), [0.02, 3.0]), (cell(2), [0.08, 5.0])]);
        assert_eq!(Spacings { cells }.voxel(), Some(0.02));
        assert_eq!(Spacings::default().voxel(), None);
    }
}
