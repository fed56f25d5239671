//! Cuts: which diamonds are refined, and so which patches show the model (design of Cignoni et al., "Adaptive
//! TetraPuzzles", SIGGRAPH 2004, on diamonds).
//!
//! A *cut* is a set of refined entries that contains entry 0 and, with every entry, all its parents. A patch in the
//! chunk of a refined entry is drawn when it is a leaf or its diamond is not refined; patches of other chunks are not.
//! Every valid cut shows the whole model once, without a crack. Pure and deterministic.

use crate::{DirectoryEntry, NO_DIAMOND, PatchRange};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// A set of refined directory entries. Made by its constructors it is always valid for the entries it was made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cut {
    refined: Vec<bool>,
}

impl Cut {
    /// Only the root entry refined: the coarsest picture.
    pub fn coarsest(entries: &[DirectoryEntry]) -> Self {
        Self { refined: (0..entries.len()).map(|i| i == 0).collect() }
    }

    /// Everything refined: the whole model.
    pub fn finest(entries: &[DirectoryEntry]) -> Self {
        Self { refined: vec![true; entries.len()] }
    }

    /// The coarsest cut whose certified error is at most `metres`: an entry is refined exactly where its error is
    /// larger. Errors are saturated, so that the cut is closed under parents; NaN and negative limits give the finest.
    pub fn for_error(entries: &[DirectoryEntry], metres: f64) -> Self {
        let refine = |e: &DirectoryEntry| metres.is_nan() || f64::from(e.error) > metres;
        Self { refined: entries.iter().enumerate().map(|(i, e)| i == 0 || refine(e)).collect() }
    }

    /// A cut of at most `limit` triangles (or the coarsest, where that has more already): refine the largest error
    /// first, and where a refinement does not fit any more, the next largest that does.
    ///
    /// `coarse_triangles[i]` is the number of triangles that refining entry `i` removes: the sum of the patches whose
    /// diamond is `i`; see [`coarse_triangles`].
    pub fn for_triangles(entries: &[DirectoryEntry], coarse_triangles: &[u64], limit: u64) -> Self {
        let mut sums = coarse_triangles.to_vec();
        let Ok(cut) = grown(entries, limit, &mut sums, |_, _| Ok::<_, std::convert::Infallible>(()));
        cut
    }

    /// The same without knowing the patches of every chunk before: `patches_of` gives those in the chunk of an entry, and is asked once for each
    /// entry that is refined, in the order of refining, and for no other. The patches that represent a diamond are in the chunks of its parents, which are
    /// refined before it.
    ///
    /// # Errors
    /// Those of `patches_of`.
    pub fn for_triangles_read<E>(
        entries: &[DirectoryEntry],
        limit: u64,
        mut patches_of: impl FnMut(u32) -> Result<Vec<PatchRange>, E>,
    ) -> Result<Self, E> {
        let mut sums = vec![0; entries.len()];
        grown(entries, limit, &mut sums, |i, sums| {
            for patch in patches_of(i)? {
                if let Some(sum) = sums.get_mut(patch.diamond as usize) {
                    *sum += u64::from(patch.count);
                }
            }
            Ok(())
        })
    }

    /// A random valid cut with up to `target` refined entries (the root included): for tests of what must hold in every
    /// cut. The same seed gives the same cut.
    pub fn random(entries: &[DirectoryEntry], seed: u64, target: usize) -> Self {
        let mut growth = Growth::new(entries);
        let mut random = fastrand::Rng::with_seed(seed);
        let mut open = growth.refine(0);
        for _ in 1..target {
            if open.is_empty() {
                break;
            }
            let i = open.swap_remove(random.usize(..open.len()));
            open.extend(growth.refine(i));
        }
        growth.cut
    }

    /// A cut from a set of refined entries, or `None` when it is not closed under parents or lacks entry 0.
    pub fn from_refined(entries: &[DirectoryEntry], refined: impl IntoIterator<Item = u32>) -> Option<Self> {
        let mut flags = vec![false; entries.len()];
        for i in refined {
            *flags.get_mut(i as usize)? = true;
        }
        let cut = Self { refined: flags };
        cut.is_valid(entries).then_some(cut)
    }

    /// Whether this is a cut of `entries`: the root is in it, and with every entry all its parents.
    pub fn is_valid(&self, entries: &[DirectoryEntry]) -> bool {
        self.refined.len() == entries.len()
            && self.refined.first() == Some(&true)
            && self
                .refined()
                .all(|i| entries.get(i as usize).is_some_and(|e| e.parents().all(|parent| self.is_refined(parent))))
    }

    /// Whether entry `index` is refined.
    pub fn is_refined(&self, index: u32) -> bool {
        self.refined.get(index as usize).copied().unwrap_or(false)
    }

    /// The refined entries in order: those whose chunks are needed.
    pub fn refined(&self) -> impl Iterator<Item = u32> + '_ {
        (0u32..).zip(&self.refined).filter(|(_, r)| **r).map(|(i, _)| i)
    }

    /// Whether a patch in the chunk of a refined entry is drawn.
    pub fn draws(&self, patch: &PatchRange) -> bool {
        patch.diamond == NO_DIAMOND || !self.is_refined(patch.diamond)
    }

    /// The patches of a refined entry's chunk that are drawn.
    pub fn drawn<'a>(&'a self, patches: &'a [PatchRange]) -> impl Iterator<Item = &'a PatchRange> {
        patches.iter().filter(|patch| self.draws(patch))
    }

    /// Certified error in metres of what the cut shows, against the finest surface: the largest error of a diamond
    /// whose coarse form may be shown. 0 for the finest cut.
    pub fn error(&self, entries: &[DirectoryEntry]) -> f32 {
        let shown = (0u32..)
            .zip(entries)
            .filter(|(i, e)| !self.is_refined(*i) && e.parents().any(|parent| self.is_refined(parent)));
        shown.map(|(_, e)| e.error).fold(0.0, f32::max)
    }
}

/// See [`Cut::for_triangles`]. `refined` is called for each entry that is refined, before its children are examined.
fn grown<E>(
    entries: &[DirectoryEntry],
    limit: u64,
    coarse_triangles: &mut [u64],
    mut refined: impl FnMut(u32, &mut [u64]) -> Result<(), E>,
) -> Result<Cut, E> {
    let mut growth = Growth::new(entries);
    let mut drawn = entries.first().map_or(0, |e| u64::from(e.triangles));
    // Errors are not negative: their bits order them. Of equal errors the earlier entry comes first.
    let rank = |i: u32| {
        let error = entries.get(i as usize).map_or(0, |e| e.error.to_bits());
        (error, Reverse(i))
    };
    if !entries.is_empty() {
        refined(0, coarse_triangles)?;
    }
    let mut open: BinaryHeap<(u32, Reverse<u32>)> = growth.refine(0).into_iter().map(rank).collect();
    while let Some((_, Reverse(i))) = open.pop() {
        let at = i as usize;
        let gain = entries.get(at).map_or(0, |e| u64::from(e.triangles));
        let loss = coarse_triangles.get(at).copied().unwrap_or(0);
        let then = drawn.saturating_add(gain).saturating_sub(loss);
        if then <= limit || then <= drawn {
            drawn = then;
            refined(i, coarse_triangles)?;
            open.extend(growth.refine(i).into_iter().map(rank));
        }
    }
    Ok(growth.cut)
}

/// How many triangles the coarse form of every diamond has, from the patch tables of all chunks in entry order.
pub fn coarse_triangles<'a>(entry_count: usize, patches: impl IntoIterator<Item = &'a PatchRange>) -> Vec<u64> {
    let mut sums = vec![0u64; entry_count];
    for patch in patches {
        if let Some(sum) = sums.get_mut(patch.diamond as usize) {
            *sum += u64::from(patch.count);
        }
    }
    sums
}

/// A cut that grows by one diamond at a time, and what that opens.
struct Growth {
    cut: Cut,
    /// Parents of each entry that are not refined yet.
    missing: Vec<u8>,
    children: HashMap<u32, Vec<u32>>,
}

impl Growth {
    fn new(entries: &[DirectoryEntry]) -> Self {
        let mut children: HashMap<u32, Vec<u32>> = HashMap::new();
        let mut missing = Vec::with_capacity(entries.len());
        for (i, entry) in (0u32..).zip(entries) {
            missing.push(u8::try_from(entry.parents().count()).unwrap_or(u8::MAX));
            for parent in entry.parents() {
                children.entry(parent).or_default().push(i);
            }
        }
        Self { cut: Cut { refined: vec![false; entries.len()] }, missing, children }
    }

    /// Refine an entry whose parents all are; returns the entries that can be refined from now on.
    fn refine(&mut self, index: u32) -> Vec<u32> {
        match self.cut.refined.get_mut(index as usize) {
            Some(refined) if !*refined => *refined = true,
            _ => return Vec::new(),
        }
        let mut opened = Vec::new();
        for child in self.children.get(&index).into_iter().flatten() {
            if let Some(missing) = self.missing.get_mut(*child as usize) {
                *missing = missing.saturating_sub(1);
                if *missing == 0 {
                    opened.push(*child);
                }
            }
        }
        opened
    }
}
