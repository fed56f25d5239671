//! The cut that is drawn: refined from the root while chunks are resident.

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
    /// Refined entries, closed under parents, every one resident. Updates what hysteresis remembers.
    pub(crate) fn refine(&mut self, view: &View) -> BTreeSet<u32> {
        let step = self.header.lattice.step();
        let mut refined = BTreeSet::new();
        let mut parents_in = BTreeMap::<u32, usize>::new();
        let mut queue = BTreeSet::from([0u32]);
        while let Some(index) = queue.pop_first() {
            let Some(node) = self.nodes.get(index) else { continue };
            let bar = if node.refined { view.target_pixels / HELD_BONUS } else { view.target_pixels };
            if node.state != State::Resident || raw_priority(index, node, view, step) <= bar {
                continue;
            }
            refined.insert(index);
            for &child in self.nodes.children(index) {
                let Some(node) = self.nodes.get(child) else { continue };
                let count = parents_in.entry(child).or_insert(0);
                *count += 1;
                if *count == Nodes::parent_count(node) {
                    queue.insert(child);
                }
            }
        }
        for &index in &self.held {
            if let Some(node) = self.nodes.get_mut(index) {
                node.refined = refined.contains(&index);
            }
        }
        refined
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
                    Some(None) => (node.entry.sphere, node.entry.error),
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
