//! Which chunks the view wants: the largest projected errors first, parents before children, until the target is
//! met or a memory budget is full.
//!
//! The order is monotone along the hierarchy (a child's priority is capped by its parents'), so what is wanted is
//! always closed under parents. A camera that glides wants for where it will be, too ([`PREDICTED_WEIGHT`]). Chunks that are already held count a little more ([`HELD_BONUS`]): at a camera that
//! trembles nothing is swapped, and at a camera at rest the wanted set can only stay as it is.

use crate::command::Budgets;
use crate::nodes::{Node, Nodes, Open, PerNode, State};
use crate::skip;
use crate::view::{Lens, Look, View};
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
    pub(crate) now: Lens,
    pub(crate) predicted: Option<Lens>,
    /// Metres of a lattice spacing.
    pub(crate) step: f64,
}

impl Cameras {
    /// Pixel error of what is shown while a chunk is not refined, weighted down where it is not seen, or not yet.
    fn priority(&self, index: u32, node: &Node) -> f64 {
        self.foreseen(node, node.entry.error, raw_priority(index, node, &self.now, self.step))
    }

    /// The larger of the priority now and of what the predicted camera will see, with this error in metres.
    fn foreseen(&self, node: &Node, error: f32, now: f64) -> f64 {
        let seen = self.predicted.as_ref().map(|p| p.look(&node.entry.sphere, f64::from(error) / self.step));
        seen.filter(|look| look.visible).map_or(now, |look| now.max(PREDICTED_WEIGHT * look.priority))
    }

    /// [`Wanted::may_want_below`].
    fn may_want_below(&self, index: u32, nodes: &Nodes) -> bool {
        let bound = nodes.get(index).map(|node| self.bound_below(index, node));
        bound.is_some_and(|bound| bound > self.now.view.target_pixels)
    }

    /// The priority that children of a chunk have at most.
    fn bound_below(&self, index: u32, node: &Node) -> f64 {
        if index == 0 {
            return f64::INFINITY;
        }
        let error = node.error_below();
        self.foreseen(node, error, self.now.look(&node.entry.sphere, f64::from(error) / self.step).priority)
    }
}

/// What the present view shows of the known nodes: each is looked at once a step at most, and not again while the view stays.
#[derive(Debug, Clone)]
pub(crate) struct Looks {
    lens: Lens,
    step: f64,
    /// With the error of the entry, metres.
    of: PerNode<Option<(Look, f32)>>,
}

impl Looks {
    /// Looks of this view, those of the last step kept where it had the same.
    pub(crate) fn renew(last: Option<Self>, lens: &Lens, step: f64, nodes: &Nodes) -> Self {
        let Some(mut last) = last else { return Self { lens: *lens, step, of: PerNode::new(nodes) } };
        // The target does not change what a ball looks like.
        let with_target = View { target_pixels: lens.view.target_pixels, ..last.lens.view };
        if with_target != lens.view {
            last.of.clear();
        }
        last.of.fit(nodes);
        Self { lens: *lens, ..last }
    }

    /// The look at the ball of a known node, and the error of its coarse form in metres.
    pub(crate) fn at(&mut self, nodes: &Nodes, index: u32) -> Option<(Look, f32)> {
        let slot = self.of.get_mut(nodes, index)?;
        if slot.is_none() {
            let entry = &nodes.get(index)?.entry;
            let look = self.lens.look(&entry.sphere, f64::from(entry.error) / self.step);
            *slot = Some((look, entry.error));
        }
        *slot
    }

    /// [`raw_priority`] of a known node.
    pub(crate) fn priority(&mut self, nodes: &Nodes, index: u32) -> f64 {
        if index == 0 { f64::INFINITY } else { self.at(nodes, index).map_or(0.0, |(look, _)| look.priority) }
    }

    pub(crate) fn lens(&self) -> &Lens {
        &self.lens
    }
}

/// The keys in ascending order; their lowest bits carry the payload. Everything is sorted as `u128`: another instance of
/// the sort would add 2 kB to the page's WebAssembly.
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
    fn new(nodes: &Nodes) -> Self {
        Self { by_index: Vec::new(), places: PerNode::new(nodes) }
    }

    /// One more, behind those that are there.
    fn push(&mut self, nodes: &Nodes, index: u32, rank: Rank) {
        self.by_index.push((index, rank));
        if let Some(slot) = self.places.get_mut(nodes, index) {
            *slot = self.by_index.len() as u32;
        }
    }

    pub(crate) fn get(&self, nodes: &Nodes, index: u32) -> Option<Rank> {
        let place = self.places.get(nodes, index).checked_sub(1)?;
        self.by_index.get(place as usize).map(|(_, rank)| *rank)
    }

    /// In order of the chunks' indices.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = (u32, Rank)> + '_ {
        self.by_index.iter().copied()
    }

    pub(crate) fn len(&self) -> usize {
        self.by_index.len()
    }
}

/// The outcome.
#[derive(Debug, Clone)]
pub(crate) struct Wanted {
    cameras: Cameras,
    /// Wanted chunks with their ranks.
    pub(crate) ranks: Ranks,
    /// Those of them that were not resident when this was decided, in order of their indices.
    pub(crate) missing: Vec<(u32, Rank)>,
    /// Encoded bytes of all of them.
    pub(crate) bytes: u64,
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
        &self.cameras.now.view
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
fn raw_priority(index: u32, node: &Node, lens: &Lens, step: f64) -> f64 {
    if index == 0 {
        return f64::INFINITY;
    }
    lens.look(&node.entry.sphere, f64::from(node.entry.error) / step).priority
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

/// What is known and held, and what there is room for.
pub(crate) struct Holding<'a> {
    pub(crate) nodes: &'a Nodes,
    pub(crate) budgets: &'a Budgets,
    pub(crate) scalars: u8,
    pub(crate) pinned: &'a [u32],
    pub(crate) head_bytes: u64,
}

impl Holding<'_> {
    /// Pinned chunks are the first ones.
    fn is_pinned(&self, index: u32) -> bool {
        (index as usize) < self.pinned.len()
    }

    /// Memory for chunks that are not pinned.
    fn headroom(&self) -> Headroom {
        let mut headroom = Headroom { gpu: self.budgets.gpu_bytes, cpu: self.budgets.cpu_bytes };
        for node in self.pinned.iter().filter_map(|&i| self.nodes.get(i)) {
            headroom.force(node, self.scalars);
        }
        headroom
    }
}

/// Wanted chunks in order of their indices, and the two flags of [`Wanted`].
struct Found {
    ranks: Ranks,
    limited: bool,
    cut_off: bool,
}

/// What the cameras want of the known part of the directory.
pub(crate) fn wanted(holding: &Holding<'_>, cameras: &Cameras, looks: &mut Looks) -> Wanted {
    let nodes = holding.nodes;
    let found = all(holding, cameras, looks).unwrap_or_else(|| most_urgent(holding, cameras, looks));
    let Found { ranks, limited, cut_off } = found;
    let mut missing = Vec::new();
    let mut bytes = 0;
    for (index, rank) in ranks.iter() {
        let Some(node) = nodes.get(index) else { continue };
        bytes += u64::from(node.entry.encoded_bytes);
        if node.state != State::Resident {
            missing.push((index, rank));
        }
    }
    let is_free = |index: u32, node: &Node| holding.is_pinned(index) || node.end() <= holding.head_bytes;
    let skipped = skip::skipped(nodes, &ranks, &missing, |index| cameras.may_want_below(index, nodes), is_free);
    Wanted { cameras: *cameras, ranks, missing, bytes, skipped, limited, cut_off }
}

/// How much a chunk counts by itself: more where it is held or drawn already.
fn own_priority(cameras: &Cameras, nodes: &Nodes, looks: &mut Looks, index: u32, node: &Node) -> f64 {
    let bonus = if node.is_held() || node.refined { HELD_BONUS } else { 1.0 };
    cameras.foreseen(node, node.entry.error, looks.priority(nodes, index)) * bonus
}

/// Everything that counts more than the target, where there is room for it.
fn all(holding: &Holding<'_>, cameras: &Cameras, looks: &mut Looks) -> Option<Found> {
    let nodes = holding.nodes;
    let mut headroom = holding.headroom();
    let target = cameras.now.view.target_pixels;
    let mut found = Found { ranks: Ranks::new(nodes), limited: false, cut_off: false };
    let mut open = Open::at_root(nodes);
    while let Some(index) = open.pop() {
        let Some(node) = nodes.get(index) else { continue };
        // Parents have been here before: what is wanted below them counts as much as the least of them at most.
        let least = node.entry.parents().try_fold(f64::INFINITY, |least, parent| {
            found.ranks.get(nodes, parent).map(|rank| least.min(rank.priority))
        });
        let Some(least) = least else { continue };
        let priority = if index == 0 { least } else { own_priority(cameras, nodes, looks, index, node).min(least) };
        let is_pinned = holding.is_pinned(index);
        let is_there = nodes.is_there(node.end());
        if priority <= target && (!is_pinned || !is_there) {
            continue;
        }
        let visible = looks.at(nodes, index).is_some_and(|(look, _)| look.visible);
        if !is_there {
            found.cut_off |= visible;
            continue; // So are all below it: nothing of them could be shown.
        }
        if !is_pinned && !headroom.take(node, holding.scalars) {
            return None;
        }
        found.ranks.push(nodes, index, Rank { visible, priority });
        open.extend(nodes.children(index));
    }
    Some(found)
}

/// What counts most of it, as much as there is room for.
fn most_urgent(holding: &Holding<'_>, cameras: &Cameras, looks: &mut Looks) -> Found {
    let nodes = holding.nodes;
    let mut headroom = holding.headroom();
    let target = cameras.now.view.target_pixels;
    let (mut limited, mut cut_off) = (false, false);
    let mut ranks = Vec::new();
    let mut parents_in = PerNode::<u8>::new(nodes);
    let mut full = false;
    let mut heap = BinaryHeap::from([Candidate { priority: f64::INFINITY, index: 0 }]);
    while let Some(Candidate { priority, index }) = heap.pop() {
        let Some(node) = nodes.get(index) else { continue };
        let visible = looks.at(nodes, index).is_some_and(|(look, _)| look.visible);
        if !nodes.is_there(node.end()) {
            cut_off |= visible && priority > target;
            continue; // So are all below it: nothing of them could be shown.
        }
        if !holding.is_pinned(index) {
            if priority <= target {
                continue;
            }
            full = full || !headroom.take(node, holding.scalars);
            if full {
                limited |= looks.priority(nodes, index) > target;
                continue;
            }
        }
        ranks.push((index, Rank { visible, priority }));
        for &child in nodes.children(index) {
            let Some((node, count)) = nodes.get(child).zip(parents_in.get_mut(nodes, child)) else { continue };
            *count += 1;
            if *count == node.parent_count {
                let own = own_priority(cameras, nodes, looks, child, node);
                heap.push(Candidate { priority: own.min(priority), index: child });
            }
        }
    }
    let keys = (0..).zip(&ranks).map(|(place, (index, _)): (u128, _)| u128::from(*index) << 64 | place);
    let mut by_index = Ranks::new(nodes);
    for (index, rank) in sorted(keys).filter_map(|key| ranks.get(key as usize).copied()) {
        by_index.push(nodes, index, rank);
    }
    Found { ranks: by_index, limited, cut_off }
}
