//! How many vertices and triangles the finest tiles of a tileset have, as the JSON of their glTF says, for what a build will need.

use super::super::companions::Companions;
use super::super::gltf::{self, Sizes};
use super::super::{Bytes, ReadOptions, open};
use super::content::{B3DM_HEADER, CMPT_HEADER, MAX_COMPOSITES, gunzip, is_gzip, piece};
use super::names::Names;
use super::tree::{self, Leaf};
use std::io::{Cursor, Seek, SeekFrom};
use std::path::Path;

/// Bytes of the header of a GLB and of its first chunk.
const GLB_HEADER: u64 = 20;

/// Of the tiles that are read of the tileset at `path`, compressed or not. Tiles that are damaged count as nothing, and the result is `None` where the tree of
/// the tileset cannot be read: the reader will say it better.
pub fn sizes(path: &Path, options: &ReadOptions) -> Option<Sizes> {
    let companions = &Companions::of(path, options, None);
    let (source, total) = open(path).ok()?;
    let json = tree::whole(source, total, path, options.document).ok()?;
    let plan = tree::plan(json, path, Names { companions, options }).ok()?;
    let of_leaf = |leaf| of_leaf(leaf, companions, options.document).unwrap_or_default();
    Some(plan.leaves.iter().map(of_leaf).fold(Sizes::default(), Sizes::and))
}

fn of_leaf(leaf: &Leaf, companions: &Companions<'_>, max: u64) -> Option<Sizes> {
    let (mut file, bytes) = companions.open(&leaf.path).ok()?;
    let path = &leaf.path;
    if !is_gzip(&piece(&mut file, 0, bytes.min(2), path).ok()?) {
        return Part { source: &mut file, path, max }.content(0, bytes, 0);
    }
    file.seek(SeekFrom::Start(0)).ok()?;
    let unpacked = gunzip(file, path, max).ok()?;
    let bytes = unpacked.len() as u64;
    Part { source: &mut Cursor::new(unpacked), path, max }.content(0, bytes, 0)
}

/// A file of tiles. The JSON of each may take `max` bytes of memory.
struct Part<'a> {
    source: &'a mut dyn Bytes,
    path: &'a Path,
    max: u64,
}

impl Part<'_> {
    /// Word `number` of what begins at byte `at`.
    fn word(&mut self, at: u64, number: u64) -> Option<u64> {
        let bytes = piece(self.source, at + 4 * number, 4, self.path).ok()?;
        bytes.first_chunk().map(|bytes| u64::from(u32::from_le_bytes(*bytes)))
    }

    /// What is in `length` bytes from byte `at` on.
    fn content(&mut self, at: u64, length: u64, composites: usize) -> Option<Sizes> {
        match &piece(self.source, at, length.min(4), self.path).ok()?[..] {
            b"b3dm" => {
                let tables = (3..7).map(|number| self.word(at, number)).sum::<Option<u64>>()?;
                let before = B3DM_HEADER + tables;
                self.gltf(at + before, length.checked_sub(before)?)
            }
            b"cmpt" if composites < MAX_COMPOSITES => {
                let (mut all, mut inner) = (Sizes::default(), CMPT_HEADER);
                for _ in 0..self.word(at, 3)? {
                    let left = length.checked_sub(inner)?;
                    let own = self.word(at + inner, 2).filter(|own| *own >= 12 && *own <= left)?;
                    all = all.and(self.content(at + inner, own, composites + 1)?);
                    inner += own;
                }
                Some(all)
            }
            _ => self.gltf(at, length),
        }
    }

    fn gltf(&mut self, at: u64, length: u64) -> Option<Sizes> {
        let is_glb = piece(self.source, at, length.min(4), self.path).ok()?.starts_with(b"glTF");
        let (before, json) = if is_glb { (GLB_HEADER, self.word(at, 3)?) } else { (0, length) };
        if json > self.max || before + json > length {
            return None;
        }
        gltf::sizes(&piece(self.source, at + before, json, self.path).ok()?, self.max)
    }
}
