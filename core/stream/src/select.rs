//! Which chunks the view wants: the largest projected errors first, parents before children, until the target is
//! met or a memory budget is full.
//!
//! The order is monotone along the hierarchy (a child's priority is capped by its parents'), so what is wanted is
//! always closed under parents. A camera that glides wants for where it will be, too ([`PREDICTED_WEIGHT`]). Chunks that are already held count a little more ([`HELD_BONUS`]): at a camera that
//! trembles nothing is swapped, and at a camera at rest the wanted set can only stay as it is.

use crate::command::Budgets;
use crate::nodes::{Node, Nodes, PerNode};
use crate::skip;
use crate::view::View;
use std::collections::BinaryHeap;

/// How much more a chunk counts that is already held, and how much farther one that is drawn stays drawn.
pub(crate) const HELD_BONUS: f64 = 1.2;

/// Weight of what the camera will see if it continues as it does: prefetched, twice as coarse.
const PREDICTED_WEIGHT: f64 = 0.5;

/// Levels that stay loaded whatever the view, if they take up no more than an eighth of the budgets.
const PINNED_LEVEL: u8 = 1;
const PINNED_SHARE: u64 = 8;

/// How urgently a chunk is wanted: first what can be seen, then by priority.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rank {
    /// It may lie in the view.
    pub(crate) visible: bool,
    pub(crate) priority: f64,
}

impl Rank {
    /// Greater is more urgent. Along the hierarchy it never grows.
    pub(crate) fn total_cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.visible.cmp(&other.visible).then(self.priority.total_cmp(&other.priority))
    }

    /// A key of [`sorted`]: the most urgent first, then the smaller number.
    pub(crate) fn key(&self, number: u64) -> u128 {
        let urgency = u64::from(self.visible) << 63 | bits(self.priority);
        u128::from(!urgency) << 64 | u128::from(number)
    }
}

/// The cameras that chunks are wanted for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cameras {
    pub(crate) view: View,
    pub(crate) predicted: Option<View>,
    /// Metres of a lattice spacing.
    pub(crate) step: f64,
}

impl Cameras {
    /// Pixel error of what is shown while a chunk is not refined, weighted down where it is not seen, or not yet.
    fn priority(&self, index: u32, node: &Node) -> f64 {
        let now = raw_priority(index, node, &self.view, self.step);
        let seen = self.predicted.as_ref().filter(|p| p.may_see(&node.entry.sphere));
        seen.map_or(now, |p| now.max(PREDICTED_WEIGHT * raw_priority(index, node, p, self.step)))
    }

    /// [`Wanted::may_want_below`].
    fn may_want_below(&self, index: u32, nodes: &Nodes) -> bool {
        let bound = nodes.get(index).map(|node| self.bound_below(index, node));
        bound.is_some_and(|bound| bound > self.view.target_pixels)
    }

    /// The priority that children of a chunk have at most.
    fn bound_below(&self, index: u32, node: &Node) -> f64 {
        if index == 0 {
            return f64::INFINITY;
        }
        let error = f64::from(node.error_below()) / self.step;
        let now = self.view.priority(&node.entry.sphere, error);
        let seen = self.predicted.as_ref().filter(|p| p.may_see(&node.entry.sphere));
        seen.map_or(now, |p| now.max(PREDICTED_WEIGHT * p.priority(&node.entry.sphere, error)))
    }
}

/// The positions of the values, in ascending order of the values. Everything is sorted as `u128`: another instance of
/// the sort would add 2 kB to the page's WebAssembly.
pub(crate) fn in_order(values: impl Iterator<Item = u32>) -> Vec<usize> {
    let keys = (0..).zip(values).map(|(place, value): (u128, u32)| u128::from(value) << 64 | place);
    sorted(keys).map(|key| key as usize).collect()
}

/// The keys in ascending order; their lowest bits carry the payload.
pub(crate) fn sorted(keys: impl Iterator<Item = u128>) -> std::vec::IntoIter<u128> {
    let mut keys: Vec<u128> = keys.collect();
    keys.sort_unstable();
    keys.into_iter()
}

/// The bits of a nonnegative number, which sort in the same order.
pub(crate) fn bits(x: f64) -> u64 {
    x.max(0.0).to_bits()
}

/// The wanted chunks with their ranks.
#[derive(Debug, Clone)]
pub(crate) struct Ranks {
    /// In order of their indices.
    by_index: Vec<(u32, Rank)>,
    /// 1 + the place in `by_index`, 0 for a chunk that is not wanted.
    places: PerNode<u32>,
}

impl Ranks {
    fn new(ranks: &[(u32, Rank)], nodes: &Nodes) -> Self {
        let indices = ranks.iter().map(|(index, _)| *index);
        let by_index: Vec<(u32, Rank)> = in_order(indices).into_iter().filter_map(|k| ranks.get(k).copied()).collect();
        let mut places = PerNode::new(nodes);
        for (place, (index, _)) in (1..).zip(&by_index) {
            if let Some(slot) = places.get_mut(nodes, *index) {
                *slot = place;
            }
        }
        Self { by_index, places }
    }

    pub(crate) fn get(&self, nodes: &Nodes, index: u32) -> Option<Rank> {
        let place = self.places.get(nodes, index).checked_sub(1)?;
        self.by_index.get(place as usize).map(|(_, rank)| *rank)
    }

    /// In order of the chunks' indices.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = (u32, Rank)> + '_ {
        self.by_index.iter().copied()
    }
}

/// The outcome.
#[derive(Debug, Clone)]
pub(crate) struct Wanted {
    cameras: Cameras,
    /// Wanted chunks, most urgent first.
    pub(crate) order: Vec<u32>,
    /// The same with their ranks.
    pub(crate) ranks: Ranks,
    /// Those of them that the picture does not need ([`crate::skip`]).
    skipped: PerNode<bool>,
    /// Something above the target did not fit.
    pub(crate) limited: bool,
    /// Something above the target that can be seen lies beyond the end of a file that is cut off.
    pub(crate) cut_off: bool,
}

impl Wanted {
    pub(crate) fn raw_priority(&self, index: u32, node: &Node) -> f64 {
        self.cameras.priority(index, node)
    }

    /// The view that they are wanted for.
    pub(crate) fn view(&self) -> &View {
        &self.cameras.view
    }

    pub(crate) fn contains(&self, nodes: &Nodes, index: u32) -> bool {
        self.ranks.get(nodes, index).is_some()
    }

    /// Whether the picture needs it.
    pub(crate) fn is_visible(&self, nodes: &Nodes, index: u32) -> bool {
        self.ranks.get(nodes, index).is_some_and(|r| r.visible) && !self.skipped.get(nodes, index)
    }

    /// Whether a child of this chunk may be wanted, by what the directory states before the children are known.
    pub(crate) fn may_want_below(&self, index: u32, nodes: &Nodes) -> bool {
        self.cameras.may_want_below(index, nodes)
    }

    /// How urgently a chunk is asked for: one that the picture does not need comes with those beside the picture.
    pub(crate) fn urgency(&self, nodes: &Nodes, index: u32, rank: Rank) -> Rank {
        Rank { visible: rank.visible && !self.skipped.get(nodes, index), ..rank }
    }
}

/// An entry of the frontier; ordered by priority, then the coarser (smaller) index.
struct Candidate {
    priority: f64,
    index: u32,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.priority.total_cmp(&other.priority).then(other.index.cmp(&self.index))
    }
}

/// Running sums against the two memory budgets.
struct Headroom {
    gpu: u64,
    cpu: u64,
}

impl Headroom {
    /// Take what is there, and more: nothing is left then.
    fn force(&mut self, node: &Node, scalars: u8) {
        self.gpu = self.gpu.saturating_sub(node.gpu_bytes());
        self.cpu = self.cpu.saturating_sub(node.cpu_bytes(scalars));
    }

    fn take(&mut self, node: &Node, scalars: u8) -> bool {
        let (gpu, cpu) = (node.gpu_bytes(), node.cpu_bytes(scalars));
        if gpu > self.gpu || cpu > self.cpu {
            return false;
        }
        self.gpu -= gpu;
        self.cpu -= cpu;
        true
    }
}

/// Raw priority of a known chunk: weighted pixel error of what is shown while it is not refined.
pub(crate) fn raw_priority(index: u32, node: &Node, view: &View, step: f64) -> f64 {
    if index == 0 {
        return f64::INFINITY;
    }
    let priority = view.priority(&node.entry.sphere, f64::from(node.entry.error) / step);
    if priority.is_nan() { 0.0 } else { priority }
}

/// The pinned chunks: the first ones in directory order, closed under parents.
pub(crate) fn pinned(nodes: &Nodes, budgets: &Budgets, scalars: u8) -> Vec<u32> {
    let mut headroom = Headroom { gpu: budgets.gpu_bytes / PINNED_SHARE, cpu: budgets.cpu_bytes / PINNED_SHARE };
    let mut pinned: Vec<u32> = Vec::new();
    for (index, node) in nodes.iter() {
        let next = index as usize == pinned.len() && node.entry.level <= PINNED_LEVEL;
        let fits = next && nodes.is_there(node.end()) && headroom.take(node, scalars);
        if !fits && (index > 0 || !nodes.is_there(node.end())) {
            break;
        }
        pinned.push(index); // The root goes in even where it is larger than the budget: without it there is nothing.
    }
    pinned
}

/// What the cameras want of the known part of the directory.
pub(crate) fn wanted(
    nodes: &Nodes,
    cameras: &Cameras,
    budgets: &Budgets,
    scalars: u8,
    pinned: &[u32],
    head_bytes: u64,
) -> Wanted {
    let mut headroom = Headroom { gpu: budgets.gpu_bytes, cpu: budgets.cpu_bytes };
    for node in pinned.iter().filter_map(|&i| nodes.get(i)) {
        headroom.force(node, scalars);
    }
    let target = cameras.view.target_pixels;
    let (mut limited, mut cut_off) = (false, false);
    let mut is_pinned = PerNode::<bool>::new(nodes);
    for &index in pinned {
        if let Some(slot) = is_pinned.get_mut(nodes, index) {
            *slot = true;
        }
    }
    let mut ranks = Vec::new();
    let mut parents_in = PerNode::<u8>::new(nodes);
    let mut full = false;
    let mut heap = BinaryHeap::from([Candidate { priority: f64::INFINITY, index: 0 }]);
    while let Some(Candidate { priority, index }) = heap.pop() {
        let Some(node) = nodes.get(index) else { continue };
        let visible = cameras.view.may_see(&node.entry.sphere);
        if !nodes.is_there(node.end()) {
            cut_off |= visible && priority > target;
            continue; // So are all below it: nothing of them could be shown.
        }
        if !is_pinned.get(nodes, index) {
            if priority <= target {
                continue;
            }
            full = full || !headroom.take(node, scalars);
            if full {
                limited |= raw_priority(index, node, &cameras.view, cameras.step) > target;
                continue;
            }
        }
        ranks.push((index, Rank { visible, priority }));
        for &child in nodes.children(index) {
            let Some((node, count)) = nodes.get(child).zip(parents_in.get_mut(nodes, child)) else { continue };
            *count += 1;
            if *count == node.parent_count {
                let bonus = if node.is_held() || node.refined { HELD_BONUS } else { 1.0 };
                let own = cameras.priority(child, node) * bonus;
                heap.push(Candidate { priority: own.min(priority), index: child });
            }
        }
    }
    let keys = ranks.iter().map(|(index, rank)| rank.key(u64::from(*index)));
    let order = sorted(keys).map(|key| key as u32).collect();
    let ranks = Ranks::new(&ranks, nodes);
    let is_free = |index: u32, node: &Node| is_pinned.get(nodes, index) || node.end() <= head_bytes;
    let skipped = skip::skipped(nodes, &ranks, |index| cameras.may_want_below(index, nodes), is_free);
    Wanted { cameras: *cameras, order, ranks, skipped, limited, cut_off }
}
