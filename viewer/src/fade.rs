//! Levels that fade into each other: for a moment both the old and the new patches of a place are drawn, each on its share of the
//! pixels.
//!
//! A pixel has a noise value v from 0 to 1 and shows the cut as it was v × [`FADE_MS`] ago, never anything else: a patch has the pixels from
//! the share that has left it to the share that has come to it. So every pixel shows a whole, valid cut, however often it changes
//! meanwhile, and once [`FADE_MS`] have passed without a change the picture is the exact cut. Pure; times come from outside.

use kilwa_stream::DrawPatch;
use std::collections::{BTreeMap, BTreeSet};

/// How long a change takes, milliseconds.
pub const FADE_MS: f64 = 200.0;

/// What changed in the last moments.
#[derive(Debug, Default)]
pub struct Fader {
    last: Vec<DrawPatch>,
    /// When patches of the cut came, where that is less than [`FADE_MS`] ago.
    born: BTreeMap<(u32, u32), f64>,
    leaving: Vec<Leaving>,
}

#[derive(Debug, Clone, Copy)]
struct Leaving {
    patch: DrawPatch,
    born: f64,
    left: f64,
}

/// What to draw.
#[derive(Debug, Default, PartialEq)]
pub struct Faded {
    /// The patches of the cut, then those that are leaving.
    pub patches: Vec<DrawPatch>,
    /// For each the pixels that it has: two shares of their noise.
    pub shares: Vec<[f32; 2]>,
    /// Whether another frame is needed.
    pub is_fading: bool,
}

fn key(patch: &DrawPatch) -> (u32, u32) {
    (patch.chunk, patch.patch)
}

/// The share of pixels that a change at `since` has reached.
fn share(now: f64, since: f64) -> f32 {
    ((now - since) / FADE_MS).clamp(0.0, 1.0) as f32
}

impl Fader {
    /// Forget what was drawn: the next cut is there at once.
    pub fn cut_short(&mut self) {
        *self = Self::default();
    }

    /// The patches to draw at `now` where the cut is `cut`. `held` returns whether a chunk is still in memory: where one that is leaving is not,
    /// the change is there at once.
    pub fn step(&mut self, now: f64, cut: &[DrawPatch], held: impl Fn(u32) -> bool) -> Faded {
        if self.last.is_empty() {
            self.last = cut.to_vec();
        }
        let same = self.last.len() == cut.len() && self.last.iter().zip(cut).all(|(a, b)| key(a) == key(b));
        if !same {
            self.change(now, cut);
        }
        self.leaving.retain(|l| now - l.left < FADE_MS);
        self.born.retain(|_, born| now - *born < FADE_MS);
        if self.leaving.iter().any(|l| !held(l.patch.chunk)) {
            self.leaving.clear();
            self.born.clear();
        }
        let mut out = Faded { patches: cut.to_vec(), ..Faded::default() };
        if self.leaving.is_empty() && self.born.is_empty() {
            return out;
        }
        out.is_fading = true;
        let come = |p: &DrawPatch| self.born.get(&key(p)).map_or([0.0, 1.0], |born| [0.0, share(now, *born)]);
        out.shares = cut.iter().map(come).collect();
        for l in &self.leaving {
            // It may have come into the view since.
            out.patches.push(DrawPatch { visible: true, ..l.patch });
            out.shares.push([share(now, l.left), share(now, l.born)]);
        }
        out
    }

    fn change(&mut self, now: f64, cut: &[DrawPatch]) {
        let before: BTreeSet<_> = self.last.iter().map(key).collect();
        let after: BTreeSet<_> = cut.iter().map(key).collect();
        for patch in self.last.iter().filter(|p| !after.contains(&key(p))) {
            let born = self.born.remove(&key(patch)).unwrap_or(f64::NEG_INFINITY);
            self.leaving.push(Leaving { patch: *patch, born, left: now });
        }
        self.born.extend(cut.iter().map(key).filter(|k| !before.contains(k)).map(|k| (k, now)));
        self.last = cut.to_vec();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_pack::NO_DIAMOND;

    fn patch(chunk: u32) -> DrawPatch {
        DrawPatch { chunk, patch: 0, first: 0, count: 1, diamond: NO_DIAMOND, level: 0, error: 0.0, visible: true }
    }

    /// The chunks that a pixel of this noise shows.
    fn shown(faded: &Faded, noise: f32) -> Vec<u32> {
        let all = faded.patches.iter().enumerate();
        let has = |k: usize| faded.shares.get(k).is_none_or(|[low, high]| (*low..*high).contains(&noise));
        let mut out: Vec<u32> = all.filter(|(k, _)| has(*k)).map(|(_, p)| p.chunk).collect();
        out.sort_unstable();
        out
    }

    #[test]
    fn during_a_fade_every_pixel_shows_a_recent_cut() {
        // Chunk 1 is refined to 2 and 3, 3 to 4 and 5 before that is done, and back to 3 soon after.
        let cuts: [(f64, &[u32]); 4] =
            [(0.0, &[0, 1]), (1000.0, &[0, 2, 3]), (1090.0, &[0, 2, 4, 5]), (1160.0, &[0, 2, 3])];
        let mut fader = Fader::default();
        for step in 0..200 {
            let now = 900.0 + f64::from(step) * 3.0;
            let cut_at = |t: f64| cuts.iter().rev().find(|(from, _)| *from <= t).map_or(&[0, 1][..], |(_, c)| c);
            let cut: Vec<DrawPatch> = cut_at(now).iter().map(|c| patch(*c)).collect();
            let faded = fader.step(now, &cut, |_| true);
            for k in 0..40 {
                let noise = (f64::from(k) + 0.37) / 40.0;
                let ago = now - noise * FADE_MS;
                // The fader hears of a change with the next frame.
                let may_be = [ago, ago - 3.0].map(|t| cut_at(t).to_vec());
                let shown = shown(&faded, noise as f32);
                assert!(may_be.contains(&shown), "at {now}, noise {noise}: {shown:?}, not {may_be:?}");
            }
        }
    }

    #[test]
    fn at_rest_only_the_exact_cut_is_drawn() {
        let mut fader = Fader::default();
        let first = fader.step(0.0, &[patch(0)], |_| true);
        assert_eq!((first.patches.len(), first.is_fading), (1, false), "the first picture is there at once");
        assert!(fader.step(10.0, &[patch(1)], |_| true).is_fading);
        let rest = fader.step(10.0 + FADE_MS, &[patch(1)], |_| true);
        assert_eq!(rest, Faded { patches: vec![patch(1)], ..Faded::default() });
    }

    #[test]
    fn a_fade_does_not_wait_for_evicted_chunks() {
        let mut fader = Fader::default();
        fader.step(0.0, &[patch(0)], |_| true);
        let faded = fader.step(5.0, &[patch(1)], |chunk| chunk != 0);
        assert_eq!(faded, Faded { patches: vec![patch(1)], ..Faded::default() });
    }
}
