//! Finds the finest tiles: walks the trees of all tilesets and leaves out tiles that finer ones replace.
//!
//! A tile is read if it has no children, or if its refinement is additive, so that it remains visible with them. Children without content replace a tile by nothing, as in
//! viewers: the finer surface may be below one of its siblings. An external tileset takes the place of the tile that refers to it. A tileset that is referenced twice is refused: the reference would be circular, or the surface would be included twice,
//! and a few small files could refer to each other billions of times. A mesh that is named twice is refused where it stands at the same place.
//!
//! A tileset stays in memory while those that it names are walked, without its text: all of them together must fit.

use super::super::ReadError;
use super::super::gltf::{Tally, json_of};
use super::content::{gunzip, is_gzip};
use super::names::{Named, Names, Referrer, shown};
use super::schema::{Content, Tile, Tileset};
use super::{UpAxis, is_tileset};
use glam::{DAffine3, DMat3, DVec3};
use kilwa_pack::plural::counted;
use std::collections::HashSet;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Maximum depth of the tree, across all tilesets.
const MAX_DEPTH: usize = 200;
/// Objects and lists in each other in one file, which serde_json allows. A tile takes two, and what it contains up to four.
const MAX_LEVELS: usize = 127;
/// Extensions that a tileset may require: those that are read, and those that do not affect the surface.
const KNOWN_EXTENSIONS: &[&str] = &[
    "3DTILES_bounding_volume_S2",
    "3DTILES_content_gltf",
    "3DTILES_metadata",
    "3DTILES_multiple_contents",
    "3DTILES_batch_table_hierarchy",
];
const EXPORT: &str =
    "Export it again with explicit tiles in b3dm or glTF, or give the mesh that the tiles were made from";

/// A file with a mesh that is part of the finest surface.
pub(super) struct Leaf {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    pub(super) root_from_tile: DAffine3,
    pub(super) up: UpAxis,
}

/// What is to be read.
#[derive(Default)]
pub(super) struct Plan {
    pub(super) leaves: Vec<Leaf>,
    /// Tiles with content that finer ones replace.
    pub(super) coarser: u64,
    /// The number of these whose descendants have no content.
    pub(super) replaced_by_nothing: u64,
    /// External tilesets.
    pub(super) external: u64,
}

/// What a tile inherits from its ancestors.
#[derive(Clone, Copy)]
struct Above {
    root_from_tile: DAffine3,
    is_added_to: bool,
    depth: usize,
}

/// The file that is being walked.
struct File<'a> {
    path: &'a Path,
    folders: &'a [String],
    up: UpAxis,
    /// The child indices from its root to the current tile.
    trail: Vec<usize>,
}

impl File<'_> {
    /// The JSON path of a part, for messages.
    fn place(&self, part: &str) -> String {
        let children = self.trail.iter().map(|i| format!(".children[{i}]"));
        format!("root{}{}{part}", children.collect::<String>(), if part.is_empty() { "" } else { "." })
    }

    fn error(&self, part: &str, found: String, expected: &str) -> ReadError {
        ReadError::Part { file: self.path.to_owned(), part: self.place(part), found, expected: expected.to_owned() }
    }

    fn needs(&self, needs: String) -> ReadError {
        ReadError::Needs { file: self.path.to_owned(), needs, way_out: EXPORT }
    }
}

struct Walk<'a> {
    names: Names<'a>,
    plan: Plan,
    /// Real paths of all tilesets, and of those that are being walked.
    met: HashSet<PathBuf>,
    open: Vec<PathBuf>,
    /// Real paths of the meshes and where they stand.
    shown: HashSet<(PathBuf, UpAxis, [u64; 12])>,
    /// Bytes of memory that tilesets which are being walked have left.
    left: u64,
}

/// The plan for a tileset whose JSON is `json`.
///
/// # Errors
/// [`ReadError`], as the module says.
pub(super) fn plan(json: Vec<u8>, path: &Path, names: Names<'_>) -> Result<Plan, ReadError> {
    let left = names.options.document;
    let (met, shown) = (HashSet::new(), HashSet::new());
    let mut walk = Walk { names, plan: Plan::default(), met, open: Vec::new(), shown, left };
    let above = Above { root_from_tile: DAffine3::IDENTITY, is_added_to: false, depth: 0 };
    walk.tileset(json, path, &[], above, UpAxis::Y)?;
    Ok(walk.plan)
}

impl Walk<'_> {
    /// Walk a tileset; returns whether anything in it has content.
    fn tileset(
        &mut self,
        json: Vec<u8>,
        path: &Path,
        folders: &[String],
        above: Above,
        up: UpAxis,
    ) -> Result<bool, ReadError> {
        let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        self.met.insert(real.clone());
        self.open.push(real);
        let (tileset, taken) = parse(&json, path, &self.names, self.left)?;
        drop(json);
        self.left -= taken;
        let mut file = File { path, folders, up, trail: Vec::new() };
        if let Some(axis) = &tileset.asset.gltf_up_axis {
            file.up = UpAxis::of(axis).ok_or_else(|| ReadError::Part {
                file: path.to_owned(),
                part: "asset.gltfUpAxis".to_owned(),
                found: format!("\"{}\"", shown(axis)),
                expected: "X, Y or Z".to_owned(),
            })?;
        }
        let has_content = self.tile(&tileset.root, &mut file, above)?;
        self.open.pop();
        self.left += taken;
        Ok(has_content)
    }

    /// Walk a tile; returns whether it or any descendant has content.
    fn tile(&mut self, tile: &Tile, file: &mut File<'_>, above: Above) -> Result<bool, ReadError> {
        if above.depth == MAX_DEPTH {
            return Err(file.needs(format!("has tiles nested more than {MAX_DEPTH} levels deep")));
        }
        if tile.is_implicit() {
            return Err(file.needs(format!("has implicit tiling in {}, which is not read", file.place(""))));
        }
        let here = below(tile, file, above)?;
        // Tilesets among its contents do not refine it: they are shown with the others.
        let is_refined = !tile.children.is_empty();
        let (mut own, mut has_below) = (Vec::new(), false);
        for (part, content) in tile.contents() {
            let Some(uri) = content.uri() else {
                let part = format!("{part}.uri");
                return Err(file.error(&part, "nothing".to_owned(), "the path of a file; export the tileset again"));
            };
            let may_be_missing = is_refined && !here.is_added_to;
            match self.external(uri, &format!("{part}.uri"), file, may_be_missing)? {
                Some(named) => has_below |= self.enter(&named, &format!("{part}.uri"), file, here)?,
                None => own.push((part, content)),
            }
        }
        for (i, child) in tile.children.iter().enumerate() {
            file.trail.push(i);
            has_below |= self.tile(child, file, here)?;
            file.trail.pop();
        }
        if is_refined && !here.is_added_to {
            self.plan.coarser += u64::from(!own.is_empty());
            self.plan.replaced_by_nothing += u64::from(!own.is_empty() && !has_below);
        } else {
            self.take(&own, file, here)?;
        }
        Ok(has_below || !own.is_empty())
    }

    /// Add the content of a tile to the plan.
    fn take(&mut self, own: &[(String, &Content)], file: &File<'_>, here: Above) -> Result<(), ReadError> {
        for (part, content) in own {
            let place = file.place(&format!("{part}.uri"));
            let from = Referrer { path: file.path, folders: file.folders };
            let Named { path, .. } = self.names.locate(content.uri().unwrap_or_default(), &place, from)?;
            let real = path.canonicalize().unwrap_or_else(|_| path.clone());
            // 0 and -0 are the same place.
            let columns = here.root_from_tile.to_cols_array().map(|x| (x + 0.0).to_bits());
            if !self.shown.insert((real, file.up, columns)) {
                let name = shown(&path.display().to_string());
                let found = format!("the file {name}, which stands there already: its surface would be included twice");
                return Err(file.error(
                    &format!("{part}.uri"),
                    found,
                    "each file once at a place; export the tileset again",
                ));
            }
            let bytes = path.metadata().map_or(0, |about| about.len());
            self.plan.leaves.push(Leaf { path, bytes, root_from_tile: here.root_from_tile, up: file.up });
        }
        Ok(())
    }

    /// The tileset that a URI refers to; `None` for anything else. Only files without a known extension are opened to find out.
    /// Where it may be missing, it is no tileset if it is.
    fn external(
        &self,
        uri: &str,
        part: &str,
        file: &File<'_>,
        may_be_missing: bool,
    ) -> Result<Option<Named>, ReadError> {
        let name = uri.split(['?', '#']).next().unwrap_or(uri).to_ascii_lowercase();
        let is_of = |extensions: &[&str]| extensions.iter().any(|e| name.ends_with(e));
        if is_of(&[".b3dm", ".glb", ".gltf", ".cmpt", ".i3dm", ".pnts", ".vctr"]) {
            return Ok(None);
        }
        let from = Referrer { path: file.path, folders: file.folders };
        if is_of(&[".json"]) {
            return self.names.locate(uri, &file.place(part), from).map(Some);
        }
        let named = if may_be_missing {
            let Some(named) = self.names.find(uri, &file.place(part), from)? else { return Ok(None) };
            named
        } else {
            self.names.locate(uri, &file.place(part), from)?
        };
        let mut start = Vec::new();
        let opened = self.names.companions.open(&named.path);
        opened
            .and_then(|(source, _)| source.take(super::super::SNIFFED).read_to_end(&mut start))
            .map_err(|source| ReadError::Open { file: named.path.clone(), source })?;
        Ok(is_tileset(&start, 0).then_some(named))
    }

    /// Walk an external tileset.
    fn enter(&mut self, named: &Named, part: &str, file: &File<'_>, here: Above) -> Result<bool, ReadError> {
        let real = named.path.canonicalize().unwrap_or_else(|_| named.path.clone());
        if self.met.contains(&real) {
            let name = shown(&named.path.display().to_string());
            let found = if self.open.contains(&real) {
                format!("the tileset {name}, which contains this one (a circular reference)")
            } else {
                format!("the tileset {name}, which another tile also refers to: its surface would be included twice")
            };
            return Err(file.error(part, found, "a tree of tilesets; export the tileset again"));
        }
        let cannot = |source| ReadError::Open { file: named.path.clone(), source };
        let (source, bytes) = self.names.companions.open(&named.path).map_err(cannot)?;
        let json = whole(source, bytes, &named.path, self.left)?;
        self.plan.external += 1;
        self.tileset(json, &named.path, &named.folders, here, file.up)
    }
}

/// All bytes of a JSON file, uncompressed.
///
/// # Errors
/// [`ReadError`] where it cannot be read, or has more bytes than memory allows.
pub(super) fn whole(source: impl Read, bytes: u64, path: &Path, max: u64) -> Result<Vec<u8>, ReadError> {
    check_memory(bytes, path, max)?;
    let mut json = Vec::new();
    let read = source.take(max).read_to_end(&mut json);
    read.map_err(|source| ReadError::Io { file: path.to_owned(), offset: 0, source })?;
    if is_gzip(&json) { gunzip(&json[..], path, max) } else { Ok(json) }
}

fn check_memory(bytes: u64, path: &Path, max: u64) -> Result<(), ReadError> {
    if bytes <= max {
        return Ok(());
    }
    let what = format!(
        "its JSON may take {} MiB of memory, and {} MiB are left for it and the tilesets that it names; give a larger --memory",
        bytes.div_ceil(1 << 20),
        max >> 20
    );
    Err(ReadError::TooLarge { file: path.to_owned(), what })
}

/// The tileset, and the bytes that it takes in memory without its text.
fn parse(json: &[u8], path: &Path, names: &Names<'_>, max: u64) -> Result<(Tileset, u64), ReadError> {
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let taken = Tally::of(json).bytes();
    check_memory(json.len() as u64 + taken, path, max)?;
    let parsed = json_of(json, path, names.companions, "a tileset of 3D Tiles 1.0 or 1.1");
    let tileset: Tileset = parsed.map_err(|e| too_deep(e, path))?;
    let needs = |needs| ReadError::Needs { file: path.to_owned(), needs, way_out: EXPORT };
    // Drafts of 1.0 have 0.0.
    if !["0.0", "1.0", "1.1"].contains(&tileset.asset.version.as_str()) {
        let version = shown(&tileset.asset.version);
        return Err(needs(format!("is a tileset of 3D Tiles {version}; only 1.0 and 1.1 are supported")));
    }
    let unknown = tileset.extensions_required.iter().filter(|name| !KNOWN_EXTENSIONS.contains(&name.as_str()));
    let unknown: Vec<String> = unknown.take(5).map(|name| shown(name)).collect();
    if !unknown.is_empty() {
        return Err(needs(format!("requires 3D Tiles extensions that are not read: {}", unknown.join(", "))));
    }
    Ok((tileset, taken))
}

/// An error of the parser; where it is that of JSON which goes too deep, in our words, because then nothing is damaged.
fn too_deep(e: ReadError, path: &Path) -> ReadError {
    match e {
        ReadError::Part { found, .. } if found.contains("recursion limit exceeded") => ReadError::Needs {
            file: path.to_owned(),
            needs: format!(
                "has more than the {MAX_LEVELS} levels of JSON that are read (some 60 tiles one below the other in one file)"
            ),
            way_out: "Export it again with its tiles in several tilesets, or give the mesh that the tiles were made from",
        },
        other => other,
    }
}

/// What the children of a tile inherit.
fn below(tile: &Tile, file: &File<'_>, above: Above) -> Result<Above, ReadError> {
    let is_added_to = match tile.refine.as_deref() {
        None => above.is_added_to,
        // Drafts of 1.0 have lower case.
        Some(refine) if refine.eq_ignore_ascii_case("replace") => false,
        Some(refine) if refine.eq_ignore_ascii_case("add") => true,
        Some(other) => {
            return Err(file.error("refine", format!("\"{}\"", shown(other)), "REPLACE or ADD"));
        }
    };
    let Some(own) = &tile.transform else {
        return Ok(Above { is_added_to, depth: above.depth + 1, ..above });
    };
    if own[3] != 0.0 || own[7] != 0.0 || own[11] != 0.0 || own[15] != 1.0 {
        let found = format!("a matrix whose last row is {} {} {} {}", own[3], own[7], own[11], own[15]);
        let expected = "0 0 0 1, in column-major order; export the tileset again";
        return Err(file.error("transform", found, expected));
    }
    let column = |i: usize| DVec3::from_slice(&own[4 * i..]);
    let own = DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
    let root_from_tile = above.root_from_tile * own;
    if !root_from_tile.is_finite() {
        let found = "a matrix that overflows when multiplied with those of its parents".to_owned();
        return Err(file.error("transform", found, "finite numbers; export the tileset again"));
    }
    Ok(Above { root_from_tile, is_added_to, depth: above.depth + 1 })
}

impl Plan {
    /// The error for a tileset without any mesh.
    pub(super) fn nothing(&self, path: &Path) -> ReadError {
        let found = match self.leaves.len() {
            0 => "no tile has content".to_owned(),
            n => format!("no triangles in its {} of the finest level", counted(n as u64, "tile", "tiles")),
        };
        ReadError::NoTriangles { file: path.to_owned(), found, way_out: "Export the tileset again" }
    }
}
