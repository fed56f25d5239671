//! The cut that is drawn: the finest that the view asks for and that what is resident can show.

use crate::command::DrawPatch;
use crate::nodes::{Node, Open, PerNode, State};
use crate::select::{HELD_BONUS, Looks};
use crate::streamer::Streamer;
use crate::view::Look;
use kilwa_pack::NO_DIAMOND;
use std::sync::Arc;

/// What the cut is good for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quality {
    pub(crate) pixels: f64,
    pub(crate) metres: f64,
    pub(crate) triangles: u64,
    /// Chunks that are in the picture, and their encoded bytes.
    pub(crate) chunks: u32,
    pub(crate) bytes: u64,
}

impl Quality {
    /// Nothing is shown that is worse than this.
    fn at_least(pixels_and_metres: f64) -> Self {
        Self { pixels: pixels_and_metres, metres: pixels_and_metres, triangles: 0, chunks: 0, bytes: 0 }
    }

    /// Something that is visible has this error.
    fn count(&mut self, look: &Look, error: f32) {
        self.metres = self.metres.max(f64::from(error));
        self.pixels = self.pixels.max(look.priority);
    }
}

/// Entries of the hierarchy that the view asks to be refined.
struct Asked {
    /// In order of their indices.
    indices: Vec<u32>,
    is_in: PerNode<bool>,
}

/// The patches of the last two steps: where the shell has dropped the older ones, their memory is used again.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lists([Arc<Vec<DrawPatch>>; 2]);

impl Lists {
    /// An empty list.
    fn take(&mut self) -> Arc<Vec<DrawPatch>> {
        self.0.swap(0, 1);
        let mut list = std::mem::take(&mut self.0[1]);
        match Arc::get_mut(&mut list) {
            Some(patches) => patches.clear(),
            None => list = Arc::default(),
        }
        list
    }

    fn keep(&mut self, list: &Arc<Vec<DrawPatch>>) {
        self.0[1] = list.clone();
    }
}

impl Streamer {
    /// The finest cut that can be drawn, no finer than the view asks for: closed under parents, and every entry of it is resident
    /// or all of its children are in the cut. It becomes [`Streamer::refined`]; hysteresis remembers it.
    pub(crate) fn refine(&mut self, looks: &mut Looks) {
        let asked = self.asked_for(looks);
        let refined = self.drawable(asked);
        if refined == self.refined {
            return;
        }
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
    fn asked_for(&self, looks: &mut Looks) -> Asked {
        let nodes = &self.nodes;
        let target = looks.lens().view.target_pixels;
        let mut asked = Asked { indices: Vec::new(), is_in: PerNode::new(nodes) };
        let mut open = Open::at_root(nodes);
        while let Some(index) = open.pop() {
            let Some(node) = nodes.get(index) else { continue };
            let bar = if node.refined { target / HELD_BONUS } else { target };
            if !node.entry.parents().all(|parent| asked.is_in.get(nodes, parent))
                || looks.priority(nodes, index) <= bar
                || node.state != State::Resident && (index == 0 || nodes.whole_family(index).is_none())
            {
                continue;
            }
            asked.indices.push(index);
            if let Some(slot) = asked.is_in.get_mut(nodes, index) {
                *slot = true;
            }
            open.extend(nodes.children(index));
        }
        asked
    }

    /// The largest subset of `asked` that can be drawn, in order of the indices: removes entries that are not resident
    /// while one of their children is not refined, and everything below them, until none is left. The union of two
    /// drawable cuts is drawable, so the largest one is unique.
    fn drawable(&self, asked: Asked) -> Vec<u32> {
        let nodes = &self.nodes;
        let Asked { mut indices, mut is_in } = asked;
        let is_resident = |i: u32| nodes.get(i).is_some_and(|n| n.state == State::Resident);
        let is_replaced = |is_in: &PerNode<bool>, i: u32| {
            nodes.whole_family(i).is_some_and(|children| children.iter().all(|&c| is_in.get(nodes, c)))
        };
        let mut doubtful: Vec<u32> = indices.iter().copied().filter(|&i| !is_resident(i)).collect();
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
        indices.retain(|&i| is_in.get(nodes, i));
        indices
    }

    /// The patches of the cut, and its quality in the view.
    pub(crate) fn cut(&mut self, looks: &mut Looks) -> (Arc<Vec<DrawPatch>>, Quality) {
        let mut list = self.lists.take();
        let quality = match Arc::get_mut(&mut list) {
            Some(draw) if !self.refined.is_empty() => self.write_cut(looks, draw),
            _ => Quality::at_least(f64::INFINITY),
        };
        self.lists.keep(&list);
        (list, quality)
    }

    fn write_cut(&self, looks: &mut Looks, draw: &mut Vec<DrawPatch>) -> Quality {
        let nodes = &self.nodes;
        let mut quality = Quality::at_least(0.0);
        let mut is_refined = PerNode::<bool>::new(nodes);
        for &chunk in &self.refined {
            if let Some(slot) = is_refined.get_mut(nodes, chunk) {
                *slot = true;
            }
        }
        for &chunk in &self.refined {
            let Some(node) = nodes.get(chunk) else { continue };
            let children = nodes.children(chunk);
            let mut refined_children = 0;
            for &child in children {
                if is_refined.get(nodes, child) {
                    refined_children += 1;
                    continue;
                }
                // A coarse form may be empty (islands that were pruned): its error counts although no patch shows it.
                if let Some((look, error)) = looks.at(nodes, child).filter(|(look, _)| look.visible) {
                    quality.count(&look, error);
                }
            }
            if refined_children == children.len() && nodes.whole_family(chunk).is_some() {
                continue; // Nothing is left of it.
            }
            let before = draw.len();
            self.write_patches(chunk, node, (refined_children > 0).then_some(&is_refined), looks, draw, &mut quality);
            let mut shown = draw.iter().skip(before).filter(|patch| patch.visible).peekable();
            if shown.peek().is_some() {
                quality.chunks += 1;
                quality.bytes += u64::from(node.entry.encoded_bytes);
                quality.triangles += shown.map(|patch| u64::from(patch.count)).sum::<u64>();
            }
        }
        quality
    }

    /// The patches of a chunk of the cut, less those whose diamond is refined.
    fn write_patches(
        &self,
        chunk: u32,
        node: &Node,
        is_refined: Option<&PerNode<bool>>,
        looks: &mut Looks,
        draw: &mut Vec<DrawPatch>,
        quality: &mut Quality,
    ) {
        let step = self.header.lattice.step();
        let mut is_leaf_visible = None;
        for (number, patch) in (0..).zip(&node.patches) {
            let (visible, error) = if patch.diamond == NO_DIAMOND {
                (*is_leaf_visible.get_or_insert_with(|| looks.lens().may_see(&node.box_sphere)), 0.0)
            } else if is_refined.is_some_and(|refined| refined.get(&self.nodes, patch.diamond)) {
                continue;
            } else {
                let (look, error) = looks.at(&self.nodes, patch.diamond).unwrap_or_else(|| {
                    let error = node.error_below();
                    (looks.lens().look(&node.entry.sphere, f64::from(error) / step), error)
                });
                if look.visible {
                    quality.count(&look, error);
                }
                (look.visible, error)
            };
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
}
