//! Joins stations into groups: first pairs with a unique relative pose, then groups, until no more can be joined.

use super::ambiguous::ambiguous;
use super::doubt::{Finding, Limits, MAX_GROUP_CONTRADICTED, MAX_KNOWN_CONTRADICTED};
use super::group::{CandidatePose, Group, Two};
use super::known::Known;
use super::pairs::{Pairs, drop_inconsistent, pairs};
use super::view::View;
use crate::ScanError;
use crate::import::Progress;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::correlate::{Correlator, Spectrum};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Cells along each side of the maps of groups.
const GROUP_SIDE: usize = 256;
/// The reach of the maps of groups, as a multiple of that of single stations.
const GROUP_REACH: f64 = 1.6;
/// Limits of the distance up to which walls are used, in voxel edges.
const REACH: (f64, f64) = (16.0, 200.0);

/// The result of joining the stations.
pub(super) struct Assembled {
    /// The groups, the largest first; every station is in one.
    pub(super) groups: Vec<Group>,
    /// What was found for pairs of stations, the first with the lower number.
    pub(super) pairs: BTreeMap<(usize, usize), Finding>,
}

/// What every step of the joining needs.
struct Work<'a> {
    views: &'a [View],
    /// The edge of the smallest voxels, metres.
    edge: f64,
    /// How far away walls are used, metres.
    reach: f64,
    known: &'a Known,
    progress: &'a (dyn Progress + Sync),
}

/// Join the stations into groups.
pub(super) fn assemble(
    views: &[View],
    edge: f64,
    known: &Known,
    progress: &(dyn Progress + Sync),
) -> Result<Assembled, ScanError> {
    let mut reaches: Vec<f64> = views.iter().map(|view| view.plan.reach()).collect();
    reaches.sort_unstable_by(f64::total_cmp);
    let reach = reaches[reaches.len() / 2].clamp(REACH.0 * edge, REACH.1 * edge);
    let singles: Vec<Group> = views.iter().enumerate().map(|(k, view)| Group::single(k, view)).collect();
    let work = Work { views, edge, reach, known, progress };
    let mut pairs = pairs(views, &singles, edge, reach, known, progress)?;
    drop_inconsistent(&mut pairs.found, known, edge);
    loop {
        let mut groups = joined(views, singles.clone(), &pairs.found, edge, known);
        let mut compared = Compared::new();
        loop {
            let best = best_of_groups(&work, &groups, &pairs, &mut compared)?;
            let Some((a, b, place)) = best else { break };
            let second = groups.remove(b);
            groups[a] = groups[a].joined(&second, place, views, edge);
        }
        let lost = ambiguous(views, &groups, &pairs, edge, known, progress)?;
        if lost.is_empty() {
            groups.sort_by_key(|group| (std::cmp::Reverse(group.members.len()), group.members[0].0));
            return Ok(Assembled { groups, pairs: pairs.found });
        }
        // Without these stations, others may become ambiguous.
        for station in lost {
            pairs.refuse(station);
        }
    }
}

/// Join the stations of accepted pairs, best first.
fn joined(
    views: &[View],
    singles: Vec<Group>,
    pairs: &BTreeMap<(usize, usize), Finding>,
    edge: f64,
    known: &Known,
) -> Vec<Group> {
    let mut groups: Vec<Option<Group>> = singles.into_iter().map(Some).collect();
    let mut group_of: Vec<usize> = (0..groups.len()).collect();
    if let [(first, first_pose), rest @ ..] = &known.fixed[..] {
        let mut group = Group::single(*first, &views[*first]);
        for (number, pose) in rest {
            let other = Group::single(*number, &views[*number]);
            group = group.joined(&other, pose.then(first_pose.inverse()), views, edge);
            groups[*number] = None;
            group_of[*number] = *first;
        }
        groups[*first] = Some(group);
    }
    let mut accepted: Vec<(&(usize, usize), &CandidatePose)> =
        pairs.iter().filter_map(|(key, found)| Some((key, found.accepted()?))).collect();
    let is_controlled = |key: &(usize, usize)| known.controlled.contains_key(key);
    accepted.sort_by(|a, b| is_controlled(b.0).cmp(&is_controlled(a.0)).then(b.1.score().total_cmp(&a.1.score())));
    for ((a, b), place) in accepted {
        let (ga, gb) = (group_of[*a], group_of[*b]);
        if ga == gb {
            continue;
        }
        let (Some(first), Some(second)) = (&groups[ga], &groups[gb]) else { continue };
        let (Some(of_a), Some(of_b)) = (first.pose_of(*a), second.pose_of(*b)) else { continue };
        let pose = of_b.inverse().then(place.pose).then(of_a);
        let two = Two { views, first, second, edge };
        let verdict = two.verdict(pose, edge, usize::MAX);
        let most = if known.are_known(*a, *b) { MAX_KNOWN_CONTRADICTED } else { MAX_GROUP_CONTRADICTED };
        let is_refused = verdict.contradicted() > most || !known.allows(first, second, pose);
        if is_refused && !is_controlled(&(*a, *b)) {
            continue;
        }
        let group = first.joined(second, pose, views, edge);
        groups[ga] = Some(group);
        groups[gb] = None;
        group_of.iter_mut().filter(|own| **own == gb).for_each(|own| *own = ga);
    }
    groups.into_iter().flatten().collect()
}

/// What was found for pairs of groups, by the numbers of their members.
type Compared = BTreeMap<[Vec<usize>; 2], Finding>;

/// The best accepted pose of one group relative to another: their indices, the lower one first, and the pose of the second in the frame of the first.
fn best_of_groups(
    work: &Work<'_>,
    groups: &[Group],
    pairs: &Pairs,
    compared: &mut Compared,
) -> Result<Option<(usize, usize, Pose)>, ScanError> {
    let names = |group: &Group| -> Vec<usize> { group.members.iter().map(|(number, _)| *number).collect() };
    let names: Vec<Vec<usize>> = groups.iter().map(names).collect();
    let is_used = |k: usize| !names[k].iter().any(|number| pairs.refused.contains(number));
    let usable =
        || (0..groups.len()).flat_map(|b| (0..b).map(move |a| (a, b))).filter(|(a, b)| is_used(*a) && is_used(*b));
    let key = |a: usize, b: usize| [names[a].clone(), names[b].clone()];
    let is_open =
        |(a, b): &(usize, usize)| names[*a].len() + names[*b].len() > 2 && !compared.contains_key(&key(*a, *b));
    let open: Vec<(usize, usize)> = usable().filter(is_open).collect();
    let correlator = Correlator::new(GROUP_REACH * work.reach, GROUP_SIDE);
    let wanted: BTreeSet<usize> = open.iter().map(|(a, _)| *a).collect();
    let maps: BTreeMap<usize, Spectrum> =
        wanted.par_iter().map(|k| (*k, correlator.upright(&groups[*k].plan))).collect();
    let seconds: BTreeSet<usize> = open.iter().map(|(_, b)| *b).collect();
    // One after the other: the turned maps of a group take 126 MB.
    for (done, b) in seconds.iter().enumerate() {
        if work.progress.is_stopped() {
            return Err(ScanError::Stopped);
        }
        let turned = correlator.turned(&groups[*b].plan);
        let firsts: Vec<usize> = open.iter().filter(|(_, second)| second == b).map(|(a, _)| *a).collect();
        let of_pair = |a: &usize| {
            let two = Two { views: work.views, first: &groups[*a], second: &groups[*b], edge: work.edge };
            let mut starts = two.starts_from_pairs(&pairs.found);
            starts.extend(work.known.start(&groups[*a], &groups[*b]));
            let allows = |pose: Pose| work.known.allows(&groups[*a], &groups[*b], pose);
            let candidates = two.candidates(&correlator, &maps[a], &turned, &starts, allows);
            (key(*a, *b), Finding::among(candidates, work.edge, Limits::GROUP, |place| allows(place.pose)))
        };
        compared.extend(firsts.par_iter().map(of_pair).collect::<Vec<_>>());
        work.progress.update("joining groups", done as u64 + 1, seconds.len() as u64);
    }
    let accepted = usable().filter_map(|(a, b)| Some((a, b, compared.get(&key(a, b))?.accepted()?)));
    let best = accepted.max_by(|x, y| x.2.score().total_cmp(&y.2.score()));
    Ok(best.map(|(a, b, place)| (a, b, place.pose)))
}
