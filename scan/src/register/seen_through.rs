//! Surface of objects that were moved between scans: planes of a member of a group that rays of two other members pass through.
//!
//! People, vehicles and scaffolding that were moved between scans contradict every station that is compared with the group, although its pose is
//! correct. Two witnesses are required, so that a single member with a wrong pose cannot hide what contradicts it. The final check of the adjusted poses
//! (`place`) compares all planes.

use super::view::View;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::surfels::Surfel;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of other members whose rays must pass through a plane.
const WITNESSES: usize = 2;
/// Witnesses that are kept for each plane: enough to leave one out.
const KEPT: usize = WITNESSES + 1;
/// If rays pass through more than this share of the planes of a member, its pose is in doubt, and all of its planes are compared.
const MAX_SHARE: f64 = 0.2;

/// For each member, the numbers of other members whose rays pass through its planes: the index of the plane among the samples of the member, and up to [`KEPT`] witnesses.
#[derive(Debug, Clone, Default)]
pub(super) struct SeenThrough(BTreeMap<usize, BTreeMap<usize, Vec<usize>>>);

impl SeenThrough {
    /// What is known when two groups are joined; the members (number, pose) of both in the same frame.
    pub(super) fn joined(
        &self,
        other: &Self,
        first: &[(usize, Pose)],
        second: &[(usize, Pose)],
        views: &[View],
        edge: f64,
    ) -> Self {
        let mut out = self.clone();
        out.0.extend(other.0.iter().map(|(number, planes)| (*number, planes.clone())));
        for (a, a_pose) in first {
            for (b, b_pose) in second {
                let a_from_b = b_pose.then(a_pose.inverse());
                out.add(*a, *b, views, a_from_b, edge);
                out.add(*b, *a, views, a_from_b.inverse(), edge);
            }
        }
        out
    }

    /// Adds the planes of `source` that rays of `witness` pass through.
    fn add(&mut self, witness: usize, source: usize, views: &[View], witness_from_source: Pose, edge: f64) {
        for plane in views[witness].through(&views[source].samples, witness_from_source, edge) {
            self.insert(source, plane, witness);
        }
    }

    fn insert(&mut self, source: usize, plane: usize, witness: usize) {
        let witnesses = self.0.entry(source).or_default().entry(plane).or_default();
        if witnesses.len() < KEPT {
            witnesses.push(witness);
        }
    }

    /// The same without one member.
    pub(super) fn without(&self, number: usize) -> Self {
        let mut out = self.clone();
        out.0.remove(&number);
        for planes in out.0.values_mut() {
            for witnesses in planes.values_mut() {
                witnesses.retain(|witness| *witness != number);
            }
        }
        out
    }

    /// The samples of a member without those that rays of [`WITNESSES`] others pass through; `None` if there are none of those, or too many.
    pub(super) fn unmoved(&self, number: usize, samples: &[Surfel]) -> Option<Arc<[Surfel]>> {
        let planes = self.0.get(&number)?;
        let is_moved = |index: usize| planes.get(&index).is_some_and(|witnesses| witnesses.len() >= WITNESSES);
        let moved = planes.keys().filter(|index| is_moved(**index)).count();
        if moved == 0 || moved as f64 > MAX_SHARE * samples.len() as f64 {
            return None;
        }
        Some(samples.iter().enumerate().filter(|(k, _)| !is_moved(*k)).map(|(_, plane)| *plane).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Samples that differ in their x coordinate.
    fn samples(n: usize) -> Vec<Surfel> {
        let plane = |k: usize| Surfel {
            position: DVec3::X * k as f64,
            normal: DVec3::Z,
            roughness: 0.0,
            edge: 0.1,
            points: 9,
            facing: 1.0,
            spread: 0.03,
        };
        (0..n).map(plane).collect()
    }

    fn left(seen: &SeenThrough, station: usize) -> Vec<usize> {
        let all = samples(10);
        let unmoved = seen.unmoved(station, &all);
        unmoved.as_deref().unwrap_or(&all).iter().map(|plane| plane.position.x as usize).collect()
    }

    #[test]
    fn planes_are_left_out_once_two_other_stations_see_through_them() {
        let mut seen = SeenThrough::default();
        seen.insert(7, 3, 1);
        assert_eq!(left(&seen, 7).len(), 10, "a single witness may have a wrong pose");
        seen.insert(7, 3, 2);
        assert_eq!(left(&seen, 7), [0, 1, 2, 4, 5, 6, 7, 8, 9]);
        assert_eq!(left(&seen, 1).len(), 10, "those of other stations stay");
    }

    #[test]
    fn a_witness_that_leaves_the_group_no_longer_counts() {
        let mut seen = SeenThrough::default();
        for witness in [1, 2] {
            seen.insert(7, 3, witness);
        }
        for witness in [1, 2, 4, 5] {
            seen.insert(7, 6, witness);
        }
        assert_eq!(left(&seen.without(2), 7), [0, 1, 2, 3, 4, 5, 7, 8, 9]);
        assert_eq!(left(&seen.without(7), 7).len(), 10);
    }

    #[test]
    fn all_planes_count_if_others_see_through_many_of_them() {
        let mut seen = SeenThrough::default();
        for plane in 0..3 {
            seen.insert(7, plane, 1);
            seen.insert(7, plane, 2);
        }
        assert_eq!(left(&seen, 7).len(), 10, "the pose of this station is in doubt");
    }
}
