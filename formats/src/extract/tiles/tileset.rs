//! `tileset.json` (OGC, "3D Tiles Specification 1.1", 22-025r4), and the tilesets below it, so that no file is long.

use super::frame::Frame;
use super::groups::Groups;
use super::tree::Tree;
use kilwa_geometry::Sphere;
use serde_json::{Value, json};
use std::collections::VecDeque;

/// The name of the first one.
pub(super) const TILESET: &str = "tileset.json";
/// The folder of the others.
pub(super) const NESTED_FOLDER: &str = "tilesets";
/// Clients refine where the error takes more than so many pixels (CesiumJS and 3d-tiles-renderer; loaders.gl takes 8), and a tile shall be
/// replaced where its certified error takes more than one.
pub const PIXELS: f64 = 16.0;
/// A tile that stands for a tileset has an error so many times that of its first tile: larger, because 3d-tiles-renderer refines a tile whose error is
/// not smaller than that of the tile above, and smaller than that of the tile above both.
const NESTED_TILESET_ERROR_FACTOR: f64 = 1.0 + 1.0 / 8192.0;

/// A JSON file of a tileset.
pub(super) struct File {
    /// Its name, relative to the folder.
    pub(super) name: String,
    pub(super) json: Value,
}

/// All of them, with at most about `tiles` tiles each.
pub(super) fn files(tree: &Tree, groups: &Groups, frame: &Frame<'_>, tiles: usize, about: &Value) -> Vec<File> {
    let writer = Writer { tree, groups };
    let mut files = Vec::new();
    let mut waiting: VecDeque<u32> = VecDeque::new();
    let mut root = writer.root(tiles, &mut waiting);
    root["transform"] = json!(frame.transform);
    let whole = f64::max(root["geometricError"].as_f64().unwrap_or(0.0), PIXELS * writer.all().radius) * 2.0;
    files.push(file(TILESET.to_owned(), root, whole, Some(about)));
    let mut number = 0;
    while let Some(first) = waiting.pop_front() {
        let mut names = Names { next: number + waiting.len() + 1, depth: "../" };
        let root = writer.part(first, tiles, &mut waiting, &mut names);
        let error = writer.error(first);
        files.push(file(format!("{NESTED_FOLDER}/{number}.json"), root, error, None));
        number += 1;
    }
    files
}

fn file(name: String, mut root: Value, error: f64, about: Option<&Value>) -> File {
    root["refine"] = json!("REPLACE");
    let mut asset = json!({"version": "1.1"});
    if let Some(about) = about {
        asset["extras"] = about.clone();
    }
    File { name, json: json!({"asset": asset, "geometricError": error, "root": root}) }
}

struct Writer<'a> {
    tree: &'a Tree,
    groups: &'a Groups,
}

/// How the file that is being written names others.
struct Names {
    /// The number of the next tileset.
    next: usize,
    /// From its folder to the folder of the whole.
    depth: &'static str,
}

impl Writer<'_> {
    fn all(&self) -> Sphere {
        self.groups.all.first().map_or(Sphere::EMPTY, |g| g.sphere)
    }

    /// The first tile; one that shows nothing where several tiles are shown first.
    fn root(&self, tiles: usize, waiting: &mut VecDeque<u32>) -> Value {
        let mut names = Names { next: 0, depth: "" };
        if let [one] = self.tree.top[..] {
            return self.part(one, tiles, waiting, &mut names);
        }
        let error = self.tree.top.iter().map(|t| self.error(*t)).fold(PIXELS * self.all().radius, f64::max) * 2.0;
        let mut included = vec![false; self.tree.pieces.len()];
        let mut queue: VecDeque<u32> = self.tree.top.iter().copied().collect();
        self.include(&mut queue, tiles, &mut included);
        let below: Vec<Value> =
            self.tree.top.iter().map(|t| self.tile(*t, self.all(), &included, waiting, &mut names)).collect();
        json!({"boundingVolume": volume(&self.all()), "geometricError": error, "children": below})
    }

    /// A tile with those below it, as far as one file goes. The others wait.
    fn part(&self, first: u32, tiles: usize, waiting: &mut VecDeque<u32>, names: &mut Names) -> Value {
        let mut included = vec![false; self.tree.pieces.len()];
        included[first as usize] = true;
        let mut queue: VecDeque<u32> = self.tree.below[first as usize].iter().copied().collect();
        self.include(&mut queue, tiles, &mut included);
        self.tile(first, self.all(), &included, waiting, names)
    }

    /// Breadth first until the file is full.
    fn include(&self, queue: &mut VecDeque<u32>, tiles: usize, included: &mut [bool]) {
        let mut room = tiles;
        while let Some(tile) = queue.pop_front() {
            if room == 0 {
                return;
            }
            room -= 1;
            included[tile as usize] = true;
            queue.extend(&self.tree.below[tile as usize]);
        }
    }

    fn error(&self, tile: u32) -> f64 {
        let group = self.tree.pieces[tile as usize].replaced_by;
        group.map_or(0.0, |group| PIXELS * self.groups.all[group as usize].error)
    }

    /// The sphere of the group that replaces it; for a tile of the finest level its own, if that is inside the one above.
    fn sphere(&self, tile: u32, above: &Sphere) -> Sphere {
        let piece = &self.tree.pieces[tile as usize];
        match piece.replaced_by {
            Some(group) => self.groups.all[group as usize].sphere,
            None if above.contains(&piece.sphere, 0.0) => piece.sphere,
            None => *above,
        }
    }

    fn tile(
        &self,
        tile: u32,
        above: Sphere,
        included: &[bool],
        waiting: &mut VecDeque<u32>,
        names: &mut Names,
    ) -> Value {
        let (piece, below) = (&self.tree.pieces[tile as usize], &self.tree.below[tile as usize]);
        let sphere = self.sphere(tile, &above);
        let volume = volume(&sphere);
        if !included[tile as usize] && !below.is_empty() {
            let folder = if names.depth.is_empty() { format!("{NESTED_FOLDER}/") } else { String::new() };
            let uri = format!("{folder}{}.json", names.next);
            names.next += 1;
            waiting.push_back(tile);
            return json!({"boundingVolume": volume, "geometricError": self.error(tile) * NESTED_TILESET_ERROR_FACTOR, "content": {"uri": uri}});
        }
        let mut json = json!({"boundingVolume": volume, "geometricError": self.error(tile)});
        if let Some(file) = &piece.file {
            json["content"] = json!({"uri": format!("{}{file}", names.depth)});
        }
        if !below.is_empty() {
            let below: Vec<Value> = below.iter().map(|t| self.tile(*t, sphere, included, waiting, names)).collect();
            json["children"] = json!(below);
        }
        json
    }
}

fn volume(sphere: &Sphere) -> Value {
    let [x, y, z] = sphere.center.to_array();
    json!({"sphere": [x, y, z, sphere.radius]})
}
