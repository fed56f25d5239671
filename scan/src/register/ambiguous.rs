//! Stations that fit equally well elsewhere in their group.

use super::doubt::{CLEARLY, Doubt, MIN_AGREE, NEARBY, is_sound};
use super::group::{CandidatePose, Group, Two};
use super::known::Known;
use super::pairs::Pairs;
use super::view::View;
use crate::ScanError;
use crate::import::Progress;
use kilwa_scan_core::Pose;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Two poses are different if their rotations differ by more than this, radians.
pub(super) const ELSEWHERE: f64 = 0.1;
/// A station also fits elsewhere if the surfaces agree there nearly as well, with no more contradictions and not much larger distances.
const ELSEWHERE_AGREEMENT: f64 = 0.15;
const ELSEWHERE_CONTRADICTED: f64 = 0.005;
const ELSEWHERE_RESIDUAL: f64 = 1.3;
/// A group of at most this many stations is dissolved if one of them also fits elsewhere.
const SMALL_GROUP: usize = 3;

/// Stations that fit equally well elsewhere in their group, as in the other of two similar rooms.
pub(super) fn ambiguous(
    views: &[View],
    groups: &[Group],
    pairs: &Pairs,
    edge: f64,
    known: &Known,
    progress: &(dyn Progress + Sync),
) -> Result<Vec<usize>, ScanError> {
    let is_known = |k: usize| known.is_fixed(k) || known.is_controlled(k);
    let of_station = |group: &Group, number: usize, own: Pose| -> Result<bool, ScanError> {
        if progress.is_stopped() {
            return Err(ScanError::Stopped);
        }
        let rest = group.without(number, views);
        let single = Group::single(number, &views[number]);
        let two = Two { views, first: &rest, second: &single, edge };
        let here = two.verdict(own, edge, usize::MAX);
        // With only a few stations, there may be no rays between a room and its copy.
        let is_small = group.members.len() <= SMALL_GROUP;
        let fits = |there: Pose, is_copy: bool| {
            let (angle, distance) = there.difference(own);
            let is_here = distance < NEARBY * edge && angle < ELSEWHERE;
            if is_here && !(is_copy && is_small) || !known.allows(&rest, &single, there) {
                return false;
            }
            let v = two.verdict(there, edge, usize::MAX);
            if is_copy && is_small && v.through <= CLEARLY / 4 {
                return true;
            }
            !is_here
                && v.agree >= MIN_AGREE
                && v.agreement() >= here.agreement() - ELSEWHERE_AGREEMENT
                && v.contradicted() <= here.contradicted().max(ELSEWHERE_CONTRADICTED)
                && v.residual() <= ELSEWHERE_RESIDUAL * here.residual()
        };
        let elsewhere = |there: Pose| fits(there, false);
        // The pose of a station relative to another if that other station were turned and this one were not.
        let turned = |pose: Pose, turn: Pose| own.then(pose.inverse()).then(turn).then(pose);
        let is_symmetric = pairs.symmetries[number].iter().any(|turn| elsewhere(turn.then(own)));
        Ok(is_symmetric
            || rest.members.iter().any(|(other, pose)| {
                let key = (number.min(*other), number.max(*other));
                let found = pairs.found.get(&key).filter(|finding| finding.doubt != Some(Doubt::Known));
                let candidates = found.map_or(&[][..], |finding| &finding.candidates);
                let relative = |found: &CandidatePose| if number < *other { found.pose.inverse() } else { found.pose };
                candidates.iter().filter(|found| is_sound(found)).any(|found| elsewhere(relative(found).then(*pose)))
                    || pairs.symmetries[*other].iter().any(|turn| elsewhere(turned(*pose, *turn)))
                    || pairs.copies[*other].iter().any(|turn| fits(turned(*pose, *turn), true))
            }))
    };
    let members = groups.iter().filter(|group| group.members.len() > 1);
    let members: Vec<(&Group, usize, Pose)> =
        members.flat_map(|group| group.members.iter().map(move |(number, own)| (group, *number, *own))).collect();
    let judge = |(group, number, own): &(&Group, usize, Pose)| -> Result<Option<usize>, ScanError> {
        Ok((!is_known(*number) && of_station(group, *number, *own)?).then_some(*number))
    };
    let lost: Vec<Option<usize>> = members.par_iter().map(judge).collect::<Result<_, _>>()?;
    let lost: BTreeSet<usize> = lost.into_iter().flatten().collect();
    // In a small group, there is no way to know which station is wrong.
    let of_group = |group: &Group| -> Vec<usize> {
        let own = || group.members.iter().map(|(number, _)| *number);
        let are_all_lost = group.members.len() <= SMALL_GROUP && own().any(|number| lost.contains(&number));
        own().filter(|number| !is_known(*number) && (are_all_lost || lost.contains(number))).collect()
    };
    Ok(groups.iter().flat_map(of_group).collect())
}
