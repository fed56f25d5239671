//! `kilwa extract --to tiles`: the hierarchy of a pack as 3D Tiles.

use super::Args;
use crate::info::grouped;
use crate::source::{FileSource, open_pack};
use crate::tiles::{Place, ProfileArg, parse_geoid_offset, write};
use crate::verify::progress_bar;
use kilwa_archive::metadata::crs::normalise;
use kilwa_formats::extract::tiles::{Folder, Profile, Tileset};
use kilwa_pack::Reader;
use kilwa_pack::plural::plural;
use std::io::Write as _;

/// Options of 3D Tiles.
#[derive(Debug, clap::Args)]
pub(super) struct TilesArgs {
    /// 3D Tiles: compressed for browsers (web), or without extensions for QGIS, Unreal and Blender (plain).
    #[arg(long, value_name = "PROFILE", default_value = "web", requires = "to")]
    profile: ProfileArg,
    /// 3D Tiles: height of the geoid above the ellipsoid at the site, in metres. It is added to all heights, because the globe needs ellipsoidal heights.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, requires = "to", value_parser = parse_geoid_offset)]
    geoid_offset: Option<f64>,
    /// 3D Tiles: the reference system of the coordinates, for a pack that states none or one that Kilwa cannot convert (EPSG:N); local: do not place
    /// the model on the globe.
    #[arg(long, value_name = "EPSG:N", requires = "to")]
    crs: Option<String>,
}

/// Where the model is on the earth; `None` for a local model.
fn place(reader: &Reader<FileSource>, args: &TilesArgs) -> anyhow::Result<Option<Place>> {
    let crs = match &args.crs {
        Some(given) => normalise(given).map_err(|why| anyhow::anyhow!("--crs: {why}"))?,
        None => reader.metadata().crs.clone(),
    };
    let Some(crs) = crs else {
        anyhow::ensure!(
            args.geoid_offset.is_none(),
            "--geoid-offset is for models with a coordinate reference system, and this one has none; add --crs EPSG:N"
        );
        return Ok(None);
    };
    let place = Place::new(crs, args.geoid_offset).map_err(|why| {
        anyhow::anyhow!("{why}; give the projected system of its coordinates with --crs EPSG:N, or use --crs local")
    })?;
    Ok(Some(place))
}

pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = Folder::prepare(&args.output)?;
    let reader = open_pack(&args.pack)?;
    let place = place(&reader, &args.tiles)?;
    let bar = progress_bar(0, "writing tiles");
    let progress = |done, all| {
        bar.set_length(all);
        bar.set_position(done);
    };
    let written = write(&reader, args.tiles.profile, place.as_ref(), &folder, &progress);
    bar.finish_and_clear();
    let written = written.map_err(|e| {
        if e.is_of_output() { e.into() } else { anyhow::Error::new(e).context(args.pack.display().to_string()) }
    })?;
    let notes = notes(&args.tiles, place.as_ref());
    if args.json { json(args, &written, place.as_ref(), &notes) } else { text(args, &written, &notes) }
}

/// What the user should know about the model's position.
fn notes(args: &TilesArgs, place: Option<&Place>) -> Vec<String> {
    let Some(place) = place else {
        let why = if args.crs.is_some() {
            "--crs local was given"
        } else {
            "the pack has no coordinate reference system; set one with --crs EPSG:N"
        };
        return vec![format!("The tileset keeps the coordinates of the pack and is not placed on the globe: {why}.")];
    };
    place.notes()
}

fn json(args: &Args, written: &Tileset, place: Option<&Place>, notes: &[String]) -> anyhow::Result<()> {
    let report = serde_json::json!({
        "output": args.output.display().to_string(),
        "format": "tiles",
        "profile": Profile::from(args.tiles.profile).name(),
        "tiles": written.tiles,
        "tilesets": written.tilesets,
        "bytes": written.bytes,
        "largest_tile_bytes": written.largest_tile,
        "triangles": written.triangles,
        "stored_triangles": written.stored_triangles,
        "stored_vertices": written.stored_vertices,
        "grid_spacing": written.spacing,
        "crs": place.map(|place| &place.crs),
        "geoid_offset": place.map(Place::geoid_offset),
        "per_vertex": written.is_curved,
        "affine_residual": written.residual,
        "left_out": written.left_out,
        "notes": notes,
    });
    writeln!(crate::terminal::out(), "{}", crate::terminal::json_text(&report)?)?;
    Ok(())
}

fn text(args: &Args, written: &Tileset, notes: &[String]) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    writeln!(
        out,
        "{}: {} {}, {} {} at the finest level, {} at all levels, {} {} ({:.2} per triangle of the finest level).",
        args.output.display(),
        grouped(written.tiles),
        plural(written.tiles, "tile", "tiles"),
        grouped(written.triangles),
        plural(written.triangles, "triangle", "triangles"),
        grouped(written.stored_triangles),
        grouped(written.bytes),
        plural(written.bytes, "byte", "bytes"),
        written.bytes as f64 / written.triangles.max(1) as f64
    )?;
    if !written.left_out.is_empty() {
        writeln!(out, "  The tiles do not store {}.", written.left_out.join(", "))?;
    }
    for note in notes {
        writeln!(out, "  {note}")?;
    }
    Ok(())
}
