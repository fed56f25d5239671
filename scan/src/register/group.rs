//! Groups of stations with known relative poses, and the candidate poses of one group relative to another. Initially, every station is a group of its own.

use super::doubt::Finding;
use super::seen_through::SeenThrough;
use super::view::{Verdict, View};
use glam::DQuat;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::correlate::{Correlator, Place, Plan, Spectrum};
use kilwa_scan_core::register::fit::{Fit, Posed, fit, moved};
use kilwa_scan_core::register::surfels::{Surfel, Surfels};
use nalgebra::{Matrix6, Vector6};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Candidates from correlation for single stations and for groups, the number of those that are fitted, and the number that are refined.
const PLACES: usize = 160;
const GROUP_PLACES: usize = 600;
const FITTED: usize = 20;
const REFINED: usize = 5;
/// Initial poses within this many voxel edges and radians of each other converge to the same pose; at most this many of them are tried.
const NEIGHBOURS: (f64, f64, usize) = (8.0, 0.3, 3);
/// Shifts that test whether a pose is unconstrained in its weakest direction, in voxel edges.
const SLIDES: [f64; 4] = [-10.0, -4.0, 4.0, 10.0];
/// Heights that are tried for each candidate.
const HEIGHTS: usize = 2;
/// Maximum distance of planes that agree in a rough check of a candidate pose of a pair, in voxel edges.
const ROUGH: f64 = 4.0;
/// Planes of a station that are used for a rough check, and for a fine fit.
const GLANCED: usize = 120;
const FINE: usize = 3000;
/// A candidate whose score is at most this share of the best score is discarded.
const RIVAL: f64 = 0.3;

/// Stations with known relative poses.
#[derive(Debug, Clone)]
pub(super) struct Group {
    /// Numbers of stations, and `group_from_station`, in the order of the numbers.
    pub(super) members: Vec<(usize, Pose)>,
    pub(super) plan: Plan,
    seen_through: SeenThrough,
    /// The samples of members without those of objects that were moved; members that have no such samples are missing.
    unmoved: BTreeMap<usize, Arc<[Surfel]>>,
}

impl Group {
    /// One station, in its own coordinates.
    pub(super) fn single(number: usize, view: &View) -> Self {
        let (seen_through, unmoved) = (SeenThrough::default(), BTreeMap::new());
        Self { members: vec![(number, Pose::IDENTITY)], plan: view.plan.clone(), seen_through, unmoved }
    }

    /// Both groups, in the frame of this one. `edge`: the edge of the smallest voxels, metres.
    pub(super) fn joined(&self, other: &Self, pose: Pose, views: &[View], edge: f64) -> Self {
        let moved: Vec<(usize, Pose)> = other.members.iter().map(|(number, own)| (*number, own.then(pose))).collect();
        let seen_through = self.seen_through.joined(&other.seen_through, &self.members, &moved, views, edge);
        let mut members: Vec<(usize, Pose)> = self.members.iter().copied().chain(moved).collect();
        members.sort_unstable_by_key(|(number, _)| *number);
        Self::of(members, seen_through, views)
    }

    /// The group without one member, in the same frame.
    pub(super) fn without(&self, number: usize, views: &[View]) -> Self {
        let members: Vec<(usize, Pose)> = self.members.iter().copied().filter(|(own, _)| *own != number).collect();
        Self::of(members, self.seen_through.without(number), views)
    }

    fn of(members: Vec<(usize, Pose)>, seen_through: SeenThrough, views: &[View]) -> Self {
        let parts: Vec<(&Plan, Pose)> = members.iter().map(|(number, pose)| (&views[*number].plan, *pose)).collect();
        let plan = Plan::joined(&parts);
        let unmoved =
            |(number, _): &(usize, Pose)| Some((*number, seen_through.unmoved(*number, &views[*number].samples)?));
        let unmoved = members.iter().filter_map(unmoved).collect();
        Self { members, plan, seen_through, unmoved }
    }

    /// The planes of the members that are compared with other stations.
    fn compared<'v>(&'v self, views: &'v [View]) -> Vec<Compared<'v>> {
        let planes = |number: &usize| self.unmoved.get(number).map_or(&views[*number].samples[..], |planes| planes);
        self.members
            .iter()
            .map(|(number, pose)| Compared { number: *number, pose: *pose, planes: planes(number) })
            .collect()
    }

    /// The pose of a member.
    pub(super) fn pose_of(&self, number: usize) -> Option<Pose> {
        self.members.iter().find(|(own, _)| *own == number).map(|(_, pose)| *pose)
    }

    fn targets<'v>(&self, views: &'v [View]) -> Vec<Posed<&'v Surfels>> {
        self.members.iter().map(|(number, pose)| Posed { pose: *pose, planes: &views[*number].surfels }).collect()
    }

    fn samples<'v>(&self, views: &'v [View]) -> Vec<Posed<&'v [Surfel]>> {
        self.members.iter().map(|(number, pose)| Posed { pose: *pose, planes: &views[*number].samples[..] }).collect()
    }
}

/// A candidate pose of one group relative to another.
#[derive(Debug, Clone)]
pub(super) struct CandidatePose {
    /// The pose of the second group in the frame of the first.
    pub(super) pose: Pose,
    pub(super) verdict: Verdict,
    /// How many planes constrain the pose in its weakest direction, and how much of that is due to noisy normals.
    pub(super) firmness: f64,
    pub(super) noise: f64,
    /// The weakest direction: a rotation and a translation that move planes by about one metre.
    weakest: Vector6<f64>,
    /// The median distance of planes that were matched in the fine fit, metres; infinite before it.
    pub(super) median: f64,
}

impl CandidatePose {
    /// A candidate for tests of the decision; its weakest direction is not used there.
    #[cfg(test)]
    pub(super) fn for_test(pose: Pose, verdict: Verdict, firmness: f64, median: f64) -> Self {
        Self { pose, verdict, firmness, noise: 0.0, weakest: Vector6::zeros(), median }
    }

    /// How much surface agrees; zero if rays of one pass through much of what the other saw.
    pub(super) fn score(&self) -> f64 {
        f64::from(self.verdict.agree) * (self.verdict.agreement() - 4.0 * self.verdict.contradicted()).max(0.0)
    }
}

/// The smallest eigenvalue of the information matrix, with rotations scaled by the mean distance of the planes, and its eigenvector.
fn firmness(information: &Matrix6<f64>) -> (f64, Vector6<f64>) {
    let turning = information.fixed_view::<3, 3>(0, 0).trace();
    let moving = information.fixed_view::<3, 3>(3, 3).trace();
    if moving <= 0.0 || turning <= 0.0 {
        return (0.0, Vector6::zeros());
    }
    let unit = (moving / turning).sqrt();
    let mut scaled = *information;
    for k in 0..3 {
        for other in 0..6 {
            scaled[(k, other)] *= unit;
            scaled[(other, k)] *= unit;
        }
    }
    let eigen = scaled.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let mut weakest: Vector6<f64> = eigen.eigenvectors.column(least).into_owned();
    for k in 0..3 {
        weakest[k] *= unit;
    }
    (eigen.eigenvalues[least], weakest)
}

/// Two groups, with the data needed to find poses of the second relative to the first.
pub(super) struct Two<'a> {
    pub(super) views: &'a [View],
    pub(super) first: &'a Group,
    pub(super) second: &'a Group,
    /// The edge of the smallest voxels, metres.
    pub(super) edge: f64,
}

impl Two<'_> {
    /// All poses found by fitting, best first. `guesses`: approximate poses.
    pub(super) fn candidates(
        &self,
        correlator: &Correlator,
        map: &Spectrum,
        turned: &[Spectrum],
        guesses: &[Pose],
        allows: impl Fn(Pose) -> bool,
    ) -> Vec<CandidatePose> {
        let mut starts = self.starts(correlator, map, turned);
        starts.extend(guesses.iter().map(|guess| (f64::INFINITY, *guess)));
        let mut out: Vec<CandidatePose> = Vec::new();
        for (_, start) in starts {
            let Some(found) = self.fitted(start) else { continue };
            if !out.iter().any(|other| is_same(other.pose, found.pose, self.edge)) {
                out.push(found);
            }
        }
        // Candidates excluded by known poses are not rivals; if all candidates are excluded, this is reported.
        if out.iter().any(|found| allows(found.pose)) {
            out.retain(|found| allows(found.pose));
        }
        out.sort_by(|x, y| y.score().total_cmp(&x.score()));
        let best = out.first().map_or(0.0, CandidatePose::score);
        out.retain(|found| found.score() > 0.0 && found.score() >= RIVAL * best);
        out.truncate(REFINED);
        let mut refined: Vec<CandidatePose> = Vec::new();
        for found in out.iter().filter_map(|found| self.refined(found)) {
            if !refined.iter().any(|other| is_same(other.pose, found.pose, self.edge)) {
                refined.push(found);
            }
        }
        refined.sort_by(|x, y| y.score().total_cmp(&x.score()));
        self.slide(&mut refined);
        refined
    }

    /// Add the poses to which the best one can be shifted in its weakest direction, for example along a corridor or round a tower.
    fn slide(&self, candidates: &mut Vec<CandidatePose>) {
        let Some(best) = candidates.first().cloned() else { return };
        self.add(candidates, SLIDES.into_iter().map(|step| moved(best.pose, &(best.weakest * (step * self.edge)))));
    }

    /// Add the poses found by fits from these initial poses.
    pub(super) fn add(&self, candidates: &mut Vec<CandidatePose>, starts: impl Iterator<Item = Pose>) {
        for start in starts {
            let found = self.fitted(start).and_then(|found| self.refined(&found));
            if let Some(found) =
                found.filter(|found| candidates.iter().all(|other| !is_same(other.pose, found.pose, self.edge)))
            {
                candidates.push(found);
            }
        }
        candidates.sort_by(|x, y| y.score().total_cmp(&x.score()));
    }

    /// The poses in which a station may coincide with itself.
    pub(super) fn others(&self, correlator: &Correlator, map: &Spectrum, turned: &[Spectrum]) -> Vec<CandidatePose> {
        let mut out: Vec<CandidatePose> = Vec::new();
        for (_, start) in self.starts(correlator, map, turned) {
            let Some(found) = self.fitted(start) else { continue };
            if !out.iter().any(|other| is_same(other.pose, found.pose, self.edge)) {
                out.push(found);
            }
        }
        out
    }

    /// Initial poses for fits, ranked by a rough check, best first.
    fn starts(&self, correlator: &Correlator, map: &Spectrum, turned: &[Spectrum]) -> Vec<(f64, Pose)> {
        let mut starts: Vec<(f64, Pose)> = Vec::new();
        // Without free-space information, a correct pose cannot be distinguished from a wrong one unless it is close to a known pose.
        let turned = if self.see_through() { turned } else { &[] };
        let are_single = self.first.members.len() + self.second.members.len() == 2;
        for place in correlator.places(map, turned, if are_single { PLACES } else { GROUP_PLACES }) {
            for height in self.first.plan.heights(&self.second.plan, &place, correlator.cell(), HEIGHTS) {
                let start = upright(&place, height);
                let glance = self.verdict(start, 0.8 * correlator.cell(), GLANCED);
                starts.push((quality(glance), start));
            }
        }
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.spread(starts)
    }

    /// The best initial poses, limited to a few that are close to each other.
    fn spread(&self, starts: Vec<(f64, Pose)>) -> Vec<(f64, Pose)> {
        let mut out: Vec<(f64, Pose)> = Vec::new();
        for (quality, start) in starts {
            let is_near = |(_, other): &&(f64, Pose)| {
                let (angle, distance) = start.difference(*other);
                distance < NEIGHBOURS.0 * self.edge && angle < NEIGHBOURS.1
            };
            if out.iter().filter(is_near).count() < NEIGHBOURS.2 {
                out.push((quality, start));
            }
            if out.len() == FITTED {
                break;
            }
        }
        out
    }

    /// Initial poses from the candidate poses of pairs of stations, one from each group, best first. A pair that has too little surface in common to be accepted may still
    /// have the correct pose among its candidates.
    pub(super) fn starts_from_pairs(&self, pairs: &BTreeMap<(usize, usize), Finding>) -> Vec<Pose> {
        if !self.see_through() {
            return Vec::new();
        }
        let rated = relative_poses(self.first, self.second, pairs)
            .into_iter()
            .map(|start| (quality(self.verdict(start, ROUGH * self.edge, GLANCED)), start));
        let mut starts: Vec<(f64, Pose)> = rated.filter(|(quality, _)| *quality > 0.0).collect();
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.spread(starts).into_iter().map(|(_, start)| start).collect()
    }

    /// Whether free space is known for all stations.
    fn see_through(&self) -> bool {
        self.first.members.iter().chain(&self.second.members).all(|(number, _)| self.views[*number].image.is_some())
    }

    /// A pose from control points.
    pub(super) fn given(&self, pose: Pose) -> CandidatePose {
        let verdict = self.verdict(pose, self.edge, usize::MAX);
        CandidatePose { pose, verdict, firmness: f64::INFINITY, noise: 0.0, weakest: Vector6::zeros(), median: 0.0 }
    }

    fn fitted(&self, start: Pose) -> Option<CandidatePose> {
        let reaches = [8.0, 4.0, 2.0, 1.0].map(|reach| reach * self.edge);
        let found = fit(&self.first.targets(self.views), &self.second.samples(self.views), start, 1, &reaches)?;
        Some(self.checked(&found, f64::INFINITY))
    }

    /// The pose refined with the finest planes.
    pub(super) fn refined(&self, rough: &CandidatePose) -> Option<CandidatePose> {
        let thinned: Vec<Vec<Surfel>> = self
            .second
            .members
            .iter()
            .map(|(number, _)| {
                let fine = &self.views[*number].fine;
                fine.iter().step_by(fine.len().div_ceil(FINE).max(1)).copied().collect()
            })
            .collect();
        let poses = self.second.members.iter().map(|(_, pose)| *pose);
        let sources: Vec<Posed<&[Surfel]>> =
            poses.zip(&thinned).map(|(pose, planes)| Posed { pose, planes: &planes[..] }).collect();
        let reaches = [1.0, 0.5, 0.3].map(|reach| reach * self.edge);
        let found = fit(&self.first.targets(self.views), &sources, rough.pose, 0, &reaches)?;
        let fine = self.checked(&found, found.median);
        // The normals of small planes are too noisy to show which directions are constrained.
        Some(CandidatePose { firmness: rough.firmness, noise: rough.noise, weakest: rough.weakest, ..fine })
    }

    fn checked(&self, found: &Fit, median: f64) -> CandidatePose {
        let verdict = self.verdict(found.pose, self.edge, usize::MAX);
        let (firmness, weakest) = firmness(&found.information);
        CandidatePose { pose: found.pose, verdict, firmness, noise: found.noise, weakest, median }
    }

    /// How well both agree, using at most `most` planes of each station.
    pub(super) fn verdict(&self, pose: Pose, margin: f64, most: usize) -> Verdict {
        let (first, second) = (self.first.compared(self.views), self.second.compared(self.views));
        compare(self.views, &first, &second, pose, margin, most)
    }
}

/// The poses of the second group in the frame of the first in which two of their members have one of the candidate poses of their pair (the first with the lower number).
fn relative_poses(first: &Group, second: &Group, pairs: &BTreeMap<(usize, usize), Finding>) -> Vec<Pose> {
    let mut out = Vec::new();
    for (a, first_from_a) in &first.members {
        for (b, second_from_b) in &second.members {
            let Some(finding) = pairs.get(&(*a.min(b), *a.max(b))) else { continue };
            for found in &finding.candidates {
                let a_from_b = if a < b { found.pose } else { found.pose.inverse() };
                out.push(second_from_b.inverse().then(a_from_b).then(*first_from_a));
            }
        }
    }
    out
}

/// Whether two poses are practically the same; `edge` is that of the smallest voxels.
pub(super) fn is_same(a: Pose, b: Pose, edge: f64) -> bool {
    let (angle, distance) = a.difference(b);
    distance < 2.0 * edge && angle < 0.035
}

/// A station that is compared with others: its number, `group_from_station`, and its planes.
#[derive(Clone, Copy)]
struct Compared<'v> {
    number: usize,
    pose: Pose,
    planes: &'v [Surfel],
}

/// Compares all stations of one group (numbers, and poses in the group) with all stations of another, with all of their samples; `pose` is the pose of the second group in the
/// frame of the first. Uses at most `most` planes of each station.
pub(super) fn verdict(
    views: &[View],
    first: &[(usize, Pose)],
    second: &[(usize, Pose)],
    pose: Pose,
    margin: f64,
    most: usize,
) -> Verdict {
    let all = |members: &[(usize, Pose)]| -> Vec<Compared<'_>> {
        let of =
            |(number, pose): &(usize, Pose)| Compared { number: *number, pose: *pose, planes: &views[*number].samples };
        members.iter().map(of).collect()
    };
    compare(views, &all(first), &all(second), pose, margin, most)
}

/// As [`verdict`], with the given planes.
fn compare(
    views: &[View],
    first: &[Compared<'_>],
    second: &[Compared<'_>],
    pose: Pose,
    margin: f64,
    most: usize,
) -> Verdict {
    let mut out = Verdict::default();
    for b in second {
        for a in first {
            let a_from_b = b.pose.then(pose).then(a.pose.inverse());
            out = out.join(Verdict::one_way(&views[a.number], b.planes, most, a_from_b, margin));
            out = out.join(Verdict::one_way(&views[b.number], a.planes, most, a_from_b.inverse(), margin));
        }
    }
    out
}

fn quality(verdict: Verdict) -> f64 {
    f64::from(verdict.agree) * (verdict.agreement() - 2.0 * verdict.contradicted())
}

fn upright(place: &Place, height: f64) -> Pose {
    Pose { rotation: DQuat::from_rotation_z(place.heading), translation: place.offset.extend(height) }
}

#[cfg(test)]
mod tests {
    use super::super::doubt::Doubt;
    use super::*;
    use glam::Vec3;
    use kilwa_scan_core::mask::through::RangeImage;
    use kilwa_scan_core::register::adjust::Shape;
    use kilwa_scan_core::register::image;
    use kilwa_scan_core::register::surfels::Collector;

    fn group(members: &[(usize, Pose)]) -> Group {
        let (seen_through, unmoved) = (SeenThrough::default(), BTreeMap::new());
        Group { members: members.to_vec(), plan: Plan::default(), seen_through, unmoved }
    }

    fn pose(heading: f64, x: f64, y: f64) -> Pose {
        Pose { rotation: DQuat::from_rotation_z(heading), translation: glam::DVec3::new(x, y, 0.5) }
    }

    #[test]
    fn candidate_poses_of_pairs_give_the_pose_of_one_group_in_the_other() {
        let survey = [pose(0.1, 1.0, 2.0), pose(2.0, 7.0, 3.0), pose(-1.0, 4.0, 9.0), pose(0.7, -3.0, 5.0)];
        let frames = [pose(0.4, 3.0, 1.0), pose(-2.5, 8.0, -6.0)];
        let member = |k: usize, frame: Pose| (k, survey[k].then(frame.inverse()));
        // The lower number of a pair is once in the first group and once in the second.
        let first = group(&[member(0, frames[0]), member(3, frames[0])]);
        let second = group(&[member(1, frames[1]), member(2, frames[1])]);
        let relative = |a: usize, b: usize| {
            CandidatePose::for_test(survey[b].then(survey[a].inverse()), Verdict::default(), 0.0, 0.0)
        };
        let found = |a, b| ((a, b), Finding { candidates: vec![relative(a, b)], doubt: Some(Doubt::Little) });
        let pairs = BTreeMap::from([found(0, 1), found(2, 3), found(0, 3), found(1, 2)]);
        let poses = relative_poses(&first, &second, &pairs);
        assert_eq!(poses.len(), 2, "one for each pair with a member of each group");
        for pose in poses {
            let (angle, distance) = pose.difference(frames[1].then(frames[0].inverse()));
            assert!(angle < 1e-7 && distance < 1e-9, "{angle} {distance}");
        }
    }

    /// A station that looks along its x axis at a wall 8 m away, 12° to either side.
    fn view(samples: Vec<Surfel>) -> View {
        let mut image = RangeImage::new(0.01);
        for k in -20..=20 {
            for row in -20..=20 {
                image.add(Vec3::new(8.0, 0.08 * k as f32, 0.08 * row as f32));
            }
        }
        let (shape, points) = image::Collector::around(0.01).finish(EDGE);
        let shape = Shape::Image(shape);
        View::for_test(Collector::new(EDGE).finish(), samples, image, shape, points)
    }

    const EDGE: f64 = 0.1;

    fn plane(x: f64, y: f64) -> Surfel {
        let normal = glam::DVec3::new(-1.0, -1.0, 0.0).normalize();
        let position = glam::DVec3::new(x, y, 0.0);
        Surfel { position, normal, roughness: 0.0, edge: 0.2, points: 9, facing: 0.7, spread: 0.05 }
    }

    #[test]
    fn what_two_members_see_through_is_no_longer_compared() {
        // The last plane is an object in front of the second and third station, which both look along the y axis of the first.
        let mut samples: Vec<Surfel> = (0..9).map(|k| plane(-5.0 - f64::from(k), 0.0)).collect();
        samples.push(plane(3.0, 0.0));
        let views = [view(samples), view(Vec::new()), view(Vec::new())];
        let single = |k: usize| Group::single(k, &views[k]);
        let quarter = std::f64::consts::FRAC_PI_2;
        let left = |group: &Group| group.compared(&views)[0].planes.len();
        let at = |x: f64, y: f64| Pose { translation: glam::DVec3::new(x, y, 0.0), ..pose(quarter, 0.0, 0.0) };
        let two = single(0).joined(&single(1), at(3.0, -4.0), &views, EDGE);
        assert_eq!(left(&two), 10);
        let three = two.joined(&single(2), at(3.2, -5.0), &views, EDGE);
        assert_eq!(left(&three), 9);
        assert_eq!(left(&three.without(1, &views)), 10, "one witness is not enough");
        // Joined in the other order, the first station is in the second group.
        let others = single(1).joined(&single(2), at(3.2, -5.0).then(at(3.0, -4.0).inverse()), &views, EDGE);
        assert_eq!(left(&others.joined(&single(0), at(3.0, -4.0).inverse(), &views, EDGE)), 9);
    }
}
