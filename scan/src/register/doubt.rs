//! When a candidate pose is accepted.
//!
//! A wrong pose is worse than none. Two stations are joined only if enough surface agrees, if hardly any rays of either pass through what the other saw, if the common surface constrains the
//! pose in every direction, and if no other pose is nearly as good.

use super::group::CandidatePose;

/// Minimum number of planes that must agree, counting the samples of both.
pub(super) const MIN_AGREE: u32 = 80;
/// Minimum share of the common planes that must agree, and maximum share that may be contradicted.
pub(super) const MIN_AGREEMENT: f64 = 0.45;
pub(super) const MAX_CONTRADICTED: f64 = 0.06;
/// The same between groups, which have more surface in common and more objects that were moved between scans.
pub(super) const MAX_GROUP_CONTRADICTED: f64 = 0.1;
/// The same where both poses are known well, because these support the candidate as well.
pub(super) const MAX_KNOWN_CONTRADICTED: f64 = 0.15;
/// Minimum number of planes that constrain the weakest direction, and the minimum ratio of that number to the contribution of noisy normals.
const MIN_FIRMNESS: f64 = 0.25;
const MIN_CLEARNESS: f64 = 3.0;
/// The minimum number of planes between groups: their candidates, too, are compared with poses shifted in the weakest direction.
const MIN_GROUP_FIRMNESS: f64 = 0.1;
/// Another pose is a rival if its score is at least this share of the best score, and its distances are at most this many times as large.
const RIVAL: [f64; 2] = [0.5, 1.8];
/// The same for poses at most this many voxel edges away, and for those that the common surface does not constrain in every direction: it is often a single wall or the ground, of which
/// much agrees in many places.
const NEAR_RIVAL: [f64; 2] = [0.8, 1.2];
pub(super) const NEARBY: f64 = 8.0;
/// A pose is no rival if rays pass through this many more planes than three times the number at the best pose.
pub(super) const CLEARLY: u32 = 12;

/// Why a candidate pose is not accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Doubt {
    /// There is no pose in which any surface agrees.
    None,
    /// There is too little common surface.
    Little,
    /// Too much of the common surface differs, or rays pass through it.
    Contradicted,
    /// The common surface does not constrain the pose in every direction.
    Loose,
    /// More than one pose fits.
    Ambiguous,
    /// It contradicts other pairs.
    Inconsistent,
    /// It contradicts a pose that is known.
    Known,
    /// After the adjustment of all poses, there is too little common surface.
    Unlinked,
    /// After the adjustment of all poses, it contradicts what other stations saw.
    Adjusted,
}

/// What a candidate pose must meet to be accepted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// Maximum share of the common planes that may be contradicted.
    contradicted: f64,
    /// Minimum number of planes that constrain the weakest direction.
    firmness: f64,
}

impl Limits {
    pub(super) const PAIR: Self = Self { contradicted: MAX_CONTRADICTED, firmness: MIN_FIRMNESS };
    /// For stations whose poses are known well.
    pub(super) const KNOWN: Self = Self { contradicted: MAX_KNOWN_CONTRADICTED, ..Self::PAIR };
    pub(super) const GROUP: Self = Self { contradicted: MAX_GROUP_CONTRADICTED, firmness: MIN_GROUP_FIRMNESS };
}

/// What was found for two stations or groups.
#[derive(Debug, Clone)]
pub(super) struct Finding {
    /// Candidate poses, best first.
    pub(super) candidates: Vec<CandidatePose>,
    /// Why the best is not used; `None` if it is.
    pub(super) doubt: Option<Doubt>,
}

impl Finding {
    pub(super) fn new(candidates: Vec<CandidatePose>, edge: f64, limits: Limits) -> Self {
        let doubt = doubt(&candidates, edge, limits);
        Self { candidates, doubt }
    }

    /// The same, considering only the candidates that agree with known poses.
    pub(super) fn among(
        mut candidates: Vec<CandidatePose>,
        edge: f64,
        limits: Limits,
        agrees: impl Fn(&CandidatePose) -> bool,
    ) -> Self {
        if !candidates.is_empty() && !candidates.iter().any(&agrees) {
            return Self { candidates, doubt: Some(Doubt::Known) };
        }
        candidates.retain(agrees);
        Self::new(candidates, edge, limits)
    }

    pub(super) fn accepted(&self) -> Option<&CandidatePose> {
        if self.doubt.is_none() { self.candidates.first() } else { None }
    }
}

fn doubt(candidates: &[CandidatePose], edge: f64, limits: Limits) -> Option<Doubt> {
    let Some(best) = candidates.first() else { return Some(Doubt::None) };
    let v = &best.verdict;
    if v.agree < MIN_AGREE {
        return Some(Doubt::Little);
    }
    if v.agreement() < MIN_AGREEMENT || v.contradicted() > limits.contradicted {
        return Some(Doubt::Contradicted);
    }
    if best.firmness < limits.firmness.max(MIN_CLEARNESS * best.noise) {
        return Some(Doubt::Loose);
    }
    let is_rival = |other: &CandidatePose| {
        // Near the correct pose there are others in which stones match the wrong stones.
        let is_near = best.pose.difference(other.pose).1 < NEARBY * edge;
        let is_loose = other.firmness < limits.firmness.min(best.firmness);
        let [score, median] = if is_near || is_loose { NEAR_RIVAL } else { RIVAL };
        other.verdict.contradicted() <= limits.contradicted.max(2.0 * v.contradicted())
            && other.verdict.through < 3 * v.through + CLEARLY
            && other.score() >= score * best.score()
            && other.median <= median * best.median
    };
    candidates[1..].iter().any(is_rival).then_some(Doubt::Ambiguous)
}

/// Whether a pose is acceptable on its own, regardless of rivals.
pub(super) fn is_sound(place: &CandidatePose) -> bool {
    let v = &place.verdict;
    v.agree >= MIN_AGREE
        && v.agreement() >= MIN_AGREEMENT
        && v.contradicted() <= MAX_CONTRADICTED
        && place.firmness >= MIN_FIRMNESS
}

#[cfg(test)]
mod tests {
    use super::super::view::Verdict;
    use super::*;
    use glam::{DQuat, DVec3};
    use kilwa_scan_core::Pose;

    const EDGE: f64 = 0.1;

    /// A candidate `x` metres away, where so many planes agree and rays pass through so many.
    fn candidate(x: f64, [agree, through]: [u32; 2], firmness: f64, median: f64) -> CandidatePose {
        let pose = Pose { rotation: DQuat::IDENTITY, translation: DVec3::new(x, 0.0, 0.0) };
        let verdict = Verdict { planes: 2000, agree, differ: 400, through, squares: 0.0 };
        CandidatePose::for_test(pose, verdict, firmness, median)
    }

    fn of(candidates: &[CandidatePose]) -> Option<Doubt> {
        doubt(candidates, EDGE, Limits::GROUP)
    }

    #[test]
    fn a_pose_that_fits_nearly_as_well_is_a_rival() {
        let best = candidate(0.0, [760, 6], 4.0, 0.007);
        assert_eq!(of(&[best.clone(), candidate(30.0, [650, 6], 2.0, 0.012)]), Some(Doubt::Ambiguous));
        assert_eq!(of(&[best.clone(), candidate(30.0, [650, 6], 2.0, 0.014)]), None, "distances are twice as large");
        assert_eq!(of(&[best.clone(), candidate(30.0, [650, 40], 2.0, 0.007)]), None, "rays pass through much more");
        assert_eq!(of(&[best.clone(), candidate(30.0, [300, 6], 2.0, 0.007)]), None, "much less agrees");
        assert_eq!(of(&[best]), None);
    }

    #[test]
    fn a_pose_that_a_single_wall_determines_is_a_rival_only_if_it_fits_just_as_well() {
        let best = candidate(0.0, [760, 6], 4.0, 0.007);
        let loose = |agree: u32, median: f64| candidate(30.0, [agree, 6], 0.04, median);
        // The ground seen from below, in a simulated survey.
        assert_eq!(of(&[best.clone(), loose(720, 0.011)]), None);
        assert_eq!(of(&[best.clone(), loose(720, 0.008)]), Some(Doubt::Ambiguous));
        assert_eq!(of(&[best, loose(600, 0.008)]), None);
    }

    #[test]
    fn groups_need_fewer_planes_in_the_weakest_direction_than_pairs() {
        let mut place = candidate(0.0, [700, 1], 0.16, 0.003);
        assert_eq!(doubt(&[place.clone()], EDGE, Limits::PAIR), Some(Doubt::Loose));
        assert_eq!(doubt(&[place.clone()], EDGE, Limits::GROUP), None);
        place.noise = 0.06;
        assert_eq!(doubt(&[place], EDGE, Limits::GROUP), Some(Doubt::Loose), "due to noisy normals");
    }
}
