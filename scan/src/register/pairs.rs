//! The pairs of stations: their candidate poses, and which pairs contradict others.

use super::ambiguous::ELSEWHERE;
use super::doubt::{Doubt, Finding, Limits, MIN_AGREE, MIN_AGREEMENT, NEARBY, is_sound};
use super::group::{CandidatePose, Group, Two, is_same};
use super::known::Known;
use super::view::View;
use crate::ScanError;
use crate::import::Progress;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::correlate::{Correlator, Spectrum};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};

/// Maximum share of contradicted planes where a station is compared with itself.
const MAX_SYMMETRY_CONTRADICTED: f64 = 0.1;
/// Cells along each side of the maps of single stations.
const SIDE: usize = 128;
/// Maximum number of copies stored of what a station sees. In a hall of identical columns there are many, and a few are enough to show that a pose is not unique.
const MAX_COPIES: usize = 24;

/// Pairs of stations, and the stations that must not be joined with others.
pub(super) struct Pairs {
    pub(super) found: BTreeMap<(usize, usize), Finding>,
    /// Poses in which each station coincides with itself.
    pub(super) symmetries: Vec<Vec<Pose>>,
    /// Poses that lead from what each station sees to a copy of it that another station sees.
    pub(super) copies: Vec<Vec<Pose>>,
    pub(super) refused: BTreeSet<usize>,
}

impl Pairs {
    /// If a station fits another in several poses, the other sees several copies of what it sees. A third station next to it may be in
    /// another copy.
    fn add_copies(&mut self, edge: f64) {
        for ((a, b), finding) in &self.found {
            if finding.doubt != Some(Doubt::Ambiguous) {
                continue;
            }
            let sound: Vec<Pose> =
                finding.candidates.iter().filter(|place| is_sound(place)).map(|place| place.pose).collect();
            for (k, one) in sound.iter().enumerate() {
                for (_, other) in sound.iter().enumerate().filter(|(other, _)| *other != k) {
                    add_new(&mut self.copies[*a], other.inverse().then(*one), edge);
                    add_new(&mut self.copies[*b], other.then(one.inverse()), edge);
                }
            }
        }
    }

    /// Stop using a station.
    pub(super) fn refuse(&mut self, station: usize) {
        self.refused.insert(station);
        for ((a, b), finding) in &mut self.found {
            if (*a == station || *b == station) && finding.doubt.is_none() {
                finding.doubt = Some(Doubt::Ambiguous);
            }
        }
    }
}

/// Adds a pose unless the list is full or already contains nearly the same pose.
fn add_new(poses: &mut Vec<Pose>, pose: Pose, edge: f64) {
    if poses.len() < MAX_COPIES && !poses.iter().any(|other| is_same(*other, pose, edge)) {
        poses.push(pose);
    }
}

/// A pair of stations, and what was found for it.
type Found = ((usize, usize), Finding);

/// What is found for every pair of stations.
pub(super) fn pairs(
    views: &[View],
    singles: &[Group],
    edge: f64,
    reach: f64,
    known: &Known,
    progress: &(dyn Progress + Sync),
) -> Result<Pairs, ScanError> {
    let correlator = Correlator::new(reach, SIDE);
    let maps: Vec<Spectrum> = singles.par_iter().map(|single| correlator.upright(&single.plan)).collect();
    let symmetries = symmetries(views, singles, edge, &correlator, &maps, progress)?;
    let (done, total) = (AtomicU64::new(0), (views.len() * (views.len() - 1) / 2) as u64);
    let of_second = |b: usize| -> Result<Vec<Found>, ScanError> {
        let turned = correlator.turned(&singles[b].plan);
        let of_pair = |a: usize| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            let two = Two { views, first: &singles[a], second: &singles[b], edge };
            let finding = if let Some(pose) = known.controlled.get(&(a, b)) {
                Finding { candidates: vec![two.given(*pose)], doubt: None }
            } else {
                let start = known.relative(a, b);
                let allows = |pose: Pose| known.allows(&singles[a], &singles[b], pose);
                let mut candidates = two.candidates(&correlator, &maps[a], &turned, start.as_slice(), allows);
                if let Some(best) = candidates.first().map(|best| best.pose) {
                    let of_first = symmetries[a].iter().map(|turn| best.then(*turn));
                    let of_second = symmetries[b].iter().map(|turn| turn.then(best));
                    two.add(&mut candidates, of_first.chain(of_second));
                }
                let limits = if known.are_known(a, b) { Limits::KNOWN } else { Limits::PAIR };
                Finding::among(candidates, edge, limits, |place| allows(place.pose))
            };
            progress.update("comparing stations", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok(((a, b), finding))
        };
        (0..b).filter(|a| !(known.is_fixed(*a) && known.is_fixed(b))).map(of_pair).collect()
    };
    let found: Vec<_> = (0..views.len()).into_par_iter().map(of_second).collect::<Result<_, _>>()?;
    let copies = vec![Vec::new(); views.len()];
    let mut pairs =
        Pairs { found: found.into_iter().flatten().collect(), symmetries, copies, refused: BTreeSet::new() };
    pairs.add_copies(edge);
    Ok(pairs)
}

/// The poses in which each station coincides with itself: a station registered to it fits there as well.
fn symmetries(
    views: &[View],
    singles: &[Group],
    edge: f64,
    correlator: &Correlator,
    maps: &[Spectrum],
    progress: &(dyn Progress + Sync),
) -> Result<Vec<Vec<Pose>>, ScanError> {
    let of_station = |(single, map): (&Group, &Spectrum)| -> Result<Vec<Pose>, ScanError> {
        if progress.is_stopped() {
            return Err(ScanError::Stopped);
        }
        let two = Two { views, first: single, second: single, edge };
        let fits = |place: &CandidatePose| {
            let v = &place.verdict;
            let (angle, distance) = place.pose.difference(Pose::IDENTITY);
            (distance > NEARBY * edge || angle > ELSEWHERE)
                && v.agree >= MIN_AGREE
                && v.agreement() >= MIN_AGREEMENT
                && v.contradicted() <= MAX_SYMMETRY_CONTRADICTED
        };
        let candidates = two.others(correlator, map, &correlator.turned(&single.plan));
        Ok(candidates.iter().filter(|place| fits(place)).map(|place| place.pose).collect())
    };
    singles.par_iter().zip(maps).map(of_station).collect()
}

/// Discard pairs that contradict others: the three relative poses around a triangle must close. A pair is discarded if more of its triangles fail to close
/// than close; all three pairs are discarded if it is unclear which of them is wrong.
pub(super) fn drop_inconsistent(pairs: &mut BTreeMap<(usize, usize), Finding>, known: &Known, edge: f64) {
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
