//! The tree of tiles: below each tile, tiles of the group that replaces it.
//!
//! All tiles that a group replaces go at the same moment, so that each of them needs something below it, and it does not matter below which of
//! them the tiles of the group are; they are put below the nearest. If there are too few of them, the rest get a tile that shows nothing.

use super::content::Piece;
use super::groups::Groups;
use kilwa_geometry::Sphere;

/// Which tiles are below each tile, by their numbers.
pub(super) struct Tree {
    pub(super) pieces: Vec<Piece>,
    pub(super) below: Vec<Vec<u32>>,
    /// The tiles that are shown first.
    pub(super) top: Vec<u32>,
}

impl Tree {
    /// Of tiles in any order.
    pub(super) fn new(mut pieces: Vec<Piece>, groups: &Groups) -> Self {
        add_empty_parents(&mut pieces, groups);
        let mut below = vec![Vec::new(); pieces.len()];
        let (mut shown_by, mut replaced_by) = (lists(groups), lists(groups));
        for (number, piece) in (0u32..).zip(&pieces) {
            shown_by[piece.group as usize].push(number);
            if let Some(group) = piece.replaced_by {
                replaced_by[group as usize].push(number);
            }
        }
        for group in 1..groups.all.len() {
            let (above, children) = (&replaced_by[group], &shown_by[group]);
            let adopted = adopt(&pieces, above, children);
            for (parent, children) in above.iter().zip(adopted) {
                below[*parent as usize] = children;
            }
            for parent in above {
                if below[*parent as usize].is_empty() {
                    below[*parent as usize].push(pieces.len() as u32);
                    pieces.push(Piece { replaced_by: None, ..empty(group as u32, pieces[*parent as usize].sphere) });
                    below.push(Vec::new());
                }
            }
        }
        let top = shown_by.swap_remove(0);
        Self { pieces, below, top }
    }
}

fn lists(groups: &Groups) -> Vec<Vec<u32>> {
    vec![Vec::new(); groups.all.len()]
}

fn empty(group: u32, sphere: Sphere) -> Piece {
    Piece { group, replaced_by: None, file: None, sphere, triangles: 0, vertices: 0, bytes: 0 }
}

/// A group whose coarse form has no triangles replaces a tile that shows nothing.
fn add_empty_parents(pieces: &mut Vec<Piece>, groups: &Groups) {
    let mut is_there = vec![false; groups.all.len()];
    for group in pieces.iter().filter_map(|p| p.replaced_by) {
        is_there[group as usize] = true;
    }
    for (number, above) in (0u32..).zip(&groups.all) {
        for below in &above.below {
            if !std::mem::replace(&mut is_there[*below as usize], true) {
                let sphere = groups.all[*below as usize].sphere;
                pieces.push(Piece { replaced_by: Some(*below), ..empty(number, sphere) });
            }
        }
    }
}

/// For each of `above` the children that are nearest to it; no tile has two children while another has none.
fn adopt(pieces: &[Piece], above: &[u32], children: &[u32]) -> Vec<Vec<u32>> {
    let center = |number: u32| pieces[number as usize].sphere.center;
    let distance = |parent: usize, child: u32| center(above[parent]).distance_squared(center(child));
    let mut adopted: Vec<Vec<u32>> = vec![Vec::new(); above.len()];
    for child in children {
        let nearest = (0..above.len()).min_by(|a, b| distance(*a, *child).total_cmp(&distance(*b, *child)));
        if let Some(parent) = nearest {
            adopted[parent].push(*child);
        }
    }
    while let Some(without) = adopted.iter().position(Vec::is_empty) {
        let spare = (0..above.len()).filter(|p| adopted[*p].len() > 1);
        let spare = spare.flat_map(|p| adopted[p].iter().enumerate().map(move |(at, child)| (p, at, *child)));
        let nearest = spare.min_by(|a, b| distance(without, a.2).total_cmp(&distance(without, b.2)));
        let Some((parent, at, child)) = nearest else { break };
        adopted[parent].remove(at);
        adopted[without].push(child);
    }
    adopted
}
