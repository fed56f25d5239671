//! Thinning: the points of a tetrahedron are grouped into cells of the Morton curve, just large enough to leave a third of them, and each cell keeps one
//! point of the finest level, with the mean colour, normal and scalars and the total area.
//!
//! Pure: the result depends on the points alone, and not on their order.

use super::Placement;
use super::splat::{Splat, normal_of, rounded};
use glam::DVec3;
use kilwa_geometry::normal;
use kilwa_pack::chunk::splat;

/// One in so many points stays at most.
pub(super) const KEEP: usize = 3;
/// Patches of fewer points stay as they are: the few tetrahedra at the top would have nothing left.
const FEWEST: usize = 128;
/// Bits of the normals of coarse splats.
const NORMAL_BITS: u8 = 7;

/// The points of a coarser form.
pub(super) struct Coarse {
    /// Along Morton's curve.
    pub(super) splats: Vec<Splat>,
    /// Lattice units: no place of the coarse form is farther from the finest one than this, and vice versa.
    pub(super) error: f32,
    /// Sum over the points and channels of squared differences of colours.
    pub(super) color_squares: f64,
}

/// Thin the points of a tetrahedron.
pub(super) fn thinned(splats: &[Splat], place: &Placement) -> Coarse {
    let mut order: Vec<(u128, u32)> = (0u32..).zip(splats).map(|(i, s)| (s.code(), i)).collect();
    order.sort_unstable();
    let cell = cell_bits(&order, splats.len().div_ceil(KEEP).max(FEWEST));
    let mut coarse = Coarse { splats: Vec::new(), error: 0.0, color_squares: 0.0 };
    let mut members: Vec<Splat> = Vec::new();
    for same in order.chunk_by(|a, b| a.0 >> cell == b.0 >> cell) {
        members.clear();
        members.extend(same.iter().map(|(_, i)| splats[*i as usize]));
        let one = merged(&members, place);
        let far = one.reach.max((splat::radius(one.radius) + 1.0) as f32);
        coarse.error = coarse.error.max(far.next_up());
        coarse.color_squares += members.iter().map(|m| squares(m.color, one.color)).sum::<f64>();
        coarse.splats.push(one);
    }
    // A representative need not be the first of its cell.
    coarse.splats.sort_unstable_by_key(Splat::code);
    coarse
}

/// How many low bits of the codes a cell has, so that there are no more than `target` cells.
fn cell_bits(order: &[(u128, u32)], target: usize) -> u32 {
    let mut differ = [0usize; 129];
    for pair in order.windows(2) {
        differ[128 - (pair[0].0 ^ pair[1].0).leading_zeros() as usize] += 1;
    }
    // With cells of b bits, two neighbours are in different ones if they differ in bit b or above.
    let mut cells = order.len();
    for (bits, n) in differ.iter().enumerate() {
        cells -= n;
        if cells <= target {
            return bits.min(127) as u32;
        }
    }
    127
}

fn squares(a: [u8; 3], b: [u8; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(b)).powi(2)).sum()
}

/// One splat for all of a cell, weighted by area.
fn merged(members: &[Splat], place: &Placement) -> Splat {
    let (mut area, mut center, mut facing) = (0.0, DVec3::ZERO, DVec3::ZERO);
    let (mut color, mut intensity, mut with_intensity) = (DVec3::ZERO, 0.0, 0.0);
    for m in members {
        let weight = splat::radius(m.radius).powi(2);
        area += weight;
        center += m.center().as_dvec3() * weight;
        facing += normal::decode(m.normal) * weight;
        color += DVec3::from(m.color.map(f64::from)) * weight;
        if !m.intensity.is_nan() {
            intensity += f64::from(m.intensity) * weight;
            with_intensity += weight;
        }
    }
    center /= area;
    let away = |m: &&Splat| (m.center().as_dvec3() - center).length_squared();
    let nearest = members.iter().min_by(|a, b| away(a).total_cmp(&away(b))).copied();
    let mut one = nearest.unwrap_or(members[0]);
    let distance = |m: &Splat| (m.center() - one.center()).as_dvec3().length();
    let reach = members.iter().map(|m| distance(m) + f64::from(m.reach)).fold(0.0, f64::max);
    let extent = members.iter().map(|m| distance(m) + splat::radius(m.radius)).fold(0.0, f64::max);
    one.reach = (reach as f32).next_up();
    one.radius = splat::code_of(area.sqrt().min(extent)).min(place.largest);
    one.normal = normal_of(facing, NORMAL_BITS);
    one.color = (color / area).to_array().map(|x| (x + 0.5) as u8);
    // NaN where no member has any.
    one.intensity = rounded((intensity / with_intensity) as f32);
    one
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::Lattice;
    use proptest::prelude::*;

    const PLACE: Placement = Placement {
        lattice: Lattice { origin: DVec3::ZERO, step_log2: -11 },
        cube_log2: 20,
        largest: 60,
        largest_estimated: 40,
    };

    fn some(seed: u64, n: usize) -> Vec<Splat> {
        let mut random = fastrand::Rng::with_seed(seed);
        let one = |_| {
            let mut s = Splat {
                position: [random.i32(0..5000), random.i32(0..5000), random.i32(0..40)],
                intensity: random.f32(),
                reach: 0.0,
                normal: [random.i16(-300..300) * 64, 64],
                color: [random.u8(..), random.u8(..), 9],
                radius: random.u8(8..24),
            };
            s.be_finest();
            s
        };
        (0..n).map(one).collect()
    }

    proptest! {
        #[test]
        fn every_point_has_a_representative_within_the_error(seed in any::<u64>(), n in 1usize..2000) {
            let fine = some(seed, n);
            let coarse = thinned(&fine, &PLACE);
            prop_assert!(coarse.splats.len() <= n.div_ceil(KEEP).max(FEWEST) && !coarse.splats.is_empty());
            for s in &fine {
                let near = coarse.splats.iter().map(|c| (c.center() - s.center()).as_dvec3().length());
                let near = near.fold(f64::INFINITY, f64::min);
                prop_assert!(near + splat::radius(s.radius) <= f64::from(coarse.error));
            }
            for c in &coarse.splats {
                prop_assert!(fine.iter().any(|s| s.position == c.position));
                prop_assert!(splat::radius(c.radius) <= f64::from(coarse.error));
            }
            // And again: what was left out before still counts.
            let coarser = thinned(&coarse.splats, &PLACE);
            for s in &fine {
                let near = coarser.splats.iter().map(|c| (c.center() - s.center()).as_dvec3().length());
                prop_assert!(near.fold(f64::INFINITY, f64::min) <= f64::from(coarser.error));
            }
        }

        #[test]
        fn the_order_of_the_points_does_not_matter(seed in any::<u64>(), n in 1usize..200) {
            let mut fine = some(seed, n);
            fine.sort_unstable_by_key(Splat::key);
            fine.dedup_by_key(|s| s.position);
            let one = thinned(&fine, &PLACE).splats;
            fine.reverse();
            prop_assert_eq!(one, thinned(&fine, &PLACE).splats);
        }
    }

    #[test]
    fn a_plane_stays_covered_with_the_area_that_it_had() {
        let mut fine = Vec::new();
        for i in 0..60 {
            for j in 0..60 {
                fine.push(Splat {
                    position: [1000 + 20 * i, 1000 + 20 * j, 7],
                    radius: splat::code_of(20.0),
                    ..some(1, 1)[0]
                });
            }
        }
        let area = |s: &[Splat]| s.iter().map(|s| splat::radius(s.radius).powi(2)).sum::<f64>();
        let coarse = thinned(&fine, &PLACE);
        assert!(coarse.splats.len() > fine.len() / 6, "{}", coarse.splats.len());
        let ratio = area(&coarse.splats) / area(&fine);
        assert!((0.9..1.5).contains(&ratio), "{ratio}");
    }
}
