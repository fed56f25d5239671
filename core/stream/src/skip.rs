//! Chunks that a view passes over: between what is shown and what was shown before.
//!
//! A chunk all of whose children are refined shows nothing. If the directory lists the children ([`kilwa_pack::Children`]) that is known without
//! the chunk, so it need not be there: the picture goes from its parents to its children at once, two levels in a step. What is
//! skipped is wanted all the same, after all that the picture needs: it is there when the camera goes back.
//!
//! Never two in a row: of a chunk and its child at most one is skipped, so that no step is coarser than two levels and nothing waits for
//! more than what it replaces. Chosen from the finest up, because there the bytes are: parents have a fifth of their children.

use crate::nodes::{Node, Nodes, PerNode, State};
use crate::select::{Rank, Ranks};

/// Those of the wanted chunks that the picture does not need; `missing` are those that are not resident. `is_free` decides what costs nothing (the head has it), or stays anyway;
/// `is_likely` where children whose entries are not known yet will be wanted.
pub(crate) fn skipped(
    nodes: &Nodes,
    ranks: &Ranks,
    missing: &[(u32, Rank)],
    is_likely: impl Fn(u32) -> bool,
    is_free: impl Fn(u32, &Node) -> bool,
) -> PerNode<bool> {
    if missing.is_empty() {
        return PerNode::default();
    }
    let mut skipped = PerNode::<bool>::new(nodes);
    // Children have larger indices than their parents.
    for &(index, rank) in missing.iter().rev() {
        let Some(node) =
            nodes.get(index).filter(|n| n.state == State::Absent && n.entry.children.is_some_and(|c| c.is_whole))
        else {
            continue;
        };
        let is_known =
            nodes.whole_family(index).is_some() || is_likely(index) && nodes.pages_of_children(index).next().is_some();
        let passes = |&child: &u32| ranks.get(nodes, child).is_some_and(|r| r.visible) && !skipped.get(nodes, child);
        let is_skipped = rank.visible && is_known && !is_free(index, node) && nodes.children(index).iter().all(passes);
        if let Some(slot) = skipped.get_mut(nodes, index) {
            *slot = is_skipped;
        }
    }
    skipped
}
