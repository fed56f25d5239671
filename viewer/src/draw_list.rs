//! The draw calls of a cut: which index ranges of which slab are drawn in which order. Pure.
//!
//! Chunks are drawn from near to far in a few layers, so that little of what is hidden is shaded, and within a layer slab by slab, so that few
//! buffers are bound. Neighbouring patches are one call where no uniform tells them apart, those of neighbouring chunks in a slab, too.

use crate::gpu::frame::{Draw, NO_FADE, draw_uniform};
use crate::options::Mode;
use glam::DVec3;
use kilwa_stream::{DrawPatch, View};
use std::ops::Range;

/// Number of layers of chunks, from near to far: within one, each buffer is bound once.
const LAYERS: usize = 12;

/// Where a chunk is in GPU memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Number of its slab.
    pub slab: u32,
    /// The first of its indices in the slab.
    pub first_index: u32,
    /// Its triangles.
    pub triangles: u32,
    /// Middle of the box of its vertices, in lattice units.
    pub middle: DVec3,
}

/// One draw call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Call {
    /// Number of the slab.
    pub slab: u32,
    /// Which of its indices.
    pub indices: Range<u32>,
    /// Place of its uniforms among those of the frame.
    pub draw: u32,
}

/// When a draw call needs uniforms of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PerCall {
    /// Only for levels that fade into each other.
    Fades,
    /// For the level of detail, too.
    Levels,
    /// Every patch is a call, with its number and its error.
    Patches,
}

impl PerCall {
    /// What a mode needs.
    pub fn of(mode: Mode) -> Self {
        match mode {
            Mode::Error => Self::Patches,
            Mode::Level => Self::Levels,
            _ => Self::Fades,
        }
    }
}

/// The calls of a frame. Kept from frame to frame for its memory.
#[derive(Debug, Default)]
pub struct DrawList {
    calls: Vec<Call>,
    draws: Vec<Draw>,
    is_fading: bool,
    /// Calls in order of the patches, and which of them belong to each chunk.
    found: Vec<Call>,
    chunks: Vec<Range<u32>>,
    /// What they are sorted by.
    keys: Vec<u128>,
}

impl DrawList {
    /// Calls in the order in which they are to be drawn.
    pub fn calls(&self) -> &[Call] {
        &self.calls
    }

    /// Their uniforms.
    pub fn draws(&self) -> &[Draw] {
        &self.draws
    }

    /// Whether a patch has only some of its pixels.
    pub fn is_fading(&self) -> bool {
        self.is_fading
    }

    /// The calls of a cut; what was here is forgotten. `fades` says for each patch which pixels it has, as two shares of their noise; patches beyond its
    /// end have all of them. `place_of` says where a chunk is; patches of chunks that are nowhere, and those that are not visible, are
    /// left out. The id of a patch is 1 plus its index.
    pub fn collect(
        &mut self,
        view: &View,
        patches: &[DrawPatch],
        fades: &[[f32; 2]],
        per_call: PerCall,
        mut place_of: impl FnMut(u32) -> Option<Place>,
    ) {
        self.found.clear();
        self.draws.clear();
        self.chunks.clear();
        self.keys.clear();
        self.is_fading = false;
        let mut first = 0;
        for patches in patches.chunk_by(|a, b| a.chunk == b.chunk) {
            let before = self.found.len();
            if let Some(place) = patches.first().and_then(|p| place_of(p.chunk)) {
                self.add(first, patches, fades, per_call, &place);
                // A chunk without calls must not count towards a layer.
                if self.found.len() > before {
                    let depth = (place.middle - view.eye).dot(view.forward) as f32;
                    self.keys.push(ordered_bits(depth) << 64 | self.chunks.len() as u128);
                    self.chunks.push(before as u32..self.found.len() as u32);
                }
            }
            first += patches.len();
        }
        self.sort();
    }

    /// Visible patches of a chunk, the first of which has the index `first`.
    fn add(&mut self, first: usize, patches: &[DrawPatch], fades: &[[f32; 2]], per_call: PerCall, place: &Place) {
        let mut last: Option<(Call, [f32; 2])> = None;
        for (index, patch) in (first..).zip(patches) {
            let end = patch.first.saturating_add(patch.count);
            if !patch.visible || end > place.triangles || patch.count == 0 {
                continue;
            }
            let fade = fades.get(index).copied().unwrap_or(NO_FADE);
            let indices = place.first_index + patch.first * 3..place.first_index + end * 3;
            if let Some((call, of)) = &mut last
                && per_call != PerCall::Patches
                && call.indices.end == indices.start
                && *of == fade
            {
                call.indices.end = indices.end;
                continue;
            }
            self.is_fading |= fade != NO_FADE;
            let level = u32::from(patch.level);
            let uniform = match per_call {
                PerCall::Fades => draw_uniform(0, 0, 0.0, fade),
                PerCall::Levels => draw_uniform(0, level, 0.0, fade),
                PerCall::Patches => draw_uniform(index as u32 + 1, level, patch.error, fade),
            };
            if self.draws.last() != Some(&uniform) {
                self.draws.push(uniform);
            }
            let call = Call { slab: place.slab, indices, draw: self.draws.len() as u32 - 1 };
            self.found.extend(last.replace((call, fade)).map(|(call, _)| call));
        }
        self.found.extend(last.map(|(call, _)| call));
    }

    /// Layers from near to far; in a layer slab by slab; in a slab in order of its indices.
    fn sort(&mut self) {
        self.keys.sort_unstable();
        let in_layer = self.keys.len().div_ceil(LAYERS).max(1);
        for (place, key) in self.keys.iter_mut().enumerate() {
            let chunk = *key as u32;
            let call = self.chunks.get(chunk as usize).and_then(|calls| self.found.get(calls.start as usize));
            let (slab, first) = call.map_or((0, 0), |call| (call.slab, call.indices.start));
            let in_slab = u128::from(slab) << 64 | u128::from(first) << 32 | u128::from(chunk);
            *key = ((place / in_layer) as u128) << 96 | in_slab;
        }
        self.keys.sort_unstable();
        self.calls.clear();
        for calls in self.keys.iter().filter_map(|key| self.chunks.get(*key as u32 as usize)) {
            for call in self.found.get(calls.start as usize..calls.end as usize).unwrap_or_default() {
                match self.calls.last_mut() {
                    Some(last)
                        if (last.slab, last.draw) == (call.slab, call.draw)
                            && last.indices.end == call.indices.start =>
                    {
                        last.indices.end = call.indices.end;
                    }
                    _ => self.calls.push(call.clone()),
                }
            }
        }
    }
}

/// The bits of a number as an integer with the same order.
fn ordered_bits(x: f32) -> u128 {
    let bits = x.to_bits();
    u128::from(if bits >> 31 == 0 { bits | 1 << 31 } else { !bits })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Projection;
    use kilwa_pack::NO_DIAMOND;
    use std::collections::BTreeMap;

    fn view() -> View {
        View {
            eye: DVec3::ZERO,
            right: DVec3::X,
            up: DVec3::Z,
            forward: DVec3::Y,
            anchor: DVec3::ZERO,
            projection: Projection::Perspective { tan_half_height: 0.5 },
            size: [64, 64],
            near: 1.0,
            far: f64::INFINITY,
            target_pixels: 1.0,
            clip: crate::Clip::default(),
        }
    }

    fn patch(chunk: u32, patch: u32, visible: bool) -> DrawPatch {
        let first = patch * 10;
        DrawPatch { chunk, patch, first, count: 10, diamond: NO_DIAMOND, level: 0, error: 0.0, visible }
    }

    /// Chunks of 40 triangles in two slabs, the odd ones in the second.
    fn place(chunk: u32) -> Place {
        let middle = DVec3::new(0.0, f64::from(chunk * 7 % 5), 0.0);
        Place { slab: chunk % 2, first_index: chunk / 2 * 120, triangles: 40, middle }
    }

    /// The triangles that calls draw, by slab: how often each.
    fn drawn(list: &DrawList) -> BTreeMap<(u32, u32), u32> {
        let mut times = BTreeMap::new();
        for call in list.calls() {
            for index in call.indices.clone().step_by(3) {
                *times.entry((call.slab, index / 3)).or_default() += 1;
            }
        }
        times
    }

    #[test]
    fn every_visible_triangle_is_drawn_once() {
        let mut list = DrawList::default();
        for seed in 0..50_u32 {
            let is_visible = |chunk: u32, patch: u32| (chunk * 31 + patch * 17 + seed * 13) % 7 > 2;
            let patches: Vec<_> =
                (0..60).flat_map(|c| (0..4).map(move |p| (c, p))).map(|(c, p)| patch(c, p, is_visible(c, p))).collect();
            for per_call in [PerCall::Fades, PerCall::Levels, PerCall::Patches] {
                list.collect(&view(), &patches, &[], per_call, |c| (c != 5).then(|| place(c)));
                let of = |p: &DrawPatch| {
                    let at = place(p.chunk);
                    (at.first_index / 3 + p.first..at.first_index / 3 + p.first + p.count).map(move |t| (at.slab, t))
                };
                let wanted =
                    patches.iter().filter(|p| p.visible && p.chunk != 5).flat_map(of).map(|t| (t, 1)).collect();
                assert_eq!(drawn(&list), wanted);
                let visible = patches.iter().filter(|p| p.visible && p.chunk != 5).count();
                assert_eq!(list.calls().len() == visible, per_call == PerCall::Patches, "{per_call:?}");
            }
        }
    }

    #[test]
    fn neighbours_in_a_slab_are_one_call() {
        let mut list = DrawList::default();
        let patches: Vec<_> = (0..8).flat_map(|c| (0..4).map(move |p| patch(c, p, true))).collect();
        let beside = |chunk: u32| Place { middle: DVec3::Y, slab: 0, first_index: chunk * 120, triangles: 40 };
        // Eight chunks in each of twelve layers.
        let many: Vec<_> = (0..96).flat_map(|c| (0..4).map(move |p| patch(c, p, true))).collect();
        list.collect(&view(), &many, &[], PerCall::Fades, |c| Some(beside(c)));
        assert_eq!(list.calls().len(), 1, "chunks at the same depth keep their order: {:?}", list.calls());
        let fades: Vec<_> = (0..patches.len()).map(|k| [0.0, if k < 16 { 0.5 } else { 1.0 }]).collect();
        list.collect(&view(), &patches, &fades, PerCall::Fades, |c| Some(beside(c)));
        assert!(list.is_fading());
        assert_eq!((list.calls().len(), list.draws().len()), (2, 2));
    }
}
