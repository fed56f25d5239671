//! From piles to leaves: which tetrahedra have more points than a leaf, the tree in which these are split, and the points of every leaf along Morton's
//! curve. If several points have the same place on the lattice, one is kept.

use super::piles::{Pile, Read};
use super::runs::{ByTetrahedron, Run, RunFile};
use super::splat::{BYTES, Splat};
use super::{LEAF_POINTS, Placement};
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::partition::{BISECTIONS, Partition};
use kilwa_geometry::tetra::max_level;
use kilwa_geometry::{Aabb, DiamondKey, LatticePoint, Tetra};
use kilwa_pack::chunk::splat;
use rustc_hash::FxHashMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many neighbours along the curve, on either side, are looked at for the spacing of points that is not known.
const WINDOW: usize = 8;
/// The spacing is the distance to so many-th nearest of them.
const NEAREST: usize = 4;
/// A spacing is at most so many times the median of its leaf.
const OUTLIER: f64 = 8.0;
/// Splats that are read before those at the same place are merged.
const DEDUPLICATED_FROM: usize = 1 << 20;

/// The leaves.
pub(super) struct Ingested {
    pub(super) tree: Partition,
    pub(super) leaves: ByTetrahedron,
    pub(super) points: u64,
    pub(super) duplicates: u64,
    /// Round all splats.
    pub(super) bounds: Aabb,
    /// How many splats have each radius.
    radii: Vec<u64>,
}

impl Ingested {
    /// The radius that half of the splats have at most, in steps.
    pub(super) fn median_radius(&self) -> f64 {
        let mut left = self.points.div_ceil(2);
        let code = (0u8..).zip(&self.radii).find(|(_, count)| {
            left = left.saturating_sub(**count);
            left == 0
        });
        code.map_or(0.0, |(code, _)| splat::radius(code))
    }
}

/// A pile that is sorted, and the diamonds in it that have to be split.
struct Sorted {
    run: Run,
    duplicates: u64,
    requests: Vec<DiamondKey>,
}

pub(super) fn leaves(read: &Read, place: &Placement, work: &Work<'_>) -> Result<Ingested, BuildError> {
    let sorted_file = RunFile::create(work.scratch, "sorted")?;
    let cost = |i: usize| read.piles[i].count * 3 * BYTES as u64;
    let done = AtomicU64::new(0);
    let total = read.piles.len() as u64;
    let sorted = work.run_jobs(read.piles.len(), work.memory / 2, cost, |i| {
        let sorted = sort(&read.piles[i], &read.file, &sorted_file, place)?;
        work.progress.update("sorting", done.fetch_add(1, Ordering::Relaxed) + 1, total);
        Ok(sorted)
    })?;
    work.scratch.remove("points")?;
    let mut requests: Vec<DiamondKey> = requests_above(&read.piles, &sorted, place);
    requests.extend(sorted.iter().flat_map(|s| s.requests.iter().copied()));
    let tree = Partition::from_split_requests(place.cube_log2, requests);
    let groups = groups(&read.piles, &tree);
    let leaves = ByTetrahedron::create(work.scratch, "leaves")?;
    let done = AtomicU64::new(0);
    let cost = |g: usize| groups[g].1.iter().map(|i| u64::from(sorted[*i].run.count) * 3 * BYTES as u64).sum();
    let total = groups.len() as u64;
    let parts = work.run_jobs(groups.len(), work.memory / 2, cost, |g| {
        let (node, piles) = &groups[g];
        let mut splats = Vec::new();
        for i in piles {
            sorted_file.read(sorted[*i].run, &mut splats)?;
        }
        if piles.len() > 1 {
            splats.sort_unstable_by_key(Splat::key);
        }
        let mut filled = Filled::new(&leaves, place);
        filled.divide(&tree, *node, splats)?;
        work.progress.update("filling leaves", done.fetch_add(1, Ordering::Relaxed) + 1, total);
        Ok((filled.points, filled.bounds, filled.radii))
    })?;
    work.scratch.remove("sorted")?;
    let duplicates = sorted.iter().map(|s| s.duplicates).sum();
    let mut all = Ingested { tree, leaves, points: 0, duplicates, bounds: Aabb::EMPTY, radii: vec![0; 256] };
    for (points, bounds, radii) in parts {
        all.points += points;
        all.bounds = all.bounds.union(&bounds);
        all.radii.iter_mut().zip(radii).for_each(|(sum, n)| *sum += n);
    }
    Ok(all)
}

/// Sort a pile, drop what lies at the same place as another, and find what has to be split in it.
fn sort(pile: &Pile, from: &RunFile, to: &RunFile, place: &Placement) -> Result<Sorted, BuildError> {
    let mut splats = Vec::new();
    let mut most = DEDUPLICATED_FROM;
    for run in &pile.runs {
        from.read(*run, &mut splats)?;
        // What lies at one place cannot be divided by space.
        if splats.len() > most {
            sort_and_merge(&mut splats);
            most = DEDUPLICATED_FROM.max(2 * splats.len());
        }
    }
    sort_and_merge(&mut splats);
    let duplicates = pile.count - splats.len() as u64;
    let mut requests = Vec::new();
    let run = to.append(&splats)?;
    request(&pile.tetra, &mut splats, place, &mut requests);
    Ok(Sorted { run, duplicates, requests })
}

/// In the order of their keys, one at each place.
fn sort_and_merge(splats: &mut Vec<Splat>) {
    splats.sort_unstable_by_key(Splat::key);
    splats.dedup_by_key(|s| s.position);
}

/// Whether a tetrahedron of so many points is to be split, and can be.
fn is_split(tetra: &Tetra, count: u64, place: &Placement) -> bool {
    count > LEAF_POINTS as u64 && tetra.level + BISECTIONS <= max_level(place.cube_log2)
}

/// The diamonds below a tetrahedron, and its own, that have to be split. The order of the points is lost.
fn request(tetra: &Tetra, splats: &mut [Splat], place: &Placement, requests: &mut Vec<DiamondKey>) {
    if !is_split(tetra, splats.len() as u64, place) {
        return;
    }
    requests.push(DiamondKey::of(tetra));
    let halves = tetra.children();
    let (first, second) = part(tetra, splats);
    for (half, splats) in halves.iter().zip([first, second]) {
        let quarters = half.children();
        let (first, second) = part(half, splats);
        request(&quarters[0], first, place, requests);
        request(&quarters[1], second, place, requests);
    }
}

/// The splats of both children.
fn part<'a>(tetra: &Tetra, splats: &'a mut [Splat]) -> (&'a mut [Splat], &'a mut [Splat]) {
    let plane = tetra.split_plane();
    let mut first = 0;
    for i in 0..splats.len() {
        if plane.child_of_sum(3 * splats[i].center().as_i64vec3()) == 0 {
            splats.swap(first, i);
            first += 1;
        }
    }
    splats.split_at_mut(first)
}

/// The diamonds above the piles that have to be split.
fn requests_above(piles: &[Pile], sorted: &[Sorted], place: &Placement) -> Vec<DiamondKey> {
    let mut counts: FxHashMap<[LatticePoint; 4], (Tetra, u64)> = FxHashMap::default();
    for (pile, sorted) in piles.iter().zip(sorted) {
        for tetra in &pile.above {
            counts.entry(tetra.v).or_insert((*tetra, 0)).1 += u64::from(sorted.run.count);
        }
    }
    let split = counts.values().filter(|(tetra, count)| is_split(tetra, *count, place));
    split.map(|(tetra, _)| DiamondKey::of(tetra)).collect()
}

/// The node of the tree that holds each pile, with the piles that it holds: the pile's own tetrahedron, or a leaf above it.
fn groups(piles: &[Pile], tree: &Partition) -> Vec<(u32, Vec<usize>)> {
    let mut groups: Vec<(u32, Vec<usize>)> = Vec::new();
    for (i, pile) in piles.iter().enumerate() {
        let way = pile.above.iter().chain([&pile.tetra]).skip(1);
        let first = pile.above.first().unwrap_or(&pile.tetra);
        let mut node = (0..6).find(|r| tree.tetrahedra[*r as usize].tetra == *first).unwrap_or(0);
        for next in way {
            let Some(children) = tree.tetrahedra[node as usize].children else { break };
            let Some(child) = children.into_iter().find(|c| tree.tetrahedra[*c as usize].tetra == *next) else { break };
            node = child;
        }
        match groups.last_mut() {
            Some((last, members)) if *last == node => members.push(i),
            _ => groups.push((node, vec![i])),
        }
    }
    groups
}

/// Gives leaves their splats.
struct Filled<'a> {
    leaves: &'a ByTetrahedron,
    place: &'a Placement,
    points: u64,
    bounds: Aabb,
    radii: Vec<u64>,
}

impl<'a> Filled<'a> {
    fn new(leaves: &'a ByTetrahedron, place: &'a Placement) -> Self {
        Self { leaves, place, points: 0, bounds: Aabb::EMPTY, radii: vec![0; 256] }
    }

    /// Divide splats that are in order among the leaves below a node; they stay in order.
    fn divide(&mut self, tree: &Partition, node: u32, splats: Vec<Splat>) -> Result<(), BuildError> {
        if splats.is_empty() {
            return Ok(());
        }
        let tetrahedron = &tree.tetrahedra[node as usize];
        let Some(children) = tetrahedron.children else { return self.leaf(tree, node, splats) };
        let halves = tetrahedron.tetra.children();
        let parts = parted(&tetrahedron.tetra, splats);
        let quarters = halves.iter().zip(parts).flat_map(|(half, splats)| parted(half, splats));
        let quarters: Vec<Vec<Splat>> = quarters.collect();
        children.into_iter().zip(quarters).try_for_each(|(child, splats)| self.divide(tree, child, splats))
    }

    fn leaf(&mut self, tree: &Partition, leaf: u32, mut splats: Vec<Splat>) -> Result<(), BuildError> {
        let [first, .., last] = tree.tetrahedra[leaf as usize].tetra.v;
        let edge = (last - first).as_dvec3().length();
        find_spacings(&mut splats, edge, self.place);
        for s in &splats {
            self.radii[usize::from(s.radius)] += 1;
            for p in splat::corners(s.center(), s.normal, s.radius) {
                self.bounds.add(p);
            }
        }
        self.points += splats.len() as u64;
        Ok(self.leaves.append(leaf, &splats)?)
    }
}

/// The splats of both children, in their order.
fn parted(tetra: &Tetra, splats: Vec<Splat>) -> [Vec<Splat>; 2] {
    let plane = tetra.split_plane();
    let (second, first) = splats.into_iter().partition(|s| plane.child_of_sum(3 * s.center().as_i64vec3()) == 1);
    [first, second]
}

/// Radii of splats whose spacing is not known: the distance to the fourth nearest of those that are near along the curve.
///
/// Where a leaf has too few points for that: as if they were spread evenly over a square on its longest edge.
fn find_spacings(splats: &mut [Splat], edge: f64, place: &Placement) {
    let spread = edge / (splats.len() as f64).sqrt() / 2.0;
    let near = |i: usize| {
        let near = &splats[i.saturating_sub(WINDOW)..(i + WINDOW + 1).min(splats.len())];
        let away = |s: &Splat| (s.center() - splats[i].center()).as_dvec3().length_squared();
        let mut distances: Vec<f64> = near.iter().map(away).collect();
        distances.sort_unstable_by(f64::total_cmp);
        // The first is the splat itself.
        distances.get(NEAREST).map(|squared| squared.sqrt())
    };
    let unknown = (0..splats.len()).filter(|i| splats[*i].is_unknown());
    let mut spacings: Vec<(usize, Option<f64>)> = unknown.map(|i| (i, near(i))).collect();
    spacings.sort_by(|a, b| a.1.unwrap_or(0.0).total_cmp(&b.1.unwrap_or(0.0)));
    let median = spacings.get(spacings.len() / 2).and_then(|(_, spacing)| *spacing).unwrap_or(0.0);
    let code = |(i, spacing): (usize, Option<f64>)| match spacing {
        Some(spacing) => (i, splat::code_of(spacing.min(OUTLIER * median)).min(place.largest)),
        None => (i, splat::code_of(spread).min(place.largest_estimated)),
    };
    let found: Vec<(usize, u8)> = spacings.into_iter().map(code).collect();
    for (i, code) in found {
        splats[i].radius = code;
        splats[i].be_finest();
    }
}
