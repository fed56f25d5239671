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
/// Another pose is a rival if its score is at least this share of the best score, and its distances are at most this many times as large.
const RIVAL: [f64; 2] = [0.5, 1.8];
/// The same for poses at most this many voxel edges away.
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

/// What was found for two stations or groups.
#[derive(Debug, Clone)]
pub(super) struct Finding {
    /// Candidate poses, best first.
    pub(super) candidates: Vec<CandidatePose>,
    /// Why the best is not used; `None` if it is.
    pub(super) doubt: Option<Doubt>,
}

impl Finding {
    pub(super) fn new(candidates: Vec<CandidatePose>, edge: f64, most: f64) -> Self {
        let doubt = doubt(&candidates, edge, most);
        Self { candidates, doubt }
    }

    /// The same, considering only the candidates that agree with known poses.
    pub(super) fn among(
        mut candidates: Vec<CandidatePose>,
        edge: f64,
        most: f64,
        agrees: impl Fn(&CandidatePose) -> bool,
    ) -> Self {
        if !candidates.is_empty() && !candidates.iter().any(&agrees) {
            return Self { candidates, doubt: Some(Doubt::Known) };
        }
        candidates.retain(agrees);
        Self::new(candidates, edge, most)
    }

    pub(super) fn accepted(&self) -> Option<&CandidatePose> {
        if self.doubt.is_none() { self.candidates.first() } else { None }
    }
}

fn doubt(candidates: &[CandidatePose], edge: f64, most: f64) -> Option<Doubt> {
    let Some(best) = candidates.first() else { return Some(Doubt::None) };
    let v = &best.verdict;
    if v.agree < MIN_AGREE {
        return Some(Doubt::Little);
    }
    if v.agreement() < MIN_AGREEMENT || v.contradicted() > most {
        return Some(Doubt::Contradicted);
    }
    if best.firmness < MIN_FIRMNESS.max(MIN_CLEARNESS * best.noise) {
        return Some(Doubt::Loose);
    }
    let is_rival = |other: &CandidatePose| {
        // Near the correct pose there are others in which stones match the wrong stones.
        let is_near = best.pose.difference(other.pose).1 < NEARBY * edge;
        let [score, median] = if is_near { NEAR_RIVAL } else { RIVAL };
        other.verdict.contradicted() <= most.max(2.0 * v.contradicted())
            && other.verdict.through < 3 * v.through + CLEARLY
            && (other.firmness >= MIN_FIRMNESS.min(best.firmness) || other.score() >= NEAR_RIVAL[0] * best.score())
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
