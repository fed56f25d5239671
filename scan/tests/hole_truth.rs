//! The causes of holes compared with what the simulator knows: shared by a test and the example `hole_flags`.

use glam::{DVec3, IVec3};
use kilwa_scan::merge::{Cause, Hole};
use kilwa_synth::scans::{Sight, Truth};
use std::collections::HashMap;

/// All truths, in the order of the columns of [`Compared::areas`].
const TRUTHS: [Truth; 3] = [Truth::Unseen, Truth::Free, Truth::Visible];

/// Areas in square metres: rows are the causes that the merge states, columns what is true.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Compared {
    pub(crate) areas: [[f64; 3]; 4],
    /// Of the surface inside holes that no station can see, sampled evenly over the true surface: number of samples, and of those flagged as unseen.
    pub(crate) hidden: [u64; 2],
    /// Samples of the surface that no station can see and that are in no hole.
    pub(crate) beyond: u64,
}

impl Compared {
    /// The share of the area flagged with a cause for which that is true; the first two causes only.
    pub(crate) fn precision(&self, k: usize) -> f64 {
        self.areas[k][k] / self.areas[k].iter().sum::<f64>()
    }

    /// The share of the area for which a cause is true that is flagged so; the first two causes only.
    pub(crate) fn recall(&self, k: usize) -> f64 {
        self.areas[k][k] / self.areas.iter().map(|row| row[k]).sum::<f64>()
    }

    /// The recall of `unseen`, from samples of the true surface instead of places in holes.
    pub(crate) fn surface_recall(&self) -> f64 {
        self.hidden[1] as f64 / self.hidden[0] as f64
    }
}

/// How far from the plane of its rim the surface that is missing in a hole may be, metres: half the radius of a disc of its area, and at least three voxels.
pub(crate) fn reach(hole: &Hole, voxel: f64) -> f64 {
    ((hole.area / std::f64::consts::PI).sqrt() / 2.0).max(3.0 * voxel)
}

/// Compare the flags with the truth at about `count` places, spread evenly over the area of the holes.
pub(crate) fn compare(holes: &[Hole], sight: &Sight, voxel: f64, count: usize) -> Compared {
    let mut compared = Compared::default();
    let step = holes.iter().map(|hole| hole.area).sum::<f64>() / count as f64;
    let mut sum = step / 2.0;
    for hole in holes {
        let share = hole.area / hole.flags.len() as f64;
        let (normal, reach) = (hole.normal(), reach(hole, voxel));
        for (place, flag) in hole.places().into_iter().zip(&hole.flags) {
            sum += share;
            if sum < step {
                continue;
            }
            let weight = (sum / step).floor() * step;
            sum -= weight;
            let row = Cause::ALL.iter().position(|cause| cause == flag).unwrap();
            let truth = sight.truth(place, normal, reach);
            let column = TRUTHS.iter().position(|t| *t == truth).unwrap();
            compared.areas[row][column] += weight;
        }
    }
    compared
}

/// Compare the flags with what `lines` random lines through a box cross of the true surface.
pub(crate) fn sample(
    compared: &mut Compared,
    holes: &[Hole],
    sight: &Sight,
    voxel: f64,
    [low, high]: [DVec3; 2],
    lines: u32,
) {
    let size = |reach: f64| reach.log2().ceil().exp2();
    let mut places: HashMap<(u64, IVec3), Vec<(DVec3, usize, Cause)>> = HashMap::new();
    let mut sizes: Vec<f64> = Vec::new();
    for (number, hole) in holes.iter().enumerate() {
        let cell = size(radius(hole, voxel));
        if !sizes.contains(&cell) {
            sizes.push(cell);
        }
        for (place, flag) in hole.places().into_iter().zip(&hole.flags) {
            let key = (cell.to_bits(), (place / cell).floor().as_ivec3());
            places.entry(key).or_default().push((place, number, *flag));
        }
    }
    let mut random = fastrand::Rng::with_seed(1);
    let (center, radius_of_box) = ((low + high) / 2.0, (high - low).length() / 2.0);
    for _ in 0..lines {
        let mut on_sphere = || {
            let (z, turn) = (2.0 * random.f64() - 1.0, std::f64::consts::TAU * random.f64());
            let flat = (1.0 - z * z).sqrt();
            DVec3::new(flat * turn.cos(), flat * turn.sin(), z)
        };
        // Two random points of a sphere: a line that is random in position and direction.
        let [from, to] = [on_sphere(), on_sphere()].map(|d| center + d * radius_of_box);
        for surface in sight.crossings(from, to) {
            let p = surface.position;
            if p.cmplt(low).any() || p.cmpgt(high).any() || sight.is_visible(&surface) {
                continue;
            }
            let mut nearest: Option<(f64, Cause)> = None;
            for cell in &sizes {
                let at = (p / cell).floor().as_ivec3();
                for k in 0..27 {
                    let around = at + IVec3::new(k % 3, k / 3 % 3, k / 9) - 1;
                    for (place, number, flag) in places.get(&(cell.to_bits(), around)).into_iter().flatten() {
                        let hole = &holes[*number];
                        let (offset, normal) = (p - place, hole.normal());
                        let along = offset.dot(normal);
                        let aside = (offset - normal * along).length();
                        let is_in = along.abs() <= reach(hole, voxel)
                            && aside <= spacing(hole)
                            && surface.normal.dot(normal) > 0.0;
                        if is_in && nearest.is_none_or(|(best, _)| offset.length() < best) {
                            nearest = Some((offset.length(), *flag));
                        }
                    }
                }
            }
            match nearest {
                None => compared.beyond += 1,
                Some((_, flag)) => {
                    compared.hidden[0] += 1;
                    compared.hidden[1] += u64::from(flag == Cause::Unseen);
                }
            }
        }
    }
}

/// The distance between places of a hole, about.
fn spacing(hole: &Hole) -> f64 {
    (hole.area / hole.flags.len() as f64).sqrt()
}

/// How far the surface that a place stands for can be from it.
fn radius(hole: &Hole, voxel: f64) -> f64 {
    reach(hole, voxel).hypot(spacing(hole))
}
