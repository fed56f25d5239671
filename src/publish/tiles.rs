//! `kilwa publish --tiles`: all levels of detail as 3D Tiles become part of a version, in `tiles/`.

use super::Args;
use super::plan::Given;
use super::progress::{Progress, Stage};
use crate::source;
use crate::tiles::{Place, ProfileArg, write};
use anyhow::{Context, anyhow, ensure};
use kilwa_archive::Manifest;
use kilwa_archive::draft::Draft;
use kilwa_archive::layout::{FILES_MAX, TILES, TILESET};
use kilwa_archive::record::PublishedTiles;
use kilwa_formats::extract::tiles::Folder;
use std::path::{Path, PathBuf};

/// Bytes for a triangle of the finest level, on the safe side of what was measured (docs/decisions/0080-tiles-of-groups.md).
const WEB: u64 = 12;
const PLAIN: u64 = 45;

/// The tiles of a version that is being made.
pub(super) struct Made {
    pub(super) published: PublishedTiles,
    /// What could not be made, and why.
    pub(super) left_out: Option<String>,
    /// What people should know about their place.
    pub(super) warnings: Vec<String>,
}

/// Check that tiles can be made of the pack.
///
/// # Errors
/// Why they cannot, and what to do.
pub(super) fn check(args: &Args, given: &Given) -> anyhow::Result<()> {
    if args.tiles.is_none() {
        return Ok(());
    }
    ensure!(
        !given.of_pack.is_of_points(),
        "{}: 3D Tiles are made of meshes, and this pack has points; publish it without --tiles",
        given.pack.display()
    );
    if args.geoid_offset.is_none() {
        return Ok(());
    }
    // Within the cell of a redacted location, the geoid offset would narrow the place down to a contour line.
    let crs = given.of_pack.crs.clone().filter(|_| given.place.is_none());
    let crs = crs.context(
        "--geoid-offset is for models that are published with their coordinate reference system, and this one is not; omit it",
    )?;
    Place::new(crs, args.geoid_offset).map(drop).map_err(|why| anyhow!("{why}; omit --geoid-offset"))
}

/// A warning if the previous version has tiles and this one does not.
pub(super) fn lost(args: &Args, before: Option<&Manifest>) -> Option<String> {
    let had = before.and_then(|m| m.versions.last()).is_some_and(|v| v.tiles.is_some());
    (had && args.tiles.is_none())
        .then(|| "the previous version has 3D Tiles, and this one has none (--tiles)".to_owned())
}

/// Disk space for the tiles, bytes.
pub(super) fn need(args: &Args, given: &Given) -> u64 {
    let of_triangle = match args.tiles {
        None => 0,
        Some(ProfileArg::Web) => WEB,
        Some(ProfileArg::Plain) => PLAIN,
    };
    given.of_pack.triangles.saturating_mul(of_triangle)
}

/// Write the tiles of the published pack into the draft, if they are requested.
///
/// # Errors
/// If the pack cannot be read or the disk refuses.
pub(super) fn make(
    args: &Args,
    given: &Given,
    pack: &Path,
    draft: &mut Draft<'_>,
    progress: &Progress,
) -> anyhow::Result<Option<Made>> {
    let Some(profile) = args.tiles else { return Ok(None) };
    progress.begin(Stage::Tiles);
    let reader = source::open_pack(pack)?;
    let place = match reader.metadata().crs.clone() {
        Some(_) if given.place.is_some() => Err("the location was removed or made coarser".to_owned()),
        None => Err("the published model has no coordinate reference system".to_owned()),
        Some(crs) => Place::new(crs, args.geoid_offset),
    };
    let left_out = place.as_ref().err().map(|why| format!("the place of the 3D Tiles on the globe: {why}"));
    let place = place.ok();
    let warnings = place.iter().flat_map(Place::notes).map(|note| format!("3D Tiles: {note}")).collect();
    let at = draft.folder().join(TILES);
    let written = write(&reader, profile, place.as_ref(), &Folder::prepare(&at)?, &|done, all| progress.at(done, all));
    let written = written.with_context(|| format!("cannot make the 3D Tiles of {}", pack.display()))?;
    ensure!(
        written.tiles + written.tilesets < FILES_MAX as u64 / 2,
        "{}: there would be {} 3D Tiles, too many files for a version; publish it without --tiles, and serve the tiles of kilwa extract --to tiles separately",
        given.pack.display(),
        written.tiles
    );
    let mut files = Vec::new();
    list(&at, TILES, &mut files).with_context(|| format!("cannot read {}", at.display()))?;
    files.sort();
    let mut root = None;
    for file in files {
        let adopted = draft.adopt(&file)?;
        if file == TILESET {
            root = Some(adopted);
        }
    }
    let (root_bytes, sha256) = root.with_context(|| format!("{} was not written", at.display()))?;
    let published = PublishedTiles {
        root_bytes,
        sha256,
        tiles: written.tiles,
        bytes: written.bytes,
        is_compressed: profile == ProfileArg::Web,
        is_on_globe: place.is_some(),
        geoid_offset: place.as_ref().map(Place::geoid_offset),
    };
    Ok(Some(Made { published, left_out, warnings }))
}

/// The paths of the files in a folder, with `/`.
fn list(folder: &Path, name: &str, files: &mut Vec<String>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path: PathBuf = entry.path();
        let name = format!("{name}/{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            list(&path, &name, files)?;
        } else {
            files.push(name);
        }
    }
    Ok(())
}
