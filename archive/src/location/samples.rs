//! Sampled values of a scalar channel, with the positions of their vertices, and groups of values that are checked separately: one missing value
//! (0, -9999, 1e30) among millions of eastings must not hide the others.
//!
//! The groups are the values between wide gaps, and the middle of all values; each is checked as it is, and again without its most frequent value.
//! Values far from the linear fit of a group are left out.

use super::channels::Sums;
use glam::DVec3;
use std::collections::HashMap;

/// Every n-th value of a channel is kept, with n chosen so that at least this many, and fewer than twice as many, are kept of a large channel.
pub(super) const KEPT: u64 = 16_384;
/// A gap of this share of the range separates groups.
const GAP: f64 = 0.25;
/// Minimum share of the values, and minimum number of values, in a group.
const SHARE: f64 = 0.005;
const FEWEST: usize = 24;
/// Values whose residual is this many times the median residual are left out, as long as this share of the group remains, and at most this many times.
const FAR: f64 = 6.0;
const LEFT: f64 = 0.5;
const ROUNDS: usize = 6;

/// A value, and the position of its vertex in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub(super) at: DVec3,
    pub(super) value: f64,
}

/// Values that belong together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Group {
    /// Smallest and largest value.
    pub(super) range: [f64; 2],
    /// Share of the variance that a linear function of the position explains.
    pub(super) explained: f64,
    /// Whether wide gaps separate the group from all other values.
    pub(super) is_apart: bool,
}

impl Group {
    /// Whether the group is a single class, count or mark: a small whole number, which is no coordinate.
    pub(super) fn is_mark(&self) -> bool {
        let [low, high] = self.range;
        low == high && is_mark(low)
    }
}

/// Whether a value is a whole number smaller than map coordinates.
pub(super) fn is_mark(value: f64) -> bool {
    value.fract() == 0.0 && value.abs() < super::MAP
}

/// The groups of a channel's values.
pub(super) fn groups(samples: &[Sample]) -> Vec<Group> {
    let mut sorted = samples.to_vec();
    sorted.sort_by(|a, b| a.value.total_cmp(&b.value));
    let fewest = FEWEST.max((sorted.len() as f64 * SHARE) as usize);
    if sorted.len() < fewest {
        return Vec::new();
    }
    let parts = separated(&sorted, fewest).into_iter().map(|part| (part, part.len() < sorted.len()));
    let mut groups = Vec::new();
    for (part, is_apart) in parts.chain(middle(&sorted).map(|part| (part, false))) {
        let frequent = most_frequent(part);
        let others: Vec<Sample> = part.iter().copied().filter(|s| s.value.to_bits() != frequent).collect();
        groups.extend(group(part, is_apart));
        if others.len() >= fewest && others.len() < part.len() {
            groups.extend(group(&others, is_apart));
        }
    }
    groups
}

/// The parts that remain when the values are split at wide gaps again and again. Parts with too few values are dropped.
fn separated(sorted: &[Sample], fewest: usize) -> Vec<&[Sample]> {
    let (mut open, mut done) = (vec![sorted], Vec::new());
    while let Some(part) = open.pop().filter(|p| !p.is_empty()) {
        let [Some(first), Some(last)] = [part.first(), part.last()] else { continue };
        // Halved, so that the range of the largest numbers does not overflow.
        let range = last.value / 2.0 - first.value / 2.0;
        let gaps = part.iter().zip(part.iter().skip(1)).map(|(a, b)| b.value / 2.0 - a.value / 2.0).enumerate();
        let widest = gaps.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, gap)| range > 0.0 && *gap >= GAP * range);
        match widest.and_then(|(at, _)| part.split_at_checked(at + 1)) {
            Some((low, high)) => open.extend([low, high].into_iter().filter(|p| p.len() >= fewest)),
            None => done.push(part),
        }
    }
    done
}

/// The shortest range that contains half of the values, and the values near it.
fn middle(sorted: &[Sample]) -> Option<&[Sample]> {
    let half = sorted.len() / 2;
    let stretches = sorted.iter().zip(sorted.get(half..)?);
    let width = |(a, b): &(&Sample, &Sample)| b.value / 2.0 - a.value / 2.0;
    let (low, high) = stretches.min_by(|a, b| width(a).total_cmp(&width(b)))?;
    let reach = 4.0 * (high.value - low.value);
    let from = sorted.partition_point(|s| s.value < low.value - reach);
    let to = sorted.partition_point(|s| s.value <= high.value + reach);
    sorted.get(from..to).filter(|part| part.len() < sorted.len())
}

/// The most frequent value, as bits.
fn most_frequent(part: &[Sample]) -> u64 {
    let mut counts: HashMap<u64, usize> = HashMap::new();
    for sample in part {
        *counts.entry(sample.value.to_bits()).or_default() += 1;
    }
    counts.into_iter().max_by_key(|(bits, count)| (*count, *bits)).map_or(0, |(bits, _)| bits)
}

/// A group with the best linear fit of its values, found by leaving out values far from the fit.
fn group(part: &[Sample], is_apart: bool) -> Option<Group> {
    let range =
        part.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], s| [low.min(s.value), high.max(s.value)]);
    let (mut kept, mut explained) = (part.to_vec(), 0.0f64);
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = part.iter().fold(empty, |(min, max), s| (min.min(s.at), max.max(s.at)));
    // glam's midpoint adds first, which overflows where this does not.
    let centre = DVec3::from([0, 1, 2].map(|k| f64::midpoint(min[k], max[k])));
    let half = ((max - min) / 2.0).max_element().max(f64::MIN_POSITIVE);
    let local = |s: &Sample| (s.at - centre) / half;
    for _ in 0..ROUNDS {
        let [low, high] =
            kept.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], s| [a.min(s.value), b.max(s.value)]);
        let scale = [f64::midpoint(low, high), (high / 2.0 - low / 2.0).max(f64::MIN_POSITIVE)];
        let mut sums = Sums::default();
        for s in &kept {
            sums.add(local(s), s.value, &scale);
        }
        explained = explained.max(sums.explained());
        let fit = sums.fit();
        let residual = |s: &Sample| {
            let DVec3 { x, y, z } = local(s);
            ((s.value - scale[0]) / scale[1] - (fit[0] + fit[1] * x + fit[2] * y + fit[3] * z)).abs()
        };
        let mut all: Vec<f64> = kept.iter().map(residual).collect();
        all.sort_by(f64::total_cmp);
        let limit = FAR * all.get(all.len() / 2)?.max(1e-7);
        let near: Vec<Sample> = kept.iter().copied().filter(|s| residual(s) <= limit).collect();
        if near.len() == kept.len() || (near.len() as f64) < LEFT * part.len() as f64 {
            break;
        }
        kept = near;
    }
    // A part with a single value is a mark for missing or saturated values.
    let is_apart = is_apart && range[0] < range[1];
    Some(Group { range, explained, is_apart })
}
