//! Joins stations into groups: first pairs with a unique relative pose, then groups, until no more can be joined.
//!
//! A wrong pose is worse than none. Two stations are joined only if enough surface agrees, if hardly any rays of either pass through what the other saw, if the common surface constrains the
//! pose in every direction, and if no other pose is nearly as good. Pairs that contradict each other in a triangle are not used.

use super::group::{Beside, Group, Two};
use super::view::View;
use crate::ScanError;
use crate::import::Progress;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::correlate::{Correlator, Spectrum};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};

/// Fewest planes that must agree, of the samples of both.
const MIN_AGREE: u32 = 80;
/// Minimum share of the common planes that must agree, and maximum share that may be contradicted.
const MIN_AGREEMENT: f64 = 0.45;
const MAX_CONTRADICTED: f64 = 0.06;
/// The same between groups, which have more surface in common and more objects that were moved between scans.
const MAX_GROUP_CONTRADICTED: f64 = 0.08;
/// The same where both poses are known with standard deviations, because these support the candidate as well.
const MAX_KNOWN_CONTRADICTED: f64 = 0.15;
/// The same where a station is compared with itself.
const MAX_SYMMETRY_CONTRADICTED: f64 = 0.1;
/// Minimum number of planes that constrain the weakest direction, and the minimum ratio of that number to the contribution of noisy normals.
const MIN_FIRMNESS: f64 = 0.25;
const MIN_CLEARNESS: f64 = 3.0;
/// Another pose is a rival if its score is at least this share of the best score, and its distances are at most this many times as large.
const RIVAL: [f64; 2] = [0.5, 1.8];
/// The same for poses at most this many voxel edges away.
const NEAR_RIVAL: [f64; 2] = [0.8, 1.2];
const NEARBY: f64 = 8.0;
/// Two poses are different if their rotations differ by more than this, radians.
const ELSEWHERE: f64 = 0.1;
/// A station also fits elsewhere if the surfaces agree there nearly as well, with no more contradictions and not much larger distances.
const ELSEWHERE_AGREEMENT: f64 = 0.15;
const ELSEWHERE_CONTRADICTED: f64 = 0.005;
const ELSEWHERE_RESIDUAL: f64 = 1.3;
/// A pose is no rival if rays pass through this many more planes than three times the number at the best pose.
const CLEARLY: u32 = 12;
/// A group of at most this many stations is dissolved if one of them also fits elsewhere.
const SMALL_GROUP: usize = 3;
/// Cells along each side of the maps of single stations and of groups.
const SIDE: usize = 128;
const GROUP_SIDE: usize = 256;
/// The reach of the maps of groups, as a multiple of that of single stations.
const GROUP_REACH: f64 = 1.6;
/// Limits of the distance up to which walls are used, in voxel edges.
const REACH: (f64, f64) = (16.0, 200.0);

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
}

/// What was found for two stations or groups.
#[derive(Debug, Clone)]
pub(super) struct Finding {
    /// Places, best first.
    pub(super) places: Vec<Beside>,
    /// Why the best is not used; `None` if it is.
    pub(super) doubt: Option<Doubt>,
}

impl Finding {
    fn new(places: Vec<Beside>, edge: f64, most: f64) -> Self {
        let doubt = doubt(&places, edge, most);
        Self { places, doubt }
    }

    fn accepted(&self) -> Option<&Beside> {
        if self.doubt.is_none() { self.places.first() } else { None }
    }
}

fn doubt(places: &[Beside], edge: f64, most: f64) -> Option<Doubt> {
    let Some(best) = places.first() else { return Some(Doubt::None) };
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
    let is_rival = |other: &Beside| {
        // Near the correct pose there are others in which stones match the wrong stones.
        let is_near = best.pose.difference(other.pose).1 < NEARBY * edge;
        let [score, median] = if is_near { NEAR_RIVAL } else { RIVAL };
        other.verdict.contradicted() <= most.max(2.0 * v.contradicted())
            && other.verdict.through < 3 * v.through + CLEARLY
            && (other.firmness >= MIN_FIRMNESS.min(best.firmness) || other.score() >= NEAR_RIVAL[0] * best.score())
            && other.score() >= score * best.score()
            && other.median <= median * best.median
    };
    places[1..].iter().any(is_rival).then_some(Doubt::Ambiguous)
}

/// The result of joining the stations.
pub(super) struct Assembled {
    /// The groups, the largest first; every station is in one.
    pub(super) groups: Vec<Group>,
    /// What was found for pairs of stations, the first with the lower number.
    pub(super) pairs: BTreeMap<(usize, usize), Finding>,
}

/// What is known beforehand.
pub(super) struct Known<'a> {
    /// Stations whose poses are known, with these poses.
    pub(super) fixed: Vec<(usize, Pose)>,
    /// Rough poses of stations.
    pub(super) guesses: &'a [Option<Guess>],
    /// The pose of the second station relative to the first from control points; the first has the lower number.
    pub(super) controlled: BTreeMap<(usize, usize), Pose>,
}

impl Known<'_> {
    /// Whether the poses of both stations are known with standard deviations.
    fn are_known(&self, a: usize, b: usize) -> bool {
        [a, b].iter().all(|k| self.guesses[*k].is_some_and(|guess| guess.reach.is_some()))
    }
}

/// A rough pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guess {
    pub(super) pose: Pose,
    /// Its maximum error, if known: metres, radians.
    pub(super) reach: Option<[f64; 2]>,
}

/// Whether a place agrees with rough poses of both stations.
fn is_near(place: Pose, guess: Pose, a: [f64; 2], b: [f64; 2]) -> bool {
    let (angle, distance) = place.difference(guess);
    // An error in the heading of one station displaces the other.
    angle <= a[1] + b[1] && distance <= a[0] + b[0] + (a[1] + b[1]) * guess.translation.length()
}

/// Join the stations into groups.
pub(super) fn assemble(
    views: &[View],
    edge: f64,
    known: &Known<'_>,
    progress: &(dyn Progress + Sync),
) -> Result<Assembled, ScanError> {
    let mut reaches: Vec<f64> = views.iter().map(|view| view.plan.reach()).collect();
    reaches.sort_unstable_by(f64::total_cmp);
    let reach = reaches[reaches.len() / 2].clamp(REACH.0 * edge, REACH.1 * edge);
    let singles: Vec<Group> = views.iter().enumerate().map(|(k, view)| Group::single(k, view)).collect();
    let mut pairs = pairs(views, &singles, edge, reach, known, progress)?;
    drop_inconsistent(&mut pairs.found, known, edge);
    loop {
        let mut groups = joined(views, singles.clone(), &pairs.found, edge, known);
        let mut tried: BTreeSet<[Vec<usize>; 2]> = BTreeSet::new();
        loop {
            let best = best_of_groups(views, &groups, &pairs.refused, edge, reach, &mut tried, progress)?;
            let Some((a, b, place)) = best else { break };
            let second = groups.remove(b);
            groups[a] = groups[a].joined(&second, place, views);
        }
        let lost = ambiguous(views, &groups, &pairs, edge, known);
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

/// Pairs of stations, and the stations that must not be joined with others.
struct Pairs {
    found: BTreeMap<(usize, usize), Finding>,
    /// Poses in which each station coincides with itself.
    symmetries: Vec<Vec<Pose>>,
    /// Poses that lead from what each station sees to a copy of it that another station sees.
    copies: Vec<Vec<Pose>>,
    refused: BTreeSet<usize>,
}

impl Pairs {
    /// Where a station fits in several places beside another, the other sees several copies of what it sees. A third station beside it may be in
    /// another copy.
    fn add_copies(&mut self) {
        for ((a, b), finding) in &self.found {
            if finding.doubt != Some(Doubt::Ambiguous) {
                continue;
            }
            let sound: Vec<Pose> =
                finding.places.iter().filter(|place| is_sound(place)).map(|place| place.pose).collect();
            for (k, one) in sound.iter().enumerate() {
                for (_, other) in sound.iter().enumerate().filter(|(other, _)| *other != k) {
                    self.copies[*a].push(other.inverse().then(*one));
                    self.copies[*b].push(other.then(one.inverse()));
                }
            }
        }
    }

    /// Stop using a station.
    fn refuse(&mut self, station: usize) {
        self.refused.insert(station);
        for ((a, b), finding) in &mut self.found {
            if (*a == station || *b == station) && finding.doubt.is_none() {
                finding.doubt = Some(Doubt::Ambiguous);
            }
        }
    }
}

/// Whether a pose is acceptable on its own, regardless of rivals.
fn is_sound(place: &Beside) -> bool {
    let v = &place.verdict;
    v.agree >= MIN_AGREE
        && v.agreement() >= MIN_AGREEMENT
        && v.contradicted() <= MAX_CONTRADICTED
        && place.firmness >= MIN_FIRMNESS
}

/// Stations that fit equally well elsewhere in their group, as in the other of two similar rooms.
fn ambiguous(views: &[View], groups: &[Group], pairs: &Pairs, edge: f64, known: &Known<'_>) -> Vec<usize> {
    let is_known = |k: usize| {
        known.fixed.iter().any(|(fixed, _)| *fixed == k) || known.controlled.keys().any(|(a, b)| *a == k || *b == k)
    };
    let of_station = |group: &Group, number: usize, own: Pose| -> bool {
        let rest = group.without(number, views);
        let single = Group::single(number, &views[number]);
        let two = Two { views, first: &rest, second: &single, edge };
        let here = two.verdict(own, edge, usize::MAX);
        let elsewhere = |there: Pose| {
            let (angle, distance) = there.difference(own);
            if distance < NEARBY * edge && angle < ELSEWHERE {
                return false;
            }
            let v = two.verdict(there, edge, usize::MAX);
            v.agree >= MIN_AGREE
                && v.agreement() >= here.agreement() - ELSEWHERE_AGREEMENT
                && v.contradicted() <= here.contradicted().max(ELSEWHERE_CONTRADICTED)
                && v.residual() <= ELSEWHERE_RESIDUAL * here.residual()
        };
        // With only a few stations, there may be no rays between a room and its copy.
        let is_small = group.members.len() <= SMALL_GROUP;
        let in_copy =
            |there: Pose| elsewhere(there) || is_small && two.verdict(there, edge, usize::MAX).through <= CLEARLY / 4;
        // The pose of a station relative to another if that other station were turned and this one were not.
        let turned = |pose: Pose, turn: Pose| own.then(pose.inverse()).then(turn).then(pose);
        let is_symmetric = pairs.symmetries[number].iter().any(|turn| elsewhere(turn.then(own)));
        is_symmetric
            || rest.members.iter().any(|(other, pose)| {
                let key = (number.min(*other), number.max(*other));
                let places = pairs.found.get(&key).map_or(&[][..], |finding| &finding.places);
                let beside = |place: &Beside| if number < *other { place.pose.inverse() } else { place.pose };
                places.iter().filter(|place| is_sound(place)).any(|place| elsewhere(beside(place).then(*pose)))
                    || pairs.symmetries[*other].iter().any(|turn| elsewhere(turned(*pose, *turn)))
                    || pairs.copies[*other].iter().any(|turn| in_copy(turned(*pose, *turn)))
            })
    };
    let members = groups.iter().filter(|group| group.members.len() > 1);
    let members: Vec<(&Group, usize, Pose)> =
        members.flat_map(|group| group.members.iter().map(move |(number, own)| (group, *number, *own))).collect();
    let lost = members.par_iter().filter(|(group, number, own)| !is_known(*number) && of_station(group, *number, *own));
    let lost: BTreeSet<usize> = lost.map(|(_, number, _)| *number).collect();
    // In a small group, there is no way to know which station is wrong.
    let of_group = |group: &Group| -> Vec<usize> {
        let own = || group.members.iter().map(|(number, _)| *number);
        let are_all_lost = group.members.len() <= SMALL_GROUP && own().any(|number| lost.contains(&number));
        own().filter(|number| !is_known(*number) && (are_all_lost || lost.contains(number))).collect()
    };
    groups.iter().flat_map(of_group).collect()
}

/// A pair of stations, and what was found for it.
type Found = ((usize, usize), Finding);

/// What is found for every pair of stations.
fn pairs(
    views: &[View],
    singles: &[Group],
    edge: f64,
    reach: f64,
    known: &Known<'_>,
    progress: &(dyn Progress + Sync),
) -> Result<Pairs, ScanError> {
    let correlator = Correlator::new(reach, SIDE);
    let maps: Vec<Spectrum> = singles.par_iter().map(|single| correlator.upright(&single.plan)).collect();
    let symmetries = symmetries(views, singles, edge, &correlator, &maps);
    let (done, total) = (AtomicU64::new(0), (views.len() * (views.len() - 1) / 2) as u64);
    let is_fixed = |k: usize| known.fixed.iter().any(|(fixed, _)| *fixed == k);
    let of_second = |b: usize| -> Result<Vec<Found>, ScanError> {
        let turned = correlator.turned(&singles[b].plan);
        let of_pair = |a: usize| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            let two = Two { views, first: &singles[a], second: &singles[b], edge };
            let finding = if let Some(pose) = known.controlled.get(&(a, b)) {
                Finding { places: vec![two.given(*pose)], doubt: None }
            } else {
                let guess = known.guesses[a].zip(known.guesses[b]);
                let guess = guess.map(|(a, b)| (b.pose.then(a.pose.inverse()), a.reach.zip(b.reach)));
                let start = guess.map(|(pose, _)| pose);
                let mut places = two.places(&correlator, &maps[a], &turned, start.as_slice());
                if let Some(best) = places.first().map(|best| best.pose) {
                    let of_first = symmetries[a].iter().map(|turn| best.then(*turn));
                    let of_second = symmetries[b].iter().map(|turn| turn.then(best));
                    two.add(&mut places, of_first.chain(of_second));
                }
                if let Some((pose, Some((a, b)))) = guess {
                    places.retain(|place| is_near(place.pose, pose, a, b));
                }
                Finding::new(
                    places,
                    edge,
                    if known.are_known(a, b) { MAX_KNOWN_CONTRADICTED } else { MAX_CONTRADICTED },
                )
            };
            progress.update("comparing stations", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok(((a, b), finding))
        };
        (0..b).filter(|a| !(is_fixed(*a) && is_fixed(b))).map(of_pair).collect()
    };
    let found: Vec<_> = (0..views.len()).into_par_iter().map(of_second).collect::<Result<_, _>>()?;
    let copies = vec![Vec::new(); views.len()];
    let mut pairs =
        Pairs { found: found.into_iter().flatten().collect(), symmetries, copies, refused: BTreeSet::new() };
    pairs.add_copies();
    Ok(pairs)
}

/// The poses in which each station coincides with itself: a station registered to it fits there as well.
fn symmetries(
    views: &[View],
    singles: &[Group],
    edge: f64,
    correlator: &Correlator,
    maps: &[Spectrum],
) -> Vec<Vec<Pose>> {
    let of_station = |(single, map): (&Group, &Spectrum)| -> Vec<Pose> {
        let two = Two { views, first: single, second: single, edge };
        let fits = |place: &Beside| {
            let v = &place.verdict;
            let (angle, distance) = place.pose.difference(Pose::IDENTITY);
            (distance > NEARBY * edge || angle > ELSEWHERE)
                && v.agree >= MIN_AGREE
                && v.agreement() >= MIN_AGREEMENT
                && v.contradicted() <= MAX_SYMMETRY_CONTRADICTED
        };
        let places = two.others(correlator, map, &correlator.turned(&single.plan));
        places.iter().filter(|place| fits(place)).map(|place| place.pose).collect()
    };
    singles.par_iter().zip(maps).map(of_station).collect()
}

/// Discard pairs that contradict others: the three relative poses around a triangle must close. A pair is discarded if more of its triangles fail to close
/// than close; all three pairs are discarded if it is unclear which of them is wrong.
fn drop_inconsistent(pairs: &mut BTreeMap<(usize, usize), Finding>, known: &Known<'_>, edge: f64) {
    loop {
        let accepted: BTreeMap<(usize, usize), Pose> =
            pairs.iter().filter_map(|(key, found)| Some((*key, found.accepted()?.pose))).collect();
        let mut votes: BTreeMap<(usize, usize), [u32; 2]> = BTreeMap::new();
        for ((a, b), ab) in &accepted {
            for ((_, c), bc) in accepted.range((*b, b + 1)..(b + 1, 0)) {
                let Some(ac) = accepted.get(&(*a, *c)) else { continue };
                let (angle, distance) = bc.then(*ab).difference(*ac);
                let closes = distance < 6.0 * edge && angle < 0.05;
                for key in [(*a, *b), (*b, *c), (*a, *c)] {
                    votes.entry(key).or_default()[usize::from(closes)] += 1;
                }
            }
        }
        votes.retain(|key, _| !known.controlled.contains_key(key));
        let worst = votes.values().map(|[against, by]| i64::from(*against) - i64::from(*by)).max().unwrap_or(0);
        if worst <= 0 {
            return;
        }
        for (key, [against, by]) in votes {
            if i64::from(against) - i64::from(by) == worst
                && let Some(found) = pairs.get_mut(&key)
            {
                found.doubt = Some(Doubt::Inconsistent);
            }
        }
    }
}

/// Join the stations of accepted pairs, best first.
fn joined(
    views: &[View],
    singles: Vec<Group>,
    pairs: &BTreeMap<(usize, usize), Finding>,
    edge: f64,
    known: &Known<'_>,
) -> Vec<Group> {
    let mut groups: Vec<Option<Group>> = singles.into_iter().map(Some).collect();
    let mut group_of: Vec<usize> = (0..groups.len()).collect();
    if let [(first, first_pose), rest @ ..] = &known.fixed[..] {
        let mut group = Group::single(*first, &views[*first]);
        for (number, pose) in rest {
            let other = Group::single(*number, &views[*number]);
            group = group.joined(&other, pose.then(first_pose.inverse()), views);
            groups[*number] = None;
            group_of[*number] = *first;
        }
        groups[*first] = Some(group);
    }
    let mut accepted: Vec<(&(usize, usize), &Beside)> =
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
        if verdict.contradicted() > most && !is_controlled(&(*a, *b)) {
            continue;
        }
        let group = first.joined(second, pose, views);
        groups[ga] = Some(group);
        groups[gb] = None;
        group_of.iter_mut().filter(|own| **own == gb).for_each(|own| *own = ga);
    }
    groups.into_iter().flatten().collect()
}

/// The best accepted pose of one group relative to another: their indices, the lower one first, and the pose of the second in the frame of the first.
fn best_of_groups(
    views: &[View],
    groups: &[Group],
    refused: &BTreeSet<usize>,
    edge: f64,
    reach: f64,
    tried: &mut BTreeSet<[Vec<usize>; 2]>,
    progress: &(dyn Progress + Sync),
) -> Result<Option<(usize, usize, Pose)>, ScanError> {
    let correlator = Correlator::new(GROUP_REACH * reach, GROUP_SIDE);
    let names = |group: &Group| -> Vec<usize> { group.members.iter().map(|(number, _)| *number).collect() };
    let maps: Vec<Spectrum> = groups.par_iter().map(|group| correlator.upright(&group.plan)).collect();
    let (done, total) = (AtomicU64::new(0), groups.len() as u64);
    if groups.len() < 2 {
        return Ok(None);
    }
    let is_used = |k: usize| !groups[k].members.iter().any(|(number, _)| refused.contains(number));
    let fresh =
        |a: usize, b: usize| is_used(a) && is_used(b) && !tried.contains(&[names(&groups[a]), names(&groups[b])]);
    let found: Vec<(usize, usize, Finding)> = (0..groups.len())
        .into_par_iter()
        .map(|b| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            let others: Vec<usize> = (0..b)
                .filter(|a| fresh(*a, b))
                .filter(|a| groups[*a].members.len() + groups[b].members.len() > 2)
                .collect();
            let turned = if others.is_empty() { Vec::new() } else { correlator.turned(&groups[b].plan) };
            let of_pair = |a: usize| {
                let two = Two { views, first: &groups[a], second: &groups[b], edge };
                (a, b, Finding::new(two.places(&correlator, &maps[a], &turned, &[]), edge, MAX_GROUP_CONTRADICTED))
            };
            let found = others.into_iter().map(of_pair).collect::<Vec<_>>();
            progress.update("joining groups", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok(found)
        })
        .collect::<Result<Vec<_>, _>>()?
        .into_iter()
        .flatten()
        .collect();
    for (a, b, finding) in &found {
        if finding.accepted().is_none() {
            tried.insert([names(&groups[*a]), names(&groups[*b])]);
        }
    }
    let accepted = found.iter().filter_map(|(a, b, finding)| Some((*a, *b, finding.accepted()?)));
    let best = accepted.max_by(|x, y| x.2.score().total_cmp(&y.2.score()));
    Ok(best.map(|(a, b, place)| (a, b, place.pose)))
}
