//! The cut that is drawn: the finest that the view asks for and that what is resident can show.

use crate::command::DrawPatch;
use crate::nodes::{PerNode, State};
use crate::select::{HELD_BONUS, in_order, raw_priority};
use crate::streamer::Streamer;
use crate::view::View;
use kilwa_geometry::Sphere;
use kilwa_pack::NO_DIAMOND;

/// What the cut is good for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quality {
    pub(crate) pixels: f64,
    pub(crate) metres: f64,
    pub(crate) triangles: u64,
}

/// What a patch shows in a view.
#[derive(Debug, Clone, Copy)]
struct Seen {
    visible: bool,
    /// Certified error, metres, and in pixels where it is visible.
    error: f32,
    pixels: f64,
}

impl Streamer {
    /// The finest cut that can be drawn, no finer than the view asks for: closed under parents, and every entry of it is resident
    /// or all of its children are in the cut. It becomes [`Streamer::refined`]; hysteresis remembers it.
    pub(crate) fn refine(&mut self, view: &View) {
        let asked = self.asked_for(view);
        let refined = self.drawable(&asked);
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
    fn asked_for(&self, view: &View) -> Vec<u32> {
        let step = self.header.lattice.step();
        let mut asked = Vec::new();
        let mut parents_in = PerNode::<u8>::new(&self.nodes);
        let mut open = vec![0u32];
        while let Some(index) = open.pop() {
            let Some(node) = self.nodes.get(index) else { continue };
            let bar = if node.refined { view.target_pixels / HELD_BONUS } else { view.target_pixels };
            let is_there = node.state == State::Resident || index > 0 && self.nodes.whole_family(index).is_some();
            if !is_there || raw_priority(index, node, view, step) <= bar {
                continue;
            }
            asked.push(index);
            for &child in self.nodes.children(index) {
                let Some(count) = parents_in.get_mut(&self.nodes, child) else { continue };
                *count += 1;
                if self.nodes.get(child).is_some_and(|node| *count == node.parent_count) {
                    open.push(child);
                }
            }
        }
        asked
    }

    /// The largest subset of `asked` that can be drawn, in order of the indices: removes entries that are not resident
    /// while one of their children is not refined, and everything below them, until none is left. The union of two
    /// drawable cuts is drawable, so the largest one is unique.
    fn drawable(&self, asked: &[u32]) -> Vec<u32> {
        let nodes = &self.nodes;
        let mut is_in = PerNode::<bool>::new(nodes);
        for &index in asked {
            if let Some(slot) = is_in.get_mut(nodes, index) {
                *slot = true;
            }
        }
        let is_resident = |i: u32| nodes.get(i).is_some_and(|n| n.state == State::Resident);
        let is_replaced = |is_in: &PerNode<bool>, i: u32| {
            nodes.whole_family(i).is_some_and(|children| children.iter().all(|&c| is_in.get(nodes, c)))
        };
        let mut doubtful: Vec<u32> = asked.iter().copied().filter(|&i| !is_resident(i)).collect();
        while let Some(index) = doubtful.pop() {
            if is_resident(index) || !is_in.get(nodes, index) || is_replaced(&is_in, index) {
                continue;
            }
            let mut falling = vec![index];
            while let Some(index) = falling.pop() {
                let Some(slot) = is_in.get_mut(nodes, index).filter(|slot| **slot) else { continue };
                *slot = false;
                falling.extend(nodes.children(index).iter().filter(|&&c| is_in.get(nodes, c)));
                let parents = nodes.get(index).into_iter().flat_map(|n| n.entry.parents());
                doubtful.extend(parents.filter(|&p| !is_resident(p)));
            }
        }
        let in_order = in_order(asked.iter().copied()).into_iter().filter_map(|k| asked.get(k).copied());
        in_order.filter(|&i| is_in.get(nodes, i)).collect()
    }

    /// The patches of the cut, and its quality in the view.
    pub(crate) fn cut(&self, view: &View) -> (Vec<DrawPatch>, Quality) {
        let mut draw = Vec::new();
        let mut quality = Quality { pixels: 0.0, metres: 0.0, triangles: 0 };
        if self.refined.is_empty() {
            return (draw, Quality { pixels: f64::INFINITY, metres: f64::INFINITY, triangles: 0 });
        }
        let step = self.header.lattice.step();
        let look = |sphere: &Sphere, error: f32| {
            let visible = view.may_see(sphere);
            let pixels = if visible { view.pixel_error(sphere, f64::from(error) / step) } else { 0.0 };
            Seen { visible, error, pixels }
        };
        let mut is_frontier = PerNode::<bool>::new(&self.nodes);
        let mut frontier = Vec::new();
        // A diamond has patches in several chunks.
        let mut diamonds = PerNode::<Option<Seen>>::new(&self.nodes);
        for &chunk in &self.refined {
            let Some(node) = self.nodes.get(chunk) else { continue };
            for &child in self.nodes.children(chunk) {
                let is_new = is_frontier.get_mut(&self.nodes, child).is_some_and(|slot| !std::mem::replace(slot, true));
                frontier.extend(self.nodes.get(child).filter(|node| is_new && !node.refined));
            }
            let leaf = look(&node.box_sphere, 0.0);
            for (number, patch) in (0..).zip(&node.patches) {
                let diamond = if patch.diamond == NO_DIAMOND { None } else { Some(self.nodes.get(patch.diamond)) };
                let seen = match diamond {
                    None => leaf,
                    Some(Some(d)) if d.refined => continue,
                    Some(Some(d)) => match diamonds.get_mut(&self.nodes, patch.diamond) {
                        Some(seen) => *seen.get_or_insert_with(|| look(&d.entry.sphere, d.entry.error)),
                        None => look(&d.entry.sphere, d.entry.error),
                    },
                    Some(None) => look(&node.entry.sphere, node.error_below()),
                };
                let Seen { visible, error, pixels } = seen;
                if visible {
                    quality.triangles += u64::from(patch.count);
                    quality.metres = quality.metres.max(f64::from(error));
                    quality.pixels = quality.pixels.max(pixels);
                }
                draw.push(DrawPatch {
                    chunk,
                    patch: number,
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
        for node in frontier {
            if view.may_see(&node.entry.sphere) {
                let error = f64::from(node.entry.error);
                quality.metres = quality.metres.max(error);
                quality.pixels = quality.pixels.max(view.pixel_error(&node.entry.sphere, error / step));
            }
        }
        (draw, quality)
    }
}
