//! The surface that rests on the backing of the field, held back until all of the measured surface has been delivered.

use super::super::rims::Rims;
use kilwa_scan_core::tsdf::{EdgeKey, Patch, PatchVertex};
use std::collections::{BTreeMap, HashMap, HashSet};

/// Triangles that were held back, by the keys of their vertices.
#[derive(Default)]
pub(in super::super) struct Held {
    /// Their vertices.
    pub(in super::super) vertices: BTreeMap<EdgeKey, PatchVertex>,
    /// Vertices of the measured surface, by their numbers.
    pub(in super::super) numbers: HashMap<EdgeKey, u64>,
    /// Vertices that a later brick may deliver.
    awaited: HashSet<EdgeKey>,
    pub(super) triangles: Vec<[EdgeKey; 3]>,
}

impl Held {
    /// Hold back the filled triangles of a patch. `numbers` are those of its measured vertices, `shared` those of earlier bricks.
    pub(in super::super) fn add(&mut self, patch: &Patch, numbers: &[u64], shared: &HashMap<EdgeKey, u64>) {
        for vertex in patch.filled.iter().flatten() {
            let k = *vertex as usize;
            let vertex = &patch.vertices[k];
            if let Some(number) = numbers.get(k).or_else(|| shared.get(&vertex.key)) {
                self.numbers.insert(vertex.key, *number);
            } else if vertex.backing.is_none() && !self.numbers.contains_key(&vertex.key) {
                self.awaited.insert(vertex.key);
            }
            self.vertices.insert(vertex.key, *vertex);
        }
        self.triangles.extend(patch.filled.iter().map(|t| t.map(|k| patch.vertices[k as usize].key)));
    }

    /// A vertex of the measured surface was delivered.
    pub(in super::super) fn delivered(&mut self, key: &EdgeKey, number: u64) {
        if self.awaited.remove(key) {
            self.numbers.insert(*key, number);
        }
    }

    /// The parts of the surface that are connected by edges, with the numbers of their triangles; and whether each closes: whether each of its edges has a triangle on its
    /// other side. Only triangles for which `wanted` holds form parts; the others count as closing.
    pub(super) fn parts(&self, rims: &Rims, wanted: impl Fn(&[EdgeKey; 3]) -> bool) -> Vec<(Vec<usize>, bool)> {
        let sides = |t: &[EdgeKey; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let by_side: HashMap<[EdgeKey; 2], usize> =
            self.triangles.iter().enumerate().flat_map(|(k, t)| sides(t).map(|side| (side, k))).collect();
        let is_rim = |a: &EdgeKey, b: &EdgeKey| match (self.numbers.get(a), self.numbers.get(b)) {
            (Some(a), Some(b)) => rims.is_open([*b, *a]),
            _ => false,
        };
        let mut is_done: Vec<bool> = self.triangles.iter().map(|t| !wanted(t)).collect();
        let mut parts = Vec::new();
        for first in 0..self.triangles.len() {
            if is_done[first] {
                continue;
            }
            let (mut part, mut closes) = (Vec::new(), true);
            let mut stack = vec![first];
            is_done[first] = true;
            while let Some(k) = stack.pop() {
                part.push(k);
                for [a, b] in sides(&self.triangles[k]) {
                    match by_side.get(&[b, a]) {
                        Some(other) if is_done[*other] => {}
                        Some(other) => {
                            is_done[*other] = true;
                            stack.push(*other);
                        }
                        None => closes &= is_rim(&a, &b),
                    }
                }
            }
            part.sort_unstable();
            parts.push((part, closes));
        }
        parts
    }
}
