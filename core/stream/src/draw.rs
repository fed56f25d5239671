//! The cut that is drawn: the finest that the view asks for and that what is resident can show.

use crate::command::DrawPatch;
use crate::nodes::{Nodes, State};
use crate::select::{HELD_BONUS, raw_priority};
use crate::streamer::Streamer;
use crate::view::View;
use kilwa_pack::NO_DIAMOND;
use std::collections::{BTreeMap, BTreeSet};

/// What the cut is good for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quality {
    pub(crate) pixels: f64,
    pub(crate) metres: f64,
    pub(crate) triangles: u64,
}

impl Streamer {
    /// The finest cut that can be drawn, no finer than the view asks for: closed under parents, and every entry of it is resident
    /// or all of its children are in the cut. It becomes [`Streamer::refined`]; hysteresis remembers it.
    pub(crate) fn refine(&mut self, view: &View) {
        let asked = self.asked_for(view);
        let refined = self.drawable(asked);
        for index in std::mem::take(&mut self.refined) {
            if let Some(node) = self.nodes.get_mut(index) {
                node.refined = false;
            }
        }
        for &index in &refined {
            if let Some(node) = self.nodes.get_mut(index) {
                node.refined = true;
            }
        }
        self.refined = refined;
    }

    /// Entries that the view asks to be refined, closed under parents, as far as resident or listed nodes reach.
    fn asked_for(&self, view: &View) -> BTreeSet<u32> {
        let step = self.header.lattice.step();
        let mut asked = BTreeSet::new();
        let mut parents_in = BTreeMap::<u32, usize>::new();
        let mut queue = BTreeSet::from([0u32]);
        while let Some(index) = queue.pop_first() {
            let Some(node) = self.nodes.get(index) else { continue };
            let bar = if node.refined { view.target_pixels / HELD_BONUS } else { view.target_pixels };
            let is_there = node.state == State::Resident || index > 0 && self.nodes.whole_family(index).is_some();
            if !is_there || raw_priority(index, node, view, step) <= bar {
                continue;
            }
            asked.insert(index);
            for &child in self.nodes.children(index) {
                let Some(node) = self.nodes.get(child) else { continue };
                let count = parents_in.entry(child).or_insert(0);
                *count += 1;
                if *count == Nodes::parent_count(node) {
                    queue.insert(child);
                }
            }
        }
        asked
    }

    /// Without the entries that are not resident while a child is not refined, and without what lies below those, until none is left: the
    /// union of two cuts that can be drawn can be drawn, so there is one largest.
    fn drawable(&self, mut cut: BTreeSet<u32>) -> BTreeSet<u32> {
        let is_resident = |i: u32| self.nodes.get(i).is_some_and(|n| n.state == State::Resident);
        let is_replaced = |cut: &BTreeSet<u32>, i: u32| {
            self.nodes.whole_family(i).is_some_and(|children| children.iter().all(|c| cut.contains(c)))
        };
        let mut doubtful: Vec<u32> = cut.iter().copied().filter(|&i| !is_resident(i)).collect();
        while let Some(index) = doubtful.pop() {
            if is_resident(index) || is_replaced(&cut, index) || !cut.contains(&index) {
                continue;
            }
            let mut falling = vec![index];
            while let Some(index) = falling.pop() {
                if !cut.remove(&index) {
                    continue;
                }
                falling.extend(self.nodes.children(index).iter().filter(|c| cut.contains(c)));
                let parents = self.nodes.get(index).into_iter().flat_map(|n| n.entry.parents());
                doubtful.extend(parents.filter(|&p| !is_resident(p)));
            }
        }
        cut
    }

    /// The patches of the cut, and its quality in the view.
    pub(crate) fn cut(&self, view: &View, refined: &BTreeSet<u32>) -> (Vec<DrawPatch>, Quality) {
        let mut draw = Vec::new();
        let mut quality = Quality { pixels: 0.0, metres: 0.0, triangles: 0 };
        if refined.is_empty() {
            return (draw, Quality { pixels: f64::INFINITY, metres: f64::INFINITY, triangles: 0 });
        }
        let step = self.header.lattice.step();
        let mut frontier = BTreeSet::new();
        for &chunk in refined {
            let Some(node) = self.nodes.get(chunk) else { continue };
            frontier.extend(self.nodes.children(chunk).iter().filter(|c| !refined.contains(c)));
            for (number, patch) in node.patches.iter().enumerate() {
                if patch.diamond != NO_DIAMOND && refined.contains(&patch.diamond) {
                    continue;
                }
                let diamond = if patch.diamond == NO_DIAMOND { None } else { Some(patch.diamond) };
                let known = diamond.map(|d| self.nodes.get(d));
                let (sphere, error) = match known {
                    None => (node.box_sphere(), 0.0),
                    Some(Some(d)) => (d.entry.sphere, d.entry.error),
                    Some(None) => (node.entry.sphere, node.error_below()),
                };
                let visible = view.may_see(&sphere);
                if visible {
                    quality.triangles += u64::from(patch.count);
                    quality.metres = quality.metres.max(f64::from(error));
                    if error > 0.0 {
                        quality.pixels = quality.pixels.max(view.pixel_error(&sphere, f64::from(error) / step));
                    }
                }
                draw.push(DrawPatch {
                    chunk,
                    patch: number as u32,
                    first: patch.first,
                    count: patch.count,
                    diamond: patch.diamond,
                    level: node.entry.level,
                    error,
                    visible,
                });
            }
        }
        // A coarse form may be empty (islands that were pruned): its error counts although no patch shows it.
        for node in frontier.iter().filter_map(|&c| self.nodes.get(c)) {
            if view.may_see(&node.entry.sphere) {
                let error = f64::from(node.entry.error);
                quality.metres = quality.metres.max(error);
                quality.pixels = quality.pixels.max(view.pixel_error(&node.entry.sphere, error / step));
            }
        }
        (draw, quality)
    }
}
